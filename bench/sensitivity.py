"""Derivatives of settled cycles against two things that know nothing of them: units, and differences of cycles.

    python bench/sensitivity.py [--scenes 200] [--seed 1] [--short]

Random scenes of the full model, those of bench/repeats.py with dampers, a static limit and Stribeck's law in some of them. Physics does
not hang on units: for each of mass, length and time the elasticities of a measure, weighted with the powers of the parameters' units,
add up to the power of its own. And a few parameters are changed in `dynstiction.cycles` by a part in 1e6, by central differences of
two widths. Prints the largest error of both for each measure, percentiles over scenes, and what a parameter costs.
"""

import argparse
import math
import random
import time

import dynstiction as ds
import numpy as np
from repeats import random_scene

MASS, LENGTH, TIME = np.eye(3)
UNITS = {
    "mass": MASS,
    "stiffness_x": MASS - 2 * TIME,
    "stiffness_y": MASS - 2 * TIME,
    "damping_x": MASS - TIME,
    "damping_y": MASS - TIME,
    "normal_load": MASS + LENGTH - 2 * TIME,
    "v_f": LENGTH - TIME,
    "velocity": LENGTH - TIME,
}
"""Powers of mass, length and time in the units of each parameter; the others have none."""
FORCE = MASS + LENGTH - 2 * TIME
MEASURES = np.array([TIME, FORCE, FORCE, TIME, TIME, LENGTH])
"""The same for the measures of a cycle."""
NEAR = 1e-6


def richer_scene(seed: int, number: int) -> ds.Scene:
    """A random scene with more of what a deck may have."""
    chance = random.Random(f"more {seed} {number}")
    scene = random_scene(seed, number)
    scale = math.sqrt(scene.system.stiffness_x * scene.system.mass)
    if chance.random() < 0.3:
        scene = scene.replace(
            system={
                "damping_x": 1e-2 * scale * chance.random(),
                "damping_y": scale * chance.random(),
            }
        )
    if chance.random() < 0.3:
        scene = scene.replace(friction={"mu_static": 0.2 * chance.uniform(1.0, 1.2)})
    if chance.random() < 0.3:
        scene = scene.replace(friction={"law": "stribeck", "exponent": chance.uniform(1.0, 2.0)})
    return scene


def errors_of_units(found: ds.Sensitivity) -> np.ndarray:
    """How far the elasticities of each measure are from what its units ask for."""
    powers = np.array([UNITS.get(key.partition(".")[2], np.zeros(3)) for key in found.parameters])
    return np.abs(found.elasticities @ powers - MEASURES).max(axis=1)


def differences(scene: ds.Scene, key: str, cycle: ds.LimitCycle) -> np.ndarray | None:
    """The derivatives of a stable cycle by cycles nearby."""
    group, name = key.split(".")
    value = scene.groups()[group][name]
    slopes = []
    for width in (NEAR, 2 * NEAR):
        ends = []
        for side in (1, -1):
            stable = ds.cycles(scene.replace(**{group: {name: value * (1 + side * width)}})).stable
            near = [one for one in stable if abs(one.period - cycle.period) < 1e-3 * cycle.period]
            if len(near) != 1:
                return None
            ends.append(np.array(near[0][:6]))
        slopes.append((ends[0] - ends[1]) / (2 * width * value))
    return (4 * slopes[0] - slopes[1]) / 3


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keys", type=int, default=2, help="parameters of a scene that are differenced")
    parser.add_argument("--short", action="store_true", help="a few scenes")
    arguments = parser.parse_args()
    scenes = 8 if arguments.short else arguments.scenes
    units, against, cost, refused = [], [], [], {}
    for number in range(scenes):
        scene = richer_scene(arguments.seed, number)
        begin = time.perf_counter()
        try:
            found = ds.sensitivity(scene)
        except ds.Error as error:
            refused[str(error)[:60]] = refused.get(str(error)[:60], 0) + 1
            continue
        whole = time.perf_counter() - begin
        begin = time.perf_counter()
        stable = ds.cycles(scene).stable
        cost.append((whole - (time.perf_counter() - begin)) / len(found.parameters))
        units.append(errors_of_units(found))
        if units[-1].max() > 1e-6:
            print(f"scene {number}: units are wrong by {units[-1].max():.1e}")
        (cycle,) = [one for one in stable if abs(one.period / found.cycle["period"] - 1) < 1e-9][:1] or [None]
        keys = random.Random(number).sample(sorted(found.parameters), arguments.keys)
        for key in keys if cycle else ():
            place = list(found.parameters).index(key)
            near = differences(scene, key, cycle)
            if near is None:
                continue
            scale = found.parameters[key] / np.array([*found.cycle.values()])
            error = np.abs((found.derivatives[:, place] - near) * scale)
            against.append(error / np.maximum(1.0, np.abs(found.elasticities[:, place])))
            if against[-1].max() > 1e-5:
                print(
                    f"scene {number}, {key}: {against[-1].max():.1e}, elasticities {found.elasticities[:, place]}"
                )
    print(f"{scenes} scenes, {len(units)} with derivatives; {refused}")
    for title, errors in (("units", units), ("differences", against)):
        if not errors:
            continue
        table = np.array(errors)
        worst = table.max(axis=1)
        print(
            f"{title}: {len(table)} comparisons, median {np.median(worst):.1e}, 90 % {np.quantile(worst, 0.9):.1e}, "
            f"largest {worst.max():.1e}; below 1e-6: {np.mean(worst <= 1e-6):.1%}"
        )
        for name, error in zip(found.cycle, np.median(table, axis=0), strict=True):
            print(
                f"  {name:15s} median {error:.1e}, largest {table[:, list(found.cycle).index(name)].max():.1e}"
            )
    print(f"a parameter: median {1e3 * float(np.median(cost)):.1f} ms, longest {1e3 * max(cost):.0f} ms")


if __name__ == "__main__":
    main()
