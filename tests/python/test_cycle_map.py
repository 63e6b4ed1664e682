"""Cycles that are leapt by their map, in scenes that have been wrong or dear; and runs that end where they have settled.

That they are those which steps make: tests/unit/test_cycle_map.f90 for every method, tests/invariance for random scenes.
"""

from __future__ import annotations

from typing import Any

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS

FIG3 = INPUTS / "fig3.nml"
SAMPLED = {"interval": 1e-3, "fields": ["u_x", "u_y", "w_x", "w_y", "X"]}
Groups = dict[str, dict[str, Any]]


def run(scene: ds.Scene, cycle_map: str, rtol: float, output: dict[str, Any], method: str = "radau9") -> ds.Result:
    return ds.run(scene, integrator={"method": method, "rtol": rtol, "cycle_map": cycle_map}, output=output)


def releases(result: ds.Result) -> np.ndarray:
    return result.events["time"][result.events["kind"] == 2]


def sticks(result: ds.Result) -> int:
    return np.count_nonzero(result.events["kind"] == 1)


def apart(a: ds.Result, b: ds.Result) -> float:
    """By how much the releases of two runs differ, relative to the end; 1 if one has more sticks."""
    if sticks(a) != sticks(b) or releases(a).size != releases(b).size:
        return 1.0
    return float(np.abs(releases(a) - releases(b)).max(initial=0.0)) / a.time[-1]


def test_the_largest_rate_of_a_run_that_ends_among_the_first_laps() -> None:
    """Rates of a table of laps are known to a share of its largest one, and the first laps are slower by orders of magnitude."""
    laps = {"mass": 0.5506403451766021, "stiffness_y": 6381731244.504325, "misalignment_deg": 0.3404056250423219}
    laps |= {"v_f": 1.182673237518143e-4, "velocity": 9.181562142602463e-5, "t_end": 0.08754591505787124}
    scene = ds.Scene(FIG3).replace(**laps)
    by_map, by_steps = (run(scene, how, 1e-8, {"interval": 0.0875}, "radau13") for how in ("auto", "off"))
    assert by_map.statistics["cycles_leapt"] > 100
    assert by_map.summary["max_X_rate"] == pytest.approx(by_steps.summary["max_X_rate"], rel=1e-6, abs=0)


@pytest.mark.parametrize(
    "changes",
    [
        {"drive": {"velocity": 1e-2}, "scene": {"t_end": 6.0}},
        {"drive": {"velocity": -1e-2}, "system": {"damping_x": 1.0}, "scene": {"t_end": 6.0}},
        {"system": {"mass": 2.5}, "scene": {"t_end": 50.0}},
        {"system": {"stiffness_x": 1e4, "stiffness_y": 1e5, "misalignment_deg": 4.0}, "scene": {"t_end": 4.0}},
    ],
)
def test_slow_cycles_with_few_sticks_are_reused(changes: Groups) -> None:
    scene = ds.Scene(FIG3, **changes)
    by_map, by_steps = (run(scene, how, 1e-9, {**SAMPLED, "interval": 1e-2}) for how in ("auto", "off"))
    assert by_map.statistics["excursions_reused"] > 5
    assert 0.0 <= by_map.statistics["map_error"] < 1e-9
    assert apart(by_map, by_steps) <= 1e-8
    assert by_map.statistics["newton"] < 0.8 * by_steps.statistics["newton"]
    assert by_map.summary["repeats"] == by_steps.summary["repeats"] == 1


