"""Values with units and meanings, tables of them, and events: what results, files and values from the core consist of."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arguments import nearest, shown
from ._native import Info
from .errors import ColumnError, UsageError, printable
from .html import page_table

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]

STICK_BEGINS = 1
SLIP_BEGINS = 2

LOG_DTYPE = np.dtype([("time", np.float64), ("kind", np.int32), ("occurs", np.int64), ("period", np.float64)])
EVENT_DTYPE = np.dtype([("time", np.float64), ("kind", np.int32)])
MOST_EVENTS = 20_000_000
"""The largest number of events that is given as one array: 240 MB."""

T = TypeVar("T")
C = TypeVar("C", bound=NDArray[np.generic])


EVENTS = {
    "time": Info("time", "s", "time of the event"),
    "kind": Info("kind", "1", "1 = stick begins, 2 = slip begins"),
    "occurs": Info("occurs", "1", "how many times the event occurs"),
    "period": Info("period", "s", "the time after which it occurs again"),
}


NOUNS = {
    "columns": "column",
    "table": "column",
    "summary": "summary value",
    "statistics": "statistic",
    "parameters": "parameter",
}
"""What a name is, by the table that contains it."""


def unit_shown(units: str) -> str:
    """A unit for people: empty for a number without dimension, or for a text."""
    return "" if units == "1" else units


def headed(name: str, units: str) -> str:
    """Heading of a column: its name, and its unit in brackets if it has one."""
    return f"{name} [{units}]" if unit_shown(units) else name


def number_shown(value: object, digits: int = 6) -> str:
    """A value for people: at most this many digits of a real number, an integer as it is."""
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


class Described(Mapping[str, T], Generic[T]):
    """Read-only mapping of names to values, with the unit and the meaning of each value.

    A value of the summary that a run does not have, like the period of steady sliding, is NaN: `get` and ``in`` tell.

    Parameters
    ----------
    entries : iterable of (Info, value)
        Name, unit and meaning of each value, and the value.
    table : str
        What the values are, for messages on missing names: ``"columns"``, ``"summary"``, ``"statistics"`` or
        ``"parameters"`` of a run, or ``"table"`` for the columns of another table.
    """

    def __init__(self, entries: Iterable[tuple[Info, T]], table: str = "") -> None:
        self._table = table
        self._entries: dict[str, tuple[Info, T]] = {}
        try:
            for info, value in entries:
                about = info if type(info) is Info else Info(*info)
                self._entries[about.name] = about, value
        except (TypeError, ValueError) as error:
            raise UsageError(
                f"entries are pairs of an Info (name, units, long_name) and a value: {error}"
            ) from None

    @property
    def units(self) -> dict[str, str]:
        """Unit of each value, like ``"m/s"``; ``"1"`` if it has none."""
        return {name: info.units for name, (info, _) in self._entries.items()}

    @property
    def long_names(self) -> dict[str, str]:
        """Meaning of each value, in words."""
        return {name: info.long_name for name, (info, _) in self._entries.items()}

    def __getitem__(self, name: str) -> T:
        try:
            return self._entries[name][1]
        except (KeyError, TypeError):
            if self._table == "summary" and isinstance(name, str) and name in self._possible():
                return cast(T, math.nan)
            raise ColumnError(self._why_missing(name)) from None

    def __contains__(self, name: object) -> bool:
        return name in self._entries

    def get(self, name: str, default: Any = None) -> Any:
        """The value, or the default if there is none.

        Parameters
        ----------
        name : str
            Of the value.
        default : object
            What is returned in its place.
        """
        return self._entries[name][1] if name in self else default

    def _why_missing(self, name: object) -> str:
        """Message for a name that does not exist here: it may be mistyped, or exist in other runs."""
        noun, possible = NOUNS.get(self._table, "value"), self._possible()
        there = f"there are {', '.join(self._entries)}" if self._entries else "there are none"
        remedy = ": name it in the deck's output.fields and run again" if self._table == "columns" else ""
        near = nearest(name, self._entries) or nearest(name, possible)
        if isinstance(name, str) and name in possible:
            return f"this run has no {noun} {name!r} ({possible[name]}){remedy}; {there}"
        if near in self._entries:
            return f"no {noun} {shown(name)}: did you mean {near!r}? ({there})"
        if near:
            return f"no {noun} {shown(name)}: did you mean {near!r}? This run has none{remedy}; {there}"
        return f"no {noun} {shown(name)}: {there}"

    def _possible(self) -> dict[str, str]:
        """Names that runs can have in such a table, with their meanings."""
        return {entry["name"]: entry["long_name"] for entry in _native.catalogue().get(self._table, ())}

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def info(self) -> list[tuple[Info, T]]:
        """Name, unit and meaning of each value with the value itself."""
        return list(self._entries.values())

    def __repr__(self) -> str:
        lines = (
            f"{info.name} = {number_shown(value)} {unit_shown(info.units)}" for info, value in self.info()
        )
        return "\n".join(printable(line.rstrip()) for line in lines)


class Table(Mapping[str, C]):
    """Columns of equal length by name: ``table["u_x"]``, ``dict(table)``, ``for name in table``.

    Tables are equal only to themselves.

    Attributes
    ----------
    columns : Described of ndarray, shape (n,)
        The columns, with units and meanings.
    """

    columns: Described[C]

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __getitem__(self, name: str) -> C:
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def to_pandas(self) -> pandas.DataFrame:
        """The table as a `pandas.DataFrame` with the same rows; ``frame.attrs["units"]`` has the units."""
        import pandas  # noqa: PLC0415  (slow to import)

        frame = pandas.DataFrame(dict(self.columns))
        frame.attrs["units"] = self.columns.units
        return frame

    def _values(self) -> tuple[str, str, Described[float]]:
        """What a notebook shows: a title, the kind of values, and the values."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        title, head, values = self._values()
        return page_table(title, (head, "value", "unit", ""), rows_of(values))


