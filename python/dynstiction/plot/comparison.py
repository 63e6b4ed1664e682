"""Several runs side by side, on the same scales."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ..errors import UsageError
from ..record import Described
from ..result import Result
from .samples import thin
from .style import BLACK, BLUE, COLUMN_WIDTH, GREEN, MM, PURPLE, VERMILION, degree_ticks

__all__ = ["MOST_RESULTS", "draw_comparison", "what_differs"]

MOST_RESULTS = 6
"""More columns than these would be too narrow to read."""

ADDED_WIDTH = 46.0 * MM
"""Of each result after the first."""

NEVER_SHOWN = frozenset({"title", "file", "flush_seconds", "checkpoint_interval", "wall_limit"})
"""Parameters that do not change the motion."""

PANELS = {
    "spring_force_x": ("$k_x u_x$ [N]", 1.0, BLUE),
    "spring_force_y": ("$k_y u_y$ [N]", 1.0, VERMILION),
    "friction": ("$|F|$ [N]", 1.0, GREEN),
    "theta": (r"$\theta$ [deg]", float(np.degrees(1.0)), PURPLE),
    "X": ("$X$ [mm]", 1e3, BLACK),
}


def draw_comparison(results: Mapping[str, Result], figure: Figure) -> None:
    """One column of panels a result, one row a quantity that all have; scales are shared along rows."""
    shown = [name for name in PANELS if all(name in result for result in results.values())]
    if not shown:
        raise UsageError(f"nothing to compare: the results share none of {', '.join(PANELS)}")
    figure.set_size_inches(COLUMN_WIDTH + ADDED_WIDTH * (len(results) - 1), (12.0 + 30.0 * len(shown)) * MM)
    axes = figure.subplots(len(shown), len(results), sharex="col", sharey="row", squeeze=False)
    titles = what_differs(results)
    for column, result in zip(axes.T, results.values(), strict=True):
        for name, axis in zip(shown, column, strict=True):
            label, scale, colour = PANELS[name]
            axis.plot(*thin(result.time, scale * result[name]), color=colour)
            axis.margins(y=0.12)
            axis.set_ylabel(label)
            axis.label_outer()
        column[-1].set_xlim(result.time[0], result.time[-1])
        column[-1].set_xlabel("$t$ [s]")
    if "theta" in shown:
        degree_ticks(axes[shown.index("theta"), 0])
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=7.5)
    figure.align_ylabels(axes[:, 0])


def what_differs(results: Mapping[str, Result]) -> list[str]:
    """Title of each result: its name, and the parameters that not all have alike."""
    parameters = [result.parameters for result in results.values()]
    names = dict.fromkeys(name for each in parameters for name in each if name not in NEVER_SHOWN)
    differing = [name for name in names if len({each.get(name) for each in parameters}) > 1]
    titles = []
    for name, each in zip(results, parameters, strict=True):
        lines = [_value(key, each) for key in differing if key in each]
        titles.append("\n".join([name, *lines[:3], *(["…"] if len(lines) > 3 else [])]))
    return titles


def _value(name: str, parameters: Described[float | str]) -> str:
    value, units = parameters[name], parameters.units[name]
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{name.removesuffix('_deg').replace('_', ' ')} = {text}{'' if units == '1' else f' {units}'}"
