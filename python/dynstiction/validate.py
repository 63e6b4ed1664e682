"""Which exponent Eq. (8) has: its forms are compared with the exact creep, and the exact creep with the full model.

docs/creep_validation.md explains the method; docs/notebooks/creep.ipynb has further evidence.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import fill
from typing import Any, NamedTuple, TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._run import run
from .creep import FORMS, creep_asymptotic, creep_exact
from .errors import UsageError
from .scene import Scene

__all__ = ["Check", "Mean", "Validation", "mean_creep", "validate_creep"]

_Floats = NDArray[np.float64]
Form = Callable[[ArrayLike, ArrayLike], _Floats]
"""X'/V [-] at tau [-] and phi [rad]."""

LIBRARY_FORMS: Mapping[str, Form] = {name: partial(creep_asymptotic, form=name) for name in FORMS}
ORDERS = {"first_power": 2.0, "printed": 1.0, "third_order": 3.0}
"""Order in phi of the error of each form, from docs/theory.md, section 3."""

# Fig. 3 of the paper with constant friction.
STIFFNESS_X = 1.0e3  # N/m
MU_0 = 0.2
NORMAL_LOAD = 10.0  # N
F_0 = MU_0 * NORMAL_LOAD
L_X = F_0 / STIFFNESS_X
DECK = """\
&scene model = 'full' /
&friction law = 'constant', contact = 'exact' /
&initial velocity_ratio = 1.0e-6 /
&integrator method = 'radau9', rtol = 1.0e-9 /
&output fields = 'u_y', 'X', 'X_rate' /
"""
SAMPLES_PER_CYCLE = 48
HALF_WIDTH = 0.02  # s, half width of the window of an average

TAUS = (0.25, 0.5, 0.8)
DEGREES = 4.0 / 2.0 ** np.arange(9)
TIMES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2)
TIME = 1.0  # s, where the forms are compared with the full model: tau = 0.5

COLUMNS = ("table", "quantity", "phi_deg", "tau", "velocity_m_s", "mass_kg", "stiffness_y_N_m", "value", "expected",
           "tolerance", "holds")  # fmt: skip
"""Columns of the table in CSV."""


class Mean(NamedTuple):
    """X'/V over whole high-frequency cycles around `time`, and the exact creep over the same window."""

    degrees: float
    velocity: float
    """V [m/s]."""
    mass: float
    """m [kg]."""
    stiffness_y: float
    """k_y [N/m]."""
    time: float
    """Requested middle of the window [s]; the window begins and ends within a cycle of time -+ `HALF_WIDTH`."""
    cycles: int
    full: float
    """(X(t_2) - X(t_1))/(V (t_2 - t_1)) [-] of the full model."""
    exact: float
    """The same of the exact creep with the same k_x/k_y [-]."""

    @property
    def tau(self) -> float:
        """V t/l_x [-]."""
        return self.velocity * self.time / L_X

    @property
    def phi(self) -> float:
        """Misalignment [rad]."""
        return math.radians(self.degrees)

    @property
    def difference(self) -> float:
        """Full model - exact creep [-]."""
        return self.full - self.exact

    @property
    def exact_at_time(self) -> float:
        """X'/V of the exact creep at `time` [-]."""
        return float(creep_exact(self.tau, self.phi, STIFFNESS_X / self.stiffness_y).X_rate)

    @property
    def at_time(self) -> float:
        """X'/V of the full model at `time` [-]: the exact creep there, and the difference of the averages."""
        return self.exact_at_time + self.difference


class Check(NamedTuple):
    """A measured number and its expected value."""

    name: str
    value: float
    expected: float
    tolerance: float

    @property
    def holds(self) -> bool:
        """Whether the value is within the tolerance; false for NaN."""
        return abs(self.value - self.expected) <= self.tolerance


