"""numbalsoda, compiled by Numba: numbalsoda_peer.py method=lsoda|dop853 formulation=polar|printed|smoothed rtol=… …

lsoda has no root-finding here: the stop is searched among outputs on a grid, and then the integration goes up to it.
"""

import contextlib
import os
import threading
import time

import numpy as np
import scene
from numba import carray, cfunc, njit, types
from numbalsoda import dop853, lsoda, lsoda_sig, solve_ivp

nogil = njit(nogil=True)
scene.compiled(nogil)
# Shared with the right-hand sides: v_s or v_floor, the time now, the level of the event.
PARAMETER, NOW, CUT = range(3)
POLAR_SCALE, CARTESIAN_SCALE, SAMPLE_TIMES = (
    scene.POLAR_SCALE,
    scene.CARTESIAN_SCALE,
    np.array(scene.SAMPLE_TIMES),
)
FLOOR_SHARE = scene.FLOOR_SHARE
polar, cartesian = scene.polar_rhs, scene.cartesian_rhs
stick, brake = scene.stick, scene.brake
MAX_STEPS = 2_000_000_000
EVENT = types.void(
    types.double, types.CPointer(types.double), types.CPointer(types.double), types.CPointer(types.double)
)
GRID = 48
WINDOW = 1.2e-3
COMPILATION = 15.0


# numbalsoda has the same tolerances for all unknowns, so the unknowns are given in units of their sizes.
@cfunc(lsoda_sig)
def polar_rhs(t, z, dz, data):
    s = POLAR_SCALE
    shared = carray(data, 3)
    dy = polar(z[0] * s[0], z[1] * s[1], z[2] * s[2], z[3] * s[3], shared[PARAMETER])
    for i in range(4):
        dz[i] = dy[i] / s[i]
    shared[NOW] = t


@cfunc(lsoda_sig)
def cartesian_rhs(t, z, dz, data):
    s = CARTESIAN_SCALE
    shared = carray(data, 3)
    dy = cartesian(z[0] * s[0], z[1] * s[1], z[2] * s[2], z[3] * s[3], shared[PARAMETER])
    for i in range(4):
        dz[i] = dy[i] / s[i]
    shared[NOW] = t


@cfunc(EVENT)
def above_cut(t, z, value, data):
    value[0] = z[2] * POLAR_SCALE[2] - carray(data, 3)[CUT]


POLAR, CARTESIAN, ABOVE_CUT = polar_rhs.address, cartesian_rhs.address, above_cut.address


@nogil
def integrate(address, explicit, y, scale, shared, rtol, states):
    """Printed and smoothed form in one call. Returns the number of valid samples."""
    times = np.concatenate((np.zeros(1), SAMPLE_TIMES))
    if explicit:
        z, good = dop853(address, y / scale, times, shared, rtol, rtol, MAX_STEPS)
    else:
        z, good = lsoda(address, y / scale, times, shared, rtol, rtol, MAX_STEPS)
    for i in range(SAMPLE_TIMES.size):
        states[i] = z[i + 1] * scale
    return SAMPLE_TIMES.size if good else 0


@nogil
def slip_explicit(y, t, end, first_step, shared, pointer, rtol):
    """Integrate to the falling v = cut or to `end`; return state, time, and whether it is the event."""
    window = WINDOW
    while t < end:
        goal = min(t + window, end)
        first = min(first_step, 0.5 * (goal - t))
        span, last = np.array([t, goal]), np.array([goal])
        result = solve_ivp(
            POLAR, span, y / POLAR_SCALE, last, "DOP853", 1, ABOVE_CUT, pointer, first, 0.0, rtol, rtol
        )
        if not result.success:
            # It gives up after about 1000 steps that seem stiff: use fewer steps in each call.
            window *= 0.2
            if window < 1e-9:
                raise ValueError("gives up where it is stiff")
            continue
        if not result.event_found:
            y, t = result.y[-1] * POLAR_SCALE, goal
            continue
        y, t = result.y_event * POLAR_SCALE, result.t_event
        if brake(y[0], y[1], y[2], y[3])[0] < 0.0:
            return y, t, True
        # A rising v also ends the call.
        y[2] = max(y[2], shared[CUT] * (1.0 + 1e-6))
    return y, t, False


