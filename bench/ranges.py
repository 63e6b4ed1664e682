"""Where stick-slip ends in random rigs: the cost, and whether runs on both sides agree.

    python bench/ranges.py [--rigs 100] [--list] [--short]

Rigs have k_y/k_x from 2 to 1e4, every friction law, and in one of three a static limit. For misalignment, velocity and damper
`dynstiction.stick_slip_range` finds the ends. Then runs 1 % before and behind each end, by another method, tolerance and length, say on
which side there is stick-slip. Prints the ends at which they disagree, and the median time of a key; with --list every end and its cost.
"""

import math
import random
import time
import warnings
from statistics import median

import dynstiction as ds
from common import options_of

KEYS = ("system.misalignment_deg", "drive.velocity", "system.damping_x")
LEAST_SWING, BESIDE, LENGTHS = 0.05, 0.01, (2000.0, 6000.0)


def main() -> None:
    options = options_of(__doc__, rigs=(100, 1), list=False)
    warnings.simplefilter("ignore")
    draw = random.Random(11)
    seconds, ends, wrong, undecided = [], 0, 0, 0
    if options.short:
        # The first one has thousands of micro-sticks.
        rig(draw)
    for number in range(options.rigs):
        scene = rig(draw)
        for key in KEYS[:1] if options.short else KEYS:
            begun = time.perf_counter()
            found = ds.stick_slip_range(scene, key, progress=False)
            seconds.append(time.perf_counter() - begun)
            if options.list:
                print(
                    number,
                    key,
                    f"{seconds[-1]:.2f} s",
                    found.has_stick_slip,
                    found.keys[0].stick_slip,
                    flush=True,
                )
            for end in found.keys[0].stick_slip:
                if math.isnan(end):
                    continue
                ends += 1
                outwards = BESIDE if end > found.keys[0].value else -BESIDE
                try:
                    inside, outside = (
                        swings(scene, key, end * (1.0 + way * outwards)) for way in (-1.0, 1.0)
                    )
                except ds.SolverError:
                    undecided += 1
                    continue
                if inside != found.has_stick_slip or outside == found.has_stick_slip:
                    wrong += 1
                    print(
                        f"rig {number}, {key}: end {end:.5g}, {found.keys[0].jumps}: {inside} before it, {outside} behind it"
                    )
    print(f"{ends} ends, {wrong} more than 1 % from those of runs, {undecided} without an answer of runs")
    print(
        f"a key: median {median(seconds):.2f} s, nine of ten {sorted(seconds)[int(0.9 * len(seconds))]:.2f} s, largest {max(seconds):.2f} s"
    )


def rig(draw: random.Random) -> ds.Scene:
    """A random rig under a random velocity."""
    stiffness = 10.0 ** draw.uniform(2.5, 5.0)
    mu_0, load = draw.uniform(0.15, 0.5), 10.0 ** draw.uniform(0.5, 2.0)
    mu_inf, v_f = mu_0 * draw.uniform(0.6, 0.9), 10.0 ** draw.uniform(-3.0, -1.5)
    law = draw.choice(("weakening", "stribeck", "table"))
    friction = {"law": law, "normal_load": load}
    if law == "table":
        speeds = [v_f * i for i in (0.0, 0.25, 0.5, 1.0, 1.5, 2.5, 4.0, 8.0)]
        friction |= {
            "table_speed": speeds,
            "table_mu": [mu_inf + (mu_0 - mu_inf) * math.exp(-v / v_f) for v in speeds],
        }
    else:
        friction |= {"mu_0": mu_0, "mu_inf": mu_inf, "v_f": v_f}
    if law == "stribeck":
        friction |= {"exponent": draw.uniform(1.0, 2.0), "viscous": draw.choice((0.0, 0.02 * mu_0 / v_f))}
    if law != "table" and draw.random() < 1.0 / 3.0:
        friction["mu_static"] = mu_0 * draw.uniform(1.0, 1.3)
    return ds.Scene(
        system={"mass": 10.0 ** draw.uniform(-1.0, 0.7), "stiffness_x": stiffness,
                "stiffness_y": stiffness * 10.0 ** draw.uniform(0.3, 4.0), "misalignment_deg": draw.uniform(0.3, 8.0)},
        friction=friction,
        drive={"velocity": 10.0 ** draw.uniform(-4.0, -2.0)},
        scene={"t_end": 1.0},
    )  # fmt: skip


def swings(scene: ds.Scene, key: str, value: float) -> bool:
    """Whether a long run from rest swings by 5 % of F_0 in its later half, and goes on doing so."""
    changed = scene.replace(**{key: value})
    limit = (changed.friction.mu_0 or changed.friction.table_mu[0]) * changed.friction.normal_load
    system, speed = changed.system, changed.drive.velocity
    length = limit / (system.stiffness_x * speed) + 2.0 * math.pi * math.sqrt(
        system.mass / system.stiffness_x
    )
    swing = []
    for lengths in LENGTHS:
        result = ds.run(changed, scene={"t_end": lengths * length}, initial={"velocity_ratio": 0.0},
                        integrator={"method": "radau9", "rtol": 1e-8, "max_steps": 3_000_000},
                        output={"interval": lengths * length, "fields": ["u_x"]})  # fmt: skip
        verdict = result.summary.get("regularity")
        swing.append(0.0 if verdict in (2, 3) else result.summary["swing"])
        if verdict == 1 and result.summary["repeats"] > 0:
            break
    # A motion whose swing still falls is on its way to sliding.
    return swing[-1] >= LEAST_SWING * limit and swing[-1] > 0.9 * swing[0]


if __name__ == "__main__":
    main()
