"""One answer: how often does the program say of a motion what is not so?

    python bench/one_answer.py turns [--scenes 1000] [--first 0] [--seed 7] [--report FILE] [--short]

`turns`: scenes of the family `turning` of tests/audit (strong weakening and a static limit above the kinetic one: many a slip nearly stops,
turns and goes on) by radau13 at the default tolerance and at 1e-6, with the cycle map. It prints how many are wrong by more than 30 rtol (1 + C) and how many
by more than 1 % of the static limit in the spring force at 100 samples; the latter may be a scene that magnifies everything, so it also
prints how many of them are wrong by the first measure. FILE gets the decks of all that are wrong.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import dynstiction as ds
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "audit"))

import audit
import truth

TOLERANCES = (1e-8, 1e-6)
LARGE = 0.01
"""Of the static limit."""


def load_error(case: audit.Case, rtol: float) -> float:
    """Largest error of the spring force at the samples, over F_s."""
    result = audit.run(case.scene, "radau13", rtol, case.cycle_map)
    gaps = [result[name] - case.columns[name] for name in ("spring_force_x", "spring_force_y")]
    return float(np.hypot(*gaps).max()) / case.scene.static_limit


def turns(scenes: dict[str, audit.Scene], report: Path | None) -> None:
    reference = truth.Reference()
    decks: list[str] = []
    verdicts: list[tuple[audit.Verdict, float]] = []
    done = 0
    for name, scene in scenes.items():
        try:
            case = audit.Case(reference, name, scene, cycle_map="auto")
        except truth.ReferenceFailed as error:
            decks.append(f"! {name}: the reference {error}\n{ds.Scene(**scene.groups()).text}")
            continue
        done += 1
        for rtol in TOLERANCES:
            verdict = audit.compare(case, "radau13", rtol)
            verdicts.append((verdict, np.inf if verdict.sticks < 0 else load_error(case, rtol)))
            if not verdict.good:
                decks.append(f"! load wrong by {verdicts[-1][1]:.2g} F_s\n{audit.shown(case, verdict)}")
                if report:
                    report.write_text("\n".join(decks))
    print(f"{done} scenes, {len(scenes) - done} without a reference")
    print(
        "| rtol | wrong by more than 30 rtol (1 + C) | excused | load wrong by more than 1 % of F_s | of these, by both |"
    )
    print("| --- | --- | --- | --- | --- |")
    for rtol in TOLERANCES:
        rows = [(v, load) for v, load in verdicts if v.rtol == rtol]
        wrong, excused = sum(not v.good for v, _ in rows), sum(v.excused for v, _ in rows)
        large = [v for v, load in rows if load > LARGE]
        print(f"| {rtol:.0e} | {wrong} | {excused} | {len(large)} | {sum(not v.good for v in large)} |")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["turns"], nargs="?", default="turns")
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--report", type=Path)
    parser.add_argument("--short", action="store_true", help="a few scenes")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", ds.SamplingWarning)
    numbers = range(arguments.first, arguments.first + (3 if arguments.short else arguments.scenes))
    turns(audit.random_scenes("turning", arguments.seed, numbers), arguments.report)


if __name__ == "__main__":
    main()
