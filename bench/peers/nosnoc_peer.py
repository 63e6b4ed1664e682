"""nosnoc: FESD, Radau IIA with switches found by its optimizer: nosnoc_peer.py method=fesd formulation=nonsmooth n_s=… h=… …"""

import functools
import math

import casadi as ca
import nosnoc
import numpy as np
import scene

# Units of time, displacement and velocity, which bring the unknowns near one.
TIME, LENGTH, SPEED = 1e-4, 1e-7, 1e-5
COMPLEMENTARITY = 1e-8
# A speed below this, in m/s, is rest.
REST = 1e-10
# One step can contain the ends of a slip and of a rest.
ELEMENTS = 3
HALVINGS = 4


def motion(x, force_x, force_y):
    """Derivatives of the state in these units, under a friction force in N."""
    push = TIME / (scene.MASS * SPEED)
    return ca.vertcat(
        TIME / LENGTH * (scene.DRIVE_X - SPEED * x[2]),
        TIME / LENGTH * (scene.DRIVE_Y - SPEED * x[3]),
        push * (scene.K_X * LENGTH * x[0] - force_x),
        push * (scene.K_Y * LENGTH * x[1] - force_y),
    )


def friction(speed):
    return scene.LOAD * (scene.MU_INF + (scene.MU_0 - scene.MU_INF) * ca.exp(-SPEED * speed / scene.V_F))


def coulomb():
    """Its general inclusion: the force F(v) f lies in the disc |f| <= 1, on its edge (alpha = 1) where the speed v is positive.

    f and v are algebraic unknowns, w = v f, and v is its switching function: alpha is in [0, 1] at v = 0.
    """
    x, z, alpha = ca.SX.sym("x", 4), ca.SX.sym("z", 3), ca.SX.sym("alpha", 1)
    f_x, f_y, v = z[0], z[1], z[2]
    strength = friction(v)
    return nosnoc.NosnocModel(
        x=x, x0=np.zeros(4), f_x=[motion(x, strength * f_x, strength * f_y)], alpha=[alpha], c=[v],
        z=z, z0=np.array([0.0, 1.0, 0.0]), lbz=np.array([-1.0, -1.0, 0.0]), ubz=np.array([1.0, 1.0, np.inf]),
        g_z=ca.vertcat(x[2] - v * f_x, x[3] - v * f_y, f_x**2 + f_y**2 - alpha),
    )  # fmt: skip


def solver_for(h, stages):
    options = nosnoc.NosnocOpts()
    options.terminal_time = h / TIME
    options.n_s, options.N_finite_elements = stages, ELEMENTS
    options.pss_mode = nosnoc.PssMode.STEP
    options.comp_tol = options.sigma_N = COMPLEMENTARITY
    options.step_equilibration = nosnoc.StepEquilibrationMode.HEURISTIC_MEAN
    options.initialization_strategy = nosnoc.InitializationStrategy.ALL_XCURRENT_WOPT_PREV
    return nosnoc.NosnocSolver(options, coulomb())


class Steps:
    """Steps of nosnoc; a step without solution is tried again from a cold start, then in two halves, and so on."""

    def __init__(self, h, stages):
        self.solver = functools.cache(lambda depth: solver_for(h / 2**depth, stages))
        self.cold = {}
        self.solved = 0

    def advance(self, x, depth=0):
        """The states at the ends of the elements."""
        solver = self.solver(depth)
        cold = self.cold.setdefault(depth, solver.problem.w0.copy())
        for _ in range(2):
            solver.set("x0", x)
            self.solved += 1
            solution = solver.solve()
            if solution["status"] == nosnoc.Status.SUCCESS:
                return solution["x_list"]
            solver.problem.w0 = cold.copy()
        if depth == HALVINGS:
            raise ArithmeticError("no solution")
        first = self.advance(x, depth + 1)
        return [*first, *self.advance(first[-1], depth + 1)]


def measure(run):
    h = float(run.given["h"])
    scale = np.array([LENGTH, LENGTH, SPEED, SPEED])
    steps = Steps(h, int(run.given["n_s"]))
    steps.solver(0)

    def simulate():
        x, slipped, count = run.initial() / scale, True, 0
        while not run.finished():
            run.check_clock()
            states = steps.advance(x)
            for state in states:
                slips = math.hypot(state[2], state[3]) * SPEED > REST
                run.stops += slipped and not slips
                slipped = slips
            x = states[-1]
            count += 1
            run.time, run.steps = count * h, steps.solved
            if count == round(scene.SAMPLE_TIMES[run.taken] / h):
                run.sample(x * scale)

    run.report(simulate)


if __name__ == "__main__":
    for each in scene.runs():
        measure(each)
