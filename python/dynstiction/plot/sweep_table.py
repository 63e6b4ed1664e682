"""The cases of a sweep for drawing: its axes, its quantities, and the parameters of every case."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import UsageError
from ..scene import Scene
from .samples import Floats
from .theory import is_exponential

if TYPE_CHECKING:
    import xarray

__all__ = ["Axis", "Table", "table_of"]

# 'system.stiffness_x' -> how a figure calls it: symbol, factor, unit.
SYMBOLS = {
    "mass": ("$m$", 1.0, "kg"),
    "stiffness_x": ("$k_x$", 1.0, "N/m"),
    "stiffness_y": ("$k_y$", 1.0, "N/m"),
    "damping_x": ("$c_x$", 1.0, "N s/m"),
    "damping_y": ("$c_y$", 1.0, "N s/m"),
    "misalignment_deg": (r"$\varphi$", 1.0, "deg"),
    "mu_0": (r"$\mu_0$", 1.0, "1"),
    "mu_inf": (r"$\mu_\infty$", 1.0, "1"),
    "v_f": ("$v_f$", 1e3, "mm/s"),
    "normal_load": ("$W$", 1.0, "N"),
    "velocity": ("$V$", 1e3, "mm/s"),
    "t_end": (r"$t_\mathrm{end}$", 1.0, "s"),
}


def _name_of(key: object) -> str:
    """Name of a key without its group."""
    return str(key).partition(".")[2]


class Axis(NamedTuple):
    """A parameter that is varied."""

    key: str
    values: Floats
    units: str

    @property
    def name(self) -> str:
        """Name of the key without its group."""
        return _name_of(self.key)

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
    """A sweep over its grid, or over the cases of a list."""

    data: xarray.Dataset
    axes: tuple[Axis, ...]
    is_grid: bool
    numbers: dict[str, float]
    """Numbers of the deck by name of the key."""
    has_theory: bool = True
    """Whether the linear theory of steady sliding, which takes coefficients, stands for the friction law."""

    def has(self, name: str) -> bool:
        """Whether every case has this parameter."""
        return name in self.numbers or name in map(_name_of, self.data.coords)

    def parameter(self, name: str) -> Floats:
        """Values of a key in every case, in the unit of the deck; a `UsageError` if it has no such number."""
        codes = self.data["result_code"]
        for key, values in self.data.coords.items():
            if _name_of(key) == name:
                return np.asarray(values.broadcast_like(codes).transpose(*codes.dims), dtype=float)
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
    """Table of a sweep from `dynstiction.sweep` or `dynstiction.open_sweep`.

    A list whose first two parameters run over all pairs of their values is taken as that grid: what else varies in it
    is a consequence of the two.
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
    varied = [_name_of(key) for key in data.coords]
    has_theory = is_exponential(values) and not {"exponent", "viscous"}.intersection(varied)
    return Table(data, axes, is_grid, numbers_of(values), has_theory)


def values_of(deck: str) -> dict[str, object]:
    """Values of the deck's keys by name."""
    groups = Scene(deck).groups().values() if deck else ()
    return {name: value for group in groups for name, value in group.items()}


def numbers_of(values: Mapping[str, object]) -> dict[str, float]:
    """Those of one number."""
    return {name: float(value) for name, value in values.items() if isinstance(value, (int, float))}
