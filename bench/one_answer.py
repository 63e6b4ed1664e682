"""How many random scenes give one answer, whatever the method, the tolerance and the cycle map.

python bench/one_answer.py [summaries] [near_fig3] [--scenes N] [--first 0] [--seed 31] [--report FILE] [--short]

summaries
    Every summary value by radau13 at 1e-6 and at 1e-8, map on and off, against radau5 at 1e-9 with the map off: random scenes of the
    audit, rigs with 3 to 60 slow cycles, and 5 to 20 s near Fig. 3.

near_fig3
    4 to 9 degrees, k_y and V within a factor of 2, radau5, 9 and 13, rtol 1e-3 to 1e-8, 50 to 5,000 s: no event out of order or after
    t_end, the balance closed, and every mean as with the map off. Means are compared with those of 40 s without the map, and if they
    differ, with those of the whole length. Irregular means may differ by 6 standard errors.

What is allowed, and when a value is not judged: tests/invariance/motions.py.
"""

from __future__ import annotations

import collections
import math
import random
import sys
import time
from pathlib import Path

# Before the programs of this folder, one of which is called fig3, too.
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "audit"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "python"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "invariance"))

import dynstiction as ds
import invariance as iv
import motions as mo
from common import options_of
from fig3 import Groups, changed
from scenes import log_uniform

SETTLED = 40.0
"""Length of the first run without the map [s]: some forty slow cycles."""
STANDARD_ERRORS = 6.0
"""Of a thousand scenes with six means each, none by chance. Twice: a mean that is off by a scatter passes with 100 cycles."""


class Tally:
    """Counts, and the decks of what is wrong, by how much."""

    def __init__(self) -> None:
        self.counts: collections.Counter[str] = collections.Counter()
        self.wrong: list[tuple[float, str]] = []
        self.began = time.time()

    def add(self, name: str, faults: list[mo.Fault], first: Groups, second: Groups) -> None:
        for fault in faults:
            self.counts[f"wrong: {name.partition(', ')[2]}, {fault.name}"] += 1
        if faults:
            text = f"{name}: {'; '.join(map(str, faults))}"
            print(text, flush=True)
            decks = f"! {text}\n{mo.deck(first)}\n! right:\n{mo.deck(second)}"
            self.wrong.append((max(fault.over for fault in faults), decks))

    def report(self, file: Path | None) -> None:
        for name, count in sorted(self.counts.items()):
            print(f"{count:6d} {name}")
        print(f"{time.time() - self.began:.0f} s")
        if file is not None:
            file.write_text("\n".join(text for _, text in sorted(self.wrong, key=lambda row: -row[0])))


def with_settings(groups: Groups, method: str, rtol: float, cycle_map: str) -> Groups:
    return changed(groups, {"integrator": {"method": method, "rtol": rtol, "cycle_map": cycle_map}})


def summaries(number: int, seed: int, tally: Tally) -> bool:
    """Whether a scene is right."""
    family = (iv.audited, iv.rig, iv.audited, iv.rig, iv.near_fig3)[number % 5]
    scene = family(random.Random(f"summaries {seed}/{number}"))
    scene = changed(
        scene, {"integrator": {"max_steps": 1_000_000}, "output": {"interval": scene["scene"]["t_end"]}}
    )
    right_groups = with_settings(scene, "radau5", 1e-9, "off")
    right = mo.run(right_groups)
    if isinstance(right, str):
        tally.counts[f"not run: {right[:60]}"] += 1
        return True
    found = []
    for rtol in (1e-6, 1e-8):
        motion = mo.Motion(scene, rtol)
        for cycle_map in ("off", "auto"):
            groups = with_settings(scene, "radau13", rtol, cycle_map)
            result, said = mo.run(groups), mo.Judgement()
            if isinstance(result, str):
                said.add("no result", result)
            else:
                values = [
                    {k: float(x) for k, x in each.summary.items() if k not in mo.OF_LEAPS}
                    for each in (result, right)
                ]
                mo.compare_summary(
                    motion, *values, mo.summary_scales(scene, result) | mo.summary_scales(scene, right), said
                )
                tally.counts["with leaps"] += bool(result.statistics["cycles_leapt"])
            tally.counts["values"] += said.values
            tally.counts["values not judged"] += len(said.unjudged)
            tally.add(f"scene {number}, {rtol:.0e} map {cycle_map}", said.faults, groups, right_groups)
            found += said.faults
    return not found


