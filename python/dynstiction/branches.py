"""Branches of limit cycles over a key of the deck, through folds and period doublings (docs/howto/branches.md)."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arguments import whole
from ._progress import progress_bar
from ._slider import held_drive, number_key, own_number
from .errors import DeckError, SolverError, UsageError
from .limit_cycles import LimitCycle, cycles
from .record import headed
from .scene import DeckLike, Scene

_Floats = NDArray[np.float64]

Kind = Literal["fold", "doubling", "grazing", "without rest", "sliding", "border", "closed", "unfinished"]

FIRST_STEP, LONGEST_STEP, SHORTEST_STEP = 2e-3, 0.04, 2e-7
"""Steps along a branch, in units of the range of the key and of the natural unit of a place, a radian or F_0."""
SHARP_TURN = 0.9
"""Cosine of the angle between the directions of a branch at both ends of a step below which the step is halved."""
FAR = 0.2
"""How far a corrected point may be from the predicted one, over the step."""
MOST_ITERATIONS = 8
CLOSE = 1e-10
"""Accuracy of a place and of a value, in these units."""
DIFFERENCE = 1e-6
"""Distance of the two values of the key of which the derivative of the map is the difference."""
LEAP, UNFORESEEN = 0.3, 3e-3
"""Change of the period in a step, over the period, above which the second cycle is another one; and that by which it differs from the
change in the last step, in proportion: where the map is steep, there are other cycles at hardly another place."""
KINK = 1e-3
"""Step from which on the direction may turn sharply, and the period need not be foreseen: the slope may jump where a stick or a slip
begins to graze."""
SMOOTH = 0.02
"""At a fold the slope of the map is 1, at a doubling -1, to this; otherwise it jumps there."""
SMALL = 2e-3
"""Swing over F_0 below which a cycle of the slow motion is about to end in steady sliding."""
MOST_POINTS = 500
"""Points of a branch to either side of the cycle with which it begins."""
BESIDE = 0.01
"""How far from a doubling the cycles that begin there are looked for, over the range."""


class BranchPoint(NamedTuple):
    """A point at which a branch turns, changes its stability, or ends."""

    kind: Kind
    """fold: a stable and an unstable cycle meet; doubling: cycles of twice the period begin; grazing: the branch ends, or turns, where a
    stick or a slip begins to graze, so that the map jumps or has no slope; without rest: the object does not rest any more, so that the
    cycle is none of the map; sliding: it shrinks into steady sliding; border: the range ends; closed: the branch comes back to where it
    began; unfinished: it has as many points as are allowed."""
    value: float
    """Value of the key."""
    place: float
    """As `Branch.place`."""
    period: float
    """[s]"""
    peak_force: float
    """[N]"""
    valley_force: float
    """[N]"""


class Branch(NamedTuple):
    """A curve of cycles, from one of its ends to the other. All arrays have the shape (points,)."""

    slow_cycles: int
    """Slow cycles after which they repeat; 0: the fast oscillation alone."""
    values: _Floats
    """Values of the key."""
    place: _Floats
    """Direction of the force at a release with which the cycle begins [rad], or, in the slow motion, its valley [N]."""
    multiplier: _Floats
    """Factor by which a small disturbance grows in a cycle, with its sign; NaN if it is not known."""
    period: _Floats
    """[s]; this and the following as for `LimitCycle`."""
    peak_force: _Floats
    """[N]"""
    valley_force: _Floats
    """[N]"""
    stick_duration: _Floats
    """[s]"""
    slip_duration: _Floats
    """[s]"""
    slip_length: _Floats
    """[m]"""
    points: tuple[BranchPoint, ...]
    """The special points in their order; the first and the last one are the ends."""

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether the cycles are stable."""
        return np.abs(self.multiplier) < 1.0

    @property
    def swing(self) -> _Floats:
        """Peak minus valley [N]."""
        return self.peak_force - self.valley_force


class Branches(NamedTuple):
    """Branches of cycles over one key; ``print`` shows a table, ``dynstiction.plot`` draws them."""

    key: str
    units: str
    model: str
    branches: tuple[Branch, ...]

    def special(self, kind: Kind) -> tuple[BranchPoint, ...]:
        """The points of one kind on all branches.

        Parameters
        ----------
        kind : str
            As in `BranchPoint`.
        """
        return tuple(point for each in self.branches for point in each.points if point.kind == kind)

    def __str__(self) -> str:
        found = f"{len(self.branches)} branch{'' if len(self.branches) == 1 else 'es'}"
        lines = [f"{self.model}: {found} of cycles over {headed(self.key, self.units)}"]
        for number, each in enumerate(self.branches, 1):
            share = float(np.mean(each.stable))
            stable = "stable" if share == 1.0 else "unstable" if share == 0.0 else "in part stable"
            lines += ["", f"branch {number}: {cycles_in_words(each.slow_cycles)}, {stable}, {each.values.size} points",
                      f"{'':4}{'':14}{self.key.rpartition('.')[2]:>18}{'period [s]':>14}{'peak [N]':>12}{'valley [N]':>12}"]  # fmt: skip
            lines += [
                f"{'':4}{point.kind:14}{point.value:>18.10g}{point.period:>14.7g}{point.peak_force:>12.6g}{point.valley_force:>12.6g}"
                for point in each.points
            ]
        return "\n".join(lines)


