"""The equations of the model as functions of arrays; "Eq." refers to Nakano & Popov (2020)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arguments import SMALLEST, finite, number, reals
from ._slider import ANGLE, SliderParameters, slider_parameters
from .errors import UsageError
from .record import unit_shown
from .scene import DeckLike

COEFFICIENTS = {"mu_0": 0.0, "mu_inf": 0.0, "v_f": 1.0, "exponent": 1.0, "viscous": 0.0}
"""Coefficients of the friction laws, and their values where a law has none; mu_inf is then mu_0."""

LIMITS: dict[str, dict[str, Any]] = {
    **{name: {"above": 0.0} for name in ("mass", "stiffness_x", "stiffness_y")},
    **{
        name: {"least": 0.0}
        for name in ("mu_0", "mu_inf", "normal_load", "v_smooth", "damping_x", "damping_y")
    },
    "v_f": {"least": SMALLEST},
}
"""Limits of the parameters of a slider, as `_arguments.reals` takes them."""


def rhs(state: ArrayLike, scene: Any = None, **parameters: Unpack[SliderParameters]) -> NDArray[np.float64]:
    """Time derivative of the state, Eqs. (1)-(5).

    ``u' = V (cos phi, sin phi) - w`` and ``m w' = K u + C u' - F(v) w / sqrt(v^2 + v_smooth^2)`` with ``v = |w|``
    and ``F(v) = [mu_inf + (mu_0 - mu_inf) exp(-v/v_f)] W``.

    Parameters
    ----------
    state : array_like, shape (..., 4)
        Elongation of the spring ``u_x, u_y`` [m] and slip velocity ``w_x, w_y`` [m/s], in the principal
        axes. Any leading dimensions.
    scene : str, PathLike or Scene, optional
        A deck or a scene, for the parameters that are not given. If its drive keeps several velocities, `velocity` must be given.
    **parameters : float
        `mass` m [kg]; `stiffness_x`, `stiffness_y`: k_x, k_y [N/m] of the soft and the stiff principal axis; `misalignment_deg`:
        phi [deg], from the drive direction to the soft axis; `mu_0`, `mu_inf`: friction coefficients at rest and at high speed
        [-]; `v_f`: velocity over which friction weakens [m/s] (without `mu_inf` and `v_f` friction is constant); `normal_load`
        W [N]; `velocity`: drive velocity V [m/s]; `v_smooth`: smoothing velocity [m/s] of the direction of friction, 0 for the
        exact law; `damping_x`, `damping_y`: c_x, c_y [N s/m] of the dampers parallel to the springs.

    Returns
    -------
    ndarray, shape (..., 4), float64, C-contiguous
        ``u_x', u_y'`` [m/s] and ``w_x', w_y'`` [m/s2].

    Raises
    ------
    UsageError
        If the last dimension of `state` is not 4, an argument is not finite or out of its range (m, k_x, k_y, v_f > 0;
        mu_0, mu_inf, W, v_smooth, c_x, c_y >= 0), or only one of `mu_inf` and `v_f` is given. Also if a rate is not a
        number: with the exact law (`v_smooth` = 0) friction has no direction at ``w = 0``.
    """
    return _evaluated(_slider(scene, parameters), state, 1)[..., 0]


def jacobian(
    state: ArrayLike, scene: Any = None, **parameters: Unpack[SliderParameters]
) -> NDArray[np.float64]:
    """Derivative of `rhs` with respect to the state.

    Parameters
    ----------
    state, scene, **parameters
        As for `rhs`.

    Returns
    -------
    ndarray, shape (..., 4, 4), float64, C-contiguous
        ``[..., i, j]`` is the derivative of component i of the right-hand side with respect to component j of the state, in
        the SI unit of that quotient.

    Raises
    ------
    UsageError
        As for `rhs`.
    """
    return _evaluated(_slider(scene, parameters), state, 4)


def friction_coefficient(speed: ArrayLike, law: Mapping[str, Any]) -> NDArray[np.float64]:
    """``mu(v) = mu_inf + (mu_0 - mu_inf) exp(-(v/v_f)^exponent) + viscous v`` with those of these coefficients that are given [SI]."""
    given = {"mu_inf": law["mu_0"], **{name: law[name] for name in COEFFICIENTS if name in law}}
    mu_0, mu_inf, v_f, exponent, viscous = (COEFFICIENTS | given).values()
    v = np.asarray(speed)
    return np.asarray(mu_inf + (mu_0 - mu_inf) * np.exp(-((v / v_f) ** exponent)) + viscous * v)


def _evaluated(slider: NDArray[np.float64], state: ArrayLike, n_columns: int) -> NDArray[np.float64]:
    """The equations of the core at each state, with a last dimension for the columns."""
    states = np.ascontiguousarray(reals("state", state))
    if np.ndim(state) == 0 or states.shape[-1] != 4:
        raise UsageError(f"state of shape {np.shape(state)}: the last dimension is 4, for u_x, u_y, w_x, w_y")
    if states.size == 0:
        return np.empty((*states.shape, n_columns))
    given = np.concatenate([np.broadcast_to(slider, (*states.shape[:-1], slider.size)), states], axis=-1)
    what = "rhs" if n_columns == 1 else "jacobian"
    columns = _native.theory(what, 4 * n_columns, given.reshape(-1, slider.size + 4))
    # The core has a Jacobian by columns.
    rates = np.ascontiguousarray(columns.reshape(*states.shape[:-1], n_columns, 4).swapaxes(-1, -2))
    if not np.all(np.isfinite(rates)) and np.any(np.all(states[..., 2:] == 0.0, axis=-1)):
        raise UsageError(
            "w = 0, where friction has no direction with the exact law: give v_smooth > 0, or take such states out"
        )
    return finite("the result", rates)


def _slider(scene: DeckLike | None, given: Mapping[str, object]) -> NDArray[np.float64]:
    """The parameter vector of the core, from the arguments of a function."""
    slider = np.array([
        number(name, value, units=unit_shown(_native.key_info(_native.group_of(name), name).units), **LIMITS.get(name, {}))
        for name, value in slider_parameters(scene, given).items()
    ])  # fmt: skip
    slider[ANGLE] = np.radians(slider[ANGLE])
    return slider
