"""Do the tests notice small changes of the core? Builds it with many mutants in one program and runs the tests on each.

    python tests/mutation/mutate.py [--count 300] [--seed 1] [--modules NAME ...]

A mutant is killed when a test fails, crashes or does not end; it survives when all pass. What survives must be listed in
equivalent.csv, with the reason why no test can or need tell it from the original. Results are in build/mutation/results.csv;
--mutants takes those with the given numbers. The last line is "N passed, M failed": passed is killed or listed. Needs meson, ninja and pytest on PATH, as in .venv; see tests/README.md.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import resource
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from schemata import Key, Mutant, Source, instrumented, read_source

CHECKOUT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
FOLDER = CHECKOUT / "build" / "mutation"
TREE = FOLDER / "tree"
BUILD = FOLDER / "build"
PREFIX = FOLDER / "prefix"
RESULTS = FOLDER / "results.csv"
EQUIVALENT = HERE / "equivalent.csv"

# Physics, numerics, motion, results. Deck, files and sweeps have their own proofs (fuzzing, damaged files, kills).
ROOMS = ("physics", "numerics", "methods", "motion", "results", "run", "sweep")
OTHERS = {"sweep.f90", "sweep_points.f90", "division.f90", "output_size.f90", "stability_report.f90", "memory_writer.f90"}
# Tables of coefficients would otherwise be a quarter of all mutants.
WEIGHTS = {"runge_kutta_tableaux.f90": 0.1}
# More mutants of one statement tell little more.
MOST_PER_STATEMENT = 2

# Two rounds of tests: only what survives the fast ones is tried by the slow ones. With pytest's -k.
ROUNDS = {
    "fast": {
        "collocation": "", "models": "", "test_stability": "", "creep": "", "test_creep_end": "", "slow_cycles": "", "giving_up": "", "radau": "",
        "resume": "", "runge_kutta": "", "cycle_map": "", "test_columns": "", "test_summary_values": "", "test_creep": "", "test_lanes": "",
        "test_models": "not profiles", "test_model_choice": "not error_stays_below_accuracy",
    },
    "slow": {
        "trajectory": "", "test_stick_slip": "", "test_python_api": "not leak and not threads",
        "test_references": "not number_of_sticks", "test_simulation": "not bar", "test_unstable_sliding": "", "test_friction_peak": "",
        "test_error_codes": "", "test_cycle_map": "", "test_sensitivity": "",
        "test_damping": "", "test_friction_laws": "",
    },
}  # fmt: skip

FIELDS = ["number", "file", "line", "procedure", "original", "mutated", "occurrence", "verdict", "killed_by",
          "seconds"]  # fmt: skip

Table = dict[Key, dict[str, str]]


@dataclass
class Check:
    """A command that must succeed, what it took without a mutant, which mutants it reaches, and how many it has killed."""

    name: str
    command: list[str]
    seconds: float | None = None
    reaches: frozenset[int] = frozenset()
    kills: dict[str, int] = field(default_factory=dict)


def sources() -> list[Source]:
    """The files whose statements are mutated."""
    found = (path for room in ROOMS for path in sorted((CHECKOUT / "src" / room).iterdir()))
    paths = (path for path in found if path.suffix in (".f90", ".inc") and path.name not in OTHERS)
    return [read_source(path.name, path.read_text()) for path in paths]


def choose(all_sources: list[Source], count: int, seed: int, modules: list[str], refused: set[Key]) -> dict[int, Mutant]:
    """The mutants that rank highest, but for those that the compiler refuses; the choice in one file does not depend on another."""
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
        if per_statement.get(place, 0) < MOST_PER_STATEMENT and mutant.key not in refused:
            per_statement[place] = per_statement.get(place, 0) + 1
            mutant.number = len(chosen) + 1
            chosen[mutant.number] = mutant
    return chosen


def put(path: Path, text: str) -> None:
    """Write only the files that have changed, so that ninja builds only these."""
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def copy_tree() -> None:
    """The checkout without what the mutants do not need; sources of src/ come from write_sources."""
    for name in ["meson.build", "meson.options", "src", "python", "tests/unit", "tools", "inputs", "docs/errors.md"]:
        origin = CHECKOUT / name
        for path in [origin] if origin.is_file() else [path for path in origin.rglob("*") if path.is_file()]:
            relative = path.relative_to(CHECKOUT)
            if "__pycache__" in relative.parts or (relative.parts[0] == "src" and path.suffix in (".f90", ".inc")):
                continue
            text = path.read_text()
            if path.name == "meson.build":
                text = re.sub(r"subdir\('(tests/fuzz|tests/threads|bench)'\)", "", text)
                text = text.replace("core_sources, precision,", "core_sources, precision, 'mutant.f90', 'mutant.c',", 1)
            put(TREE / relative, text)
    for name in ("mutant.f90", "mutant.c"):
        put(TREE / "src" / name, (HERE / name).read_text())


def write_sources(all_sources: list[Source], chosen: dict[int, Mutant]) -> dict[str, dict[int, list[int]]]:
    places = {}
    for source in all_sources:
        text, places[source.name] = instrumented(source, chosen)
        put(TREE / next((CHECKOUT / "src").rglob(source.name)).relative_to(CHECKOUT), text)
    for path in (CHECKOUT / "src").rglob("*.f90"):
        if path.name not in places:
            put(TREE / path.relative_to(CHECKOUT), path.read_text())
    return places


def build(all_sources: list[Source], count: int, seed: int, modules: list[str], jobs: int) -> dict[int, Mutant]:
    """Build with the chosen mutants; those that the compiler refuses are replaced by others."""
    rejected: set[Key] = set()
    while True:
        chosen = choose(all_sources, count, seed, modules, rejected)
        copy_tree()
        places = write_sources(all_sources, chosen)
        if not (BUILD / "build.ninja").exists():
            subprocess.run(["meson", "setup", BUILD, TREE, f"--prefix={PREFIX}", "-Dpython.install_env=prefix", "-Doptimization=1",
                            "-Ddebug=false", "-Dfortran_args=-ffree-line-length-none -w"],
                           check=True, stdout=subprocess.DEVNULL)  # fmt: skip
        done = subprocess.run(["ninja", "-C", BUILD, "-k", "0", "-j", str(jobs)], text=True, capture_output=True, check=False)
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
        rejected |= {chosen[number].key for number in refused}
    subprocess.run(["meson", "install", "-C", BUILD, "--quiet", "--no-rebuild"], check=True, stdout=subprocess.DEVNULL)
    return chosen


def checks_of(name: str) -> list[Check]:
    checks = []
    for test, selection in ROUNDS[name].items():
        command = [str(BUILD / "tests" / "unit" / f"test_{test}")]
        if not (CHECKOUT / "tests" / "unit" / f"test_{test}.f90").exists():
            path = (CHECKOUT / "tests" / "python" / (f"{test}.py" if "/" not in test else test)).resolve()
            command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", str(path)]
            command += ["-m", "not full", *(["-k", selection] if selection else [])]
        checks.append(Check(test.removeprefix("../"), command))
    return checks


def run(check: Check, mutant: int, limit: int, reached: Path | None = None) -> str:
    """'' when all passed, else what failed. The limit is of processor time [s]: other programs may be busy."""
    environment = {**os.environ, "DYNSTICTION_MUTANT": str(mutant), "DYNSTICTION_EXE": str(BUILD / "src" / "dynstiction"),
                   "PYTHONPATH": str(next(PREFIX.glob("**/dynstiction/__init__.py")).parents[1]), "OMP_NUM_THREADS": "1",
                   "PYTHONDONTWRITEBYTECODE": "1", **({"DYNSTICTION_MUTANTS_REACHED": str(reached)} if reached else {})}  # fmt: skip
    limited = ["sh", "-c", 'ulimit -t "$0" && exec "$@"', str(limit), *check.command]
    with subprocess.Popen(limited, cwd=FOLDER, env=environment, text=True, errors="replace", stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True) as process:  # fmt: skip
        try:
            output, _ = process.communicate(timeout=20 * limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return "no end"
    if process.returncode == 0:
        return ""
    if process.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return "no end"
    failed = re.search(r"^(?:FAILED:? |ERROR )(.*)$", output, re.MULTILINE)
    return failed[1][:100] if failed else f"exit status {process.returncode}"


def measure(check: Check) -> float:
    """Run it without a mutant: it must pass. Note which mutants it reaches, and return what it took [s]."""
    reached = FOLDER / "reached.txt"
    reached.unlink(missing_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    failure = run(check, 0, 900, reached)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    check.seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    check.reaches = frozenset(map(int, reached.read_text().split())) if reached.exists() else frozenset()
    print(f"  {check.name}: {check.seconds:.1f} s, reaches {len(check.reaches)} mutants", flush=True)
    if failure:
        sys.exit(f"{check.name} fails without a mutant: {failure}")
    return check.seconds


def verdict_of(mutant: Mutant, checks: list[Check]) -> tuple[str, str]:
    """The checks that reach it, in the order in which they are likely to kill soon: those of the same file, and fast ones, first.
    One that has not run yet comes last, and is measured only if the mutant is alive then.
    """

    def promise(check: Check) -> float:
        if check.seconds is None:
            return 0.0
        return (0.2 + check.kills.get(mutant.file, 0) + 0.1 * sum(check.kills.values())) / max(check.seconds, 0.01)

    is_reached = False
    for check in sorted(checks, key=promise, reverse=True):
        seconds = measure(check) if check.seconds is None else check.seconds
        if mutant.number not in check.reaches:
            continue
        is_reached = True
        failure = run(check, mutant.number, int(3.0 * seconds + 5.0))
        if failure:
            check.kills[mutant.file] = check.kills.get(mutant.file, 0) + 1
            return "killed", f"{check.name}: {failure}"
    return "survived", "" if is_reached else "not reached"


def note(mutant: Mutant, verdict: str, by: str, seconds: float, results: Table) -> None:
    row = (mutant.number, mutant.file, mutant.line, mutant.procedure, mutant.original, mutant.mutated, mutant.occurrence)
    results[mutant.key] = dict(zip(FIELDS, map(str, (*row, verdict, by, round(seconds, 1))), strict=True))
    with RESULTS.open("w", newline="") as file:
        table = csv.DictWriter(file, FIELDS)
        table.writeheader()
        table.writerows(results.values())


def read_table(path: Path) -> Table:
    if not path.exists():
        return {}
    with path.open(newline="") as file:
        return {
            (row["file"], row["procedure"], row["original"], row["mutated"], int(row["occurrence"])): row
            for row in csv.DictReader(file)
        }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--modules", nargs="+", default=[])
    parser.add_argument("--mutants", type=int, nargs="+", help="only these numbers")
    parser.add_argument("--jobs", type=int, default=1, help="processes of the compiler")
    options = parser.parse_args()

    FOLDER.mkdir(parents=True, exist_ok=True)
    all_sources = sources()
    chosen = build(all_sources, options.count, options.seed, options.modules, options.jobs)
    print(f"{len(chosen)} mutants in {len({mutant.file for mutant in chosen.values()})} files", flush=True)
    results = read_table(RESULTS)
    tried = [mutant for mutant in chosen.values() if not options.mutants or mutant.number in options.mutants]
    equivalent = read_table(EQUIVALENT)
    for mutant in tried:
        if mutant.key in equivalent:
            note(mutant, "listed", "", 0.0, results)
    alive = [mutant for mutant in tried if mutant.key not in equivalent]
    for name in ROUNDS:
        if not alive:
            break
        print(f"{name} round, {len(alive)} mutants", flush=True)
        checks = checks_of(name)
        for mutant in alive[:]:
            start = time.monotonic()
            verdict, by = verdict_of(mutant, checks)
            note(mutant, verdict, by, time.monotonic() - start, results)
            if verdict == "killed":
                alive.remove(mutant)
    for mutant in alive:
        print(f"{mutant.number}: {mutant.file}:{mutant.line} {mutant.procedure}")
        print(f"    {mutant.original}\n    {mutant.mutated or '(deleted)'}")
    print(f"{len(tried) - len(alive)} passed, {len(alive)} failed")
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
