"""Dampers beside the springs: `system.damping_x` and `damping_y`.

Equations and the end of slip: tests/unit/test_models.f90; random scenes, with ramps and jumps, against another program: tests/audit.
"""

from __future__ import annotations

import math

import dynstiction as ds
import fig3
import numpy as np
import pytest
from numpy.typing import NDArray
from programs import ROOT
from scipy.integrate import simpson
from scipy.optimize import brentq

IMPLICIT = ["radau5", "radau9", "radau13"]
EXPLICIT = ["dopri5", "dop853"]
ADAPTIVE = [*IMPLICIT, *EXPLICIT]

Vector = NDArray[np.float64]


def scene(*changes: fig3.Groups, model: str = "full", method: str = "radau13", rtol: float = 1e-10, t_end: float = 1.0) -> ds.Scene:
    """The apparatus of Fig. 3 from rest, changed."""
    return ds.Scene(
        **fig3.changed(
            fig3.slider(),
            {
                "scene": {"model": model, "t_end": t_end},
                "integrator": {"method": method, "rtol": rtol},
                "output": {"interval": 1e-3},
            },
            *changes,
        )
    )


def oscillator(t: Vector, u_0: float, mass: float, stiffness: float, damping: float) -> Vector:
    """u(t) of m u'' + c u' + k u = 0 from rest at u_0."""
    roots = np.roots([mass, damping, stiffness]).astype(complex)
    a = u_0 * roots[1] / (roots[1] - roots[0])
    return np.real(a * np.exp(roots[0] * t) + (u_0 - a) * np.exp(roots[1] * t))


@pytest.mark.parametrize("method", ADAPTIVE)
@pytest.mark.parametrize(("damping_x", "damping_y"), [(0.7, 0.0), (0.0, 3.0), (2.0, 5.0), (40.0, 2.0)])
def test_free_decay(method: str, damping_x: float, damping_y: float) -> None:
    """A spring that is let go without friction and drive: every sample of two free oscillations, from below to above the critical
    damping, 31.6 and 63.2 N s/m.
    """
    system = {"stiffness_y": 4e3, "misalignment_deg": 20.0, "damping_x": damping_x, "damping_y": damping_y}
    changes = {"friction": {**fig3.CONSTANT, "mu_0": 0.0}, "drive": {"velocity": 0.0}}
    initial = {"elongation_x": 1e-3, "elongation_y": 5e-4}
    result = ds.run(scene({"system": system, **changes, "initial": initial}, method=method, rtol=1e-11, t_end=0.5))
    for name, u_0, k, c in (("u_x", 1e-3, 1e3, damping_x), ("u_y", 5e-4, 4e3, damping_y)):
        expected = oscillator(result.time, u_0, 0.25, k, c)
        np.testing.assert_allclose(result[name], expected, rtol=0, atol=1e-8 * u_0)


MODELS = [
    *(("full", {}, method) for method in [*IMPLICIT, *EXPLICIT]),
    *(("full", {"contact": "smoothed", "v_smooth": 1e-5}, method) for method in ("radau9", "dop853")),
    ("full", {"contact": "smoothed", "v_smooth": 1e-2}, "rk4"),
    *(("low_frequency", {}, method) for method in ("radau9", "dopri5")),
    *(("high_frequency", {}, method) for method in ("radau9", "dop853")),
]


def as_far_as_it_goes(given: ds.Scene) -> ds.Result:
    """A run, or what there is of one that takes too many steps."""
    try:
        return ds.run(given)
    except ds.SolverError as error:
        assert "max_steps" in str(error)
        return error.result


