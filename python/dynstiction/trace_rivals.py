"""What explains a trace: creep, static friction, ageing, or another change of the rig; each is fitted, and its evidence compared
(docs/fit.md).
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._arguments import generator, names_in
from ._fit.models import NoCycleError
from ._fit.problem import Problem
from ._fit.search import ANGLE, COARSE_OF_OWN, MISFIT, USUAL, Search, glances
from ._fit.shooting import COARSELY, FINELY, delayed, shot
from ._fit.solve import Solution, has_failed, spread
from ._progress import progress_bar
from .errors import Error, UsageError
from .scene import DeckLike, Scene
from .trace import Chain, Trace
from .trace_fit import BAR, Fit, problem_of

_Floats = NDArray[np.float64]

ALL = (ANGLE, "friction.mu_0", "friction.mu_inf", "friction.v_f", "system.mass", "system.stiffness_x")
"""What is free in a test by default."""
SURE = 0.95
"""Probability above which an explanation is named."""
POWER = 1.2816
"""Standard deviations by which an effect that is seen in nine of ten traces exceeds the one that is just seen."""
ANGLES = tuple(0.05 * 1.5**i for i in range(15))
"""Misalignments for which it is asked whether the trace would show them [deg]."""
SHARES = (0.99, 0.7, 0.4)
"""Starts for friction with a higher limit at rest: share of the weakening from mu_inf to that limit which mu_0 has."""
STARTS = 2
"""Starts of the slow model that are completed for creep if nothing else explains the trace; otherwise one is."""
AGE = 1e-3
"""Time at rest from which on friction grows, over the period, if the deck has none."""
ROUGH = 0.01
"""Error with which starts are tried, relative to swing and period."""
TRIED = 2
"""Starts that are completed for an explanation."""
BEGIN, SIZES = 0.05, (0.95, 1.0, 1.1, 1.25)
"""Start of a key that the deck does not have, relative to what it competes with; multiples of it of which the best is the start."""


class Explanation(NamedTuple):
    """One explanation of a trace, fitted to it."""

    name: str
    """What is added to the rig, or left out."""
    probability: float
    """Its probability if one of the compared explanations is right, and each as likely before."""
    misfit: float
    """Mean square of the residuals over that expected from the scatter of the cycles."""
    chance: float
    """Probability of such a misfit if it is right."""
    values: Mapping[str, float]
    """Fitted values of its parameters, by ``group.key``."""

    def __str__(self) -> str:
        values = ", ".join(f"{name} = {value:.4g}" for name, value in self.values.items())
        return f"{self.name}: probability {self.probability:.2g}, misfit {self.misfit:.3g} (by chance {self.chance:.1g}), {values}"


@dataclass(frozen=True, repr=False)
class CreepTest:
    """Why an object sticks before it slips.

    Attributes
    ----------
    explanations : tuple of Explanation
        The most probable one first: 'creep' (friction that turns, with a misalignment), 'static' (a constant limit at rest), 'ageing'
        (one that grows with the time at rest); of traces at one speed 'creep' and 'static or ageing'.
    cycles : int
        Cycles of all traces.
    least_angle : float
        Smallest misalignment [deg] that nine of ten such traces would show; NaN if none would, or nothing without creep is near.
    """

    explanations: tuple[Explanation, ...]
    cycles: int
    least_angle: float

    def probability(self, name: str) -> float:
        """Probability of an explanation.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        float
            0 if it has no stick-slip near.
        """
        return sum(each.probability for each in self.explanations if each.name == name)

    @property
    def explains(self) -> bool:
        """Whether any of them explains the trace."""
        return max(each.chance for each in self.explanations) >= MISFIT

    @property
    def named(self) -> str | None:
        """The explanation that the trace shows, with a probability of at least 95 %, if it explains it."""
        best = self.explanations[0]
        return best.name if best.probability >= SURE and best.chance >= MISFIT else None

    @property
    def creeps(self) -> bool:
        """Whether the object creeps before it slips."""
        return self.named == "creep"

    def __str__(self) -> str:
        words = {
            None: "this trace does not tell",
            "creep": "the object creeps before it slips: dynamic stiction",
            "static": "the object rests up to a static limit, without creep",
            "ageing": "the object rests up to a limit that grows with the time at rest, without creep",
            "static or ageing": "static friction, without creep; whether it ages only traces at other speeds show",
        }
        verdict = words[self.named]
        if not self.explains:
            verdict = "none of the explanations explains the trace"
        elif not self.named and self.probability("static") + self.probability("ageing") >= SURE:
            verdict = "static friction, without creep; these traces do not tell whether it ages"
        angle = (
            "no misalignment"
            if math.isnan(self.least_angle)
            else f"a misalignment from {self.least_angle:.2g}° on"
        )
        first = f"{verdict} ({self.cycles} cycles; in nine of ten such traces {angle} would be seen)"
        return "\n".join([first, *map(str, self.explanations)])

    def __repr__(self) -> str:
        return f"<CreepTest: {self}>"


@dataclass(frozen=True)
class _Fitted:
    """A hypothesis at its best values."""

    name: str
    problem: Problem
    solution: Solution

    @cached_property
    def cost(self) -> float:
        if self.solution.left is not None:
            return self.solution.cost
        return float(np.sum(self.problem.residuals(self.solution.z, 0.0) ** 2))

    def misfit(self) -> tuple[float, float]:
        """Misfit and its probability; of values at which there is no run nothing is explained."""
        try:
            return self.problem.misfit(self.solution.z, self.solution.left)
        except Error:
            return math.inf, 0.0

    def weighted_as(self, other: Problem) -> _Fitted:
        """The same with the errors of another problem of these traces."""
        weighted = [
            replace(one, waveform=two.waveform)
            for one, two in zip(self.problem.recordings, other.recordings, strict=True)
        ]
        again = self.solution if other.repeats else replace(self.solution, left=None)
        return _Fitted(self.name, replace(self.problem, recordings=tuple(weighted)), again)


def _compared(fits: Sequence[_Fitted]) -> tuple[Explanation, ...]:
    """Explanations by their evidence: the integral of the likelihood over the parameters, by Schwarz's approximation. Of several fits
    of one explanation it is that with the most.
    """
    told = [each.misfit() for each in fits]
    scale = max(1.0, min(misfit for misfit, _ in told))
    share = math.log(_measured(fits[0].problem))
    evidence = [-0.5 * (each.cost / scale + len(each.problem.names) * share) for each in fits]
    best: dict[str, int] = {}
    for i in np.argsort(-np.array(evidence), kind="stable"):
        best.setdefault(fits[i].name, int(i))
    shares = np.exp([evidence[i] - max(evidence) for i in best.values()])
    return tuple(
        Explanation(fits[i].name, float(share), *told[i], fits[i].problem.named(fits[i].solution.z))
        for i, share in zip(best.values(), shares / shares.sum(), strict=True)
    )


def _measured(problem: Problem) -> int:
    """Number of values that were measured: of each bin of each cycle, and the periods."""
    waves = [each.waveform for each in problem.recordings]
    return sum(len(each.rows) * (int(np.count_nonzero(each.used)) + 1) for each in waves)


def _best(problem: Problem, starts: Sequence[Mapping[str, float]]) -> Solution | None:
    """The best fit from the best of some starts, which name values of parameters; None if no start has stick-slip."""
    places = problem.cheapest([problem.place(values) for values in starts], COARSE_OF_OWN[0])
    found: list[Solution] = []
    for place in places[:TRIED]:
        with suppress(NoCycleError):
            found.append(shot(problem, place, (*COARSELY, *FINELY)))
            if problem.misfit(found[-1].z, found[-1].left)[1] >= USUAL:
                break
    best = min(found, key=lambda each: each.cost, default=None)
    return best and replace(best, z=delayed(problem, best.z))


def _resting_starts(problem: Problem) -> Iterator[dict[str, float]]:
    """Starts for friction that holds an object at rest: up to the peak of the load, with a lower friction in slip."""
    record = problem.recordings[0]
    age = record.scene.friction.ageing_time or 1.0
    begin = dict(zip(problem.names, map(float, np.abs(problem.begin)), strict=True))
    for values in [begin, *list(glances(record))[:4]]:
        limit = values.get("friction.mu_0", begin.get("friction.mu_0", 0.0))
        low = values.get("friction.mu_inf", 0.5 * limit)
        for share in SHARES:
            top = low + share * (limit - low)
            grown = (limit - top) / math.log1p(record.waveform.period / age)
            yield {**values, "friction.mu_0": top, "friction.mu_static": limit, "friction.ageing": grown}


def creep_test(
    scene: DeckLike,
    trace: Trace | Sequence[Trace],
    free: Sequence[str] | str = ALL,
    *,
    each: Mapping[str, Sequence[float]] | None = None,
    known: Mapping[str, tuple[float, float]] | None = None,
    chain: Chain | None = None,
    rng: int | np.random.Generator | None = 0,
    progress: bool | None = None,
) -> CreepTest:
    """Whether an object creeps before it slips, because friction turns, or rests up to a static limit, which may age.

    Models are fitted to the trace, each with all free parameters, and compared by their evidence: with the misalignment; without
    it, with and without a static limit above mu_0, ``friction.mu_static``; and, of traces at several speeds, with one that grows with
    the time at rest, ``friction.ageing``.

    Parameters
    ----------
    scene : str, PathLike or Scene
        The rig, of model 'full': its known parameters, and initial values of the free ones.
    trace, free, each, known, chain, rng, progress
        As for `fit`; ``system.misalignment_deg`` is always free. Whether a limit ages only traces at several speeds show.

    Returns
    -------
    CreepTest
        The explanations with their probabilities, and the smallest misalignment that such a trace would show.

    Raises
    ------
    UsageError, FileError, DeckError
        As for `fit`.
    """
    rig = Scene(scene)
    if (rig.scene.model or "full") != "full":
        raise UsageError("creep_test: rest is part of the model 'full': give a deck with it")
    names = tuple(name for name in names_in("free", free) if name != ANGLE)
    rig = rig.replace(
        friction={"mu_static": None, "ageing": None},
        system={"misalignment_deg": rig.system.misalignment_deg or 1.0},
    )
    with progress_bar(progress, 1.0, BAR) as show:
        turned = float(rig.system.misalignment_deg or 1.0)
        limits = {ANGLE: tuple(sorted(math.copysign(end, turned) for end in (ANGLES[0], ANGLES[-1])))}
        creep = problem_of(rig, trace, (ANGLE, *names), each=each, known=known, bounds=limits, chain=chain)
        period = min(record.waveform.period for record in creep.recordings)
        resting = []
        for i, (name, rest) in enumerate(_without_creep(rig, period, len(creep.recordings))):
            show(0.1 * i)
            problem = creep.changed((*names, *rest), {ANGLE: 0.0, **rest})
            problem.recordings[0].scene.check()
            found = _best(problem, list(_resting_starts(problem)))
            if found is not None:
                resting.append(_Fitted(name, problem, found))
        show(0.3)
        explained = any(one.misfit()[1] >= MISFIT for one in resting)
        fits = _by_creep(creep, rng, explained)
        if fits:
            # The errors of cycles that are not alike are known from their fit.
            resting = [one.weighted_as(fits[0].problem) for one in resting]
        near = min(resting, key=lambda one: one.cost) if resting else None
        fits += resting
        if not fits:
            raise UsageError(
                f"{rig.name}: no stick-slip near any start: begin with values with which a run has some"
            )
        show(0.9)
        least = _least_angle(near) if near is not None else math.nan
        show(1.0)
        return CreepTest(
            _compared(fits), sum(len(record.waveform.rows) for record in creep.recordings), least
        )


def _without_creep(rig: Scene, period: float, traces: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Name of each explanation without a misalignment, and values of its parameters."""
    mu_0 = float(rig.friction.mu_0 or 0.2)
    # Friction that falls fast enough with speed is a static limit, too.
    name = "static" if traces > 1 else "static or ageing"
    yield name, {}
    yield name, {"friction.mu_static": (1.0 + BEGIN) * mu_0}
    # At one speed a rest is as long as the next, and shows one limit.
    if traces > 1:
        age = rig.friction.ageing_time or AGE * period
        yield "ageing", {"friction.ageing": BEGIN * mu_0, "friction.ageing_time": age}


