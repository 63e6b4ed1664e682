"""Columns of runs against time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..errors import ColumnError, UsageError
from ..record import Described
from ..result import Result
from ..stick_slip import first_release
from .notation import COLUMNS, PARAMETERS, label_of, scaled, with_unit
from .samples import Floats, columns, thin
from .style import (
    BLACK,
    BLUE,
    COLUMN_WIDTH,
    GREEN,
    MM,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    degree_ticks,
    note,
    panels,
    sized,
)
from .theory import drive_profile, driven_length, static_limit, steady_friction, stiff_frequency
from .view import View, view_of

__all__ = [
    "HISTORY",
    "MOST_RESULTS",
    "VELOCITIES",
    "draw_column",
    "draw_comparison",
    "draw_history",
    "draw_in_axes",
    "draw_overlay",
    "draw_series",
    "draw_velocities",
    "show_time",
    "what_differs",
]

HISTORY = ("spring_force_x", "spring_force_y", "pull_force", "friction", "psi", "X")
VELOCITIES = ("w_x", "w_y")
OVERLAID = ("spring_force_x", "psi", "X")
"""Default columns of several runs in the same panels."""
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, BLACK, ORANGE, SKY)
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1, 1)),
    (0, (5, 1, 1, 1)),
    (0, (8, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
)
"""Dashes of lines in the same panel: colours alone are not distinguishable in print."""

AT_START = ("friction", "theta", "theta_deg", "psi")
"""Columns that jump after the sample at t = 0, where the object still has its start velocity and then comes to rest."""

DETAIL_PERIODS, DETAIL_SAMPLES = 5.0, 40

FEW = 6
"""Number of columns above which the panels are lower, so that they fit on a page."""

MOST_RESULTS = 6
"""Largest number of results side by side; more would be too narrow to read."""

ADDED_WIDTH = 46.0
"""Width of each result after the first [mm]."""

FORCE, TEXT = "0.45", "0.25"
SLIP = "0.85"
"""Grey of the intervals of time in which the object slips."""
MOST_SLIPS = 60
"""Largest number of grey intervals; more would make the panels grey."""
WIDTH = 52
"""Characters of a line of the legend, including the markup of symbols."""
VISIBLE = 0.01
"""Share of F_0 by which the steady force must differ from F_0 to get a separate line."""

NEVER_SHOWN = frozenset(
    {
        "title", "file", "checkpoint_interval", "wall_limit", "interval", "fields", "max_steps",
        "t_end",
        "threads", "accuracy", "quantities", "stop_at_steady", "overwrite",
    }
)  # fmt: skip
"""Parameters that do not change the motion, or not in a way that matters to the reader."""

INSETS = (
    (0.125, 0.60, 0.265, 0.34),
    (0.64, 0.19, 0.33, 0.34),
    (0.13, 0.19, 0.28, 0.34),
    (0.64, 0.60, 0.33, 0.34),
)
"""Possible places of an inset: left, bottom, width, height in shares of the panel."""
INSET_LABELS = (0.115, 0.15)
"""Space of the numbers of an inset, on its left and below it."""
LEAST_CREEP, MOST_CREEP = 20, 0.6
"""Samples of the first creep that an inset needs, and the share of the panel's height above which the panel itself shows it."""


def draw_column(
    axis: Axes, result: Result, name: str, margin: float = 0.12, scale: tuple[Floats, ...] = ()
) -> None:
    """Draw one column against time, with its label, in the unit that suits the column or the values `scale`."""
    label, factor, colour = label_of(name, result.columns.units[name], *(scale or (result[name],)))
    axis.plot(*_line(result, name, factor), color=colour)
    axis.set_ylabel(label)
    axis.margins(y=margin)


def show_time(axis: Axes, result: Result) -> None:
    """Set the limits and the label of the time axis."""
    axis.set_xlim(result.time[0], result.time[-1])
    axis.set_xlabel("$t$ [s]")