NAMES = ("misalignment_deg", "mass", "stiffness_y", "mu_inf", "v_f", "velocity", "t_end")
DEAR = [
    (2.944135660568665, 1.4368818940701285, 607265.2260634421, 0.09847402371068538, 0.017469746678746994, 1.769136017705724e-4,
     138.5),
    (5.190160874530475, 0.03871672680650971, 35927085.33592335, 0.1066259121920759, 0.003253932508935188, 0.035336608015327405, 1.148),
    (10.004061982010477, 0.05098858419250527, 78270368.112, 0.10368727231117367, 0.00733798127878324, 0.046478949413718565, 1.0547),
    (1.4075703077414614, 0.13920312836924734, 150652.5813606, 0.07877619189280104, 0.006564136273765923, 0.0012362900367057098, 20.3),
    (0.39570428310482525, 0.17361908422732442, 649985.2888, 0.07064902325621644, 0.03693537109842398, 0.018272423260246116, 2.307),
]  # fmt: skip


@pytest.mark.parametrize("values", DEAR)
def test_tables_that_do_not_pay_are_not_made(values: tuple[float, ...]) -> None:
    """Weighed in passages they made these runs 8.5 (a slip of 50,000 steps), 1.55, 1.16, 1.13 and 1.21 times as dear as without."""
    scene = ds.Scene(FIG3).replace(**dict(zip(NAMES, values, strict=True)))
    by_map, by_steps = (run(scene, how, 1e-6, {**SAMPLED, "interval": values[-1]}) for how in ("auto", "off"))
    assert by_map.statistics["newton"] <= 1.05 * by_steps.statistics["newton"]


def test_a_long_run_has_every_stick() -> None:
    """To 100 s, 109 slow cycles: 47974 sticks, as by steps at rtol 1e-10; most excursions are taken from an earlier one."""
    result = run(ds.Scene(FIG3, scene={"t_end": 100.0}), "auto", 1e-8, {"interval": 1.0})
    assert sticks(result) == result.summary["sticks"] == 47974
    assert result.statistics["excursions_reused"] > 100
    assert (np.diff(result.events["time"]) > 0).all()
    assert (result.events["kind"][::2] == 1).all() and (result.events["kind"][1::2] == 2).all()


def test_events_of_a_motion_that_repeats_are_a_block(program, tmp_path) -> None:
    """Each event can be had, from memory, from files, and while the run goes on."""
    # A repetition of less than 100,000 events is listed.
    listed, block = (ds.run(FIG3, scene={"t_end": t_end}, output={"interval": 1.0}) for t_end in (80.0, 300.0))
    assert (listed.log["occurs"] == 1).all()
    assert block.log.size < 10000
    assert block.log["occurs"].sum() == block.statistics["events"] == block.events.size == 2 * block.sticks()
    early = block.events_between(-1.0, 79.0)
    expected = listed.events[listed.events["time"] <= 79.0]
    np.testing.assert_array_equal(early["kind"], expected["kind"])
    np.testing.assert_allclose(early["time"], expected["time"], rtol=0.0, atol=1e-12)
    assert block.sticks(79.0) == listed.sticks(79.0)
    assert (np.diff(block.events["time"]) > 0.0).all()
    middle = block.events_between(150.0, 160.0)
    np.testing.assert_array_equal(middle, block.events[(block.events["time"] >= 150.0) & (block.events["time"] <= 160.0)])
    block.save(tmp_path / "saved.h5")
    assert ds.open(tmp_path / "saved.h5").events.tobytes() == block.events.tobytes()
    with ds.Simulation(FIG3, scene={"t_end": 300.0}, output={"interval": 1.0}) as simulation:
        simulation.step_to(200.0)
        np.testing.assert_array_equal(simulation.events["kind"], block.events_between(0.0, 200.0)["kind"])
        np.testing.assert_allclose(simulation.events["time"], block.events_between(0.0, 200.0)["time"], rtol=1e-15)
    program("run", FIG3, "-o", "file.h5", "--quiet", settings=["scene.t_end=300", "output.interval=1"], status=0)
    assert ds.open(tmp_path / "file.h5").events.tobytes() == block.events.tobytes()


