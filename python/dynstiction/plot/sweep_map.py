"""Map of a sweep: a quantity over one or two parameters, with the lines where steady sliding loses its stability."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import FigureBase
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from ..errors import UsageError
from ..record import headed
from .bifurcation import critical_of, draw_limits, mark_below, slider_at
from .notation import QUANTITIES, Floats, scaled
from .style import BLACK, BLUE, BROWN, GREEN, PURPLE, SKY, VERMILION, legend_above, one_axes, ticks_outside
from .sweep_table import Axis, Table, table_of

if TYPE_CHECKING:
    import xarray


COLOURS = "cividis"
NOTHING = "0.8"
"""Colour of cases that are done and have no such quantity."""

RELATIVE = {
    "swing": ("peak-to-peak $k_x u_x$ over $F_0$", "F_0"),
    "peak_force": ("mean peak of the load over $F_0$", "F_0"),
    "valley_force": ("mean valley of the load over $F_0$", "F_0"),
    "pull_peak": ("largest pull force over $F_0$", "F_0"),
    "pull_valley": ("smallest pull force over $F_0$", "F_0"),
    "pull_swing": ("peak-to-peak pull force over $F_0$", "F_0"),
    "sticking_time": ("share of the time at true rest", "t_end"),
}
"""Quantities that are drawn in units of the static limit F_0 = mu_0 W or of the run's length: label, unit."""

LASTING = ("swing", "pull_swing")
"""Quantities without a value where the motion rings down: they would be those of the second half of a run."""
IRREGULAR, RINGING_DOWN = -1.0, 3.0
"""Values of the regularity."""

OF_CYCLES = ("period", "peak_force", "valley_force", "slip_length", "slip_duration", "stick_duration")
"""Quantities that exist only with stick-slip, besides their scatters."""
CROWDED = 1.5
"""Ratio of the largest value to the largest one without the top 2 %, above which the top values do not set the colours."""
USUAL_SHARE = 98.0

SIGNED = {"lyapunov_exponent": 5.0}
"""Quantities whose sign matters, and the limit of the colours on either side of 0."""
SIGNED_COLOURS = "RdBu_r"


def draw_map(data: xarray.Dataset, figure: FigureBase, quantity: str = "swing") -> None:
    """A quantity in colours over a grid, as a line over one parameter, or as marks for a list."""
    table = table_of(data)
    values, label = _values(table, quantity)
    if not np.isfinite(values).any():
        raise UsageError(f"nothing to draw: no case has a value of '{quantity}': name another quantity")
    axis = one_axes(figure, 72.0)
    if len(table.axes) == 1:
        _draw_line(axis, table, quantity, values, label)
        legend_above(figure, axis.get_legend_handles_labels()[0], 2)
    elif table.is_grid and len(table.axes) == 2:
        _draw_colours(figure, axis, table, quantity, values, label)
    elif table.is_grid:
        raise UsageError(f"a map has one or two parameters, not {len(table.axes)}: select some with xarray")
    else:
        # Marks against the first parameter of a list, in colours of the second.
        first, second = table.axes[:2]
        marks = axis.scatter(first.shown, values, c=second.shown, s=6.0, cmap=COLOURS, norm=second.norm)
        figure.colorbar(marks, ax=axis, label=second.symbol.label)
        axis.set(xscale=first.scale, xlabel=first.symbol.label, ylabel=label)


def _values(table: Table, quantity: str) -> tuple[Floats, str]:
    """Values as they are drawn, and their label."""
    values = table.quantity(quantity)
    if _of_cycles(quantity):
        values = np.where(_slides(table), np.nan, values)
    elif quantity in LASTING:
        values = np.where(_is(RINGING_DOWN, table), np.nan, values)
    about = table.data[quantity].attrs
    if quantity in RELATIVE:
        label, unit = RELATIVE[quantity]
        names = ("mu_0", "normal_load") if unit == "F_0" else (unit,)
        if all(table.has(name) for name in names):
            return values / np.prod([table.parameter(name) for name in names], axis=0), label
    text = QUANTITIES.get(quantity, str(about["long_name"]).replace("_", " "))
    if about["units"] == "rad":
        return np.degrees(values), headed(text, "deg")
    factor, unit = scaled(str(about["units"]), values)
    return factor * values, headed(text, unit)


