"""Damping diagram: the damping ratio of the slow motion over Lambda and the angle of friction (Fig. 5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import FixedLocator

from ..errors import UsageError
from ..result import Result
from ..stability import damping_ratio
from .notation import MISALIGNMENT
from .style import BLACK, Canvas, one_axes, plain_ticks, ticks_outside
from .theory import damping_crossing, slider
from .view import View

DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)))
COLOURS = "PuOr_r"
"""Its middle is the damping ratio 1."""
MOST_RATIO = 1e5
"""The colours end at this ratio and at its inverse."""
SHOWN = (0.1, 1e5)
"""Least range of Lambda: both sides of 1, below which no angle is overdamped."""
LEAST_ANGLE = 0.5
"""Least angle [deg], unless a run slides at a smaller one."""
MARK: Any = {"color": BLACK, "markeredgewidth": 1.1, "zorder": 5, "clip_on": False}
CIRCLE: Any = {"marker": "o", "linestyle": "", "markersize": 4.0, "fillstyle": "none"}
VISITED: Any = {"color": BLACK, "linewidth": 3.2, "alpha": 0.35}
FINE = 200
"""Cells of the map in each direction."""


def draw_damping(view: View, canvas: Canvas) -> None:
    """Damping ratio over Lambda and angle, with the line of one run."""
    draw_damping_of([view.whole], canvas)


def draw_damping_of(results: Sequence[Result], canvas: Canvas) -> None:
    """Damping ratio of Eq. (10) over Lambda and angle, with the lines of at most two runs (Fig. 5).

    A run has one Lambda. Its line leads from friction across the soft axis (90 deg) down to steady sliding (theta = phi), and is
    thick where the run has been before it first slips or slides. Crosses: damping ratio 1, and steady sliding; circle: damping
    ratio 1 with the weakening of friction.
    """
    sliders = [_slider(result) for result in results]
    constant = [{n: v for n, v in each.items() if n not in ("mu_inf", "v_f")} for each in sliders]
    ratios = [float(damping_ratio(0.5 * np.pi, **each)) for each in constant]
    ends = [float(np.arcsin(abs(np.sin(np.radians(each["misalignment_deg"]))))) for each in sliders]
    axis = one_axes(canvas, 82.0)
    axis.set(xscale="log", yscale="log", xlabel=r"$\Lambda$", ylabel=r"angle of friction $\theta$ [deg]")
    axis.set_xlim(min(SHOWN[0], 0.3 * min(ratios)), max(SHOWN[1], 3.0 * max(ratios)))
    axis.set_ylim(min(LEAST_ANGLE, 0.5 * np.degrees(min(ends))), 90.0)
    _draw_map(axis)
    with_weakening: Any = {}
    for result, parameters, plain, ratio, end, dashes in zip(
        results, sliders, constant, ratios, ends, DASHES, strict=False
    ):
        label = rf"{MISALIGNMENT} = {parameters['misalignment_deg']:.4g}°, $\Lambda$ = {ratio:.4g}"
        line = [90.0, np.degrees(end)]
        axis.plot([ratio] * 2, line, color=BLACK, linestyle=dashes, linewidth=1.0, label=label)
        _draw_visited(axis, result, ratio)
        reached = [theta for theta in (end, damping_crossing(plain, 1.0)) if theta >= end]  # False for NaN
        axis.plot([ratio] * len(reached), np.degrees(reached), "x", markersize=5.0, **MARK)
        crossing = damping_crossing(parameters, 1.0)
        if parameters != plain and crossing >= end:
            axis.plot(ratio, np.degrees(crossing), **CIRCLE, **MARK)
            with_weakening = {"label": r"$\zeta=1$ with weakening", "color": BLACK, **CIRCLE}
    axis.plot([], [], label="run, up to its first slip", **VISITED)
    if with_weakening:
        axis.plot([], [], **with_weakening)
    plain_ticks(axis.yaxis, FixedLocator([0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 90]))
    ticks_outside(axis)
    # Above the axes, where nothing is covered.
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, handlelength=1.2, columnspacing=0.6)


def _slider(result: Result) -> dict[str, Any]:
    parameters = slider(result)
    parameters["velocity"] = abs(parameters["velocity"])
    turning = parameters["velocity"] * np.sin(np.radians(parameters["misalignment_deg"]))
    if turning * parameters["mu_0"] * parameters["normal_load"] == 0.0:
        raise UsageError(
            "without misalignment, drive or friction nothing turns the friction vector and there is no damping ratio: "
            "run with misalignment_deg, velocity, mu_0 and normal_load not 0"
        )
    return parameters


def _draw_map(axis: Axes) -> None:
    """Colours of zeta = Lambda sin^3 theta, and its curve zeta = 1."""
    ratio, degrees = (np.geomspace(*limits, FINE) for limits in (axis.get_xlim(), axis.get_ylim()))
    zeta = ratio * np.sin(np.radians(degrees))[:, np.newaxis] ** 3
    # In the least ratio that the colours have, where zeta underflows.
    zeta = zeta.clip(min=np.finfo(np.float64).tiny)
    style: Any = {"cmap": COLOURS, "norm": LogNorm(1.0 / MOST_RATIO, MOST_RATIO), "shading": "gouraud"}
    picture = axis.pcolormesh(ratio, degrees, zeta, rasterized=True, **style)
    axis.get_figure().colorbar(picture, ax=axis, label=r"damping ratio $\zeta$", extend="both")  # type: ignore[union-attr]
    over = np.geomspace(max(1.0, ratio[0]), ratio[-1], FINE)
    curve = np.degrees(np.arcsin(over ** (-1.0 / 3.0)))
    axis.plot(over, curve, color=BLACK, linewidth=1.6, label=r"$\zeta=1$")


def _draw_visited(axis: Axes, result: Result, ratio: float) -> None:
    """The part of the line on which the run is up to its first slip."""
    force = np.abs(result["spring_force_x"])
    fallen = np.flatnonzero(np.maximum.accumulate(force) - force > 0.05 * force.max())
    before = slice(0, int(np.argmax(force[: fallen[0]])) + 1 if fallen.size else force.size)
    loaded = force[before] > 0.0
    if np.any(loaded):
        sine = np.abs(np.sin(result["theta"][before][loaded]))
        theta = np.degrees(np.arcsin([sine.max(), max(float(sine.min()), 1e-6)]))
        axis.plot([ratio] * 2, theta, solid_capstyle="butt", **VISITED)
