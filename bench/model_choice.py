"""Whether `model = 'auto'` keeps its word on random scenes: what a reader can rerun.

    python bench/model_choice.py [--seconds S] [--seed N] [--short]

Draws scenes log-uniformly over several decades of every parameter, asks for several accuracies, and compares the chosen model
with the full one, in the quantities or in one column. Prints the cases in which the error exceeds the accuracy asked for,
and the counts by model; it fails if there is such a case.
"""

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "python"))
import dynstiction as ds
from test_model_choice import (
    COLUMNS,
    chosen_for,
    deck,
    error_in_creep,
    error_in_stick_slip,
    fast_cycles,
    random_scene,
)

# The scenes that a rule is judged by, drawn before it was made: 300 of this seed. Do not tune on them.
JUDGED_SEED, JUDGED_SCENES = 20261123, 300
ACCURACIES = (0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-5)
MOST_CYCLES = 3e4


def drawn(random: np.random.Generator) -> tuple[dict[str, float], str, float]:
    """A scene, what is asked of it, and how many l_x the drive moves: such that it has at most MOST_CYCLES fast cycles."""
    while True:
        scene = random_scene(random)
        quantities = str(random.choice(["creep", "stick_slip"]))
        lengths = float(
            random.choice([0.1, 0.3, 0.6, 0.9, 1.2, 2.6] if quantities == "creep" else [0.5, 2.6, 4.0])
        )
        if fast_cycles(scene, lengths) <= MOST_CYCLES:
            return scene, quantities, lengths


def judged_scenes() -> list[tuple[dict[str, float], str, float]]:
    """The 300 scenes."""
    random = np.random.default_rng(JUDGED_SEED)
    return [drawn(random) for _ in range(JUDGED_SCENES)]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--short", action="store_true", help="a few seconds: whether it still runs")
    options = parser.parse_args()
    if options.short:
        options.seconds = 5.0
    random = np.random.default_rng(options.seed)
    chosen: Counter[str] = Counter()
    scenes = exceeded = 0
    end = time.monotonic() + options.seconds
    while time.monotonic() < end:
        scene, quantities, lengths = drawn(random)
        column = str(random.choice(["default", "default", *COLUMNS]))
        scenes += 1
        full = None
        for accuracy in ACCURACIES:
            result = chosen_for(column, scene, quantities, lengths, accuracy)
            chosen["full" if result is None else str(result.attributes["model"])] += 1
            if result is None:
                break
            full = full or ds.run(deck(scene, "full", lengths))
            if column == "default":
                error = (error_in_creep if quantities == "creep" else error_in_stick_slip)(result, full)
            else:
                error = np.abs(result[column] - full[column]).max() / np.abs(full[column]).max()
            if error > accuracy:
                exceeded += 1
                print(
                    f"{quantities} {column} {lengths} {accuracy}: {error:.3g}",
                    scene,
                    result.attributes["model_choice"],
                )
    print(f"{scenes} scenes, {exceeded} errors above the accuracy asked for; chosen: {dict(chosen)}")
    sys.exit(exceeded > 0)


if __name__ == "__main__":
    main()
