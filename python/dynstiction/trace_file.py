"""Measured traces and friction coefficients in files: tables of text, HDF5."""

from __future__ import annotations

import csv
import gzip
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import mode
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._arguments import number, path_name, shown
from .errors import FileError, UsageError
from .trace import Trace

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

__all__ = ["UNITS", "Column", "Units", "read_friction", "read_trace"]

_Floats = NDArray[np.float64]

_Found: TypeAlias = tuple[_Floats, str, str]
"""Values of a column as the file has it, its unit, '' if none is named, and where the unit stands, for a message."""

Column: TypeAlias = int | str
"""A column of a table by its number, from 0, or its name; a dataset of an HDF5 file by its path."""

Units: TypeAlias = Mapping[str, str | float]
"""Name of the unit of a quantity, or its factor to SI."""

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "force": {
        "N": 1.0,
        "mN": 1e-3,
        "cN": 1e-2,
        "uN": 1e-6,
        "nN": 1e-9,
        "kN": 1e3,
        "gf": 9.80665e-3,
        "kgf": 9.80665,
        "lbf": 4.4482216152605,
    },
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6},
    "mu": {"1": 1.0, "-": 1.0, "%": 1e-2},
}
"""Names of the units in the file of a trace or of friction coefficients, and their factors to SI."""
UNITS["lateral_force"] = UNITS["force"]

SYNONYMS = {"sec": "s", "msec": "ms", "usec": "us"}
"""Other names of units."""

ALTERNATIVES: dict[str, tuple[str, ...]] = {
    "time": ("time", "t", "time_series/time"),
    "force": ("force", "f", "pull_force", "friction_force"),
    "speed": ("speed", "velocity", "v", "table_speed"),
    "mu": ("mu", "friction", "friction_coefficient", "table_mu"),
}
"""Column names by which these are found if the user gives none."""

