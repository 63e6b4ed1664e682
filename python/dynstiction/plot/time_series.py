"""Columns of a run against time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..errors import UsageError
from ..record import Described
from ..result import Result
from ..stick_slip import first_release
from .samples import columns, thin
from .style import BLACK, BLUE, COLUMN_WIDTH, GREEN, MM, ORANGE, PURPLE, SKY, VERMILION, degree_ticks, panels
from .theory import stiff_frequency

__all__ = [
    "MOST_RESULTS",
    "VELOCITIES",
    "draw_column",
    "draw_comparison",
    "draw_history",
    "draw_series",
    "draw_velocities",
    "show_time",
    "what_differs",
]

COLUMNS = {
    "spring_force_x": ("$k_x u_x$ [N]", 1.0, BLUE),
    "spring_force_y": ("$k_y u_y$ [N]", 1.0, VERMILION),
    "friction": ("$|F|$ [N]", 1.0, GREEN),
    "theta": (r"$\theta$ [deg]", float(np.degrees(1.0)), PURPLE),
    "X": ("$X$ [mm]", 1e3, BLACK),
    "w_x": ("$w_x$ [mm/s]", 1e3, BLUE),
    "w_y": ("$w_y$ [mm/s]", 1e3, VERMILION),
}
"""Label, scale and colour of a column."""

HISTORY, VELOCITIES = tuple(COLUMNS)[:5], ("w_x", "w_y")
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, BLACK, ORANGE, SKY)
"""Of columns that are drawn as they are."""

DETAIL_PERIODS, DETAIL_SAMPLES = 5.0, 40

MOST_RESULTS = 6
"""More columns than these would be too narrow to read."""

ADDED_WIDTH = 46.0 * MM
"""Of each result after the first."""

NEVER_SHOWN = frozenset({"title", "file", "flush_seconds", "checkpoint_interval", "wall_limit"})
"""Parameters that do not change the motion."""


def draw_column(axis: Axes, result: Result, name: str, margin: float = 0.12) -> None:
    """One of `COLUMNS` against time, with its label."""
    label, scale, colour = COLUMNS[name]
    axis.plot(*thin(result.time, scale * result[name]), color=colour)
    axis.set_ylabel(label)
    axis.margins(y=margin)


def show_time(axis: Axes, result: Result) -> None:
    """Times of the whole run along x, with their label."""
    axis.set_xlim(result.time[0], result.time[-1])
    axis.set_xlabel("$t$ [s]")


def draw_history(result: Result, figure: Figure) -> None:
    """Spring forces, friction force and angle, and position against time (Fig. 3)."""
    columns(result, *HISTORY)
    axes = panels(figure, len(HISTORY), 160.0, sharex=True)
    for axis, name in zip(axes, HISTORY, strict=True):
        draw_column(axis, result, name)
    degree_ticks(axes[3])
    show_time(axes[-1], result)
    # The slow creep of the first stick phase, which the whole history hides.
    first = slice(0, first_release(result["spring_force_x"]) + 1)
    inset = axes[-1].inset_axes((0.15, 0.53, 0.30, 0.41))
    inset.plot(*thin(result.time[first], 1e6 * result["X"][first]), color=BLACK)
    inset.margins(x=0.0, y=0.1)
    inset.tick_params(labelsize=7.0, pad=1.5, length=2.0)
    inset.text(0.06, 0.93, "creep\n$X$ [µm]", transform=inset.transAxes, va="top", fontsize=7.0)
    inset.locator_params(nbins=3)


def draw_velocities(result: Result, figure: Figure) -> None:
    """Both slip velocities: left the whole run, right five periods of the stiff axis in its middle."""
    columns(result, *VELOCITIES)
    figure.set_size_inches(COLUMN_WIDTH, 80.0 * MM)
    axes = figure.subplots(2, 2, sharex="col", width_ratios=(3.0, 2.0))
    detail = _detail(result)
    time = 1e3 * (result.time[detail] - result.time[detail][0])
    for row, name in zip(axes, VELOCITIES, strict=True):
        draw_column(row[0], result, name, 0.05)
        _, scale, colour = COLUMNS[name]
        row[1].plot(time, scale * result[name][detail], color=colour)
    show_time(axes[1, 0], result)
    axes[1, 1].set_xlim(0.0, time[-1])
    axes[1, 1].set_xlabel(f"$t$ − {result.time[detail][0]:.6g} s [ms]")
    figure.align_ylabels(axes[:, 0])


def _detail(result: Result) -> slice:
    """Samples of a few periods of the stiff axis from half time on; more where there are not enough samples for a line."""
    frequency = stiff_frequency(result)
    length = 0.0 if frequency is None else DETAIL_PERIODS / frequency
    start = int(np.searchsorted(result.time, 0.5 * (result.time[0] + result.time[-1])))
    start = max(0, min(start, result.time.size - DETAIL_SAMPLES))
    end = int(np.searchsorted(result.time, result.time[start] + length, side="right"))
    return slice(start, max(end, start + DETAIL_SAMPLES))


def draw_series(result: Result, figure: Figure) -> None:
    """Every column as it is, one panel each: for files that hold too few for another kind."""
    names = [name for name in result if name != "time"]
    if not names:
        raise UsageError("nothing to draw: the result holds times only: run again with other output.fields")
    axes = panels(figure, len(names), 28.0 * len(names) + 8.0, letters="", sharex=True)
    for i, (name, axis) in enumerate(zip(names, axes, strict=True)):
        axis.plot(*thin(result.time, result[name]), color=COLOURS[i % len(COLOURS)])
        units = result.columns.units[name]
        axis.set_ylabel(f"{name.replace('_', ' ')} [{'–' if units == '1' else units}]")
        axis.margins(y=0.12)
    show_time(axes[-1], result)


def draw_comparison(results: Mapping[str, Result], figure: Figure) -> None:
    """One column of panels a result, one row a quantity that all have; scales are shared along rows."""
    shown = [name for name in HISTORY if all(name in result for result in results.values())]
    if not shown:
        raise UsageError(f"nothing to compare: the results share none of {', '.join(HISTORY)}")
    figure.set_size_inches(COLUMN_WIDTH + ADDED_WIDTH * (len(results) - 1), (12.0 + 30.0 * len(shown)) * MM)
    axes = figure.subplots(len(shown), len(results), sharex="col", sharey="row", squeeze=False)
    titles = what_differs(results)
    for column, result in zip(axes.T, results.values(), strict=True):
        for name, axis in zip(shown, column, strict=True):
            draw_column(axis, result, name)
            axis.label_outer()
        show_time(column[-1], result)
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
