"""Figures of results, drawn for one journal column (86 mm).

A kind of figure is a function of a result and an empty figure, and one line in `KINDS`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from .errors import ColumnError, FileError, UsageError
from .result import Result

__all__ = ["KINDS", "draw", "save", "thin"]

Floats: TypeAlias = NDArray[np.float64]

MM = 1.0 / 25.4
COLUMN_WIDTH = 86.0 * MM
DOTS_PER_INCH = 400
# Twice the dots of a column's width: no bin is wider than a dot.
BINS = 2 * int(COLUMN_WIDTH * DOTS_PER_INCH)

# Okabe & Ito's palette, which colour-blind readers can tell apart.
BLUE, VERMILION, GREEN, PURPLE, BLACK = "#0072B2", "#D55E00", "#009E73", "#AA4499", "#000000"

STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "lines.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 0,
    "path.simplify": False,
}


def draw(result: Result, kind: str = "history") -> Figure:
    """Draw one kind of figure.

    Parameters
    ----------
    result : Result
        A run, from `dynstiction.run` or `dynstiction.open`.
    kind : str
        A name in `KINDS`.

    Returns
    -------
    matplotlib.figure.Figure
        Not attached to any window.

    Raises
    ------
    UsageError
        If there is no such kind, or the result lacks a column (a `ColumnError`) or has no samples.
    """
    if kind not in KINDS:
        raise UsageError(f"no kind of figure '{kind}': the kinds are {', '.join(KINDS)}")
    if result.time.size < 2:
        raise UsageError("nothing to draw: the result has fewer than two samples")
    with rc_context(STYLE):
        figure = Figure(layout="constrained")
        KINDS[kind](result, figure)
    return figure


def save(result: Result, path: str | os.PathLike[str], kind: str = "history") -> None:
    """Draw one kind of figure into a file; its suffix names the format (PNG, PDF, SVG).

    Raises
    ------
    UsageError
        As `draw`.
    FileError
        If the file cannot be written.
    """
    figure = draw(result, kind)
    try:
        with rc_context(STYLE):
            figure.savefig(path, dpi=DOTS_PER_INCH)
    except (OSError, ValueError) as error:  # matplotlib's ValueError: no such format
        raise FileError(f"{os.fspath(path)}: cannot be written: {error}") from error


def thin(time: Floats, values: Floats, bins: int = BINS) -> tuple[Floats, Floats]:
    """Smallest and largest value of each stretch of time, in their order.

    The drawn line covers the same dots as that of all samples, however fast they oscillate.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
        Rising times and a value at each.
    bins : int
        Number of stretches of equal length.

    Returns
    -------
    time, values : ndarray, shape (at most 2*bins + 2,)
        The kept samples, the first and the last among them.
    """
    if time.size <= 2 * bins:
        return time, values
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], bins + 1)[1:-1])
    starts = np.unique(np.concatenate([[0], edges]))
    starts = starts[starts < time.size]
    sizes = np.diff(np.append(starts, time.size))
    keep = [0, time.size - 1]
    for extreme in (np.fmin, np.fmax):
        reached = values == np.repeat(extreme.reduceat(values, starts), sizes)
        # The first sample of each bin that reaches its extreme; none where all are NaN.
        reaching = np.flatnonzero(reached)
        bin_of = np.searchsorted(starts, reaching, side="right")
        keep.extend(reaching[np.unique(bin_of, return_index=True)[1]])
    kept = np.unique(keep)
    return time[kept], values[kept]


def _draw_history(result: Result, figure: Figure) -> None:
    """Spring forces, friction force and angle, and position against time (Fig. 3)."""
    needed = _columns(result, "spring_force_x", "spring_force_y", "friction", "theta", "X")
    panels = {
        "$k_x u_x$ [N]": (needed["spring_force_x"], BLUE),
        "$k_y u_y$ [N]": (needed["spring_force_y"], VERMILION),
        "$|F|$ [N]": (needed["friction"], GREEN),
        r"$\theta$ [deg]": (np.degrees(needed["theta"]), PURPLE),
        "$X$ [mm]": (1e3 * needed["X"], BLACK),
    }
    figure.set_size_inches(COLUMN_WIDTH, 160.0 * MM)
    axes = figure.subplots(len(panels), 1, sharex=True)
    for letter, axis, (label, (values, colour)) in zip("abcde", axes, panels.items(), strict=True):
        axis.plot(*thin(result.time, values), color=colour)
        axis.set_ylabel(label)
        axis.margins(y=0.12)
        _letter(axis, letter)
    axes[3].yaxis.set_major_locator(MultipleLocator(30.0))
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
    inset.set_ylabel(r"$X$ [µm]", fontsize=7.0, labelpad=1.0)
    inset.text(0.06, 0.93, "creep", transform=inset.transAxes, va="top", fontsize=7.0)
    inset.locator_params(nbins=3)


def first_release(force: Floats) -> int:
    """Index of the sample where the first stick phase ends: the first peak of the spring force.

    Without a fall by 5 % there is no slip, and the phase ends where the force comes within 1 % of its
    largest value.
    """
    size = np.abs(force)
    fallen = np.flatnonzero(np.maximum.accumulate(size) - size > 0.05 * size.max())
    if fallen.size:
        return int(np.argmax(size[: fallen[0]]))
    return int(np.argmax(size >= 0.99 * size.max()))


def _draw_path(result: Result, figure: Figure) -> None:
    """Path of the tip of the friction vector in the plane of the principal axes, over a circle."""
    needed = _columns(result, "friction", "theta")
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


def _columns(result: Result, *names: str) -> Mapping[str, Floats]:
    missing = [name for name in names if name not in result]
    if missing:
        listed = ", ".join(repr(name) for name in (*(n for n in result if n != "time"), *missing))
        raise ColumnError(
            f"the result lacks {', '.join(missing)}: run the deck again with output.fields = {listed}"
        )
    return {name: result[name] for name in names}


def _letter(axis: Axes, letter: str) -> None:
    axis.text(-0.19, 1.0, f"({letter})", transform=axis.transAxes, va="top", fontweight="bold")


KINDS: dict[str, Callable[[Result, Figure], None]] = {
    "history": _draw_history,
    "path": _draw_path,
}
"""Kinds of figure by name."""
