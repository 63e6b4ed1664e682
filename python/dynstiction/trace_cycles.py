"""Stick-slip cycles of a force trace: the same code for measured traces and for runs, robust against noise.

A slip is a fall of the force. Falls are found on a smoothed trace, by turns of more than 30 % of the usual fall; their values
come from the samples themselves. Times are means over a band of the fall; peaks and valleys are values of parabolas fitted
on either side of the fall. No value depends on a single extreme sample, which noise would push outwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._arguments import instance
from ._native import Info
from .errors import FileError
from .record import Described, Table, unit_shown
from .stick_slip import _turns
from .trace import Trace

_Floats = NDArray[np.float64]

FEWEST_CYCLES = 3
"""Least number of whole cycles for a scatter."""
FEWEST_SAMPLES = 20
"""Least number of samples in a cycle."""
MOST_SAMPLES, LEAST_SAMPLES = (5_000, 100), (500, 25)
"""Numbers of samples in a cycle and in its fall above which a trace is averaged, and that are left of one with very many."""
MANY = 1_000_000
"""Number of samples that is not many."""
THRESHOLD = 0.3
"""Share of the usual fall by which the force must turn to count."""
QUIET = 0.02
"""Noise that remains after smoothing, where falls are searched, relative to the range of the force."""
ABOVE_NOISE = 12.0
"""Least size of a fall over the remaining noise. White noise alone reaches 8 to 9 over a million samples."""
WHOLE_PART = 1.0 / 20.0
"""Longest window to smooth over, as a share of the trace."""
BACKWARDS = 3.0
"""A force that rises this many times faster than it falls has the wrong sign."""
MID_BAND, END_BAND = 0.25, 0.05
"""Half widths, as shares of the fall, of the bands over which the times at its middle and at its ends are averaged."""
NEAR_END = 0.1
"""Ends of the fall, as a share of it, between which the slip lasts, and where the windows of the parabolas begin."""
BEYOND = 0.7
"""Distance of the extreme of a harmonic fall from an end of the fall, over the time from this end to its middle."""
FEWEST_FITTED, PARABOLA = 5, 8
"""Least numbers of samples to which a line and a parabola are fitted."""
CURVED = (0.1, 0.6)
"""Shares of the loading time between which the parabola is fitted that gives the start of the loading."""
STRAIGHT = (0.3, 0.6)
"""Shares of the loading time between which the straight line of the loading is fitted."""
FINE = 64
"""Least number of samples in a fall, after refinement by linear interpolation."""
FILTERED, MORE = 4, 1.5
"""Samples after which noise behind a low pass is another, and how much more of it there is then than from one to the next."""
TINY = 1e-290
"""Smallest divisor of a force."""
DRIFTS = 4.0
"""Drift, in standard errors, above which there is a note."""

CYCLE_COLUMNS = (
    Info("slip_time", "s", "middle of the slip that begins the cycle"),
    Info("period", "s", "from slip to slip"),
    Info("peak_force", "N", "peak of the force before the next slip"),
    Info("valley_force", "N", "force from which the loading starts after the slip"),
    Info("swing", "N", "peak minus valley"),
    Info("slip_duration", "s", "time in which the force falls from 90 % to 10 % of the fall"),
    Info("loading_rate", "N/s", "slope of the force from 30 % to 60 % of the loading"),
    Info(
        "creep_share",
        "1",
        "how far the force before slip is below the straight line of the loading, over the swing",
    ),
    Info("slip_length", "m", "displacement in the slip that begins the cycle"),
    Info(
        "lateral_change",
        "N",
        "increase of the lateral force: mean of the last tenth of the loading minus mean of the first",
    ),
)
"""Quantities of a cycle; the last two of a trace with a displacement and with a lateral force."""
TENTH = 0.1


@dataclass(frozen=True, repr=False, eq=False)
class TraceCycles(Table[_Floats]):
    """Table of the stick-slip cycles of a force trace, from each slip to the next.

    Attributes
    ----------
    columns : Described of ndarray, shape (n,)
        ``slip_time`` [s], ``period`` [s], ``peak_force`` [N], ``valley_force`` [N], ``swing`` [N], ``slip_duration`` [s]
        (NaN where the fall takes less than two sampling intervals), ``loading_rate`` [N/s], ``creep_share``; with a
        displacement also ``slip_length`` [m], with a lateral force ``lateral_change`` [N].
    slips : ndarray, shape (n + 1,)
        Middles of all slips [s].
    onsets : ndarray, shape (n + 1,)
        Times at which the slips begin [s], as in a harmonic fall, from the times at 90 % and at the middle of the fall.
    noise : float
        Standard deviation of the noise from sample to sample [N].
    drift : float
        Slope of the middle of the force over time [N/s].
    drift_error : float
        Standard error of the drift [N/s].
    notes : tuple of str
        Cautions about the values.
    """

    columns: Described[_Floats]
    slips: _Floats
    onsets: _Floats
    noise: float
    drift: float
    drift_error: float
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.slips.size) - 1

    def means(self) -> Described[float]:
        """Mean of each column except the times of slip."""
        return self._each(lambda values: float(np.mean(values)))

    def scatter(self) -> Described[float]:
        """Standard deviation (n - 1) of each column except the times of slip."""
        return self._each(lambda values: float(np.std(values, ddof=1)))

    def errors(self) -> Described[float]:
        """Standard error of each mean if cycles are independent; for the period of a regular motion it is too large."""
        return self._each(lambda values: float(np.std(values, ddof=1) / np.sqrt(values.size)))

    def _each(self, of: object) -> Described[float]:
        return Described((info, of(v)) for info, v in self.columns.info() if info.name != "slip_time")  # type: ignore[operator]

    def _values(self) -> tuple[str, str, Described[float]]:
        return f"{len(self)} cycles of a trace", "mean of", self.means()

    def __repr__(self) -> str:
        errors = self.errors()
        units = {name: unit_shown(units) for name, units in self.columns.units.items()}
        lines = [f"{n} = {v:.6g} ± {errors[n]:.2g} {units[n]}".rstrip() for n, v in self.means().items()]
        return "\n  ".join([f"<TraceCycles: {len(self)} cycles", *lines, *self.notes]) + ">"


def noise_level(force: _Floats) -> float:
    """Standard deviation of white noise on a force [N], from the median of its second differences.

    Parameters
    ----------
    force : ndarray, shape (n,)
        Samples at regular times.
    """
    second = np.abs(force[2:] - 2.0 * force[1:-1] + force[:-2])
    if second.size == 0:
        return 0.0
    return float(1.4826 * np.median(second) / np.sqrt(6.0))


def find_cycles(trace: Trace) -> TraceCycles:
    """Stick-slip cycles of a trace.

    Parameters
    ----------
    trace : Trace
        A measured trace, or ``Trace.of`` a run.

    Returns
    -------
    TraceCycles
        One row for each whole cycle, from slip to slip.

    Raises
    ------
    FileError
        If the force is constant, there is no stick-slip above the noise, there are fewer than three whole cycles, too few
        samples in a cycle, or the force seems to have the wrong sign. The text says what to do.
    UsageError
        If this is not a trace.
    """
    trace = instance("trace", trace, Trace, "give what read_trace, Trace or Trace.of returns")
    noise, filtered = (noise_level(trace.force[::step]) for step in (1, FILTERED))
    try:
        falls = _falls(trace, max(noise, filtered))
    except FileError:
        # A coarse trace differs from sample to sample in other ways, too.
        filtered, falls = 0.0, _falls(trace, noise)
    if filtered > MORE * noise:
        noise = filtered
    _refuse_few(trace, falls)
    slips = _slips(trace, falls)
    interval = trace.interval
    rows = [_row(trace, interval, before, after) for before, after in pairwise(slips)]
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    notes = []
    if np.isnan(columns["slip_duration"]).any():
        columns["slip_duration"][:] = np.nan
        notes.append(
            f"slips take less than two sampling intervals ({interval:.3g} s): their duration is not given"
        )
    middle = 0.5 * (columns["peak_force"] + columns["valley_force"])
    drift, drift_error = _slope(columns["slip_time"], middle)
    change = drift * trace.duration
    if abs(drift) > DRIFTS * drift_error and abs(change) > 0.05 * float(np.mean(columns["swing"])):
        notes.append(f"the force drifts by {change:.2g} N over the trace: peaks and valleys change with time")
    return TraceCycles(
        Described([(info, columns[info.name]) for info in CYCLE_COLUMNS if info.name in columns], "table"),
        np.array([slip.time for slip in slips]),
        np.array([slip.onset for slip in slips]),
        noise,
        drift,
        drift_error,
        tuple(notes),
    )


def fine_enough(trace: Trace) -> tuple[Trace, TraceCycles]:
    """A trace with no more samples than its slips need, so that runs need no more, and its cycles."""
    # Of very many samples means are enough, if they resolve the slips.
    for count in (trace.time.size // MANY, 1):
        coarse = trace if count < 2 else trace.averaged(count)
        try:
            cycles = find_cycles(coarse)
        except FileError:
            if count < 2:
                raise
            continue
        fall = 2.0 * float(np.mean(cycles.slips - cycles.onsets))
        in_cycle, in_fall = cycles.means()["period"] / coarse.interval, fall / coarse.interval
        if count < 2 or (in_cycle > LEAST_SAMPLES[0] and in_fall > LEAST_SAMPLES[1]):
            break
    spare = int(min(in_cycle / MOST_SAMPLES[0], in_fall / MOST_SAMPLES[1]))
    if spare < 2:
        return coarse, cycles
    coarse = coarse.averaged(spare)
    return coarse, find_cycles(coarse)


# Finding the falls --------------------------------------------------------------------------------------------------------


def _falls(trace: Trace, noise: float) -> list[tuple[int, int, int, int]]:
    """Samples of each fall: the valley before, or the first sample; peak; valley; next peak, or the last sample."""
    force = trace.force
    extent = float(force.max() - force.min())
    if extent <= 1e-12 * float(np.abs(force).max()):
        raise FileError(
            f"{trace.name}: the force is constant, {force[0]:.6g} N: name the column of the force, or give a trace with stick-slip"
        )
    range_of = float(np.diff(np.percentile(force, (0.5, 99.5)))[0]) or extent
    usual = range_of
    # The noise widens the range of the force; the second pass uses the falls of the first.
    for _ in range(2):
        window = int(np.ceil((noise / (QUIET * usual)) ** 2))
        window = min(window | 1, max(1, int(WHOLE_PART * force.size)) | 1)
        smooth = _smoothed(force, window)
        left = noise / np.sqrt(window)
        least = max(ABOVE_NOISE * left, 0.5 * QUIET * usual)
        usual = _usual_size(np.array([smooth[p] - smooth[v] for _, p, v, _ in _pairs(smooth, least)]))
        if usual == 0.0:
            raise FileError(
                f"{trace.name}: no stick-slip above the noise: the force has no falls beyond {ABOVE_NOISE * left:.3g} N, with a noise "
                f"of {noise:.3g} N a sample: name the column of the force, or give a trace with stick-slip"
            )
        if left <= QUIET * usual:
            break
    return _pairs(smooth, THRESHOLD * usual)


def _pairs(smooth: _Floats, least: float) -> list[tuple[int, int, int, int]]:
    turns = _turns(smooth, least)
    at = [0, *(i for i, _ in turns), smooth.size - 1]
    # A trace that begins in a fall has a valley first.
    return [(at[k], at[k + 1], at[k + 2], at[k + 3]) for k in range(len(turns) - 1) if turns[k][1] > 0]


def _smoothed(force: _Floats, window: int) -> _Floats:
    """The force without spikes of one sample, averaged over a window."""
    low, high = np.minimum(force[:-2], force[2:]), np.maximum(force[:-2], force[2:])
    inner = np.clip(force[1:-1], low, high)
    quiet = np.concatenate([inner[:1], inner, inner[-1:]])
    if window == 1:
        return quiet
    half = window // 2
    sums = np.concatenate([[0.0], np.cumsum(quiet - quiet[0])])
    i = np.arange(quiet.size)
    start, stop = np.maximum(i - half, 0), np.minimum(i + half + 1, quiet.size)
    return np.asarray(quiet[0] + (sums[stop] - sums[start]) / (stop - start))


def _usual_size(sizes: _Floats) -> float:
    """The size above and below which falls have equal sums of sizes: neither many small falls nor one large one change it much."""
    if sizes.size == 0:
        return 0.0
    ordered = np.sort(sizes)
    return float(ordered[np.searchsorted(np.cumsum(ordered), 0.5 * ordered.sum())])


# One slip -----------------------------------------------------------------------------------------------------------------


class _Slip(NamedTuple):
    time: float
    onset: float
    end: float
    duration: float
    peak: float
    last: float
    """Value of the parabola before the fall, at the begin of the fall."""
    valley: float


def _slips(trace: Trace, falls: list[tuple[int, int, int, int]]) -> list[_Slip]:
    """Values of each fall; first from the extremes of the samples, then from the fits on either side of the fall."""
    peaks = [float(np.median(trace.force[max(p - 2, first) : p + 1])) for first, p, _, _ in falls]
    bottoms = [float(np.median(trace.force[v : min(v + 3, last + 1)])) for _, _, v, last in falls]
    times = [_times(trace, *each) for each in zip(falls, peaks, bottoms, strict=True)]
    ends = [late + BEYOND * max(late - middle, 0.0) for _, middle, late in times]
    onsets = [_onset(early, middle) for early, middle, _ in times]
    valleys = [
        _loading_begins(trace, *each)
        for each in zip(ends[:-1], onsets[1:], bottoms[:-1], peaks[1:], strict=True)
    ]
    # The loading after the last slip may have no end.
    valleys.append(bottoms[-1] + float(np.median(np.subtract(valleys, bottoms[:-1]))))
    slips = []
    for fall, end, bottom, top, begin in zip(falls, ends, bottoms, peaks, valleys, strict=True):
        peak, at_onset, valley = top, top, begin if begin < top else bottom
        for _ in range(2):
            early, middle, late = _times(trace, fall, peak, valley)
            onset, size = _onset(early, middle), peak - valley
            found, at_onset = _peak(trace, fall[0], onset, peak - NEAR_END * size, END_BAND * size)
            peak = found if found > valley else peak
        slips.append(_Slip(middle, onset, end, late - early, peak, at_onset, valley))
    return slips


def _onset(early: float, middle: float) -> float:
    return early - BEYOND * max(middle - early, 0.0)


def _times(
    trace: Trace, fall: tuple[int, int, int, int], peak: float, valley: float
) -> tuple[float, float, float]:
    """Times near the beginning of the fall, at its middle and near its end."""
    first, p, v, last = fall
    around = slice(max(p - (v - p), first), min(v + (v - p), last) + 1)
    size = peak - valley
    levels = (
        (peak - NEAR_END * size, END_BAND),
        (valley + 0.5 * size, MID_BAND),
        (valley + NEAR_END * size, END_BAND),
    )
    early, middle, late = (
        _time_above(trace.time, trace.force, around, level, band * size, p, v) for level, band in levels
    )
    return early, middle, late


def _time_above(
    time: _Floats, force: _Floats, around: slice, level: float, band: float, p: int, v: int
) -> float:
    """When the force falls through a level: the mean over a band, so that noise has little effect."""
    t, f = time[around], force[around]
    inner_p, inner_v = p - around.start, v - around.start
    fine = np.linspace(t[0], t[-1], max(FINE * (t.size // max(inner_v - inner_p, 1) + 1), 4 * t.size) + 1)
    share = _share_above(np.interp(fine, t, f), level, band)
    # Before the peak the force is above the level, after the valley below it, whatever the loading does there.
    share[fine <= t[inner_p]] = 1.0
    share[fine >= t[inner_v]] = 0.0
    return float(fine[0] + np.sum(0.5 * (share[1:] + share[:-1])) * (fine[1] - fine[0]))


def _share_above(force: _Floats, level: float, band: float) -> _Floats:
    # Two readings of a coarse converter may be alike: no band is left between them.
    return np.clip((force - (level - band)) / max(2.0 * band, 1e-12 * abs(level), TINY), 0.0, 1.0)


def _peak(trace: Trace, first: int, onset: float, level: float, band: float) -> tuple[float, float]:
    """Largest value of the parabola through the samples before `onset` that are near the peak, and its value at `onset`."""
    stop = int(np.searchsorted(trace.time, onset, side="right"))
    # As many samples as are above the level in total: noise on both sides of the level cancels.
    count = round(float(_share_above(trace.force[first:stop], level, band).sum()))
    inside = slice(max(first, stop - max(count, FEWEST_FITTED)), stop)
    t, f = trace.time[inside] - onset, trace.force[inside]
    if t.size < 2:
        nearest = float(trace.force[max(stop - 1, 0)])
        return nearest, nearest
    c = np.polynomial.polynomial.polyfit(t, f, 2 if t.size >= PARABOLA else 1)
    places = np.array([t[0], 0.0])
    if c.size == 3 and c[2] < 0.0:
        places = np.append(places, np.clip(-0.5 * c[1] / c[2], t[0], 0.0))
    return float(np.max(np.polynomial.polynomial.polyval(places, c))), float(c[0])


def _loading_begins(trace: Trace, end: float, onset: float, bottom: float, peak: float) -> float:
    """Force from which the loading starts: a parabola through a part of it, continued back to the end of the slip.

    A dip at the end of the slip, where friction turns back, and the oscillation after it do not count.
    """
    loading = onset - end
    inside = slice(*np.searchsorted(trace.time, [end + share * loading for share in CURVED]))
    t, f = trace.time[inside] - end, trace.force[inside]
    if t.size < FEWEST_FITTED:
        return bottom
    begin = float(np.polynomial.polynomial.polyfit(t, f, 2 if t.size >= PARABOLA else 1)[0])
    return begin if begin < peak else bottom


def _row(trace: Trace, interval: float, before: _Slip, after: _Slip) -> dict[str, float]:
    """Quantities of a cycle, from one slip to the next."""
    loading = after.onset - before.end
    inside = slice(*np.searchsorted(trace.time, [before.end + share * loading for share in STRAIGHT]))
    t, f = trace.time[inside], trace.force[inside]
    swing = after.peak - before.valley
    rate = lacking = np.nan
    if t.size >= 3:
        rate, _ = _slope(t, f)
        line = float(np.mean(f)) + rate * (after.onset - float(np.mean(t)))
        lacking = (line - after.last) / swing
    row = {
        "slip_time": before.time,
        "period": after.time - before.time,
        "peak_force": after.peak,
        "valley_force": before.valley,
        "swing": swing,
        "slip_duration": before.duration if before.duration >= 2.0 * interval else np.nan,
        "loading_rate": rate,
        "creep_share": lacking,
    }
    if trace.displacement is not None:
        begin, end = np.interp((before.onset, before.end), trace.time, trace.displacement)
        row["slip_length"] = end - begin
    if trace.lateral_force is not None:
        tenth = TENTH * loading
        at = [before.end, before.end + tenth, after.onset - tenth, after.onset]
        i, j, k, m = np.searchsorted(trace.time, at)
        first, last = trace.lateral_force[i : max(j, i + 1)], trace.lateral_force[min(k, m - 1) : m]
        row["lateral_change"] = float(np.mean(last) - np.mean(first))
    return row


def _slope(x: _Floats, y: _Floats) -> tuple[float, float]:
    """Slope of the straight line through points, and its standard error."""
    dx, dy = x - np.mean(x), y - np.mean(y)
    square = float(np.sum(dx**2))
    if x.size < 3 or square == 0.0:
        return 0.0, np.inf
    slope = float(np.sum(dx * dy)) / square
    rest = float(np.sum((dy - slope * dx) ** 2))
    return slope, float(np.sqrt(rest / (x.size - 2) / square))


def _refuse_few(trace: Trace, falls: list[tuple[int, int, int, int]]) -> None:
    cycles = max(len(falls) - 1, 0)
    if cycles < FEWEST_CYCLES:
        raise FileError(
            f"{trace.name}: {cycles} whole cycles ({len(falls)} slips) in {trace.duration:.4g} s: at least {FEWEST_CYCLES} are "
            "needed: give a longer trace"
        )
    period = float(np.median(np.diff([trace.time[p] for _, p, _, _ in falls])))
    samples = period / trace.interval
    if samples < FEWEST_SAMPLES:
        raise FileError(
            f"{trace.name}: {samples:.3g} samples in a cycle of {period:.4g} s: at least {FEWEST_SAMPLES} are needed: sample more often"
        )
    _, p, v, after = trace.time[np.array(falls)].T
    fall, rise = float(np.median(v - p)), float(np.median((after - v)[:-1]))
    if fall > BACKWARDS * rise:
        raise FileError(
            f"{trace.name}: the force rises in {rise:.3g} s and falls in {fall:.3g} s, as if its sign were turned: "
            "give a negative factor as the unit of force"
        )
