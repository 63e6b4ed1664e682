"""Stick-slip, cycle by cycle, from the samples and events of a result.

The definitions are those of the core's summary (src/results/cycles.f90).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._arguments import instance
from ._native import Info
from ._slider import drive_of
from .errors import Error, UsageError
from .record import SLIP_BEGINS, STICK_BEGINS, Described, Table
from .result import Result
from .scene import Scene

THRESHOLD = 0.01
"""Share of the static limit mu_0 W by which the load must fall or rise to count."""

_Floats = NDArray[np.float64]

COLUMNS = (
    Info("peak_time", "s", "time of the peak of the load, where the slip begins"),
    Info("peak_force", "N", "peak of the load: k_x u_x, positive where the drive pulls"),
    Info("valley_time", "s", "time of the valley that follows"),
    Info("valley_force", "N", "valley of the load"),
    Info("slip_duration", "s", "from peak to valley"),
    Info("slip_length", "m", "advance in X from peak to valley, positive with the drive"),
    Info("stick_duration", "s", "from valley to the next peak: dynamic stiction"),
    Info("period", "s", "from peak to the next peak"),
    Info("rests", "1", "number of times that the object came to rest, from peak to the next peak"),
    Info("rest_time", "s", "time at rest, from peak to the next peak"),
)


@dataclass(frozen=True, repr=False, eq=False)
class StickSlip(Table[_Floats]):
    """Table of stick-slip cycles, from each peak of the longitudinal spring force to the next.

    Attributes
    ----------
    columns : Described of ndarray, shape (n,)
        ``peak_time`` [s], ``peak_force`` [N], ``valley_time`` [s], ``valley_force`` [N], ``slip_duration`` [s],
        ``slip_length`` [m], ``stick_duration`` [s], ``period`` [s], ``rests``, ``rest_time`` [s]; NaN where the run ends,
        or the drive stops or reverses, before the next peak.
    summary : Described of float
        The summary of the run.
    """

    columns: Described[_Floats]
    summary: Described[float]

    def __len__(self) -> int:
        return int(self.columns["peak_time"].size)

    def means(self) -> Described[float]:
        """Means of the columns over the settled cycles, from the summary; empty if there are none."""
        return self._of_summary("")

    def scatter(self) -> Described[float]:
        """Their standard deviations (n - 1); empty for fewer than two cycles."""
        return self._of_summary("_scatter")

    def _of_summary(self, suffix: str) -> Described[float]:
        infos = [info for info, _ in self.columns.info() if info.name + suffix in self.summary]
        return Described((info, self.summary[info.name + suffix]) for info in infos)

    def __repr__(self) -> str:
        lines = repr(self.means()).splitlines()
        return "\n  ".join([f"<StickSlip: {len(self)} peaks; means", *lines]) + ">"

    def _values(self) -> tuple[str, str, Described[float]]:
        return f"Stick-slip: {len(self)} peaks", "mean of", self.means()


def stick_slip_statistics(result: Result) -> StickSlip:
    """Stick-slip cycles of a run.

    The load is the longitudinal spring force k_x u_x, positive in the direction in which the drive pulls the spring. A cycle goes
    from a peak of the load over a valley to the next peak; at each of them the load must turn by more than 1 % of the static limit
    mu_0 W. A drive that stops or reverses ends the current cycle. The summary, of which the means are, has the same definitions, and
    also finds extremes between the samples.

    Parameters
    ----------
    result : Result
        A run with the columns ``spring_force_x`` and ``X``.

    Returns
    -------
    StickSlip
        One row for each peak.

    Raises
    ------
    ColumnError
        If the result lacks a column.
    UsageError
        If this is not a result, or the result does not contain mu_0 and W.
    """
    result = instance("result", result, Result, "give what run or open returns")
    force, position, time = result["spring_force_x"], result["X"], result.time
    try:
        limit = float(result.parameters["mu_0"]) * float(result.parameters["normal_load"])
    except KeyError as error:
        raise UsageError(f"the result has no parameter {error}: it is none of dynstiction's runs") from None
    drive, pull = _directions(result)
    # Of each peak: its sample, that of its valley, whether that and the next peak follow in the same stretch, and where this begins.
    rows: list[tuple[int, int, bool, bool, int]] = []
    for stretch in np.split(np.arange(drive.size), np.flatnonzero(np.diff(drive)) + 1):
        if stretch.size and pull[stretch[0]]:
            first, last = stretch[[0, -1]]
            found = _turns(pull[first] * force[first : last + 2], THRESHOLD * limit)
            # Peaks and valleys alternate.
            for k, (peak, kind) in enumerate(found):
                valley, *later = [i for i, _ in found[k + 1 : k + 3]] or [peak]
                if kind > 0:
                    rows.append((first + peak, first + valley, k + 1 < len(found), bool(later), first))
    peaks, valleys, has_valley, has_next, begin = np.array(rows, dtype=np.intp).reshape(-1, 5).T
    whole, linked = has_valley > 0, has_next > 0
    side_of, along = pull[begin].astype(float), drive[begin].astype(float)
    n = peaks.size
    peak_time, peak_force = _vertex(time, force, peaks)
    valley_time, valley_force = (np.where(whole, v, np.nan) for v in _vertex(time, force, valleys))
    slip_length = np.where(whole, along * (position[valleys] - position[peaks]), np.nan)
    next_peak = np.where(linked, np.append(peak_time[1:], np.nan)[:n], np.nan)
    rests, rest_time = _rests(result.events, peak_time)
    values = (
        peak_time,
        side_of * peak_force,
        valley_time,
        side_of * valley_force,
        valley_time - peak_time,
        slip_length,
        next_peak - valley_time,
        next_peak - peak_time,
        np.where(linked, rests, np.nan),
        np.where(linked, rest_time, np.nan),
    )
    return StickSlip(Described(zip(COLUMNS, values, strict=True), "table"), result.summary)


def first_release(force: _Floats) -> int:
    """Index of the sample where the first stick phase ends: the first peak of the spring force.

    Without a fall by 5 % there is no slip, and the phase ends where the force reaches 99 % of its
    largest value.
    """
    size = np.abs(force)
    fallen = np.flatnonzero(np.maximum.accumulate(size) - size > 0.05 * size.max())
    if fallen.size:
        return int(np.argmax(size[: fallen[0]]))
    return int(np.argmax(size >= 0.99 * size.max()))


def drive_profile(result: Result) -> tuple[_Floats, _Floats] | None:
    """Times [s] and velocities [m/s] of the corners of the drive; None if the drive is constant, or the run does not contain it."""
    if "velocity" in result.parameters or not result.resolved_deck:
        return None
    try:
        time, velocity = map(np.array, drive_of(Scene(result.resolved_deck)))
    except Error:
        return None
    return (time, velocity) if velocity.size > 1 and time.shape == velocity.shape else None


def _directions(result: Result) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Signs of V and of V cos(phi) from each sample to the next, 0 where the drive does not pull."""
    angle = float(result.parameters.get("misalignment_deg", 0.0))
    cosine = 0.0 if angle % 180.0 == 90.0 else float(np.cos(np.radians(angle)))
    if result.parameters.get("model") in ("high_frequency", "creep", "creep_asymptotic"):
        cosine = 0.0
    middle = 0.5 * (result.time[1:] + result.time[:-1])
    profile = drive_profile(result)
    velocity = np.full(middle.shape, float(result.parameters.get("velocity", 1.0)))
    if profile is not None:
        velocity = np.interp(middle, *profile)
    sign = np.sign(velocity).astype(int)
    return sign, sign * int(np.sign(cosine))


