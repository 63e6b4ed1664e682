"""The Moreau-Jean scheme, a reference that shares nothing with the program: a fixed step, no events, of first order.

Friction obeys the set-valued law at the end of a step h, so that rest is one of its solutions. With K = diag(k_x, k_y), theta = 1/2 and
the drive's displacement D e:

    u_1 = u_0 + D e - h w_h,     m (w_1 - w_0) = h K u_h - h f_1,     x_h = theta x_1 + (1 - theta) x_0.

Source: M. Jean, The non-smooth contact dynamics method, Comput. Methods Appl. Mech. Eng. 177 (1999) 235.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

THETA = 0.5


def positions(
    mass: float,
    stiffness: tuple[float, float],
    angle: float,
    velocity: float,
    friction: Callable[[float], float],
    static_limit: float,
    step: float,
    count: int,
) -> tuple[NDArray[np.float64], int]:
    """X after each of `count` steps from rest [m], and the number of rests, the first included.

    `friction` gives the force of a slip speed [N], `static_limit` [N] holds an object at rest, `angle` is in rad.
    """
    k, along = np.array(stiffness), np.array([np.cos(angle), np.sin(angle)])
    inertia, driven = mass / step + THETA**2 * step * k, velocity * step * along
    u, w, x, sticks = np.zeros(2), np.zeros(2), 0.0, 1
    found = np.empty(count)
    for i in range(count):
        free = mass * w / step + k * (u + THETA * (driven - (1.0 - THETA) * step * w))
        size = float(np.hypot(*free))
        before, w_0 = bool(w.any()), w
        if size <= (friction(0.0) if before else static_limit):
            w = np.zeros(2)
        else:

            def excess(r: float, b: NDArray[np.float64] = free) -> float:
                """Of the free force over the resistance to the speed r."""
                return float(np.hypot(*(b / (inertia * r + friction(r))))) - 1.0

            r = brentq(excess, 0.0, 2.0 * float(np.max(np.abs(free) / inertia)), xtol=1e-16, rtol=1e-13)
            w = r * free / (inertia * r + friction(r))
        mean = THETA * w + (1.0 - THETA) * w_0
        u = u + driven - step * mean
        x += step * float(along @ mean)
        sticks += before and not w.any()
        found[i] = x
    return found, sticks
