"""Measured traces and friction coefficients in files: tables of text, HDF5, MATLAB, TDMS."""

from __future__ import annotations

import codecs
import csv
import gzip
import os
import re
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from statistics import mode
from typing import Any, TextIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._arguments import number, path_name, shown
from .errors import Error, FileError, PackageError, UsageError
from .trace import Trace

_Floats = NDArray[np.float64]

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

OTHER_UNITS = {"V", "mV", "A", "mA", "K", "°C", "Hz", "bar", "Pa", "g", "kg", "°", "deg"}
"""Units of columns that are no trace, in a line of units."""

SYNONYMS = {"sec": "s", "seconds": "s", "msec": "ms", "usec": "us", "Newton": "N", "Newtons": "N"}
"""Other names of units."""

ALTERNATIVES: dict[str, tuple[str, ...]] = {
    "time": ("time", "t", "time_series/time", "x_value"),
    "force": ("force", "f", "pull_force", "friction_force"),
    "speed": ("speed", "velocity", "v", "table_speed"),
    "mu": ("mu", "friction", "friction_coefficient", "table_mu"),
}
"""Column names by which these are found if the user gives none."""

WORDS_OF_A_NAME = re.compile(r"[\s_,:;\-\[\](){}<>]+")
UNIT_TOLD = re.compile(r"\S\s*[\[({<]\s*([^\[\](){}<>]+?)\s*[\])}>]|\S\s*/\s*(\S+)|\S\s+in\s+(\S+)")
"""How a head names any unit of a column: F [mN], F (mN), F/mN, F in mN."""
NO_UNIT = {"s", "N", "h", "m", "1", "-", "%"}
"""Words above the data that need not be units, or are those of SI."""
NUMBER = re.compile(r"[+-]?(([0-9]+[.,]?[0-9]*|[.,][0-9]+)(e[+-]?[0-9]+)?|nan|inf|infinity)", re.IGNORECASE)
"""With a decimal point or a decimal comma."""
EITHER = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""A number of which nobody knows whether its comma is a decimal one or separates thousands."""
BEGINS_WITH_NUMBER = re.compile(r'\s*["+\-.,0-9]')
CLOCK = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}.*|\d+:\d+.*")
"""A date, or a time of day."""
BEGINS_DATA = re.compile(f"|{NUMBER.pattern}|{CLOCK.pattern}", re.IGNORECASE)

GZIP_BEGINNING = b"\x1f\x8b"
DELIMITERS = (";", "\t", ",", " ")
TOP = 10_000
"""Number of lines from which heads and delimiter are found."""
SNIFFED = 20
"""Number of lines, the last of these, from which the delimiter is found."""
MOST_LINES = 0.6
"""Least share of these lines that a delimiter splits into the same columns."""
MOST_NAMED = 20
"""Largest number of columns that a message names."""
WORDS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
FORMATS = "a table of text, or an HDF5, MATLAB or TDMS file"


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
    """Read a trace from a table of text, or from an HDF5, MATLAB or TDMS file.

    A table has one sample in each line, with commas, semicolons, tabs or blanks between the columns. It may begin with a line of
    names, ``force [mN]`` or ``force``, and a line of units. Empty lines and text after a ``#`` are ignored. If the delimiter is
    not a comma, a number may have a decimal comma. TDMS needs npTDMS, ``pip install dynstiction[tdms]``.

    Parameters
    ----------
    path : str or PathLike
        The file.
    time, force : int or str, optional
        Columns of time and force, by number from 0 or by name: in HDF5 the path of a dataset, in TDMS ``group/channel``. By default
        those named ``time`` and ``force``, else, of a table, the first and the second. A waveform of TDMS has its own times.
    displacement, lateral_force : int or str, optional
        Columns of the object's displacement along the pull and of the force across it.
    units : mapping, optional
        Units, ``{"time": "ms", "force": "mN"}``, or factors to SI, ``{"force": 9.81e-3}``; a negative factor reverses the sign.
        By default the units beside or below the names, or in the attribute ``units`` or ``unit_string``, else SI.
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
    """Slip speeds [m/s] and friction coefficients from a file; arguments and errors as for `read_trace`."""
    wanted = {"speed": None, "mu": None}
    values, *_ = _read(path, "a table of friction", wanted, tuple(wanted), units, delimiter)
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

    A required column that is not named is the one with a usual name, else that at its place.
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
    file = _file_of(name, what, required, delimiter)
    at = file.chosen(wanted, required)
    for quantity, column in at.items():
        if quantity not in factors:
            unit, place = file.unit(quantity, column)
            factors[quantity] = _factor(quantity, unit, place) if unit else 1.0
    values, lines = file.values(at)
    if not {*required} <= {*values}:
        raise UsageError(f"{name}: which column is time? Name it, or give the interval: {file.about()}")
    for quantity in at:
        values[quantity] *= factors[quantity]
    words = ", ".join(f"{q.replace('_', ' ')} in {_name_of(q, factors[q])}" for q in at)
    return values, words, lines


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


