"""Figures of results, drawn for one journal column (86 mm).

A kind of figure is a function of a view of a run, or of another result, and an empty figure, and one line in a table of kinds.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase, SubFigure

from ..branches import Branches
from ..errors import UsageError
from ..result import Result
from ..stick_slip import first_release
from ..tangents import Sensitivity
from .bifurcation import draw_bifurcation
from .branches import draw_branches
from .creep import draw_creep
from .cycle_map import draw_cycle_map
from .damping import draw_damping
from .notation import columns as refuse_lacking
from .notation import the_nearest, thin
from .path import draw_path
from .sensitivity import draw_sensitivity
from .spectra import draw_spectrogram
from .style import DOTS_PER_INCH, new_figure, write
from .sweep_lambda import draw_lambda
from .sweep_map import draw_map
from .time_series import (
    draw_comparison,
    draw_history,
    draw_in_axes,
    draw_overlay,
    draw_series,
    draw_velocities,
)
from .view import coarseness, view_of, window

if TYPE_CHECKING:
    import xarray

__all__ = [
    "DOTS_PER_INCH",
    "KINDS",
    "SWEEP_KINDS",
    "Drawable",
    "PlotModule",
    "coarseness",
    "compare",
    "draw",
    "first_release",
    "overlay",
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

MOST_RESULTS = 6
"""Largest number of results side by side; more would be too narrow to read."""

WITH_QUANTITY = ("map", "bifurcation", "branches")
"""Kinds of figure, of a sweep or of branches, for which a quantity can be chosen."""

KIND_OF_MODEL = {"creep": "creep", "creep_asymptotic": "columns", "high_frequency": "velocities"}
"""Kind of figure that suits the purpose of a model; for other models the history."""

LARGEST = 1e100
"""Larger values would overflow in the computations for a figure."""

KINDS_OF: dict[type, dict[str, Callable[..., None]]] = {
    Result: KINDS,
    Sensitivity: {"sensitivity": draw_sensitivity},
    Branches: {"branches": draw_branches},
}
"""Kinds of figure of other objects than sweeps, the default one first."""

Drawable: TypeAlias = "Result | Sensitivity | Branches | xarray.Dataset"
"""A run, the derivatives of a cycle, branches of cycles, or a sweep."""


WINDOWED = ("history", "velocities", "spectrogram", "path", "columns")
"""Kinds of figure of a run that can show a part of its time; the others show the first creep, or the releases."""

IN_AXES = ("path", "damping")
"""Kinds of figure of a run that can be drawn into one pair of axes, besides single columns."""


def draw(
    result: Drawable,
    kind: str | None = None,
    quantity: str | None = None,
    *,
    branches: Branches | None = None,
    columns: str | Sequence[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    figure: Figure | SubFigure | None = None,
    ax: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """Draw one kind of figure.

    Parameters
    ----------
    result : Result, Sensitivity, Branches or xarray.Dataset
        A run, from `dynstiction.run` or `dynstiction.open`; derivatives, from `dynstiction.sensitivity`; branches, from
        `dynstiction.branch`; or a sweep, from `dynstiction.sweep` or `dynstiction.open`.
    kind : str, optional
        For a run, a name in `KINDS`; the default depends on its model, and is all columns if the result lacks the data for
        that kind. For a sweep, a name in `SWEEP_KINDS`, by default ``"map"``.
    quantity : str, optional
        Quantity of a map of a sweep, by default ``"swing"``, or of a bifurcation diagram, by default ``"peak_force"``,
        which is also that of branches.
    branches : Branches, optional
        Branches over the parameter of the sweep, which are drawn into its bifurcation diagram.
    columns : str or sequence of str, optional
        Columns of a run to draw, one in each panel, in place of those of the kind ``"history"``.
    start, end : float, optional
        Part of a run to draw [s]. Without both, a run with many cycles is drawn up to its first cycles, and the figure says so.
    figure : Figure or SubFigure, optional
        Figure to draw into; it keeps its size. Without it (and without `ax`) a new figure of one journal column is made.
    ax : Axes or sequence of Axes, optional
        Axes to draw into: `columns`, one in each (by default ``"spring_force_x"`` in the first), or one of the kinds in `IN_AXES`.

    Returns
    -------
    matplotlib.figure.Figure
        A new one, not attached to any window, or the one that contains `figure` or `ax`.

    Raises
    ------
    UsageError
        If there is no such kind, the result lacks a column (a `ColumnError`) or has no samples, the kind cannot show such a
        result, or the start is not before the end; the text says what would be right.
    """
    kinds, usual = _kinds_of(result, kind)
    if quantity is not None and (kind or usual) not in WITH_QUANTITY:
        raise UsageError(
            "a quantity can be chosen for branches, and for the map or the bifurcation diagram of a sweep only"
        )
    if figure is not None and ax is not None:
        raise UsageError("give figure= or ax=, not both")
    names = _names(columns)
    if isinstance(result, Result):
        _refuse_undrawable(result)
        kind = _kind_of_part(result, kind, usual, names, (start, end))
    elif names or start is not None or end is not None:
        raise UsageError("columns and a part in time can be chosen for a run only: a sweep has no samples")
    if branches is not None and kind != "bifurcation":
        raise UsageError("branches= is for the bifurcation diagram of a sweep: give kind='bifurcation'")
    options: dict[str, Any] = {"quantity": quantity, "branches": branches, "names": names}
    chosen = {name: value for name, value in options.items() if value not in (None, ())}

    def seen() -> Any:
        return view_of(result, start, end) if isinstance(result, Result) else result

    def fill(name: str, canvas: FigureBase | Axes) -> None:
        kinds[name](seen(), canvas, **chosen)

    if ax is not None:
        axes = _axes(result, kind, ax)
        if kind in IN_AXES:
            return new_figure(partial(fill, str(kind)), axes[0])
        shown = names or ("spring_force_x",)
        return new_figure(lambda _: draw_in_axes(seen(), axes, shown), axes[0])
    try:
        return new_figure(partial(fill, kind or usual), figure)
    except UsageError:
        if kind is not None or not isinstance(result, Result):
            raise
    # The default kind cannot be drawn: all columns.
    if figure is not None:
        figure.clear()
    return new_figure(partial(fill, "columns"), figure)


def _names(columns: str | Sequence[str] | None) -> tuple[str, ...]:
    return (columns,) if isinstance(columns, str) else tuple(columns or ())


def _kind_of_part(
    result: Result,
    kind: str | None,
    usual: str,
    names: tuple[str, ...],
    part: tuple[float | None, float | None],
) -> str | None:
    """The kind of figure for some columns or a part of a run, refused if it cannot show them; None is the default kind."""
    if names:
        if kind not in (None, "history"):
            raise UsageError(f"columns can be chosen for the kind 'history', not for '{kind}'")
        kind = "history"
        # A missing column is refused here: otherwise the default kind would be replaced by another.
        refuse_lacking(result, *names)
    if part != (None, None):
        kind = kind or (usual if usual in WINDOWED else "columns")
        if kind not in WINDOWED:
            shown = ", ".join(WINDOWED)
            raise UsageError(f"a part of the run can be chosen for the kinds {shown}, not for '{kind}'")
        window(result, *part)
    return kind


def _axes(result: Drawable, kind: str | None, ax: Axes | Sequence[Axes]) -> list[Axes]:
    """Axes of the user for columns of a run, or for a kind with one panel."""
    axes = list(np.ravel(np.asarray(ax, dtype=object)))
    if not axes or not all(isinstance(each, Axes) for each in axes):
        raise UsageError("ax must be matplotlib Axes, or a sequence of them")
    if not isinstance(result, Result) or kind not in (None, "history", *IN_AXES):
        offered = ", ".join(IN_AXES)
        raise UsageError(f"ax= is for columns of a run, and the kinds {offered}: give figure= for others")
    if kind in IN_AXES and len(axes) != 1:
        raise UsageError(f"the kind '{kind}' takes one pair of axes, not {len(axes)}")
    return axes


def _kinds_of(result: Drawable, kind: str | None) -> tuple[dict[str, Callable[..., None]], str]:
    """Kinds of figure for the given object, and the default one; a kind that is none of them is refused."""
    kinds = next((kinds for type_, kinds in KINDS_OF.items() if isinstance(result, type_)), SWEEP_KINDS)
    usual = next(iter(kinds))
    if isinstance(result, Result):
        usual = KIND_OF_MODEL.get(str(result.attributes.get("model", "")), usual)
    if kind is not None and kind not in kinds:
        near = the_nearest(kind, kinds)
        raise UsageError(f"no kind of figure '{kind}': {near}the kinds are {', '.join(kinds)}")
    return kinds, usual


def _refuse_undrawable(result: Result) -> None:
    if result.time.size < 2:
        raise UsageError("nothing to draw: the result has fewer than two samples")
    for name, values in result.columns.items():
        if not np.all(np.abs(values) < LARGEST):
            raise UsageError(
                f"nothing to draw: '{name}' reaches {np.max(np.abs(values)):g}: no axis holds {LARGEST:g} or more"
            )


def compare(
    results: Mapping[str, Result],
    *,
    columns: str | Sequence[str] | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Figure:
    """Draw several runs side by side, on the same scales.

    Parameters
    ----------
    results : mapping of Result
        Two to six runs by name.
    columns : str or sequence of str, optional
        Columns to draw, one in each row; by default those of the kind ``"history"`` that all runs have.
    start, end : float, optional
        The part of each run [s]; by default as for `draw`.

    Returns
    -------
    matplotlib.figure.Figure
        Not attached to any window; above each run its name, and the parameters in which the runs differ.

    Raises
    ------
    UsageError
        If there are too few or too many runs, one has no samples, or they have no column in common.
    """
    return _of_several(draw_comparison, results, columns, start=start, end=end)


def overlay(
    results: Mapping[str, Result],
    *,
    columns: str | Sequence[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    over_distance: bool = False,
) -> Figure:
    """Draw several runs into the same panels.

    Parameters
    ----------
    results : mapping of Result
        Two to six runs by name.
    columns : str or sequence of str, optional
        Columns to draw, one in each panel; by default those of ``spring_force_x``, ``theta`` and ``X`` that all runs have.
    start, end : float, optional
        The part of each run [s]; by default the longest part that `draw` shows of one of them.
    over_distance : bool, optional
        Whether the runs are drawn over the distance of the driven end, by default up to the one that all have reached: so runs at
        different speeds can be compared.

    Returns
    -------
    matplotlib.figure.Figure
        Not attached to any window; its legend names the runs, and the parameters in which they differ.

    Raises
    ------
    UsageError
        As for `compare`; also if a drive goes back.
    """
    return _of_several(draw_overlay, results, columns, start=start, end=end, over_distance=over_distance)


def _of_several(
    fill: Callable[..., None],
    results: Mapping[str, Result],
    columns: str | Sequence[str] | None,
    **how: Any,
) -> Figure:
    if not 2 <= len(results) <= MOST_RESULTS:
        raise UsageError(f"{len(results)} results to compare: give two to {MOST_RESULTS}, of different names")
    for result in results.values():
        _refuse_undrawable(result)
    return new_figure(partial(fill, results, names=_names(columns), **how))


def save(
    result: Drawable,
    path: str | os.PathLike[str],
    kind: str | None = None,
    quantity: str | None = None,
    *,
    overwrite: bool = True,
    **how: Any,
) -> None:
    """Draw one kind of figure into a file; its suffix names the format (PNG, PDF, SVG); `how` as for `draw`.

    Raises
    ------
    UsageError
        As for `draw`.
    FileError
        If the file cannot be written.
    """
    write(draw(result, kind, quantity, **how), path, overwrite=overwrite)


class PlotModule(ModuleType):
    """A module that draws when it is called."""

    def __call__(self, result: Any, kind: str | None = None, **options: Any) -> Figure:
        """Draw a result.

        If pyplot has been imported, it also manages a new figure, so that ``plt.show()`` shows it. In a notebook with inline
        figures it does not, because the notebook shows the returned figure itself.

        Parameters
        ----------
        result : Result, Sensitivity or xarray.Dataset, or mapping of Result
            A run, derivatives, or a sweep; or several runs by name, which are drawn side by side.
        kind : str, optional
            Kind of figure, as for `dynstiction.plot.draw`.
        **options
            As for `dynstiction.plot.draw`.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        UsageError
            As for `dynstiction.plot.draw`.
        """
        is_one = isinstance(result, Result) or not isinstance(result, Mapping) or hasattr(result, "coords")
        figure = draw(result, kind, **options) if is_one else compare(result, **options)
        pyplot = sys.modules.get("matplotlib.pyplot")
        is_new = "ax" not in options and "figure" not in options
        if is_new and pyplot is not None and "inline" not in pyplot.get_backend().lower():
            pyplot.figure(FigureClass=lambda *_, **__: figure)
        return figure


sys.modules[__name__].__class__ = PlotModule

if TYPE_CHECKING:
    plot: PlotModule
