"""The package of the figures as a function: ``ds.plot(result)`` beside ``ds.plot.draw`` and ``import dynstiction.plot``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PlotModule", "make_callable", "plot"]


class PlotModule(ModuleType):
    """A module that draws when it is called."""

    def __call__(self, result: Any, kind: str | None = None, **options: Any) -> Figure:
        """Draw a result.

        A figure that is new is also one of pyplot's, if that has been imported, so that ``plt.show()`` shows it; not in a
        notebook with inline figures, which shows the returned figure itself.

        Parameters
        ----------
        result : Result, Trade or xarray.Dataset, or mapping of Result
            A run, a comparison, or a sweep; or several runs by name, which are drawn side by side.
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
            As `dynstiction.plot.draw`.
        """
        from .record import Table  # noqa: PLC0415

        if isinstance(result, Mapping) and not isinstance(result, Table) and not hasattr(result, "coords"):
            figure: Figure = self.compare(result, **options)
        else:
            figure = self.draw(result, kind, **options)
        if "ax" not in options and "figure" not in options:
            _give_to_pyplot(figure)
        return figure


def make_callable(name: str) -> None:
    """Let the module of this name draw when it is called."""
    sys.modules[name].__class__ = PlotModule


def _give_to_pyplot(figure: Figure) -> None:
    """Let pyplot, where it is in use, manage a figure, unless figures are shown as values."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None and "inline" not in pyplot.get_backend().lower():
        pyplot.figure(FigureClass=lambda *_, **__: figure)


if TYPE_CHECKING:
    plot: PlotModule
