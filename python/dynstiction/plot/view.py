"""The part of a run that a figure shows, and the notes on it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .. import _native
from ..errors import Error, UsageError
from ..record import Described
from ..result import Result
from ..scene import Scene
from ..stick_slip import StickSlip, drive_profile, stick_slip_statistics
from .notation import Floats

MOST_CYCLES = 12
"""A run with more cycles is shown up to its first cycles."""
SHOWN_CYCLES = 8
"""Number of cycles that are shown after the first slip."""
LARGEST = 1e100
"""Larger values would overflow in the computations for a figure."""
SLACK = 1e-9
"""Share of the run's length by which an end of the window may be outside the run."""


class View(NamedTuple):
    """Some samples of a run."""

    whole: Result
    """The run."""
    result: Result
    """The samples that are shown."""
    cycles: StickSlip | None
    """Cycles of the whole run; None if it lacks the columns for them."""
    notes: tuple[str, ...]
    """Notes of the figure on its samples."""

    def slips(self) -> Floats:
        """Begin and end [s] of the slips, shape (n, 2)."""
        if self.cycles is None:
            return np.empty((0, 2))
        both = np.column_stack([self.cycles["peak_time"], self.cycles["valley_time"]])
        begin, end = self.result.time[[0, -1]]
        inside = (both[:, 1] >= begin) & (both[:, 0] <= end)
        return np.asarray(both[inside & np.isfinite(both).all(axis=1)])


def view_of(result: Result, start: float | None = None, end: float | None = None) -> View:
    """The samples from `start` to `end` [s]; without both, the first creep and some cycles of a run that has many.

    Raises
    ------
    UsageError
        If the run has fewer than two samples, or values that no axis holds; if the start is not before the end, or one of them is
        outside the run.
    """
    cycles, begin, finish = shown_part(result, start, end)
    first, last = float(result.time[0]), float(result.time[-1])
    notes = []
    shown = result
    if (begin, finish) != (first, last):
        low, high = np.searchsorted(result.time, [begin, finish])
        part = slice(int(low), int(high) + int(high < result.time.size and result.time[high] == finish))
        if result.time[part].size < 2:
            raise UsageError(
                f"from {begin:g} to {finish:g} s: the run has fewer than two samples there: choose a longer part"
            )
        held = Described(((info, values[part]) for info, values in result.columns.info()), "columns")
        shown = replace(result, columns=held)
        if start is None and end is None:
            notes.append(f"first {finish - first:.3g} s of {last - first:.4g} s")
    coarse = coarseness(shown)
    return View(result, shown, cycles, (*notes, *([coarse] if coarse else [])))


def shown_part(
    result: Result,
    start: float | None,
    end: float | None,
    shown: int = SHOWN_CYCLES,
    most: int = MOST_CYCLES,
) -> tuple[StickSlip | None, float, float]:
    """Cycles of a run, None if it lacks the columns for them, and both ends [s] of the part from `start` to `end`.

    Without both, a run with more than `most` cycles is shown up to `shown` cycles after its first slip; one whose drive changes, and
    one whose cycles end, as a whole. It is refused as by `view_of`.
    """
    if result.time.size < 2:
        raise UsageError("nothing to draw: the result has fewer than two samples")
    for name, values in result.columns.items():
        if not np.all(np.abs(values) < LARGEST):
            raise UsageError(
                f"nothing to draw: '{name}' reaches {np.max(np.abs(values)):g}: no axis holds {LARGEST:g} or more"
            )
    try:
        cycles = stick_slip_statistics(result)
    except Error:
        cycles = None
    first, last = float(result.time[0]), float(result.time[-1])
    if start is None and end is None:
        if cycles is None or len(cycles) <= most or not cycles.means() or drive_profile(result):
            return cycles, first, last
        peaks = cycles["peak_time"]
        return cycles, first, float(min(last, 0.5 * (peaks[shown] + peaks[shown + 1])))
    begin, finish = first if start is None else start, last if end is None else end
    slack = SLACK * (last - first)
    if not first - slack <= begin < finish <= last + slack:
        raise UsageError(
            f"from {begin:g} to {finish:g} s: the run has samples from {first:g} to {last:g} s: "
            "choose a part of it that begins before it ends"
        )
    return cycles, max(begin, first), min(finish, last)


def coarseness(result: Result) -> str | None:
    """A note that the samples are too far apart for the fast oscillation; None if they are not, or there is no such oscillation, or the
    run does not contain its deck.
    """
    if result.time.size < 2 or not result.resolved_deck:
        return None
    step = float(f"{np.median(np.diff(result.time)):.6g}")
    try:
        with _native.Run(Scene(result.resolved_deck).replace(interval=step).source) as run:
            return run.sampling_note.partition(" (")[0] or None
    except Error:
        return None
