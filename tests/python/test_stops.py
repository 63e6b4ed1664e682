"""Stops where v just reaches zero, on knots and between samples: the same number by every method, at their own times."""

import dynstiction as ds
import numpy as np
import pytest
from drives import distance
from fig3 import Groups, changed, slider

METHODS = ("radau5", "radau9", "radau13", "dopri5", "dop853")


def rig(mass: float, stiffness_x: float, stiffness_y: float, misalignment_deg: float, **friction: object) -> Groups:
    system = {"mass": mass, "stiffness_x": stiffness_x, "stiffness_y": stiffness_y, "misalignment_deg": misalignment_deg}
    return {"system": system, "friction": friction}


GRAZING = rig(0.003714626115048481, 228.00925659361542, 5675820473.863028, 23.786050600998433,
              law="constant", mu_0=0.3095310335744721, normal_load=5.2524214699351806)  # fmt: skip
"""v_min is some 1e-7 n of its largest value in the n-th oscillation: the object never stops again."""

FIG3 = slider()


def run(groups, t_end, velocity, method, rtol, *, time=None, interval=None, model="full", **initial):
    return ds.run(
        ds.Scene(
            **changed(groups, {"drive": {"velocity": velocity, "time": time}}),
            scene={"model": model, "t_end": t_end},
            initial={"velocity_ratio": 0.0, **initial},
            integrator={"method": method, "rtol": rtol},
            output={"interval": interval or t_end / 50, "fields": ["X", "u_x", "u_y", "w_x", "w_y", "sticking"]},
        )
    )


