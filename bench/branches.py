"""Folds and doublings of branches, found a second time.

python bench/branches.py [--rigs 10] [--seed 1] [--model full] [--short]

For random rigs, `ds.branch` follows the cycles over the misalignment around the scene's own. Each doubling is then found a second time by
bisection over `ds.cycles`, which knows nothing of branches, of where a cycle with this period changes its stability. At a fold two cycles
are too near each other for such a search: it is found as the value at which the extremum of the map minus identity is 0. Prints the
relative differences and the cost.
"""

import random
import time

import dynstiction as ds
import numpy as np
from common import options_of
from dynstiction import _native
from scipy.optimize import brentq, minimize_scalar

WINDOW = 3e-3
"""Cycles are those of a point if their period differs by no more than this, relatively."""
FROM, ACCURACY = 1e-3, 1e-8
"""First distance from the point at which a bisection begins, and its accuracy, relative to the value."""


def rig(rng: random.Random, model: str) -> ds.Scene:
    stiffness = 10.0 ** rng.uniform(3.0, 4.5)
    mu_0 = rng.uniform(0.15, 0.4)
    return ds.Scene(
        model=model,
        mass=10.0 ** rng.uniform(-1.0, 0.5),
        stiffness_x=stiffness,
        stiffness_y=stiffness * 10.0 ** rng.uniform(1.5, 3.5) if model == "full" else None,
        misalignment_deg=rng.uniform(1.0, 8.0),
        law="weakening",
        mu_0=mu_0,
        mu_inf=mu_0 * rng.uniform(0.5, 0.9),
        v_f=10.0 ** rng.uniform(-2.7, -1.5),
        normal_load=10.0 ** rng.uniform(0.5, 1.5),
        velocity=10.0 ** rng.uniform(-3.3, -1.0),
        t_end=1.0,
    )


def near(scene: ds.Scene, value: float, slow_cycles: int, point: ds.BranchPoint) -> list[ds.LimitCycle]:
    """The cycles at a value that may be those of a point."""
    found = ds.cycles(scene.replace(misalignment_deg=value)).cycles
    return [
        each for each in found
        if each.slow_cycles == slow_cycles and abs(each.period / point.period - 1.0) < WINDOW
        and abs(each.valley_force - point.valley_force) < WINDOW * abs(point.peak_force)
    ]  # fmt: skip


def touching(scene: ds.Scene, model: str, slow_cycles: int, point: ds.BranchPoint) -> float:
    """The value at which the map touches the diagonal near a fold; NaN if it does not pass through it there."""

    def turn(value: float, place: float) -> float:
        there = scene.replace(misalignment_deg=value).source
        return _native.returned(there, model, place, slow_cycles)[0] - place

    for width in np.array([1e-3, 1e-4, 1e-5]) * abs(point.place):
        ends = [turn(point.value, point.place + side * width) for side in (-1.0, 1.0)]
        if not ends[0] * ends[1] > 0.0:
            continue

        def gap(value: float, width: float = width, sense: float = np.sign(ends[0])) -> float:
            bounds = (point.place - width, point.place + width)
            return minimize_scalar(lambda place: sense * turn(value, place), bounds=bounds, method="bounded",
                                   options={"xatol": 1e-5 * width}).fun  # fmt: skip

        low, high = (point.value * (1.0 + side * 1e-3 * width / abs(point.place)) for side in (-1.0, 1.0))
        if gap(low) * gap(high) < 0.0:
            return brentq(gap, low, high, rtol=1e-10)
    return float("nan")


def again(scene: ds.Scene, slow_cycles: int, point: ds.BranchPoint) -> float:
    """The value of a doubling by bisection; NaN if it is not between two values next to it."""

    def state(value: float) -> object:
        cycles = near(scene, value, slow_cycles, point)
        closest = min(cycles, key=lambda each: abs(each.period - point.period), default=None)
        return closest.stable if closest else None

    distance = FROM
    while distance > 10.0 * ACCURACY:
        low, high = point.value * (1.0 - distance), point.value * (1.0 + distance)
        states = state(low), state(high)
        if None not in states and states[0] != states[1]:
            break
        distance *= 0.3
    else:
        return float("nan")
    while high - low > ACCURACY * high:
        middle = 0.5 * (low + high)
        if state(middle) == states[0]:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def main() -> None:
    options = options_of(__doc__, rigs=(10, 20), seed=1, model=("full", "low_frequency"))
    rng = random.Random(options.seed)
    differences, unseen, seconds, branches = [], 0, [], 0
    for number in range(options.rigs):
        scene = rig(rng, options.model)
        own = scene.system.misalignment_deg
        begun = time.perf_counter()
        found = ds.branch(scene, "misalignment_deg", 0.5 * own, 4.0 * own, slow_cycles=1, most_branches=3)
        seconds.append(time.perf_counter() - begun)
        branches += len(found.branches)
        for each in found.branches:
            for point in each.points[1:-1]:
                if point.kind not in ("fold", "doubling"):
                    continue
                if point.kind == "fold":
                    other = touching(scene, options.model, each.slow_cycles, point)
                else:
                    other = again(scene, each.slow_cycles, point)
                unseen += np.isnan(other)
                differences.append(other / point.value - 1.0)
                print(
                    f"rig {number}: {point.kind} at {point.value:.10g} deg, again {other:.10g}: {differences[-1]:.1e}",
                    flush=True,
                )
    size = np.abs([each for each in differences if np.isfinite(each)])
    print(
        f"{options.rigs} rigs, {branches} branches in {np.median(seconds):.2g} s a rig (median), at most {max(seconds):.2g} s"
    )
    print(
        f"{len(differences)} folds and doublings, {unseen} of them not found again; largest difference {size.max(initial=0.0):.1e}"
    )


if __name__ == "__main__":
    main()