def rows_of(values: Described[Any], digits: int = 8) -> list[tuple[str, str, str, str]]:
    """Name, value, unit and meaning of each scalar as texts, for a table."""
    return [(i.name, number_shown(v, digits), unit_shown(i.units), i.long_name) for i, v in values.info()]


def occurrences(log: NDArray[np.void], latest: float) -> NDArray[np.int64]:
    """How often each event of a log occurs up to a time [s]."""
    period = np.where(log["period"] > 0.0, log["period"], 1.0)
    times = np.floor((latest - log["time"]) / period) + 1.0
    # A single one is compared as it is: a difference would be rounded.
    times = np.where(log["occurs"] > 1, times, np.where(log["time"] <= latest, 1.0, 0.0))
    return np.clip(times, 0.0, log["occurs"]).astype(np.int64)


def _blocks(log: NDArray[np.void]) -> list[NDArray[np.void]]:
    """Successive rows that occur equally often with one period: all of them occur, then all of them again."""
    edges = np.flatnonzero((np.diff(log["occurs"]) != 0) | (np.diff(log["period"]) != 0.0)) + 1
    return np.split(log, edges) if log.size > 0 else []


def log_until(log: NDArray[np.void], latest: float) -> NDArray[np.void]:
    """The log of what occurs up to a time [s]: whole repetitions of a block, and those of the last one row by row."""
    parts = [log[:0]]
    for block in _blocks(log):
        times = occurrences(block, latest)
        whole, last = block.copy(), block[times > times[-1]]
        whole["occurs"] = times[-1]
        last["time"] += times[-1] * last["period"]
        last["occurs"], last["period"] = 1, 0.0
        parts += [whole[whole["occurs"] > 0], last]
    return np.concatenate(parts)


def events_between(log: NDArray[np.void], first: float, last: float) -> NDArray[np.void]:
    """Time [s] and kind of each event of a log from one time [s] to another, both included."""
    count = int((occurrences(log, last) - occurrences(log, np.nextafter(first, -np.inf))).sum())
    if count > MOST_EVENTS:
        raise UsageError(
            f"there are {count} events from {first:g} to {last:g} s, more than {MOST_EVENTS} for one array: ask for those "
            "of a shorter time with result.events_between, or see result.log, where the motion repeats"
        )
    parts = [np.empty(0, dtype=EVENT_DTYPE)]
    for rows in _blocks(log):
        times = np.zeros(1)
        if rows["occurs"][0] > 1:
            begin = np.floor((first - rows["time"][-1]) / rows["period"][0])
            times = np.arange(max(0.0, begin), occurrences(rows[:1], last)[0]) * rows["period"][0]
        part = np.empty((times.size, rows.size), dtype=parts[0].dtype)
        part["time"] = rows["time"] + times[:, None]
        part["kind"] = rows["kind"]
        parts.append(part.ravel())
    events = np.concatenate(parts)
    return events[(events["time"] >= first) & (events["time"] <= last)]
