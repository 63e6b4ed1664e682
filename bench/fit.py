"""Reliability of fits: how often the 95 % intervals contain the true values, for synthetic traces of random rigs.

Each trace is a settled run of the full model, 20 cycles at 1 kHz with noise of 1 % of the swing. Random parameters are
misalignment, both friction coefficients, v_f, mass, soft stiffness and drive velocity. All except the velocity are free in the fit,
which begins at values that differ from the true ones by up to 30 %. Only rigs with repeating stick-slip are used, with at least 20
samples in a slip and slips that take less than a quarter of the period. `python bench/fit.py` fits 200 traces (`--count`); other
options are `--first N` (number of the first rig), `--noise`, `--ratio LOW HIGH`: a random k_y/k_x in place of k_y = 1e7 N/m, and
`--irregular`: rigs whose cycles are not alike, 40 of them, at 2 kHz.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Iterator

import dynstiction as ds
import numpy as np
from common import parser_of

FREE = (
    "system.misalignment_deg",
    "friction.mu_0",
    "friction.mu_inf",
    "friction.v_f",
    "system.mass",
    "system.stiffness_x",
)
RIG = """
&scene model = 'full', t_end = 10.0 /
&system mass = 0.25, stiffness_x = 1.0e3, stiffness_y = 1.0e7, misalignment_deg = 1.0 /
&friction mu_0 = 0.20, mu_inf = 0.15, v_f = 0.010, normal_load = 10.0 /
&drive velocity = 1.0e-3 /
&integrator rtol = 1.0e-7 /
"""
CYCLES, RATE = 20.6, 1.0e3
CYCLES_OF_IRREGULAR, RATE_OF_IRREGULAR = 40.6, 2.0e3
FASTEST = 20.0
"""Least number of samples in a slip."""
SHORTEST = 0.25
"""Longest slip, as a share of the period."""
ALIKE = 0.01
"""Least scatter of the period of an irregular rig, relative to it."""
AWAY = 0.3
"""Largest change of a logarithm from the true value to the start of a fit."""


def with_values(scene: ds.Scene, values: dict[str, float]) -> ds.Scene:
    return scene.replace(**{name: float(value) for name, value in values.items()})  # type: ignore[arg-type]


def rigs(
    seed: int, ratio: tuple[float, float] | None, irregular: bool = False
) -> Iterator[tuple[dict[str, float], ds.Scene, float, float]]:
    """Values, scene, period and time at which the motion has settled, for one rig after another."""
    draw = np.random.default_rng(seed)
    while True:
        mu_0 = draw.uniform(0.15, 0.6)
        values = {
            "system.misalignment_deg": float(np.exp(draw.uniform(np.log(0.5), np.log(3.0)))),
            "friction.mu_0": mu_0,
            "friction.mu_inf": mu_0 * draw.uniform(0.6, 0.9),
            "friction.v_f": 10.0 ** draw.uniform(-2.5, -1.5),
            "system.mass": 10.0 ** draw.uniform(-1.0, 0.5),
            "system.stiffness_x": 10.0 ** draw.uniform(2.5, 3.7),
        }
        velocity = 10.0 ** draw.uniform(-3.5, -2.5)
        known = {"drive.velocity": velocity}
        if ratio:
            share = float(np.exp(draw.uniform(*np.log(ratio))))
            known["system.stiffness_y"] = share * values["system.stiffness_x"]
        scene = with_values(ds.Scene(RIG), values | known)
        # The drive loads the soft spring to F_0 in this time.
        loading = (
            mu_0
            * float(str(scene.groups()["friction"]["normal_load"]))
            / (values["system.stiffness_x"] * velocity)
        )
        settled = ds.run(scene, scene={"settle": 1e-7, "t_end": 30.0 * loading}, output={"interval": loading})
        about = settled.summary
        if (about.get("regularity") == -1) if irregular else ("settled_at" in about):
            slip, period = about["slip_duration"], about["period"]
        else:
            continue
        if irregular and about["period_scatter"] < ALIKE * period:
            continue
        rate = RATE_OF_IRREGULAR if irregular else RATE
        if slip * rate >= FASTEST and slip <= SHORTEST * period:
            yield values, scene, float(period), float(settled.time[-1])


def trace_of(
    scene: ds.Scene, period: float, begin: float, noise: float, seed: int, irregular: bool = False
) -> ds.Trace:
    """The rig's force for 20 cycles, of an irregular one for 40, with noise."""
    cycles, rate = (CYCLES_OF_IRREGULAR, RATE_OF_IRREGULAR) if irregular else (CYCLES, RATE)
    draw = np.random.default_rng(seed)
    run = ds.run(
        scene,
        scene={"t_end": begin + cycles * period},
        output={"interval": 1.0 / rate, "fields": ["spring_force_x", "spring_force_y"]},
    )
    trace = ds.Trace.of(run).part(start=begin + draw.uniform(0.0, 0.5) * period)
    swing = np.ptp(trace.force)
    return ds.Trace(trace.time, trace.force + noise * swing * draw.standard_normal(trace.time.size))


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--ratio", type=float, nargs=2, metavar=("LOW", "HIGH"))
    parser.add_argument("--irregular", action="store_true")
    options = parser.parse_args()
    count = 4 if options.short else options.count
    inside: list[list[bool | None]] = []
    times, warned, refused = [], 0, 0
    for seed in range(options.first, options.first + count):
        values, scene, period, begin = next(rigs(seed, options.ratio, options.irregular))
        trace = trace_of(scene, period, begin, options.noise, seed, options.irregular)
        draw = np.random.default_rng(seed + 1_000_000)
        deck = with_values(scene, {k: v * np.exp(draw.uniform(-AWAY, AWAY)) for k, v in values.items()})
        started = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = ds.fit(deck, trace, FREE)
        except ds.Error as error:
            refused += 1
            print(f"{seed:5d} refused: {error}", flush=True)
            continue
        times.append(time.process_time() - started)
        ends = [found.interval(name) for name in FREE]
        held = [
            low <= values[name] <= high if found.parameters[name].told else None
            for name, (low, high) in zip(FREE, ends, strict=True)
        ]
        if found.explains:
            inside.append(held)
        else:
            warned += 1
        angle = found.parameters["system.misalignment_deg"]
        print(
            f"{seed:5d} period {period:6.3f} s, phi {values[FREE[0]]:5.3f} found {angle.value:6.3f} ± {angle.error:5.3f}, "
            f"{''.join('-' if h is None else '+' if h else 'x' for h in held)} misfit {found.misfit:.2f} {times[-1]:4.1f} s"
            f"{'' if found.explains else ' NOT EXPLAINED'}",
            flush=True,
        )
    told = [h for row in inside for h in row if h is not None]
    print(f"{len(inside)} fits that explain their trace, {warned} that warn, {refused} refused")
    if told:
        print(f"95 % intervals that contain the true value: {100.0 * np.mean(told):.1f} % of {len(told)}")
        for i, name in enumerate(FREE):
            column = [row[i] for row in inside if row[i] is not None]
            print(f"  {name:24s} {100.0 * np.mean(column):5.1f} % of {len(column)}")
        print(
            f"processor time of a fit: median {np.median(times):.2f} s, 95 % below {np.quantile(times, 0.95):.2f} s, longest {max(times):.2f} s"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
