"""What Python adds to the solver: the import of the package, and `ds.run` beyond the time that the solver takes.

    python bench/overhead.py [--runs N] [--short]

The solver's time is `statistics/wall_time` of the same run: the integration, which is the same in the executable. Prints the
medians of N [ms], of the overhead also the least, which is what a busy machine leaves visible. The import is that of a new interpreter, less one that imports nothing.
"""

import argparse
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
    parser.add_argument("--runs", type=int, default=9, help="of which the median is taken")
    parser.add_argument("--short", action="store_true", help="a few seconds: whether it still runs")
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
    bare = statistics.median(start("pass") for _ in range(runs))
    loaded = statistics.median(start("import dynstiction") for _ in range(runs))
    numpy = statistics.median(start("import numpy") for _ in range(runs))
    print(f"import dynstiction: {1e3 * (loaded - bare):.0f} ms, of which numpy {1e3 * (numpy - bare):.0f} ms")


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
