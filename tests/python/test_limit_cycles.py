"""Limit cycles are those that runs come to, and end where an independent code says."""

from __future__ import annotations

import itertools
import math
import random
import signal
import subprocess
import time

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS, STOPPED, Program

FIG3 = ds.Scene(INPUTS / "fig3.nml")
LIMIT = 2.0
TIGHT = {"method": "radau13", "rtol": 1e-12}

# Angles [deg] at which the stick-slip of Fig. 3's slow model ends, by V [m/s], from another integration of the same equations
# (scipy, Radau with rtol 1e-12), a fold or an amplitude of 5 % of F_0.
ENDS = {
    1e-4: (2.740068864302916, False),
    1e-3: (8.18422726698844, False),
    3e-3: (12.356845808925039, False),
    10e-3: (17.1665104916, False),
    75e-3: (4.3832563823545, True),
}


def slow(scene: ds.Scene) -> ds.Scene:
    """The same scene with the slow model."""
    return scene.replace(scene={"model": "low_frequency"}, system={"stiffness_y": None}, friction={"contact": None})


def at(velocity: float, angle: float, stiffness_y: float = 1e7) -> ds.Scene:
    return FIG3.replace(drive={"velocity": velocity}, system={"misalignment_deg": angle, "stiffness_y": stiffness_y})


@pytest.mark.parametrize(
    ("scene", "within", "ends"),
    [
        (slow(FIG3), 1e-9, {"t_end": 60.0, "settle": 1e-10}),
        (FIG3, 1e-9, {"t_end": 60.0, "settle": 1e-10}),
        (FIG3.replace(system={"damping_x": 0.5, "damping_y": 2.0}), 1e-6, {"t_end": 8.0}),
        (FIG3.replace(friction={"mu_static": 0.22}), 1e-6, {"t_end": 8.0}),
    ],
    ids=["slow", "full", "dampers", "static limit"],
)
def test_the_stable_cycle_is_that_of_a_run(scene: ds.Scene, within: float, ends: dict[str, float]) -> None:
    run = ds.run(scene, scene=ends, integrator=TIGHT, output={"interval": ends["t_end"]})
    found = ds.cycles(scene)
    (cycle,) = found.cycles
    assert found.model == scene.scene.model
    assert cycle.stable
    for name in ("period", "peak_force", "valley_force", "stick_duration", "slip_duration", "slip_length"):
        assert getattr(cycle, name) == pytest.approx(run.summary[name], rel=within), name
    assert cycle.swing == cycle.peak_force - cycle.valley_force


def test_an_unstable_cycle_parts_what_sticks_and_slips_from_what_slides() -> None:
    found = ds.cycles(at(75e-3, 3.5), model="low_frequency")
    small, large = found.cycles
    assert (small.stable, large.stable, found.sliding_is_stable) == (False, True, True)
    assert (found.unstable, found.stable) == ((small,), (large,))
    for share, swing in ((0.999, 0.0), (1.001, large.swing)):
        middle = found.sliding_load
        start = (middle + share * (small.valley_force - middle)) / 1e3
        run = ds.run(slow(at(75e-3, 3.5)), t_end=200.0, interval=200.0, elongation_x=start, velocity_ratio=1.0, **TIGHT)
        assert run.summary["swing"] == pytest.approx(swing, abs=1e-3 * large.swing)


def test_no_cycle_of_a_random_scene_is_overlooked() -> None:
    """Runs from many valleys end at one of the stable cycles, or in steady sliding where that is stable."""
    chance = random.Random(18)
    ended = set()
    for _ in range(7):
        velocity = math.exp(chance.uniform(math.log(5e-3), math.log(0.15)))
        scene = slow(at(velocity, chance.uniform(1.0, 12.0)))
        found = ds.cycles(scene)
        swings = [cycle.swing for cycle in found.stable] + ([0.0] if found.sliding_is_stable else [])
        for share in (0.02, 0.3, 2.0):
            start = (found.sliding_load - share * LIMIT) / 1e3
            run = ds.run(scene, t_end=200.0, interval=200.0, elongation_x=start, velocity_ratio=1.0, method="radau13", rtol=1e-8)
            nearest = min(swings, key=lambda swing: abs(swing - run.summary["swing"]))
            assert run.summary["swing"] == pytest.approx(nearest, abs=0.02 * LIMIT), (scene.groups(), share)
            ended.add(nearest == 0.0)
    assert ended == {True, False}


