"""The end of slow creep: the decay of the fast oscillation in runs, and the models that have it in the summary."""

import dynstiction as ds
import numpy as np
import pytest
from fig3 import SLIDER
from programs import INPUTS


def test_the_oscillation_of_a_run_decays_as_sigma_says() -> None:
    """Its amplitude in w_y, between 20 and 11 degrees: exp of the integral of sigma, times sin(theta)^(3/2), because the
    action of an oscillation with the mass m/sin(theta)^2 is kept while its frequency sqrt(k_y/m) sin(theta) falls.
    """
    run = ds.run(
        INPUTS / "fig3.nml",
        scene={"t_end": 2.0},
        integrator={"rtol": 1e-10},
        output={"interval": 1e-5, "fields": ["w_y", "spring_force_x"]},
    )
    time, across = run.time, run["w_y"]
    inner = across[1:-1]
    tops = 1 + np.flatnonzero((inner > across[:-2]) & (inner >= across[2:]))
    bottoms = 1 + np.flatnonzero((inner < across[:-2]) & (inner <= across[2:]))
    amplitude = across[tops] - np.interp(time[tops], time[bottoms], across[bottoms])

    drift = SLIDER["velocity"] * np.sin(np.radians(SLIDER["misalignment_deg"]))

    def friction(theta: np.ndarray) -> np.ndarray:
        return 1.5 + 0.5 * np.exp(-drift / np.sin(theta) / 0.01)

    path = np.radians(np.linspace(89.9, 4.4, 40000))
    theta = np.interp(run["spring_force_x"][tops], friction(path) * np.cos(path), path)
    speed = drift / np.sin(theta)
    feeding = 50.0 * np.exp(-speed / 0.01) / 0.25
    sigma = 0.5 * (feeding - speed * 1e7 * np.cos(theta) ** 2 / friction(theta))
    degrees = np.degrees(theta)
    for above, below in ((20.0, 18.0), (18.0, 16.0), (16.0, 14.0), (14.0, 12.0), (12.0, 11.0)):
        first, last = (int(np.argmin(abs(degrees - angle))) for angle in (above, below))
        part = slice(first, last + 1)
        expected = np.trapezoid(sigma[part], time[tops][part]) + 1.5 * np.log(np.sin(theta[last]) / np.sin(theta[first]))
        assert np.log(amplitude[last] / amplitude[first]) == pytest.approx(expected, rel=0.02), (above, below)


# D by scipy.integrate.quad of -sigma dt over theta, and the angle [deg], to nine digits.
QUAD = [
    ({}, 10.3402141787, 4.31636334),
    ({"misalignment_deg": 3.0}, 88.588356007, 6.17845466),
    ({"misalignment_deg": 7.0}, 362.7067326, 8.09942293),
    ({"stiffness_y": 1e8}, 478.0391087, 4.31636334),
    ({"velocity": 2e-4}, 0.63966400569, 2.53550850),
]


@pytest.mark.parametrize(("change", "decay", "angle"), QUAD)
def test_decay_and_angle_are_those_of_another_quadrature(change: dict[str, float], decay: float, angle: float) -> None:
    end = ds.creep_end(**(SLIDER | change))
    assert end.decay == pytest.approx(decay, rel=1e-7)
    assert np.degrees(end.angle) == pytest.approx(angle, rel=1e-8)
    # The mirror images, and the drive backwards, have the same.
    mirrored = [change.get("misalignment_deg", 1.0) + turn for turn in (0.0, 180.0)] * np.array([[1.0], [-1.0]])
    for way in (1.0, -1.0):
        others = SLIDER | change | {"misalignment_deg": mirrored, "velocity": way * change.get("velocity", 1e-3)}
        np.testing.assert_allclose(ds.creep_end(**others).decay, end.decay, rtol=1e-13)