@nogil
def slip_lsoda(y, t, end, shared, rtol):
    cut = shared[CUT]
    while True:
        times = np.linspace(t, min(t + WINDOW, end), GRID + 1)
        z, good = lsoda(POLAR, y / POLAR_SCALE, times, shared, rtol, rtol, MAX_STEPS)
        if not good:
            raise ValueError("lsoda failed")
        v = z[:, 2] * POLAR_SCALE[2]
        for k in range(GRID):
            if v[k] > cut >= v[k + 1]:
                return refine(z[k], times[k], z[k + 1], times[k + 1], shared, rtol)
        y, t = z[-1] * POLAR_SCALE, times[-1]
        if t >= end:
            return y, end, False


@nogil
def refine(z, t, z_next, t_next, shared, rtol):
    """Integrate from a grid point before the stop up to v = cut, by regula falsi with lsoda itself."""
    unit = POLAR_SCALE[2]
    cut = shared[CUT]
    while True:
        v, v_next = z[2] * unit, z_next[2] * unit
        goal = t + (t_next - t) * min((v - cut) / (v - v_next), 0.999)
        middle, good = lsoda(POLAR, z, np.array([t, goal]), shared, rtol, rtol, MAX_STEPS)
        if not good:
            raise ValueError("lsoda failed")
        if middle[1, 2] * unit > cut:
            z, t = middle[1], goal
            if z[2] * unit <= 1.4 * cut:
                return z * POLAR_SCALE, t, True
        else:
            z_next, t_next = middle[1], goal
        if t_next - t <= 4e-16 * t:
            return z * POLAR_SCALE, t, True


@nogil
def follow(explicit, y, v_cut, share, tolerance, shared, pointer, rtol, states, counts):
    taken, t, first_step = 0, 0.0, 1e-10
    while taken < SAMPLE_TIMES.size:
        cut = v_cut
        while not (y[2] <= 1.5 * cut and brake(y[0], y[1], y[2], y[3])[2] > 0.0):
            shared[CUT], shared[PARAMETER] = cut, FLOOR_SHARE * cut
            if explicit:
                y, t, event = slip_explicit(y, t, SAMPLE_TIMES[taken], first_step, shared, pointer, rtol)
            else:
                y, t, event = slip_lsoda(y, t, SAMPLE_TIMES[taken], shared, rtol)
            if not event:
                states[taken] = scene.cartesian(y)
                taken += 1
                counts[0] = taken
                if taken == SAMPLE_TIMES.size:
                    return
            if not y[2] > 0.0:
                raise ValueError("fell through the stop")
            if event and y[2] <= 1.5 * cut and brake(y[0], y[1], y[2], y[3])[2] <= 0.0:
                cut = 0.1 * y[2]
        y, t, taken, length = stick(y, t, tolerance, states, taken)
        counts[0] = taken
        counts[1] += 1
        first_step = share * length


def measure(run):
    explicit = run.method == "dop853"
    shared = np.array([run.v_s, 0.0, run.v_cut])

    def solve(target, y, states, counts):
        if run.polar:
            follow(
                explicit,
                y,
                run.v_cut,
                run.share,
                run.tolerance,
                target,
                target.ctypes.data,
                run.rtol,
                states,
                counts,
            )
        else:
            counts[0] = integrate(CARTESIAN, explicit, y, run.scale, target, run.rtol, states)
            if counts[0] == 0:
                raise ArithmeticError(f"{run.method} failed at t = {target[1]:.3g} s")

    outcome, states, counts = [], np.zeros_like(run.states), np.zeros(2, dtype=np.int64)

    def work():
        try:
            solve(shared, run.initial(), states, counts)
            outcome.append("done")
        except Exception as failure:
            outcome.append(str(failure))

    def measured(allowance=0.0):
        outcome.clear()
        counts[:] = 0
        run.taken, shared[:] = 0, (run.v_s, 0.0, run.v_cut)
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        while thread.is_alive() and time.process_time() - run.begun < run.limit + allowance:
            thread.join(0.001 if time.process_time() - run.begun < 1.0 else 0.1)
        run.states, run.taken, run.stops, run.time = states, int(counts[0]), int(counts[1]), shared[NOW]
        if not outcome:
            raise scene.LimitReached("time limit")
        if outcome[0] != "done":
            raise ArithmeticError(outcome[0])

    # The first run compiles.
    run.begun = time.process_time()
    with contextlib.suppress(Exception):
        measured(allowance=COMPILATION)
    if outcome:
        run.report(measured)
    else:
        # The thread of the run cannot be stopped.
        run.print("time limit")
        os._exit(0)


if __name__ == "__main__":
    for each in scene.runs():
        measure(each)
