"""Style of all figures: one journal column wide, fonts, lines and colours."""

from __future__ import annotations

import io
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

from .._output import put
from ..errors import Error, FileError, UsageError

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
"""Grey of the notes in a figure."""
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
    # The numbers of both axes must not touch in a corner at 0.
    "xtick.major.pad": 4.5,
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "lines.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 0,
    "path.simplify": False,
    # TrueType fonts, because several journals refuse Type 3, and text as text, which can be searched.
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
    """Let `draw` fill a figure of the user, which keeps its size; if it has no layout engine, it gets ours."""
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
    """Set the size [mm] of a figure of our own; a part of a figure of the user keeps its size."""
    if isinstance(figure, Figure):
        figure.set_size_inches(width * MM, height * MM)


def one_axes(canvas: FigureBase | Axes, height: float) -> Axes:
    """Axes of a figure with one panel of `height` mm: new ones, or the given ones."""
    if isinstance(canvas, Axes):
        return canvas
    sized(canvas, height)
    return canvas.subplots()


def note(axes: Axes, lines: Sequence[str]) -> None:
    """Notes on the samples of a figure, as grey lines above the axes."""
    if lines:
        axes.set_title("\n".join(lines), loc="right", fontsize=7.0, color=NOTE, pad=3.0)


@contextmanager
def rendering() -> Iterator[None]:
    """Turn the exceptions of matplotlib and NumPy for numbers that no axis can show into a `UsageError`."""
    try:
        yield
    except Error:
        raise
    except (ValueError, ArithmeticError) as error:
        raise UsageError(
            f"nothing to draw: the numbers are too large or too close for an axis: {error}"
        ) from error


def write(figure: Figure, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Write a figure; the suffix names the format, without one it is PNG. A `FileError` says why it cannot be written."""
    suffix = format_of(path)
    image = io.BytesIO()
    with rc_context(STYLE), rendering():
        figure.savefig(image, format=suffix, dpi=DOTS_PER_INCH)
    put(
        path if os.path.splitext(path)[1] else f"{os.fspath(path)}.{suffix}",
        image.getvalue(),
        overwrite=overwrite,
    )


def format_of(path: str | os.PathLike[str]) -> str:
    """The format of a figure that the suffix of its file names; an unknown one is refused."""
    known = Figure().canvas.get_supported_filetypes()
    suffix = os.path.splitext(path)[1].lstrip(".").lower() or "png"
    if suffix not in known:
        raise FileError(
            f"{os.fspath(path)}: cannot be written: no format '{suffix}', only {', '.join(known)}"
        )
    return suffix


def degree_ticks(axis: Axes) -> None:
    """Ticks at round angles along y, as many as there is room for."""
    low, high = axis.get_ylim()
    for step in DEGREE_STEPS:
        if (high - low) / step <= MOST_DEGREE_TICKS:
            axis.yaxis.set_major_locator(MultipleLocator(step))
            return


def panels(
    figure: FigureBase, count: int, height: float, letters: str = "abcdefgh", **how: Any
) -> NDArray[Any]:
    """Axes one above the other in a column of `height` mm, named by letters; `how` as for `Figure.subplots`."""
    sized(figure, height)
    axes: NDArray[Any] = figure.subplots(count, 1, squeeze=False, **how)[:, 0]
    for axis, name in zip(axes, letters, strict=False):
        _letter(axis, name)
    figure.align_ylabels(axes)
    return axes


def _letter(axis: Axes, name: str) -> None:
    """The letter of a panel at the left edge of the figure, left of the numbers of the axis, however wide they are."""
    place = blended_transform_factory(axis.get_figure(root=False).transSubfigure, axis.transAxes)  # type: ignore[union-attr]
    text = axis.text(0.005, 1.0, f"({name})", transform=place, va="top", fontweight="bold")
    text.set_in_layout(False)
