"""Bifurcation diagram of a sweep: a quantity of every settled stick-slip cycle over the parameter, with steady sliding."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from .._native import group_of
from ..equations import friction_coefficient
from ..errors import UsageError
from ..record import headed
from ..stability import CriticalMisalignment, critical_misalignment
from .branches import put_branches
from .notation import QUANTITIES, Floats
from .style import BLACK, BLUE, VERMILION, legend_above, one_axes
from .sweep_table import Axis, Table, table_of

if TYPE_CHECKING:
    import xarray

    from ..branches import Branches


COLOURS = "viridis"
ROW = 0.05
"""Height of a row of marks over that of the diagram."""

LOADS = ("peak_force", "valley_force")
"""Quantities that steady sliding has too."""

CONSEQUENCES = ("scene", "integrator")
"""Keys that a list may vary together with its parameter."""

SLIDER = ("mass", "stiffness_x", "misalignment_deg", "mu_0", "normal_load", "velocity")
"""Parameters of the stability of steady sliding; in addition mu_inf and v_f if friction weakens, k_y, and dampers."""
OPTIONAL = ("stiffness_y", "mu_inf", "v_f", "damping_x", "damping_y")


def draw_bifurcation(
    data: xarray.Dataset, figure: FigureBase, quantity: str = "peak_force", branches: Branches | None = None
) -> None:
    """Draw a dot for each cycle, steady sliding as a line, broken where it is unstable, other cases as marks below, and branches."""
    table = table_of(data)
    cycles = _cycles(table, quantity)
    # Along the axis, and a second one, if there is one, in colours.
    sides = [side for side in table.axes if group_of(side.name) not in CONSEQUENCES] or list(table.axes[:1])
    if len(sides) > 2:
        raise UsageError(
            f"a bifurcation diagram has one or two parameters, not {len(sides)}: select some with xarray"
        )
    axis, side = one_axes(figure, 72.0), sides[0]
    there = np.isfinite(cycles)
    shown = np.broadcast_to(_in_cases(table, side)[:, np.newaxis], cycles.shape)[there]
    counts = there.sum(axis=1)
    usual = np.median(counts[counts > 0]) if there.any() else 1.0
    # Repeated cycles lie on each other and become black; those of an irregular motion show their density.
    how: Any = {"alpha": float(np.clip(3.0 / usual, 0.3, 1.0)), "linewidths": 0.0, "rasterized": True}
    how["s"] = _dot(side) ** 2
    if len(sides) == 1:
        axis.scatter(shown, cycles[there], color=BLACK, **how)
    else:
        colour = np.broadcast_to(_in_cases(table, sides[1])[:, np.newaxis], cycles.shape)[there]
        dots = axis.scatter(shown, cycles[there], c=colour, cmap=COLOURS, norm=sides[1].norm, **how)
        figure.colorbar(dots, ax=axis, label=sides[1].symbol.label).solids.set_alpha(1.0)  # type: ignore[union-attr]
    about = table.data[f"cycle_{quantity}"].attrs
    label = headed(QUANTITIES.get(quantity, about.get("long_name", quantity)), about["units"])
    axis.set(xscale=side.scale, xlim=side.span, xlabel=side.symbol.label, ylabel=label)
    if branches is not None:
        if branches.key.rpartition(".")[2] != side.name:
            raise UsageError(f"branches over {branches.key}: the sweep varies {side.name}")
        put_branches(axis, branches, quantity)
    _draw_others(axis, table, side, quantity)
    if len(sides) == 1:
        draw_limits(axis, table, side)
        _draw_steady_branch(axis, table, side, quantity)
    legend_above(figure, axis.get_legend_handles_labels()[0], 2)


def _cycles(table: Table, quantity: str) -> Floats:
    """Values (case, cycle) of a quantity in the unit of the deck; none for cases that failed."""
    kept = [
        str(n).removeprefix("cycle_") for n, values in table.data.data_vars.items() if "cycle" in values.dims
    ]
    if not kept:
        raise UsageError("the sweep keeps no cycles: run it with sweep.keep = 'cycles'")
    if quantity not in kept:
        raise UsageError(f"no quantity '{quantity}' of a cycle, only {', '.join(sorted(kept))}")
    cases = table.data["result_code"]
    values = table.data[f"cycle_{quantity}"].where(cases == 0).transpose(*cases.dims, "cycle").values
    return np.asarray(values, dtype=float).reshape(cases.size, -1)


def _in_cases(table: Table, side: Axis) -> Floats:
    """A parameter in every case, in the unit of the figure."""
    return side.at(table.parameter(side.name)).reshape(-1)


def _dot(side: Axis) -> float:
    """Diameter of a dot [pt], which is smaller if the parameter has more values."""
    return float(np.clip(25.0 / np.sqrt(np.unique(side.values).size), 0.8, 2.5))


def _draw_others(axis: Axes, table: Table, side: Axis, quantity: str) -> None:
    """Cases without a cycle: the load at the end of those that slide steadily, and a mark below for each of the others."""
    shown = _in_cases(table, side)
    codes = table.data["result_code"].values.reshape(-1)
    without = (codes == 0) & (table.data["cycle_count"].values.reshape(-1) == 0)
    steady = without & table.slides().reshape(-1)
    # From the bottom upwards; a row without cases takes no space.
    rows = [("failed", codes > 0, VERMILION), ("no settled cycle yet", without & ~steady, "0.5")]
    if quantity in LOADS and table.has("stiffness_x"):
        pull = table.parameter("velocity") * np.cos(np.radians(table.parameter("misalignment_deg")))
        # k_x u_x at the end, positive where the drive pulls.
        load = np.ravel(np.sign(pull) * table.parameter("stiffness_x") * table.quantity("final_u_x"))
        dots: Any = {"markersize": _dot(side), "markeredgewidth": 0.0, "rasterized": True}
        axis.plot(shown[steady], load[steady], "o", color=BLUE, **dots)
    else:
        rows.append(("steady sliding", steady, BLUE))
    mark_below(axis, shown, rows)


def mark_below(axis: Axes, shown: Floats, rows: Sequence[tuple[str, NDArray[np.bool_], str]]) -> None:
    """Rows of marks below all dots: words for the legend, the cases that they apply to, and a colour; empty rows take no space."""
    rows = [row for row in rows if row[1].any()]
    marks: Any = {
        "markersize": 3.0,
        "markeredgewidth": 0.5,
        "rasterized": True,
        "linestyle": "",
        "marker": "|",
    }
    for i, (text, chosen, colour) in enumerate(rows):
        level = np.full(np.count_nonzero(chosen), 0.02 + ROW * i)
        place = axis.get_xaxis_transform()
        axis.plot(shown[chosen], level, color=colour, transform=place, label=text, **marks)
    if rows:
        (low, high), room = axis.get_ylim(), ROW * len(rows)
        axis.set_ylim(low - room / (1.0 - room) * (high - low), high)


def slider_at(table: Table, side: Axis, values: Floats) -> dict[str, Floats] | None:
    """Parameters of steady sliding for these values of the parameter of the diagram; None if some are missing, V is 0,
    or the friction law is not given by coefficients.
    """
    names = [*SLIDER, *(name for name in OPTIONAL if table.has(name))]
    held: dict[str, Any] = {**table.numbers, side.name: values}
    if not table.has_theory or not all(name in held for name in names) or not np.all(held["velocity"]):
        return None
    return {name: np.broadcast_to(held[name], values.shape) for name in names}


def critical_of(slider: dict[str, Floats]) -> CriticalMisalignment:
    """Where steady sliding loses its stability; without a stiff axis only the limit for a rigid one means something."""
    others = {name: values for name, values in slider.items() if name != "misalignment_deg"}
    # The rigid limit does not depend on k_y.
    return critical_misalignment(**({"stiffness_y": 1e6 * others["stiffness_x"]} | others))


def _is_stable(slider: dict[str, Floats]) -> NDArray[np.bool_]:
    """Whether steady sliding is stable; without a stiff axis, for a rigid one."""
    critical = critical_of(slider)
    # An angle and its mirror images are equivalent.
    angle = 90.0 - np.abs(90.0 - np.mod(slider["misalignment_deg"], 180.0))
    if "stiffness_y" not in slider:
        return np.asarray(angle > critical.limit)
    with np.errstate(invalid="ignore"):
        return np.asarray((angle > critical.window[..., 0]) & (angle < critical.window[..., 1]))


def _draw_steady_branch(axis: Axes, table: Table, side: Axis, quantity: str) -> None:
    """Draw the load of steady sliding, solid where it is stable."""
    slider = slider_at(table, side, side.fine)
    if quantity not in LOADS or slider is None or not np.ptp(side.fine) > 0.0:
        return
    friction = friction_coefficient(np.abs(slider["velocity"]), slider)
    # F(V) cos(phi), positive where the drive pulls.
    load = friction * slider["normal_load"] * np.abs(np.cos(np.radians(slider["misalignment_deg"])))
    shown, stable = side.at(side.fine), _is_stable(slider)
    style: Any = {"color": BLUE, "linewidth": 0.7, "zorder": 1.5}
    unstable = "unstable" if stable.any() else "steady sliding, unstable"
    for part, dashes, label in ((stable, "-", "steady sliding"), (~stable, (0, (4.0, 3.0)), unstable)):
        if part.any():
            axis.plot(shown, np.where(part, load, np.nan), linestyle=dashes, label=label, **style)


def draw_limits(axis: Axes, table: Table, side: Axis) -> None:
    """Draw thin lines where steady sliding gains or loses its stability along the parameter, found by bisection."""
    slider = slider_at(table, side, side.fine)
    if slider is None:
        return
    stable = _is_stable(slider)
    changes = np.flatnonzero(np.diff(stable))
    low, high, before = side.fine[changes], side.fine[changes + 1], stable[changes]
    here = {name: values[changes] for name, values in slider.items()}
    for _ in range(50 if changes.size else 0):
        middle = 0.5 * (low + high)
        same = _is_stable(here | {side.name: middle}) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    unit = side.symbol.label.partition("[")[2].rstrip("]")
    for value, was_stable in zip(side.at(high), before, strict=True):
        label = f"steady sliding stable {'below' if was_stable else 'above'} {value:.3g} {unit}".rstrip()
        axis.axvline(value, color=BLUE, linewidth=0.5, zorder=1.0, label=label)