def test_more_events_than_an_array_may_have_are_refused() -> None:
    result = ds.run(FIG3, scene={"t_end": 1e6}, output={"interval": 1e6})
    assert result.sticks() > 4e8
    assert result.sticks(10.0) == 5398
    with pytest.raises(ds.UsageError, match="events_between"):
        _ = result.events
    block = result.log[result.log["occurs"] > 1]
    assert result.events_between(5e5, 5e5 + block["period"][0] * (1.0 - 1e-9)).size == block.size


@pytest.mark.parametrize(
    "changes",
    [
        {"drive": {"velocity": 0.05}},
        {"drive": {"velocity": 0.05}, "friction": {"contact": "smoothed", "v_smooth": 1e-5}},
        {"scene": {"model": "low_frequency"}, "system": {"stiffness_y": None}},
        # Two slow cycles.
        {
            "system": {"mass": 0.4, "stiffness_x": 2e4, "stiffness_y": 2e6, "misalignment_deg": 11.6},
            "friction": {"mu_0": 0.25, "mu_inf": 0.18, "v_f": 4e-3, "normal_load": 20.0, "contact": "smoothed", "v_smooth": 1e-6},
        },
    ],
)
def test_what_repeats_without_a_rest_costs_no_more_the_longer_it_lasts(changes: dict) -> None:
    scene = ds.Scene(FIG3, **changes)
    short, long = (ds.run(scene, t_end=end, interval=end) for end in (20.0, 1e6))
    # At most one cycle more.
    assert long.statistics["newton"] < 1.2 * short.statistics["newton"]
    more = (1e6 - 20.0) / short.summary["period"]
    assert long.summary["cycles"] == pytest.approx(short.summary["cycles"] + more, abs=3)
    assert set(long.summary) == set(short.summary)
    for name in ("period", "peak_force", "valley_force", "slip_length", "swing", "lyapunov_exponent"):
        if name in short.summary:
            assert long.summary[name] == pytest.approx(short.summary[name], rel=1e-8), name
    assert long.summary["energy_residual"] < 1e-7


def test_an_excursion_that_has_just_been_dropped_is_not_reused() -> None:
    """Here the end of one excursion drops the earlier one that the same release would reuse: that crashed."""
    stiff = ds.Scene(FIG3, system={"stiffness_y": 53872320.50775176}, integrator={"method": "radau13", "rtol": 1e-6})
    result = ds.run(stiff, scene={"t_end": 50.0}, output={"interval": 1.0})
    stepped = ds.run(stiff, scene={"t_end": 50.0}, output={"interval": 1.0}, integrator={"cycle_map": "off"})
    assert result.summary["cycles"] == stepped.summary["cycles"] > 40
    assert result.summary["period"] == pytest.approx(stepped.summary["period"], rel=1e-3)


def test_slow_cycles_that_repeat_are_leapt_in_their_order() -> None:
    """One stick in each slow cycle, each like the one before: no drift between fast cycles predicts when the next one slips."""
    scene = ds.Scene(FIG3, system={"misalignment_deg": 6.65}, integrator={"method": "radau13", "rtol": 1e-6})
    leapt, stepped = (
        ds.run(scene, scene={"t_end": 50.0}, output={"interval": 1.0}, integrator={"cycle_map": how}) for how in ("auto", "off")
    )
    # By roundoff they are excursions made again, or cycles of a table.
    assert leapt.statistics["cycles_leapt"] > 1000
    assert (np.diff(leapt.events["time"]) >= 0).all()
    assert leapt.summary["cycles"] == stepped.summary["cycles"] > 40
    for name in ("period", "peak_force", "slip_length"):
        assert leapt.summary[name] == pytest.approx(stepped.summary[name], rel=1e-6), name


# Runs that end where they have settled.