@dataclass(frozen=True)
class Validation:
    """Results of `validate_creep`: the forms of Eq. (8), and the full model at phi = 1 deg along one run."""

    forms: Mapping[str, Form]
    means: Sequence[Mean]

    def error(self, form: str, tau: float) -> _Floats:
        """|X'/V of a form - exact| [-] at `DEGREES`, with a rigid stiff axis."""
        phi = np.radians(DEGREES)
        return np.abs(self.forms[form](tau, phi) - creep_exact(tau, phi).X_rate)

    def order(self, form: str, tau: float) -> float:
        """Order of that error in phi, from the two smallest misalignments."""
        return observed_order(DEGREES[-2:], self.error(form, tau)[-2:])

    @property
    def one(self) -> Mean:
        """The full model at `TIME`."""
        return next(mean for mean in self.means if mean.time == TIME)

    @property
    def worst_difference(self) -> float:
        """Largest relative difference between full model and exact creep [-]."""
        return max(abs(mean.difference / mean.exact) for mean in self.means)

    def at_one(self, form: str) -> float:
        """X'/V [-] of a form where `one` is."""
        return float(self.forms[form](self.one.tau, self.one.phi))

    def checks(self) -> tuple[Check, ...]:
        """All checks that the finding needs."""
        full = self.one.at_time
        return (
            *(
                Check(
                    f"order in phi of the error of {form} at tau = {tau:g}", self.order(form, tau), order, 0.05
                )
                for form, order in ORDERS.items()
                for tau in TAUS
            ),
            Check("X'/V of the full model at 1 s, 1 deg", full, 0.0103482, 1.0e-7),
            Check("full model and exact creep, relative difference", self.worst_difference, 0.0, 1e-4),
            Check("error of the first power, full model at 1 s, 1 deg", self.at_one("first_power") / full - 1.0, 0.0032, 1e-3),
            Check("error of the printed form there", self.at_one("printed") / full - 1.0, -0.4837, 1e-3),
        )  # fmt: skip

    @property
    def holds(self) -> bool:
        """Whether every check holds."""
        return all(check.holds for check in self.checks())

    def report(self) -> str:
        """Tables and finding as plain text."""
        wrapped = (fill(line, 100, subsequent_indent="   ") for line in self.finding())
        return "\n".join([*self._tables(), "", *wrapped])

    def _tables(self) -> Iterator[str]:
        yield "1. Error of X'/V from Eq. (8) relative to the exact creep (rigid stiff axis), tau = 0.5"
        yield f"{'phi [deg]':>12}" + "".join(f"{form:>14}" for form in self.forms)
        for degrees, *errors in zip(DEGREES, *(self.error(form, 0.5) for form in self.forms), strict=True):
            yield f"{degrees:12g}" + "".join(f"{error:14.5e}" for error in errors)
        for tau in TAUS:
            yield f"{f'order, {tau:g}':>12}" + "".join(
                f"{self.order(form, tau):14.3f}" for form in self.forms
            )
        yield ""
        yield "2. X'/V of the full model, constant friction, phi = 1 deg, averaged over whole high-frequency cycles around t"
        yield f"{'t [s]':>12}{'cycles':>8}{'full model':>12}{'exact':>11}{'difference':>12}"
        for mean in self.means:
            yield f"{mean.time:12g}{mean.cycles:8d}{mean.full:12.7f}{mean.exact:11.7f}{mean.difference:12.2e}"

    def finding(self) -> tuple[str, ...]:
        """The finding in sentences, or the checks that fail."""
        checks = self.checks()
        failed = [check for check in checks if not check.holds]
        if failed:
            lines = (f"  {c.name}: {c.value:.6g}, must be {c.expected:g} +- {c.tolerance:g}" for c in failed)
            return (f"{len(failed)} of {len(checks)} checks fail; no finding on Eq. (8):", *lines)
        one = self.one
        rigid = float(creep_exact(one.tau, one.phi).X_rate)
        return (
            "Finding: Eq. (8) holds with the first power of Vt/l_x, X' = V phi (phi + tau/sqrt(1 - tau^2)), "
            "tau = Vt/l_x. The square of Vt/l_x in the numerator, as the preprint prints it, is a misprint. Evidence:",
            "1. Compared with the exact creep, Eqs. (6) and (7), the first power has an error of second order in phi; "
            "the printed form has an error of first order, which is the order of the creep itself.",
            f"2. The full model with inertia creeps at X'/V = {one.at_time:.7f} at t = {TIME:g} s, phi = 1 deg. "
            f"The exact creep gives {one.exact_at_time:.7f} ({rigid:.7f} with a rigid stiff axis), the first power "
            f"{self.at_one('first_power'):.7f}, the printed form {self.at_one('printed'):.7f}. The remaining difference "
            f"between full model and exact creep, at most {self.worst_difference:.1e} relative, is due to inertia.",
            f"All {len(checks)} checks hold.",
        )

    def write_csv(self, file: TextIO) -> None:
        """Every number in a line: table, quantity, where, value; checks with their expected values."""
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows())

    def _rows(self) -> Iterator[dict[str, Any]]:
        for form in self.forms:
            for tau in TAUS:
                for degrees, error in zip(DEGREES.tolist(), self.error(form, tau).tolist(), strict=True):
                    yield {"table": "error", "quantity": form, "phi_deg": degrees, "tau": tau, "value": error}
        for mean in self.means:
            place = (mean.degrees, mean.tau, mean.velocity, mean.mass, mean.stiffness_y)
            where = {"table": "by_time", **dict(zip(COLUMNS[2:7], place, strict=True))}
            for quantity in ("full", "exact", "difference"):
                yield {**where, "quantity": quantity, "value": getattr(mean, quantity)}
        for check in self.checks():
            must = {"expected": check.expected, "tolerance": check.tolerance, "holds": int(check.holds)}
            yield {"table": "check", "quantity": check.name, "value": check.value, **must}


