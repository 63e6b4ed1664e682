"""The science decks: what a summary says of stick-slip and creep, and what thinned maps show."""

from __future__ import annotations

import runpy

import dynstiction as ds
import numpy as np
import pytest
from fig3 import CONSTANT, SLIDER
from programs import INPUTS, ROOT

STATIC_LIMIT = 2.0  # N, F_0 of Fig. 3
LIMIT = 1.01627  # of theta (4 Lambda^2 tan phi)^(1/5) at slip, from the inner equation of docs/maps.md


@pytest.mark.parametrize(
    ("model", "changes"),
    [
        ("full", {}),
        ("full", {"integrator": {"method": "dopri5"}}),
        ("low_frequency", {"system": {"stiffness_y": None}, "friction": {"contact": None}}),
    ],
)
def test_summary_agrees_with_the_series(fig3, model, changes):
    """Swing, creep share and slip angle against the samples of the same run."""
    result = ds.run(fig3, scene={"model": model, "t_end": 4.0}, **changes)
    late = result.time >= 2.0
    force, rate = result["spring_force_x"], result["X_rate"]
    assert result.summary["swing"] == pytest.approx(np.ptp(force[late]), rel=1e-4)
    assert result.summary["swing"] > 0.3 * STATIC_LIMIT
    assert result.summary["creep_share"] == pytest.approx(np.mean(np.abs(rate[late]) <= 1e-4), abs=2e-3)
    assert 0.5 < result.summary["creep_share"] < 1.0
    # The sample before and the one after the crossing enclose it.
    after = int(np.argmax(force > result["friction"]))
    around = np.arctan2(np.abs(result["w_y"]), np.abs(result["w_x"]))[after - 1 : after + 1]
    assert around.min() - 1e-6 <= result.summary["slip_angle"] <= around.max() + 1e-6


def test_swing_begins_in_the_middle_of_the_run():
    """Slow loading in few long steps: the force at t_end/2 counts, though no step ends there."""
    result = ds.run(INPUTS / "low_frequency.nml", scene={"t_end": 1.6}, output={"interval": 0.8})
    force = result["spring_force_x"]
    assert result.summary["swing"] == pytest.approx(force[2] - force[1], rel=1e-6)
    assert "slip_angle" not in result.summary


def test_rest_is_creep_with_no_angle_and_steady_sliding_has_none():
    """Without misalignment the object rests, and friction points along the pull from the start."""
    result = ds.run(INPUTS / "low_frequency.nml", system={"misalignment_deg": 0.0})
    assert result.summary["slip_angle"] == 0.0
    rest = result["sticking"][result.time >= 5.0].mean()
    assert rest - 1e-3 < result.summary["creep_share"] < rest + 0.01
    steady = ds.run(INPUTS / "phi10.nml").summary
    assert steady["swing"] < 1e-3 * STATIC_LIMIT
    assert steady["creep_share"] == 0.0


def first_slip(number: float, phi: float, mass: float) -> float:
    """Angle [rad] at slip under constant friction for Lambda^2 tan(phi) and a mass."""
    degrees = np.degrees(phi)
    damping = np.sqrt(number / np.tan(phi))  # Lambda
    velocity = STATIC_LIMIT / (2.0 * damping * np.sin(phi) * np.sqrt(mass * 1e3))
    end = 2.0 * STATIC_LIMIT / (1e3 * velocity) + 10.0 * np.sqrt(mass / 1e3)
    changes = {"t_end": end, "misalignment_deg": degrees, "mass": mass, "velocity": velocity, "velocity_ratio": 0.0, "rtol": 1e-10}
    return ds.run(INPUTS / "low_frequency.nml", friction=CONSTANT, interval=end, **changes).summary["slip_angle"]


def test_slip_angle_depends_on_one_number():
    """For small phi: on Lambda^2 tan(phi) alone, by its -1/5th power where it is large; cot(theta) is twice it where small."""
    for number in (1e-3, 1.0, 1e4):
        angles = [first_slip(number, phi, mass) for phi, mass in ((1e-4, 0.25), (1e-4, 9.0), (4e-4, 0.25))]
        assert np.ptp(angles) < 2e-3 * angles[0]
    assert first_slip(1e6, 1e-5, 0.25) == pytest.approx(LIMIT * 4e6**-0.2, rel=3e-3)
    assert 1.0 / np.tan(first_slip(1e-3, 1e-4, 0.25)) == pytest.approx(2e-3, rel=1e-2)


