"""Whether `model = 'auto'` is as accurate as requested on random scenes, and the cost of its choice; for readers to repeat.

    python bench/model_choice.py [--seconds S] [--seed N] [--short]
    python bench/model_choice.py --judge

Draws scenes log-uniformly over several decades of every parameter, asks for several accuracies, and compares the chosen model
with the full one, in the quantities or in one column. Prints the cases in which the error exceeds the requested accuracy,
and the counts by model; it fails if there is such a case.

With --judge it uses 300 scenes that were drawn before the rule was made, and their quantities. It then also prints the Newton
iterations of the run of the model chosen at accuracy 1e-2, and those of the full model; closed forms need no iterations.
"""

import statistics
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "python"))
import dynstiction as ds
from common import parser_of, progress
from test_model_choice import (
    COLUMNS,
    chosen_for,
    deck,
    error_in_creep,
    error_in_stick_slip,
    fast_cycles,
    random_scene,
)

# The scenes for the assessment of a rule, drawn before the rule was made: 300 of this seed. Do not tune a rule on them.
JUDGED_SEED, JUDGED_SCENES = 20261123, 300
# The accuracy for which the cost is printed.
COMMON = 1e-2
ACCURACIES = (0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-5)
MOST_CYCLES = 3e4


def drawn(random: np.random.Generator) -> tuple[dict[str, float], str, float]:
    """A scene, the requested quantities, and the distance of the drive in l_x, for at most MOST_CYCLES fast cycles."""
    while True:
        scene = random_scene(random)
        quantities = str(random.choice(["creep", "stick_slip"]))
        lengths = float(
            random.choice([0.1, 0.3, 0.6, 0.9, 1.2, 2.6] if quantities == "creep" else [0.5, 2.6, 4.0])
        )
        if fast_cycles(scene, lengths) <= MOST_CYCLES:
            return scene, quantities, lengths


Drawn = tuple[dict[str, float], str, float]


def exceeds(
    result: ds.Result, full: ds.Result, asked: Drawn, accuracy: float, column: str = "default"
) -> bool:
    """Whether the error is larger than requested; then the scene is printed."""
    scene, quantities, lengths = asked
    if column == "default":
        error = (error_in_creep if quantities == "creep" else error_in_stick_slip)(result, full)
    else:
        error = np.abs(result[column] - full[column]).max() / np.abs(full[column]).max()
    if error > accuracy:
        choice = result.attributes["model_choice"]
        print(f"{quantities} {column} {lengths} {accuracy}: {error:.3g}", scene, choice)
    return bool(error > accuracy)


def judge() -> None:
    """Errors and costs on the 300 scenes."""
    exceeded = 0
    costs: dict[str, list[float]] = {"always full": [], "auto": []}
    chosen: dict[float, Counter[str]] = {accuracy: Counter() for accuracy in ACCURACIES}
    random = np.random.default_rng(JUDGED_SEED)
    for _ in progress(range(JUDGED_SCENES), "scenes"):
        scene, quantities, lengths = asked = drawn(random)
        full = ds.run(deck(scene, "full", lengths))
        costs["always full"].append(full.statistics["newton"])
        for accuracy in ACCURACIES:
            result = ds.run(deck(scene, "auto", lengths, f"quantities='{quantities}', accuracy={accuracy}"))
            model = str(result.attributes["model"])
            chosen[accuracy][model] += 1
            if accuracy == COMMON:
                costs["auto"].append(result.statistics["newton"])
            if model != "full":
                exceeded += exceeds(result, full, asked, accuracy)
    for accuracy, models in chosen.items():
        print(f"accuracy {accuracy:g}: {dict(models)}")
    for name, values in costs.items():
        median, mean = statistics.median(values), statistics.mean(values)
        print(f"Newton iterations, {name}: median {median:.0f}, mean {mean:.0f}")
    print(f"{JUDGED_SCENES} scenes, {exceeded} errors above the accuracy asked for")
    sys.exit(bool(exceeded > 0))


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--judge", action="store_true", help="the 300 scenes drawn before the rule, and what it costs"
    )
    options = parser.parse_args()
    if options.judge:
        judge()
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
            exceeded += exceeds(result, full, (scene, quantities, lengths), accuracy, column)
    print(f"{scenes} scenes, {exceeded} errors above the accuracy asked for; chosen: {dict(chosen)}")
    sys.exit(bool(exceeded > 0))


if __name__ == "__main__":
    main()
