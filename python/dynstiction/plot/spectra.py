"""Elongation rates or slip velocities, and their spectrograms (Fig. 4)."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D

from ..errors import UsageError
from ..result import Result
from ..spectrum import Spectrogram, oscillation_frequency, spectrogram
from ..stick_slip import first_release
from .notation import COLUMNS, Floats
from .style import note, panels
from .theory import creep, slider, stiff_frequency
from .time_series import VELOCITIES, draw_column, show_time
from .view import View

RATES = ("u_x_rate", "u_y_rate")

PERIODS = 20.0
"""Length of the Hamming window in periods of the stiff axis: a spectral line is then about a tenth of its frequency wide."""
SHORTEST = 8.0
"""The same if stick-slip is so fast that `PERIODS` would hide it."""
OF_CYCLE = 0.25
"""Share of a stick-slip cycle that the window should not exceed."""
FEWEST, OF_SHORT_SPAN = 2.0, 0.5
"""Window of a run that is shorter than `PERIODS`: number of periods, and share of the part that is shown."""
OF_SPAN = 0.1
"""Window without a stiff axis, as a share of the part that is shown."""
DECIBELS = 70.0
HIGHEST_FREQUENCY = 2.5
"""Upper end of the frequency axis over the frequency of the stiff axis."""
ROUNDING = 0.01
"""Factor by which the samples may miss the top of the axis, because an interval is a round number."""
FOLDING = 10.0
"""Number of samples in a period of the stiff axis below which overtones fold back into the figure."""


def draw_spectrogram(view: View, figure: FigureBase, *, length: float | None = None) -> None:
    """Both elongation rates, their spectrograms and the predicted ridge of the first creep (Fig. 4).

    A file without the rates shows the slip velocities, which are the drive's velocity minus the rates. The length of the sliding
    window [s] follows from the scene if it is not given.
    """
    names = RATES if all(name in view.whole for name in RATES) else VELOCITIES
    stiff = stiff_frequency(view.whole)
    folds = _folds(view.result, stiff)
    length, shown = length or _length(view, stiff), view.result
    spectra = {name: spectrogram(shown.time, 1e3 * shown[name], length) for name in names}
    # The slips, which are visible only along the soft axis, may exceed the scale.
    soft, stiff_axis = (float(spectra[name].density.max()) for name in names)
    top = stiff_axis or soft or 1.0
    axes = panels(figure, 4, 165.0, sharex=True, height_ratios=(2.5, 3.0, 2.5, 3.0))
    highest = HIGHEST_FREQUENCY * (stiff or np.inf)
    # Wide gaps, so that the ridge below is visible.
    style: Any = {"color": "white", "linewidth": 0.9, "linestyle": (0, (4, 6))}
    ridges: list[Line2D] = []
    for i, name in enumerate(names):
        trace, density = axes[2 * i : 2 * i + 2]
        draw_column(trace, name, shown, margin=0.05, scale=[shown[each] for each in names])
        image = _draw_density(density, spectra[name], 10.0 * np.log10(top), highest, length)
        # The prediction needs more data than the spectrogram, which is useful without it.
        with suppress(UsageError):
            times, frequency = predicted_ridge(view.whole)
            ridges += density.plot(times, 1e-3 * frequency, label="predicted in slow creep", **style)
        density.set_ylabel(f"$f$ of {COLUMNS[name].text} [kHz]")
    show_time(axes[-1], shown)
    label = "power density [dB re 1 (mm/s)$^2$/Hz]"
    beyond = ["slips exceed the scale of colours"] if soft > top else []
    figure.colorbar(image, ax=axes, location="top", aspect=40, pad=0.01, extend="both", label=label)
    note(axes[0], (*view.notes, f"Hamming window of {1e3 * length:.3g} ms", *beyond, *folds))
    if ridges:
        # The legend is outside the spectrogram, in which there are lines everywhere, on the dark background that the line needs.
        dark: Any = {"frameon": True, "facecolor": "0.25", "edgecolor": "none", "labelcolor": "white"}
        figure.legend(handles=ridges[:1], loc="outside lower center", handlelength=2.6, **dark)


def _length(view: View, stiff: float | None) -> float:
    """Length of the window [s]: several periods of the stiff axis, fewer if the cycles are short."""
    span = float(view.result.time[-1] - view.result.time[0])
    if stiff is None:
        return OF_SPAN * span
    means = view.cycles.means() if view.cycles is not None else {}
    cycle = float(means.get("period", np.inf))
    usual = float(np.clip(OF_CYCLE * cycle, SHORTEST / stiff, PERIODS / stiff))
    return min(usual, max(OF_SHORT_SPAN * span, FEWEST / stiff))


def predicted_ridge(result: Result) -> tuple[Floats, Floats]:
    """Times [s] of the first creep and the frequency [Hz] that `creep_exact` predicts for them, if it applies to the run."""
    system = slider(result)
    times = np.linspace(0.0, result.time[first_release(result["spring_force_x"])], 500)
    stiffness = {name: system[name] for name in ("mass", "stiffness_x", "stiffness_y")}
    return times, oscillation_frequency(creep(result, times).theta, **stiffness)


def _draw_density(axis: Axes, spectrum: Spectrogram, top: float, highest: float, length: float) -> AxesImage:
    """Density in decibels below `top`, up to the frequency `highest` [Hz]."""
    shown = spectrum.frequency <= highest
    frequency = 1e-3 * spectrum.frequency[shown]
    decibels = 10.0 * np.log10(np.maximum(spectrum.density[shown], np.finfo(np.float64).tiny))
    style: Any = {"cmap": "viridis", "origin": "lower", "aspect": "auto", "interpolation": "nearest"}
    extent = (*_edges(spectrum.time, length), *_edges(frequency, length))
    image = axis.imshow(decibels, vmin=top - DECIBELS, vmax=top, extent=extent, **style)
    axis.set_facecolor("0.9")
    axis.set_ylim(0.0, frequency[-1])
    return image


def _edges(middles: Floats, length: float) -> tuple[float, float]:
    """First and last edge of equal cells with these middles."""
    half = 0.5 * (middles[1] - middles[0]) if middles.size > 1 else 0.5 * length
    return float(middles[0] - half), float(middles[-1] + half)


def _folds(result: Result, stiff: float | None) -> list[str]:
    """A note that overtones above half the sampling rate appear as rising lines; samples that miss a frequency of the axis itself,
    which would fold back into the figure, are refused.
    """
    step = float(np.median(np.diff(result.time)))
    if stiff is not None and step * stiff * HIGHEST_FREQUENCY > 0.5 * (1.0 + ROUNDING):
        raise UsageError(
            f"samples {step:.6g} s apart cannot show the oscillation of {stiff:.6g} Hz and its overtones up to "
            f"{HIGHEST_FREQUENCY * stiff:.4g} Hz: run again with output.interval = {0.05 / stiff:.1g}"
        )
    is_fine = stiff is None or step * stiff * FOLDING < 1.0
    return [] if is_fine else [f"overtones above {0.5e-3 / step:.3g} kHz fold back: rising lines"]
