"""Cost of the low-frequency model and its differences from the full one, for readers to repeat.

    python bench/models.py [--runs N] [--short]

Prints, for Fig. 3 at rtol 1e-6, the solver's wall time of both models, the full one with and without the cycle map (median of N
alternating runs), the instructions for 10 s if valgrind is installed (from two lengths of the run, so that start, tables of the map
and output cancel), and the differences of the summary values.
"""

import shutil
import statistics
import tempfile
from pathlib import Path

import dynstiction as ds
from common import INPUTS, instructions, parser_of

MODELS = {
    "full": ("fig3", "auto", (2.0, 12.0)),
    "full, map off": ("fig3", "off", (2.0, 12.0)),
    "low_frequency": ("low_frequency", "auto", (100.0, 1000.0)),
}
"""Deck, cycle map, and the two lengths [s]."""
QUANTITIES = (
    *("period", "peak_force", "valley_force", "slip_length", "max_X_rate"),
    *("stick_duration", "slip_duration"),
)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--runs", type=int, default=11, help="number of runs for a median")
    options = parser.parse_args()
    times: dict[str, list[float]] = {model: [] for model in MODELS}
    found = {}
    for _ in range(1 if options.short else options.runs):
        for model, (deck, cycle_map, _) in MODELS.items():
            found[model] = ds.run(
                INPUTS / f"{deck}.nml",
                t_end=10.0,
                interval=10.0,
                integrator={"rtol": 1e-6, "cycle_map": cycle_map},
            )
            times[model].append(found[model].statistics["wall_time"])
    for model, values in times.items():
        print(
            f"{model:14} {1e3 * statistics.median(values):9.3f} ms for 10 s, least {1e3 * min(values):.3f} ms"
        )
    print_ratios("time", [statistics.median(values) for values in times.values()])
    if shutil.which("valgrind") and not options.short:
        print_ratios("instructions for 10 s", [count(*given) for given in MODELS.values()])
    full, low = found["full"].summary, found["low_frequency"].summary
    for name in QUANTITIES:
        print(f"{name:15} {full[name]:.6g} {low[name]:.6g} {100 * (low[name] / full[name] - 1):+.3f} %")


def print_ratios(what: str, values: list[float]) -> None:
    full, direct, low = values
    print(f"{what}: {full:.3e}, {direct:.3e} and {low:.3e}, ratios {full / low:.0f} and {direct / low:.0f}")


def count(deck: str, cycle_map: str, lengths: tuple[float, float]) -> float:
    """Instructions for 10 s of the motion."""
    with tempfile.TemporaryDirectory() as folder:
        first, last = (
            instructions(
                INPUTS / f"{deck}.nml",
                Path(folder) / "run.h5",
                {
                    "integrator.rtol": 1e-6,
                    "integrator.cycle_map": cycle_map,
                    "scene.t_end": t_end,
                    "output.interval": t_end,
                },
            )
            for t_end in lengths
        )
    return 10.0 * (last - first) / (lengths[1] - lengths[0])


if __name__ == "__main__":
    main()
