"""Spectrograms: their numbers on known signals, and the ridge of Fig. 4 against the closed form of creep."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from dynstiction.creep import dimensionless
from dynstiction.plot.paper import deck
from fig3 import SLIDER

FIG4 = {name: value for name, value in SLIDER.items() if name not in ("mu_inf", "v_f")}
TIMES = np.array([0.1, 0.3, 0.6, 1.0, 1.4, 1.6])
# NUMERICS: the oscillation counted by its zero crossings, without any spectrum.
SIMULATED = np.array([1000.9, 990.8, 956.2, 869.1, 720.3, 610.5])
TIME = np.arange(20001) / 1e4


def creep_frequency(t: np.ndarray, *, mass: float, **slider: float) -> np.ndarray:
    """Frequency of the fast oscillation in slow creep, at times since the spring was relaxed."""
    theta = ds.creep_exact(*dimensionless(t, **slider)).theta
    return ds.oscillation_frequency(theta, mass=mass, stiffness_x=slider["stiffness_x"], stiffness_y=slider["stiffness_y"])


def tone(frequency: float, amplitude: float = 1.0, offset: float = 0.0) -> np.ndarray:
    return offset + amplitude * np.sin(2 * np.pi * frequency * TIME)


def test_ridge_of_a_tone_and_of_a_chirp() -> None:
    for frequency in (100.0, 123.4, 1000.0, 4321.0):
        found = ds.ridge(ds.spectrogram(TIME, tone(frequency, offset=5.0)))
        np.testing.assert_allclose(found, frequency, rtol=0.0, atol=0.05)
    rate = 300.0
    spectrum = ds.spectrogram(TIME, np.sin(2 * np.pi * (500.0 * TIME + 0.5 * rate * TIME**2)))
    np.testing.assert_allclose(ds.ridge(spectrum), 500.0 + rate * spectrum.time, rtol=2e-3)


@pytest.mark.parametrize(
    ("signal", "power", "rtol"),
    [(tone(1000.0, 3.0, offset=7.0), 4.5, 1e-3), (np.where(np.arange(TIME.size) % 2, -1.0, 1.0), 1.0, 1e-9)],
    ids=["a tone on an offset", "the Nyquist frequency, without a mirror image"],
)
def test_power_is_that_of_the_signal(signal: np.ndarray, power: float, rtol: float) -> None:
    """Parseval: the density integrates to the mean square, whatever offset the signal has."""
    spectrum = ds.spectrogram(TIME, signal)
    step = spectrum.frequency[1] - spectrum.frequency[0]
    np.testing.assert_allclose(spectrum.density.sum(axis=0) * step, power, rtol=rtol)


def test_windows_lie_within_the_signal() -> None:
    spectrum = ds.spectrogram(TIME + 3.0, tone(1000.0), window=0.2)
    assert spectrum.time[0] == pytest.approx(3.1, abs=5e-3)
    assert spectrum.time[-1] == pytest.approx(4.9, abs=0.01)
    assert spectrum.density.shape == (spectrum.frequency.size, spectrum.time.size)
    assert spectrum.frequency[-1] == pytest.approx(5e3)


def test_ridge_above_a_drift_and_without_power() -> None:
    spectrum = ds.spectrogram(TIME, tone(1000.0) + 100.0 * TIME)
    np.testing.assert_allclose(ds.ridge(spectrum, above=200.0), 1000.0, atol=0.5)
    assert np.all(ds.ridge(spectrum) < 50.0)
    assert np.all(np.isnan(ds.ridge(ds.spectrogram(TIME, np.full(TIME.size, 0.5)))))


def test_a_short_last_interval_is_left_out() -> None:
    # So short that every sample begins or ends a window.
    time, values = TIME[:1101], tone(1000.0)[:1101]
    expected = ds.spectrogram(time, values).density
    longer = ds.spectrogram(np.append(time, time[-1] + 1e-5), np.append(values, 1e9))
    np.testing.assert_array_equal(longer.density, expected)


def test_frequency_of_the_axes() -> None:
    system = {name: SLIDER[name] for name in ("mass", "stiffness_x", "stiffness_y")}
    found = ds.oscillation_frequency([0.0, np.pi / 2], **system)
    np.testing.assert_allclose(found, [10.0658, 1006.58], rtol=1e-5)


def test_prediction_is_the_circle_for_small_misalignment() -> None:
    """f_y sqrt(1 - tau^2), with an error of first order in phi."""
    tau = np.linspace(0.05, 0.9, 18)
    circle = 1006.5842 * np.sqrt(1.0 - tau**2)
    errors = []
    for phi in (1e-2, 1e-3):
        # A rigid stiff axis: both stiffnesses and the mass scaled, so that k_x/k_y does not show.
        slider = FIG4 | {"misalignment_deg": np.degrees(phi), "stiffness_y": 1e11, "mass": 2.5e3}
        errors.append(np.max(np.abs(creep_frequency(2.0 * tau, **slider) / circle - 1.0)))
    assert errors[0] < 0.05
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.15)


@pytest.mark.parametrize("column", ["w_x", "w_y"])
def test_ridge_of_fig4(fig4_result: ds.Result, column: str) -> None:
    """Within 1 % of the prediction, and within 0.2 % of the simulated frequencies, at every time."""
    spectrum = ds.spectrogram(fig4_result.time, fig4_result[column])
    found = ds.ridge(spectrum, above=100.0)
    here = np.interp(TIMES, spectrum.time, found)
    np.testing.assert_allclose(here, creep_frequency(TIMES, **FIG4), rtol=0.01)
    np.testing.assert_allclose(here, SIMULATED, rtol=0.002)
    between = (spectrum.time >= 0.1) & (spectrum.time <= 1.6)
    predicted = creep_frequency(spectrum.time[between], **FIG4)
    np.testing.assert_allclose(found[between], predicted, rtol=0.01)


def test_without_rests_the_ridge_is_the_prediction() -> None:
    """Constant friction: the object rests only once, and the oscillation is the harmonic one that is predicted."""
    result = ds.run(deck("fig3_constant"), scene={"t_end": 0.7}, output={"interval": 1e-4})
    spectrum = ds.spectrogram(result.time, result["w_y"])
    here = np.interp(TIMES[:3], spectrum.time, ds.ridge(spectrum, above=100.0))
    np.testing.assert_allclose(here, creep_frequency(TIMES[:3], **FIG4), rtol=5e-4)
