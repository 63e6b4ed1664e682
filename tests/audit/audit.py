"""The package against the independent reference, on random scenes: every column at 100 samples and the end, every event.

python tests/audit/audit.py [--scenes 200] [--seed 7] [--family turning] [--methods radau9,radau13] [--rtol 1e-5,1e-6,...] [--cycle-map auto]

The error of a column at a sample is its difference from the reference in the scale of `truth.scales`. Allowed are
30 rtol (1 + C) with the conditioning C of that column at that sample (`truth.conditioning`), and 1e-13 (1 + C) of roundoff; for the time of an
event, the same in t_end. The number of sticks must be exact, but for rests so short that an error of 30 rtol in v makes them. A sample must
be in the right state unless an event is as near as an event may be off.

C costs the reference six runs more, so it is measured only where an error is above 30 rtol; elsewhere C = 0 is printed.

There is one excuse: the truth itself. Where a run fails, the reference does the scene again with its parameters changed by
30 rtol. If the number of sticks depends on that, neither it nor whether a sample sticks is judged. If a column leaves what C foretells,
C means nothing from there on, and the run is judged up to there; it then counts as excused.

The cycle map is off, unless it is asked for: what it changes is tested by itself (tests/README.md, "What must not matter").

A run that fails is printed as a deck, with what is wrong in its first lines.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import secrets
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import dynstiction as ds
import numpy as np
import truth as tr
from scenes import FAMILIES, Scene, random_scene

METHODS = ("radau5", "radau9", "radau13")
TOLERANCES = (1e-4, 1e-6, 1e-8)
EXPLICIT = ("dopri5", "dop853")
RUNS = (*itertools.product(METHODS, TOLERANCES), *itertools.product(EXPLICIT, (1e-7,)))
FACTOR = 30.0
ROUNDOFF = 1e-13
EVENT = "event"
"""What the time of an event is called beside the columns."""
MOST_STEPS, STEPS_USED_UP = 200_000, 42
"""Any method may use up its steps; the error code of that. An explicit one may end with any error, as docs/numerics.md says."""
NONLINEAR = 3.0
"""A change this many times what C foretells is not linear. Twice: hardly a scene less is excused."""


class Case:
    """A scene with its truth, and what may be asked for."""

    def __init__(self, reference: tr.Reference, name: str, scene: Scene, cycle_map: str = "off") -> None:
        self.reference, self.name, self.scene, self.cycle_map = reference, name, scene, cycle_map
        self.truth = reference.run(scene)
        self.columns, self.scales = tr.columns(scene, self.truth), tr.scales(scene, self.truth)
        self.none = dict.fromkeys([*self.columns, EVENT], 0.0)

    @functools.cached_property
    def conditioning(self) -> dict[str, np.ndarray]:
        """Of each column at each sample, and of the time of each event. Most runs are good without."""
        truth, perturbed = self.truth, self.reference.perturbed(self.scene)
        same = [other for other in perturbed if np.array_equal(other.event_kind, truth.event_kind)]
        shifts = [np.abs(other.event_time - truth.event_time) / self.scene.t_end / tr.CHANGE for other in same]
        most = np.max([*shifts, np.zeros_like(truth.event_time)], axis=0)
        return tr.conditioning(self.scene, truth, perturbed) | {EVENT: tr.widest(most) if most.size else most}


@dataclass
class Verdict:
    """One run against the truth."""

    name: str
    method: str
    rtol: float
    sticks: int = -1
    true_sticks: int = -1
    column: str = ""
    time: float = 0.0
    error: float = 0.0
    """The largest error, over rtol (1 + C), of `column` at `time`."""
    raw: float = 0.0
    """The same error in the column's scale."""
    found: float = 0.0
    right: float = 0.0
    fault: str = ""
    """What else is wrong."""
    excused: bool = False
    gave_up: bool = False
    """Excused after `MOST_STEPS`."""

    @property
    def good(self) -> bool:
        return not self.fault and self.error <= FACTOR


def deck(scene: Scene, method: str, rtol: float, cycle_map: str) -> ds.Scene:
    bound: dict[str, Any] = {} if method.startswith("radau") else {"max_steps": MOST_STEPS}
    return ds.Scene(**scene.groups(method=method, rtol=rtol, cycle_map=cycle_map, **bound))


def run(scene: Scene, method: str, rtol: float, cycle_map: str) -> ds.Result:
    return ds.run(deck(scene, method, rtol, cycle_map))


