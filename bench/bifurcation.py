"""Time of a bifurcation diagram: the 2,000 stiffnesses of inputs/bifurcation_stiffness.nml, for readers to repeat.

    python bench/bifurcation.py [--runs N] [--threads N...] [--short]

The command `dynstiction run` makes the file of settled cycles, and `dynstiction.plot` draws it. The wall time is the best of N
runs; the processor time is that of the same run.
"""

import argparse
import os
import resource
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import dynstiction as ds
from dynstiction import plot

DECK = Path(__file__).resolve().parent.parent / "inputs" / "bifurcation_stiffness.nml"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3, help="number of runs, of which the best counts")
    parser.add_argument(
        "--threads", type=int, nargs="+", default=[1, 2], help="numbers of threads of the executable"
    )
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    settings = ["--set", "sweep.count=40"] if options.short else []
    runs = 1 if options.short else options.runs
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "diagram.h5"
        print("threads  wall [s]  processor [s]  cases  cases/s  cycles kept")
        for threads in options.threads:
            wall, processor = min(seconds(file, threads, settings) for _ in range(runs))
            data = ds.open(file)
            cases, kept = data["cycle_count"].size, int(data["cycle_count"].sum())
            print(
                f"{threads:7d}  {wall:8.1f}  {processor:13.1f}  {cases:5d}  {cases / wall:7.1f}  {kept:11d}"
            )
        begun = time.perf_counter()
        plot.save(ds.open(file), file.with_suffix(".png"), "bifurcation")
        print(f"drawn in {time.perf_counter() - begun:.1f} s; file of {file.stat().st_size / 1e6:.1f} MB")


def seconds(file: Path, threads: int, settings: list[str]) -> tuple[float, float]:
    """Wall and processor time [s] of a sweep."""
    command = [
        shutil.which("dynstiction") or "dynstiction",
        "run",
        DECK,
        "-o",
        file,
        "--quiet",
        "--overwrite",
        *settings,
    ]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, env=os.environ | {"OMP_NUM_THREADS": str(threads)})
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
