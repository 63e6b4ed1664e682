"""A measured trace: the mean waveforms of it and of a run; a fit with its residuals, each cycle by itself, and its parameters two by
two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from .._fit.models import steady_velocity
from .._fit.problem import unit_of
from ..errors import Error, UsageError
from ..record import headed
from .notation import Floats
from .style import BLACK, BLUE, VERMILION, legend_above, new_figure, panels, sized

if TYPE_CHECKING:
    from ..trace_comparison import TraceComparison
    from ..trace_fit import Fit, FittedTrace


ERRORS = 2.0
"""Half width of the band of a mean waveform in standard errors."""
LIMIT = 4.0
"""Colours show residuals of a cycle up to so many of its errors."""
BINS = 12
"""Bins of a distribution over the cycles."""
SIGMAS = (1.0, 2.0)
"""Sizes of the ellipses, in standard errors."""
SPAN = 3.2
"""Half width of the range of a parameter, in its largest standard error."""
SIDE = 24.0
"""Width of a panel of two parameters [mm]."""

FIRST = 4
"""Number of cycles that are shown over time if no times are given."""
FORCE = "force along the pull [N]"
AROUND = 2.5
"""Time that is shown before and after the middle of the slip, in durations of the fall."""
DOTS: Any = {"marker": ".", "linestyle": "", "color": BLUE, "markersize": 2.5}


def draw_trace_comparison(comparison: TraceComparison, figure: Figure) -> None:
    """Mean force over a cycle and around the slip, and the difference of trace and run in standard errors."""
    axes = panels(figure, 3, 140.0, height_ratios=(3.0, 3.0, 2.4))
    measured, simulated = (rows.mean(axis=0) for rows in comparison.waveforms)
    errors = np.hypot(*(rows.std(axis=0, ddof=1) / np.sqrt(len(rows)) for rows in comparison.waveforms))
    words = [
        f"{side}, {len(rows)} cycles"
        for side, rows in zip(("measured", "simulated"), comparison.waveforms, strict=True)
    ]
    fall = 2.0 * float(np.mean(comparison.measured.slips - comparison.measured.onsets))
    _draw_cycle(axes[:2], comparison.edges, fall, {words[0]: measured}, {words[1]: simulated})
    _draw_residuals(axes[2], (simulated - measured) / errors, "difference/error")
    legend_above(figure, axes[0].get_lines())


def _draw_cycle(
    axes: NDArray[Any], edges: Floats, fall: float, dots: Mapping[str, Floats], lines: Mapping[str, Floats]
) -> None:
    """Mean forces in the bins of a cycle: all of it, and around the slip."""
    time = 0.5 * (edges[1:] + edges[:-1])
    near = AROUND * fall
    ends = (edges[0], edges[-1]), (max(-near, edges[0]), min(near, edges[-1]))
    for axis, (low, high), scale, unit in zip(axes, ends, (1.0, 1e3), ("s", "ms"), strict=True):
        for forces, how in ((dots, DOTS), (lines, {"color": VERMILION})):
            for label, force in forces.items():
                axis.plot(scale * time, force, label=label, **how)
        axis.set(ylabel="force [N]", xlabel=f"time from the slip [{unit}]", xlim=(scale * low, scale * high))


def _draw_residuals(axis: Axes, off: Floats, name: str) -> None:
    axis.plot(np.arange(off.size), off, **DOTS)
    axis.set(xlim=(0, off.size), xlabel="bin, in the order of time")
    _about_zero(axis, name)


def check_fit_kind(kind: str) -> None:
    """Refuse what is no kind of figure of a fit."""
    if kind not in FIT_KINDS:
        raise UsageError(f"kind = {kind!r}: a fit has the figures {', '.join(FIT_KINDS)}")


def fit_figure(
    fit: Fit, kind: str, trace: int = 0, start: float | None = None, end: float | None = None
) -> Figure:
    """Figure of one trace of a fit, of one of `FIT_KINDS`; `start` and `end` are of the kind ``time``."""
    check_fit_kind(kind)
    if not 0 <= trace < len(fit.traces):
        raise UsageError(f"trace = {trace}: the fit has {len(fit.traces)} traces, from 0 on")
    if kind != "time" and (start, end) != (None, None):
        raise UsageError("start and end: only the figure 'time' has them")
    more = (start, end) if kind == "time" else ()
    return new_figure(lambda figure: FIT_KINDS[kind](fit, fit.traces[trace], figure, *more))


def draw_waveform(fit: Fit, each: FittedTrace, figure: Figure) -> None:
    """Mean force over a cycle and around the slip, displacement in the creep if it was measured, residuals in standard errors."""
    wave = each.waveform
    has_way = wave.ahead.size > 0
    ratios = (3.0, 3.0, *([3.0] * has_way), 2.4)
    axes = panels(figure, len(ratios), 180.0 if has_way else 140.0, height_ratios=ratios)
    if has_way:
        time = wave.time[: each.ahead.size]
        drive = abs(steady_velocity(each.scene)) * (time - time[0]) - each.ahead[0]
        axes[2].plot(time, 1e6 * (wave.ahead.mean(axis=0) + drive), **DOTS)
        axes[2].plot(time, 1e6 * (each.ahead + drive), color=VERMILION)
        axes[2].set(xlabel="time from the slip [s]", ylabel="creep [µm]")
    words = f"measured, {len(wave.rows)} cycles", f"fitted, {fit.model}"
    _draw_cycle(axes[:2], wave.edges, wave.fall, {words[0]: wave.mean}, {words[1]: each.fitted})
    off = (wave.rows.mean(axis=0) - each.fitted_rows.mean(axis=0)) / wave.errors
    _draw_residuals(axes[-1], np.where(wave.used, off, np.nan), "residual/error")
    if has_way:
        axes[-1].set_xlabel("bin, in the order of time, force and displacement")
    legend_above(figure, axes[0].get_lines())


def draw_time(
    fit: Fit, each: FittedTrace, figure: Figure, start: float | None = None, end: float | None = None
) -> None:
    """The force and what the model makes of each cycle, and their difference; of the first cycles, or between two times [s]."""
    wave, trace = each.waveform, each.trace
    slips = wave.slips
    begin = float(slips[0] + wave.edges[0]) if start is None else start
    stop = float(slips[min(FIRST, slips.size) - 1] + wave.edges[-1]) if end is None else end
    part = trace.part(begin, stop)
    model = np.full(part.time.size, np.nan)
    n = wave.time.size
    for slip, force in zip(slips, np.broadcast_to(each.fitted_rows, wave.rows.shape)[:, :n], strict=True):
        i, j = np.searchsorted(part.time, slip + wave.edges[[0, -1]])
        model[i:j] = np.interp(part.time[i:j], slip + wave.time, force)
    above, below = panels(figure, 2, 95.0, sharex=True, height_ratios=(3.0, 2.0))
    above.plot(part.time, part.force, label="measured", **DOTS)
    above.plot(part.time, model, color=VERMILION, label=f"fitted, {fit.model}")
    above.set(ylabel=FORCE, xlim=part.time[[0, -1]])
    below.plot(part.time, part.force - model, **DOTS)
    below.set_xlabel("time [s]")
    _about_zero(below, "difference [N]", ERRORS * each.cycles.noise)
    legend_above(figure, above.get_lines())


def _about_zero(axis: Axes, name: str, level: float = ERRORS) -> None:
    """Lines at 0 and at two errors to either side."""
    for height in (-level, 0.0, level):
        axis.axhline(height, color=BLACK, linewidth=0.4, linestyle="-" if height == 0.0 else ":")
    axis.set_ylabel(name)


def draw_cycles(_: Fit, each: FittedTrace, figure: Figure) -> None:
    """Residuals of every cycle, and how periods and peaks of the cycles are distributed, in the trace and in a run."""
    wave = each.waveform
    image, *below = panels(figure, 3, 130.0, height_ratios=(3.0, 1.4, 1.4))
    n = wave.time.size
    off = (wave.rows - each.fitted_rows) / (wave.errors * np.sqrt(len(wave.rows)))
    off = np.where(wave.used, off, np.nan)[:, :n]
    number = np.arange(len(off) + 1) + 0.5
    mesh = image.pcolormesh(
        np.arange(n + 1), number, off, cmap="RdBu_r", vmin=-LIMIT, vmax=LIMIT, rasterized=True
    )
    image.set(xlabel="bin, in the order of time (dotted: slip; white: not used)", ylabel="cycle")
    image.axvline(float(np.searchsorted(wave.edges, 0.0)), color=BLACK, linewidth=0.5, linestyle=":")
    image.yaxis.get_major_locator().set_params(integer=True)
    image.figure.colorbar(mesh, ax=image, label="residual / error", extend="both")
    sides = {"measured": (each.cycles, BLUE)}
    # Without stick-slip of a run there is the trace alone.
    with suppress(Error):
        sides["simulated"] = (each.comparison.simulated, VERMILION)
    for axis, column in zip(below, ("period", "peak_force"), strict=True):
        values = [cycles[column] for cycles, _ in sides.values()]
        bins = np.histogram_bin_edges(np.concatenate(values), BINS)
        for name, (cycles, colour) in sides.items():
            how: Any = {"color": colour, "label": f"{name}, {len(cycles)} cycles"}
            axis.hist(cycles[column], bins, weights=np.full(len(cycles), 1.0 / len(cycles)), alpha=0.5, **how)
        info = each.cycles.columns
        axis.locator_params("x", nbins=5)
        axis.set(xlabel=headed(column.replace("_", " "), info.units[column]), ylabel="share")
    legend_above(figure, below[0].get_legend_handles_labels()[0])


def draw_corner(fit: Fit, _: FittedTrace, figure: Figure) -> None:
    """The parameters two by two: ellipses of one and two standard errors, and of the other values that explain the traces."""
    names = list(fit.parameters)
    p = len(names)
    sized(figure, SIDE * max(p, 2), SIDE * max(p, 2))
    axes = figure.subplots(p, p, squeeze=False)
    scales = np.array([each.value if each.told else np.nan for each in fit.parameters.values()])
    errors = np.array([each.error for each in fit.parameters.values()])
    relative = fit.sets[0][1]
    places = [(values - fit.sets[0][0], spread) for values, spread in fit.sets]
    size = np.max([np.abs(at) + spread for at, spread in places], axis=0) / relative
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = np.array([np.cos(turn), np.sin(turn)])
    for i in range(p):
        for j in range(p):
            axis = axes[i, j]
            if j > i:
                axis.set_axis_off()
                continue
            axis.set_xlim(
                scales[j] + SPAN * size[j] * errors[j] * np.array([-1.0, 1.0])
                if np.isfinite(scales[j])
                else None
            )
            axis.tick_params("y", labelleft=j == 0 and i > 0)
            axis.tick_params("x", labelbottom=i == p - 1, labelrotation=45.0)
            axis.locator_params(nbins=3)
            if i == p - 1:
                axis.set_xlabel(_short(names[j]), fontsize=7.0)
            if j == 0 and i > 0:
                axis.set_ylabel(_short(names[i]), fontsize=7.0)
            if not np.isfinite(scales[[i, j]]).all():
                _without_scale(axis, scales[[j, i]], i == j)
                continue
            for k, (at, spread) in enumerate(places):
                # Logarithms change as values do, over the value.
                middle = scales + at * errors / relative
                width = spread * errors / relative
                colour = BLUE if k == 0 else VERMILION
                if i == j:
                    x = middle[i] + width[i] * np.linspace(-SPAN, SPAN, 100)
                    axis.plot(x, np.exp(-0.5 * ((x - middle[i]) / width[i]) ** 2) / width[i], color=colour)
                    axis.set_yticks([])
                    continue
                part = np.array([[1.0, fit.correlation[i, j]], [fit.correlation[i, j], 1.0]])
                root = np.linalg.cholesky(part + 1e-12 * np.eye(2))
                for sigma in SIGMAS:
                    way = sigma * root @ circle
                    axis.plot(middle[j] + width[j] * way[1], middle[i] + width[i] * way[0], color=colour)
    if len(places) > 1:
        told = {"best values": BLUE, "others that explain the traces": VERMILION}
        handles = [Line2D([], [], color=colour, label=name) for name, colour in told.items()]
        legend_above(figure, handles, 1)
    figure.align_labels(axes[p - 1])


def _without_scale(axis: Axes, scales: Floats, is_diagonal: bool) -> None:
    """What the traces do not determine has no ticks."""
    for ticks, scale in zip((axis.xaxis, axis.yaxis), scales, strict=True):
        if not np.isfinite(scale):
            ticks.set_ticks([])
    if is_diagonal:
        axis.text(
            0.5, 0.5, "not\ndetermined", ha="center", va="center", fontsize=7.0, transform=axis.transAxes
        )


def _short(name: str) -> str:
    """The key of a parameter with its unit."""
    unit = unit_of(name)
    return name.partition(".")[2] + (f"\n[{unit}]" if unit not in ("", "1") else "")


FIT_KINDS: dict[str, Callable[..., None]] = {
    "waveform": draw_waveform,
    "time": draw_time,
    "cycles": draw_cycles,
    "corner": draw_corner,
}
"""The figures of a fit, of one of its traces; the last is of all together."""
