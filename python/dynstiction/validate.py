"""Which exponent Eq. (8) has: its forms against the exact creep, and that against the full model.

Nothing here prints or draws: `validate_creep` computes, `Validation` holds the numbers, checks and finding.
docs/creep_validation.md explains what is measured and why.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from textwrap import fill
from typing import TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline  # type: ignore[import-untyped]
from scipy.optimize import least_squares  # type: ignore[import-untyped]

from ._run import run
from .creep import FORMS, creep_asymptotic, creep_exact
from .errors import UsageError
from .scene import Scene

__all__ = [
    "RUNS",
    "Check",
    "Contributions",
    "FormError",
    "Mean",
    "Validation",
    "mean_creep",
    "separate",
    "validate_creep",
]

_Floats = NDArray[np.float64]
Form = Callable[[ArrayLike, ArrayLike], _Floats]
"""X'/V [-] at tau [-] and phi [rad]."""

LIBRARY_FORMS: Mapping[str, Form] = {name: partial(creep_asymptotic, form=name) for name in FORMS}
ORDERS = {"first_power": 2.0, "printed": 1.0, "third_order": 3.0}
"""Order in phi of the error of each form, from docs/theory.md, section 3."""

# Fig. 3 of the paper with constant friction. Its kappa adds kappa tan^2(alpha) to X'/V: too much for the fits.
STIFFNESS_X = 1.0e3  # N/m
STIFFNESS_Y = 1.0e7  # N/m
STIFFNESS_Y_OF_FITS = 1.0e8  # N/m
MASS = 0.25  # kg
MU_0 = 0.2
NORMAL_LOAD = 10.0  # N
VELOCITY = 1.0e-3  # m/s
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
HALF_WIDTH = 0.02  # s, of the window of an average

TAUS = (0.25, 0.5, 0.8)
DEGREES = tuple(4.0 / 2**i for i in range(9))
TIME = 1.0  # s, where the forms are held against the full model: tau = 0.5
DEGREES_OF_MEANS = (2.0, 1.0, 0.5, 0.25, 0.125)
LATE = 1.6  # s, where at small misalignments hardly more than the inertia of the creep itself is left
DEGREES_LATE = (0.25, 0.125, 0.0625, 0.03125, 0.015625)
MASSES = (1.0, 0.5, 0.25, 0.125)
TIMES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2)
DEGREES_OF_FITS = (0.5, 1.0, 2.0, 4.0)
VELOCITIES_OF_FITS = (0.5e-4, 1.0e-4, 2.0e-4, 3.0e-4, 4.0e-4)
RUNS = 1 + len((*DEGREES_OF_MEANS, *DEGREES_LATE, *MASSES)) + len(DEGREES_OF_FITS) * len(VELOCITIES_OF_FITS)
"""Runs of the full model that `validate_creep` makes."""

COLUMNS = (
    "table",
    "quantity",
    "phi_deg",
    "tau",
    "velocity_m_s",
    "mass_kg",
    "stiffness_y_N_m",
    "value",
    "expected",
    "tolerance",
    "holds",
)
"""Of the table in CSV."""


@dataclass(frozen=True)
class FormError:
    """Error of one form of Eq. (8) against the exact creep with a rigid stiff axis."""

    form: str
    tau: float
    degrees: _Floats
    """Misalignments [deg], each half the one before, shape (n,)."""
    error: _Floats
    """|X'/V of the form - exact| [-], shape (n,)."""

    @property
    def order(self) -> float:
        """Observed order in phi, from the two smallest misalignments."""
        return observed_order(self.degrees[-2:], self.error[-2:])


@dataclass(frozen=True)
class Mean:
    """X'/V over whole high-frequency cycles about `time`, and the exact creep over the very same window."""

    degrees: float
    velocity: float
    """V [m/s]."""
    mass: float
    """m [kg]."""
    stiffness_y: float
    """k_y [N/m]."""
    time: float
    """Middle of the window as asked for [s]; it begins and ends within a cycle of time -+ `HALF_WIDTH`."""
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
    def at_time(self) -> float:
        """X'/V of the full model at `time` [-]: the exact creep there, and the difference of the averages."""
        exact = creep_exact(self.tau, self.phi, STIFFNESS_X / self.stiffness_y).X_rate
        return float(exact) + self.difference


