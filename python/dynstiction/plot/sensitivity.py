"""What a cycle hangs on: a bar for each measure and parameter."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import FigureBase

from ..tangents import Sensitivity
from .style import BLUE, MM, VERMILION, sized

__all__ = ["draw_sensitivity"]

ROW = 3.4 * MM
"""Height of a bar with its label."""


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
