"""Misalignment and creep length from the displacement of the first stick of Fig. 3 (docs/howto/fit_creep.md).

    python bench/creep_fit.py [--short]

For each noise of the sensor and each form of the creep: what the fit finds, with its standard errors, and its misfit.
"""

import argparse
import warnings
from pathlib import Path
from typing import Any

import dynstiction as ds
import numpy as np

DECK = Path(__file__).resolve().parent.parent / "inputs" / "fig3.nml"
NOISES = {"10 nm": 1e-8, "100 nm": 1e-7, "1 µm": 1e-6}


def law(speed: Any) -> Any:
    """The friction of Fig. 3, relative to that at rest."""
    return 0.75 + 0.25 * np.exp(-speed / 0.01)


FORMS: dict[str, dict[str, Any]] = {
    "exact, with k_y and F(v)": {"stiffness_ratio": 1e-4, "law": law},
    "exact": {},
    "Eq. (8), first power": {"form": "first_power"},
    "Eq. (8), as printed": {"form": "printed"},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="one noise, to check that it runs")
    short = parser.parse_args().short
    warnings.simplefilter("ignore", ds.FitWarning)
    run = ds.run(DECK, times=np.arange(0.0, 1.85, 1e-3), output={"fields": ["X"]})
    for name, noise in list(NOISES.items())[: 1 if short else None]:
        noisy = run["X"] + noise * np.random.default_rng(1).standard_normal(run.time.size)
        for form, options in FORMS.items():
            fit = ds.fit_creep(run.time, noisy, velocity=1e-3, **options)
            print(
                f"| {name} | {form} | {fit.misalignment_deg:.4f} ± {fit.misalignment_error:.1g} "
                f"| {1e3 * fit.length:.4f} ± {1e3 * fit.length_error:.1g} | {fit.misfit:.3g} |"
            )


if __name__ == "__main__":
    main()
