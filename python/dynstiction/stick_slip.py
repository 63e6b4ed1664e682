"""Stick-slip, cycle by cycle, from the samples and events of a result."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .errors import ColumnError, UsageError
from .html import page_table
from .record import SLIP_BEGINS, STICK_BEGINS, Described, Info
from .result import Result

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

__all__ = ["StickSlip", "stick_slip_statistics"]

THRESHOLD = 0.01
"""Of the static limit mu_0 W: what the spring force must fall or rise by to count, as in the core's summary."""

_Floats = NDArray[np.float64]

COLUMNS = (
    Info("peak_time", "s", "time of the peak of k_x u_x: the slip begins"),
    Info("peak_force", "N", "peak of k_x u_x"),
    Info("valley_time", "s", "time of the valley that follows"),
    Info("valley_force", "N", "valley of k_x u_x"),
    Info("slip_duration", "s", "from peak to valley"),
    Info("slip_length", "m", "advance in X from peak to valley"),
    Info("stick_duration", "s", "from valley to the next peak: dynamic stiction"),
    Info("period", "s", "from peak to the next peak"),
    Info("rests", "1", "times that the object came to rest, from peak to the next peak"),
    Info("rest_time", "s", "time at rest, from peak to the next peak"),
)

INSTANTS = ("peak_time", "valley_time")
"""Columns that have no mean."""


@dataclass(frozen=True, repr=False, eq=False)
class StickSlip:
    """Table of stick-slip cycles, from each peak of the longitudinal spring force to the next.

    Attributes
    ----------
    columns : Described of ndarray, shape (n,)
        ``peak_time`` [s], ``peak_force`` [N], ``valley_time`` [s], ``valley_force`` [N], ``slip_duration`` [s],
        ``slip_length`` [m], ``stick_duration`` [s], ``period`` [s], ``rests``, ``rest_time`` [s]; NaN in the last row
        where the run ends before.
    """

    columns: Described[_Floats]

    def __getitem__(self, name: str) -> _Floats:
        try:
            return self.columns[name]
        except KeyError:
            raise ColumnError(f"no column '{name}', only {', '.join(self.columns)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return int(self.columns["peak_time"].size)

    def means(self) -> Described[float]:
        """Mean of each column but the times, over the cycles that have it; what none has is left out."""
        kept = (
            (info, v[np.isfinite(v)]) for info, v in self.columns.info() if not info.name.endswith("_time")
        )
        return Described((info, float(np.mean(values))) for info, values in kept if values.size)

    def to_pandas(self) -> pandas.DataFrame:
        """The table as a `pandas.DataFrame`, one row a cycle; ``frame.attrs["units"]`` has the units."""
        import pandas  # noqa: PLC0415  (optional)

        frame = pandas.DataFrame(dict(self.columns))
        frame.attrs["units"] = dict(self.columns.units)
        return frame

    def __repr__(self) -> str:
        lines = [f"{n} = {value:.6g} {self.columns.units[n]}" for n, value in self.means().items()]
        return "\n  ".join([f"<StickSlip: {len(self)} peaks; means", *lines]) + ">"

    def _repr_html_(self) -> str:
        rows = [
            (info.name, f"{value:.6g}", info.units, info.long_name) for info, value in self.means().info()
        ]
        return page_table(f"Stick-slip: {len(self)} peaks", ("mean of", "value", "unit", ""), rows)


def stick_slip_statistics(result: Result) -> StickSlip:
    """Stick-slip cycles of a run.

    A cycle is a fall and a rise of the longitudinal spring force k_x u_x by more than 1 % of the static limit mu_0 W,
    as in the summary of the core, which finds extremes between the samples too: the means agree with it within the
    distance of the samples.

    Parameters
    ----------
    result : Result
        A run with the columns ``spring_force_x`` and ``X``.

    Returns
    -------
    StickSlip
        One row a peak.

    Raises
    ------
    ColumnError
        If the result lacks a column.
    UsageError
        If the result does not say what mu_0 and W are.
    """
    force, position, time = result["spring_force_x"], result["X"], result.time
    try:
        limit = float(result.parameters["mu_0"]) * float(result.parameters["normal_load"])
    except KeyError as error:
        raise UsageError(f"the result has no parameter {error}: it is none of dynstiction's runs") from None
    turns = _turns(force, THRESHOLD * limit)
    peaks, valleys = turns[0::2], turns[1::2]
    n = peaks.size
    peak_time, peak_force = _vertex(time, force, peaks)
    valley_time, valley_force = (_padded(values, n) for values in _vertex(time, force, valleys))
    slip_length = _padded(position[valleys] - position[peaks[: valleys.size]], n)
    next_peak = _padded(peak_time[1:], n)
    rests, rest_time = _rests(result.events, peak_time)
    values = (
        peak_time,
        peak_force,
        valley_time,
        valley_force,
        valley_time - peak_time,
        slip_length,
        next_peak - valley_time,
        next_peak - peak_time,
        _padded(rests, n),
        _padded(rest_time, n),
    )
    return StickSlip(Described(zip(COLUMNS, values, strict=True)))


def _turns(force: _Floats, least: float) -> NDArray[np.intp]:
    """Samples of peaks and valleys in turn, a peak first, that are `least` or more apart."""
    # Of a level stretch both ends: the last of equal extremes is the one that counts.
    side_of = np.sign(np.diff(force))
    local = np.flatnonzero(side_of[1:] != side_of[:-1]) + 1
    candidates = np.unique(np.concatenate([[0], local, [force.size - 1]])) if force.size else local
    turns: list[int] = []
    side, best = 1.0, None
    for i, value in zip(candidates.tolist(), force[candidates].tolist(), strict=True):
        if best is None or side * (value - best[1]) >= 0.0:
            best = (i, value)
        elif side * (best[1] - value) > least:
            turns.append(best[0])
            side, best = -side, (i, value)
    return np.array(turns, dtype=np.intp)


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
    """Of each interval between edges: how often a rest begins in it, and how long the object is at rest."""
    times, kinds = events["time"], events["kind"]
    begins = times[kinds == STICK_BEGINS]
    ends = times[kinds == SLIP_BEGINS]
    # A slip that begins before any rest ends none.
    ends = ends[ends >= begins[0]] if begins.size else ends[:0]
    counts = np.diff(np.searchsorted(begins, edges)).astype(np.float64)

    def at_rest_until(edge: _Floats) -> _Floats:
        begun, ended = np.searchsorted(begins, edge), np.searchsorted(ends, edge)
        whole = np.concatenate([[0.0], np.cumsum(ends - begins[: ends.size])])
        still = np.where(begun > ended, edge - begins[np.maximum(begun, 1) - 1] if begins.size else 0.0, 0.0)
        return np.asarray(whole[ended] + still)

    return counts, np.diff(at_rest_until(edges))


def _padded(values: _Floats, n: int) -> _Floats:
    """A column of n rows, NaN where there is no value."""
    return np.concatenate([values, np.full(n - values.size, np.nan)])