def _file_of(name: str, what: str, required: Sequence[str], delimiter: str | None) -> _File:
    """The file, by how it begins."""
    if os.path.exists(name) and not os.path.isfile(name):
        raise FileError(f"{name}: is not a regular file: give {FORMATS}")
    try:
        with open(name, "rb") as stream:
            beginning = stream.read(4096)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileError(f"{name}: cannot be read: {reason}: give the file of {what}") from error
    for mark, binary in BINARY.items():
        # HDF5 may begin later.
        if beginning.find(mark) % 512 == 0:
            if delimiter is not None:
                raise UsageError(f"{name}: is no text, and has no delimiter: leave it out")
            with _reading(name):
                return binary(name)
    return _Table(name, delimiter, " and ".join(required))


@contextmanager
def _reading(name: str) -> Iterator[None]:
    """What fails while a file is read is a `FileError`; damaged files cause exceptions of any kind."""
    try:
        yield
    except Error:
        raise
    except Exception as error:
        raise FileError(f"{name}: cannot be read: {error}") from error


class _Named:
    """The columns of a file: of each its names, in the order in which they count."""

    in_order = True
    """Whether a column without a usual name is found by its place."""

    def __init__(self, name: str, names: Sequence[tuple[str, ...]], width: int) -> None:
        self.name, self.names, self.width = name, names, width

    def about(self) -> str:
        """The columns, for a message."""
        if not self.names:
            count = f"{self.width} columns without names, 0 to {self.width - 1}" if self.width else "none"
            return f"there are {count}"
        named = [f"{i} {shown(each[0])}" for i, each in enumerate(self.names[:MOST_NAMED])]
        return "the columns are " + ", ".join(named) + ", …" * (len(self.names) > MOST_NAMED)

    def called(self, name: str) -> list[int]:
        """Columns of a name: as it stands, else without unit or group, else in small letters."""
        for same in (str, str.lower):
            for level in range(3):
                found = [i for i, each in enumerate(self.names) if same(each[level]) == same(name)]
                if found:
                    return found
        return []

    def chosen(self, wanted: Mapping[str, Column | None], required: Sequence[str]) -> dict[str, int]:
        """The wanted columns; a required one that is not named is the one with a usual name, else that at its place."""
        at = {
            quantity: self._find(quantity, column, [*required, quantity].index(quantity))
            for quantity, column in wanted.items()
            if column is not None or quantity in required
        }
        twice = [q for q in at if list(at.values()).count(at[q]) > 1]
        if twice:
            raise UsageError(
                f"{self.name}: {' and '.join(twice)} are the same column, {at[twice[0]]}: {self.about()}"
            )
        return at

    def _find(self, quantity: str, column: Column | None, place: int) -> int:
        if column is None:
            usual = (self.called(name) for name in ALTERNATIVES[quantity])
            others = [place] if place < self.width and self.in_order else []
            found = next((each for each in usual if len(each) == 1), others)
            what = f"which column is {quantity}? Name it"
        else:
            found = self.called(column) if isinstance(column, str) else [column] * (0 <= column < self.width)
            what = f"{quantity} is to be column {shown(column)}"
            if len(found) > 1:
                what = f"{len(found)} columns are called {shown(column)}: give its number"
        if len(found) != 1:
            raise UsageError(f"{self.name}: {what}: {self.about()}")
        return found[0]


# Tables -------------------------------------------------------------------------------------------------------------------


_Head: TypeAlias = tuple[int, list[str], bool]
"""A line above the data with a word for each column: its number, the words, and whether it is a comment."""


