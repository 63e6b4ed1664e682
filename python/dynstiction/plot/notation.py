"""Symbols, units and colours: each quantity has one symbol and one notation in all figures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .samples import Floats
from .style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

__all__ = [
    "COLUMNS",
    "MISALIGNMENT",
    "PARAMETERS",
    "QUANTITIES",
    "SPEED_RATIO",
    "Symbol",
    "label_of",
    "scaled",
    "with_unit",
]

MISALIGNMENT = r"$\varphi$"
SPEED_RATIO = r"$\dot X/V$"
"""Velocity along the drive over the drive velocity."""


class Symbol(NamedTuple):
    """How figures write a quantity."""

    text: str
    unit: str
    """Unit in figures: SI without a prefix, or deg; empty for a number without unit."""
    factor: float = 1.0
    """Factor from the unit of files and decks to this unit."""
    colour: str = BLACK

    @property
    def label(self) -> str:
        """Symbol and unit, as for an axis."""
        return with_unit(self.text, self.unit)


QUANTITIES = {
    "peak_force": "peak of the load $k_x u_x$",
    "valley_force": "valley of the load $k_x u_x$",
    "period": "period",
    "stick_duration": "stick: valley to peak of the load",
    "slip_duration": "slip: peak to valley of the load",
    "slip_length": "advance $X$ from peak to valley",
    "slip_angle": r"$\theta$ at the first slip",
    "first_peak_force": "first peak of the load",
    "max_X_rate": r"largest $|\dot X|$",
    "final_X": "$X$ at the end",
    "final_X_rate": r"$\dot X$ at the end",
    "final_u_x": "$u_x$ at the end",
    "final_u_y": "$u_y$ at the end",
    "sticks": "number of rests",
    "cycles": "number of cycles",
    "fast_decay": "$D$, decay of the fast oscillation",
    "pull_frequency": "frequency of the pull force",
    "creep_share": r"share of the time with $|\dot X| \leq V/10$",
    "lyapunov_exponent": "Lyapunov exponent of a slow cycle",
}
"""Labels of summary values."""

COLUMNS = {
    "spring_force_x": Symbol("$k_x u_x$", "N", colour=BLUE),
    "spring_force_y": Symbol("$k_y u_y$", "N", colour=VERMILION),
    "pull_force": Symbol(r"$F_\mathrm{pull}$", "N", colour=SKY),
    "friction": Symbol("$|F|$", "N", colour=GREEN),
    "theta": Symbol(r"$\theta$", "deg", float(np.degrees(1.0)), PURPLE),
    "theta_deg": Symbol(r"$\theta$", "deg", colour=PURPLE),
    "psi": Symbol(r"$\psi$", "deg", float(np.degrees(1.0)), ORANGE),
    "X": Symbol("$X$", "m", colour=BLACK),
    "Y": Symbol("$Y$", "m", colour=ORANGE),
    "u_x": Symbol("$u_x$", "m", colour=BLUE),
    "u_y": Symbol("$u_y$", "m", colour=VERMILION),
    "u_x_rate": Symbol(r"$\dot u_x$", "m/s", colour=BLUE),
    "u_y_rate": Symbol(r"$\dot u_y$", "m/s", colour=VERMILION),
    "w_x": Symbol("$w_x$", "m/s", colour=BLUE),
    "w_y": Symbol("$w_y$", "m/s", colour=VERMILION),
    "X_rate": Symbol(r"$\dot X$", "m/s", colour=BLACK),
    "Y_rate": Symbol(r"$\dot Y$", "m/s", colour=ORANGE),
    "zeta": Symbol(r"$\zeta$", "", colour=GREEN),
    "sticking": Symbol("rest", "", colour=SKY),
}
"""Columns of a run, in the order in which figures show them."""

PARAMETERS = {
    "mass": Symbol("$m$", "kg"),
    "stiffness_x": Symbol("$k_x$", "N/m"),
    "stiffness_y": Symbol("$k_y$", "N/m"),
    "damping_x": Symbol("$c_x$", "N s/m"),
    "damping_y": Symbol("$c_y$", "N s/m"),
    "misalignment_deg": Symbol(MISALIGNMENT, "deg"),
    "velocity": Symbol("$V$", "mm/s", 1e3),
    "mu_0": Symbol(r"$\mu_0$", ""),
    "mu_inf": Symbol(r"$\mu_\infty$", ""),
    "v_f": Symbol("$v_f$", "mm/s", 1e3),
    "normal_load": Symbol("$W$", "N"),
    "t_end": Symbol(r"$t_\mathrm{end}$", "s"),
}
"""Keys of a deck, in the order in which figures name them."""

PREFIXES = ((1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
WITH_PREFIX = ("m", "m/s", "N")
LEAST = 0.5
"""A unit with a prefix is chosen so that the largest value is at least this."""


def with_unit(text: str, unit: str) -> str:
    """A label: text and unit, or the text alone if there is no unit."""
    return text if unit in ("", "1", "–") else f"{text} [{unit}]"


def scaled(unit: str, *values: Floats) -> tuple[float, str]:
    """Factor from a unit of `WITH_PREFIX` to the unit in which values are short numbers, and this unit."""
    if unit not in WITH_PREFIX:
        return 1.0, unit
    largest = max((float(np.nanmax(np.abs(each), initial=0.0)) for each in values), default=0.0)
    if not largest > 0.0:
        return 1.0, unit
    for size, prefix in PREFIXES:
        if largest >= LEAST * size:
            # Not 1/size, which is not exact.
            return float(f"{1.0 / size:.0e}"), prefix + unit
    size, prefix = PREFIXES[-1]
    return float(f"{1.0 / size:.0e}"), prefix + unit


def label_of(name: str, units: str, *values: Floats) -> tuple[str, float, str]:
    """Label, factor and colour of a column with these values in these units."""
    symbol = COLUMNS.get(name)
    if symbol is None:
        return with_unit(name.replace("_", " "), units), 1.0, BLACK
    factor, unit = scaled(symbol.unit, *values)
    return with_unit(symbol.text, unit), factor * symbol.factor, symbol.colour
