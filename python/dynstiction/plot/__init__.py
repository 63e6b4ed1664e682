"""Figures of results, drawn for one journal column (86 mm).

A kind of figure is a function of a result and an empty figure, in a file of its own, and one line in `KINDS`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from matplotlib.figure import Figure

from .._trade import Trade
from ..errors import UsageError
from ..result import Result
from ..stick_slip import first_release
from .bifurcation import draw_bifurcation
from .creep import draw_creep
from .cycle_map import draw_cycle_map
from .damping import draw_damping
from .path import draw_path
from .samples import thin
from .spectra import draw_spectrogram
from .style import DOTS_PER_INCH, new_figure, write
from .sweep_lambda import draw_lambda
from .sweep_map import draw_map
from .time_series import MOST_RESULTS, draw_comparison, draw_history, draw_series, draw_velocities
from .work_precision import draw_work_precision

if TYPE_CHECKING:
    import xarray

__all__ = [
    "DOTS_PER_INCH",
    "KINDS",
    "SWEEP_KINDS",
    "WORK_PRECISION",
    "Drawable",
    "compare",
    "draw",
    "first_release",
    "save",
    "thin",
]

KINDS: dict[str, Callable[..., None]] = {
    "history": draw_history,
    "velocities": draw_velocities,
    "spectrogram": draw_spectrogram,
    "damping": draw_damping,
    "creep": draw_creep,
    "path": draw_path,
    "columns": draw_series,
    "cycle_map": draw_cycle_map,
}
"""Kinds of figure of a run by name."""

SWEEP_KINDS: dict[str, Callable[..., None]] = {
    "map": draw_map,
    "lambda": draw_lambda,
    "bifurcation": draw_bifurcation,
}
"""Kinds of figure of a sweep by name."""

WITH_QUANTITY = (None, "map", "bifurcation")
"""Kinds of figure of a sweep for which a quantity can be chosen."""

KIND_OF_MODEL = {"creep": "creep", "creep_asymptotic": "columns", "high_frequency": "velocities"}
"""What shows best what a model is for; of the others the history."""

LARGEST = 1e100
"""Larger values would overflow in what is computed from them."""

WORK_PRECISION = "work_precision"
"""The kind of figure of a comparison."""

Drawable: TypeAlias = "Result | Trade | xarray.Dataset"
"""A run, a comparison or a sweep."""


def draw(result: Drawable, kind: str | None = None, quantity: str | None = None) -> Figure:
    """Draw one kind of figure.

    Parameters
    ----------
    result : Result, Trade or xarray.Dataset
        A run, from `dynstiction.run` or `dynstiction.open`; a comparison, from `dynstiction.trade` or
        `dynstiction.open_trade`; or a sweep, from `dynstiction.sweep` or `dynstiction.open_sweep`.
    kind : str, optional
        Of a run a name in `KINDS`, by default what its model is for, or all columns
        where that needs more than the result has; of a sweep one in `SWEEP_KINDS`, by default ``"map"``;
        of a comparison `WORK_PRECISION`, the only one.
    quantity : str, optional
        What a map of a sweep shows, by default ``"swing"``, or a bifurcation diagram, by default ``"peak_force"``.

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
    kinds, usual = _kinds_of(result)
    if quantity is not None and (kinds is not SWEEP_KINDS or kind not in WITH_QUANTITY):
        raise UsageError("a quantity can be chosen for the map or the bifurcation diagram of a sweep only")
    if kind is not None and kind not in kinds:
        near = "".join(f"the nearest is '{name}', " for name in get_close_matches(str(kind), kinds, 1))
        raise UsageError(f"no kind of figure '{kind}': {near}the kinds are {', '.join(kinds)}")
    chosen = {} if quantity is None else {"quantity": quantity}
    if not isinstance(result, Result):
        return new_figure(partial(kinds[kind or usual], result, **chosen))
    _refuse_undrawable(result)
    try:
        return new_figure(partial(kinds[kind or usual], result))
    except UsageError:
        if kind is not None:
            raise
        return new_figure(partial(draw_series, result))


def _kinds_of(result: Drawable) -> tuple[dict[str, Callable[..., None]], str]:
    """Kinds of figure of what is given, and the usual one."""
    if isinstance(result, Trade):
        return {WORK_PRECISION: draw_work_precision}, WORK_PRECISION
    if isinstance(result, Result):
        return KINDS, KIND_OF_MODEL.get(str(result.attributes.get("model", "")), "history")
    return SWEEP_KINDS, "map"


def _refuse_undrawable(result: Result) -> None:
    if result.time.size < 2:
        raise UsageError("nothing to draw: the result has fewer than two samples")
    for name, values in result.columns.items():
        if not np.all(np.abs(values) < LARGEST):
            raise UsageError(
                f"nothing to draw: '{name}' reaches {np.max(np.abs(values)):g}: no axis holds {LARGEST:g} or more"
            )


def compare(results: Mapping[str, Result]) -> Figure:
    """Draw several runs side by side, on the same scales.

    Parameters
    ----------
    results : mapping of Result
        Two to six runs by name.

    Returns
    -------
    matplotlib.figure.Figure
        Not attached to any window; above each run its name, and the parameters in which the runs differ.

    Raises
    ------
    UsageError
        If there are too few or too many, one has no samples, or they share no column.
    """
    if not 2 <= len(results) <= MOST_RESULTS:
        raise UsageError(f"{len(results)} results to compare: give two to {MOST_RESULTS}, of different names")
    for result in results.values():
        _refuse_undrawable(result)
    return new_figure(partial(draw_comparison, results))


def save(
    result: Drawable, path: str | os.PathLike[str], kind: str | None = None, quantity: str | None = None
) -> None:
    """Draw one kind of figure into a file; its suffix names the format (PNG, PDF, SVG).

    Raises
    ------
    UsageError
        As `draw`.
    FileError
        If the file cannot be written.
    """
    write(draw(result, kind, quantity), path)