class _Table(_Named):
    """A table of text: heads with names and units, and rows of data."""

    def __init__(self, name: str, delimiter: str | None, sample: str) -> None:
        with _text(name) as stream:
            top = [(i, *_parts(line)) for i, line in enumerate(islice(stream, TOP), 1)]
        if any("\0" in before for _, before, _ in top):
            raise FileError(f"{name}: is not text: give {FORMATS}")
        lines = [(i, before) for i, before, _ in top if before.strip()]
        if not lines:
            raise FileError(f"{name}: has no samples: a table has one a line, {sample}")
        if delimiter is None:
            delimiter = _sniff(name, lines, sample)
        elif not isinstance(delimiter, str) or len(delimiter) != 1 or delimiter in '\r\n"#.+-0123456789':
            raise UsageError(f"delimiter = {shown(delimiter)}: it is one character, like ',' or ';'")
        self.delimiter = delimiter
        rows = {i: _fields(line, delimiter) for i, line in lines}
        with_numbers = [i for i, fields in rows.items() if any(map(_is_number, fields))]
        if not with_numbers:
            raise FileError(f"{name}: has names and no samples: a table has one sample a line, {sample}")
        # Data begin with a number, a time of day or nothing, if any line does.
        first = (i for i in with_numbers if BEGINS_DATA.fullmatch(rows[i][0]))
        begin = next(first, with_numbers[0])
        above = [(i, before or after, not before.strip()) for i, before, after in top if i < begin]
        heads = [head for each in above if (head := self._head(rows[begin], *each))]
        names, names_at = self._read_heads(heads)
        # A line with numbers below the names is damaged, which is reported later.
        self.begin = next(i for i in with_numbers if i > names_at)
        used = {names_at, *(line for line, _ in self.units)}
        self.doubt = next((i for i, text, _ in above if i not in used and _names_units(text)), 0)
        # Empty columns from delimiters at the ends of all lines.
        empty = min(len(fields) - max(1, _filled(fields)) for fields in rows.values())
        super().__init__(name, [(each, *_short_names(each)) for each in names], len(rows[begin]) - empty)
        named = len(_fields(above[-1][1], ",")) if above else 0
        self._refuse_either([(i, line) for i, line in lines if i >= self.begin], named)

    def _head(self, row: Sequence[str], line: int, text: str, is_comment: bool) -> _Head | None:
        """A line as words, one for each column, also between other delimiters if it names units."""
        for mark in (self.delimiter, *((*DELIMITERS[:-1], "  ") if _names_units(text) else ())):
            fields = re.split(r"\s\s+", text.strip()) if mark == "  " else _fields(text, mark)
            # LabVIEW names a last column that is mostly empty.
            if len(fields) > len(row) and fields[-1] == "Comment":
                fields.pop()
            fits = len(fields) == len(row) or _filled(fields) == _filled(row)
            has_words = any(letter.isalnum() for letter in text)
            if fits and has_words and not any(map(_is_number, fields)):
                return line, fields, is_comment
        return None

    def _read_heads(self, heads: Sequence[_Head]) -> tuple[list[str], int]:
        """Names of the columns and their line; units are in the last line of units, the names, or the last other line that has some."""
        units = [each for each in heads if _are_units(each[1])]
        if len(units) == len(heads):
            units = [each for each in units if _are_units(each[1], share=1.0)]
        others = [each for each in heads if each not in units]
        told = [each for each in others if any(_unit_in(field, UNITS_OF_ALL, sure=True) for field in each[1])]
        names = [each for each in others if not each[2]] or others
        names = [each for each in names if each in told] or names
        if units and not any(map(_is_label, units[-1][1])):
            names = [each for each in names if each[0] < units[-1][0]] or names
        self.units = [(line, fields) for line, fields, _ in (*units[-1:], *names[-1:], *told[-1:])]
        self.units_at = units[-1][0] if units else 0
        return (names[-1][1], names[-1][0]) if names else ([], 0)

    def _refuse_either(self, rows: Sequence[tuple[int, str]], named: int) -> None:
        """Refuse a table in which every comma may separate thousands, or be a decimal one."""
        fields = [_fields(text, self.delimiter) for _, text in rows]
        told = [field for each in fields for field in each]
        if self.delimiter == ",":
            is_mixed = all(re.search(r",\s.*,\S|,\S.*,\s", text) for _, text in rows)
            has_zeros = any(re.fullmatch(r"[+-]?0\d+", field) for field in told)
            has_points = any("." in field for field in told)
            is_doubtful = (1 < named < len(fields[0]) or has_zeros or is_mixed) and not has_points
            what = "may be a decimal one or separate columns"
        else:
            doubtful = [field for field in told if "," in field and "." not in field]
            is_doubtful = bool(doubtful) and all(map(EITHER.fullmatch, doubtful))
            what = "in all numbers may be a decimal one or separate thousands"
        if is_doubtful:
            raise FileError(
                f"{self.name}:{rows[0][0]}: the comma {what}: write numbers with points, or without separators"
            )

    def unit(self, quantity: str, column: int) -> tuple[str, str]:
        """Unit of a column, '' if none is named, and where it stands, for a message."""
        for line, fields in self.units:
            field = fields[column] if column < len(fields) else ""
            unit = _unit_in(field, UNITS[quantity])
            if line == self.units_at and not _is_label(field):
                unit = field.strip("[](){}<> ")
            if unit:
                return unit, f"{self.name}:{line}: {quantity}"
        if self.doubt:
            raise UsageError(
                f"{self.name}:{self.doubt}: names units, but not {self.width} columns: name the units, like --unit force=mN, "
                "units={'force': 'mN'}"
            )
        return "", ""

    def values(self, at: Mapping[str, int]) -> tuple[dict[str, _Floats], NDArray[np.int64] | None]:
        """Values of columns as they are in the file, and the lines of the samples."""
        lines, row, has_commas, blank = array("q"), "", self.delimiter != ",", self.delimiter + " \t\n"

        def rows() -> Iterator[str]:
            nonlocal row
            with _text(self.name) as stream:
                for i, line in enumerate(islice(stream, self.begin - 1, None), self.begin):
                    row = line.partition("#")[0]
                    if row.strip(blank):
                        lines.append(i)
                        yield row.replace(",", ".") if has_commas else row

        try:
            found = np.loadtxt(
                rows(),
                delimiter=None if self.delimiter == " " else self.delimiter,
                usecols=list(at.values()),
                comments=None,
                quotechar='"',
                ndmin=2,
            )
        except ValueError as error:
            if isinstance(error, Error):
                raise
            raise self._fault(at, lines[-1], row, error) from None
        return dict(zip(at, found.T, strict=True)), np.frombuffer(lines, dtype=np.int64)

    def _fault(self, at: Mapping[str, int], line: int, row: str, error: ValueError) -> FileError:
        """What is wrong with a row, and what to do."""
        fields, told = _fields(row, self.delimiter), str(error)
        bad = (each for each in at.items() if each[1] >= len(fields) or not _is_number(fields[each[1]]))
        for quantity, column in islice(bad, 1):
            if column >= len(fields):
                told = (
                    f"has {len(fields)} columns, and {quantity} is column {column}: complete the line, or take it out "
                    f"(columns are separated by {WORDS.get(self.delimiter, self.delimiter)})"
                )
                break
            field = fields[column]
            what = f"is {shown(field)}, no number" if field else "is empty"
            remedy = "correct the line or take it out, or name another column"
            if quantity == "time" and (not field or CLOCK.fullmatch(field)):
                remedy = "name a column of seconds, or give the time between two samples (interval)"
            told = f"{quantity} (column {column}) {what}: {remedy}; {self.about()}"
        return FileError(f"{self.name}:{line}: {told}")


