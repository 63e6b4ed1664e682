"""Results: time series, events, summary and statistics of one run."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from . import _hdf5
from .errors import ColumnError
from .record import STICK_BEGINS, Record

if TYPE_CHECKING:
    import xarray

__all__ = ["Result", "open"]


class Result(Record):
    """What `dynstiction.run` returns and `dynstiction.open` reads.

    A `Record` (time series, events, summary, statistics, provenance) with what one does with it.
    ``result["u_x"]`` is a column, ``for name in result`` runs over their names.
    """

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
        If the file is missing, damaged, of another program, or holds a sweep (`dynstiction.open_sweep`).
    """
    return Result(**vars(_hdf5.read(path)))
