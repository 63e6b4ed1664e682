"""Slow creep without inertia (Nakano & Popov 2020, Eqs. 6-8), for arrays; docs/theory.md derives the equations.

Constant friction ``F_0 = mu_0 W``, ``l_x = F_0/k_x``, ``kappa = k_x/k_y``, ``tau = V t/l_x`` and ``u = 0`` at
``t = 0``. While the object creeps it is under full friction, ``|K u| = F_0``.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arguments import LARGEST, SMALLEST, finite, reals, shape_of, shown
from .errors import UsageError

_Floats = NDArray[np.float64]
Form = Literal["first_power", "printed", "third_order"]
FORMS: tuple[Form, ...] = get_args(Form)


class Creep(NamedTuple):
    """Creep at each point; all arrays have the broadcast shape of the arguments."""

    alpha: _Floats
    """Angle of the spring force [rad]: ``k_x u_x/F_0 = sin(alpha)``."""
    theta: _Floats
    """Angle of friction to the soft axis [rad], ``pi/2 - alpha`` with the sign of phi."""
    psi: _Floats
    """Angle of friction to the drive [rad], ``theta - phi``."""
    v: _Floats
    """Slip speed over V [-]."""
    X_rate: _Floats
    """Velocity along the drive over V [-]."""
    Y_rate: _Floats
    """Velocity across the drive over V [-], Eq. (6): ``Y' = -w_x sin(phi) + w_y cos(phi)``."""
    X: _Floats
    """Distance along the drive over l_x [-]."""
    deficit: _Floats
    """``1 - X'/V`` [-], computed without cancellation."""


def creep_exact(tau: ArrayLike, phi: ArrayLike, kappa: ArrayLike = 0.0) -> Creep:
    """Exact slow creep, the closed form of Eq. (7) and its extension to a finite stiffness k_y.

    ``(cos^2 alpha + kappa sin^2 alpha) d(alpha)/d(tau) = cos(alpha + phi)``; for kappa = 0
    ``v/V = sin phi/sin theta``, ``X'/V = sin phi cos psi/sin theta``, ``Y'/V = sin phi sin psi/sin theta``. With
    kappa > 0 the object sticks (v = 0) up to ``tau = kappa/sqrt(kappa^2 cos^2 phi + sin^2 phi)``.

    Parameters
    ----------
    tau : array_like
        Time V t/l_x [-], at least 0.
    phi : array_like
        Misalignment [rad] in (-pi/2, pi/2). A negative one mirrors the motion: theta, psi and Y' change sign.
        At 0, which is the limit from above, tau must be < 1.
    kappa : array_like
        k_x/k_y [-] in [0, 1).

    Returns
    -------
    Creep
        Arrays (alpha, theta, psi, v, X_rate, Y_rate, X, deficit) of the broadcast shape, float64; ratios to V and l_x.

    Raises
    ------
    UsageError
        If a point is out of range or is not a number (the message gives the range), or if the arguments do not broadcast.

    Notes
    -----
    The relative errors are below 2e-14 for 1e-6 deg <= phi <= 89 deg, those of X'/V and X below 2e-15, up to where
    1 - X'/V = 1e-12. With kappa > 0, the relative error of X just after the release at tau_1 is about 2e-16 tau_1/(tau - tau_1),
    because the rounding of phi shifts tau_1.
    """
    return Creep(*finite("creep", _evaluate("exact", len(Creep._fields), tau, phi, kappa)))


def creep_asymptotic(tau: ArrayLike, phi: ArrayLike, form: Form = "first_power") -> _Floats:
    """X'/V of slow creep for small misalignment, Eq. (8) and two relatives.

    Parameters
    ----------
    tau : array_like
        Time V t/l_x [-], in [0, 1). All forms fail when ``1 - tau`` decreases to about phi.
    phi : array_like
        Misalignment [rad] in (-pi/2, pi/2); the result is even in it.
    form : {'first_power', 'printed', 'third_order'}
        'first_power': ``phi (phi + tau/sqrt(1 - tau^2))``, Eq. (8) as it follows from Eqs. (6) and (7), with an error of order
        phi^2. 'printed': ``phi (phi + tau^2/sqrt(1 - tau^2))``, as in the preprint, with an error of order phi.
        'third_order': ``phi tau/sqrt(1 - tau^2) + phi^2 [1 + 1/(1 - tau^2) - (1 - tau^2)^(-3/2)]``, with an error of order
        phi^3.

    Returns
    -------
    ndarray, float64
        X'/V [-] in the broadcast shape.

    Raises
    ------
    UsageError
        If a point is out of range or is not a number, if the form is none of these, or if the arguments do not broadcast.
    """
    if not isinstance(form, str) or form not in FORMS:
        raise UsageError(f"form = {shown(form)}: one of {', '.join(map(repr, FORMS))}")
    return cast(_Floats, finite("X'/V", _evaluate(form, 1, tau, phi, 0.0)[0]))


