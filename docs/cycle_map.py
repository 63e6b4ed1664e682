"""Measure the numbers of docs/cycle_map.md and draw its figure, so that readers can repeat them.

    python docs/cycle_map.py [--short]

Prints a table in Markdown: Fig. 3 at t = 10 s with and without the cycle map. Writes docs/figures/cycle_map.png.
"""

import argparse
import json
from pathlib import Path

import dynstiction as ds
import numpy as np
from dynstiction import plot

DOCS = Path(__file__).resolve().parent
FIG3 = ds.Scene(DOCS.parent / "inputs" / "fig3.nml")
REFERENCE = DOCS.parent / "tests" / "reference" / "fig3.json"
TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
,
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
    print_runs(TOLERANCES[:2] if options.short else TOLERANCES)
    if not options.short:
        plot.save(ds.run(FIG3), DOCS / "figures" / "cycle_map.png", "cycle_map")

def print_runs(tolerances: tuple[float, ...]) -> None:
    states = json.loads(REFERENCE.read_text(encoding="utf-8"))["scenes"]["fig3"]["states"]
    (reference,) = (np.array(state[3:]) for state in states if state[0] == 10.0)
    print(
        "| rtol | error of w, map | off | Newton iterations, map | off | cycles leapt | sampled | map_error | sticks |"
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
