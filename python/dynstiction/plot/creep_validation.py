"""Figure of the validation of slow creep, for one journal column."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from ..creep import creep_exact
from ..validate import ORDERS, TIME, Validation
from .style import BLACK, BLUE, COLUMN_WIDTH, GREEN, MM, VERMILION, letter

__all__ = ["draw_creep_validation"]

COLOURS = {"first_power": BLUE, "printed": VERMILION, "third_order": GREEN}
NAMES = {"first_power": "first power", "printed": "as printed", "third_order": "third order"}
POWERS = {"first_power": r"$\varphi^2$", "printed": r"$\varphi$", "third_order": r"$\varphi^3$"}
MARKS = {"first_power": "o", "printed": "s", "third_order": "^"}


def draw_creep_validation(validation: Validation, figure: Figure) -> None:
    """Three pieces of evidence: errors of the forms, creep of the full model, second contribution."""
    figure.set_size_inches(COLUMN_WIDTH, 145.0 * MM)
    axes = figure.subplots(3, 1)
    _draw_errors(axes[0], validation)
    _draw_means(axes[1], validation)
    _draw_second(axes[2], validation)
    for name, axis in zip("abc", axes, strict=True):
        letter(axis, name)
    figure.align_ylabels(axes)


def _draw_errors(axis: Axes, validation: Validation) -> None:
    """Errors against the exact creep at tau = 0.5, and the slopes of their orders."""
    for entry in validation.errors:
        if entry.tau != 0.5:
            continue
        colour = COLOURS[entry.form]
        slope = entry.error[-1] * (entry.degrees / entry.degrees[-1]) ** ORDERS[entry.form]
        axis.plot(entry.degrees, slope, color=colour)
        axis.plot(entry.degrees, entry.error, MARKS[entry.form], color=colour, markersize=3.0)
        above = entry.form != "third_order"
        axis.annotate(
            f"{NAMES[entry.form]}, {POWERS[entry.form]}",
            (entry.degrees[5], entry.error[5]),
            xytext=(-6.0, 7.0) if above else (6.0, -10.0),
            ha="center" if above else "left",
            textcoords="offset points",
            color=colour,
            fontsize=7.5,
        )
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_ylim(top=0.2)
    axis.xaxis.set_major_formatter("{x:g}")
    axis.set_xlabel(r"$\varphi$ [deg]")
    axis.set_ylabel(r"error of $\dot X/V$ at $\tau=0.5$")


def _draw_means(axis: Axes, validation: Validation) -> None:
    """X'/V in time: averages of the full model, the exact creep, two forms of Eq. (8)."""
    means = validation.by_time
    time = np.linspace(0.0, 1.08 * means[-1].time, 200)
    tau, phi = time * means[-1].tau / means[-1].time, means[-1].phi
    axis.plot(time, 1e3 * creep_exact(tau, phi).X_rate, color=BLACK, label="exact creep")
    for form, dashes in (("first_power", (4, 2)), ("printed", (1, 1))):
        axis.plot(
            time,
            1e3 * validation.forms[form](tau, phi),
            color=COLOURS[form],
            dashes=dashes,
            linewidth=1.0,
            label=f"Eq. (8), {NAMES[form]}",
        )
    axis.plot(
        [mean.time for mean in means],
        [1e3 * mean.full for mean in means],
        "o",
        color=BLACK,
        fillstyle="none",
        markersize=4.0,
        label="full model, average",
    )
    axis.set_xlim(0.0, time[-1])
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel("$t$ [s]")
    axis.set_ylabel(r"$\dot X/V$ [$10^{-3}$]")
    axis.legend(frameon=False, title=r"$\varphi=1°$", title_fontsize=7.5, loc="upper left")


def _draw_second(axis: Axes, validation: Validation) -> None:
    """What the full model's creep has beyond phi^2, over phi/sqrt(1 - tau^2): tau or its square."""
    tau = np.geomspace(0.02, 0.25, 2)
    axis.plot(tau, tau, color=BLUE)
    axis.plot(tau, tau**2, color=VERMILION)
    axis.text(0.06, 0.085, r"first power, $\tau$", color=BLUE, fontsize=7.5, ha="right")
    axis.text(0.06, 0.0055, r"as printed, $\tau^2$", color=VERMILION, fontsize=7.5, ha="right")
    by_degrees: dict[float, list[tuple[float, float]]] = {}
    for mean in validation.fit_points:
        second = (mean.at_time - mean.phi**2) * np.sqrt(1.0 - mean.tau**2) / mean.phi
        by_degrees.setdefault(mean.degrees, []).append((mean.tau, second))
    # The points of all misalignments coincide: rings of growing size.
    for i, (degrees, points) in enumerate(by_degrees.items()):
        size = 2.0 + 2.5 * i
        axis.plot(
            *np.array(points).T,
            "o",
            color=BLACK,
            fillstyle="none",
            markersize=size,
            markeredgewidth=0.6,
            label=f"{degrees:g}°",
        )
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlim(tau[0], tau[-1])
    axis.set_ylim(bottom=1.0e-4)
    axis.set_xticks([0.02, 0.05, 0.1, 0.2])
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel(rf"$\tau=Vt/l_x$ at $t={TIME:g}$ s, by $V$")
    axis.set_ylabel(r"$(\dot X/V-\varphi^2)\sqrt{1-\tau^2}/\varphi$")
    axis.legend(frameon=False, title=r"full model, $\varphi$", title_fontsize=7.5, loc="lower right", ncols=2)