@pytest.mark.parametrize("cycle_map", ["auto", "off"])
def test_a_settled_run_ends_after_a_few_cycles(cycle_map: str) -> None:
    settled = ds.run(FIG3, scene={"t_end": 50.0, "settle": 1e-5}, integrator={"cycle_map": cycle_map}, output={"interval": 0.01})
    assert settled.complete and settled.result_code == 0
    assert 2 <= settled.summary["cycles"] <= 4
    # In the valley after the peak at which it had settled.
    ends = settled.summary["settled_at"] + settled.summary["slip_duration"]
    assert settled.time[-1] == pytest.approx(ends, rel=4e-16, abs=0)
    assert settled["spring_force_x"][-1] == pytest.approx(settled.summary["valley_force"], rel=1e-6)
    assert settled.time[-1] < 5.0
    assert (np.diff(settled.time) > 0).all()
    assert settled.events["time"][-1] <= settled.time[-1]


@pytest.mark.parametrize("cycle_map", ["auto", "off"])
def test_what_never_settles_runs_to_its_end(cycle_map: str) -> None:
    scene = ds.Scene(FIG3, t_end=12.0, settle=1e-9, stiffness_y=1e6, cycle_map=cycle_map, interval=0.1)
    result = ds.run(scene)
    assert result.time[-1] == 12.0
    assert result.summary["cycles"] > 8
    assert "settled_at" not in result.summary
    # Nor is the motion another one.
    other = ds.run(scene, scene={"settle": 0.0})
    assert other.events.tobytes() == result.events.tobytes()


@pytest.mark.parametrize("cycle_map", ["auto", "off"])
def test_what_passes_an_unstable_cycle_does_not_repeat(cycle_map: str) -> None:
    """Two of its cycles agree to a thousandth, and end the run."""
    passing = ds.run(FIG3, t_end=400.0, settle=1e-3, stiffness_y=1e6, cycle_map=cycle_map, interval=1.0)
    assert passing.summary["settled_at"] < 400.0
    assert passing.summary["lyapunov_exponent"] > 0.0
    assert (passing.summary["repeats"], passing.summary["regularity"]) in ((0, 0), (0, -1))


@pytest.mark.parametrize("changes", [{}, {"system.damping_x": 2.0}, {"system.stiffness_y": 1e8}])
def test_a_motion_settles_by_laps_as_by_steps(changes: dict[str, float]) -> None:
    """All that a settled run tells, creep up to each peak included; laps are leapt, slips are not."""
    scene = ds.Scene(FIG3, scene={"t_end": 200.0, "settle": 1e-7}, output={"interval": 0.01}).replace(**changes)
    leapt, stepped = (ds.run(scene, integrator={"cycle_map": choice}) for choice in ("auto", "off"))
    assert leapt.statistics["newton"] < 0.5 * stepped.statistics["newton"]
    assert leapt.summary.keys() == stepped.summary.keys()
    for name, value in stepped.summary.items():
        if name not in ("energy_residual", "conditioning"):
            assert leapt.summary[name] == pytest.approx(value, rel=2e-5), name
    np.testing.assert_allclose(leapt["spring_force_x"], stepped["spring_force_x"], atol=1e-5)
    assert leapt.events["time"][-1] <= leapt.time[-1]


@pytest.mark.parametrize("model", ["low_frequency", "full"])
def test_a_settled_run_is_resumed(program, tmp_path, model: str) -> None:
    deck = FIG3 if model == "full" else INPUTS / "low_frequency.nml"
    lasting = ("scene.t_end=1000", "scene.settle=1e-7", "output.interval=1e-5", "output.fields=u_x")
    program("run", deck, "-o", "whole.h5", "--quiet", settings=lasting, status=0)
    done = program("run", deck, "-o", "x.h5", "--quiet", settings=(*lasting, "output.wall_limit=0.02"))
    stops = 0
    while done.returncode == 75:
        stops += 1
        done = program("resume", "x.h5", "--quiet")
    assert done.returncode == 0 and stops > 0
    whole, resumed = ds.open(tmp_path / "whole.h5"), ds.open(tmp_path / "x.h5")
    assert dict(whole.summary) == dict(resumed.summary)
    assert whole.time[-1] == resumed.time[-1] < 100.0
    assert whole["u_x"].tobytes() == resumed["u_x"].tobytes() and whole.events.tobytes() == resumed.events.tobytes()


