"""Columns of runs against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from ..errors import ColumnError, UsageError
from ..record import Described, headed, number_shown
from ..result import Result
from ..stick_slip import drive_profile, first_release
from .notation import COLUMNS, PARAMETERS, Floats, label_of, scaled, thin
from .style import (
    BLACK,
    COLUMN_WIDTH,
    MM,
    PALETTE,
    Canvas,
    degree_ticks,
    given_axes,
    legend_above,
    note,
    panels,
    sized,
)
from .theory import driven_length, static_limit, steady_friction, stiff_frequency
from .view import View, view_of

HISTORY = ("spring_force_x", "spring_force_y", "pull_force", "friction", "psi", "X")
VELOCITIES = ("w_x", "w_y")
OVERLAID = ("spring_force_x", "psi", "X")
"""Default columns of several runs in the same panels."""
COLOURS = PALETTE[:7]
DASHES: Any = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)), (0, (8, 2)), (0, (3, 1, 1, 1, 1, 1)))
"""Dashes of lines in the same panel: colours alone are not distinguishable in print."""

AT_START = ("friction", "theta", "theta_deg", "psi")
"""Columns that jump after the sample at t = 0, where the object still has its start velocity and then comes to rest."""

DETAIL_PERIODS, DETAIL_SAMPLES = 5.0, 40

FEW = 7
"""Number of panels above which they are lower, so that they fit on a page."""

MOST_RESULTS = 6
"""Largest number of results in a figure; more would be too narrow to read."""

ADDED_WIDTH = 46.0
"""Width of each result after the first [mm]."""

GUIDE: Any = {"color": "0.45", "linewidth": 0.6, "zorder": 1.5}
"""Lines that are not of the run."""
SLIP = "0.85"
"""Grey of the intervals of time in which the object slips."""
MOST_SLIPS = 60
"""Largest number of grey intervals; more would make the panels grey."""
WIDTH = 52
"""Characters of a line of the legend, including the markup of symbols."""
VISIBLE = 0.01
"""Share of F_0 by which the steady force must differ from F_0 to get a separate line."""

NEVER_SHOWN = (
    "title", "file", "checkpoint_interval", "wall_limit", "interval", "fields", "max_steps", "t_end", "accuracy", "quantities"
)  # fmt: skip
"""Parameters that do not change the motion, or not in a way that matters to the reader."""

INSETS = (
    (0.125, 0.60, 0.265, 0.34),
    (0.64, 0.19, 0.33, 0.34),
    (0.13, 0.19, 0.28, 0.34),
    (0.64, 0.60, 0.33, 0.34),
)
"""Possible places of an inset: left, bottom, width, height in shares of the panel."""
AROUND = (0.115, 0.15, 0.01, 0.03)
"""Space of an inset on its left and below it, for its numbers, on its right and above it."""
LEAST_CREEP, MOST_CREEP = 20, 0.6
"""Samples of the first creep that an inset needs, and the share of the panel's height above which the panel itself shows it."""


def draw_column(
    axis: Axes, name: str, *results: Result, margin: float = 0.12, scale: Sequence[Floats] = ()
) -> None:
    """Draw one column of a run against time, with its label, in the unit that suits the column or the values `scale`; or that of several
    runs, each with its own colour and dashes.
    """
    scale = scale or [result[name] for result in results]
    label, factor, colour = label_of(name, results[0].columns.units[name], *scale)
    colours = COLOURS if len(results) > 1 else [colour]
    for result, own, dashes in zip(results, colours, DASHES, strict=False):
        axis.plot(*_line(result, name, factor), color=own, linestyle=dashes)
    axis.set_ylabel(label)
    axis.margins(y=margin)
    degree_ticks(axis, name)


def show_time(axis: Axes, *results: Result) -> None:
    """Set the limits and the label of the time axis."""
    ends = [result.time[[0, -1]] for result in results]
    axis.set(xlabel="$t$ [s]", xlim=(np.min(ends), np.max(ends)))


def draw_history(view: View, canvas: Canvas, *, columns: Sequence[str] = ()) -> None:
    """Spring forces, the force of the load cell, friction force and angle, position against time (Fig. 3), or other columns; above
    them V(t) of a profile. Axes of the user show their columns alone.
    """
    if not isinstance(canvas, FigureBase):
        _draw_in_axes(view, canvas, columns or ("spring_force_x",))
        return
    # A file of an earlier version has no pull_force.
    names = columns or [name for name in HISTORY if name != "pull_force" or name in view.whole]
    profile = drive_profile(view.whole)
    count = len(names) + (profile is not None)
    axes = panels(canvas, count, (28.0 if count <= FEW else 18.0) * count + 20.0, sharex=True)
    note(axes[0], view.notes)
    if profile is not None:
        # V(t) as a line through the corners of the drive.
        factor, unit = scaled("m/s", profile[1])
        time = np.append(profile[0], max(profile[0][-1], view.result.time[-1]))
        axes[0].plot(time, factor * np.append(profile[1], profile[1][-1]), color=BLACK)
        axes[0].set_ylabel(headed("$V$", unit))
        axes[0].margins(y=0.12)
    named: dict[str, Artist] = {}
    for axis, name in zip(axes[count - len(names) :], names, strict=True):
        draw_column(axis, name, view.result)
        for line in _draw_limits(axis, view, name):
            named[str(line.get_label())] = line
    slips = view.slips()
    if 0 < len(slips) <= MOST_SLIPS:
        # From each peak of the load to its valley.
        for axis in axes:
            for begin, end in slips:
                axis.axvspan(begin, end, color=SLIP, linewidth=0.0, zorder=0.5)
        named["slip"] = Patch(color=SLIP, label="slip")
    show_time(axes[-1], view.result)
    if "X" in names:
        _draw_creep_inset(axes[count - len(names) + list(names).index("X")], view)
    legend_above(canvas, list(named.values()))


