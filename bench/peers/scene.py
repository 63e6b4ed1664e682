"""The scene of scene.hpp for the peers that are called from Python: Fig. 3, inputs/fig3.nml, to 2.5 s or, with t_end=100, to 100 s, SI units.

Plain functions of floats, which SciPy calls fastest; `compiled` compiles them with Numba.
"""

import itertools
import json
import math
import sys
import time

import numpy as np

MASS, K_X, K_Y = 0.25, 1.0e3, 1.0e7
MU_0, MU_INF, V_F, LOAD = 0.20, 0.15, 0.010, 10.0
VELOCITY, VELOCITY_RATIO, MISALIGNMENT = 1.0e-3, 1.0e-6, math.radians(1.0)
F_0 = MU_0 * LOAD
DRIVE_X, DRIVE_Y = VELOCITY * math.cos(MISALIGNMENT), VELOCITY * math.sin(MISALIGNMENT)
SAMPLE_TIMES = (0.5, 2.0, 2.5, 10.0, 100.0) if "t_end=100" in sys.argv else (0.02, 0.5, 2.0, 2.5)
POLAR_SCALE = np.array([1e-7, 1e-7, 1e-5, 1.0])
CARTESIAN_SCALE = np.array([1e-7, 1e-7, 1e-5, 1e-5])
FLOOR_SHARE = 0.5
ORDER = 12


def friction(v):
    return (MU_INF + (MU_0 - MU_INF) * math.exp(-v / V_F)) * LOAD


def friction_slope(v):
    return -(MU_0 - MU_INF) / V_F * math.exp(-v / V_F) * LOAD


def cartesian_rhs(u_x, u_y, w_x, w_y, v_s):
    v = math.hypot(w_x, w_y)
    drag = friction(v) / math.sqrt(v * v + v_s * v_s)
    return DRIVE_X - w_x, DRIVE_Y - w_y, (K_X * u_x - drag * w_x) / MASS, (K_Y * u_y - drag * w_y) / MASS


def cartesian_jacobian(u_x, u_y, w_x, w_y, v_s):
    v = math.hypot(w_x, w_y)
    r = math.sqrt(v * v + v_s * v_s)
    drag = friction(v) / r
    change = friction_slope(v) / (v * r) - friction(v) / r**3
    cross = -change * w_x * w_y / MASS
    return [
        [0.0, 0.0, -1.0, 0.0],
        [0.0, 0.0, 0.0, -1.0],
        [K_X / MASS, 0.0, -(change * w_x * w_x + drag) / MASS, cross],
        [0.0, K_Y / MASS, cross, -(change * w_y * w_y + drag) / MASS],
    ]


def polar_rhs(u_x, u_y, v, theta, v_floor):
    c, s = math.cos(theta), math.sin(theta)
    f_x, f_y = K_X * u_x, K_Y * u_y
    return (
        DRIVE_X - v * c,
        DRIVE_Y - v * s,
        (f_x * c + f_y * s - friction(v)) / MASS,
        (f_y * c - f_x * s) / (MASS * max(v, v_floor)),
    )


def polar_jacobian(u_x, u_y, v, theta, v_floor):
    c, s = math.cos(theta), math.sin(theta)
    f_x, f_y, inertia = K_X * u_x, K_Y * u_y, MASS * max(v, v_floor)
    across = f_y * c - f_x * s
    return [
        [0.0, 0.0, -c, v * s],
        [0.0, 0.0, -s, -v * c],
        [K_X * c / MASS, K_Y * s / MASS, -friction_slope(v) / MASS, across / MASS],
        [
            -K_X * s / inertia,
            K_Y * c / inertia,
            -across / (inertia * v) if v > v_floor else 0.0,
            -(f_x * c + f_y * s) / inertia,
        ],
    ]


def rest_delay(u_x, u_y):
    """Time at rest until |K u| = F_0."""
    f_x, f_y, g_x, g_y = K_X * u_x, K_Y * u_y, K_X * DRIVE_X, K_Y * DRIVE_Y
    f = math.hypot(f_x, f_y)
    if f >= F_0:
        return 0.0
    a, b, c = g_x * g_x + g_y * g_y, g_x * f_x + g_y * f_y, (F_0 - f) * (F_0 + f)
    root = math.sqrt(b * b + a * c)
    return c / (b + root) if b > 0.0 else (root - b) / a