TWO = FIG3.replace(system={"misalignment_deg": 0.381358, "stiffness_y": 3.05718e6}, drive={"velocity": 0.00402966})
"""It repeats after two slow cycles."""


@pytest.mark.parametrize(("scene", "model", "within"), [(at(75e-3, 3.5), "low_frequency", 1e-10), (TWO, "full", 1e-6)])
def test_cycles_of_mirrored_scenes_are_the_same(scene: ds.Scene, model: str, within: float) -> None:
    velocity, angle = scene.drive.velocity, scene.system.misalignment_deg
    assert velocity is not None and angle is not None
    first = ds.cycles(scene, model=model).cycles
    for mirror in ({"velocity": -velocity}, {"misalignment_deg": -angle}, {"misalignment_deg": 180.0 - angle}):
        for cycle, mirrored in zip(first, ds.cycles(scene.replace(**mirror), model=model).cycles, strict=True):
            assert mirrored == pytest.approx(cycle, rel=within)


def end_of_stick_slip(key: str, inside: float, outside: float, **scene: float) -> float:
    """Where the swing of the largest stable cycle of Fig. 3's slow model falls below 5 % of F_0, or the cycle ceases."""

    def goes_on(value: float) -> bool:
        cycles = ds.cycles(slow(at(**{"velocity": 1e-3, "angle": 1.0} | scene | {key: value}))).stable
        return bool(cycles) and cycles[-1].swing >= 0.05 * LIMIT

    assert goes_on(inside) and not goes_on(outside)
    while abs(outside - inside) > 2e-12 * outside:
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if goes_on(middle) else (inside, middle)
    return outside


@pytest.mark.parametrize(("velocity", "end"), ENDS.items())
def test_ends_of_stick_slip_are_those_of_another_code(velocity: float, end: tuple[float, bool]) -> None:
    """At a fold two cycles meet, elsewhere the swing is least."""
    found = end_of_stick_slip("angle", 0.99 * end[0], 1.01 * end[0], velocity=velocity)
    assert found == pytest.approx(end[0], rel=1e-10)
    inside, beyond = (ds.cycles(slow(at(velocity, found * (1.0 + side * 1e-4)))) for side in (-1, 1))
    if end[1]:
        assert ([cycle.stable for cycle in inside.cycles], beyond.cycles) == ([False, True], ())
    else:
        # With a slow drive abruptly.
        least = 0.04 * LIMIT if velocity == 3e-3 else 0.0
        assert inside.stable[-1].swing > 0.05 * LIMIT > beyond.stable[-1].swing > least


def test_ends_in_velocity_are_those_in_the_angle() -> None:
    """Where stick-slip at 3.5 degrees ends, it ends at 3.5 degrees; the upper end is a fold, known from another integration."""
    high = end_of_stick_slip("velocity", 0.09, 0.1, angle=3.5)
    assert high == pytest.approx(0.0925838509277, rel=1e-11)
    for velocity in (end_of_stick_slip("velocity", 1e-3, 1e-4, angle=3.5), high):
        assert end_of_stick_slip("angle", 3.4, 3.6, velocity=velocity) == pytest.approx(3.5, rel=1e-8)


# Where the slow motion stands for the full one.


def test_where_the_slow_motion_does_not_hold_it_does_not_answer() -> None:
    rigs: tuple[dict[str, float], ...] = (
        {},
        {"mass": 0.4, "stiffness_x": 2e4, "mu_0": 0.25, "mu_inf": 0.18, "v_f": 4e-3, "normal_load": 20.0},
        {"mass": 1.0, "stiffness_x": 5e3, "mu_0": 0.30, "mu_inf": 0.25, "v_f": 0.010, "normal_load": 20.0},
    )
    for rig, ratio in itertools.product(rigs, (1.0, 2.0, 10.0, 100.0, 300.0)):
        scene = at(1e-3, 9.0, ratio * rig.get("stiffness_x", 1e3)).replace(**rig)
        with pytest.raises(ds.DeckError, match="model 'full'"):
            ds.cycles(scene, model="low_frequency")
    constant = FIG3.replace(friction={"law": "constant", "mu_inf": None, "v_f": None})
    assert ds.cycles(constant, model="low_frequency").cycles == ()