def _draw_in_axes(view: View, axes: Sequence[Axes], names: Sequence[str]) -> None:
    for axis, name in zip(given_axes(axes, len(names)), names, strict=True):
        draw_column(axis, name, view.result)
        show_time(axis, view.result)
    note(axes[0], view.notes)


def _line(result: Result, name: str, factor: float) -> tuple[Floats, Floats]:
    """Samples of a column that are drawn: without that at t = 0 if it would show a jump that takes no time."""
    first = int(name in AT_START and result.time[0] == 0.0 and result.time.size > 2)
    return thin(result.time[first:], factor * result[name][first:])


def _draw_limits(axis: Axes, view: View, name: str) -> list[Line2D]:
    """Draw the static limit and steady sliding in the panels that have them, and the driven end in that of the position."""
    parameters = view.whole.parameters
    if name == "X":
        driven = driven_length(view.whole, view.result.time)
        if driven is None:
            return []
        driven = label_of("X", "m", view.result["X"])[1] * driven
        low, high = axis.get_ylim()
        (line,) = axis.plot(view.result.time, driven, linestyle=":", label="driven end", **GUIDE)
        # Before the first slip it is far ahead; so the position remains readable.
        axis.set_ylim(low, max(high, min(float(np.max(driven)) * 1.05, high + 0.5 * (high - low))))
        return [line]
    limit, steady = static_limit(view.whole), steady_friction(view.whole)
    if name not in ("spring_force_x", "friction") or not limit:
        return []
    phi = np.radians(float(parameters.get("misalignment_deg", 0.0)))
    along = np.cos(phi) * np.sign(float(parameters.get("velocity", 1.0))) if name == "spring_force_x" else 1.0
    factor = label_of(name, "N", view.result[name])[1]
    side = np.sign(along) or 1.0
    lines = [axis.axhline(factor * side * limit, linestyle=(0, (5, 2)), label="$F_0$", **GUIDE)]
    if steady is not None and abs(steady * abs(along) - limit) > VISIBLE * limit:
        style: Any = {"linestyle": (0, (5, 1.5, 1, 1.5)), "label": "steady sliding"}
        lines.append(axis.axhline(factor * along * steady, **style, **GUIDE))
    return lines


def _draw_creep_inset(axis: Axes, view: View) -> None:
    """Inset with the slow creep of the first stick phase, which is not visible in the whole history, if the panel has room."""
    shown, whole = view.result, view.whole
    if shown.time[0] != whole.time[0] or "spring_force_x" not in whole:
        return
    first = slice(0, first_release(whole["spring_force_x"]) + 1)
    time, place = whole.time[first], whole["X"][first]
    is_hidden = 0.0 < np.ptp(place) < MOST_CREEP * float(np.ptp(shown["X"]))
    corner = _free_corner(axis)
    if time.size < LEAST_CREEP or time[-1] > shown.time[-1] or not is_hidden or corner is None:
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
    axis.autoscale_view()
    paths = [line.get_path().transformed(axis.transLimits) for line in axis.lines]
    left, below, right, above = AROUND
    for x, y, width, height in INSETS:
        box = Bbox.from_extents(x - left, y - below, x + width + right, y + height + above)
        if not any(path.intersects_bbox(box, filled=False) for path in paths):
            return x, y, width, height
    return None


