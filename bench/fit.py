"""What fits determine, and their reliability: how often the 95 % intervals contain the true values, for synthetic traces of rigs.

    python bench/fit.py [intervals] [errors] [--count 200] [--first 1] [--noise 0.01] [--rate 1000] [--ratio LOW,HIGH] [--irregular]
        [--independent] [--chain] [--short]

intervals: Each trace is a settled run of the full model, 20 cycles at 1 kHz with noise of 1 % of the swing. Random parameters are
misalignment, both friction coefficients, v_f, mass, soft stiffness and drive velocity. All except the velocity are free in the fit,
which begins at values that differ from the true ones by up to 30 %. Only rigs with repeating stick-slip are used, with at least 20
samples in a slip and slips that take less than a quarter of the period. --first: number of the first rig; --ratio: a random k_y/k_x in
place of k_y = 1e7 N/m, and 2 to 100 sticks in each cycle; --irregular: rigs whose cycles are not alike, 40 of them, at 2 kHz. --independent: the traces are those of
tests/audit/reference.cpp, which shares nothing with the program (needs g++), 40 cycles at 2 kHz. --chain: they are read from a table below
a preamble of 30 lines, behind a low pass of 300 Hz, with a zero that is off and drifts, hum and 12 bits; the zero is free, too.

errors: A table in Markdown, standard errors of the parameters of one rig, and of a law of any shape. Writes docs/figures/fit.png.
"""

import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator

import dynstiction as ds
import numpy as np
from common import FIG3, ROOT, options_of
from dynstiction.plot.style import write

FREE = (
    "system.misalignment_deg",
    "friction.mu_0",
    "friction.mu_inf",
    "friction.v_f",
    "system.mass",
    "system.stiffness_x",
)
RIG = ds.Scene(FIG3, rtol=1e-7)
CYCLES, CYCLES_OF_IRREGULAR = 20.6, 40.6
FASTEST = 20.0
"""Least number of samples in a slip."""
SHORTEST = 0.25
"""Longest slip, as a share of the period."""
ALIKE = 0.01
"""Least scatter of the period of an irregular rig, relative to it."""
AWAY = 0.3
"""Largest change of a logarithm from the true value to the start of a fit."""