def _by_creep(problem: Problem, rng: int | np.random.Generator | None, explained: bool) -> list[_Fitted]:
    """The explanation by creep, none where the full model has no stick-slip near; not sought far away if another explains the traces."""
    search = Search(problem, 1 if explained else STARTS, generator(rng))
    with suppress(Error):
        if explained and problem.repeats:
            search.glance()
        else:
            search.run()
    return [_Fitted("creep", search.problem, search.best)] if search.found else []


def _least_angle(near: _Fitted) -> float:
    """Smallest angle [deg] whose effect, after all free parameters have made up for it, would be evidence of creep."""
    problem, solution = near.problem, near.solution
    here = problem.residuals(solution.z, 0.0)
    basis, _ = np.linalg.qr(problem.at(solution.z).jacobian)
    need = math.sqrt(2.0 * math.log(SURE / (1.0 - SURE)) + math.log(_measured(problem))) + POWER

    def is_seen(angle: float) -> bool:
        there = problem.changed(problem.names, {ANGLE: angle}).residuals(solution.z, 0.0)
        if has_failed(there):
            return False
        change = there - here
        change -= basis @ (basis.T @ change)
        return bool(math.sqrt(change @ change) > need)

    # A larger angle has a larger effect.
    least = bisect_left(ANGLES, True, key=is_seen)
    return ANGLES[least] if least < len(ANGLES) else math.nan


