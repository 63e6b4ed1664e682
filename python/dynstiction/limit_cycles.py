"""Limit cycles without runs (docs/cycles.md)."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from .scene import DeckLike, Scene

Verdict = Literal["regular", "irregular", "steady sliding", "undecided"]
VERDICTS: dict[float, Verdict] = {1.0: "regular", -1.0: "irregular", 2.0: "steady sliding"}


class LimitCycle(NamedTuple):
    """A stick-slip cycle that repeats itself. Loads are k_x u_x, positive where the drive pulls."""

    period: float
    """Time from peak to peak of the load [s]."""
    peak_force: float
    """Peak of the load [N]; the apparent static friction if the cycle is stable."""
    valley_force: float
    """Valley of the load [N]."""
    stick_duration: float
    """Time from valley to peak [s]."""
    slip_duration: float
    """Time from peak to valley [s]."""
    slip_length: float
    """Advance in X from peak to valley [m], positive with the drive."""
    swing: float
    """Peak minus valley [N]."""
    log_multiplier: float
    """Logarithm of the factor by which a small disturbance grows in a cycle [-]; NaN if it is not known."""
    slow_cycles: int
    """Slow cycles after which it repeats: then period is that of all of them, the peak is the highest, the valley the lowest, and the
    other values are means. 0: the fast oscillation alone."""
    stable: bool
    """Whether the cycle is stable, so that the motion can stay at it."""

    @property
    def multiplier(self) -> float:
        """Factor by which a small disturbance grows in a cycle [-]; 0 if it is below the smallest number."""
        return math.exp(min(self.log_multiplier, 700.0))


class Regularity(NamedTuple):
    """Regularity of the motion of a scene from its initial state."""

    verdict: Verdict
    """Whether the motion reaches a cycle; if it is irregular, its cycles have a distribution, not one value."""
    repeats: int
    """Slow cycles after which the motion repeats; 0 if it does not."""
    exponent: float
    """Lyapunov exponent for a slow cycle [-]; NaN if it is not known."""
    error: float
    """Standard error of the Lyapunov exponent; NaN if it is not known."""
    slow_cycles: int
    """Number of slow cycles that were followed."""
    mean: dict[str, float]
    """Mean of period, peak_force, ..., over the later half of the cycles; empty if there are none."""
    scatter: dict[str, float]
    """Their standard deviations."""
    searched: int
    """Cycles of up to so many slow cycles were looked for: those of more are too many for the releases that were followed, or the search
    took too long."""


class Cycles(NamedTuple):
    """Every limit cycle of a scene, and steady sliding."""

    model: str
    velocity: float
    """Drive velocity |V| [m/s]."""
    cycles: tuple[LimitCycle, ...]
    """The cycles by increasing swing."""
    release_angle: NDArray[np.float64]
    """Direction of the force on the object at the release with which each of them begins [rad], from the soft to the stiff axis, each
    positive where the drive pulls; NaN for those without a release, as in the slow motion."""
    sliding_load: float
    """k_x u_x in steady sliding [N]."""
    sliding_is_stable: bool
    eigenvalues: NDArray[np.complex128]
    """Eigenvalues of a small disturbance of steady sliding [1/s], by decreasing real part; shape (2,), for the full model (4,)."""
    regularity: Regularity | None
    """Regularity of the full model."""
    error: float
    """Estimated largest relative error of the slow motion against the full one [-]; 0 for the full model, and without its k_y."""

    @property
    def stable(self) -> tuple[LimitCycle, ...]:
        """The stable cycles, at which the motion can stay."""
        return tuple(cycle for cycle in self.cycles if cycle.stable)

    @property
    def unstable(self) -> tuple[LimitCycle, ...]:
        """The other cycles. An unstable cycle around stable steady sliding bounds the motions that reach steady sliding."""
        return tuple(cycle for cycle in self.cycles if not cycle.stable)


def cycles(scene: DeckLike, *, model: str = "") -> Cycles:
    """Every limit cycle of a scene, stable and unstable.

    Parameters
    ----------
    scene : str, PathLike or Scene
        A deck or a scene. Its drive must keep one velocity other than 0 and no second one.
    model : str
        Model of the cycles, 'full' or 'low_frequency'; by default the scene's own model, which must be one of these.

    Returns
    -------
    Cycles
        The cycles by increasing swing, and steady sliding.

    Raises
    ------
    DeckError, FileError
        As for `dynstiction.run`; also if the misalignment is a multiple of 90 degrees, the full model has the smoothed
        contact, or the slow motion does not hold for the scene's stiff axis.
    UsageError
        If the drive keeps no velocity other than 0, or several.
    SolverError
        If the motion cannot be followed.

    Notes
    -----
    The slow motion is planar, so that every cycle is a fixed point of its map from valley to valley, and the multiplier
    follows from the divergence along the cycle. The cycles of the full model are fixed points of its map from release to release;
    if it has no releases, only the cycle to which it settles is known. See docs/cycles.md.
    """
    with _native.Session(Scene(scene).source, "cycles", model) as found:
        of, quantities = found.text("model"), found.numbers("cycles")
        # By cycle: the numbers of a `LimitCycle`, the angle of its release, and whether it is stable.
        rows: list[Any] = quantities.T.tolist()
        verdict, sliding = np.split(found.numbers("verdict")[:, 0], [7])
        load, is_stable, velocity, error = sliding.tolist()
        real, imaginary = found.numbers("eigenvalues").reshape(2, -1)
        return Cycles(
            of,
            velocity,
            tuple(LimitCycle._make([*row, int(m), stable == 1.0]) for *row, m, _, stable in rows),
            quantities[-2],
            load,
            is_stable == 1.0,
            real + 1j * imaginary,
            _regularity(found, verdict.tolist()) if of == "full" else None,
            error,
        )


def _regularity(found: _native.Session, values: list[float]) -> Regularity:
    verdict, exponent, error, slow_cycles, count, repeats, searched = values
    mean, scatter = dict[str, float](), dict[str, float]()
    if count > 0.0:
        names = [info.name for info in found.infos("regularity")]
        mean, scatter = (dict(zip(names, row, strict=True)) for row in found.numbers("regularity").tolist())
    return Regularity(
        VERDICTS.get(verdict, "undecided"),
        int(repeats),
        exponent,
        error,
        int(slow_cycles),
        mean,
        scatter,
        int(searched),
    )
