"""Whether `model = 'auto'` is as accurate as requested on random scenes, and the cost of its choice; for readers to repeat.

    python bench/model_choice.py [--scenes 300] [--seed 20261123] [--short]

Draws scenes log-uniformly over several decades of every parameter, asks for several accuracies, and compares the chosen model with the
full one, in the quantities and in a random column. Prints the cases in which the error exceeds the requested accuracy, the counts by
model, and the Newton iterations of the run of the model chosen at accuracy 1e-2, and those of the full model: closed forms need no
iterations. It fails if an error is too large.

The 300 scenes of the usual seed were drawn before the rule was made. Do not tune a rule on them.
"""

import sys
from collections import Counter
from pathlib import Path
from statistics import mean, median

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "python"))
import dynstiction as ds
from common import options_of, progress
from test_model_choice import (
    COLUMNS,
    chosen_for,
    deck,
    error_in_creep,
    error_in_stick_slip,
    fast_cycles,
    random_scene,
)

# The accuracy for which the cost is printed.
COMMON = 1e-2
ACCURACIES = (0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-5)
MOST_CYCLES = 3e4
LENGTHS = {"creep": (0.1, 0.3, 0.6, 0.9, 1.2, 2.6), "stick_slip": (0.5, 2.6, 4.0)}
"""Distances of the drive in l_x."""


def drawn(random: np.random.Generator) -> tuple[dict[str, float], str, float]:
    """A scene, the requested quantities, and the distance of the drive in l_x, for at most MOST_CYCLES fast cycles."""
    while True:
        scene = random_scene(random)
        quantities = str(random.choice(["creep", "stick_slip"]))
        lengths = float(random.choice(LENGTHS[quantities]))
        if fast_cycles(scene, lengths) <= MOST_CYCLES:
            return scene, quantities, lengths


def main() -> None:
    options = options_of(__doc__, scenes=(300, 10), seed=20261123)
    exceeded = 0
    costs: dict[str, list[float]] = {"always full": [], "auto": []}
    chosen = {accuracy: Counter() for accuracy in ACCURACIES}
    random, of_columns = np.random.default_rng(options.seed), np.random.default_rng(options.seed + 1)
    for _ in progress(range(options.scenes), "scenes"):
        scene, quantities, lengths = drawn(random)
        full = ds.run(deck(scene, "full", lengths))
        costs["always full"].append(full.statistics["newton"])
        error_of = error_in_creep if quantities == "creep" else error_in_stick_slip
        column = str(of_columns.choice(COLUMNS))
        for accuracy in ACCURACIES:
            errors = {}
            result = ds.run(deck(scene, "auto", lengths, f"quantities='{quantities}', accuracy={accuracy}"))
            chosen[accuracy][str(result.attributes["model"])] += 1
            if accuracy == COMMON:
                costs["auto"].append(result.statistics["newton"])
            if result.attributes["model"] != "full":
                errors["default"] = error_of(result, full)
            if result := chosen_for(column, scene, quantities, lengths, accuracy):
                errors[column] = np.abs(result[column] - full[column]).max() / np.abs(full[column]).max()
            for name, error in errors.items():
                if error > accuracy:
                    exceeded += 1
                    print(f"{quantities} {name} {lengths} {accuracy}: {error:.3g}", scene)
    for accuracy, models in chosen.items():
        print(f"accuracy {accuracy:g}: {dict(models)}")
    for name, values in costs.items():
        print(f"Newton iterations, {name}: median {median(values):.0f}, mean {mean(values):.0f}")
    print(f"{options.scenes} scenes, {exceeded} errors above the accuracy asked for")
    sys.exit(int(exceeded > 0))


if __name__ == "__main__":
    main()
