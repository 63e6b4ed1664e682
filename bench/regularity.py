"""Whether stick-slip is regular: the Lyapunov exponent of long orbits, and its confirmation.

    python bench/regularity.py [--short]

Prints for five scenes the Lyapunov exponent for a slow cycle, pooled over runs with different initial elongations, at several
rtol. For V = 0.2 mm/s it prints after how many slow cycles the motion repeats, and how long the transient takes, with and without the
cycle map.
"""

import dynstiction as ds
import numpy as np
from common import FIG3, options_of

LENGTH, RELEASE = 2e-3, 2
SLOW = {"velocity": 2e-4}
SCENES = {
    "Fig. 3": {},
    "k_y = 5e5": {"stiffness_y": 5e5},
    "k_y = 1e6": {"stiffness_y": 1e6},
    "k_y = 2e6": {"stiffness_y": 2e6},
    "V = 0.2 mm/s": SLOW,
}
SEEDS = tuple(float(seed) for seed in np.linspace(0.0, 0.92, 24))
"""Elongations at the start, over F_0/k_x."""

# For a motion that repeats: the largest difference of equal periods [s], the largest number of slow cycles after which it repeats,
# the difference below which its transient has ended.
SAME, MOST, SETTLED = 1e-7, 12, 1e-4


def main() -> None:
    options = options_of(__doc__, tolerances=("1e-8,1e-9,1e-11", "1e-8"))
    seeds = SEEDS[1:5] if options.short else SEEDS
    print(
        f"{'scene':14s} {'rtol':>6s} {'exponent':>10s} {'error':>8s} {'chi2':>5s} {'runs: regular, undecided, irregular'}"
    )
    for name, changes in SCENES.items():
        for rtol in map(float, options.tolerances.split(",")):
            print_exponent(name, changes, rtol, seeds if rtol == 1e-9 else seeds[::3])
    print("\nV = 0.2 mm/s: start, rtol, map: repeats after, slow cycles of the transient")
    for seed in seeds:
        print_repeating(seed, 1e-9, "auto")
    if not options.short:
        for rtol, cycle_map in ((1e-8, "auto"), (1e-11, "auto"), (1e-9, "off")):
            print_repeating(SEEDS[1], rtol, cycle_map)


def run(changes: dict, t_end: float, seed: float, rtol: float, cycle_map: str = "auto") -> ds.Result:
    integrator = {"method": "radau13", "rtol": rtol, "cycle_map": cycle_map}
    return ds.run(
        FIG3, t_end=t_end, interval=t_end, elongation_x=seed * LENGTH, integrator=integrator, **changes
    )


def print_exponent(name: str, changes: dict, rtol: float, seeds: tuple[float, ...]) -> None:
    """The mean over runs, its standard error from their scatter, and the ratio of the scatter to that from their own errors."""
    summaries = [run(changes, 1200.0 if changes == SLOW else 120.0, seed, rtol).summary for seed in seeds]
    values, errors, verdicts = (
        np.array([summary.get(key, np.nan) for summary in summaries])
        for key in ("lyapunov_exponent", "lyapunov_error", "regularity")
    )
    error = values.std(ddof=1) / np.sqrt(values.size)
    chi2 = (
        np.mean(((values - values.mean()) / np.maximum(errors, 1e-4)) ** 2) * values.size / (values.size - 1)
    )
    counts = [int(np.count_nonzero(verdicts == verdict)) for verdict in (1, 0, -1)]
    print(f"{name:14s} {rtol:6.0e} {values.mean():10.4f} {error:8.4f} {chi2:5.1f} {counts}", flush=True)


def print_repeating(seed: float, rtol: float, cycle_map: str) -> None:
    """V = 0.2 mm/s: after how many slow cycles the motion repeats, and from which cycle."""
    events = run(SLOW, 800.0 if cycle_map == "auto" else 500.0, seed, rtol, cycle_map).events
    time, kind = events["time"], events["kind"]
    releases = np.flatnonzero(kind[:-1] == RELEASE)
    # A release before a long slip, which lasts for a good part of a slow period.
    period = np.diff(time[releases[time[releases + 1] - time[releases] > 0.02]])
    told = "does not repeat"
    for after in range(1, MOST + 1):
        apart = np.abs(period[after:] - period[:-after])
        if apart[-5:].max() <= SAME:
            begins = int(np.flatnonzero(apart > SETTLED).max(initial=-1)) + 1
            told = f"{after:3d} {begins:5d}   periods {np.unique(np.round(period[-after:], 6))} s"
            break
    print(f"{seed:5.2f} {rtol:6.0e} {cycle_map:>5s} {told}", flush=True)


if __name__ == "__main__":
    main()
