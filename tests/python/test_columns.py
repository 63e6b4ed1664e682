"""The columns fit together at any misalignment: geometry, Coulomb's law, Eqs. (4), (5) and (10)."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from dynstiction._native import catalogue
from programs import INPUTS

MASS, STIFFNESS, LIMIT = 0.25, np.array([1e3, 1e5]), 2.0
INTERVAL = 1e-5


CASES = [
    (35.0, 5e-3, "radau9"),
    (115.0, 5e-3, "radau5"),
    (-70.0, -5e-3, "radau13"),
    (200.0, 5e-3, "dop853"),
    (-35.0, 5e-3, "dopri5"),
]


@pytest.fixture(scope="module", params=CASES)
def motion(request: pytest.FixtureRequest) -> tuple[ds.Result, float, float]:
    """An oscillation of stretched springs at an angle at which no cosine is near 1; several samples in each step."""
    angle, velocity, method = request.param
    result = ds.run(
        INPUTS / "fig3.nml",
        scene={"t_end": 0.05},
        system={"misalignment_deg": angle, "stiffness_y": STIFFNESS[1]},
        drive={"velocity": velocity},
        integrator={"method": method},
        initial={"velocity_ratio": None, "elongation_x": 3e-3, "elongation_y": -2e-5},
        output={"interval": INTERVAL, "fields": [each["name"] for each in catalogue()["columns"] if each["name"] != "time"]},
    )
    return result, np.radians(angle), velocity


def across(angle: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The component to the left of the drive."""
    return np.asarray(-np.sin(angle) * x + np.cos(angle) * y)


def along(angle: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(np.cos(angle) * x + np.sin(angle) * y)


def test_position_and_rates_are_turned_by_the_misalignment(motion: tuple[ds.Result, float, float]) -> None:
    r, angle, velocity = motion
    length = np.abs(r["u_x"]).max()
    np.testing.assert_allclose(r["Y"], -across(angle, r["u_x"], r["u_y"]), atol=1e-14 * length)
    np.testing.assert_allclose(r["X"], velocity * r.time - along(angle, r["u_x"], r["u_y"]), atol=1e-12 * length)
    speed = np.hypot(r["w_x"], r["w_y"]).max()
    np.testing.assert_allclose(r["X_rate"], along(angle, r["w_x"], r["w_y"]), atol=1e-14 * speed)
    np.testing.assert_allclose(r["Y_rate"], across(angle, r["w_x"], r["w_y"]), atol=1e-14 * speed)


def test_rates_are_derivatives(motion: tuple[ds.Result, float, float]) -> None:
    """Central differences, away from the events; u' = V e - w is Eq. (4)."""
    r, _, _ = motion
    near = np.zeros(r.time.size, dtype=bool)
    for time in r.events["time"]:
        near |= np.abs(r.time - time) < 2 * INTERVAL
    inside = slice(1, -1)
    speed = np.hypot(r["w_x"], r["w_y"]).max()
    rates = {"X": r["X_rate"], "Y": r["Y_rate"]}
    rates["u_x"], rates["u_y"] = r["u_x_rate"], r["u_y_rate"]
    for name, rate in rates.items():
        error = np.abs((r[name][2:] - r[name][:-2]) / (2 * INTERVAL) - rate[inside])
        assert error[~near[inside]].max() < 1e-4 * speed, name


def test_forces_obey_hooke_and_coulomb(motion: tuple[ds.Result, float, float]) -> None:
    r, angle, velocity = motion
    force = STIFFNESS[:, None] * np.array([r["u_x"], r["u_y"]])
    np.testing.assert_allclose([r["spring_force_x"], r["spring_force_y"]], force, rtol=1e-15)
    speed = np.hypot(r["w_x"], r["w_y"])
    slides = r["sticking"] == 0.0
    law = 1.5 + 0.5 * np.exp(-speed / 0.01)
    np.testing.assert_allclose(r["friction"][slides], law[slides], rtol=1e-12)
    assert slides.any()
    if not slides.all():
        np.testing.assert_allclose(r["friction"][~slides], np.hypot(*force)[~slides], rtol=1e-12)
        np.testing.assert_allclose(r["theta"][~slides], np.arctan2(force[1], force[0])[~slides], rtol=1e-12)
    moves = slides & (speed > 1e-6 * speed.max())
    slip = (speed * np.exp(1j * r["theta"]))[moves]
    np.testing.assert_allclose(slip, (r["w_x"] + 1j * r["w_y"])[moves], atol=1e-12 * speed.max())
    np.testing.assert_allclose(np.exp(1j * r["psi"]), np.exp(1j * (r["theta"] - angle)), atol=1e-12)
    assert np.abs(r["psi"]).max() <= np.pi
    assert np.abs(r["theta"]).max() <= np.pi
    scale = 2 * abs(velocity * np.sin(angle)) * np.sqrt(MASS * STIFFNESS[0])
    np.testing.assert_allclose(r["zeta"], LIMIT * np.abs(np.sin(r["theta"])) ** 3 / scale, rtol=1e-12)


@pytest.mark.parametrize("damping", [{}, {"damping_x": 5.0, "damping_y": 400.0}])
def test_pull_force_is_what_a_load_cell_on_the_drive_measures(damping: dict[str, float]) -> None:
    """It moves the object against friction: m X'' = pull - friction along the drive; theta in degrees is theta."""
    angle, velocity, names = 35.0, 5e-3, ("X_rate", "psi", "friction", "spring_force_x", "spring_force_y", "theta", "w_x", "w_y")
    r = ds.run(
        INPUTS / "fig3.nml",
        scene={"t_end": 0.05},
        system={"misalignment_deg": angle, "stiffness_y": STIFFNESS[1], **damping},
        drive={"velocity": velocity},
        initial={"velocity_ratio": None, "elongation_x": 3e-3, "elongation_y": -2e-5},
        output={"interval": INTERVAL, "fields": ("pull_force", "theta_deg", "sticking", *names)},
    )
    np.testing.assert_allclose(np.radians(r["theta_deg"]), r["theta"], rtol=1e-14)
    phi = np.radians(angle)
    springs = along(phi, r["spring_force_x"], r["spring_force_y"])
    ux_rate, uy_rate = velocity * np.cos(phi) - r["w_x"], velocity * np.sin(phi) - r["w_y"]
    dampers = along(phi, damping.get("damping_x", 0.0) * ux_rate, damping.get("damping_y", 0.0) * uy_rate)
    np.testing.assert_allclose(r["pull_force"], springs + dampers, atol=1e-12)
    assert (np.abs(dampers).max() > 0.01) == bool(damping)
    acceleration = np.gradient(r["X_rate"], INTERVAL)
    slips = r["sticking"] == 0.0
    # Away from the ends of slip, where the acceleration jumps.
    inside = slips & np.roll(slips, 5) & np.roll(slips, -5)
    inside[:10] = inside[-10:] = False
    assert inside.sum() > 100
    force = r["pull_force"] - r["friction"] * np.cos(r["psi"])
    np.testing.assert_allclose(MASS * acceleration[inside], force[inside], atol=2e-3 * np.abs(force).max())