def explanations(found: Fit) -> tuple[Explanation, ...]:
    """What would explain the traces of a fit that does not explain them: the same with one more free parameter, each fitted.

    Parameters
    ----------
    found : Fit
        The fit.

    Returns
    -------
    tuple of Explanation
        The most probable one first; 'as fitted' is the fit itself, once more. None if the fit is not one of the scene's own model.
    """
    if not found.is_of_own_model:
        return ()
    base = found.problem
    q, delays = np.split(found.coordinates, [len(base.names)])
    tried = [("as fitted", base, found.coordinates)]
    for name, extra, begin, more in _changes(found):
        problem = base.changed((*base.names, extra), {extra: begin, **more})
        sizes = (1.0,) if name.startswith("another ") else SIZES
        starts = [np.append(problem.coordinates(np.append(base.values(q), s * begin)), delays) for s in sizes]
        tried.append((name, problem, problem.cheapest(starts, ROUGH)[0]))

    def one(each: tuple[str, Problem, _Floats]) -> _Fitted | None:
        name, problem, start = each
        with suppress(Error):
            if problem.is_slow:
                return _Fitted(name, problem, problem.improved(start, COARSE_OF_OWN[-3:]))
            return _Fitted(name, problem, shot(problem, start, FINELY if problem.repeats else FINELY[1:]))
        return None

    fits = [found for found in spread(one, tried) if found is not None]
    return _compared(fits) if fits else ()


