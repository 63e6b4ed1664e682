"""Columns and other quantities: their samples, symbols, units and colours, the same in all figures."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .._arguments import nearest
from ..record import headed
from .style import BLACK, BLUE, COLUMN_WIDTH, DOTS_PER_INCH, GREEN, ORANGE, PURPLE, SKY, VERMILION

Floats: TypeAlias = NDArray[np.float64]

# Twice the number of dots in a column's width, so that no bin is wider than a dot.
BINS = 2 * int(COLUMN_WIDTH * DOTS_PER_INCH)

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
        return headed(self.text, self.unit)


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

PREFIXES = {"k": 1e-3, "": 1.0, "m": 1e3, "µ": 1e6, "n": 1e9}
"""Factors from a unit to that with the prefix."""
WITH_PREFIX = ("m", "m/s", "N")
LEAST = 0.5
"""A unit with a prefix is chosen so that the largest value is at least this."""


def scaled(unit: str, *values: Floats) -> tuple[float, str]:
    """Factor from a unit of `WITH_PREFIX` to the unit in which values are short numbers, and this unit."""
    largest = max((float(np.nanmax(np.abs(each), initial=0.0)) for each in values), default=0.0)
    if unit not in WITH_PREFIX or not largest > 0.0:
        return 1.0, unit
    prefix, factor = next(each for each in PREFIXES.items() if each[0] == "n" or largest * each[1] >= LEAST)
    return factor, prefix + unit


def label_of(name: str, units: str, *values: Floats) -> tuple[str, float, str]:
    """Label, factor and colour of a column with these values in these units."""
    symbol = COLUMNS.get(name)
    if symbol is None:
        return headed(name.replace("_", " "), units), 1.0, BLACK
    factor, unit = scaled(symbol.unit, *values)
    return headed(symbol.text, unit), factor * symbol.factor, symbol.colour


def the_nearest(name: str, known: Iterable[str]) -> str:
    """The part of a refusal that names what was probably meant; empty if nothing is similar."""
    near = nearest(name, known)
    return f"the nearest is '{near}', " if near else ""


def thin(time: Floats, values: Floats, bins: int = BINS) -> tuple[Floats, Floats]:
    """Smallest and largest value in each of `bins` equal intervals of time, in their order, and the first and the last sample.

    The drawn line covers the same dots as the line through all samples, however fast they oscillate.
    """
    if time.size <= 2 * bins:
        return time, values
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], bins + 1)[1:-1])
    starts = np.unique(np.concatenate([[0], edges]))
    starts = starts[starts < time.size]
    sizes = np.diff(np.append(starts, time.size))
    keep = [0, time.size - 1]
    for extreme in (np.fmin, np.fmax):
        reached = values == np.repeat(extreme.reduceat(values, starts), sizes)
        # The first sample of each bin with its extreme value; none if all are NaN.
        reaching = np.flatnonzero(reached)
        bin_of = np.searchsorted(starts, reaching, side="right")
        keep.extend(reaching[np.unique(bin_of, return_index=True)[1]])
    kept = np.unique(keep)
    return time[kept], values[kept]
