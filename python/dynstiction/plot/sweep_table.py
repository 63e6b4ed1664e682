"""The cases of a sweep for drawing: its axes, its quantities, and the parameters of every case."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import UsageError
from ..scene import Scene
from .samples import Floats

if TYPE_CHECKING:
    import xarray

__all__ = ["Axis", "Table", "table_of"]

# 'system.stiffness_x' -> how a figure calls it: symbol, factor, unit.
SYMBOLS = {
    "mass": ("$m$", 1.0, "kg"),
    "stiffness_x": ("$k_x$", 1.0, "N/m"),
    "stiffness_y": ("$k_y$", 1.0, "N/m"),
    "misalignment_deg": (r"$\varphi$", 1.0, "deg"),
    "mu_0": (r"$\mu_0$", 1.0, "1"),
    "mu_inf": (r"$\mu_\infty$", 1.0, "1"),
    "v_f": ("$v_f$", 1e3, "mm/s"),
    "normal_load": ("$W$", 1.0, "N"),
    "velocity": ("$V$", 1e3, "mm/s"),
    "t_end": (r"$t_\mathrm{end}$", 1.0, "s"),
}


class Axis(NamedTuple):
    """A parameter that is varied."""

    key: str
    values: Floats
    units: str

    @property
    def name(self) -> str:
        """Name of the key without its group."""
        return self.key.partition(".")[2]

    @property
    def shown(self) -> Floats:
        """Values in the unit of a figure."""
        return self.values * SYMBOLS.get(self.name, ("", 1.0, ""))[1]

    @property
    def label(self) -> str:
        """Symbol and unit."""
        symbol, _, unit = SYMBOLS.get(self.name, (self.name, 1.0, self.units))
        return f"{symbol} [{unit}]"

    @property
    def scale(self) -> str:
        """``"log"`` if the values keep their ratio better than their distance."""
        values = np.unique(self.values)
        if values.size < 3 or values[0] <= 0.0:
            return "linear"
        distance, ratio = np.diff(values), np.diff(np.log(values))
        return "log" if np.ptp(ratio) / ratio.mean() < np.ptp(distance) / distance.mean() else "linear"


class Table(NamedTuple):
    """A sweep as arrays of one shape: that of its grid, or (cases,) of a list."""

    data: xarray.Dataset
    axes: tuple[Axis, ...]
    is_grid: bool
    order: NDArray[np.intp]
    """Places of the cases in the order of a grid; their own order in a list."""
    shape: tuple[int, ...]
    numbers: dict[str, float]
    """Numbers of the deck by name of the key."""

    def has(self, name: str) -> bool:
        """Whether every case has this parameter."""
        return name in self.numbers or any(axis.name == name for axis in self._columns())

    def parameter(self, name: str) -> Floats:
        """Values of a key in every case, in the unit of the deck.

        Raises
        ------
        UsageError
            If the deck has no such number.
        """
        for axis in self._columns():
            if axis.name == name:
                return axis.values
        if name not in self.numbers:
            raise UsageError(f"the sweep lacks a number '{name}', which this figure needs")
        return np.full(self.shape, self.numbers[name])

    def quantity(self, name: str) -> Floats:
        """Values of a quantity in every case; NaN where a case failed or has none.

        Raises
        ------
        UsageError
            If the sweep has no such quantity.
        """
        if name not in self.data or self.data[name].dtype.kind != "f":
            known = sorted(n for n, values in self.data.data_vars.items() if values.dtype.kind == "f")  # type: ignore[type-var]
            raise UsageError(f"no quantity '{name}', only {', '.join(map(str, known))}")
        return self._arranged(np.asarray(self.data[name].values))

    def _arranged(self, values: Floats) -> Floats:
        return values.reshape(-1)[self.order].reshape(self.shape)

    def _columns(self) -> list[Axis]:
        """Every varied parameter, with its value in every case."""
        columns = []
        for key, values in self.data.coords.items():
            broadcast, _ = self._broadcast(values)
            columns.append(Axis(str(key), self._arranged(broadcast), str(values.attrs["units"])))
        return columns

    def _broadcast(self, values: xarray.DataArray) -> tuple[Floats, tuple[str, ...]]:
        dims = tuple(map(str, self.data["result_code"].dims))
        if dims == ("case",):
            return np.asarray(values.values, dtype=float), dims
        shape = [1] * len(dims)
        shape[dims.index(str(values.name))] = values.size
        whole = self.data["result_code"].shape
        return np.broadcast_to(np.asarray(values.values, dtype=float).reshape(shape), whole), dims


def table_of(data: xarray.Dataset) -> Table:
    """Table of a sweep from `dynstiction.sweep` or `dynstiction.open_sweep`.

    A list whose first two parameters run over all pairs of their values is taken as that grid: what else varies in it
    is a consequence of the two.
    """
    axes = tuple(
        Axis(str(key), np.asarray(values.values, dtype=float), str(values.attrs["units"]))
        for key, values in data.coords.items()
    )
    codes = data["result_code"]
    numbers = numbers_of(str(data.attrs.get("deck", "")))
    own_order = np.arange(codes.size)
    if codes.dims != ("case",):
        return Table(data, axes, True, own_order, codes.shape, numbers)
    sides = [np.unique(axis.values, return_inverse=True) for axis in axes[:2]]
    if len(sides) == 2:
        shape = (sides[0][0].size, sides[1][0].size)
        places = np.ravel_multi_index((sides[0][1].reshape(-1), sides[1][1].reshape(-1)), shape)
        if min(shape) > 1 and np.array_equal(np.sort(places), np.arange(np.prod(shape))):
            grid = tuple(axis._replace(values=side[0]) for axis, side in zip(axes[:2], sides, strict=True))
            return Table(data, grid, True, np.argsort(places), shape, numbers)
    return Table(data, axes, False, own_order, codes.shape, numbers)


def numbers_of(deck: str) -> dict[str, float]:
    """Values of the deck's keys that have one number."""
    values = (
        {name: value for group in Scene(deck).groups().values() for name, value in group.items()}
        if deck
        else {}
    )
    return {name: float(value) for name, value in values.items() if isinstance(value, (int, float))}
