"""Slip velocities against time, and some periods of their oscillation."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..result import Result
from .samples import columns, thin
from .style import BLUE, COLUMN_WIDTH, MM, VERMILION
from .theory import stiff_frequency

__all__ = ["VELOCITIES", "draw_velocities"]

VELOCITIES = {"w_x": ("$w_x$ [mm/s]", BLUE), "w_y": ("$w_y$ [mm/s]", VERMILION)}
"""Column, label and colour of each slip velocity."""

DETAIL_PERIODS = 5.0
DETAIL_SAMPLES = 40


def draw_velocities(result: Result, figure: Figure) -> None:
    """Both slip velocities: left the whole run, right five periods of the stiff axis in its middle."""
    needed = columns(result, *VELOCITIES)
    figure.set_size_inches(COLUMN_WIDTH, 80.0 * MM)
    axes = figure.subplots(2, 2, sharex="col", width_ratios=(3.0, 2.0))
    detail = _detail(result)
    middle = result.time[detail][0]
    for row, (name, (label, colour)) in zip(axes, VELOCITIES.items(), strict=True):
        row[0].plot(*thin(result.time, 1e3 * needed[name]), color=colour)
        row[1].plot(1e3 * (result.time[detail] - middle), 1e3 * needed[name][detail], color=colour)
        row[0].set_ylabel(label)
    axes[1, 0].set_xlim(result.time[0], result.time[-1])
    axes[1, 1].set_xlim(0.0, 1e3 * (result.time[detail][-1] - middle))
    axes[1, 0].set_xlabel("$t$ [s]")
    axes[1, 1].set_xlabel(f"$t$ − {middle:.6g} s [ms]")
    figure.align_ylabels(axes[:, 0])


def _detail(result: Result) -> slice:
    """Samples of a few periods of the stiff axis from half time on; more where there are not enough samples for a line."""
    frequency = stiff_frequency(result)
    length = 0.0 if frequency is None else DETAIL_PERIODS / frequency
    start = int(np.searchsorted(result.time, 0.5 * (result.time[0] + result.time[-1])))
    start = max(0, min(start, result.time.size - DETAIL_SAMPLES))
    end = int(np.searchsorted(result.time, result.time[start] + length, side="right"))
    return slice(start, max(end, start + DETAIL_SAMPLES))
