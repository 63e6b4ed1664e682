"""Dependence of the cost of the full model, step by step, on its parameters; for readers to repeat.

    python bench/scaling.py [--cycles 2000] [--short]

Runs Fig. 3 at rtol 1e-6 over the same number of fast cycles while one parameter varies over its decades, and prints accepted steps,
Newton iterations and microseconds of solver time for one cycle. Only the number of cycles should matter. The cycle map, which leaps
most of them, is off (bench/cycle_map.py).
"""

from statistics import median

import dynstiction as ds
import numpy as np
from common import FIG3, options_of

DECADES = {
    "stiffness_y": (1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11),
    "mass": (1e-3, 1e-2, 1.0, 1e2),
    "misalignment_deg": (0.1, 0.3, 3.0, 8.0),
    "velocity": (1e-5, 1e-4, 1e-2),
    "v_f": (3e-3, 0.1, 10.0),
}


def main() -> None:
    cycles = options_of(__doc__, cycles=(2000.0, 50.0)).cycles
    print(f"{'parameter':>17} {'value':>8} {'steps':>6} {'Newton':>7} {'us':>6}   a cycle")
    for name, values in DECADES.items():
        for value in values:
            scene = ds.Scene(
                FIG3, velocity_ratio=0.0, integrator={"rtol": 1e-6, "cycle_map": "off"}, **{name: value}
            )
            system, velocity = scene.system, float(scene.drive.velocity)
            release = 2.0 / (velocity * np.sin(np.radians(system.misalignment_deg)) * system.stiffness_y)
            t_end = float(release + cycles * 2.0 * np.pi * np.sqrt(system.mass / system.stiffness_y))
            runs = [ds.run(scene, t_end=t_end, interval=t_end).statistics for _ in range(5)]
            time = 1e6 * median(run["wall_time"] for run in runs)
            print(
                f"{name:>17} {value:8.1e} {runs[0]['steps'] / cycles:6.2f} {runs[0]['newton'] / cycles:7.2f} {time / cycles:6.2f}"
            )


if __name__ == "__main__":
    main()
