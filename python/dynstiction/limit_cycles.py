"""Limit cycles, and where stick-slip ends, without runs (docs/cycles.md, docs/closed_laws.md)."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from .scene import DeckLike, Scene

__all__ = ["Cycles", "End", "LimitCycle", "Regularity", "StickSlipEnds", "cycles", "stick_slip_ends"]


class LimitCycle(NamedTuple):
    """A stick-slip cycle that repeats itself. Loads are k_x u_x, positive where the drive pulls."""

    period: float
    """Time from peak to peak of the load [s]."""
    peak_force: float
    """Peak of the load [N]: of a stable cycle the apparent static friction."""
    valley_force: float
    """Valley of the load [N]."""
    stick_duration: float
    """Time from valley to peak [s]."""
    slip_duration: float
    """Time from peak to valley [s]."""
    slip_length: float
    """Advance in X from peak to valley [m], positive with the drive."""
    swing: float
    """Peak less valley [N]."""
    log_multiplier: float
    """Logarithm of the factor by which a cycle makes a small disturbance larger [-]; NaN where it is not known."""
    stable: bool
    """Whether the object can stay at it."""

    @property
    def multiplier(self) -> float:
        """Factor by which a cycle makes a small disturbance larger [-]; 0 if it is below the smallest number."""
        return math.exp(min(self.log_multiplier, 700.0))


class Regularity(NamedTuple):
    """What the motion of a scene is like, from its own beginning on."""

    verdict: Literal["regular", "irregular", "undecided"]
    """Whether it comes to a cycle; if it is irregular, its cycles have a distribution and not a value."""
    exponent: float
    """Lyapunov exponent for a slow cycle [-]."""
    error: float
    """Its standard error."""
    slow_cycles: int
    """Over how many slow cycles."""
    mean: dict[str, float]
    """Mean of period, peak_force, ..., over the later half of the cycles; empty if there are none."""
    scatter: dict[str, float]
    """Their standard deviations."""


class Cycles(NamedTuple):
    """Every limit cycle of a scene, and steady sliding beside them."""

    model: str
    velocity: float
    """Drive velocity |V| [m/s]."""
    cycles: tuple[LimitCycle, ...]
    """By growing swing."""
    sliding_load: float
    """k_x u_x in steady sliding [N]."""
    sliding_is_stable: bool
    eigenvalues: NDArray[np.complex128]
    """Of a small disturbance of steady sliding [1/s], by falling real part; shape (2,), of the full model (4,)."""
    regularity: Regularity | None
    """Of the full model."""

    @property
    def stable(self) -> tuple[LimitCycle, ...]:
        """The cycles at which the object can stay."""
        return tuple(cycle for cycle in self.cycles if cycle.stable)

    @property
    def unstable(self) -> tuple[LimitCycle, ...]:
        """The others. One inside of which steady sliding is stable bounds what comes to it."""
        return tuple(cycle for cycle in self.cycles if not cycle.stable)


class End(NamedTuple):
    """Where stick-slip ends."""

    at: float
    """Misalignment [rad] or drive velocity [m/s]."""
    is_fold: bool
    """Whether a stable and an unstable cycle meet there; if not, the swing is 5 % of mu_0 W there."""


class StickSlipEnds(NamedTuple):
    """Where the stick-slip of the slow motion ends. What does not exist is None."""

    critical_misalignment: float | None
    """Where steady sliding gains its stability at the scene's velocity [rad]; None if friction does not weaken."""
    is_supercritical: bool | None
    """Whether the small cycles that begin there are stable."""
    misalignment: End | None
    """Where stick-slip ends at the scene's velocity."""
    critical_velocity: tuple[float, float] | None
    """Between which velocities steady sliding is unstable at the scene's misalignment [m/s]."""
    velocity: tuple[End | None, End | None]
    """Between which velocities there is stick-slip at the scene's misalignment."""
    bautin_point: tuple[float, float] | None
    """V [m/s] and phi [rad] at which small cycles change from stable to unstable."""
    slow_drive_law: float | None
    """Misalignment [rad] of the canard, in three orders."""
    slow_drive_doubt: float | None
    """The last term of its series over the sum [-]."""
    fast_drive_law: float | None
    """Misalignment [rad] at which harmonic swings end."""
    fast_drive_doubt: float | None
    """The largest damping ratio in such a swing [-]."""


def cycles(scene: DeckLike, *, model: str = "") -> Cycles:
    """Every limit cycle of a scene, stable and unstable.

    Parameters
    ----------
    scene : str, PathLike or Scene
        A deck or a scene. Of a drive with several velocities the first one counts that is held and is not 0.
    model : str
        Whose cycles; default: the scene's own model, which has to be 'full' or 'low_frequency'.

    Returns
    -------
    Cycles
        The cycles by growing swing, and steady sliding.

    Raises
    ------
    DeckError, FileError
        As for `dynstiction.run`; also if the misalignment is a multiple of 90 degrees, or the contact of the full model is smoothed.
    UsageError
        If the drive holds no velocity but 0.
    SolverError
        If the motion cannot be followed.

    Notes
    -----
    The slow motion is planar, so that every cycle is a fixed point of its map from valley to valley, and the multiplier
    follows from the divergence along it. The cycles of the full model are fixed points of its map from release to release;
    where it has no releases, only the cycle to which it settles is known. docs/cycles.md.
    """
    with _native.Cycles(Scene(scene).source, model) as found:
        return Cycles(
            found.model,
            found.velocity,
            tuple(
                LimitCycle(*(*row, stable))
                for row, stable in zip(found.values.tolist(), found.are_stable, strict=True)
            ),
            found.sliding_load,
            found.sliding_is_stable,
            found.eigenvalues,
            _regularity(found) if found.model == "full" else None,
        )


def _regularity(found: _native.Cycles) -> Regularity:
    verdicts: dict[float, Literal["regular", "irregular", "undecided"]] = {1.0: "regular", -1.0: "irregular"}
    there = found.count > 0
    return Regularity(
        verdicts.get(found.verdict, "undecided"),
        found.exponent,
        found.error,
        found.slow_cycles,
        found.mean if there else {},
        found.scatter if there else {},
    )


def stick_slip_ends(scene: DeckLike) -> StickSlipEnds:
    """Where the stick-slip of the slow motion ends: in the misalignment, and in the drive velocity.

    Parameters
    ----------
    scene : str, PathLike or Scene
        As for `cycles`. Its misalignment matters to the ends in velocity only, and its velocity to those in the angle.

    Returns
    -------
    StickSlipEnds
        The ends, and what the laws of slow and of fast drives say.

    Raises
    ------
    DeckError, FileError, UsageError, SolverError
        As for `cycles`.
    """
    with _native.Ends(Scene(scene).source) as found:
        values = found.values

    def end(name: str) -> End | None:
        return End(values[name], values[f"{name}_is_fold"] == 1.0) if name in values else None

    def pair(first: str, second: str) -> tuple[float, float] | None:
        return (values[first], values[second]) if first in values else None

    supercritical = values.get("is_supercritical")
    return StickSlipEnds(
        values.get("critical_misalignment"),
        None if supercritical is None else supercritical == 1.0,
        end("misalignment"),
        pair("critical_velocity_low", "critical_velocity_high"),
        (end("velocity_low"), end("velocity_high")),
        pair("bautin_velocity", "bautin_misalignment"),
        values.get("slow_drive_law"),
        values.get("slow_drive_doubt"),
        values.get("fast_drive_law"),
        values.get("fast_drive_doubt"),
    )