# Bytes that are no UTF-8, as older programs write them.
codecs.register_error(
    "dynstiction.latin_1",
    lambda error: (error.object[error.start : error.end].decode("latin-1"), error.end),  # type: ignore[attr-defined]
)


@contextmanager
def _text(name: str) -> Iterator[TextIO]:
    """The lines of a file."""
    with _reading(name):
        with open(name, "rb") as raw:
            opened: Callable[..., Any] = gzip.open if raw.read(2) == GZIP_BEGINNING else open
        with opened(name, "rb") as binary:
            wide = binary.read(2) in (b"\xff\xfe", b"\xfe\xff")
        encoding = "utf-16" if wide else "utf-8-sig"
        with opened(name, "rt", encoding=encoding, errors="dynstiction.latin_1") as stream:
            yield stream


def _parts(line: str) -> tuple[str, str]:
    """What is before a comment, and the comment."""
    before, _, after = line.rstrip("\n").partition("#")
    if before.strip() and not BEGINS_WITH_NUMBER.match(before):
        # A sign in a name.
        return line.rstrip("\n"), ""
    return before, after.strip("# ")


def _fields(line: str, delimiter: str) -> list[str]:
    split = line.split(None if delimiter == " " else delimiter)
    if '"' in line and delimiter != " ":
        # A field may be longer than the csv module takes, in a file that is no table.
        with suppress(csv.Error):
            split = next(csv.reader([line], delimiter=delimiter))
    return [field.strip() for field in split]


