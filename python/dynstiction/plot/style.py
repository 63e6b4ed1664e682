"""How every figure looks: one journal column wide, its fonts, lines and colours."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.ticker import MultipleLocator
from matplotlib.transforms import blended_transform_factory
from numpy.typing import NDArray

from ..errors import Error, FileError, UsageError, require_folder

__all__ = [
    "BLACK",
    "BLUE",
    "BROWN",
    "COLUMN_WIDTH",
    "DOTS_PER_INCH",
    "GREEN",
    "MM",
    "ORANGE",
    "PALETTE",
    "PURPLE",
    "SKY",
    "STYLE",
    "VERMILION",
    "degree_ticks",
    "in_axes",
    "in_figure",
    "new_figure",
    "note",
    "one_axes",
    "panels",
    "rendering",
    "sized",
    "write",
]

MM = 1.0 / 25.4
COLUMN_WIDTH = 86.0 * MM
DOTS_PER_INCH = 400
NOTE = "0.35"
"""Grey of what a figure says of itself."""
DEGREE_STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0)
MOST_DEGREE_TICKS = 6

# Okabe & Ito's palette, and a brown, which colour-blind readers can distinguish (tests/python/test_colours.py).
BLUE, VERMILION, GREEN, PURPLE, BLACK = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000"
ORANGE, SKY, BROWN = "#E69F00", "#56B4E9", "#661100"
PALETTE = (BLUE, VERMILION, GREEN, PURPLE, BLACK, ORANGE, SKY, BROWN)
"""Colours of lines and marks."""

STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.direction": "in",
    # Numbers at the corner of an axis that begins at 0 must not touch.
    "xtick.major.pad": 4.5,
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "lines.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 0,
    "path.simplify": False,
    # Fonts as fonts: several journals refuse those of Type 3, and words in a drawing can then be searched.
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "svg.fonttype": "none",
}


def new_figure(draw: Callable[[Figure], None]) -> Figure:
    """Figure that `draw` has filled, in this style and not attached to any window."""
    with rc_context(STYLE), rendering():
        figure = Figure(layout="constrained")
        draw(figure)
    return figure


def in_figure(draw: Callable[[FigureBase], None], figure: Figure | SubFigure) -> None:
    """Let `draw` fill a figure of the user, which keeps its size; without a layout of its own it gets that of ours."""
    with rc_context(STYLE), rendering():
        if isinstance(figure, Figure):
            if figure.get_layout_engine() is None:
                figure.set_layout_engine("constrained")
            draw(figure.add_subfigure(figure.add_gridspec()[0, 0]))
        else:
            draw(figure)


def in_axes(draw: Callable[[Axes], None], axes: Axes) -> None:
    """Let `draw` fill axes of the user."""
    with rc_context(STYLE), rendering():
        draw(axes)


def sized(figure: FigureBase, height: float, width: float = COLUMN_WIDTH / MM) -> None:
    """Give a figure of our own its size [mm]; a part of a figure of the user keeps that which it has."""
    if isinstance(figure, Figure):
        figure.set_size_inches(width * MM, height * MM)


def one_axes(canvas: FigureBase | Axes, height: float) -> Axes:
    """Axes of a drawing with one panel `height` mm high: new ones, or those that are given."""
    if isinstance(canvas, Axes):
        return canvas
    sized(canvas, height)
    return canvas.subplots()


def note(axes: Axes, lines: Sequence[str]) -> None:
    """Grey lines above axes: what the figure says of its samples."""
    if lines:
        axes.set_title("\n".join(lines), loc="right", fontsize=7.0, color=NOTE, pad=3.0)


@contextmanager
def rendering() -> Iterator[None]:
    """Turn what matplotlib and NumPy make of numbers that no axis can hold into a `UsageError`."""
    try:
        yield
    except Error:
        raise
    except (ValueError, ArithmeticError) as error:
        raise UsageError(
            f"nothing to draw: the numbers are too large or too close for an axis: {error}"
        ) from error


def write(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure; the suffix names the format. A `FileError` says why it cannot be written."""
    known = figure.canvas.get_supported_filetypes()
    suffix = os.path.splitext(path)[1].lstrip(".").lower()
    if suffix and suffix not in known:
        raise FileError(
            f"{os.fspath(path)}: cannot be written: no format '{suffix}', only {', '.join(known)}"
        )
    require_folder(path)
    try:
        with rc_context(STYLE), rendering():
            figure.savefig(path, dpi=DOTS_PER_INCH)
    except UsageError:
        raise
    except OSError as error:
        raise FileError(f"{os.fspath(path)}: cannot be written: {error.strerror or error}") from error


def degree_ticks(axis: Axes) -> None:
    """Ticks at round angles along y, not more than there is room for."""
    low, high = axis.get_ylim()
    for step in DEGREE_STEPS:
        if (high - low) / step <= MOST_DEGREE_TICKS:
            axis.yaxis.set_major_locator(MultipleLocator(step))
            return


def panels(
    figure: FigureBase, count: int, height: float, letters: str = "abcdefgh", **how: Any
) -> NDArray[Any]:
    """Axes one above the other in a column `height` mm high, named by letters; `how` as `Figure.subplots` takes it."""
    sized(figure, height)
    axes: NDArray[Any] = figure.subplots(count, 1, squeeze=False, **how)[:, 0]
    for axis, name in zip(axes, letters, strict=False):
        _letter(axis, name)
    figure.align_ylabels(axes)
    return axes


def _letter(axis: Axes, name: str) -> None:
    """The name of a panel at the left edge of the figure: beside the numbers of the axis, however wide they are."""
    place = blended_transform_factory(axis.get_figure(root=False).transSubfigure, axis.transAxes)  # type: ignore[union-attr]
    text = axis.text(0.005, 1.0, f"({name})", transform=place, va="top", fontweight="bold")
    text.set_in_layout(False)