def cycles_in_words(slow_cycles: int) -> str:
    """What cycles of so many slow cycles are called."""
    return f"{slow_cycles} slow cycle{'s' * (slow_cycles > 1)}" if slow_cycles else "fast oscillation"


class _Place(NamedTuple):
    """A point of the map: a value of the key and a place, in units of a step, and what the motion from there does."""

    q: float
    a: float
    turn: float
    """Where the motion returns to, minus the place; 0 but for rounding in a cycle."""
    slope: float
    measures: tuple[float, ...]
    kind: Kind | None = None
    """Of a special point."""


class _NoReturn(Exception):
    """There is no motion of this kind there."""


class _Map:
    """The map of slow cycles of a scene as a function of one key."""

    def __init__(self, scene: Scene, key: str, start: float, end: float, model: str) -> None:
        self.scene, self.key, self.start, self.end = scene, key, start, end
        is_log = start > 0.0 and end / start > 10.0
        self.scale: Callable[[float], float] = math.log if is_log else float
        self.value_of: Callable[[float], float] = math.exp if is_log else float
        own = own_number(scene, key)
        self.begin = self.share(own) if start <= own <= end else 0.0
        self.cycles = functools.cache(lambda q: cycles(self.at(q), model=model))
        self.model = self.cycles(self.begin).model
        limit = (own_number(self.at(self.begin), f"friction.{name}") for name in ("mu_0", "normal_load"))
        self.unit = 1.0 if self.model == "full" else math.prod(limit)

    def value(self, q: float) -> float:
        """The value of the key."""
        if q in (0.0, 1.0):
            return self.end if q else self.start
        low, high = self.scale(self.start), self.scale(self.end)
        return self.value_of(low + q * (high - low))

    def share(self, value: float) -> float:
        """The inverse of `value`."""
        low, high = self.scale(self.start), self.scale(self.end)
        return (self.scale(value) - low) / (high - low)

    def at(self, q: float) -> Scene:
        """The scene with a value of the key."""
        return _changed(self.scene, self.key, self.value(q))

    def go(self, q: float, a: float, slow_cycles: int) -> _Place:
        """What the motion from a place does."""
        try:
            to, slope, _, *measures = _native.returned(
                self.at(q).source, self.model, a * self.unit, slow_cycles
            )
        except (DeckError, SolverError):
            raise _NoReturn from None
        if math.isnan(to):
            raise _NoReturn
        return _Place(q, a, to / self.unit - a, slope, tuple(measures))

    def on_line(self, q: float, a: float, way: tuple[float, float], step: float, slow_cycles: int) -> _Place:
        """The cycle on a line in the plane of value and place, near one of its points, by the secant method."""
        before, old, at = 0.0, self.go(q, a, slow_cycles).turn, step
        for _ in range(MOST_ITERATIONS):
            here = self.go(q + at * way[0], a + at * way[1], slow_cycles)
            if here.turn == old:
                break
            change = -here.turn * (at - before) / (here.turn - old)
            if abs(change) <= CLOSE:
                return here
            before, old, at = at, here.turn, at + change
        raise _NoReturn

    def at_value(self, q: float, a: float, slow_cycles: int) -> _Place:
        """The cycle at a value, near a place."""
        return self.on_line(q, a, (0.0, 1.0), SHORTEST_STEP, slow_cycles)