def creep_velocity(
    t: ArrayLike,
    *,
    velocity: ArrayLike,
    misalignment_deg: ArrayLike,
    stiffness_x: ArrayLike,
    stiffness_y: ArrayLike | None = None,
    mu_0: ArrayLike,
    normal_load: ArrayLike,
) -> _Floats:
    """Velocity X' of slow creep along the drive in SI units, exact (`creep_exact`).

    Parameters
    ----------
    t : array_like
        Time [s] since the spring was relaxed, at least 0.
    velocity : array_like
        V [m/s] of the drive, positive.
    misalignment_deg : array_like
        phi [deg] in (-90, 90).
    stiffness_x, stiffness_y : array_like
        k_x < k_y [N/m] of the soft and the stiff principal axis; without `stiffness_y` the stiff axis is rigid.
    mu_0 : array_like
        Friction coefficient [-], positive.
    normal_load : array_like
        W [N], positive.

    Returns
    -------
    ndarray, float64
        X' [m/s] in the broadcast shape of all arguments.

    Raises
    ------
    UsageError
        If an argument is out of range or is not a number (the message gives the range), or if the arguments do not broadcast.
    """
    scaled = dimensionless(**locals() | {"stiffness_y": np.inf if stiffness_y is None else stiffness_y})
    return reals("velocity", velocity) * creep_exact(*scaled).X_rate


def dimensionless(
    t: ArrayLike,
    *,
    velocity: ArrayLike,
    misalignment_deg: ArrayLike,
    stiffness_x: ArrayLike,
    stiffness_y: ArrayLike,
    mu_0: ArrayLike,
    normal_load: ArrayLike,
) -> tuple[_Floats, _Floats, _Floats]:
    """Arguments (tau, phi, kappa) of `creep_exact` from those of `creep_velocity`; an infinite `stiffness_y` is rigid."""
    positive = (("velocity", velocity, "m/s"), ("stiffness_x", stiffness_x, "N/m"), ("mu_0", mu_0, "1"),
                ("normal_load", normal_load, "N"))  # fmt: skip
    given = {name: reals(name, value, above=0.0, units=units) for name, value, units in positive}
    stiff = reals("stiffness_y", stiffness_y, checked=False)
    # Infinity means a rigid axis.
    reals("stiffness_y", np.minimum(stiff, LARGEST), above=0.0, units="N/m")
    times = reals("t", t, least=0.0, units="s")
    phi = np.radians(reals("misalignment_deg", misalignment_deg, above=-90.0, below=90.0, units="deg"))
    shape_of(t=times, misalignment_deg=phi, stiffness_y=stiff, **given)
    speed, soft, friction_coefficient, load = given.values()
    with np.errstate(all="ignore"):
        friction = reals("mu_0 normal_load", friction_coefficient * load, least=SMALLEST, units="N")
        loading = reals("velocity stiffness_x", speed * soft, least=SMALLEST, units="N/s")
        rate = reals(
            "velocity stiffness_x/(mu_0 normal_load)", loading / friction, least=SMALLEST, units="1/s"
        )
        kappa = reals("stiffness_x/stiffness_y", soft / stiff, least=0.0, below=1.0)
        return times * rate, phi, kappa


def _evaluate(form: str, n_values: int, tau: ArrayLike, phi: ArrayLike, kappa: ArrayLike) -> _Floats:
    """Results of the core for each point, in the broadcast shape with the values first."""
    given = {
        name: reals(name, value, checked=False)
        for name, value in zip(("tau", "phi", "kappa"), (tau, phi, kappa), strict=True)
    }
    shape = shape_of(**given)
    if 0 in shape:
        return np.empty((n_values, *shape))
    points = (np.ascontiguousarray(np.broadcast_to(array, shape)).reshape(-1) for array in given.values())
    return _native.creep(form, n_values, *points).reshape(n_values, *shape)
