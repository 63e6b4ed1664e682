"""The cases of a sweep for drawing: its axes, its quantities, and the parameters of every case."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import UsageError
from ..scene import Scene
from .notation import PARAMETERS, Symbol, with_unit
from .samples import Floats
from .theory import is_exponential

if TYPE_CHECKING:
    import xarray

__all__ = ["Axis", "Table", "table_of"]


class Axis(NamedTuple):
    """A varied parameter."""

    name: str
    """Of the key, without its group."""
    values: Floats
    units: str

    @property
    def symbol(self) -> Symbol:
        """Notation of the parameter in figures."""
        return PARAMETERS.get(self.name, Symbol(self.name.replace("_", " "), self.units))

    @property
    def shown(self) -> Floats:
        """Values in the unit of a figure."""
        return self.values * self.symbol.factor

    @property
    def label(self) -> str:
        """Symbol and unit."""
        return with_unit(self.symbol.text, self.symbol.unit)

    @property
    def scale(self) -> str:
        """``"log"`` if the ratios of the values are more uniform than their distances."""
        values = np.unique(self.values)
        if values.size < 3 or values[0] <= 0.0:
            return "linear"
        distance, ratio = np.diff(values), np.diff(np.log(values))
        return "log" if np.ptp(ratio) / ratio.mean() < np.ptp(distance) / distance.mean() else "linear"


class Table(NamedTuple):
    """A sweep over its grid, or over the cases of a list."""

    data: xarray.Dataset
    axes: tuple[Axis, ...]
    is_grid: bool
    numbers: dict[str, float]
    """Numbers of the deck by name of the key."""
    has_theory: bool = True
    """Whether the linear theory of steady sliding, which takes coefficients, applies to the friction law."""

    def has(self, name: str) -> bool:
        """Whether every case has this parameter."""
        return name in self.numbers or name in self.data.coords

    def parameter(self, name: str) -> Floats:
        """Values of a key in every case, in the unit of the deck; a `UsageError` if it has no such number."""
        codes = self.data["result_code"]
        if name in self.data.coords:
            return np.asarray(self.data[name].broadcast_like(codes).transpose(*codes.dims), dtype=float)
        if name not in self.numbers:
            raise UsageError(f"the sweep lacks a number '{name}', which this figure needs")
        return np.full(codes.shape, self.numbers[name])

    def quantity(self, name: str) -> Floats:
        """Values of a quantity in every case, NaN where a case failed; a `UsageError` if there is no such quantity."""
        if name not in self.data or self.data[name].dtype.kind != "f":
            known = sorted(n for n, values in self.data.data_vars.items() if values.dtype.kind == "f")  # type: ignore[type-var]
            near = "".join(
                f"the nearest is '{each}', " for each in get_close_matches(name, map(str, known), 1)
            )
            raise UsageError(f"no quantity '{name}': {near}there are {', '.join(map(str, known))}")
        return np.asarray(self.data[name].values)


def table_of(data: xarray.Dataset) -> Table:
    """Table of a sweep from `dynstiction.sweep` or `dynstiction.open`.

    A list whose first two parameters run over all pairs of their values is taken as a grid: other parameters that vary in it
    depend on these two.
    """
    units = {key: str(values.attrs["units"]) for key, values in data.coords.items()}
    if data["result_code"].dims == ("case",):
        first_two = list(data.coords)[:2]
        levels = [np.unique(data[key]).size for key in first_two]
        pairs = np.unique([data[key] for key in first_two], axis=1).shape[1]
        if len(first_two) == 2 and min(levels) > 1 and pairs == np.prod(levels) == data.sizes["case"]:
            data = data.set_index(case=first_two).unstack("case")
    dims = data["result_code"].dims
    is_grid = dims != ("case",)
    axes = tuple(
        Axis(str(key), np.asarray(data[key].values, dtype=float), units[key])
        for key in (dims if is_grid else data.coords)
    )
    values = values_of(str(data.attrs.get("deck", "")))
    varied = list(map(str, data.coords))
    has_theory = is_exponential(values) and not {"exponent", "viscous"}.intersection(varied)
    return Table(data, axes, is_grid, numbers_of(values), has_theory)


def values_of(deck: str) -> dict[str, object]:
    """Values of the deck's keys by name."""
    groups = Scene(deck).groups().values() if deck else ()
    return {name: value for group in groups for name, value in group.items()}


def numbers_of(values: Mapping[str, object]) -> dict[str, float]:
    """Values of the keys with one number."""
    return {name: float(value) for name, value in values.items() if isinstance(value, (int, float))}
