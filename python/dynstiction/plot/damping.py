"""Damping ratio of the slow motion against the direction of friction (Fig. 5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.ticker import NullFormatter

from ..errors import UsageError
from ..result import Result
from ..stability import damping_ratio
from .notation import MISALIGNMENT
from .samples import Floats, columns
from .style import BLUE, VERMILION, one_axes
from .theory import damping_crossing, slider

__all__ = ["draw_damping", "draw_damping_of"]

COLOURS = (BLUE, VERMILION)
LOWEST_RATIO = 3e-3


def draw_damping(result: Result, canvas: FigureBase | Axes) -> None:
    """Damping ratio against angle with the path of one run (Fig. 5)."""
    draw_damping_of([result], canvas)


def draw_damping_of(results: Sequence[Result], canvas: FigureBase | Axes) -> None:
    """Damping ratio against angle with the paths of at most two runs (Fig. 5).

    Each path leads from friction across the soft axis (90 deg) to steady sliding (theta = phi). Solid: Eq. (10), thick in the
    part that the run covers before it first slips or slides; dashed: with the weakening of friction. Crosses: damping ratio 1 and
    steady sliding.
    """
    sliders = [_slider(result) for result in results]
    axis = one_axes(canvas, 72.0)
    axis.set(xscale="log", yscale="log")
    for result, parameters, colour in zip(results, sliders, COLOURS, strict=False):
        _draw_path(axis, result, parameters, colour)
    lowest = min(abs(np.sin(parameters["misalignment"])) for parameters in sliders)
    axis.set_xlim(max(0.05, 0.5 * np.degrees(np.arcsin(lowest))), 100.0)
    _mark_regions(axis)
    _label_degrees(axis)
    axis.set(xlabel=r"angle of friction to the soft axis, $\theta$ [deg]", ylabel=r"damping ratio $\zeta$")
    if any("v_f" in parameters for parameters in sliders):
        axis.plot([], [], "--", color="0.3", label="with weakening")
    axis.plot([], [], color="0.3", linewidth=2.6, alpha=0.35, label="run, up to its first slip")
    axis.legend(loc="lower right", handlelength=1.8)


def _slider(result: Result) -> dict[str, float]:
    parameters = slider(result)
    parameters["velocity"] = abs(parameters["velocity"])
    turning = parameters["velocity"] * np.sin(parameters["misalignment"])
    if turning * parameters["mu_0"] * parameters["normal_load"] == 0.0:
        raise UsageError(
            "without misalignment, drive or friction nothing turns the friction vector and there is no damping ratio: "
            "run with misalignment_deg, velocity, mu_0 and normal_load not 0"
        )
    return parameters


def _draw_path(axis: Axes, result: Result, weakening: dict[str, float], colour: str) -> None:
    """Eq. (10) and, if friction weakens, the corrected curve, between friction across the soft axis and steady sliding."""
    constant = {name: value for name, value in weakening.items() if name not in ("mu_inf", "v_f")}
    end = np.arcsin(abs(np.sin(weakening["misalignment"])))
    theta = np.geomspace(0.5 * np.pi, min(end, 0.4 * np.pi), 400)
    label = f"{MISALIGNMENT} = {np.degrees(weakening['misalignment']):.4g}°"
    axis.plot(np.degrees(theta), damping_ratio(theta, **constant), color=colour, label=label)
    _draw_visited(axis, result, constant, colour)
    if weakening != constant:
        _draw_weakening(axis, theta, weakening, colour)
        _cross(axis, damping_crossing(weakening, 1.0), weakening, end, colour)
    _cross(axis, damping_crossing(constant, 1.0), constant, end, colour)
    _cross(axis, end, constant, end, colour)


def _draw_weakening(axis: Axes, theta: Floats, parameters: dict[str, float], colour: str) -> None:
    """The curve with weakening; a triangle at the lower edge marks where it falls through zero."""
    zero = damping_crossing(parameters, 0.0)
    if zero > theta[-1]:  # False for NaN
        theta = np.concatenate([theta[theta > 1.1 * zero], zero * (1.0 + np.geomspace(0.1, 1e-7, 100))])
        axis.plot(
            np.degrees(zero), 0.025, "v", color=colour, markersize=4.0, transform=axis.get_xaxis_transform()
        )
    axis.plot(np.degrees(theta), damping_ratio(theta, **parameters), "--", color=colour)


def _draw_visited(axis: Axes, result: Result, constant: dict[str, float], colour: str) -> None:
    """The part of the curve that the run covers up to its first slip."""
    needed = columns(result, "theta", "spring_force_x")
    force = np.abs(needed["spring_force_x"])
    fallen = np.flatnonzero(np.maximum.accumulate(force) - force > 0.05 * force.max())
    before = slice(0, int(np.argmax(force[: fallen[0]])) + 1 if fallen.size else force.size)
    loaded = force[before] > 0.0
    if not np.any(loaded):
        return
    sine = np.abs(np.sin(needed["theta"][before][loaded]))
    theta = np.arcsin(np.geomspace(sine.max(), max(float(sine.min()), 1e-6), 400).clip(max=1.0))
    (visited,) = axis.plot(np.degrees(theta), damping_ratio(theta, **constant), color=colour)
    visited.set(linewidth=2.6, alpha=0.35, solid_capstyle="butt")


def _cross(axis: Axes, theta: float, parameters: dict[str, float], end: float, colour: str) -> None:
    """A cross at an angle that the path reaches."""
    if theta >= end:  # False for NaN
        ratio = float(damping_ratio(theta, **parameters))
        axis.plot(np.degrees(theta), ratio, "x", color=colour, markersize=5.0, markeredgewidth=1.1, zorder=5)


def _mark_regions(axis: Axes) -> None:
    axis.axhline(1.0, color="0.4", linewidth=0.6, linestyle=":")
    tops = [
        float(np.nanmax(line.get_ydata())) for line in axis.lines if line.get_transform() == axis.transData
    ]
    axis.set_ylim(LOWEST_RATIO, 3.0 * max([1.0, *tops]))
    axis.axhspan(1.0, axis.get_ylim()[1], color="0.94", zorder=0)
    style: Any = {"transform": axis.get_yaxis_transform(), "ha": "right", "fontsize": 7.5, "color": "0.3"}
    axis.text(0.98, 1.25, "overdamped: creep", va="bottom", **style)
    axis.text(0.98, 0.8, "underdamped: slip", va="top", **style)


def _label_degrees(axis: Axes) -> None:
    limits = axis.get_xlim()
    axis.set_xticks([0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 90])
    axis.set_xlim(limits)
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())
