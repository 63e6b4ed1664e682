"""The mean waveform of a trace around its slips, as means over bins: of the force, and of the displacement if it was measured; the same
for a measurement and for a model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import UsageError
from ..trace import Trace
from ..trace_cycles import TraceCycles

_Floats = NDArray[np.float64]

FEWEST = 3
"""Least number of cycles for a scatter."""
LEAD = 0.9
"""The window of a cycle begins this share of a period before its slip, and ends a period later."""
CREEP_BINS = 40
"""Number of bins in the creep before the slip. With twice as many, the standard errors change by less than 5 %."""
SLIP_BINS = 25
"""Number of bins in the fall of the force at a slip, if there are as many samples."""
CORNER = 0.1
"""Share of the fall that is left out around the valley, where the force along the pull jumps with the direction of friction and
oscillates."""
CREEP_ENDS, LEAST_CREEP = 1.5, 5
"""The displacement is used up to this before a slip, in durations of the fall: the times of slips have errors; and up to so many edges."""
ALIKE = 3e-3
"""True changes of the period from cycle to cycle, over the period, up to which cycles are alike: the errors of slip times are smaller."""
SWING, FELL = (0.02, 0.98), 0.7
"""Quantiles of the force between which it swings, and the share of the swing over which the duration of a fall is measured."""
SHORT = 0.05
"""If cycles are not alike, windows are as long as the period that this share of them do not reach."""
EXACT = 1e-4
"""Error of a model's means over their range: of sampling and of the fast oscillation."""
NORMAL_MEDIAN = 0.6745
"""Median of the size of a normal variable, over its standard deviation."""
SMOOTHED = 2
"""Number of bins on either side over which the scatter of a bin is averaged."""


@dataclass(frozen=True)
class Waveform:
    """Force over one stick-slip cycle, and its period; and how far the object is ahead of the drive, if that was measured.

    Attributes
    ----------
    edges : ndarray, shape (n + 1,)
        Edges of the bins, time since the slip [s].
    slips : ndarray, shape (cycles,)
        Times of the slips [s].
    rows : ndarray, shape (cycles, n + k)
        What is fitted, of each cycle: mean force of each bin [N]; then, if the displacement was measured, its mean over each of the first
        k bins, the creep, minus that of the drive, minus the mean over these bins [m]. How the object slips is in the force.
    error : ndarray, shape (n + k,)
        Standard error of the mean of `rows` over the cycles.
    used : ndarray of bool, shape (n + k,)
        Which of `rows` count in a fit.
    period, period_error : float
        Mean period and its standard error [s].
    fall : float
        Time in which the force falls from 85 % to 15 % of its swing [s].
    interval : float
        Time between two samples [s].
    repeats : bool
        Whether all cycles are alike, so that their mean contains what they say; else each cycle is explained by itself.
    """

    edges: _Floats
    slips: _Floats
    rows: _Floats
    error: _Floats
    used: NDArray[np.bool_]
    period: float
    period_error: float
    fall: float
    interval: float
    repeats: bool

    @property
    def cycles(self) -> _Floats:
        """Mean force of each bin in each cycle [N], shape (cycles, n)."""
        return self.rows[:, : self.edges.size - 1]

    @property
    def ahead(self) -> _Floats:
        """How far the object is ahead of the drive in the creep of each cycle [m], shape (cycles, k); k = 0 if that was not measured."""
        return self.rows[:, self.edges.size - 1 :]

    @property
    def model_error(self) -> _Floats:
        """The part of `errors` that is a model's."""
        return EXACT * self.sizes

    @property
    def errors(self) -> _Floats:
        """Standard errors of the means of `rows`, and of a model's."""
        return np.asarray(np.hypot(self.error, self.model_error))

    @property
    def sizes(self) -> _Floats:
        """Swing of the quantity of each of `rows`."""
        parts = (self.cycles, self.ahead)
        return np.concatenate(
            [np.full(each.shape[1], np.ptp(each.mean(axis=0))) for each in parts if each.size]
        )

    def weights(self, coarse: float) -> _Floats:
        """Inverse errors of the means of `rows`, with a share `coarse` of the swing added to the errors; 0 for what does not count."""
        return np.asarray(self.used / np.hypot(self.errors, coarse * self.sizes))

    @property
    def creep_edges(self) -> _Floats:
        """Edges of the bins of the displacement [s]; none without one."""
        return self.edges[: self.ahead.shape[1] + 1] if self.ahead.size else self.edges[:0]

    @property
    def mean(self) -> _Floats:
        """Mean over the cycles [N], shape (n,)."""
        return np.asarray(self.cycles.mean(axis=0))

    @property
    def time(self) -> _Floats:
        """Middles of the bins, time since the slip [s], shape (n,)."""
        return np.asarray(0.5 * (self.edges[1:] + self.edges[:-1]))

    @property
    def swing(self) -> float:
        """Highest bin minus lowest bin [N]."""
        return float(np.ptp(self.mean))


