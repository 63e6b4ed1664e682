"""Speed and accuracy on Fig. 3 by method and tolerance, without the cycle map, for readers to repeat.

    python bench/fig3.py [--runs 5] [--short]

Prints the error of the slip velocity at t = 10 s (relative to |w|), the number of sticks, the solver's wall time (median of N runs),
Newton iterations and the time of one; then time and memory of the whole process with the map, for t_end = 10 s and 1000 s.
"""

import json
import statistics
import tempfile
from pathlib import Path

import dynstiction as ds
import numpy as np
from common import FIG3, ROOT, largest_memory, options_of, program

TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10)
METHODS = ("radau5", "radau9", "radau13", "dopri5", "dop853")


def main() -> None:
    options = options_of(__doc__, runs=(5, 1))
    runs, tolerances, lengths = options.runs, TOLERANCES, (10.0, 1000.0)
    if options.short:
        tolerances, lengths = (1e-4, 1e-6), (1.0,)
    print("method     rtol  error of w sticks  solver s   Newton  us each       rhs")
    for method in METHODS:
        for rtol in tolerances:
            print_solver(method, rtol, runs)
    with tempfile.TemporaryDirectory() as folder:
        for t_end in lengths:
            settings = {"scene.t_end": t_end, "integrator.rtol": 1e-6}
            walls = [program("run", FIG3, Path(folder) / "fig3.h5", **settings).wall for _ in range(runs)]
            print(f"process, t_end = {t_end} s: {statistics.median(walls):.3f} s, {largest_memory():.1f} MB")


def print_solver(method: str, rtol: float, runs: int) -> None:
    """Error and cost of the solver alone: one sample a second."""
    settings = {"method": method, "rtol": rtol, "cycle_map": "off"}
    results = [ds.run(FIG3, integrator=settings, output={"interval": 1.0}) for _ in range(runs)]
    result, work = results[0], results[0].statistics
    reference = final_reference()
    error = np.linalg.norm([result["w_x"][-1], result["w_y"][-1]] - reference) / np.linalg.norm(reference)
    seconds = statistics.median(each.statistics["wall_time"] for each in results)
    newton = int(work["newton"])
    each = f"{1e6 * seconds / newton:8.2f}" if newton else f"{'-':>8}"
    print(
        f"{method:8} {rtol:6.0e} {error:11.1e} {result.sticks():6d} {seconds:9.4f} {newton:8d} {each} {int(work['rhs']):9d}",
        flush=True,
    )


def final_reference() -> np.ndarray:
    """Slip velocity at t = 10 s, converged in quadruple precision."""
    scenes = json.loads((ROOT / "tests" / "reference" / "fig3.json").read_text())
    row = next(row for row in scenes["scenes"]["fig3"]["states"] if row[0] == 10.0)
    return np.array(row[3:5])


if __name__ == "__main__":
    main()
