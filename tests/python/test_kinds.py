"""The kinds of figure: their data against known values, and any file that may come."""

from __future__ import annotations

from typing import Any

import dynstiction as ds
import numpy as np
import pytest
from dynstiction import plot
from dynstiction.plot.creep import mean_velocity
from dynstiction.plot.damping import draw_damping_of
from dynstiction.plot.paper import deck
from dynstiction.plot.style import new_figure
from dynstiction.plot.theory import damping_crossing, slider
from fig3 import CONSTANT


@pytest.fixture(scope="module")
def phi10_result() -> ds.Result:
    return ds.run(deck("phi10"))


@pytest.fixture(scope="module")
def constant_result() -> ds.Result:
    return ds.run(deck("fig3_constant"), scene={"t_end": 2.2})


def weakened_ratio(theta_deg: float, phi_deg: float) -> float:
    """The damping ratio with weakening, written out for the parameters of Fig. 3."""
    theta, across = np.radians(theta_deg), 1e-3 * np.sin(np.radians(phi_deg))
    v = across / np.sin(theta)
    weakening = 0.5 * np.exp(-v / 0.01)
    force, slope = 1.5 + weakening, -weakening / 0.01
    return (slope * np.cos(theta) ** 2 + force * np.sin(theta) ** 3 / across) / (2 * np.sqrt(0.25 * 1e3))


def test_spectrogram_shows_the_ridge_and_the_prediction(fig4_result: ds.Result) -> None:
    axes = plot.draw(fig4_result, "spectrogram").axes
    for axis in (axes[1], axes[3]):
        (image,) = axis.images
        left, right, low, high = image.get_extent()
        decibels = np.asarray(image.get_array())
        frequency = low + (high - low) * (np.arange(decibels.shape[0]) + 0.5) / decibels.shape[0]
        time = left + (right - left) * (np.arange(decibels.shape[1]) + 0.5) / decibels.shape[1]
        assert (time[0], time[-1]) == (pytest.approx(0.01, abs=5e-3), pytest.approx(1.99, abs=5e-3))
        above = frequency > 0.1
        brightest = frequency[above][np.argmax(decibels[above], axis=0)]
        (line,) = axis.lines
        predicted = np.interp(time, *line.get_data())
        between = (time > 0.1) & (time < 1.6)
        # A window of 20 periods: 25 Hz between two rows.
        np.testing.assert_allclose(brightest[between], predicted[between], rtol=0.01, atol=13e-3)
    assert "[dB re 1 (mm/s)" in axes[4].get_xlabel()
    # Beside it are the velocities.
    for kind, names in {"spectrogram": ("u_x_rate", "u_y_rate"), "velocities": ("w_x", "w_y")}.items():
        axes = plot.draw(fig4_result, kind).axes
        for place, name in zip((0, 2), names, strict=True):
            drawn = axes[place].lines[0].get_ydata()
            factor = {"mm": 1e3, "µm": 1e6}[axes[place].get_ylabel().partition("[")[2].partition("/")[0]]
            assert (drawn.min(), drawn.max()) == (factor * fig4_result[name].min(), factor * fig4_result[name].max())


def test_fig5_is_a_map_over_lambda_and_theta(fig4_result: ds.Result, phi10_result: ds.Result) -> None:
    """Lines at Lambda = 3623.9 (1 deg) and 364.2 (10 deg) from 90 deg to theta = phi; zeta is 0.0193 and 1.907 there.

    It is 1 at 3.733 deg, with weakening at 5.10 and 10.87 deg; steady sliding is at 1 and at 10 deg.
    """
    axis = new_figure(lambda empty: draw_damping_of([fig4_result, phi10_result], empty)).axes[0]
    assert axis.get_xlim()[0] < 1.0
    assert axis.get_xlim()[1] > 3623.9
    ratio, theta = np.moveaxis(axis.collections[0].get_coordinates(), 2, 0)
    zeta = np.asarray(axis.collections[0].get_array())
    np.testing.assert_allclose(zeta, ratio * np.sin(np.radians(theta)) ** 3, rtol=1e-12)
    over, degrees = axis.lines[0].get_data()
    np.testing.assert_allclose(over * np.sin(np.radians(degrees)) ** 3, 1.0, rtol=1e-9)
    lines = [line.get_data() for line in axis.lines if line.get_linewidth() == 1.0 and line.get_marker() == "None"]
    np.testing.assert_allclose(lines, [([3623.9] * 2, [90.0, 1.0]), ([364.2] * 2, [90.0, 10.0])], rtol=2e-4)
    at_end = [ratio[1] * np.sin(np.radians(theta[1])) ** 3 for ratio, theta in lines]
    np.testing.assert_allclose(at_end, [0.01926, 1.907], rtol=5e-4)
    marked = [line for line in axis.lines if len(line.get_ydata())]
    found = {mark: [[*line.get_ydata()] for line in marked if line.get_marker() == mark] for mark in "xo"}
    assert found["x"] == [pytest.approx([1.0, 3.733], rel=2e-4), pytest.approx([10.0])]
    assert found["o"] == [pytest.approx([5.103], rel=2e-4), pytest.approx([10.873], rel=2e-4)]
    assert weakened_ratio(10.873, 10.0) == pytest.approx(1.0, rel=1e-3)
    assert weakened_ratio(5.1033, 1.0) == pytest.approx(1.0, rel=1e-3)
    constant = {k: v for k, v in slider(fig4_result).items() if k not in ("mu_inf", "v_f")}
    for level in (0.1, 1.0, 100.0):
        expected = np.arcsin((level / 3623.87) ** (1 / 3))
        assert damping_crossing(constant, level) == pytest.approx(expected, rel=1e-5)
    assert np.isnan(damping_crossing(constant, 4000.0))