def test_a_drive_with_several_velocities_has_no_single_answer() -> None:
    profile = FIG3.replace(drive={"time": [0.0, 1.0, 1.0], "velocity": [1e-3, 1e-3, 2e-3]})
    for question in (ds.cycles, ds.Scene.stability, ds.critical_misalignment):
        with pytest.raises(ds.UsageError, match="several velocities"):
            question(profile)
    stops = FIG3.replace(drive={"time": [0.0, 1.0, 1.0, 2.0], "velocity": [1e-3, 1e-3, 0.0, 0.0]})
    assert ds.cycles(stops).cycles == ds.cycles(FIG3).cycles


# The full model: regular and irregular motion.


@pytest.mark.parametrize(
    ("changes", "verdict", "exponent", "within"),
    [
        ({}, 1, -9.17, 0.05),
        ({"friction": {"contact": "smoothed", "v_smooth": 1e-7}, "scene": {"t_end": 14.0}}, 1, -9.17, 0.1),
        ({"system": {"stiffness_y": 1e6}, "scene": {"t_end": 100.0}}, -1, 2.3, 0.5),
        ({"system": {"stiffness_y": 5e6}, "scene": {"t_end": 30.0}}, 1, -1.28, 0.05),
    ],
)
def test_a_run_says_whether_it_is_regular(changes: dict, verdict: int, exponent: float, within: float) -> None:
    run = ds.run(FIG3.replace(**changes), integrator={"method": "radau13", "rtol": 1e-9}, output={"interval": 1.0})
    assert run.summary["regularity"] == verdict
    assert run.summary["lyapunov_exponent"] == pytest.approx(exponent, abs=within)
    assert (run.summary["period_scatter"] > 1e-4 * run.summary["period"]) == (verdict < 0)


def test_two_motions_part_as_the_exponent_says() -> None:
    """Of an irregular scene: the distance of two motions, from slow cycle to slow cycle."""
    scene = FIG3.replace(system={"stiffness_y": 1e6}, scene={"t_end": 14.0}, output={"interval": 1e-3, "fields": ["u_x"]})
    tight = {"method": "radau13", "rtol": 1e-12}
    loads = [ds.run(scene, integrator=tight, initial={"elongation_x": 1e-3 * (1.0 + push)})["u_x"] for push in (0.0, 1e-9)]
    apart = np.abs(loads[0] - loads[1]).reshape(-1)[:-1].reshape(14, -1).max(axis=1) / 2e-3
    growth = np.log(apart[7] / apart[1]) / (6.0 / 0.886)
    assert growth == pytest.approx(2.3, abs=0.9)


def test_an_irregular_scene_has_many_unstable_cycles() -> None:
    scene = FIG3.replace(system={"stiffness_y": 1e6})
    found = ds.cycles(scene)
    assert found.regularity is not None
    assert found.regularity.verdict == "irregular"
    assert len(found.cycles) > 5
    assert not found.stable
    # Each has its own: the map alternately decreases and increases where it crosses the diagonal.
    known = {(round(cycle.log_multiplier, 3), round(cycle.period, 6)) for cycle in found.cycles}
    assert len(known) == len(found.cycles)
    assert found.regularity.exponent > 5 * found.regularity.error
    mean, scatter = found.regularity.mean["period"], found.regularity.scatter["period"]
    periods = [cycle.period for cycle in found.cycles]
    assert min(periods) < mean < max(periods)
    assert 1e-3 * mean < scatter < 0.05 * mean


def test_several_stable_cycles_of_the_full_model_are_all_found() -> None:
    """At k_y = 5e6 N/m the fast oscillation may have one or more periods more or less in a slow cycle."""
    found = ds.cycles(FIG3.replace(system={"stiffness_y": 5e6}))
    cycles = sorted(found.cycles, key=lambda cycle: cycle.period)
    assert [cycle.stable for cycle in cycles] == [True, False, True]
    assert found.regularity is not None
    assert found.regularity.verdict == "regular"
    assert found.regularity.exponent == cycles[2].log_multiplier
    run = ds.run(FIG3, system={"stiffness_y": 5e6}, scene={"t_end": 30.0}, integrator={"rtol": 1e-10}, output={"interval": 1.0})
    assert cycles[2].log_multiplier == pytest.approx(run.summary["lyapunov_exponent"], abs=1e-3)


# The release map: what repeats, after how many slow cycles.

FAST = FIG3.replace(
    mass=0.12843404516110027, misalignment_deg=2.636206398074764, stiffness_y=2540.1376172650675,
    mu_inf=0.17256450051088845, v_f=0.04166683247099321, velocity=0.00013293200356692174,
)  # fmt: skip