@dataclass(frozen=True)
class Contributions:
    """``X' = a phi^p V^m (t/l_x)^(m-1) + b phi^q V^n (t/l_x)^(n-1)/sqrt(1 - tau^2)``, fitted at one t."""

    coefficients: tuple[float, float]
    """a and b [-]."""
    powers_of_phi: tuple[float, float]
    """p and q."""
    powers_of_velocity: tuple[float, float]
    """m and n."""
    residual: float
    """Root mean square of the relative residual [-]."""


@dataclass(frozen=True)
class Check:
    """A measured number beside what it must be."""

    name: str
    value: float
    expected: float
    tolerance: float

    @property
    def holds(self) -> bool:
        """Whether the value is within the tolerance; NaN is not."""
        return abs(self.value - self.expected) <= self.tolerance


@dataclass(frozen=True)
class Validation:
    """What `validate_creep` measured."""

    forms: Mapping[str, Form] = field(repr=False)
    errors: tuple[FormError, ...]
    by_time: tuple[Mean, ...]
    """phi = 1 deg, along one run."""
    by_phi: tuple[Mean, ...]
    late: tuple[Mean, ...]
    by_mass: tuple[Mean, ...]
    fit_points: tuple[Mean, ...]
    fits: Mapping[str, Contributions]
    """Of the full model, and of each form at the same points."""

    def checks(self) -> tuple[Check, ...]:
        """All that must hold for the finding."""
        return (*self._checks_of_orders(), *self._checks_of_means(), *self._checks_of_fits())

    def _checks_of_orders(self) -> Iterator[Check]:
        for entry in self.errors:
            name = f"order in phi of the error of {entry.form} at tau = {entry.tau:g}"
            yield Check(name, entry.order, ORDERS[entry.form], 0.05)

    def _checks_of_means(self) -> Iterator[Check]:
        (one,) = (mean for mean in self.by_phi if mean.degrees == 1.0)
        yield Check("X'/V of the full model at 1 s, 1 deg", one.at_time, 0.0103482, 1.0e-7)
        yield Check(
            "full model against the exact creep, relative difference", self.worst_difference, 0.0, 1.0e-4
        )
        yield Check("order in the mass of that difference", self.order_in_mass, 1.0, 0.05)
        yield Check(f"order in phi of that difference at {LATE:g} s", self.order_in_phi, 2.0, 0.1)
        yield Check("first power off the full model at 1 s, 1 deg", self._off(one, "first_power"), 0.0, 0.01)
        yield Check(
            "printed form off it, as the exact creep has it", self._off(one, "printed"), -0.4837, 0.001
        )

    def _off(self, mean: Mean, form: str) -> float:
        return float(self.forms[form](mean.tau, mean.phi)) / mean.at_time - 1.0

    def _checks_of_fits(self) -> Iterator[Check]:
        for name in ("full", "first_power"):
            fit = self.fits[name]
            for i, (phi, velocity) in enumerate(((2.0, 1.0), (1.0, 2.0))):
                term = f"{('first', 'second')[i]} contribution, {name}"
                yield Check(f"power of phi, {term}", fit.powers_of_phi[i], phi, 0.05)
                yield Check(f"power of V, {term}", fit.powers_of_velocity[i], velocity, 0.05)
                yield Check(f"coefficient, {term}", fit.coefficients[i], 1.0, 0.05)
        yield Check(
            "power of V, second contribution, printed", self.fits["printed"].powers_of_velocity[1], 3.0, 0.05
        )

    @property
    def worst_difference(self) -> float:
        """Largest relative difference between full model and exact creep [-]."""
        means = (*self.by_time, *self.by_phi, *self.late, *self.by_mass)
        return max(abs(mean.difference / mean.exact) for mean in means)

    @property
    def order_in_mass(self) -> float:
        """Observed order of that difference in the mass."""
        return observed_order([m.mass for m in self.by_mass], [abs(m.difference) for m in self.by_mass])

    @property
    def order_in_phi(self) -> float:
        """Observed order of that difference in phi, where little of the oscillation is left."""
        return observed_order([m.phi for m in self.late], [abs(m.difference) for m in self.late])

    @property
    def holds(self) -> bool:
        """Whether every check holds."""
        return all(check.holds for check in self.checks())

    def report(self) -> str:
        """Tables and finding as plain text."""
        wrapped = (fill(line, 100, subsequent_indent="   ") for line in self.finding())
        return "\n".join([*self._tables(), "", *wrapped])

    def _tables(self) -> Iterator[str]:
        yield "1. Error of X'/V after Eq. (8) against the exact creep (rigid stiff axis), tau = 0.5"
        shown = [entry for entry in self.errors if entry.tau == 0.5]
        yield f"{'phi [deg]':>12}" + "".join(f"{entry.form:>14}" for entry in shown)
        for i, degrees in enumerate(DEGREES):
            yield f"{degrees:12g}" + "".join(f"{entry.error[i]:14.5e}" for entry in shown)
        for tau in TAUS:
            orders = "".join(f"{entry.order:14.3f}" for entry in self.errors if entry.tau == tau)
            yield f"{f'order, {tau:g}':>12}{orders}"
        yield ""
        yield "2. X'/V of the full model, constant friction, averaged over whole high-frequency cycles about t"
        heads = ("phi [deg]", "t [s]", "mass [kg]", "cycles", "full model", "exact", "difference")
        yield "".join(
            f"{head:>{width}}" for head, width in zip(heads, (12, 7, 11, 8, 12, 11, 12), strict=True)
        )
        for mean in (*self.by_phi, *self.by_mass, *self.late):
            yield (
                f"{mean.degrees:12g}{mean.time:7g}{mean.mass:11g}{mean.cycles:8d}{mean.full:12.7f}{mean.exact:11.7f}"
                f"{mean.difference:12.2e}"
            )
        yield ""
        yield "3. X' = a phi^p V^m (t/l_x)^(m-1) + b phi^q V^n (t/l_x)^(n-1)/sqrt(1 - tau^2), fitted over phi and V"
        yield f"{'':12}" + "".join(f"{name:>8}" for name in "apmbqn") + f"{'residual':>12}"
        for name, fit in self.fits.items():
            numbers = (
                value
                for i in (0, 1)
                for value in (fit.coefficients[i], fit.powers_of_phi[i], fit.powers_of_velocity[i])
            )
            yield f"{name:12}" + "".join(f"{value:8.3f}" for value in numbers) + f"{fit.residual:12.1e}"

    def finding(self) -> tuple[str, ...]:
        """The finding in sentences, or what fails."""
        checks = self.checks()
        failed = [check for check in checks if not check.holds]
        if failed:
            lines = (f"  {c.name}: {c.value:.6g}, must be {c.expected:g} +- {c.tolerance:g}" for c in failed)
            return (f"{len(failed)} of {len(checks)} checks fail; no finding on Eq. (8):", *lines)
        (one,) = (mean for mean in self.by_phi if mean.degrees == 1.0)
        tau, phi = one.tau, one.phi
        exact, rigid = (
            float(creep_exact(tau, phi, kappa).X_rate) for kappa in (STIFFNESS_X / one.stiffness_y, 0.0)
        )
        first, printed = (float(self.forms[form](tau, phi)) for form in ("first_power", "printed"))
        full, misprint = self.fits["full"], self.fits["printed"]
        (p, q), (m, n) = full.powers_of_phi, full.powers_of_velocity
        return (
            "Finding: Eq. (8) holds with the first power of Vt/l_x, X' = V phi (phi + tau/sqrt(1 - tau^2)), "
            "tau = Vt/l_x. The square of Vt/l_x in the numerator, as the preprint prints it, is a misprint. Evidence:",
            "1. Against the exact creep, Eqs. (6) and (7), the first power errs by the second order in phi; "
            "the printed form errs by the first, that of the creep itself.",
            f"2. The full model with inertia creeps at X'/V = {one.at_time:.7f} at t = {TIME:g} s, phi = 1 deg. "
            f"The exact creep gives {exact:.7f} ({rigid:.7f} with a rigid stiff axis), the first power {first:.7f}, "
            f"the printed form {printed:.7f}. What is left between full model and exact creep, "
            f"{self.worst_difference:.1e} of it at most, is inertia: it goes with the mass to the power "
            f"{self.order_in_mass:.2f} and, late, with phi to the power {self.order_in_phi:.2f}.",
            f"3. The full model's creep is the sum of phi^{p:.2f} V^{m:.2f} and phi^{q:.2f} V^{n:.2f} t/l_x. The "
            "paper's own sentence, linear in phi and of second order in V, says the same of the second contribution; "
            f"the printed form would have it with V^{misprint.powers_of_velocity[1]:.2f}.",
            f"All {len(checks)} checks hold.",
        )

    def write_csv(self, file: TextIO) -> None:
        """Every number, one a line: table, quantity, where, value; checks with what they must be."""
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows())

    def _rows(self) -> Iterator[dict[str, str | float]]:
        for entry in self.errors:
            for degrees, error in zip(entry.degrees.tolist(), entry.error.tolist(), strict=True):
                where = {"phi_deg": degrees, "tau": entry.tau}
                yield {"table": "error", "quantity": entry.form, **where, "value": error}
        for table in ("by_time", "by_phi", "late", "by_mass", "fit_points"):
            for mean in getattr(self, table):
                where = {
                    "phi_deg": mean.degrees,
                    "tau": mean.tau,
                    "velocity_m_s": mean.velocity,
                    "mass_kg": mean.mass,
                    "stiffness_y_N_m": mean.stiffness_y,
                }
                for quantity in ("full", "exact", "difference"):
                    yield {"table": table, "quantity": quantity, **where, "value": getattr(mean, quantity)}
        for check in self.checks():
            must = {"expected": check.expected, "tolerance": check.tolerance, "holds": int(check.holds)}
            yield {"table": "check", "quantity": check.name, "value": check.value, **must}


