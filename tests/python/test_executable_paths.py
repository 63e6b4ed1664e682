"""What a deck can bring about in the executable and no other test of it does: why 'auto' is the full model, scenes that are
refused when they are set up, faults of &sweep, a sweep that keeps its series, cases side by side.
"""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from programs import INPUTS

pytestmark = pytest.mark.deck

RK4 = ("friction.contact=smoothed", "friction.v_smooth=1e-5", "integrator.method=rk4", "integrator.step=1e-5", "integrator.rtol=")
# Settings on fig3.nml, and why the full model is taken.
OBSTACLES: dict[str, tuple[str, ...]] = {
    "the high-frequency motion alone costs as much": ("scene.quantities=high_frequency",),
    "the reduced models have the exact contact": RK4,
    "known only for a constant drive velocity": ("drive.velocity=0",),
    "known only for unstretched springs": ("initial.elongation_x=1e-6",),
    "known only for a slow start": ("initial.velocity_ratio=2",),
    "nothing to reduce": ("friction.normal_load=0",),
    "known only for 0 < |misalignment_deg| < 90": ("system.misalignment_deg=0",),
    "stiffness_y is below 300 stiffness_x": ("system.stiffness_y=1e5",),
    "not above stiffness_x/stiffness_y": ("system.misalignment_deg=1e-3",),
    "more than accuracy = ": ("scene.accuracy=1e-12",),
}


@pytest.mark.parametrize("reason", OBSTACLES)
def test_auto_says_why_it_is_the_full_model(program, tmp_path, reason):
    settings = ("scene.model=auto", "scene.t_end=1e-3", *OBSTACLES[reason])
    done = program("run", INPUTS / "fig3.nml", "-o", "x.h5", settings=settings, status=0)
    with h5py.File(tmp_path / "x.h5") as file:
        assert file.attrs["model"] == "full"
        assert file.attrs["model_choice"].startswith("full: ")
        assert reason in file.attrs["model_choice"]
        assert file.attrs["model_choice"] in done.stderr


def test_auto_takes_a_closed_form_of_creep(program, tmp_path):
    settings = ("scene.model=auto", "scene.quantities=creep", "scene.t_end=0.5", "scene.accuracy=0.05", "output.fields=X,u_x")
    program("run", INPUTS / "fig3_constant.nml", "-o", "x.h5", settings=settings, status=0)
    with h5py.File(tmp_path / "x.h5") as file:
        assert file.attrs["model"] in {"creep_asymptotic", "creep"}
        assert "(estimated), accuracy = " in file.attrs["model_choice"]


ABSENT = ("system.mass=", "friction.law=", "initial.velocity_ratio=", "integrator.method=", "integrator.rtol=")
REFUSED: dict[str, tuple[str, ...]] = {
    "does not give zeta": ("scene.model=creep", "output.fields=zeta", *ABSENT),
    "zeta has no value where V sin(phi) = 0": ("output.fields=zeta", "system.misalignment_deg=0"),
    "below the static limit": ("scene.model=high_frequency", "initial.elongation_x=1"),
    "closed form has no steps": ("scene.model=creep", "output.interval=0", *ABSENT),
}


@pytest.mark.parametrize("words", REFUSED)
def test_a_scene_that_cannot_be_set_up_is_refused(program, tmp_path, words):
    assert words in program("run", INPUTS / "fig3_constant.nml", "-o", "x.h5", settings=REFUSED[words], status=2).stderr
    assert not (tmp_path / "x.h5").exists()


LISTS = {"parameter": "'system.misalignment_deg', 'drive.velocity'", "first": "1.0, 1e-3", "last": "4.0, 4e-3", "count": "2, 3",
         "spacing": "'linear', 'log'"}  # fmt: skip
# What is put in the place of a list, and what the refusal says.
SWEEP_FAULTS: dict[str, tuple[str, str]] = {
    "1 value(s) of 'first' but 2 of 'parameter'": ("first", "1.0"),
    "3 value(s) of 'spacing' but 2": ("spacing", "'log', 'log', 'log'"),
    "both must have the same sign": ("first", "1.0, -1e-3"),
    "is no whole number": ("count", "2.5, 3"),
    "there is no key 'system.mas'": ("parameter", "'system.mas', 'drive.velocity'"),
    "there is no key 'mass'": ("parameter", "'mass', 'drive.velocity'"),
    "cannot be varied": ("parameter", "'scene.model', 'drive.velocity'"),
    "is not used with": ("parameter", "'integrator.step', 'drive.velocity'"),
    "is out of range": ("parameter", "'system.mass', 'system.stiffness_x'"),
    "cases": ("count", "100000, 100000"),
}  # fmt: skip