def bin_means(time: _Floats, force: _Floats, edges: _Floats) -> _Floats:
    """Means over bins of the straight lines between samples: shape (..., n) for edges of the shape (..., n + 1) inside the samples' times,
    or, of one row of edges, for forces of the shape (..., samples).
    """
    steps = np.diff(time)
    total = np.zeros(force.shape)
    np.cumsum(0.5 * (force[..., 1:] + force[..., :-1]) * steps, axis=-1, out=total[..., 1:])
    k = np.clip(np.searchsorted(time, edges, side="right") - 1, 0, time.size - 2)
    past = edges - time[k]
    slope = (force[..., k + 1] - force[..., k]) / steps[k]
    integral = total[..., k] + past * (force[..., k] + 0.5 * past * slope)
    return np.asarray(np.diff(integral) / np.diff(edges))


def centred(values: _Floats) -> _Floats:
    """Without the mean over the bins (last axis): only changes of a displacement are compared."""
    return np.asarray(values - values.mean(axis=-1, keepdims=True))


def waveform_of(trace: Trace, cycles: TraceCycles, velocity: float) -> Waveform:
    """Waveform of a trace with these cycles, at a drive velocity |V| [m/s].

    Raises
    ------
    UsageError
        If fewer than three slips have a whole cycle around them in the trace.
    """
    time, force, slips, noise = trace.time, trace.force, cycles.slips, cycles.noise
    interval = trace.interval
    periods = np.diff(slips)
    period = float(np.mean(periods))
    fall = _fall(time, force, slips, period)
    # Not more than that of one sample: cycles that alternate look like slips whose times have errors.
    timing = np.hypot(noise * fall / (FELL * np.ptp(np.quantile(force, SWING))), interval)
    repeats = _true_changes(periods, timing)[1] <= (ALIKE * period) ** 2
    edges = _edges(period if repeats else float(np.quantile(periods, SHORT)), fall, interval)
    whole = whole_cycles(trace, slips, edges)
    if len(whole) < FEWEST:
        raise UsageError(
            f"{trace.name}: {len(whole)} slips have a whole cycle of {period:.4g} s around them: at least {FEWEST} are needed"
        )
    at = edges + whole[:, np.newaxis]
    rows = bin_means(time, force, at)
    error = _error(rows, noise, edges, interval, repeats)
    middle = 0.5 * (edges[1:] + edges[:-1])
    mean = rows.mean(axis=0)
    after = np.flatnonzero(middle > 0.0)
    valley = middle[after[np.argmin(mean[after])]]
    used = np.abs(middle - valley) > max(3.0 * interval, CORNER * fall)
    if trace.displacement is not None:
        way = trace.displacement - velocity * time
        creep = edges[: max(LEAST_CREEP, int(np.count_nonzero(edges < -CREEP_ENDS * fall)))]
        ahead = centred(bin_means(time, way, at[:, : creep.size]))
        # Second differences show the noise alone.
        way_noise = float(np.median(np.abs(np.diff(way, 2)))) / NORMAL_MEDIAN / np.sqrt(6.0)
        error = np.append(error, _error(ahead, way_noise, creep, interval, repeats))
        rows, used = np.hstack([rows, ahead]), np.append(used, np.full(creep.size - 1, True))
    period_error = _period_error(periods, timing)
    return Waveform(edges, whole, rows, error, used, period, period_error, fall, interval, repeats)


