"""RADAU of Hairer and Wanner, orders 5 to 13, called from Python: pyradau13_peer.py formulation=… rtol=… …"""

import functools
import os

import numpy as np
import scene
from pyradau13 import radau13


def measure(run):
    tolerances = {"reltol": np.full(4, run.rtol), "abstol": run.rtol * run.scale, "max_steps": 2_000_000_000}
    parameter, stopped = run.v_s, None

    def rhs(t, y):
        run.steps += 1
        if run.steps % 64 == 0:
            run.time = t
            # An exception would not stop it.
            if run.over_time():
                run.print("time limit")
                os._exit(0)
        return equations(*np.ravel(y).tolist(), parameter)

    def jacobian(t, y):
        return matrix(*np.ravel(y).tolist(), parameter)

    equations = scene.polar_rhs if run.polar else scene.cartesian_rhs
    matrix = scene.polar_jacobian if run.polar else scene.cartesian_jacobian

    def advance(y, first_step, watch):
        nonlocal stopped
        while not run.finished():
            stopped = None
            end = scene.SAMPLE_TIMES[run.taken]
            h0 = min(first_step, end - run.time)
            y = radau13(rhs, y, end, t0=run.time, h0=h0, jacobian_fn=jacobian, **watch, **tolerances)
            y = np.ravel(np.asarray(y, dtype=float))
            if stopped is not None:
                run.time, y = stopped
                return y
            run.time = end
            run.sample(y)
        return y

    def slip(y, first_step, cut):
        nonlocal parameter
        parameter = scene.FLOOR_SHARE * cut
        before = y[2]

        def watch(t_old, t, y, dense):
            nonlocal stopped, before
            after = np.ravel(y)[2]
            if not (before > cut >= after):
                before = after
                return False
            low, high = t_old, t
            for _ in range(40):
                middle = 0.5 * (low + high)
                if np.ravel(dense(middle))[2] > cut:
                    low = middle
                else:
                    high = middle
            stopped = low, np.array(np.ravel(dense(low)), dtype=float)
            return True

        return advance(y, first_step, {"dense_callback": watch})

    if run.polar:
        run.report(functools.partial(run.follow, slip))
    else:
        run.report(lambda: advance(run.initial(), 1e-12, {}))


if __name__ == "__main__":
    for each in scene.runs():
        measure(each)