def compare(case: Case, method: str, rtol: float) -> Verdict:
    verdict = Verdict(case.name, method, rtol, true_sticks=case.truth.sticks)
    try:
        result = run(case.scene, method, rtol, case.cycle_map)
    except (ds.SolverError, ds.DeckError) as error:
        verdict.gave_up = isinstance(error, ds.SolverError) and (error.code == STEPS_USED_UP or method in EXPLICIT)
        verdict.excused, verdict.fault = verdict.gave_up, "" if verdict.gave_up else str(error)
        return verdict
    if result.time.size != case.truth.time.size or np.abs(result.time - case.truth.time).max() > 4e-16 * case.scene.t_end:
        verdict.fault = f"samples at other times ({result.time.size} for {case.truth.time.size})"
        return verdict
    verdict.sticks = result.sticks()
    look(case, verdict, result, case.none)
    try:
        if not verdict.good:
            look(case, verdict, result, case.conditioning)
        if not verdict.good:
            excuse(case, verdict, result)
    except tr.ReferenceFailed as error:
        verdict.fault = f"the reference {error} with changed parameters"
    return verdict


def excuse(case: Case, verdict: Verdict, result: ds.Result) -> None:
    """Judge again what does not depend on changes of 30 rtol in a way that C does not foretell."""
    change = FACTOR * verdict.rtol
    until, count = np.inf, True
    for sign in (1, -1):
        for other in case.reference.perturbed(case.scene, sign * change):
            count = count and other.sticks == case.truth.sticks
            for name, gap in tr.changes(case.scene, case.truth, other).items():
                beyond = gap > NONLINEAR * change * (1 + case.conditioning[name])
                if beyond.any():
                    until = min(until, float(case.truth.time[np.argmax(beyond)]))
    if until < np.inf or not count:
        verdict.excused = True
        look(case, verdict, result, case.conditioning, until, count=count and until == np.inf, states=count)


def look(
    case: Case,
    verdict: Verdict,
    result: ds.Result,
    conditioning: Mapping[str, np.ndarray | float],
    until: float = np.inf,
    count: bool = True,
    states: bool = True,
) -> None:
    """The worst error before the time `until`; whether the number of sticks is judged, and whether the samples' states are."""
    truth, rtol, scene = case.truth, verdict.rtol, case.scene
    verdict.column, verdict.error, verdict.fault = "", 0.0, ""

    def worst(
        name: str, time: np.ndarray, raw: np.ndarray, condition: np.ndarray | float, found: np.ndarray, right: np.ndarray
    ) -> None:
        over = np.where(time < until, np.maximum(0.0, raw / (1 + condition) - ROUNDOFF) / rtol, 0.0)
        k = int(np.argmax(over)) if over.size else 0
        if over.size and (over[k] > verdict.error or not verdict.column):
            verdict.column, verdict.time, verdict.error = name, float(time[k]), float(over[k])
            verdict.raw, verdict.found, verdict.right = float(raw[k]), float(found[k]), float(right[k])

    for name in (name for name in result.columns if name in case.columns and name != "sticking"):
        with np.errstate(invalid="ignore"):
            raw = np.nan_to_num(tr.differences(name, result[name], case.columns[name]) / case.scales[name], nan=0.0)
        if name in tr.JUMPING:
            raw = np.where(result["sticking"] == truth.sticking, raw, 0.0)
        worst(name, truth.time, raw, conditioning[name], result[name], case.columns[name])
    kind, time = result.events["kind"], result.events["time"]
    # Where v = v_max (omega t)^2/2 just reaches zero, an error of 30 rtol v_max is a rest of this many radians.
    short = 2 * np.sqrt(2 * FACTOR * rtol)
    found, right = (tr.long_rests(scene, *events, short) for events in ((kind, time), (truth.event_kind, truth.event_time)))
    if count and verdict.sticks != verdict.true_sticks and found != right:
        verdict.fault = f"{verdict.sticks} sticks, right are {verdict.true_sticks}"
    # The reference writes no beginning of slip at t = 0.
    begun = int(kind.size > 0 and kind[0] == 2 and time[0] == 0.0)
    if np.array_equal(kind[begun:], truth.event_kind):
        raw = np.abs(time[begun:] - truth.event_time) / scene.t_end
        worst(EVENT, truth.event_time, raw, conditioning[EVENT], time[begun:], truth.event_time)
    if not states:
        return
    near = (FACTOR * rtol * (1 + np.max(conditioning[EVENT], initial=0.0)) + ROUNDOFF) * scene.t_end
    events = np.concatenate([truth.event_time, truth.touches, time])
    for t in truth.time[(result["sticking"] != truth.sticking) & (truth.time < until)]:
        if np.abs(events - t).min(initial=np.inf) > near:
            verdict.fault = verdict.fault or f"sticking is wrong at t = {t:.9g} s"