def validate_creep(
    forms: Mapping[str, Form] = LIBRARY_FORMS, advance: Callable[[], None] = lambda: None
) -> Validation:
    """Measure all that Eq. (8)'s exponent can be told from; some seconds.

    Parameters
    ----------
    forms : mapping
        The three forms of Eq. (8) by name, functions of tau and phi [rad].
    advance : callable
        Called after each of the `RUNS` runs of the full model.

    Returns
    -------
    Validation
        The numbers. Nothing is raised where a check fails: see `Validation.checks`.

    Raises
    ------
    SolverError
        If the full model could not be integrated.
    """

    def means(times: Sequence[float] = (TIME,), **case: float) -> tuple[Mean, ...]:
        found = mean_creep(times, **case)
        advance()
        return found

    errors = tuple(form_error(name, form, tau) for name, form in forms.items() for tau in TAUS)
    by_time = means(TIMES)
    by_phi = tuple(means(degrees=degrees)[0] for degrees in DEGREES_OF_MEANS)
    late = tuple(means((LATE,), degrees=degrees)[0] for degrees in DEGREES_LATE)
    by_mass = tuple(means(mass=mass)[0] for mass in MASSES)
    fit_points = tuple(
        means(degrees=degrees, velocity=velocity, stiffness_y=STIFFNESS_Y_OF_FITS)[0]
        for degrees, velocity in product(DEGREES_OF_FITS, VELOCITIES_OF_FITS)
    )
    fits = fits_of(fit_points, forms)
    return Validation(forms, errors, by_time, by_phi, late, by_mass, fit_points, fits)


