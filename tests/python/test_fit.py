"""Fits find the parameters behind a trace, name those that it does not determine, and warn if the model does not explain it."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from dynstiction import trace_fit
from programs import INPUTS, Program

ALL = ("system.misalignment_deg", "friction.mu_0", "friction.mu_inf", "friction.v_f", "system.mass", "system.stiffness_x")
QUICK = {"method": "radau13", "rtol": 1e-7}
RIG = ds.Scene(INPUTS / "fig3.nml").replace(
    system={"misalignment_deg": 1.4, "stiffness_x": 900.0, "mass": 0.4}, friction={"mu_0": 0.24, "mu_inf": 0.19}, integrator=QUICK
)
TRUE = {
    "system.misalignment_deg": 1.4,
    "friction.mu_0": 0.24,
    "friction.mu_inf": 0.19,
    "friction.v_f": 0.01,
    "system.mass": 0.4,
    "system.stiffness_x": 900.0,
}
DECK = ds.Scene(INPUTS / "fig3.nml").replace(integrator=QUICK)


def trace_of(scene: ds.Scene, noise: float = 0.01, seed: int = 0, end: float = 24.0, sense: float = 1.0) -> ds.Trace:
    run = ds.run(scene, scene={"t_end": end}, output={"interval": 1e-3, "fields": ["spring_force_x", "spring_force_y"]})
    clean = ds.Trace.of(run).part(start=3.0)
    random = np.random.default_rng(seed)
    return ds.Trace(clean.time, sense * clean.force + noise * np.ptp(clean.force) * random.standard_normal(clean.time.size))


@pytest.fixture(scope="module")
def trace() -> ds.Trace:
    return trace_of(RIG)


@pytest.fixture(scope="module")
def found(trace: ds.Trace) -> ds.Fit:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ds.FitWarning)
        return ds.fit(DECK, trace, ALL)


def test_all_six_parameters_of_a_rig_are_found(found: ds.Fit) -> None:
    for name, value in TRUE.items():
        parameter = found.parameters[name]
        assert parameter.told
        assert abs(found[name] - value) < 4.0 * parameter.error, name
        assert parameter.error < 0.06 * value, name
    assert abs(found["system.misalignment_deg"] - 1.4) < 0.1
    assert found.model == "full"
    assert 0.5 < found.misfit < 1.5
    assert found.explains
    assert all("friction need not fall exponentially" in note for note in found.notes)


def test_a_displacement_tells_the_angle(trace: ds.Trace, found: ds.Fit) -> None:
    """With a sensor of 0.1 µm, ten times as accurately as the force alone."""
    run = ds.run(RIG, scene={"t_end": 24.0}, output={"interval": 1e-3, "fields": ["spring_force_x", "spring_force_y", "X"]})
    way = ds.Trace.of(run).part(start=3.0).displacement
    assert way is not None
    both = ds.Trace(trace.time, trace.force, displacement=way + 1e-7 * np.random.default_rng(7).standard_normal(way.size))
    fit = ds.fit(DECK, both, ALL)
    for name, value in TRUE.items():
        assert abs(fit[name] - value) < 4.0 * fit.parameters[name].error, name
    angle = "system.misalignment_deg"
    assert fit.parameters[angle].error < 0.1 * found.parameters[angle].error
    assert fit.explains and fit.ahead.size > 20
    np.testing.assert_allclose(fit.ahead, fit.waveform.ahead.mean(axis=0), atol=2e-6)
    assert len(fit.plot().axes) == 4 and len(found.plot().axes) == 3


def test_what_hangs_on_the_law_is_said(found: ds.Fit) -> None:
    """A viscous term bends friction at the speeds of slip as another exponential does: the trace cannot tell, and that is said."""
    with pytest.warns(ds.FitWarning, match=r"friction\.mu_inf ± .* need not fall exponentially"):
        viscous = ds.fit(DECK, trace_of(RIG.replace(friction={"law": "stribeck", "viscous": 0.3})), ALL)
    assert viscous.explains
    limit = viscous.parameters["friction.mu_inf"]
    assert abs(limit.value - 0.19) > 4.0 * limit.error
    for name, value in TRUE.items():
        parameter = viscous.parameters[name]
        assert abs(parameter.value - value) < 4.0 * max(parameter.error, parameter.law_error), name
    assert found.parameters["friction.mu_inf"].law_error > 10.0 * found.parameters["friction.mu_inf"].error


def test_the_fitted_scene_runs_and_repeats_what_was_measured(found: ds.Fit, trace: ds.Trace) -> None:
    deck = ds.Scene(found.scene.to_deck())
    for name in TRUE:
        group, _, key = name.partition(".")
        assert deck.groups()[group][key] == pytest.approx(found[name], rel=1e-15)
    assert not any(statistic.differs for statistic in ds.compare(deck, trace).statistics)
    run = ds.run(deck, scene={"t_end": 30.0, "settle": 1e-7}, output={"interval": 1.0})
    assert run.summary["period"] == pytest.approx(found.waveform.period, abs=5.0 * found.waveform.period_error)
    assert run.summary["period"] == pytest.approx(found.period, rel=1e-5)


def test_the_same_seed_gives_the_same_bits(found: ds.Fit, trace: ds.Trace) -> None:
    again = ds.fit(DECK, trace, ",".join(ALL))
    assert [each.value for each in again.parameters.values()] == [each.value for each in found.parameters.values()]
    assert again.correlation.tobytes() == found.correlation.tobytes()


def test_random_starts_follow_the_seed(trace: ds.Trace, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[bytes] = []

    def nothing_near(model: object, wave: object, starts: list[np.ndarray], count: int) -> list[np.ndarray]:
        tried.append(np.array(starts).tobytes())
        return []

    monkeypatch.setattr(trace_fit, "best_start", nothing_near)
    for seed in (3, 3, 4):
        with pytest.raises(ds.UsageError, match="no stick-slip near any start"):
            ds.fit(DECK, trace, ALL, rng=seed)
    assert tried[0] == tried[1] != tried[2]


def test_dampers_pull_at_the_load_cell_too() -> None:
    """A cell in line with springs and dampers shows both: a fit that forgot the dampers would find another friction."""
    rig = RIG.replace(system={"damping_x": 3.0, "damping_y": 40.0})
    run = ds.run(
        rig, scene={"t_end": 24.0}, output={"interval": 1e-3, "fields": ["spring_force_x", "spring_force_y", "pull_force"]}
    )
    clean = ds.Trace.of(run).part(start=3.0)
    springs = run["spring_force_x"] * np.cos(np.radians(1.4)) + run["spring_force_y"] * np.sin(np.radians(1.4))
    assert np.max(np.abs(clean.force - springs[-clean.time.size :])) > 0.05 * np.ptp(clean.force)
    noise = 0.01 * np.ptp(clean.force) * np.random.default_rng(5).standard_normal(clean.time.size)
    trace = ds.Trace(clean.time, clean.force + noise)
    free = ("system.misalignment_deg", "friction.mu_0", "friction.mu_inf", "system.damping_x")
    found = ds.fit(rig.replace(system={"damping_x": 1.5}, friction={"mu_0": 0.25}), trace, free)
    assert found.explains
    assert found["system.damping_x"] == pytest.approx(3.0, abs=4.0 * found.parameters["system.damping_x"].error)
    assert found.parameters["system.damping_x"].error < 0.5
    assert found["friction.mu_inf"] == pytest.approx(0.19, abs=4.0 * found.parameters["friction.mu_inf"].error)
    assert ds.compare(rig, trace).differing == ()


def test_intervals_are_wider_for_more_confidence_and_more_noise(found: ds.Fit) -> None:
    low, high = found.interval("friction.mu_0")
    lower, higher = found.interval("friction.mu_0", 0.999)
    assert lower < low < found["friction.mu_0"] < high < higher
    noisy = ds.fit(RIG, trace_of(RIG, noise=0.04), ("system.misalignment_deg", "friction.mu_0"))
    quiet = ds.fit(RIG, trace_of(RIG, noise=0.002), ("system.misalignment_deg", "friction.mu_0"))
    for name in noisy.parameters:
        assert noisy.parameters[name].error > 4.0 * quiet.parameters[name].error


def test_a_product_is_not_told_apart() -> None:
    """Friction forces are products of coefficients and the normal load: only these are in a force trace."""
    with pytest.warns(ds.FitWarning, match="does not distinguish"):
        found = ds.fit(RIG, trace_of(RIG), ("friction.mu_0", "friction.mu_inf", "friction.normal_load", "system.misalignment_deg"))
    for name in ("friction.mu_0", "friction.mu_inf", "friction.normal_load"):
        assert not found.parameters[name].told
        assert math.isnan(found[name])
        assert found.interval(name) == (0.0, math.inf)
        assert any(name in note for note in found.notes)
    assert found.parameters["system.misalignment_deg"].told
    assert "not determined by this trace" in str(found)


@pytest.mark.parametrize("friction", [{"law": "stribeck", "exponent": 2.0}, {"law": "stribeck", "exponent": 1.5}])
def test_another_law_is_noticed(friction: dict[str, object]) -> None:
    """Whatever values explain the trace best, it is said that they do not explain it."""
    strange = trace_of(RIG.replace(friction=friction), noise=0.01)
    with pytest.warns(ds.FitWarning, match="does not explain"):
        found = ds.fit(DECK, strange, ALL)
    assert found.chance < 1e-4


def test_a_static_limit_is_noticed() -> None:
    strange = trace_of(RIG.replace(friction={"mu_static": 0.26}))
    with pytest.warns(ds.FitWarning, match="does not explain"):
        ds.fit(DECK, strange, ALL)


def test_a_wrong_value_that_is_held_is_noticed(trace: ds.Trace) -> None:
    with pytest.warns(ds.FitWarning, match="does not explain"):
        ds.fit(RIG.replace(system={"mass": 0.2}), trace, ("system.misalignment_deg", "friction.mu_0"))


def test_the_slow_model_is_fitted_alone_where_the_scene_says_so() -> None:
    slow = RIG.replace(scene={"model": "low_frequency"}, system={"stiffness_y": None}, friction={"contact": None})
    found = ds.fit(slow, trace_of(slow), ("system.misalignment_deg", "friction.mu_0"))
    assert found.model == "low_frequency"
    assert found["friction.mu_0"] == pytest.approx(0.24, rel=1e-3)


@pytest.mark.parametrize(
    ("free", "message"),
    [
        ("", "name the parameters"),
        ("friction.mu_0,friction.mu_0", "named twice"),
        ("drive.velocity", "&system and &friction"),
        ("friction.law", "not a real number"),
        ("friction.mu", "&system and &friction"),
        ("friction.exponent", "has no value"),
    ],
)
def test_what_cannot_be_free_is_refused(trace: ds.Trace, free: str, message: str) -> None:
    with pytest.raises(ds.UsageError, match=message):
        ds.fit(DECK, trace, free)


def test_a_drive_that_changes_is_refused(trace: ds.Trace) -> None:
    scene = DECK.replace(drive={"velocity": (1e-3, 2e-3), "time": (0.0, 1.0)})
    with pytest.raises(ds.UsageError, match="constant velocity"):
        ds.fit(scene, trace, "friction.mu_0")


def test_constant_friction_has_no_start(trace: ds.Trace) -> None:
    scene = DECK.replace(friction={"law": "constant", "mu_inf": None, "v_f": None})
    with pytest.raises(ds.UsageError, match="no stick-slip near any start"):
        ds.fit(scene, trace, "friction.mu_0")


# The page howto/fit_a_trace, which test_docs.py runs, has the command in short.
@pytest.mark.full
def test_the_command_writes_a_deck_and_a_figure(program: Program, tmp_path: Path, trace: ds.Trace) -> None:
    table = np.column_stack([1e3 * (trace.time - trace.time[0]), 1e3 * trace.force])
    np.savetxt(tmp_path / "rig.csv", table, delimiter=";", header="t [ms];F [mN]", comments="", fmt="%.7g")
    free = "system.misalignment_deg,friction.mu_0,friction.mu_inf,friction.v_f"
    rig = ("system.mass=0.4", "system.stiffness_x=990.0")
    done = program("fit", INPUTS / "fig3.nml", "rig.csv", "--free", free, settings=rig, status=6)
    assert done.stdout.startswith("the fit does NOT explain the trace")
    assert "system.misalignment_deg" in done.stdout
    assert "note: the model does not explain the trace" in done.stdout
    assert (tmp_path / "rig_fitted.png").stat().st_size > 10_000
    assert ds.Scene(tmp_path / "rig_fitted.nml").system.mass == 0.4
    again = program("fit", INPUTS / "fig3.nml", "rig.csv", "--free", free, status=None)
    assert again.returncode != 0
    assert "--overwrite" in again.stderr
