"""Slow creep through Python: closed form, expansions, the full model, shapes, errors."""

from __future__ import annotations

import re
import time

import dynstiction as ds
import numpy as np
import pytest
from fig3 import CONSTANT, SLIDER
from scipy.integrate import solve_ivp

DEGREES = (4.0, 2.0, 1.0, 0.5, 0.25, 0.125)
# Errors at tau = 0.5, computed in quadruple precision.
TABLE = {
    "first_power": (1.24194e-3, 2.80997e-4, 6.65453e-5, 1.61725e-5, 3.98509e-6, 9.89017e-7),
    "printed": (1.89114e-2, 9.79567e-3, 4.97179e-3, 2.50299e-3, 1.2556e-3, 6.28802e-4),
    "third_order": (2.36619e-4, 2.96666e-5, 3.7127e-6, 4.64322e-7, 5.80536e-8, 7.25749e-9),
}
ORDERS = {"first_power": 2.0, "printed": 1.0, "third_order": 3.0}
FIG3 = {name: SLIDER[name] for name in ("velocity", "stiffness_x", "mu_0", "normal_load")}


@pytest.mark.parametrize("form", TABLE)
def test_errors_of_the_expansions(form: str) -> None:
    phi = np.radians(DEGREES)
    error = np.abs(ds.creep_asymptotic(0.5, phi, form) - ds.creep_exact(0.5, phi).X_rate)
    assert [f"{value:.5e}" for value in error] == [f"{value:.5e}" for value in TABLE[form]]


@pytest.mark.parametrize("tau", [0.25, 0.5, 0.8])
@pytest.mark.parametrize("form", ORDERS)
def test_orders_of_the_expansions(form: str, tau: float) -> None:
    phi = np.radians([0.02, 0.01])
    coarse, fine = np.abs(ds.creep_asymptotic(tau, phi, form) - ds.creep_exact(tau, phi).X_rate)
    assert np.log2(coarse / fine) == pytest.approx(ORDERS[form], abs=0.05)


