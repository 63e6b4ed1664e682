"""Fits by shooting: each cycle from its own rest, with exact derivatives, so that no long irregular motion is compared with another.

After a slip an object comes to rest. How a slow cycle goes on hangs on the elongations of that rest, which are unknowns of the cycle, and
on the parameters. Of cycles that are alike the mean is one, and it ends as it began.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import Error
from ..scene import Scene
from ..tangents import derivatives
from .models import NoCycleError, finer_of, has_memory, sampled_means, steady_velocity
from .problem import CHAIN, Problem, Recording, apart_in_time
from .solve import Solution, spread
from .waveform import EXACT, centred

_Floats = NDArray[np.float64]


class Level(NamedTuple):
    """How coarsely residuals are seen."""

    width: float
    """Standard deviation of their smoothing [bins]: wide enough, it hides single sticks, whose number makes the cost rugged."""
    share: float
    """Of swing and period, added to the errors."""
    patient: bool = False
    """Whether the best rest of each cycle is sought until nothing is to be gained."""


COARSELY = (Level(8.0, 0.01),)
FINELY = (Level(8.0, 0.001), Level(0.0, 0.001), Level(0.0, 0.0))
PATIENTLY = (Level(0.0, 0.0, patient=True),)
MOST_STEPS, LONGEST = 20, 0.3
"""Largest number of steps of a fit, and of the change of a coordinate in one."""
FIRST, LEAST, MORE, MOST = 1e-4, 1e-8, 30.0, 1.0
"""Levenberg and Marquardt's damping: at first, least, its factor after a step that failed, and that at which a fit ends."""
ENDS = 2e-3
"""Decrease of the cost, over its square root, at which a fit ends."""
PRIOR = 0.01
"""Weight of the prior that keeps a step finite."""
CAP, BAD = 4.0, 1.7
"""Costs of one of many cycles that are not alike, over the median: above which it does not count (none of the tried rests is near), and
other rests are tried."""
NEWTON, BETTER, GAINED = 4, 0.9, 1.0
"""Newton's steps for the state of a cycle; the cost over that before up to which another is made; and, if patient, the decrease of the
cost that it promises above which it is made whatever the last one did."""
FRESH = 2
"""Largest number of times that better rests are sought in a run when a fit has ended, if patient."""
STARTS = 4
"""Rests of a run that are tried for a cycle which is explained badly; if patient, for each."""
OPEN = 0.03
"""How far, relative to the swing, a cycle may end from where it began, but in the last fit."""
MISSING = 0.4
"""Largest share of the bins that are before the rest."""
IN_PERIOD, IN_BIN, NARROW = 8.0, 4.0, 1.5
"""Samples in a period of the fast oscillation, and in a long bin; bins around the slip are narrower than so many of the narrowest."""
CHAIN_STEP = 1e-3
"""Change of a coordinate of the chain for a derivative."""
DELAYS, DELAY = 2, 0.02
"""Steps to find a delay, and its change for a derivative."""


class _Shot(NamedTuple):
    """A cycle from a rest: weighted residuals, measured minus model, and derivatives of the model."""

    off: _Floats
    by_parameters: _Floats
    """With no column, of a try: its parameters are not asked yet."""
    by_state: _Floats
    kept: NDArray[np.intp]
    """Rows that are not before the rest."""
    missing: float
    """Number of bins before it: each costs what noise would."""
    period: _Floats
    """Change of the period with the parameters, of a cycle that ends as it began."""
    closed: tuple[_Floats, _Floats]
    """Changes of parameters, and of the delay, by what the state of such a cycle follows."""

    @property
    def cost(self) -> float:
        return float(self.off @ self.off) + self.missing


