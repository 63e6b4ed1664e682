"""Where stick-slip begins and ends in numbers of a deck: on both sides of an end are motions of both kinds."""

from __future__ import annotations

import math
import warnings
from typing import Any

import dynstiction as ds
import numpy as np
import pytest
from dynstiction import ranges
from programs import INPUTS, Program
from scipy.optimize import brentq

FIG3 = ds.Scene(INPUTS / "fig3.nml")
SPEEDS = [0.0, 0.002, 0.005, 0.01, 0.02, 0.04, 0.08]
SCENES: dict[str, tuple[ds.Scene, str]] = {
    "misalignment": (FIG3, "system.misalignment_deg"),
    "damper": (FIG3, "system.damping_x"),
    "from sliding": (FIG3.replace(misalignment_deg=12.0), "system.misalignment_deg"),
    "table": (
        FIG3.replace(friction=ds.Friction(law="table", normal_load=10.0, table_speed=SPEEDS,
                                          table_mu=[0.15 + 0.05 * math.exp(-v / 0.01) for v in SPEEDS])),
        "system.misalignment_deg",
    ),
    "static limit": (FIG3.replace(mu_static=0.22), "system.damping_x"),
    "viscous": (FIG3.replace(friction=ds.Friction(law="stribeck", mu_0=0.2, mu_inf=0.15, v_f=0.01, exponent=1.0, viscous=0.5,
                                                  normal_load=10.0)), "friction.viscous"),
}  # fmt: skip


def swing(scene: ds.Scene, key: str, value: float) -> float:
    """Swing over F_0, by another method, tolerance and length than those of the search."""
    length = {"t_end": 120.0, "velocity_ratio": 0.0, "interval": 0.0, "fields": ["u_x"]}
    result = ds.run(scene.replace(**{key: value}), method="radau9", rtol=1e-8, **length)
    limit = float(result.parameters["mu_0"]) * float(result.parameters["normal_load"])
    return float(result.summary["swing"]) / limit


@pytest.mark.parametrize("name", SCENES)
def test_on_both_sides_of_an_end(name: str) -> None:
    scene, key = SCENES[name]
    found = ds.stick_slip_range(scene, key)
    (one,) = found.keys
    ends = [end for end in one.stick_slip if not math.isnan(end)]
    assert ends and found.has_stick_slip == (name != "from sliding")
    for end in ends:
        outwards = math.copysign(1e-3, end - one.value)
        inner, outer = (swing(scene, key, end * (1.0 + share * outwards)) >= 0.05 for share in (-1.0, 1.0))
        assert inner == found.has_stick_slip and outer != inner, end
    for end in (end for end in one.sliding if not math.isnan(end)):
        before, after = (np.max(ds.steady_sliding_eigenvalues(scene.replace(**{key: end * (1.0 + side * 2e-4)})).real) < 0.0
                         for side in (-1.0, 1.0))  # fmt: skip
        assert before != after


def test_sliding_ends_where_the_theory_says() -> None:
    one, two = ds.stick_slip_range(FIG3, "system.misalignment_deg,system.damping_x").keys
    assert one.sliding[1] == pytest.approx(ds.critical_misalignment(FIG3).angle[0], rel=1e-4)
    critical = brentq(lambda c: np.max(ds.steady_sliding_eigenvalues(FIG3.replace(damping_x=c)).real), 1.0, 100.0)
    assert two.sliding[1] == pytest.approx(critical, rel=1e-4)
    assert math.isnan(one.sliding[0]) and two.searched[0] == 0.0


def test_a_jump_is_told() -> None:
    """At 100 mm/s the swing of Fig. 3 falls from 130 % of F_0 to nothing at once."""
    found = ds.stick_slip_range(FIG3.replace(velocity=0.1), "system.misalignment_deg")
    (one,) = found.keys
    end = one.stick_slip[1]
    inner = swing(FIG3.replace(velocity=0.1), one.key, end * (1.0 - 1e-3))
    assert one.jumps == (False, True) and inner > 1.0 and "(jump)" in str(found)


@pytest.mark.parametrize(
    ("scene", "keys", "told"),
    [
        (FIG3, "friction.law", "no real number"),
        (FIG3, "system.weight", "GROUP.KEY"),
        (FIG3.replace(velocity=[1e-3, 1e-3, 2e-3, 2e-3], time=[0.0, 1.0, 1.0, 2.0]), "system.mass", "several velocities"),
        (INPUTS / "creep.nml", "system.mass", "model='full'"),
        (FIG3.replace(friction=ds.Friction(law="stribeck", mu_0=0.2, mu_inf=0.15, v_f=0.01, exponent=1.0, viscous=0.0,
                                           normal_load=10.0)), "friction.viscous", "give a small one"),
    ],
)  # fmt: skip
def test_wrong_use(scene: Any, keys: str, told: str) -> None:
    with pytest.raises(ds.UsageError, match=told):
        ds.stick_slip_range(scene, keys)


def test_a_value_that_the_solver_gives_up_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the ends of the search and between two values of which one has the change."""
    motion_of = ranges._Rig.motion

    def limited(self: Any, change: Any) -> Any:
        if 8.14 < change.get("system.misalignment_deg", 0.0) < 8.18:
            raise ds.SolverError("too many steps", 42)
        return motion_of(self, change)

    monkeypatch.setattr(ranges._Rig, "motion", limited)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (one,) = ds.stick_slip_range(FIG3, "Misalignment_deg").keys
    assert one.key == "system.misalignment_deg" and math.isnan(one.stick_slip[1]) and one.sliding[1] > 8.6


def test_the_command(program: Program) -> None:
    done = program("stability", INPUTS / "fig3.nml", "--key", "system.damping_x", "--set", "system.misalignment_deg=2", status=0)
    lines = done.stdout.splitlines()
    assert lines[0].startswith("at V = 0.001 m/s: stick-slip with a swing of 0.79") and lines[0].endswith("is not stable")
    assert lines[-1].startswith("system.damping_x [N s/m]") and "above" in lines[-1]
    assert "GROUP.KEY" in program("range", INPUTS / "fig3.nml", "--key", "friction.law", status=1).stderr