def releases(scene: ds.Scene, t_end: float, steps: dict[str, object]) -> np.ndarray:
    """Times of the releases of a run by steps."""
    run = ds.run(scene, t_end=t_end, interval=t_end, fields=["u_x"], cycle_map="off", **steps)
    return run.events["time"][run.events["kind"] == 2]


def releases_from(scene: ds.Scene, angle: float, t_end: float, steps: dict[str, object]) -> np.ndarray:
    """Of a run that begins with the release at this angle."""
    x, y = scene.system.stiffness_x, scene.system.stiffness_y
    begun = {"elongation_x": LIMIT * math.cos(angle) / x, "elongation_y": LIMIT * math.sin(angle) / y}
    return releases(scene.replace(velocity_ratio=0.0, **begun), t_end, steps)


def test_the_fast_oscillation_alone_is_a_cycle_and_steady_sliding_is_none() -> None:
    found = ds.cycles(FAST)
    (cycle,) = found.cycles
    assert (cycle.slow_cycles, cycle.stable, found.regularity.verdict) == (0, True, "regular")
    # It settles slowly: by 1.7 % in each.
    between = np.diff(releases(FAST, 150.0, {"method": "radau13", "rtol": 1e-10}))[-20:]
    assert between == pytest.approx(cycle.period, rel=1e-7)
    assert cycle.swing < 0.01 * LIMIT
    found = ds.cycles(at(1e-3, 12.0))
    assert (found.cycles, found.regularity.verdict, found.regularity.repeats) == ((), "steady sliding", 0)
    assert np.isnan(found.regularity.exponent)
    assert np.isnan(found.regularity.error)


def test_a_motion_that_repeats_after_two_slow_cycles() -> None:
    found = ds.cycles(TWO)
    assert (found.regularity.verdict, found.regularity.repeats) == ("regular", 2)
    (stable,), (unstable,) = found.stable, found.unstable
    assert (stable.slow_cycles, unstable.slow_cycles) == (2, 1)
    assert found.regularity.exponent == pytest.approx(stable.log_multiplier / 2)
    back = np.diff(releases(TWO, 15.0, {"method": "radau13", "rtol": 1e-10}))[::-1].cumsum()
    assert np.abs(back / stable.period - 1).min() < 1e-8 < np.abs(2 * back / stable.period - 1).min()
    assert unstable.period == pytest.approx(stable.period / 2, rel=1e-3)
    # The unstable one lies between the two slow cycles that it parted into.
    assert stable.valley_force < unstable.valley_force
    # Means are over whole repetitions, after an even number of slow cycles or an odd one.
    for t_end in (14.0, 14.3, 14.6, 14.9):
        run = ds.run(TWO, scene={"t_end": t_end}, integrator={"method": "radau13", "rtol": 1e-11}, output={"interval": t_end})
        assert run.summary["repeats"] == 2
        for name in ("period", "stick_duration", "slip_duration", "slip_length"):
            scale = 2 if name == "period" else 1
            assert scale * run.summary[name] == pytest.approx(getattr(stable, name), rel=1e-6), (name, t_end)


def test_an_irregular_beginning_is_no_irregular_motion() -> None:
    """After some 30 to 80 irregular slow cycles it repeats after two of 4.193310 and 4.193816 s, at every tolerance."""
    found = ds.cycles(FIG3.replace(drive={"velocity": 2e-4}))
    assert (found.regularity.verdict, found.regularity.repeats) == ("regular", 2)
    assert found.regularity.exponent == pytest.approx(-0.172, abs=0.002)
    assert found.stable[0].period == pytest.approx(4.193310 + 4.193816, abs=2e-6)


FEW = FIG3.replace(
    mass=0.11810069680474723, misalignment_deg=19.705913050320426, stiffness_y=10717.48146869197,
    mu_inf=0.07208458490660812, v_f=0.01989111302206811, velocity=0.00016333553636584846,
)  # fmt: skip
OTHERS = FIG3.replace(
    mass=0.003146045936841037, misalignment_deg=0.7182818178738907, stiffness_y=8877557.575645091,
    mu_inf=0.05153929994043587, v_f=0.003616128958358883, velocity=0.03969562397834232,
)  # fmt: skip


