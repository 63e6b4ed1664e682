"""Misalignment and creep length from the displacement of the first stick of Fig. 3 (docs/howto/fit_creep.md).

    python bench/creep_fit.py [--rigs 100] [--short]

For each noise of the sensor and each form of the creep: what the fit finds, with its standard errors, and its misfit. Then the errors
of the misalignment for N random rigs (100), with a noise of 1e-5 l_x, where the misfit is below 1.1, and where it is not.
"""

import warnings
from typing import Any

import dynstiction as ds
import numpy as np
from common import FIG3, options_of

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
    options = options_of(__doc__, rigs=(100, 3))
    warnings.simplefilter("ignore", ds.FitWarning)
    run = ds.run(FIG3, times=np.arange(0.0, 1.85, 1e-3), output={"fields": ["X"]})
    for name, noise in list(NOISES.items())[: 1 if options.short else None]:
        noisy = run["X"] + noise * np.random.default_rng(1).standard_normal(run.time.size)
        for form, how in FORMS.items():
            fit = ds.fit_creep(run.time, noisy, velocity=1e-3, **how)
            print(
                f"| {name} | {form} | {fit.misalignment_deg:.4f} ± {fit.misalignment_error:.1g} "
                f"| {1e3 * fit.length:.4f} ± {1e3 * fit.length_error:.1g} | {fit.misfit:.3g} |"
            )
    random_rigs(options.rigs)


def random_rigs(count: int) -> None:
    """Errors of the misalignment, relative to it, for rigs of many sizes."""
    random = np.random.default_rng(5)
    found = []
    for _ in range(count):
        soft, ratio, mass, load, speed, v_f = 10 ** random.uniform(
            [2, 1.5, -2, 0, -4, -2.5], [4.3, 4.5, 0.5, 2, -2.3, -1]
        )
        mu_0, fall, phi = random.uniform([0.1, 0.6, 0.3], [0.6, 1.0, 8.0])
        length, mu_inf = mu_0 * load / soft, mu_0 * fall
        rig = {"stiffness_x": soft, "stiffness_y": soft * ratio, "mass": mass, "normal_load": load, "mu_0": mu_0, "mu_inf": mu_inf,
               "v_f": v_f, "velocity": speed, "misalignment_deg": phi, "velocity_ratio": 0.0}  # fmt: skip
        end = 0.93 * length / speed
        times = np.linspace(0.0, end, 600)
        x = ds.run(FIG3, t_end=end, times=times, output={"fields": ["X"]}, **rig)["X"]
        # Up to the first slip, if friction weakens so much that it begins earlier.
        slips = np.flatnonzero(np.diff(x) > 0.5 * speed * times[1])
        stick = slice(int(0.97 * (slips[slips >= 5][0] + 1 if np.any(slips >= 5) else times.size)))
        noisy = x[stick] + 1e-5 * length * random.standard_normal(times[stick].size)
        fit = ds.fit_creep(times[stick], noisy, velocity=speed, stiffness_ratio=1 / ratio,
                           law=lambda v, a=fall, b=v_f: a + (1 - a) * np.exp(-v / b))  # fmt: skip
        found.append((abs(fit.misalignment_deg / phi - 1), fit.misfit))
    error, misfit = np.transpose(found)
    rests = np.isnan(error)
    print(f"{np.sum(rests)} of {count} rigs rest")
    for name, chosen in (("below 1.1", misfit < 1.1), ("above", misfit >= 1.1)):
        if np.any(chosen := chosen & ~rests):
            median, most, largest = 100 * np.quantile(error[chosen], [0.5, 0.9, 1.0])
            print(
                f"misfit {name}: {np.sum(chosen)} rigs, error of phi {median:.2g} % in the median, 90 % below {most:.2g} %, largest {largest:.2g} %"
            )


if __name__ == "__main__":
    main()
