"""Which rtol gives summary values that people look at, on random scenes, and what it costs: the reason for the default.

    python bench/default_tolerance.py [--scenes N] [--seed N] [--short]

Half of the scenes are those of the sweeps that people make (phi 0.3 to 8 degrees, k_y 1e6 to 1e8 N/m, V 0.2 to 100 mm/s, 10 s), the
others are much more various (as in cycle_map.py). The true values are those at rtol = 1e-12; a scene in which the values at 1e-11
differ from them by more than 1e-6 has no values (irregular motion), and is listed and left out. The error of a value is relative to
its size, that of a share to 1, of the number of sticks to that number, and of a valley, of a swing and of a work to the peak or the
largest work. Prints for each rtol the share of scenes in which all values are right to 1e-5, quantiles of the largest error, what
is worst, and the Newton iterations over those at 1e-8. It takes some minutes.
"""

import argparse
import math
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import dynstiction as ds
import numpy as np
from common import FIG3 as DECK
from common import random_values
from cycle_map import SEED, duration

TOLERANCES = (1e-4, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8)
TRUTH, NEARLY, NO_VALUE, WANTED, USUAL = 1e-12, 1e-11, 1e-6, 1e-5, 1e-8
SWEPT = {"phi": (0.3, 8.0), "k_y": (1e6, 1e8), "V": (0.2e-3, 0.1)}
OWN_SCALE = (
    "period",
    "peak_force",
    "stick_duration",
    "slip_duration",
    "slip_length",
    "first_peak_force",
    "max_X_rate",
    "sticks",
    "sticking_time",
)
OTHER_SCALE = {
    "valley_force": "peak_force",
    "swing": "first_peak_force",
    "drive_work": "friction_work",
    "friction_work": "friction_work",
    "creep_share": None,
    "slip_angle": None,
}


@dataclass
class Scene:
    """A random scene: by how much its values at each tolerance are wrong, which most, and the Newton iterations."""

    number: int
    values: dict[str, float]
    error: dict[float, float]
    worst: dict[float, str]
    newton: dict[float, float]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    numbers = range(6 if options.short else options.scenes)
    with ThreadPoolExecutor(2) as pool:
        scenes = list(pool.map(lambda number: measure(options.seed, number), numbers))
    known = [scene for scene in scenes if scene.error[NEARLY] <= NO_VALUE]
    for scene in scenes:
        if scene not in known:
            described = ", ".join(f"{name} {value:.3g}" for name, value in scene.values.items())
            print(
                f"no values: scene {scene.number} ({described}), {scene.worst[NEARLY]} {scene.error[NEARLY]:.1e}"
            )
    print(f"{len(known)} of {len(scenes)} scenes have values")
    print(f"{'rtol':>8s} {'right':>7s} {'median':>9s} {'90 %':>9s} {'largest':>9s}  {'Newton':>7s}  worst")
    for rtol in TOLERANCES:
        errors = np.array([scene.error[rtol] for scene in known])
        ratio = [
            math.log(scene.newton[rtol] / scene.newton[USUAL]) for scene in known if scene.newton[rtol] > 0
        ]
        worst = Counter(scene.worst[rtol] for scene in known if scene.error[rtol] > WANTED)
        print(
            f"{rtol:8.0e} {100 * np.mean(errors <= WANTED):6.1f}% {np.median(errors):9.1e} {np.quantile(errors, 0.9):9.1e}"
            f" {errors.max():9.1e}  {math.exp(np.mean(ratio)):7.3f}  "
            + ", ".join(f"{name} {count}" for name, count in worst.most_common(4))
        )


def measure(seed: int, number: int) -> Scene:
    """Run a scene at all tolerances."""
    if number % 2 == 0:
        values, t_end = random_values(seed, number, SWEPT), 10.0
    else:
        values = random_values(seed, number)
        t_end = duration(values)
    scene = Scene(number, values, {}, {}, {})
    try:
        truth, _ = summary(values, t_end, TRUTH)
    except ds.SolverError as failure:
        scene.error[NEARLY], scene.worst[NEARLY] = math.inf, str(failure)
        return scene
    for rtol in (NEARLY, *TOLERANCES):
        found, newton = summary(values, t_end, rtol)
        errors = {name: error(name, found, truth) for name in (*OWN_SCALE, *OTHER_SCALE)}
        scene.worst[rtol] = max(errors, key=lambda name: errors[name])
        scene.error[rtol] = errors[scene.worst[rtol]]
        scene.newton[rtol] = newton
    return scene


def summary(values: dict[str, float], t_end: float, rtol: float) -> tuple[dict[str, float], float]:
    """The summary of a run, and its Newton iterations."""
    run = ds.run(
        DECK,
        scene={"t_end": t_end},
        system={"stiffness_y": values["k_y"], "misalignment_deg": values["phi"]}
        | {name: values[name] for name in ("mass",) if name in values},
        friction={name: values[name] for name in ("v_f",) if name in values},
        drive={"velocity": values["V"]},
        integrator={"method": None, "rtol": rtol},
        output={"interval": t_end, "fields": ["u_x"]},
    )
    return dict(run.summary), run.statistics["newton"]


def error(name: str, found: dict[str, float], truth: dict[str, float]) -> float:
    """The error of a value, over its scale; of one that is there in one run only, infinite."""
    if (name in found) != (name in truth):
        return math.inf
    if name not in truth:
        return 0.0
    scale = abs(truth[name])
    if name in OTHER_SCALE:
        other = OTHER_SCALE[name]
        scale = 1.0 if other is None else abs(truth.get(other, 1.0))
    return abs(found[name] - truth[name]) / scale if scale > 0.0 else float(found[name] != truth[name])


if __name__ == "__main__":
    main()