@pytest.mark.parametrize("method", ["rodas4p", "radau9"])
def test_cases_of_a_sweep_settle(method: str) -> None:
    pytest.importorskip("xarray")
    scene = ds.Scene(INPUTS / "low_frequency.nml", scene={"t_end": 200.0}, integrator={"method": method, "rtol": 1e-7})
    angles = {"system.misalignment_deg": np.linspace(1.0, 6.0, 11)}
    short = ds.sweep(scene, angles, scene={"settle": 1e-4})
    long = ds.sweep(scene, angles)
    assert (short["result_code"] == 0).all()
    assert (short["settled_at"] < 20.0).all()
    for name in ("period", "peak_force", "swing", "slip_length"):
        np.testing.assert_allclose(short[name], long[name], rtol=1e-3, err_msg=name)
    assert "settled_at" not in long or np.isnan(long["settled_at"]).all()


CONDITIONED = {
    "Fig. 3": {"scene": {"t_end": 20.0}},
    "few sticks": {"system": {"stiffness_y": 1e6, "misalignment_deg": 6.0}, "drive": {"velocity": 1e-2}},
    "irregular": {"system": {"stiffness_y": 1e6}, "scene": {"t_end": 8.0}},
    "dampers": {"system": {"damping_x": 0.3, "damping_y": 20.0}},
}


@pytest.mark.parametrize("name", CONDITIONED)
@pytest.mark.filterwarnings("ignore::dynstiction.SamplingWarning")
def test_conditioning_bounds_the_error_of_the_last_events(name: str) -> None:
    """A relative error of rtol in each passage would make that of the time at the end no larger than rtol times the conditioning."""
    scene = ds.Scene(INPUTS / "fig3.nml").replace(output={"interval": 10.0}).replace(**CONDITIONED[name])
    truth = ds.run(scene, integrator={"rtol": 1e-12, "cycle_map": "off"})
    found = []
    for settings in ({"rtol": 1e-8}, {"rtol": 1e-8, "cycle_map": "off"}, {"rtol": 1e-6}, {"rtol": 1e-6, "method": "radau5"}):
        run = ds.run(scene, integrator=settings)
        found.append(run.summary["conditioning"])
        last = min(len(run.events), len(truth.events)) - 1
        error = abs(run.events["time"][last] - truth.events["time"][last])
        assert error <= settings["rtol"] * found[-1] * truth.events["time"][last], settings
    spread = 10.0 if name == "irregular" else 1.001
    assert max(found) <= spread * min(found)
    assert min(found) >= 1.0


@pytest.mark.parametrize("changes", [{"velocity": 1e-2}, {"velocity": 3e-2}, {"velocity": 1e-2, "model": "low_frequency"}])
@pytest.mark.filterwarnings("ignore::dynstiction.SamplingWarning")
def test_conditioning_without_rest(changes: dict) -> None:
    """Slow cycles without a rest count as passages; their error is a shift of the time at the end."""
    scene = ds.Scene(INPUTS / "fig3.nml").replace(output={"interval": 20.0, "fields": ["u_x", "u_x_rate"]}, t_end=20.0, **changes)
    truth = ds.run(scene, integrator={"rtol": 1e-12, "cycle_map": "off"})
    found = []
    for settings in ({"rtol": 1e-6}, {"rtol": 1e-6, "cycle_map": "off"}, {"rtol": 1e-8, "method": "radau5"}):
        run = ds.run(scene, integrator=settings)
        found.append(run.summary["conditioning"])
        shift = abs((run["u_x"][-1] - truth["u_x"][-1]) / truth["u_x_rate"][-1])
        assert shift <= settings["rtol"] * found[-1] * 20.0, settings
    assert 1.0 <= min(found) <= max(found) <= 2.0


