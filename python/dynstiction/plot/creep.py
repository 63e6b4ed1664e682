"""Slow creep of a run, its closed form and the expansions of Eq. (8)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import FigureBase

from ..creep import Form, creep_asymptotic, creep_exact
from ..errors import UsageError
from ..result import Result
from ..stick_slip import first_release
from .notation import SPEED_RATIO, Floats
from .style import BLACK, BLUE, GREEN, SKY, VERMILION, note, panels
from .theory import scaled, stiff_frequency
from .view import View, coarseness

# The forms of Eq. (8) are drawn up to here, where they are no longer valid.
LAST_TAU = 0.999
FORMS: dict[Form, tuple[str, str, str]] = {
    "first_power": ("Eq. (8)", BLUE, "--"),
    "printed": ("Eq. (8) as printed", VERMILION, ":"),
    "third_order": ("third order", GREEN, "-."),
}
POINTS = 200
AVERAGED = 8
"""Least number of samples that are averaged."""
PERIODS = 5.0
"""Least number of periods of the stiff axis that are averaged: with a part of a period, the oscillation would be visible."""
AT_REST = 0.3
"""Share of the slowest exact creep below which the object is at rest in a mean of the run, which would spoil the scale."""


def draw_creep(view: View, figure: FigureBase) -> None:
    """Mean velocity along the drive in the first creep, and its deviation from the exact creep."""
    result = view.whole
    tau, run, smooth = mean_velocity(result)
    _, phi, kappa = scaled(result, np.zeros(1))
    exact = creep_exact(tau, phi, kappa).X_rate
    above, below = panels(figure, 2, 105.0, sharex=True, height_ratios=(3.0, 2.0))
    creeps = exact > 0.0
    slowest = float(exact[creeps].min()) if creeps.any() else 0.0
    wide: Any = {"color": SKY, "linewidth": 4.0, "alpha": 0.6}
    above.plot(tau, np.where(run > AT_REST * slowest, run, np.nan), label="run", **wide)
    above.plot(tau, np.where(creeps, exact, np.nan), color=BLACK, zorder=3, label="exact, Eq. (7)")
    below.axhline(0.0, color=BLACK)
    below.plot(tau, _percent(run, smooth), **wide)
    for name, (label, colour, dashes) in FORMS.items():
        # Up to where the forms are valid.
        values = np.where(tau < LAST_TAU, creep_asymptotic(np.minimum(tau, LAST_TAU), phi, name), np.nan)
        style: Any = {"color": colour, "linestyle": dashes, "linewidth": 1.0, "label": label}
        above.plot(tau, np.where(values > 0.0, values, np.nan), **style)
        below.plot(tau, _percent(values, exact), **style)
    above.set(yscale="log", ylabel=SPEED_RATIO)
    note(above, [coarseness(result) or ""])
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper center", ncols=2, handlelength=2.4)
    below.set(ylim=(-12.0, 12.0), ylabel="deviation [%]", xlabel=r"$\tau = V t\, k_x/(\mu_0 W)$")
    below.set_xlim(0.0, max(tau[-1], min(1.0, 1.02 * tau[-1])))


def mean_velocity(result: Result) -> tuple[Floats, Floats, Floats]:
    """Times V t k_x/(mu_0 W) of the first creep, X'/V of the run, and that of `creep_exact`, smoothed in the same way.

    It is a difference of means of X, so that the oscillation is not visible and the samples need not resolve it. A `UsageError`
    is raised if the closed form of creep does not apply to the run, or the run has no creep.
    """
    end = first_release(result["spring_force_x"]) + 1
    tau, phi, kappa = scaled(result, result.time[:end])
    if end < 2 * AVERAGED or phi == 0.0:
        raise UsageError(
            f"the run has no creep to show: it needs a misalignment that is not 0 and {2 * AVERAGED} samples "
            "before its first slip"
        )
    exact = creep_exact(tau, phi, kappa)
    # X' = w.(cos phi, sin phi) changes sign with the drive; the closed form is for a drive with V > 0.
    length = float(result.parameters["velocity"]) * result.time[1] / tau[1]
    least, frequency = AVERAGED, stiff_frequency(result)
    step = float(np.median(np.diff(result.time[:end])))
    if frequency is not None and step > 0.0:
        least = int(min(end // 4, np.ceil(PERIODS / (frequency * step))))
    middle, run = _mean_slope(tau, result["X"][:end] / length, least)
    return middle, run, _mean_slope(tau, exact.X, least)[1]


def _mean_slope(x: Floats, y: Floats, least: int) -> tuple[Floats, Floats]:
    """Slope of y(x), averaged with triangles of 1/40 of all samples or of the least number, and the middles of the triangles."""
    half = max(AVERAGED // 2, x.size // 80, least // 2)
    starts = np.unique(np.linspace(0, x.size - 1 - 2 * half, POINTS).astype(int))
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(x))])
    left, middle, right = (x[starts + i * half] for i in range(3))
    first, whole, second = (integral[starts + i * half] for i in range(3))
    means = (whole - first) / (middle - left), (second - whole) / (right - middle)
    return (left + middle + right) / 3.0, 2.0 * (means[1] - means[0]) / (right - left)


def _percent(values: Floats, exact: Floats) -> Floats:
    """Deviation [%]; NaN at rest."""
    nothing = np.full_like(exact, np.nan)
    return np.asarray(100.0 * np.divide(values - exact, exact, out=nothing, where=exact > 0.0))