def draw_velocities(view: View, figure: FigureBase) -> None:
    """Both slip velocities: left in the part shown, right in five periods of the stiff axis halfway to the first slip."""
    sized(figure, 80.0)
    axes = figure.subplots(2, 2, sharex="col", width_ratios=(3.0, 2.0))
    shown, slips = view.result, view.slips()
    # A few periods of the stiff axis halfway to the first slip; more if these are too few samples for a line.
    frequency, until = stiff_frequency(shown), float(slips[0, 0]) if slips.size else float(shown.time[-1])
    begin = int(np.searchsorted(shown.time, 0.5 * (shown.time[0] + max(until, float(shown.time[0])))))
    begin = max(0, min(begin, shown.time.size - DETAIL_SAMPLES))
    length = 0.0 if frequency is None else DETAIL_PERIODS / frequency
    end = int(np.searchsorted(shown.time, shown.time[begin] + length, side="right"))
    detail = slice(begin, max(end, begin + DETAIL_SAMPLES))
    both = tuple(shown[name] for name in VELOCITIES)
    time = 1e3 * (shown.time[detail] - shown.time[detail][0])
    for row, name in zip(axes, VELOCITIES, strict=True):
        draw_column(row[0], name, shown, margin=0.05, scale=both)
        _, factor, colour = label_of(name, "m/s", *both)
        row[1].plot(time, factor * shown[name][detail], color=colour)
    note(axes[0, 1], view.notes)
    show_time(axes[1, 0], shown)
    axes[1, 1].set(xlim=(0.0, time[-1]), xlabel=f"$t$ − {shown.time[detail][0]:.6g} s [ms]")
    figure.align_ylabels(axes[:, 0])


def draw_series(view: View, figure: FigureBase) -> None:
    """All columns, one in each panel: for files with too few columns for another kind."""
    names = [name for name in view.whole if name != "time"]
    if not names:
        raise UsageError("nothing to draw: the result holds times only: run again with other output.fields")
    # Known columns in the order of the figures, the others in the order of the file.
    names.sort(key=lambda name: list(COLUMNS).index(name) if name in COLUMNS else len(COLUMNS))
    draw_history(view, figure, columns=names)


def _shared(results: Mapping[str, Result], names: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """The columns to compare: the named ones, which all results must have, or those of the usual ones that all have."""
    if not 2 <= len(results) <= MOST_RESULTS:
        raise UsageError(f"{len(results)} results to compare: give two to {MOST_RESULTS}, of different names")
    if names:
        for name, result in results.items():
            try:
                _ = [result[each] for each in names]
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
    columns: Sequence[str] = (),
    start: float | None = None,
    end: float | None = None,
) -> None:
    """One column of panels for each result, one row for each quantity that all have; rows share their scales."""
    shown = _shared(results, columns, HISTORY)
    views = [view_of(result, start, end) for result in results.values()]
    sized(figure, 12.0 + 30.0 * len(shown), COLUMN_WIDTH / MM + ADDED_WIDTH * (len(results) - 1))
    axes = figure.subplots(len(shown), len(results), sharex="col", sharey="row", squeeze=False)
    for row, name in zip(axes, shown, strict=True):
        scale = tuple(view.result[name] for view in views)
        for axis, view in zip(row, views, strict=True):
            draw_column(axis, name, view.result, scale=scale)
            axis.label_outer()
    for column, title, view in zip(axes.T, what_differs(results), views, strict=True):
        show_time(column[-1], view.result)
        # A note has two lines, because columns of panels are narrow.
        notes = [line.replace(" apart ", " apart\n") for line in view.notes]
        column[0].set_title("\n".join([title, *notes]), fontsize=7.5)
    figure.align_ylabels(axes[:, 0])


def draw_overlay(
    results: Mapping[str, Result],
    figure: FigureBase,
    *,
    columns: Sequence[str] = (),
    start: float | None = None,
    end: float | None = None,
) -> None:
    """One panel for each quantity, with a line for each result."""
    shown = _shared(results, columns, OVERLAID)
    notes: list[str] = []
    views = [view_of(result, start, end) for result in results.values()]
    if start is None and end is None:
        # One window for all results: the longest of their windows.
        last = max(float(result.time[-1]) for result in results.values())
        window = max(float(view.result.time[-1]) for view in views)
        notes = [f"first {window:.3g} s of {last:.4g} s"] if window < last else []
        views = [view_of(each, None, min(window, float(each.time[-1]))) for each in results.values()]
    axes = panels(figure, len(shown), 34.0 * len(shown) + 12.0 + 5.0 * len(results), sharex=True)
    drawn = [view.result for view in views]
    for axis, name in zip(axes, shown, strict=True):
        draw_column(axis, name, *drawn)
    show_time(axes[-1], *drawn)
    titles = [fill(title.replace("\n", ", "), WIDTH) for title in what_differs(results)]
    figure.legend(axes[0].lines, titles, loc="outside upper center", ncols=1, handlelength=2.8)
    note(axes[0], [*notes, *dict.fromkeys(line for view in views for line in view.notes)])


def what_differs(results: Mapping[str, Result]) -> list[str]:
    """Title of each result: its name, and the parameters in which the results differ, those of the physics first."""
    parameters = [result.parameters for result in results.values()]
    # Each once, those of the figures first.
    known = dict.fromkeys([*PARAMETERS, *(name for each in parameters for name in each)])
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
    shown = number_shown(factor * value if isinstance(value, float) else value)
    shown = shown.replace("e+0", "e").replace("e-0", "e-")
    return f"{text} = {shown}{'' if units in ('', '1') else '°' if units == 'deg' else f' {units}'}"