def near_fig3(number: int, seed: int, tally: Tally) -> bool:
    """Whether a scene is right."""
    chance = random.Random(f"near Fig. 3 {seed}/{number}")
    t_end = float(f"{log_uniform(chance, 50, 5000):.4g}")
    method, rtol = chance.choice(["radau5", "radau9", "radau13"]), log_uniform(chance, 1e-8, 1e-3)
    groups = changed(
        iv.near_fig3(chance),
        {
            "scene": {"t_end": t_end},
            "system": {"misalignment_deg": chance.uniform(4, 9)},
            "integrator": {"method": method, "rtol": rtol, "max_steps": 0},
            "output": {"interval": t_end / 64, "wall_limit": 600.0},
        },
    )
    off = changed(groups, {"integrator": {"cycle_map": "off"}})
    result, said = mo.run(groups), mo.Judgement()
    if isinstance(result, str):
        said.add("no result", result)
    else:
        for fault in mo.order_faults(result):
            said.add("order", fault)
        if result.time[-1] != t_end:
            said.add("order", f"ends at {result.time[-1]}")
        if not abs(mo.value_of(result, "energy_residual")) <= mo.ENERGY * rtol:
            said.add("energy_residual", str(mo.value_of(result, "energy_residual")))
        short = changed(off, {"scene": {"t_end": min(SETTLED, t_end)}})
        means = mean_faults(short, result, rtol, tally)
        if means and t_end > SETTLED:
            # Perhaps it takes longer to settle.
            tally.counts["compared over the whole length"] += 1
            means = mean_faults(off, result, rtol, tally)
        said.faults += means
    tally.add(f"scene {number}, near Fig. 3", said.faults, groups, off)
    return not said.faults


def mean_faults(off: Groups, result: ds.Result, rtol: float, tally: Tally) -> list[mo.Fault]:
    """Means that differ from those of a run without the map."""
    right, said = mo.run(off), mo.Judgement()
    if isinstance(right, str):
        said.add("no result without the map", right)
        return said.faults
    values = [{k: float(each.summary[k]) for k in mo.MEANS if k in each.summary} for each in (result, right)]
    mo.compare_summary(
        mo.Motion(off, rtol), *values, mo.summary_scales(off, result) | mo.summary_scales(off, right), said
    )
    tally.counts["means of irregular motions"] += len(said.unjudged)
    for key in said.unjudged:
        a, b = (mo.value_of(each, key) for each in (result, right))
        errors = [
            mo.value_of(each, f"{key}_scatter") / math.sqrt(min(mo.value_of(each, "cycles") / 2, 100))
            for each in (result, right)
        ]
        if not abs(a - b) <= STANDARD_ERRORS * math.hypot(*errors):
            said.add(
                key,
                f"{a:.10g}, without the map {b:.10g}, standard errors {errors[0]:.3g} and {errors[1]:.3g}",
            )
    return said.faults


COMMANDS = {"summaries": (summaries, 1500), "near_fig3": (near_fig3, 1000)}
"""What judges a scene, and the number of scenes."""


def main() -> None:
    options = options_of(__doc__, *COMMANDS, scenes=(0, 2), first=0, seed=31, report="")
    tally = Tally()
    for what in options.words:
        judge, usual = COMMANDS[what]
        count = options.scenes or usual
        right = sum(
            judge(number, options.seed, tally) for number in range(options.first, options.first + count)
        )
        print(f"{what}: {count - right} of {count} scenes wrong")
    tally.report(Path(options.report) if options.report else None)


if __name__ == "__main__":
    main()
