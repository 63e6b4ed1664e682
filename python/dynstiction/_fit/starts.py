"""Starts of a fit: rough estimates from a waveform."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from .waveform import Waveform

__all__ = ["glances"]

ANGLES = (0.3, 0.8, 2.0, 4.0)
"""Misalignments that are tried [deg]."""
WEAKENING = (0.1, 0.4, 1.2, 4.0)
"""Velocities v_f that are tried, over the speed of the fastest slip."""
LAG = 0.4
"""Share of the weakening that such a slip does not reach, divided by the ratio of v_f to the speed of the fastest slip."""
FALL = 0.494
"""Share of half a period of a harmonic motion in which it falls from 85 % to 15 % of its swing."""
STEEPEST = 10
"""Number of parts of a cycle; the load rises fastest over one of them."""


def glances(wave: Waveform, velocity: float, normal_load: float) -> Iterator[Mapping[str, float]]:
    """Rough estimates of the parameters behind a waveform, for several misalignments and weakening velocities.

    The load rises no faster than k_x V. It falls like half a period of a harmonic motion, and ends as far below the friction in
    slip as it began above it.

    Parameters
    ----------
    wave : Waveform
        The measured waveform.
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