def draw_history(
    result: Result,
    figure: FigureBase,
    *,
    names: Sequence[str] = (),
    start: float | None = None,
    end: float | None = None,
) -> None:
    """Spring forces, the force of the load cell, friction force and angle, position against time (Fig. 3), or other columns; above
    them V(t) of a profile.
    """
    # A file of an earlier version has no pull_force.
    names = names or [name for name in HISTORY if name != "pull_force" or name in result]
    columns(result, *names)
    view = view_of(result, start, end)
    profile = drive_profile(result)
    count = len(names) + (profile is not None)
    axes = panels(figure, count, 28.0 * count + 20.0, sharex=True)
    note(axes[0], view.notes)
    if profile is not None:
        _draw_drive(axes[0], profile, view.result)
    lines: dict[str, Line2D | Patch] = {}
    for axis, name in zip(axes[count - len(names) :], names, strict=True):
        draw_column(axis, view.result, name)
        lines |= _draw_limits(axis, view, name)
        if "theta" in name or name == "psi":
            degree_ticks(axis)
    lines |= _mark_slips(axes, view)
    show_time(axes[-1], view.result)
    if "X" in names:
        _draw_creep_inset(axes[count - len(names) + list(names).index("X")], view)
    if lines:
        figure.legend(
            handles=list(lines.values()),
            loc="outside upper center",
            ncols=len(lines),
            handlelength=1.8,
            columnspacing=1.0,
        )


def draw_in_axes(
    result: Result, axes: Sequence[Axes], names: Sequence[str], start: float | None, end: float | None
) -> None:
    """Draw one column into each of several axes."""
    columns(result, *names)
    view = view_of(result, start, end)
    for axis, name in zip(axes, names, strict=True):
        draw_column(axis, view.result, name)
        show_time(axis, view.result)
    note(axes[0], view.notes)


def _line(result: Result, name: str, factor: float) -> tuple[Floats, Floats]:
    """Samples of a column that are drawn: without that at t = 0 if it would show a jump that takes no time."""
    first = int(name in AT_START and result.time[0] == 0.0 and result.time.size > 2)
    return thin(result.time[first:], factor * result[name][first:])


def _draw_drive(axis: Axes, profile: tuple[Floats, Floats], result: Result) -> None:
    """V(t) as a line through the corners of the drive."""
    corners, velocity = profile
    factor, unit = scaled("m/s", velocity)
    ends = result.time[[0, -1]]
    time = np.concatenate([corners, [max(corners[-1], ends[1])]])
    axis.plot(time, factor * np.append(velocity, velocity[-1]), color=BLACK)
    axis.set_ylabel(with_unit("$V$", unit))
    axis.margins(y=0.12)


def _draw_limits(axis: Axes, view: View, name: str) -> dict[str, Line2D | Patch]:
    """Draw the static limit and steady sliding in the panels that have them, and the driven end in that of the position."""
    drawn: dict[str, Line2D | Patch] = {}
    if name == "X":
        driven = driven_length(view.whole, view.result.time)
        if driven is not None:
            factor = label_of("X", "m", view.result["X"])[1]
            low, high = axis.get_ylim()
            (drawn["driven"],) = axis.plot(
                view.result.time,
                factor * driven,
                color=FORCE,
                linewidth=0.6,
                linestyle=":",
                label="driven end",
                zorder=1.5,
            )
            # Before the first slip it is far ahead; so the position remains readable.
            axis.set_ylim(
                low, max(high, min(float(np.max(factor * driven)) * 1.05, high + 0.5 * (high - low)))
            )
    if name not in ("spring_force_x", "friction"):
        return drawn
    limit, steady = static_limit(view.whole), steady_friction(view.whole)
    if not limit:
        return drawn
    phi = np.radians(float(view.whole.parameters.get("misalignment_deg", 0.0)))
    velocity = float(view.whole.parameters.get("velocity", 1.0))
    along = np.cos(phi) * np.sign(velocity) if name == "spring_force_x" else 1.0
    factor = label_of(name, "N", view.result[name])[1]
    side = np.sign(along) or 1.0
    style: Any = {"color": FORCE, "linewidth": 0.6, "zorder": 1.5}
    drawn["limit"] = axis.axhline(factor * side * limit, linestyle=(0, (5, 2)), label="$F_0$", **style)
    if steady is not None and abs(steady * abs(along) - limit) > VISIBLE * limit:
        drawn["steady"] = axis.axhline(
            factor * along * steady, linestyle=(0, (5, 1.5, 1, 1.5)), label="steady sliding", **style
        )
    return drawn


