"""Five reference motions for simulators of rigid bodies: a mass on springs, constant friction, exact trajectories (docs/howto/simulators.md).

    python bench/simulators/scenes.py [--check]

Writes a CSV file for each deck of this folder: time [s], position X, Y [m] and velocity [m/s] along and across the drive at 101 times, with
the scene and the largest error of each column in its first lines. The error is the difference of radau13 at rtol = 1e-12 and radau9 at 1e-11.
With --check nothing is written: the exit status is 1 if a file differs from the motion by more than the errors it states.
"""

import argparse
import sys
from pathlib import Path

import dynstiction as ds
import numpy as np

HERE = Path(__file__).resolve().parent
COLUMNS = ("X", "Y", "X_rate", "Y_rate")
KEYS = (
    ("system", ("mass", "stiffness_x", "stiffness_y", "misalignment_deg")),
    ("friction", ("mu_0", "normal_load")),
)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="compare with the files instead of writing them")
    check, wrong = parser.parse_args().check, 0
    for deck in sorted(HERE.glob("*.nml")):
        scene = ds.Scene(deck)
        times = np.linspace(0.0, scene.scene.t_end, 101)
        runs = [ds.run(scene, times=times, integrator={"method": method, "rtol": rtol}, output={"fields": COLUMNS})
                for method, rtol in (("radau13", 1e-12), ("radau9", 1e-11))]  # fmt: skip
        values = np.column_stack([times, *(runs[0][name] for name in COLUMNS)]) + 0.0  # no -0
        errors = [np.abs(runs[0][name] - runs[1][name]).max() for name in COLUMNS]
        path = deck.with_suffix(".csv")
        if check:
            known = np.loadtxt(path, delimiter=",", skiprows=3)
            stated = np.array(
                [0.0, *map(float, path.read_text().splitlines()[1].rpartition(": ")[2].split(", "))]
            )
            good = bool(np.all(np.abs(known - values) <= 10.0 * stated + 1e-12 * np.abs(values).max(axis=0)))
            wrong += not good
            print(f"{path.name}: {'as stated' if good else 'DIFFERS'}")
            continue
        groups = scene.groups()
        keys = ", ".join(f"{key} = {groups[group][key]:g}" for group, names in KEYS for key in names)
        drive = groups["drive"]
        given = (
            f"time = {list(drive['time'])}, velocity = {list(drive['velocity'])}"
            if "time" in drive
            else f"velocity = {drive['velocity']:g}"
        )
        head = f"# {keys}; drive: {given}\n# largest error of each column: {', '.join(f'{e:.1e}' for e in errors)}\ntime,{','.join(COLUMNS)}"
        np.savetxt(path, values, fmt="%.15g", delimiter=",", header=head, comments="")
        print(
            f"{path.name}: X = {values[-1, 1]:.8g} m at {times[-1]:g} s, errors {', '.join(f'{e:.1e}' for e in errors)}"
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
