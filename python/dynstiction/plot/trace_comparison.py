"""A measured trace and a run: mean waveforms over a cycle and around the slip, and the table of statistics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .style import BLUE, COLUMN_WIDTH, MM, VERMILION

if TYPE_CHECKING:
    from ..trace_comparison import Statistic, TraceComparison
    from ..trace_cycles import Waveform

__all__ = ["draw_trace_comparison"]

ERRORS = 2.0
"""Half width of a band in standard errors."""
MOST_DIGITS = 8
MILLI = (1e3, "ms")
SYMBOLS = {
    "period": "period [s]",
    "peak_force": "peak [N]",
    "valley_force": "valley [N]",
    "swing": "swing [N]",
    "slip_duration": "slip [s]",
    "loading_rate": "loading [N/s]",
    "creep_share": "creep share",
    "slip_length": "slip length [m]",
    "lateral_change": "lateral change [N]",
}
"""Names of the statistics in the figure."""


def draw_trace_comparison(comparison: TraceComparison, figure: Figure) -> None:
    """(a) Mean force over a cycle, (b) around the slip, (c) the lateral force if the trace has one; below, the statistics.

    Bands are two standard errors wide to either side.
    """
    lateral = (comparison.measured_lateral, comparison.simulated_lateral)
    heights = [3.0, 3.0, 0.3 * len(comparison.statistics)]
    if lateral[0] is not None:
        heights.insert(2, 2.2)
    figure.set_size_inches(COLUMN_WIDTH, 18.0 * MM * sum(heights))
    cycle, slip, *others, table = figure.subplots(len(heights), 1, height_ratios=heights)
    _draw(cycle, comparison.measured_waveform, comparison.simulated_waveform, 1.0)
    cycle.set_xlim(0.0, 1.0)
    cycle.set_xlabel("phase from slip to slip")
    cycle.legend(loc="lower right")
    scale, unit = _time_scale(comparison.measured_slip.phase)
    _draw(slip, comparison.measured_slip, comparison.simulated_slip, scale)
    slip.set_xlim(scale * comparison.measured_slip.phase[[0, -1]])
    slip.set_xlabel(f"time from the middle of the slip [{unit}]")
    for axis in others:
        if lateral[0] is not None and lateral[1] is not None:
            _draw(axis, lateral[0], lateral[1], 1.0)
        axis.set_xlim(0.0, 1.0)
        axis.set_xlabel("phase from slip to slip")
    names = ["force along the pull [N]"] * 2 + ["lateral force [N]"] * len(others)
    for axis, letter, name in zip((cycle, slip, *others), "abc", names, strict=False):
        axis.set_ylabel(name)
        axis.text(-0.17, 1.0, f"({letter})", transform=axis.transAxes, va="top", fontweight="bold")
    _draw_table(table, comparison.statistics)


def _draw(axis: Axes, measured: Waveform, simulated: Waveform, scale: float) -> None:
    # Where both lines are the same, the wider one is visible beneath the other.
    for form, colour, name, width in (
        (measured, BLUE, "measured", 1.6),
        (simulated, VERMILION, "simulated", 0.7),
    ):
        band = ERRORS * np.nan_to_num(form.error)
        axis.fill_between(
            scale * form.phase, form.force - band, form.force + band, color=colour, alpha=0.25, linewidth=0.0
        )
        axis.plot(
            scale * form.phase,
            form.force,
            color=colour,
            linewidth=width,
            label=f"{name}, {form.cycles} cycles" if scale == 1.0 else name,
        )
    axis.margins(y=0.08)


def _time_scale(time: object) -> tuple[float, str]:
    """Scale of times, and their unit."""
    longest = float(np.max(np.abs(np.asarray(time))))
    return (1.0, "s") if longest >= 1.0 else MILLI if longest >= 1e-3 else (1e6, "µs")


def _draw_table(axis: Axes, statistics: tuple[Statistic, ...]) -> None:
    axis.set_axis_off()
    head = ("mean (error)", "measured", "simulated", "difference\nin errors")
    rows = [
        (
            SYMBOLS.get(each.name, each.name),
            _with_error(each.measured, each.measured_error),
            _with_error(each.simulated, each.simulated_error),
            "–" if np.isnan(each.deviation) else f"{each.deviation:+.1f}",
        )
        for each in statistics
    ]
    places = (-0.15, 0.46, 0.80, 1.0)
    height = 1.0 / (len(rows) + 1.5)
    for i, row in enumerate((head, *rows)):
        y = 1.0 - height * (0.9 if i == 0 else i + 1.2)
        for j, text in enumerate(row):
            differs = i > 0 and j == 3 and statistics[i - 1].differs
            axis.text(
                places[j],
                y,
                text,
                ha="left" if j == 0 else "right",
                va="center",
                fontsize=7.0,
                fontweight="bold" if differs else "normal",
                transform=axis.transAxes,
            )


def _with_error(value: float, error: float) -> str:
    """A value with its standard error, which has two digits, in units of its last digit: 0.83293(32)."""
    if np.isnan(value):
        return "–"
    if not (np.isfinite(error) and error > 1e-9 * abs(value)):
        return f"{value:.6g}"
    digits = 1 - int(np.floor(np.log10(error)))
    if not 0 <= digits <= MOST_DIGITS:
        return f"{value:.4g} ± {error:.1g}"
    shown = f"{error:.{digits}f}"
    # An error above 1 is written with its own decimal point.
    return f"{value:.{digits}f}({shown if error >= 1.0 else round(error * 10.0**digits)})"
