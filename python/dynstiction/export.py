"""Results as CSV files, for spreadsheets and programs without HDF5."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ._open import info_of, open_file, own_datasets, values_in
from ._output import check_outputs, make_folder, put
from .record import Info, event_columns, headed, unit_shown
from .result import Result

__all__ = ["export_csv", "export_sweep_csv"]

FORMULA_BEGINNINGS = ("=", "+", "-", "@", "\t", "\r", "\n", "|")
Table = tuple[Sequence[str], Iterable[Sequence[object]]]
"""Headings and rows."""

ABOUT = ("table", "name", "value", "unit", "meaning")


def export_csv(result: Result, folder: Path, name: str, *, overwrite: bool = False) -> Iterator[Path]:
    """Write the tables of a run, and yield each file when it is written.

    Numbers are written so that they are read back as the same doubles. The heading of a column is ``name [unit]``. A text that a
    spreadsheet would take for a formula gets an apostrophe before it.

    Parameters
    ----------
    result : Result
        NAME_time_series.csv, NAME_events.csv (kind 1 = stick begins, 2 = slip begins) and NAME_summary.csv (summary, statistics
        and parameters, one in each line) are written.
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
    tables: dict[str, Callable[[], Table]] = {
        "time_series": lambda: _table(result.columns.info()),
        "events": lambda: _table(event_columns(result.events)),
        "summary": lambda: (ABOUT, _summary_rows(result)),
    }
    return _write({folder / f"{name}_{table}.csv": make for table, make in tables.items()}, overwrite)


def _summary_rows(result: Result) -> Iterator[Sequence[object]]:
    for table in ("summary", "statistics", "parameters"):
        for info, value in getattr(result, table).info():
            yield table, info.name, value, unit_shown(info.units), info.long_name


def export_sweep_csv(path: Path, folder: Path, name: str, *, overwrite: bool = False) -> Iterator[Path]:
    """Write the tables of a sweep file, and yield each file when it is written.

    There is one row for each case, with parameters, summary, result code and wall time. The cycles that are kept
    (``sweep.keep = 'cycles'``) have a row each: case, parameters, number of the cycle in the case, period, peak force, ....

    Parameters
    ----------
    path : Path
        The sweep file.
    folder, name, overwrite
        As for `export_csv`; the files are NAME_sweep.csv and, where there are cycles, NAME_cycles.csv.

    Raises
    ------
    FileError
        If the sweep file cannot be read, or a CSV file exists already or cannot be written.
    """
    with open_file(path) as file:
        group = file["sweep"]
        tables = {folder / f"{name}_sweep.csv": lambda: _table(_sweep_columns(group))}
        if "cycles" in group:
            tables[folder / f"{name}_cycles.csv"] = lambda: _table(_cycle_columns(group))
        yield from _write(tables, overwrite)


def _sweep_columns(group: Any) -> Iterator[tuple[Info, Any]]:
    """Columns with one number for each case: case, parameters, result code, wall time, then the summary."""
    cases = values_in(group, "case").shape
    for table in (group, group["summary"]):
        # Sorted by name, except the number of the case.
        for name, dataset in sorted(own_datasets(table, 1), key=lambda named: named[0] != "case"):
            if dataset.shape == cases and dataset.dtype.kind in "iuf":
                yield info_of(name, dataset), dataset[...]


def _cycle_columns(group: Any) -> Iterator[tuple[Info, Any]]:
    """Columns with one number for each kept cycle: case, parameters, number of the cycle, then its quantities."""
    cycles = group["cycles"]
    counts = values_in(cycles, "count")
    for name in ("case", *str(group.attrs["parameters"]).split()):
        yield info_of(name, group[name]), np.repeat(values_in(group, name), counts)
    numbers = values_in(cycles, "cycle")
    there = np.arange(numbers.size) < counts[:, np.newaxis]
    yield info_of("cycle", cycles["cycle"]), np.broadcast_to(numbers, there.shape)[there]
    for name, dataset in own_datasets(cycles, 2):
        if dataset.shape == there.shape and dataset.dtype.kind in "iuf":
            yield info_of(name, dataset), dataset[...][there]


def _table(columns: Iterable[tuple[Info, Any]]) -> Table:
    """Headings and rows of a table of columns."""
    infos, values = zip(*columns, strict=True)
    head = [headed(info.name, info.units) for info in infos]
    # As Python numbers, which are written with the fewest digits that are read back as the same number.
    return head, zip(*(np.asarray(column).tolist() for column in values), strict=True)


def _write(tables: Mapping[Path, Callable[[], Table]], overwrite: bool) -> Iterator[Path]:
    """Write tables, which are made one after the other; all names are checked before."""
    for folder in {path.parent for path in tables}:
        make_folder(folder)
    check_outputs(tables, overwrite=overwrite)
    for path, make in tables.items():
        head, rows = make()
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(map(_harmless, head))
        writer.writerows(map(_harmless, row) for row in rows)
        put(path, text.getvalue().encode(), overwrite=overwrite)
        yield path


def _harmless(cell: object) -> object:
    """A text, with an apostrophe before it if a spreadsheet would take it for a formula; numbers are unchanged."""
    return f"'{cell}" if isinstance(cell, str) and cell.lstrip(" ").startswith(FORMULA_BEGINNINGS) else cell