def fits_of(points: Sequence[Mean], forms: Mapping[str, Form]) -> dict[str, Contributions]:
    """The contributions of the full model, and of the forms for comparison at the same points."""
    phi, tau = np.array([[mean.phi, mean.tau] for mean in points]).T
    fits = {"full": separate(phi, tau, np.array([mean.at_time for mean in points]))}
    for name in ("first_power", "printed"):
        fits[name] = separate(phi, tau, forms[name](tau, phi))
    return fits


def form_error(name: str, form: Form, tau: float, degrees: Sequence[float] = DEGREES) -> FormError:
    """Error of a form of Eq. (8) against the exact creep at one tau [-], for misalignments [deg]."""
    phi = np.radians(degrees)
    return FormError(name, tau, np.array(degrees), np.abs(form(tau, phi) - creep_exact(tau, phi).X_rate))


def mean_creep(
    times: Sequence[float],
    *,
    degrees: float = 1.0,
    velocity: float = VELOCITY,
    mass: float = MASS,
    stiffness_y: float = STIFFNESS_Y,
) -> tuple[Mean, ...]:
    """X' of the full model with constant friction, averaged over whole high-frequency cycles.

    A cycle begins where u_y rises through its value in the exact creep. There X, which oscillates opposite to u_y,
    is on its mean, so that a decaying oscillation leaves no trace in the average.

    Parameters
    ----------
    times : sequence of float
        Middles of the windows [s]; none may come within `HALF_WIDTH` of 0.
    degrees, velocity, mass, stiffness_y : float
        Misalignment [deg], V [m/s], m [kg], k_y [N/m]; the rest is Fig. 3's.

    Returns
    -------
    tuple of Mean
        One for each time.

    Raises
    ------
    UsageError
        If the oscillation has died out at one of the times.
    SolverError
        If the full model could not be integrated.
    """
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


