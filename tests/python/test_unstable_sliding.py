"""Motion that becomes unstable is left, by every method and tolerance at the same time; what only roundoff decides is named.

Steady sliding of Fig. 3 is unstable below 8.656 degrees (slow branch) and above 76.3 degrees (fast, transverse branch): theory_stability.md.
"""

import math

import dynstiction as ds
import pytest
from fig3 import changed, slider

METHODS = ("radau5", "radau9", "radau13")
RTOL = (1e-4, 1e-5, 1e-6)


def scene(angle, t_end, method, rtol, drive, model="full", **initial):
    groups = slider({"system": {"misalignment_deg": angle}, "drive": drive, "initial": {"velocity_ratio": 0.0, **initial}})
    if model == "low_frequency":
        groups = changed(groups, {"system": {"stiffness_y": None}, "initial": {"elongation_y": None}})
    integrator = {"method": method, "rtol": rtol}
    return ds.Scene(**groups, scene={"model": model, "t_end": t_end}, integrator=integrator, output={"interval": t_end / 100})


def pushed(angle, push, t_end, method, rtol, model="full"):
    """A start in steady sliding at 1 mm/s, but for a relative push of the slip velocity."""
    along = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    friction = 10.0 * (0.15 + 0.05 * math.exp(-0.1))
    stretch = {"elongation_x": friction * along[0] / 1e3, "elongation_y": friction * along[1] / 1e7}
    drive = {"velocity": 1e-3}
    return scene(angle, t_end, method, rtol, drive, model, velocity_ratio=1.0 + push, **stretch)


RAMP = {"velocity": (5e-4, 5e-4, 1e-3), "time": (0.0, 100.0, 150.0)}
"""Through the critical speed of 8 degrees, 0.86 mm/s."""


@pytest.mark.parametrize("model", ["full", "low_frequency"])
@pytest.mark.parametrize("method", METHODS)
def test_ramp_through_the_critical_speed(method, model):
    """The slow motion follows the drive until the ramp ends; the kink there starts stick-slip."""
    runs = [ds.run(scene(8.0, 200.0, method, rtol, RAMP, model)) for rtol in RTOL]
    assert [r.summary["cycles"] for r in runs] == [54.0] * len(RTOL)
    for run in runs:
        assert run.summary["swing"] == pytest.approx(0.5561 if model == "full" else 0.5588, rel=1e-3)
        assert run.summary["undecided_from"] < 150.1


@pytest.mark.parametrize("push", [1e-6, 1e-9, -1e-9])
@pytest.mark.parametrize("angle", [5.0, 8.0])
def test_slow_branch_from_a_push(angle, push):
    counts = set()
    for method in METHODS:
        for rtol in RTOL:
            for model in ("full", "low_frequency"):
                run = ds.run(pushed(angle, push, 5.0, method, rtol, model))
                counts.add(run.summary["cycles"])
                assert "undecided_from" not in run.summary
    assert len(counts) == 1 and counts.pop() >= 2


def test_the_lanes_of_a_sweep_follow_slow_growth():
    """Just below the critical angle: the amplitude after 5 s depends on the accuracy of the growth of 0.1 1/s, from pushes below rtol."""
    swings = {}
    for method in ("rodas4p", "radau9"):
        for rtol in (1e-3, 1e-5):
            scene = pushed(8.6, 0.0, 5.0, method, rtol, "low_frequency")
            data = ds.sweep(scene, {"initial.velocity_ratio": [1 + 1e-6, 1 + 1e-9]}, progress=False)
            swings[method, rtol] = data["swing"].values
    for found in swings.values():
        assert found == pytest.approx(swings["radau9", 1e-5], rel=0.2)


@pytest.mark.parametrize("angle", [80.0, 83.0])
def test_fast_branch_from_a_push(angle):
    sticks = {ds.run(pushed(angle, 1e-6, 1.0, method, rtol)).summary["sticks"] for method in METHODS for rtol in RTOL}
    assert len(sticks) == 1 and sticks.pop() > 600


@pytest.mark.parametrize("method", [*METHODS, "dopri5"])
@pytest.mark.parametrize("angle", [8.0, 83.0])
def test_an_exact_equilibrium_is_named(angle, method):
    """The further motion depends on roundoff, and the summary says from when."""
    run = ds.run(pushed(angle, 0.0, 5.0 if angle < 10 else 1.0, method, 1e-6))
    assert 0.0 <= run.summary["undecided_from"] <= run.time[-1]


@pytest.mark.parametrize("method", [*METHODS, "dopri5"])
def test_a_stable_equilibrium_is_not(method):
    run = ds.run(pushed(12.0, 0.0, 5.0, method, 1e-6))
    assert "undecided_from" not in run.summary
    assert run.summary["cycles"] == 0


@pytest.mark.parametrize("method", ["radau9", "radau13"])
def test_stable_sliding_costs_little(method):
    """Following what grows does not shorten the steps where nothing grows."""
    assert ds.run(pushed(20.0, 1e-3, 100.0, method, 1e-6)).statistics["steps"] < 3000