def test_every_cycle_of_few_slow_cycles_repeats_itself() -> None:
    """Unstable ones as well: a run that begins with the release of a cycle has it, and the next one, again after its period."""
    found = ds.cycles(FEW)
    assert (found.regularity.verdict, found.regularity.repeats) == ("irregular", 0)
    assert found.regularity.exponent > 5 * found.regularity.error > 0
    assert found.regularity.searched >= 4
    seen = [(cycle, angle) for cycle, angle in zip(found.cycles, found.release_angle, strict=True) if cycle.slow_cycles <= 4]
    assert {cycle.slow_cycles for cycle, _ in seen} == {1, 2, 3, 4}
    for cycle, angle in seen:
        release = np.append(0.0, releases_from(FEW, angle, cycle.period + 8.0, TIGHT))
        again = release[:2] + cycle.period
        assert np.abs(again[:, None] - release).min(axis=1).max() < 1e-9 * cycle.period, cycle


def test_cycles_to_which_only_other_motions_come() -> None:
    found = ds.cycles(OTHERS)
    assert len(found.stable) == 2
    assert found.regularity.repeats == 1
    tight = OTHERS.replace(t_end=8.0, interval=8.0, method="radau13", rtol=1e-10)
    starts = (tight, tight.replace(elongation_x=1e-3, elongation_y=-1e-7))
    periods = sorted(ds.run(start).summary["period"] for start in starts)
    assert periods == pytest.approx(sorted(cycle.period for cycle in found.stable), rel=1e-7)


@pytest.mark.parametrize(("angle", "stiffness_y"), [(3.5, 1e7), (3.9, 1e8)])
def test_stick_slip_is_found_from_steady_sliding(angle: float, stiffness_y: float) -> None:
    """Both are stable: which of them a motion comes to is decided by its beginning."""
    stick_slip = at(75e-3, angle, stiffness_y)
    found = ds.cycles(stick_slip)
    assert found.sliding_is_stable
    load = found.sliding_load
    across = load * math.tan(math.radians(angle)) / stiffness_y
    sliding = stick_slip.replace(initial={"velocity_ratio": 1.0, "elongation_x": load / 1e3, "elongation_y": across})
    other = ds.cycles(sliding)
    assert (other.regularity.verdict, found.regularity.verdict) == ("steady sliding", "regular")
    assert len(found.stable) == 1
    assert other.stable[0].period == pytest.approx(found.stable[0].period, rel=1e-9)
    least, most = (ds.run(scene, output={"interval": 1.0}).summary["swing"] for scene in (sliding, stick_slip))
    assert least < 1e-6 < most


# The command.


def test_the_command(program: Program) -> None:
    """What is known if the search is stopped: some 20,000 sticks in a slow cycle. Refusals name the remedy."""
    fold = ["drive.velocity=0.075", "system.misalignment_deg=3.5", "system.stiffness_y=1e9"]
    told = program("cycles", INPUTS / "fig3.nml", settings=fold, status=0).stdout
    assert "model full" in told and "apparent static friction" in told
    for settings, remedy in (
        (["system.misalignment_deg=0"], "change it a little"),
        (["drive.velocity=0"], "give one value"),
        (["scene.model=high_frequency", "initial.elongation_x=1e-3"], "give 'full' or 'low_frequency'"),
        (["friction.contact=smoothed", "friction.v_smooth=1e-7"], "contact 'exact'"),
    ):
        assert remedy in program("cycles", INPUTS / "fig3.nml", settings=settings, status=2).stderr
    many = FIG3.replace(
        mass=0.00736305136761138, misalignment_deg=0.26351469481281053, stiffness_y=34763446.02554201,
        mu_inf=0.09476532229353388, v_f=0.029872538167948545, velocity=0.0013755287024585605,
    )  # fmt: skip
    (program.folder / "many.nml").write_text(many.to_deck())
    search = program.start("cycles", "many.nml", stdout=subprocess.PIPE)
    time.sleep(2.0)
    search.send_signal(signal.SIGINT)
    output, errors = search.communicate(timeout=60)
    assert search.returncode == STOPPED
    assert "steady sliding is" in output
    assert "stopped by SIGINT: there may be more cycles" in errors


# What a run says of its motion.


def peaks_of(run: ds.Result) -> np.ndarray:
    """The peaks of the load [m], each from a parabola through three samples."""
    u = run["u_x"]
    at = np.flatnonzero((u[1:-1] >= u[:-2]) & (u[1:-1] > u[2:])) + 1
    before, here, after = u[at - 1], u[at], u[at + 1]
    return here - (before - after) ** 2 / (8.0 * (before - 2.0 * here + after))


