"""The time between samples: 'auto' shows the fast oscillation of a scene, and what does not show it is said once."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np
import pytest
from programs import INPUTS, Program

AUTO = {"output": {"interval": "auto"}}
FIG3 = ds.Scene(INPUTS / "fig3.nml").replace(**AUTO)


def interval(scene: ds.Scene) -> float:
    with ds.Simulation(scene) as simulation:
        return float(simulation.result.parameters["interval"])


@pytest.mark.parametrize("stiffness_y", [1e4, 3.3e5, 1e7, 2e9])
@pytest.mark.parametrize("mass", [0.02, 0.25, 7.0])
@pytest.mark.parametrize("model", ["full", "high_frequency"])
def test_auto_shows_the_fast_oscillation(model: str, mass: float, stiffness_y: float) -> None:
    scene = FIG3.replace(scene={"model": model, "t_end": 0.5}, system={"mass": mass, "stiffness_y": stiffness_y})
    period = 2.0 * math.pi * math.sqrt(mass / stiffness_y)
    step = interval(scene)
    # At most a quarter finer than needed, unless the slow motion or a short run needs more.
    assert step <= period / 10
    assert step > min(period / 12.9, 0.5 / 1290, 2.0 * math.pi * math.sqrt(mass / 1e3) / 129)
    # The last sample is one of those at equal distances.
    digits = step / 10.0 ** math.floor(math.log10(step))
    assert round(digits, 9) in (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0)


def test_auto_of_slow_models() -> None:
    slow = FIG3.replace(scene={"model": "low_frequency"}, system={"stiffness_y": None})
    assert interval(slow) == 8e-4
    # Without misalignment nothing excites the stiff axis.
    assert interval(FIG3.replace(system={"misalignment_deg": 0.0})) == 8e-4
    creep = ds.Scene(INPUTS / "creep.nml").replace(**AUTO)
    run = ds.run(creep)
    assert 500 <= run.time.size <= 2001 and run.parameters["interval"] == interval(creep)


def test_auto_is_the_default_and_resolves_the_stored_oscillation() -> None:
    assert ds.Output().interval == "auto"
    scene = ds.Scene(
        **{name: FIG3.replace().__getattribute__(name) for name in ("scene", "system", "friction", "drive", "initial")}
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = ds.run(scene, scene={"t_end": 0.5})
    assert run.parameters["interval"] == 8e-5
    spectrum = np.abs(np.fft.rfft(run["u_y"] - run["u_y"].mean()))
    frequency = np.fft.rfftfreq(run.time.size, 8e-5)
    assert frequency[np.argmax(spectrum[50:]) + 50] == pytest.approx(1006.6, rel=0.05)


def test_a_long_run_keeps_to_a_million_samples() -> None:
    assert interval(FIG3.replace(scene={"t_end": 100.0})) == 1e-4
    long = FIG3.replace(scene={"t_end": 1e4})
    assert interval(long) == 0.01
    with pytest.warns(ds.SamplingWarning, match=r"'auto' takes at most 1e6 samples; output\.interval = 8e-5 shows it with 1\.25e8"):
        ds.run(long, scene={"settle": 1e-3}, integrator={"rtol": 1e-6})


def test_coarse_samples_are_said_once(program: Program, tmp_path: Path) -> None:
    deck, step = INPUTS / "fig3.nml", 3e-4
    short = ("--set", "scene.t_end=0.1", "--set", f"output.interval={step}")
    for command in (("check", deck), ("run", deck, "-o", tmp_path / "x.h5")):
        said = program(*command, *short, status=0).stderr
        assert said.count("note:") == 1 and said.count("\n") == 1
        assert "3.3 samples in a period" in said and "output.interval = 'auto'" in said
    assert program("run", deck, "-o", tmp_path / "y.h5", *short, "--quiet", status=0).stderr == ""
    with pytest.warns(ds.SamplingWarning, match="do not show the fast oscillation") as caught:
        ds.run(FIG3, scene={"t_end": 0.1}, output={"interval": step})
    assert len(caught) == 1 and caught[0].filename == __file__


@pytest.mark.parametrize(
    "change",
    [
        {"output": {"interval": 2e-4}},
        {"output": {"interval": 0.0}},
        {"output": {"interval": 0.1}},
        {"output": {"interval": 1e-3}, "system": {"misalignment_deg": 0.0}},
        {"output": {"interval": 1e-3}, "scene": {"model": "low_frequency"}, "system": {"stiffness_y": None}},
        {"output": {"interval": 1e-3}, "system": {"damping_y": 4e3}},
    ],
)
def test_nothing_is_said_where_samples_show_all_or_are_none(change: dict[str, dict[str, object]]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", ds.SamplingWarning)
        ds.run(FIG3.replace(scene={"t_end": 0.1}), **change)


def test_the_value_is_in_the_file_and_in_the_printed_deck(program: Program, tmp_path: Path) -> None:
    deck = tmp_path / "own.nml"
    deck.write_text(program("template", status=0).stdout)
    printed = program("check", deck, "--set", "scene.t_end=0.1", status=0).stdout
    (line,) = (line for line in printed.splitlines() if line.startswith("  interval"))
    assert "'auto'" in line and "here 8.0e-5;" in line
    program("run", deck, "-o", tmp_path / "x.h5", "--set", "scene.t_end=0.1", status=0)
    with h5py.File(tmp_path / "x.h5") as file:
        assert file["parameters/interval"][()] == 8e-5
        assert "interval = 'auto'" in file["deck/resolved"].asstr()[()]
        assert file["time_series/time"].size == 1251
