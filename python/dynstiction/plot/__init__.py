"""Figures of results, drawn for one journal column (86 mm).

A kind of figure is a function of what it shows and an empty canvas, and one line in a table of kinds, with what can be chosen for it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from ..branches import Branches
from ..errors import UsageError
from ..result import Result
from ..stick_slip import first_release
from ..tangents import Sensitivity
from .bifurcation import draw_bifurcation
from .branches import draw_branches, draw_sensitivity
from .creep import draw_creep
from .damping import draw_damping
from .notation import the_nearest, thin
from .path import draw_path
from .spectra import draw_spectrogram
from .style import DOTS_PER_INCH, new_figure, write
from .sweep_map import draw_map
from .time_series import draw_comparison, draw_history, draw_overlay, draw_series, draw_velocities
from .view import coarseness, view_of

if TYPE_CHECKING:
    import xarray

__all__ = [
    "DOTS_PER_INCH",
    "KINDS",
    "SWEEP_KINDS",
    "Drawable",
    "Kind",
    "PlotModule",
    "coarseness",
    "draw",
    "first_release",
    "save",
    "thin",
]


class Kind(NamedTuple):
    """A kind of figure: the function that draws it, and what can be chosen for it, by the keywords of `draw`."""

    draw: Callable[..., None]
    choices: tuple[str, ...] = ()


PART = ("start", "end")
KINDS = {
    "history": Kind(draw_history, (*PART, "columns", "ax")),
    "velocities": Kind(draw_velocities, PART),
    "spectrogram": Kind(draw_spectrogram, PART),
    "damping": Kind(draw_damping, ("ax",)),
    "creep": Kind(draw_creep),
    "path": Kind(draw_path, (*PART, "ax")),
    "columns": Kind(draw_series, PART),
}
"""Kinds of figure of a run by name."""

SWEEP_KINDS = {
    "map": Kind(draw_map, ("quantity",)),
    "bifurcation": Kind(draw_bifurcation, ("quantity", "branches")),
}
"""Kinds of figure of a sweep by name."""

KINDS_OF: dict[type, dict[str, Kind]] = {
    Result: KINDS,
    Sensitivity: {"sensitivity": Kind(draw_sensitivity)},
    Branches: {"branches": Kind(draw_branches, ("quantity",))},
    dict: {
        "compare": Kind(draw_comparison, (*PART, "columns")),
        "overlay": Kind(draw_overlay, (*PART, "columns")),
    },
    object: SWEEP_KINDS,
}
"""Kinds of figure of an object, the default one first."""

KIND_OF_MODEL = {"creep": "creep", "creep_asymptotic": "columns", "high_frequency": "velocities"}
"""Kind of figure that suits the purpose of a model; for other models the history."""

Drawable: TypeAlias = "Result | Sensitivity | Branches | xarray.Dataset | dict[str, Result]"
"""A run, the derivatives of a cycle, branches of cycles, a sweep, or several runs by name."""


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
    result : Result, Sensitivity, Branches, xarray.Dataset or dict of Result
        A run, from `dynstiction.run` or `dynstiction.open`; derivatives, from `dynstiction.sensitivity`; branches, from
        `dynstiction.branch`; a sweep, from `dynstiction.sweep` or `dynstiction.open`; or two to six runs by name.
    kind : str, optional
        For a run, a name in `KINDS`; the default depends on its model, and is all columns if the result lacks the data for
        that kind. For a sweep, a name in `SWEEP_KINDS`, by default ``"map"``. For several runs ``"compare"``, the default, which
        draws them side by side on the same scales, or ``"overlay"``, which draws them into the same panels; both name the
        parameters in which the runs differ.
    quantity : str, optional
        Quantity of a map of a sweep, by default ``"swing"``, or of a bifurcation diagram, by default ``"peak_force"``,
        which is also that of branches.
    branches : Branches, optional
        Branches over the parameter of the sweep, which are drawn into its bifurcation diagram.
    columns : str or sequence of str, optional
        Columns of runs to draw, one in each panel, in place of those of the kind ``"history"``; by default several runs show
        what all of them have.
    start, end : float, optional
        Part of a run to draw [s]. Without both, a run with many cycles is drawn up to its first cycles, and the figure says so;
        an overlay has the longest of these parts.
    figure : Figure or SubFigure, optional
        Figure to draw into; it keeps its size. Without it (and without `ax`) a new figure of one journal column is made.
    ax : Axes or sequence of Axes, optional
        Axes to draw into: `columns`, one in each (by default ``"spring_force_x"`` in the first), or a kind with one panel.

    Returns
    -------
    matplotlib.figure.Figure
        A new one, not attached to any window, or the one that contains `figure` or `ax`.

    Raises
    ------
    UsageError
        If there is no such kind, the result lacks a column (a `ColumnError`) or has no samples, the kind cannot show such a
        result or what was chosen, or the start is not before the end; the text says what would be right.
    """
    if figure is not None and ax is not None:
        raise UsageError("give figure= or ax=, not both")
    canvas = figure if ax is None else list(np.ravel(np.asarray(ax, dtype=object)))
    if isinstance(canvas, list) and not (canvas and all(isinstance(each, Axes) for each in canvas)):
        raise UsageError("ax must be matplotlib Axes, or a sequence of them")
    names = (columns,) if isinstance(columns, str) else tuple(columns or ())
    given: dict[str, Any] = {"quantity": quantity, "branches": branches, "columns": names or None, "ax": ax}
    given |= {"start": start, "end": end}
    chosen = {key: value for key, value in given.items() if value is not None}
    kinds = next(kinds for type_, kinds in KINDS_OF.items() if isinstance(result, type_))
    wanted = kind or _usual_kind(result, kinds, set(chosen))
    _refuse_unfit(wanted, kinds, set(chosen))
    chosen.pop("ax", None)
    if not isinstance(result, Result):
        return new_figure(lambda canvas: kinds[wanted].draw(result, canvas, **chosen), canvas)
    begin, finish = (chosen.pop(key, None) for key in PART)

    def fill(name: str, canvas: Any) -> None:
        kinds[name].draw(view_of(result, begin, finish), canvas, **chosen)

    try:
        return new_figure(partial(fill, wanted), canvas)
    except UsageError:
        if kind is not None or chosen or ax is not None:
            raise
    # The default kind cannot be drawn: all columns.
    if figure is not None:
        figure.clear()
    return new_figure(partial(fill, "columns"), figure)


