"""Figures of results, drawn for one journal column (86 mm).

A kind of figure is a function of a result and an empty figure, in a file of its own, and one line in `KINDS`.
"""

from __future__ import annotations

import os
from collections.abc import Callable

from matplotlib.figure import Figure

from .._trade import Trade
from ..errors import UsageError
from ..result import Result
from .creep import draw_creep
from .damping import draw_damping
from .history import draw_history
from .path import draw_path
from .samples import first_release, thin
from .spectra import draw_spectrogram
from .style import DOTS_PER_INCH, new_figure, write
from .velocities import draw_velocities
from .work_precision import draw_work_precision

__all__ = ["DOTS_PER_INCH", "KINDS", "WORK_PRECISION", "draw", "first_release", "save", "thin"]

KINDS: dict[str, Callable[[Result, Figure], None]] = {
    "history": draw_history,
    "velocities": draw_velocities,
    "spectrogram": draw_spectrogram,
    "damping": draw_damping,
    "creep": draw_creep,
    "path": draw_path,
}
"""Kinds of figure of a run by name."""

WORK_PRECISION = "work_precision"
"""The kind of figure of a comparison."""


def draw(result: Result | Trade, kind: str | None = None) -> Figure:
    """Draw one kind of figure.

    Parameters
    ----------
    result : Result or Trade
        A run, from `dynstiction.run` or `dynstiction.open`, or a comparison, from `dynstiction.trade` or
        `dynstiction.open_trade`.
    kind : str, optional
        Of a run a name in `KINDS`, by default ``"history"``; of a comparison `WORK_PRECISION`, the only one.

    Returns
    -------
    matplotlib.figure.Figure
        Not attached to any window.

    Raises
    ------
    UsageError
        If there is no such kind, the result lacks a column (a `ColumnError`) or has no samples, or is not what the kind
        can show; the text says what would be right.
    """
    if isinstance(result, Trade):
        if kind not in (None, WORK_PRECISION):
            raise UsageError(f"a comparison has no figure '{kind}': its kind is {WORK_PRECISION}")
        comparison = result
        return new_figure(lambda figure: draw_work_precision(comparison, figure))
    kind = kind or "history"
    if kind not in KINDS:
        raise UsageError(f"no kind of figure '{kind}': the kinds are {', '.join(KINDS)}")
    if result.time.size < 2:
        raise UsageError("nothing to draw: the result has fewer than two samples")
    run, draw_kind = result, KINDS[kind]
    return new_figure(lambda figure: draw_kind(run, figure))


def save(result: Result | Trade, path: str | os.PathLike[str], kind: str | None = None) -> None:
    """Draw one kind of figure into a file; its suffix names the format (PNG, PDF, SVG).

    Raises
    ------
    UsageError
        As `draw`.
    FileError
        If the file cannot be written.
    """
    write(draw(result, kind), path)
