"""Dependence of the cost of the full model, step by step, on its parameters; for readers to repeat.

    python bench/scaling.py [--cycles N] [--short]

Runs Fig. 3 at rtol 1e-6 over the same number of fast cycles while one parameter varies over its decades, and prints accepted steps,
Newton iterations and microseconds of solver time for one cycle. Only the number of cycles should matter. The cycle map, which leaps
most of them, is off (bench/cycle_map.py).
"""

import statistics

import dynstiction as ds
import numpy as np
from common import parser_of

FIG3 = {
    "mass": 0.25,
    "stiffness_x": 1e3,
    "stiffness_y": 1e7,
    "misalignment_deg": 1.0,
    "velocity": 1e-3,
    "v_f": 0.01,
}
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
            row = cost(FIG3 | {name: value}, options.cycles)
            print(f"{name:>17} {value:8.1e} {row[0]:6.2f} {row[1]:7.2f} {row[2]:6.2f}")


def cost(scene: dict[str, float], cycles: float) -> tuple[float, float, float]:
    """Steps, Newton iterations and solver time [us] for one cycle of the oscillation on the stiff spring, after its release."""
    period = 2.0 * np.pi * np.sqrt(scene["mass"] / scene["stiffness_y"])
    release = 2.0 / (scene["velocity"] * np.sin(np.radians(scene["misalignment_deg"])) * scene["stiffness_y"])
    t_end = float(release + cycles * period)
    text = f"""
    &scene t_end={t_end!r} /
    &system mass={scene["mass"]}, stiffness_x={scene["stiffness_x"]}, stiffness_y={scene["stiffness_y"]},
        misalignment_deg={scene["misalignment_deg"]} /
    &friction mu_0=0.2, mu_inf=0.15, v_f={scene["v_f"]}, normal_load=10.0 /
    &drive velocity={scene["velocity"]} /
    &integrator rtol=1e-6, cycle_map='off' /
    &output interval={t_end!r} /
    """
    runs = [ds.run(text).statistics for _ in range(5)]
    time = statistics.median(run["wall_time"] for run in runs)
    return runs[0]["steps"] / cycles, runs[0]["newton"] / cycles, 1e6 * time / cycles


if __name__ == "__main__":
    main()
