"""Derivatives of runs against differences of runs.

    python bench/sensitivity.py [--scenes 200] [--seed 1] [--keys 2] [--short]

Scenes of all laws, with dampers, ramps and jumps of V, starts in motion, smoothed contact and all adaptive methods, some hundred
periods of the fast oscillation long. Columns and times of events by `dynstiction.derivatives` at rtol 1e-12 (1e-11 by explicit methods,
scenes of more than 40,000 steps are left out) against differences of fourth order of runs of radau13 at 1e-12, closer together where
they magnify changes. Samples at which slip begins or ends in some of these runs are left out.
"""

import math
import random
import sys
from collections import Counter
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "audit"))

import dynstiction as ds
import numpy as np
from common import FIG3, options_of, progress, timed
from scenes import log_uniform

METHODS = ("radau5", "radau9", "radau13", "dopri5", "dop853")
COLUMNS = ("u_x", "u_y", "w_x", "w_y", "X", "Y", "spring_force_x", "spring_force_y", "friction", "theta")


def run_scene(seed: int, number: int) -> tuple[ds.Scene, str]:
    """A random scene for runs, and what is in it."""
    chance = random.Random(f"runs {seed} {number}")
    ranges = ((1e3, 1e5), (0.1, 5.0), (1.0, 50.0), (10.0, 1e3), (1e-4, 1e-2), (1e-3, 5e-2))
    k_x, mass, load, ratio, v, v_f = (log_uniform(chance, *bounds) for bounds in ranges)
    k_y, mu = k_x * ratio, chance.uniform(0.1, 0.5)
    length = mu * load / k_x
    t_end = min(length / v * chance.uniform(0.5, 2.5), 400.0 / math.sqrt(k_y / mass))
    law = chance.choice(["weakening", "stribeck", "constant", "table", "static"])
    what, keys = [law], {"law": "weakening" if law == "static" else law}
    if law == "table":
        keys |= {
            "table_speed": (0.0, v_f, 3 * v_f, 10 * v_f),
            "table_mu": (mu, 0.8 * mu, 0.75 * mu, 0.7 * mu),
        }
    else:
        keys["mu_0"] = mu
    if law == "static":
        keys["mu_static"] = mu * chance.uniform(1.0, 1.2)
    if keys["law"] in ("weakening", "stribeck"):
        keys |= {"mu_inf": mu * chance.uniform(0.5, 0.95), "v_f": v_f}
    if law == "stribeck":
        keys |= {"exponent": chance.uniform(1.0, 2.0), "viscous": chance.uniform(0.0, 0.2)}
    keys |= {"misalignment_deg": chance.uniform(0.3, 10.0), "velocity": v}
    method = chance.choice(METHODS)
    if chance.random() < 0.4:
        what.append("dampers")
        keys |= {
            "damping_x": 0.05 * math.sqrt(k_x * mass) * chance.random(),
            "damping_y": 0.3 * math.sqrt(k_y * mass) * chance.random(),
        }
    kind = chance.random()
    if kind < 0.3:
        what.append("ramps")
        keys |= {"time": (0.0, 0.2 * t_end, 0.5 * t_end, 0.7 * t_end), "velocity": (v, v, 2 * v, -0.5 * v)}
    elif kind < 0.4:
        what.append("jump")
        keys |= {"time": (0.0, 0.3 * t_end, 0.3 * t_end), "velocity": (v, v, 3 * v)}
    if chance.random() < 0.5:
        what.append("start")
        keys |= {
            "velocity_ratio": chance.uniform(0.1, 2.0),
            "elongation_x": chance.uniform(-0.5, 0.5) * length,
            "elongation_y": chance.uniform(-0.5, 0.5) * mu * load / k_y,
        }
    if chance.random() < 0.2 and law != "static":
        what.append("smoothed")
        keys |= {"contact": "smoothed", "v_smooth": 1e-2 * v}
        method = "radau13"
    keys |= {"method": method, "rtol": 1e-12 if method.startswith("radau") else 1e-11, "max_steps": 40000}
    keys |= {"model": "full", "t_end": t_end, "interval": t_end / 97, "fields": "default"}
    scene = ds.Scene(mass=mass, stiffness_x=k_x, stiffness_y=k_y, normal_load=load, **keys)
    return scene, " ".join([method, *what])


