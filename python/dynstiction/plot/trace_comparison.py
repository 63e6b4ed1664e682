"""A measured trace and a run: mean waveforms over a cycle and around the slip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from .notation import prefixed
from .style import BLUE, VERMILION, panels

if TYPE_CHECKING:
    from ..trace_comparison import TraceComparison

__all__ = ["draw_trace_comparison"]

ERRORS = 2.0
"""Half width of a band in standard errors."""


def draw_trace_comparison(comparison: TraceComparison, figure: Figure) -> None:
    """(a) Mean force over a cycle, (b) around the slip, (c) the lateral force if the trace has one.

    Bands are two standard errors wide to either side.
    """
    longest = float(np.max(np.abs(comparison.measured_slip.phase)))
    scale, unit = prefixed("s", longest, 1.0, ("", "m", "µ"))
    around, over_cycle = f"time from the middle of the slip [{unit}]", "phase from slip to slip"
    force, lateral = "force along the pull [N]", "lateral force [N]"
    rows = [
        (1.0, comparison.measured_waveform, comparison.simulated_waveform, over_cycle, force),
        (scale, comparison.measured_slip, comparison.simulated_slip, around, force),
        (1.0, comparison.measured_lateral, comparison.simulated_lateral, over_cycle, lateral),
    ]
    rows = [row for row in rows if row[1] is not None and row[2] is not None]
    for axis, (factor, *forms, xlabel, ylabel) in zip(
        panels(figure, len(rows), 54.0 * len(rows)), rows, strict=True
    ):
        # Where both lines are the same, the wider one is visible beneath the other.
        for form, colour, name, width in zip(
            forms, (BLUE, VERMILION), ("measured", "simulated"), (1.6, 0.7), strict=True
        ):
            phase, band = factor * form.phase, ERRORS * np.nan_to_num(form.error)
            ends = (form.force - band, form.force + band)
            axis.fill_between(phase, *ends, color=colour, alpha=0.25, linewidth=0.0)
            label = f"{name}, {form.cycles} cycles"
            axis.plot(phase, form.force, color=colour, linewidth=width, label=label)
        axis.margins(y=0.08)
        axis.set(xlabel=xlabel, ylabel=ylabel)
        axis.set_xlim(factor * forms[0].phase[[0, -1]] if xlabel == around else (0.0, 1.0))
    figure.axes[0].legend(loc="lower right")