def _mark_slips(axes: Iterable[Axes], view: View) -> dict[str, Line2D | Patch]:
    """Grey intervals from each peak of the load to its valley."""
    slips = view.slips()
    if not 0 < len(slips) <= MOST_SLIPS:
        return {}
    for axis in axes:
        for begin, end in slips:
            axis.axvspan(begin, end, color=SLIP, linewidth=0.0, zorder=0.5)
    return {"slip": Patch(color=SLIP, label="slip")}


def _draw_creep_inset(axis: Axes, view: View) -> None:
    """Inset with the slow creep of the first stick phase, which is not visible in the whole history, if the panel has room."""
    if not view.starts_the_run or "spring_force_x" not in view.whole or "X" not in view.whole:
        return
    first = slice(0, first_release(view.whole["spring_force_x"]) + 1)
    time, place = view.whole.time[first], view.whole["X"][first]
    height = float(np.ptp(view.result["X"]))
    if (
        time.size < LEAST_CREEP
        or time[-1] > view.result.time[-1]
        or not 0.0 < np.ptp(place) < MOST_CREEP * height
    ):
        return
    corner = _free_corner(axis)
    if corner is None:
        return
    factor, unit = scaled("m", place)
    inset = axis.inset_axes(corner)
    inset.plot(*thin(time, factor * place), color=BLACK)
    inset.margins(x=0.0, y=0.1)
    inset.tick_params(labelsize=7.0, pad=1.5, length=2.0)
    inset.tick_params(axis="x", pad=3.5)
    inset.text(0.06, 0.93, f"creep\n$X$ [{unit}]", transform=inset.transAxes, va="top", fontsize=7.0)
    inset.locator_params(nbins=3)


