"""Dynamic stiction against Lambda of Eq. (10), the damping of slow creep, in a sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator
from numpy.typing import NDArray

from .notation import MISALIGNMENT, PARAMETERS, Floats
from .style import BLACK, panels, plain_ticks
from .sweep_table import table_of

if TYPE_CHECKING:
    import xarray

__all__ = ["draw_lambda", "slip_angle_of_creep"]

VIRIDIS = colormaps["viridis"]
LIGHTEST = 0.95
"""Share of the colour map that is used: the last colours are too light for marks."""
MOST_NAMED = 8
"""Largest number of angles in the legend; more angles have a colour bar."""
TICKS = 6
PLAIN, SHORT = 200.0, 5.0
"""Largest ratio of the ends of a logarithmic axis for which its ticks are plain, evenly spaced numbers."""

VISIBLE = 0.01
"""Share of F_0 above which a swing is that of stick-slip."""

FREE_OSCILLATION = float(np.arccos(0.9) / np.pi)
"""Share of the time in which X' = V (1 - cos omega t) is at most V/10."""


def slip_angle_of_creep(number: Floats) -> Floats:
    """Angle [rad] of friction at the first slip for large ``Lambda^2 tan(phi)`` and phi far below it (docs/maps.md)."""
    return 1.01627 * np.asarray(4.0 * number) ** -0.2


def draw_lambda(data: xarray.Dataset, figure: FigureBase) -> None:
    """Friction angle at the first slip, creep share and first peak force; colours by misalignment."""
    table = table_of(data)
    names = ("mu_0", "normal_load", "velocity", "misalignment_deg", "mass", "stiffness_x")
    mu_0, load, velocity, degrees, mass, stiffness = (table.parameter(name).reshape(-1) for name in names)
    with np.errstate(divide="ignore"):
        number = mu_0 * load / (2.0 * velocity * np.sin(np.radians(degrees)) * np.sqrt(mass * stiffness))
    slope = np.tan(np.radians(degrees))
    slow = velocity < 0.5 * table.parameter("v_f").reshape(-1) if table.has("v_f") else velocity > 0.0
    visible = table.quantity("swing").reshape(-1) > VISIBLE * mu_0 * load
    creep, peak = table.quantity("creep_share").reshape(-1), table.quantity("first_peak_force").reshape(-1)
    slip = np.degrees(table.quantity("slip_angle").reshape(-1))

    axes = panels(figure, 4, 190.0)
    angles = np.unique(degrees)
    turned, angle_label, unit = np.isfinite(slip), r"$\theta$ at slip [deg]", mu_0 * load
    shown = (
        (number, slip, turned, r"$\Lambda$", angle_label, "log"),
        (number**2 * slope, slip, turned, r"$\Lambda^2\tan\varphi$", angle_label, "log"),
        (number, creep, visible, r"$\Lambda$", "creep share", "linear"),
        (number, peak / unit, visible, r"$\Lambda$", "first peak / $F_0$", "log"),
    )
    for panel, (x, y, chosen, xlabel, ylabel, yscale) in zip(axes, shown, strict=True):
        panel.set(xscale="log", yscale=yscale, xlabel=xlabel, ylabel=ylabel)
        for i, angle in enumerate(angles):
            for filled in (True, False):
                here = chosen & (degrees == angle) & (slow == filled) & np.isfinite(x)
                style: Any = {"markersize": 2.5, "markeredgewidth": 0.6, "color": _colour(i, angles)}
                panel.plot(x[here], y[here], "o", fillstyle="full" if filled else "none", **style)
    theory = _finish(axes, number, angles)
    marks: list[Any] = (
        [] if slow.all() else [("0.4", "full", "$V < v_f/2$"), ("0.4", "none", r"$V \geq v_f/2$")]
    )
    if angles.size <= MOST_NAMED:
        named = [rf"{MISALIGNMENT} = {angle:.4g}°" for angle in angles]
        marks = [*((_colour(i, angles), "full", name) for i, name in enumerate(named)), *marks]
    else:
        # The marks are evenly spaced in colour: the numbers at the bar are the values.
        scale = ScalarMappable(Normalize(0.0, (angles.size - 1) / LIGHTEST), VIRIDIS)
        above: Any = {"location": "top", "aspect": 40, "pad": 0.01}
        bar = figure.colorbar(scale, ax=list(axes), label=PARAMETERS["misalignment_deg"].label, **above)
        ticks = np.unique(np.linspace(0, angles.size - 1, TICKS).astype(int))
        bar.set_ticks(list(ticks), labels=[f"{angles[i]:.3g}" for i in ticks])
        bar.ax.set_xlim(0.0, angles.size - 1)
    dot: Any = {"marker": "o", "linestyle": "none", "markersize": 3.0}
    handles = [
        Line2D([], [], color=colour, fillstyle=fill, label=label, **dot) for colour, fill, label in marks
    ]
    figure.legend(handles=[*handles, *theory], loc="outside lower center", ncols=2, columnspacing=1.2)


def _finish(axes: NDArray[Any], number: Floats, angles: Floats) -> list[Line2D]:
    """Draw the lines of theory, which are returned, and set ticks."""
    ends = np.geomspace(np.nanmin(number), np.nanmax(number[np.isfinite(number)]), 50)
    large, small = np.geomspace(1.0, 1e7), np.geomspace(1e-5, 1.0)
    style: Any = {"color": BLACK, "zorder": 1.5}
    slip = np.degrees(slip_angle_of_creep(large)), np.degrees(np.arctan2(1.0, 2.0 * small))
    (creep,) = axes[1].plot(large, slip[0], linestyle="--", label="(b) slip out of creep", **style)
    (inertia,) = axes[1].plot(small, slip[1], linestyle=":", label="(b) slip at once", **style)
    free = axes[2].axhline(FREE_OSCILLATION, linestyle="-.", label="(c) free oscillation", **style)
    axes[2].set_ylim(-0.03, 1.03)
    for i, angle in enumerate(angles):
        if angle > 0.0:
            beyond = 1.0 / (2.0 * ends * np.sin(np.radians(angle)))
            axes[3].plot(ends, 1.0 + beyond, color=_colour(i, angles), linewidth=0.5)
    for side in (side for panel in axes for side in (panel.xaxis, panel.yaxis)):
        low, high = side.get_view_interval()
        # A short logarithmic axis would otherwise have numbers like 8 x 10^0.
        if side.get_scale() == "log" and 0.0 < low < high < PLAIN * low and low > 1e-3 and high < 1e4:
            # It may contain only one of 1, 2 and 5.
            is_short = high < SHORT * low
            plain_ticks(side, MaxNLocator(4) if is_short else LogLocator(subs=(1.0, 2.0, 5.0)))
    overshoot = Line2D([], [], color="0.4", linewidth=0.5, label=r"(d) $1+1/(2\Lambda\sin\varphi)$")
    return [creep, inertia, free, overshoot]


def _colour(i: int, angles: Floats) -> tuple[float, float, float, float]:
    return VIRIDIS(LIGHTEST * i / max(1, angles.size - 1))
