"""Figure of the validation of slow creep, for one journal column."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from ..creep import creep_exact
from ..validate import DEGREES, ORDERS, Validation
from .style import BLACK, BLUE, GREEN, VERMILION, panels

__all__ = ["draw_creep_validation"]

FORMS = {
    "first_power": ("first power", BLUE, "o", r"$\varphi^2$", (4, 2)),
    "printed": ("as printed", VERMILION, "s", r"$\varphi$", (1, 1)),
    "third_order": ("third order", GREEN, "^", r"$\varphi^3$", None),
}
"""Name, colour, mark, order of the error, and dashes of the forms that are drawn against time."""


def draw_creep_validation(validation: Validation, figure: FigureBase) -> None:
    """Errors of the forms, and the creep of the full model."""
    axes = panels(figure, 2, 100.0)
    _draw_errors(axes[0], validation)
    _draw_means(axes[1], validation)


def _draw_errors(axis: Axes, validation: Validation) -> None:
    """Errors relative to the exact creep at tau = 0.5, and the slopes of their orders."""
    for form, (name, colour, mark, power, _) in FORMS.items():
        error = validation.error(form, 0.5)
        axis.plot(DEGREES, error[-1] * (DEGREES / DEGREES[-1]) ** ORDERS[form], color=colour)
        axis.plot(DEGREES, error, mark, color=colour, markersize=3.0)
        above = form != "third_order"
        axis.annotate(
            f"{name}, {power}",
            (DEGREES[5], error[5]),
            xytext=(-6.0, 7.0) if above else (6.0, -10.0),
            ha="center" if above else "left",
            textcoords="offset points",
            color=colour,
            fontsize=7.5,
        )
    axis.set(
        xscale="log", yscale="log", xlabel=r"$\varphi$ [deg]", ylabel=r"error of $\dot X/V$ at $\tau=0.5$"
    )
    axis.set_ylim(top=0.2)
    axis.xaxis.set_major_formatter("{x:g}")


def _draw_means(axis: Axes, validation: Validation) -> None:
    """X'/V against time: averages of the full model, the exact creep, two forms of Eq. (8)."""
    means = validation.means
    time = np.linspace(0.0, 1.08 * means[-1].time, 200)
    tau, phi = time * means[-1].tau / means[-1].time, means[-1].phi
    axis.plot(time, 1e3 * creep_exact(tau, phi).X_rate, color=BLACK, label="exact creep")
    for form, (name, colour, *_, dashes) in FORMS.items():
        if dashes:
            rate = 1e3 * validation.forms[form](tau, phi)
            axis.plot(time, rate, color=colour, dashes=dashes, linewidth=1.0, label=f"Eq. (8), {name}")
    (rings,) = axis.plot([mean.time for mean in means], [1e3 * mean.full for mean in means], "o", color=BLACK)
    rings.set(fillstyle="none", markersize=4.0, label="full model, average")
    axis.set(xlim=(0.0, time[-1]), xlabel="$t$ [s]", ylabel=r"$\dot X/V$ [$10^{-3}$]")
    axis.set_ylim(bottom=0.0)
    axis.legend(title=r"$\varphi=1°$", title_fontsize=7.5, loc="upper left")
