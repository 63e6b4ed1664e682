"""Branches of limit cycles over a key of the deck, through folds and period doublings (docs/howto/branches.md)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arguments import whole
from ._progress import progress_bar
from ._slider import held_drive, number_key, own_number
from .errors import DeckError, SolverError, UsageError
from .limit_cycles import Cycles, LimitCycle, cycles
from .scene import DeckLike, Scene

__all__ = ["Branch", "BranchPoint", "Branches", "branch", "cycles_in_words"]

_Floats = NDArray[np.float64]

Kind = Literal["fold", "doubling", "grazing", "without rest", "sliding", "border", "closed", "unfinished"]

FIRST_STEP, LONGEST_STEP, SHORTEST_STEP = 2e-3, 0.04, 2e-7
"""Steps along a branch, in units of the range of the key and of the natural unit of a place, a radian or F_0."""
SHARP_TURN = 0.9
"""Cosine of the angle between two steps below which the second one is halved."""
FAR = 0.2
"""How far a corrected point may be from the predicted one, over the step."""
PREFERRED = 0.3
"""The key is given, and the place found, where it changes by more than this share of what the place changes by; otherwise vice versa."""
MOST_ITERATIONS = 8
CLOSE = 1e-10
"""Accuracy of a place and of a value, in these units."""
VAGUE, FITTING = 0.2, 0.4
"""Shares of the integral of the slope: above the first one it is known well enough for a test, which the second one passes."""
NUDGE = 1e-6
"""How far from a place the search for a cycle is repeated if it finds none."""
LEAP = 0.3
"""Change of the period in a step, over the period, above which the second cycle is another one."""
KINK = 1e-3
"""Step from which on that test is left out: the factor in it may jump where a stick or a slip begins to graze."""
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
        name = self.key if self.units == "1" else f"{self.key} [{self.units}]"
        lines = [
            f"{self.model}: {len(self.branches)} branch{'' if len(self.branches) == 1 else 'es'} of cycles over {name}"
        ]
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
    slope: float
    measures: tuple[float, ...]

    @property
    def excess(self) -> dict[str, float]:
        """What is 0 at a fold and at a doubling."""
        return {"fold": self.slope - 1.0, "doubling": self.slope + 1.0}


class _NoReturn(Exception):
    """There is no motion of this kind there."""


class _Map:
    """The map of slow cycles of a scene as a function of one key."""

    def __init__(self, scene: Scene, key: str, start: float, end: float, model: str) -> None:
        self.scene, self.key, self.start, self.end = scene, key, start, end
        self.is_log = start > 0.0 and end / start > 10.0
        self.model = model
        with _native.Run(scene.source) as run:
            parameters = {info.name: value for info, value in run.parameters()}
        self.unit = 1.0 if model == "full" else float(parameters["mu_0"]) * float(parameters["normal_load"])

    def value(self, q: float) -> float:
        """The value of the key."""
        if q in (0.0, 1.0):
            return self.end if q else self.start
        if self.is_log:
            return float(self.start * (self.end / self.start) ** q)
        return self.start + q * (self.end - self.start)

    def share(self, value: float) -> float:
        """The inverse of `value`."""
        if self.is_log:
            return math.log(value / self.start) / math.log(self.end / self.start)
        return (value - self.start) / (self.end - self.start)

    def at(self, q: float) -> Scene:
        """The scene with a value of the key."""
        return _changed(self.scene, self.key, self.value(q))

    def go(self, q: float, a: float, slow_cycles: int) -> tuple[float, _Place]:
        """Where the motion from a place returns to, minus the place."""
        try:
            with _native.Return(self.at(q).source, self.model, a * self.unit, slow_cycles) as found:
                to, slope, measures = found.to, found.slope, tuple(found.measures)
        except (DeckError, SolverError):
            raise _NoReturn from None
        if math.isnan(to):
            raise _NoReturn
        return to / self.unit - a, _Place(q, a, slope, measures)

    def at_value(self, q: float, a: float, slow_cycles: int) -> _Place:
        """The cycle at a value, near a place, by Newton's method."""
        for _ in range(MOST_ITERATIONS):
            turn, here = self.go(q, a, slow_cycles)
            slope = 0.0 if math.isnan(here.slope) else here.slope
            if slope == 1.0:
                break
            step = -turn / (slope - 1.0)
            if abs(step) <= CLOSE:
                return here
            if abs(step) > LONGEST_STEP:
                break
            a += step
        raise _NoReturn

    def at_place(self, q: float, a: float, slow_cycles: int, step: float) -> _Place:
        """The cycle with a place, near a value, by the secant method."""
        before, (turn, here) = q, self.go(q, a, slow_cycles)
        old, q = turn, q + step
        for _ in range(MOST_ITERATIONS):
            turn, here = self.go(q, a, slow_cycles)
            if turn == old:
                break
            change = -turn * (q - before) / (turn - old)
            before, old = q, turn
            if abs(change) <= CLOSE:
                return here
            q += change
        raise _NoReturn


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
    is followed with steps along it, in which the value is given and the place found, or, near folds, vice versa. Branches that no
    cycle at the values above is on are not found.

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
    own = own_number(rig, name)
    first = _changed(rig, name, own if start <= own <= end else start)
    seen = cycles(first, model=model)
    the_map = _Map(first, name, float(start), float(end), seen.model)
    begin = the_map.share(own) if start <= own <= end else 0.0
    queue = [begin, *(q for q in (0.0, 1.0) if q != begin)]
    known = {begin: seen}
    found: list[tuple[Branch, list[_Place]]] = []
    with progress_bar(progress, most_branches, "{n_fmt} branches {elapsed}") as show:
        while queue and len(found) < most_branches:
            q = queue.pop(0)
            for cycle, a in _cycles_at(the_map, q, slow_cycles, known.get(q)):
                if len(found) == most_branches or _is_known(the_map, found, q, cycle):
                    continue
                one = _follow(the_map, q, a, max(1, cycle.slow_cycles))
                if one is None:
                    continue
                found.append((_as_branch(the_map, cycle.slow_cycles, *one), one[0]))
                queue += [
                    beside
                    for kind, at in one[1]
                    if kind == "doubling"
                    for beside in (at.q - BESIDE, at.q + BESIDE)
                    if 0.0 <= beside <= 1.0
                ]
                show(len(found))
    units = _native.key_info(*name.split(".")).units or "1"
    ordered = sorted(
        (each for each, _ in found),
        key=lambda each: (each.slow_cycles, -float(np.mean(each.stable)), each.period[0]),
    )
    return Branches(name, units, seen.model, tuple(ordered))