def release(u_x, u_y, tolerance):
    """Slip from rest as power series in time, rows (u_x, u_y, v, theta), and the time up to which they are valid."""
    load = math.hypot(K_X * u_x, K_Y * u_y)
    f_0 = max(load, F_0)
    excess = load - F_0 if load > F_0 * (1.0 + 1e-14) else 0.0
    a = np.zeros((4, ORDER + 2))
    c, s, decay = np.zeros(ORDER + 1), np.zeros(ORDER + 1), np.zeros(ORDER + 1)
    a[0, 0], a[1, 0], a[3, 0] = u_x, u_y, math.atan2(K_Y * u_y, K_X * u_x)
    c[0], s[0], decay[0] = math.cos(a[3, 0]), math.sin(a[3, 0]), 1.0
    for k in range(ORDER + 1):
        if k > 0:
            for j in range(1, k):
                c[k] -= j * a[3, j] * s[k - j] / k
                s[k] += j * a[3, j] * c[k - j] / k
            across = 0.0
            for i in range(k + 1):
                across += K_Y * a[1, i] * c[k - i] - K_X * a[0, i] * s[k - i]
            for j in range(1, k):
                across -= MASS * j * a[3, j] * a[2, k + 1 - j]
            a[3, k] = across / (f_0 + MASS * k * a[2, 1])
            c[k] -= a[3, k] * s[0]
            s[k] += a[3, k] * c[0]
        along, slip_x, slip_y = 0.0, 0.0, 0.0
        for i in range(k + 1):
            along += K_X * a[0, i] * c[k - i] + K_Y * a[1, i] * s[k - i]
            slip_x += a[2, i] * c[k - i]
            slip_y += a[2, i] * s[k - i]
            if i > 0:
                decay[k] -= i * a[2, i] * decay[k - i] / (k * V_F)
        push = excess if k == 0 else along - (MU_0 - MU_INF) * LOAD * decay[k]
        a[2, k + 1] = push / (MASS * (k + 1))
        a[0, k + 1] = ((DRIVE_X if k == 0 else 0.0) - slip_x) / (k + 1)
        a[1, k + 1] = ((DRIVE_Y if k == 0 else 0.0) - slip_y) / (k + 1)
    a[3, ORDER + 1] = a[2, ORDER + 1] = 0.0
    first = 1 if excess > 0.0 else 2
    delay = 0.25 * math.sqrt(MASS / K_Y)
    for k in (ORDER - 1, ORDER):
        delay = min(delay, (tolerance * a[2, first] / (abs(a[2, k]) + 1e-300)) ** (1.0 / (k - first)))
        delay = min(delay, (tolerance / (abs(a[3, k]) + 1e-300)) ** (1.0 / k))
    return a, delay


def release_at(a, dt):
    y = np.zeros(4)
    for k in range(ORDER, -1, -1):
        y = y * dt + a[:, k]
    return y


def brake(u_x, u_y, v, theta):
    """Acceleration, jerk and time to the stop with a constant direction; the time is negative if there is no stop."""
    c, s = math.cos(theta), math.sin(theta)
    acceleration = (K_X * u_x * c + K_Y * u_y * s - friction(v)) / MASS
    jerk = (
        K_X * (DRIVE_X - v * c) * c + K_Y * (DRIVE_Y - v * s) * s - friction_slope(v) * acceleration
    ) / MASS
    discriminant = acceleration * acceleration - 2.0 * jerk * v
    if discriminant < 0.0 or acceleration >= 0.0:
        return acceleration, jerk, -1.0
    return acceleration, jerk, 2.0 * v / (math.sqrt(discriminant) - acceleration)


def brake_at(y, acceleration, jerk, dt):
    way = dt * (y[2] + dt * (acceleration / 2.0 + dt * jerk / 6.0))
    return np.array(
        [
            y[0] + DRIVE_X * dt - way * math.cos(y[3]),
            y[1] + DRIVE_Y * dt - way * math.sin(y[3]),
            y[2] + dt * (acceleration + dt * jerk / 2.0),
            y[3],
        ]
    )


def cartesian(y):
    return np.array([y[0], y[1], y[2] * math.cos(y[3]), y[2] * math.sin(y[3])])


