"""Predictions of the closed forms for a run, from the parameters of its deck."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..creep import Creep, creep_exact, dimensionless
from ..equations import friction_coefficient
from ..errors import UsageError
from ..result import Result
from ..spectrum import oscillation_frequency
from ..stability import damping_ratio
from ..stick_slip import drive_profile
from .notation import Floats

ALWAYS = ("mass", "stiffness_x", "stiffness_y", "mu_0", "normal_load", "velocity")
WEAKENING = ("mu_inf", "v_f")


def is_exponential(values: Mapping[str, object]) -> bool:
    """Whether the friction law of a deck with these values by key is constant or decreases exponentially."""
    law = values.get("law", "constant")
    plain = values.get("exponent", 1.0) == 1.0 and values.get("viscous", 0.0) == 0.0
    return law in ("constant", "weakening") or (law == "stribeck" and plain)


def slider(result: Result) -> dict[str, float]:
    """Keywords of `damping_ratio` and others [SI], for the friction law of the deck; a `UsageError` if one is missing."""
    parameters = _numbers(result, *ALWAYS, "misalignment_deg")
    # With another law only the curve for constant friction mu_0 W is drawn.
    if is_exponential(result.parameters) and all(name in result.parameters for name in WEAKENING):
        parameters |= _numbers(result, *WEAKENING)
    return parameters


def stiff_frequency(result: Result) -> float | None:
    """Frequency [Hz] of the stiff axis, the highest of the motion; None for a model without transverse motion."""
    system = _held(result, "mass", "stiffness_x", "stiffness_y")
    return None if system is None else float(max(oscillation_frequency([0.0, 0.5 * np.pi], **system)))


def scaled(result: Result, time: Floats) -> tuple[Floats, Floats, Floats]:
    """``tau = V t k_x/(mu_0 W)`` at some times [s], phi [rad] and kappa; a `UsageError` if the run has no such creep from a relaxed spring."""
    if any(float(result.parameters.get(name, 0.0)) for name in ("elongation_x", "elongation_y")):
        raise UsageError(
            "the closed form of creep starts from a relaxed spring: run without elongation_x, elongation_y"
        )
    given = _numbers(
        result, "velocity", "misalignment_deg", "stiffness_x", "stiffness_y", "mu_0", "normal_load"
    )
    return dimensionless(time, **given | {"velocity": abs(given["velocity"])})


def creep(result: Result, time: Floats) -> Creep:
    """Exact slow creep with the parameters of a run, at some times [s]; refused as by `scaled` and `creep_exact`."""
    return creep_exact(*scaled(result, time))


def static_limit(result: Result) -> float | None:
    """F_0 = mu_0 W [N]; None if the run does not contain it."""
    given = _held(result, "mu_0", "normal_load")
    return None if given is None else given["mu_0"] * given["normal_load"]


def steady_friction(result: Result) -> float | None:
    """F(V) [N], the friction in steady sliding; None where the drive is not constant, or the law is a table."""
    given = _held(result, "velocity", "mu_0", "normal_load")
    is_known = result.parameters.get("law", "constant") in ("constant", "weakening", "stribeck")
    if given is None or not is_known or given["velocity"] == 0.0:
        return None
    return given["normal_load"] * float(friction_coefficient(abs(given["velocity"]), result.parameters))


def driven_length(result: Result, time: Floats) -> Floats | None:
    """Integral of V [m] from 0 to some times [s]; None if the run does not contain V."""
    profile = drive_profile(result)
    if profile is None:
        given = _held(result, "velocity")
        return None if given is None else given["velocity"] * time
    # Between two of these times V is linear, so that its value in the middle gives the integral; the last velocity is held.
    knots = np.unique(np.concatenate([profile[0], time]))
    middle = 0.5 * (knots[1:] + knots[:-1])
    length = np.concatenate([[0.0], np.cumsum(np.interp(middle, *profile) * np.diff(knots))])
    return np.asarray(length[np.searchsorted(knots, time)])


def damping_crossing(parameters: Mapping[str, Any], level: float) -> float:
    """Largest angle [rad] at most 90 degrees where the damping ratio of `damping_ratio` passes a level; NaN if none."""

    def excess(theta: float | Floats) -> Floats:
        return damping_ratio(theta, **parameters) - level

    angles = np.geomspace(0.5 * np.pi, 1e-4, 2000)
    below = np.flatnonzero(np.diff(np.sign(excess(angles))))
    if below.size == 0:
        return float("nan")
    from scipy.optimize import brentq  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    return float(brentq(excess, angles[below[0] + 1], angles[below[0]], xtol=1e-15))


def _held(result: Result, *names: str) -> dict[str, float] | None:
    """Parameters of a run that are numbers, by name; None if it lacks one."""
    try:
        return _numbers(result, *names)
    except UsageError:
        return None


def _numbers(result: Result, *names: str) -> dict[str, float]:
    """The same, but a lack is refused."""
    held = result.parameters
    missing = [name for name in names if name not in held or np.ndim(held[name])]
    if missing:
        raise UsageError(
            f"the result lacks a value of {', '.join(missing)}, which this figure needs: "
            "run a deck with a constant drive velocity and a model that has it"
        )
    return {name: float(held[name]) for name in names}
