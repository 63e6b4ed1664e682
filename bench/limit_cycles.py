"""Limit cycles and the ends of stick-slip, found without runs: their cost, and whether other methods agree.

    python bench/limit_cycles.py [--short]

Prints the time of `dynstiction.cycles` on Fig. 3 and how far its cycles are from those of settled runs. Then the slow motion, whose
cycles SciPy's `solve_bvp` computes a second time by collocation, as boundary value problems: no step of that method is shared with a run
or with a map. Compared are the angle at which stick-slip ends for each velocity of docs/maps.md and others, a swing of 5 % of F_0 or a
fold, where the angle of the cycles is largest; and valley, peak, period and multiplier of three cycles, one of them unstable. Fails if one differs by more than 1e-7.
"""

import sys
from functools import partial
from statistics import median

import dynstiction as ds
import numpy as np
from common import FIG3, options_of, timed
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import minimize_scalar

# A stiff axis on which the slow motion holds at every velocity.
SLOW = ds.Scene(FIG3).replace(system={"stiffness_y": 1e10})
MASS, STIFFNESS, LIMIT, V_F = 0.25, 1e3, 2.0, 10e-3
"""kg, N/m, N, m/s"""
FALL = 0.25
"""1 - mu_inf/mu_0"""
LEAST = 0.05
"""Swing at which stick-slip ends, over F_0."""
VELOCITIES = (0.1e-3, 0.3e-3, 1e-3, 10e-3, 30e-3, 38e-3, 40e-3, 50e-3, 75e-3, 100e-3)
CLOSE = 1e-7
"""Largest permitted difference, relative to the value. It was at most 2e-10."""


def main() -> None:
    options = options_of(__doc__, repetitions=(21, 3))
    for model in ("low_frequency", "full"):
        found = ds.cycles(FIG3, model=model)
        seconds = median(timed(partial(ds.cycles, FIG3, model=model), options.repetitions)[0])
        print(f"cycles, {model:13s} {1e3 * seconds:8.1f} ms, from the settled run {distance(found):.1e}")
    print(
        "| V [mm/s] | value | this project | by collocation | difference |\n| --- | --- | --- | --- | --- |"
    )
    worst = max(map(compared, VELOCITIES[3:7:3] if options.short else VELOCITIES))
    if not options.short:
        worst = max(worst, *(compared_cycles(*each) for each in ((75e-3, 3.5), (1e-3, 1.0))))
    print(f"largest difference: {worst:.0e}")
    sys.exit(int(worst > CLOSE))


def distance(found: ds.Cycles) -> float:
    """Largest relative difference of period, peak and valley between the stable cycle and the last cycle of a settled run."""
    run = ds.run(
        FIG3,
        scene={"model": found.model, "t_end": 60.0, "settle": 1e-10},
        integrator={"method": "radau13", "rtol": 1e-12},
        output={"interval": 60.0},
        **({"stiffness_y": None, "contact": None} if found.model == "low_frequency" else {}),
    )
    names = ("period", "peak_force", "valley_force")
    return max(abs(getattr(found.stable[-1], name) / run.summary[name] - 1.0) for name in names)


# By this project


def slow(velocity: float, angle: float) -> ds.Cycles:
    return ds.cycles(SLOW.replace(velocity=velocity, misalignment_deg=angle), model="low_frequency")


def end_of_stick_slip(velocity: float, low: float, high: float) -> tuple[float, bool]:
    """The angle [deg] between two from which on no stable cycle swings by 5 % of F_0, and whether it is a fold."""
    while high - low > 1e-13 * high:
        middle = 0.5 * (low + high)
        goes_on = any(cycle.swing >= LEAST * LIMIT for cycle in slow(velocity, middle).stable)
        low, high = (middle, high) if goes_on else (low, middle)
    return high, bool(slow(velocity, high * (1.0 - 1e-6)).unstable)


# By collocation. Unknowns u = k_x u_x/F_0 and w = w_x/V, time in units of sqrt(m/k_x).


def rates(u: np.ndarray, w: np.ndarray, velocity: float, angle: float) -> np.ndarray:
    inertia = velocity * np.sqrt(MASS * STIFFNESS) / LIMIT
    speed = np.hypot(w, np.sin(angle))
    friction = 1.0 - FALL + FALL * np.exp(-velocity * speed / V_F)
    return np.array([inertia * (np.cos(angle) - w), (u - friction * w / speed) / inertia])