def _changed(scene: Scene, key: str, value: float) -> Scene:
    change: dict[str, Any] = {key: value}
    return scene.replace(**change)


def _cycles_at(
    the_map: _Map, q: float, slow_cycles: int, seen: Cycles | None
) -> Iterator[tuple[LimitCycle, float]]:
    """The cycles at a value that are followed, of those that are known there, and their places; none if the deck is refused there."""
    try:
        seen = seen or cycles(the_map.at(q), model=the_map.model)
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
            try:
                there = the_map.at_value(q, one.a + share * (other.a - one.a), max(1, each.slow_cycles))
            except _NoReturn:
                continue
            if math.isclose(there.measures[0], cycle.period, rel_tol=1e-7) and math.isclose(
                there.measures[2], cycle.valley_force, rel_tol=1e-7, abs_tol=1e-9
            ):
                return True
    return False


_Special = tuple[Kind, _Place]


def _follow(the_map: _Map, q: float, a: float, n: int) -> tuple[list[_Place], list[_Special]] | None:
    """The branch through a cycle: its points, and the special ones among them."""
    try:
        middle = the_map.at_value(q, a, n)
    except _NoReturn:
        return None
    sides = []
    for side in (-1, 1):
        places, between, end = _one_way(the_map, middle, side, n)
        special = [*(found for _, found in between), (end, places[-1])]
        for place, (_, at) in reversed(between):
            places.insert(place, at)
        sides.append((places, special))
    (left, before), (right, after) = sides
    return left[:0:-1] + right, before[::-1] + after