def test_the_exponent_of_a_motion_without_rest_is_how_its_cycles_approach_each_other() -> None:
    scene = at(75e-3, 3.5)
    run = ds.run(scene, integrator={"rtol": 1e-10}, output={"interval": 10.0})
    assert run.summary["repeats"] == 1
    close = ds.run(scene, scene={"t_end": 1.2}, integrator={"rtol": 1e-11}, output={"interval": 1e-5, "fields": ["u_x"]})
    peaks = peaks_of(close)
    apart = np.abs(np.diff(peaks[peaks > 0.5 * peaks.max()]))[4:9]
    assert run.summary["lyapunov_exponent"] == pytest.approx(np.log(apart[1:] / apart[:-1]).mean(), abs=2e-3)
    assert run.summary["lyapunov_error"] < 1e-4
    for other in ({"cycle_map": "off"}, {"method": "dopri5", "rtol": 1e-8}, {"method": "radau5"}):
        summary = ds.run(scene, integrator=other, output={"interval": 10.0}).summary
        assert summary["lyapunov_exponent"] == pytest.approx(run.summary["lyapunov_exponent"], abs=1e-4), other
    (cycle,) = ds.cycles(scene).cycles
    assert cycle.log_multiplier == pytest.approx(run.summary["lyapunov_exponent"], abs=1e-8)


@pytest.mark.parametrize(("velocity", "angle", "within"), [(75e-3, 3.5, 1e-5), (1e-3, 1.0, 0.1), (1e-3, 8.0, 0.1)])
def test_the_exponent_of_the_slow_motion_is_the_multiplier_of_its_cycle(velocity: float, angle: float, within: float) -> None:
    """The multiplier of Fig. 3 is exp(-92524)."""
    scene = slow(at(velocity, angle)).replace(scene={"t_end": 40.0})
    run = ds.run(scene, output={"interval": 40.0})
    (stable,) = ds.cycles(scene).stable
    assert run.summary["lyapunov_exponent"] == pytest.approx(stable.log_multiplier, abs=within)


@pytest.mark.parametrize(
    ("velocity", "angle", "t_end", "verdict"),
    [(1e-3, 1.0, 10.0, 1), (1e-3, 12.0, 10.0, 2), (75e-3, 4.6, 10.0, 3), (75e-3, 20.0, 10.0, 2), (1e-3, 1.0, 0.3, 0)],
)
def test_every_run_under_a_steady_drive_says_what_its_motion_is(velocity: float, angle: float, t_end: float, verdict: int) -> None:
    """It repeats, slides steadily, rings down, or has not gone on for long enough."""
    full = at(velocity, angle).replace(t_end=t_end, interval=t_end)
    for scene in (full, full.replace(cycle_map="off"), slow(full)):
        assert ds.run(scene).summary["regularity"] == verdict
        drive = {"time": [0.0, 0.5 * t_end, t_end], "velocity": [velocity, velocity, 2 * velocity]}
        assert "regularity" not in ds.run(scene, drive=drive).summary


def test_a_fast_object_oscillates_before_it_is_said_to_slide() -> None:
    """After half a period of its free oscillation it has come many lengths F_0/k_x far."""
    inert = FIG3.replace(system={"mass": 1.0}, drive={"velocity": 0.5})
    for t_end in (0.08, 0.3, 1.0):
        assert ds.run(inert, scene={"t_end": t_end}, output={"interval": t_end}).summary["regularity"] == 0


def test_a_fast_cycle_that_laps_come_to_too_slowly() -> None:
    """Differences shrink by a thousandth in each of 300,000 laps: Newton's method finds where these end."""
    slow_laps = FIG3.replace(mass=3.4868651e-3, stiffness_y=59628585.2, misalignment_deg=11.53632)
    slow_laps = slow_laps.replace(mu_inf=0.0610707833, v_f=0.043051494, velocity=2.4422e-4)
    found = ds.cycles(slow_laps)
    (cycle,) = found.stable
    assert found.regularity.verdict == "regular"
    assert (cycle.slow_cycles, cycle.log_multiplier) == (0, pytest.approx(-8.59e-4, rel=0.01))
    # A run from its release stays on it.
    again = releases_from(slow_laps, found.release_angle[0], 20.0 * cycle.period, {"rtol": 1e-11})
    np.testing.assert_allclose(np.diff(again), cycle.period, rtol=1e-7)