@pytest.mark.parametrize("method", ["radau13", "dopri5"])
def test_works_are_those_of_the_samples(method: str) -> None:
    """In slip, at rest, and in stops that are finished in closed form: the balance has what dampers take on both sides, and would not
    tell.
    """
    fig3 = ds.Scene(ROOT / "inputs" / "fig3.nml").replace(system={"damping_x": 3.0, "damping_y": 40.0})
    run = ds.run(
        fig3,
        scene={"t_end": 2.5},
        integrator={"rtol": 1e-9, "method": method},
        output={"interval": 1e-5, "fields": ["w_x", "w_y", "sticking", "friction", "pull_force"]},
    )
    assert run["sticking"].mean() > 0.03
    phi = np.radians(1.0)
    power = {
        "damper_work": 3.0 * (1e-3 * np.cos(phi) - run["w_x"]) ** 2 + 40.0 * (1e-3 * np.sin(phi) - run["w_y"]) ** 2,
        "friction_work": run["friction"] * np.hypot(run["w_x"], run["w_y"]),
        "drive_work": 1e-3 * run["pull_force"],
    }
    for name, values in power.items():
        assert run.summary[name] == pytest.approx(simpson(values, x=run.time), rel=1e-7), name


@pytest.mark.parametrize(("model", "contact", "method"), MODELS)
def test_energy_balance(model: str, contact: dict[str, object], method: str) -> None:
    """What the drive gives is what friction and the dampers take and what is stored: random scenes, from below to above the
    critical damping, under drives that hold, ramp, jump and reverse.
    """
    random = np.random.default_rng(20)
    done = 0
    for _ in range(12):
        k_x, m = np.exp(random.uniform(np.log([1e2, 0.05]), np.log([1e4, 1.0])))
        k_y = k_x * math.exp(random.uniform(0.0, math.log(1e2)))
        ratios = np.exp(random.uniform(np.log(1e-2), np.log(5.0), 2)) * random.choice([0.0, 1.0], 2)
        velocity = math.exp(random.uniform(math.log(1e-3), math.log(3e-2)))
        phi, load = random.uniform(0.0, 90.0), random.uniform(1.0, 4.0)
        t_end = 4.0 * load / k_x / velocity
        times, shares = [
            ([0.0], [1.0]),
            ([0.0, 0.3, 0.6], [0.0, 1.0, -1.0]),
            ([0.0, 0.5, 0.5, 0.7], [1.0, 1.0, -1.0, 0.0]),
            ([0.0, 0.4, 0.4, 0.6, 0.6], [0.0, 0.0, 1.0, 1.0, 3.0]),
        ][random.integers(4)]
        damping = 2.0 * np.sqrt(np.array([k_x, k_y]) * m) * ratios
        system: dict[str, object] = {
            "mass": m, "stiffness_x": k_x, "stiffness_y": k_y, "misalignment_deg": phi,
            "damping_x": damping[0], "damping_y": damping[1],
        }  # fmt: skip
        if model == "low_frequency":
            system |= {"stiffness_y": None, "damping_y": None}
        if model == "high_frequency":
            system |= {"damping_x": None}
        fixed = {"rtol": None, "step": t_end / 20000} if method == "rk4" else {}
        result = as_far_as_it_goes(
            scene(
                {
                    "system": system,
                    "friction": {"mu_0": load / 10.0, "mu_inf": load / 14.0, **contact},
                    "drive": {"time": [t * t_end for t in times], "velocity": [v * velocity for v in shares]},
                    "integrator": {"max_steps": 40000, **fixed},
                    "output": {"interval": t_end / 50.0},
                },
                model=model,
                method=method,
                rtol=1e-7,
                t_end=t_end,
            )
        )
        used = damping[0] if model == "low_frequency" else damping[1] if model == "high_frequency" else damping.sum()
        assert ("damper_work" in result.summary) == (used > 0.0)
        done += result.summary.get("damper_work", 0.0) > 0.0
        assert abs(result.summary["energy_residual"]) < 1e-7
    assert done >= 3


def linear(parameters: dict[str, float]) -> NDArray[np.complex128]:
    """Eigenvalues of steady sliding from the Jacobian, written again."""
    p = parameters
    angle = math.radians(p["misalignment_deg"])
    s = np.array([math.cos(angle), math.sin(angle)])
    n = np.array([-s[1], s[0]])
    drop = p["normal_load"] * (p["mu_0"] - p["mu_inf"]) * math.exp(-p["velocity"] / p["v_f"])
    friction = p["normal_load"] * p["mu_inf"] + drop
    damping = np.diag([p["damping_x"], p["damping_y"]]) - drop / p["v_f"] * np.outer(s, s)
    damping += friction / p["velocity"] * np.outer(n, n)
    stiffness = np.diag([p["stiffness_x"], p["stiffness_y"]])
    upper = np.hstack([np.zeros((2, 2)), np.eye(2)])
    return np.linalg.eigvals(np.vstack([upper, np.hstack([-stiffness, -damping]) / p["mass"]]))


