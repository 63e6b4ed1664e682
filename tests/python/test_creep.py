"""Slow creep through Python: units, shapes, errors. The numbers: tests/unit/test_creep.f90, test_creep_validation.py."""

from __future__ import annotations

import time

import dynstiction as ds
import numpy as np
from fig3 import SLIDER

FIG3 = {name: SLIDER[name] for name in ("velocity", "stiffness_x", "mu_0", "normal_load")}


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


def test_speed() -> None:
    """Below 10 us of the processor a point: tens of times what it takes."""
    tau = np.linspace(0.0, 2.0, 500_000)
    start = time.process_time()
    creep = ds.creep_exact(tau, np.radians(1.0))
    assert time.process_time() - start < 1e-5 * tau.size
    assert np.all(np.isfinite(creep))
