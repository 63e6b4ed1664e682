"""Path of the tip of the friction vector."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from ..result import Result
from .samples import BINS, Floats, columns
from .style import COLUMN_WIDTH, MM

__all__ = ["draw_path"]


def draw_path(result: Result, figure: Figure) -> None:
    """Path of the tip of the friction vector in the plane of the principal axes, over a circle."""
    needed = columns(result, "friction", "theta")
    force = needed["friction"]
    tip = np.stack([force * np.cos(needed["theta"]), force * np.sin(needed["theta"])], axis=1)
    kept = _visible_steps(tip)
    figure.set_size_inches(COLUMN_WIDTH, 66.0 * MM)
    axis = figure.subplots()
    axis.add_patch(Circle((0.0, 0.0), force.max(), fill=False, color="0.6", linewidth=0.6, linestyle=":"))
    segments = np.stack([tip[kept[:-1]], tip[kept[1:]]], axis=1)
    # The friction force jumps when a stick begins; a fine line joins what belongs together.
    jumps = np.hypot(*np.diff(tip[kept], axis=0).T) > 0.2 * force.max()
    widths = np.where(jumps, 0.25, 0.8)
    lines = LineCollection(list(segments), array=result.time[kept[1:]], cmap="viridis", linewidths=widths)
    lines.set_clim(result.time[0], result.time[-1])
    axis.add_collection(lines)
    axis.set_xlim(_with_margin(tip[:, 0]))
    axis.set_ylim(_with_margin(tip[:, 1]))
    axis.set_aspect("equal")
    axis.set_xlabel("$F_x$ [N]")
    axis.set_ylabel("$F_y$ [N]")
    figure.colorbar(lines, ax=axis, label="$t$ [s]", pad=0.02)


def _visible_steps(points: Floats) -> NDArray[np.intp]:
    """Indices of the points (n, 2) that lie in another dot than the one before."""
    dots = np.rint((points - points.min(axis=0)) * (BINS / max(np.ptp(points, axis=0).max(), 1e-300)))
    moved = np.any(dots[1:] != dots[:-1], axis=1)
    return np.flatnonzero(np.concatenate([[True], moved[:-1], [True]]))


def _with_margin(values: Floats) -> tuple[float, float]:
    margin = 0.05 * (np.ptp(values) or 1.0)
    return float(values.min() - margin), float(values.max() + margin)
