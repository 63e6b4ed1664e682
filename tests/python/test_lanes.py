"""rodas4p: cases of a sweep side by side give what a single run gives, each for itself."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from fig3 import CONSTANT, slider
from programs import INPUTS

pytest.importorskip("xarray")

SLOW = INPUTS / "low_frequency.nml"
ANGLES = np.linspace(1.0, 8.0, 37)


def sweep(values, method="rodas4p", rtol=1e-6, **groups):
    return ds.sweep(SLOW, values, points=True, integrator={"method": method, "rtol": rtol}, scene={"t_end": 10.0}, **groups)


def largest_error(a, b, name):
    difference = np.abs(a[name].values - b[name].values)
    return np.nanmax(difference / np.maximum(np.abs(b[name].values), 1e-9))


@pytest.fixture(scope="module")
def exact():
    return sweep({"system.misalignment_deg": ANGLES}, "radau13", 1e-12)


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
def test_agrees_with_radau_as_well_as_asked(exact, rtol):
    found = sweep({"system.misalignment_deg": ANGLES}, rtol=rtol)
    assert (found["result_code"] == 0).all()
    assert np.array_equal(found["cycles"], exact["cycles"])
    for name in ("final_u_x", "final_X", "period", "peak_force", "valley_force", "slip_length", "drive_work", "swing"):
        assert largest_error(found, exact, name) < rtol, name
    for name in ("stick_duration", "slip_duration", "friction_work", "max_X_rate", "slip_angle"):
        assert largest_error(found, exact, name) < 3 * rtol, name
    assert np.abs(found["creep_share"] - exact["creep_share"]).max() < 0.1 * rtol**0.5
    assert np.abs(found["energy_residual"]).max() < rtol
    assert np.array_equal(found["final_u_y"], np.zeros(ANGLES.size))


def test_errors_fall_with_the_order(exact):
    found = [sweep({"system.misalignment_deg": ANGLES}, rtol=rtol) for rtol in (1e-5, 1e-9)]
    errors = [np.max(np.abs(f["final_u_x"].values - exact["final_u_x"].values)) for f in found]
    steps = [f["steps"].values.mean() for f in found]
    assert np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0]) == pytest.approx(4.0, abs=0.5)


def test_a_case_does_not_depend_on_its_neighbours():
    one_by_one = [sweep({"system.misalignment_deg": [angle]}) for angle in ANGLES[:11]]
    for order in (ANGLES, ANGLES[::-1], np.concatenate([[77.0, 0.01], ANGLES])):
        together = sweep({"system.misalignment_deg": order})
        for angle, alone in zip(ANGLES, one_by_one, strict=False):
            place = int(np.flatnonzero(order == angle)[0])
            for name in ("final_u_x", "period", "max_X_rate", "friction_work", "steps"):
                assert together[name].values[place] == alone[name].values[0]


def random_scenes(n):
    chance = np.random.default_rng(7)
    values = {
        "system.misalignment_deg": chance.choice([-1, 1], n) * 10 ** chance.uniform(-2, 1.9, n),
        "system.mass": 10 ** chance.uniform(-3, 1, n),
        "system.stiffness_x": 10 ** chance.uniform(1, 5, n),
        "friction.mu_0": chance.uniform(0.05, 0.5, n),
        "friction.mu_inf": chance.uniform(0.01, 0.5, n),
        "friction.v_f": 10 ** chance.uniform(-3, 0, n),
        "friction.normal_load": 10 ** chance.uniform(-1, 2, n),
        "drive.velocity": chance.choice([-1, 1], n) * 10 ** chance.uniform(-4, -1, n),
        "initial.velocity_ratio": chance.choice([0.0, 1e-6, 1.0, -2.0], n),
        "initial.elongation_x": chance.choice([0.0, 1e-4, -1e-3], n),
    }
    length = values["friction.mu_0"] * values["friction.normal_load"] / values["system.stiffness_x"]
    values["scene.t_end"] = length / np.abs(values["drive.velocity"]) * chance.uniform(0.1, 5, n)
    return values, length


def test_random_scenes_agree_with_radau():
    values, length = random_scenes(150)
    found, exact = sweep(values, rtol=1e-7), sweep(values, "radau13", 1e-11)
    assert (found["result_code"] == 0).all()
    error = np.abs(found["final_u_x"].values - exact["final_u_x"].values) / length
    assert np.median(error) < 1e-8
    assert error.max() < 1e-3
    # X starts at 0 - u.e, and is as exact as u is.
    travel = np.abs(values["drive.velocity"]) * values["scene.t_end"]
    apart = np.abs(found["final_X"].values - exact["final_X"].values) / (length + travel)
    assert np.median(apart) < 1e-8
    assert apart.max() < 1e-3
    # The first peak may be where the motion began.
    limit = values["friction.mu_0"] * values["friction.normal_load"]
    for name in ("peak_force", "valley_force"):
        np.testing.assert_array_equal(np.isnan(found[name]), np.isnan(exact[name]))
        assert np.nanmax(np.abs(found[name].values - exact[name].values) / limit) < 1e-5
    assert np.abs(found["energy_residual"]).max() < 1e-4
    # Slip may begin in the middle of a step that passes over the relaxation.
    assert np.nanmax(np.abs(found["slip_angle"] - exact["slip_angle"])) < 0.07


def test_constant_friction():
    groups = slider({"system": {"stiffness_y": None, "misalignment_deg": 2.0}, "friction": CONSTANT})
    constant = ds.Scene(scene={"model": "low_frequency", "t_end": 3.0}, **groups)
    values = {"drive.velocity": [1e-3, 2e-3]}
    found, exact = (
        ds.sweep(constant, values, integrator={"method": method, "rtol": rtol})
        for method, rtol in (("rodas4p", 1e-7), ("radau13", 1e-11))
    )
    assert largest_error(found, exact, "final_u_x") < 1e-7


@pytest.mark.parametrize(
    ("values", "code", "words"),
    [
        ({"system.misalignment_deg": [0.0, 1.0]}, 2, "V sin(phi)"),
        ({"integrator.max_steps": [5.0, 1e6]}, 42, "max_steps"),
        ({"system.misalignment_deg": [1e-300, 1.0]}, 41, "step vanishes"),
    ],
)
@pytest.mark.filterwarnings("ignore::dynstiction.errors.IncompleteWarning")
def test_what_it_cannot_do_is_a_row(values, code, words):
    found = sweep(values)
    assert list(found["result_code"]) == [code, 0]
    assert words in str(found["result_text"].values[0])
    assert np.isnan(found["final_u_x"][0])
    assert np.isfinite(found["final_u_x"][1])
    if code == 42:
        needed = int(sweep({"system.misalignment_deg": [1.0]})["steps"].values[0])
        found = sweep({"integrator.max_steps": [1.0, 2.0, 7.0, needed - 1.0, float(needed)]})
        assert list(found["steps"]) == [1, 2, 7, needed - 1, needed]
        assert list(found["result_code"]) == [42, 42, 42, 42, 0]
