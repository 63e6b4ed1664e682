"""A static limit that ages: rest ends where the force reaches the limit of its age."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS

FIG3 = ds.Scene(INPUTS / "fig3.nml").replace(integrator={"rtol": 1e-9})
B, T_0 = 0.02, 0.05
AGED = FIG3.replace(friction={"ageing": B, "ageing_time": T_0})
STICK, SLIP = 1, 2


def rests(scene: ds.Scene) -> tuple[np.ndarray, np.ndarray]:
    """How long each rest lasted [s], and the force with which it ended [N]."""
    events = ds.run(scene, output={"interval": 1.0}).events
    slips = np.flatnonzero(events["kind"] == SLIP)
    slips = slips[slips > 0]
    begun = np.array([events["time"][k - 1] if events["kind"][k - 1] == STICK else 0.0 for k in slips])
    ended = events["time"][slips]
    fields = ["spring_force_x", "spring_force_y"]
    there = ds.run(scene, times=ended, output={"fields": fields})
    return ended - begun, np.hypot(*(there[name] for name in fields))


@pytest.mark.parametrize(
    "groups",
    [
        {"system": {"misalignment_deg": 0.0}, "scene": {"t_end": 20.0}},
        {"system": {"misalignment_deg": 5.0, "stiffness_y": 1e5}, "scene": {"t_end": 2.0}},
        {"system": {"misalignment_deg": 0.0}, "friction": {"mu_static": 0.23}, "drive": {"velocity": -2e-3}},
        {"system": {"misalignment_deg": 0.0}, "drive": {"time": (0.0, 5.0), "velocity": (5e-4, 2e-3)}},
        {"system": {"misalignment_deg": 2.0, "stiffness_y": 1e6}, "integrator": {"method": "dopri5"}, "scene": {"t_end": 1.0}},
    ],
    ids=["in a line", "in the plane", "backwards, above a static limit", "a ramp", "explicit"],
)
@pytest.mark.filterwarnings("ignore::dynstiction.SamplingWarning")
def test_rest_ends_at_the_limit_of_its_age(groups: dict[str, dict[str, object]]) -> None:
    scene = AGED.replace(**groups)
    age, force = rests(scene)
    static = max(0.2, float(scene.friction.mu_static or 0.0))
    assert age.size >= 3
    np.testing.assert_allclose(force, 10.0 * (static + B * np.log1p(age / T_0)), rtol=1e-10)


def test_a_hold_strengthens_the_contact() -> None:
    """Slide, hold, slide: the force that ends a hold grows by b W in a hold that is longer by a factor of e."""
    limits = []
    for hold in (100.0, 1000.0, 10000.0):
        drive = {"time": (0.0, 5.0, 5.0, 5.0 + hold, 5.0 + hold), "velocity": (1e-3, 1e-3, 0.0, 0.0, 1e-3)}
        scene = AGED.replace(system={"misalignment_deg": 0.0}, drive=drive, scene={"t_end": 9.0 + hold})
        age, force = rests(scene)
        longest = int(np.argmax(age))
        assert age[longest] > hold
        limits.append(force[longest])
    np.testing.assert_allclose(np.diff(limits), 10.0 * B * np.log(10.0), rtol=0.03)


def test_what_does_not_age_is_as_before() -> None:
    plain, none = ds.run(FIG3), ds.run(FIG3, friction={"ageing": 0.0, "ageing_time": 0.1})
    np.testing.assert_array_equal(plain["u_x"], none["u_x"])


def test_cycles_are_refused() -> None:
    with pytest.raises(ds.DeckError, match=r"friction\.ageing: .* remove ageing"):
        ds.cycles(AGED)
    with pytest.raises(ds.DeckError, match="ageing"):
        ds.run(AGED, scene={"model": "low_frequency"})
    chosen = ds.run(AGED.replace(scene={"model": "auto", "t_end": 0.1}))
    assert ds.Scene(chosen.deck).scene.model == "full"
