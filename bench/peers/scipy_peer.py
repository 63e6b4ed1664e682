"""SciPy's solve_ivp on the scene of scene.hpp, with plain functions of floats, which it calls fastest."""

import math
import time

import numpy as np
from scipy.integrate import solve_ivp

MASS, K_X, K_Y = 0.25, 1.0e3, 1.0e7
MU_0, MU_INF, V_F, LOAD = 0.20, 0.15, 0.010, 10.0
DRIVE_X, DRIVE_Y = 1.0e-3 * math.cos(math.radians(1.0)), 1.0e-3 * math.sin(math.radians(1.0))
START = np.array([0.0, 0.0, 1e-6 * DRIVE_X, 1e-6 * DRIVE_Y])
SCALE = np.array([1e-7, 1e-7, 1e-5, 1e-5])
SAMPLE_TIMES = (0.02, 0.5, 2.0, 2.5)


def friction(v):
    return (MU_INF + (MU_0 - MU_INF) * math.exp(-v / V_F)) * LOAD


def rhs(u_x, u_y, w_x, w_y, v_s):
    v = math.hypot(w_x, w_y)
    drag = friction(v) / math.sqrt(v * v + v_s * v_s)
    return DRIVE_X - w_x, DRIVE_Y - w_y, (K_X * u_x - drag * w_x) / MASS, (K_Y * u_y - drag * w_y) / MASS


def jacobian(u_x, u_y, w_x, w_y, v_s):
    v = math.hypot(w_x, w_y)
    r = math.sqrt(v * v + v_s * v_s)
    drag = friction(v) / r
    slope = -(MU_0 - MU_INF) / V_F * math.exp(-v / V_F) * LOAD
    change = slope / (v * r) - friction(v) / r**3
    cross = -change * w_x * w_y / MASS
    return [
        [0.0, 0.0, -1.0, 0.0],
        [0.0, 0.0, 0.0, -1.0],
        [K_X / MASS, 0.0, -(change * w_x * w_x + drag) / MASS, cross],
        [0.0, K_Y / MASS, cross, -(change * w_y * w_y + drag) / MASS],
    ]


def run(method, rtol, v_s, limit):
    """Processor time and states with the methods Radau, LSODA or DOP853, as printed (v_s = 0) or smoothed."""
    settings = {"rtol": max(rtol, 3e-14), "atol": rtol * SCALE, "method": method}
    if method != "DOP853":
        settings["jac"] = lambda t, y: jacobian(*y.tolist(), v_s)
    begun, calls, now, y, states, status = time.process_time(), 0, 0.0, START, [], "done"

    def rates(t, y):
        nonlocal calls, now
        calls += 1
        if calls % 64 == 0:
            now = t
            if time.process_time() - begun > limit:
                raise TimeoutError("time limit")
        return rhs(*y.tolist(), v_s)

    try:
        for end in SAMPLE_TIMES:
            solution = solve_ivp(rates, (now, end), y, first_step=1e-12, **settings)
            if solution.status < 0:
                raise ArithmeticError(solution.message)
            now, y = end, solution.y[:, -1]
            states.append(y)
    except (ArithmeticError, TimeoutError, ValueError) as failure:
        status = str(failure).replace("\n", " ") or type(failure).__name__
    return {
        "status": status,
        "seconds": time.process_time() - begun,
        "time": float(now),
        "stops": 0,
        "states": states,
    }
