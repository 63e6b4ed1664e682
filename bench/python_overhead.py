"""Time that Python adds to the solver: the import of the package, and the part of `ds.run` outside the solver.

    python bench/python_overhead.py [--runs 9] [--calls 2000] [--short]

The solver's time is `statistics/wall_time` of the same run: the integration, which is the same in the executable. Prints the
medians of N runs [ms], and for the overhead also the least value, which depends least on other work of the machine; then the overhead
of a run that takes the solver some microseconds [us]. The time of the import is that of a new interpreter minus one without it.
"""

import subprocess
import sys
from statistics import median

import dynstiction as ds
from common import INPUTS, options_of, timed

SCENES = {
    "1 ms of Fig. 3": ("fig3.nml", {"t_end": 1.0e-3}),
    "Fig. 3": ("fig3.nml", {}),
    "Fig. 3, low_frequency": ("low_frequency.nml", {}),
    "creep": ("creep.nml", {}),
}


def main() -> None:
    options = options_of(__doc__, runs=(9, 1), calls=(2000, 10))
    print(
        f"{'scene':24} {'samples':>8} {'events':>8} {'run ms':>10} {'solver ms':>10} {'overhead ms':>12} {'least':>8}"
    )
    for name, (deck, changes) in SCENES.items():
        runs, results = timed(
            lambda deck=deck, changes=changes: ds.run(INPUTS / deck, scene=changes), options.runs
        )
        solver = [result.statistics["wall_time"] for result in results]
        overheads = [1e3 * (run - part) for run, part in zip(runs, solver, strict=True)]
        print(
            f"{name:24} {results[0].time.size:8} {results[0].events.size:8} {1e3 * median(runs):10.2f} {1e3 * median(solver):10.2f}"
            f" {median(overheads):12.2f} {min(overheads):8.2f}"
        )
    scene = ds.Scene(INPUTS / "creep.nml", scene={"t_end": 0.1})
    runs, results = timed(lambda: ds.run(scene), options.calls)
    spent = [run - result.statistics["wall_time"] for run, result in zip(runs, results, strict=True)]
    print(f"overhead of a short run: {1e6 * median(spent):.1f} us, least {1e6 * min(spent):.1f} us")
    bare, loaded, numpy = (
        median(
            timed(lambda code=code: subprocess.run([sys.executable, "-c", code], check=True), options.runs)[0]
        )
        for code in ("pass", "import dynstiction", "import numpy")
    )
    print(f"import dynstiction: {1e3 * (loaded - bare):.0f} ms, of which numpy {1e3 * (numpy - bare):.0f} ms")


if __name__ == "__main__":
    main()
