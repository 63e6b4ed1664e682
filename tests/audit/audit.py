"""The package against the independent reference, on random scenes: every column at 100 samples and the end.

python tests/audit/audit.py [--scenes 200] [--seed 12] [--methods radau9,radau13] [--rtol 1e-5,1e-6,...] [--report FILE]

The error of a column at a sample is its difference from the reference in the scale of `truth.scales`. Allowed are
30 rtol (1 + C) with the conditioning C of that column at that sample (`truth.conditioning`), and 1e-13 (1 + C) of roundoff. A sample within
the same share of t_end of an event may be in either state; there only the columns that do not jump are compared. The number of sticks must
be exact, but for the scenes in which the true number changes when a parameter changes by 30 rtol, and above rtol = 1e-7 where v grazes zero (`grazes`). If the
events depart from the true ones where v grazes zero, the columns are judged up to there.
"""

from __future__ import annotations

import argparse
import collections
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import dynstiction as ds
import numpy as np
import truth as tr
from scenes import Scene, random_scenes

SEED = 12
METHODS = ("radau9", "radau13")
TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
FACTOR = 30.0
ROUNDOFF = 1e-13
GRAZING_UNTIL = 1.0001e-7


@dataclass
class Judged:
    """A scene with its truth and what may be asked for."""

    number: int
    scene: Scene
    truth: tr.Truth
    columns: dict[str, np.ndarray]
    scales: dict[str, np.ndarray]
    conditioning: dict[str, np.ndarray]
    event_conditioning: float

    @property
    def worst_conditioning(self) -> float:
        return max(float(c.max()) for c in self.conditioning.values())


@dataclass
class Verdict:
    """One run against the truth."""

    number: int
    method: str
    rtol: float
    column: str = ""
    sample: float = 0.0
    error: float = 0.0
    """Largest error of a column, over rtol (1 + C)."""
    raw: float = 0.0
    """The same without the conditioning."""
    found: float = 0.0
    true: float = 0.0
    sticks: int = 0
    true_sticks: int = 0
    excuse: str = ""
    """Why another number of sticks may be right."""
    event_error: float | None = None
    """Largest error of an event time, over rtol (1 + C) t_end; None if the events differ."""
    failure: str = ""
    wrong: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def sticks_right(self) -> bool:
        return not self.failure and self.sticks == self.true_sticks

    @property
    def good(self) -> bool:
        return not self.failure and self.error <= FACTOR and (self.sticks_right or self.excused)

    @property
    def excused(self) -> bool:
        """From rtol = 1e-7 on grazing is no excuse for another number: every method is to find the same sticks."""
        return self.excuse == "varies" or (self.excuse == "grazing" and self.rtol > GRAZING_UNTIL)


def judge(reference: tr.Reference, number: int, scene: Scene) -> Judged:
    truth = reference.run(scene)
    perturbed = reference.perturbed(scene)
    same = [other for other in perturbed if np.array_equal(other.event_kind, truth.event_kind)]
    shift = [np.abs(o.event_time - truth.event_time).max(initial=0.0) / scene.t_end / tr.CHANGE for o in same]
    return Judged(
        number,
        scene,
        truth,
        tr.columns(scene, truth),
        tr.scales(scene, truth),
        tr.conditioning(scene, truth, perturbed),
        max(shift, default=0.0),
    )


def varies(reference: tr.Reference, case: Judged, rtol: float) -> bool:
    """Whether the true number of sticks changes when a parameter changes by 30 rtol."""
    for change in (FACTOR * rtol, -FACTOR * rtol):
        try:
            if any(other.sticks != case.truth.sticks for other in reference.perturbed(case.scene, change)):
                return True
        except tr.ReferenceFailed:
            return True
    return False


def fast_cycle(scene: Scene) -> float:
    """Period of the oscillation on the stiffer spring [s]."""
    return float(2 * np.pi * np.sqrt(scene.mass / max(scene.stiffness_x, scene.stiffness_y)))


def events_of(result: ds.Result) -> tuple[np.ndarray, np.ndarray]:
    """Kinds and times, without the slip that begins at t = 0 beyond the static limit: the reference writes none."""
    kind, time = result.events["kind"], result.events["time"]
    begun = int(kind.size > 0 and kind[0] == 2 and time[0] == 0.0)
    return kind[begun:], time[begun:]


def departure(case: Judged, result: ds.Result, near: float) -> float:
    """When the events first differ from the true ones by more than `near` [s]; infinite if they never do."""
    kind, time = events_of(result)
    for i in range(max(kind.size, case.truth.event_kind.size)):
        if i >= kind.size:
            return float(case.truth.event_time[i])
        if i >= case.truth.event_kind.size:
            return float(time[i])
        if kind[i] != case.truth.event_kind[i] or abs(time[i] - case.truth.event_time[i]) > near:
            return float(min(time[i], case.truth.event_time[i]))
    return np.inf


