"""Error against cost of the Moreau-Jean scheme on Fig. 3 up to t = 2.5 s, compared with radau9, for readers to repeat.

    python bench/moreau_jean.py [--runs N] [--exe PATH] [--short]

Prints for every step, or tolerance, the error of u_x and of the slip velocity at the end (relative), the
number of sticks (1826 are right), the solver's wall time (median of N runs) and the steps.
"""

import argparse
import json
import shutil
import statistics
import tempfile
from pathlib import Path

import h5py
import numpy as np
from fig3 import ROOT, run

T_END = 2.5
STEPS = ("1e-3", "1e-4", "3e-5", "1e-5", "3e-6", "1e-6", "3e-7")
TOLERANCES = ("1e-4", "1e-6", "1e-8")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3, help="number of runs for a median")
    parser.add_argument("--exe", default=shutil.which("dynstiction") or ROOT / ".venv/bin/dynstiction")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    steps = STEPS
    if options.short:
        options.runs, steps = 1, STEPS[:4]
    cases = [("moreau_jean", ("integrator.rtol=", f"integrator.step={step}")) for step in steps]
    cases += [("radau9", (f"integrator.rtol={rtol}",)) for rtol in TOLERANCES]
    reference = reference_state()
    print(
        f"{'method':11} {'step, rtol':>10} {'error of u_x':>12} {'of w':>8} {'sticks':>6} {'solver s':>9} {'steps':>9}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for method, settings in cases:
            print(
                line(Path(folder) / "fig3.h5", str(options.exe), options.runs, method, settings, reference),
                flush=True,
            )


def line(
    file: Path, exe: str, runs: int, method: str, settings: tuple[str, ...], reference: np.ndarray
) -> str:
    """One row of the table: run `runs` times, compare the last sample."""
    seconds = []
    common = (f"scene.t_end={T_END}", "initial.velocity_ratio=0", "output.interval=0.1")
    for _ in range(runs):
        run(exe, file, (*common, f"integrator.method={method}", *settings))
        with h5py.File(file) as content:
            seconds.append(float(content["statistics/wall_time"][()]))
    with h5py.File(file) as content:
        state = np.array([content[f"time_series/{name}"][-1] for name in ("u_x", "w_x", "w_y")])
        sticks, steps = int(content["summary/sticks"][()]), int(content["statistics/steps"][()])
    u_x = abs(state[0] / reference[0] - 1)
    w = np.linalg.norm(state[1:] - reference[1:]) / np.linalg.norm(reference[1:])
    value = settings[-1].split("=")[1]
    return f"{method:11} {value:>10} {u_x:12.1e} {w:8.1e} {sticks:6d} {statistics.median(seconds):9.4f} {steps:9d}"


def reference_state() -> np.ndarray:
    """u_x, w_x and w_y at the end, converged in quadruple precision."""
    scenes = json.loads((ROOT / "tests" / "reference" / "fig3.json").read_text())
    row = next(row for row in scenes["scenes"]["fig3"]["states"] if row[0] == T_END)
    return np.array([row[1], row[3], row[4]])


if __name__ == "__main__":
    main()
