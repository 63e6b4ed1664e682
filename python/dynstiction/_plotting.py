"""The package of the figures as a function: ``ds.plot(result)`` beside ``ds.plot.draw`` and ``import dynstiction.plot``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PlotModule", "plot"]


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
        from .record import Table  # noqa: PLC0415

        if isinstance(result, Mapping) and not isinstance(result, Table) and not hasattr(result, "coords"):
            figure: Figure = self.compare(result, **options)
        else:
            figure = self.draw(result, kind, **options)
        pyplot = sys.modules.get("matplotlib.pyplot")
        is_new = "ax" not in options and "figure" not in options
        if is_new and pyplot is not None and "inline" not in pyplot.get_backend().lower():
            pyplot.figure(FigureClass=lambda *_, **__: figure)
        return figure


if TYPE_CHECKING:
    plot: PlotModule
