"""What the closed forms say of a run, from the parameters of its deck."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..creep import Creep, creep_exact
from ..errors import UsageError
from ..result import Result
from ..spectrum import oscillation_frequency
from ..stability import damping_ratio
from .samples import Floats

__all__ = ["creep", "damping_crossing", "is_exponential", "scaled_time", "slider", "stiff_frequency"]

ALWAYS = ("mass", "stiffness_x", "stiffness_y", "mu_0", "normal_load", "velocity")
WEAKENING = ("mu_inf", "v_f")


def is_exponential(values: Mapping[str, object]) -> bool:
    """Whether the friction law of a deck with these values by key is constant, or falls exponentially."""
    law = values.get("law", "constant")
    plain = values.get("exponent", 1.0) == 1.0 and values.get("viscous", 0.0) == 0.0
    return law in ("constant", "weakening") or (law == "stribeck" and plain)


def slider(result: Result) -> dict[str, float]:
    """Keywords of `damping_ratio` and its like [SI], of the friction law as the deck has it; a `UsageError` if one is missing."""
    parameters = _numbers(result, *ALWAYS, "misalignment_deg")
    parameters["misalignment"] = np.radians(parameters.pop("misalignment_deg"))
    # With another law the curve of friction held at mu_0 W remains.
    if is_exponential(result.parameters) and all(name in result.parameters for name in WEAKENING):
        parameters |= _numbers(result, *WEAKENING)
    return parameters


def stiff_frequency(result: Result) -> float | None:
    """Frequency [Hz] of the stiff axis, the highest of the motion; None for a model without transverse motion."""
    try:
        system = _numbers(result, "mass", "stiffness_x", "stiffness_y")
    except UsageError:
        return None
    return float(max(oscillation_frequency([0.0, 0.5 * np.pi], **system)))


def scaled_time(result: Result, time: Floats) -> Floats:
    """``tau = V t k_x/(mu_0 W)`` at some times [s]; a `UsageError` if the run is no creep from a relaxed spring."""
    given = _numbers(result, "velocity", "stiffness_x", "mu_0", "normal_load")
    elongation = [float(result.parameters.get(name, 0.0)) for name in ("elongation_x", "elongation_y")]
    friction = given["mu_0"] * given["normal_load"]
    if any(elongation) or given["velocity"] == 0.0 or friction == 0.0:
        raise UsageError(
            "the closed form of creep starts from a relaxed spring, with friction, under a constant drive velocity: "
            "run a deck without elongation_x and elongation_y, and with mu_0, normal_load and velocity not 0"
        )
    return np.asarray(abs(given["velocity"]) * time * given["stiffness_x"] / friction)


def creep(result: Result, time: Floats) -> Creep:
    """Exact slow creep with the parameters of a run, at some times [s]; refused as by `scaled_time` and `creep_exact`."""
    system = _numbers(result, "misalignment_deg", "stiffness_x", "stiffness_y")
    kappa = system["stiffness_x"] / system["stiffness_y"]
    return creep_exact(scaled_time(result, time), np.radians(system["misalignment_deg"]), kappa)


def damping_crossing(parameters: Mapping[str, float], level: float) -> float:
    """Largest angle [rad] at most 90 degrees where the damping ratio of `damping_ratio` passes a level; NaN if none."""
    from scipy.optimize import brentq  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    def excess(theta: float | Floats) -> Floats:
        return damping_ratio(theta, **parameters) - level

    angles = np.geomspace(0.5 * np.pi, 1e-4, 2000)
    below = np.flatnonzero(np.diff(np.sign(excess(angles))))
    if below.size == 0:
        return float("nan")
    return float(brentq(excess, angles[below[0] + 1], angles[below[0]], xtol=1e-12))


def _numbers(result: Result, *names: str) -> dict[str, float]:
    missing = [
        name for name in names if np.ndim(result.parameters.get(name, "")) or name not in result.parameters
    ]
    if missing:
        raise UsageError(
            f"the result lacks a value of {', '.join(missing)}, which this figure needs: "
            "run a deck with a constant drive velocity and a model that has it"
        )
    return {name: float(result.parameters[name]) for name in names}