def grazes(case: Judged, rtol: float, time: float) -> bool:
    """Whether, within a fast cycle of `time`, v passes a minimum below 30 rtol of the largest speed since the release, or rests so shortly that
    it would have been negative by at most this value.
    """
    cycle, truth = fast_cycle(case.scene), case.truth
    at, speed, peak = truth.dips.T
    if ((np.abs(at - time) <= cycle) & (speed <= FACTOR * rtol * peak)).any():
        return True
    begun = np.flatnonzero(truth.event_kind[:-1] == 1)
    lasted = np.diff(truth.event_time)[begun]
    close = np.abs(truth.event_time[begun] - time) <= cycle
    return bool((close & ((lasted / cycle) ** 2 <= FACTOR * rtol)).any())


def compare(reference: tr.Reference, case: Judged, method: str, rtol: float) -> Verdict:
    scene, truth = case.scene, case.truth
    verdict = Verdict(case.number, method, rtol, true_sticks=truth.sticks)
    began = time.perf_counter()
    try:
        result = ds.run(ds.Scene(**scene.groups(method=method, rtol=rtol)))
    except (ds.SolverError, ds.DeckError) as error:
        verdict.failure = str(error)
        return verdict
    verdict.seconds = time.perf_counter() - began
    verdict.sticks = result.sticks()
    if result.time.size != truth.time.size or np.abs(result.time - truth.time).max() > 4e-16 * scene.t_end:
        verdict.failure = f"samples at other times ({result.time.size} for {truth.time.size})"
        return verdict
    event_kind, event_time = events_of(result)
    if np.array_equal(event_kind, truth.event_kind):
        gap = np.abs(event_time - truth.event_time).max(initial=0.0)
        verdict.event_error = gap / (scene.t_end * rtol * (1 + case.event_conditioning))
    near = (FACTOR * rtol * (1 + case.event_conditioning) + 1e-13) * scene.t_end
    parted = departure(case, result, near)
    grazing = bool(np.isfinite(parted)) and grazes(case, rtol, parted)
    if not verdict.sticks_right:
        verdict.excuse = "varies" if varies(reference, case, rtol) else "grazing" if grazing else ""
    whole = np.ones_like(truth.time, dtype=bool)
    judge_columns(case, verdict, result, whole)
    if verdict.error > FACTOR and grazing:
        # This tolerance does not decide whether it stopped there, and the later motion depends on that.
        verdict.excuse = verdict.excuse or "grazing"
        verdict.wrong, verdict.column, verdict.error = {}, "", 0.0
        judge_columns(case, verdict, result, truth.time < parted - fast_cycle(scene))
    other = result["sticking"] != truth.sticking
    if other.any() and not verdict.excuse:
        distance = np.array([np.abs(truth.event_time - t).min(initial=np.inf) for t in truth.time[other]])
        if (distance > near).any():
            verdict.wrong["sticking"] = float(np.count_nonzero(other))
            if verdict.error <= FACTOR:
                verdict.column, verdict.error = "sticking", np.inf
                verdict.sample = float(truth.time[other][np.argmax(distance)])
    return verdict


def judge_columns(case: Judged, verdict: Verdict, result: ds.Result, rows: np.ndarray) -> None:
    """The worst of the columns at the samples `rows`."""
    rtol, truth = verdict.rtol, case.truth
    for name in (name for name in result.columns if name not in {"time", "sticking"}):
        gap = tr.differences(name, result[name], case.columns[name])
        with np.errstate(invalid="ignore"):
            raw = np.nan_to_num(gap / case.scales[name], nan=0.0)
        if name in tr.JUMPING:
            raw = np.where(result["sticking"] == truth.sticking, raw, 0.0)
        over = np.where(rows, np.maximum(0.0, raw / (1 + case.conditioning[name]) - ROUNDOFF) / rtol, 0.0)
        k = int(np.argmax(over))
        if over[k] > FACTOR:
            verdict.wrong[name] = float(over[k])
        if over[k] > verdict.error or not verdict.column:
            verdict.column, verdict.sample, verdict.error = name, float(truth.time[k]), float(over[k])
            verdict.raw = float(raw[k]) / rtol
            verdict.found, verdict.true = float(result[name][k]), float(case.columns[name][k])


def describe(case: Judged) -> str:
    scene, notes = case.scene, case.truth.notes
    return (
        f"{'+'.join(scene.kinds) or 'plain'}: {case.truth.sticks} sticks, conditioning {case.worst_conditioning:.1g}, "
        f"smallest dip {notes['smallest_dip']:.1g}, smallest gap {case.truth.gap.min(initial=np.inf):.1g}, "
        f"shortest rest {notes['shortest_rest'] / scene.t_end:.1g} t_end"
    )


def report(cases: dict[int, Judged], verdicts: list[Verdict], count: int) -> str:
    """The worst runs with all that is needed to repeat them."""
    wrong = sorted((v for v in verdicts if not v.good), key=lambda v: (not v.failure, -v.error))
    by_scene: dict[int, list[Verdict]] = {}
    for v in wrong:
        by_scene.setdefault(v.number, []).append(v)
    text = []
    for number, rows in list(by_scene.items())[:count]:
        case = cases[number]
        text.append(f"## scene {number}, {describe(case)}")
        worst = rows[0]
        text.append(f"ds.run(ds.Scene(**{case.scene.groups(method=worst.method, rtol=worst.rtol)!r}))")
        for v in sorted(rows, key=lambda v: (v.method, -v.rtol)):
            text.append("  " + line(v))
        text.append("")
    return "\n".join(text)


