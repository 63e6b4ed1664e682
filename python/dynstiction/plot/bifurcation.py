"""Bifurcation diagram of a sweep: a quantity of every settled stick-slip cycle over the parameter, with steady sliding."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from .._native import group_of
from ..errors import UsageError
from ..stability import critical_misalignment
from .branches import put_branches
from .notation import PARAMETERS, QUANTITIES, with_unit
from .samples import Floats
from .style import BLACK, BLUE, VERMILION, sized
from .sweep_table import Axis, Table, table_of

if TYPE_CHECKING:
    import xarray

    from ..branches import Branches

__all__ = [
    "VerticalLine",
    "draw_bifurcation",
    "draw_vertical_lines",
    "mark_below",
    "slides_steadily",
    "span_of",
    "vertical_lines",
]

COLOURS = "viridis"

LOADS = ("peak_force", "valley_force")
"""Quantities that steady sliding has too."""

CONSEQUENCES = ("scene", "integrator")
"""Keys that a list may vary together with its parameter."""

LEAST_SWING = 0.01
"""Least swing of a cycle as a share of F_0, as in src/results/cycles.f90: below it the object slides steadily."""

SLIDER = ("mass", "stiffness_x", "misalignment_deg", "mu_0", "normal_load", "velocity")
"""Parameters of the stability of steady sliding; in addition mu_inf and v_f if friction weakens, k_y, and dampers."""
OPTIONAL = ("stiffness_y", "mu_inf", "v_f", "damping_x", "damping_y")

FINE = 2000
"""Number of values of the parameter at which steady sliding is computed."""

SMALL = 7.0
"""Size of the words in the diagram [pt]."""


CHARACTER = 0.019
"""Width of a small character over that of the diagram."""
LINE = 0.056
"""Height of a line of small words over that of the diagram."""


class VerticalLine(NamedTuple):
    """A value of the parameter at which the motion changes."""

    value: float
    """The value in the unit of the deck."""
    text: str
    """Text before the value."""
    colour: str = VERMILION


def vertical_lines(table: Table, side: Axis) -> list[VerticalLine]:
    """All vertical lines of a diagram over a parameter; other kinds of critical values are to be added here."""
    return list(_limits_of_steady_sliding(table, side))


def draw_bifurcation(
    data: xarray.Dataset, figure: FigureBase, quantity: str = "peak_force", branches: Branches | None = None
) -> None:
    """Draw a dot for each cycle, steady sliding as a line, broken where it is unstable, other cases as marks below, and branches."""
    table = table_of(data)
    cycles = _cycles(table, quantity)
    sides = _sides(table)
    sized(figure, 72.0)
    axis = figure.subplots()
    side = sides[0]
    shown = np.broadcast_to(_in_cases(table, side)[:, np.newaxis], cycles.shape)
    there = np.isfinite(cycles)
    how: dict[str, Any] = {
        "s": _dot(side) ** 2,
        "alpha": _opacity(there),
        "linewidths": 0.0,
        "rasterized": True,
    }
    if len(sides) == 1:
        axis.scatter(shown[there], cycles[there], color=BLACK, **how)
    else:
        colour = np.broadcast_to(_in_cases(table, sides[1])[:, np.newaxis], cycles.shape)
        norm = LogNorm() if sides[1].scale == "log" else Normalize()
        dots = axis.scatter(shown[there], cycles[there], c=colour[there], cmap=COLOURS, norm=norm, **how)
        figure.colorbar(dots, ax=axis, label=sides[1].label).solids.set_alpha(1.0)  # type: ignore[union-attr]
    axis.set(xscale=side.scale, xlabel=side.label, ylabel=_label(table, quantity))
    axis.set_xlim(*span_of(side))
    if branches is not None:
        if branches.key.rpartition(".")[2] != side.name:
            raise UsageError(f"branches over {branches.key}: the sweep varies {side.name}")
        put_branches(
            axis, branches, quantity, PARAMETERS[side.name].factor if side.name in PARAMETERS else 1.0
        )
    _draw_others(axis, table, side, quantity)
    if len(sides) == 1:
        places = draw_vertical_lines(axis, table, side)
        _draw_steady_branch(
            axis, table, side, quantity, np.stack([shown[there], cycles[there]], axis=1), places
        )


def _cycles(table: Table, quantity: str) -> Floats:
    """Values (case, cycle) of a quantity in the unit of the deck; none for cases that failed."""
    kept = [
        str(name).removeprefix("cycle_") for name in table.data.data_vars if "cycle" in table.data[name].dims
    ]
    if not kept:
        raise UsageError("the sweep keeps no cycles: run it with sweep.keep = 'cycles'")
    if quantity not in kept:
        raise UsageError(f"no quantity '{quantity}' of a cycle, only {', '.join(sorted(kept))}")
    cases = table.data["result_code"]
    values = table.data[f"cycle_{quantity}"].where(cases == 0).transpose(*cases.dims, "cycle").values
    return np.asarray(values, dtype=float).reshape(cases.size, -1)


def _sides(table: Table) -> list[Axis]:
    """The parameters of the diagram: along the axis, and a second one, if there is one, in colours."""
    sides = [side for side in table.axes if group_of(side.name) not in CONSEQUENCES] or list(table.axes[:1])
    if len(sides) > 2:
        raise UsageError(
            f"a bifurcation diagram has one or two parameters, not {len(sides)}: select some with xarray"
        )
    return sides


def _in_cases(table: Table, side: Axis) -> Floats:
    """A parameter in every case, in the unit of the figure."""
    codes = table.data["result_code"]
    values = table.data[side.name].broadcast_like(codes).transpose(*codes.dims).values
    return np.asarray(side._replace(values=values).shown, dtype=float).reshape(-1)


def _dot(side: Axis) -> float:
    """Diameter of a dot [pt], which is smaller if the parameter has more values."""
    return float(np.clip(25.0 / np.sqrt(np.unique(side.values).size), 0.8, 2.5))


def _opacity(there: NDArray[np.bool_]) -> float:
    """Opacity of a dot: repeated cycles lie on each other and become black; those of an irregular motion show their density."""
    counts = there.sum(axis=1)
    usual = np.median(counts[counts > 0]) if there.any() else 1.0
    return float(np.clip(3.0 / usual, 0.3, 1.0))


def span_of(side: Axis) -> tuple[float, float]:
    """Limits from the first value to the last, with a margin."""
    ends = np.array([np.nanmin(side.shown), np.nanmax(side.shown)])
    if not ends[1] > ends[0]:
        return float(ends[0] - 1.0), float(ends[1] + 1.0)
    if side.scale == "log":
        room = (ends[1] / ends[0]) ** 0.01
        return float(ends[0] / room), float(ends[1] * room)
    room = 0.01 * (ends[1] - ends[0])
    return float(ends[0] - room), float(ends[1] + room)


def _label(table: Table, quantity: str) -> str:
    about = table.data[f"cycle_{quantity}"].attrs
    return with_unit(QUANTITIES.get(quantity, about.get("long_name", quantity)), about["units"])


# Cases without cycles.


def _draw_others(axis: Axes, table: Table, side: Axis, quantity: str) -> None:
    """Cases without a cycle: the load at the end of those that slide steadily, and a mark below for each of the others."""
    shown = _in_cases(table, side)
    codes = table.data["result_code"].values.reshape(-1)
    without = (codes == 0) & (table.data["cycle_count"].values.reshape(-1) == 0)
    steady = without & slides_steadily(table)
    # From the bottom upwards; a row without cases takes no space.
    rows = [("failed", codes > 0, VERMILION), ("no settled cycle yet", without & ~steady, "0.5")]
    if quantity in LOADS and table.has("stiffness_x"):
        load = _final_load(table)
        axis.plot(
            shown[steady],
            load[steady],
            "o",
            color=BLUE,
            markersize=_dot(side),
            markeredgewidth=0.0,
            rasterized=True,
        )
    else:
        rows.append(("steady sliding", steady, BLUE))
    mark_below(axis, shown, rows)


def mark_below(axis: Axes, shown: Floats, rows: Sequence[tuple[str, NDArray[np.bool_], str]]) -> None:
    """Rows of marks below all dots: a word, the cases that it applies to, and a colour; a row without cases takes no space."""
    height = 0.02
    for text, chosen, colour in rows:
        if not chosen.any():
            continue
        axis.plot(
            shown[chosen], np.full(np.count_nonzero(chosen), height), "|", color=colour, markersize=3.0,
            markeredgewidth=0.5, transform=axis.get_xaxis_transform(), rasterized=True,
        )  # fmt: skip
        begin = _begin(_in_shares(axis, float(np.median(shown[chosen]))), CHARACTER * len(text), 0.01)
        axis.text(
            begin, height + 0.025, text, color=colour, fontsize=SMALL, va="bottom", transform=axis.transAxes
        )
        height += 0.09
    if height == 0.02:
        return
    # The marks are placed below all dots.
    low, high = axis.get_ylim()
    axis.set_ylim(low - (height - 0.02) / (1.02 - height) * (high - low), high)


def _in_shares(axis: Axes, value: float) -> float:
    """Position of a value of the parameter, as a share of the width of the diagram."""
    return float((axis.get_xaxis_transform() + axis.transAxes.inverted()).transform((value, 0.0))[0])


def _begin(middle: float, width: float, margin: float = 0.0) -> float:
    """Left end of words with this middle, shifted so that they are within the diagram."""
    return min(max(margin, middle - 0.5 * width), max(margin, 1.0 - margin - width))


def slides_steadily(table: Table) -> NDArray[np.bool_]:
    """Whether the load of each case hardly oscillates in the second half of the run."""
    swing = table.quantity("swing").reshape(-1)
    limit = (table.parameter("mu_0") * table.parameter("normal_load")).reshape(-1)
    return np.asarray(swing <= LEAST_SWING * limit)


def _final_load(table: Table) -> Floats:
    """k_x u_x at the end [N], positive where the drive pulls."""
    pull = table.parameter("velocity") * np.cos(np.radians(table.parameter("misalignment_deg")))
    return np.asarray(np.sign(pull) * table.parameter("stiffness_x") * table.quantity("final_u_x")).reshape(
        -1
    )


# Steady sliding.


def _slider(table: Table, side: Axis, values: Floats) -> dict[str, Floats] | None:
    """Parameters of steady sliding for these values of the parameter of the diagram; None if some are missing, V is 0,
    or the friction law is not given by coefficients.
    """
    names = [*SLIDER, *(name for name in OPTIONAL if table.has(name))]
    if not table.has_theory or not all(name in table.numbers or name == side.name for name in names):
        return None
    found = {
        name: values if name == side.name else np.full(values.shape, table.numbers[name]) for name in names
    }
    return found if found["velocity"].all() else None


def _steady_load(slider: dict[str, Floats]) -> Floats:
    """F(V) cos(phi) [N], positive where the drive pulls."""
    friction = slider["mu_0"]
    if "v_f" in slider:
        falls = np.exp(-np.abs(slider["velocity"]) / slider["v_f"])
        friction = slider["mu_inf"] + (slider["mu_0"] - slider["mu_inf"]) * falls
    return np.asarray(
        friction * slider["normal_load"] * np.abs(np.cos(np.radians(slider["misalignment_deg"])))
    )


def _is_stable(slider: dict[str, Floats]) -> NDArray[np.bool_]:
    """Whether steady sliding is stable; without a stiff axis, for a rigid one."""
    others = {name: values for name, values in slider.items() if name != "misalignment_deg"}
    is_rigid = "stiffness_y" not in others
    # The rigid limit does not depend on k_y.
    critical = critical_misalignment(
        **(others | ({"stiffness_y": 1e6 * others["stiffness_x"]} if is_rigid else {}))
    )
    # An angle and its mirror images are equivalent.
    angle = 90.0 - np.abs(90.0 - np.mod(slider["misalignment_deg"], 180.0))
    if is_rigid:
        return np.asarray(angle > critical.limit)
    with np.errstate(invalid="ignore"):
        return np.asarray((angle > critical.window[..., 0]) & (angle < critical.window[..., 1]))


def _fine(side: Axis) -> Floats:
    spaced = np.geomspace if side.scale == "log" else np.linspace
    return np.asarray(spaced(side.values.min(), side.values.max(), FINE))


def _draw_steady_branch(
    axis: Axes, table: Table, side: Axis, quantity: str, dots: Floats, lines: list[float]
) -> None:
    """Draw the load of steady sliding, solid where it is stable, and its name where it hides few of the dots (n, 2) and lines."""
    values = _fine(side)
    slider = _slider(table, side, values)
    if quantity not in LOADS or slider is None or not np.ptp(values) > 0.0:
        return
    load, stable = _steady_load(slider), _is_stable(slider)
    shown = side._replace(values=values).shown
    for chosen, style in ((stable, "-"), (~stable, (0, (4.0, 3.0)))):
        axis.plot(
            shown, np.where(chosen, load, np.nan), color=BLUE, linewidth=0.7, linestyle=style, zorder=1.5
        )
    text = "steady sliding" if stable.any() else "steady sliding, unstable"
    branch = np.stack([shown, load], axis=1)
    x, y = _quiet_place(axis, branch, dots, lines, CHARACTER * len(text))
    axis.text(x, y, text, color=BLUE, fontsize=SMALL, va="bottom", transform=axis.transAxes)


def _quiet_place(
    axis: Axes, branch: Floats, dots: Floats, lines: list[float], width: float
) -> tuple[float, float]:
    """Lower left corner of words next to a branch where they hide least, in shares of the diagram, as for the lines."""
    axis.autoscale_view()
    in_shares = axis.transData + axis.transAxes.inverted()
    branch, dots = in_shares.transform(branch), in_shares.transform(dots)
    best, least = (0.02, 0.02), np.inf
    for x in np.linspace(0.02, 0.98 - width, 25):
        near = branch[(branch[:, 0] > x - 0.01) & (branch[:, 0] < x + width + 0.01), 1]
        if near.size == 0:
            continue
        for y in (near.max() + 0.015, near.min() - LINE - 0.005):
            inside = (dots[:, 0] > x - 0.01) & (dots[:, 0] < x + width + 0.01)
            # Dots between words and branch would seem to be what the words name.
            inside &= (dots[:, 1] > min(y, near.min()) - 0.02) & (
                dots[:, 1] < max(y + LINE, near.max()) + 0.02
            )
            # Far from its line the name would not be understood.
            cost = (
                np.count_nonzero(inside)
                + 100.0 * np.ptp(near)
                + 50.0 * sum(x - 0.01 < line < x + width for line in lines)
            )
            if cost < least and y > 0.02 and y < 0.97 - LINE:
                best, least = (float(x), float(y)), cost
    return best


def _limits_of_steady_sliding(table: Table, side: Axis) -> Iterator[VerticalLine]:
    """Where steady sliding gains or loses its stability along the parameter, by bisection."""
    values = _fine(side)
    slider = _slider(table, side, values)
    if slider is None:
        return
    changes = np.flatnonzero(np.diff(_is_stable(slider)))
    low, high = values[changes], values[changes + 1]
    before = _is_stable(slider)[changes]
    for _ in range(50):
        middle = 0.5 * (low + high)
        slider = _slider(table, side, middle)
        if slider is None or changes.size == 0:
            return
        same = _is_stable(slider) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    for value, was_stable in zip(high, before, strict=True):
        yield VerticalLine(float(value), f"steady sliding stable {'below' if was_stable else 'above'}", BLUE)


def draw_vertical_lines(axis: Axes, table: Table, side: Axis) -> list[float]:
    """Draw thin lines, with names above the frame in as many rows as needed; return the positions in shares of the diagram."""
    ends: list[float] = []
    places = []
    unit = side.label.partition("[")[2].rstrip("]")
    for line in sorted(vertical_lines(table, side)):
        shown = float(side._replace(values=np.array([line.value])).shown[0])
        axis.axvline(shown, color=line.colour, linewidth=0.5, zorder=1.0)
        text = f"{line.text} {shown:.3g}" + (f" {unit}" if unit else "")
        width = CHARACTER * len(text)
        place = _in_shares(axis, shown)
        places.append(place)
        begin = _begin(place, width)
        row = next((i for i, end in enumerate(ends) if end < begin), len(ends))
        ends[row : row + 1] = [begin + width + 0.03]
        axis.text(
            begin,
            1.015 + LINE * row,
            text,
            color=line.colour,
            fontsize=SMALL,
            va="bottom",
            transform=axis.transAxes,
        )
    return places
