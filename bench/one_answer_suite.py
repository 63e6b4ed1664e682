"""How many random scenes give one answer: summary values by radau13 and radau5, and scenes near Fig. 3 with the map and without.

python bench/one_answer_suite.py summaries [--scenes 1500] [--seed 31] [--report FILE]
python bench/one_answer_suite.py near_fig3 [--scenes 1000] [--seed 31] [--report FILE]
"""

from __future__ import annotations

import argparse
import collections
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "invariance"))

import dynstiction as ds
import numpy as np
from motions import Groups, Judgement, Motion, changed, compare_summary, deck, near_fig3, random_groups, rig, run, value_of


def with_settings(groups: Groups, method: str, rtol: float, cycle_map: str) -> Groups:
    return changed(groups, {"integrator": {"method": method, "rtol": rtol, "cycle_map": cycle_map}})


def one_summary(seed: int, number: int) -> tuple[str, list[tuple[str, Judgement, Groups, Groups]]]:
    base = (rig if number % 2 else random_groups)(seed, number)
    truth_groups = with_settings(base, "radau5", 1e-9, "off")
    truth = run(truth_groups)
    if isinstance(truth, str):
        return truth, []
    found = []
    for rtol in (1e-6, 1e-8):
        motion = Motion(base, rtol + 1e-9)
        for cycle_map in ("off", "auto"):
            groups = with_settings(base, "radau13", rtol, cycle_map)
            result = run(groups)
            name = f"{rtol:.0e} map {cycle_map}"
            if isinstance(result, str):
                judgement = Judgement()
                judgement.failure = result
            else:
                judgement = compare_summary(motion, result, truth)
            found.append((name, judgement, groups, truth_groups))
    return "", found


def summaries(arguments: argparse.Namespace) -> None:
    values, unjudged, wrong, scenes, failed = (collections.Counter() for _ in range(5))
    worst = []
    began = time.time()
    for number in range(arguments.first, arguments.first + arguments.scenes):
        failure, rows = one_summary(arguments.seed, number)
        if failure:
            failed[failure[:40]] += 1
            continue
        scenes["judged"] += 1
        bad = False
        for name, j, groups, truth_groups in rows:
            values[name] += j.values
            if getattr(j, "failure", ""):
                print(number, name, j.failure, flush=True)
                worst.append((1e9, number, name, j.failure, groups, truth_groups))
                bad = True
            for key in j.unjudged:
                unjudged[name, key] += 1
            for fault in j.faults:
                wrong[name, fault.name] += 1
                worst.append((fault.over, number, name, str(fault), groups, truth_groups))
                print(number, name, fault, flush=True)
                bad = True
        scenes["wrong"] += bad
    print(dict(scenes), "not run:", dict(failed), f"{time.time() - began:.0f} s")
    print("values", dict(values))
    print("unjudged", sum(unjudged.values()), unjudged.most_common(40))
    for (name, key), n in sorted(wrong.items()):
        print(f"{name:16s} {key:24s} {n}")
    write_report(arguments.report, worst)


MEANS = ("period", "peak_force", "valley_force", "stick_duration", "slip_duration", "slip_length", "swing")
SETTLED = 40.0
"""Length of the first run without the map [s]: some forty slow cycles."""
CHANCE = 6.0
"""Irregular motions: how many standard errors two means may differ."""


def order_faults(result: ds.Result, t_end: float) -> Iterator[str]:
    """Time runs on, events take turns, and nothing is after the end."""
    time, kind = result.events["time"], result.events["kind"]
    if (np.diff(result.time) <= 0).any() or result.time[-1] != t_end:
        yield f"samples run back, or end at {result.time[-1]} and not at {t_end}"
    if (np.diff(time) < 0).any():
        yield f"events run back by {-np.diff(time).min():.3g} s"
    if time.size and not 0 <= time[0] <= time[-1] <= t_end:
        yield f"events from {time[0]} to {time[-1]}, t_end {t_end}"
    if (kind[1:] == kind[:-1]).any():
        yield "stick and slip do not take turns"
    if abs(value_of(result, "energy_residual")) > 400 * float(result.parameters["rtol"]):
        yield f"energy_residual {value_of(result, 'energy_residual'):.3g}"


