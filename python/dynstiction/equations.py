"""The equations of the model as functions of arrays (Nakano & Popov 2020, "Eq." as there)."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arguments import SMALLEST, finite, number, reals
from .errors import UsageError

__all__ = ["jacobian", "rhs", "slider_parameters"]

LIMITS: dict[str, dict[str, Any]] = {
    "mass": {"above": 0.0, "units": "kg"},
    "stiffness_x": {"above": 0.0, "units": "N/m"},
    "stiffness_y": {"above": 0.0, "units": "N/m"},
    "misalignment": {"units": "rad"},
    "mu_0": {"least": 0.0},
    "mu_inf": {"least": 0.0},
    "v_f": {"least": SMALLEST, "units": "m/s"},
    "normal_load": {"least": 0.0, "units": "N"},
    "velocity": {"units": "m/s"},
    "v_smooth": {"least": 0.0, "units": "m/s"},
    "damping_x": {"least": 0.0, "units": "N s/m"},
    "damping_y": {"least": 0.0, "units": "N s/m"},
}
"""Of the parameters of a slider, as `_arguments.reals` takes them."""


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
    damping_x: float = 0.0,
    damping_y: float = 0.0,
) -> NDArray[np.float64]:
    """Time derivative of the state, Eqs. (1)-(5).

    ``u' = V (cos phi, sin phi) - w`` and ``m w' = K u + C u' - F(v) w / sqrt(v^2 + v_smooth^2)`` with ``v = |w|``
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
    damping_x, damping_y : float
        c_x, c_y [N s/m] of the dampers beside the springs.

    Returns
    -------
    ndarray, shape (..., 4), float64, C-contiguous
        ``u_x', u_y'`` [m/s] and ``w_x', w_y'`` [m/s2].

    Raises
    ------
    UsageError
        If the last dimension of `state` is not 4, an argument is not finite or out of its range (m, k_x, k_y, v_f > 0;
        mu_0, mu_inf, W, v_smooth, c_x, c_y >= 0), or only one of `mu_inf` and `v_f` is given. If a rate is not a
        number: with the exact law (`v_smooth` = 0) friction has no direction at ``w = 0``.
    """
    slider = _slider(
        mass,
        stiffness_x,
        stiffness_y,
        misalignment,
        mu_0,
        mu_inf,
        v_f,
        normal_load,
        velocity,
        v_smooth,
        damping_x,
        damping_y,
    )
    return _evaluated(slider, state, 1)[..., 0]


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
    damping_x: float = 0.0,
    damping_y: float = 0.0,
) -> NDArray[np.float64]:
    """Derivative of `rhs` by the state.

    Parameters
    ----------
    state : array_like, shape (..., 4)
        ``u_x, u_y`` [m], ``w_x, w_y`` [m/s], as for `rhs`.
    mass, stiffness_x, stiffness_y, misalignment, mu_0, mu_inf, v_f, normal_load, velocity, v_smooth, damping_x, damping_y : float
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
    slider = _slider(
        mass,
        stiffness_x,
        stiffness_y,
        misalignment,
        mu_0,
        mu_inf,
        v_f,
        normal_load,
        velocity,
        v_smooth,
        damping_x,
        damping_y,
    )
    return _evaluated(slider, state, 4)


def _evaluated(slider: NDArray[np.float64], state: ArrayLike, n_columns: int) -> NDArray[np.float64]:
    """The equations of the core at each state, with a last dimension for the columns."""
    states = np.ascontiguousarray(reals("state", state))
    if np.ndim(state) == 0 or states.shape[-1] != 4:
        raise UsageError(f"state of shape {np.shape(state)}: the last dimension is 4, for u_x, u_y, w_x, w_y")
    if states.size == 0:
        return np.empty((*states.shape, n_columns))
    rates = _native.equations(slider, states.reshape(-1, 4), n_columns).reshape(*states.shape, n_columns)
    if not np.all(np.isfinite(rates)) and np.any(np.all(states[..., 2:] == 0.0, axis=-1)):
        raise UsageError(
            "w = 0, where friction has no direction with the exact law: give v_smooth > 0, or take such states out"
        )
    return finite("the result", rates)


def _slider(*values: float | None) -> NDArray[np.float64]:
    """The parameter vector of the core."""
    return np.array(
        [number(name, value, **LIMITS[name]) for name, value in slider_parameters(*values).items()]
    )


def slider_parameters(*values: ArrayLike | None) -> dict[str, ArrayLike]:
    """Parameters of sliders by name, from all of them in the order of the core; `mu_inf` and `v_f` belong together.

    Without these two friction is constant.
    """
    given = dict(zip(_native.slider_parameters(), values, strict=True))
    if (given["mu_inf"] is None) != (given["v_f"] is None):
        raise UsageError("mu_inf and v_f belong together: both for weakening friction, neither for constant")
    if given["mu_inf"] is None:
        given |= {"mu_inf": given["mu_0"], "v_f": 1.0}
    return cast(dict[str, ArrayLike], given)
