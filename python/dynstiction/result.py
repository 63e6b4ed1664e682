"""Results: time series, events, summary and statistics of one run."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._arguments import flag, path_name
from .errors import printable
from .html import table
from .record import (
    STICK_BEGINS,
    Described,
    Table,
    events_between,
    headed,
    occurrences,
    unit_shown,
)

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False, eq=False)
class Result(Table[NDArray[np.float64]]):
    """The results of a run, as `dynstiction.run` returns them and `dynstiction.open` reads them.

    A read-only mapping of the columns of the time series by name: ``result["u_x"]``, ``dict(result)``,
    ``for name in result``, ``"theta" in result``, ``len(result)`` columns. Events, summary, statistics and provenance are
    attributes. Results are equal only to themselves.

    Attributes
    ----------
    columns : Described of ndarray, shape (n,), float64
        The time series by name, ``time`` [s] first: ``u_x``, ``u_y`` [m], ``w_x``, ``w_y`` [m/s], …;
        ``columns.units`` and ``columns.long_names`` describe them.
    log : structured ndarray
        The events of a run, those of a motion that repeats once: ``log["time"]`` [s], ``log["kind"]`` (1 = stick begins,
        2 = slip begins), how many times it ``log["occurs"]``, and after which ``log["period"]`` [s]. `events` has each of them.
    summary : Described of float or int
        Period, peak force, …, if the run has them; counts are integers.
    statistics : Described of int or float
        Counts of the work: steps, evaluations, factorisations, wall time [s], ….
    parameters : Described
        Every key of the deck with the value used.
    attributes : dict
        Provenance and outcome: program, version, model, method, result_code, …; and what was added to the file.
    deck, resolved_deck : str
        The deck as read, and the deck with the values used of all keys.
    """

    columns: Described[NDArray[np.float64]]
    log: NDArray[np.void]
    summary: Described[float]
    statistics: Described[float]
    parameters: Described[float | str] = field(default_factory=lambda: Described([]))
    attributes: dict[str, Any] = field(default_factory=dict)
    deck: str = ""
    resolved_deck: str = ""

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def events(self) -> NDArray[np.void]:
        """All events, shape (n_events,): ``events["time"]`` [s] and ``events["kind"]`` (1 = stick begins, 2 = slip begins).

        Raises
        ------
        UsageError
            If there are more than twenty million.
        """
        return self.events_between(-np.inf, np.inf)

    def events_between(self, first: float, last: float) -> NDArray[np.void]:
        """The events from one time to another, both included: ``time`` [s] and ``kind``, as in `events`.

        Parameters
        ----------
        first, last : float
            Times [s].

        Raises
        ------
        UsageError
            If there are more than twenty million.
        """
        return events_between(self.log, first, last)

    @property
    def time(self) -> NDArray[np.float64]:
        """Times of the samples [s], shape (n,); the last one is the `t_end` of a complete run."""
        return self.columns["time"]

    @property
    def result_code(self) -> int:
        """0: done, 40 to 49: the solver gave up, 75: stopped early."""
        return int(self.attributes.get("result_code", 0))

    @property
    def result_text(self) -> str:
        """How the run ended, in words."""
        return str(self.attributes.get("result_text", ""))

    @property
    def complete(self) -> bool:
        """Whether the run reached its end."""
        return bool(self.attributes.get("complete", 0))

    def sticks(self, until: float = np.inf) -> int:
        """Number of sticks that began, including the first one.

        Parameters
        ----------
        until : float
            Time [s] after which sticks are not counted.
        """
        return int(occurrences(self.log[self.log["kind"] == STICK_BEGINS], until).sum())

    def to_xarray(self) -> xarray.Dataset:
        """Time series as an `xarray.Dataset` over ``time`` [s], with units and provenance.

        It has the same variables as ``xarray.open_dataset(file, group="time_series", engine="h5netcdf")`` gives
        for the saved result, and the attributes of the whole file.
        """
        import xarray  # noqa: PLC0415  (costs a second)

        variables = {
            info.name: ("time", values, {"units": info.units, "long_name": info.long_name})
            for info, values in self.columns.info()
        }
        return xarray.Dataset(variables, {"time": variables.pop("time")}, self.attributes)

    def to_pandas(self) -> pandas.DataFrame:
        """Time series as a `pandas.DataFrame`, indexed by time [s]; ``frame.attrs["units"]`` has the units."""
        return super().to_pandas().set_index("time")

    def plot(self, kind: str | None = None, **options: Any) -> Figure:
        """Draw the result.

        Parameters
        ----------
        kind : str, optional
            ``"history"``, ``"velocities"``, ``"path"``, …: a name in `dynstiction.plot.KINDS`; the default depends on the model.
        **options
            As for `dynstiction.plot.draw`.

        Returns
        -------
        matplotlib.figure.Figure
            If pyplot has been imported, it manages the figure, so that ``plt.show()`` shows it; except with inline figures of a
            notebook.

        Raises
        ------
        UsageError
            If there is no such kind, or the result lacks the data for it.
        """
        from . import plot  # noqa: PLC0415  (matplotlib is slow to import)

        return plot(self, kind, **options)  # type: ignore[no-any-return]

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the same HDF5 file as the executable; it appears under its name only when it is complete.

        Parameters
        ----------
        path : str or PathLike
            The file.
        overwrite : bool
            Whether it may replace an existing file, if that is a file of dynstiction.

        Raises
        ------
        FileError
            If the file exists, is not a file of dynstiction, or cannot be written; the existing file is then kept.
        UsageError
            If `path` is not a path.
        """
        from . import _hdf5  # noqa: PLC0415  (h5py is slow to import)

        _hdf5.write(self, path_name(path), overwrite=flag("overwrite", overwrite))

    def _heading(self) -> str:
        about = " ".join(str(self.attributes[key]) for key in ("model", "method") if key in self.attributes)
        state = "complete" if self.complete else f"incomplete: {self.result_text}"
        span = f"to t = {self.time[-1]:g} s" if self.time.size else "none"
        return f"Result {about}: {self.time.size} samples {span}, {self.sticks()} sticks, {state}"

    def _values(self) -> tuple[str, str, Described[float]]:
        return self._heading(), "summary", self.summary

    def _repr_html_(self) -> str:
        columns = table(
            ("column", "unit", ""),
            [(i.name, unit_shown(i.units), i.long_name) for i, _ in self.columns.info()],
        )
        shown = super()._repr_html_()
        return f"{shown}<details><summary>{len(self.columns)} columns</summary>{columns}</details>"

    def __repr__(self) -> str:
        columns = "columns: " + ", ".join(headed(name, u) for name, u in self.columns.units.items())
        lines = [f"<{self._heading()}", columns, *repr(self.summary).splitlines()]
        return "\n  ".join(printable(line) for line in lines) + ">"


def open(path: str | os.PathLike[str]) -> Any:
    """What a file holds that the executable, `Result.save` or ``dynstiction merge`` has written: a run or a sweep.

    Parameters
    ----------
    path : str or PathLike
        The file.

    Returns
    -------
    Result or xarray.Dataset
        A run; or a sweep, as `dynstiction.sweep` gives it, cycles too. Series (``keep = 'series'``) are left in the file, group
        ``/sweep/series``.

    Warns
    -----
    IncompleteWarning
        If the run did not reach its end, or cases of the sweep failed or have not been run; the results until then are returned.

    Raises
    ------
    FileError
        If the file is missing, damaged or of another program.
    UsageError
        If `path` is not a path.
    """
    from . import _hdf5  # noqa: PLC0415  (h5py is slow to import)

    return _hdf5.read(path_name(path))
