"""The equations as SciPy takes them, and functions of the linear theory that take a scene."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from fig3 import SLIDER
from programs import Program
from scipy.integrate import solve_ivp


@pytest.mark.parametrize("changes", [{}, {"damping_x": 0.5, "damping_y": 20.0}, {"velocity": -2e-3, "misalignment_deg": 8.0}])
def test_scipy_gets_the_run(changes: dict[str, float], fig3: ds.Scene) -> None:
    """The motion of the smoothed contact with a program that is not ours."""
    names = ("u_x", "u_y", "w_x", "w_y")
    result = ds.run(fig3, t_end=0.004, contact="smoothed", v_smooth=1e-6, rtol=1e-11, elongation_x=1e-5, **changes)
    given = {**SLIDER, **changes, "v_smooth": 1e-6}
    begin = [result[name][0] for name in names]
    found = solve_ivp(
        lambda _, y: ds.rhs(y, **given),
        (0.0, 0.004),
        begin,
        "Radau",
        jac=lambda _, y: ds.jacobian(y, **given),
        rtol=1e-9,
        atol=1e-15,
    )
    np.testing.assert_allclose(found.y[:, -1], [result[name][-1] for name in names], rtol=2e-5, atol=1e-12)


def test_equations_of_a_scene(fig3: ds.Scene) -> None:
    states = np.random.default_rng(3).uniform(0.1, 1.0, (5, 4)) * [1e-3, 1e-6, 1e-3, 1e-3]
    np.testing.assert_array_equal(ds.rhs(states, fig3), ds.rhs(states, **SLIDER))
    np.testing.assert_array_equal(ds.jacobian(states, fig3, velocity=2e-3), ds.jacobian(states, **{**SLIDER, "velocity": 2e-3}))
    with pytest.raises(ds.UsageError, match="w = 0"):
        ds.rhs(np.zeros(4), fig3)
    table = fig3.replace(law="table", mu_0=None, mu_inf=None, v_f=None, table_speed=[0.0, 1.0], table_mu=[0.2, 0.1])
    with pytest.raises(ds.UsageError, match="law = 'table'"):
        ds.rhs(states, table)


# Linear theory of a scene

THEORY = {
    "steady_sliding_eigenvalues": (ds.steady_sliding_eigenvalues, ()),
    "critical_misalignment": (ds.critical_misalignment, ()),
    "creep_end": (ds.creep_end, ()),
    "damping_ratio": (ds.damping_ratio, (0.3,)),
}


def assert_close(found: object, expected: object, rtol: float = 1e-9) -> None:
    """Arrays, or tuples of them."""
    for ours, theirs in zip(*(value if isinstance(value, tuple) else (value,) for value in (found, expected)), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=rtol)


@pytest.mark.parametrize("name", THEORY)
def test_theory_takes_a_scene(name: str, fig3: ds.Scene) -> None:
    function, arguments = THEORY[name]
    for scene in (fig3, fig3.text):
        assert_close(function(*arguments, scene), function(*arguments, **SLIDER))
    velocities = np.geomspace(1e-4, 1e-2, 5)
    expected = function(*arguments, **{**SLIDER, "velocity": velocities, "mass": 0.5})
    np.testing.assert_equal(function(*arguments, fig3, velocity=velocities, mass=0.5), expected)
    constant = fig3.replace(law="constant", mu_inf=None, v_f=None)
    parameters = {name: value for name, value in SLIDER.items() if name not in ("mu_inf", "v_f")}
    assert_close(function(*arguments, constant), function(*arguments, **parameters))


def test_other_friction_laws_have_their_linear_theory(fig3: ds.Scene) -> None:
    """Which depends on the force and its slope at V alone: here those of the weakening law."""
    speeds = np.linspace(0.0, 0.02, 401)
    mu = 0.15 + 0.05 * np.exp(-speeds / 0.01)
    table = fig3.replace(law="table", mu_0=None, mu_inf=None, v_f=None, table_speed=speeds, table_mu=mu)
    same = fig3.replace(law="stribeck", exponent=1.0)
    viscous = fig3.replace(law="stribeck", viscous=0.5)
    expected = ds.critical_misalignment(fig3)
    for scene, close in ((table, 1e-4), (same, 1e-10)):
        np.testing.assert_allclose(ds.critical_misalignment(scene).angle, expected.angle, rtol=close)
        np.testing.assert_allclose(ds.steady_sliding_eigenvalues(scene), ds.steady_sliding_eigenvalues(fig3), rtol=10 * close)
        assert scene.stability().stable is False
    assert ds.critical_misalignment(viscous).angle[0] < expected.angle[0]
    with pytest.raises(ds.UsageError, match=r"law = 'table': with keywords"):
        ds.critical_misalignment(table, velocity=[1e-3, 2e-3])


def test_dampers_and_smoothing_of_a_scene_count(fig3: ds.Scene) -> None:
    scene = fig3.replace(damping_x=1.0, damping_y=10.0, contact="smoothed", v_smooth=1e-4)
    expected = ds.steady_sliding_eigenvalues(**SLIDER, damping_x=1.0, damping_y=10.0, v_smooth=1e-4)
    np.testing.assert_array_equal(ds.steady_sliding_eigenvalues(scene), expected)
    assert not np.array_equal(expected, ds.steady_sliding_eigenvalues(fig3))


def test_a_missing_parameter_is_named(fig3: ds.Scene) -> None:
    with pytest.raises(ds.UsageError, match=r"^mass, velocity: not given: give a scene, or mass=…, velocity=…"):
        ds.steady_sliding_eigenvalues(**{name: value for name, value in SLIDER.items() if name not in ("mass", "velocity")})
    with pytest.raises(ds.UsageError, match=r"stiffness_y: not given, and not in the scene: give stiffness_y=…"):
        ds.steady_sliding_eigenvalues(fig3.replace(stiffness_y=None), mass=1.0)
    for call in (lambda scene: ds.critical_misalignment(scene, mass=1.0), ds.Scene.stability):
        with pytest.raises(ds.UsageError, match="holds no velocity but 0"):
            call(fig3.replace(velocity=0.0))
    assert ds.critical_misalignment(fig3.replace(velocity=0.0), velocity=1e-3).angle.shape == (2,)


@pytest.mark.parametrize(
    "profile", [([1e-3, 2e-3], [0.0, 1.0]), ([0.0, 0.0, 3e-3, 3e-3], [0.0, 1.0, 2.0, 3.0]), ([1e-3, -2e-3, -2e-3], [0.0, 1.0, 1.5])]
)
def test_the_velocity_is_that_of_the_command(profile: tuple[list[float], list[float]], fig3: ds.Scene, program: Program) -> None:
    velocity, time = profile
    scene = fig3.replace(velocity=velocity, time=time)
    (program.folder / "deck.nml").write_text(scene.to_deck())
    printed = program("stability", "deck.nml", status=0).stdout
    found = scene.stability()
    assert float(printed.partition("V = ")[2].split()[0]) == found.velocity
    assert_close(ds.critical_misalignment(scene, mass=0.25), ds.critical_misalignment(scene))
    assert_close(ds.rhs([1e-3, 1e-6, 1e-3, 1e-3], scene), ds.rhs([1e-3, 1e-6, 1e-3, 1e-3], scene, velocity=found.velocity))


@pytest.mark.parametrize(("angle", "stable"), [(1.0, False), (10.0, True), (-10.0, True)])
def test_stability_of_a_scene(angle: float, stable: bool, fig3: ds.Scene, program: Program) -> None:
    found = fig3.replace(misalignment_deg=angle).stability()
    assert found.stable is stable and found.velocity == 1e-3
    assert found.misalignment_deg == pytest.approx(angle, rel=1e-14)
    assert found.critical_misalignment_deg == pytest.approx(ds.critical_misalignment(**SLIDER).angle[0], rel=1e-12)
    assert f"phi = {angle:g} deg is {'stable' if stable else 'unstable'} (stable above 8.656 deg)" in str(found)
    (program.folder / "deck.nml").write_text(fig3.text)
    printed = program("stability", "deck.nml", settings=[f"system.misalignment_deg={angle}"], status=0).stdout
    assert ("not stable" in printed) is not stable
    constant = fig3.replace(law="constant", mu_inf=None, v_f=None).stability()
    assert constant.stable and constant.critical_misalignment_deg == 0.0