@pytest.mark.parametrize("method", METHODS)
def test_grazing_is_no_stick(method):
    for rtol in (1e-5, 1e-7, 1e-9) if method.startswith("d") else (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
        result = run(GRAZING, 0.00204057, 9.653523977595618e-5, method, rtol)
        assert list(result.events["kind"]) == [1, 2], rtol


TURNING = rig(0.10745644273827007, 323.3910021669124, 8780.331563208336, 0.0,
              law="weakening", normal_load=1.2306151123245448, mu_0=0.3287389544475471, mu_inf=0.025485580508520105,
              v_f=0.009912637626459492, mu_static=0.39811314478877635)  # fmt: skip
"""Slips swing back until the load is between mu_0 W and mu_static W."""


def turning(method, angle, rtol, **system):
    return ds.run(
        ds.Scene(
            **changed(TURNING, {"system": {"misalignment_deg": angle, **system}}),
            scene={"t_end": 11.8},
            drive={"velocity": -0.00075333},
            integrator={"method": method, "rtol": rtol},
            output={"interval": 0.002},
        )
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_turn_is_no_stop(method):
    """A slip that meets more than mu_0 W turns round and goes on, however nearly it is on a line."""
    for angle in (0.2, 0.01, 0.0003, 1e-7):
        exact = turning("radau13", angle, 1e-11)
        assert exact.summary["sticks"] == 13
        for rtol in (1e-4, 1e-6):
            found = turning(method, angle, rtol)
            assert found.summary["sticks"] == 13, (angle, rtol)
            assert np.abs(found["u_x"] - exact["u_x"]).max() < 100 * rtol * np.abs(exact["u_x"]).max(), (angle, rtol)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("angle", "stiffness_y"), [(0.0, 8780.0), (37.0, TURNING["system"]["stiffness_x"])])
def test_on_a_line_slip_stops(method, angle, stiffness_y):
    """Up to mu_static W: along a principal axis, or in any direction if the springs are equal."""
    for rtol in (1e-4, 1e-8):
        assert turning(method, angle, rtol, stiffness_y=stiffness_y).summary["sticks"] == 4


@pytest.mark.parametrize("ratio", [1 + 1e-6, 1.0, 1 - 1e-6])
def test_marginal_rest_is_the_same_for_all(ratio):
    """Friction that falls or rises by a millionth: the first oscillations all but stop."""
    groups = slider({"friction": {"mu_inf": 0.2 * ratio}})
    sticks = {run(groups, 0.05, 1e-3, method, rtol).summary["sticks"] for method in METHODS for rtol in (1e-7, 1e-9)}
    assert len(sticks) == 1


@pytest.mark.parametrize("method", ["radau9", "radau13", "dopri5"])
@pytest.mark.parametrize("angle", [0.1, 0.01])
def test_small_misalignment_with_an_explicit_method(angle, method):
    """The cut-off of the explicit methods scales with the motion: V sin(phi) is 1e-4 of V here."""
    groups = slider({"system": {"misalignment_deg": angle}})
    exact = run(groups, 1.0025, 1e-3, "radau13", 1e-12)
    found = run(groups, 1.0025, 1e-3, method, 1e-7)
    speed = np.hypot(exact["w_x"], exact["w_y"]).max()
    assert len(found.events) == len(exact.events)
    assert np.hypot(found["w_x"] - exact["w_x"], found["w_y"] - exact["w_y"]).max() < 30e-7 * speed


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
def test_slow_piece_of_a_profile(method):
    """The drive comes to rest between faster pieces; the last slip before that ends where it should."""
    groups = slider({"system": {"stiffness_x": 3e3, "stiffness_y": 3e6, "misalignment_deg": 3.0}})
    profile = {"time": (0.0, 0.1, 0.4, 0.5, 0.6, 0.9), "velocity": (0.0, 2e-3, 2e-3, 0.0, 0.0, -3e-3)}
    exact = run(groups, 1.2, **profile, method="radau13", rtol=1e-12)
    found = run(groups, 1.2, **profile, method=method, rtol=1e-6)
    assert len(found.events) == len(exact.events)
    assert np.abs(found.events["time"] - exact.events["time"]).max() < 1e-7


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13"])
def test_no_step_passes_a_knot(method, seed, rtol):
    """X = D - u.e to roundoff at every sample, with thousands of knots."""
    random = np.random.default_rng(seed)
    knots = np.sort(random.uniform(0, 0.5, 3000))
    time = np.concatenate([[0.0], knots, [0.5]])
    velocity = 1e-3 * (1 + 2 * random.standard_normal(time.size))
    result = run(FIG3, 0.5, tuple(velocity), method, rtol, time=tuple(time), interval=1e-3)
    driven = distance(velocity, time, result.time)
    along = np.cos(np.radians(1.0)), np.sin(np.radians(1.0))
    stretch = result["u_x"] * along[0] + result["u_y"] * along[1]
    assert np.abs(result["X"] - (driven - stretch)).max() < 1e-15


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("method", METHODS)
def test_samples_have_their_own_times(method, rtol):
    """Also within a stop that is finished in closed form."""
    result = run(FIG3, 4e-3, 1e-3, method, rtol, interval=1e-7, velocity_ratio=5.43)
    assert np.abs(result.time - 1e-7 * np.arange(result.time.size)).max() < 1e-17
    # And the states are those of the times: X' integrates to X.
    advance = np.diff(result["X"])
    along = np.cos(np.radians(1.0)), np.sin(np.radians(1.0))
    rate = result["w_x"] * along[0] + result["w_y"] * along[1]
    middle = 0.5e-7 * (rate[1:] + rate[:-1])
    assert np.abs(advance - middle).max() < 3e-3 * 1e-7 * np.abs(rate).max()


def test_redundant_knots_change_no_bit():
    """A knot on the line between its neighbours is none, in any model."""
    for model, angle in (("full", 1.0), ("low_frequency", 3.0)):
        stiff = {"stiffness_y": None} if model == "low_frequency" else {}
        groups = slider({"system": {"misalignment_deg": angle, **stiff}})
        one, other = (
            run(groups, 1.0, velocity, "radau9", 1e-6, time=time, interval=0.01, model=model)
            for time, velocity in (((0.0, 1.0), (1e-3, -1e-3)), ((0.0, 0.25, 0.5, 0.625, 1.0), (1e-3, 5e-4, 0.0, -2.5e-4, -1e-3)))
        )
        assert all((one[name] == other[name]).all() for name in ("u_x", "X", "w_x"))


def test_a_sample_before_a_turn_has_the_direction_of_then():
    """high_frequency turns at rest; the samples of the step before it had the direction of the turn."""
    scene = {
        **rig(5.382100394788668, 3013.2086563840994, 645059506.4899609, 11.546946635805254, law="weakening", mu_0=0.5723945693254295,
              mu_inf=0.0, v_f=0.0058009209613340855, normal_load=1.584501674454454),
        "scene": {"model": "high_frequency", "t_end": 0.211861},
        "drive": {"velocity": -0.05578183275032312},
        "initial": {"velocity_ratio": 0.0, "elongation_x": 8.332460781818993e-05},
        "output": {"interval": 0.00211861},
    }  # fmt: skip
    runs = [
        ds.run(ds.Scene(**scene, integrator={"method": method, "rtol": rtol}))
        for method, rtol in (("radau13", 1e-12), ("radau13", 1e-5), ("radau9", 1e-5))
    ]
    speed = np.abs(runs[0]["w_y"]).max()
    for result in runs[1:]:
        assert np.abs(result["w_y"] - runs[0]["w_y"]).max() < 1e-3 * speed


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("velocity_ratio", [-1.25, 3.0, 300.0])
@pytest.mark.parametrize(
    "friction",
    [
        {"law": "weakening", "mu_0": 0.6, "mu_inf": 0.8, "v_f": 5e-3},
        {"law": "weakening", "mu_0": 0.6, "mu_inf": 0.4, "v_f": 5e-3},
        {"law": "stribeck", "mu_0": 0.6, "mu_inf": 0.6, "v_f": 5e-3, "viscous": 5.0},
        {"law": "constant", "mu_0": 0.6},
    ],
    ids=str,
)
def test_a_start_in_motion_stops_after_its_kinetic_energy_is_spent(friction, velocity_ratio, method):
    """Springs hardly pull until then: the distance is that of the friction alone, whether it falls or rises with the speed."""
    mass, load, drive, rtol = 7e-4, 12.0, 7e-5, 1e-8
    result = run(rig(mass, 6.0, 10.0, 1.0, normal_load=load, **friction), 1e-3, drive, method, rtol, velocity_ratio=velocity_ratio)

    def force(v):
        if friction["law"] == "constant":
            return load * friction["mu_0"] + 0.0 * v
        fall = (friction["mu_0"] - friction["mu_inf"]) * np.exp(-v / friction["v_f"])
        return load * (friction["mu_inf"] + fall + friction.get("viscous", 0.0) * v)

    node, weight = np.polynomial.legendre.leggauss(30)
    begun = abs(velocity_ratio) * drive
    v = 0.5 * begun * (node + 1.0)
    way = 0.5 * begun * np.sum(weight * mass * v / force(v))
    assert result["X"][-1] == pytest.approx(np.sign(velocity_ratio) * way, rel=30 * rtol)
