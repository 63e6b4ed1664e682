"""A measured trace and a run: mean waveforms over a cycle and around the slip, and the table of statistics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .notation import prefixed
from .style import BLUE, VERMILION, sized

if TYPE_CHECKING:
    from ..trace_comparison import Statistic, TraceComparison
    from ..trace_cycles import Waveform

__all__ = ["draw_trace_comparison"]

ERRORS = 2.0
"""Half width of a band in standard errors."""
MOST_DIGITS = 8
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
    longest = float(np.max(np.abs(comparison.measured_slip.phase)))
    scale, unit = prefixed("s", longest, 1.0, ("", "m", "µ"))
    over_cycle, around = "phase from slip to slip", f"time from the middle of the slip [{unit}]"
    force, lateral = "force along the pull [N]", "lateral force [N]"
    rows: list[tuple[Any, ...]] = [
        (3.0, comparison.measured_waveform, comparison.simulated_waveform, over_cycle, force),
        (3.0, comparison.measured_slip, comparison.simulated_slip, around, force),
        (2.2, comparison.measured_lateral, comparison.simulated_lateral, over_cycle, lateral),
    ]
    rows = [row for row in rows if row[1] is not None and row[2] is not None]
    heights = [*(row[0] for row in rows), 0.3 * len(comparison.statistics)]
    sized(figure, 18.0 * sum(heights))
    *axes, table = figure.subplots(len(heights), 1, height_ratios=heights)
    for axis, letter, (_, measured, simulated, xlabel, ylabel) in zip(axes, "abc", rows, strict=False):
        is_slip = xlabel == around
        _draw(axis, measured, simulated, scale if is_slip else 1.0)
        axis.set(xlabel=xlabel, ylabel=ylabel)
        axis.set_xlim(scale * measured.phase[[0, -1]] if is_slip else (0.0, 1.0))
        axis.text(-0.17, 1.0, f"({letter})", transform=axis.transAxes, va="top", fontweight="bold")
    axes[0].legend(loc="lower right")
    _draw_table(table, comparison.statistics)


def _draw(axis: Axes, measured: Waveform, simulated: Waveform, scale: float) -> None:
    # Where both lines are the same, the wider one is visible beneath the other.
    for form, colour, name, width in (
        (measured, BLUE, "measured", 1.6),
        (simulated, VERMILION, "simulated", 0.7),
    ):
        phase, band = scale * form.phase, ERRORS * np.nan_to_num(form.error)
        ends = (form.force - band, form.force + band)
        axis.fill_between(phase, *ends, color=colour, alpha=0.25, linewidth=0.0)
        label = f"{name}, {form.cycles} cycles" if scale == 1.0 else name
        axis.plot(phase, form.force, color=colour, linewidth=width, label=label)
    axis.margins(y=0.08)


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
            how: Any = {"ha": "left" if j == 0 else "right", "fontweight": "bold" if differs else "normal"}
            axis.text(places[j], y, text, va="center", fontsize=7.0, transform=axis.transAxes, **how)


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
