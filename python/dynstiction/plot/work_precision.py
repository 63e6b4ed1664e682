"""Work-precision diagram: error and cost of every point of a comparison."""

from __future__ import annotations

from functools import cache
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D

from .._native import catalogue
from .._trade import Trade
from ..errors import UsageError
from .samples import Floats
from .style import BLACK, BLUE, BROWN, GREEN, ORANGE, PURPLE, SKY, VERMILION, panels

__all__ = ["Family", "draw_work_precision", "families"]

COLOURS = (ORANGE, BLUE, SKY, VERMILION, PURPLE, BROWN, BLACK, GREEN)
"""Colours of the methods, in the order of the core's list."""
KINDS = {
    "full": ("full model, exact contact", "o", "full"),
    "direct": ("full model without the cycle map", "o", "none"),
    "smoothed": ("full model, smoothed contact", "s", "none"),
    "low_frequency": ("low-frequency model", "^", "none"),
    "high_frequency": ("high-frequency model", "v", "none"),
    "creep": ("creep in closed form", "*", "full"),
}
"""Kinds of equations: name in the legend, mark, filled or not."""
LINES = {"full": "-", "direct": ":"}
"""Kinds whose points are joined."""

PANELS = ("final_elongation", "period", "creep_velocity", "fast_phase")
"""Quantities that have a panel, if the scene has them; at most three."""

LABELS = {
    "final_elongation": "error of the final elongation",
    "period": "error of the period",
    "creep_velocity": "error of the creep velocity",
    "fast_phase": r"error of the fast phase, over $\pi$",
}


class Family(NamedTuple):
    """Points that differ in tolerance or step only, the coarse ones first.

    Errors below the floor, the resolution of the reference, are drawn at the floor: `known` is False there.
    """

    kind: str
    method: str
    error: Floats
    seconds: Floats
    known: np.ndarray[tuple[int], np.dtype[np.bool_]]


def families(trade: Trade, quantity: str) -> list[Family]:
    """Measured points of a comparison by family, for one quantity."""
    error, floor = trade.error(quantity), trade.floor(quantity)
    coarseness = np.fmax(trade.number("rtol"), trade.number("step"))
    rows: dict[tuple[str, str, float], list[int]] = {}
    for i in np.flatnonzero(trade.done):
        model = str(trade["model"][i]).removesuffix("_asymptotic")
        kind = "smoothed" if trade["contact"][i] == "smoothed" else model
        kind = "direct" if trade["cycle_map"][i] == "off" else kind
        rows.setdefault((kind, str(trade["method"][i]), float(trade["v_smooth"][i])), []).append(int(i))
    found = []
    for (kind, method, _), members in rows.items():
        members.sort(key=lambda i: -float(coarseness[i]))
        size = error[members]
        known = size > floor
        found.append(
            Family(kind, method, np.where(known, size, floor), trade.number("seconds")[members], known)
        )
    return found


def draw_work_precision(trade: Trade, figure: FigureBase) -> None:
    """Cost against error, one panel for each quantity; errors in the grey part are below the resolution of the reference."""
    shown = [name for name in PANELS if name in trade.quantities][:3]
    if not shown or not trade.done.any():
        raise UsageError("nothing to draw: no point was measured: give dynstiction trade a larger --budget")
    axes = panels(figure, len(shown), 25.0 + 55.0 * len(shown), sharey=True)
    drawn: set[str] = set()
    for axis, quantity in zip(axes, shown, strict=True):
        drawn |= _draw_panel(axis, trade, quantity)
    figure.legend(
        handles=_legend(drawn), loc="outside lower center", ncols=2, handletextpad=0.3, columnspacing=1.0
    )


def _draw_panel(axis: Axes, trade: Trade, quantity: str) -> set[str]:
    """Draw the points of one quantity; return the methods and kinds that occur."""
    drawn: set[str] = set()
    for family in families(trade, quantity):
        drawn |= {family.kind, family.method}
        _, mark, fill = KINDS[family.kind]
        colour = _colours().get(family.method, BLACK)
        style: Any = {"color": colour, "markersize": 3.5, "markeredgewidth": 0.7}
        if family.kind in LINES:
            axis.plot(family.error, family.seconds, LINES[family.kind], color=colour, alpha=0.6)
        known = family.known
        axis.plot(family.error[known], family.seconds[known], mark, fillstyle=fill, **style)
        axis.plot(family.error[~known], family.seconds[~known], "<", fillstyle="none", **style)
    axis.set(xscale="log", yscale="log", xlabel=LABELS[quantity], ylabel="wall time [s]")
    axis.axvspan(axis.get_xlim()[0], trade.floor(quantity), color="0.9", linewidth=0.0)
    axis.set_xlim(left=0.3 * trade.floor(quantity))
    return drawn


@cache
def _colours() -> dict[str, str]:
    return {
        method["name"]: colour for method, colour in zip(catalogue()["methods"], cycle(COLOURS), strict=False)
    }


def _legend(drawn: set[str]) -> list[Line2D]:
    """Methods by colour, equations by mark."""
    methods = [
        Line2D([], [], color=colour, label=name, linewidth=1.2)
        for name, colour in _colours().items()
        if name in drawn
    ]
    kinds = [
        Line2D([], [], color="0.4", marker=mark, fillstyle=fill, markersize=3.5, linestyle="none", label=text)  # type: ignore[arg-type]
        for kind, (text, mark, fill) in KINDS.items()
        if kind in drawn
    ]
    return methods + kinds
