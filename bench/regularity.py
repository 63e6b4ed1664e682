"""Whether stick-slip is regular: the Lyapunov exponent of long orbits, and its confirmation.

    python bench/regularity.py [--quad PROGRAM] [--short]

Prints for five scenes the Lyapunov exponent for a slow cycle, pooled over runs with different initial elongations, at several
rtol. For V = 0.2 mm/s it prints after how many slow cycles the motion repeats, how long the transient takes, and its rate, with
and without the cycle map. With ``--quad`` PROGRAM, the program in quadruple precision (-Dprecision=quad), it also prints how two
motions with a small difference separate or approach, without the cycle map, and the exponent of the same orbit (three minutes).
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np

DECK = Path(__file__).resolve().parent.parent / "inputs" / "fig3.nml"
LENGTH, RELEASE, FAST = 2e-3, 2, 20
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

# In quadruple precision: push over the elongation, rtol, and time [s].
PARTING = {
    "k_y = 1e6": (1e-14, "1e-18", 10.0),
    "Fig. 3": (1e-3, "1e-18", 4.8),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quad", metavar="PROGRAM", type=Path, help="the program in quadruple precision")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    seeds = SEEDS[1:5] if options.short else SEEDS
    tolerances = (1e-8,) if options.short else (1e-8, 1e-9, 1e-11)
    print(
        f"{'scene':14s} {'rtol':>6s} {'exponent':>10s} {'error':>8s} {'chi2':>5s} {'runs: regular, undecided, irregular'}"
    )
    for name, changes in SCENES.items():
        for rtol in tolerances:
            print_exponent(name, changes, rtol, seeds if rtol == 1e-9 else seeds[::3])
    print_repeating(seeds)
    if options.quad is not None:
        for name, given in PARTING.items():
            print_parting(options.quad, name, *given)


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
    return ds.run(ds.Scene(DECK), **groups)


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


def print_parting(program: Path, name: str, push: float, rtol: str, t_end: float) -> None:
    """Two motions in quadruple precision: ln of the growth of the difference of their periods, slow cycle by slow cycle."""
    with tempfile.TemporaryDirectory() as folder:
        files = [
            quad_run(program, Path(folder) / f"{push:g}.h5", SCENES[name], push, rtol, t_end)
            for push in (0.0, push)
        ]
        (time, kind, slip), (other, other_kind, other_slip) = (release_times(file) for file in files)
    count = min(slip.size, other_slip.size)
    differences = []
    for one, two in zip(slip[:count], other_slip[:count], strict=True):
        # The duration of some fast cycles after the end of a slow cycle shows by how much their first angles differ. Differences of
        # times, each as double and remainder, lose no digits.
        i, j = (
            releases[releases > at]
            for releases, at in ((releases_of(kind), one), (releases_of(other_kind), two))
        )
        if min(i.size, j.size) <= FAST:
            break
        first, last = (sum(time[part][i[k]] - other[part][j[k]] for part in (0, 1)) for k in (0, FAST))
        if last == first:
            break
        differences.append(abs(last - first))
    logarithm = np.log(differences)
    growth = np.diff(logarithm)
    print(f"\n{name}, quadruple precision, rtol {rtol}, push {push:g}: ln of the growth in each slow cycle")
    print(" ".join(f"{value:.3f}" for value in growth) + f"; mean {growth.mean():.4f}")
    print(f"difference of {FAST} fast cycles [s]: {differences[0]:.1e} to {differences[-1]:.1e}", flush=True)
    # In double precision the orbit is the same for some slow cycles. Its exponent is from the later half of the complete ones.
    for k in range(4, len(differences) + 1):
        until = time[0][slip[k]] if k < slip.size else t_end
        summary = run(SCENES[name] | {"initial.velocity_ratio": 0.0}, until - 0.01, 0.5, 1e-12).summary
        if "lyapunov_exponent" in summary:
            here = growth[k // 2 - 1 : k - 1].mean()
            print(
                f"slow cycles {k // 2 + 1} to {k}: parting {here:.4f}, by the map {summary['lyapunov_exponent']:.4f}",
                flush=True,
            )


def quad_run(program: Path, file: Path, changes: dict, push: float, rtol: str, t_end: float) -> Path:
    # All digits of the elongation, as text: half of F_0/k_x, pushed.
    digits = f"{1.0:.0f}.{round(push * 1e24):024d}e-3"
    settings = {
        "scene.t_end": t_end,
        "initial.velocity_ratio": 0,
        "initial.elongation_x": digits,
        "integrator.method": "radau13",
        "integrator.rtol": rtol,
        "integrator.cycle_map": "off",
        "output.interval": t_end,
        **changes,
    }
    given = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    subprocess.run([program, "run", DECK, "-o", file, "--quiet", *given], check=True)
    return file


def releases_of(kind: np.ndarray) -> np.ndarray:
    return np.flatnonzero(kind == RELEASE)


def release_times(file: Path) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray]:
    """Times of all events, as double and remainder, their kinds, and which begin a long slip."""
    with h5py.File(file) as content:
        time, rest, kind = (
            content[key][:] for key in ("events/time", "remainder/events/time", "events/kind")
        )
    return (time, rest), kind, slips(time, kind)


if __name__ == "__main__":
    main()
