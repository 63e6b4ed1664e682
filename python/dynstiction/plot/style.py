"""Style of all figures: one journal column wide, fonts, lines and colours."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from string import ascii_lowercase
from textwrap import fill
from typing import Any, TypeAlias

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.ticker import Locator, MultipleLocator, NullFormatter
from matplotlib.transforms import blended_transform_factory
from numpy.typing import NDArray

from .._output import put
from ..errors import Error, FileError, UsageError

# Besides the names of the colours; the others are for the figures of this folder.

MM = 1.0 / 25.4
COLUMN_WIDTH = 86.0 * MM
DOTS_PER_INCH = 400
WIDEST = 52
"""Characters in a row of a legend, or of a note."""
NOTE = "0.35"
"""Grey of the notes in a figure."""
DEGREE_STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0)
MOST_DEGREE_TICKS = 6

# Okabe & Ito's palette, and a brown, which colour-blind readers can distinguish.
BLUE, VERMILION, GREEN, PURPLE, BLACK = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000"
ORANGE, SKY, BROWN = "#E69F00", "#56B4E9", "#661100"
PALETTE = (BLUE, VERMILION, GREEN, PURPLE, BLACK, ORANGE, SKY, BROWN)
"""Colours of lines and marks."""

TICKS = {"labelsize": 7.5, "major.width": 0.6, "minor.width": 0.4, "direction": "in"}
STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    **{f"{side}tick.{name}": value for side in "xy" for name, value in TICKS.items()},
    # The numbers of both axes must not touch in a corner at 0.
    "xtick.major.pad": 4.5,
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


Canvas: TypeAlias = FigureBase | Sequence[Axes]
"""What a kind of figure is drawn into: a figure or a part of one, or axes of the user."""


def new_figure(draw: Callable[[Any], None], canvas: Figure | SubFigure | list[Axes] | None = None) -> Figure:
    """The figure in which `draw` has filled a canvas of the user, or a new one, which is not attached to any window.

    A figure of the user keeps its size; if it has no layout engine, it gets ours.
    """
    first = canvas[0] if isinstance(canvas, list) else canvas
    root = Figure(layout="constrained") if first is None else first.get_figure(root=True)
    if root is None:
        raise UsageError("ax belongs to no figure: make it with figure.subplots()")
    part = canvas or root
    if isinstance(canvas, Figure):
        if root.get_layout_engine() is None:
            root.set_layout_engine("constrained")
        part = root.add_subfigure(root.add_gridspec()[0, 0])
    with rc_context(STYLE), rendering():
        draw(part)
    return root


def sized(figure: FigureBase, height: float, width: float = COLUMN_WIDTH / MM) -> None:
    """Set the size [mm] of a figure of our own; a part of a figure of the user keeps its size."""
    if isinstance(figure, Figure):
        figure.set_size_inches(width * MM, height * MM)


def given_axes(axes: Sequence[Axes], count: int) -> Sequence[Axes]:
    """Axes of the user for this number of panels."""
    if len(axes) != count:
        raise UsageError(f"{count} panels for {len(axes)} axes: give as many axes as panels")
    return axes


def one_axes(canvas: Canvas, height: float) -> Axes:
    """Axes of a figure with one panel of `height` mm: new ones, or the given ones."""
    if not isinstance(canvas, FigureBase):
        return given_axes(canvas, 1)[0]
    sized(canvas, height)
    return canvas.subplots()


def legend_above(figure: FigureBase, handles: Sequence[Artist], most: int = 9) -> None:
    """Legend above all panels, with at most so many columns, fewer if they are too wide; none without handles."""
    if handles:
        lengths = sorted((len(str(each.get_label())) for each in handles), reverse=True)
        columns = next(
            n for n in range(min(most, len(handles)), 0, -1) if n == 1 or sum(lengths[:n]) <= WIDEST
        )
        how: Any = {"loc": "outside upper center", "handlelength": 1.8, "columnspacing": 1.0}
        figure.legend(handles=handles, ncols=columns, **how)


def ticks_outside(axis: Axes) -> None:
    """Ticks outside, for colours on which they would not be visible inside."""
    axis.tick_params(which="both", direction="out", top=False, right=False)


def plain_ticks(side: Axis, locator: Locator) -> None:
    """Numbers like 0.5 and 20 on a logarithmic axis, at these places and no others."""
    side.set_major_locator(locator)
    side.set_major_formatter("{x:g}")
    side.set_minor_formatter(NullFormatter())


def with_margin(low: float, high: float, share: float, log: bool = False) -> tuple[float, float]:
    """Limits of an axis with a margin, as a share of its length."""
    room = (high / low) ** share if log else share * (high - low)
    return (low / room, high * room) if log else (low - room, high + room)


def note(axes: Axes, lines: Sequence[str]) -> None:
    """Notes on the samples of a figure, as grey lines above the axes."""
    if any(lines):
        text = "\n".join(fill(line, WIDEST) for line in lines)
        axes.set_title(text, loc="right", fontsize=7.0, color=NOTE, pad=3.0)


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
    target = path if os.path.splitext(path)[1] else f"{os.fspath(path)}.{suffix}"
    put(target, image_of(figure, suffix), overwrite=overwrite)


def image_of(figure: Figure, suffix: str, dots_per_inch: int = DOTS_PER_INCH) -> bytes:
    """A figure as the content of a file of this format."""
    image = io.BytesIO()
    with rc_context(STYLE), rendering():
        figure.savefig(image, format=suffix, dpi=dots_per_inch)
    return image.getvalue()


def format_of(path: str | os.PathLike[str]) -> str:
    """The format of a figure that the suffix of its file names; an unknown one is refused."""
    known = Figure().canvas.get_supported_filetypes()
    suffix = os.path.splitext(path)[1].lstrip(".").lower() or "png"
    if suffix not in known:
        raise FileError(
            f"{os.fspath(path)}: cannot be written: no format '{suffix}', only {', '.join(known)}"
        )
    return suffix


def degree_ticks(axis: Axes, column: str) -> None:
    """Ticks at round angles along y, as many as there is room for, if a column is an angle."""
    low, high = axis.get_ylim()
    steps = [step for step in DEGREE_STEPS if (high - low) / step <= MOST_DEGREE_TICKS]
    if steps and ("theta" in column or column == "psi"):
        axis.yaxis.set_major_locator(MultipleLocator(steps[0]))


def panels(figure: FigureBase, count: int, height: float, **how: Any) -> NDArray[Any]:
    """Axes one above the other in a column of `height` mm, named by letters; `how` as for `Figure.subplots`."""
    sized(figure, height)
    axes: NDArray[Any] = figure.subplots(count, 1, squeeze=False, **how)[:, 0]
    # A letter is at the left edge of the figure, left of the numbers of the axis, however wide they are.
    for axis, name in zip(axes, ascii_lowercase, strict=False):
        place = blended_transform_factory(axis.get_figure(root=False).transSubfigure, axis.transAxes)
        text = axis.text(0.005, 1.0, f"({name})", transform=place, va="top", fontweight="bold")
        text.set_in_layout(False)
    figure.align_ylabels(axes)
    return axes
