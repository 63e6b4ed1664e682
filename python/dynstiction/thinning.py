"""Fewer samples for the same drawn line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["extremes"]


def extremes(
    time: NDArray[np.float64], values: NDArray[np.float64], bins: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Smallest and largest value in each interval of time, in their order.

    The drawn line covers the same dots as the line through all samples, however fast they oscillate. There are `bins` intervals of
    equal length; the first and the last sample are also kept.
    """
    if time.size <= 2 * bins:
        return time, values
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], bins + 1)[1:-1])
    starts = np.unique(np.concatenate([[0], edges]))
    starts = starts[starts < time.size]
    sizes = np.diff(np.append(starts, time.size))
    keep = [0, time.size - 1]
    for extreme in (np.fmin, np.fmax):
        reached = values == np.repeat(extreme.reduceat(values, starts), sizes)
        # The first sample of each bin with its extreme value; none if all are NaN.
        reaching = np.flatnonzero(reached)
        bin_of = np.searchsorted(starts, reaching, side="right")
        keep.extend(reaching[np.unique(bin_of, return_index=True)[1]])
    kept = np.unique(keep)
    return time[kept], values[kept]