def _one_way(
    the_map: _Map, first: _Place, side: int, n: int
) -> tuple[list[_Place], list[tuple[int, _Special]], Kind]:
    """The branch from a cycle to one side of its value, to its end: points, special ones with their place among these, and the end."""
    places: list[_Place] = [first]
    special: list[tuple[int, _Special]] = []
    step = FIRST_STEP
    end: Kind | None = "border" if first.q == (0.0 if side < 0 else 1.0) else None
    while end is None and len(places) < MOST_POINTS:
        here = places[-1]
        way = (float(side), 0.0)
        if len(places) > 1:
            way = (here.q - places[-2].q, here.a - places[-2].a)
            way = (way[0] / math.hypot(*way), way[1] / math.hypot(*way))
        there, why = _next(the_map, places, way, step, n)
        if there is None:
            step *= 0.5
            if step < SHORTEST_STEP:
                at = _beginning(the_map, here, n)
                places += [at] if at else []
                end = "doubling" if at else why
            continue
        for kind, at in _between(the_map, here, there, n):
            if kind == "doubling" and at.slope > 0.0:
                # Beyond are the same cycles, from another of their releases.
                there, end = at, kind
                break
            special.append((len(places), (kind, at)))
        places.append(there)
        end = end or _end(the_map, places)
        step = min(LONGEST_STEP, 1.5 * step)
    return places, special, end or "unfinished"


def _end(the_map: _Map, places: list[_Place]) -> Kind | None:
    """Whether a branch ends with its last point."""
    first, here, there = places[0], *places[-2:]
    if there.q in (0.0, 1.0):
        return "border"
    if the_map.model != "full" and there.measures[1] - there.measures[2] < SMALL * the_map.unit:
        places[-1] = _in_sliding(the_map, there)
        return "sliding"
    return "closed" if len(places) > 10 and _passes(here, there, first) else None


def _passes(here: _Place, there: _Place, point: _Place) -> bool:
    """Whether a step passes a point."""
    if here.q == there.q or not 0.0 <= (share := (point.q - here.q) / (there.q - here.q)) <= 1.0:
        return False
    is_near = abs(here.a + share * (there.a - here.a) - point.a) <= 0.05 * abs(there.a - here.a)
    low, high = sorted((here.slope, there.slope))
    return is_near and low - 0.1 * (high - low) <= point.slope <= high + 0.1 * (high - low)


def _next(
    the_map: _Map, places: list[_Place], way: tuple[float, ...], step: float, n: int
) -> tuple[_Place | None, Kind]:
    """The next point of a branch, or why there is none with this step."""
    here, is_first = places[-1], len(places) == 1
    q, a = here.q + step * way[0], here.a + step * way[1]
    is_beyond = not 0.0 <= q <= 1.0
    if is_beyond:
        # The last point is at the border.
        share = (min(1.0, max(0.0, q)) - here.q) / (q - here.q)
        q, a = min(1.0, max(0.0, q)), here.a + share * (a - here.a)
    ways: list[Callable[[], _Place]] = [lambda: the_map.at_value(q, a, n)]
    if not is_first and not is_beyond:
        ways.append(lambda: the_map.at_place(q, a, n, 1e-3 * step * (1.0 if way[0] > 0.0 else -1.0)))
        if abs(way[0]) < PREFERRED * abs(way[1]):
            ways.reverse()
    why: Kind = "without rest"
    for correct in ways:
        try:
            there = correct()
        except _NoReturn:
            continue
        why = "grazing"
        if not 0.0 <= there.q <= 1.0:
            continue
        moved = (there.q - here.q, there.a - here.a)
        length = math.hypot(*moved)
        if is_first:
            # The direction is not known yet: the place may change more than the value, but not by leaps.
            if length <= 20.0 * step + CLOSE:
                return there, why
        elif (
            math.hypot(there.q - q, there.a - a) <= FAR * step + 10.0 * CLOSE
            and moved[0] * way[0] + moved[1] * way[1] >= SHARP_TURN * length
            and abs(there.measures[0] - here.measures[0]) <= LEAP * here.measures[0]
            and (step <= KINK or _fits(places, there))
            and not _is_of_fewer(the_map, there, n)
        ):
            return there, why
    if len(places) > 2 and (beyond := _round_a_fold(the_map, places, step, n)):
        return beyond, why
    if why == "without rest":
        try:
            the_map.go(q, a, n)
            why = "grazing"
        except _NoReturn:
            pass
    return None, why


