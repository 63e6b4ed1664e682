"""Dampers beside the springs: `system.damping_x` and `damping_y`."""

from __future__ import annotations

import math

import dynstiction as ds
import fig3
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

IMPLICIT = ["radau5", "radau9", "radau13"]
EXPLICIT = ["dopri5", "dop853"]
ADAPTIVE = [*IMPLICIT, *EXPLICIT]

Vector = NDArray[np.float64]


def scene(*changes: fig3.Groups, model: str = "full", method: str = "radau13", rtol: float = 1e-10, t_end: float = 1.0) -> ds.Scene:
    """The apparatus of Fig. 3 from rest, changed."""
    return ds.Scene(
        **fig3.changed(
            fig3.slider(),
            {"scene": {"model": model, "t_end": t_end}, "integrator": {"method": method, "rtol": rtol}, "output": {"interval": 1e-3}},
            *changes,
        )
    )


def free(theta_deg: float, method: str, rtol: float, **damping: float) -> ds.Result:
    """Slip without friction of a spring that is let go, under no drive: two damped oscillators."""
    return ds.run(
        scene(
            {
                "system": {"stiffness_y": 4e3, "misalignment_deg": theta_deg, **damping},
                "friction": {**fig3.CONSTANT, "mu_0": 0.0},
                "drive": {"velocity": 0.0},
                "initial": {"elongation_x": 1e-3, "elongation_y": 5e-4},
            },
            method=method,
            rtol=rtol,
            t_end=0.5,
        )
    )


def oscillator(t: Vector, u_0: float, mass: float, stiffness: float, damping: float) -> Vector:
    """u(t) of m u'' + c u' + k u = 0 from rest at u_0."""
    roots = np.roots([mass, damping, stiffness]).astype(complex)
    a = u_0 * roots[1] / (roots[1] - roots[0])
    return np.real(a * np.exp(roots[0] * t) + (u_0 - a) * np.exp(roots[1] * t))


@pytest.mark.parametrize("method", ADAPTIVE)
@pytest.mark.parametrize(("damping_x", "damping_y"), [(0.7, 0.0), (0.0, 3.0), (2.0, 5.0), (40.0, 2.0)])
def test_free_decay(method: str, damping_x: float, damping_y: float) -> None:
    """Every sample of two free oscillations, from below to above the critical damping, 31.6 and 63.2 N s/m."""
    result = free(20.0, method, 1e-11, damping_x=damping_x, damping_y=damping_y)
    for name, u_0, k, c in (("u_x", 1e-3, 1e3, damping_x), ("u_y", 5e-4, 4e3, damping_y)):
        expected = oscillator(result.time, u_0, 0.25, k, c)
        np.testing.assert_allclose(result[name], expected, rtol=0, atol=1e-8 * u_0)


@pytest.mark.parametrize("method", ADAPTIVE)
def test_decay_rate_and_frequency(method: str) -> None:
    """Rate c/2m and frequency of what is left between two maxima, to 1e-8."""
    result = free(0.0, method, 1e-12, damping_x=1.5)
    rate, frequency = 1.5 / 0.5, math.sqrt(1e3 / 0.25 - (1.5 / 0.5) ** 2)
    # u and u' = -w are known at every sample: the complex amplitude w + (rate - i frequency) u turns and decays as a whole.
    amplitude = -result["w_x"] + (rate + 1j * frequency) * result["u_x"]
    growth = np.polyfit(result.time, np.log(np.abs(amplitude)), 1)[0]
    turning = np.polyfit(result.time, np.unwrap(np.angle(amplitude)), 1)[0]
    assert growth == pytest.approx(-rate, rel=1e-8)
    assert abs(turning) == pytest.approx(frequency, rel=1e-8)


