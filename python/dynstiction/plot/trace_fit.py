"""A measured waveform and the fitted one: over the cycle, around the slip, and the residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .style import BLUE, COLUMN_WIDTH, MM, VERMILION, new_figure

if TYPE_CHECKING:
    from ..trace_fit import Fit

__all__ = ["draw_fit", "fit_figure"]

AROUND = 2.5
"""Time that is shown before and after the middle of the slip, in durations of the fall."""
MILLI = 1e3


def fit_figure(fit: Fit) -> Figure:
    """Figure of a fit."""
    return new_figure(lambda figure: draw_fit(fit, figure))


def draw_fit(fit: Fit, figure: Figure) -> None:
    """(a) Mean force over a cycle, (b) around the slip, (c) residuals in standard errors over both."""
    figure.set_size_inches(COLUMN_WIDTH, 130.0 * MM)
    cycle, slip, residual = figure.subplots(3, 1, height_ratios=(3.0, 3.0, 2.0))
    wave = fit.waveform
    _draw(cycle, fit, wave.time, 1.0)
    cycle.set_xlim(wave.edges[0], wave.edges[-1])
    cycle.set_xlabel("time from the slip [s]")
    cycle.legend(loc="lower left")
    _draw(slip, fit, wave.time, MILLI)
    near = AROUND * wave.fall
    slip.set_xlim(MILLI * max(-near, wave.edges[0]), MILLI * min(near, wave.edges[-1]))
    slip.set_xlabel("time from the slip [ms]")
    off = (wave.mean - fit.fitted) / wave.error
    residual.plot(np.arange(off.size), np.where(wave.used, off, np.nan), ".", color=BLUE, markersize=2.5)
    for level in (-2.0, 0.0, 2.0):
        residual.axhline(level, color="black", linewidth=0.4, linestyle="-" if level == 0.0 else ":")
    residual.set_ylabel("residual / error")
    residual.set_xlabel("bin, in the order of time")
    residual.set_xlim(0, off.size)
    for axis, letter in ((cycle, "a"), (slip, "b"), (residual, "c")):
        axis.set_title(f"({letter})", loc="left", fontsize=8.0, fontweight="bold")


def _draw(axis: Axes, fit: Fit, time: NDArray[np.float64], scale: float) -> None:
    wave = fit.waveform
    axis.plot(
        scale * time,
        wave.mean,
        ".",
        color=BLUE,
        markersize=2.5,
        label=f"measured, mean of {len(wave.cycles)} cycles",
    )
    axis.plot(scale * time, fit.fitted, color=VERMILION, label=f"fitted, {fit.model}")
    axis.set_ylabel("force along the pull [N]")
    axis.margins(y=0.08)
