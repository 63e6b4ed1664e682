"""How often `creep_test` names what makes a rig stick: creep, a static limit, or ageing.

    python bench/creep_test.py [--count 50] [--first 1] [--short]

Rigs are random; a trace has 20 cycles at 1 kHz and noise of 1 % of the swing, two traces at speeds a factor of four apart share that
time for ageing and static friction (at one speed both show the same limit). Rigs that do not creep have no misalignment. The deck
with which a test begins is wrong by up to 20 %. Prints a table in Markdown for so many of each.
"""

import sys
import time
import warnings

import dynstiction as ds
import numpy as np
from common import options_of
from fit import RIG, trace_of

KINDS = ("creep", "static", "ageing", "static or ageing")
RATE, CYCLES, NOISE, AWAY = 1e3, 20.6, 0.01, 0.2
SPEEDS = 4.0
"""Ratio of the two speeds."""


def draw_rig(kind: str, draw: np.random.Generator) -> tuple[dict[str, float], ds.Scene, list[float]]:
    """Values that the deck will have wrong, the scene, and its speeds."""
    mu_0 = draw.uniform(0.15, 0.5)
    values = {
        "friction.mu_0": mu_0,
        "friction.mu_inf": mu_0 * draw.uniform(0.6, 0.85),
        "friction.v_f": 10.0 ** draw.uniform(-2.5, -1.7),
        "system.mass": 10.0 ** draw.uniform(-0.8, 0.3),
        "system.stiffness_x": 10.0 ** draw.uniform(2.7, 3.5),
    }
    velocity = 10.0 ** draw.uniform(-3.3, -2.7)
    what: dict[str, float] = {"misalignment_deg": 0.0}
    if kind == "creep":
        what = {"misalignment_deg": float(np.exp(draw.uniform(np.log(0.5), np.log(3.0))))}
    elif kind == "ageing":
        what |= {"ageing": mu_0 * draw.uniform(0.006, 0.03), "ageing_time": 1e-3}
    elif kind == "static" or draw.uniform() < 0.5:
        what["mu_static"] = mu_0 * (draw.uniform(1.03, 1.25) if kind == "static" else 1.1)
    speeds = [velocity, SPEEDS * velocity] if kind in ("static", "ageing") else [velocity]
    return values, RIG.replace(**values, **what), speeds


def traces_of(
    kind: str, draw: np.random.Generator
) -> tuple[ds.Scene, list[ds.Trace], dict[str, list[float]]]:
    """The deck to begin with, the traces, and what differs from one to the other."""
    while True:
        values, scene, speeds = draw_rig(kind, draw)
        traces = []
        for speed in speeds:
            moved = scene.replace(velocity=speed)
            about = ds.run(moved, settle=1e-7, t_end=60.0, interval=1.0)
            period, slip = (about.summary.get(name, 0.0) for name in ("period", "slip_duration"))
            if "settled_at" not in about.summary or not 20.0 / RATE < slip < 0.2 * period:
                break
            traces.append(
                trace_of(moved, float(about.time[-1]), CYCLES / len(speeds) * period, RATE, NOISE, draw)
            )
        if len(traces) == len(speeds):
            break
    start = {name: value * np.exp(draw.uniform(-AWAY, AWAY)) for name, value in values.items()}
    start["friction.mu_inf"] = min(start["friction.mu_inf"], 0.9 * start["friction.mu_0"])
    deck = RIG.replace(**start, misalignment_deg=1.0, velocity=speeds[0])
    return deck, traces, {"drive.velocity": speeds}


def main() -> None:
    options = options_of(__doc__, count=(50, 1), first=1)
    warnings.simplefilter("ignore")
    print(
        "| made with | named right | not named | named wrong | median time | longest |\n| --- | --- | --- | --- | --- | --- |"
    )
    for number, kind in enumerate(KINDS[: 1 if options.short else None]):
        named, times = [], []
        for seed in range(options.first, options.first + options.count):
            deck, traces, each = traces_of(kind, np.random.default_rng([number, seed]))
            begun = time.process_time()
            found = ds.creep_test(deck, traces, each=each)
            times.append(time.process_time() - begun)
            named.append(found.named)
            if found.named != kind:
                print(f"{kind} {seed}: {found}", file=sys.stderr)
        right, none = named.count(kind), named.count(None)
        print(
            f"| {kind} | {right} | {none} | {len(named) - right - none} | {np.median(times):.1f} s | {max(times):.1f} s |",
            flush=True,
        )


if __name__ == "__main__":
    main()
