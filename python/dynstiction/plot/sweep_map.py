"""Map of a sweep: a quantity over one or two parameters, with the lines where steady sliding loses its stability."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import FigureBase
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from ..errors import UsageError
from ..stability import critical_misalignment
from .bifurcation import draw_vertical_lines, mark_below, slides_steadily, span_of
from .notation import QUANTITIES, scaled, with_unit
from .samples import Floats
from .style import BLACK, BLUE, BROWN, GREEN, PURPLE, SKY, VERMILION, sized
from .sweep_table import Axis, Table, table_of

if TYPE_CHECKING:
    import xarray

__all__ = ["draw_map"]

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

SLIDER = ("mass", "stiffness_x", "stiffness_y", "mu_0", "mu_inf", "v_f", "normal_load", "velocity")
"""Parameters of the lines of stability, besides the misalignment."""
DAMPERS = ("damping_x", "damping_y")
"""Additional parameters if there are dampers."""

FINE = 2000
"""Number of points of a line of stability."""


def draw_map(data: xarray.Dataset, figure: FigureBase, quantity: str = "swing") -> None:
    """A quantity in colours over a grid, as a line over one parameter, or as marks for a list."""
    table = table_of(data)
    values, label = _values(table, quantity)
    if not np.isfinite(values).any():
        raise UsageError(f"nothing to draw: no case has a value of '{quantity}': name another quantity")
    sized(figure, 72.0)
    axis = figure.subplots()
    if len(table.axes) == 1:
        _draw_line(axis, table, quantity, values, label)
    elif table.is_grid and len(table.axes) == 2:
        _draw_colours(figure, axis, table, quantity, values, label)
    elif table.is_grid:
        raise UsageError(f"a map has one or two parameters, not {len(table.axes)}: select some with xarray")
    else:
        _draw_marks(figure, axis, table, values, label)


def _values(table: Table, quantity: str) -> tuple[Floats, str]:
    """Values as they are drawn, and their label."""
    values = table.quantity(quantity)
    if _of_cycles(quantity):
        values = np.where(_slides(table, values.shape), np.nan, values)
    elif quantity in LASTING:
        values = np.where(_is(RINGING_DOWN, table, values.shape), np.nan, values)
    about = table.data[quantity].attrs
    if quantity in RELATIVE:
        label, unit = RELATIVE[quantity]
        names = ("mu_0", "normal_load") if unit == "F_0" else (unit,)
        if all(table.has(name) for name in names):
            return values / np.prod([table.parameter(name) for name in names], axis=0), label
    text = QUANTITIES.get(quantity, str(about["long_name"]).replace("_", " "))
    if about["units"] == "rad":
        return np.degrees(values), with_unit(text, "deg")
    factor, unit = scaled(str(about["units"]).replace("m s-1", "m/s"), values)
    return factor * values, with_unit(text, unit)


def _of_cycles(quantity: str) -> bool:
    return quantity.removesuffix("_scatter") in OF_CYCLES


def _absent(table: Table, quantity: str, values: Floats) -> list[tuple[str, NDArray[np.bool_], str]]:
    """Why cases have no value: words, the cases, and a colour that the values do not have."""
    codes = table.data["result_code"].values
    missing = ~np.isfinite(values)
    done = missing & (codes == 0)
    rows = [("failed", missing & (codes > 0), PURPLE), ("not run", missing & ~(codes >= 0), GREEN)]
    if not _of_cycles(quantity):
        rings_down = done & (quantity in LASTING) & _is(RINGING_DOWN, table, values.shape)
        return [*rows, ("rings down", rings_down, SKY), ("no value", done & ~rings_down, NOTHING)]
    steady = done & _slides(table, values.shape)
    cycled = done & ~steady & (table.quantity("cycles") > 0.0)
    return [
        *rows, ("no stick-slip", steady, NOTHING), ("rings down", cycled, SKY), ("no cycle yet", done & ~steady & ~cycled, BROWN)
    ]  # fmt: skip


def _is(verdict: float, table: Table, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Whether the regularity of each case is this one."""
    if "regularity" not in table.data:
        return np.zeros(shape, dtype=bool)
    return np.asarray(table.quantity("regularity").reshape(shape) == verdict)