@pytest.mark.filterwarnings("ignore::dynstiction.SamplingWarning")
def test_conditioning_grows_as_differences_do() -> None:
    """By the exponent in each slow cycle of an irregular motion, and not at all in one that repeats, however long."""
    scene = ds.Scene(INPUTS / "fig3.nml").replace(output={"interval": 1e5})
    long = [ds.run(scene, scene={"t_end": t_end}).summary["conditioning"] for t_end in (100.0, 1e3, 1e5)]
    assert long[1] == pytest.approx(long[2], rel=0.02)
    assert long[0] == pytest.approx(long[2], rel=0.1)
    irregular = ds.run(scene, system={"stiffness_y": 1e6}, scene={"t_end": 60.0}).summary
    grown = np.log(irregular["conditioning"]) / irregular["cycles"]
    assert grown == pytest.approx(irregular["lyapunov_exponent"], rel=0.15)


@pytest.mark.parametrize(
    "changes",
    [
        {"t_end": 0.0126, "mass": 0.00259, "stiffness_y": 1.44e9, "misalignment_deg": 0.537, "v_f": 0.698, "velocity": 4.64e-5},
        {"t_end": 0.0403, "mass": 0.0403, "stiffness_y": 4.3e8, "misalignment_deg": 2.6, "v_f": 0.00117, "velocity": 0.0401},
    ],
    ids=["all laps alike", "few laps of many steps"],
)
def test_laps_of_a_short_run_are_cheap(changes: dict[str, float]) -> None:
    """Where sticks end is not guessed from two laps that are alike; and laps have the motion inside, or are run."""
    scene = ds.Scene(FIG3).replace(**changes)
    by_map, by_steps = (run(scene, how, 1e-6, {"interval": 1.0}, "radau13") for how in ("auto", "off"))
    assert by_map.statistics["newton"] < 1.15 * by_steps.statistics["newton"]
    assert apart(by_map, by_steps) < 1e-7


@pytest.mark.parametrize("cycle_map", ["auto", "off"])
def test_a_cycle_that_is_reached_from_both_sides_in_turn_is_one(cycle_map: str) -> None:
    """Each slip ends on the other side of the cycle: two of them are nearer to it than one, but are no cycle of two."""
    scene = ds.Scene(
        FIG3,
        scene={"t_end": 13.68},
        system={"mass": 0.068713, "stiffness_x": 941.068, "stiffness_y": 89709.4, "misalignment_deg": 4.18586},
        friction={"mu_0": 0.411973, "mu_inf": 0.342168, "v_f": 0.00392761, "normal_load": 8.06079},
        drive={"velocity": 0.00181177},
    )
    assert run(scene, cycle_map, 1e-5, {"interval": 1.0}, "radau13").summary["repeats"] == 1


def test_errors_of_a_repeated_cycle_do_not_add_up() -> None:
    """Two slips are stepped; the block has the duration of the cycle that they approach."""
    long = {"scene": {"t_end": 300.0}}
    loose, tight = (run(ds.Scene(FIG3, **long), "auto", rtol, {"interval": 300.0}, "radau13") for rtol in (1e-6, 1e-11))
    assert loose.statistics["newton"] < 2000
    assert apart(loose, tight) < 1e-9


def test_steps_of_a_repeated_cycle_are_sampled_in_every_one() -> None:
    """Without an interval each step is a sample, in repetitions as well, of which the next begins where the last one ends."""
    result = ds.run(FIG3, t_end=8.0, integrator={"rtol": 1e-6, "method": "radau13"}, output={"interval": 0.0, "fields": ["u_x"]})
    period = result.summary["period"]
    counts = [np.count_nonzero((result.time >= a) & (result.time < a + period)) for a in np.arange(3.2, 7.0, period)]
    assert min(counts) > 1000
    assert max(counts) - min(counts) <= 2
    assert np.diff(result.time).max() < 0.05
