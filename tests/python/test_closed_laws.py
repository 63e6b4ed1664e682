"""The closed laws for the end of stick-slip: known expansions, accurate ends, runs of the program, and what the page says."""

from __future__ import annotations

import importlib.util
import math
import re
import sys
from types import ModuleType

import dynstiction as ds
import numpy as np
import pytest
from programs import ROOT


@pytest.fixture(scope="module")
def laws() -> ModuleType:
    found = importlib.util.spec_from_file_location("closed_laws", ROOT / "docs" / "closed_laws.py")
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules["closed_laws"] = module
    found.loader.exec_module(module)
    return module


def test_canard_of_van_der_pol(laws: ModuleType) -> None:
    # w^3/3 - w at w = 1.
    assert laws.canard_terms([-2 / 3, 0, 2, 2, 0, 0, 0, 0]) == pytest.approx((-1 / 8, -3 / 32, -173 / 1024), rel=1e-15)


def test_canard_of_very_slow_drive(laws: ModuleType) -> None:
    # -1/(2 x^2) - x at x = 1.
    derivatives = [0, 0] + [-0.5 * (-1) ** n * math.factorial(n + 1) for n in range(2, 8)]
    terms = laws.canard_terms(derivatives)
    assert terms == pytest.approx((2 / 9, 73 / 243, 4048 / 6561), rel=1e-14)
    gamma = 10.0
    series = laws.power(np.array([1.0, *terms]), -1.5)
    for order in (1, 2, 3):
        exact = sum(term / gamma ** (2 * n) for n, term in enumerate(series[: order + 1]))
        assert laws.universal(gamma, order) == pytest.approx(exact, abs=1e-14)
    rig = laws.Rig(stiffness=25.0 / 0.25)
    slow = math.tan(laws.canard(rig, 1e-7, 3)) / math.tan(laws.hopf(rig, 1e-7))
    assert slow == pytest.approx(laws.universal(gamma, 3), abs=1e-5)


def test_derivatives(laws: ModuleType) -> None:
    rig, w, across = laws.Rig(), 0.008, 0.003
    circle = 0.004 * np.exp(2j * np.pi * np.arange(64) / 64)
    v = np.sqrt((w + circle) ** 2 + across**2)
    force = rig.friction(v)[0] * (w + circle) / v
    series = np.fft.fft(force).real[:8] / 64 / 0.004 ** np.arange(8)
    expected = series * [math.factorial(n) for n in range(8)]
    assert rig.taylor(w, across, 8) == pytest.approx(expected, rel=1e-8)
    assert rig.phi(np.array(w), np.array(across)) == pytest.approx(expected[:3], rel=1e-10)


def test_the_critical_angle_is_that_of_the_program(laws: ModuleType) -> None:
    for drive in (1e-3, 0.02, 0.075):
        critical = ds.critical_misalignment(
            mass=0.25, stiffness_x=1e3, stiffness_y=1e7, mu_0=0.2, mu_inf=0.15, v_f=0.01, normal_load=10.0, velocity=drive
        )
        assert laws.hopf(laws.Rig(), drive) == pytest.approx(float(critical.limit), rel=1e-12)


def test_every_velocity_of_the_map_has_a_law(laws: ModuleType) -> None:
    best = {0.03: "canard 3", 0.1: "canard 3", 0.3: "canard 3", 1.0: "canard 3", 10.0: "averaged 3"}
    table = laws.compare(laws.Rig(), [row for row in laws.ACCURATE if row[0] in laws.ROWS])
    assert len(table) == 9
    for velocity, _, angle, values in table:
        assert values[best.get(velocity, "averaged")] == pytest.approx(angle, rel=0.005)


def test_orders_converge(laws: ModuleType) -> None:
    rig = laws.Rig()
    accurate = {velocity: angle for velocity, _, angle in laws.ACCURATE}

    def deviation(law: str, velocity: float) -> float:
        return abs(math.degrees(laws.LAWS[law].angle(rig, 1e-3 * velocity)) / accurate[velocity] - 1.0)

    for coarse, fine, velocity in (
        ("canard 1", "canard 2", 0.3),
        ("canard 2", "canard 3", 0.3),
        ("small 2", "small 4", 20.0),
        ("averaged", "averaged 3", 15.0),
        ("averaged", "averaged 3", 50.0),
    ):
        assert deviation(fine, velocity) < 0.4 * deviation(coarse, velocity)


def test_small_cycles_agree_with_third_order_averaging(laws: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    # Both have all terms to the fourth power of the amplitude, so they differ by its sixth.
    rig, differences = laws.Rig(), []
    for end in (0.01, 0.005):
        monkeypatch.setattr(laws, "END_OF_SWING", end)
        differences.append(laws.small_cycle(rig, 0.012, 4) - laws.averaged_third_end(rig, 0.012))
    assert math.log2(differences[0] / differences[1]) == pytest.approx(6.0, abs=0.05)


def test_fold_near_the_bautin_point(laws: ModuleType) -> None:
    rig = laws.Rig()
    drive, angle = laws.bautin(rig)
    assert drive / rig.v_f == pytest.approx(3.60403, abs=1e-5)
    fold = laws.averaged_fold(rig, 1.01 * drive)[0]
    assert laws.near_bautin(rig, 1.01 * drive) == pytest.approx(fold, rel=1e-5)
    assert fold < angle


def test_both_sides_of_a_fold_by_runs(laws: ModuleType) -> None:
    drive = 0.05
    fold = math.degrees(laws.averaged_fold(laws.Rig(), drive)[0])
    swings = [
        ds.run(
            ROOT / "inputs" / "fig3.nml",
            scene={"model": "low_frequency", "t_end": 200.0},
            system={"misalignment_deg": fold + beyond, "stiffness_y": None},
            friction={"contact": None},
            drive={"velocity": drive},
            output={"interval": 1.0},
        ).summary["swing"]
        for beyond in (-0.02, 0.02)
    ]
    assert swings[0] > 0.9 and swings[1] < 1e-3


def test_cycle_of_the_return_map(laws: ModuleType) -> None:
    angle, peak, multiplier = laws.cycle_through(laws.Rig(), 0.075, 2.0 * 0.209330198039, *np.radians((3.0, 4.0)))
    assert math.degrees(angle) == pytest.approx(3.5, abs=1e-7)
    assert (peak / 2.0, multiplier) == pytest.approx((1.289672996761, 0.242084267218), rel=1e-7)


def test_the_table_of_the_page(laws: ModuleType) -> None:
    text = (ROOT / "docs" / "closed_laws.md").read_text(encoding="utf-8")
    printed = dict(re.findall(r"^\| \*{0,2}([\d.]+)\*{0,2} \| (\d+\.\d{6})°", text, re.MULTILINE))
    assert {float(velocity): angle for velocity, angle in printed.items()} == {
        velocity: f"{angle:.6f}" for velocity, _, angle in laws.ACCURATE
    }


def test_accurate_angles_are_those_of_the_solver(laws: ModuleType) -> None:
    # A stiff axis on which the slow motion holds at every velocity.
    fig3 = ds.Scene(ROOT / "inputs" / "fig3.nml").replace(system={"stiffness_y": 1e10})
    angles = {velocity: angle for velocity, _, angle in laws.ACCURATE}
    for velocity in laws.ROWS:
        end = ds.stick_slip_ends(fig3.replace(drive={"velocity": 1e-3 * velocity})).misalignment
        assert end is not None
        assert math.degrees(end.at) == pytest.approx(angles[velocity], rel=1e-9)