@pytest.mark.parametrize("kappa", [0.0, 0.2])
@pytest.mark.parametrize("degrees", [1.0, 30.0])
def test_closed_form_against_integration(kappa: float, degrees: float) -> None:
    phi = np.radians(degrees)
    tau_1 = kappa / np.hypot(kappa * np.cos(phi), np.sin(phi))
    tau = tau_1 + np.linspace(0.05, 1.5, 9)

    def rate(_: float, alpha: np.ndarray) -> np.ndarray:
        return np.cos(alpha + phi) / (np.cos(alpha) ** 2 + kappa * np.sin(alpha) ** 2)

    start = np.arctan2(kappa * np.cos(phi), np.sin(phi)) if kappa else 0.0
    path = solve_ivp(rate, (tau_1, tau[-1]), [start], method="DOP853", rtol=1e-13, atol=1e-14, t_eval=tau)
    creep = ds.creep_exact(tau, phi, kappa)
    # The integration's own error: near 2e-12 on some machines.
    np.testing.assert_allclose(creep.alpha, path.y[0], rtol=0, atol=1e-11)
    # Eq. (6): X = V t - u_x c - u_y s, and the velocity along its direction
    np.testing.assert_allclose(
        creep.X, tau - np.sin(creep.alpha) * np.cos(phi) - kappa * np.cos(creep.alpha) * np.sin(phi), rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(creep.X_rate, creep.v * np.cos(creep.psi), rtol=1e-13)
    np.testing.assert_allclose(creep.Y_rate, creep.v * np.sin(creep.psi), rtol=1e-13)
    np.testing.assert_allclose(creep.deficit, 1.0 - creep.X_rate, rtol=0, atol=1e-15)


def test_full_model_creeps_as_the_closed_form(fig3: ds.Scene) -> None:
    """Constant friction, phi = 1 deg: X'/V at t = 1 s, averaged over whole high-frequency cycles."""
    cycle = 2 * np.pi / np.sqrt(1e7 / 0.25)  # [s] of u_y, stiffness_y/mass; sticking lengthens it a little
    run = ds.run(fig3, scene={"t_end": 1.05}, friction=CONSTANT, output={"interval": 1e-5})
    # Hann's window over 30 cycles hides the oscillation and a linear trend; the curvature makes 2e-7.
    inside = np.abs(run.time - 1.0) <= 15 * cycle
    window = np.hanning(inside.sum() + 2)[1:-1]
    mean = float(np.sum(window * run["X_rate"][inside]) / window.sum()) / FIG3["velocity"]
    exact = ds.creep_exact(0.5, np.radians(1.0), 1e-4).X_rate
    rigid = ds.creep_exact(0.5, np.radians(1.0)).X_rate
    print(f"X'/V: full model {mean:.7f}, exact creep {exact:.7f}, with a rigid axis {rigid:.7f}")
    assert mean == pytest.approx(0.0103482, abs=1e-6)


def test_si_units() -> None:
    phi = np.radians(1.0)
    t = np.array([0.5, 1.0, 3.0])
    rigid = ds.creep_velocity(t, misalignment_deg=1.0, **FIG3)
    np.testing.assert_allclose(rigid, 1e-3 * ds.creep_exact(0.5 * t, phi).X_rate, rtol=1e-15)
    finite = ds.creep_velocity(t, misalignment_deg=1.0, stiffness_y=1e7, **FIG3)
    np.testing.assert_allclose(finite, 1e-3 * ds.creep_exact(0.5 * t, phi, 1e-4).X_rate, rtol=1e-15)
    assert finite[1] != rigid[1]


def test_mirror() -> None:
    tau = np.linspace(0.0, 2.0, 50)
    plus, minus = ds.creep_exact(tau, 0.1, 0.05), ds.creep_exact(tau, -0.1, 0.05)
    for name in ("alpha", "v", "X_rate", "X", "deficit"):
        assert np.array_equal(getattr(plus, name), getattr(minus, name)), name
    for name in ("theta", "psi", "Y_rate"):
        assert np.array_equal(getattr(plus, name), -getattr(minus, name)), name
    np.testing.assert_array_equal(ds.creep_asymptotic(0.5, -0.1), ds.creep_asymptotic(0.5, 0.1))


def test_shapes() -> None:
    tau, phi = np.linspace(0, 2, 7)[:, None], np.radians([1.0, -2.0, 30.0])
    creep = ds.creep_exact(tau, phi, 0.01)
    for column in creep:
        assert column.shape == (7, 3)
        assert column.dtype == np.float64
    assert creep.X_rate[3, 2] == ds.creep_exact(tau[3, 0], phi[2], 0.01).X_rate
    assert ds.creep_exact(0.5, 0.1).v.shape == ()
    assert ds.creep_exact([], 0.1).v.shape == (0,)
    assert ds.creep_asymptotic(tau[:3], phi).shape == (3, 3)
    assert ds.creep_asymptotic([], 0.1).shape == (0,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1e-300, 0.1), "tau must be finite and in [0, inf)"),
        ((np.nan, 0.1), "tau must be finite and in [0, inf)"),
        ((np.inf, 0.1), "tau must be finite and in [0, inf)"),
        (([0.5, 0.5], [0.1, np.nan]), "phi must be in (-pi/2, pi/2) rad"),
        ((0.5, np.pi / 2), "phi must be in (-pi/2, pi/2) rad"),
        ((0.5, -1.6), "phi must be in (-pi/2, pi/2) rad"),
        ((0.5, 0.1, 1.0), "kappa must be in [0, 1)"),
        ((0.5, 0.1, -0.1), "kappa must be in [0, 1)"),
        ((0.5, 0.1, np.nan), "kappa must be in [0, 1)"),
        (([0.5, 1.0], 0.0), "tau = [0, 1) only"),
    ],
)
def test_out_of_range(arguments: tuple, message: str) -> None:
    with pytest.raises(ds.UsageError, match=re.escape(message)):
        ds.creep_exact(*arguments)


def test_out_of_range_of_the_expansions() -> None:
    for tau in (1.0, 1.5, -0.1, -1.0, np.nan):
        with pytest.raises(ds.UsageError, match=re.escape("Eq. (8) holds for tau in [0, 1)")):
            ds.creep_asymptotic([0.5, tau], 0.1)
    with pytest.raises(ds.UsageError, match=re.escape("phi must be in (-pi/2, pi/2) rad")):
        ds.creep_asymptotic(0.5, 2.0)
    with pytest.raises(ds.UsageError, match="one of 'first_power', 'printed', 'third_order'"):
        ds.creep_asymptotic(0.5, 0.1, "second")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value", "valid"),
    [
        ("velocity", 0.0, "finite and in (0, inf) m/s"),
        ("stiffness_x", -1.0, "finite and in (0, inf) N/m"),
        ("mu_0", np.nan, "finite and in (0, inf)"),
        ("normal_load", np.inf, "finite and in (0, inf) N"),
        ("stiffness_y", 999.0, "in [0, 1)"),
        ("misalignment_deg", 91.0, "in (-90, 90) deg"),
    ],
)
def test_out_of_range_in_si_units(name: str, value: float, valid: str) -> None:
    with pytest.raises(ds.UsageError, match=re.escape(valid)):
        ds.creep_velocity([0.1, 1.0], **{"misalignment_deg": 5.0, **FIG3, name: value})
    with pytest.raises(ds.UsageError, match=re.escape("t = -1")):
        ds.creep_velocity([0.1, -1.0], misalignment_deg=5.0, **FIG3)


def test_speed() -> None:
    """Below 10 us of the processor a point: tens of times what it takes."""
    tau = np.linspace(0.0, 2.0, 500_000)
    start = time.process_time()
    creep = ds.creep_exact(tau, np.radians(1.0))
    assert time.process_time() - start < 1e-5 * tau.size
    assert np.all(np.isfinite(creep))
