"""Where a fit begins: what a waveform says at a glance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from .waveform import Waveform

__all__ = ["glances"]

ANGLES = (0.3, 0.8, 2.0, 4.0)
"""Misalignments that are tried [deg]."""
WEAKENING = (0.1, 0.4, 1.2, 4.0)
"""Velocities v_f that are tried, over the fastest slip."""
LAG = 0.4
"""Part of the weakening that such a slip does not come to see, over v_f and the fastest slip."""
FALL = 0.494
"""Of half a period of a harmonic motion: from 85 % to 15 % of its swing."""
STEEPEST = 10
"""Parts of a cycle, over one of which the load rises fastest."""


def glances(wave: Waveform, velocity: float, normal_load: float) -> Iterator[Mapping[str, float]]:
    """Parameters behind a waveform, roughly, for several misalignments and weakening velocities.

    The load rises no faster than k_x V, falls like half a period of a harmonic motion, to as far below the friction in slip as it
    was above.

    Parameters
    ----------
    wave : Waveform
        What is measured.
    velocity : float
        Drive velocity [m/s].
    normal_load : float
        W [N].
    """
    time, mean = wave.time, wave.mean
    grid = np.linspace(time[0], time[-1], 20 * STEEPEST)
    load = np.interp(grid, time, mean)
    part = grid.size // STEEPEST
    stiffness = float(np.max((load[part:] - load[:-part]) / (grid[part:] - grid[:-part]))) / abs(velocity)
    peak, valley = float(mean.max()), float(mean[time > 0.0].min())
    half = 0.5 * (peak - valley)
    mass = stiffness * (wave.fall / FALL / np.pi) ** 2
    fastest = half / np.sqrt(stiffness * mass)
    for angle in ANGLES:
        for share in WEAKENING:
            yield {
                "system.misalignment_deg": angle,
                "system.stiffness_x": stiffness,
                "system.mass": mass,
                "friction.mu_0": 1.003 * peak / normal_load,
                "friction.mu_inf": max(peak - half * (1.0 + LAG * share), 0.1 * peak) / normal_load,
                "friction.v_f": share * fastest,
            }
