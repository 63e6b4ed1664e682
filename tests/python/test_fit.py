"""Fits find the parameters behind a trace, name those that it does not determine, and warn if the model does not explain it."""

from __future__ import annotations

import math
import pickle
import re
import warnings
from pathlib import Path
from types import SimpleNamespace

import dynstiction as ds
import numpy as np
import pytest
from dynstiction._fit import search
from dynstiction._fit.models import NoCycleError, _rests, _sampled, full_cycles
from dynstiction._fit.problem import Problem
from dynstiction._fit.solve import Solution
from dynstiction._fit.waveform import waveform_of
from dynstiction.trace_cycles import find_cycles
from dynstiction.trace_fit import problem_of, verdict
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
SLOW = RIG.replace(scene={"model": "low_frequency"}, system={"stiffness_y": None}, friction={"contact": None})


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


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few starts: what explains a trace badly is otherwise tried from all."""
    monkeypatch.setattr(search, "SHOTS", 4)
    monkeypatch.setattr(search, "HOPS", 1)


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


def test_a_fit_shows_its_cycles_and_its_parameters(found: ds.Fit) -> None:
    (image,) = found.plot("cycles").axes[0].collections
    residuals = image.get_array().compressed()
    assert residuals.size > 0.9 * found.waveform.cycles.size - 10 * len(found.waveform.cycles)
    assert 0.8 < residuals.std() < 1.2
    corner = found.plot("corner")
    p = len(ALL)
    assert [len(axis.lines) for axis in corner.axes] == [(1 if i == j else 2) if j <= i else 0 for i in range(p) for j in range(p)]
    pair = corner.axes[p * (p - 1)]
    assert pair.get_xlabel().startswith("misalignment_deg") and pair.get_ylabel().startswith("stiffness_x")
    x, y = pair.lines[0].get_data()
    assert np.corrcoef(x, y)[0, 1] == pytest.approx(found.correlation[0, -1], abs=0.02)
    assert np.ptp(x) == pytest.approx(2.0 * found.parameters[ALL[0]].error, rel=0.02)
    for arguments, message in (({"kind": "pie"}, "waveform, time, cycles, corner"), ({"start": 1.0}, "only the figure 'time'")):
        with pytest.raises(ds.UsageError, match=message):
            found.plot(**arguments)


def test_a_report_has_all_figures_of_a_fit(found: ds.Fit, trace: ds.Trace) -> None:
    """Data, model and difference over any time, and distributions of the trace and of a run."""
    page = found.report()
    assert re.findall(r'<img alt="(\w+): \w', page) == ["time", "waveform", "cycles", *["time"] * 6, "corner"]
    assert "the fit explains the trace" in page and "nothing differs" in page
    above, below = found.plot("time", start=10.0, end=14.0).axes
    np.testing.assert_array_equal(above.lines[0].get_xdata(), trace.part(10.0, 14.0).time)
    difference = below.lines[0].get_ydata()
    assert np.isfinite(difference).mean() > 0.95 and np.nanstd(difference) < 1.5 * found.cycles.noise
    for axis in found.plot("cycles").axes[1:3]:
        assert axis.get_legend_handles_labels()[1] == ["measured, 21 cycles", "simulated, 42 cycles"]


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
    assert not ds.compare(deck, trace).differing
    run = ds.run(deck, scene={"t_end": 30.0, "settle": 1e-7}, output={"interval": 1.0})
    assert run.summary["period"] == pytest.approx(found.waveform.period, abs=5.0 * found.waveform.period_error)
    assert run.summary["period"] == pytest.approx(found.period, rel=1e-5)


def test_the_same_seed_gives_the_same_bits(found: ds.Fit, trace: ds.Trace) -> None:
    again = ds.fit(DECK, trace, ",".join(ALL))
    assert [each.value for each in again.parameters.values()] == [each.value for each in found.parameters.values()]
    assert again.correlation.tobytes() == found.correlation.tobytes()


def test_random_starts_follow_the_seed(trace: ds.Trace, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[bytes] = []

    def nothing(problem: Problem, start: np.ndarray, levels: object) -> None:
        tried[-1] += start.tobytes()
        raise NoCycleError("none is completed")

    monkeypatch.setattr(Problem, "improved", nothing)
    monkeypatch.setattr(search, "shot", nothing)
    monkeypatch.setattr(search, "SHOTS", 1)
    for seed in (3, 3, 4):
        tried.append(b"")
        with pytest.raises(ds.UsageError, match="no stick-slip near any start"):
            ds.fit(DECK, trace, ALL, rng=seed)
    assert tried[0] == tried[1] != tried[2]


def test_values_of_the_slow_model_explain_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the scene's own model has no stick-slip the slow one's values are shown, with the scene's own model in the deck."""

    def none(*_: object) -> None:
        raise NoCycleError("steady sliding")

    monkeypatch.setattr("dynstiction._fit.problem.full_cycles", none)
    monkeypatch.setattr(search, "SHOTS", 1)
    with pytest.warns(ds.FitWarning, match="no stick-slip near these values"):
        found = ds.fit(RIG, trace_of(SLOW), ("system.misalignment_deg", "friction.mu_0"))
    assert found.model == "low_frequency" and found.scene.scene.model in (None, "full")
    assert found.chance > 1e-4 and not found.explains
    assert ds.explanations(found) == ()


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


