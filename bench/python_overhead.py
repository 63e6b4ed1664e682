"""Time that Python adds to the solver: the import of the package, and the part of `ds.run` outside the solver.

    python bench/python_overhead.py [--runs N] [--short] [--against FOLDER]

The solver's time is `statistics/wall_time` of the same run: the integration, which is the same in the executable. Prints the
medians of N runs [ms], and for the overhead also the least value, which depends least on other work of the machine. Then it prints
the overhead of a run that takes the solver some microseconds, and the time of an attribute of a scene [us], from 2000 of each.
With `--against`, a folder with the package of another revision, it also prints the ratio to that package, measured in turn. The
time of the import is that of a new interpreter minus that of one that imports nothing.
"""

import argparse
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import dynstiction as ds

INPUTS = Path(__file__).resolve().parent.parent / "inputs"
SCENES = {
    "1 ms of Fig. 3": ("fig3.nml", {"t_end": 1.0e-3}),
    "Fig. 3": ("fig3.nml", {}),
    "Fig. 3, low_frequency": ("low_frequency.nml", {}),
    "creep": ("creep.nml", {}),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=9, help="number of runs for a median")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    parser.add_argument("--against", metavar="FOLDER", help="package to compare with")
    options = parser.parse_args()
    runs = 1 if options.short else options.runs
    print(
        f"{'scene':24} {'samples':>8} {'events':>8} {'run ms':>10} {'solver ms':>10} {'overhead ms':>12} {'least':>8}"
    )
    for name, (deck, changes) in SCENES.items():
        measured = [measure(INPUTS / deck, changes) for _ in range(runs)]
        result = ds.run(INPUTS / deck, scene=changes)
        wall, solver = (statistics.median(column) for column in zip(*measured, strict=True))
        overheads = [1e3 * (all_of_it - part) for all_of_it, part in measured]
        print(
            f"{name:24} {result.time.size:8} {result.events.size:8} {1e3 * wall:10.2f} {1e3 * solver:10.2f}"
            f" {statistics.median(overheads):12.2f} {min(overheads):8.2f}"
        )
    compare(10 if options.short else 2000, options.against)
    bare = statistics.median(start("pass") for _ in range(runs))
    loaded = statistics.median(start("import dynstiction") for _ in range(runs))
    numpy = statistics.median(start("import numpy") for _ in range(runs))
    print(f"import dynstiction: {1e3 * (loaded - bare):.0f} ms, of which numpy {1e3 * (numpy - bare):.0f} ms")


SMALL = """
import statistics, sys, time
import dynstiction as ds
scene = ds.Scene(sys.argv[1], scene={"t_end": 0.1})
for call in (lambda: ds.run(scene), lambda: scene.system.stiffness_x):
    spent = []
    for _ in range(int(sys.argv[2])):
        begin = time.perf_counter()
        result = call()
        spent.append(time.perf_counter() - begin - (result.statistics["wall_time"] if isinstance(result, ds.Result) else 0.0))
    print(1e6 * statistics.median(spent), 1e6 * min(spent))
"""
NAMES = ("overhead of a short run", "attribute of a scene")


def compare(runs: int, against: str | None) -> None:
    """Print the times of short operations [us], and their ratio to those of another package."""
    columns = [small(runs, folder) for folder in (None, against)[: 2 if against else 1]]
    for name, *times in zip(NAMES, *columns, strict=True):
        ratio = (
            f", {times[0][0] / times[1][0]:.2f} (least {times[0][1] / times[1][1]:.2f}) of the other package"
            if against
            else ""
        )
        print(f"{name}: {times[0][0]:.1f} us, least {times[0][1]:.1f} us{ratio}")


def small(runs: int, folder: str | None) -> list[tuple[float, ...]]:
    """Median and least [us] of each."""
    command = [sys.executable, "-c", SMALL, INPUTS / "creep.nml", str(runs)]
    environment = os.environ | ({"PYTHONPATH": folder} if folder else {})
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    return [tuple(map(float, line.split())) for line in done.stdout.splitlines()]


def measure(deck: Path, changes: dict[str, float]) -> tuple[float, float]:
    """Wall time of `ds.run` and of the solver in it [s]."""
    begin = time.perf_counter()
    result = ds.run(deck, scene=changes)
    return time.perf_counter() - begin, result.statistics["wall_time"]


def start(code: str) -> float:
    """Wall time of a new interpreter [s]."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True)
    return time.perf_counter() - begin


if __name__ == "__main__":
    main()
