"""The search of a fit: near the scene's values and the slow model's fit, then beyond."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from ..errors import Error
from .models import NoCycleError, steady_velocity
from .problem import KINETIC, PRIOR, VELOCITY, Problem, Recording
from .shooting import COARSELY, FINELY, GAINED, PATIENTLY, Level, cost_at, delayed, shot
from .solve import Solution, has_failed, least_squares_of, spread

_Floats = NDArray[np.float64]

ANGLE = "system.misalignment_deg"
COARSE = (0.02, 0.005)
"""Errors relative to swing and period that are added, one fit after another: of the slow model."""
COARSE_OF_OWN = (0.05, 0.02, 0.005, 0.001, 0.0)
"""The same for the scene's own model."""
MISFIT = 1e-3
"""Probability of such a misfit by chance, below which the model does not explain a trace."""
USUAL = 0.05
"""The same, above which a search has found what it looked for."""
CORRECTIONS, CORRECTED = 6, 0.1
"""Largest number of times that the difference between the scene's model and the slow one is computed for a fit, and the change of all
coordinates, in standard errors, below which this ends."""
MOST_CORRECTIONS, PROMISING = 8, 0.3
"""The same number for starts, and the mean square of coarse residuals below which the model can explain the traces."""
FACTORS = (
    (1.0, 1.0),
    (1.5, 1.0),
    (0.67, 1.0),
    (1.0, 2.0),
    (1.0, 0.5),
    (1.5, 2.0),
    (0.67, 0.5),
    (1.5, 0.5),
    (0.67, 2.0),
)
"""Misalignment and v_f that are held on the way to a start, over those that are given."""
NEAR = 100.0
"""Misfit below which a start is near the traces."""
SMOOTH = 60.0
"""Number of sticks in a slow cycle above which the cost is smooth: one search finds its minimum."""
ALSO = 3.84
"""Excess of the cost, over the misfit, up to which other values explain a trace as well: 95 % of one parameter."""
RANDOM_STARTS = 6
SHOTS, COMPLETED = 40, 8
"""Random starts that are shot at first, of three times as many, and the largest number that is completed."""
SIDE_BY_SIDE = 4
"""Fits that are made at once."""
APART = 3.0
"""Errors by which a coordinate of a coarse fit differs from that of a better one, or it is not completed."""
HOPS, FARTHEST = 8, 0.5
"""Largest number of fits from near the best one that find nothing better, and the largest change of a coordinate to where they begin."""
LEFT_OPEN = 1.0
"""Error of a coordinate above which a fit leaves it open."""
MOST_SHOTS = 10000
"""Shots after which no further fit is begun from near the best one."""
STRIDE, MOST_STRIDES = 2.0, 12
"""Least distance from the best fit at which others begin, in standard errors, and their largest number."""
AHEAD = 0.25
"""Share of such a stride that a fit keeps if it leads on."""
AGAIN, GAIN = 4, 0.99
"""Largest number of times that the best fit begins again, and its cost over that before above which it does not."""
CLOSE = 2.0
"""Cost, over what noise costs, below which a fit is improved patiently, or, of cycles that are alike, others are begun beside it."""
OFTEN = 0.3
"""Probability of a misfit by chance above which a guided fit needs no shot of its own."""
SPREAD_OF_COST = 3.0
"""Excess of the cost of cycles that are not alike, in its standard deviations, up to which it is what noise explains."""
NEAR_SLOW = {ANGLE: (-1.4, 1.4), KINETIC: (-0.03, 0.2), VELOCITY: (-0.7, 0.7)}
NEAR_OTHERS = (-0.06, 0.06)
"""Changes of logarithms from the slow model's fit to a start. The rise and the valley of the load show that model most parameters well. A
creep in few sticks hides the misalignment, and ends before friction has its full size: mu_0 is rather larger than that fit."""
SPREAD = 0.7
"""Largest change of a logarithm in a random start."""
ANGLES = (0.3, 0.8, 2.0, 4.0)
"""Misalignments that are tried [deg]."""
WEAKENING = (0.1, 0.4, 1.2, 4.0)
"""Velocities v_f that are tried, over the speed of the fastest slip."""
LAG = 0.4
"""Share of the weakening that such a slip does not reach, divided by the ratio of v_f to the speed of the fastest slip."""
FALL = 0.494
"""Share of half a period of a harmonic motion in which it falls from 85 % to 15 % of its swing."""
STEEPEST = 10
"""Number of parts of a cycle; the load rises fastest over one of them."""