def _usual_kind(result: Drawable, kinds: Mapping[str, Kind], chosen: set[str]) -> str:
    """The default kind of an object, or the first one for which this can be chosen."""
    of_model = KIND_OF_MODEL.get(result.attributes.get("model", "")) if isinstance(result, Result) else None
    known = ([of_model] if of_model else []) + list(kinds)
    return next((name for name in known if chosen.issubset(kinds[name].choices)), known[0])


def _refuse_unfit(kind: str, kinds: Mapping[str, Kind], chosen: set[str]) -> None:
    """Refuse what is no kind of figure of an object, and what cannot be chosen for it."""
    if kind not in kinds:
        near = the_nearest(kind, kinds)
        raise UsageError(f"no kind of figure '{kind}': {near}the kinds are {', '.join(kinds)}")
    for choice in sorted(chosen.difference(kinds[kind].choices)):
        fit = [name for each in KINDS_OF.values() for name in each if choice in each[name].choices]
        raise UsageError(f"{choice} can be chosen for the kinds {', '.join(fit)}, not for '{kind}'")


def save(
    result: Drawable, path: str | os.PathLike[str], *args: Any, overwrite: bool = True, **how: Any
) -> None:
    """Draw one kind of figure into a file, whose suffix names the format (PNG, PDF, SVG); `args` and `how` as for `draw`.

    Raises
    ------
    UsageError
        As for `draw`.
    FileError
        If the file cannot be written.
    """
    write(draw(result, *args, **how), path, overwrite=overwrite)


class PlotModule(ModuleType):
    """A module that draws when it is called."""

    def __call__(self, result: Drawable, kind: str | None = None, **options: Any) -> Figure:
        """Draw a result as `dynstiction.plot.draw` does, with the same options.

        If pyplot has been imported, it also manages a new figure, so that ``plt.show()`` shows it. In a notebook with inline
        figures it does not, because the notebook shows the returned figure itself.
        """
        figure = draw(result, kind, **options)
        pyplot = sys.modules.get("matplotlib.pyplot")
        is_new = "ax" not in options and "figure" not in options
        if is_new and pyplot is not None and "inline" not in pyplot.get_backend().lower():
            pyplot.figure(FigureClass=lambda *_, **__: figure)
        return figure


sys.modules[__name__].__class__ = PlotModule
