"""Misalignment and creep length from one apparent stick, measured as a displacement (docs/howto/fit_creep.md)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from itertools import product
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline  # type: ignore[import-untyped]
from scipy.optimize import least_squares  # type: ignore[import-untyped]

from ._arguments import number, reals, shown
from .errors import FitWarning, UsageError

_Floats = NDArray[np.float64]
Law = Callable[[_Floats], ArrayLike]
Form = Literal["exact", "first_power", "printed"]
FORMS: tuple[Form, ...] = get_args(Form)
START_DEGREES, START_TAU = (0.1, 0.5, 2.0, 8.0), (0.5, 0.8, 0.98)
"""Misalignments [deg], and values of V t/l_x at the last sample, from which the fit starts."""
GRID = np.linspace(0.0, 15.0, 1501)
"""-ln of the angle between friction and its limit, over the angle at release. At the end of it the slip is steady."""
LEAST_SAMPLES = 10
NO_CREEP = 30.0
"""Creep must explain more than this many variances of the noise, or it is none: noise alone gives up to 15 in 1000 samples."""
PATH_ERROR = 1e-6
"""Of `creep_path`, relative to the distance; what differs by less is explained."""


class CreepFit(NamedTuple):
    """What one apparent stick says of the misalignment; standard errors (one sigma) from the scatter of the samples."""

    misalignment_deg: float
    """Size of phi [deg]."""
    misalignment_error: float
    length: float
    """l_x = F_0/k_x [m]; with the stiffness k_x it gives F_0 = mu_0 W."""
    length_error: float
    offset: float
    """Position X before creep begins [m]."""
    relaxed_at: float
    """When the spring had no load [s]."""
    residual: float
    """Root mean square of the differences between measured and fitted X [m]."""
    misfit: float
    """`residual` over the scatter from one sample to the next: 1 if only noise is left."""

    def __str__(self) -> str:
        return (
            f"misalignment {self.misalignment_deg:.5g} ± {self.misalignment_error:.2g} deg, "
            f"l_x {self.length:.6g} ± {self.length_error:.2g} m, residual {self.residual:.2g} m, misfit {self.misfit:.3g}"
        )


def fit_creep(
    time: ArrayLike,
    X: ArrayLike,
    *,
    velocity: float,
    stiffness_ratio: float = 0.0,
    law: Law | None = None,
    relaxed_at: float | None = 0.0,
    form: Form = "exact",
) -> CreepFit:
    """Fit slow creep to the displacement of an object that seems to stick.

    Parameters
    ----------
    time : array_like, shape (n,)
        Times [s], ascending, from one apparent stick: without the slips before and after it.
    X : array_like, shape (n,)
        Displacement of the object along the drive [m].
    velocity : float
        V of the drive [m/s], positive.
    stiffness_ratio : float
        kappa = k_x/k_y in [0, 1).
    law : callable, optional
        Friction at given slip speeds [m/s], relative to friction at rest: ``lambda v: 0.75 + 0.25*np.exp(-v/0.01)``. By default
        friction is constant; the slip speeds of creep weaken it by little, which only accurate sensors see.
    relaxed_at : float or None
        When the spring had no load [s]; None if it is to be fitted, as for a stick that begins after a slip.
    form : {'exact', 'first_power', 'printed'}
        Eq. (7), or Eq. (8) as it follows from it or as it is printed in the preprint, see `creep_asymptotic`. Eq. (8) has neither
        stiffness ratio nor law.

    Returns
    -------
    CreepFit
        Misalignment and creep length with standard errors.

    Warns
    -----
    FitWarning
        If the differences are not those of noise alone; or if no creep is seen: then the values are NaN.

    Raises
    ------
    UsageError
        If an argument is out of range, or if the times do not ascend.

    See Also
    --------
    fit : the parameters behind a trace of the force.

    Examples
    --------
    >>> stick = result.time < 0.9                                              # doctest: +SKIP
    >>> print(fit_creep(result.time[stick], result["X"][stick], velocity=1e-3))    # doctest: +SKIP
    """
    t, x = reals("time", time, units="s"), reals("X", X, units="m")
    if t.ndim != 1 or t.shape != x.shape or t.size < LEAST_SAMPLES or not np.all(np.diff(t) > 0.0):
        raise UsageError(f"time and X: give at least {LEAST_SAMPLES} samples of both, at times that ascend")
    speed = number("velocity", velocity, above=0.0, units="m/s")
    kappa = number("stiffness_ratio", stiffness_ratio, least=0.0, below=1.0)
    if form not in FORMS:
        raise UsageError(f"form = {shown(form)}: one of {', '.join(map(repr, FORMS))}")
    start = float(t[0]) if relaxed_at is None else number("relaxed_at", relaxed_at, units="s")
    duration = t[-1] - start
    if duration <= 0.0 or t[0] < start:
        raise UsageError(f"relaxed_at = {start:g} s: the stick begins at {t[0]:g} s: give a time before it")
    scale = speed * (t[-1] - t[0])

    def begins(parameters: _Floats) -> float:
        return float(start - (parameters[3] * duration if relaxed_at is None else 0.0))

    def differences(parameters: _Floats) -> _Floats:
        phi, length = np.exp(parameters[:2])
        since = t - begins(parameters)
        if form == "exact":
            along = creep_path(since, min(phi, 1.5), length, speed, kappa, law)
        else:
            along = _asymptotic(speed * since / length, phi, form) * length
        return np.asarray(along / scale + parameters[2] - measured)

    measured, more = x / scale, [0.1] if relaxed_at is None else []
    starts = [
        np.array([np.log(np.radians(degrees)), np.log(speed * duration / tau), measured[0], *more])
        for degrees, tau in product(START_DEGREES, START_TAU)
    ]
    starts.sort(key=lambda each: float(np.sum(differences(each) ** 2)))
    how = {"x_scale": "jac", "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
    best = min((least_squares(differences, each, **how) for each in starts[:2]), key=lambda each: each.cost)
    p, variance = best.x, 2.0 * best.cost / max(t.size - best.x.size, 1)
    at_rest = np.sum((measured - measured.mean()) ** 2)
    if at_rest - 2.0 * best.cost < NO_CREEP * variance:
        scatter = float(np.std(x, ddof=1))
        warnings.warn(
            f"no creep is seen above the noise of {scatter:.2g} m: the object rests, or the misalignment is too small for this "
            "sensor", FitWarning, stacklevel=2,
        )  # fmt: skip
        nan, inf = np.nan, np.inf
        return CreepFit(nan, inf, nan, inf, float(x.mean()), start, scatter, 1.0)
    spread = np.sqrt(variance)
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * spread**2
    errors = np.sqrt(np.diag(covariance))
    # Differences of neighbours show the noise alone, whatever the model leaves.
    noise = np.std(np.diff(best.fun)) / np.sqrt(2.0)
    misfit = float(spread / noise) if noise > 0.0 else 1.0
    angle, length = float(np.degrees(np.exp(p[0]))), float(np.exp(p[1]))
    sizes = angle, float(angle * errors[0]), length, float(length * errors[1])
    found = CreepFit(*sizes, float(p[2] * scale), begins(p), float(spread * scale), misfit)
    if misfit > 1.0 + 3.0 / np.sqrt(t.size) and found.residual > PATH_ERROR * np.ptp(x):
        warnings.warn(
            f"creep does not explain the displacement: the differences are {misfit:.3g} times its noise, and the errors are too "
            "small: leave out the slips, give the law of friction or the stiffness ratio", FitWarning, stacklevel=2,
        )  # fmt: skip
    return found


def creep_path(
    since: _Floats, phi: float, length: float, velocity: float, kappa: float = 0.0, law: Law | None = None
) -> _Floats:
    """Distance along the drive in slow creep [m], at times since the spring was relaxed [s]; steady sliding where it has ended.

    The friction angle theta is the variable, as in Eq. (7) (docs/theory.md): the slip speed is
    ``v = V (kappa c cos(phi) + s sin(phi))/D``, the spring forces are ``k_x u_x = F(v) c``, ``k_y u_y = F(v) s``, and
    ``dt = (l_x/V) D/(s sin(theta - phi)) d(F c/F_0)``, with c, s of theta and ``D = kappa c^2 + s^2``. With constant friction this
    is `creep_exact`; with a law it leaves out ``dF/dv dv/dt`` against ``k_y v``.
    """
    first = np.arctan2(np.sin(phi), kappa * np.cos(phi))
    beyond = (first - phi) * np.exp(-GRID)
    theta = phi + beyond
    c, s = np.cos(theta), np.sin(theta)
    compliance = kappa * c**2 + s**2
    v = velocity * (kappa * c * np.cos(phi) + s * np.sin(phi)) / compliance
    friction = np.broadcast_to(np.asarray(1.0 if law is None else law(v), dtype=np.float64), v.shape)
    change = friction * s * beyond + c * CubicSpline(GRID, friction)(GRID, 1)
    rate = length / velocity * compliance / (s * np.sin(beyond)) * change
    # Friction that weakens may no longer balance the load: there creep ends.
    last = int(np.argmax(rate <= 0.0)) if np.any(rate <= 0.0) else GRID.size
    release = length / velocity / np.hypot(np.cos(phi), np.sin(phi) / kappa if kappa > 0.0 else np.inf)
    passed = release + CubicSpline(GRID, rate).antiderivative()(GRID)
    x = velocity * passed - length * friction * (c * np.cos(phi) + kappa * s * np.sin(phi))
    x_rate = v * np.cos(beyond)
    if last < 2:
        return np.asarray(velocity * np.maximum(since - release, 0.0))
    end = passed[last - 1]
    creep = CubicHermiteSpline(passed[:last], x[:last], x_rate[:last])(np.clip(since, release, end))
    return np.asarray(creep + velocity * np.maximum(since - end, 0.0))


def _asymptotic(tau: _Floats, phi: float, form: Form) -> _Floats:
    """Distance over l_x by Eq. (8), integrated; beyond tau = 1, where it ends, its value there."""
    tau = np.clip(tau, 0.0, 1.0)
    root = np.sqrt(1.0 - tau**2)
    bend = 1.0 - root if form == "first_power" else (np.arcsin(tau) - tau * root) / 2.0
    return phi**2 * tau + phi * bend