def glances(recording: Recording) -> Iterator[Mapping[str, float]]:
    """Rough estimates of the parameters behind a waveform, for several misalignments and weakening velocities.

    The load rises no faster than k_x V. It falls like half a period of a harmonic motion, and ends as far below the friction in
    slip as it began above it.
    """
    wave, load = recording.waveform, recording.scene.friction.normal_load or 1.0
    time, mean = wave.time, wave.mean
    grid = np.linspace(time[0], time[-1], 20 * STEEPEST)
    force = np.interp(grid, time, mean)
    part = grid.size // STEEPEST
    stiffness = float(np.max((force[part:] - force[:-part]) / (grid[part:] - grid[:-part]))) / abs(
        steady_velocity(recording.scene)
    )
    peak, valley = float(mean.max()), float(mean[time > 0.0].min())
    half = 0.5 * (peak - valley)
    mass = stiffness * (wave.fall / FALL / np.pi) ** 2
    fastest = half / np.sqrt(stiffness * mass)
    for angle in ANGLES:
        for share in WEAKENING:
            yield {
                "system.misalignment_deg": angle,
                "system.stiffness_x": stiffness,
                "system.mass": mass,
                "friction.mu_0": 1.003 * peak / load,
                "friction.mu_inf": max(peak - half * (1.0 + LAG * share), 0.1 * peak) / load,
                "friction.v_f": share * fastest,
            }


def _apart(problem: Problem, found: Sequence[Solution]) -> list[Solution]:
    """Fits in the order of their cost, without those whose coordinates are all within a few errors of those of a better one."""
    apart: list[Solution] = []
    ends: list[_Floats] = []
    for each in sorted(found, key=lambda each: each.cost):
        if all(np.any(np.abs(each.z - other.z) > end) for other, end in zip(apart, ends, strict=True)):
            apart.append(each)
            ends.append(APART * np.linalg.norm(problem.root(each.jacobian), axis=1))
    return apart


