"""Measure the numbers of docs/fit.md and draw its figure, so that readers can repeat them.

    python docs/fit.py [--short]

Prints a table in Markdown: standard errors of the parameters of a rig from a force trace along the pull, by noise and sampling. Writes
docs/figures/fit.png.
"""

import argparse
import warnings
from pathlib import Path

import dynstiction as ds
import numpy as np
from dynstiction.plot.style import write

DOCS = Path(__file__).resolve().parent
RIG = ds.Scene(DOCS.parent / "inputs" / "fig3.nml").replace(
    integrator={"method": "radau13", "rtol": 1e-7},
    system={"misalignment_deg": 1.4, "stiffness_x": 900.0, "mass": 0.4},
    friction={"mu_0": 0.24, "mu_inf": 0.19},
)
FREE = (
    "system.misalignment_deg",
    "friction.mu_0",
    "friction.mu_inf",
    "friction.v_f",
    "system.mass",
    "system.stiffness_x",
)
NOISES, RATES = (0.001, 0.01, 0.05), (200.0, 1e3, 5e3)
CYCLES = 20.6


def clean_trace(scene: ds.Scene, cycles: float, rate: float) -> ds.Trace:
    """Force of the settled motion."""
    period = ds.run(scene, scene={"settle": 1e-7, "t_end": 60.0}, output={"interval": 1.0}).summary["period"]
    run = ds.run(
        scene,
        scene={"t_end": (4.0 + cycles) * period},
        output={"interval": 1.0 / rate, "fields": ["spring_force_x", "spring_force_y"]},
    )
    return ds.Trace.of(run).part(start=4.0 * period)


def noisy(trace: ds.Trace, noise: float, seed: int) -> ds.Trace:
    random = np.random.default_rng(seed)
    return ds.Trace(
        trace.time, trace.force + noise * np.ptp(trace.force) * random.standard_normal(trace.time.size)
    )


def identifiability(short: bool) -> dict[tuple[float, float], ds.Fit]:
    found = {}
    for rate in RATES[1:2] if short else RATES:
        trace = clean_trace(RIG, CYCLES, rate)
        for noise in NOISES[1:2] if short else NOISES:
            found[rate, noise] = ds.fit(RIG, noisy(trace, noise, 1), FREE)
    names = [name.partition(".")[2] for name in FREE]
    print("| samples per second | noise, of the swing | " + " | ".join(names) + " |")
    print("| --- " * (len(FREE) + 2) + "|")
    for (rate, noise), fit in found.items():
        cells = [
            f"{100.0 * p.error / p.value:.2g} %" if p.told else "–"
            for p in (fit.parameters[name] for name in FREE)
        ]
        print(f"| {rate:g} | {100.0 * noise:g} % | " + " | ".join(cells) + " |")
    law = found[1e3, 0.01]
    cells = [
        f"{100.0 * p.law_error / p.value:.2g} %" if p.told else "–" for p in (law.parameters[n] for n in FREE)
    ]
    print("| 1000 | 1 %, any law | " + " | ".join(cells) + " |\n")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--short", action="store_true", help="a part of the tables, no figures")
    short = parser.parse_args().short
    warnings.simplefilter("ignore", ds.FitWarning)
    found = identifiability(short)
    if not short:
        write(found[1e3, 0.01].plot(), DOCS / "figures" / "fit.png")


if __name__ == "__main__":
    main()
