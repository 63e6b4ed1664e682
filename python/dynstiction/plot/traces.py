"""A measured trace: the mean waveforms of it and of a run; a fit with its residuals, each cycle by itself, and its parameters two by
two.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._fit.problem import explained_by_each, unit_of
from ..errors import UsageError
from .notation import Floats, prefixed
from .style import BLACK, BLUE, VERMILION, new_figure, panels, sized

if TYPE_CHECKING:
    from ..trace_comparison import TraceComparison
    from ..trace_fit import Fit

__all__ = [
    "FIT_KINDS",
    "check_fit_kind",
    "draw_corner",
    "draw_cycles",
    "draw_fit",
    "draw_trace_comparison",
    "fit_figure",
]

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

AROUND = 2.5
"""Time that is shown before and after the middle of the slip, in durations of the fall."""
DOTS: Any = {"marker": ".", "linestyle": "", "color": BLUE, "markersize": 2.5}


def draw_trace_comparison(comparison: TraceComparison, figure: Figure) -> None:
    """(a) Mean force over a cycle, (b) around the slip, (c) the lateral force if the trace has one.

    Bands are two standard errors wide to either side.
    """
    longest = float(np.max(np.abs(comparison.measured_slip.phase)))
    scale, unit = prefixed("s", longest, 1.0, ("", "m", "µ"))
    around, over_cycle = f"time from the middle of the slip [{unit}]", "phase from slip to slip"
    force, lateral = "force along the pull [N]", "lateral force [N]"
    rows = [
        (1.0, over_cycle, force, (comparison.measured_waveform, comparison.simulated_waveform)),
        (scale, around, force, (comparison.measured_slip, comparison.simulated_slip)),
    ]
    if comparison.measured_lateral is not None and comparison.simulated_lateral is not None:
        rows.append((1.0, over_cycle, lateral, (comparison.measured_lateral, comparison.simulated_lateral)))
    axes = panels(figure, len(rows), 54.0 * len(rows))
    for axis, (factor, xlabel, ylabel, forms) in zip(axes, rows, strict=True):
        # Where both lines are the same, the wider one is visible beneath the other.
        for form, colour, name, width in zip(
            forms, (BLUE, VERMILION), ("measured", "simulated"), (1.6, 0.7), strict=True
        ):
            phase, band = factor * form.phase, ERRORS * np.nan_to_num(form.error)
            ends = (form.force - band, form.force + band)
            axis.fill_between(phase, *ends, color=colour, alpha=0.25, linewidth=0.0)
            label = f"{name}, {form.cycles} cycles"
            axis.plot(phase, form.force, color=colour, linewidth=width, label=label)
        axis.margins(y=0.08)
        axis.set(xlabel=xlabel, ylabel=ylabel)
        axis.set_xlim(factor * forms[0].phase[[0, -1]] if xlabel == around else (0.0, 1.0))
    figure.axes[0].legend(loc="lower right")


def check_fit_kind(kind: str) -> None:
    """Refuse what is no kind of figure of a fit."""
    if kind not in FIT_KINDS:
        raise UsageError(f"kind = {kind!r}: a fit has the figures {', '.join(FIT_KINDS)}")


def fit_figure(fit: Fit, kind: str = "waveform") -> Figure:
    """Figure of a fit, of one of `FIT_KINDS`."""
    check_fit_kind(kind)
    return new_figure(lambda figure: FIT_KINDS[kind](fit, figure))


def draw_fit(fit: Fit, figure: Figure) -> None:
    """Mean force over a cycle and around the slip, displacement in the creep if it was measured, residuals in standard errors."""
    wave = fit.waveform
    has_way = wave.ahead.size > 0
    ratios = (3.0, 3.0, *([3.0] * has_way), 2.0)
    sized(figure, 170.0 if has_way else 130.0)
    axes = figure.subplots(len(ratios), 1, height_ratios=ratios)
    cycle, slip, residual = axes[0], axes[1], axes[-1]
    if has_way:
        time = wave.time[: fit.ahead.size]
        drive = abs(float(np.ravel(fit.scene.drive.velocity or 0.0)[0])) * (time - time[0]) - fit.ahead[0]
        axes[2].plot(time, 1e6 * (wave.ahead.mean(axis=0) + drive), **DOTS)
        axes[2].plot(time, 1e6 * (fit.ahead + drive), color=VERMILION)
        axes[2].set(xlabel="time from the slip [s]", ylabel="creep along the pull [µm]")
        axes[2].margins(y=0.08)
    _draw(cycle, fit, wave.time)
    cycle.set(xlim=wave.edges[[0, -1]], xlabel="time from the slip [s]")
    cycle.legend(loc="upper left")
    _draw(slip, fit, 1e3 * wave.time)
    near = AROUND * wave.fall
    slip.set_xlim(1e3 * max(-near, wave.edges[0]), 1e3 * min(near, wave.edges[-1]))
    slip.set_xlabel("time from the slip [ms]")
    off = (wave.rows.mean(axis=0) - np.append(fit.fitted, fit.ahead)) / wave.errors
    residual.plot(np.arange(off.size), np.where(wave.used, off, np.nan), **DOTS)
    for level in (-2.0, 0.0, 2.0):
        residual.axhline(level, color=BLACK, linewidth=0.4, linestyle="-" if level == 0.0 else ":")
    order = "bin, in the order of time" + (", force and displacement" if has_way else "")
    residual.set(xlim=(0, off.size), xlabel=order, ylabel="residual / error")
    for axis, letter in zip(axes, "abcd", strict=False):
        axis.set_title(f"({letter})", loc="left", fontsize=8.0, fontweight="bold")


def _draw(axis: Axes, fit: Fit, time: Floats) -> None:
    cycles = len(fit.waveform.cycles)
    axis.plot(time, fit.waveform.mean, label=f"measured, mean of {cycles} cycles", **DOTS)
    axis.plot(time, fit.fitted, color=VERMILION, label=f"fitted, {fit.model}")
    axis.set_ylabel("force along the pull [N]")
    axis.margins(y=0.08)


def draw_cycles(fit: Fit, figure: Figure) -> None:
    """Residuals of every cycle, and how the periods and peaks of the cycles are distributed, with the values of the fit."""
    wave = fit.waveform
    image, *below = panels(figure, 3, 130.0, height_ratios=(3.0, 1.4, 1.4))
    n = wave.time.size
    weights = 1.0 / (wave.errors * np.sqrt(len(wave.cycles)))
    if wave.repeats:
        off = (wave.cycles - fit.fitted) * weights[:n]
    else:
        off = explained_by_each(wave, fit.problem.cycles(fit.coordinates, 0), weights)[:, :n]
    off = np.where(wave.used[:n], off, np.nan)
    number = np.arange(len(off) + 1) + 0.5
    mesh = image.pcolormesh(
        np.arange(n + 1), number, off, cmap="RdBu_r", vmin=-LIMIT, vmax=LIMIT, rasterized=True
    )
    image.set(xlabel="bin, in the order of time (dotted: slip; white: not used)", ylabel="cycle")
    image.axvline(float(np.searchsorted(wave.edges, 0.0)), color=BLACK, linewidth=0.5, linestyle=":")
    image.yaxis.get_major_locator().set_params(integer=True)
    image.figure.colorbar(mesh, ax=image, label="residual / error", extend="both")
    top = int(np.argmax(fit.fitted))
    for axis, values, fitted, name in (
        (below[0], fit.cycles["period"], fit.period, "period [s]"),
        (below[1], wave.cycles[:, top], float(fit.fitted[top]), "force in the highest bin of the fit [N]"),
    ):
        axis.hist(values[np.isfinite(values)], bins=BINS, color=BLUE, alpha=0.5, label="measured")
        axis.axvline(fitted, color=VERMILION, label="fitted")
        axis.set(xlabel=name, ylabel="cycles")
        axis.yaxis.get_major_locator().set_params(integer=True)
        axis.margins(y=0.3)
    below[0].legend(loc="upper left", ncols=2)


def draw_corner(fit: Fit, figure: Figure) -> None:
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
    figure.align_labels(axes[p - 1])


def _short(name: str) -> str:
    """The key of a parameter with its unit."""
    unit = unit_of(name)
    return name.partition(".")[2] + (f"\n[{unit}]" if unit not in ("", "1") else "")


FIT_KINDS = {"waveform": draw_fit, "cycles": draw_cycles, "corner": draw_corner}
"""The figures of a fit."""