def _round_a_fold(the_map: _Map, places: list[_Place], step: float, n: int) -> _Place | None:
    """The next point where the value is nearly a square function of the place, as near a fold, which may be too sharp for steps along the
    branch.
    """
    first, before, here = places[-3:]
    length = math.hypot(here.q - before.q, here.a - before.a)
    a = here.a + min(1.0, step / length) * (here.a - before.a)
    if not (here.a - before.a) * (before.a - first.a) > 0.0:
        return None
    bend = ((here.q - before.q) / (here.a - before.a) - (before.q - first.q) / (before.a - first.a)) / (
        here.a - first.a
    )
    q = here.q + (a - here.a) * ((here.q - before.q) / (here.a - before.a) + bend * (a - before.a))
    size = abs(here.q - before.q)
    try:
        there = the_map.at_place(q, a, n, 1e-3 * size or CLOSE)
    except _NoReturn:
        return None
    is_near = abs(there.q - q) <= FAR * max(size, abs(q - here.q)) and 0.0 <= there.q <= 1.0
    return there if is_near and _fits(places, there) and not _is_of_fewer(the_map, there, n) else None


def _is_of_fewer(the_map: _Map, place: _Place, n: int, *, near: float = 1e-6) -> bool:
    """Whether a cycle of n slow cycles is one of fewer, which the map of n has, too."""
    for fewer in (each for each in range(1, n // 2 + 1) if n % each == 0):
        try:
            turn, _ = the_map.go(place.q, place.a, fewer)
        except _NoReturn:
            continue
        if abs(turn) <= near:
            return True
    return False


def _fits(places: list[_Place], there: _Place) -> bool:
    """Whether a point is on the branch of the last ones: along it the change of the value is the integral of slope - 1 over the place, times
    a factor that changes little from step to step.
    """
    here = places[-1]
    if abs(there.slope - here.slope) > max(1.0, 0.5 * max(abs(there.slope), abs(here.slope))):
        return False
    new, size = _integral(here, there)
    for one, other in zip(places[-2:-5:-1], places[-1:-4:-1], strict=False):
        old, old_size = _integral(one, other)
        if abs(old) > VAGUE * old_size:
            factor = (other.q - one.q) / old
            return abs((there.q - here.q) - factor * new) <= FITTING * abs(factor) * size
    return True


def _integral(one: _Place, other: _Place) -> tuple[float, float]:
    """The integral of slope - 1 over the place between two points, and what it would be without a change of sign."""
    way, ends = other.a - one.a, (one.slope - 1.0, other.slope - 1.0)
    return 0.5 * sum(ends) * way, abs(way) * max(map(abs, ends))


def _beginning(the_map: _Map, last: _Place, n: int) -> _Place | None:
    """The doubling next to the last point of a branch of cycles of n slow cycles, where cycles of half as many lose their stability."""
    if n % 2 or not abs(last.slope - 1.0) < 0.1:
        return None
    q, old = last.q, math.nan
    change = 1e-5
    try:
        for _ in range(MOST_ITERATIONS):
            half = the_map.at_value(q, last.a, n // 2)
            excess = half.slope + 1.0
            if abs(excess) < 1e-9 or abs(change) < CLOSE:
                break
            if not math.isnan(old):
                change *= -excess / (excess - old) if excess != old else 0.0
            old = excess
            q += change
    except _NoReturn:
        return None
    if not abs(half.slope + 1.0) < SMOOTH or abs(half.q - last.q) > BESIDE:
        return None
    period, *rest = half.measures
    return _Place(half.q, half.a, 1.0, (2.0 * period, *rest))


def _between(the_map: _Map, one: _Place, other: _Place, n: int) -> list[_Special]:
    """The folds and doublings between two points of a branch."""
    from scipy.optimize import brentq  # noqa: PLC0415

    special: list[_Special] = []
    for kind in ("fold", "doubling"):
        if not one.excess[kind] * other.excess[kind] < 0.0:
            continue
        seen: dict[float, _Place] = {0.0: one, 1.0: other}

        def excess(share: float, kind: str = kind, seen: dict[float, _Place] = seen) -> float:
            if share not in seen:
                q, a = (
                    before + share * (after - before)
                    for before, after in ((one.q, other.q), (one.a, other.a))
                )
                if kind == "fold" or abs(other.q - one.q) < PREFERRED * abs(other.a - one.a):
                    seen[share] = the_map.at_place(
                        q, a, n, 1e-3 * max(abs(other.q - one.q), 1e-3 * abs(other.a - one.a))
                    )
                else:
                    # From one side of a doubling a slow cycle may count as two, with a slope of 1.
                    for beside in (0.0, NUDGE, -NUDGE):
                        try:
                            seen[share] = the_map.at_value(q, a + beside, n)
                            break
                        except _NoReturn:
                            if beside < 0.0:
                                raise
            return seen[share].excess[kind]

        try:
            at = seen[brentq(excess, 0.0, 1.0, xtol=1e-9, rtol=1e-12, maxiter=60)]
        except (_NoReturn, RuntimeError):
            continue
        if not abs(at.excess[kind]) < SMOOTH:
            special.append(("grazing", at))
        elif kind == "doubling" or _is_of_fewer(the_map, at, n, near=1e-4):
            # Or it is one: the map of n has its fold where cycles of n begin.
            special.append(("doubling", at))
        else:
            special.append(("fold", at))
    return special


def _in_sliding(the_map: _Map, last: _Place) -> _Place:
    """The point of steady sliding in which a small cycle of the slow motion ends: where its stability changes."""
    from scipy.optimize import brentq  # noqa: PLC0415

    def growth(q: float) -> float:
        return float(np.max(cycles(the_map.at(q), model=the_map.model).eigenvalues.real))

    around = [max(0.0, last.q - 0.01), min(1.0, last.q + 0.01)]
    if growth(around[0]) * growth(around[1]) >= 0.0:
        return last
    q = brentq(growth, *around, xtol=1e-13)
    seen = cycles(the_map.at(q), model=the_map.model)
    load = seen.sliding_load
    period = 2.0 * math.pi / abs(float(seen.eigenvalues[0].imag) or math.nan)
    return _Place(q, load / the_map.unit, 1.0, (period, load, load, 0.5 * period, 0.5 * period, math.nan))


def _as_branch(the_map: _Map, slow_cycles: int, places: list[_Place], special: list[_Special]) -> Branch:
    rows = [
        (the_map.value(place.q), place.a * the_map.unit, place.slope, *place.measures) for place in places
    ]
    points = tuple(
        BranchPoint(kind, the_map.value(at.q), at.a * the_map.unit, *at.measures[:3]) for kind, at in special
    )
    return Branch._make((slow_cycles, *np.array(rows).T, points))
