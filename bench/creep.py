"""Speed of slow creep in closed form: points per second on one core, from Python, including allocation.

    python bench/creep.py [--points N] [--runs N] [--short]

Times tau in [0, 2), in order and shuffled, for several misalignments; then with a misalignment for each point, and with a finite
k_y. The processor time is the best of all runs.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial

import dynstiction as ds
import numpy as np


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--points", type=int, default=2_000_000)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    if options.short:
        options.points, options.runs = 20_000, 1
    ordered = np.linspace(0.0, 2.0, options.points, endpoint=False)
    shuffled = np.random.default_rng(1).permutation(ordered)
    print(f"{'':24} {'points/s':>10} {'shuffled':>10}")

    def line(name: str, function: Callable[[np.ndarray], object]) -> None:
        speeds = [points_per_second(function, tau, options.runs) for tau in (ordered, shuffled)]
        print(f"{name:24} {speeds[0]:10.2e} {speeds[1]:10.2e}", flush=True)

    for degrees in (1e-3, 0.1, 1.0, 5.0, 20.0, 45.0, 89.0):
        line(f"exact, {degrees:g} deg", partial(ds.creep_exact, phi=np.radians(degrees)))
    each = np.radians(np.random.default_rng(2).uniform(0.1, 45.0, options.points))
    line("exact, phi by point", lambda tau: ds.creep_exact(tau, each))
    line("exact, 1 deg, kappa 1e-4", lambda tau: ds.creep_exact(tau, np.radians(1.0), 1e-4))
    line("Eq. (8), 1 deg", lambda tau: ds.creep_asymptotic(0.49 * tau, np.radians(1.0)))


def points_per_second(function: Callable[[np.ndarray], object], tau: np.ndarray, runs: int) -> float:
    times = []
    for _ in range(runs):
        start = time.process_time()
        function(tau)
        times.append(time.process_time() - start)
    return tau.size / min(times)


if __name__ == "__main__":
    main()
