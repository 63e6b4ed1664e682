"""Results: time series, events, summary and statistics of one run."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import _hdf5
from ._native import Info
from .errors import ColumnError

if TYPE_CHECKING:
    import xarray

__all__ = ["EVENT_DTYPE", "SLIP_BEGINS", "STICK_BEGINS", "Described", "Result", "open"]

STICK_BEGINS = 1
SLIP_BEGINS = 2

EVENT_DTYPE = np.dtype([("time", np.float64), ("kind", np.int32)])

T = TypeVar("T")


class Described(Mapping[str, T], Generic[T]):
    """Read-only mapping of names to values that knows what each value is.

    Attributes
    ----------
    units : dict of str
        Unit of each value, ``"1"`` where it has none.
    long_names : dict of str
        What each value is, in words.
    """

    def __init__(self, entries: Iterable[tuple[Info, T]]) -> None:
        self._values: dict[str, T] = {}
        self.units: dict[str, str] = {}
        self.long_names: dict[str, str] = {}
        for info, value in entries:
            self._values[info.name] = value
            self.units[info.name] = info.units
            self.long_names[info.name] = info.long_name

    def __getitem__(self, name: str) -> T:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def info(self) -> list[tuple[Info, T]]:
        """Name, unit and meaning of each value with the value itself."""
        return [
            (Info(name, self.units[name], self.long_names[name]), value)
            for name, value in self._values.items()
        ]

    def __repr__(self) -> str:
        return "\n".join(f"{name} = {value} {self.units[name]}" for name, value in self.items())


@dataclass(frozen=True, repr=False, eq=False)
class Result:
    """What `dynstiction.run` returns and `dynstiction.open` reads.

    Attributes
    ----------
    columns : Described of ndarray, shape (n,), float64
        The time series by name, ``time`` [s] first: ``u_x``, ``u_y`` [m], ``w_x``, ``w_y`` [m/s], …;
        ``columns.units`` and ``columns.long_names`` describe them.
    events : structured ndarray, shape (n_events,)
        ``events["time"]`` [s] and ``events["kind"]`` (1 = stick begins, 2 = slip begins).
    summary : Described of float
        What the run amounts to (period, peak force, …), as far as it has a value.
    statistics : Described of int or float
        The work done: steps, evaluations, factorisations, wall time [s], ….
    parameters : Described
        Every key of the deck as used.
    attributes : dict
        Provenance and outcome: program, version, model, method, result_code, ….
    deck, resolved_deck : str
        The deck as read, and with every key as used.
    """

    columns: Described[NDArray[np.float64]]
    events: NDArray[np.void]
    summary: Described[float]
    statistics: Described[float]
    parameters: Described[float | str] = field(default_factory=lambda: Described([]))
    attributes: dict[str, str | int] = field(default_factory=dict)
    deck: str = ""
    resolved_deck: str = ""

    @property
    def time(self) -> NDArray[np.float64]:
        """Times of the samples [s], shape (n,); the last one is the `t_end` of a complete run."""
        return self.columns["time"]

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        try:
            return self.columns[name]
        except KeyError:
            raise ColumnError(
                f"no column '{name}', only {', '.join(self.columns)}: "
                f"name '{name}' in the deck's output.fields and run again"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    @property
    def result_code(self) -> int:
        """0 done, 40 to 49 the solver gave up, 75 stopped early."""
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
        """Number of sticks that began up to the time `until` [s], the first one included."""
        began = (self.events["kind"] == STICK_BEGINS) & (self.events["time"] <= until)
        return int(np.count_nonzero(began))

    def to_xarray(self) -> xarray.Dataset:
        """Time series as an `xarray.Dataset` over ``time`` [s], with units and provenance.

        The same variables as ``xarray.open_dataset(file, group="time_series", engine="h5netcdf")`` gives
        of the saved result, and the attributes of the whole file.
        """
        import xarray  # noqa: PLC0415  (costs a second, and only this method needs it)

        variables = {
            info.name: ("time", values, {"units": info.units, "long_name": info.long_name})
            for info, values in self.columns.info()
        }
        return xarray.Dataset(
            {name: variable for name, variable in variables.items() if name != "time"},
            coords={"time": variables["time"]},
            attrs=dict(self.attributes),
        )

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the HDF5 file that the executable writes.

        Parameters
        ----------
        path : str or PathLike
            The file.
        overwrite : bool
            Whether it may replace a file that is there.

        Raises
        ------
        FileError
            If the file exists or cannot be written.
        """
        _hdf5.write(self, path, overwrite=overwrite)

    def __repr__(self) -> str:
        about = " ".join(str(self.attributes[key]) for key in ("model", "method") if key in self.attributes)
        state = "complete" if self.complete else f"incomplete: {self.result_text}"
        span = f"to t = {self.time[-1]:g} s" if self.time.size else "none"
        lines = [f"<Result {about}: {self.time.size} samples {span}, {self.sticks()} sticks, {state}"]
        lines.append("  columns: " + ", ".join(f"{n} [{u}]" for n, u in self.columns.units.items()))
        for name, value in self.summary.items():
            lines.append(f"  {name} = {value:.10g} {self.summary.units[name]}")
        return "\n".join(lines) + ">"


def open(path: str | os.PathLike[str]) -> Result:
    """Result in a file written by the executable or by `Result.save`.

    Warns
    -----
    IncompleteWarning
        If the run did not reach its end; what it wrote is returned.

    Raises
    ------
    FileError
        If the file is missing, damaged, of another program, or holds a sweep.
    """
    return _hdf5.read(path)
