"""What a deck can bring about in the executable and no other test of it does: why 'auto' is the full model, scenes that are
refused when they are set up, faults of &sweep.
"""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from programs import INPUTS

pytestmark = pytest.mark.deck

# Settings on fig3.nml, and why the full model is taken; more of them: test_model_choice.py.
OBSTACLES: dict[str, str] = {
    "the high-frequency motion alone costs as much": "scene.quantities=high_frequency",
    "nothing to reduce": "friction.normal_load=0",
    "more than accuracy = ": "scene.accuracy=1e-12",
}


@pytest.mark.parametrize("reason", OBSTACLES)
def test_auto_says_why_it_is_the_full_model(program, tmp_path, reason):
    settings = ("scene.model=auto", "scene.t_end=1e-3", OBSTACLES[reason])
    done = program("run", INPUTS / "fig3.nml", "-o", "x.h5", settings=settings, status=0)
    with h5py.File(tmp_path / "x.h5") as file:
        assert file.attrs["model"] == "full"
        assert file.attrs["model_choice"].startswith("full: ")
        assert reason in file.attrs["model_choice"]
        assert file.attrs["model_choice"] in done.stderr


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
# What is put in the place of a list, and what the refusal says; more of them: test_sweep.py.
SWEEP_FAULTS: dict[str, tuple[str, str]] = {
    "3 value(s) of 'spacing' but 2": ("spacing", "'log', 'log', 'log'"),
    "there is no key 'mass'": ("parameter", "'mass', 'drive.velocity'"),
    "is not used with": ("parameter", "'integrator.step', 'drive.velocity'"),
    "cases": ("count", "100000, 100000"),
}


@pytest.mark.parametrize("words", SWEEP_FAULTS)
def test_a_sweep_with_faults_is_refused(program, tmp_path, words):
    key, value = SWEEP_FAULTS[words]
    lists = "".join(f"  {name} = {values}\n" for name, values in {**LISTS, key: value}.items())
    (tmp_path / "map.nml").write_text((INPUTS / "low_frequency.nml").read_text() + f"\n&sweep\n{lists}/\n")
    assert words in program("run", "map.nml", "-o", "x.h5", status=2).stderr
    assert not list(tmp_path.glob("x.h5*"))


def test_the_energy_balance_of_a_swing_back_to_rest(program, tmp_path):
    """Without friction a pulled mass is at rest again after one period, and the works are 0: what was exchanged is not."""
    period = float(2 * np.pi * np.sqrt(0.25 / 1e3))
    settings = ("friction.normal_load=0", "initial.velocity_ratio=0", "system.misalignment_deg=0", f"scene.t_end={period!r}")
    program("run", INPUTS / "fig3_constant.nml", "-o", "x.h5", "--quiet", settings=settings, status=0)
    with h5py.File(tmp_path / "x.h5") as file:
        kinetic = 0.5 * 0.25 * 1e-3**2
        assert abs(file["summary/drive_work"][()]) < 1e-8 * kinetic
        assert abs(file["summary/energy_residual"][()]) < 1e-8
