"""Measured error against cost on one scene, in slices of wall time.

A survey finds the time scales of the motion. The reference is radau13 at the smallest tolerance; its error is the difference from
radau9 at ten times that tolerance. Then the candidates that are not costly run in turn, and after them the costly ones, the
cheapest first, until the budget of wall time is used up. A candidate that does not fit is skipped or abandoned, and stays in the
list with the reason.
"""

from __future__ import annotations

import math
import time
from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from .. import _native
from .._native import STOPPED_EARLY
from ..errors import DeckError, Error
from ..record import Described, Info, Record
from ..scene import Scene
from ..simulation import Simulation
from .plan import Candidate, Settings, Subject, candidates
from .quantities import QUANTITIES, Observer, Quantity, of_distributions

__all__ = ["RESOLUTION", "Comparison", "Point", "StoppedEarlyError"]

RESOLUTION = 100.0
"""An error counts as measured if it exceeds the error of the reference by this factor."""
WORST_REFERENCE = 1.0e-2
"""A quantity whose error in the reference is larger than this is not used."""
ROUNDOFF = 10.0 * float(np.finfo(float).eps)
"""Smallest error of the reference: two runs may agree to the last digit by chance."""
SMALLEST_RTOL, LOOSEST_REFERENCE = 1.0e-13, 1.0e-9
SURVEY_RTOL, SURVEY_SAMPLES = 1.0e-6, 4000
SHARE = 0.08
"""Share of the remaining budget that one candidate may take before the costly ones run."""
PROOF = 0.15
"""Share of its allowed time after which the speed of a candidate is estimated."""
SHORT_RUN, MOST_REPEATS = 0.02, 3
"""Runs shorter than this [s] are repeated this many times, and the shortest time counts."""
RHS_PER_STEP = 4.0

CLOSED_FORMS = ("creep", "creep_asymptotic")

COLUMNS = {
    "role": ("1", "reference, check (its errors are those of the reference) or candidate", "role"),
    "model": ("1", "equations", "candidate.model"),
    "form": ("1", "of Eq. (8)", "candidate.form"),
    "method": ("1", "integrator; empty for a closed form", "candidate.method"),
    "contact": ("1", "exact or smoothed; empty where the model has no choice", "candidate.contact"),
    "cycle_map": (
        "1",
        "auto: cycles that repeat are leapt, off: not; empty where there is no choice",
        "candidate.cycle_map",
    ),
    "rtol": ("1", "relative tolerance; 0 = not used", "candidate.rtol"),
    "step": ("s", "fixed step; 0 = not used", "candidate.step"),
    "v_smooth": ("m/s", "smoothing velocity; 0 = not used", "candidate.v_smooth"),
    "seconds": ("s", "wall time; of an abandoned run what it would have been at its pace", "seconds"),
    "steps": ("1", "accepted steps", "steps"),
    "rhs": ("1", "evaluations of the equations of motion", "rhs"),
    "newton": ("1", "Newton iterations", "newton"),
    "result_code": (
        "1",
        "0 = done, 40 to 49 = the solver gave up, 75 = no budget, 2 = cannot be used, or is the same as another",
        "code",
    ),
}
"""Units and meaning of the columns other than the errors, and the attribute of a point that they contain."""


class StoppedEarlyError(Error):
    """The budget was too small, or a signal was received."""

    exit_status = STOPPED_EARLY

    def __init__(self, text: str) -> None:
        super().__init__(f"{text}; see dynstiction help errors")


@dataclass
class Point:
    """One candidate and its result."""

    candidate: Candidate
    role: str = "candidate"
    code: int = STOPPED_EARLY
    text: str = "not tried"
    seconds: float = 0.0
    steps: float = 0.0
    rhs: float = 0.0
    newton: float = 0.0
    leapt: float = 0.0
    """Number of cycles that were leapt."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Errors by quantity, for the quantities that the scene has."""

    @property
    def done(self) -> bool:
        """Whether it was measured."""
        return self.code == 0


