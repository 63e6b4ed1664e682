"""Linear theory of steady sliding and of slow creep, for arrays of parameters (docs/theory_stability.md).

Every parameter may be a number or an array; arrays broadcast against each other as in numpy.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arguments import reals, shape_of
from ._slider import SliderParameters, slider_parameters
from .scene import DeckLike, Scene

UNDAMPED: Any = {"v_smooth": 0.0, "damping_x": 0.0, "damping_y": 0.0}


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
    scene: DeckLike | None = None, /, **parameters: Unpack[SliderParameters]
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
    **parameters : array_like
        As for `rhs`; V must not be 0. Arrays broadcast.

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
    if scene is not None and not _given(parameters):
        with _native.Steady(Scene(scene).source) as found:
            return found.eigenvalues
    parts = _theory("eigenvalues", 8, scene, parameters)
    return parts[..., :4] + 1j * parts[..., 4:]


def critical_misalignment(
    scene: DeckLike | None = None, /, **parameters: Unpack[SliderParameters]
) -> CriticalMisalignment:
    """Misalignments between 0 and 90 degrees at which the stability of steady sliding changes.

    With weakening friction there are two, one for each branch, if ``|F'| < F/V`` and
    ``|F'| F/V < m (sqrt(k_y) - sqrt(k_x))^2`` at V; otherwise none, and steady sliding is unstable at every angle.
    With constant or strengthening friction there are none, and steady sliding is stable at every angle in between. With dampers
    one branch may have an angle and the other none.

    Parameters
    ----------
    scene, **parameters
        As for `steady_sliding_eigenvalues`; `misalignment_deg` may be missing, and has an effect on the shape only.

    Returns
    -------
    CriticalMisalignment
        Angles [deg], frequencies [rad/s], window [deg] and rigid limit [deg], from closed forms.

    Raises
    ------
    UsageError
        As for `steady_sliding_eigenvalues`.
    """
    if scene is not None and not _given(parameters):
        with _native.Steady(Scene(scene).source) as found:
            return _critical(found.critical)
    if scene is None and parameters.get("misalignment_deg") is None:
        parameters["misalignment_deg"] = 0.0
    return _critical(_theory("critical", 9, scene, parameters))


def _critical(values: NDArray[np.float64]) -> CriticalMisalignment:
    """Critical misalignments (..., 9), from the core."""
    exists, angle, frequency, window, limit = np.split(values, [2, 4, 6, 8], axis=-1)
    return CriticalMisalignment(
        np.where(exists == 1.0, np.degrees(angle), np.nan),
        np.where(exists == 1.0, frequency, np.nan),
        np.where(window[..., 1:] > window[..., :1], np.degrees(window), np.nan),
        np.degrees(limit[..., 0]),
    )


def creep_end(scene: DeckLike | None = None, /, **parameters: Unpack[SliderParameters]) -> CreepEnd:
    """Where slow creep ends in slip, and how far the fast oscillation has decayed by then.

    During creep ``v = V sin(phi)/sin(theta)`` and ``k_x u_x = F(v) cos(theta)``; creep ends at the maximum of k_x u_x. The fast
    oscillation grows at ``sigma = [-F'(v)/m - v k_y cos^2(theta)/F(v)]/2``; D is the integral of ``-sigma`` over the time
    from its zero to the end. Where D is large, slip does not depend on the fast oscillation; where D is small, slow cycles
    need not repeat.

    Parameters
    ----------
    scene, **parameters
        As for `steady_sliding_eigenvalues`, without smoothing velocity and dampers.

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
    exists, *values = np.moveaxis(_theory("creep_end", 5, scene, parameters, **UNDAMPED), -1, 0)
    return CreepEnd(*(np.where(exists == 1.0, column, np.nan) for column in values))


def damping_ratio(
    theta: ArrayLike, scene: DeckLike | None = None, **parameters: Unpack[SliderParameters]
) -> NDArray[np.float64]:
    """Damping ratio of the slow motion while friction points along theta, Eq. (10).

    Constant friction: ``zeta = Lambda |sin theta|^3``, ``Lambda = mu_0 W / (2 V sin(phi) sqrt(m k_x))``.
    With `mu_inf` and `v_f`: ``zeta = [F'(v) cos^2 theta + F(v) |sin theta|^3 / (V sin phi)] / (2 sqrt(m k_x))``
    at ``v = V sin(phi) / sin(theta)``.

    Parameters
    ----------
    theta : array_like
        Angle [rad] from the soft axis to the friction; broadcasts with the parameters.
    scene, **parameters
        As for `creep_end`; `stiffness_y` may be missing, and has an effect on the shape only: the stiff axis is taken as rigid.

    Returns
    -------
    ndarray, shape (...), float64
        zeta [-]: above 1 the slow motion creeps, below 0 it grows.

    Raises
    ------
    UsageError
        As for `steady_sliding_eigenvalues`; also if ``V sin(phi) = 0``.
    """
    if parameters.get("stiffness_y") is None:
        parameters["stiffness_y"] = 1.0
    angles = reals("theta", theta, units="rad")
    return _theory("damping", 1, scene, parameters, angles, **UNDAMPED)[..., 0]


def _given(parameters: SliderParameters) -> bool:
    return any(value is not None for value in parameters.values())


def _theory(
    what: str,
    n_values: int,
    scene: DeckLike | None,
    given: SliderParameters,
    theta: NDArray[np.float64] | None = None,
    **fixed: float,
) -> NDArray[np.float64]:
    """Values (..., n_values) of the core's linear theory, from the arguments of a function."""
    # The core checks the ranges.
    arrays = {
        name: reals(name, value, checked=False)
        for name, value in slider_parameters(scene, given, **fixed).items()
    }
    arrays["misalignment_deg"] = np.radians(arrays["misalignment_deg"])
    shape = shape_of(**arrays, **({} if theta is None else {"theta": theta}))
    rows = np.stack([np.broadcast_to(array, shape).reshape(-1) for array in arrays.values()], axis=1)
    if theta is not None:
        rows = np.column_stack([rows, np.broadcast_to(theta, shape).reshape(-1)])
        if given.get("mu_inf") is not None or np.any(arrays["mu_0"] != arrays["mu_inf"]):
            what = "weakening"
    return _native.theory(what, n_values, np.ascontiguousarray(rows)).reshape(*shape, n_values)