class _Shooting:
    """Shots of all cycles of all traces at one level."""

    def __init__(self, problem: Problem, level: Level) -> None:
        self.problem, self.level = problem, level
        self.targets = [
            (k, row)
            for k, each in enumerate(problem.recordings)
            for row in ([each.waveform.rows.mean(axis=0)] if each.waveform.repeats else each.waveform.rows)
        ]

    def at(self, z: _Floats, k: int) -> Recording:
        """Trace k with the values at these coordinates."""
        return self.problem.at_values(self.problem.recordings[k], z[: len(self.problem.names)])

    def units(self, z: _Floats) -> _Floats:
        """Units of the state of each cycle [m], shape (cycles, 2)."""
        each = [_units(self.at(z, k)) for k in range(len(self.problem.recordings))]
        return np.array([each[k] for k, _ in self.targets])

    def shots(
        self, z: _Floats, states: _Floats, which: Sequence[int], whole: bool = False
    ) -> list[_Shot | None]:
        """One for each of these cycles, None where the program gives no motion; if whole, with the derivatives by the parameters."""
        recordings = [self.at(z, k) for k in range(len(self.problem.recordings))]

        def one(i: int) -> _Shot | None:
            k, row = self.targets[i]
            try:
                return _shot(self.problem, z, k, recordings[k], row, states[i], self.level, whole)
            except Error:
                return None

        return spread(one, which)

    def rests(self, z: _Floats) -> list[_Floats]:
        """States at the rests of cycles in a run that come near those of the traces, one array for each try.

        A cycle begins with one number. Along it the distance from a measured cycle has a minimum for each number of sticks: the lowest of these are tried.
        NaN where there are fewer.
        """
        problem, found = self.problem, []
        for k, record in enumerate(problem.recordings):
            wave = record.waveform
            # Near the mean of cycles that are alike roughly settled ones will do.
            model = problem.cycles(z, k, patient=not (wave.repeats and self.level.share))
            if wave.repeats:
                wave = replace(wave, rows=wave.rows.mean(axis=0, keepdims=True))
            apart, later = apart_in_time(wave, model, wave.weights(max(self.level.share, FINELY[0].share)))
            # At rest the springs are stretched as the drive moves.
            way = _pull(self.at(z, k).scene)
            order = np.argsort(model.states[:, 1] * way[1] - model.states[:, 2] * way[0])
            minima = _lowest_minima(apart[:, order], STARTS).T
            tries = order[minima]
            late = np.take_along_axis(later, tries.T, axis=1).T
            there = model.states[tries]
            there[..., 1:] += late[..., np.newaxis] * way
            there[minima < 0] = math.nan
            found.append(there)
        return list(np.concatenate(found, axis=1))

    def settled(
        self, z: _Floats, states: _Floats | None, cost: float = 0.0
    ) -> tuple[_Floats, list[_Shot | None]]:
        """States near given ones, or near those of a run, that explain the cycles best, and the shots from them.

        The given states are enough if they explain each cycle, at less than a cost.
        """
        every, units = range(len(self.targets)), self.units(z)
        tries = self.rests(z) if states is None else []
        states = (tries[0] if states is None else states).copy()
        shots = self.shots(z, states, every, whole=not tries)
        if not tries and not self.badly(shots) and self.cost(z, shots) < cost:
            return states, shots

        def take(those: _Floats, which: Sequence[int], there: list[_Shot | None] | None = None) -> None:
            """Begin with those states, whose shots may be known, then with where Newton's steps lead from them."""
            before = np.full(len(states), math.inf)
            for _ in range(1 + NEWTON):
                there, those, leading = there or self.shots(z, those, which), those.copy(), []
                for i, new in zip(which, there, strict=True):
                    if new is None:
                        continue
                    old = shots[i]
                    if old is None or new.cost < old.cost:
                        shots[i], states[i] = new, those[i]
                    step = np.linalg.lstsq(new.by_state, new.off, rcond=1e-9)[0]
                    gained = float(np.sum((new.by_state @ step) ** 2))
                    if gained > GAINED if self.level.patient else new.cost < BETTER * before[i]:
                        those[i, 1:] += step * units[i]
                        leading.append(i)
                    before[i] = new.cost
                which, there = leading, None

        take(states.copy(), every, shots.copy())
        patient = bool(tries) and self.level.patient
        for those in tries[1:] or (self.rests(z) if self.badly(shots) else ()):
            which = every if patient else self.badly(shots)
            take(those, [i for i in which if np.isfinite(those[i, 0])])
        return states, shots

    def complete(self, z: _Floats, states: _Floats, shots: list[_Shot | None]) -> None:
        """Give all shots the derivatives by the parameters."""
        tries = [i for i, here in enumerate(shots) if here is not None and not here.by_parameters.size]
        for i, here in zip(tries, self.shots(z, states, tries, whole=True), strict=True):
            shots[i] = here

    def most(self, shots: Sequence[_Shot | None]) -> _Floats:
        """Cost of each cycle above which it does not count, of many that are not alike."""
        recordings = self.problem.recordings
        alike = [recordings[k].waveform.repeats for k, _ in self.targets]
        return np.where(alike, math.inf, CAP * np.median(_costs(shots)))

    def badly(self, shots: Sequence[_Shot | None]) -> list[int]:
        """Cycles that are explained much worse than most."""
        return np.flatnonzero(~(_costs(shots) <= BAD / CAP * self.most(shots))).tolist()

    def equations(
        self, z: _Floats, shots: Sequence[_Shot | None], damping: float
    ) -> tuple[_Floats, _Floats, _Floats]:
        """Normal matrix and gradient of the parameters, and the changes of the states with and without those of the parameters."""
        p = len(self.problem.names)
        matrix, pull = np.zeros((p, p)), np.zeros(p)
        follow = np.zeros((len(shots), 2, p + 1))
        counts = _costs(shots) <= self.most(shots)
        for i, here in enumerate(shots):
            if here is None or not counts[i]:
                continue
            a, n = here.by_parameters, here.by_state
            inner = n.T @ n
            inner += np.eye(2) * (damping + 1e-9) * np.trace(inner) * 0.5
            follow[i] = np.linalg.solve(inner, n.T @ np.column_stack([-a, here.off]))
            matrix += a.T @ (a + n @ follow[i, :, :p])
            pull += a.T @ (here.off - n @ follow[i, :, p])
        off, rows = self.problem.of_known(z)
        matrix += rows.T @ rows
        pull -= rows.T @ off
        return matrix, pull, follow

    def cost(self, z: _Floats, shots: Sequence[_Shot | None]) -> float:
        """Sum of squares, of each cycle at most what counts."""
        off, _ = self.problem.of_known(z)
        return float(np.sum(np.minimum(_costs(shots), self.most(shots))) + off @ off)

    def fitted(self, z: _Floats, states: _Floats | None) -> tuple[_Floats, _Floats, list[_Shot | None]]:
        """Parameters and states that explain the cycles best; if patient, with other rests where these are better, as long as that helps."""
        z, states, shots = self.descended(z, *self.settled(z, states))
        for _ in range(FRESH if self.level.patient else 0):
            before = self.cost(z, shots)
            try:
                others, there = self.settled(z, None)
            except Error:
                break
            for i in np.flatnonzero(_costs(there) < _costs(shots)):
                states[i], shots[i] = others[i], there[i]
            if self.cost(z, shots) > before - GAINED:
                break
            z, states, shots = self.descended(z, states, shots)
        self.complete(z, states, shots)
        return z, states, shots

    def descended(
        self, z: _Floats, states: _Floats, shots: list[_Shot | None]
    ) -> tuple[_Floats, _Floats, list[_Shot | None]]:
        """Parameters and states by Levenberg and Marquardt's method."""
        p = len(self.problem.names)
        cost, damping = self.cost(z, shots), FIRST
        for _ in range(MOST_STEPS):
            if not math.isfinite(cost):
                raise NoCycleError("no stick-slip near this start")
            self.complete(z, states, shots)
            matrix, pull, follow = self.equations(z, shots, damping)
            step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)) + PRIOR * np.eye(p), pull)
            share = min(1.0, LONGEST / max(float(np.abs(step).max()), 1e-300))
            new, after = z.copy(), states.copy()
            new[:p] += share * step
            try:
                after[:, 1:] += share * (follow @ np.append(step, 1.0)) * self.units(new)
                after, there = self.settled(new, after, cost)
                lower = self.cost(new, there)
            except Error:
                lower = math.inf
            if lower < cost:
                ended = cost - lower < ENDS * math.sqrt(cost)
                z, states, shots, cost = new, after, there, lower
                damping = max(0.1 * damping, LEAST)
                if ended:
                    break
            else:
                damping = MORE * max(damping, 100.0 * LEAST)
                if damping > MOST:
                    break
        return z, states, shots


