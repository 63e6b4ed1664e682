"""Forces, angle and position against time (Fig. 3)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..result import Result
from ..stick_slip import first_release
from .samples import Floats, columns, thin
from .style import BLACK, BLUE, COLUMN_WIDTH, GREEN, MM, PURPLE, VERMILION, degree_ticks, letter

__all__ = ["draw_history"]


def draw_history(result: Result, figure: Figure) -> None:
    """Spring forces, friction force and angle, and position against time (Fig. 3)."""
    needed = columns(result, "spring_force_x", "spring_force_y", "friction", "theta", "X")
    panels = {
        "$k_x u_x$ [N]": (needed["spring_force_x"], BLUE),
        "$k_y u_y$ [N]": (needed["spring_force_y"], VERMILION),
        "$|F|$ [N]": (needed["friction"], GREEN),
        r"$\theta$ [deg]": (np.degrees(needed["theta"]), PURPLE),
        "$X$ [mm]": (1e3 * needed["X"], BLACK),
    }
    figure.set_size_inches(COLUMN_WIDTH, 160.0 * MM)
    axes = figure.subplots(len(panels), 1, sharex=True)
    for name, axis, (label, (values, colour)) in zip("abcde", axes, panels.items(), strict=True):
        axis.plot(*thin(result.time, values), color=colour)
        axis.set_ylabel(label)
        axis.margins(y=0.12)
        letter(axis, name)
    degree_ticks(axes[3])
    axes[-1].set_xlim(result.time[0], result.time[-1])
    axes[-1].set_xlabel("$t$ [s]")
    figure.align_ylabels(axes)
    _draw_creep(axes[-1], result.time, needed["X"], needed["spring_force_x"])


def _draw_creep(axis: Axes, time: Floats, position: Floats, force: Floats) -> None:
    """Inset: the slow creep of the first stick phase, which the whole history hides."""
    end = first_release(force) + 1
    inset = axis.inset_axes((0.15, 0.53, 0.30, 0.41))
    inset.plot(*thin(time[:end], 1e6 * position[:end]), color=BLACK)
    inset.margins(x=0.0, y=0.1)
    inset.tick_params(labelsize=7.0, pad=1.5, length=2.0)
    inset.text(0.06, 0.93, "creep\n$X$ [µm]", transform=inset.transAxes, va="top", fontsize=7.0)
    inset.locator_params(nbins=3)
