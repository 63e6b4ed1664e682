"""What is free, what was measured, and the residuals between both: the same for one trace and several, and for every model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _native
from ..errors import Error
from ..scene import Scene
from ..trace import Chain, Trace
from ..trace_cycles import TraceCycles
from .models import Cycles, NoCycleError, full_cycles, slow_cycles, slow_scene
from .solve import FAILED, Solution, derivatives, has_failed, least_squares_of, spread
from .waveform import Waveform, smoothed

_Floats = NDArray[np.float64]

STATIC, KINETIC, VELOCITY = "friction.mu_static", "friction.mu_0", "friction.v_f"
WEAKENING = (KINETIC, "friction.mu_inf", VELOCITY)
HELD = 1e-3
"""Relative error with which a value is held."""
CHAIN = {"chain.tare": "N", "chain.filter": "Hz", "chain.gain": "1"}
"""What can be free of a measuring chain, and its units."""
HUGE = 300.0
"""Logarithm of what is no coefficient of friction."""
LEAST_DROP = 1e-3
"""Least weakening at the start of a fit, as a share of mu_0."""
PRIOR = 2.3
"""Standard deviation of the prior of a logarithm about its start: a factor of ten."""
OPEN = 1e4
"""The same of a delay, whose prior must not hold what is shifted with it: a zero."""
FEW = 10
"""Number of cycles that a search uses of many that are not alike."""
NEIGHBOURS = 4
"""Number of cycles between which and the nearest one a measured cycle is sought."""
MOST_OF_ONE = 3.0
"""Largest sum of squares of one cycle, over the median of all."""
MOST_DELAY = 0.3
"""Largest error of a slip's time, over the duration of the fall."""
STEP, OWN_STEP = 1e-4, 5e-3
"""Changes of a coordinate for a derivative: of the slow model, and of the scene's own, whose runs are sampled."""
BAD = 0.3
"""Mean square of the residuals with the first added error above which a search is given up: it leads nowhere."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One trace of a fit.

    Attributes
    ----------
    scene : Scene
        The scene with the values that are this trace's own.
    chain : Chain
        Its measuring chain.
    trace : Trace
        The trace.
    cycles : TraceCycles
        Its cycles.
    waveform : Waveform
        What is fitted.
    """

    scene: Scene
    chain: Chain
    trace: Trace
    cycles: TraceCycles
    waveform: Waveform

    def changed(self, values: Mapping[str, Any]) -> Recording:
        """The same with other values of its scene and chain, by ``group.key``."""
        of_chain: Any = {name.partition(".")[2]: value for name, value in values.items() if name in CHAIN}
        others: Any = {name: value for name, value in values.items() if name not in CHAIN}
        return replace(self, scene=self.scene.replace(**others), chain=replace(self.chain, **of_chain))

    @property
    def size(self) -> int:
        """Number of residuals: of each bin, and of the period."""
        return (1 if self.waveform.repeats else len(self.waveform.rows)) * self.waveform.used.size + 1

    def residuals(self, model: Cycles, coarse: float) -> _Floats:
        """Weighted residuals of a model's cycles, the period last."""
        wave = self.waveform
        weights = wave.weights(coarse)
        if wave.repeats:
            off = (model.rows.mean(axis=0) - wave.rows.mean(axis=0)) * weights
        else:
            off = -explained_by_each(wave, model, weights / math.sqrt(len(wave.rows))).ravel()
        return np.append(off, (model.period - wave.period) / self.period_error(coarse))

    def period_error(self, coarse: float) -> float:
        """Standard error of the period [s], with a share `coarse` of it added."""
        return math.hypot(self.waveform.period_error, coarse * self.waveform.period)

    def explained(self, model: Cycles) -> _Floats:
        """The model's rows as they explain each cycle; one row if cycles repeat."""
        wave = self.waveform
        if wave.repeats:
            return np.asarray(model.rows.mean(axis=0, keepdims=True))
        weights = wave.weights(0.0) + 1e-12
        return np.asarray(wave.rows - explained_by_each(wave, model, weights) / weights)

    def misfit(
        self, model: Cycles | None, parameters: int, left: _Floats | None = None
    ) -> tuple[float, float]:
        """Mean square of a model's residuals over that expected from the scatter of the cycles, and the probability of such a misfit.

        With what is left of each weighted row, if that is known, no model is needed.
        """
        from scipy.stats import f  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

        wave = self.waveform
        n = len(wave.rows)
        weights = wave.weights(0.0)
        scatter = wave.rows.var(axis=0, ddof=1) / n if wave.repeats else wave.errors**2
        if left is not None:
            left = left.reshape(-1, weights.size)
            residual = left.sum(axis=0) / math.sqrt(len(left))
            if not wave.repeats:
                scatter = smoothed(left.var(axis=0, ddof=1)) * wave.errors**2
        elif model is not None:
            residual = (wave.rows - self.explained(model)).mean(axis=0) * weights
        expected = float(np.sum((scatter + wave.model_error**2) * weights**2))
        used = int(np.count_nonzero(wave.used))
        free = max(used - parameters - 1, 1)
        misfit = float(residual @ residual) / expected * used / free
        return misfit, float(f.sf(misfit, free, used * (n - 1)))

    def of_few_cycles(self) -> Recording:
        """With about `FEW` of the cycles, if they are not alike."""
        wave = self.waveform
        rows = wave.rows[:: max(1, len(wave.rows) // FEW)]
        if wave.repeats or len(rows) == len(wave.rows):
            return self
        error = wave.error * math.sqrt(len(wave.rows) / len(rows))
        return replace(self, waveform=replace(wave, rows=rows, error=error))

    def of_mean(self) -> Recording:
        """With the mean of the cycles for one that repeats."""
        wave = self.waveform
        if wave.repeats:
            return self
        scatter = smoothed(wave.rows.var(axis=0, ddof=1)) / len(wave.rows)
        return replace(self, waveform=replace(wave, repeats=True, error=np.sqrt(wave.error**2 + scatter)))

    def reweighted(self, model: Cycles) -> Recording:
        """With the scatter of the cycles about those of the model as their error, if they are not alike."""
        wave = self.waveform
        if wave.repeats:
            return self
        weights = np.where(wave.used, wave.weights(0.0), 1.0)
        rest = explained_by_each(wave, model, wave.weights(0.0)) / weights
        scatter = np.sqrt(smoothed(np.where(wave.used, rest.var(axis=0, ddof=1), 0.0)) / len(rest))
        return replace(self, waveform=replace(wave, error=np.maximum(wave.error, scatter)))


def apart_in_time(wave: Waveform, model: Cycles, weights: _Floats) -> tuple[_Floats, _Floats]:
    """Squares of the weighted difference of each measured cycle and each of the model, which is taken so much later [s]; both of shape
    (cycles, cycles of the model).
    """
    rows, those, later = wave.rows * weights, model.rows * weights, model.later * weights
    steep, most = _steepness(later), MOST_DELAY * wave.fall
    along = rows @ later.T - np.sum(those * later, axis=1)
    shift = np.clip(along / steep, -most, most)
    apart = np.sum(rows**2, axis=1)[:, np.newaxis] - 2.0 * rows @ those.T + np.sum(those**2, axis=1)
    return apart - 2.0 * shift * along + shift**2 * steep, shift


def _steepness(later: _Floats) -> _Floats:
    return np.asarray(np.maximum(np.sum(later**2, axis=1), 1e-300))


def explained_by_each(wave: Waveform, model: Cycles, weights: _Floats) -> _Floats:
    """Weighted difference of each measured cycle and the model's cycle that is nearest to it, shape (cycles, bins).

    A slow cycle begins with one number, so that a model's cycles form a line: between the nearest one and its neighbours it is straight.
    The time of a measured slip has an error, along the derivative of the cycle with time.
    """
    rows, those, later = wave.rows * weights, model.rows * weights, model.later * weights
    steep = _steepness(later)
    apart, shift = apart_in_time(wave, model, weights)
    order = np.argsort(apart, axis=1)[:, : NEIGHBOURS + 1]
    nearest = order[:, 0]
    off = rows - those[nearest] - np.take_along_axis(shift, order[:, :1], axis=1) * later[nearest]
    best, least = off, np.sum(off**2, axis=1)
    for k in order.T[1:]:
        # The way to a neighbour, without its part along time.
        way = those[k] - those[nearest]
        way -= (np.sum(way * later[nearest], axis=1) / steep[nearest])[:, np.newaxis] * later[nearest]
        share = np.clip(np.sum(off * way, axis=1) / np.maximum(np.sum(way**2, axis=1), 1e-300), 0.0, 1.0)
        there = off - share[:, np.newaxis] * way
        cost = np.sum(there**2, axis=1)
        best = np.where((cost < least)[:, np.newaxis], there, best)
        least = np.minimum(cost, least)
    # A cycle from where the model's are rare has none near.
    share = np.minimum(1.0, MOST_OF_ONE * np.median(least) / np.maximum(least, 1e-300))
    return np.asarray(best * np.sqrt(share)[:, np.newaxis])


@dataclass(frozen=True, eq=False)
class Problem:
    """Free parameters and traces. The coordinates z are those of the parameters, and the delay of the slips of each trace over its fall.

    Each free parameter has a name, ``group.key``, and a value with which it begins. What is `known`, `bounds` and `ties` are those of `fit`;
    `runs` has the trace of each run so far.
    """

    names: tuple[str, ...]
    begin: _Floats
    known: Mapping[str, tuple[float, float]]
    bounds: Mapping[str, tuple[float, float]]
    ties: Mapping[str, tuple[str, float]]
    recordings: tuple[Recording, ...]
    runs: list[int] = field(default_factory=list)

    @property
    def is_slow(self) -> bool:
        """Whether the model is low_frequency."""
        return self.model == "low_frequency"

    @property
    def model(self) -> str:
        """The model of the scenes."""
        return str(self.recordings[0].scene.scene.model or "full")

    @property
    def repeats(self) -> bool:
        """Whether the cycles of each trace are alike."""
        return all(each.waveform.repeats for each in self.recordings)

    @property
    def noise(self) -> int:
        """What noise costs: the number of bins of the mean, or, if each cycle is explained by itself, of all cycles."""
        waves = [each.waveform for each in self.recordings]
        return sum(int(np.count_nonzero(w.used)) * (1 if w.repeats else len(w.rows)) for w in waves)

    def of_slow_model(self) -> Problem:
        """The same for the slow model."""
        recordings = tuple(replace(each, scene=slow_scene(each.scene)) for each in self.recordings)
        return replace(self, recordings=recordings, runs=[])

    def of_few_cycles(self) -> Problem:
        """The same with every so many of the cycles that are not alike: for a search."""
        if self.repeats:
            return self
        return replace(self, recordings=tuple(each.of_few_cycles() for each in self.recordings))

    def of_means(self) -> Problem:
        """The same with the means of cycles that are not alike for some that are."""
        return replace(self, recordings=tuple(each.of_mean() for each in self.recordings), runs=[])

    def holding(self, values: Mapping[str, float]) -> Problem:
        """The same with some parameters held at these values."""
        held = {name: (value, HELD * abs(value)) for name, value in values.items()}
        return replace(self, known={**self.known, **held})

    @cached_property
    def heard(self) -> tuple[str, ...]:
        """Parameters that the model has: the slow one lacks some, and sees no filter."""
        if not self.is_slow:
            return self.names
        groups = self.recordings[0].scene.groups()
        keys = {f"{group}.{key}" for group, values in groups.items() for key in values}
        return tuple(name for name in self.names if name in {*keys, "chain.tare", "chain.gain"})

    def changed(self, names: tuple[str, ...], changes: Mapping[str, Any]) -> Problem:
        """The same with other values of the rig or its chain, and other free parameters, which begin as here or at these values."""
        begin = {**dict(zip(self.names, self.begin, strict=True)), **changes}
        return replace(
            self,
            names=names,
            begin=np.array([float(begin[name]) for name in names]),
            known={name: value for name, value in self.known.items() if name in names},
            bounds={name: ends for name, ends in self.bounds.items() if name in names},
            recordings=tuple(each.changed(changes) for each in self.recordings),
            runs=[],
        )

    @property
    def weakening(self) -> tuple[int, int, int] | None:
        """Indices of mu_0, mu_inf and v_f, if all three are free."""
        if not set(WEAKENING) <= set(self.names):
            return None
        i, j, k = (self.names.index(name) for name in WEAKENING)
        return i, j, k

    @property
    def scales(self) -> _Floats:
        """Unit of each parameter that is no logarithm [N], NaN for the others."""
        swing = self.recordings[0].waveform.swing
        return np.array([swing if name == "chain.tare" else np.nan for name in self.names])

    def coordinates(self, values: _Floats) -> _Floats:
        """Coordinates of parameters, without delays.

        mu_inf is replaced by (mu_0 - mu_inf)/v_f: creep depends on the slope of friction only, which hardly distinguishes mu_inf from v_f,
        and in these coordinates the valley of good fits is straight.
        """
        linear = np.isfinite(self.scales)
        q = np.where(linear, values / self.scales, np.log(np.abs(np.where(linear, 1.0, values))))
        if self.weakening:
            i, j, k = self.weakening
            q[j] = math.log(max(math.exp(q[i]) - math.exp(q[j]), LEAST_DROP * math.exp(q[i]))) - q[k]
        return np.asarray(q)

    def logarithms(self, q: _Floats) -> _Floats:
        """Logarithms of the parameters (of the tare: the tare over the swing) from their coordinates."""
        z = q.copy()
        if self.weakening:
            i, j, k = self.weakening
            # A step of a fit may lead beyond the largest number.
            if q[i] > HUGE:
                raise NoCycleError("mu_0 would be beyond all numbers")
            limit = math.exp(q[i]) - math.exp(min(q[j] + q[k], q[i] + 1.0))
            if limit <= 0.0:
                raise NoCycleError("mu_inf would be negative")
            z[j] = math.log(limit)
        return z

    def slopes(self, q: _Floats) -> _Floats:
        """Derivatives of `logarithms`, shape (p, p)."""
        slopes = np.eye(q.size)
        if self.weakening:
            i, j, k = self.weakening
            top, drop = math.exp(q[i]), math.exp(q[j] + q[k])
            slopes[j, [i, j, k]] = np.array([top, -drop, -drop]) / (top - drop)
        return slopes

    def values(self, q: _Floats) -> _Floats:
        """Values of the parameters from their coordinates."""
        z = self.logarithms(q)
        linear = np.isfinite(self.scales)
        sizes = np.exp(np.where(linear, 0.0, z))
        values = np.where(linear, z * self.scales, np.copysign(sizes, self.begin))
        if STATIC in self.names and KINETIC not in self.ties:
            # At its end a static limit is the kinetic one; beyond, what is as far above it: the cost has no plateau.
            i, begin = self.names.index(STATIC), self.recordings[0].scene.friction.mu_0
            least = values[self.names.index(KINETIC)] if KINETIC in self.names else float(begin or 0.0)
            values[i] = least + abs(values[i] - least)
        ends = np.array([self.bounds.get(name, (-math.inf, math.inf)) for name in self.names])
        return np.asarray(np.clip(values, *ends.T))

    def named(self, z: _Floats) -> dict[str, float]:
        """Values of the parameters by name, from all coordinates or those without delays."""
        return dict(zip(self.names, map(float, self.values(z[: len(self.names)])), strict=True))

    def place(self, values: Mapping[str, float]) -> _Floats:
        """All coordinates of values by name, the others as they begin, without delays."""
        begin = zip(self.names, self.begin, strict=True)
        here = self.coordinates(np.array([values.get(name, value) for name, value in begin]))
        return np.append(here, np.zeros(len(self.recordings)))

    def moved(self, z: _Floats, changes: _Floats) -> _Floats:
        """Coordinates after changes of the logarithms of the parameters, of a tare over the swing."""
        p, unit = len(self.names), self.scales
        values = self.values(z[:p])
        there = np.where(np.isfinite(unit), values + unit * changes, values * np.exp(changes))
        return np.append(self.coordinates(there), z[p:])

    def cheapest(self, starts: Sequence[_Floats], coarse: float) -> list[_Floats]:
        """Coordinates in the order of their cost, with a share that is added to the errors."""
        costs = [
            math.inf if has_failed(there) else float(np.sum(there**2))
            for there in spread(lambda z: self.residuals(z, coarse), starts)
        ]
        return [starts[i] for i in np.argsort(costs, kind="stable")]

    def at_values(self, recording: Recording, q: _Floats) -> Recording:
        """A trace with the values at these coordinates in its scene and chain."""
        values = {name: value for name, value in self.named(q).items() if name in self.heard}
        values |= {tied: by * values[name] for tied, (name, by) in self.ties.items() if name in values}
        return recording.changed(values)

    def cycles(self, z: _Floats, k: int, patient: bool = True) -> Cycles:
        """Cycles of the model for trace k; a patient run may take very long to settle."""
        p = len(self.names)
        self.runs.append(k)
        recording = self.recordings[k]
        delay = float(z[p + k]) * recording.waveform.fall if recording.waveform.repeats else 0.0
        here = self.at_values(recording, z[:p])
        model = slow_cycles if self.is_slow else full_cycles
        return model(here.scene, here.waveform, delay, here.chain, patient)

    def residuals(self, z: _Floats, coarse: float) -> _Floats:
        """Weighted residuals of all traces, each with its period last, then those of known values."""
        parts: list[ArrayLike] = []
        try:
            for k, recording in enumerate(self.recordings):
                parts.append(recording.residuals(self.cycles(z, k, coarse == 0.0), coarse))
            parts.append(self.of_known(z)[0])
        except Error:
            return np.full(sum(each.size for each in self.recordings) + len(self.known), FAILED)
        return np.nan_to_num(np.concatenate(parts), nan=FAILED, posinf=FAILED, neginf=-FAILED)

    def of_known(self, z: _Floats) -> tuple[_Floats, _Floats]:
        """Weighted residuals of known values, and their derivatives with the coordinates of the parameters."""
        values, slopes, unit = self.named(z), self.slopes(z[: len(self.names)]), self.scales
        off = [(values[name] - value) / error for name, (value, error) in self.known.items()]
        rows = np.zeros((len(off), len(self.names)))
        for row, (name, (_, error)) in zip(rows, self.known.items(), strict=True):
            i = self.names.index(name)
            row[:] = slopes[i] * (unit[i] if math.isfinite(unit[i]) else values[name]) / error
        return np.array(off), rows

    @property
    def step(self) -> float:
        """Change of a coordinate for a derivative."""
        return STEP if self.is_slow else OWN_STEP

    def improved(self, start: _Floats, levels: Sequence[float]) -> Solution:
        """Several fits, one after another, with errors that shrink to those of the traces; the first alone if it ends far from these."""
        z = start
        for coarse in levels[:-1]:
            found = least_squares_of(self, z, coarse, last=False)
            z = found.z
            if coarse == levels[0] and found.cost > BAD * found.jacobian.shape[0]:
                return self.at(z, levels[-1])
        return least_squares_of(self, z, levels[-1])

    def at(self, z: _Floats, coarse: float = 0.0, step: float | None = None) -> Solution:
        """Cost and Jacobian at coordinates."""
        here = self.residuals(z, coarse)
        jacobian = derivatives(
            lambda there: self.residuals(there, coarse), z, here, step or self.step, central=True
        )
        return Solution(z, float(here @ here), jacobian)

    def misfit(self, z: _Floats, left: _Floats | None = None) -> tuple[float, float]:
        """The worst misfit of all traces, and the smallest probability; with the residuals that are left, if they are known."""
        each, begin = [], 0
        for k, recording in enumerate(self.recordings):
            part = None if left is None else left[begin : begin + recording.size - 1]
            model = self.cycles(z, k) if part is None else None
            each.append(recording.misfit(model, len(self.names), part))
            begin += recording.size
        return max(misfit for misfit, _ in each), min(chance for _, chance in each)

    @property
    def priors(self) -> _Floats:
        """Standard deviations of the priors of all coordinates."""
        return np.repeat([PRIOR, OPEN], [len(self.names), len(self.recordings)])

    def root(self, jacobian: _Floats) -> _Floats:
        """A root R of the inverse normal matrix R Rᵀ, with the prior that each parameter is known to a factor of ten.

        From the Jacobian itself: of the normal matrix roundoff may leave no definite one.
        """
        _, sizes, axes = np.linalg.svd(np.vstack([jacobian, np.diag(1.0 / self.priors)]), full_matrices=False)
        return np.asarray(axes.T / sizes)

    def covariance(self, found: Solution) -> tuple[_Floats, _Floats, float]:
        """Covariance of logarithms and delays from the scatter of the cycles, inverse normal matrix, largest correlation of one cycle with the next."""
        p = found.z.size
        turn = np.eye(p)
        turn[: len(self.names), : len(self.names)] = self.slopes(found.z[: len(self.names)])
        root = self.root(found.jacobian)
        inverse = root @ root.T
        # What each cycle does to the gradient, and how a parameter's changes by one cycle and the next are related.
        rows: list[_Floats] = []
        related = np.zeros(p)
        begin = 0
        for k, recording in enumerate(self.recordings):
            wave, n = recording.waveform, len(recording.waveform.rows)
            part = found.jacobian[begin : begin + recording.size]
            begin += recording.size
            if wave.repeats:
                pulls = (wave.rows - wave.rows.mean(axis=0)) * wave.weights(0.0) @ part[:-1] / n
            else:
                if found.left is None:
                    off = -explained_by_each(wave, self.cycles(found.z, k), wave.weights(0.0) / math.sqrt(n))
                else:
                    off = found.left[begin - len(part) : begin - 1].reshape(n, -1)
                pulls = np.einsum("ij,ijk->ik", off, part[:-1].reshape(n, -1, p))
            lost = 1 if wave.repeats else len(self.names)
            rows += [pulls * math.sqrt(n / max(n - lost, 1)), part[-1:]]
            moves = pulls @ inverse
            moves = moves - moves.mean(axis=0)
            sizes = np.maximum(np.sum(moves**2, axis=0), 1e-300)
            one = np.sum(moves[1:] * moves[:-1], axis=0) / sizes
            related = np.maximum(related, np.where(one > 2.0 / math.sqrt(n), one, 0.0))
        # Blocks of n cycles scatter by (1 + r)/(1 - r) as much as independent ones.
        changes = np.vstack([*rows, found.jacobian[begin:]]) @ inverse
        changes *= np.sqrt((1.0 + related) / (1.0 - np.minimum(related, 0.9)))
        if not self.repeats:
            # What noise there is in each cycle is known: some forty cycles may scatter by less. No such cycle hangs on the delays.
            free = range(len(self.names))
            least = np.diag(inverse)[free] / np.maximum(np.sum(changes[:, free] ** 2, axis=0), 1e-300)
            changes[:, free] *= np.sqrt(np.maximum(1.0, least))
        changes = changes @ turn.T
        return changes.T @ changes, turn @ inverse @ turn.T, float(related.max())


def unit_of(name: str) -> str:
    """Unit of a parameter."""
    if name in CHAIN:
        return CHAIN[name]
    group, _, key = name.partition(".")
    return _native.key_info(group, key).units