class Orbit:
    """A cycle: the rise of the load from its valley to its peak, and its fall, each over its own duration."""

    def __init__(self, velocity: float, angle_deg: float, cycle: ds.LimitCycle) -> None:
        """A first guess, by an integration from the valley of a cycle near by."""
        angle, period = np.radians(angle_deg), cycle.period * np.sqrt(STIFFNESS / MASS)
        found = solve_ivp(
            lambda _, y: rates(*y, velocity, angle), (0.0, period), [cycle.valley_force / LIMIT, np.cos(angle)],
            method="Radau", rtol=1e-9, atol=1e-12, dense_output=True,
        )  # fmt: skip
        rise = found.t[np.argmax(found.y[0])]
        self.values = {"velocity": velocity, "angle": angle, "swing": np.ptp(found.y[0])}
        self.durations = np.array([rise, period - rise])
        before = found.t <= rise
        self.place = np.unique([*found.t[before] / rise, *(found.t[~before] - rise) / (period - rise), 1.0])
        self.states = np.vstack(
            [found.sol(self.place * rise), found.sol(rise + self.place * (period - rise))]
        )

    def solve(self, free: str, **given: float) -> "Orbit":
        """The cycle with given values of the velocity and of angle or swing, the other one free."""
        fixed = {name: value for name, value in (self.values | given).items() if name != free}

        def of_halves(_: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
            known = fixed | {free: p[2]}
            return np.vstack(
                [p[i] * rates(*y[2 * i : 2 * i + 2], known["velocity"], known["angle"]) for i in (0, 1)]
            )

        def ends(valley: np.ndarray, peak: np.ndarray, p: np.ndarray) -> np.ndarray:
            known = fixed | {free: p[2]}
            # The load is extreme where w = cos(angle).
            turns = [valley[1] - np.cos(known["angle"]), peak[1] - np.cos(known["angle"])]
            return np.array(
                [
                    *turns,
                    *(valley[2:] - peak[:2]),
                    *(peak[2:] - valley[:2]),
                    peak[0] - valley[0] - known["swing"],
                ]
            )

        found = solve_bvp(
            of_halves,
            ends,
            self.place,
            self.states,
            [*self.durations, self.values[free]],
            tol=1e-8,
            max_nodes=100_000,
        )
        if not found.success:
            raise SystemExit(f"limit_cycles.py: solve_bvp: {found.message}")
        self.place, self.states, self.durations = found.x, found.y, found.p[:2]
        self.values = fixed | {free: found.p[2]}
        self.solution = found.sol
        return self

    def fold(self) -> float:
        """The largest angle over the swings near by."""
        least, most = 0.9 * self.values["swing"], 1.1 * self.values["swing"]

        def fallen(swing: float) -> float:
            return -self.solve("angle", swing=swing).values["angle"]

        return -minimize_scalar(fallen, bounds=(least, most), method="bounded").fun

    def measures(self) -> dict[str, float]:
        """Valley and peak over F_0, period [s], and the multiplier, e to the integral of dw'/dw, by Gauss quadrature."""
        nodes, weights = np.polynomial.legendre.leggauss(5)
        width = np.diff(self.place)
        place = self.place[:-1, np.newaxis] + 0.5 * width[:, np.newaxis] * (1.0 + nodes)
        across, velocity = np.sin(self.values["angle"]), self.values["velocity"]
        growth = 0.0
        for duration, w in zip(self.durations, self.solution(place)[1::2], strict=True):
            speed = np.hypot(w, across)
            weakening = FALL * np.exp(-velocity * speed / V_F)
            slope = (1.0 - FALL + weakening) * across**2 / speed**3 - weakening * velocity / V_F * (
                w / speed
            ) ** 2
            growth -= (
                duration * 0.5 * width @ slope @ weights / (velocity * np.sqrt(MASS * STIFFNESS) / LIMIT)
            )
        return {"valley": self.states[0, 0], "peak": self.states[0, -1],
                "period [s]": sum(self.durations) * np.sqrt(MASS / STIFFNESS), "multiplier": np.exp(growth)}  # fmt: skip


# Both


def compared(velocity: float) -> float:
    """The end of stick-slip at a velocity."""
    end, is_fold = end_of_stick_slip(velocity, 0.5, 25.0)
    near = 0.9999 * end if is_fold else end
    orbit = Orbit(velocity, near, slow(velocity, near).stable[-1])
    angle = orbit.fold() if is_fold else orbit.solve("angle", swing=LEAST).values["angle"]
    return row(velocity, f"{'fold' if is_fold else 'swing of 5 %'} at φ [deg]", end, np.degrees(angle))


def compared_cycles(velocity: float, angle: float) -> float:
    """The cycles of a velocity and an angle, stable and unstable."""
    worst = 0.0
    for cycle in slow(velocity, angle).cycles:
        ours = (cycle.valley_force / LIMIT, cycle.peak_force / LIMIT, cycle.period, cycle.multiplier)
        found = Orbit(velocity, angle, cycle).solve("swing").measures()
        for own, (name, other) in zip(ours, found.items(), strict=True):
            # That of Fig. 3 is 0 beside rounding.
            if own:
                worst = max(worst, row(velocity, f"φ = {angle:g}°, {name}", own, other))
    return worst


def row(velocity: float, what: str, ours: float, other: float) -> float:
    difference = abs(other / ours - 1.0)
    print(f"| {1e3 * velocity:g} | {what} | {ours:.10g} | {other:.10g} | {difference:.0e} |", flush=True)
    return difference


if __name__ == "__main__":
    main()
