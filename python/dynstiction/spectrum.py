"""Spectrograms of slip velocities, and the frequency of the oscillation in slow creep (Nakano & Popov 2020, Fig. 4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arguments import finite, instance, number, reals, shape_of
from .errors import UsageError

_Floats = NDArray[np.float64]

WINDOWS = 400
"""Approximate number of windows; fewer if they would be less than a sample apart."""
PADDING = 2
"""Windows are filled with zeros to this multiple of their length, so that the peak is within three close points."""
SPACING_TOLERANCE = 1e-6
"""How far the spacing of samples may be from uniform."""


class Spectrogram(NamedTuple):
    """Power density of a signal over time and frequency."""

    time: _Floats
    """Middles of the windows [s], shape (n_t,)."""
    frequency: _Floats
    """Frequencies [Hz] from 0 to the Nyquist frequency, shape (n_f,)."""
    density: _Floats
    """One-sided power spectral density [unit of the signal squared / Hz], shape (n_f, n_t)."""


def spectrogram(time: ArrayLike, values: ArrayLike, window: float = 0.1) -> Spectrogram:
    """Power spectral density in a Hamming window that slides over the signal; the mean of each window is subtracted.

    Parameters
    ----------
    time : array_like, shape (n,)
        Times of the samples [s], uniform. The last interval may be shorter (at the end of a run); the last sample is then
        left out.
    values : array_like, shape (n,)
        The signal.
    window : float
        Length of the window [s].

    Returns
    -------
    Spectrogram
        The spectrogram, with windows that are within the signal.

    Raises
    ------
    UsageError
        If the samples are not uniform, not finite or too few for the window, if the window holds fewer than 8 of them, or if
        the density is beyond the range of double precision.
    """
    from scipy import signal  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    times, samples = reals("time", time, checked=False), reals("values", values, checked=False)
    window = number("window", window, checked=False)
    if times.ndim != 1 or times.shape != samples.shape:
        raise UsageError(f"time and values of shapes {times.shape} and {samples.shape}: both must be (n,)")
    if not (np.all(np.isfinite(samples)) and np.all(np.isfinite(times))):
        raise UsageError("a value is not finite: leave such samples out")
    with np.errstate(all="ignore"):
        step, n = _uniform(times)
    if not (0.0 < window <= (n - 1) * step * (1.0 + SPACING_TOLERANCE)):
        raise UsageError(
            f"the samples span {(n - 1) * step:.6g} s: a window of {window:g} s needs a longer run"
        )
    length = round(window / step)
    if length < 8:
        raise UsageError(
            f"samples {step:.6g} s apart are too few for a window of {window:g} s: "
            f"run again with output.interval = {window / 100:.1g} or less"
        )
    hop = max(1, (n - length) // WINDOWS)
    # The middles of the windows are multiples of the hop, from the first window that is within the signal.
    half = length // 2
    first = -(-half // hop)
    how = {"window": np.hamming(length), "noverlap": length - hop, "nfft": PADDING * length}
    with np.errstate(all="ignore"):
        frequency, _, density = signal.spectrogram(samples[hop * first - half : n], 1.0 / step, **how)
    middles = times[0] + step * hop * (first + np.arange(density.shape[1]))
    return Spectrogram(middles, finite("the frequency", frequency), finite("the density", density))


def ridge(spectrum: Spectrogram, above: float = 0.0) -> _Floats:
    """Frequency of the highest peak at each time, interpolated by a parabola through the logarithms.

    Parameters
    ----------
    spectrum : Spectrogram
        As `spectrogram` returns it.
    above : float
        Lower frequencies [Hz] are ignored; a value of 4/window or more excludes a slow drift.

    Returns
    -------
    ndarray, shape (n_t,)
        Frequency [Hz]; NaN where there is no power.

    Raises
    ------
    UsageError
        If `spectrum` is not a spectrogram, or `above` is beyond its end.
    """
    spectrum = instance("spectrum", spectrum, Spectrogram, "give what spectrogram returns")
    frequency, density = reals("frequency", spectrum.frequency), reals("density", spectrum.density, least=0.0)
    if density.ndim != 2 or frequency.shape != density.shape[:1] or frequency.size < 3:
        raise UsageError(
            f"frequency and density of shapes {frequency.shape} and {density.shape}: (n_f,) and (n_f, n_t), n_f > 2"
        )
    above = number("above", above, units="Hz")
    first = int(np.searchsorted(frequency, above))
    if first >= frequency.size:
        raise UsageError(f"above = {above:g} Hz: the spectrogram ends at {frequency[-1]:g} Hz")
    columns = np.arange(density.shape[1])
    peak = first + np.argmax(density[first:], axis=0)
    inner = np.clip(peak, 1, frequency.size - 2)
    tiny = np.finfo(np.float64).tiny
    left, middle, right = (np.log(np.maximum(density[inner + i, columns], tiny)) for i in (-1, 0, 1))
    curvature = left - 2.0 * middle + right
    is_peak = (inner == peak) & (curvature < 0.0)
    shift = np.where(is_peak, 0.5 * (left - right) / np.where(is_peak, curvature, 1.0), 0.0)
    found = frequency[peak] + (frequency[1] - frequency[0]) * np.clip(shift, -0.5, 0.5)
    return np.where(density[peak, columns] > 0.0, found, np.nan)


def oscillation_frequency(
    theta: ArrayLike, *, mass: ArrayLike, stiffness_x: ArrayLike, stiffness_y: ArrayLike
) -> _Floats:
    """Frequency of the fast oscillation along a slip direction, ``sqrt((k_y sin^2 theta + k_x cos^2 theta)/m)/(2 pi)``.

    Parameters
    ----------
    theta : array_like
        Angle [rad] from the soft axis to the slip.
    mass : array_like
        m [kg].
    stiffness_x, stiffness_y : array_like
        k_x, k_y [N/m].

    Returns
    -------
    ndarray, float64
        Frequency [Hz] in the broadcast shape.

    Raises
    ------
    UsageError
        If an argument is not finite, the mass or a stiffness is not positive, or the arguments do not broadcast.
    """
    angle = reals("theta", theta, units="rad")
    inertia = reals("mass", mass, above=0.0, units="kg")
    soft = reals("stiffness_x", stiffness_x, above=0.0, units="N/m")
    stiff = reals("stiffness_y", stiffness_y, above=0.0, units="N/m")
    shape_of(theta=angle, mass=inertia, stiffness_x=soft, stiffness_y=stiff)
    # The root of a sum of squares, computed so that no square leaves the range of the numbers.
    root = np.hypot(np.sqrt(stiff) * np.sin(angle), np.sqrt(soft) * np.cos(angle))
    with np.errstate(over="ignore"):
        return np.asarray(finite("the frequency", root / np.sqrt(inertia) / (2.0 * np.pi)))


def _uniform(times: _Floats) -> tuple[float, int]:
    """Spacing [s], and the number of samples with this spacing."""
    steps = np.diff(times)
    if steps.size == 0:
        raise UsageError("a spectrogram needs more than one sample: lower output.interval and run again")
    step = float(np.median(steps))
    uneven = np.abs(steps - step) > SPACING_TOLERANCE * abs(step)
    if not step > 0.0 or np.any(uneven[:-1]):
        raise UsageError(
            "the samples are not uniform in time: run again with output.interval > 0, or interpolate them"
        )
    return step, times.size - 1 if uneven[-1] else times.size