def errors_of_run(found: ds.Derivatives, scene: ds.Scene, key: str, cycle_map: str) -> tuple[float, float]:
    """Largest errors of the derivatives of columns and of events with respect to a key, relative to what is large; NaN for both if
    the runs nearby have other events.
    """
    value, place = found.parameters[key], list(found.parameters).index(key)
    changes = {column: change[:, place] * value for column, change in found.derivatives.items()}
    scale = {name: np.abs(column).max() for name, column in found.columns.items()}
    # The object at rest has X and Y by roundoff.
    for column in ("X", "Y"):
        scale[column] = max(scale[column], 1e-3 * scale["u_x"] + 1e-3 * scale["u_y"])
    magnified = max(np.abs(changes[name]).max() / scale[name] for name in COLUMNS if scale[name] > 0.0)
    width = min(1e-4, 1e-3 / max(magnified, 1e-3))
    finest = {"method": "radau13", "rtol": 1e-12}
    if scene.friction.contact == "exact":
        finest["cycle_map"] = cycle_map
    near = [
        ds.run(scene.replace(**{key: value * (1 + i * width)}), integrator=finest) for i in (-2, -1, 1, 2)
    ]
    if any(not np.array_equal(one.events["kind"], found.events["kind"]) for one in near):
        return math.nan, math.nan
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * width)
    shift = found.event_derivatives[:, place] * value
    by_runs = weights @ np.array([one.events["time"] for one in near])
    events = np.abs(shift - by_runs).max(initial=0.0) / max(np.abs(shift).max(initial=0.0), found.time[-1])
    reach = 3.0 * width * np.abs(shift) + 1e-12
    smooth = ~(np.abs(found.time[:, np.newaxis] - found.events["time"]) < reach).any(axis=1)
    columns = 0.0
    for name in COLUMNS:
        error = np.abs(changes[name] - weights @ np.array([one[name] for one in near]))[smooth].max()
        columns = max(columns, error / max(scale[name], np.abs(changes[name]).max(), 1e-300))
    return columns, events


def main() -> None:
    options = options_of(__doc__, scenes=(200, 8), seed=1, keys=2)
    errors, left_out = [], Counter()
    for number in progress(range(options.scenes), "scenes"):
        scene, what = run_scene(options.seed, number)
        chosen = random.Random(f"keys {options.seed} {number}")
        try:
            found = ds.derivatives(scene)
            cycle_map = chosen.choice(["auto", "off"])
            for key in chosen.sample(sorted(found.parameters), options.keys):
                error = errors_of_run(found, scene, key, cycle_map)
                if math.isnan(error[0]):
                    left_out["other events nearby"] += 1
                    continue
                errors.append(error)
                if max(error) > 1e-6:
                    print(
                        f"scene {number} ({what}, map {cycle_map}), {key}: columns {error[0]:.1e}, events {error[1]:.1e}"
                    )
        except ds.SolverError as error:
            left_out[str(error)[:40]] += 1
    print(f"{options.scenes} scenes, {len(errors)} comparisons; left out: {dict(left_out)}")
    for title, error in zip(("columns", "events"), np.array(errors).T, strict=True):
        print(
            f"{title}: median {np.median(error):.1e}, 90 % {np.quantile(error, 0.9):.1e}, largest {error.max():.1e}; "
            f"below 1e-6: {np.mean(error <= 1e-6):.1%}"
        )
    # What a parameter costs, over a run of Fig. 3 step by step.
    scene = ds.Scene(FIG3, t_end=3.0, interval=3.0, cycle_map="off")
    every = list(ds.derivatives(scene).parameters)
    run, one, all_of_them = (
        median(timed(work, 7)[0])
        for work in (
            lambda: ds.run(scene),
            lambda: ds.derivatives(scene, every[:1]),
            lambda: ds.derivatives(scene, every),
        )
    )
    print(
        f"Fig. 3, 3 s, step by step: run {1e3 * run:.0f} ms, one parameter {1e3 * one:.0f} ms, {len(every)} parameters "
        f"{1e3 * all_of_them:.0f} ms: each further one {(all_of_them - one) / (len(every) - 1) / run:.1%} of the run"
    )


if __name__ == "__main__":
    main()