class Reference:
    """The same motion by another program: slip in Cartesian velocities between events, each phase by scipy."""

    def __init__(self, system: dict[str, float], friction: dict[str, float], times: Vector, velocities: Vector) -> None:
        phi = math.radians(system["misalignment_deg"])
        self.m, self.e = system["mass"], np.array([math.cos(phi), math.sin(phi)])
        self.k = np.array([system["stiffness_x"], system["stiffness_y"]])
        self.c = np.array([system["damping_x"], system["damping_y"]])
        self.f = friction
        self.times, self.velocities = times, velocities

    def friction_at(self, v: float) -> float:
        f = self.f
        return f["normal_load"] * (f["mu_inf"] + (f["mu_0"] - f["mu_inf"]) * math.exp(-v / f["v_f"]))

    def run(self, t_end: float, sampled: Vector) -> tuple[Vector, Vector]:
        """(u_x, u_y, w_x, w_y) at the times, and the works of drive, friction and dampers."""
        values = np.empty((sampled.size, 4))
        state, sticks = np.zeros(7), True
        knots = [*(t for t in self.times if t < t_end), t_end]
        for begin, end in zip(knots[:-1], knots[1:], strict=True):
            if end <= begin:
                continue
            first = int(np.searchsorted(self.times, begin, side="right")) - 1
            v_0 = self.velocities[first]
            ramp = 0.0
            if first + 1 < self.times.size:
                ramp = (self.velocities[first + 1] - v_0) / (self.times[first + 1] - self.times[first])
            state, sticks = self.stretch(begin, end, v_0, ramp, state, sticks, sampled, values)
        return values, state[4:]

    def stretch(self, begin, end, v_0, ramp, state, sticks, sampled, values):  # type: ignore[no-untyped-def]
        """One stretch of the drive on which V is linear."""
        t = begin
        limit = self.friction_at(0.0)

        def drive(t: float) -> float:
            return v_0 + ramp * (t - begin)

        def at_rest(t: float, y: Vector) -> Vector:
            return self.k * y[:2] + self.c * drive(t) * self.e

        def stuck(t: float, y: Vector) -> Vector:
            rate = drive(t) * self.e
            force = at_rest(t, y)
            return np.array([*rate, 0.0, 0.0, rate @ force, 0.0, rate @ (self.c * rate)])

        def slip(t: float, y: Vector) -> Vector:
            w = y[2:4]
            v = math.hypot(*w)
            rate = drive(t) * self.e - w
            force = self.k * y[:2] + self.c * rate
            friction = self.friction_at(v)
            n = w / v if v > 0.0 else at_rest(t, y) / math.hypot(*at_rest(t, y))
            return np.array(
                [*rate, *((force - friction * n) / self.m), drive(t) * (self.e @ force), friction * v, rate @ (self.c * rate)]
            )

        def stops(t: float, y: Vector) -> float:
            return float(y[2] ** 2 + y[3] ** 2) - 1e-24

        def release(t: float, y: Vector) -> float:
            return math.hypot(*at_rest(t, y)) - limit

        release.terminal, release.direction = True, 1.0  # type: ignore[attr-defined]
        stops.terminal, stops.direction = True, -1.0  # type: ignore[attr-defined]
        while t < end:
            if sticks:
                if release(t, state) > 1e-12 * limit:
                    sticks = False
                    continue
                step = solve_ivp(stuck, (t, end), state, "DOP853", rtol=1e-13, atol=1e-18, events=release, dense_output=True)
            else:
                # From rest the object sets off along the force; a Taylor step leads past v = 0.
                if not np.any(state[2:4]):
                    force = at_rest(t, state)
                    n = force / math.hypot(*force)
                    growth = (self.k * drive(t) + self.c * ramp) * self.e
                    rate = max(0.0, math.hypot(*force) - limit) / self.m
                    h = 1e-7
                    state = state + h * stuck(t, state)
                    state[2:4] = (rate * h + 0.5 * h * h * float(growth @ n) / self.m) * n
                    t += h

                step = solve_ivp(slip, (t, end), state, "Radau", rtol=1e-10, atol=1e-15, events=stops, dense_output=True)
            inside = (sampled >= t) & (sampled <= step.t[-1])
            values[inside] = step.sol(sampled[inside]).T[:, :4]
            t, state = float(step.t[-1]), step.y[:, -1]
            if step.status == 1:
                sticks = not sticks
                state[2:4] = 0.0
        return state, sticks