def _filled(fields: Sequence[str]) -> int:
    """Number of fields up to the last one that is not empty."""
    return next((i for i in range(len(fields), 0, -1) if fields[i - 1] != ""), 0)


def _sniff(name: str, lines: Sequence[tuple[int, str]], sample: str) -> str:
    """The delimiter that splits the last lines, from the first row of numbers on, into the same columns, at least two of them numbers."""
    last = [line for _, line in lines[-SNIFFED:]]

    def share(delimiter: str) -> float:
        fields = [_fields(line, delimiter) for line in last]
        widths = [len(each) if _is_row(each) else 0 for each in fields]
        usual = mode(filter(None, widths)) if any(widths) else 0
        # What stands above the first row of this width is a preamble or a head.
        below = widths[widths.index(usual) :]
        return below.count(usual) / len(below) if usual and set(below) <= {0, usual} else 0.0

    # One line may be damaged, which is reported later: agreement of most lines is enough.
    best = max(DELIMITERS, key=share)
    if share(best) >= MOST_LINES:
        return best
    alone = [_is_number(line.strip()) for line in last]
    if any(alone) and all(alone[alone.index(True) :]):
        return " "
    raise FileError(
        f"{name}:{lines[-1][0]}: no columns of numbers are found, as in {shown(last[-1])}: name the delimiter, or give a table "
        f"with one sample a line, {sample}"
    )


def _is_row(fields: Sequence[str]) -> bool:
    """Whether fields are those of a sample: at least two numbers, or one and a time of day, and no field with several."""
    numbers = sum(map(_is_number, fields))
    several = any(len(field.split()) > 1 and all(map(_is_number, field.split())) for field in fields)
    return not several and (numbers > 1 or (numbers == 1 and any(map(CLOCK.fullmatch, fields))))


def _is_number(field: str) -> bool:
    return NUMBER.fullmatch(field) is not None


# Heads --------------------------------------------------------------------------------------------------------------------

UNITS_OF_ALL = {unit for units in UNITS.values() for unit in units}


def _unit_in(name: str, known: Iterable[str], *, sure: bool = False) -> str:
    """Unit in the name of a column, '' if none: a known one behind the first word, else, if not `sure`, what stands where units do."""
    words = [word for word in WORDS_OF_A_NAME.split(name.strip())[1:] if _unit_name(word) in known]
    told = [next(filter(None, each)).strip("[](){}<> ") for each in UNIT_TOLD.findall(name)]
    told = [unit for unit in told if not sure or _unit_name(unit) in known]
    return [*told, *words][-1] if words or told else ""


def _short_names(name: str) -> tuple[str, str]:
    """The name of a column without its unit, and its first word."""
    return re.split(r"(?<=\S)\s*[\[({<]", name)[0].strip(), re.split(r"(?<=\S)[\s_,/\[({<]", name)[0]


def _is_label(field: str) -> bool:
    """Whether this is no unit, but says that units follow."""
    return re.search(r"(\b|_)units?(\b|_)|einheit", field, re.IGNORECASE) is not None


def _are_units(fields: Sequence[str], share: float = 0.5) -> bool:
    """Whether at least a share of the words are units."""
    filled = [field.strip("[](){}<> ") for field in fields if field and not _is_label(field)]
    count = sum(_unit_name(field) in UNITS_OF_ALL | OTHER_UNITS for field in filled)
    return count > 0 and count >= share * len(filled)


def _names_units(text: str) -> bool:
    """Whether a line above the data has a word that is a unit."""
    return any(_unit_name(word) in UNITS_OF_ALL - NO_UNIT for word in re.split(r"[\W_]+", text))


# Files of other kinds -----------------------------------------------------------------------------------------------------


