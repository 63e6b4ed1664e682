"""The cases of a sweep for drawing: its axes, its quantities, and the parameters of every case."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from numpy.typing import NDArray

from ..errors import UsageError
from ..scene import Scene
from .notation import PARAMETERS, Floats, Symbol, the_nearest
from .style import with_margin
from .theory import is_exponential

if TYPE_CHECKING:
    import xarray


FINE = 2000
"""Number of values of a parameter at which a theory is drawn."""
LEAST_SWING = 0.01
"""Least swing of a cycle as a share of F_0, as in src/results/cycles.f90: below it the object slides steadily."""


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
        return self.at(self.values)

    def at(self, values: Floats) -> Floats:
        """Other values in the unit of a figure."""
        return values * self.symbol.factor

    @property
    def fine(self) -> Floats:
        """Many values from the least to the largest, in the unit of the deck."""
        spaced = np.geomspace if self.scale == "log" else np.linspace
        return np.asarray(spaced(self.values.min(), self.values.max(), FINE))

    @property
    def span(self) -> tuple[float, float]:
        """Limits from the first value to the last, with a margin."""
        low, high = float(np.nanmin(self.shown)), float(np.nanmax(self.shown))
        return with_margin(low, high, 0.01, self.scale == "log") if high > low else (low - 1.0, high + 1.0)

    @property
    def norm(self) -> Normalize:
        """Scale of the colours of this parameter."""
        return LogNorm() if self.scale == "log" else Normalize()

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
            known = sorted(str(n) for n, values in self.data.data_vars.items() if values.dtype.kind == "f")
            raise UsageError(f"no quantity '{name}': {the_nearest(name, known)}there are {', '.join(known)}")
        return np.asarray(self.data[name].values)

    def slides(self) -> NDArray[np.bool_]:
        """Whether the load of each case hardly oscillates in the second half of the run."""
        limit = self.parameter("mu_0") * self.parameter("normal_load")
        return np.asarray(self.quantity("swing") <= LEAST_SWING * limit)


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
    deck = str(data.attrs.get("deck", ""))
    groups = Scene(deck).groups().values() if deck else ()
    values: dict[str, object] = {name: value for group in groups for name, value in group.items()}
    numbers = {name: float(value) for name, value in values.items() if isinstance(value, (int, float))}
    has_theory = is_exponential(values) and not {"exponent", "viscous"}.intersection(map(str, data.coords))
    return Table(data, axes, is_grid, numbers, has_theory)
