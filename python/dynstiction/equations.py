"""The equations of the model as functions of arrays (Nakano & Popov 2020, "Eq." as there)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from .errors import UsageError

__all__ = ["jacobian", "rhs"]


def rhs(
    state: ArrayLike,
    *,
    mass: float,
    stiffness_x: float,
    stiffness_y: float,
    misalignment: float,
    mu_0: float,
    mu_inf: float | None = None,
    v_f: float | None = None,
    normal_load: float,
    velocity: float,
    v_smooth: float = 0.0,
) -> NDArray[np.float64]:
    """Time derivative of the state, Eqs. (1)-(5).

    ``u' = V (cos phi, sin phi) - w`` and ``m w' = K u - F(v) w / sqrt(v^2 + v_smooth^2)`` with ``v = |w|``
    and ``F(v) = [mu_inf + (mu_0 - mu_inf) exp(-v/v_f)] W``.

    Parameters
    ----------
    state : array_like, shape (..., 4)
        Elongation of the spring ``u_x, u_y`` [m] and slip velocity ``w_x, w_y`` [m/s], in the principal
        axes. Any leading dimensions.
    mass : float
        m [kg].
    stiffness_x, stiffness_y : float
        k_x, k_y [N/m] of the soft and the stiff principal axis.
    misalignment : float
        phi [rad], from the drive direction to the soft axis.
    mu_0, mu_inf : float
        Friction coefficients at rest and at high speed [-]. Without `mu_inf` friction is constant.
    v_f : float
        Velocity over which friction weakens [m/s], with `mu_inf`.
    normal_load : float
        W [N].
    velocity : float
        V [m/s], of the drive.
    v_smooth : float
        Smoothing velocity [m/s] of the direction of friction; 0 for the exact law.

    Returns
    -------
    ndarray, shape (..., 4), float64, C-contiguous
        ``u_x', u_y'`` [m/s] and ``w_x', w_y'`` [m/s2].

    Raises
    ------
    UsageError
        If the last dimension of `state` is not 4, or only one of `mu_inf` and `v_f` is given.

    Notes
    -----
    With the exact law the direction of friction has no value at ``w = 0``.
    """
    states = _states(state)
    slider = _slider(
        mass, stiffness_x, stiffness_y, misalignment, mu_0, mu_inf, v_f, normal_load, velocity, v_smooth
    )
    if states.size == 0:
        return np.empty(states.shape)
    return _native.rhs(slider, states.reshape(-1, 4)).reshape(states.shape)


def jacobian(
    state: ArrayLike,
    *,
    mass: float,
    stiffness_x: float,
    stiffness_y: float,
    misalignment: float,
    mu_0: float,
    mu_inf: float | None = None,
    v_f: float | None = None,
    normal_load: float,
    velocity: float,
    v_smooth: float = 0.0,
) -> NDArray[np.float64]:
    """Derivative of `rhs` by the state.

    Parameters
    ----------
    state : array_like, shape (..., 4)
        ``u_x, u_y`` [m], ``w_x, w_y`` [m/s], as for `rhs`.
    mass, stiffness_x, stiffness_y, misalignment, mu_0, mu_inf, v_f, normal_load, velocity, v_smooth : float
        As for `rhs`.

    Returns
    -------
    ndarray, shape (..., 4, 4), float64, C-contiguous
        ``[..., i, j]`` = derivative of component i of the right-hand side by component j of the state, in
        the SI unit of that quotient.

    Raises
    ------
    UsageError
        As for `rhs`.
    """
    states = _states(state)
    slider = _slider(
        mass, stiffness_x, stiffness_y, misalignment, mu_0, mu_inf, v_f, normal_load, velocity, v_smooth
    )
    shape = (*states.shape, 4)
    if states.size == 0:
        return np.empty(shape)
    return _native.jacobian(slider, states.reshape(-1, 4)).reshape(shape)


def _states(state: ArrayLike) -> NDArray[np.float64]:
    states = np.ascontiguousarray(state, dtype=np.float64)
    if states.shape[-1] != 4:
        raise UsageError(f"state of shape {states.shape}: the last dimension is 4, for u_x, u_y, w_x, w_y")
    return states


def _slider(
    mass: float,
    stiffness_x: float,
    stiffness_y: float,
    misalignment: float,
    mu_0: float,
    mu_inf: float | None,
    v_f: float | None,
    normal_load: float,
    velocity: float,
    v_smooth: float,
) -> NDArray[np.float64]:
    """The parameter vector of the core's flat routines."""
    if (mu_inf is None) != (v_f is None):
        raise UsageError("mu_inf and v_f belong together: both for weakening friction, neither for constant")
    if mu_inf is None or v_f is None:
        mu_inf, v_f = mu_0, 1.0
    return np.array(
        [mass, stiffness_x, stiffness_y, misalignment, mu_0, mu_inf, v_f, normal_load, velocity, v_smooth],
        dtype=np.float64,
    )
