"""Whether stick-slip is regular: the Lyapunov exponent of long orbits, and its confirmation.

    python bench/regularity.py [--short]

Prints for five scenes the Lyapunov exponent for a slow cycle, pooled over runs with different initial elongations, at several
rtol. For V = 0.2 mm/s it prints after how many slow cycles the motion repeats, how long the transient takes, and its rate, with
and without the cycle map.
"""

import dynstiction as ds
import numpy as np
from common import FIG3, parser_of

LENGTH, RELEASE = 2e-3, 2
SCENES = {
    "Fig. 3": {},
    "k_y = 5e5": {"system.stiffness_y": 5e5},
    "k_y = 1e6": {"system.stiffness_y": 1e6},
    "k_y = 2e6": {"system.stiffness_y": 2e6},
    "V = 0.2 mm/s": {"drive.velocity": 2e-4},
}
SEEDS = tuple(float(seed) for seed in np.linspace(0.0, 0.92, 24))
"""Elongations at the start, over F_0/k_x."""

# For a motion that repeats: the largest difference of equal periods [s], the largest number of slow cycles after which it repeats,
# the difference below which its transient has ended, and the differences between which its rate is taken.
SAME, MOST, SETTLED, BETWEEN = 1e-7, 12, 1e-4, (1e-8, 1e-5)


def main() -> None:
    options = parser_of(__doc__).parse_args()
    seeds = SEEDS[1:5] if options.short else SEEDS
    tolerances = (1e-8,) if options.short else (1e-8, 1e-9, 1e-11)
    print(
        f"{'scene':14s} {'rtol':>6s} {'exponent':>10s} {'error':>8s} {'chi2':>5s} {'runs: regular, undecided, irregular'}"
    )
    for name, changes in SCENES.items():
        for rtol in tolerances:
            print_exponent(name, changes, rtol, seeds if rtol == 1e-9 else seeds[::3])
    print_repeating(seeds)


def run(changes: dict, t_end: float, seed: float, rtol: float, cycle_map: str = "auto") -> ds.Result:
    groups: dict[str, dict] = {
        "scene": {"t_end": t_end},
        "initial": {"elongation_x": seed * LENGTH},
        "integrator": {"method": "radau13", "rtol": rtol, "cycle_map": cycle_map},
        "output": {"interval": t_end},
    }
    for key, value in changes.items():
        group, name = key.split(".")
        groups.setdefault(group, {})[name] = value
    return ds.run(ds.Scene(FIG3), **groups)


def print_exponent(name: str, changes: dict, rtol: float, seeds: tuple[float, ...]) -> None:
    """The mean over runs, its standard error from their scatter, and the ratio of the scatter to that from their own errors."""
    t_end = 120.0 * 1e-3 / changes.get("drive.velocity", 1e-3)
    summaries = [
        run(changes, 2.0 * t_end if "drive.velocity" in changes else t_end, seed, rtol).summary
        for seed in seeds
    ]
    values, errors, verdicts = (
        np.array([summary.get(key, np.nan) for summary in summaries])
        for key in ("lyapunov_exponent", "lyapunov_error", "regularity")
    )
    error = values.std(ddof=1) / np.sqrt(values.size)
    expected = np.maximum(errors, 1e-4)
    chi2 = np.mean(((values - values.mean()) / expected) ** 2) * values.size / (values.size - 1)
    counts = [int(np.count_nonzero(verdicts == verdict)) for verdict in (1, 0, -1)]
    print(f"{name:14s} {rtol:6.0e} {values.mean():10.4f} {error:8.4f} {chi2:5.1f} {counts}", flush=True)


def slips(time: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Whether each event is a release before a long slip, which lasts for a good part of a slow period."""
    releases = np.flatnonzero(kind[:-1] == RELEASE)
    long = (time[releases + 1] - time[releases]) > 0.02
    return releases[long]


def periods(result: ds.Result) -> np.ndarray:
    time, kind = (result.events[key] for key in ("time", "kind"))
    return np.diff(time[slips(time, kind)])


def print_repeating(seeds: tuple[float, ...]) -> None:
    """V = 0.2 mm/s: after how many slow cycles the motion repeats, from which cycle, and the rate of the transient."""
    print(
        "\nV = 0.2 mm/s: start, rtol, map: repeats after, slow cycles of the transient, rate for a slow cycle"
    )
    cases = [(seed, 1e-9, "auto") for seed in seeds]
    if len(seeds) > 4:
        cases += [(SEEDS[1], rtol, "auto") for rtol in (1e-8, 1e-11)] + [(SEEDS[1], 1e-9, "off")]
    for seed, rtol, cycle_map in cases:
        period = periods(
            run(SCENES["V = 0.2 mm/s"], 800.0 if cycle_map == "auto" else 500.0, seed, rtol, cycle_map)
        )
        told = "does not repeat"
        for after in range(1, MOST + 1):
            apart = np.abs(period[after:] - period[:-after])
            if apart[-5:].max() > SAME:
                continue
            begins = int(np.flatnonzero(apart > SETTLED).max(initial=-1)) + 1
            # The last cycles before: their differences decrease by the same factor each time.
            first = int(np.flatnonzero(apart > BETWEEN[1]).max(initial=-1)) + 1
            here = np.arange(first, apart.size)
            here = here[apart[first:] > BETWEEN[0]]
            rate = np.polyfit(here, np.log(apart[here]), 1)[0] if here.size > 4 else np.nan
            told = (
                f"{after:3d} {begins:5d} {rate:10.4f}   periods {np.unique(np.round(period[-after:], 6))} s"
            )
            break
        print(f"{seed:5.2f} {rtol:6.0e} {cycle_map:>5s} {told}", flush=True)


if __name__ == "__main__":
    main()
