"""Dependence of the cost of the full model, step by step, on its parameters; for readers to repeat.

    python bench/scaling.py [--cycles N] [--short]

Runs Fig. 3 at rtol 1e-6 over the same number of fast cycles while one parameter varies over its decades, and prints accepted steps,
Newton iterations and microseconds of solver time for one cycle. Only the number of cycles should matter. The cycle map, which leaps
most of them, is off (bench/cycle_map.py).
"""

import statistics

import dynstiction as ds
import numpy as np
from common import FIG3, parser_of

DECADES = {
    "stiffness_y": (1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11),
    "mass": (1e-3, 1e-2, 1.0, 1e2),
    "misalignment_deg": (0.1, 0.3, 3.0, 8.0),
    "velocity": (1e-5, 1e-4, 1e-2),
    "v_f": (3e-3, 0.1, 10.0),
}


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--cycles", type=float, default=2000.0)
    options = parser.parse_args()
    if options.short:
        options.cycles = 50.0
    print(f"{'parameter':>17} {'value':>8} {'steps':>6} {'Newton':>7} {'us':>6}   a cycle")
    for name, values in DECADES.items():
        for value in values:
            row = cost(ds.Scene(FIG3, velocity_ratio=0.0, **{name: value}), options.cycles)
            print(f"{name:>17} {value:8.1e} {row[0]:6.2f} {row[1]:7.2f} {row[2]:6.2f}")


def cost(scene: ds.Scene, cycles: float) -> tuple[float, float, float]:
    """Steps, Newton iterations and solver time [us] for one cycle of the oscillation on the stiff spring, after its release."""
    system, velocity = scene.system, float(scene.drive.velocity)
    period = 2.0 * np.pi * np.sqrt(system.mass / system.stiffness_y)
    release = 2.0 / (velocity * np.sin(np.radians(system.misalignment_deg)) * system.stiffness_y)
    t_end = float(release + cycles * period)
    settings = {"rtol": 1e-6, "cycle_map": "off"}
    runs = [ds.run(scene, t_end=t_end, interval=t_end, integrator=settings).statistics for _ in range(5)]
    time = statistics.median(run["wall_time"] for run in runs)
    return runs[0]["steps"] / cycles, runs[0]["newton"] / cycles, 1e6 * time / cycles


if __name__ == "__main__":
    main()