def line(v: Verdict) -> str:
    if v.failure:
        return f"{v.number:4d} {v.method:8s} {v.rtol:.0e} FAILED {v.failure}"
    events = "events differ" if v.event_error is None else f"events {v.event_error:.2g}"
    also = f"; too large: {', '.join(f'{k} {x:.2g}' for k, x in v.wrong.items())}" if v.wrong else ""
    sticks = f"sticks {v.sticks}" + (f" for {v.true_sticks}" if v.sticks != v.true_sticks else "")
    return (
        f"{v.number:4d} {v.method:8s} {v.rtol:.0e} {v.column:14s} t={v.sample:.9g} error/rtol {v.error:9.3g} (raw {v.raw:9.3g}) "
        f"found {v.found:.12g} true {v.true:.17g} {sticks}{' (' + v.excuse + ')' if v.excuse else ''} {events}{also}"
    )


def audit(
    scenes: dict[int, Scene], methods: tuple[str, ...], tolerances: tuple[float, ...], reference: tr.Reference, say: bool = True
) -> tuple[dict[int, Judged], list[Verdict], list[str]]:
    """Judge all runs; also the scenes that the reference could not do."""
    cases, verdicts, skipped = {}, [], []
    for number, scene in scenes.items():
        try:
            cases[number] = judge(reference, number, scene)
        except tr.ReferenceFailed as error:
            skipped.append(f"{number}: {error}: {scene!r}")
            continue
        for method in methods:
            for rtol in tolerances:
                verdicts.append(compare(reference, cases[number], method, rtol))
                if say and not verdicts[-1].good:
                    print(line(verdicts[-1]), flush=True)
    return cases, verdicts, skipped


def summary(cases: dict[int, Judged], verdicts: list[Verdict]) -> str:
    keys = sorted({(v.method, v.rtol) for v in verdicts}, key=lambda key: (key[0], -key[1]))
    text = [
        "| method | rtol | runs | within 30 rtol | sticks exact | else grazing | else varying | event times within 30 rtol | failed | median error/rtol | largest |",
        "| " + "--- | " * 11,
    ]
    for method, rtol in keys:
        rows = [v for v in verdicts if (v.method, v.rtol) == (method, rtol)]
        done = [v for v in rows if not v.failure]
        miscounted = collections.Counter(v.excuse for v in done if not v.sticks_right)
        timely = sum(v.event_error is not None and v.event_error <= FACTOR for v in done)
        counts = [
            len(rows),
            sum(v.error <= FACTOR for v in done),
            sum(v.sticks_right for v in done),
            miscounted["grazing"],
            miscounted["varies"],
            timely,
            len(rows) - len(done),
        ]
        errors = [v.error for v in done]
        text.append(f"| {method} | {rtol:.0e} | {' | '.join(map(str, counts))} | {np.median(errors):.2g} | {max(errors):.3g} |")
    good = sum(all(v.good for v in verdicts if v.number == number) for number in cases)
    text.append(f"{good} of {len(cases)} scenes within {FACTOR:g} rtol")
    return "\n".join(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=lambda s: [int(x) for x in s.split(",")], help="numbers of scenes")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--rtol", default=",".join(map(str, TOLERANCES)))
    parser.add_argument("--constant-drive", action="store_true", help="no profiles")
    parser.add_argument("--report", type=Path, help="file for the worst scenes, ready to repeat")
    parser.add_argument("--worst", type=int, default=30)
    parser.add_argument("--prepare", action="store_true", help="the reference alone")
    arguments = parser.parse_args()
    every = dict(enumerate(random_scenes(arguments.seed, arguments.first + arguments.scenes, not arguments.constant_drive)))
    chosen = arguments.only or range(arguments.first, arguments.first + arguments.scenes)
    scenes = {number: every[number] for number in chosen}
    reference = tr.Reference()
    if arguments.prepare:
        for number, scene in scenes.items():
            began = time.perf_counter()
            try:
                print(number, describe(judge(reference, number, scene)), f"{time.perf_counter() - began:.1f} s", flush=True)
            except tr.ReferenceFailed as error:
                print(number, error, scene, flush=True)
        return
    tolerances = tuple(float(x) for x in arguments.rtol.split(","))
    cases, verdicts, skipped = audit(scenes, tuple(arguments.methods.split(",")), tolerances, reference)
    text = summary(cases, verdicts)
    if arguments.report:
        arguments.report.write_text(text + "\n\n" + report(cases, verdicts, arguments.worst))
    for each in skipped:
        print(f"no reference for scene {each}")
    print(text)
    sys.exit(0 if all(v.good for v in verdicts) and not skipped else 1)


if __name__ == "__main__":
    main()