def _free_corner(axis: Axes) -> tuple[float, float, float, float] | None:
    """The first place of an inset that no line of the panel crosses, its numbers included."""
    (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
    lines = [line for line in axis.lines if line.get_transform() == axis.transData]
    for place in INSETS:
        x, y = place[0] - INSET_LABELS[0], place[1] - INSET_LABELS[1]
        crossed = False
        for line in lines:
            across = (np.asarray(line.get_xdata(), dtype=float) - left) / (right - left)
            up = (np.asarray(line.get_ydata(), dtype=float) - low) / (high - low)
            # A line with few points may cross the inset between two points.
            fine = np.linspace(across.min(), across.max(), 500)
            across, up = np.append(across, fine), np.append(up, np.interp(fine, across, up))
            crossed |= bool(
                np.any(
                    (across > x)
                    & (across < place[0] + place[2] + 0.01)
                    & (up > y)
                    & (up < place[1] + place[3] + 0.03)
                )
            )
        if not crossed:
            return place
    return None


def draw_velocities(
    result: Result, figure: FigureBase, *, start: float | None = None, end: float | None = None
) -> None:
    """Both slip velocities: left in the part shown, right in five periods of the stiff axis halfway to the first slip."""
    columns(result, *VELOCITIES)
    view = view_of(result, start, end)
    sized(figure, 80.0)
    axes = figure.subplots(2, 2, sharex="col", width_ratios=(3.0, 2.0))
    shown = view.result
    slips = view.slips()
    detail = _detail(shown, float(slips[0, 0]) if slips.size else float(shown.time[-1]))
    both = tuple(shown[name] for name in VELOCITIES)
    time = 1e3 * (shown.time[detail] - shown.time[detail][0])
    for row, name in zip(axes, VELOCITIES, strict=True):
        draw_column(row[0], shown, name, 0.05, both)
        _, factor, colour = label_of(name, "m/s", *both)
        row[1].plot(time, factor * shown[name][detail], color=colour)
    note(axes[0, 1], view.notes)
    show_time(axes[1, 0], shown)
    axes[1, 1].set_xlim(0.0, time[-1])
    axes[1, 1].set_xlabel(f"$t$ − {shown.time[detail][0]:.6g} s [ms]")
    figure.align_ylabels(axes[:, 0])


def _detail(result: Result, until: float) -> slice:
    """Samples of a few periods of the stiff axis, from half of a time on; more periods if these are too few samples for a line."""
    frequency = stiff_frequency(result)
    length = 0.0 if frequency is None else DETAIL_PERIODS / frequency
    start = int(np.searchsorted(result.time, 0.5 * (result.time[0] + max(until, float(result.time[0])))))
    start = max(0, min(start, result.time.size - DETAIL_SAMPLES))
    end = int(np.searchsorted(result.time, result.time[start] + length, side="right"))
    return slice(start, max(end, start + DETAIL_SAMPLES))


def draw_series(
    result: Result,
    figure: FigureBase,
    *,
    names: Sequence[str] = (),
    start: float | None = None,
    end: float | None = None,
) -> None:
    """All columns, or some, one in each panel: for files with too few columns for another kind."""
    held = [name for name in result if name != "time"]
    if not held:
        raise UsageError("nothing to draw: the result holds times only: run again with other output.fields")
    # Known columns in the order of the figures, the others in the order of the file.
    names = names or sorted(
        held, key=lambda name: list(COLUMNS).index(name) if name in COLUMNS else len(COLUMNS)
    )
    columns(result, *names)
    view = view_of(result, start, end)
    axes = panels(
        figure, len(names), (26.0 if len(names) <= FEW else 18.0) * len(names) + 12.0, letters="", sharex=True
    )
    for i, (name, axis) in enumerate(zip(names, axes, strict=True)):
        draw_column(axis, view.result, name)
        axis.lines[0].set_color(COLOURS[i % len(COLOURS)])
        if "theta" in name or name == "psi":
            degree_ticks(axis)
    note(axes[0], view.notes)
    show_time(axes[-1], view.result)


def _shared(results: Mapping[str, Result], names: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """The columns to compare: the named ones, which all results must have, or those of the usual ones that all have."""
    if names:
        for name, result in results.items():
            try:
                columns(result, *names)
            except ColumnError as error:
                raise ColumnError(f"{name}: {error}") from None
        return list(names)
    shared = [name for name in wanted if all(name in result for result in results.values())]
    if not shared:
        raise UsageError(f"nothing to compare: the results share none of {', '.join(wanted)}")
    return shared


def draw_comparison(
    results: Mapping[str, Result],
    figure: FigureBase,
    *,
    names: Sequence[str] = (),
    start: float | None = None,
    end: float | None = None,
) -> None:
    """One column of panels for each result, one row for each quantity that all have; rows share their scales."""
    shown = _shared(results, names, HISTORY)
    views = [view_of(result, start, end) for result in results.values()]
    sized(figure, 12.0 + 30.0 * len(shown), COLUMN_WIDTH / MM + ADDED_WIDTH * (len(results) - 1))
    axes = figure.subplots(len(shown), len(results), sharex="col", sharey="row", squeeze=False)
    for row, name in zip(axes, shown, strict=True):
        scale = tuple(view.result[name] for view in views)
        for axis, view in zip(row, views, strict=True):
            draw_column(axis, view.result, name, scale=scale)
            axis.label_outer()
        if "theta" in name or name == "psi":
            degree_ticks(row[0])
    for axis, view in zip(axes[-1], views, strict=True):
        show_time(axis, view.result)
    for axis, title, view in zip(axes[0], what_differs(results), views, strict=True):
        axis.set_title("\n".join([title, *map(_folded, view.notes)]), fontsize=7.5)
    figure.align_ylabels(axes[:, 0])


def draw_overlay(
    results: Mapping[str, Result],
    figure: FigureBase,
    *,
    names: Sequence[str] = (),
    start: float | None = None,
    end: float | None = None,
    over_distance: bool = False,
) -> None:
    """One panel for each quantity, with a line for each result, over time or over the distance of the driven end."""
    shown = _shared(results, names, OVERLAID)
    notes: list[str] = []
    if over_distance and start is None and end is None:
        # Up to the distance that all have reached.
        driven = [_distance(name, result, result.time) for name, result in results.items()]
        reach = min(float(length[-1]) for length in driven)
        ends = [
            float(np.interp(reach, length, result.time))
            for length, result in zip(driven, results.values(), strict=True)
        ]
        views = [view_of(result, None, last) for result, last in zip(results.values(), ends, strict=True)]
    elif start is None and end is None:
        # One window for all results: the longest of their windows.
        ends = [float(view_of(result).result.time[-1]) for result in results.values()]
        views = [view_of(result, None, min(max(ends), float(result.time[-1]))) for result in results.values()]
        longest = max(float(result.time[-1]) for result in results.values())
        notes = [f"first {max(ends):.3g} s of {longest:.4g} s"] if max(ends) < longest else []
    else:
        views = [view_of(result, start, end) for result in results.values()]
    axes = panels(figure, len(shown), 34.0 * len(shown) + 12.0 + 5.0 * len(results), sharex=True)
    for axis, name in zip(axes, shown, strict=True):
        units = views[0].result.columns.units[name]
        label, factor, _ = label_of(name, units, *(view.result[name] for view in views))
        for i, (of, view) in enumerate(zip(results, views, strict=True)):
            time, values = _line(view.result, name, factor)
            along = 1e3 * _distance(of, view.whole, time) if over_distance else time
            axis.plot(along, values, color=COLOURS[i], linestyle=DASHES[i])
        axis.set_ylabel(label)
        axis.margins(y=0.12)
        if "theta" in name or name == "psi":
            degree_ticks(axis)
    if over_distance:
        axes[-1].set_xlabel("distance of the driven end [mm]")
        axes[-1].margins(x=0.0)
    else:
        axes[-1].set_xlim(
            min(view.result.time[0] for view in views), max(view.result.time[-1] for view in views)
        )
        axes[-1].set_xlabel("$t$ [s]")
    names_of = [fill(title.replace("\n", ", "), WIDTH) for title in what_differs(results)]
    handles = [
        Line2D([], [], color=COLOURS[i], linestyle=DASHES[i], label=each) for i, each in enumerate(names_of)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=1, handlelength=2.8)
    note(axes[0], [*notes, *dict.fromkeys(line for view in views for line in view.notes)])


def _distance(name: str, result: Result, time: Floats) -> Floats:
    """How far the driven end has come [m]."""
    length = driven_length(result, time)
    if length is None or not np.all(np.diff(np.abs(length)) >= 0.0) or not length[-1]:
        raise UsageError(f"{name}: no distance that grows: its drive has no velocity, or goes back")
    return np.abs(length)


def _folded(line: str) -> str:
    """A note in two lines, because columns of panels are narrow."""
    return line.replace(" apart ", " apart\n")


def what_differs(results: Mapping[str, Result]) -> list[str]:
    """Title of each result: its name, and the parameters in which the results differ, those of the physics first."""
    parameters = [result.parameters for result in results.values()]
    known = [
        *PARAMETERS,
        *dict.fromkeys(name for each in parameters for name in each if name not in PARAMETERS),
    ]
    differing = [
        name for name in known if name not in NEVER_SHOWN and len({each.get(name) for each in parameters}) > 1
    ]
    titles = []
    for name, each in zip(results, parameters, strict=True):
        lines = [_value(key, each) for key in differing if key in each]
        titles.append("\n".join([name, *lines[:3], *(["…"] if len(lines) > 3 else [])]))
    return titles


def _value(name: str, parameters: Described[float | str]) -> str:
    value, units = parameters[name], parameters.units[name]
    text, factor = name.removesuffix("_deg").replace("_", " "), 1.0
    if name in PARAMETERS:
        text, units, factor = PARAMETERS[name][:3]
    shown = (
        f"{factor * value:.6g}".replace("e+0", "e").replace("e-0", "e-")
        if isinstance(value, float)
        else str(value)
    )
    return f"{text} = {shown}{'' if units in ('', '1') else '°' if units == 'deg' else f' {units}'}"