def _changes(found: Fit) -> Iterator[tuple[str, str, float, dict[str, Any]]]:
    """Name, key and initial value of what one more free parameter may explain, and keys without which it has no effect."""
    scene, chain, wave = found.scene, found.traces[0].chain, found.waveform
    system, friction, velocity = scene.system, scene.friction, scene.drive.velocity
    mu_0, stiffness, mass = friction.mu_0 or 0.2, system.stiffness_x or 1.0, system.mass or 1.0
    free = set(found.problem.names)
    alike = len(found.traces) > 1 or {"system.stiffness_x", "system.mass", "friction.v_f"} <= free
    age, exponential = {"friction.ageing_time": AGE * wave.period}, friction.law in (None, "weakening")
    values = {name: getattr(getattr(scene, name.partition(".")[0]), name.partition(".")[2]) for name in ALL}
    # The last is whether it is left out: the rig has it, has no use for it, or the traces would not tell.
    candidates: list[tuple[str, str, Any, dict[str, Any], bool]] = [
        *(
            (f"another {name.partition('.')[2]}", name, value, {}, not value)
            for name, value in values.items()
        ),
        ("a static limit", "friction.mu_static", (1.0 + BEGIN) * mu_0, {}, bool(friction.mu_static)),
        ("a limit that ages", "friction.ageing", BEGIN * mu_0, age, bool(friction.ageing)),
        (
            "another exponent of friction",
            "friction.exponent",
            1.0 + BEGIN,
            {"friction.law": "stribeck"},
            not exponential,
        ),
        (
            "a damper along the pull",
            "system.damping_x",
            BEGIN * math.sqrt(stiffness * mass),
            {},
            bool(system.damping_x),
        ),
        ("another velocity", "drive.velocity", velocity, {}, alike),
        ("a zero that is off", "chain.tare", chain.tare + BEGIN * wave.swing, {}, False),
        ("a low pass", "chain.filter", BEGIN / wave.interval, {}, chain.filter is not None),
    ]
    for name, key, begin, more, excluded in candidates:
        if key not in free and not excluded:
            yield name, key, float(begin), more
