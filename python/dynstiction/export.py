"""Results as CSV files, for spreadsheets and programs without HDF5."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd  # type: ignore[import-untyped]

from ._output import check_outputs, make_folder, put
from .record import headed, unit_shown
from .result import Result

if TYPE_CHECKING:
    import xarray


FORMULA_BEGINNINGS = ("=", "+", "-", "@", "\t", "\r", "\n", "|")


def export_csv(
    found: Result | xarray.Dataset, folder: Path, name: str, *, overwrite: bool = False
) -> Iterator[Path]:
    """Write the tables of a run or a sweep, and yield each file when it is written.

    Numbers are written so that they are read back as the same doubles. The heading of a column is ``name [unit]``. A text that a
    spreadsheet would take for a formula gets an apostrophe before it.

    Parameters
    ----------
    found : Result or xarray.Dataset
        Of a run NAME_time_series.csv, NAME_events.csv (kind 1 = stick begins, 2 = slip begins) and NAME_summary.csv (summary,
        statistics and parameters, one in each line) are written. Of a sweep NAME_sweep.csv with parameters, summary, result code
        and wall time, a row for each case, and, if cycles are kept, NAME_cycles.csv with a row for each of them.
    folder : Path
        The folder; it is created if it does not exist.
    name : str
        Begin of the names of the files.
    overwrite : bool
        Whether files may be replaced.

    Raises
    ------
    FileError
        If a file exists already or cannot be written.
    """
    tables = _of_run(found) if isinstance(found, Result) else _of_sweep(found)
    files = {folder / f"{name}_{table}.csv": frame for table, frame in tables.items()}
    make_folder(folder)
    check_outputs(files, overwrite=overwrite)
    for path, frame in files.items():
        texts = frame.select_dtypes("object").columns
        frame[texts] = frame[texts].map(_harmless)
        frame.columns = [_harmless(head) for head in frame.columns]
        put(
            path, frame.to_csv(index=False, lineterminator="\r\n", na_rep="nan").encode(), overwrite=overwrite
        )
        yield path


def _of_run(result: Result) -> dict[str, pd.DataFrame]:
    series = pd.DataFrame({headed(info.name, info.units): values for info, values in result.columns.info()})
    events = pd.DataFrame(result.events).rename(columns={"time": "time [s]"})
    rows = [
        (table, info.name, value, unit_shown(info.units), info.long_name)
        for table in ("summary", "statistics", "parameters")
        for info, value in getattr(result, table).info()
    ]
    summary = pd.DataFrame(rows, columns=["table", "name", "value", "unit", "meaning"], dtype=object)
    return {"time_series": series, "events": events, "summary": summary}


def _of_sweep(data: xarray.Dataset) -> dict[str, pd.DataFrame]:
    """A row for each case, and one for each cycle that is kept."""
    of_cases = data.drop_dims("cycle", errors="ignore").drop_vars("result_text").reset_coords()
    dims, count = data["result_code"].dims, data["result_code"].size
    tables = {"sweep": {"case": np.arange(1, count + 1)}}
    for name, values in of_cases.variables.items():
        column = values.set_dims(dict(zip(dims, data["result_code"].shape, strict=True)))  # type: ignore[no-untyped-call]
        column = column.transpose(*dims)
        tables["sweep"][headed(str(name), str(values.attrs.get("units", "1")))] = column.values.ravel()
    if "cycle_count" in data:
        counts = data["cycle_count"].values.ravel()
        first = ["case", *(headed(str(key), str(data[key].attrs["units"])) for key in data.coords)]
        tables["cycles"] = {name: np.repeat(tables["sweep"][name], counts) for name in first}
        there = np.arange(data.sizes["cycle"]) < counts[:, np.newaxis]
        tables["cycles"]["cycle"] = np.nonzero(there)[1] + 1
        for name, cycle in data.data_vars.items():
            if "cycle" in cycle.dims:
                head = headed(str(name).removeprefix("cycle_"), str(cycle.attrs["units"]))
                tables["cycles"][head] = cycle.transpose(*dims, "cycle").values.reshape(there.shape)[there]
    return {name: pd.DataFrame(columns) for name, columns in tables.items()}


def _harmless(cell: Any) -> Any:
    """A text, with an apostrophe before it if a spreadsheet would take it for a formula; numbers are unchanged."""
    return f"'{cell}" if isinstance(cell, str) and cell.lstrip(" ").startswith(FORMULA_BEGINNINGS) else cell