def _costs(shots: Sequence[_Shot | None]) -> _Floats:
    return np.array([math.inf if each is None else each.cost for each in shots])


def _lowest_minima(values: _Floats, count: int) -> NDArray[np.intp]:
    """Where each row has its lowest minima, shape (rows, count), the lowest first; -1 if there are fewer."""
    beside = np.pad(values, ((0, 0), (1, 1 + count)), constant_values=math.inf)
    here = beside[:, 1:-1]
    here = np.where((here <= beside[:, :-2]) & (here <= beside[:, 2:]), here, math.inf)
    found = np.argsort(here, axis=1)[:, :count]
    return np.where(np.take_along_axis(here, found, axis=1) < math.inf, found, -1)


def shot(problem: Problem, start: _Floats, levels: Sequence[Level]) -> Solution:
    """Fit from one start, with smoothing and errors that shrink.

    Raises
    ------
    NoCycleError
        If there is no stick-slip near this start.
    """
    z, states = start, None
    for level in levels:
        shooting = _Shooting(problem, level)
        z, states, shots = shooting.fitted(z, None if level.width else states)
    return _solution(shooting, z, shots)


def shot_at(problem: Problem, z: _Floats) -> Solution:
    """Cost and Jacobian at coordinates, with the states that explain the cycles best."""
    shooting = _Shooting(problem, FINELY[-1])
    states, shots = shooting.settled(z, None)
    shooting.complete(z, states, shots)
    return _solution(shooting, z, shots)


