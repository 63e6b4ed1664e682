"""How often `creep_test` names what makes a rig stick: creep, a static limit, or ageing.

Rigs are random; a trace has 20 cycles at 1 kHz and noise of 1 % of the swing, two traces at speeds a factor of four apart share that
time for ageing and static friction (at one speed both show the same limit). Traces with creep are runs of the full model; the others come from
an integration of their own, in one dimension by SciPy, which shares nothing with the program. `python bench/creep_test.py --count 10`
makes so many of each; the deck with which a test begins is wrong by up to 20 %.
"""

from __future__ import annotations

import sys
import time
import warnings

import dynstiction as ds
import numpy as np
from common import parser_of
from fit import RIG, with_values
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

KINDS = ("creep", "static", "ageing", "static or ageing")
RATE, CYCLES, NOISE, AWAY = 1e3, 20.6, 0.01, 0.2
SPEEDS = 4.0
"""Ratio of the two speeds."""
LOAD = 10.0
"""Normal load [N]."""


def draw_rig(draw: np.random.Generator) -> dict[str, float]:
    mu_0 = draw.uniform(0.15, 0.5)
    return {
        "friction.mu_0": mu_0,
        "friction.mu_inf": mu_0 * draw.uniform(0.6, 0.85),
        "friction.v_f": 10.0 ** draw.uniform(-2.5, -1.7),
        "system.mass": 10.0 ** draw.uniform(-0.8, 0.3),
        "system.stiffness_x": 10.0 ** draw.uniform(2.7, 3.5),
    }


def line(
    rig: dict[str, float], velocity: float, static: float, ageing: float, age: float, cycles: float
) -> NDArray[np.float64]:
    """Load of a rig without misalignment [N] at 1 kHz, after its first two cycles, for so many cycles."""
    k, m, weight = rig["system.stiffness_x"], rig["system.mass"], LOAD
    mu_0, mu_inf, v_f = (rig[f"friction.{name}"] for name in ("mu_0", "mu_inf", "v_f"))
    time_, load, now, u, releases = [], [], 0.0, 0.0, []

    def friction(w: float) -> float:
        return float((mu_inf + (mu_0 - mu_inf) * np.exp(-w / v_f)) * weight)

    while len(releases) < cycles + 4:
        # At rest the load rises to the limit, which grows.
        def excess(t: float, u: float = u) -> float:
            return k * (u + velocity * t) - (static + ageing * np.log1p(t / age)) * weight

        end = brentq(excess, 0.0, 100.0 * static * weight / (k * velocity), xtol=1e-12)
        time_.append(now + np.array([0.0, end]))
        load.append(k * (u + velocity * np.array([0.0, end])))
        now, u = now + end, u + velocity * end
        releases.append(now)

        def rates(_: float, y: NDArray[np.float64]) -> list[float]:
            return [velocity - y[1], (k * y[0] - friction(max(y[1], 0.0))) / m]

        def stops(t: float, y: NDArray[np.float64]) -> float:
            return y[1] if t > 1e-9 else 1.0

        stops.terminal, stops.direction = True, -1.0  # type: ignore[attr-defined]
        start = max(0.0, (k * u - mu_0 * weight) / m)
        # Without an excess the slip begins as t^2.
        first = 1e-6
        slip = [u + velocity * first, start * first + 0.5 * k * velocity / m * first**2]
        found = solve_ivp(
            rates,
            (first, 10.0 * np.sqrt(m / k) * np.pi),
            slip,
            events=stops,
            rtol=1e-9,
            atol=1e-13,
            max_step=0.02 * np.sqrt(m / k),
        )
        time_.append(now + found.t)
        load.append(k * found.y[0])
        now, u = now + found.t[-1], float(found.y[0, -1])
    grid = np.arange(releases[2] + 0.3 * (releases[3] - releases[2]), releases[-2], 1.0 / RATE)
    return np.interp(grid, np.concatenate(time_), np.concatenate(load))


def traces_of(
    kind: str, draw: np.random.Generator
) -> tuple[ds.Scene, list[ds.Trace], dict[str, list[float]]]:
    """The deck to begin with, the traces, and what differs from one to the other."""
    while True:
        rig = draw_rig(draw)
        velocity = 10.0 ** draw.uniform(-3.3, -2.7)
        limit = rig["friction.mu_0"]
        static = limit * draw.uniform(1.03, 1.25) if kind == "static" else limit
        ageing = limit * draw.uniform(0.006, 0.03) if kind == "ageing" else 0.0
        if kind == "static or ageing" and draw.uniform() < 0.5:
            static *= 1.1
        angle = float(np.exp(draw.uniform(np.log(0.5), np.log(3.0))))
        speeds = [velocity, SPEEDS * velocity] if kind in ("static", "ageing") else [velocity]
        scene = with_values(
            ds.Scene(RIG), rig | {"system.misalignment_deg": angle if kind == "creep" else 0.0}
        )
        forces = []
        for v in speeds:
            if kind == "creep":
                about = ds.run(
                    scene,
                    drive={"velocity": v},
                    scene={"settle": 1e-7, "t_end": 60.0},
                    output={"interval": 1.0},
                )
                if (
                    "settled_at" not in about.summary
                    or not 20.0 / RATE < about.summary["slip_duration"] < 0.2 * about.summary["period"]
                ):
                    break
                begin = float(about.time[-1])
                run = ds.run(
                    scene,
                    drive={"velocity": v},
                    scene={"t_end": begin + CYCLES * about.summary["period"]},
                    output={"interval": 1.0 / RATE, "fields": ["spring_force_x", "spring_force_y"]},
                )
                forces.append(ds.Trace.of(run).part(start=begin).force)
            else:
                radian = np.sqrt(rig["system.mass"] / rig["system.stiffness_x"])
                if not 20.0 / RATE < np.pi * radian < 0.05:
                    break
                forces.append(line(rig, v, static, ageing, 1e-3, CYCLES / len(speeds)))
                if np.ptp(forces[-1]) < 0.1 * limit * LOAD * (1.0 - rig["friction.mu_inf"] / limit):
                    break
        if len(forces) == len(speeds):
            break
    traces = []
    for force in forces:
        noisy = force + NOISE * np.ptp(force) * draw.standard_normal(force.size)
        traces.append(ds.Trace(np.arange(force.size) / RATE, noisy))
    start = {name: value * np.exp(draw.uniform(-AWAY, AWAY)) for name, value in rig.items()}
    start["friction.mu_inf"] = min(start["friction.mu_inf"], 0.9 * start["friction.mu_0"])
    deck = with_values(scene, start | {"system.misalignment_deg": 1.0, "drive.velocity": velocity})
    return deck, traces, {"drive.velocity": speeds}


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--first", type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    count = 1 if options.short else options.count
    print(
        "| made with | named right | not named | named wrong | median time | longest |\n| --- | --- | --- | --- | --- | --- |"
    )
    for number, kind in enumerate(KINDS):
        right, wrong, times = 0, [], []
        for seed in range(options.first, options.first + count):
            deck, traces, each = traces_of(kind, np.random.default_rng([number, seed]))
            begun = time.process_time()
            found = ds.creep_test(deck, traces, each=each)
            times.append(time.process_time() - begun)
            right += found.named == kind
            if found.named not in (kind, None):
                wrong.append(seed)
                print(f"{kind} {seed}: {found}", file=sys.stderr)
            elif found.named is None:
                print(f"{kind} {seed}: {found}", file=sys.stderr)
        print(
            f"| {kind} | {right} | {count - right - len(wrong)} | {len(wrong)} | {np.median(times):.1f} s | {max(times):.1f} s |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
