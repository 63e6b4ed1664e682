"""What a run and `dynstiction.cycles` say of a motion, against runs by steps: random scenes of the full model.

    python bench/repeats.py [--scenes 100] [--seed 1] [--starts 0] [--slow-cycles 150] [--runs-only] [--short]

A run with the cycle map off (radau13, rtol 1e-9) is as long as some hundred slow cycles. Its releases tell whether it repeats: the
intervals between the last ones agree with those of n releases before. Compared are the time after which it repeats, and the verdict, of
`cycles`, and of a run with the map at the usual tolerance: `repeats` times its mean period. Prints a line for each scene where they
differ, and for each verdict how many there are and how long the analysis takes. With ``--starts`` runs begin with as many random
elongations of each scene: what they repeat has to be one of the cycles, too. With ``--runs-only`` only runs are compared.
"""

import argparse
import collections
import math
import random
import time
from pathlib import Path
from statistics import median

import dynstiction as ds
import numpy as np

FIG3 = ds.Scene(Path(__file__).resolve().parent.parent / "inputs" / "fig3.nml")
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
ONE = {"interval": 1e9, "fields": ["u_x"]}
"""No samples but the first and the last."""


def random_scene(seed: int, number: int) -> ds.Scene:
    chance = random.Random(f"{seed} {number}")
    groups: dict[str, dict[str, float]] = collections.defaultdict(dict)
    for key, (low, high) in RANGES.items():
        group, name = key.split(".")
        groups[group][name] = math.exp(chance.uniform(math.log(low), math.log(high)))
    return FIG3.replace(**groups)


def length_of(scene: ds.Scene, slow_cycles: float) -> float:
    """As long as so many slow cycles [s]."""
    return slow_cycles * (
        2.0 / (1e3 * scene.drive.velocity) + 2 * math.pi * math.sqrt(scene.system.mass / 1e3)
    )


def repeats_after(scene: ds.Scene, slow_cycles: float) -> tuple[float | None, int]:
    """The time after which the releases of a run by steps repeat [s], None if they do not; and how many there are in its later half."""
    t_end = length_of(scene, slow_cycles)
    steps = {"method": "radau13", "rtol": 1e-9, "cycle_map": "off"}
    run = ds.run(
        scene,
        scene={"t_end": t_end},
        integrator=steps,
        output=ONE | {"wall_limit": 20.0},
    )
    release = run.events["time"][run.events["kind"] == 2]
    late = release[release > 0.5 * run.time[-1]]
    between = np.diff(late)
    for n in range(1, between.size // 3):
        if np.all(np.abs(between[-2 * n :] - between[-3 * n : -n]) <= ALIKE * between[-3 * n :].max()):
            return float(between[-n:].sum()), late.size
    return None, late.size


def period_from(scene: ds.Scene, chance: random.Random) -> float | None:
    """The time after which a run repeats that begins with random elongations within the limit of rest [s]; None if it does not."""
    pull, angle = 2.0 * math.sqrt(chance.random()), chance.uniform(-math.pi, math.pi)
    summary = ds.run(
        scene,
        initial={
            "velocity_ratio": 0.0,
            "elongation_x": pull * math.cos(angle) / 1e3,
            "elongation_y": pull * math.sin(angle) / scene.system.stiffness_y,
        },
        scene={"t_end": length_of(scene, 100.0)},
        integrator={"method": "radau13", "rtol": 1e-9},
        output=ONE,
    ).summary
    return summary["repeats"] * summary["period"] if summary.get("repeats") and summary["cycles"] else None


def missing(periods: list[float | None], found: ds.Cycles) -> list[float]:
    """Those that no stable cycle has."""
    return [
        period
        for period in periods
        if period is not None
        and not any(abs(period - cycle.period) <= 1e-5 * period for cycle in found.stable)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--starts", type=int, default=0, help="runs from other elongations")
    parser.add_argument("--slow-cycles", type=float, default=150, help="length of the runs")
    parser.add_argument("--runs-only", action="store_true", help="leave out cycles")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    taken = collections.defaultdict(list)
    agree = differ = attractors = missed = 0
    runs = collections.Counter()
    for number in range(options.first, options.first + (4 if options.short else options.scenes)):
        scene = random_scene(options.seed, number)
        period, releases = repeats_after(scene, 20 if options.short else options.slow_cycles)
        summary = ds.run(
            scene, scene={"t_end": length_of(scene, 20 if options.short else options.slow_cycles)}, output=ONE
        ).summary
        # A motion with releases whose load does not swing repeats with its fast oscillation, and has no slow cycle.
        if period is None or summary["cycles"] == 0:
            said = "other" if period is None and not summary.get("repeats") else "not compared"
        else:
            said = (
                "right" if abs(summary["repeats"] * summary["period"] - period) <= 1e-5 * period else "wrong"
            )
        runs[said] += 1
        if said == "wrong":
            print(f"scene {number}: the run says {summary['repeats']} x {summary['period']}, steps {period}")
        if options.runs_only:
            continue
        begun = time.perf_counter()
        found = ds.cycles(scene)
        verdict = found.regularity.verdict
        taken[verdict].append(time.perf_counter() - begun)
        others = [
            period_from(scene, random.Random(f"{options.seed} {number} {start}"))
            for start in range(options.starts)
        ]
        lost = missing(others, found)
        attractors, missed = attractors + len(others) - others.count(None), missed + len(lost)
        if lost:
            print(f"scene {number}: runs from elsewhere repeat after {lost} s, which is no cycle")
        told = [cycle.period for cycle in found.stable]
        if period is not None:
            right = verdict == "regular" and any(abs(period - one) <= 1e-5 * period for one in told)
        elif releases == 0:
            # It slides, or its stick-slip has no stick.
            right = verdict in {"steady sliding", "regular"}
        else:
            right = verdict != "steady sliding"
        agree, differ = agree + right, differ + (not right)
        if not right:
            keys = " ".join(
                f"--set {key}={getattr(getattr(scene, key.split('.')[0]), key.split('.')[1])!r}"
                for key in RANGES
            )
            print(
                f"scene {number}: {verdict}, repeats {found.regularity.repeats}, stable {told}; run: {period}, {releases} releases\n  {keys}",
                flush=True,
            )
        elif period is None:
            print(
                f"scene {number}: {verdict} ({found.regularity.exponent:.3g} +- {found.regularity.error:.2g}), run does not repeat, {releases} releases",
                flush=True,
            )
    print(f"cycles: {agree} agree, {differ} differ; runs: {dict(runs)}")
    print(f"runs from elsewhere that repeat: {attractors}, not in the list: {missed}")
    for verdict, seconds in taken.items():
        print(
            f"{verdict:15s} {len(seconds):4d} scenes, median {1e3 * median(seconds):8.1f} ms, longest {max(seconds):6.2f} s"
        )


if __name__ == "__main__":
    main()