def branch(
    scene: DeckLike,
    key: str,
    start: float,
    end: float,
    *,
    slow_cycles: int = 2,
    model: str = "",
    most_branches: int = 12,
    progress: bool | None = None,
) -> Branches:
    """Follow the cycles of a scene, stable and unstable, over a key of the deck.

    Parameters
    ----------
    scene : str, PathLike or Scene
        As for `cycles`. Its own value of the key is where branches begin, if it is in the range; they also begin at both ends, and at
        doublings.
    key : str
        A number of the deck, ``'misalignment_deg'`` or ``'system.misalignment_deg'``.
    start, end : float
        The range, ``start < end``; if end/start > 10, steps are equal in the logarithm.
    slow_cycles : int
        Unstable cycles of up to so many slow cycles are followed; stable ones whatever their number (up to 8).
    model : str
        'full' or 'low_frequency'; by default the scene's own.
    most_branches : int
        No more branches are followed.
    progress : bool, optional
        Whether to show progress as a bar; by default as for `dynstiction.run`.

    Returns
    -------
    Branches
        The branches with their folds, doublings and ends.

    Raises
    ------
    UsageError
        If the key is no number, or the range is none.
    DeckError, FileError, SolverError
        As for `cycles`; also if the deck is refused at an end of the range.

    Notes
    -----
    A cycle is a fixed point of the map from a release to the release so many slow cycles later, in the slow motion from a valley to the
    next. Both the map and its slope are exact, to the accuracy of the integrator, so that the value of a fold is known to some 1e-9. A branch
    is followed with steps in its direction, which the derivatives of the map say, each corrected across it. Branches that no cycle at the values
    above is on are not found.

    Examples
    --------
    >>> found = branch("inputs/fig3.nml", "misalignment_deg", 1.0, 9.0, model="low_frequency")     # doctest: +SKIP
    >>> found.special("fold")                                                                      # doctest: +SKIP
    """
    rig, name = held_drive(Scene(scene)), number_key(key)
    if not (math.isfinite(start) and math.isfinite(end) and start < end):
        raise UsageError(f"start = {start:g}, end = {end:g}: a range goes from a number to a larger one")
    whole("slow_cycles", slow_cycles, least=0)
    for value in (start, end):
        _changed(rig, name, value).check()
    the_map = _Map(rig, name, float(start), float(end), model)
    queue = [the_map.begin, *(q for q in (0.0, 1.0) if q != the_map.begin)]
    found: list[tuple[Branch, list[_Place]]] = []
    with progress_bar(progress, most_branches, "{n_fmt} branches {elapsed}") as show:
        while queue and len(found) < most_branches:
            q = queue.pop(0)
            for cycle, a in _cycles_at(the_map, q, slow_cycles):
                if len(found) == most_branches or _is_known(the_map, found, q, cycle):
                    continue
                places = _Curve(the_map, max(1, cycle.slow_cycles)).follow(q, a)
                if len(places) < 2:
                    continue
                found.append((_as_branch(the_map, cycle.slow_cycles, places), places))
                doublings = [
                    at.q + beside for at in places if at.kind == "doubling" for beside in (-BESIDE, BESIDE)
                ]
                queue += [q for q in doublings if 0.0 <= q <= 1.0]
                show(len(found))
    units = _native.key_info(*name.split(".")).units or "1"
    ordered = sorted(
        (each for each, _ in found),
        key=lambda each: (each.slow_cycles, -float(np.mean(each.stable)), each.period[0]),
    )
    return Branches(name, units, the_map.model, tuple(ordered))


def _changed(scene: Scene, key: str, value: float) -> Scene:
    change: dict[str, Any] = {key: value}
    return scene.replace(**change)


def _cycles_at(the_map: _Map, q: float, slow_cycles: int) -> Iterator[tuple[LimitCycle, float]]:
    """The cycles at a value that are followed, of those that are known there, and their places; none if the deck is refused there."""
    try:
        seen = the_map.cycles(q)
    except (DeckError, SolverError):
        return
    for cycle, release in zip(seen.cycles, seen.release_angle, strict=True):
        place = release if the_map.model == "full" else cycle.valley_force
        if math.isfinite(place) and (cycle.stable or cycle.slow_cycles <= slow_cycles):
            yield cycle, float(place) / the_map.unit


def _is_known(
    the_map: _Map, found: Sequence[tuple[Branch, list[_Place]]], q: float, cycle: LimitCycle
) -> bool:
    """Whether a cycle is on one of the branches."""
    for each, places in found:
        if each.slow_cycles != cycle.slow_cycles:
            continue
        for one, other in itertools.pairwise(places):
            if not min(one.q, other.q) <= q <= max(one.q, other.q):
                continue
            share = (q - one.q) / (other.q - one.q) if other.q != one.q else 0.0
            with suppress(_NoReturn):
                there = the_map.at_value(q, one.a + share * (other.a - one.a), max(1, each.slow_cycles))
                if np.allclose(there.measures[:3:2], (cycle.period, cycle.valley_force), 1e-7, 1e-9):
                    return True
    return False


