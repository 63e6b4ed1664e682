"""What interleaved shares of a sweep cost against ideal dealing, from the times of its cases.

    python bench/shares.py [FILE.h5] [--exe EXE] [--short]

Share I of N has the cases I, I+N, I+2N, ... The number is the time at which the last share ends over that of ideal dealing, minus 1;
beside it that of contiguous blocks of cases. Ideal dealing keeps all processes busy until the end, or until the longest case ends.
The times are /sweep/wall_time of FILE, by default of 1000 cases of model `full` that differ by the misalignment and the velocity.
"""

import argparse
import os
import subprocess
import tempfile
from pathlib import Path

import h5py
import numpy as np

DECK = Path(__file__).parents[1] / "inputs" / "fig3.nml"
PROCESSES = (4, 8, 16, 32, 64)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", nargs="?")
    parser.add_argument("--exe", default="dynstiction")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    costs = costs_in(options.file) if options.file else measured_costs(options.exe, options.short)
    print(
        f"{len(costs)} cases, {costs.mean():.1e} s on average, the longest {costs.max() / costs.mean():.1f} times that"
    )
    print("processes   shares   blocks   more time than ideal dealing [%]")
    for processes in PROCESSES:
        ideal = max(costs.sum() / processes, costs.max())
        interleaved = max(costs[i::processes].sum() for i in range(processes))
        blocks = max(block.sum() for block in np.array_split(costs, processes))
        print(f"{processes:9} {100 * (interleaved / ideal - 1):8.1f} {100 * (blocks / ideal - 1):8.1f}")


def costs_in(file: str | Path) -> np.ndarray:
    """Seconds of each case of a sweep that has been run."""
    with h5py.File(file) as opened:
        return opened["sweep/wall_time"][:][opened["sweep/result_code"][:] >= 0]


def measured_costs(exe: str, short: bool) -> np.ndarray:
    """Seconds of each case of a grid, run by one thread."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "costs.h5"
        grid = ["system.misalignment_deg=0.5:20:40", "drive.velocity=0.5e-3:5e-3:25"]
        settings = [word for setting in grid for word in ("--vary", setting)]
        command = [exe, "sweep", str(DECK), "-o", str(output), "--quiet", *settings]
        subprocess.run(
            [*command, "--set", f"scene.t_end={0.05 if short else 2.0}"],
            check=True,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
        )
        return costs_in(output)


if __name__ == "__main__":
    main()
