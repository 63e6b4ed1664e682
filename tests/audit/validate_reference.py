"""How right the reference itself is: against the values in quadruple precision, and against itself with other stages and precision.

python tests/audit/validate_reference.py [--scenes 20] [--seed 12] [--quadruple]
"""

from __future__ import annotations

import argparse
import json
import subprocess
from pathlib import Path

import numpy as np
import truth as tr
from scenes import random_scenes

PUBLISHED = tr.CHECKOUT / "tests" / "reference" / "fig3.json"


def published(until: float = np.inf) -> dict[str, tuple[str, list[list[float]], list[list[float]]]]:
    """Inputs for the scenes of tests/reference/fig3.json, with their states and sticks, up to a time [s]."""
    document = json.loads(PUBLISHED.read_text())
    found = {}
    for name, scene in document["scenes"].items():
        keys: dict[str, object] = {}
        for groups in (document["deck"], scene["change"]):
            for group in groups.values():
                keys.update(group)
        if keys.pop("law", "weakening") == "constant":
            keys |= {"mu_inf": keys["mu_0"], "v_f": 1.0}
        keys["velocity_ratio"] = 0.0  # the values belong to a start from rest
        keys.pop("model")
        states = [state for state in scene["states"] if state[0] <= until]
        if not states:
            continue
        keys["t_end"] = max(state[0] for state in states)
        times = " ".join(repr(state[0]) for state in states)
        lines = ["decimal 1", *(f"{key} {value!r}" for key, value in keys.items()), f"samples {times}"]
        sticks = [row for row in scene["sticks"] if row[0] <= keys["t_end"]]
        found[name] = "\n".join(lines) + "\n", states, sticks
    return found


def against_published(program: Path, until: float = np.inf) -> float:
    """Largest difference: u relative to itself, w relative to |w|. The number of sticks must be the same."""
    worst = 0.0
    for name, (text, states, sticks) in published(until).items():
        output = subprocess.run([program], input=text, capture_output=True, text=True, check=True).stdout
        truth = tr.parse(output)
        for t, u_x, u_y, w_x, w_y in states:
            k = int(np.argmin(np.abs(truth.time - t)))
            errors = [
                abs(truth.u[0][k] / u_x - 1),
                abs(truth.u[1][k] / u_y - 1),
                float(np.hypot(truth.w[0][k] - w_x, truth.w[1][k] - w_y) / np.hypot(w_x, w_y)),
            ]
            print(f"{name:18s} t = {t:5g}: u_x {errors[0]:.1e}, u_y {errors[1]:.1e}, w {errors[2]:.1e}")
            worst = max(worst, *errors)
        for t, count in sticks:
            found = int(np.count_nonzero((truth.event_kind == 1) & (truth.event_time <= t)))
            assert found == count, (name, t, found, count)
    return worst


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=12)
    parser.add_argument("--quadruple", action="store_true", help="compare with __float128, not with other stages")
    arguments = parser.parse_args()
    reference = tr.Reference()
    print(f"largest difference from the published values: {against_published(reference.program):.1e}")
    other = tr.Reference(quadruple=True) if arguments.quadruple else reference
    settings = {"tolerance": 1e-16, "stages": 14} if arguments.quadruple else {"tolerance": 1e-14, "stages": 9}
    worst = 0.0
    for number, scene in enumerate(random_scenes(arguments.seed, arguments.scenes)):
        truth, again = reference.run(scene), other.run(scene, **settings)
        scale, condition = tr.scales(scene, truth), tr.conditioning(scene, truth, reference.perturbed(scene))
        here, there = tr.columns(scene, truth), tr.columns(scene, again)
        raw, shared, where = 0.0, 0.0, ""
        for name in here:
            gap = tr.differences(name, there[name], here[name]) / scale[name]
            if name in tr.JUMPING:
                gap = np.where(again.sticking == truth.sticking, gap, 0.0)
            gap = np.nan_to_num(gap, nan=0.0)
            if gap.max() > raw:
                raw, where = float(gap.max()), name
            shared = max(shared, float((gap / (1 + condition[name])).max()))
        worst = max(worst, shared)
        events = "same events" if np.array_equal(truth.event_kind, again.event_kind) else "EVENTS DIFFER"
        print(f"{number:4d} {raw:.1e} ({where}), over conditioning {shared:.1e}, {events}", flush=True)
    print(f"largest difference over conditioning: {worst:.1e}")


if __name__ == "__main__":
    main()
