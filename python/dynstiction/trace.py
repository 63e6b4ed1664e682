"""Traces: a force along the pull against time, from arrays, or from a run, and what a measuring chain makes of it; from files in
`trace_file`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._arguments import generator, instance, number, reals, text, whole
from .errors import ColumnError, FileError, UsageError
from .result import Result
from .scene import Scene

_Floats = NDArray[np.float64]

QUANTITIES = ("time", "force", "displacement", "lateral_force")
"""Quantities of a trace; time and force are required."""

GAP = 5.0
"""A time between two samples that is this many times the usual one is a gap."""

NEEDED = 3
"""Least number of samples."""


@dataclass(frozen=True, eq=False, repr=False)
class Trace:
    """A force along the pull against time, in SI units.

    Parameters
    ----------
    time : array_like, shape (n,)
        Times of the samples [s], increasing and without gaps: none is more than five usual sampling intervals after the
        one before.
    force : array_like, shape (n,)
        Force along the pull [N], positive where the drive pulls.
    displacement : array_like, shape (n,), optional
        Displacement of the object along the pull [m].
    lateral_force : array_like, shape (n,), optional
        Force across the pull [N].
    name : str
        Name of the trace, as messages and figures show it.
    lines : array_like of int, shape (n,), optional
        Lines of the file that the samples come from, for messages.
    units : str
        Units in the file, as 'time in ms, force in mN'.

    Raises
    ------
    UsageError
        If the arguments are not arrays of one length, or there are too few samples.
    FileError
        If the samples are not usable: one is not a number, times do not increase, or there is a gap. The text names the
        sample, or the line of the file.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.linspace(0.0, 5.0, 501)
    >>> Trace(time, 1.0 + 0.2 * (time % 0.5))
    <Trace 'trace': 501 samples from 0 to 5 s, 1 to 1.098 N>
    """

    time: _Floats
    force: _Floats
    displacement: _Floats | None = None
    lateral_force: _Floats | None = None
    name: str = "trace"
    lines: NDArray[np.int64] | None = None
    units: str = ""

    def __post_init__(self) -> None:
        text("name", self.name)
        for quantity, values in self._columns().items():
            column = np.array(reals(quantity, values, checked=False))
            if column.ndim != 1:
                raise UsageError(f"{quantity} has the shape {column.shape}: it must have one dimension")
            column.setflags(write=False)
            object.__setattr__(self, quantity, column)
            n = self.time.size
            if column.size != n:
                raise UsageError(f"{quantity} has {column.size} samples and time has {n}: give as many")
        if self.lines is not None:
            lines = np.asarray(self.lines)
            if lines.shape != (n,) or lines.dtype.kind not in "iu":
                raise UsageError("lines must be whole numbers, one a sample")
            object.__setattr__(self, "lines", lines.astype(np.int64, copy=False))
        if n < NEEDED:
            raise FileError(f"{self.name}: has {n} samples: at least {NEEDED} are needed")
        self._check_numbers()
        self._check_times()

    def _columns(self) -> dict[str, _Floats]:
        """The quantities that the trace has: those that are required, and those that are given."""
        columns = ((quantity, getattr(self, quantity)) for quantity in QUANTITIES)
        return {q: values for q, values in columns if values is not None or q in ("time", "force")}

    def place(self, sample: int) -> str:
        """Origin of a sample: the file and line, or the trace and the number of the sample, from 0.

        Parameters
        ----------
        sample : int
            Its number, from 0.
        """
        if self.lines is None:
            return f"{self.name}: sample {sample}"
        return f"{self.name}:{self.lines[sample]}"

    def _check_numbers(self) -> None:
        for quantity, values in self._columns().items():
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                also = f", and {bad.size - 1} more" if bad.size > 1 else ""
                raise FileError(
                    f"{self.place(bad[0])}: {quantity} is {values[bad[0]]:g}{also}: take the "
                    f"{'samples' if bad.size > 1 else 'sample'} out, or use a part of the trace without"
                )

    def _check_times(self) -> None:
        steps = np.diff(self.time)
        usual = float(np.median(steps))
        for i in np.flatnonzero(steps <= 0.0)[:1]:
            what, remedy = (
                (
                    "is the one before",
                    "write times with more digits, or give the sampling interval instead of a column of times",
                )
                if steps[i] == 0.0
                else (f"comes after {self.time[i]:.9g} s", "sort the samples, or use one recording at a time")
            )
            raise FileError(f"{self.place(i + 1)}: time {self.time[i + 1]:.9g} s {what}: {remedy}")
        gaps = np.flatnonzero(steps > GAP * usual)
        for i in gaps[:1]:
            also = f", and {gaps.size - 1} more gaps" if gaps.size > 1 else ""
            raise FileError(
                f"{self.place(i + 1)}: a gap of {steps[i]:.4g} s before {self.time[i + 1]:.9g} s, samples are "
                f"{usual:.4g} s apart{also}: use the part before or after it, or fill it by interpolation"
            )

    @property
    def interval(self) -> float:
        """Usual time between two samples [s]: the median."""
        return float(np.median(np.diff(self.time)))

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0])

    def part(self, start: float | None = None, end: float | None = None) -> Trace:
        """The samples between two times, both included.

        Parameters
        ----------
        start, end : float, optional
            First and last time [s]; by default those of the trace.

        Raises
        ------
        UsageError
            If there are fewer than three samples.
        """
        low = -np.inf if start is None else number("start", start)
        high = np.inf if end is None else number("end", end)
        inside = (self.time >= low) & (self.time <= high)
        if np.count_nonzero(inside) < NEEDED:
            raise UsageError(
                f"{self.name}: {np.count_nonzero(inside)} samples from {low:g} to {high:g} s: "
                f"it has times from {self.time[0]:g} to {self.time[-1]:g} s"
            )
        columns: Any = {quantity: values[inside] for quantity, values in self._columns().items()}
        return replace(self, **columns, lines=None if self.lines is None else self.lines[inside])

    def regular(self, interval: float | None = None) -> Trace:
        """The trace at regular times, by linear interpolation; the trace itself if it is regular and no interval is given.

        Parameters
        ----------
        interval : float, optional
            Time between two samples [s]; by default the usual one.

        Raises
        ------
        FileError
            If fewer than three samples would be left.
        """
        step = self.interval if interval is None else number("interval", interval, above=0.0, units="s")
        if interval is None and np.allclose(np.diff(self.time), step, rtol=1e-3, atol=0.0):
            return self
        columns: Any = _at_interval(self._columns(), step)
        return replace(self, **columns, lines=None)

    def averaged(self, count: int) -> Trace:
        """The trace with one sample in place of so many, their mean.

        Parameters
        ----------
        count : int
            Number of samples of each mean; a rest at the end is left out.
        """
        whole_parts = self.time.size // whole("count", count, least=1) * count
        columns: Any = {
            quantity: values[:whole_parts].reshape(-1, count).mean(axis=1)
            for quantity, values in self._columns().items()
        }
        return replace(self, **columns, lines=None)

    def with_noise(self, deviation: float, rng: int | np.random.Generator | None = None) -> Trace:
        """The trace with white noise added to the force.

        Parameters
        ----------
        deviation : float
            Standard deviation of the noise [N].
        rng : int or numpy.random.Generator, optional
            Source of the noise: the same seed gives the same noise, None a new one.
        """
        size = number("deviation", deviation, least=0.0, units="N")
        noise = generator(rng).standard_normal(self.time.size)
        return replace(self, force=self.force + size * noise)

    def zeroed(self, start: float, end: float) -> Trace:
        """The trace with the mean force between two times, at which nothing pulled, as its zero.

        Parameters
        ----------
        start, end : float
            First and last time [s].
        """
        return replace(self, force=self.force - np.mean(self.part(start, end).force))

    @classmethod
    def of(cls, result: Result, interval: float | None = None) -> Trace:
        """The force that a load cell along the drive would show in a run, with displacement X and the force across.

        The force along the drive is k_x u_x cos phi + k_y u_y sin phi, positive where the drive pulls; with dampers it is the
        column ``pull_force``. The force across is k_y u_y cos phi - k_x u_x sin phi; with dampers there is none.

        Parameters
        ----------
        result : Result
            A run with the columns ``spring_force_x``, ``spring_force_y``, with dampers ``pull_force``, and, for the displacement,
            ``X``.
        interval : float, optional
            Time between two samples [s], by linear interpolation; by default that of the result.

        Raises
        ------
        ColumnError
            If the result lacks a column.
        UsageError
            If `result` is not a `Result`.
        """
        result = instance("result", result, Result, "give what run or open returns")
        sense = _sense(result)
        columns: Any = {"time": result.time, "force": sense * pull_force(result)}
        if "X" in result.columns:
            columns["displacement"] = sense * result["X"]
        if not _is_damped(result):
            columns["lateral_force"] = sense * _spring_forces(result)[1]
        keep = np.append(True, np.diff(result.time) > 0.0)
        columns = {quantity: values[keep] for quantity, values in columns.items()}
        steps = np.diff(columns["time"])
        # Samples at every step of the method are not regular: a long time between two of them is not a gap.
        if interval is not None or not np.allclose(steps, np.median(steps), rtol=1e-3):
            usual = np.median(steps) if interval is None else interval
            columns = _at_interval(columns, number("interval", usual, above=0.0, units="s"))
        return cls(**columns, name=str(result.parameters.get("title", "")) or "run")

    def __repr__(self) -> str:
        more = [f", {q.replace('_', ' ')}" for q in QUANTITIES[2:] if getattr(self, q) is not None]
        return (
            f"<Trace {self.name!r}: {self.time.size} samples from {self.time[0]:g} to {self.time[-1]:g} s, "
            f"{self.force.min():.4g} to {self.force.max():.4g} N{''.join(more)}>"
        )


def _at_interval(columns: dict[str, _Floats], step: float) -> dict[str, _Floats]:
    """Columns at regular times [s], by linear interpolation."""
    time = columns["time"]
    count = int(np.floor((time[-1] - time[0]) / step * (1.0 + 1e-12))) + 1
    at = np.minimum(time[0] + step * np.arange(count), time[-1])
    return {quantity: np.interp(at, time, values) for quantity, values in columns.items()} | {"time": at}


def pull_force(result: Result) -> _Floats:
    """Force along the drive [N], shape (n,), of springs and dampers, as a load cell in line with both shows it."""
    if "pull_force" in result.columns:
        return result["pull_force"]
    if _is_damped(result):
        raise ColumnError("a scene with dampers needs the column pull_force: add it to output.fields")
    return _spring_forces(result)[0]


def _spring_forces(result: Result) -> tuple[_Floats, _Floats]:
    """Forces of the springs along the drive and across it [N]; no column contains the part of dampers across."""
    phi = np.radians(float(result.parameters.get("misalignment_deg", 0.0)))
    cosine, sine = float(np.cos(phi)), float(np.sin(phi))
    x, y = result["spring_force_x"], result["spring_force_y"]
    return x * cosine + y * sine, y * cosine - x * sine


def _is_damped(result: Result) -> bool:
    return any(float(result.parameters.get(name, 0.0)) for name in ("damping_x", "damping_y"))


def _sense(result: Result) -> float:
    """-1 for a drive that moves only backwards."""
    velocity: object = result.parameters.get("velocity")
    if velocity is None and result.resolved_deck:
        velocity = Scene(result.resolved_deck).groups()["drive"]["velocity"]
    values = np.atleast_1d(np.asarray(1.0 if velocity is None else velocity, dtype=np.float64))
    return -1.0 if np.min(values) < 0.0 and np.max(values) <= 0.0 else 1.0


@dataclass(frozen=True)
class Chain:
    """A measuring chain: it changes a force as instruments do, in the order of its attributes.

    Attributes
    ----------
    gain : float
        Factor of the force.
    resonance : float, optional
        Natural frequency of the load cell [Hz]; without one it is rigid.
    damping : float
        Its damping ratio.
    filter : float, optional
        Corner frequency of a Butterworth low pass [Hz].
    order : int
        Its order.
    tare : float
        Reading without a force [N].
    drift : float
        Slope of this reading [N/s].
    hum, mains : float
        Amplitude [N] and frequency [Hz] of what the mains add.
    step : float
        Difference of two readings of the converter [N].

    Notes
    -----
    A filter, and a resonance, above half of the sampling rate changes nothing. To a fit drift, hum and step are scatter of the cycles.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 1001)
    >>> Chain(gain=2.0, tare=0.5)(Trace(time, 1.0 + 0.1 * time)).force[[0, -1]]
    array([2.5, 2.7])
    """

    gain: float = 1.0
    resonance: float | None = None
    damping: float = 0.05
    filter: float | None = None
    order: int = 2
    tare: float = 0.0
    drift: float = 0.0
    hum: float = 0.0
    mains: float = 50.0
    step: float = 0.0

    def __post_init__(self) -> None:
        whole("order", self.order, least=1)
        limits: dict[str, dict[str, float]] = {
            "tare": {},
            "drift": {},
            "hum": {"least": 0.0},
            "step": {"least": 0.0},
        }
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name != "order" and value is not None:
                checked = number(each.name, value, **limits.get(each.name, {"above": 0.0}))
                object.__setattr__(self, each.name, checked)

    def response(self, interval: float, force: _Floats) -> _Floats:
        """Gain, resonance, filter and tare, of a force that was at rest before.

        Parameters
        ----------
        interval : float
            Time between two samples [s].
        force : ndarray, shape (..., n)
            Force [N].
        """
        shown = self.gain * force
        if self.resonance is not None or self.filter is not None:
            shown = self._filtered(interval, shown)
        return np.asarray(shown + self.tare)

    def _filtered(self, interval: float, shown: _Floats) -> _Floats:
        from scipy.signal import bilinear, butter, sosfilt, sosfilt_zi, tf2sos  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

        stages = []
        if self.resonance is not None and self.resonance * interval < 0.5:
            angular = 2.0 * np.pi * self.resonance
            cell = [angular**2], [1.0, 2.0 * self.damping * angular, angular**2]
            stages.append(tf2sos(*bilinear(*cell, 1.0 / interval)))
        if self.filter is not None and self.filter * interval < 0.5:
            stages.append(butter(self.order, self.filter, fs=1.0 / interval, output="sos"))
        for stage in stages:
            rest = np.expand_dims(sosfilt_zi(stage), tuple(range(1, shown.ndim)))
            shown, _ = sosfilt(stage, shown, zi=rest * shown[..., :1])
        return shown

    def __call__(self, trace: Trace) -> Trace:
        """The trace as this chain shows its force, at the same, regular times.

        Parameters
        ----------
        trace : Trace
            Force of the springs, ``Trace.of`` a run.
        """
        trace = instance("trace", trace, Trace, "give what Trace.of returns").regular()
        since = trace.time - trace.time[0]
        shown = self.response(trace.interval, trace.force) + self.drift * since
        shown += self.hum * np.sin(2.0 * np.pi * self.mains * since)
        if self.step:
            shown = self.step * np.round(shown / self.step)
        return replace(trace, force=shown, lines=None)
