"""How every figure looks: one journal column wide, its fonts, lines and colours."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from ..errors import Error, FileError, UsageError

__all__ = [
    "BLACK",
    "BLUE",
    "COLUMN_WIDTH",
    "DOTS_PER_INCH",
    "GREEN",
    "MM",
    "ORANGE",
    "PURPLE",
    "SKY",
    "STYLE",
    "VERMILION",
    "degree_ticks",
    "new_figure",
    "panels",
    "rendering",
    "write",
]

MM = 1.0 / 25.4
COLUMN_WIDTH = 86.0 * MM
DOTS_PER_INCH = 400
MOST_DEGREES = 1000.0

# Okabe & Ito's palette, which colour-blind readers can tell apart.
BLUE, VERMILION, GREEN, PURPLE, BLACK = "#0072B2", "#D55E00", "#009E73", "#AA4499", "#000000"
ORANGE, SKY = "#E69F00", "#56B4E9"

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
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "lines.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 0,
    "path.simplify": False,
}


def new_figure(draw: Callable[[Figure], None]) -> Figure:
    """Figure that `draw` has filled, in this style and not attached to any window."""
    with rc_context(STYLE), rendering():
        figure = Figure(layout="constrained")
        draw(figure)
    return figure


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
    try:
        with rc_context(STYLE), rendering():
            figure.savefig(path, dpi=DOTS_PER_INCH)
    except UsageError:
        raise
    except FileNotFoundError as error:
        folder = os.path.dirname(path)
        raise FileError(
            f"{os.fspath(path)}: cannot be written: the folder {folder} does not exist: create it first"
        ) from error
    except OSError as error:
        raise FileError(f"{os.fspath(path)}: cannot be written: {error.strerror or error}") from error


def degree_ticks(axis: Axes) -> None:
    """Ticks at multiples of 30 degrees along y, if what is shown are a few turns."""
    low, high = axis.get_ylim()
    if high - low < MOST_DEGREES:
        axis.yaxis.set_major_locator(MultipleLocator(30.0))


def panels(figure: Figure, count: int, height: float, letters: str = "abcde", **how: Any) -> NDArray[Any]:
    """Axes one above the other in a column `height` mm high, named by letters; `how` as `Figure.subplots` takes it."""
    figure.set_size_inches(COLUMN_WIDTH, height * MM)
    axes: NDArray[Any] = figure.subplots(count, 1, squeeze=False, **how)[:, 0]
    for axis, name in zip(axes, letters, strict=False):
        axis.text(-0.19, 1.0, f"({name})", transform=axis.transAxes, va="top", fontweight="bold")
    figure.align_ylabels(axes)
    return axes