def _of_cycles(quantity: str) -> bool:
    return quantity.removesuffix("_scatter") in OF_CYCLES


def _absent(table: Table, quantity: str, values: Floats) -> list[tuple[str, NDArray[np.bool_], str]]:
    """Why cases have no value: words, the cases, and a colour that the values do not have."""
    codes = table.data["result_code"].values
    missing = ~np.isfinite(values)
    done = missing & (codes == 0)
    rows = [("failed", missing & (codes > 0), PURPLE), ("not run", missing & ~(codes >= 0), GREEN)]
    if not _of_cycles(quantity):
        rings_down = done & (quantity in LASTING) & _is(RINGING_DOWN, table)
        return [*rows, ("rings down", rings_down, SKY), ("no value", done & ~rings_down, NOTHING)]
    steady = done & _slides(table)
    cycled = done & ~steady & (table.quantity("cycles") > 0.0)
    return [
        *rows, ("no stick-slip", steady, NOTHING), ("rings down", cycled, SKY), ("no cycle yet", done & ~steady & ~cycled, BROWN)
    ]  # fmt: skip


def _is(verdict: float, table: Table) -> NDArray[np.bool_]:
    """Whether the regularity of each case is this one."""
    if "regularity" not in table.data:
        return np.zeros(table.data["result_code"].shape, dtype=bool)
    return np.asarray(table.quantity("regularity") == verdict)


def _slides(table: Table) -> NDArray[np.bool_]:
    """Whether each case slides steadily: its swing is so small that earlier cycles did not persist."""
    is_known = "swing" in table.data and table.has("mu_0") and table.has("normal_load")
    return table.slides() if is_known else np.zeros(table.data["result_code"].shape, dtype=bool)


def _draw_line(axis: Axes, table: Table, quantity: str, values: Floats, label: str) -> None:
    (side,) = table.axes
    order = np.argsort(side.values)
    axis.plot(side.shown[order], values[order], ".-", color=BLUE, markersize=3.0)
    # The limits are those of all cases, also if no case has a value.
    axis.set(xscale=side.scale, xlim=side.span, xlabel=side.symbol.label, ylabel=label)
    rows = [*_absent(table, quantity, values), ("irregular", _is(IRREGULAR, table), BLACK)]
    # In a colour that is visible on paper.
    mark_below(axis, side.shown, [(*row[:2], "0.35" if row[2] == NOTHING else row[2]) for row in rows])
    draw_limits(axis, table, side)