def validate_creep(forms: Mapping[str, Form] = LIBRARY_FORMS) -> Validation:
    """Measure the exponent of Eq. (8), with its three forms. A check that fails raises no exception: see `Validation.checks`."""
    return Validation(forms, mean_creep(TIMES))


def mean_creep(
    times: Sequence[float],
    *,
    degrees: float = 1.0,
    velocity: float = 1.0e-3,
    mass: float = 0.25,
    stiffness_y: float = 1.0e7,
) -> tuple[Mean, ...]:
    """X' of the full model with constant friction, averaged over whole high-frequency cycles.

    A cycle begins where u_y rises through its value in the exact creep. There X, which oscillates opposite to u_y,
    is at its mean, so that a decaying oscillation does not affect the average. The times [s] are the middles of the
    windows; a `UsageError` is raised if the oscillation has died out at one of them. Parameters that are not given are those of
    Fig. 3, in SI units.
    """
    from scipy.interpolate import CubicHermiteSpline  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    cycle = 2.0 * math.pi * math.sqrt(mass / stiffness_y)
    # Late cycles are longer than `cycle`, by 1/sqrt(1 - tau^2).
    margin = HALF_WIDTH + 3.0 * cycle
    result = run(
        Scene(DECK),
        scene={"t_end": max(times) + margin},
        system={
            "mass": mass,
            "stiffness_x": STIFFNESS_X,
            "stiffness_y": stiffness_y,
            "misalignment_deg": degrees,
        },
        friction={"mu_0": MU_0, "normal_load": NORMAL_LOAD},
        drive={"velocity": velocity},
        output={"interval": cycle / SAMPLES_PER_CYCLE},
    )
    phi, kappa = math.radians(degrees), STIFFNESS_X / stiffness_y
    found = []
    for time in times:
        inside = np.abs(result.time - time) <= margin
        t, u_y, x, x_rate = (result[name][inside] for name in ("time", "u_y", "X", "X_rate"))
        creep = creep_exact(velocity * t / L_X, phi, kappa)
        begins = _rising_zeros(t, u_y - F_0 / stiffness_y * np.cos(creep.alpha))
        if begins.size < 2:
            raise UsageError(f"degrees = {degrees:g}: at t = {time:g} s the oscillation has died out")
        first, last = (
            int(np.argmin(np.abs(begins - edge))) for edge in (time - HALF_WIDTH, time + HALF_WIDTH)
        )
        window = begins[[first, last]]
        way = float(np.diff(CubicHermiteSpline(t, x, x_rate)(window))[0])
        way_exact = L_X * float(np.diff(creep_exact(velocity * window / L_X, phi, kappa).X)[0])
        scale = 1.0 / (velocity * float(window[1] - window[0]))
        found.append(
            Mean(degrees, velocity, mass, stiffness_y, time, last - first, way * scale, way_exact * scale)
        )
    return tuple(found)


def _rising_zeros(t: _Floats, values: _Floats) -> _Floats:
    before = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    slope = (values[before + 1] - values[before]) / (t[before + 1] - t[before])
    return t[before] - values[before] / slope


def observed_order(sizes: ArrayLike, errors: ArrayLike) -> float:
    """Slope of log(errors) over log(sizes), least squares."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