def shown(case: Case, verdict: Verdict) -> str:
    """A run as a deck, with what is wrong in its first lines."""
    wrong = [
        f"{verdict.name}: {verdict.method} at rtol = {verdict.rtol:g}",
        f"{verdict.column} at t = {verdict.time:.12g} s is {verdict.found:.12g}, right is {verdict.right:.17g}"
        + f": {verdict.error:.3g} rtol (1 + C), {verdict.raw:.2g} of its scale",
    ]
    if verdict.fault:
        wrong.append(verdict.fault)
    return "".join(f"! {text}\n" for text in wrong) + deck(case.scene, verdict.method, verdict.rtol, case.cycle_map).text


@dataclass
class Outcome:
    """What became of many scenes."""

    verdicts: list[Verdict]
    failures: list[str]
    """Decks of the runs that failed, and scenes that the reference could not do."""

    def table(self) -> str:
        text = [
            "| method | rtol | runs | within 30 rtol (1 + C) | excused | gave up | wrong | median error/rtol | 95 % | largest |",
            "| " + "--- | " * 10,
        ]
        for method, rtol in dict.fromkeys((v.method, v.rtol) for v in self.verdicts):
            rows = [v for v in self.verdicts if (v.method, v.rtol) == (method, rtol)]
            median, most, largest = np.quantile([v.error for v in rows], [0.5, 0.95, 1])
            counts = [
                len(rows),
                sum(v.good and not v.excused for v in rows),
                sum(v.excused and v.good and not v.gave_up for v in rows),
            ]
            counts += [sum(v.gave_up for v in rows), sum(not v.good for v in rows)]
            numbers = " | ".join(map(str, counts))
            text.append(f"| {method} | {rtol:.0e} | {numbers} | {median:.2g} | {most:.2g} | {largest:.3g} |")
        return "\n".join(text)


def audit(
    reference: tr.Reference, scenes: dict[str, Scene], runs: Iterable[tuple[str, float]] = RUNS, cycle_map: str = "off"
) -> Outcome:
    """Judge all runs of all scenes."""
    outcome = Outcome([], [])
    for name, scene in scenes.items():
        try:
            case = Case(reference, name, scene, cycle_map)
        except tr.ReferenceFailed as error:
            outcome.failures.append(f"! {name}: the reference {error}\n{ds.Scene(**scene.groups()).text}")
            print(outcome.failures[-1], flush=True)
            continue
        for method, rtol in runs:
            verdict = compare(case, method, rtol)
            outcome.verdicts.append(verdict)
            if not verdict.good:
                outcome.failures.append(shown(case, verdict))
                print(outcome.failures[-1], flush=True)
    return outcome


def random_scenes(family: str, seed: int, numbers: range) -> dict[str, Scene]:
    return {f"scene {k} of the family '{family}', seed {seed}": random_scene(seed, k, family=family) for k in numbers}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=None, help="drawn and printed if it is not given")
    parser.add_argument("--family", choices=FAMILIES, default="any")
    parser.add_argument("--methods", type=lambda s: tuple(s.split(",")), default=METHODS)
    parser.add_argument("--rtol", type=lambda s: tuple(map(float, s.split(","))), default=TOLERANCES)
    parser.add_argument("--cycle-map", choices=("off", "auto"), default="off")
    arguments = parser.parse_args()
    seed = secrets.randbits(32) if arguments.seed is None else arguments.seed
    print(f"seed {seed}", flush=True)
    numbers = range(arguments.first, arguments.first + arguments.scenes)
    runs = tuple(itertools.product(arguments.methods, arguments.rtol))
    outcome = audit(tr.Reference(), random_scenes(arguments.family, seed, numbers), runs, arguments.cycle_map)
    print(outcome.table())
    sys.exit(1 if outcome.failures else 0)


if __name__ == "__main__":
    main()