def _draw_colours(
    figure: FigureBase, axis: Axes, table: Table, quantity: str, values: Floats, label: str
) -> None:
    """Draw the first parameter upwards and the second to the right, or vice versa if the second is the misalignment."""
    if table.axes[1].name == "misalignment_deg":
        dims = table.data["result_code"].dims[::-1]
        table, values = table._replace(data=table.data.transpose(*dims, ...), axes=table.axes[::-1]), values.T
    up, right = table.axes
    absent = [row for row in _absent(table, quantity, values) if row[1].any()]
    irregular = _is(IRREGULAR, table)
    decay = table.quantity("fast_decay") if "fast_decay" in table.data else np.ones_like(values)
    colours, extend = COLOURS, "neither"
    lowest, highest = min(0.0, float(np.nanmin(values))), float(np.nanmax(values))
    usual = float(np.nanpercentile(values, USUAL_SHARE))
    if quantity in SIGNED:
        colours, extend, lowest, highest = SIGNED_COLOURS, "both", -SIGNED[quantity], SIGNED[quantity]
    elif highest > CROWDED * usual > 0.0:
        # Otherwise a few cases would leave one colour for all others.
        extend, highest = "max", usual
    cells: Any = (_edges(right), _edges(up))
    picture = axis.pcolormesh(*cells, values, cmap=colours, vmin=lowest, vmax=highest, rasterized=True)
    figure.colorbar(picture, ax=axis, label=label, extend=extend)
    for _, cases, colour in absent:
        there = np.ma.masked_equal(cases, False)
        axis.pcolormesh(*cells, there, cmap=ListedColormap([colour]), rasterized=True)
    if quantity == "lyapunov_exponent" and min(decay.shape) > 1 and np.nanmin(decay) < 1.0 < np.nanmax(decay):
        # The curve beyond which the fast oscillation decays before slip.
        line = axis.contour(right.shown, up.shown, decay, levels=[1.0], colors=BLACK, linewidths=1.2)
        axis.clabel(line, fmt={1.0: "$D=1$"}, fontsize="small")
    if irregular.any():
        rows, columns = np.nonzero(irregular)
        style: Any = {"color": BLACK, "markersize": 1.2, "label": "irregular", "rasterized": True}
        axis.plot(right.shown[columns], up.shown[rows], ".", **style)
    if up.name == "misalignment_deg":
        _draw_stability(axis, table, right)
    axis.set(xscale=right.scale, xlim=cells[0][[0, -1]], xlabel=right.symbol.label)
    axis.set(yscale=up.scale, ylim=cells[1][[0, -1]], ylabel=up.symbol.label)
    # Above the map: the lines that it shows, and the colours of cases without a value.
    low, high = axis.get_ylim()
    named = [line for line in axis.lines if not str(line.get_label()).startswith("_")]
    seen = [line for line in named if any(low < y < high for y in np.asarray(line.get_ydata()))]
    legend_above(figure, [*seen, *(Patch(color=colour, label=text) for text, _, colour in absent)], 2)
    ticks_outside(axis)


def _edges(side: Axis) -> Floats:
    """Borders of the cells around the values, in the unit of the figure."""
    values = np.log(side.shown) if side.scale == "log" else side.shown
    steps = np.diff(values) if values.size > 1 else np.ones(1)
    wider = np.concatenate([values[:1] - steps[0], values, values[-1:] + steps[-1]])
    edges = 0.5 * (wider[1:] + wider[:-1])
    if side.scale == "log":
        return np.asarray(np.exp(edges))
    # Positive values have no cells below 0.
    return np.maximum(edges, 0.0) if np.min(side.shown) > 0.0 else np.asarray(edges)


def _draw_stability(axis: Axes, table: Table, right: Axis) -> None:
    """Lines between which steady sliding is stable, and, if k_y is varied, the crossover tan(phi) = k_x/k_y."""
    shown = right.at(right.fine)
    slider = slider_at(table, right, right.fine)
    # Constant friction leaves steady sliding stable.
    if slider is not None and "v_f" in slider and "mu_inf" in slider:
        critical = critical_of(slider)
        limit: Any = {"color": VERMILION, "linewidth": 1.2}
        slow, fast = critical.angle.T if "stiffness_y" in slider else (critical.limit, None)
        axis.plot(shown, slow, label="stability limit, slow mode", **limit)
        if fast is not None:
            axis.plot(shown, fast, linestyle="--", label="fast mode", **limit)
        if fast is not None and right.name != "stiffness_y":
            # A dark edge, so that the line is also visible on the paper of the legend.
            style: Any = {"color": "white", "linestyle": (0, (1, 1.5)), "label": "rigid stiff axis"}
            edge = [Stroke(linewidth=2.2, foreground="0.2"), Normal()]
            axis.plot(shown, critical.limit, linewidth=1.0, path_effects=edge, **style)
    if right.name == "stiffness_y" and table.has("stiffness_x"):
        crossover = np.degrees(np.arctan(table.numbers["stiffness_x"] / right.fine))
        axis.plot(shown, crossover, color=BLACK, linewidth=1.0, linestyle=":", label=r"$\tan\varphi=k_x/k_y$")