class Comparison:
    """The candidates, their results, and a budget of wall time that starts now [s].

    The scene, the quantities and the candidates `own` come from the user. Raises a `DeckError` if the scene is refused.
    """

    def __init__(
        self, scene: Scene, budget: float, quantities: Mapping[str, Quantity], own: Iterable[Settings]
    ) -> None:
        self.budget = budget
        self.subject = subject = Subject(scene)
        if subject.model in CLOSED_FORMS:
            raise DeckError(
                f"model '{subject.model}' is a closed form and leaves nothing to compare: choose model = 'full', which has it "
                "among its candidates"
            )
        with Simulation(subject.scene()) as simulation:
            self._record = replace(simulation.result, deck=scene.text)
        v_smooth = subject.number("v_smooth") if subject.contact == "smoothed" else 0.0
        # The reference must not use the cycle map, which it is to judge.
        best = Candidate(
            subject.model,
            "radau13",
            subject.contact,
            cycle_map="off" if subject.has_cycle_map else "",
            rtol=SMALLEST_RTOL,
            v_smooth=v_smooth,
        )
        self.best, self.second = Point(best, "reference"), Point(replace(best, method="radau9"), "check")
        self.points = [Point(candidate) for candidate in candidates(subject, own)]
        self._quantities = quantities
        self._t_end = subject.number("t_end")
        self._survey = self._start(
            replace(self.second.candidate, rtol=SURVEY_RTOL), self._t_end / SURVEY_SAMPLES
        )
        self.has_reference = False
        self.is_irregular = False
        """Whether there is a reference to compare with."""
        self._begun = time.monotonic()

    @property
    def elapsed(self) -> float:
        """Wall time since the start [s]."""
        return time.monotonic() - self._begun

    @property
    def left(self) -> float:
        """Budget left [s]."""
        return self.budget - self.elapsed

    def steps(self) -> Iterator[None]:
        """Run the comparison in steps of about 50 ms; raise an `Error` if there is no reference, or no time for one."""
        yield from self._find_reference()
        # First what is right, and cheaper than the reference: whatever is left of the budget, there is a recommendation.
        kin = {"model": self.best.candidate.model, "method": self.best.candidate.method}
        sure = [i for i, point in enumerate(self.points) if kin.items() <= vars(point.candidate).items()][:1]
        waiting = yield from self._try_all(sure, 1.0)
        waiting += yield from self._try_all((i for i in range(len(self.points)) if i not in sure), SHARE)
        cost = {i: max(self.points[i].seconds, self._expected(self.points[i].candidate)) for i in waiting}
        yield from self._try_all(sorted(waiting, key=cost.__getitem__), 1.0)

    def _start(self, candidate: Candidate, interval: float = 0.0) -> Simulation:
        settings = candidate.settings()
        simulation = Simulation(self.subject.scene(settings, interval=interval or self._t_end, fields=None))
        if not interval:
            simulation._sample_at(self._observer.instants)
        return simulation

    def _find_reference(self) -> Iterator[None]:
        with self._survey as survey:
            yield from self._finish(survey)
            self._observer = Observer(self.subject, survey.result, self._quantities)
            work = _work(survey)
            self._seconds_per_rhs = work["wall_time"] / max(1.0, work["rhs"])
        with (yield from self._finish_loosened(self.best)) as reference:
            result = reference.result
            self._observer.tune(result)
            self._true = self._observer.observe(reference)
            self._record = replace(self._record, summary=result.summary, statistics=result.statistics)
        self.second.candidate = replace(self.second.candidate, rtol=10.0 * self.best.candidate.rtol)
        with (yield from self._finish_loosened(self.second)) as check:
            errors = self._observer.errors(self._observer.observe(check), self._true)
        spread = of_distributions(result.summary)
        self.is_irregular = bool(spread)
        # Differences above three standard errors are resolved; a smaller tolerance does not change this for a distribution.
        errors |= {name: 3.0 * error / RESOLUTION for name, error in spread.items() if name in errors}
        errors = {name: max(error, ROUNDOFF) for name, error in errors.items() if error <= WORST_REFERENCE}
        self._true = {name: self._true[name] for name in errors}
        self.second.errors = errors
        self.has_reference = True

    def _finish_loosened(self, point: Point) -> Generator[None, None, Simulation]:
        """Run the reference; if its solver gives up, at a larger tolerance."""
        while True:
            simulation = self._start(point.candidate)
            yield from self._finish(simulation, loosest=point.candidate.rtol >= LOOSEST_REFERENCE)
            self._note(point, simulation)
            if point.done:
                return simulation
            point.candidate = replace(point.candidate, rtol=10.0 * point.candidate.rtol)

    def _finish(self, simulation: Simulation, *, loosest: bool = True) -> Iterator[None]:
        while not simulation._go_on(min(_native.CHUNK_SECONDS, self.left)):
            yield
            if self.left <= 0.0:
                raise StoppedEarlyError(
                    f"the budget of {self.budget:.3g} s does not suffice for the reference: raise --budget, or lower scene.t_end"
                )
        code, text = simulation._outcome or (0, "")
        if code != 0 and loosest:
            raise self.subject.scene().source.error(code, f"there is no reference: {text}")
        yield

    def _try_all(self, order: Iterable[int], share: float) -> Generator[None, None, list[int]]:
        """Try points in turn, each with a share of the remaining budget; points that were too costly are postponed."""
        waiting = []
        for i in order:
            point = self.points[i]
            try:
                self._check(point.candidate)
                allowance, expected = share * self.left, self._expected(point.candidate)
                if expected > allowance or self.left <= 0.0:
                    self._skip(point, expected)
                    waiting.append(i)
                elif not (yield from self._try(point, allowance)):
                    waiting.append(i)
            except DeckError as error:
                point.code, point.text = error.exit_status, str(error)
        return waiting

    def _check(self, candidate: Candidate) -> None:
        """Refuse a candidate that cannot replace the deck, because of its obstacle or because its closed form lacks some output.

        Also refuse a candidate that is the same run as another one, unless the user asked for it.
        """
        if candidate.obstacle:
            raise DeckError(candidate.obstacle)
        twin = replace(candidate, cycle_map="auto", rank=0)
        if candidate.cycle_map == "off" and candidate.rank > 0:
            for point in self.points:
                if point.done and point.leapt == 0.0 and replace(point.candidate, rank=0) == twin:
                    raise DeckError("the same run as with cycle_map = 'auto', which leapt no cycle")
        if candidate.order == 0:
            Simulation(self.subject.scene(candidate.settings())).close()

    def _try(self, point: Point, allowance: float) -> Generator[None, None, bool]:
        """Run a candidate; return whether it ended."""
        for repeat in range(MOST_REPEATS):
            with self._start(point.candidate) as simulation:
                begun = time.monotonic()
                while not simulation._go_on(min(_native.CHUNK_SECONDS, self.left, PROOF * allowance)):
                    yield
                    spent, reached = time.monotonic() - begun, simulation._core.time()
                    pace = self._t_end / max(reached, 1.0e-6 * self._t_end)
                    if spent > allowance or (spent > PROOF * allowance and spent * pace > 3.0 * allowance):
                        self._note(point, simulation)
                        point.code, point.seconds = STOPPED_EARLY, point.seconds * pace
                        point.text = f"abandoned after {spent:.3g} s at t = {reached:.3g} s: the budget did not suffice"
                        return False
                if repeat == 0:
                    self._note(point, simulation)
                    if point.done:
                        point.errors = self._observer.errors(self._observer.observe(simulation), self._true)
                point.seconds = min(point.seconds, _work(simulation)["wall_time"])
            yield
            if not point.done or point.seconds >= SHORT_RUN or self.left <= 10.0 * point.seconds:
                break
        return True

    @staticmethod
    def _note(point: Point, simulation: Simulation) -> None:
        work = _work(simulation)
        point.steps, point.rhs, point.newton = (work[name] for name in ("steps", "rhs", "newton"))
        point.seconds, point.leapt = work["wall_time"], work["cycles_leapt"]
        point.code, point.text = simulation._outcome or (0, "")

    def _skip(self, point: Point, expected: float) -> None:
        # The text of the first round, that it was abandoned, says more.
        if point.steps == 0.0:
            left = self.left
            point.text = "skipped: the budget was used up"
            if left > 0.0:
                point.text = f"skipped: it was expected to take {expected:.3g} s, and {left:.3g} s of the budget were left"

    def _expected(self, candidate: Candidate) -> float:
        """Expected cost of a candidate [s], from the nearest one of its family; 0 if there is none."""
        expected, nearest = 0.0, math.inf
        if candidate.step > 0.0:
            expected = self._seconds_per_rhs * RHS_PER_STEP * self._t_end / candidate.step
        for point in self.points:
            other = point.candidate
            if point.seconds > 0.0 and other.family == candidate.family:
                ratio = 1.0
                if candidate.step > 0.0:
                    ratio = other.step / candidate.step
                elif candidate.rtol > 0.0:
                    ratio = (other.rtol / candidate.rtol) ** (1.0 / max(1, candidate.order))
                if abs(math.log(ratio)) < nearest:
                    expected, nearest = point.seconds * ratio, abs(math.log(ratio))
        return expected

    def record(self, fault: Error | None) -> Record:
        """Scene, provenance and outcome of the comparison, with summary and statistics of the reference, without samples."""
        code = 0 if fault is None else getattr(fault, "code", fault.exit_status)
        attributes: dict[str, str | int] = {
            **self._record.attributes,
            "deck_sha256": sha256(self._record.deck.encode("utf-8", "surrogateescape")).hexdigest(),
            "model": self.subject.model,
            "method": "radau13",
            "result_code": code,
            "result_text": "done" if fault is None else str(fault),
            "complete": int(fault is None),
        }
        attributes.pop("model_choice", None)
        return replace(self._record, columns=Described([]), attributes=attributes)

    def table(self) -> Described[NDArray[np.float64] | NDArray[np.str_]]:
        """One row for each point: the reference, the run that gives its error, and the candidates in the order of the trials."""
        points = [self.best, self.second, *self.points]
        columns = [(Info("point", "1", "number of the point"), np.arange(1.0, len(points) + 1.0))]
        for name, (units, long_name, place) in COLUMNS.items():
            values = np.array([attrgetter(place)(point) for point in points])
            columns.append(
                (Info(name, units, long_name), values.astype(float) if values.dtype.kind in "if" else values)
            )
        for name, text in (QUANTITIES | dict.fromkeys(self._quantities, "quantity of the user")).items():
            errors = np.array([point.errors.get(name, math.nan) for point in points])
            columns.append((Info(f"error_{name}", "1", f"error of: {text}"), errors))
        return Described(
            [*columns, (Info("text", "1", "how it ended"), np.array([point.text for point in points]))],
            "table",
        )


def _work(simulation: Simulation) -> dict[str, float]:
    """Counters of the work so far, and the wall time in the core [s]."""
    return {info.name: value for info, value in simulation._statistics_so_far()}
