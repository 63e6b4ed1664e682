"""Summary values against motions that are known: rest, and an oscillation without friction."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS

MASS, SOFT, STIFF, LIMIT, V = 0.25, 1e3, 1e7, 2.0, 1e-3


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13", "dopri5", "dop853"])
@pytest.mark.parametrize("angle", [0.5, -20.0])
def test_an_object_that_never_moves(method: str, angle: float) -> None:
    """The springs are stretched by the drive alone, and hold."""
    e = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    force = np.array([SOFT, STIFF]) * e * V
    t_end = 0.9 * LIMIT / np.hypot(*force)
    start = {"velocity_ratio": 0.0, "misalignment_deg": angle}
    result = ds.run(INPUTS / "fig3.nml", t_end=t_end, method=method, interval=t_end / 8, **start)
    summary = result.summary
    assert summary["sticks"] == 1
    assert summary["sticking_time"] == pytest.approx(t_end, rel=1e-14)
    assert summary["creep_share"] == 1.0
    assert summary["swing"] == pytest.approx(force[0] * t_end / 2, rel=1e-12)
    assert summary["drive_work"] == pytest.approx(np.dot(force, e) * V * t_end**2 / 2, rel=1e-12)
    assert summary["friction_work"] == 0.0
    assert abs(summary["energy_residual"]) < 1e-14
    assert summary["max_X_rate"] == 0.0
    assert summary["cycles"] == 0
    assert not {"period", "valley_force", "slip_duration", "slip_angle"} & set(summary)
    for name in ("steps", "rejected", "rhs", "jacobians", "factorisations", "newton"):
        assert result.statistics[name] == 0, name
    assert result.statistics["events"] == 1


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13"])
def test_an_oscillation_without_friction(method: str) -> None:
    """Along a line from rest: u = V sin(omega t)/omega, X' = V (1 - cos(omega t)); ten periods."""
    omega = np.sqrt(SOFT / MASS)
    cycle = 2 * np.pi / omega
    start = {"velocity_ratio": 0.0, "misalignment_deg": 0.0, "normal_load": 0.0}
    result = ds.run(INPUTS / "fig3.nml", t_end=10 * cycle, method=method, rtol=1e-9, interval=cycle / 10, **start)
    amplitude = SOFT * V / omega
    expected = {
        "period": cycle,
        "peak_force": amplitude,
        "valley_force": -amplitude,
        "swing": 2 * amplitude,
        "creep_share": np.arccos(0.9) / np.pi,
        "stick_duration": cycle / 2,
        "slip_duration": cycle / 2,
        "slip_length": V * cycle / 2 + 2 * V / omega,
        "max_X_rate": 2 * V,
    }
    for name, value in expected.items():
        assert result.summary[name] == pytest.approx(value, rel=3e-6), name
    assert result.summary["friction_work"] == 0.0
    # The springs end as they began, and so does X'.
    assert abs(result.summary["drive_work"]) < 1e-6 * MASS * V**2
    assert abs(result.summary["energy_residual"]) < 1e-7
    # A new matrix is computed and factorised in each iteration.
    statistics = result.statistics
    assert statistics["jacobians"] == statistics["factorisations"] == statistics["newton"]
    assert statistics["newton"] > statistics["steps"] + statistics["rejected"]
    time, theta = result.time, omega * result.time
    np.testing.assert_allclose(result["u_x"], V / omega * np.sin(theta), atol=1e-7 * V / omega)
    np.testing.assert_allclose(result["X_rate"], V * (1 - np.cos(theta)), atol=1e-6 * V)
    np.testing.assert_allclose(result["X"], V * (time - np.sin(theta) / omega), atol=1e-6 * V / omega)