def test_creep_figure_has_the_closed_form_and_those_of_equation_8(constant_result: ds.Result) -> None:
    tau, run, exact = mean_velocity(constant_result)
    inner = (tau > 0.05) & (tau < 0.95)
    np.testing.assert_allclose(run[inner], exact[inner], rtol=2e-3)
    assert np.interp(0.5, tau, run) == pytest.approx(0.0103482, rel=1e-3)
    assert tau[-1] == pytest.approx(1.0, abs=0.02)
    above, below = plot.draw(constant_result, "creep").axes
    drawn = {line.get_label(): line for line in above.lines}
    phi = np.radians(1.0)
    tau, printed = drawn["Eq. (8) as printed"].get_data()
    inner = (tau > 0.1) & (tau < 0.9)
    np.testing.assert_allclose(printed[inner], (phi * (phi + tau**2 / np.sqrt(1 - tau**2)))[inner])
    tau, first = drawn["Eq. (8)"].get_data()
    np.testing.assert_allclose(first[inner], (phi * (phi + tau / np.sqrt(1 - tau**2)))[inner])
    exact = ds.creep_exact(tau, phi, 1e-4).X_rate
    np.testing.assert_allclose(drawn["exact, Eq. (7)"].get_ydata(), exact)
    deviation = below.lines[-3].get_ydata()
    np.testing.assert_allclose(deviation[inner], 100 * (first / exact - 1)[inner])


def run_short(changes: dict[str, Any]) -> ds.Result:
    return ds.run(deck("fig3"), **({"t_end": 0.3, "interval": 2e-4} | changes))


# Changes of a scene, and what names the remedy of the kinds that it cannot have.
ANY_FILE: dict[str, tuple[dict[str, Any], dict[str, str]]] = {
    "aligned": ({"misalignment_deg": 0.0}, {"damping": "misalignment", "creep": "misalignment"}),
    "negative": ({"misalignment_deg": -1.0}, {}),
    "across": ({"misalignment_deg": 90.0}, {"creep": "misalignment_deg"}),
    "turned": ({"misalignment_deg": 170.0}, {"creep": "misalignment_deg"}),
    "backwards": ({"velocity": -1e-3}, {}),
    "profile": ({"time": [0.0, 0.1, 0.2], "velocity": [1e-3, 1e-3, 0.0]}, {"damping": "velocity", "creep": "velocity"}),
    "at rest": ({"velocity": 0.0, "velocity_ratio": 0.0}, {"damping": "drive", "creep": "velocity"}),
    "strained": ({"elongation_x": 1e-4}, {"creep": "relaxed"}),
    "isotropic": ({"stiffness_y": 1e3}, {"creep": "stiffness_x/stiffness_y"}),
    "without friction": ({"mu_0": 0.0, "mu_inf": 0.0}, {"creep": "mu_0", "damping": "friction"}),
    "constant": ({"friction": CONSTANT}, {}),
    "smoothed": ({"contact": "smoothed", "v_smooth": 1e-6}, {}),
    "every step": ({"interval": 0.0, "t_end": 0.1}, {"spectrogram": "uniform"}),
    "coarse": ({"interval": 0.01}, {"spectrogram": r"output\.interval = 5e-05"}),
    "short": ({"t_end": 1e-3}, {"spectrogram": "longer run", "creep": "samples"}),
    "two samples": ({"t_end": 1e-3, "interval": 1e-3}, {"spectrogram": "longer run|uniform|output", "creep": "samples"}),
}
# Laying out takes most of the time, and the logarithmic axes are what it may find fault with.
LAID_OUT = ("across", "turned", "backwards")


@pytest.mark.parametrize("name", ANY_FILE)
def test_any_file_is_drawn_or_refused_with_a_remedy(name: str) -> None:
    changes, refused = ANY_FILE[name]
    result = run_short(changes)
    for kind in plot.KINDS:
        if kind in refused:
            with pytest.raises(ds.UsageError, match=refused[kind]):
                plot.draw(result, kind)
        else:
            figure = plot.draw(result, kind)
            if name in LAID_OUT and kind in ("damping", "creep"):
                figure.draw_without_rendering()
