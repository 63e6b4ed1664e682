"""What checkpoints cost, on Fig. 3's scene over 1000 s, for readers to repeat.

    python bench/checkpoint.py [--runs N] [--t-end S] [--exe PATH] [--short]

Runs the scene (a sample every 0.1 s) without checkpoints, with one every second, and with one in every pass
of the run loop (0.05 s), in turn, so that a slower machine affects all three. Prints the medians of N runs of
wall time and processor time, including child processes, and their ratios to the runs without checkpoints.
The third kind, with many more checkpoints, gives the cost of one.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KINDS = {"none": "0", "every 1 s": "1.0", "every 0.05 s": "0.05"}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5, help="number of runs of each kind for a median")
    parser.add_argument("--t-end", default="1000.0", help="model time, s")
    parser.add_argument("--exe", default=shutil.which("dynstiction") or ROOT / ".venv/bin/dynstiction")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    if options.short:
        options.runs, options.t_end = 1, "20.0"
    wall: dict[str, list[float]] = {kind: [] for kind in KINDS}
    processor: dict[str, list[float]] = {kind: [] for kind in KINDS}
    with tempfile.TemporaryDirectory(dir=".") as folder:
        for _ in range(options.runs):
            for kind, interval in KINDS.items():
                seconds = run(str(options.exe), Path(folder) / "x.h5", options.t_end, interval)
                wall[kind].append(seconds[0])
                processor[kind].append(seconds[1])
    print(f"{'checkpoints':14} {'wall s':>8} {'over none':>10} {'processor s':>12} {'over none':>10}")
    for kind in KINDS:
        of_wall, of_processor = statistics.median(wall[kind]), statistics.median(processor[kind])
        more_wall = of_wall / statistics.median(wall["none"]) - 1
        more_processor = of_processor / statistics.median(processor["none"]) - 1
        print(f"{kind:14} {of_wall:8.3f} {more_wall:9.2%} {of_processor:12.3f} {more_processor:9.2%}")
    often = statistics.median(wall["every 0.05 s"])
    each = (often - statistics.median(wall["none"])) / (often / 0.05)
    each_processor = (statistics.median(processor["every 0.05 s"]) - statistics.median(processor["none"])) / (
        often / 0.05
    )
    print(f"one checkpoint: {1e3 * each:.2f} ms, of that {1e3 * each_processor:.2f} ms of processor time")


def run(exe: str, output: Path, t_end: str, interval: str) -> tuple[float, float]:
    """Wall time and processor time of one run [s]."""
    settings = {
        "scene.t_end": t_end,
        "output.interval": "0.1",
        "output.checkpoint_interval": interval,
    }
    command = [exe, "run", str(ROOT / "inputs" / "fig3.nml"), "--overwrite", "--quiet", "-o", str(output)]
    for key, value in settings.items():
        command += ["--set", f"{key}={value}"]
    start = time.perf_counter()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        raise SystemExit(f"{' '.join(command)} failed")
    return time.perf_counter() - start, usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
