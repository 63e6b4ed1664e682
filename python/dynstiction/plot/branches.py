"""Limit cycles: their branches over a key, stable ones solid and unstable ones broken, and what a cycle hangs on."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from ..branches import Branches, cycles_in_words
from ..errors import UsageError
from ..record import headed
from ..tangents import Sensitivity
from .notation import PARAMETERS, QUANTITIES, Floats
from .style import (
    BLACK,
    BLUE,
    GREEN,
    MM,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    legend_above,
    one_axes,
    plain_ticks,
    sized,
    with_margin,
)
from .sweep_table import Axis

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
"""Of branches of 1, 2, 3 ... slow cycles; the last one of all others."""
MARKS = {"fold": "s", "doubling": "o", "grazing": "x", "without rest": "^", "sliding": "D"}
"""Marks of special points; the border of the range has none."""
MARK: dict[str, Any] = {"markersize": 3.5, "markerfacecolor": "white", "markeredgewidth": 0.8}
UNSTABLE = (0, (2.5, 1.5))
ROW = 3.4 * MM
"""Height of the bar of a sensitivity with its label."""
UNITS = {"period": "s", "stick_duration": "s", "slip_duration": "s", "slip_length": "m"}


def draw_branches(found: Branches, figure: FigureBase, quantity: str = "peak_force") -> None:
    """A quantity of the cycles over the key."""
    if not found.branches:
        raise UsageError("nothing to draw: no branch was found")
    axis = one_axes(figure, 76.0)
    put_branches(axis, found, quantity)
    side = Axis(
        found.key.rpartition(".")[2], np.concatenate([each.values for each in found.branches]), found.units
    )
    axis.set_xlabel(side.symbol.label)
    axis.set_ylabel(headed(QUANTITIES.get(quantity, quantity.replace("_", " ")), UNITS.get(quantity, "N")))
    low, high = side.shown.min(), side.shown.max()
    is_wide = low > 0.0 and high > 10.0 * low
    if is_wide:
        axis.set_xscale("log")
        plain_ticks(axis.xaxis, LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_xlim(*with_margin(low, high, 0.02, is_wide))
    legend_above(figure, _legend(found), 3)


def _legend(found: Branches) -> list[Line2D]:
    counts = sorted({each.slow_cycles for each in found.branches})
    handles = [Line2D([], [], color=_colour(count), label=cycles_in_words(count)) for count in counts]
    stable = np.concatenate([each.stable for each in found.branches])
    if not stable.all():
        handles += [Line2D([], [], color="0.35", label="stable")] if stable.any() else []
        handles.append(Line2D([], [], color="0.35", linestyle=UNSTABLE, label="unstable"))
    there = {point.kind for each in found.branches for point in each.points}
    return handles + [
        Line2D([], [], color="0.35", linestyle="", marker=mark, label=kind, **MARK)
        for kind, mark in MARKS.items()
        if kind in there
    ]


def _colour(slow_cycles: int) -> str:
    return COLOURS[min(max(slow_cycles, 1), len(COLOURS)) - 1]


def put_branches(axis: Axes, found: Branches, quantity: str) -> None:
    """Lines and marks of branches in axes of their key."""
    name = found.key.rpartition(".")[2]
    factor = PARAMETERS[name].factor if name in PARAMETERS else 1.0
    for each in found.branches:
        if quantity not in each._fields or not isinstance(getattr(each, quantity), np.ndarray):
            raise UsageError(
                f"no quantity {quantity!r} of a branch: draw peak_force, valley_force, period, or another measure"
            )
        values: Floats = getattr(each, quantity)
        colour = _colour(each.slow_cycles)
        # A stretch is stable if the middle of its ends is: one of them may be a fold.
        slope = 0.5 * (each.multiplier[:-1] + each.multiplier[1:])
        stable = np.abs(slope) < 1.0
        for stretch in np.split(np.arange(stable.size), np.flatnonzero(np.diff(stable)) + 1):
            part = slice(stretch[0], stretch[-1] + 2)
            style = "-" if stable[stretch[0]] else UNSTABLE
            axis.plot(factor * each.values[part], values[part], color=colour, linewidth=0.9, linestyle=style)
        for point in each.points:
            if point.kind in MARKS and quantity in point._fields:
                place = factor * point.value, getattr(point, quantity)
                axis.plot(*place, MARKS[point.kind], color=colour, zorder=3.0, **MARK)


def draw_sensitivity(result: Sensitivity, canvas: FigureBase) -> None:
    """Elasticities: one panel for each measure of the cycle, with a bar for each parameter."""
    keys = [key.partition(".")[2] for key in result.parameters]
    names = list(result.cycle)
    sized(canvas, (2.0 * ROW * (len(keys) + 3.5)) / MM)
    axes = np.ravel(canvas.subplots(2, (len(names) + 1) // 2, sharey=True))
    places = np.arange(len(keys))
    for axis, name, changes in zip(axes, names, result.elasticities, strict=False):
        axis.barh(places, changes, color=np.where(changes < 0.0, VERMILION, BLUE), height=0.7)
        axis.axvline(0.0, color="0.35", linewidth=0.6)
        axis.set_title(name.replace("_", " "), fontsize="medium")
        axis.margins(x=0.12)
    axes[0].set(yticks=places, yticklabels=keys)
    axes[0].invert_yaxis()
    canvas.supxlabel("percent per percent", fontsize="medium")