def without_drift(trace: Trace, slips: _Floats) -> Trace:
    """A trace without a constant drift of its zero, which stays as it is in the middle: that of the means over its cycles."""
    rate = np.polyfit(0.5 * (slips[1:] + slips[:-1]), bin_means(trace.time, trace.force, slips), 1)[0]
    return replace(trace, force=trace.force - rate * (trace.time - trace.time.mean()))


def whole_cycles(trace: Trace, slips: _Floats, edges: _Floats) -> _Floats:
    """Slips that have a whole cycle around them in a trace [s]."""
    return np.asarray(slips[(slips + edges[0] >= trace.time[0]) & (slips + edges[-1] <= trace.time[-1])])


def _error(rows: _Floats, noise: float, edges: _Floats, interval: float, repeats: bool) -> _Floats:
    """Standard error of the mean over cycles: from the noise of the samples, and, if they are alike, from their scatter."""
    width = np.diff(edges) / interval
    # Of the mean of straight lines between samples, over all phases of the bin; 7/15 is the mean size of the sum of four uniform errors.
    white = noise**2 * (width - 7.0 / 15.0) / width**2
    scatter = smoothed(rows.var(axis=0, ddof=1)) if repeats else 0.0
    return np.asarray(np.sqrt(np.maximum(white, scatter) / len(rows)))


def _fall(time: _Floats, force: _Floats, slips: _Floats, period: float) -> float:
    """Median time from 85 % to 15 % of the swing."""
    low, high = np.quantile(force, SWING)
    lengths = []
    for slip in slips:
        begin = np.searchsorted(time, slip - 0.4 * period, side="right")
        near = slice(begin, np.searchsorted(time, slip + 0.4 * period))
        t, share = time[near], (force[near] - low) / (high - low)
        before = t[(t <= slip) & (share > 0.5 * (1.0 + FELL))]
        after = t[(t >= slip) & (share < 0.5 * (1.0 - FELL))]
        if before.size and after.size:
            lengths.append(after[0] - before[-1])
    return float(np.median(lengths)) if lengths else 0.02 * period


def _edges(period: float, fall: float, interval: float) -> _Floats:
    step = max(interval, fall / SLIP_BINS)
    first, last = -LEAD * period, (1.0 - LEAD) * period
    near = np.arange(max(-2.0 * fall, 0.5 * first), min(3.0 * fall, last), step)
    creep = np.linspace(
        first, near[0], min(CREEP_BINS, max(2, int((near[0] - first) / step))), endpoint=False
    )
    rest = np.linspace(near[-1], last, 9)[1:] if last - near[-1] > 8.0 * step else np.array([])
    return np.concatenate([creep, near, rest])


def smoothed(variance: _Floats) -> _Floats:
    """Variances of bins, averaged over neighbours."""
    width = 2 * SMOOTHED + 1
    return np.convolve(np.pad(variance, SMOOTHED, mode="edge"), np.ones(width) / width, mode="valid")


def _true_changes(periods: _Floats, most: float) -> tuple[float, float]:
    """Variance of the error of a slip's time [s^2], which is at most so large [s], and that of the true changes of the period.

    The periods have the variance d^2 + 2 e^2 and the covariance -e^2 of neighbours, with e the error of a time.
    """
    n = periods.size
    off = periods - periods.mean()
    variance = float(off @ off) / max(n - 1, 1)
    timing = min(max(0.0, -float(off[1:] @ off[:-1]) / max(n - 1, 1)), most**2)
    return timing, max(0.0, variance - 2.0 * timing)


def _period_error(periods: _Floats, most: float) -> float:
    """Standard error of the mean period: errors of the times of slips cancel from cycle to cycle, true changes do not."""
    n = periods.size
    timing, changes = _true_changes(periods, most)
    return max(float(np.sqrt((2.0 * timing + n * changes) / n**2)), 1e-7 * float(periods.mean()))
