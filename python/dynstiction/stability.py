"""Linear theory of steady sliding and of slow creep, for arrays of parameters (docs/theory_stability.md).

Every parameter may be a number or an array; arrays broadcast against each other as in numpy.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arguments import reals, shape_of
from ._slider import for_the_core, slider_parameters
from .scene import DeckLike, Scene

__all__ = [
    "CreepEnd",
    "CriticalMisalignment",
    "Stability",
    "creep_end",
    "critical_misalignment",
    "damping_ratio",
    "stability",
    "steady_sliding_eigenvalues",
]


UNDAMPED = {"v_smooth": 0.0, "damping_x": 0.0, "damping_y": 0.0}


class CriticalMisalignment(NamedTuple):
    """Where steady sliding gains and loses its stability; ``...`` is the broadcast shape of the parameters.

    The last dimension of `angle` and `frequency` is the branch: 0 the slow mode (a Hopf bifurcation near
    the frequency of the soft axis), 1 the fast mode (near that of the stiff axis).
    """

    angle: NDArray[np.float64]
    """Critical angles [deg] between 0 and 90, shape (..., 2); NaN where there is none."""
    frequency: NDArray[np.float64]
    """Angular frequency [rad/s] of the oscillation at the critical angles, shape (..., 2)."""
    window: NDArray[np.float64]
    """Steady sliding is stable between these angles [deg], shape (..., 2); NaN where it is stable at no angle."""
    limit: NDArray[np.float64]
    """Critical angle [deg] of the slow mode in the limit of infinite ``k_y``, shape (...); 0 if friction does not weaken."""


class CreepEnd(NamedTuple):
    """Where slow creep ends in slip; NaN where it does not. ``...`` is the broadcast shape of the parameters."""

    angle: NDArray[np.float64]
    """Angle [rad] from the soft axis to the friction, shape (...)."""
    speed: NDArray[np.float64]
    """Mean slip speed [m/s], shape (...)."""
    load: NDArray[np.float64]
    """Largest ``|k_x u_x|`` [N] that quasi-static creep reaches, shape (...)."""
    decay: NDArray[np.float64]
    """D [-]: the fast oscillation decays by a factor ``exp(-D)`` before slip; 0 if it grows until slip. Shape (...)."""


class Stability(NamedTuple):
    """Steady sliding of one scene: what `Scene.stability` returns."""

    stable: bool
    """Whether every disturbance decays, so that steady sliding can be seen."""
    velocity: float
    """Drive velocity |V| [m/s] of this analysis: the only one that the drive keeps and that is not 0."""
    misalignment_deg: float
    """Misalignment of the scene [deg]."""
    critical_misalignment_deg: float
    """Misalignment [deg] above which steady sliding is stable at this velocity; NaN if it is stable at no angle."""
    eigenvalues: NDArray[np.complex128]
    """Eigenvalues of a small disturbance [1/s], by decreasing real part; shape (4,)."""

    def __str__(self) -> str:
        verdict = "stable" if self.stable else "unstable"
        above = f"stable above {self.critical_misalignment_deg:.4g} deg"
        return (
            f"steady sliding at V = {self.velocity:g} m/s, phi = {self.misalignment_deg:g} deg is {verdict} "
            f"({'stable at no angle' if np.isnan(self.critical_misalignment_deg) else above})"
        )


def stability(scene: Scene) -> Stability:
    """Whether steady sliding of a scene is stable; see `Scene.stability`."""
    with _native.Steady(scene.source) as found:
        return Stability(
            bool(np.all(found.eigenvalues.real < 0.0)),
            found.velocity,
            float(np.degrees(found.misalignment)),
            float(_critical(found.critical).window[0]),
            found.eigenvalues,
        )


def steady_sliding_eigenvalues(
    scene: DeckLike | None = None,
    /,
    *,
    mass: ArrayLike | None = None,
    stiffness_x: ArrayLike | None = None,
    stiffness_y: ArrayLike | None = None,
    misalignment_deg: ArrayLike | None = None,
    mu_0: ArrayLike | None = None,
    mu_inf: ArrayLike | None = None,
    v_f: ArrayLike | None = None,
    normal_load: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    v_smooth: ArrayLike | None = None,
    damping_x: ArrayLike | None = None,
    damping_y: ArrayLike | None = None,
) -> NDArray[np.complex128]:
    """Eigenvalues of a perturbation of steady sliding.

    ``m u'' + D u' + K u = 0`` with ``D = F'(V) s s^T + F(V)/V n n^T + C``, ``s = (cos phi, sin phi)``, n normal
    to s, ``C = diag(c_x, c_y)``, and ``F(v) = [mu_inf + (mu_0 - mu_inf) exp(-v/v_f)] W``. Steady sliding is stable if
    all real parts are negative.

    Parameters
    ----------
    scene : str, PathLike or Scene, optional
        A deck or a scene, for the parameters that are not given. If its drive keeps several velocities, `velocity` must be given.
        Without keywords the scene may have any friction law, with keywords only constant or weakening friction.
    mass, stiffness_x, stiffness_y, misalignment_deg, mu_0, mu_inf, v_f, normal_load, velocity, v_smooth : array_like
        As for `rhs`: m [kg], k_x, k_y [N/m], phi [deg], friction coefficients, v_f [m/s], W [N], V [m/s], which must not be
        0, and the smoothing velocity [m/s].
    damping_x, damping_y : array_like
        c_x, c_y [N s/m] of the dampers parallel to the springs.

    Returns
    -------
    ndarray, shape (..., 4), complex128, C-contiguous
        Eigenvalues [1/s] by decreasing real part; of a pair, the one with the positive imaginary part is first.

    Raises
    ------
    UsageError
        If a parameter is out of its range or is not a number, if the parameters do not broadcast, if only one of `mu_inf` and
        `v_f` is given, or if a result is beyond the range of double precision.

    Notes
    -----
    Computed by LAPACK; the error is about 1e-16 times the largest eigenvalue, so the sign of a real part
    far below that has no meaning. `critical_misalignment` has no such limit.
    """
    given = locals()
    if _is_alone(given):
        with _native.Steady(Scene(given["scene"]).source) as found:
            return found.eigenvalues
    sliders, shape = _sliders(given)
    parts = _native.steady_sliding("eigenvalues", 8, sliders)
    return (parts[:, :4] + 1j * parts[:, 4:]).reshape(*shape, 4)


def critical_misalignment(
    scene: DeckLike | None = None,
    /,
    *,
    mass: ArrayLike | None = None,
    stiffness_x: ArrayLike | None = None,
    stiffness_y: ArrayLike | None = None,
    misalignment_deg: ArrayLike | None = None,
    mu_0: ArrayLike | None = None,
    mu_inf: ArrayLike | None = None,
    v_f: ArrayLike | None = None,
    normal_load: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    v_smooth: ArrayLike | None = None,
    damping_x: ArrayLike | None = None,
    damping_y: ArrayLike | None = None,
) -> CriticalMisalignment:
    """Misalignments between 0 and 90 degrees at which the stability of steady sliding changes.

    With weakening friction there are two, one for each branch, if ``|F'| < F/V`` and
    ``|F'| F/V < m (sqrt(k_y) - sqrt(k_x))^2`` at V; otherwise none, and steady sliding is unstable at every angle.
    With constant or strengthening friction there are none, and steady sliding is stable at every angle in between. With dampers
    one branch may have an angle and the other none.

    Parameters
    ----------
    scene : str, PathLike or Scene, optional
        As for `steady_sliding_eigenvalues`.
    mass, stiffness_x, stiffness_y, mu_0, mu_inf, v_f, normal_load, velocity, v_smooth, damping_x, damping_y : array_like
        As for `steady_sliding_eigenvalues`.
    misalignment_deg : array_like
        Has an effect on the shape only. It is accepted so that the same keywords can be used as for `steady_sliding_eigenvalues`.

    Returns
    -------
    CriticalMisalignment
        Angles [deg], frequencies [rad/s], window [deg] and rigid limit [deg], from closed forms.

    Raises
    ------
    UsageError
        As for `steady_sliding_eigenvalues`.
    """
    given = locals()
    if _is_alone(given):
        with _native.Steady(Scene(given["scene"]).source) as found:
            return _critical(found.critical)
    if scene is None and misalignment_deg is None:
        given["misalignment_deg"] = 0.0
    sliders, shape = _sliders(given)
    return _critical(_native.steady_sliding("critical", 9, sliders).reshape(*shape, 9))


def _critical(values: NDArray[np.float64]) -> CriticalMisalignment:
    """Critical misalignments (..., 9), from the core."""
    exists, angle, frequency, window, limit = np.split(values, [2, 4, 6, 8], axis=-1)
    return CriticalMisalignment(
        np.where(exists == 1.0, np.degrees(angle), np.nan),
        np.where(exists == 1.0, frequency, np.nan),
        np.where(window[..., 1:] > window[..., :1], np.degrees(window), np.nan),
        np.degrees(limit[..., 0]),
    )


def creep_end(
    scene: DeckLike | None = None,
    /,
    *,
    mass: ArrayLike | None = None,
    stiffness_x: ArrayLike | None = None,
    stiffness_y: ArrayLike | None = None,
    misalignment_deg: ArrayLike | None = None,
    mu_0: ArrayLike | None = None,
    mu_inf: ArrayLike | None = None,
    v_f: ArrayLike | None = None,
    normal_load: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
) -> CreepEnd:
    """Where slow creep ends in slip, and how far the fast oscillation has decayed by then.

    During creep ``v = V sin(phi)/sin(theta)`` and ``k_x u_x = F(v) cos(theta)``; creep ends at the maximum of k_x u_x. The fast
    oscillation grows at ``sigma = [-F'(v)/m - v k_y cos^2(theta)/F(v)]/2``; D is the integral of ``-sigma`` over the time
    from its zero to the end. Where D is large, slip does not depend on the fast oscillation; where D is small, slow cycles
    need not repeat.

    Parameters
    ----------
    scene : str, PathLike or Scene, optional
        As for `steady_sliding_eigenvalues`.
    mass, stiffness_x, stiffness_y, misalignment_deg, mu_0, mu_inf, v_f, normal_load, velocity : array_like
        As for `steady_sliding_eigenvalues`.

    Returns
    -------
    CreepEnd
        Angle [rad], speed [m/s], load [N] and decay [-]. NaN where friction does not weaken, where the misalignment is a
        multiple of pi/2, and where creep becomes steady sliding.

    Raises
    ------
    UsageError
        As for `steady_sliding_eigenvalues`.
    """
    sliders, shape = _sliders(locals() | UNDAMPED)
    values = _native.steady_sliding("creep_end", 5, sliders)
    exists = values[:, 0] == 1.0
    return CreepEnd(*(np.where(exists, column, np.nan).reshape(shape) for column in values.T[1:]))


def damping_ratio(
    theta: ArrayLike,
    scene: Any = None,
    *,
    mass: ArrayLike | None = None,
    stiffness_x: ArrayLike | None = None,
    stiffness_y: ArrayLike | None = None,
    misalignment_deg: ArrayLike | None = None,
    mu_0: ArrayLike | None = None,
    mu_inf: ArrayLike | None = None,
    v_f: ArrayLike | None = None,
    normal_load: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Damping ratio of the slow motion while friction points along theta, Eq. (10).

    Constant friction: ``zeta = Lambda |sin theta|^3``, ``Lambda = mu_0 W / (2 V sin(phi) sqrt(m k_x))``.
    With `mu_inf` and `v_f`: ``zeta = [F'(v) cos^2 theta + F(v) |sin theta|^3 / (V sin phi)] / (2 sqrt(m k_x))``
    at ``v = V sin(phi) / sin(theta)``.

    Parameters
    ----------
    theta : array_like
        Angle [rad] from the soft axis to the friction; broadcasts with the parameters.
    scene : str, PathLike or Scene, optional
        As for `steady_sliding_eigenvalues`.
    mass, stiffness_x, misalignment_deg, mu_0, mu_inf, v_f, normal_load, velocity : array_like
        As for `steady_sliding_eigenvalues`; ``V sin(phi)`` must not be 0.
    stiffness_y : array_like
        Has an effect on the shape only: the stiff axis is taken as rigid.

    Returns
    -------
    ndarray, shape (...), float64
        zeta [-]: above 1 the slow motion creeps, below 0 it grows.

    Raises
    ------
    UsageError
        As for `steady_sliding_eigenvalues`; also if ``V sin(phi) = 0``.
    """
    given = locals() | UNDAMPED | {"stiffness_y": 1.0 if stiffness_y is None else stiffness_y}
    angles = reals("theta", theta, units="rad")
    sliders, shape = _sliders(given, theta=angles)
    every_angle = np.broadcast_to(angles, shape).reshape(-1)
    weakens = np.any(sliders[:, 4] != sliders[:, 5])
    what = "weakening" if mu_inf is not None or weakens else "damping"
    return _native.steady_sliding(what, 1, sliders, every_angle).reshape(shape)


def _is_alone(given: Mapping[str, Any]) -> bool:
    """Whether a scene is given, and no parameter besides."""
    return [name for name, value in given.items() if value is not None] == ["scene"]


def _sliders(
    given: Mapping[str, Any], **others: NDArray[np.float64]
) -> tuple[NDArray[np.float64], tuple[int, ...]]:
    """Parameter rows of the core, from the arguments of a function, and the shape that they and `others` broadcast to."""
    # The core checks the ranges.
    parameters = {
        name: for_the_core(name, reals(name, value, checked=False))
        for name, value in slider_parameters(given["scene"], given).items()
    }
    shape = shape_of(**parameters, **others)
    rows = np.stack([np.broadcast_to(array, shape).reshape(-1) for array in parameters.values()], axis=1)
    return np.ascontiguousarray(rows), shape
