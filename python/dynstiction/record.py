"""The data of one run, described: the ground on which results, files and the core's answers stand."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ._arguments import shown
from ._optional import needed
from .errors import ColumnError, UsageError, printable
from .html import page_table

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    import xarray

__all__ = [
    "EVENTS",
    "EVENT_DTYPE",
    "SLIP_BEGINS",
    "STICK_BEGINS",
    "Described",
    "Info",
    "Record",
    "Table",
    "frame_of",
    "rows_of",
]

STICK_BEGINS = 1
SLIP_BEGINS = 2

EVENT_DTYPE = np.dtype([("time", np.float64), ("kind", np.int32)])

T = TypeVar("T")
C = TypeVar("C", bound=NDArray[np.generic])


class Info(NamedTuple):
    """What a column or a scalar is."""

    name: str
    units: str
    long_name: str


EVENTS = {
    "time": Info("time", "s", "time of the event"),
    "kind": Info("kind", "1", "1 = stick begins, 2 = slip begins"),
}


class Described(Mapping[str, T], Generic[T]):
    """Read-only mapping of names to values that knows what each value is.

    Parameters
    ----------
    entries : iterable of (Info, value)
        Name, unit and meaning of each value, and the value.
    """

    def __init__(self, entries: Iterable[tuple[Info, T]]) -> None:
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
        """Unit of each value, ``"1"`` where it has none."""
        return {name: info.units for name, (info, _) in self._entries.items()}

    @property
    def long_names(self) -> dict[str, str]:
        """What each value is, in words."""
        return {name: info.long_name for name, (info, _) in self._entries.items()}

    def __getitem__(self, name: str) -> T:
        return self._entries[name][1]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def info(self) -> list[tuple[Info, T]]:
        """Name, unit and meaning of each value with the value itself."""
        return list(self._entries.values())

    def __repr__(self) -> str:
        return "\n".join(printable(f"{info.name} = {value} {info.units}") for info, value in self.info())


class Table(Generic[C]):
    """Columns of one length under their names: ``table["u_x"]`` is a column, ``for name in table`` runs over the names.

    Attributes
    ----------
    columns : Described of ndarray, shape (n,)
        The columns, with units and meanings.
    """

    columns: Described[C]
    missing: ClassVar[str] = ""
    """What to do about a column that is not there."""

    def __getitem__(self, name: str) -> C:
        try:
            return self.columns[name]
        except (KeyError, TypeError):
            names = ", ".join(self.columns)
            raise ColumnError(f"no column {shown(name)}, only {names}{self.missing}") from None

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def to_pandas(self) -> pandas.DataFrame:
        """The table as a `pandas.DataFrame`, one row a line; ``frame.attrs["units"]`` has the units.

        Raises
        ------
        PackageError
            If pandas is not installed.
        """
        return frame_of(self.columns)

    def _dataset(self, index: str, attributes: Mapping[str, object]) -> xarray.Dataset:
        """The table as an `xarray.Dataset` over one of its columns, or over the number of the row."""
        needed("xarray", "to_xarray")
        import xarray  # noqa: PLC0415  (costs a second, and only this method needs it)

        variables = {
            info.name: (index, values, {"units": info.units, "long_name": info.long_name})
            for info, values in self.columns.info()
        }
        coordinates = {index: variables.pop(index)} if index in variables else {}
        return xarray.Dataset(variables, coordinates, dict(attributes))

    def _values(self) -> tuple[str, str, Described[float]]:
        """What a notebook shows: a title, what is listed, and the list."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        title, head, values = self._values()
        return page_table(title, (head, "value", "unit", ""), rows_of(values))


def frame_of(columns: Described[C]) -> pandas.DataFrame:
    """Columns as a `pandas.DataFrame` that knows their units."""
    needed("pandas", "to_pandas")
    import pandas  # noqa: PLC0415  (optional)

    frame = pandas.DataFrame(dict(columns))
    frame.attrs["units"] = columns.units
    return frame


def rows_of(values: Described[Any]) -> list[tuple[str, str, str, str]]:
    """Name, value, unit and meaning of each scalar as texts, for a table."""
    return [
        (
            i.name,
            f"{v:.8g}" if isinstance(v, float) else str(v),
            "" if i.units == "1" else i.units,
            i.long_name,
        )
        for i, v in values.info()
    ]


@dataclass(frozen=True, repr=False, eq=False)
class Record(Table[NDArray[np.float64]]):
    """What one run has brought.

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