def _solution(shooting: _Shooting, z: _Floats, shots: Sequence[_Shot | None]) -> Solution:
    """Cost and Jacobian of shots of all cycles."""
    problem = shooting.problem
    p = len(problem.names)
    parts, lefts, counts = [], [], _costs(shots) <= shooting.most(shots)
    for k, record in enumerate(problem.recordings):
        bins = record.waveform.used.size
        for i, here in enumerate(shots):
            if shooting.targets[i][0] != k:
                continue
            part, left = np.zeros((bins, z.size)), np.zeros(bins)
            parts.append(part)
            lefts.append(left)
            if here is None or not counts[i]:
                continue
            m = len(here.kept)
            n, off, a = here.by_state[:m], here.off[:m], here.by_parameters[:m]
            if record.waveform.repeats:
                part[here.kept, :p] = a + n @ here.closed[0]
                part[here.kept, p + k] = n @ here.closed[1]
                left[here.kept] = -off
            else:
                # The state of the cycle takes what it can.
                basis, _ = np.linalg.qr(n)
                part[here.kept, :p] = a - basis @ (basis.T @ a)
                left[here.kept] = basis @ (basis.T @ off) - off
        period = np.zeros((1, z.size))
        here = shots[[number for number, _ in shooting.targets].index(k)]
        if here is not None:
            period[0, :p] = here.period
        parts.append(period)
        lefts.append(np.zeros(1))
    cost = shooting.cost(z, shots)
    off, rows = problem.of_known(z)
    parts.append(np.column_stack([rows, np.zeros((len(off), z.size - p))]))
    lefts.append(off)
    return Solution(z, cost, np.vstack(parts), np.concatenate(lefts))


def cost_at(problem: Problem, z: _Floats, level: Level) -> float:
    """Cost of parameters with the states that explain the cycles best; infinite where there is no stick-slip."""
    shooting = _Shooting(problem, level)
    try:
        return shooting.cost(z, shooting.settled(z, None)[1])
    except Error:
        return math.inf


def delayed(problem: Problem, z: _Floats) -> _Floats:
    """With the delays at which the motions of the scenes come nearest to traces whose cycles are alike."""
    z, p = z.copy(), len(problem.names)
    for k, record in enumerate(problem.recordings):
        for _ in range(DELAYS if record.waveform.repeats else 0):
            here = record.residuals(problem.cycles(z, k), 0.0)[:-1]
            there = record.residuals(problem.cycles(z + DELAY * np.eye(z.size)[p + k], k), 0.0)[:-1]
            way = (there - here) / DELAY
            z[p + k] -= np.clip(way @ here / max(float(way @ way), 1e-300), -0.3, 0.3)
    return z