class Search:
    """A search for the values of a problem, with the scene's own model, in which so many starts are completed.

    What it finds is in `found`. Random starts come from `random`; `show` is told the share that is done.
    """

    def __init__(
        self,
        problem: Problem,
        starts: int,
        random: np.random.Generator,
        show: Callable[[float], None] = lambda _: None,
    ) -> None:
        self.problem, self.starts, self.random, self.show = problem, starts, random, show
        self.slow = None if problem.is_slow else problem.of_slow_model()
        """The same for the slow model, which proposes starts; None where it is the scene's own."""
        self.given = problem.place({})
        self.proposal: _Floats | None = None
        """The best fit of the slow model."""
        self.found: list[Solution] = []
        self.faults: list[NoCycleError] = []
        """Why starts were not completed."""

    @property
    def best(self) -> Solution:
        """The fit with the least cost."""
        return min(self.found, key=lambda each: each.cost)

    def run(self) -> None:
        """All fits: near the traces, then, if these do not explain them, far away."""
        if not self._near():
            self._shoot()
        if self.found and self.best.left is not None:
            best = self.best
            with suppress(Error):
                self.found[self.found.index(best)] = replace(best, z=delayed(self.problem, best.z))
        if self.found and not self.problem.repeats:
            self._weigh()

    def _near(self) -> bool:
        """Fits that begin near the traces; whether nothing better is to be expected elsewhere."""
        problem = self.problem
        if self.slow is None:
            for start in self._slow_starts(problem):
                self._attempt(start)
            return True
        self._propose(self.slow)
        self.show(0.2)
        if not problem.repeats:
            return False
        # Where there are few sticks in a cycle, such fits end beside the least cost, and shots are needed anyway.
        if self.proposal is not None and self.slow.heard == problem.names and self._is_smooth(self.proposal):
            self.found += self._guided(self.slow, self.proposal)
            if self.found and self._chance(problem) < OFTEN:
                # With the derivatives of another model a fit ends near the minimum, but not always at it.
                self._add_shot(problem, self.best.z, FINELY[1:])
                self._walk(problem)
            if self.found and (self._chance(problem) >= USUAL or self._is_near(self.best.z)):
                return True
        for begin in (self.given, self.proposal):
            if begin is not None and not self._explains() and self._is_near(begin):
                self._add_shot(problem, begin, FINELY)
        return False

    def glance(self) -> None:
        """A fit from the given values or from those of the slow model, for what need not be found."""
        if self.slow is not None:
            self._propose(self.slow)
        starts = [each for each in (self.given, self.proposal) if each is not None]
        if rough := self._shots(self.problem, starts, COARSELY):
            self._add_shot(self.problem, min(rough, key=lambda each: each.cost).z, FINELY)

    def _weigh(self) -> None:
        """Take the scatter of cycles that are not alike about those of the best fit for their error."""
        best = self.best
        recordings = enumerate(self.problem.recordings)
        better = tuple(each.reweighted(self.problem.cycles(best.z, k)) for k, each in recordings)
        self.problem = replace(self.problem, recordings=better)

    def _attempt(self, start: _Floats) -> None:
        """A fit from one start, or why there is none."""
        try:
            self.found.append(self.problem.improved(start, COARSE_OF_OWN))
        except NoCycleError as error:
            self.faults.append(error)

    def _is_near(self, start: _Floats) -> bool:
        with suppress(Error):
            return self.problem.misfit(start)[0] < NEAR
        return False

    def _explains(self, problem: Problem | None = None) -> bool:
        problem = problem or self.problem
        if not self.found:
            return False
        if problem.repeats:
            return self._chance(problem) >= USUAL
        return self._costs_noise(problem) and self._chance(problem) >= MISFIT

    def _chance(self, problem: Problem) -> float:
        """Probability by chance of the misfit of the best fit; 0 if there is none, or no run there."""
        with suppress(Error):
            return problem.misfit(self.best.z, self.best.left)[1] if self.found else 0.0
        return 0.0

    def _costs_noise(self, problem: Problem) -> bool:
        """Whether the best fit to cycles that are not alike costs no more than what noise does."""
        least = problem.noise + SPREAD_OF_COST * math.sqrt(2.0 * problem.noise)
        return self.best.left is not None and self.best.cost <= least

    def _is_smooth(self, z: _Floats) -> bool:
        """Whether the motion has many sticks in a cycle, or none: then one more or less does not matter."""
        with suppress(Error):
            return not 0.0 < self.problem.cycles(z, 0, patient=False).sticks < SMOOTH
        return False

    def _propose(self, slow: Problem) -> None:
        fits = []
        for start in self._slow_starts(slow):
            with suppress(NoCycleError):
                fits.append(slow.improved(start, COARSE))
        if fits:
            self.proposal = min(fits, key=lambda each: each.cost).z

    def _slow_starts(self, slow: Problem) -> list[_Floats]:
        """The best starts for the slow model: the scene's values, glances at the waveform, random changes of both."""
        near = [self.given, *map(slow.place, glances(self.problem.recordings[0]))]
        p = len(slow.names)
        for _ in range(RANDOM_STARTS):
            start = near[int(self.random.integers(len(near)))].copy()
            start[:p] += self.random.uniform(-SPREAD, SPREAD, p)
            near.append(start)
        return slow.cheapest(near, COARSE[0])[: self.starts]

    def _rough(self, problem: Problem) -> list[Solution]:
        """Coarse fits from random starts, of which the best are worth completing.

        Where the cost of one mean cycle is rugged, the first minimum that explains it need not be the least; where it is smooth, it is found
        here, and nothing else is of use.
        """
        rough: list[Solution] = []
        starts = self._own_starts()
        for i in range(0, len(starts), SIDE_BY_SIDE):
            for each in self._shots(problem, starts[i : i + SIDE_BY_SIDE], COARSELY):
                rough.append(each)
                if each.cost < PROMISING * problem.noise and self._is_smooth(each.z):
                    self._add_shot(problem, each.z, FINELY)
                    if self._explains():
                        return []
        return rough

    def _own_starts(self) -> list[_Floats]:
        """The best of many random starts near the slow model's fit, and the scene's values; where there is no such fit, near these and glances."""
        problem = self.problem
        ends = np.array([NEAR_SLOW.get(name, NEAR_OTHERS) for name in problem.names])
        begin = problem.named(self.given)
        middles: list[dict[str, float]] = [begin, *map(dict, glances(problem.recordings[0]))]
        if self.proposal is not None:
            middles = [problem.named(self.proposal)]
            # Its misalignment may be zero, whatever the true one.
            if ANGLE in begin:
                middles[0][ANGLE] = begin[ANGLE]
        starts = [self.given]
        for i in range(3 * SHOTS):
            middle = problem.place(middles[i % len(middles)])
            starts.append(problem.moved(middle, self.random.uniform(*ends.T)))
        return problem.cheapest(starts, COARSE_OF_OWN[0])[:SHOTS]

    def _guided(self, slow: Problem, z: _Floats) -> list[Solution]:
        """The fit of the scene's model with the derivatives of the slow one; none where that leads astray.

        With many sticks in a cycle the slow model is near, and its derivatives are smooth where the other's cost is rough by a stick more or less.
        """
        problem, found = self.problem, None
        for new in islice(self._corrected(problem, slow, z, 0.0), CORRECTIONS):
            errors = np.linalg.norm(problem.root(new.jacobian), axis=1)
            change, z, found = np.abs(new.z - z), new.z, new
            if np.all(change < CORRECTED * errors):
                break
        if found is None or has_failed(here := problem.residuals(z, 0.0)):
            return []
        return [Solution(z, float(here @ here), found.jacobian)]

    def _corrected(self, problem: Problem, slow: Problem, z: _Floats, coarse: float) -> Iterator[Solution]:
        """Fits of the slow model, each corrected by its difference from the scene's own at the one before."""
        while True:
            here, slowly = problem.residuals(z, coarse), slow.residuals(z, coarse)
            if has_failed(here) or has_failed(slowly):
                return
            try:
                new = least_squares_of(slow, z, coarse, offset=here - slowly)
            except NoCycleError:
                return
            yield new
            z = new.z

    def _approach(self, few: Problem) -> Iterator[_Floats]:
        """Starts: where the slow model leads by the mean of the cycles, or the given values if they are nearer to the cycles.

        The mean hardly shows misalignment and v_f, along which a fit to it would wander: these are held, at the given values and then at others.
        """
        held = [name for name in (ANGLE, VELOCITY) if name in self.problem.names]
        near, given = PROMISING * few.noise, self.problem.named(self.given)
        best: _Floats | None = self.given
        least = cost_at(few, self.given, COARSELY[0])
        for factors in dict.fromkeys(each[: len(held)] for each in FACTORS):
            hold = {name: given[name] * factor for name, factor in zip(held, factors, strict=True)}
            for z in self._held(hold) if least > near else ():
                cost = cost_at(few, z, COARSELY[0])
                if cost < least:
                    best, least = z, cost
                if least < near:
                    break
            if best is not None:
                yield best
            best, least = None, math.inf

    def _held(self, hold: Mapping[str, float]) -> Iterator[_Floats]:
        """Ever better values for the mean of the cycles with some of them held."""
        own = self.problem.of_means().holding(hold)
        slow = own.of_slow_model()
        near = [self.problem.named(start) for start in (self.given, self.proposal) if start is not None]
        near += [self.problem.named(self.problem.place(each)) for each in glances(self.problem.recordings[0])]
        starts = slow.cheapest([slow.place({**each, **hold}) for each in near], COARSE[0])
        for start in starts[: self.starts]:
            try:
                z = slow.improved(start, COARSE).z
            except NoCycleError:
                continue
            yield z
            corrected = self._corrected(own, slow, z, COARSE[-1])
            yield from (each.z for each in islice(corrected, MOST_CORRECTIONS))
            return

    def _shoot(self) -> None:
        """Fits by shooting from the best starts, then from near the best fit, until one explains the traces."""
        few, promising = self.problem.of_few_cycles(), True
        if few.repeats:
            rough = [] if self._explains() else self._rough(few)
            promising = not rough or min(each.cost for each in rough) < PROMISING * few.noise
            worth = _apart(few, rough)[: COMPLETED if promising else 1]
            self.found += self._shots(few, [each.z for each in worth], FINELY)
        else:
            for i, start in enumerate(self._approach(few)):
                self.show(0.2 + 0.2 * i / len(FACTORS))
                self._add_shot(few, start, FINELY)
                self._again(few)
                if self._explains(few) or len(few.runs) > MOST_SHOTS:
                    break
        self._hop(few, HOPS if promising else 0, 0.4)
        self._again(few)
        if few is self.problem:
            self._walk(few)
        elif self.found:
            found, self.found = self.found, []
            best = min(found, key=lambda each: each.cost)
            self._add_shot(self.problem, best.z, self._levels_near(few, best))
            # What explains few cycles need not explain all.
            self._hop(self.problem, AGAIN, 0.8)
            self._walk(self.problem)
            if not self.found:
                self.problem, self.found = few, found

    def _again(self, problem: Problem) -> None:
        """The best fit once more, from other rests, until that does not matter."""
        for _ in range(AGAIN if self.found else 0):
            if self._explains(problem):
                break
            before, levels = self.best.cost, self._levels_near(problem)
            self._add_shot(problem, self.best.z, levels)
            if levels is PATIENTLY or self.best.cost > GAIN * before:
                break

    def _levels_near(self, problem: Problem, best: Solution | None = None) -> tuple[Level, ...]:
        """Levels that begin at the best fit to a problem's cycles: patience is for one that is near."""
        return PATIENTLY if (best or self.best).cost < CLOSE * problem.noise else FINELY[1:]

    def _hop(self, problem: Problem, most: int, done: float) -> None:
        """Fits from near the best one, along what the traces determine least, until one explains them; where the cost is rugged, until so
        many of them have found nothing better.
        """
        rugged = problem.repeats and bool(self.found) and not self._is_smooth(self.best.z)
        left, made = most if self.found else 0, 0
        while left > 0 and (rugged or not self._explains(problem)) and len(problem.runs) <= MOST_SHOTS:
            self.show(done + (0.95 - done) * made / (made + most))
            starts = [self._near_best(problem) for _ in range(SIDE_BY_SIDE if rugged else 1)]
            levels = (*COARSELY, *FINELY) if problem.repeats else self._levels_near(problem)
            before = self.best.cost
            self.found += self._shots(problem, starts, levels)
            left = most if rugged and self.best.cost < before - GAINED else left - len(starts)
            made += len(starts)

    def _near_best(self, problem: Problem) -> _Floats:
        """Coordinates near those of the best fit; what it leaves open is near the scene's values."""
        p, root = len(problem.names), problem.root(self.best.jacobian)
        way = root @ self.random.standard_normal(root.shape[0])
        left_open = (np.linalg.norm(root, axis=1) > LEFT_OPEN) & (np.arange(way.size) < p)
        way[left_open] = 0.0
        largest = float(np.abs(way[:p]).max())
        way *= FARTHEST * self.random.uniform() ** 2 / largest if largest else 0.0
        near = self.given + NEAR_SLOW[ANGLE][1] * self.random.uniform(-1.0, 1.0, way.size)
        return np.where(left_open, near, self.best.z + way)

    def _walk(self, problem: Problem) -> None:
        """Fits to both sides of the best one, along what the traces determine least, as far as values explain them as well: the cost is rippled.

        Where each cycle is explained by itself, a fit is dear: as far as each is better than the last. Strides grow while they lead on.
        """
        p, alike = len(problem.names), problem.repeats
        levels, excess = (FINELY[1:], ALSO) if alike else (PATIENTLY, -ALSO)
        near = self.found and (
            self.best.cost < CLOSE * problem.noise if alike else self._costs_noise(problem)
        )
        if not near:
            return
        begin = self.best.z
        for side in (STRIDE, -STRIDE):
            last, stride, stays = self.best, side, 0
            for _ in range(MOST_STRIDES):
                root = problem.root(last.jacobian)[:p]
                sizes, axes = np.linalg.eigh(root @ root.T)
                way = axes[:, -1] * math.sqrt(sizes[-1])
                way *= math.copysign(stride, stride * way[np.abs(way).argmax()])
                way *= min(1.0, FARTHEST / np.abs(way).max())
                there, least, count = last.z.copy(), self.best.cost, len(self.found)
                there[:p] += way
                if np.abs(there - begin)[:p].max() > PRIOR:
                    # What a trace does not determine.
                    break
                self._add_shot(problem, there, levels)
                new = self.found[-1]
                as_well = len(self.found) > count and new.cost < least + excess
                if as_well and (new.z - last.z)[:p] @ way > AHEAD * (way @ way):
                    last, stride, stays = new, 2.0 * stride, 0
                    continue
                if (stays := stays + 1) > alike:
                    break
                stride = 2.0 * side if stride == side else side

    def _add_shot(self, problem: Problem, start: _Floats, levels: Sequence[Level]) -> None:
        self.found += self._shots(problem, [start], levels)

    def _shots(self, problem: Problem, starts: Sequence[_Floats], levels: Sequence[Level]) -> list[Solution]:
        """Fits from several starts, which threads compute side by side."""

        def one(start: _Floats) -> Solution | NoCycleError:
            try:
                return shot(problem, start, levels)
            except NoCycleError as error:
                return error

        ends = spread(one, starts)
        self.faults += [end for end in ends if isinstance(end, NoCycleError)]
        return [end for end in ends if isinstance(end, Solution)]
