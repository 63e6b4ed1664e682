"""A measured waveform and the fitted one: over the cycle, around the slip, and the residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .notation import Floats
from .style import BLACK, BLUE, VERMILION, new_figure, sized

if TYPE_CHECKING:
    from ..trace_fit import Fit

__all__ = ["draw_fit", "fit_figure"]

AROUND = 2.5
"""Time that is shown before and after the middle of the slip, in durations of the fall."""
DOTS: Any = {"marker": ".", "linestyle": "", "color": BLUE, "markersize": 2.5}


def fit_figure(fit: Fit) -> Figure:
    """Figure of a fit."""
    return new_figure(lambda figure: draw_fit(fit, figure))


def draw_fit(fit: Fit, figure: Figure) -> None:
    """Mean force over a cycle and around the slip, displacement in the creep if it was measured, residuals in standard errors."""
    wave = fit.waveform
    has_way = wave.ahead is not None
    sized(figure, 170.0 if has_way else 130.0)
    axes = figure.subplots(3 + has_way, 1, height_ratios=(3.0, 3.0, *([3.0] * has_way), 2.0))
    cycle, slip, residual = axes[0], axes[1], axes[-1]
    if wave.ahead is not None:
        time = wave.time[: fit.ahead.size]
        drive = abs(float(np.ravel(fit.scene.drive.velocity or 0.0)[0])) * (time - time[0]) - fit.ahead[0]
        axes[2].plot(time, 1e6 * (wave.ahead.mean(axis=0) + drive), **DOTS)
        axes[2].plot(time, 1e6 * (fit.ahead + drive), color=VERMILION)
        axes[2].set(xlabel="time from the slip [s]", ylabel="creep along the pull [µm]")
        axes[2].margins(y=0.08)
    _draw(cycle, fit, wave.time)
    cycle.set(xlim=wave.edges[[0, -1]], xlabel="time from the slip [s]")
    cycle.legend(loc="upper left")
    _draw(slip, fit, 1e3 * wave.time)
    near = AROUND * wave.fall
    slip.set_xlim(1e3 * max(-near, wave.edges[0]), 1e3 * min(near, wave.edges[-1]))
    slip.set_xlabel("time from the slip [ms]")
    off = (wave.rows.mean(axis=0) - np.append(fit.fitted, fit.ahead)) / wave.errors
    residual.plot(np.arange(off.size), np.where(wave.counts, off, np.nan), **DOTS)
    for level in (-2.0, 0.0, 2.0):
        residual.axhline(level, color=BLACK, linewidth=0.4, linestyle="-" if level == 0.0 else ":")
    order = "bin, in the order of time" + (", force and displacement" if has_way else "")
    residual.set(xlim=(0, off.size), xlabel=order, ylabel="residual / error")
    for axis, letter in zip(axes, "abcd", strict=False):
        axis.set_title(f"({letter})", loc="left", fontsize=8.0, fontweight="bold")


def _draw(axis: Axes, fit: Fit, time: Floats) -> None:
    cycles = len(fit.waveform.cycles)
    axis.plot(time, fit.waveform.mean, label=f"measured, mean of {cycles} cycles", **DOTS)
    axis.plot(time, fit.fitted, color=VERMILION, label=f"fitted, {fit.model}")
    axis.set_ylabel("force along the pull [N]")
    axis.margins(y=0.08)