def test_random_sliders() -> None:
    """The load F(v) cos(theta) is largest at the end, and D is the integral of Eqs. (8) and (9) of the page on stability."""
    random = np.random.default_rng(20261123)
    ended = 0
    for _ in range(60):
        angle, k_y, m, velocity = np.exp(random.uniform(*np.log([[0.1, 1e6, 1e-3, 1e-5], [20.0, 1e9, 10.0, 1e-2]])))
        scene = SLIDER | {"misalignment_deg": angle, "stiffness_y": k_y, "mass": m, "velocity": velocity}
        end, phi = ds.creep_end(**scene), np.radians(angle)
        if np.isnan(end.decay):
            continue
        ended += 1
        edges = np.geomspace(end.angle, np.pi / 2, 60001)
        theta = np.sqrt(edges[1:] * edges[:-1])
        v, v_edge = (velocity * np.sin(phi) / np.sin(each) for each in (theta, edges))
        load = (1.5 + 0.5 * np.exp(-v_edge / 0.01)) * np.cos(edges)
        assert end.load == pytest.approx(load[0], rel=1e-12)
        assert load.argmax() == 0
        drop = 0.5 * np.exp(-v / 0.01)
        sigma = 0.5 * (drop / 0.01 / m - v * k_y * np.cos(theta) ** 2 / (1.5 + drop))
        parts = sigma * np.diff(load) * np.sin(theta) / (1e3 * velocity * np.sin(theta - phi))
        assert end.decay == pytest.approx(max(0.0, parts.cumsum().max()), rel=2e-6, abs=1e-8)
    assert ended > 35


def test_if_friction_falls_to_zero_creep_ends_far_from_the_soft_axis() -> None:
    """tan(theta)^2 = v/v_f."""
    end = ds.creep_end(**(SLIDER | {"misalignment_deg": 10.0, "stiffness_y": 1e9, "mu_inf": 0.0, "velocity": 0.12}))
    assert np.degrees(end.angle) > 45.0
    assert np.tan(end.angle) ** 2 == pytest.approx(end.speed / 0.01, rel=1e-9)


@pytest.mark.parametrize("change", [{}, {"misalignment_deg": 3.0}, {"stiffness_y": 1e6}, {"stiffness_y": 1e8}])
def test_the_summary_has_it(change: dict[str, float]) -> None:
    summary = ds.run(INPUTS / "fig3.nml", scene={"t_end": 0.01}, system=change, output={"interval": 0.01}).summary
    assert summary["fast_decay"] == pytest.approx(ds.creep_end(**(SLIDER | change)).decay, rel=1e-13)


@pytest.mark.parametrize(
    "change",
    [
        {"friction": {"law": "constant", "mu_inf": None, "v_f": None}},
        {"system": {"misalignment_deg": 0.0}},
        {"system": {"misalignment_deg": 9.0}},
        {"friction": {"contact": "smoothed", "v_smooth": 1e-6}},
        {"drive": {"time": [0.0, 1.0], "velocity": [1e-3, 2e-3]}},
        {"drive": {"velocity": 0.0}},
        {"scene": {"model": "low_frequency"}, "system": {"stiffness_y": None}},
        {"scene": {"model": "high_frequency"}},
    ],
    ids=str,
)
def test_scenes_without_it(change: dict[str, dict[str, object]]) -> None:
    groups = {"scene": {"t_end": 0.01}, "output": {"interval": 0.01}}
    for group, keys in change.items():
        groups[group] = {**groups.get(group, {}), **keys}
    assert "fast_decay" not in ds.run(INPUTS / "fig3.nml", **groups).summary


def test_arrays_of_scenes() -> None:
    """Broadcast, and NaN where creep does not end."""
    end = ds.creep_end(**(SLIDER | {"misalignment_deg": [1.0, 3.0, 9.0, 0.0], "stiffness_y": [[1e7], [1e8]]}))
    assert end.decay.shape == (2, 4)
    assert np.isnan(np.array(end)[:, :, 2:]).all()
    assert end.decay[0, :2] == pytest.approx([10.3402141787, 88.588356007], rel=1e-9)
    drift = SLIDER["velocity"] * np.sin(np.radians([1.0, 3.0]))
    np.testing.assert_allclose(end.speed[0, :2] * np.sin(end.angle[0, :2]), drift, rtol=1e-14)
