"""Cost of the low-frequency model and its differences from the full one, for readers to repeat.

    python bench/models.py [--runs 11] [--short]

Prints, for Fig. 3 at rtol 1e-6, the solver's wall time of both models, the full one with and without the cycle map (median of N
alternating runs), and the differences of the summary values.
"""

import statistics

import dynstiction as ds
from common import INPUTS, options_of

MODELS = {
    "full": ("fig3", "auto"),
    "full, map off": ("fig3", "off"),
    "low_frequency": ("low_frequency", "auto"),
}
"""Deck and cycle map."""
QUANTITIES = (
    "period",
    "peak_force",
    "valley_force",
    "slip_length",
    "max_X_rate",
    "stick_duration",
    "slip_duration",
)


def main() -> None:
    options = options_of(__doc__, runs=(11, 1))
    times: dict[str, list[float]] = {model: [] for model in MODELS}
    found = {}
    for _ in range(options.runs):
        for model, (deck, cycle_map) in MODELS.items():
            settings = {"rtol": 1e-6, "cycle_map": cycle_map}
            found[model] = ds.run(INPUTS / f"{deck}.nml", t_end=10.0, interval=10.0, integrator=settings)
            times[model].append(found[model].statistics["wall_time"])
    low = statistics.median(times["low_frequency"])
    for model, values in times.items():
        median = statistics.median(values)
        print(
            f"{model:14} {1e3 * median:9.3f} ms for 10 s, least {1e3 * min(values):.3f} ms, {median / low:.0f} times that of low_frequency"
        )
    full, low = found["full"].summary, found["low_frequency"].summary
    for name in QUANTITIES:
        print(f"{name:15} {full[name]:.6g} {low[name]:.6g} {100 * (low[name] / full[name] - 1):+.3f} %")


if __name__ == "__main__":
    main()
