"""Which exponent Eq. (8) has: its forms against the exact creep, and the exact creep against the full model.

    python -m dynstiction.creep_validation [FIGURE.png]

prints checks and finding, and draws them; the exit status is 1 if a check fails. docs/creep_validation.md explains the method.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline  # type: ignore[import-untyped]

from ._run import run
from .creep import Form, creep_asymptotic, creep_exact
from .plot.style import BLACK, BLUE, GREEN, VERMILION, new_figure, panels

ORDERS: dict[Form, float] = {"first_power": 2.0, "printed": 1.0, "third_order": 3.0}
"""Forms of Eq. (8), and the order in phi of their errors, from docs/theory.md, section 3."""
TAUS, DEGREES = (0.25, 0.5, 0.8), 4.0 / 2.0 ** np.arange(9)
TIMES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2)
STIFFNESS_X, F_0, L_X = 1.0e3, 2.0, 2.0e-3  # N/m, N, m: Fig. 3 with constant friction
DECK = """\
&system stiffness_x = 1.0e3 / &friction law = 'constant', mu_0 = 0.2, normal_load = 10.0 /
&initial velocity_ratio = 1.0e-6 / &integrator rtol = 1.0e-9 / &output fields = 'u_y', 'X', 'X_rate' /
"""


class Mean(NamedTuple):
    """X'/V [-] over whole fast cycles around `time` [s], of the full model and of the exact creep with the same k_y."""

    phi: float
    tau: float
    mass: float
    time: float
    cycles: int
    full: float
    exact: float
    at_time: float
    """X'/V of the full model at `time`: the exact creep there, and the difference of the averages."""


def mean_creep(times: Sequence[float], half_width: float = 0.02, **keys: float) -> list[Mean]:
    """X' of the full model, averaged over whole fast cycles within `half_width` of each time [s]; other keys than Fig. 3's.

    A cycle begins where u_y rises through its value in the exact creep. There X, which oscillates opposite to u_y, is at its mean,
    so that a decaying oscillation does not affect the average.
    """
    rig: Any = {"velocity": 1e-3, "mass": 0.25, "stiffness_y": 1e7, "misalignment_deg": 1.0} | keys
    velocity, mass, stiffness_y, degrees = rig.values()
    cycle = 2.0 * np.pi * np.sqrt(mass / stiffness_y)
    margin = half_width + 3.0 * cycle
    result = run(DECK, t_end=max(times) + margin, interval=cycle / 48.0, **rig)
    phi, kappa, found = np.radians(degrees), STIFFNESS_X / stiffness_y, []
    for time in times:
        near = np.abs(result.time - time) <= margin
        t, x, x_rate = result.time[near], result["X"][near], result["X_rate"][near]
        alpha = creep_exact(velocity * t / L_X, phi, kappa).alpha
        beside = result["u_y"][near] - F_0 / stiffness_y * np.cos(alpha)
        rises = np.flatnonzero((beside[:-1] < 0.0) & (beside[1:] >= 0.0))
        begins = t[rises] - beside[rises] * np.diff(t)[rises] / np.diff(beside)[rises]
        first, last = (int(np.argmin(np.abs(begins - time - side))) for side in (-half_width, half_width))
        window = begins[[first, last]]
        way = velocity * np.ptp(window)
        full = np.ptp(CubicHermiteSpline(t, x, x_rate)(window)) / way
        exact = L_X * np.ptp(creep_exact(velocity * window / L_X, phi, kappa).X) / way
        tau = velocity * time / L_X
        at_time = float(creep_exact(tau, phi, kappa).X_rate) + float(full - exact)
        found.append(Mean(phi, tau, mass, time, last - first, float(full), float(exact), at_time))
    return found


def error(form: Form, tau: float) -> NDArray[np.float64]:
    """|X'/V of a form - exact| [-] at `DEGREES`, with a rigid stiff axis."""
    phi = np.radians(DEGREES)
    return np.abs(creep_asymptotic(tau, phi, form) - creep_exact(tau, phi).X_rate)


def observed_order(sizes: ArrayLike, errors: ArrayLike) -> float:
    """Slope of log(errors) over log(sizes), least squares."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def checks(means: Sequence[Mean]) -> dict[str, tuple[float, float, float]]:
    """What the finding needs: measured value, expected value and tolerance by name."""
    found = {}
    for form, order in ORDERS.items():
        for tau in TAUS:
            value = observed_order(DEGREES[-2:], error(form, tau)[-2:])
            found[f"order in phi of the error of {form}, tau = {tau:g}"] = (value, order, 0.05)
    one = next(mean for mean in means if mean.time == 1.0)
    found["X'/V of the full model at 1 s, 1 deg"] = (one.at_time, 0.0103482, 1e-7)
    expected_there: dict[Form, float] = {"first_power": 0.0032, "printed": -0.4837}
    for form, expected in expected_there.items():
        off = float(creep_asymptotic(one.tau, one.phi, form)) / one.at_time - 1.0
        found[f"relative error of {form} there"] = (off, expected, 1e-3)
    worst = max(abs(mean.full / mean.exact - 1.0) for mean in means)
    return found | {"full model and exact creep, largest relative difference": (worst, 0.0, 1e-4)}


def report(means: Sequence[Mean]) -> tuple[str, bool]:
    """The checks and the finding as text, and whether all checks hold."""
    lines, holds = [], True
    for name, (value, expected, tolerance) in checks(means).items():
        holds = holds and abs(value - expected) <= tolerance
        lines.append(f"{name:56} {value:11.7f}, must be {expected:g} +- {tolerance:g}")
    finding = (
        "Eq. (8) holds with the first power of Vt/l_x; the square that the preprint prints is a misprint."
    )
    return "\n".join([*lines, finding if holds else "A check fails: no finding on Eq. (8)."]), holds


def draw(means: Sequence[Mean]) -> Figure:
    """(a) Errors of the forms and their orders; (b) creep of the full model against time, 1 deg."""

    def fill(figure: Figure) -> None:
        errors, creep = panels(figure, 2, 110.0)
        time, phi = np.linspace(0.0, 1.3, 200), means[0].phi
        tau = time * means[0].tau / means[0].time
        creep.plot(time, 1e3 * creep_exact(tau, phi).X_rate, color=BLACK, label="exact creep")
        for (form, order), colour in zip(ORDERS.items(), (BLUE, VERMILION, GREEN), strict=True):
            size, label = error(form, 0.5), f"{form.replace('_', ' ')}: order {order:g}"
            errors.loglog(DEGREES, size, "o", color=colour, markersize=3.0, label=label)
            errors.loglog(DEGREES, size[-1] * (DEGREES / DEGREES[-1]) ** order, color=colour)
            creep.plot(time, 1e3 * creep_asymptotic(tau, phi, form), "--", color=colour)
        creep.plot(
            [m.time for m in means], [1e3 * m.full for m in means], "ko", fillstyle="none", label="full"
        )
        errors.set(xlabel=r"$\varphi$ [deg]", ylabel=r"error of $\dot X/V$ at $\tau=0.5$")
        creep.set(xlim=(0.0, 1.3), ylim=(0.0, 16.0), xlabel="$t$ [s]", ylabel=r"$\dot X/V$ [$10^{-3}$]")
        _ = errors.legend(), creep.legend()

    return new_figure(fill)


if __name__ == "__main__":
    averages = mean_creep(TIMES)
    text, is_sound = report(averages)
    print(text)
    if len(sys.argv) > 1:
        draw(averages).savefig(sys.argv[1], dpi=400)
    sys.exit(not is_sound)