def rigs(
    seed: int, rate: float, ratio: str = "", irregular: bool = False
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
        scene = RIG.replace(**values, velocity=10.0 ** draw.uniform(-3.5, -2.5))
        if ratio:
            share = float(np.exp(draw.uniform(*np.log([float(each) for each in ratio.split(",")]))))
            scene = scene.replace(stiffness_y=share * scene.system.stiffness_x)
        # The drive loads the soft spring to F_0 in this time.
        loading = mu_0 * scene.friction.normal_load / (scene.system.stiffness_x * scene.drive.velocity)
        settled = ds.run(scene, settle=1e-7, t_end=30.0 * loading, interval=loading)
        about = settled.summary
        if (about.get("regularity") == -1) if irregular else ("settled_at" in about):
            slip, period = about["slip_duration"], about["period"]
        else:
            continue
        if irregular and about["period_scatter"] < ALIKE * period:
            continue
        if ratio and not 2.0 <= about["sticks"] / about["cycles"] <= 100.0:
            continue
        if slip * rate >= FASTEST and slip <= SHORTEST * period:
            yield values, scene, float(period), float(settled.time[-1])


def trace_of(
    scene: ds.Scene, begin: float, duration: float, rate: float, noise: float, draw: np.random.Generator
) -> ds.Trace:
    """The force from a time on, with noise relative to its swing."""
    run = ds.run(
        scene, t_end=begin + duration, interval=1.0 / rate, fields=["spring_force_x", "spring_force_y"]
    )
    trace = ds.Trace.of(run).part(start=begin)
    return trace.with_noise(noise * np.ptp(trace.force), draw)


def independent_trace_of(
    scene: ds.Scene, begin: float, duration: float, rate: float, noise: float, draw: np.random.Generator
) -> ds.Trace:
    """The same by an independent program, from a rest just before a slip."""
    sys.path.insert(0, str(ROOT / "tests" / "audit"))
    from truth import build, parse  # noqa: PLC0415  (needs a compiler)

    groups = scene.groups()
    keys = groups["system"] | groups["friction"] | groups["drive"]
    loaded = 0.9 * keys["mu_0"] * keys["normal_load"] / keys["stiffness_x"]
    times = begin + np.arange(0.0, duration, 1.0 / rate)
    given = {name: value for name, value in keys.items() if isinstance(value, float)} | {
        "elongation_x": loaded, "t_end": begin + duration, "stages": 5, "tolerance": 1e-8,
    }  # fmt: skip
    lines = [f"{name} {value!r}" for name, value in given.items()]
    lines.append("samples " + " ".join(map(repr, times.tolist())))
    program = build(ROOT / "build" / "audit")
    said = subprocess.run([program], input="\n".join(lines), capture_output=True, text=True, check=True)
    truth = parse(said.stdout)
    phi = np.radians(keys["misalignment_deg"])
    force = keys["stiffness_x"] * truth.u[0] * np.cos(phi) + keys["stiffness_y"] * truth.u[1] * np.sin(phi)
    trace = ds.Trace(truth.time[: times.size] - begin, force[: times.size])
    return trace.with_noise(noise * np.ptp(trace.force), draw)


def behind_a_chain(trace: ds.Trace, draw: np.random.Generator) -> ds.Trace:
    """The trace as a rig writes it."""
    swing = np.ptp(trace.force)
    tare, drift = 0.35 * swing * draw.uniform(-1.0, 1.0), 0.02 * swing / trace.duration
    shown = ds.Chain(filter=300.0, tare=tare, drift=drift, hum=0.005 * swing, step=2.0 * swing / 2**12)(trace)
    with tempfile.NamedTemporaryFile("w", suffix=".csv") as file:
        file.write("".join(f"Setting {i}: {i}\n" for i in range(28)) + "time;force\ns;N\n")
        np.savetxt(file, np.column_stack([shown.time, shown.force]), "%.7g", ";")
        file.flush()
        return ds.read_trace(file.name)


def print_intervals(options) -> None:
    inside, times, warned, refused = [], [], 0, 0
    many = options.irregular or options.independent
    chain = ds.Chain(filter=300.0, tare=0.01) if options.chain else ds.Chain()
    free = (*FREE, "chain.tare") if options.chain else FREE
    cycles, rate = (CYCLES_OF_IRREGULAR, 2.0 * options.rate) if many else (CYCLES, options.rate)
    make = independent_trace_of if options.independent else trace_of
    for seed in range(options.first, options.first + options.count):
        values, scene, period, settled = next(rigs(seed, rate, options.ratio, options.irregular))
        draw = np.random.default_rng(seed)
        away = draw.uniform(0.0, 0.5) * period
        trace = make(scene, settled + away, cycles * period - away, rate, options.noise, draw)
        if options.chain:
            trace = behind_a_chain(trace, draw)
        draw = np.random.default_rng(seed + 1_000_000)
        deck = scene.replace(
            **{name: value * np.exp(draw.uniform(-AWAY, AWAY)) for name, value in values.items()}
        )
        started = time.process_time()
        try:
            found = ds.fit(deck, trace, free, chain=chain)
        except ds.Error as error:
            refused += 1
            print(f"{seed:5d} refused: {error}", flush=True)
            continue
        times.append(time.process_time() - started)
        held = [
            low <= values[name] <= high if found.parameters[name].told else None
            for name in FREE for low, high in [found.interval(name)]
        ]  # fmt: skip
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
    print(f"{len(inside)} fits that explain their trace, {warned} that warn, {refused} refused")
    if inside:
        told = [h for row in inside for h in row if h is not None]
        print(f"95 % intervals that contain the true value: {100.0 * np.mean(told):.1f} % of {len(told)}")
        for name, row in zip(FREE, zip(*inside, strict=True), strict=True):
            column = [h for h in row if h is not None]
            print(f"  {name:24s} {100.0 * np.mean(column):5.1f} % of {len(column)}")
        print(
            f"processor time of a fit: median {np.median(times):.2f} s, 95 % below {np.quantile(times, 0.95):.2f} s, longest {max(times):.2f} s"
        )


def print_errors(options) -> None:
    """Standard errors, relative to the values, of a rig with a period of 0.95 s."""
    rig = RIG.replace(misalignment_deg=1.4, stiffness_x=900.0, mass=0.4, mu_0=0.24, mu_inf=0.19)
    period = ds.run(rig, settle=1e-7, t_end=60.0, interval=1.0).summary["period"]
    fit = ds.fit(
        rig,
        trace_of(rig, 4.0 * period, CYCLES * period, options.rate, options.noise, np.random.default_rng(1)),
        FREE,
    )
    names = " | ".join(name.partition(".")[2] for name in FREE)
    print(f"| samples per second | noise, of the swing | {names} |")
    print("| --- " * (len(FREE) + 2) + "|")
    for law in ("", ", any law"):
        cells = [
            f"{100.0 * (p.law_error if law else p.error) / p.value:.2g} %" if p.told else "–"
            for p in (fit.parameters[name] for name in FREE)
        ]
        print(f"| {options.rate:g} | {100.0 * options.noise:g} %{law} | {' | '.join(cells)} |")
    if not options.short:
        write(fit.plot(), ROOT / "docs" / "figures" / "fit.png")


def main() -> None:
    options = options_of(
        __doc__,
        "intervals",
        "errors",
        count=(200, 4),
        first=1,
        noise=0.01,
        rate=1e3,
        ratio="",
        irregular=False,
        independent=False,
        chain=False,
    )
    warnings.simplefilter("ignore")
    for word in options.words:
        {"intervals": print_intervals, "errors": print_errors}[word](options)


if __name__ == "__main__":
    main()
