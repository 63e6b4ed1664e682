"""What a run and `dynstiction.cycles` say of a motion, against runs by steps: random scenes of the full model.

    python bench/repeats.py [--scenes 100] [--first 0] [--seed 1] [--slow-cycles 150] [--runs-only] [--short]

A run with the cycle map off (radau13, rtol 1e-9) is as long as some hundred slow cycles. Its releases tell whether it repeats: the
intervals between the last ones agree with those of n releases before. Compared are the time after which it repeats, and the verdict, of
`cycles`, and of a run with the map at the usual tolerance: `repeats` times its mean period. Prints a line for each scene where they
differ, and for each verdict how many there are and how long the analysis takes. With --runs-only only runs are compared.
"""

import collections
import math
import random
import time
from statistics import median

import dynstiction as ds
import numpy as np
from common import FIG3, options_of

SCENE = ds.Scene(FIG3)
RANGES = {
    "system.misalignment_deg": (0.2, 25.0),
    "drive.velocity": (1e-4, 1e-1),
    "system.mass": (3e-3, 3.0),
    "friction.mu_inf": (0.05, 0.199),
    "friction.v_f": (2e-3, 5e-2),
    "system.stiffness_y": (1.3e3, 1e8),
}
ALIKE = 1e-6
"""Largest difference of two intervals that are the same, over the longer one."""
NEAR = 1e-5
"""Largest difference of two periods that are the same, relative to them."""
ONE = {"interval": 1e9, "fields": ["u_x"]}
"""No samples but the first and the last."""


def main() -> None:
    options = options_of(
        __doc__, scenes=(100, 4), first=0, seed=1, slow_cycles=(150.0, 20.0), runs_only=False
    )
    taken = collections.defaultdict(list)
    verdicts, runs = collections.Counter(), collections.Counter()
    for number in range(options.first, options.first + options.scenes):
        chance = random.Random(f"{options.seed} {number}")
        values = {key: math.exp(chance.uniform(*map(math.log, bounds))) for key, bounds in RANGES.items()}
        scene = SCENE.replace(**values)
        slow = 2.0 / (1e3 * scene.drive.velocity) + 2 * math.pi * math.sqrt(scene.system.mass / 1e3)
        scene = scene.replace(t_end=options.slow_cycles * slow)
        period, releases = repeats_after(scene)
        said, what = of_run(scene, period)
        runs[said] += 1
        if said == "wrong":
            print(f"scene {number}: the run says {what}, steps {period}")
        if options.runs_only:
            continue
        begun = time.perf_counter()
        found = ds.cycles(scene)
        verdict = found.regularity.verdict
        taken[verdict].append(time.perf_counter() - begun)
        told = [cycle.period for cycle in found.stable]
        if period is not None:
            right = verdict == "regular" and any(abs(period - one) <= NEAR * period for one in told)
        elif releases == 0:
            # It slides, or its stick-slip has no stick.
            right = verdict in {"steady sliding", "regular"}
        else:
            right = verdict != "steady sliding"
        verdicts["agree" if right else "differ"] += 1
        if not right or period is None:
            about = found.regularity
            print(
                f"scene {number}: {verdict} ({about.exponent:.3g} +- {about.error:.2g}), repeats {about.repeats}, stable {told}; "
                f"run: {period}, {releases} releases",
                *(() if right else [f"--set {key}={value!r}" for key, value in values.items()]),
                flush=True,
            )
    print(f"cycles: {verdicts['agree']} agree, {verdicts['differ']} differ; runs: {dict(runs)}")
    for verdict, seconds in taken.items():
        print(
            f"{verdict:15s} {len(seconds):4d} scenes, median {1e3 * median(seconds):8.1f} ms, longest {max(seconds):6.2f} s"
        )


def repeats_after(scene: ds.Scene) -> tuple[float | None, int]:
    """The time after which the releases of a run by steps repeat [s], None if they do not; and how many there are in its later half."""
    steps = {"method": "radau13", "rtol": 1e-9, "cycle_map": "off"}
    run = ds.run(scene, integrator=steps, output=ONE | {"wall_limit": 20.0})
    release = run.events["time"][run.events["kind"] == 2]
    late = release[release > 0.5 * run.time[-1]]
    between = np.diff(late)
    for n in range(1, between.size // 3):
        if np.all(np.abs(between[-2 * n :] - between[-3 * n : -n]) <= ALIKE * between[-3 * n :].max()):
            return float(between[-n:].sum()), late.size
    return None, late.size


def of_run(scene: ds.Scene, period: float | None) -> tuple[str, str]:
    """Whether a run with the map is right about the period by steps, and what it says."""
    summary = ds.run(scene, output=ONE).summary
    # A motion with releases whose load does not swing repeats with its fast oscillation, and has no slow cycle.
    if period is None or summary["cycles"] == 0:
        return "other" if period is None and not summary.get("repeats") else "not compared", ""
    right = abs(summary["repeats"] * summary["period"] - period) <= NEAR * period
    return "right" if right else "wrong", f"{summary['repeats']} x {summary['period']}"


if __name__ == "__main__":
    main()