@pytest.mark.parametrize("friction", [*({"law": "stribeck", "exponent": n} for n in (2.0, 1.5)), {"mu_static": 0.26}])
@pytest.mark.usefixtures("hasty")
def test_another_law_is_noticed(friction: dict[str, object]) -> None:
    """Whatever values explain the trace best, it is said that they do not explain it."""
    strange = trace_of(RIG.replace(friction=friction), noise=0.01)
    with pytest.warns(ds.FitWarning, match="does not explain"):
        found = ds.fit(DECK, strange, ALL)
    assert found.chance < 1e-4


@pytest.mark.usefixtures("hasty")
def test_a_wrong_value_that_is_held_is_noticed(trace: ds.Trace) -> None:
    with pytest.warns(ds.FitWarning, match="does not explain"):
        ds.fit(RIG.replace(system={"mass": 0.2}), trace, ("system.misalignment_deg", "friction.mu_0"))


def test_the_slow_model_is_fitted_alone_where_the_scene_says_so() -> None:
    found = ds.fit(SLOW, trace_of(SLOW), ("system.misalignment_deg", "friction.mu_0"))
    assert found.model == "low_frequency"
    assert found["friction.mu_0"] == pytest.approx(0.24, rel=1e-3)


@pytest.mark.parametrize(
    ("free", "message"),
    [
        ("", "name the parameters"),
        ("friction.mu_0,friction.mu_0", "named twice"),
        ("output.interval", "&system and &friction"),
        ("chain.filter", "has no value"),
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


@pytest.mark.parametrize("change", [{"scene": {"model": "auto"}}, {"friction": {"contact": "smoothed", "v_smooth": 1e-6}}])
def test_a_scene_without_derivatives_is_refused(trace: ds.Trace, change: dict[str, object]) -> None:
    with pytest.raises(ds.UsageError, match=r"can be fitted|exact derivatives"):
        ds.fit(DECK.replace(**change), trace, "friction.mu_0")


def test_cycles_that_alternate_are_not_alike() -> None:
    """Errors of the times of slips look like that, but no time has an error of so many samples."""
    draw = np.random.default_rng(4)
    for change, repeats in ((0.0, True), (0.01, False)):
        lengths = 0.5 * (1.0 + change * (-1.0) ** np.arange(42))
        time = np.arange(0.0, 20.0, 1e-3)
        since = time - np.cumsum(np.append(0.0, lengths))[np.searchsorted(np.cumsum(lengths), time)]
        force = np.minimum(3.0 + since, 3.5 - 12.0 * (since - 0.46)) + 1e-3 * draw.standard_normal(time.size)
        trace = ds.Trace(time, force)
        cycles = find_cycles(trace)
        assert waveform_of(trace, cycles, 1e-3).repeats == repeats


def test_one_minimum_is_completed_once() -> None:
    """Of coarse fits that differ only in what is badly known, the best is kept; another minimum is not crowded out."""
    problem = SimpleNamespace(root=np.diag)
    errors = np.array([2.0, 0.01])
    starts = [([0.0, 0.0], 3.0), ([-4.0, 0.01], 1.0), ([-5.0, 0.02], 2.0), ([0.1, 0.0], 3.5)]
    found = [Solution(np.array(z), cost, errors) for z, cost in starts]
    kept = search._apart(problem, found)
    assert [each.cost for each in kept] == [1.0]
    found[0] = Solution(np.array([0.0, 0.35]), 3.0, errors)
    assert [each.cost for each in search._apart(problem, found)] == [1.0, 3.0]


def test_starts_keep_no_angle_of_zero(trace: ds.Trace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Problem, "cheapest", lambda _problem, starts, _coarse: starts)
    looking = search.Search(problem_of(RIG, trace, ALL), 2, np.random.default_rng(1))
    looking.proposal = looking.problem.place(TRUE | {"system.misalignment_deg": 1e-6, "friction.mu_0": 0.2})
    angle, mu_0, *_, stiffness = np.array([list(looking.problem.named(z).values()) for z in looking._own_starts()]).T
    assert 0.3 < angle.min() < 0.5 and 4.0 < angle.max() < 6.0
    assert mu_0[1:].max() > 0.23 and np.ptp(stiffness) < 0.15 * stiffness.mean()


def test_a_delay_has_no_prior_that_matters(trace: ds.Trace) -> None:
    """A zero is told by a force that a delay nearly makes up for, whatever the unit of the delay."""
    root, jacobian = problem_of(RIG, trace, ("friction.mu_0", "chain.tare")).root, np.diag([1.0, 10.0, 0.0])
    jacobian[1:, 1:] += [[0.0, 1.0], [0.5, 0.0]]
    for unit in (1.0, 0.03):
        assert np.linalg.norm(root(jacobian * [1.0, 1.0, unit])[1]) == pytest.approx(1.51, abs=0.01)


def test_a_cycle_begins_in_the_nearest_rest() -> None:
    """The longest one soon after its window begins, else the nearest, before or after it."""
    time = np.arange(100.0)
    sticking = np.isin(time, [*range(10, 15), *range(30, 33), *range(34, 41), *range(80, 85)])
    at = _rests(time, sticking, np.array([29.0, 16.0, 68.0]), 10.0)
    assert at.tolist() == [36, 12, 82]


def test_constant_friction_has_no_start(trace: ds.Trace) -> None:
    with pytest.raises(ds.UsageError, match="no stick-slip near any start"):
        ds.fit(DECK.replace(friction={"law": "constant", "mu_inf": None, "v_f": None}), trace, "friction.mu_0")


def test_speeds_tell_the_law() -> None:
    """Two speeds in one fit determine v_f and mu_inf better than one does; the values are those of both."""
    velocities = (1e-3, 4e-3)
    traces = [trace_of(RIG.replace(drive={"velocity": v}), seed=k, end=14.0) for k, v in enumerate(velocities)]
    both = ds.fit(DECK, traces, ALL, each={"drive.velocity": velocities})
    one = ds.fit(DECK, traces[0], ALL)
    for name, value in TRUE.items():
        assert abs(both[name] - value) < 4.0 * both.parameters[name].error, name
    for name in ("friction.v_f", "friction.mu_inf"):
        assert both.parameters[name].error < 0.6 * one.parameters[name].error, name
    assert [each.scene.drive.velocity for each in both.traces] == list(velocities)
    assert both.explains and verdict(both)[0]


def test_a_zero_that_is_wrong_is_found(trace: ds.Trace) -> None:
    shifted = ds.Trace(trace.time, trace.force + 0.35 + 0.02 * (trace.time - trace.time.mean()))
    free = ("system.misalignment_deg", "friction.mu_0", "friction.v_f")
    told = ds.fit(RIG, shifted, (*free, "chain.tare"), known={"friction.mu_0": (0.24, 1e-4)})
    assert told["chain.tare"] == pytest.approx(0.35, abs=4.0 * told.parameters["chain.tare"].error)
    assert told.parameters["chain.tare"].error < 0.002
    assert told["system.misalignment_deg"] == pytest.approx(1.4, abs=4.0 * told.parameters["system.misalignment_deg"].error)
    resting = ds.Trace(np.arange(1000) * 1e-3, np.append(np.full(500, 0.35), np.linspace(0.35, 1.0, 500)))
    assert resting.zeroed(0.0, 0.4).force[0] == pytest.approx(0.0, abs=1e-12)


def test_the_model_passes_the_filter_of_the_trace(trace: ds.Trace) -> None:
    filtered = ds.Chain(filter=40.0, order=4)(trace)
    free = ("system.misalignment_deg", "friction.v_f", "system.mass")
    found = ds.fit(RIG, filtered, free, chain=ds.Chain(filter=40.0, order=4))
    assert found.explains
    for name in free:
        assert abs(found[name] - TRUE[name]) < 4.0 * found.parameters[name].error, name
    with pytest.warns(ds.FitWarning, match="does not explain"):
        ds.fit(RIG, filtered, free)


def test_speed_and_lengths_are_not_told_apart(trace: ds.Trace) -> None:
    with pytest.warns(
        ds.FitWarning, match=r"hardly distinguishes drive\.velocity, system\.stiffness_x, system\.mass, friction\.v_f"
    ):
        found = ds.fit(RIG, trace, ("drive.velocity", "system.stiffness_x", "system.mass", "friction.v_f"))
    low, high = found.interval("drive.velocity")
    assert low < 1e-3 < high
    assert high - low > 0.1 * found["drive.velocity"]
    assert found.parameters["drive.velocity"].error > 0.03 * found["drive.velocity"]


def test_a_motion_settles_to_the_same_cycle_by_the_map_and_by_steps(trace: ds.Trace) -> None:
    wave = waveform_of(trace, find_cycles(trace), 1e-3)
    scenes = (RIG.replace(integrator={"cycle_map": choice}) for choice in ("auto", "off"))
    mapped, stepped = (full_cycles(scene, wave, 0.0, ds.Chain(), patient=True) for scene in scenes)
    until = ds.run(RIG, scene={"settle": 1e-8, "t_end": 100.0}, output={"interval": 100.0})
    assert mapped.period == pytest.approx(until.summary["period"], rel=1e-6)
    np.testing.assert_allclose(mapped.rows, stepped.rows, atol=1e-5 * wave.swing)


def test_the_cycle_of_a_motion_that_settles_late() -> None:
    """Its irregular beginning ends at another time in each run."""
    rig = RIG.replace(
        system={"misalignment_deg": 0.7933, "mass": 0.3273, "stiffness_x": 2300.357, "stiffness_y": 2624616.6},
        friction={"mu_0": 0.21201, "mu_inf": 0.13678, "v_f": 0.018112},
        drive={"velocity": 0.00122493},
    )
    trace = trace_of(rig).part(start=15.0)
    wave = waveform_of(trace, find_cycles(trace), 1e-3)
    run, begin, end = _sampled(rig, wave, 1.0, 1.6, 1e-3, repeats=True)
    assert run.summary["repeats"] == 1.0 < begin <= run.time[0] < run.time[-1] < end + 1e-3


def test_cycles_that_are_not_alike_are_fitted_one_by_one() -> None:
    """An irregular rig: all three values within four errors of some per cent, from a start that is 20 % off."""
    rig = ds.Scene(
        model="full", mass=0.4, stiffness_x=2e4, stiffness_y=2e6, misalignment_deg=1.0, mu_0=0.25, mu_inf=0.18, v_f=4e-3,
        normal_load=20.0, velocity=1e-3, t_end=9.0,
    )  # fmt: skip
    run = ds.run(rig, output={"interval": 5e-4, "fields": ["spring_force_x", "spring_force_y", "pull_force"]})
    clean = ds.Trace.of(run).part(start=5.0)
    trace = ds.Trace(clean.time, clean.force).with_noise(0.01 * np.ptp(clean.force), 3)
    free = ("system.misalignment_deg", "friction.mu_0", "system.mass")
    start = rig.replace(system={"misalignment_deg": 1.2, "mass": 0.36}, friction={"mu_0": 0.26})
    found = ds.fit(start, trace, free)
    assert not found.waveform.repeats and found.explains
    (image,) = found.plot("cycles").axes[0].collections
    assert np.nanstd(image.get_array()) < 1.5
    for name, value in zip(free, (1.0, 0.25, 0.4), strict=True):
        assert abs(found[name] - value) < 4.0 * found.parameters[name].error, name
        assert found.parameters[name].error < 0.05 * value, name


def test_bounds_and_ties_hold(trace: ds.Trace) -> None:
    """mu_inf as a share of mu_0, and a mass that stops at its bound, which is said."""
    free = ("system.misalignment_deg", "friction.mu_0")
    tied = ds.fit(RIG.replace(friction={"mu_0": 0.25}), trace, free, ties={"friction.mu_inf": ("friction.mu_0", 0.19 / 0.24)})
    assert tied.explains and tied["friction.mu_0"] == pytest.approx(0.24, abs=4.0 * tied.parameters["friction.mu_0"].error)
    assert tied.scene.friction.mu_inf == pytest.approx(tied["friction.mu_0"] * 0.19 / 0.24, rel=1e-14)
    with pytest.warns(ds.FitWarning, match=r"system\.mass is at its bound 0\.3[:]"):
        bound = ds.fit(SLOW.replace(system={"mass": 0.25}), trace, (*free, "system.mass"), bounds={"system.mass": (0.2, 0.3)})
    assert bound.scene.system.mass == 0.3 and not bound.explains
    for arguments, message in (
        ({"bounds": {"system.mass": (0.2, 0.3)}}, "is not free"),
        ({"bounds": {"friction.mu_0": (0.3, 0.2)}}, "is not below"),
        ({"ties": {"friction.mu_0": ("friction.mu_0", 1.0)}}, "must not be free"),
        ({"ties": {"friction.law": ("friction.mu_0", 1.0)}}, "not a real number"),
    ):
        with pytest.raises(ds.UsageError, match=message):
            ds.fit(RIG, trace, free, **arguments)


def test_a_fit_is_data(found: ds.Fit) -> None:
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.residuals({}), found.residuals({}))
    assert again.interval("friction.v_f") == found.interval("friction.v_f")


def test_residuals_are_those_of_the_likelihood(found: ds.Fit) -> None:
    best = {name: found[name] for name in TRUE}
    least = float(np.sum(found.residuals(best) ** 2))
    for name in ALL:
        moved = float(np.sum(found.residuals(best | {name: found[name] + 3.0 * found.parameters[name].error}) ** 2))
        assert moved > least + 1.0, name
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), found.sets[0][1])


def test_a_plan_expects_the_errors_of_a_fit(found: ds.Fit) -> None:
    plan = ds.plan_traces(RIG, ALL, {"drive.velocity": (1e-3, 4e-3)}, duration=21.0)
    assert list(plan) == ["0.001", "0.004", "together"] and tuple(plan.index) == ALL
    for name in ALL:
        expected = found.parameters[name].error / found[name]
        assert 0.6 < plan.loc[name, "0.001"] / expected < 1.7, name
        assert plan.loc[name, "together"] <= 1.05 * plan.loc[name, "0.001"] * math.sqrt(2.0), name


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


def test_a_step_beyond_the_largest_number_is_no_cycle() -> None:
    """Of the slope of friction."""
    problem = SimpleNamespace(weakening=(0, 1, 2))
    with pytest.raises(NoCycleError, match="mu_inf would be negative"):
        Problem.logarithms(problem, np.array([0.0, 800.0, 0.0]))