def mean_faults(motion: Motion, with_map: ds.Result, without: ds.Result) -> tuple[str, list[str]]:
    """How the means were judged, and which differ."""
    judgement = compare_summary(motion, with_map, without, only=MEANS)
    if not judgement.faults and not judgement.unjudged:
        return "within 30 rtol (1 + C)", []
    faults = [str(fault) for fault in judgement.faults]
    for key in judgement.unjudged:
        values = [value_of(result, key) for result in (with_map, without)]
        scatter = [value_of(result, key + "_scatter") for result in (with_map, without)]
        if key == "swing":
            continue
        counts = [min(value_of(result, "cycles") / 2, 100) for result in (with_map, without)]
        chance = CHANCE * math.hypot(*(s / math.sqrt(max(n, 1)) for s, n in zip(scatter, counts, strict=True)))
        if not abs(values[0] - values[1]) <= chance:
            faults.append(f"{key}: {values[0]:.10g} +- {scatter[0]:.3g}, without the map {values[1]:.10g} +- {scatter[1]:.3g} (irregular)")
    return "irregular", faults


def near(arguments: argparse.Namespace) -> None:
    how, worst, wrong = collections.Counter(), [], 0
    began = time.time()
    for number in range(arguments.first, arguments.first + arguments.scenes):
        groups = near_fig3(arguments.seed, number)
        t_end, rtol = groups["scene"]["t_end"], groups["integrator"]["rtol"]
        unlimited = {"integrator": {"max_steps": 0}, "output": {"interval": t_end / 64, "wall_limit": 400.0}}
        groups = changed(groups, unlimited)
        start = time.time()
        result = run(groups)
        spent = time.time() - start
        off = changed(groups, {"integrator": {"cycle_map": "off"}})
        if isinstance(result, str):
            how["no result"] += 1
            faults = [result]
        else:
            faults = list(order_faults(result, t_end))
            short = changed(off, {"scene": {"t_end": min(SETTLED, t_end)}})
            verdict, differing = mean_faults(Motion(short, rtol), result, run(short))
            if differing and not faults:
                # Perhaps it takes longer to settle.
                verdict, differing = mean_faults(Motion(short, rtol), result, run(off))
                verdict += ", whole length"
            faults += differing
            how[verdict] += 1
        if arguments.verbose:
            print(number, f"{spent:.1f} {time.time() - start:.1f} s", t_end, groups["integrator"], flush=True)
        if faults:
            wrong += 1
            worst.append((-number, number, "near Fig. 3", "; ".join(faults), groups, off))
            print(number, "; ".join(faults), flush=True)
    print(f"{wrong} of {arguments.scenes} scenes wrong", dict(how), f"{time.time() - began:.0f} s")
    write_report(arguments.report, worst)


def write_report(path: Path | None, worst: list) -> None:
    if path is None:
        return
    worst.sort(key=lambda row: -row[0])
    text, seen = [], set()
    for _, number, name, what, groups, right in worst:
        text.append(f"! scene {number}, {name}: {what}")
        if (number, name) not in seen:
            text += [deck(groups), "! right:", deck(right)]
        seen.add((number, name))
    path.write_text("\n".join(text))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["summaries", "near_fig3"])
    parser.add_argument("--scenes", type=int, default=1500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=31)
    parser.add_argument("--report", type=Path)
    parser.add_argument("--verbose", action="store_true")
    arguments = parser.parse_args()
    {"summaries": summaries, "near_fig3": near}[arguments.what](arguments)


if __name__ == "__main__":
    main()