def test_lists_are_those_of_the_tool(tmp_path):
    tool = runpy.run_path(str(ROOT / "tools" / "map_points.py"))
    tool["main"](tmp_path)
    lists = sorted(path.name for path in INPUTS.glob("*.csv"))
    assert lists == sorted(tool["LISTS"])
    for name in lists:
        assert (tmp_path / name).read_text() == (INPUTS / name).read_text()


@pytest.fixture
def thinned(program, tmp_path):
    """Run a deck of a map with few cases: settings, or points in place of its list."""

    def run(deck: str, *settings: str, points: str = ""):
        if points:
            (tmp_path / "few.csv").write_text(points)
            settings = (*settings, f"sweep.points={tmp_path / 'few.csv'}")
        done = program("run", INPUTS / f"{deck}.nml", "-o", "few.h5", "--quiet", "--overwrite", settings=settings, status=0)
        assert done.stderr == ""
        return ds.open(tmp_path / "few.h5")

    return run


def test_stick_slip_ends_at_low_and_outlives_the_line_at_high_velocity(thinned):
    """At 1 mm/s (line at 8.66 degrees) and at 75 mm/s (line at 2.13 degrees)."""
    cases = "system.misalignment_deg,drive.velocity,scene.t_end\n1,1e-3,8\n10,1e-3,8\n4,0.075,60\n8,0.075,60\n"
    swing = thinned("map_phi_velocity", points=cases)["swing"].values / STATIC_LIMIT
    assert swing[0] > 0.4 and swing[2] > 0.9
    assert swing[1] < 1e-3 and swing[3] < 1e-3
    critical = ds.critical_misalignment(**(SLIDER | {"velocity": [1e-3, 0.075]}))
    np.testing.assert_allclose(critical.angle[:, 0], [8.656, 2.129], atol=1e-3)
    # k_y/k_x = 1e4: rest below the crossover at 0.0057 degrees, creep above it; the amplitude is the same.
    data = thinned("map_anisotropy", "sweep.count=2,1", "sweep.first=5.7e-4,1e7", "sweep.last=0.57,1e7", "scene.t_end=4")
    rest = data["sticking_time"].values[:, 0] / 4.0
    assert rest[0] > 0.9 and rest[1] < 0.2
    assert np.all(data["creep_share"].values > 0.85)
    assert np.all(data["swing"].values > 0.4 * STATIC_LIMIT)


def test_stiction_fades_with_lambda(thinned):
    """One degree, by the mass: from nearly all of the time to what a free oscillation has."""
    lines = (INPUTS / "map_lambda.csv").read_text().splitlines()
    few = [lines[0], *(line for line in lines[1:] if line.startswith("1,") and line.split(",")[2] == "0.001")]
    data = thinned("map_lambda", points="\n".join([*few[:1], *few[1::10]]))
    share, angle = data["creep_share"].values, np.degrees(data["slip_angle"].values)
    assert share.size == 5
    free = np.arccos(0.9) / np.pi
    # The first two oscillate freely; their shares differ by the part of a period in which the run ends.
    assert np.all(np.diff(share) > -1e-3) and np.all(np.diff(share[1:]) > 0.0)
    assert np.all((0.8 * free < share[:3]) & (share[:3] < free))
    assert share[3] > 2.0 * free and share[4] > 0.9
    assert np.all(np.diff(angle) < 0.0) and angle[0] > 89.0 and angle[-1] < 4.0


def test_a_map_says_what_is_irregular_and_what_rings_down() -> None:
    rig = ds.Scene(INPUTS / "fig3.nml").replace(
        mass=0.4, stiffness_x=2e4, stiffness_y=2e6, normal_load=20.0, mu_0=0.25, mu_inf=0.18, v_f=4e-3, t_end=2.0
    )
    data = ds.sweep(rig, {"misalignment_deg": [2.0, 6.0, 20.0], "velocity": [1e-3, 5e-2]})
    assert (data["regularity"].values == -1.0).any() and (data["regularity"].values == 3.0).any()
    figure = ds.plot(data, quantity="pull_swing")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"irregular", "rings down"} <= set(labels)
    (dots,) = (line for line in figure.axes[0].lines if line.get_label() == "irregular")
    assert dots.get_xdata().size == np.count_nonzero(data["regularity"].values == -1.0)
    quiet = ds.run(rig, misalignment_deg=30.0, velocity=1e-2).summary
    assert quiet["pull_swing"] < 1e-6 and "pull_frequency" not in quiet
