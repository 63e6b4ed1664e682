"""Slip velocities and their spectrograms (Fig. 4)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from ..errors import UsageError
from ..result import Result
from ..spectrum import Spectrogram, oscillation_frequency, spectrogram
from ..stick_slip import first_release
from .samples import Floats, columns
from .style import panels
from .theory import creep, slider, stiff_frequency
from .time_series import VELOCITIES, draw_column, show_time

__all__ = ["draw_spectrogram", "predicted_ridge"]

WINDOW = 0.1
"""Length of the Hamming window [s], the paper's."""
DECIBELS = 70.0
HIGHEST_FREQUENCY = 2.5
"""Upper end of the frequency axis over the frequency of the stiff axis."""


def draw_spectrogram(result: Result, figure: Figure) -> None:
    """Both slip velocities, their spectrograms and the predicted ridge of the first creep (Fig. 4)."""
    needed = columns(result, *VELOCITIES)
    _refuse_aliases(result)
    spectra = {name: spectrogram(result.time, 1e3 * values, WINDOW) for name, values in needed.items()}
    # The slips, which only w_x shows, may exceed the scale.
    top = float(spectra["w_y"].density.max()) or float(spectra["w_x"].density.max()) or 1.0
    axes = panels(figure, 4, 140.0, sharex=True, height_ratios=(2.0, 3.0, 2.0, 3.0))
    highest = HIGHEST_FREQUENCY * (stiff_frequency(result) or np.inf)
    for i, name in enumerate(VELOCITIES):
        draw_column(axes[2 * i], result, name, 0.05)
        image = _draw_density(axes[2 * i + 1], spectra[name], 10.0 * np.log10(top), highest)
        _draw_ridge(axes[2 * i + 1], result)
        axes[2 * i + 1].set_ylabel(f"$f$ of ${name}$ [kHz]")
    show_time(axes[-1], result)
    label = "power density [dB re 1 (mm/s)$^2$/Hz]"
    figure.colorbar(image, ax=axes, location="top", aspect=40, pad=0.01, extend="both", label=label)


def predicted_ridge(result: Result) -> tuple[Floats, Floats]:
    """Times [s] of the first creep and the frequency [Hz] that `creep_exact` predicts for them, if it applies to the run."""
    system = slider(result)
    end = result.time[first_release(columns(result, "spring_force_x")["spring_force_x"])]
    times = np.linspace(0.0, end, 500)
    theta = creep(result, times).theta
    stiffness = {name: system[name] for name in ("mass", "stiffness_x", "stiffness_y")}
    return times, oscillation_frequency(theta, **stiffness)


def _draw_density(axis: Axes, spectrum: Spectrogram, top: float, highest: float) -> AxesImage:
    """Density in decibels below `top`, up to the frequency `highest` [Hz]."""
    shown = spectrum.frequency <= highest
    frequency = 1e-3 * spectrum.frequency[shown]
    decibels = 10.0 * np.log10(np.maximum(spectrum.density[shown], np.finfo(np.float64).tiny))
    image = axis.imshow(
        decibels,
        cmap="viridis",
        vmin=top - DECIBELS,
        vmax=top,
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        extent=(*_edges(spectrum.time), *_edges(frequency)),
    )
    axis.set_facecolor("0.9")
    axis.set_ylim(0.0, frequency[-1])
    return image


def _edges(middles: Floats) -> tuple[float, float]:
    """First and last edge of equal cells with these middles."""
    half = 0.5 * (middles[1] - middles[0]) if middles.size > 1 else 0.5 * WINDOW
    return float(middles[0] - half), float(middles[-1] + half)


def _draw_ridge(axis: Axes, result: Result) -> None:
    try:
        times, frequency = predicted_ridge(result)
    except UsageError:
        return  # the figure is good without the prediction, which needs more than the spectrogram does
    # Wide gaps: the ridge below must be seen.
    axis.plot(times, 1e-3 * frequency, color="white", linewidth=0.9, linestyle=(0, (4, 6)), label="predicted")
    # Framed: a whole history has lines everywhere.
    framed: Any = {"frameon": True, "facecolor": "black", "edgecolor": "none"}
    axis.legend(loc="upper left", labelcolor="white", handlelength=2.6, **framed)


def _refuse_aliases(result: Result) -> None:
    stiff = stiff_frequency(result)
    step = float(np.median(np.diff(result.time)))
    if stiff is not None and step * stiff > 0.5:
        raise UsageError(
            f"samples {step:.6g} s apart cannot show the oscillation of {stiff:.6g} Hz: "
            f"run again with output.interval = {0.05 / stiff:.1g}"
        )