def separate(phi: _Floats, tau: _Floats, x_rate: _Floats) -> Contributions:
    """Fit the two contributions to X'/V, ``a phi^p tau^(m-1) + b phi^q tau^(n-1)/sqrt(1 - tau^2)``.

    At one t, tau stands for V. Least squares of the logarithm; both contributions
    start alike, one a little to either side of the other, from phi^1.5 V^1.5.

    Parameters
    ----------
    phi, tau, x_rate : ndarray, shape (n,)
        Misalignment [rad], V t/l_x [-] in (0, 1), X'/V [-]; n at least 6.
    """
    log_phi, log_tau = np.log(phi), np.log(tau)
    columns = np.stack([np.ones_like(phi), log_phi, log_tau], axis=1)
    root = -0.5 * np.log1p(-(tau**2))

    def terms(unknowns: _Floats) -> tuple[_Floats, _Floats]:
        return np.exp(columns @ unknowns[:3]), np.exp(columns @ unknowns[3:] + root)

    def residual_of(unknowns: _Floats) -> _Floats:
        return np.log(sum(terms(unknowns)) / x_rate)

    def jacobian_of(unknowns: _Floats) -> _Floats:
        first, second = terms(unknowns)
        share = (first / (first + second))[:, np.newaxis]
        return np.hstack([share * columns, (1.0 - share) * columns])

    unknowns = np.array([0.0, 1.6, 0.5, 0.0, 1.5, 0.6])
    # Each starts as half of the whole.
    for i in (0, 3):
        unknowns[i] = np.mean(np.log(0.5 * x_rate) - unknowns[i + 1] * log_phi - unknowns[i + 2] * log_tau)
    fit = least_squares(residual_of, unknowns, jacobian_of, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    a, p, m, b, q, n = fit.x.tolist()
    return Contributions(
        coefficients=(math.exp(a), math.exp(b)),
        powers_of_phi=(p, q),
        powers_of_velocity=(m + 1.0, n + 1.0),
        residual=float(np.sqrt(np.mean(fit.fun**2))),
    )


def observed_order(sizes: ArrayLike, errors: ArrayLike) -> float:
    """Slope of log(errors) over log(sizes), least squares."""
    return float(np.polyfit(np.log(np.asarray(sizes)), np.log(np.asarray(errors)), 1)[0])
