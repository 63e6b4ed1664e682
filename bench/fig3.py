"""Speed and accuracy of the direct path on Fig. 3, without the cycle map, for readers to repeat.

    python bench/fig3.py [--runs N] [--exe PATH] [--against PATH] [--short]

Prints, for every method and tolerance, the error of the slip velocity at t = 10 s (relative to |w|), the
number of sticks, the solver's wall time (median of N runs), Newton iterations and the time of one; then
time and memory of the whole process, for t_end = 10 s and 1000 s. With --against it compares with another build of
the program instead: for errors of 1e-5 and 1e-8, the method (radau9 or radau13) and tolerance that reach the error first
in each build are run alternately, and the ratio of the times is printed.
"""

import argparse
import json
import os
import platform
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DECK = ROOT / "inputs" / "fig3.nml"
TOLERANCES = ("1e-4", "1e-5", "1e-6", "1e-7", "1e-8", "1e-10")
METHODS = ("radau5", "radau9", "radau13", "dopri5", "dop853")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5, help="number of runs for a median")
    parser.add_argument("--exe", default=shutil.which("dynstiction") or ROOT / ".venv/bin/dynstiction")
    parser.add_argument("--against", help="another executable to compare with")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    runs, tolerances, lengths = options.runs, TOLERANCES, ("10.0", "1000.0")
    if options.short:
        runs, tolerances, lengths = 1, ("1e-4", "1e-6"), ("1.0",)
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {cpu_name()}")
    with tempfile.TemporaryDirectory() as folder:
        if options.against:
            compare(Path(folder), str(options.exe), options.against, runs)
            return
        solver_table(Path(folder), str(options.exe), runs, tolerances)
        process_table(Path(folder), str(options.exe), runs, lengths)


def solver_table(folder: Path, exe: str, runs: int, tolerances: tuple[str, ...]) -> None:
    """Error and cost of the solver alone: one sample a second."""
    print(
        f"{'method':8} {'rtol':>6} {'error of w':>11} {'sticks':>6} {'solver s':>9} {'Newton':>8} {'us each':>8} {'rhs':>9}"
    )
    for method in METHODS:
        for rtol in tolerances:
            points = [solve(exe, folder / "fig3.h5", method, rtol) for _ in range(runs)]
            error, newton, rhs, sticks = (points[0][key] for key in ("error", "newton", "rhs", "sticks"))
            seconds = statistics.median(point["seconds"] for point in points)
            each = f"{1e6 * seconds / newton:8.2f}" if newton else f"{'-':>8}"
            print(
                f"{method:8} {rtol:>6} {error:11.1e} {sticks:6d} {seconds:9.4f} {newton:8d} {each} {rhs:9d}",
                flush=True,
            )


def solve(exe: str, output: Path, method: str, rtol: str) -> dict[str, float]:
    """Error of w at the end, work, number of sticks and wall time of one run of the solver."""
    run(
        exe,
        output,
        (
            f"integrator.method={method}",
            f"integrator.rtol={rtol}",
            "output.interval=1.0",
            "integrator.cycle_map='off'",
        ),
    )
    reference = final_reference()
    with h5py.File(output) as file:
        w = np.array([file["time_series/w_x"][-1], file["time_series/w_y"][-1]])
        return {
            "error": float(np.linalg.norm(w - reference) / np.linalg.norm(reference)),
            "newton": int(file["statistics/newton"][()]),
            "rhs": int(file["statistics/rhs"][()]),
            "sticks": int(file["summary/sticks"][()]),
            "seconds": float(file["statistics/wall_time"][()]),
        }


def compare(folder: Path, exe: str, other: str, runs: int) -> None:
    """Ratio of the times of two programs at the same error."""
    for target in (1e-5, 1e-8):
        chosen = {name: cheapest(folder, name, target) for name in (exe, other)}
        ratios, seconds = [], {exe: [], other: []}
        for _ in range(runs):
            for name, (method, rtol) in chosen.items():
                seconds[name].append(solve(name, folder / "fig3.h5", method, rtol)["seconds"])
            ratios.append(seconds[exe][-1] / seconds[other][-1])
        for name, (method, rtol) in chosen.items():
            print(
                f"error {target:.0e}: {method} at {rtol}, {statistics.median(seconds[name]):.4f} s, least {min(seconds[name]):.4f} s: {name}"
            )
        least = min(seconds[exe]) / min(seconds[other])
        print(
            f"error {target:.0e}: ratio {statistics.median(ratios):.2f} in the median, {least:.2f} of the least",
            flush=True,
        )


def cheapest(folder: Path, exe: str, target: float) -> tuple[str, str]:
    """radau9 or radau13 and the tolerance that reaches an error, also at all tighter tolerances, in the least time of three runs."""
    least, choice = float("inf"), ("radau9", "1e-10")
    for method in ("radau9", "radau13"):
        found = None
        for exponent in range(-40, -12):
            rtol = f"{10 ** (exponent / 4):.2e}"
            if solve(exe, folder / "fig3.h5", method, rtol)["error"] > target:
                break
            found = rtol
        if found:
            seconds = min(solve(exe, folder / "fig3.h5", method, found)["seconds"] for _ in range(3))
            if seconds < least:
                least, choice = seconds, (method, found)
    return choice


def process_table(folder: Path, exe: str, runs: int, lengths: tuple[str, ...]) -> None:
    """The whole process: 1 ms sampling of all default fields, radau9 at rtol 1e-6."""
    for t_end in lengths:
        seconds, memory = [], []
        for _ in range(1 if t_end == "1000.0" else runs):
            start = time.perf_counter()
            memory.append(run(exe, folder / "fig3.h5", (f"scene.t_end={t_end}", "integrator.rtol=1e-6")))
            seconds.append(time.perf_counter() - start)
        print(f"process, t_end = {t_end} s: {statistics.median(seconds):.3f} s, {max(memory) / 1024:.1f} MB")


def run(exe: str, output: Path, settings: tuple[str, ...]) -> int:
    """Run Fig. 3's deck and return the largest resident memory in kB."""
    command = [exe, "run", str(DECK), "--overwrite", "--quiet", "-o", str(output)]
    for setting in settings:
        command += ["--set", setting]
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        raise SystemExit(f"{' '.join(command)} failed")
    return usage.ru_maxrss


def final_reference() -> np.ndarray:
    """Slip velocity at t = 10 s, converged in quadruple precision."""
    scenes = json.loads((ROOT / "tests" / "reference" / "fig3.json").read_text())
    row = next(row for row in scenes["scenes"]["fig3"]["states"] if row[0] == 10.0)
    return np.array(row[3:5])


def cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return "unknown processor"
    return next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")),
        "unknown processor",
    )


if __name__ == "__main__":
    main()