def sweep_deck(folder: Path, lists: dict[str, str], *more: str) -> str:
    group = "\n".join(["", "&sweep", *(f"  {key} = {value}" for key, value in lists.items()), *more, "/", ""])
    (folder / "map.nml").write_text((INPUTS / "low_frequency.nml").read_text() + group)
    return "map.nml"


@pytest.mark.parametrize("words", SWEEP_FAULTS)
def test_a_sweep_with_faults_is_refused(program, tmp_path, words):
    key, value = SWEEP_FAULTS[words]
    lists = LISTS | {key: value}
    if words == "is out of range":
        lists["first"] = "-1.0, 1e-3"
    assert words in program("run", sweep_deck(tmp_path, lists), "-o", "x.h5", status=2).stderr
    assert not list(tmp_path.glob("x.h5*"))


def test_a_sweep_keeps_its_series(program, tmp_path):
    """Each case has the samples that a run of its own gives."""
    short = ("scene.t_end=0.05", "output.fields=u_x,X_rate")
    deck = sweep_deck(tmp_path, LISTS, "  keep = 'series'")
    program("run", deck, "-o", "x.h5", "--quiet", settings=short, status=0)
    alone = ("system.misalignment_deg=4.0", "drive.velocity=2e-3")
    program("run", INPUTS / "low_frequency.nml", "-o", "one.h5", "--quiet", settings=(*short, *alone), status=0)
    with h5py.File(tmp_path / "x.h5") as file, h5py.File(tmp_path / "one.h5") as single:
        assert file["sweep/drive.velocity"][:] == pytest.approx([1e-3, 2e-3, 4e-3] * 2, rel=1e-15)
        assert file["sweep/system.misalignment_deg"][:].tolist() == [1.0] * 3 + [4.0] * 3
        for column in ("u_x", "X_rate"):
            series = file[f"sweep/series/{column}"][4]
            expected = single[f"time_series/{column}"][:]
            np.testing.assert_allclose(series[: expected.size], expected, rtol=1e-9, atol=1e-18)
            assert np.isnan(series[expected.size :]).all()


def test_the_energy_balance_of_a_swing_back_to_rest(program, tmp_path):
    """Without friction a pulled mass is at rest again after one period, and the works are 0: what was exchanged is not."""
    period = float(2 * np.pi * np.sqrt(0.25 / 1e3))
    settings = ("friction.normal_load=0", "initial.velocity_ratio=0", "system.misalignment_deg=0", f"scene.t_end={period!r}")
    program("run", INPUTS / "fig3_constant.nml", "-o", "x.h5", "--quiet", settings=settings, status=0)
    with h5py.File(tmp_path / "x.h5") as file:
        kinetic = 0.5 * 0.25 * 1e-3**2
        assert abs(file["summary/drive_work"][()]) < 1e-8 * kinetic
        assert abs(file["summary/energy_residual"][()]) < 1e-8


def test_cases_side_by_side_are_as_those_one_by_one(program, tmp_path):
    grid = "&sweep parameter = 'system.misalignment_deg' first = 1.0 last = 6.0 count = 11 /\n"
    (tmp_path / "map.nml").write_text((INPUTS / "low_frequency.nml").read_text() + grid)
    found = {}
    for method in ("rodas4p", "radau9"):
        settings = (f"integrator.method={method}", "integrator.rtol=1e-6", "scene.t_end=4")
        program("run", "map.nml", "-o", f"{method}.h5", "--quiet", settings=settings, status=0)
        with h5py.File(tmp_path / f"{method}.h5") as file:
            found[method] = {name: file["sweep/summary"][name][()] for name in ("cycles", "peak_force", "swing")}
    assert np.array_equal(found["rodas4p"]["cycles"], found["radau9"]["cycles"])
    for name in ("peak_force", "swing"):
        assert found["rodas4p"][name] == pytest.approx(found["radau9"][name], rel=1e-4)
    shown = program("show", "rodas4p.h5", status=0).stdout
    assert "11" in shown


def test_the_catalogue_has_every_table(program):
    catalogue = json.loads(program("template", "--json", status=0).stdout)
    assert {"commands", "options", "keys", "methods"} <= set(catalogue)
    assert {method["name"]: method["order"] for method in catalogue["methods"]}["radau13"] == 13
