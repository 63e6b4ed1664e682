"""Cases per second and core of sweeps, for readers to repeat.

    python bench/sweep.py [--runs 5] [--cases 3200] [--short]

(a) low_frequency at a measured error: 64 angles from 1 to 8 degrees, repeated, otherwise Fig. 3 for 10 s. The error is the largest
relative error of the final u_x compared with radau13 at rtol 1e-12; the time is the best processor time of N runs with one thread,
with methods and tolerances in turn.

(b) full: 96 cases of Fig. 3 for 10 s, with angles from 0.3 to 8 degrees, k_y from 1e6 to 1e8 N/m and V from 0.2 to 100 mm/s. The best
processor time of N runs, with one thread.
"""

import time

import dynstiction as ds
import numpy as np
from common import FIG3, INPUTS, options_of

DECK = INPUTS / "low_frequency.nml"
ANGLES = np.linspace(1.0, 8.0, 64)
FULL = {
    "system.misalignment_deg": [0.3, 1.0, 3.0, 8.0],
    "system.stiffness_y": [1e6, 1e7, 1e8],
    "drive.velocity": [2e-4, 5e-4, 1e-3, 3e-3, 1e-2, 3e-2, 5e-2, 0.1],
}
SETTINGS = [
    *(("rodas4p", rtol) for rtol in (1e-3, 2.3e-4, 1e-4, 1e-5, 3.9e-6, 1e-6)),
    *(("radau9", rtol) for rtol in (1e-5, 3e-7, 1e-8)),
    *(("radau13", rtol) for rtol in (1e-6, 1e-9)),
]


def main() -> None:
    options = options_of(__doc__, runs=(5, 1), cases=(3200, 64))
    angles = np.resize(ANGLES, options.cases)
    exact = final(ANGLES, "radau13", 1e-12)
    best = dict.fromkeys(SETTINGS, np.inf)
    error = {}
    for _ in range(options.runs):
        for setting in SETTINGS:
            begun = time.process_time()
            found = final(angles, *setting)
            best[setting] = min(best[setting], time.process_time() - begun)
            error[setting] = np.max(np.abs(found[: ANGLES.size] / exact - 1))
    print("method   rtol     error    cases/s and core")
    for method, rtol in SETTINGS:
        setting = method, rtol
        print(f"{method:8} {rtol:.1e}  {error[setting]:.1e}  {options.cases / best[setting]:9.0f}")
    for rtol in (1e-6, 1e-8):
        times = []
        for _ in range(options.runs):
            begun = time.process_time()
            cases = ds.sweep(FIG3, FULL, t_end=10.0, threads=1, integrator={"rtol": rtol})
            times.append(time.process_time() - begun)
        print(f"full, radau13, {rtol:.0e}: {cases['period'].size / min(times):.0f} cases/s and core")


def final(angles: np.ndarray, method: str, rtol: float) -> np.ndarray:
    """u_x at the end of every case [m]."""
    cases = ds.sweep(
        DECK,
        {"system.misalignment_deg": angles},
        points=True,
        threads=1,
        integrator={"method": method, "rtol": rtol},
        scene={"t_end": 10.0},
    )
    return cases["final_u_x"].values


if __name__ == "__main__":
    main()
