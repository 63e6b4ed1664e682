"""The derivatives of a settled cycle obey units, and agree with cycles of changed scenes."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS, Program

FIG3 = ds.Scene(INPUTS / "fig3.nml")
SCENES = {
    "Fig. 3": {},
    "dampers and a static limit, backwards": {
        "system": {"damping_x": 0.3, "damping_y": 20.0, "misalignment_deg": -3.0},
        "friction": {"mu_static": 0.21},
        "drive": {"velocity": -2e-3},
    },
    "few sticks": {"system": {"stiffness_y": 1e6, "misalignment_deg": 6.0}, "drive": {"velocity": 1e-2}},
    "four slow cycles": {"system": {"stiffness_y": 4e5, "misalignment_deg": 5.0}, "drive": {"velocity": 5e-3}},
    "Stribeck": {"friction": {"law": "stribeck", "exponent": 1.5}},
}
MASS, LENGTH, TIME = np.eye(3)
FORCE = MASS + LENGTH - 2.0 * TIME
UNITS = {
    "system.mass": MASS,
    "system.stiffness_x": FORCE - LENGTH,
    "system.stiffness_y": FORCE - LENGTH,
    "system.damping_x": FORCE - LENGTH + TIME,
    "system.damping_y": FORCE - LENGTH + TIME,
    "friction.normal_load": FORCE,
    "friction.v_f": LENGTH - TIME,
    "drive.velocity": LENGTH - TIME,
}


def settled(scene: ds.Scene) -> np.ndarray:
    """Measures of the cycle to which it settles."""
    cycle = ds.cycles(scene).stable[-1]
    return np.array(cycle[:6])


@pytest.mark.parametrize("name", SCENES)
def test_physics_does_not_hang_on_units(name: str) -> None:
    """If mass, length and time are counted in other units, every number changes by its own powers of them."""
    found = ds.sensitivity(FIG3.replace(**SCENES[name]))
    powers = np.array([UNITS.get(key, np.zeros(3)) for key in found.parameters])
    assert np.all(np.abs(found.elasticities) < 100.0)
    expected = [TIME, FORCE, FORCE, TIME, TIME, LENGTH]
    np.testing.assert_allclose(found.elasticities @ powers, expected, rtol=0.0, atol=3e-6)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("Fig. 3", "system.misalignment_deg"),
        ("Fig. 3", "friction.mu_0"),
        ("dampers and a static limit, backwards", "drive.velocity"),
        ("dampers and a static limit, backwards", "system.damping_y"),
        ("few sticks", "friction.mu_inf"),
        ("four slow cycles", "friction.v_f"),
        ("Stribeck", "friction.exponent"),
    ],
)
def test_derivatives_are_those_of_the_cycle(name: str, key: str) -> None:
    scene = FIG3.replace(**SCENES[name])
    found = ds.sensitivity(scene, key)
    group, short = key.split(".")
    value = found.parameters[key]
    near = [settled(scene.replace(**{group: {short: value * (1.0 + change)}})) for change in (-1e-6, 1e-6)]
    measures = np.array([*found.cycle.values()])
    np.testing.assert_allclose(measures, settled(scene), rtol=1e-9)
    difference = (near[1] - near[0]) / 2e-6 / measures
    np.testing.assert_allclose(found.elasticities[:, 0], difference, rtol=1e-5, atol=1e-5)


def test_parameters() -> None:
    """By name with or without its group; by default all that the deck gives."""
    every = ds.sensitivity(FIG3)
    two = ds.sensitivity(FIG3, ["mass", "friction.v_f"])
    assert [*two.parameters.items()] == [("system.mass", 0.25), ("friction.v_f", 0.01)]
    assert set(every.parameters) == {
        "system.mass",
        "system.stiffness_x",
        "system.stiffness_y",
        "system.misalignment_deg",
        "friction.mu_0",
        "friction.mu_inf",
        "friction.v_f",
        "friction.normal_load",
        "drive.velocity",
    }
    places = [[*every.parameters].index(key) for key in two.parameters]
    np.testing.assert_array_equal(two.derivatives, every.derivatives[:, places])
    assert len(str(every).splitlines()) == 1 + len(every.parameters)


@pytest.mark.parametrize(
    ("groups", "key", "kind"),
    [
        ({"system": {"stiffness_y": 1e6}}, "mass", ds.UsageError),
        ({}, "damping_y", ds.UsageError),
        ({}, "scene.t_end", ds.UsageError),
        ({}, "method", ds.UsageError),
        ({}, "mas", ds.DeckError),
        ({"friction": {"contact": "smoothed", "v_smooth": 1e-6}}, "mass", ds.DeckError),
        ({"drive": {"velocity": 0.5}}, "mass", ds.UsageError),
    ],
)
def test_what_has_no_derivative_is_refused(groups: dict, key: str, kind: type[ds.Error]) -> None:
    with pytest.raises(kind):
        ds.sensitivity(FIG3.replace(**groups), key)


@pytest.mark.deck
def test_the_command_says_the_same(executable: str, tmp_path) -> None:
    keys = ["system.mass", "drive.velocity"]
    done = Program((executable,), tmp_path)("cycles", INPUTS / "fig3.nml", "--sensitivity", ",".join(keys))
    rows = [line.split() for line in done.stdout.splitlines() if line.split()[:1] in ([key] for key in keys)]
    assert [row[0] for row in rows] == keys
    found = ds.sensitivity(FIG3, keys)
    np.testing.assert_allclose(np.array([row[1:] for row in rows], float).T, found.elasticities, atol=1e-4)


def test_figure() -> None:
    pytest.importorskip("matplotlib")
    found = ds.sensitivity(FIG3)
    figure = ds.plot(found)
    assert len(figure.axes) == len(found.cycle)
    for axis, changes in zip(figure.axes, found.elasticities, strict=True):
        assert [bar.get_width() for bar in axis.patches] == list(changes)
    with pytest.raises(ds.UsageError):
        ds.plot(found, "map")
