"""The data of one run, described: the ground on which results, files and the core's answers stand."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from .errors import UsageError

__all__ = ["EVENT_DTYPE", "SLIP_BEGINS", "STICK_BEGINS", "Described", "Info", "Record"]

STICK_BEGINS = 1
SLIP_BEGINS = 2

EVENT_DTYPE = np.dtype([("time", np.float64), ("kind", np.int32)])

T = TypeVar("T")


class Info(NamedTuple):
    """What a column or a scalar is."""

    name: str
    units: str
    long_name: str


class Described(Mapping[str, T], Generic[T]):
    """Read-only mapping of names to values that knows what each value is.

    Parameters
    ----------
    entries : iterable of (Info, value)
        Name, unit and meaning of each value, and the value.

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
        try:
            described = [(Info(*info), value) for info, value in entries]
        except (TypeError, ValueError) as error:
            raise UsageError(
                f"entries are pairs of an Info (name, units, long_name) and a value: {error}"
            ) from None
        for info, value in described:
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
class Record:
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