STYLES = tuple(
    re.compile(f".*\\S{style}")
    for style in (r"\s*\[([^\[]*)\]", r"\s*\(([^(]*)\)", r"\s*/\s*(\S+)", r"\s+in\s+(\S+)")
)
"""How a head names the unit of a column: F [mN], F (mN), F/mN, F in mN."""
EITHER = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""A number of which nobody knows whether its comma is a decimal one or separates thousands."""
BEGINS_WITH_NUMBER = re.compile(r'\s*["+\-.,0-9]')

HDF5_BEGINNING = b"\x89HDF\r\n\x1a\n"
GZIP_BEGINNING = b"\x1f\x8b"
HDF5_PLACES = (0, 512, 1024, 2048)
DELIMITERS = (";", "\t", ",", " ")
SNIFFED = 20
"""Number of lines from which the delimiter is found."""
MOST_LINES = 0.6
"""Least share of these lines that a delimiter splits into the same columns."""
MOST_HEADS = 2
"""Largest number of lines with names and units at the beginning of a table."""
WORDS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}


def read_trace(
    path: str | os.PathLike[str],
    *,
    time: Column | None = None,
    force: Column | None = None,
    displacement: Column | None = None,
    lateral_force: Column | None = None,
    units: Units | None = None,
    delimiter: str | None = None,
    interval: float | None = None,
) -> Trace:
    """Read a trace from a table of text or from an HDF5 file.

    A table has one sample in each line, with commas, semicolons, tabs or blanks between the columns. It may begin with a line of
    names, ``force [mN]`` or ``force``, and a line of units. Empty lines and text after a ``#`` are ignored. If the delimiter is
    not a comma, a number may have a decimal comma.

    Parameters
    ----------
    path : str or PathLike
        The file.
    time, force : int or str, optional
        Columns of time and force, by number from 0 or by name; in an HDF5 file the paths of the datasets. By default the columns
        named ``time`` and ``force``, else the first and the second.
    displacement, lateral_force : int or str, optional
        Columns of the object's displacement along the pull and of the force across it.
    units : mapping, optional
        Units, ``{"time": "ms", "force": "mN"}``, or factors to SI, ``{"force": 9.81e-3}``; a negative factor reverses the sign.
        By default the units in brackets after the names, or in the attribute ``units`` of a dataset, else SI.
    delimiter : str, optional
        The delimiter between the columns; by default it is detected.
    interval : float, optional
        Time between two samples [s], if there is no column of times.

    Returns
    -------
    Trace
        The trace in SI units.

    Raises
    ------
    FileError
        If the file cannot be read or a sample is not usable; the text gives the file, the line and what to do.
    UsageError
        If there is no such column or unit.
    """
    wanted = {"time": time, "force": force, "displacement": displacement, "lateral_force": lateral_force}
    required = ("time", "force") if interval is None else ("force",)
    if interval is not None:
        interval = number("interval", interval, above=0.0, units="s")
        if time is not None:
            raise UsageError("time and interval: give the column of times or the time between two samples")
    values, words, lines = _read(path, "a trace", wanted, required, units, delimiter)
    if interval is not None:
        values["time"] = interval * np.arange(values["force"].size, dtype=np.float64)
    return Trace(**values, name=path_name(path), lines=lines, units=words)


def read_friction(
    path: str | os.PathLike[str], *, units: Units | None = None, delimiter: str | None = None
) -> tuple[_Floats, _Floats]:
    """Slip speeds [m/s] and friction coefficients from a table of text; arguments and errors as for `read_trace`."""
    wanted, name = {"speed": None, "mu": None}, path_name(path)
    if _is_hdf5(name, "a table of friction"):
        raise FileError(f"{name}: is an HDF5 file: give a table of text, or arrays")
    values, *_ = _read(name, "a table of friction", wanted, tuple(wanted), units, delimiter)
    return values["speed"], values["mu"]


def _read(
    path: str | os.PathLike[str],
    what: str,
    wanted: Mapping[str, Column | None],
    required: Sequence[str],
    units: Units | None,
    delimiter: str | None,
) -> tuple[dict[str, _Floats], str, NDArray[np.int64] | None]:
    """Columns of a file in SI units, the units in the file, in words, and the lines of the samples; None of an HDF5 file.

    A required column that is not named is the one with a usual name, in a table else that at its place.
    """
    name = path_name(path)
    if not isinstance(units, Mapping | None):
        raise UsageError(f"units = {shown(units)}: units are a mapping of names, {{'force': 'mN'}}")
    for quantity in units or {}:
        if quantity not in wanted:
            quantities = (" and " if len(wanted) == 2 else ", ").join(wanted)
            raise UsageError(f"units: {shown(quantity)}: {what} has {quantities}")
    for quantity, column in wanted.items():
        if isinstance(column, bool) or not isinstance(column, int | str | None):
            raise UsageError(
                f"{quantity} = {shown(column)}: a column is given by its number, from 0, or its name"
            )
    factors = {quantity: _factor(quantity, unit) for quantity, unit in (units or {}).items()}
    lines = None
    if _is_hdf5(name, what):
        if delimiter is not None:
            raise UsageError(f"{name}: is an HDF5 file, which has no delimiter: leave it out")
        found = _hdf5_columns(name, wanted, required)
    else:
        table = _Table(name, delimiter, " and ".join(required))
        found = table.columns(wanted, required)
        lines = np.array([line for line, _ in table.rows], dtype=np.int64)
    for quantity, (_, unit, place) in found.items():
        if quantity not in factors:
            factors[quantity] = _factor(quantity, unit, place) if unit else 1.0
    words = ", ".join(f"{q.replace('_', ' ')} in {_name_of(q, factors[q])}" for q in found)
    return {quantity: values * factors[quantity] for quantity, (values, *_) in found.items()}, words, lines


def _factor(quantity: str, unit: str | float, place: str = "") -> float:
    """Factor to SI of a unit at a place in the file, or of one that is given by name, or as the factor itself."""
    known = UNITS[quantity]
    if isinstance(unit, str) and (name := _unit_name(unit)) in known:
        return known[name]
    base = next(iter(known))
    if place:
        raise UsageError(
            f"{place} is in {shown(unit)}, which is unknown: name the unit ({', '.join(known)}) or its factor to {base}"
        )
    try:
        factor = number(f"the unit of {quantity}", float(unit) if isinstance(unit, str) else unit)
    except ValueError:
        raise UsageError(
            f"units: {quantity} in {shown(unit)}: the units are {', '.join(known)}; for another give its factor to {base}"
        ) from None
    if factor == 0.0:
        raise UsageError(f"units: the factor of {quantity} is 0: give one that is not")
    return factor


def _unit_name(text: str) -> str:
    name = text.strip().replace("µ", "u").replace("μ", "u")
    return SYNONYMS.get(name, name)


def _name_of(quantity: str, factor: float) -> str:
    """Name of a unit, or its factor to SI."""
    known = UNITS[quantity]
    return next((name for name, each in known.items() if each == factor), f"{factor:g} {next(iter(known))}")


def _is_hdf5(name: str, what: str) -> bool:
    if os.path.exists(name) and not os.path.isfile(name):
        raise FileError(f"{name}: is not a regular file: give a file with a table, or an HDF5 file")
    try:
        with open(name, "rb") as stream:
            beginning = stream.read(HDF5_PLACES[-1] + len(HDF5_BEGINNING))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileError(f"{name}: cannot be read: {reason}: give the file of {what}") from error
    return any(beginning.startswith(HDF5_BEGINNING, place) for place in HDF5_PLACES)


# Tables -------------------------------------------------------------------------------------------------------------------


class _Table:
    """A table of text: heads with names and units, and rows of data, each with the number of its line."""

    def __init__(self, name: str, delimiter: str | None, sample: str) -> None:
        comments: list[tuple[int, str]] = []
        lines: list[tuple[int, str]] = []
        for i, line in enumerate(_text_of(name).split("\n"), 1):
            before, mark, after = line.partition("#")
            if before.strip() and not BEGINS_WITH_NUMBER.match(before):
                # A sign in a name.
                before = line
            if before.strip():
                lines.append((i, before.rstrip("\r")))
            elif mark and not lines:
                comments.append((i, after.strip().lstrip("#").strip()))
        if not lines:
            raise FileError(f"{name}: has no samples: a table has one a line, {sample}")
        if delimiter is None:
            delimiter = _sniff(name, lines, sample)
        elif not isinstance(delimiter, str) or len(delimiter) != 1 or delimiter in '\r\n"#.+-0123456789':
            raise UsageError(f"delimiter = {shown(delimiter)}: it is one character, like ',' or ';'")
        self.name, self.delimiter = name, delimiter
        rows = [(i, _fields(line, delimiter)) for i, line in lines]
        # Empty columns from delimiters at the ends of all lines.
        empty = min(len(fields) - max(1, _filled(fields)) for _, fields in rows)
        rows = [(i, fields[: len(fields) - empty]) for i, fields in rows]
        # Data begin with a number, if any line does.
        by_first = (i for i, (_, fields) in enumerate(rows) if _is_number(fields[0], delimiter))
        by_any = (i for i, (_, fields) in enumerate(rows) if self._has_number(fields))
        begin = next(by_first, next(by_any, len(rows)))
        above, self.rows = rows[:begin], rows[begin:]
        if not self.rows:
            raise FileError(f"{name}: has names and no samples: a table has one sample a line, {sample}")
        heads = [(i, fields) for i, fields in above if any(fields) and self._are_names(fields, delimiter)]
        # Of a longer preamble the last line is a head; of two lines, and before a line of units, there are names above it.
        has_two = len(heads) > 1 and (len(above) == len(heads) == MOST_HEADS or _are_units(heads[-1][1]))
        self.heads = heads[-2:] if has_two and not _name_units(heads[-1][1]) else heads[-1:]
        # A line with numbers below the names is damaged, which is reported later.
        last = self.heads[-1][0] if self.heads else 0
        self.rows = [each for each in above if each[0] > last and self._has_number(each[1])] + self.rows
        self.heads = self.heads or self._commented_head(comments)
        self._refuse_either()

    def _has_number(self, fields: Sequence[str]) -> bool:
        return any(_is_number(field, self.delimiter) for field in fields)

    def _are_names(self, fields: Sequence[str], delimiter: str) -> bool:
        """Whether fields are words, one for each column."""
        row = self.rows[0][1]
        fits = len(fields) == len(row) or _filled(fields) == _filled(row)
        return fits and not any(_is_number(field, delimiter) for field in fields)

    def _commented_head(self, comments: Sequence[tuple[int, str]]) -> list[tuple[int, list[str]]]:
        """The last comment before the data that has a word for each column, or, between other delimiters, a name with a unit."""
        known = {*UNITS["time"], *UNITS["force"]} - {"s", "N", "h", "min"}
        in_brackets = re.compile(r"[\[(]([^\[\]()]*)[\])]")
        names_unit = {
            line for line, text in comments if known & {*map(_unit_name, in_brackets.findall(text))}
        }
        for line, text in reversed(comments):
            for mark in (self.delimiter, *(DELIMITERS[:-1] if line in names_unit else ())):
                if self._are_names(fields := _fields(text, mark), mark):
                    return [(line, fields)]
        if names_unit:
            raise UsageError(
                f"{self.name}:{min(names_unit)}: names units, but not {_filled(self.rows[0][1])} columns: name the units, like --unit "
                "force=mN, units={'force': 'mN'}"
            )
        return []

    def _refuse_either(self) -> None:
        """Refuse a table in which every comma may separate thousands."""
        fields = ((line, field) for line, fields in self.rows for field in fields)
        doubtful = [(line, field) for line, field in fields if "," in field and "." not in field]
        if self.delimiter != "," and doubtful and all(EITHER.fullmatch(field) for _, field in doubtful):
            raise FileError(
                f"{self.name}:{doubtful[0][0]}: the comma in all numbers may be a decimal one or separate thousands: write them with points, "
                "or without separators"
            )

    @property
    def names(self) -> list[str]:
        """Names of the columns; empty if there are none."""
        return self.heads[0][1] if self.heads else []

    @property
    def width(self) -> int:
        return len(self.rows[0][1])

    def about(self) -> str:
        """The columns, for a message."""
        if self.names:
            return "the columns are " + ", ".join(f"{i} {shown(each)}" for i, each in enumerate(self.names))
        return f"there are {self.width} columns without names, 0 to {self.width - 1}"

    def columns(self, wanted: Mapping[str, Column | None], required: Sequence[str]) -> dict[str, _Found]:
        """The wanted columns; a required one that is not named is the one with a usual name, else that at its place."""
        found = {
            quantity: self._find(quantity, each) for quantity, each in wanted.items() if each is not None
        }
        for place, quantity in enumerate(required):
            if quantity not in found:
                found[quantity] = self._usual(quantity, place, set(found.values()))
        twice = [q for q in found if list(found.values()).count(found[q]) > 1]
        if twice:
            raise UsageError(
                f"{self.name}: {' and '.join(twice)} are the same column, {found[twice[0]]}: {self.about()}"
            )
        line = self.heads[0][0] if self.heads else 0
        return {
            q: (self._numbers(q, i), self._unit(q, i), f"{self.name}:{line}: {q}") for q, i in found.items()
        }

    def _find(self, quantity: str, column: Column) -> int:
        found: list[int] = []
        if isinstance(column, int):
            found = [column] if 0 <= column < self.width else []
        else:
            for form in (str, _bare, lambda each: _bare(each).lower()):
                found = found or [i for i, each in enumerate(self.names) if form(each) == form(column)]
        if len(found) > 1:
            raise UsageError(
                f"{self.name}: {len(found)} columns are called {shown(column)}: give its number; {self.about()}"
            )
        if found:
            return found[0]
        raise UsageError(f"{self.name}: {quantity} is to be column {shown(column)}: {self.about()}")

    def _usual(self, quantity: str, place: int, taken: set[int]) -> int:
        bare = [_bare(each).lower() for each in self.names]
        for name in ALTERNATIVES[quantity]:
            if bare.count(name) == 1 and bare.index(name) not in taken:
                return bare.index(name)
        if place >= self.width or place in taken:
            raise UsageError(f"{self.name}: which column is {quantity}? Name it: {self.about()}")
        return place

    def _unit(self, quantity: str, column: int) -> str:
        """Unit of a column in the head, '' if none: in a line of units, in brackets, after a slash or 'in', or, if it is one of the
        quantity, after a blank or an underscore.
        """
        if len(self.heads) > 1 and column < len(self.heads[1][1]):
            below = self.heads[1][1][column].strip("[]() ")
            if below:
                return below
        name = self.names[column].strip() if column < len(self.names) else ""
        words = name.split()
        if len(words) > 1 and _unit_name(words[-1]) in UNITS[quantity]:
            return words[-1]
        for style in STYLES:
            if (found := style.fullmatch(name)) and (unit := found[1].strip()):
                return unit
        before, _, unit = name.rpartition("_")
        return unit if before and _unit_name(unit) in UNITS[quantity] else ""

    def _numbers(self, quantity: str, column: int) -> _Floats:
        values = np.empty(len(self.rows))
        for k, (line, fields) in enumerate(self.rows):
            if column >= len(fields):
                raise FileError(
                    f"{self.name}:{line}: has {len(fields)} columns, and {quantity} is column {column}: complete the line, or "
                    f"take it out (columns are separated by {WORDS.get(self.delimiter, self.delimiter)})"
                )
            field = fields[column]
            try:
                values[k] = _value(field, self.delimiter)
            except ValueError:
                what = f"is {shown(field)}, no number" if field else "is empty"
                raise FileError(
                    f"{self.name}:{line}: {quantity} (column {column}) {what}: correct the line or take it out, or name another "
                    f"column; {self.about()}"
                ) from None
        return values


def _filled(fields: Sequence[str]) -> int:
    """Number of fields up to the last one that is not empty."""
    return next((i for i in range(len(fields), 0, -1) if fields[i - 1] != ""), 0)


def _name_units(fields: Sequence[str]) -> bool:
    """Whether one of the words is a name with a unit."""
    return any(style.fullmatch(field) for style in STYLES for field in fields)


def _are_units(fields: Sequence[str]) -> bool:
    """Whether one of the words is a unit."""
    every = {unit for units in UNITS.values() for unit in units}
    return any(_unit_name(field.strip("[]() ")) in every for field in fields)


def _text_of(name: str) -> str:
    data = Path(name).read_bytes()
    if data.startswith(GZIP_BEGINNING):
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError) as error:
            raise FileError(f"{name}: cannot be decompressed: {error}") from error
    wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "latin-1"):
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" in text:
            break
        return text.replace("\r\n", "\n").replace("\r", "\n")
    raise FileError(f"{name}: is not text: give a table of text, or an HDF5 file")


def _fields(line: str, delimiter: str) -> list[str]:
    split = line.split(None if delimiter == " " else delimiter)
    if '"' in line and delimiter != " ":
        # A field may be longer than the csv module takes, in a file that is no table.
        with suppress(csv.Error):
            split = next(csv.reader([line], delimiter=delimiter))
    return [field.strip() for field in split]


def _sniff(name: str, lines: Sequence[tuple[int, str]], sample: str) -> str:
    """The delimiter that splits the last lines, from the first row of numbers on, into the same columns, at least two of them numbers."""
    last = [line for _, line in lines[-SNIFFED:]]

    def share(delimiter: str) -> float:
        fields = [_fields(line, delimiter) for line in last]
        widths = [len(each) if _is_row(each, delimiter) else 0 for each in fields]
        usual = mode(filter(None, widths)) if any(widths) else 0
        # What stands above the first row of this width is a preamble or a head.
        below = widths[widths.index(usual) :]
        return below.count(usual) / len(below) if usual and set(below) <= {0, usual} else 0.0

    # One line may be damaged, which is reported later: agreement of most lines is enough.
    best = max(DELIMITERS, key=share)
    if share(best) >= MOST_LINES:
        return best
    alone = [_is_number(line.strip(), " ") for line in last]
    if any(alone) and all(alone[alone.index(True) :]):
        return " "
    raise FileError(
        f"{name}:{lines[-1][0]}: no columns of numbers are found: name the delimiter, or give a table with one sample a "
        f"line, {sample}"
    )


def _is_row(fields: Sequence[str], delimiter: str) -> bool:
    several = any(
        len(parts := field.split()) > 1 and all(_is_number(p, " ") for p in parts) for field in fields
    )
    return sum(_is_number(field, delimiter) for field in fields) >= 2 and not several


def _value(field: str, delimiter: str) -> float:
    if delimiter != "," and "," in field and "." not in field:
        field = field.replace(",", ".", 1)
    if "_" in field:
        raise ValueError(field)
    return float(field)


def _is_number(field: str, delimiter: str) -> bool:
    try:
        _value(field, delimiter)
    except ValueError:
        return False
    return field.strip().lower().lstrip("+-") not in ("nan", "inf", "infinity")


def _bare(name: str) -> str:
    """The name of a column without its unit."""
    for bracket in "[(":
        before = name.partition(bracket)[0].strip()
        if before:
            name = before
    return name.strip()


# HDF5 ---------------------------------------------------------------------------------------------------------------------


def _hdf5_columns(
    name: str, wanted: Mapping[str, Column | None], required: Sequence[str]
) -> dict[str, _Found]:
    """The wanted datasets of a file."""
    import h5py  # noqa: PLC0415

    from ._hdf5 import dataset_in, open_file  # noqa: PLC0415  (h5py is slow to import)

    found, there = {}, list[str]()
    with open_file(name) as file:
        for quantity, column in wanted.items():
            if column is None and quantity not in required:
                continue
            paths = ALTERNATIVES[quantity] if column is None else (column,)
            sets = [
                each
                for path in paths
                if isinstance(path, str) and (each := dataset_in(file, path)) is not None
            ]
            if not sets:
                file.visititems(
                    lambda path, item: there.append(path) if isinstance(item, h5py.Dataset) else None
                )
                raise UsageError(
                    f"{name}: no dataset {' or '.join(map(shown, paths))} for {quantity}: name one of "
                    f"{', '.join(there[:12]) or 'none: the file is empty'}{', …' if len(there) > 12 else ''}"
                )
            found[quantity] = _dataset_values(sets[0], name, quantity)
    return found


def _dataset_values(dataset: h5py.Dataset, name: str, quantity: str) -> _Found:
    """Values of a dataset, and its unit."""
    # MATLAB writes columns as matrices.
    if dataset.ndim == 0 or max(dataset.shape) != dataset.size or dataset.dtype.kind not in "biuf":
        raise UsageError(
            f"{name}: {dataset.name} has the shape {dataset.shape} and the type {dataset.dtype}: {quantity} must be real numbers in "
            "one dimension; otherwise read it yourself and give the arrays to Trace"
        )
    values = np.asarray(dataset[()], dtype=np.float64).reshape(-1)
    # Conventions of netCDF.
    if (missing := dataset.attrs.get("_FillValue")) is not None:
        values = np.where(values == float(np.ravel(missing)[0]), np.nan, values)
    scale, shift = (
        float(np.ravel(dataset.attrs.get(key, usual))[0])
        for key, usual in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    units = dataset.attrs.get("units", dataset.attrs.get("unit", ""))
    (unit,) = np.asarray(units).reshape(-1)[:1].tolist() or [""]
    unit = unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)
    return values * scale + shift, "" if unit == "1" else unit, f"{name}: {dataset.name}"
