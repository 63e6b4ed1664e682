"""Spectrograms of slip velocities, and the frequency that they show in slow creep (Nakano & Popov 2020, Fig. 4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .creep import creep_exact
from .errors import UsageError

__all__ = ["Spectrogram", "creep_frequency", "oscillation_frequency", "ridge", "spectrogram"]

_Floats = NDArray[np.float64]

# Zeros are added to this multiple of the window: the peak then lies within three close points.
PADDING = 2
# How far the spacing of samples may be from uniform.
SPACING_TOLERANCE = 1e-6


class Spectrogram(NamedTuple):
    """Power of a signal by time and frequency."""

    time: _Floats
    """Middles of the windows [s], shape (n_t,)."""
    frequency: _Floats
    """Frequencies [Hz] from 0 to the Nyquist frequency, shape (n_f,)."""
    density: _Floats
    """One-sided power spectral density [unit of the signal squared / Hz], shape (n_f, n_t)."""


def spectrogram(time: ArrayLike, values: ArrayLike, window: float = 0.1, count: int = 400) -> Spectrogram:
    """Power spectral density in a Hamming window that slides over the signal; the mean of each window is taken out.

    Parameters
    ----------
    time : array_like, shape (n,)
        Times of the samples [s], uniform. The last one may be nearer than the others (the end of a run) and is then
        left out.
    values : array_like, shape (n,)
        The signal.
    window : float
        Length of the window [s].
    count : int
        About how many windows; fewer if they would be less than a sample apart.

    Returns
    -------
    Spectrogram
        Only windows that lie within the signal.

    Raises
    ------
    UsageError
        If the samples are not uniform, not finite, too few for the window, or the window holds fewer than 8 of them.
    """
    from scipy.signal import ShortTimeFFT  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    times, signal = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if times.ndim != 1 or times.shape != signal.shape:
        raise UsageError(f"time and values of shapes {times.shape} and {signal.shape}: both must be (n,)")
    if not (np.all(np.isfinite(signal)) and np.all(np.isfinite(times))):
        raise UsageError("a value is not finite: leave such samples out")
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
    hop = max(1, (n - length) // max(count, 1))
    transform = ShortTimeFFT(
        np.hamming(length), hop, fs=1.0 / step, fft_mode="onesided2X", mfft=PADDING * length, scale_to="psd"
    )
    first, last = transform.lower_border_end[1], transform.upper_border_begin(n)[1]
    density = transform.spectrogram(signal[:n], detr="constant", p0=first, p1=last)
    middles = times[0] + transform.delta_t * np.arange(first, last)
    return Spectrogram(middles, transform.f, density)


def ridge(spectrum: Spectrogram, above: float = 0.0) -> _Floats:
    """Frequency of the highest peak at each time, between the points by a parabola through the logarithms.

    Parameters
    ----------
    spectrum : Spectrogram
        As `spectrogram` returns it.
    above : float
        Lower frequencies [Hz] are passed over; with 4/window or more those of a slow drift.

    Returns
    -------
    ndarray, shape (n_t,)
        Frequency [Hz]; NaN where there is no power.
    """
    frequency, density = spectrum.frequency, spectrum.density
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
    """
    angle = np.asarray(theta, dtype=np.float64)
    stiffness = np.asarray(stiffness_y) * np.sin(angle) ** 2 + np.asarray(stiffness_x) * np.cos(angle) ** 2
    return np.asarray(np.sqrt(stiffness / np.asarray(mass)) / (2.0 * np.pi), dtype=np.float64)


def creep_frequency(
    t: ArrayLike,
    *,
    mass: ArrayLike,
    velocity: ArrayLike,
    misalignment: ArrayLike,
    stiffness_x: ArrayLike,
    stiffness_y: ArrayLike,
    mu_0: ArrayLike,
    normal_load: ArrayLike,
) -> _Floats:
    """Frequency of the fast oscillation in slow creep: `oscillation_frequency` at the angle of `creep_exact`.

    For small misalignment ``sqrt(k_y/m) sqrt(1 - tau^2)/(2 pi)`` with ``tau = V t k_x/(mu_0 W)``.

    Parameters
    ----------
    t : array_like
        Time [s] since the spring was relaxed, at least 0.
    mass, velocity, misalignment, stiffness_x, stiffness_y, mu_0, normal_load : array_like
        m [kg], V [m/s] > 0, phi [rad], k_x < k_y [N/m], friction coefficient, W [N].

    Returns
    -------
    ndarray, float64
        Frequency [Hz] in the broadcast shape.

    Raises
    ------
    UsageError
        If an argument is out of the range of `creep_exact`.
    """
    soft, stiff = np.asarray(stiffness_x, dtype=np.float64), np.asarray(stiffness_y, dtype=np.float64)
    friction = np.asarray(mu_0, dtype=np.float64) * np.asarray(normal_load, dtype=np.float64)
    tau = np.asarray(t, dtype=np.float64) * np.asarray(velocity, dtype=np.float64) * soft / friction
    theta = creep_exact(tau, misalignment, soft / stiff).theta
    return oscillation_frequency(theta, mass=mass, stiffness_x=soft, stiffness_y=stiff)


def _uniform(times: _Floats) -> tuple[float, int]:
    """Spacing [s], and how many samples keep it."""
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