def _run_from(
    problem: Problem, z: _Floats, here: Recording, state: _Floats, time: _Floats, whole: bool
) -> tuple[dict[str, _Floats], dict[str, _Floats]]:
    """Columns of a run from a state, and their changes with the coordinates of the parameters, if whole, and those of the state."""
    p, scene = len(problem.names) if whole else 0, here.scene
    scene = scene.replace(
        initial={"elongation_x": float(state[1]), "elongation_y": float(state[2])},
        scene={"t_end": float(time[-1]), "settle": 0.0},
        output={"fields": ["pull_force", "u_x", "u_y", *(["X"] * (here.waveform.creep_edges.size > 0))]},
    )
    free: dict[str, str] = {}
    if whole:
        free = {name: name for name in problem.heard if name not in CHAIN}
        free |= {tied: name for tied, (name, _) in problem.ties.items()}
    # Without a misalignment nothing moves across.
    ways = [i for i in range(2) if state[1 + i]]
    run = derivatives(scene, [*free, *(f"initial.elongation_{'xy'[i]}" for i in ways)], time)
    turn = np.zeros((len(free) + len(ways), p + 2))
    slopes = problem.slopes(z[: len(problem.names)])
    for i, (key, name) in enumerate(free.items()):
        turn[i, :p] = run.parameters[key] * slopes[problem.names.index(name)]
    turn[len(free) :, p:] = np.diag(_units(here))[ways]
    return run.columns, {name: column @ turn for name, column in run.derivatives.items()}


def _pull(scene: Scene) -> _Floats:
    """How fast the drive stretches the springs of an object at rest [m/s]."""
    phi = math.radians(scene.system.misalignment_deg or 0.0)
    return steady_velocity(scene) * np.array([math.cos(phi), math.sin(phi)])


def _units(here: Recording) -> _Floats:
    """Elongations that the springs need for the swing of a trace [m]."""
    system = here.scene.system
    return here.waveform.swing / np.array([system.stiffness_x or 1.0, system.stiffness_y or 1.0])


@lru_cache(64)
def _smoothing(n: int, width: float) -> _Floats:
    """Matrix that smooths residuals of error one, which keep it."""
    place = np.arange(n)
    kernel = np.exp(-0.5 * ((place[:, np.newaxis] - place) / width) ** 2)
    return np.asarray(kernel / np.sqrt(np.sum(kernel**2, axis=1))[:, np.newaxis])


def _closing(
    here: Recording, state: _Floats, time: _Floats, columns: dict[str, _Floats], changes: dict[str, _Floats]
) -> tuple[_Floats, _Floats, _Floats, tuple[_Floats, _Floats]]:
    """How far a cycle ends from where it began, with its changes; and period and state of a cycle that ends there: their changes."""
    wave, units, p = here.waveform, _units(here), changes["u_x"].shape[1] - 2
    ends = [np.interp(wave.period, time, columns[name]) for name in ("u_x", "u_y")]
    gap = (np.array(ends) - state[1:]) / units
    turns = [[np.interp(wave.period, time, each) for each in changes[name].T] for name in ("u_x", "u_y")]
    ending = np.array(turns) / units[:, np.newaxis] - np.eye(2, p + 2, p)
    along = _pull(here.scene) / units
    across = np.array([-along[1], along[0]]) / np.hypot(*along)
    unknown = np.column_stack([ending[:, p:] @ across, along])
    follow = -np.linalg.lstsq(unknown, ending[:, :p], rcond=1e-12)[0]
    return gap, ending, follow[1] / here.period_error(0.0), (np.outer(across, follow[0]), along * wave.fall)