class _Curve:
    """The cycles of n slow cycles as a curve in the plane of value and place."""

    def __init__(self, the_map: _Map, n: int) -> None:
        self.map, self.n = the_map, n

    def follow(self, q: float, a: float) -> list[_Place]:
        """The branch through a cycle; none if that is not found again."""
        try:
            middle = self.map.at_value(q, a, self.n)
        except _NoReturn:
            return []
        left, right = (self.one_way(middle, side) for side in (-1, 1))
        return left[:0:-1] + (left if len(left) == 1 and not right[0].kind else right[:1]) + right[1:]

    def one_way(self, first: _Place, side: int) -> list[_Place]:
        """The branch from a cycle to one side of its value, to its end."""
        if first.q == (0.0 if side < 0 else 1.0):
            return [first._replace(kind="border")]
        try:
            way = self.direction(first)
        except _NoReturn:
            return [first._replace(kind="grazing")]
        steps, places, step, end = [first], [first], FIRST_STEP, None
        sense = side * math.copysign(1.0, way[0])
        way *= sense
        while end is None and len(steps) < MOST_POINTS:
            try:
                there, onward = self.next(steps, way, step, sense)
            except _NoReturn:
                if step < SHORTEST_STEP:
                    at = self.beginning(places[-1])
                    places += [at] if at else []
                    end = "doubling" if at else self.why(steps[-1], step * way)
                step *= 0.5
                continue
            for at in self.between(steps[-1], there):
                places.append(at)
                if at.kind == "doubling" and at.slope > 0.0:
                    # Beyond are the same cycles, from another of their releases.
                    end = "doubling"
                    break
            else:
                steps.append(there)
                end, way = self.end(steps), onward
                places.append(_in_sliding(self.map, there) if end == "sliding" else there)
                step = min(LONGEST_STEP, 1.5 * step)
        places[-1] = places[-1]._replace(kind=end or "unfinished")
        return places

    def end(self, steps: list[_Place]) -> Kind | None:
        """Whether a branch ends with its last point."""
        first, here, there = steps[0], *steps[-2:]
        if there.q in (0.0, 1.0):
            return "border"
        if self.map.model != "full" and there.measures[1] - there.measures[2] < SMALL * self.map.unit:
            return "sliding"
        return "closed" if len(steps) > 10 and _passes(here, there, first) else None

    def next(self, steps: list[_Place], way: _Floats, step: float, sense: float) -> tuple[_Place, _Floats]:
        """The next point of a branch and the way onward from there, if this step leads to one of the same branch."""
        here = steps[-1]
        (q, a), across = (here.q, here.a) + step * way, (-way[1], way[0])
        if not 0.0 <= q <= 1.0:
            # The last point is at the border.
            border = min(1.0, max(0.0, q))
            q, a, across = border, here.a + (border - here.q) / (q - here.q) * (a - here.a), (0.0, 1.0)
        there = self.map.on_line(q, a, across, 1e-3 * step, self.n)
        onward = sense * self.direction(there)
        if not (
            0.0 <= there.q <= 1.0
            and math.hypot(there.q - q, there.a - a) <= FAR * step + 10.0 * CLOSE
            and onward @ way >= (SHARP_TURN if step > KINK else 0.0)
            and abs(there.measures[0] - here.measures[0]) <= LEAP * here.measures[0]
            and (step <= KINK or len(steps) == 1 or _is_foreseen(steps[-2], here, there))
            and not self.is_of_fewer(there)
        ):
            raise _NoReturn
        return there, onward

    def direction(self, here: _Place) -> _Floats:
        """Unit vector along the cycles, on which the motion returns to where it began; the derivative over the value is a difference.
        It turns continuously along a branch, and reverses where a branch of fewer slow cycles crosses.
        """
        beside = []
        for apart in (-DIFFERENCE, DIFFERENCE):
            with suppress(_NoReturn):
                beside.append(self.map.go(here.q + apart, here.a, self.n))
        if not beside:
            raise _NoReturn
        # The slope may jump right at a cycle, where a slow cycle begins to count as two: of both sides that with its slope.
        one = min(beside, key=lambda each: abs(each.slope - here.slope))
        along = np.array([1.0 - one.slope, (one.turn - here.turn) / (one.q - here.q)])
        return along / math.hypot(*along)

    def why(self, last: _Place, step: _Floats) -> Kind:
        """Why a branch ends before a step: the motion does not return from there, or not to where it began."""
        try:
            self.map.go(last.q + step[0], last.a + step[1], self.n)
        except _NoReturn:
            return "without rest"
        return "grazing"

    def is_of_fewer(self, place: _Place, *, near: float = 1e-6) -> bool:
        """Whether a cycle of n slow cycles is one of fewer, which the map of n has, too."""
        for fewer in (each for each in range(1, self.n // 2 + 1) if self.n % each == 0):
            with suppress(_NoReturn):
                if abs(self.map.go(place.q, place.a, fewer).turn) <= near:
                    return True
        return False

    def beginning(self, last: _Place) -> _Place | None:
        """The doubling next to the last point of a branch, where cycles of half as many slow cycles lose their stability."""
        from scipy.optimize import newton  # type: ignore[import-untyped]  # noqa: PLC0415

        if self.n % 2 or not abs(last.slope - 1.0) < 0.1:
            return None

        def half(q: float) -> _Place:
            return self.map.at_value(q, last.a, self.n // 2)

        try:
            found = half(newton(lambda q: half(q).slope + 1.0, last.q, x1=last.q + 1e-5, tol=CLOSE, maxiter=MOST_ITERATIONS))  # fmt: skip
        except (_NoReturn, RuntimeError):
            return None
        if not abs(found.slope + 1.0) < SMOOTH or abs(found.q - last.q) > BESIDE:
            return None
        period, *rest = found.measures
        return _Place(found.q, found.a, 0.0, 1.0, (2.0 * period, *rest))

    def between(self, one: _Place, other: _Place) -> Iterator[_Place]:
        """The folds and doublings between two points of a branch."""
        from scipy.optimize import brentq  # noqa: PLC0415

        dq, da = other.q - one.q, other.a - one.a
        length = math.hypot(dq, da)

        @functools.cache
        def at(share: float) -> _Place:
            if share in (0.0, 1.0):
                return other if share else one
            across = (-da / length, dq / length)
            return self.map.on_line(one.q + share * dq, one.a + share * da, across, 1e-3 * length, self.n)

        for slope in (1.0, -1.0):

            def excess(share: float, slope: float = slope) -> float:
                return at(share).slope - slope

            if not excess(0.0) * excess(1.0) < 0.0:
                continue
            try:
                there = at(brentq(excess, 0.0, 1.0, xtol=1e-9, rtol=1e-12, maxiter=60))
            except (_NoReturn, RuntimeError):
                continue
            # A fold of the map of n may be where cycles of n begin.
            kind: Kind = "fold" if slope > 0.0 and not self.is_of_fewer(there, near=1e-4) else "doubling"
            yield there._replace(kind=kind if abs(there.slope - slope) < SMOOTH else "grazing")


def _is_foreseen(before: _Place, here: _Place, there: _Place) -> bool:
    """Whether the period changes in a step as it did in the last one, in proportion to their lengths."""
    ratio = math.dist(there[:2], here[:2]) / math.dist(here[:2], before[:2])
    change, last = there.measures[0] - here.measures[0], here.measures[0] - before.measures[0]
    return abs(change - ratio * last) <= UNFORESEEN * here.measures[0]


def _passes(here: _Place, there: _Place, point: _Place) -> bool:
    """Whether a step passes a point."""
    if here.q == there.q or not 0.0 <= (share := (point.q - here.q) / (there.q - here.q)) <= 1.0:
        return False
    is_near = abs(here.a + share * (there.a - here.a) - point.a) <= 0.05 * abs(there.a - here.a)
    low, high = sorted((here.slope, there.slope))
    return is_near and low - 0.1 * (high - low) <= point.slope <= high + 0.1 * (high - low)


def _in_sliding(the_map: _Map, last: _Place) -> _Place:
    """The point of steady sliding in which a small cycle of the slow motion ends: where its stability changes."""
    from scipy.optimize import brentq  # noqa: PLC0415

    def growth(q: float) -> float:
        return float(np.max(the_map.cycles(q).eigenvalues.real))

    around = [max(0.0, last.q - 0.01), min(1.0, last.q + 0.01)]
    if growth(around[0]) * growth(around[1]) >= 0.0:
        return last
    q = brentq(growth, *around, xtol=1e-13)
    seen = the_map.cycles(q)
    load = seen.sliding_load
    period = 2.0 * math.pi / abs(float(seen.eigenvalues[0].imag) or math.nan)
    return _Place(
        q, load / the_map.unit, 0.0, 1.0, (period, load, load, 0.5 * period, 0.5 * period, math.nan)
    )


def _as_branch(the_map: _Map, slow_cycles: int, places: list[_Place]) -> Branch:
    rows = [(the_map.value(at.q), at.a * the_map.unit, at.slope, *at.measures) for at in places]
    points = (
        BranchPoint(at.kind, *row[:2], *row[3:6]) for at, row in zip(places, rows, strict=True) if at.kind
    )
    return Branch._make((slow_cycles, *np.array(rows).T, tuple(points)))