def _slides(table: Table, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Whether each case slides steadily: its swing is so small that earlier cycles did not persist."""
    if "swing" in table.data and table.has("mu_0") and table.has("normal_load"):
        return slides_steadily(table).reshape(shape)
    return np.zeros(shape, dtype=bool)


def _draw_line(axis: Axes, table: Table, quantity: str, values: Floats, label: str) -> None:
    (side,) = table.axes
    order = np.argsort(side.values)
    axis.plot(side.shown[order], values[order], ".-", color=BLUE, markersize=3.0)
    axis.set(xscale=side.scale, xlabel=side.label, ylabel=label)
    # Also if no case has a value.
    axis.set_xlim(*span_of(side))
    rows = [
        (text, cases, "0.35" if colour == NOTHING else colour)
        for text, cases, colour in [
            *_absent(table, quantity, values),
            ("irregular", _is(IRREGULAR, table, values.shape), BLACK),
        ]
    ]
    mark_below(axis, side.shown, rows)
    draw_vertical_lines(axis, table, side)


def _draw_marks(figure: FigureBase, axis: Axes, table: Table, values: Floats, label: str) -> None:
    """Draw marks against the first parameter, in colours of the second."""
    first, second = table.axes[:2]
    norm = LogNorm() if second.scale == "log" else Normalize()
    marks = axis.scatter(first.shown, values, c=second.shown, s=6.0, cmap=COLOURS, norm=norm)
    figure.colorbar(marks, ax=axis, label=second.label)
    axis.set(xscale=first.scale, xlabel=first.label, ylabel=label)


def _draw_colours(
    figure: FigureBase, axis: Axes, table: Table, quantity: str, values: Floats, label: str
) -> None:
    """Draw the first parameter upwards and the second to the right, or vice versa if the second is the misalignment."""
    up, right = table.axes
    absent = [row for row in _absent(table, quantity, values) if row[1].any()]
    is_turned = right.name == "misalignment_deg"
    if is_turned:
        up, right, values = right, up, values.T
    extend = "both" if quantity in SIGNED else "neither"
    if quantity in SIGNED:
        colours, highest = SIGNED_COLOURS, SIGNED[quantity]
        lowest = -highest
    else:
        colours, highest = COLOURS, np.nanmax(values)
        lowest = min(0.0, np.nanmin(values))
        usual = float(np.nanpercentile(values, USUAL_SHARE))
        if highest > CROWDED * usual > 0.0:
            # Otherwise a few cases would leave one colour for all others.
            highest, extend = usual, "max"
    picture = axis.pcolormesh(
        _edges(right), _edges(up), values, cmap=colours, vmin=lowest, vmax=highest, rasterized=True
    )
    figure.colorbar(picture, ax=axis, label=label, extend=extend)
    for _, cases, colour in absent:
        cells = np.ma.masked_equal(cases.T if is_turned else cases, False)
        axis.pcolormesh(_edges(right), _edges(up), cells, cmap=ListedColormap([colour]), rasterized=True)
    if quantity == "lyapunov_exponent" and "fast_decay" in table.data:
        decay = table.quantity("fast_decay")
        _draw_decay(axis, up, right, decay.T if is_turned else decay)
    irregular = _is(IRREGULAR, table, table.quantity(quantity).shape)
    if irregular.any():
        rows, columns = np.nonzero(irregular.T if is_turned else irregular)
        axis.plot(
            right.shown[columns],
            up.shown[rows],
            ".",
            color=BLACK,
            markersize=1.2,
            label="irregular",
            rasterized=True,
        )
    if up.name == "misalignment_deg":
        _draw_stability(axis, table, up, right)
    axis.set(xscale=right.scale, xlim=_edges(right)[[0, -1]], xlabel=right.label)
    axis.set(yscale=up.scale, ylim=_edges(up)[[0, -1]], ylabel=up.label)
    _draw_legend(figure, axis, [Patch(color=colour, label=text) for text, _, colour in absent])
    # Ticks inside would not be visible on the colours.
    axis.tick_params(which="both", direction="out", top=False, right=False)


def _draw_decay(axis: Axes, up: Axis, right: Axis, decay: Floats) -> None:
    """Draw the curve D = 1, beyond which the fast oscillation decays before slip."""
    if min(decay.shape) > 1 and np.nanmin(decay) < 1.0 < np.nanmax(decay):
        line = axis.contour(right.shown, up.shown, decay, levels=[1.0], colors=BLACK, linewidths=1.2)
        axis.clabel(line, fmt={1.0: "$D=1$"}, fontsize="small")


def _edges(side: Axis) -> Floats:
    """Borders of the cells around the values, in the unit of the figure."""
    values = np.log(side.shown) if side.scale == "log" else side.shown
    half = 0.5 * np.diff(values) if values.size > 1 else np.array([0.5])
    edges = np.concatenate(
        ([values[0] - half[0]], values[:-1] + half[: values.size - 1], [values[-1] + half[-1]])
    )
    if side.scale == "log":
        return np.asarray(np.exp(edges))
    # Positive values have no cells below 0.
    return np.maximum(edges, 0.0) if np.min(side.shown) > 0.0 else np.asarray(edges)


def _draw_stability(axis: Axes, table: Table, up: Axis, right: Axis) -> None:
    """Lines between which steady sliding is stable, and, if k_y is varied, the crossover tan(phi) = k_x/k_y."""
    spaced = np.geomspace if right.scale == "log" else np.linspace
    values = spaced(right.values.min(), right.values.max(), FINE)
    shown = right._replace(values=values).shown
    if table.has_theory and all(
        name in table.numbers or name == right.name for name in SLIDER if name != "stiffness_y"
    ):
        # Without a stiff axis only the limit for a rigid one is drawn, which does not depend on k_y.
        given = {"stiffness_y": 1e6 * table.numbers.get("stiffness_x", 1.0)}
        given |= {name: table.numbers[name] for name in (*SLIDER, *DAMPERS) if name in table.numbers}
        critical = critical_misalignment(**(given | {right.name: values}))
        (slow, fast), rigid = critical.angle.T, critical.limit
        if table.has("stiffness_y"):
            axis.plot(shown, slow, color=VERMILION, linewidth=1.2, label="stability limit, slow mode")
            axis.plot(shown, fast, color=VERMILION, linewidth=1.2, linestyle="--", label="fast mode")
            if right.name != "stiffness_y":
                (line,) = axis.plot(
                    shown,
                    rigid,
                    color="white",
                    linewidth=1.0,
                    linestyle=(0, (1, 1.5)),
                    label="rigid stiff axis",
                )
                # A dark edge, so that the line is also visible on the paper of the legend.
                line.set_path_effects([Stroke(linewidth=2.2, foreground="0.2"), Normal()])
        else:
            axis.plot(shown, rigid, color=VERMILION, linewidth=1.2, label="stability limit, slow mode")
    if right.name == "stiffness_y" and table.has("stiffness_x"):
        crossover = np.degrees(np.arctan(table.numbers["stiffness_x"] / values))
        axis.plot(shown, crossover, color=BLACK, linewidth=1.0, linestyle=":", label=r"$\tan\varphi=k_x/k_y$")


def _draw_legend(figure: FigureBase, axis: Axes, absent: Sequence[Patch]) -> None:
    """Legend above the map: lines, and the colours of cases without a value."""
    low, high = axis.get_ylim()
    handles: list[Artist] = [
        line
        for line in axis.lines
        if not str(line.get_label()).startswith("_")
        and np.any((np.asarray(line.get_ydata()) > low) & (np.asarray(line.get_ydata()) < high))
    ]
    handles += absent
    if handles:
        figure.legend(
            handles=handles,
            loc="outside upper center",
            ncols=min(2, len(handles)),
            handlelength=1.8,
            columnspacing=1.0,
        )