def random_slider(random: np.random.Generator) -> dict[str, float]:
    def spread(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    p = {"mass": spread(1e-2, 10), "stiffness_x": spread(10, 1e4), "mu_0": 0.3, "mu_inf": spread(0.01, 0.29)}
    p |= {"v_f": spread(1e-3, 0.1), "normal_load": spread(0.1, 100), "misalignment_deg": float(random.uniform(0, 90))}
    p |= {"stiffness_y": p["stiffness_x"] * spread(1e-2, 1e3), "velocity": p["v_f"] * spread(1e-2, 5)}
    slope = p["normal_load"] * (p["mu_0"] - p["mu_inf"]) / p["v_f"] * math.exp(-p["velocity"] / p["v_f"])
    p |= {"damping_x": slope * spread(1e-3, 3), "damping_y": slope * spread(1e-3, 10)}
    p[("damping_x", "damping_y", "misalignment_deg")[random.integers(3)]] = 0.0
    return p


def test_steady_sliding() -> None:
    """Eigenvalues, critical angles and the stable window of random sliders against numpy's eigenvalues."""
    random = np.random.default_rng(5)
    branches = [0, 0, 0]
    for _ in range(200):
        p = random_slider(random)

        def growth(angle: float, p: dict[str, float] = p) -> float:
            return float(linear({**p, "misalignment_deg": angle}).real.max())

        expected = linear(p)
        found = ds.steady_sliding_eigenvalues(**p)
        assert np.abs(found[:, None] - expected).min(axis=0).max() < 1e-12 * np.abs(expected).max()
        critical = ds.critical_misalignment(**p)
        angles = critical.angle[np.isfinite(critical.angle)]
        branches[angles.size] += 1
        grid = np.linspace(1e-4, 90 - 1e-4, 60)
        values = np.array([growth(angle) for angle in grid])
        for low, high in zip(*(grid[np.nonzero(values[1:] * values[:-1] < 0.0)[0] + i] for i in (0, 1)), strict=True):
            assert np.count_nonzero((angles > low) & (angles < high)) == 1
        for angle in angles:
            exact = brentq(growth, angle * (1 - 1e-5), min(angle * (1 + 1e-5), 90), xtol=1e-15, rtol=1e-13)
            assert angle == pytest.approx(exact, rel=1e-10)
        clear = np.abs(values) > 1e-9 * np.abs(expected).max()
        inside = (critical.window[0] < grid) & (grid < critical.window[1])
        np.testing.assert_array_equal(inside[clear], values[clear] < 0.0)
    assert min(branches) > 20


def test_rigid_limit() -> None:
    """The angle of the slow mode for a rigid stiff axis, tan^2 = -(F' + c_x)/(F/V + c_x)."""
    p = {**fig3.SLIDER, "damping_x": 1.0, "damping_y": 0.0, "stiffness_y": 1e14}
    critical = ds.critical_misalignment(**p)
    assert critical.angle[0] == pytest.approx(critical.limit, rel=1e-6)
    assert critical.limit < ds.critical_misalignment(**fig3.SLIDER).limit


def test_equations() -> None:
    """The right-hand side and its Jacobian with dampers."""
    p = {**fig3.SLIDER, "stiffness_y": 4e3, "v_smooth": 1e-3}
    state = np.array([1e-3, -2e-4, 3e-3, 2e-3])
    damping = np.array([3.0, 7.0])
    extension = p["velocity"] * np.array([math.cos(math.radians(1.0)), math.sin(math.radians(1.0))]) - state[2:]
    more = ds.rhs(state, **p, damping_x=damping[0], damping_y=damping[1]) - ds.rhs(state, **p)
    np.testing.assert_allclose(more, [0.0, 0.0, *(damping * extension / p["mass"])], rtol=1e-12)
    more = ds.jacobian(state, **p, damping_x=damping[0], damping_y=damping[1]) - ds.jacobian(state, **p)
    np.testing.assert_allclose(more, np.diag([0.0, 0.0, *(-damping / p["mass"])]), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("method", ADAPTIVE)
def test_release_at_a_jump(method: str) -> None:
    """A jump of V by 20 mm/s loads the damper by 2.4 N at once, beyond the static limit of 2 N: the object sets off with the
    acceleration that is left; a jump back stops the pull.
    """
    given = scene(
        {
            "system": {"damping_x": 120.0, "stiffness_y": 4e3},
            "drive": {"time": [0.0, 0.1, 0.1], "velocity": [1e-4, 1e-4, 2.01e-2]},
            "output": {"interval": 1e-5},
        },
        method=method,
        t_end=0.101,
    )
    result = ds.run(given)
    slips = result.events["time"][result.events["kind"] == 2]
    assert slips[0] == 0.1
    at = np.searchsorted(result.time, 0.1)
    phi = math.radians(1.0)
    pull = np.hypot(*((np.array([1e3, 4e3]) * 1e-5 + np.array([120.0 * 2.01e-2, 0.0])) * [math.cos(phi), math.sin(phi)]))
    acceleration = (pull - 2.0) / 0.25
    speed = np.hypot(result["w_x"], result["w_y"])
    assert speed[at + 1] / 1e-5 == pytest.approx(acceleration, rel=1e-2)
    assert abs(result.summary["energy_residual"]) < 1e-9


def test_friction_at_rest_balances_the_dampers() -> None:
    result = ds.run(scene({"system": {"damping_x": 50.0, "stiffness_y": 4e3}, "drive": {"velocity": 1e-2}}, t_end=0.05))
    sticks = result["sticking"] == 1
    phi = math.radians(1.0)
    x = result["spring_force_x"] + 50.0 * 1e-2 * math.cos(phi)
    np.testing.assert_allclose(result["friction"][sticks], np.hypot(x, result["spring_force_y"])[sticks], rtol=1e-13)
    np.testing.assert_allclose(result["spring_force_x"], 1e3 * result["u_x"], rtol=1e-15)


@pytest.mark.parametrize("method", ["radau13", "dop853"])
def test_zero_is_as_absent(method: str) -> None:
    """Damping 0 changes no bit, and the cycle map leaps as before."""
    fixed = {"rtol": 1e-8}
    with_it, without = (
        ds.run(scene({"system": damping, "integrator": fixed}, method=method, t_end=1.2))
        for damping in ({"damping_x": 0.0, "damping_y": 0.0}, {})
    )
    for name in without:
        np.testing.assert_array_equal(with_it[name], without[name])
    assert dict(with_it.summary) == dict(without.summary)
    assert {**with_it.statistics, "wall_time": 0} == {**without.statistics, "wall_time": 0}
    assert "damper_work" not in without.summary


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"scene": {"model": "creep"}, "system": {"damping_x": 1.0}}, "damping_x"),
        ({"scene": {"model": "high_frequency"}, "system": {"damping_x": 1.0}}, "damping_x"),
        ({"scene": {"model": "low_frequency"}, "system": {"damping_y": 1.0}}, "damping_y"),
        ({"scene": {"model": "low_frequency"}, "system": {"damping_x": 1.0}, "integrator": {"method": "rodas4p"}}, "damping_x"),
        ({"system": {"damping_x": -1.0}}, "damping_x"),
    ],
)
def test_refused_by_name(change: fig3.Groups, key: str) -> None:
    given = scene(change)
    with pytest.raises(ds.DeckError, match=key):
        given.check()


def test_a_sweep_of_damping() -> None:
    """Cases with and without dampers in one sweep; the damped ones say what the dampers took."""
    table = ds.sweep(scene(method="radau9", rtol=1e-7, t_end=0.3), {"system.damping_y": [0.0, 100.0, 4000.0]})
    work = np.asarray(table["damper_work"])
    assert np.isnan(work[0])
    assert np.all(work[1:] > 0.0)
    assert np.all(np.abs(table["energy_residual"]) < 1e-8)