class _Binary(_Named):
    """Columns with paths and units, and how they are read."""

    def __init__(
        self, name: str, units: Mapping[str, str], read: Callable[[str], Any], steps: Mapping[str, float]
    ) -> None:
        self.units, self.read, self.steps = list(units.values()), read, steps
        names = [(path, path, path.rpartition("/")[2]) for path in units]
        super().__init__(name, names, len(names))
        # The order of datasets means nothing: only the one beside the times is the force.
        self.has_times = any(map(self.called, ALTERNATIVES["time"]))
        self.in_order = len(names) == 1 + self.has_times

    def chosen(self, wanted: Mapping[str, Column | None], required: Sequence[str]) -> dict[str, int]:
        """As for any file; a waveform has its own times if no column has."""
        if self.steps and wanted.get("time") is None and not self.has_times:
            required = [quantity for quantity in required if quantity != "time"]
        return super().chosen(wanted, required)

    def unit(self, quantity: str, column: int) -> tuple[str, str]:
        """Unit of a column, '' if none is named, and where it stands, for a message."""
        unit = self.units[column]
        return "" if unit == "1" else unit, f"{self.name}: {self.names[column][0]}: {quantity}"

    def values(self, at: Mapping[str, int]) -> tuple[dict[str, _Floats], None]:
        """Values of columns as they are in the file."""
        found = {}
        for quantity, column in at.items():
            path = self.names[column][0]
            with _reading(self.name):
                item = self.read(path)
                if item.dtype.kind == "M":
                    item = (item - item[0]) / np.timedelta64(1, "s")
            # MATLAB writes columns as matrices.
            if item.ndim == 0 or max(item.shape) != item.size or item.dtype.kind not in "biuf":
                raise UsageError(
                    f"{self.name}: {path} has the shape {item.shape} and the type {item.dtype}: {quantity} must be real numbers "
                    "in one dimension; otherwise read it yourself and give the arrays to Trace"
                )
            found[quantity] = item.astype(np.float64).reshape(-1)
        if "time" not in at and "force" in at and (path := self.names[at["force"]][0]) in self.steps:
            found["time"] = self.steps[path] * np.arange(found["force"].size)
        return found, None


def _hdf5(name: str) -> _Binary:
    """An HDF5 file, also of MATLAB 7.3."""
    import h5py  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    from ._hdf5 import dataset_in, open_file  # noqa: PLC0415

    units: dict[str, str] = {}

    def visit(path: str, link: Any) -> None:
        if path.startswith("#"):
            return
        try:
            item = file[path] if isinstance(link, h5py.HardLink) else dataset_in(file, path)
        except FileError:
            # It leads to another file, which is said if it is read.
            units[path] = ""
            return
        if isinstance(item, h5py.Dataset):
            (unit,) = np.ravel(item.attrs.get("units", item.attrs.get("unit", "")))[:1].tolist() or [""]
            units[path] = unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)

    def read(path: str) -> Any:
        with open_file(name) as file:
            dataset: Any = dataset_in(file, path)
            values = np.asarray(dataset[()])
            if values.dtype.kind not in "biuf":
                return values
            # Conventions of netCDF.
            missing, scale, shift = (
                float(np.ravel(dataset.attrs.get(key, usual))[0])
                for key, usual in (("_FillValue", np.nan), ("scale_factor", 1.0), ("add_offset", 0.0))
            )
            return np.where(values == missing, np.nan, values) * scale + shift

    with open_file(name) as file:
        file.visititems_links(visit)
    return _Binary(name, units, read, {})


def _matlab(name: str) -> _Binary:
    """A file of MATLAB up to version 7."""
    from scipy.io import loadmat  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    arrays: dict[str, NDArray[Any]] = {}

    def add(path: str, item: object) -> None:
        if isinstance(item, dict):
            for key, value in item.items():
                add(f"{path}/{key}".lstrip("/"), value)
        elif isinstance(item, np.ndarray):
            arrays[path] = item

    add("", loadmat(name, simplify_cells=True))
    return _Binary(name, dict.fromkeys(arrays, ""), arrays.__getitem__, {})


def _tdms(name: str) -> _Binary:
    """A TDMS file: channels are columns."""
    try:
        from nptdms import TdmsFile  # type: ignore[import-not-found]  # noqa: PLC0415
    except ImportError as error:
        raise PackageError(f"{name}: TDMS needs npTDMS ({error}): pip install dynstiction[tdms]") from None

    def read(path: str) -> Any:
        with TdmsFile.open(name) as file:
            group, channel = places[path]
            return file[group][channel][:]

    with TdmsFile.open(name) as file:
        channels = {f"{group.name}/{one.name}": one for group in file.groups() for one in group.channels()}
        places = {path: (one.group_name, one.name) for path, one in channels.items()}
        told = {path: one.properties for path, one in channels.items()}
    units = {path: str(each.get("unit_string", "")) for path, each in told.items()}
    steps = {path: each["wf_increment"] for path, each in told.items() if "wf_increment" in each}
    return _Binary(name, units, read, steps)


BINARY = {b"\x89HDF\r\n\x1a\n": _hdf5, b"MATLAB 5.0 MAT": _matlab, b"TDSm": _tdms}
"""What reads a file, by what it begins with."""

_File: TypeAlias = _Table | _Binary
