"""What files cost: `ds.open` against h5py, a run of 1 ms as a process, and files that are made whole during a run.

    python bench/files.py [--runs N] [--exe PATH] [--short]

Medians of N runs, in turn, so that a slower machine affects all. `h5py` reads the same datasets and attributes as `ds.open`;
its first row reads the datasets alone. Instructions: valgrind --tool=callgrind dynstiction run inputs/fig3.nml.
"""

import argparse
import resource
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import dynstiction as ds
import h5py

ROOT = Path(__file__).resolve().parent.parent
DECK = ROOT / "inputs" / "fig3.nml"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=15, help="number of runs for a median")
    parser.add_argument("--exe", default=shutil.which("dynstiction") or ROOT / ".venv/bin/dynstiction")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    runs = 2 if options.short else options.runs
    with tempfile.TemporaryDirectory(dir=".") as folder:
        file = Path(folder) / "x.h5"

        def run(*settings: str) -> None:
            words = [word for setting in settings for word in ("--set", setting)]
            subprocess.run(
                [options.exe, "run", DECK, "-o", file, "--quiet", "--overwrite", *words], check=True
            )

        run()
        table("reading Fig. 3 [ms]", runs, {
            "h5py, datasets": lambda: read(file, attributes=False),
            "h5py, with attributes": lambda: read(file, attributes=True),
            "ds.open": lambda: ds.open(file),
        })  # fmt: skip
        steps = (
            "integrator.method=radau5",
            "integrator.cycle_map=off",
            f"scene.t_end={4 if options.short else 20}",
        )
        table("as a process [ms]", max(1, runs // 5), {
            "--version": lambda: subprocess.run([options.exe, "--version"], check=True, stdout=subprocess.DEVNULL),
            "1 ms": lambda: run("scene.t_end=1e-3"),
            "20 s in steps, one file": lambda: run(*steps, "output.checkpoint_interval=0"),
            "the same, made whole from 0.1 s on": lambda: run(*steps, "output.checkpoint_interval=0.1"),
        })  # fmt: skip


def table(title: str, runs: int, kinds: dict[str, Callable[[], object]]) -> None:
    """Wall time and processor time, children included, of each kind [ms], and its ratio to the first one."""
    wall: dict[str, list[float]] = {name: [] for name in kinds}
    processor: dict[str, list[float]] = {name: [] for name in kinds}
    for _ in range(runs):
        for name, act in kinds.items():
            begun, used = time.perf_counter(), used_so_far()
            act()
            wall[name].append(1e3 * (time.perf_counter() - begun))
            processor[name].append(1e3 * (used_so_far() - used))
    first = statistics.median(next(iter(wall.values())))
    print(f"{title:38} {'wall':>8} {'ratio':>6} {'processor':>10}")
    for name in kinds:
        median = statistics.median(wall[name])
        print(f"{name:38} {median:8.1f} {median / first:6.2f} {statistics.median(processor[name]):10.1f}")


def used_so_far() -> float:
    return sum(
        used.ru_utime + used.ru_stime
        for used in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def read(file: Path, *, attributes: bool) -> list[object]:
    found: list[object] = []

    def take(_: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            found.append(item[()])
            if attributes:
                found.extend([item.attrs["units"], item.attrs["long_name"]])

    with h5py.File(file) as data:
        data.visititems(take)
    return found


if __name__ == "__main__":
    main()
