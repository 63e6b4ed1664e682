#!/usr/bin/env python3
"""Write the lists of points of the maps and diagrams whose run time depends on the case: inputs/*.csv.

    python tools/map_points.py [DIR]

A run must last for some stick-slip cycles, of about l_x/V = mu_0 W/(k_x V) each, and for the time until the
motion has settled. System and friction are those of Fig. 3 of Nakano and Popov (2020).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

MASS, STIFFNESS_X, FRICTION = 0.25, 1.0e3, 0.2 * 10.0  # kg, N/m, N
LENGTH = FRICTION / STIFFNESS_X  # m, l_x

Point = tuple[float, ...]


def log_spaced(first: float, last: float, count: int) -> list[float]:
    """`count` values with equal ratios, to four digits."""
    return [float(f"{first * (last / first) ** (i / (count - 1)):.4g}") for i in range(count)]


def phi_velocity() -> Iterator[Point]:
    """Misalignment against drive velocity: four lengths l_x of drive, and time to settle.

    This time is 30 slow periods, and more with a faster drive, for which friction damps the slow motion less.
    """
    for phi in log_spaced(0.3, 30.0, 27):
        for velocity in log_spaced(3.0e-5, 0.1, 29):
            yield phi, velocity, 4.0 * LENGTH / velocity + 3.0 + 1.0e3 * velocity


def by_lambda() -> Iterator[Point]:
    """Lambda from 1e4 to 0.1 at some misalignments, by a change of the mass and by a change of the velocity.

    The drive moves by four lengths l_x, and then for 400 slow periods: with large inertia the motion settles slowly.
    """
    for phi in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0):
        unit = FRICTION / (2.0 * math.sin(math.radians(phi)) * math.sqrt(STIFFNESS_X))
        for value in log_spaced(0.1, 1.0e4, 41):
            mass = (unit / (1.0e-3 * value)) ** 2
            velocity = unit / (math.sqrt(MASS) * value)
            for m, v in ((mass, 1.0e-3), (MASS, velocity)):
                settling = 400.0 * 2.0 * math.pi * math.sqrt(m / STIFFNESS_X)
                yield phi, m, v, 4.0 * LENGTH / v + settling


def over_velocity() -> Iterator[Point]:
    """Drive velocity for a bifurcation diagram: 40 lengths l_x of drive, and time to settle as above."""
    for velocity in log_spaced(1.0e-4, 0.1, 400):
        yield velocity, 40.0 * LENGTH / velocity + 6.0 + 1.0e3 * velocity


def regularity() -> Iterator[Point]:
    """Stiffness of the stiff axis against drive velocity: 20 lengths l_x of drive, some 40 slow cycles of Fig. 3, and 40 slow periods."""
    for stiffness in log_spaced(1.0e5, 1.0e9, 30):
        for velocity in log_spaced(1.0e-4, 2.0e-2, 25):
            yield stiffness, velocity, 20.0 * LENGTH / velocity + 4.0


LISTS = {
    "map_phi_velocity.csv": ("system.misalignment_deg,drive.velocity,scene.t_end", phi_velocity),
    "bifurcation_velocity.csv": ("drive.velocity,scene.t_end", over_velocity),
    "map_regularity.csv": ("system.stiffness_y,drive.velocity,scene.t_end", regularity),
    "map_lambda.csv": ("system.misalignment_deg,system.mass,drive.velocity,scene.t_end", by_lambda),
}


def main(folder: Path) -> None:
    """Write all lists into a folder."""
    for name, (header, points) in LISTS.items():
        lines = [header, *(",".join(f"{value:.6g}" for value in point) for point in points())]
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "folder",
        metavar="DIR",
        nargs="?",
        type=Path,
        default=Path(__file__).parents[1] / "inputs",
        help="default: inputs",
    )
    main(parser.parse_args().folder)
