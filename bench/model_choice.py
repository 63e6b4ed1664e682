"""Whether `model = 'auto'` keeps its word on random scenes: what a reader can rerun.

    python bench/model_choice.py [--seconds S] [--seed N]

Draws scenes log-uniformly over several decades of every parameter, asks for several accuracies, and compares the chosen model
with the full one. Prints the cases in which the error exceeds the accuracy asked for, and the counts by model.
"""

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "python"))
import dynstiction as ds
from test_model_choice import FIG3, deck, error_in_creep, error_in_stick_slip

ACCURACIES = (0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-5)
MOST_CYCLES = 3e4


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    random = np.random.default_rng(options.seed)
    chosen: Counter[str] = Counter()
    scenes = exceeded = 0
    end = time.monotonic() + options.seconds
    while time.monotonic() < end:
        scene = random_scene(random)
        quantities = str(random.choice(["creep", "stick_slip"]))
        lengths = float(
            random.choice([0.1, 0.3, 0.6, 0.9, 1.2, 2.6] if quantities == "creep" else [0.5, 2.6, 4.0])
        )
        if fast_cycles(scene, lengths) > MOST_CYCLES:
            continue
        scenes += 1
        full = None
        for accuracy in ACCURACIES:
            result = ds.run(deck(scene, "auto", lengths, f"quantities='{quantities}', accuracy={accuracy}"))
            model = str(result.attributes["model"])
            chosen[model] += 1
            if model == "full":
                break
            full = full or ds.run(deck(scene, "full", lengths))
            error = (error_in_creep if quantities == "creep" else error_in_stick_slip)(result, full)
            if error > accuracy:
                exceeded += 1
                print(
                    f"{quantities} {lengths} {accuracy}: {error:.3g}",
                    scene,
                    result.attributes["model_choice"],
                )
    print(f"{scenes} scenes, {exceeded} errors above the accuracy asked for; chosen: {dict(chosen)}")


def random_scene(random: np.random.Generator) -> dict[str, float]:
    scene = dict(FIG3)
    scene["mass"] = 0.25 * 10 ** random.uniform(-2, 2)
    scene["stiffness_x"] = 1e3 * 10 ** random.uniform(-1.5, 1.5)
    scene["stiffness_y"] = scene["stiffness_x"] * 10 ** random.uniform(2.5, 6.5)
    scene["mu_0"] = random.uniform(0.05, 0.9)
    scene["mu_inf"] = scene["mu_0"] * random.choice([1.0, random.uniform(0.1, 1.2)])
    scene["v_f"] = 10 ** random.uniform(-4, 0)
    scene["velocity"] = 10 ** random.uniform(-5, -1)
    scene["misalignment_deg"] = float(random.choice([-1, 1]) * 10 ** random.uniform(-2, 1.9))
    return scene


def fast_cycles(scene: dict[str, float], lengths: float) -> float:
    duration = lengths * scene["mu_0"] * 10.0 / scene["stiffness_x"] / scene["velocity"]
    return float(duration * np.sqrt(scene["stiffness_y"] / scene["mass"]) / (2.0 * np.pi))


if __name__ == "__main__":
    main()
