"""An explicit method on a scene where its stability limits the steps: that is said before the time is spent, with a faster method."""

from __future__ import annotations

import warnings
from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS, Program

FIG3 = INPUTS / "fig3.nml"
SLOW = ("--set", "scene.model=low_frequency")
SMALL = ("--set", "system.misalignment_deg=0.05")


def notes(program: Program, *arguments: object) -> list[str]:
    return [line for line in program("check", *arguments, status=0).stderr.splitlines() if "stable only" in line]


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
def test_a_stiff_scene_has_a_note(method: str, program: Program, tmp_path: Path) -> None:
    found = notes(program, FIG3, *SMALL, "--set", f"integrator.method={method}")
    assert len(found) == (method == "dopri5")
    assert all("radau13" in note and "rodas4p" not in note for note in found)
    deck = tmp_path / "sweep.nml"
    deck.write_text(FIG3.read_text() + "&sweep parameter='system.misalignment_deg' first=1.0 last=8.0 count=2000 /\n")
    (note,) = notes(program, deck, *SLOW, "--set", f"integrator.method={method}")
    assert "2000 cases" in note and "rodas4p" in note


@pytest.mark.parametrize("more", [(), SMALL, SLOW, ("--set", "integrator.method=dopri5"), (*SMALL, "--set", "scene.t_end=1e-3")])
def test_others_have_none(more: tuple[str, ...], program: Program) -> None:
    assert notes(program, FIG3, *more) == []


def test_the_least_number_of_steps_is_near_the_true_one() -> None:
    """Where the object creeps once: friction is constant."""
    change = {
        "scene": {"model": "low_frequency"},
        "friction": {"mu_inf": 0.2},
        "integrator": {"method": "dopri5"},
        "velocity": 3e-4,
    }
    with pytest.warns(ds.StiffnessWarning, match="at least 1.8e6 steps") as caught:
        result = ds.run(FIG3, **change)
    assert caught[0].filename == __file__
    assert 0.9 < result.statistics["steps"] / 1.8e6 < 1.2


def test_sweeps_warn() -> None:
    change = {"scene": {"model": "low_frequency", "t_end": 1e-2}, "integrator": {"method": "dopri5"}}
    with warnings.catch_warnings():
        warnings.simplefilter("error", ds.StiffnessWarning)
        ds.sweep(FIG3, {"misalignment_deg": [1.0, 2.0]}, **change)
    with pytest.warns(ds.StiffnessWarning, match="in each of 2000 cases"):
        ds.sweep(FIG3, {"misalignment_deg": np.linspace(60.0, 80.0, 2000)}, **change)