def _samples(here: Recording, begin: float, end: float, finer: int) -> tuple[_Floats, list[NDArray[np.intp]]]:
    """Times since a rest at which a model is sampled, and which of them are those of a trace, for each of its phases.

    Long bins need few: enough to show the fast oscillation.
    """
    wave, system = here.waveform, here.scene.system
    step = wave.interval / finer
    n = math.ceil((end - begin) / step) + 2 * finer
    period = 2.0 * math.pi * math.sqrt((system.mass or 0.0) / (system.stiffness_y or 1.0))
    widths = np.diff(wave.edges)
    coarser = int(min(period / IN_PERIOD, widths[0] / IN_BIN) / step)
    if has_memory(here.chain) or coarser < 2:
        return step * np.arange(n, dtype=np.float64), [np.arange(k, n, finer) for k in range(finer)]
    # Bins are narrow around the slip.
    fine = wave.edges[np.flatnonzero(widths < NARROW * widths.min())[[0, -1]] + [0, 1]] - begin
    low, high = np.clip((fine / step + [-2.0 * finer, 2.0 * finer]).astype(int), 0, n)
    parts = (np.arange(0, low, coarser), np.arange(low, high), np.arange(high, n + coarser, coarser))
    time = np.concatenate(parts) * step
    first, last = len(parts[0]), len(parts[0]) + len(parts[1])
    coarse = np.append(np.arange(first), np.arange(last, time.size))
    return time, [np.sort(np.append(coarse, np.arange(first + k, last, finer))) for k in range(finer)]


def _shot(
    problem: Problem,
    z: _Floats,
    k: int,
    here: Recording,
    row: _Floats,
    state: _Floats,
    level: Level,
    whole: bool,
) -> _Shot:
    """One cycle of trace k, which is here, from a state: time after the slip [s], elongations [m]; if whole, with the derivatives by
    the parameters.
    """
    problem.runs.append(k)
    p = len(problem.names) if whole else 0
    wave, chain = here.waveform, here.chain
    finer = finer_of(wave, chain) if wave.repeats and level not in COARSELY else 1
    step, begin = wave.interval / finer, float(state[0])
    end = max(wave.edges[-1], begin + wave.period) if wave.repeats else wave.edges[-1]
    # A filter does not know what was before the rest.
    first = int(np.searchsorted(wave.edges, begin + step + (1.0 / chain.filter if chain.filter else 0.0)))
    missing = float(np.count_nonzero(wave.used[:first]))
    if missing > MISSING * np.count_nonzero(wave.used):
        raise NoCycleError("the rest is late in the cycle")
    time, phases = _samples(here, begin, end, finer)
    columns, changes = _run_from(problem, z, here, state, time, whole)
    velocity = steady_velocity(here.scene)
    sense = math.copysign(1.0, velocity)

    def means(values: _Floats, edges: _Floats) -> _Floats:
        return sampled_means(time, values, edges[first:] - begin, phases)

    pull = sense * columns["pull_force"]
    model = means(chain.response(step, pull), wave.edges)
    change = means(chain.response(step, sense * changes["pull_force"].T) - chain.tare, wave.edges)
    for i in (i for i, name in enumerate(problem.names[:p]) if name in CHAIN):
        unit = np.eye(p)[i] * CHAIN_STEP
        chains = (problem.at_values(problem.recordings[k], z[:p] + way * unit).chain for way in (1.0, -1.0))
        more, less = (means(each.response(step, pull), wave.edges) for each in chains)
        change[i] = (more - less) / (2.0 * CHAIN_STEP)
    kept = np.arange(first, wave.time.size)
    if wave.creep_edges.size:
        way = sense * (columns["X"] - velocity * time)
        model = np.append(model, centred(means(way, wave.creep_edges)))
        ways = centred(means(sense * changes["X"].T, wave.creep_edges))
        change = np.hstack([change, ways])
        late = np.arange(wave.time.size + first, row.size)
        kept, row = np.append(kept, late), row.copy()
        row[late] = centred(row[late])
    weights = wave.weights(level.share)[kept] / (1.0 if wave.repeats else math.sqrt(len(wave.rows)))
    off, by = (row[kept] - model) * weights, change.T * weights[:, np.newaxis]
    if level.width:
        kernel = _smoothing(off.size, level.width)
        off, by = kernel @ off, kernel @ by
    period, closed = np.zeros(p), (np.zeros((2, p)), np.zeros(2))
    if wave.repeats:
        gap, ending, period, closed = _closing(here, state, time, columns, changes)
        weight = 1.0 / (EXACT if not level.share else OPEN)
        off, by = np.append(off, -gap * weight), np.vstack([by, ending * weight])
    return _Shot(off, by[:, :p], by[:, p:], kept, missing, period, closed)