def test_a_cycle_reached_from_both_sides_has_one_exponent() -> None:
    """Here each slow cycle is one passage, which ends a little above and a little below the release of the cycle in turn."""
    scene = ds.Scene(
        t_end=0.6, mass=0.0587, stiffness_x=22250.0, stiffness_y=1.5e5, misalignment_deg=-7.57, damping_x=2.54, damping_y=17.3,
        law="stribeck", mu_0=0.68, mu_inf=0.405, v_f=3.89e-3, viscous=0.053, normal_load=0.677, exponent=1.0, velocity=1.464e-3,
        interval=0.1,
    )  # fmt: skip
    (cycle,) = ds.cycles(scene).stable
    assert cycle.log_multiplier == pytest.approx(-0.89, abs=0.02)
    for rtol in (1e-5, 1e-7, 1e-9):
        for cycle_map in ("auto", "off"):
            run = ds.run(scene, integrator={"rtol": rtol, "cycle_map": cycle_map})
            assert (run.summary["repeats"], run.summary["regularity"]) == (1, 1)
            assert run.summary["lyapunov_exponent"] == pytest.approx(cycle.log_multiplier, abs=10 * rtol + 1e-6), (rtol, cycle_map)


@pytest.mark.parametrize("cycle_map", ["auto", "off"])
def test_eight_slow_cycles_with_two_peaks_each_repeat(cycle_map: str) -> None:
    scene = FIG3.replace(
        misalignment_deg=6.794208244504857, velocity=8.734085522767699e-4, mass=2.4150237382024167, mu_inf=0.1418302626248151,
        v_f=2.9354535228202517e-3, stiffness_y=25530.780895050255, t_end=350.0, cycle_map=cycle_map,
    )  # fmt: skip
    (cycle,) = ds.cycles(scene).stable
    said = ds.run(scene, output={"interval": 1e9, "fields": ["u_x"]}).summary
    assert (said["repeats"], said["regularity"]) == (16, 1)
    assert said["repeats"] * said["period"] == pytest.approx(cycle.period, rel=1e-7)
    assert said["repeats"] * said["lyapunov_exponent"] == pytest.approx(cycle.log_multiplier, rel=1e-4)


def test_a_repetition_that_has_just_set_in_has_the_exponent_of_its_cycle() -> None:
    """Eight peaks of the load in six turns of the force, after an irregular beginning."""
    scene = FIG3.replace(
        mass=0.47747611209378393, stiffness_x=6300.89920189386, stiffness_y=365943.7713153857, misalignment_deg=3.2563746444553288,
        mu_0=0.15039926972148066, mu_inf=0.10970037522583123, v_f=0.003252046142968699, normal_load=24.397929900405437,
        velocity=0.0028969639683968777, rtol=1e-10, interval=1000.0,
    )  # fmt: skip
    found = [ds.run(scene, t_end=t_end).summary for t_end in (122.0, 122.747, 124.0, 128.0, 200.0, 460.0)]
    exponents = [each["lyapunov_exponent"] for each in found if each["repeats"] > 0]
    assert len(exponents) > 1 and exponents == pytest.approx([-0.09771819] * len(exponents), rel=1e-3)


def test_a_cycle_to_which_a_motion_without_a_rest_comes_is_listed_once() -> None:
    scene = at(0.022558003, 2.806758529, 1326.998763).replace(mass=0.393886974, mu_inf=0.18940855, v_f=0.00225921973)
    (cycle,) = ds.cycles(scene).cycles
    assert cycle.stable and cycle.log_multiplier == pytest.approx(-2.587134, abs=1e-4)


def test_a_cycle_without_a_rest_is_waited_for() -> None:
    """Differences shrink by a hundredth in a cycle, so that it has not settled after the usual time."""
    scene = at(0.0234, 3.5627, 2.6252e5).replace(mass=1.1628, mu_inf=0.18802, v_f=5.3465e-3)
    (cycle,) = ds.cycles(scene).stable
    settled = ds.run(scene, t_end=600.0, interval=1e9, fields=["u_x"]).summary
    assert cycle.period == pytest.approx(settled["period"], rel=1e-6)
    assert cycle.log_multiplier == pytest.approx(settled["lyapunov_exponent"], rel=1e-2)
