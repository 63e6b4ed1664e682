"""A law of friction from measured points (docs/howto/fit_friction_law.md)."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares  # type: ignore[import-untyped]

from . import _native
from ._arguments import number, reals
from .equations import COEFFICIENTS, friction_coefficient
from .errors import FitWarning, UsageError
from .record import unit_shown
from .trace_file import Units, read_friction

_Floats = NDArray[np.float64]

KEYS = tuple(COEFFICIENTS)
LAWS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("constant", ("mu_0",)),
    ("weakening", ("mu_0", "mu_inf", "v_f")),
    ("stribeck", ("mu_0", "mu_inf", "v_f", "viscous")),
    ("stribeck", ("mu_0", "mu_inf", "v_f", "exponent")),
    ("stribeck", KEYS),
)
"""Laws of a deck with their free coefficients, from the simplest on."""
STEEPEST = 10.0
"""Largest exponent of a deck."""
COMPLEX_STEP = 1e-20


@dataclass(frozen=True)
class FrictionFit:
    """The simplest law of a deck that explains measured points; ``print`` shows the lines of the deck.

    Attributes
    ----------
    law : str
        'constant', 'weakening' or 'stribeck'.
    values : mapping
        Its coefficients by the keys of the deck.
    covariance : ndarray, shape (p, p)
        Of the coefficients, in the order of `values`, from the scatter of the points.
    scatter : float
        Root mean square of the differences between measured and fitted friction coefficient.
    speed : ndarray, shape (n,)
        The measured slip speeds [m/s], ascending.
    turns : int
        How many times a line through the points rises or falls where the law does not.
    """

    law: str
    values: Mapping[str, float]
    covariance: _Floats
    scatter: float
    speed: _Floats
    turns: int

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors of the coefficients."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def mu(self, speed: ArrayLike) -> _Floats:
        """Friction coefficient of the law.

        Parameters
        ----------
        speed : array_like
            Slip speeds [m/s], at least 0.
        """
        return friction_coefficient(reals("speed", speed, least=0.0, units="m/s"), self.values)

    def slope(self, speed: float) -> tuple[float, float]:
        """Slope of the friction coefficient [s/m], and its standard error.

        Where it is negative, steady sliding without damping is unstable.

        Parameters
        ----------
        speed : float
            Slip speed [m/s], at least 0.
        """
        v = number("speed", speed, least=0.0, units="m/s")
        slope = _slope(self.values, v)
        gradient = np.array([
            (_slope({**self.values, key: value + step}, v) - _slope({**self.values, key: value - step}, v)) / (2.0 * step)
            for key, value in self.values.items()
            for step in [1e-5 * max(abs(value), 1e-9)]
        ])  # fmt: skip
        return slope, float(np.sqrt(gradient @ self.covariance @ gradient))

    @property
    def deck(self) -> str:
        """The lines of a deck, with the errors as comments; the normal load is missing."""
        lines = [f"  law = '{self.law}'"]
        for key, value in self.values.items():
            units = unit_shown(_native.key_info("friction", key).units)
            lines.append(f"  {key} = {value:.10g}  ! ± {self.errors[key]:.2g} {units}".rstrip())
        return "&friction\n" + "\n".join(lines) + "\n/\n"

    def __str__(self) -> str:
        text = self.deck + f"! scatter {self.scatter:.2g} of {self.speed.size} points\n"
        if self.turns:
            text += (
                f"! as a table the points would rise and fall by their noise, {self.turns} times where this law does not: "
                "stability and stick-slip would hang on it\n"
            )
        for v in dict.fromkeys((self.speed[0], self.speed[self.speed.size // 2], self.speed[-1])):
            slope, error = self.slope(float(v))
            known = "" if abs(slope) > 2.0 * error or self.law == "constant" else ": its sign is not known"
            text += f"! slope at {v:.4g} m/s: {slope:.4g} ± {error:.2g} s/m{known}\n"
        return text


def fit_friction_law(
    speed: ArrayLike | str | os.PathLike[str],
    mu: ArrayLike | None = None,
    *,
    units: Units | None = None,
    delimiter: str | None = None,
) -> FrictionFit:
    """Fit the laws of a deck to measured friction coefficients, and take the simplest that explains them (BIC).

    The laws are ``mu_inf + (mu_0 - mu_inf) exp(-(v/v_f)**exponent) + viscous*v`` with all or some of these coefficients.

    Parameters
    ----------
    speed : array_like or path
        Slip speeds [m/s], at least 0, in any order; or a table of text with columns for both, read as by `read_trace`: by their
        names ``speed`` (``velocity``, ``v``) and ``mu`` (``friction``), else the first and the second.
    mu : array_like, optional
        Friction coefficients.
    units, delimiter : optional
        Of a table, as for `read_trace`: ``{"speed": "mm/s"}``.

    Returns
    -------
    FrictionFit
        The law, its coefficients and their errors; ``print`` shows the lines of a deck.

    Warns
    -----
    FitWarning
        If the points do not determine a coefficient: its error is larger than itself.

    Raises
    ------
    UsageError
        If a value is out of range, or if there are fewer than five points.
    FileError
        If the table cannot be read.

    Examples
    --------
    >>> law = fit_friction_law([0.001, 0.003, 0.01, 0.03, 0.1, 0.3], [0.195, 0.187, 0.168, 0.152, 0.150, 0.150])
    >>> law.law
    'weakening'
    """
    if mu is None:
        speed, mu = read_friction(cast("str | os.PathLike[str]", speed), units=units, delimiter=delimiter)
    elif units is not None or delimiter is not None:
        raise UsageError("units and delimiter are those of a table: give arrays in SI units")
    v = reals("speed", cast("ArrayLike", speed), least=0.0, units="m/s")
    f = reals("mu", mu, least=0.0)
    if v.ndim != 1 or v.shape != f.shape or v.size < len(KEYS):
        raise UsageError(f"speed and mu: give at least {len(KEYS)} points, each with both")
    order = np.argsort(v, kind="stable")
    v, f = v[order], f[order]
    # One coefficient for each point would explain any scatter.
    found = [_fitted(law, keys, v, f) for law, keys in LAWS if v.size > len(keys) + 1]
    best = min(
        found,
        key=lambda each: v.size * np.log(max(each.scatter, 1e-12) ** 2) + len(each.values) * np.log(v.size),
    )
    for key, error in best.errors.items():
        if error > abs(best.values[key]) > 0.0:
            warnings.warn(
                f"{key} = {best.values[key]:.3g} ± {error:.2g} is not determined by these points: measure at other speeds, where "
                "friction changes", FitWarning, stacklevel=2,
            )  # fmt: skip
    return best


def _slope(values: Mapping[str, float], v: float) -> float:
    """Exact: the imaginary part after a step in the imaginary direction."""
    return float(np.imag(friction_coefficient(v + 1j * COMPLEX_STEP, values)) / COMPLEX_STEP)


def _fitted(law: str, keys: tuple[str, ...], v: _Floats, f: _Floats) -> FrictionFit:
    """The best coefficients of one law, from several starts."""
    positive = v[v > 0.0]
    least, most = (positive.min(), positive.max()) if positive.size else (1e-3, 1.0)
    bounds = {"mu_0": (0.0, np.inf), "mu_inf": (0.0, np.inf), "v_f": (np.log(least / 30.0), np.log(30.0 * most)),
              "exponent": (1.0, STEEPEST), "viscous": (0.0, np.inf)}  # fmt: skip
    scale = float(np.abs(f).max()) or 1.0

    def values_of(p: _Floats) -> dict[str, float]:
        return {key: float(np.exp(x) if key == "v_f" else x) for key, x in zip(keys, p, strict=True)}

    def differences(p: _Floats) -> _Floats:
        return (friction_coefficient(v, values_of(p)) - f) / scale

    lower, upper = (np.array([bounds[key][side] for key in keys]) for side in (0, 1))
    start = {"mu_0": f[0], "mu_inf": f[-1], "exponent": 1.5, "viscous": 1e-3 * scale / most}
    tried = []
    for v_f in np.geomspace(least, most, 5) if "v_f" in keys else (1.0,):
        begin = np.clip([(start | {"v_f": np.log(v_f)})[key] for key in keys], lower + 1e-9, upper - 1e-9)
        how = {"x_scale": "jac", "xtol": 1e-12, "ftol": 1e-12}
        tried.append(least_squares(differences, begin, bounds=(lower, upper), **how))
    best = min(tried, key=lambda each: each.cost)
    scatter = np.sqrt(2.0 * best.cost / (v.size - len(keys))) * scale
    jacobian = best.jac * scale
    values = values_of(best.x)
    if "v_f" in keys:
        jacobian[:, keys.index("v_f")] /= values["v_f"]
    if law == "constant":
        turns = np.sum(np.diff(np.sign(np.diff(f))) != 0)
    else:
        turns = np.sum(np.diff(f) * np.diff(friction_coefficient(v, values)) < 0.0)
    return FrictionFit(
        law, values, np.linalg.pinv(jacobian.T @ jacobian) * scatter**2, float(scatter), v, int(turns)
    )
