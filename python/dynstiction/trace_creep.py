"""Does a force trace show dynamic stiction or static friction? The creep before its slips decides (docs/fit.md)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .trace import Trace
from .trace_cycles import find_cycles

__all__ = ["CreepTest", "creep_test"]

INERTIA = 0.17
"""Inertia rounds the peak of a slip that begins at a sharp limit, by at most this share of slip duration over period. Measured:
0.15 to 0.17 for misalignment 0 and static limits from mu_0 to 1.5 mu_0 (docs/fit.md)."""
ROUND = 0.12
"""Slip duration over period above which the peak is round whatever friction does: in a fast motion, behind a filter, in a sine."""


class CreepTest(NamedTuple):
    """Whether an object creeps before it slips."""

    creep_share: float
    """How far the force before slip is below the straight line of the loading, over the swing: mean over the cycles."""
    error: float
    """Its standard error."""
    of_inertia: float
    """The largest value that it can have with static friction: slip does not begin at once, because of inertia."""
    cycles: int
    probability: float
    """Probability of this much creep if there is only static friction."""
    slip_share: float
    """Slip duration over period."""

    @property
    def can_tell(self) -> bool:
        """Whether slips are so short that the shape of the peak shows creep: at most 0.12 of the period."""
        return self.slip_share <= ROUND

    @property
    def creeps(self) -> bool:
        """Whether this probability is below one in a thousand, and slips are short enough to tell."""
        return self.can_tell and self.probability < 1e-3

    def __str__(self) -> str:
        verdict = (
            "the object creeps before it slips: dynamic stiction, or friction that grows at rest"
            if self.creeps
            else "no creep before slip is seen: static friction, or creep that is too small for this trace"
            if self.can_tell
            else f"a slip takes {100.0 * self.slip_share:.0f} % of a cycle: inertia, or a filter, rounds such a peak as creep does; fit the "
            "deck with a misalignment, and without one but with friction.mu_static, and compare the misfits"
        )
        return (
            f"creep before slip: {self.creep_share:.4f} ± {self.error:.4f} of the swing, inertia alone {self.of_inertia:.4f}; "
            f"by chance with probability {self.probability:.1e}: {verdict}"
        )


def creep_test(trace: Trace) -> CreepTest:
    """Distinguish dynamic stiction from static friction by the creep before the slips of a trace.

    With static friction the load rises along a straight line until it slips; only the inertia of the slip rounds its peak. With
    dynamic stiction the object creeps while the friction vector turns, and the load stays below the line.

    Parameters
    ----------
    trace : Trace
        Force along the pull, from `read_trace`.

    Returns
    -------
    CreepTest
        How far the load is below the line, and how probable that is with static friction alone (Student's distribution, one-sided).

    Raises
    ------
    FileError
        If the trace has no stick-slip, see `find_cycles`.
    """
    from scipy.stats import t  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    cycles = find_cycles(trace)
    means, errors = cycles.means(), cycles.errors()
    slip = means["slip_duration"]
    slip_share = (2.0 * trace.interval if np.isnan(slip) else slip) / means["period"]
    share, error = means["creep_share"], max(errors["creep_share"], 1e-12)
    n = len(cycles)
    inertia = INERTIA * slip_share
    return CreepTest(share, error, inertia, n, float(t.sf((share - inertia) / error, n - 1)), slip_share)
