"""Measure the numbers of docs/cycle_map.md and draw its figures, so that readers can repeat them.

    python docs/cycle_map.py [--short]

Prints two tables in Markdown. The first: Chebyshev interpolation of the time T of a cycle of Fig. 3 and of the turn of the
spring force in it, on three intervals of the angle, by the number of points; each cycle is a separate run. The second: Fig. 3
at t = 10 s with and without the cycle map. Writes docs/figures/cycle_map.png and cycle_map_irregular.png.
"""

import argparse
import json
from pathlib import Path

import dynstiction as ds
import numpy as np
from dynstiction import plot
from numpy.polynomial import chebyshev

DOCS = Path(__file__).resolve().parent
FIG3 = ds.Scene(DOCS.parent / "inputs" / "fig3.nml")
REFERENCE = DOCS.parent / "tests" / "reference" / "fig3.json"
TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
POINTS = (5, 9, 13, 17, 21, 25)
INTERVALS = ((40.0, 85.0), (25.0, 40.0), (23.2, 25.0))
"""Angles of the spring force to the soft axis [deg]."""

LIMIT, STIFFNESS = 2.0, np.array([1e3, 1e7])
"""Static limit [N] and stiffnesses [N/m] of Fig. 3."""

IRREGULAR = {
    "system": {"stiffness_y": 1e6},
    "scene": {"t_end": 200.0},
    "output": {"interval": 0.1},
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--short",
        action="store_true",
        help="a short form of some seconds, to check that it runs; writes nothing",
    )
    options = parser.parse_args()
    print_interpolation(POINTS[:2] if options.short else POINTS)
    print_runs(TOLERANCES[:2] if options.short else TOLERANCES)
    if not options.short:
        plot.save(ds.run(FIG3), DOCS / "figures" / "cycle_map.png", "cycle_map")
        plot.save(ds.run(FIG3, **IRREGULAR), DOCS / "figures" / "cycle_map_irregular.png", "cycle_map")


def print_interpolation(points: tuple[int, ...]) -> None:
    end = end_of_sticks()
    print(f"sticks end at {end:.2f} deg; share of the time at rest there: 0\n")
    heads = []
    for low, high in INTERVALS:
        beyond = 1.0 + 2.0 * (low - end) / (high - low)
        heads.append(f"{low:g}° to {high:g}°: ρ = {beyond + np.sqrt(beyond**2 - 1.0):.2f}")
    print("| points | " + " | ".join(f"{head}; T | turn" for head in heads) + " |")
    print("| --- " * (1 + 2 * len(heads)) + "|")
    for count in points:
        errors = [error for interval in INTERVALS for error in interpolation_errors(interval, count)]
        print(f"| {count} | " + " | ".join(f"{error:.1e}" for error in errors) + " |", flush=True)


def interpolation_errors(interval: tuple[float, float], count: int) -> np.ndarray:
    """Largest errors of T, relative, and of the turn, relative to its largest value, at ten angles between the points."""
    low, high = interval
    place = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    cycles = np.array([cycle(low + 0.5 * (high - low) * (x + 1.0))[:2] for x in place])
    fit = chebyshev.chebfit(place, cycles, count - 1)
    between = np.linspace(-0.97, 0.97, 10)
    exact = np.array([cycle(low + 0.5 * (high - low) * (x + 1.0))[:2] for x in between])
    scale = np.stack([exact[:, 0], np.full(between.size, np.abs(exact[:, 1]).max())], axis=1)
    return np.max(np.abs(chebyshev.chebval(between, fit).T - exact) / scale, axis=0)


def end_of_sticks() -> float:
    """Angle at which the share of the time at rest, which decreases like a square root, would be zero [deg]."""
    angles = (24.0, 23.7)
    first, second = (cycle(angle)[2] ** 2 for angle in angles)
    return angles[1] - (angles[0] - angles[1]) * second / (first - second)


def cycle(angle: float) -> tuple[float, float, float]:
    """Duration [s], turn of the spring force [rad] and share of the time at rest, for the cycle from an angle [deg]."""
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    elongation = LIMIT * direction / STIFFNESS
    period = 2.0 * np.pi * np.sqrt(0.25 / 1e7) / direction[1]
    run = ds.run(
        FIG3,
        scene={"t_end": 1.3 * period},
        initial={"velocity_ratio": 0.0, "elongation_x": elongation[0], "elongation_y": elongation[1]},
        integrator={"method": "radau13", "rtol": 1e-13, "cycle_map": "off"},
        output={"interval": 0.0, "fields": ["u_x", "u_y"]},
    )
    events = run.events[run.events["time"] > 0.3 * period]
    stick, release = (float(events["time"][events["kind"] == kind][0]) for kind in (1, 2))
    row = int(np.searchsorted(run.time, release))
    force = STIFFNESS * np.array([run["u_x"][row], run["u_y"][row]])
    turn = np.arctan2(direction[0] * force[1] - direction[1] * force[0], direction @ force)
    return release, float(turn), 1.0 - stick / release


def print_runs(tolerances: tuple[float, ...]) -> None:
    states = json.loads(REFERENCE.read_text(encoding="utf-8"))["scenes"]["fig3"]["states"]
    (reference,) = (np.array(state[3:]) for state in states if state[0] == 10.0)
    print(
        "\n| rtol | error of w, map | off | Newton iterations, map | off | cycles leapt | sampled | map_error | sticks |"
    )
    print("| --- " * 9 + "|")
    for rtol in tolerances:
        runs = [
            ds.run(
                FIG3,
                initial={"velocity_ratio": 0.0},
                integrator={"rtol": rtol, "cycle_map": choice},
                output={"interval": 10.0},
            )
            for choice in ("auto", "off")
        ]
        errors = [
            np.linalg.norm([run["w_x"][-1], run["w_y"][-1]] - reference) / np.linalg.norm(reference)
            for run in runs
        ]
        work = runs[0].statistics
        newton = " | ".join(str(run.statistics["newton"]) for run in runs)
        sticks = sorted({run.sticks() for run in runs})
        print(
            f"| {rtol:.0e} | {errors[0]:.1e} | {errors[1]:.1e} | {newton} | {work['cycles_leapt']} | {work['cycles_sampled']} "
            f"| {work['map_error']:.0e} | {', '.join(map(str, sticks))} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
