"""Do the tests notice small changes of the core? Builds it with many mutants in one program and runs the tests on each.

    python tests/mutation/mutate.py [--count 300] [--seed 1] [--suite unit|quick|wide] [--modules NAME ...]

A mutant is killed when a test fails, crashes or does not end; it survives when all pass. What survives must be listed in
equivalent.csv, with the reason why no test can or need tell it from the original. Results are in build/mutation/results.csv;
--survivors repeats only those that survived the last time, --mutants those with the given numbers. The last line is
"N passed, M failed": passed is killed or listed. Needs meson, ninja and pytest on PATH, as in .venv; see docs/testing.md.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from schemata import Mutant, Source, instrumented, read_source

CHECKOUT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
FOLDER = CHECKOUT / "build" / "mutation"
TREE = FOLDER / "tree"
BUILD = FOLDER / "build"
PREFIX = FOLDER / "prefix"
RESULTS = FOLDER / "results.csv"
EQUIVALENT = HERE / "equivalent.csv"

# Physics, numerics, motion, results. Deck, files and sweeps have their own proofs (fuzzing, damaged files, kills).
MODULES = """friction slider drive contact full_model low_frequency straight_slip slip_system stepper trajectory radau newton_kernels
newton_kernel.inc gauss_jordan.inc collocation interpolation bernstein runge_kutta runge_kutta_tableaux moreau_jean linear_solve creep
creep_motion stability observables summary lanes model_choice simulation""".split()  # fmt: skip
# Tables of coefficients would otherwise be a quarter of all mutants.
WEIGHTS = {"runge_kutta_tableaux.f90": 0.1}
# More mutants of one statement tell little more.
MOST_PER_STATEMENT = 2

UNIT_TESTS = "collocation models stability creep giving_up moreau_jean radau resume runge_kutta trajectory".split()
# Of each file the tests that take less than a second or so; the others are in the wide suite.
QUICK = {
    "test_creep": "", "test_stability": "", "test_lanes": "", "test_stick_slip": "",
    "test_python_api": "not leak and not threads", "test_models": "not profiles and not methods_agree",
    "test_references": "not number_of_sticks", "test_simulation": "not bar",
}  # fmt: skip
WIDE = """test_models test_references test_python_api test_model_choice test_kinds test_scene test_decks test_checkpoint test_sweep
test_sweep_points test_sweep_python test_trade test_maps test_paper test_validate_creep test_handover test_spectrum ../extremes""".split()

FIELDS = ["number", "file", "line", "procedure", "original", "mutated", "occurrence", "verdict", "killed_by", "seconds"]


@dataclass
class Check:
    """A command that must succeed, what it took without a mutant, which mutants it reaches, and how many it has killed."""

    name: str
    command: list[str]
    seconds: float = 0.0
    reaches: frozenset[int] = frozenset()
    kills: dict[str, int] = field(default_factory=dict)


def sources() -> list[Source]:
    names = [name if name.endswith(".inc") else f"{name}.f90" for name in MODULES]
    return [read_source(name, (CHECKOUT / "src" / name).read_text()) for name in names if (CHECKOUT / "src" / name).exists()]


def choose(all_sources: list[Source], count: int, seed: int, modules: list[str]) -> dict[int, Mutant]:
    """The mutants that rank highest; what is chosen in one file does not hang on another."""
    everything = [mutant for source in all_sources for found in source.mutants.values() for mutant in found]
    for mutant in everything:
        mutant.number = 0
    ranked = sorted(
        (mutant for mutant in everything if not modules or Path(mutant.file).stem in modules),
        key=lambda mutant: mutant.rank(seed, WEIGHTS.get(mutant.file, 1.0)), reverse=True)  # fmt: skip
    chosen: dict[int, Mutant] = {}
    per_statement: dict[tuple[str, int], int] = {}
    for mutant in ranked:
        place = (mutant.file, mutant.line)
        if len(chosen) == count:
            break
        if per_statement.get(place, 0) < MOST_PER_STATEMENT and mutant.key not in rejected():
            per_statement[place] = per_statement.get(place, 0) + 1
            mutant.number = len(chosen) + 1
            chosen[mutant.number] = mutant
    return chosen


_rejected: set[tuple] = set()


def rejected() -> set[tuple]:
    """Mutants that the compiler has refused, in this and earlier builds."""
    path = FOLDER / "rejected.txt"
    if not _rejected and path.exists():
        _rejected.update(eval(line) for line in path.read_text().splitlines())  # noqa: S307
    return _rejected


def reject(mutants: list[Mutant]) -> None:
    rejected().update(mutant.key for mutant in mutants)
    (FOLDER / "rejected.txt").write_text("".join(f"{key!r}\n" for key in sorted(rejected())))


def put(path: Path, text: str) -> None:
    """Write what has changed only, so that ninja builds no more than that."""
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def copy_tree() -> None:
    """The checkout without what the mutants do not need; sources of src/ come from write_sources."""
    for name in ["meson.build", "meson.options", "src", "python", "tests/unit", "tools", "inputs"]:
        origin = CHECKOUT / name
        for path in [origin] if origin.is_file() else [path for path in origin.rglob("*") if path.is_file()]:
            relative = path.relative_to(CHECKOUT)
            if "__pycache__" in relative.parts or (relative.parts[0] == "src" and path.suffix in (".f90", ".inc")):
                continue
            text = path.read_text()
            if path.name == "meson.build":
                text = re.sub(r"subdir\('(tests/fuzz|tests/threads|bench)'\)", "", text)
                text = text.replace("core_sources, precision,", "core_sources, precision, 'mutant.f90', 'mutant.c',", 1)
                text = text.replace("link_with: test_tools)", "link_with: test_tools, link_language: 'fortran')")
            put(TREE / relative, text)
    for name in ("mutant.f90", "mutant.c"):
        put(TREE / "src" / name, (HERE / name).read_text())


def write_sources(all_sources: list[Source], chosen: dict[int, Mutant]) -> dict[str, dict[int, list[int]]]:
    places = {}
    for source in all_sources:
        text, places[source.name] = instrumented(source, chosen)
        put(TREE / "src" / source.name, text)
    for path in (CHECKOUT / "src").glob("*.f90"):
        if path.name not in places:
            put(TREE / "src" / path.name, path.read_text())
    return places


def build(all_sources: list[Source], count: int, seed: int, modules: list[str], python: bool) -> dict[int, Mutant]:
    """Build with the chosen mutants; those that the compiler refuses are replaced by others."""
    while True:
        chosen = choose(all_sources, count, seed, modules)
        copy_tree()
        places = write_sources(all_sources, chosen)
        if not (BUILD / "build.ninja").exists():
            subprocess.run(["meson", "setup", BUILD, TREE, f"--prefix={PREFIX}", "-Dpython.install_env=prefix", "-Doptimization=1",
                            "-Ddebug=false", f"-Dpython={str(python).lower()}", "-Dfortran_args=-ffree-line-length-none -w"],
                           check=True, stdout=subprocess.DEVNULL)  # fmt: skip
        elif python:
            subprocess.run(["meson", "configure", BUILD, "-Dpython=true"], check=True, stdout=subprocess.DEVNULL)
        done = subprocess.run(["ninja", "-C", BUILD, "-k", "0", "-j", str(JOBS)], text=True, capture_output=True, check=False)
        if done.returncode == 0:
            break
        refused = {
            number
            for name, line in re.findall(r"([\w.]+\.(?:f90|inc)):(\d+):\d+:\n(?:.*\n){0,6}?Error:", done.stdout)
            for number in places.get(name, {}).get(int(line), [])
        }
        if not refused:
            sys.exit(done.stdout[-6000:] + done.stderr)
        print(f"The compiler refuses {len(refused)} mutants; they are replaced", flush=True)
        for number in sorted(refused):
            print(f"    {chosen[number].original} -> {chosen[number].mutated}", flush=True)
        reject([chosen[number] for number in refused])
    if python:
        subprocess.run(["meson", "install", "-C", BUILD, "--quiet", "--no-rebuild"], check=True, stdout=subprocess.DEVNULL)
    return chosen


def checks_of(suite: str) -> list[Check]:
    checks = [Check(f"unit {name}", [str(BUILD / "tests" / "unit" / f"test_{name}")]) for name in UNIT_TESTS]
    pytest = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", "not full"]
    for name, selection in QUICK.items() if suite != "unit" else ():
        path = CHECKOUT / "tests" / "python" / f"{name}.py"
        checks.append(Check(name, [*pytest, str(path), *(["-k", selection] if selection else [])]))
    for name in WIDE if suite == "wide" else ():
        path = (CHECKOUT / "tests" / "python" / (f"{name}.py" if name.startswith("test_") else name)).resolve()
        checks.append(Check(f"all of {path.stem}", [*pytest, str(path)]))
    return checks


def run(check: Check, mutant: int, limit: float, reached: Path | None = None) -> str:
    """'' when all passed, else what failed."""
    environment = {**os.environ, "DYNSTICTION_MUTANT": str(mutant), "DYNSTICTION_EXE": str(BUILD / "src" / "dynstiction"),
                   "PYTHONPATH": str(next(PREFIX.glob("lib/python*/site-packages"), "")), "OMP_NUM_THREADS": "1",
                   "PYTHONDONTWRITEBYTECODE": "1", **({"DYNSTICTION_MUTANTS_REACHED": str(reached)} if reached else {})}  # fmt: skip
    with subprocess.Popen(check.command, cwd=FOLDER, env=environment, text=True, errors="replace", stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True) as process:  # fmt: skip
        try:
            output, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return "no end"
    if process.returncode == 0:
        return ""
    failed = re.search(r"^(?:FAILED:? |ERROR )(.*)$", output, re.MULTILINE)
    return failed[1][:100] if failed else f"exit status {process.returncode}"


def prepare(checks: list[Check]) -> None:
    """Run the checks without a mutant: they must pass. Note what they take and reach."""
    for check in checks:
        reached = FOLDER / "reached.txt"
        reached.unlink(missing_ok=True)
        start = time.monotonic()
        failure = run(check, 0, 900.0, reached)
        check.seconds = time.monotonic() - start
        check.reaches = frozenset(map(int, reached.read_text().split())) if reached.exists() else frozenset()
        print(f"  {check.name}: {check.seconds:.1f} s, reaches {len(check.reaches)} mutants", flush=True)
        if failure:
            sys.exit(f"{check.name} fails without a mutant: {failure}")


def verdict_of(mutant: Mutant, checks: list[Check]) -> tuple[str, str]:
    """The checks that reach it, in the order in which they are likely to kill soon: those of the same file, and fast ones, first."""
    def promise(check: Check) -> float:
        return (0.2 + check.kills.get(mutant.file, 0) + 0.1 * sum(check.kills.values())) / max(check.seconds, 0.01)

    reaching = [check for check in checks if mutant.number in check.reaches]
    for check in sorted(reaching, key=promise, reverse=True):
        failure = run(check, mutant.number, 3.0 * check.seconds + 5.0)
        if failure:
            check.kills[mutant.file] = check.kills.get(mutant.file, 0) + 1
            return "killed", f"{check.name}: {failure}"
    return "survived", "" if reaching else "not reached"


def read_table(path: Path) -> dict[tuple, dict[str, str]]:
    if not path.exists():
        return {}
    with path.open(newline="") as file:
        return {(row["file"], row["procedure"], row["original"], row["mutated"], int(row["occurrence"])): row for row in csv.DictReader(file)}


def write_results(rows: dict[tuple, dict[str, str]]) -> None:
    with RESULTS.open("w", newline="") as file:
        table = csv.DictWriter(file, FIELDS)
        table.writeheader()
        table.writerows(rows.values())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--suite", choices=["unit", "quick", "wide"], default="quick")
    parser.add_argument("--modules", nargs="+", default=[])
    parser.add_argument("--survivors", action="store_true", help="only those that survived the last time and are not listed")
    parser.add_argument("--mutants", type=int, nargs="+", help="only these numbers")
    parser.add_argument("--jobs", type=int, default=1, help="processes of the compiler")
    parser.add_argument("--build-only", action="store_true")
    options = parser.parse_args()
    global JOBS  # noqa: PLW0603
    JOBS = options.jobs

    FOLDER.mkdir(parents=True, exist_ok=True)
    all_sources = sources()
    total = sum(len(found) for source in all_sources for found in source.mutants.values())
    chosen = build(all_sources, options.count, options.seed, options.modules, options.suite != "unit")
    print(f"{len(chosen)} of {total} mutants in {len({mutant.file for mutant in chosen.values()})} files", flush=True)
    if options.build_only:
        return 0
    checks = checks_of(options.suite)
    prepare(checks)
    equivalent, results = read_table(EQUIVALENT), read_table(RESULTS)
    failed = 0
    tried = [mutant for mutant in chosen.values()
             if (not options.mutants or mutant.number in options.mutants)
             and (not options.survivors or (mutant.key not in equivalent and results.get(mutant.key, {}).get("verdict") != "killed"))]  # fmt: skip
    for mutant in tried:
        start = time.monotonic()
        verdict, by = ("listed", "") if mutant.key in equivalent else verdict_of(mutant, checks)
        results[mutant.key] = dict(zip(FIELDS, map(str, (mutant.number, mutant.file, mutant.line, mutant.procedure, mutant.original,
                                   mutant.mutated, mutant.occurrence, verdict, by, round(time.monotonic() - start, 1))), strict=True))  # fmt: skip
        write_results(results)
        if verdict == "survived":
            failed += 1
            print(f"{mutant.number}: {mutant.file}:{mutant.line} {mutant.procedure}\n    {mutant.original}\n    {mutant.mutated or '(deleted)'}", flush=True)
    print(f"{len(tried) - failed} passed, {failed} failed")
    return 1 if failed else 0


JOBS = 1
if __name__ == "__main__":
    sys.exit(main())
