"""How well sweeps use the cores, and the needs of a large one, for readers to repeat.

    python bench/sweep_scaling.py [efficiency] [full] [million] [--repeat N] [--exe EXE] [--short]

efficiency: two threads compared with one; cases with equal costs, and with costs that differ by a factor of 1000, the expensive
ones in a row. full: a map of model `full` compared with single runs. million: a summary sweep of a million cases, in two shares,
and its merge.

The efficiency consists of two numbers that do not depend on other work of the machine: `busy`, the share of the wall time of all
cores that was spent in cases, from the start of the program to its end, and `cpu`, the processor time of one thread over that of
all. `wall` is the plain ratio of wall times over the cores, which needs a quiet machine. Medians, and the range in brackets.
"""

import argparse
import os
import resource
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import h5py

INPUTS = Path(__file__).parents[1] / "inputs"
SCENE = (INPUTS / "low_frequency.nml").read_text()
CORES = 2


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", default=["efficiency", "full", "million"])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--exe", default="dynstiction")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    share = 1
    if options.short:
        options.repeat, share = 1, 20
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "efficiency" in options.parts:
            for costs in ("equal", "1000 times"):
                deck = costs_deck(folder, costs, share)
                print_efficiency(f"low_frequency, costs {costs}", deck, options.exe, options.repeat)
        if "full" in options.parts:
            angles = ANGLES[::share]
            print_efficiency("full", full_deck(folder, angles), options.exe, options.repeat)
            print_singles(folder, options.exe, options.repeat, angles)
        if "million" in options.parts:
            print_million(folder, options.exe, 1000 // share)


def costs_deck(folder: Path, costs: str, share: int) -> Path:
    """600 cases of some milliseconds; or 60 that cost 1000 times as much as the other 540; every `share`-th of them."""
    ends = [300.0] * 600 if costs == "equal" else [3000.0] * 60 + [3.0] * 540
    ends = ends[::share]
    (folder / "points.csv").write_text("\n".join(["scene.t_end", *map(str, ends)]))
    deck = folder / "costs.nml"
    deck.write_text(SCENE + "&sweep points = 'points.csv' /\n")
    return deck


ANGLES = [0.5 + 0.25 * i for i in range(40)]


def full_deck(folder: Path, angles: list[float]) -> Path:
    deck = folder / "full.nml"
    deck.write_text(
        (INPUTS / "fig3.nml").read_text()
        + f"&sweep parameter = 'system.misalignment_deg', first = {angles[0]}, last = {angles[-1]}, count = {len(angles)} /\n"
    )
    return deck


def measure(command: list[str], threads: int) -> tuple[float, float]:
    """Wall and processor time [s]."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = os.environ | {"OMP_NUM_THREADS": str(threads)}
    subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    passed, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return passed, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def print_efficiency(title: str, deck: Path, exe: str, repeat: int) -> None:
    output = deck.with_suffix(".h5")
    command = [exe, "run", str(deck), "-o", str(output), "--quiet", "--overwrite"]
    measured: dict[int, list[tuple[float, float, float]]] = {1: [], CORES: []}
    for _ in range(repeat):
        for threads, found in measured.items():
            wall, cpu = measure(command, threads)
            with h5py.File(output) as file:
                in_cases = float(file["sweep/wall_time"][:].sum())
            found.append((wall, cpu, in_cases / wall / threads))
    print(f"{title}: {repeat} runs of each, alternating")
    for threads, found in measured.items():
        pairs = list(zip(measured[1], found, strict=True))
        cpu_ratio = [one[1] / many[1] for one, many in pairs]
        wall_ratio = [one[0] / (threads * many[0]) for one, many in pairs]
        print(
            f"{threads} threads: {statistics.median(many[0] for many in found):7.2f} s, busy {spread([many[2] for many in found])}, "
            f"cpu {spread(cpu_ratio)}, wall {spread(wall_ratio)}",
            flush=True,
        )


def spread(values: list[float]) -> str:
    return f"{statistics.median(values):.3f} [{min(values):.3f}, {max(values):.3f}]"


def print_singles(folder: Path, exe: str, repeat: int, angles: list[float]) -> None:
    """The cases of the map as separate runs that write the same summary, compared with the map in one thread."""
    totals = []
    for _ in range(repeat):
        total = 0.0
        for angle in angles:
            command = [
                exe,
                "run",
                str(INPUTS / "fig3.nml"),
                "-o",
                str(folder / "single.h5"),
                "--quiet",
                "--overwrite",
            ]
            settings = ["--set", f"system.misalignment_deg={angle!r}", "--set", "output.interval=10"]
            total += measure([*command, *settings], 1)[1]
        command = [
            exe,
            "run",
            str(folder / "full.nml"),
            "-o",
            str(folder / "full.h5"),
            "--quiet",
            "--overwrite",
        ]
        totals.append(measure(command, CORES)[1] / total)
    print(
        f"full: processor time of the map in {CORES} threads over that of {len(angles)} single runs: {spread(totals)}"
    )


def print_million(folder: Path, exe: str, side: int) -> None:
    cases = side**2
    deck, output = folder / "million.nml", folder / "million.h5"
    deck.write_text(
        SCENE.replace("t_end = 10.0", "t_end = 0.02")
        + "&sweep parameter = 'system.misalignment_deg', 'drive.velocity', first = 1.0, 1e-3, last = 8.0, 4e-3, "
        f"count = {side}, {side} /\n"
    )
    command = [exe, "run", str(deck), "-o", str(output), "--quiet", "--share"]
    walls, cpus = zip(*(measure([*command, f"{i}/2"], CORES) for i in (1, 2)), strict=True)
    print(
        f"{cases} cases: {sum(walls):.1f} s, {1e6 * sum(cpus) / cases:.1f} us of processor time a case, {memory()} MB"
    )
    wall, cpu = measure([exe, "merge", str(deck), "-o", str(output)], 1)
    with h5py.File(output) as file:
        values = sum(item.size for name, item in datasets(file["sweep"]) if not name.startswith("failures"))
    print(
        f"merge: {wall:.1f} s ({cpu:.1f} s of processor time), {memory()} MB at most so far; "
        f"{output.stat().st_size / values:.2f} bytes a value"
    )


def memory() -> int:
    """Largest memory of any process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024


def datasets(group: h5py.Group) -> list[tuple[str, h5py.Dataset]]:
    found: list[tuple[str, h5py.Dataset]] = []
    group.visititems(
        lambda name, item: found.append((name, item)) if isinstance(item, h5py.Dataset) else None
    )
    return found


if __name__ == "__main__":
    main()