def _turns(load: _Floats, least: float) -> list[tuple[int, int]]:
    """Samples of alternating peaks (1) and valleys (-1) that are more than `least` apart. The ends are not turns."""
    # Both ends of a level stretch: the last of equal extremes is the one that counts.
    side_of = np.sign(np.diff(load))
    local = np.flatnonzero(side_of[1:] != side_of[:-1]) + 1
    candidates = np.unique(np.concatenate([[0], local, [load.size - 1]])) if load.size else local
    turns: list[tuple[int, int]] = []
    heading = 0
    best = highest = lowest = (0, float(load[0]) if load.size else 0.0)
    for here in zip(candidates.tolist(), load[candidates].tolist(), strict=True):
        if heading == 0:
            highest = here if here[1] >= highest[1] else highest
            lowest = here if here[1] <= lowest[1] else lowest
            if highest[1] - lowest[1] > least:
                heading = 1 if highest[0] > lowest[0] else -1
                best = highest if heading > 0 else lowest
        elif heading * (here[1] - best[1]) >= 0.0:
            best = here
        elif heading * (best[1] - here[1]) > least:
            turns.append((best[0], heading))
            heading, best = -heading, here
    return turns


def _vertex(time: _Floats, force: _Floats, at: NDArray[np.intp]) -> tuple[_Floats, _Floats]:
    """Time and value of an extreme, by a parabola through the sample and its neighbours."""
    inner = np.clip(at, 1, max(1, time.size - 2))
    left, right = time[inner - 1] - time[inner], time[inner + 1] - time[inner]
    a, b = force[inner - 1] - force[inner], force[inner + 1] - force[inner]
    curvature = (a / left - b / right) / (left - right)
    slope = a / left - curvature * left
    regular = (inner == at) & (np.abs(curvature) > 0.0)
    shift = np.where(regular, -0.5 * slope / np.where(regular, curvature, 1.0), 0.0)
    shift = np.clip(shift, left, right)
    rise = np.where(regular, slope * shift + curvature * shift**2, 0.0)
    return time[at] + shift, force[at] + rise


def _rests(events: NDArray[np.void], edges: _Floats) -> tuple[_Floats, _Floats]:
    """From each edge to the next: how often a rest begins there, and how long the object is at rest; the last one is NaN."""
    times, kinds = events["time"], events["kind"]
    begins = times[kinds == STICK_BEGINS]
    ends = times[kinds == SLIP_BEGINS]
    # A slip that begins before any rest does not end a rest.
    ends = ends[ends >= begins[0]] if begins.size else ends[:0]
    counts = np.diff(np.searchsorted(begins, edges), append=np.nan)
    if begins.size > ends.size:
        ends = np.append(ends, max(begins[-1], edges.max(initial=0.0)))
    # The time at rest so far grows from the beginning of a rest to its end, and stays until the next.
    knots = np.column_stack([begins, ends]).ravel()
    rested = np.cumsum(np.column_stack([np.zeros(begins.size), ends - begins]))
    return counts, np.diff(np.interp(edges, knots, rested), append=np.nan) if knots.size else 0.0 * counts
