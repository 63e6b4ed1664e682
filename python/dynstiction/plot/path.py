"""Path of the tip of the friction vector."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection

from .notation import BINS, Floats
from .style import Canvas, note, one_axes
from .view import View

NARROWEST = 0.1
"""Least ratio of the sides of the view."""

FINEST = 1e-9
"""Least side of the view over the distance from 0: smaller views would need numbers that are too long for the axis."""

ARC_POINTS = 2000


def draw_path(view: View, canvas: Canvas) -> None:
    """Path of the tip of the friction vector in the plane of the principal axes, over a circle."""
    # At t = 0 the object has its start velocity; friction jumps when the object comes to rest, which takes no time.
    first = int(view.result.time[0] == 0.0 and view.result.time.size > 2)
    time, force, theta = (view.result[name][first:] for name in ("time", "friction", "theta"))
    tip = np.stack([force * np.cos(theta), force * np.sin(theta)], axis=1)
    # Samples that are in a different dot than the one before.
    dots = np.rint((tip - tip.min(axis=0)) * (BINS / max(np.ptp(tip, axis=0).max(), 1e-300)))
    moved = np.any(dots[1:] != dots[:-1], axis=1)
    kept = np.flatnonzero(np.concatenate([[True], moved[:-1], [True]]))
    axis = one_axes(canvas, 70.0)
    segments = np.stack([tip[kept[:-1]], tip[kept[1:]]], axis=1)
    # The friction force jumps when a stick begins; a thin line joins both ends of a jump.
    jumps = np.hypot(*np.diff(tip[kept], axis=0).T) > 0.2 * force.max()
    widths = np.where(jumps, 0.25, 0.8)
    lines = LineCollection(list(segments), array=time[kept[1:]], cmap="viridis", linewidths=widths)
    lines.set_clim(time[0], time[-1])
    axis.add_collection(lines)
    shown = _view(tip)
    axis.plot(
        *_arc(float(force.max()), shown), color="0.35", linewidth=0.8, linestyle=":", label="largest $|F|$"
    )
    axis.set(xlim=shown[:, 0], ylim=shown[:, 1], aspect="equal", xlabel="$F_x$ [N]", ylabel="$F_y$ [N]")
    axis.figure.colorbar(lines, ax=axis, label="$t$ [s]", pad=0.02)
    note(axis, (*view.notes, "dotted: a circle with the largest $|F|$"))


def _view(points: Floats) -> Floats:
    """Lower left and upper right corner of the view: the points with a margin, with a least width and height."""
    low, high = points.min(axis=0), points.max(axis=0)
    spans = high - low
    least = max(NARROWEST * spans.max(), FINEST * np.abs(points).max())
    spans = np.maximum(spans, least or 1.0)
    middle, half = low + 0.5 * (high - low), 0.55 * spans
    return np.stack([middle - half, middle + half])


def _arc(radius: float, view: Floats) -> tuple[Floats, Floats]:
    """The visible part of a circle with its centre at 0: drawing the parts far outside would not end."""
    start, end = -np.pi, np.pi
    if not np.all(view[0] * view[1] < 0.0):
        # Angles from the middle of the view, so that none jumps from pi to -pi.
        middle = np.arctan2(*view.mean(axis=0)[::-1])
        corners = np.array([[x, y] for x in view[:, 0] for y in view[:, 1]])
        turned = np.arctan2(corners[:, 1], corners[:, 0]) - middle
        turned = (turned + np.pi) % (2.0 * np.pi) - np.pi
        start, end = middle + turned.min(), middle + turned.max()
    angles = np.linspace(start, end, ARC_POINTS)
    return radius * np.cos(angles), radius * np.sin(angles)