def stick(y, time_now, tolerance, states, taken):
    """From the end of slip at y to the next slip: stop, rest, release, with the samples on the way.

    Returns the state and time at which slip begins again, the number of samples taken, and the length of the series.
    """
    acceleration, jerk, delay = brake(y[0], y[1], y[2], y[3])
    while taken < len(SAMPLE_TIMES) and SAMPLE_TIMES[taken] <= time_now + delay:
        states[taken] = cartesian(brake_at(y, acceleration, jerk, SAMPLE_TIMES[taken] - time_now))
        taken += 1
    y = brake_at(y, acceleration, jerk, delay)
    time_now += delay
    delay = rest_delay(y[0], y[1])
    while taken < len(SAMPLE_TIMES) and SAMPLE_TIMES[taken] <= time_now + delay:
        dt = SAMPLE_TIMES[taken] - time_now
        states[taken] = np.array([y[0] + DRIVE_X * dt, y[1] + DRIVE_Y * dt, 0.0, 0.0])
        taken += 1
    series, length = release(y[0] + DRIVE_X * delay, y[1] + DRIVE_Y * delay, tolerance)
    time_now += delay
    while taken < len(SAMPLE_TIMES) and SAMPLE_TIMES[taken] <= time_now + length:
        states[taken] = cartesian(release_at(series, SAMPLE_TIMES[taken] - time_now))
        taken += 1
    return release_at(series, length), time_now + length, taken, length


def compiled(njit):
    """Have Numba compile the functions above."""
    names = "friction friction_slope cartesian_rhs polar_rhs rest_delay release release_at brake brake_at cartesian stick"
    for name in names.split():
        globals()[name] = njit(globals()[name])


class LimitReached(Exception):
    pass


def runs():
    """One Run for each combination of the comma-separated values of the arguments "key=value,value"."""
    words = dict(word.split("=", 1) for word in sys.argv[1:])
    for values in itertools.product(*(text.split(",") for text in words.values())):
        yield Run(dict(zip(words, values, strict=True)))


class Run:
    """Settings, clock (processor time) and printed line of one run."""

    def __init__(self, given):
        self.given = given
        self.method = given.get("method", "")
        self.formulation = given.get("formulation", "polar")
        self.polar = self.formulation == "polar"
        defaults = {"rtol": 1e-6, "v_cut": 1e-8, "v_s": 0.0, "limit": 60.0, "first_step": 0.3}
        numbers = [float(given.get(key, default)) for key, default in defaults.items()]
        self.rtol, self.v_cut, self.v_s, self.limit, self.share = numbers
        self.scale = POLAR_SCALE if self.polar else CARTESIAN_SCALE
        self.tolerance = max(0.1 * self.rtol, 1e-14)
        self.states = np.zeros((len(SAMPLE_TIMES), 4))
        self.taken = self.stops = self.steps = 0
        self.time = 0.0
        self.begun = time.process_time()

    def finished(self):
        return self.taken == len(SAMPLE_TIMES)

    def sample(self, y):
        self.states[self.taken] = cartesian(y) if self.polar else y
        self.taken += 1

    def over_time(self):
        return time.process_time() - self.begun > self.limit

    def check_clock(self):
        if self.over_time():
            raise LimitReached("time limit")

    def initial(self):
        if self.polar:
            return np.array([0.0, 0.0, VELOCITY_RATIO * VELOCITY, MISALIGNMENT])
        return np.array([0.0, 0.0, VELOCITY_RATIO * DRIVE_X, VELOCITY_RATIO * DRIVE_Y])

    def follow(self, slip):
        """Slip, stop, rest and release in turn; slip(y, first_step, cut) ends at the first falling v = cut."""
        y, first_step = self.initial(), 0.1 * MASS * VELOCITY_RATIO * VELOCITY / F_0
        while not self.finished():
            cut = self.v_cut
            while not (y[2] <= 1.5 * cut and brake(*y)[2] > 0.0):
                y = slip(y, first_step, cut)
                if self.finished():
                    return
                if not y[2] > 0.0:
                    raise ArithmeticError("fell through the stop")
                if y[2] <= 1.5 * cut and brake(*y)[2] <= 0.0:
                    cut = 0.1 * y[2]
            y, self.time, self.taken, length = stick(y, self.time, self.tolerance, self.states, self.taken)
            self.stops += 1
            first_step = self.share * length

    def report(self, work):
        """Run work() and print the line that run.py reads."""
        self.begun = time.process_time()
        try:
            work()
            status = "done"
        except Exception as failure:
            status = str(failure) or type(failure).__name__
        self.print(status)

    def print(self, status):
        line = {
            "given": self.given,
            "status": status.replace("\n", " "),
            "seconds": time.process_time() - self.begun,
            "time": float(self.time),
            "stops": int(self.stops),
            "steps": int(self.steps),
            "states": self.states[: self.taken].tolist(),
        }
        print(json.dumps(line), flush=True)
