"""SciPy's solve_ivp: scipy_peer.py method=Radau|LSODA|DOP853 formulation=polar|printed|smoothed rtol=… …"""

import functools

import scene
from scipy.integrate import solve_ivp


def measure(run):
    tolerances = {"rtol": max(run.rtol, 3e-14), "atol": run.rtol * run.scale}
    parameter = run.v_s

    def rhs(t, y):
        run.steps += 1
        if run.steps % 64 == 0:
            run.time = t
            run.check_clock()
        return equations(*y.tolist(), parameter)

    equations = scene.polar_rhs if run.polar else scene.cartesian_rhs
    jacobian = scene.polar_jacobian if run.polar else scene.cartesian_jacobian
    if run.method != "DOP853":
        tolerances["jac"] = lambda t, y: jacobian(*y.tolist(), parameter)

    def advance(y, first_step, events):
        while not run.finished():
            span = (run.time, scene.SAMPLE_TIMES[run.taken])
            solution = solve_ivp(
                rhs, span, y, run.method, events=events,
                first_step=min(first_step, 0.5 * (span[1] - span[0])), **tolerances,
            )  # fmt: skip
            if solution.status < 0:
                raise ArithmeticError(solution.message)
            run.time, y = solution.t[-1], solution.y[:, -1]
            if solution.status == 1:
                return y
            run.sample(y)
        return y

    def slip(y, first_step, cut):
        nonlocal parameter
        parameter = scene.FLOOR_SHARE * cut

        def stop(t, y):
            return y[2] - cut

        stop.terminal, stop.direction = True, -1
        return advance(y, first_step, [stop])

    if run.polar:
        run.report(functools.partial(run.follow, slip))
    else:
        run.report(lambda: advance(run.initial(), 1e-12, None))


if __name__ == "__main__":
    for each in scene.runs():
        measure(each)
