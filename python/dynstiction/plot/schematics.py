"""The model and its angles as drawings (Figs. 1 and 2).

The plane is the floor seen from above, X to the right and Y upwards. The soft principal axis x is at the angle -phi to X.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Polygon

from .notation import Floats
from .style import BLACK, BLUE, COLUMN_WIDTH, GREEN, PURPLE, VERMILION

PHI = np.radians(16.0)
"""Misalignment in the drawings; it is larger than in the scenes so that it is visible."""
GREY = "0.45"
ORIGIN = np.zeros(2)
ALONG_X, ALONG_Y = np.eye(2)


def draw_apparatus(figure: Figure) -> None:
    """Fig. 1: the object on the floor, its two springs, and the frame that pulls them along X."""
    axis = _canvas(figure, (-1.3, 3.75), (-1.55, 1.75))
    soft, stiff = principal_axes(PHI)
    _axis_line(axis, -0.75 * ALONG_X, 3.4 * ALONG_X, "$X$")
    _axis_line(axis, -0.75 * soft, 3.25 * soft, "$x$")
    _axis_line(axis, -0.95 * stiff, 1.55 * stiff, "$y$")
    wall, roof = 2.35 * soft, 1.0 * stiff
    frame = np.array([roof - 0.55 * soft, wall + roof, wall - 0.75 * stiff])
    axis.plot(*frame.T, color=BLACK, linewidth=2.5, solid_joinstyle="miter")
    axis.plot(*coil(0.33 * soft, wall, turns=9, width=0.13).T, color=BLUE, linewidth=1.0)
    axis.plot(*coil(0.33 * stiff, roof, turns=4, width=0.13).T, color=VERMILION, linewidth=1.0)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.33
    style: Any = {"facecolor": "0.85", "edgecolor": BLACK, "linewidth": 0.8, "zorder": 4}
    axis.add_patch(Polygon(corners @ np.stack([soft, stiff]), **style))
    _text(axis, ORIGIN, "$m$", zorder=5)
    _angle(axis, 2.9, -PHI, 0.0, r"$\varphi$")
    _text(axis, 1.35 * soft - 0.26 * stiff, "$k_x$", color=BLUE)
    _text(axis, 0.68 * stiff + 0.36 * soft, "$k_y$", color=VERMILION)
    corner = wall + roof
    _arrow(axis, corner + 0.12 * ALONG_X, corner + 0.9 * ALONG_X, GREEN, 1.4)
    _text(axis, corner + 0.5 * ALONG_X + 0.2 * ALONG_Y, "$V$", color=GREEN)
    # The normal load, into the plane.
    load = np.array([-0.85, 0.75])
    axis.add_patch(Circle(load.tolist(), 0.11, fill=False, linewidth=0.8))
    for sign in (1.0, -1.0):
        axis.plot(*(load + 0.078 * np.array([[-1.0, -sign], [1.0, sign]])).T, color=BLACK, linewidth=0.8)
    _text(axis, load + 0.17 * ALONG_X, "$W$", ha="left")
    note: Any = {"color": GREY, "ha": "left", "fontsize": 7.5}
    _text(axis, np.array([-1.2, -1.45]), "floor at rest, seen from above", **note)


def draw_angles(figure: Figure) -> None:
    """Fig. 2: spring force, slip velocity and friction at the object, and their angles."""
    axis = _canvas(figure, (-1.75, 2.2), (-1.4, 1.75))
    soft, stiff = principal_axes(PHI)
    theta = np.radians(62.0)
    direction = np.cos(theta) * soft + np.sin(theta) * stiff
    across = np.sin(theta) * soft - np.cos(theta) * stiff
    _axis_line(axis, -1.3 * ALONG_X, 1.95 * ALONG_X, "$X$")
    _axis_line(axis, -1.3 * soft, 1.9 * soft, "$x$")
    _axis_line(axis, -0.75 * stiff, 1.5 * stiff, "$y$")
    axis.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color="0.6", linewidth=0.6, linestyle=":"))
    _text(axis, np.array([-0.87, 0.72]), r"$F_0 = \mu_0 W$", color=GREY, ha="right", fontsize=7.5)
    for along, label, colour, place in (
        (np.cos(theta) * soft, "$k_x u_x$", BLUE, -0.2 * stiff),
        (np.sin(theta) * stiff, "$k_y u_y$", VERMILION, -0.27 * soft),
    ):
        axis.plot(*np.stack([along, direction]).T, color=colour, linewidth=0.6, linestyle="--")
        _arrow(axis, ORIGIN, along, colour, 1.0)
        _text(axis, 0.62 * along + place, label, color=colour)
    _arrow(axis, ORIGIN, direction, BLACK, 1.4)
    _text(axis, 0.72 * direction - 0.16 * across, r"$\mathbf{Ku}$")
    _arrow(axis, 1.04 * direction, 1.5 * direction, GREEN, 1.4)
    _text(axis, 1.62 * direction, r"$\mathbf{w}$", color=GREEN)
    _arrow(axis, ORIGIN, -direction, PURPLE, 1.4)
    _text(axis, np.array([-0.98, -1.03]), "friction $-F(v)\\,\\mathbf{w}/v$", color=PURPLE, va="top")
    axis.add_patch(Circle((0.0, 0.0), 0.05, color=BLACK, zorder=4))
    _angle(axis, 1.5, -PHI, 0.0, r"$\varphi$")
    _angle(axis, 0.38, 0.0, theta - PHI, r"$\psi$")
    _angle(axis, 1.22, -PHI, theta - PHI, r"$\theta$")


def principal_axes(phi: float) -> tuple[Floats, Floats]:
    """Unit vectors of the soft and the stiff axis in the (X, Y) plane, for a misalignment [rad]."""
    return np.array([np.cos(phi), -np.sin(phi)]), np.array([np.sin(phi), np.cos(phi)])


def coil(start: Floats, end: Floats, turns: int, width: float) -> Floats:
    """Points, shape (n, 2), of a zigzag spring between two points, straight at both ends."""
    along = np.concatenate([[0.0], np.linspace(0.12, 0.88, 2 * turns + 1), [1.0]])
    side = np.concatenate([[0.0, 0.0], np.resize([1.0, -1.0], 2 * turns - 1), [0.0, 0.0]]) * width
    span = end - start
    length = float(np.hypot(*span))
    normal = np.array([-span[1], span[0]]) / length if length > 0.0 else np.zeros(2)
    return np.asarray(start + along[:, np.newaxis] * span + side[:, np.newaxis] * normal)


def _canvas(figure: Figure, across: tuple[float, float], up: tuple[float, float]) -> Axes:
    """Axes without frame, equal scales, one column wide."""
    figure.set_layout_engine("none")
    figure.set_size_inches(COLUMN_WIDTH, COLUMN_WIDTH * (up[1] - up[0]) / (across[1] - across[0]))
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set(xlim=across, ylim=up, aspect="equal")
    axis.set_axis_off()
    return axis


def _text(axis: Axes, place: Floats, text: str, **style: Any) -> None:
    axis.text(place[0], place[1], text, **{"ha": "center", "va": "center", **style})


def _arrow(axis: Axes, start: Floats, end: Floats, colour: str, width: float, zorder: float = 3.0) -> None:
    head: Any = {"arrowstyle": "-|>,head_length=0.4,head_width=0.16", "shrinkA": 0, "shrinkB": 0}
    head |= {"color": colour, "linewidth": width}
    axis.annotate("", end.tolist(), start.tolist(), zorder=zorder, arrowprops=head)


def _axis_line(axis: Axes, start: Floats, end: Floats, label: str) -> None:
    _arrow(axis, start, end, GREY, 0.6, zorder=1.0)
    _text(axis, end + 0.14 * (end - start) / np.hypot(*(end - start)), label)


def _angle(axis: Axes, radius: float, start: float, end: float, label: str) -> None:
    """Draw an arc from one direction [rad] to another, with its name in the middle."""
    first, last = np.degrees([start, end])
    axis.add_patch(Arc((0.0, 0.0), 2 * radius, 2 * radius, theta1=first, theta2=last, linewidth=0.7))
    middle = 0.5 * (start + end)
    _text(axis, (radius + 0.13) * np.array([np.cos(middle), np.sin(middle)]), label)
