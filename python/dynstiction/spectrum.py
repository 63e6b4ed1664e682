"""Spectrograms of slip velocities, and the frequency of the oscillation in slow creep (Nakano & Popov 2020, Fig. 4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from ._arguments import finite, instance, number, reals, shape_of
from .creep import creep_exact, dimensionless
from .errors import UsageError

__all__ = ["Spectrogram", "creep_frequency", "oscillation_frequency", "ridge", "spectrogram"]

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
    times, signal = reals("time", time, checked=False), reals("values", values, checked=False)
    window = number("window", window, checked=False)
    if times.ndim != 1 or times.shape != signal.shape:
        raise UsageError(f"time and values of shapes {times.shape} and {signal.shape}: both must be (n,)")
    if not (np.all(np.isfinite(signal)) and np.all(np.isfinite(times))):
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
    # The middles of the windows are multiples of the hop, from the first to the last that is within the signal.
    half = length // 2
    first, last = -(-half // hop), (n - length + half) // hop + 1
    begins = hop * np.arange(first, last) - half
    padded = PADDING * length
    windows, weights = sliding_window_view(signal, length)[begins], np.hamming(length)
    with np.errstate(all="ignore"):
        spectra = np.fft.rfft((windows - windows.mean(axis=1, keepdims=True)) * weights, padded)
        density = step / np.sum(weights**2) * np.abs(spectra.T) ** 2
        # Twice, for both signs of the frequency, except for 0 and the Nyquist frequency.
        density[1:-1] *= 2.0
        frequency = np.fft.rfftfreq(padded, step)
    middles = times[0] + step * hop * np.arange(first, last)
    return Spectrogram(
        middles,
        finite("the frequency", np.asarray(frequency, dtype=np.float64)),
        finite("the density", np.ascontiguousarray(density)),
    )


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


def creep_frequency(
    t: ArrayLike,
    *,
    mass: ArrayLike,
    velocity: ArrayLike,
    misalignment_deg: ArrayLike,
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
    mass, velocity, misalignment_deg, stiffness_x, stiffness_y, mu_0, normal_load : array_like
        m [kg], V [m/s] > 0, phi [deg], k_x < k_y [N/m], friction coefficient, W [N].

    Returns
    -------
    ndarray, float64
        Frequency [Hz] in the broadcast shape.

    Raises
    ------
    UsageError
        If an argument is out of the range of `creep_velocity`, or the mass is not positive.
    """
    scaled = dimensionless(
        t,
        velocity=velocity,
        misalignment_deg=misalignment_deg,
        stiffness_x=stiffness_x,
        stiffness_y=reals("stiffness_y", stiffness_y, above=0.0, units="N/m"),
        mu_0=mu_0,
        normal_load=normal_load,
    )
    theta = creep_exact(*scaled).theta
    return oscillation_frequency(theta, mass=mass, stiffness_x=stiffness_x, stiffness_y=stiffness_y)


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
