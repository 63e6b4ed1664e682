"""How far a piecewise-linear drive has moved."""

from __future__ import annotations

import numpy as np


def distance(velocity: object, knots: object, time: np.ndarray) -> np.ndarray:
    """D(t) [m] in extended precision: the integral of a velocity that is given at knots, and stays what it is at the last one."""
    velocity, knots = (np.atleast_1d(np.asarray(x, dtype=np.longdouble)) for x in (velocity, knots))
    way = np.concatenate([[0], np.cumsum(np.diff(knots) * (velocity[1:] + velocity[:-1]) / 2)])
    i = np.searchsorted(knots, time, side="right") - 1
    elapsed = time.astype(np.longdouble) - knots[i]
    rise, span = np.append(np.diff(velocity), 0)[i], np.append(np.diff(knots), 1)[i]
    share = np.divide(elapsed, span, out=np.zeros_like(elapsed), where=span > 0)
    return np.asarray(way[i] + elapsed * (velocity[i] + rise * share / 2))
