"""Derivatives of cycles and of runs obey units, and agree with those of changed scenes."""

from __future__ import annotations

import signal
import time
from subprocess import PIPE

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS, SCRIPT, Program

FIG3 = ds.Scene(INPUTS / "fig3.nml")
SCENES = {
    "Fig. 3": {},
    "dampers and a static limit, backwards": {
        "damping_x": 0.3, "damping_y": 20.0, "misalignment_deg": -3.0, "mu_static": 0.21, "velocity": -2e-3
    },
    "few sticks": {"stiffness_y": 1e6, "misalignment_deg": 6.0, "velocity": 1e-2},
    "four slow cycles": {"stiffness_y": 4e5, "misalignment_deg": 5.0, "velocity": 5e-3},
    "Stribeck": {"law": "stribeck", "exponent": 1.5},
}  # fmt: skip
MASS, LENGTH, TIME = np.eye(3)
FORCE = MASS + LENGTH - 2.0 * TIME
UNITS = {
    "system.mass": MASS,
    "system.stiffness_x": FORCE - LENGTH,
    "system.stiffness_y": FORCE - LENGTH,
    "system.damping_x": FORCE - LENGTH + TIME,
    "system.damping_y": FORCE - LENGTH + TIME,
    "friction.normal_load": FORCE,
    "friction.v_f": LENGTH - TIME,
    "drive.velocity": LENGTH - TIME,
}


def settled(scene: ds.Scene) -> np.ndarray:
    """Measures of the cycle to which it settles."""
    cycle = ds.cycles(scene).stable[-1]
    return np.array(cycle[:6])


@pytest.mark.parametrize("name", SCENES)
def test_physics_does_not_hang_on_units(name: str) -> None:
    """If mass, length and time are counted in other units, every number changes by its own powers of them."""
    found = ds.sensitivity(FIG3.replace(**SCENES[name]))
    powers = np.array([UNITS.get(key, np.zeros(3)) for key in found.parameters])
    assert np.all(np.abs(found.elasticities) < 100.0)
    expected = [TIME, FORCE, FORCE, TIME, TIME, LENGTH]
    np.testing.assert_allclose(found.elasticities @ powers, expected, rtol=0.0, atol=3e-6)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("Fig. 3", "system.misalignment_deg"),
        ("Fig. 3", "friction.mu_0"),
        ("dampers and a static limit, backwards", "drive.velocity"),
        ("dampers and a static limit, backwards", "system.damping_y"),
        ("few sticks", "friction.mu_inf"),
        ("four slow cycles", "friction.v_f"),
        ("Stribeck", "friction.exponent"),
    ],
)
def test_derivatives_are_those_of_the_cycle(name: str, key: str) -> None:
    scene = FIG3.replace(**SCENES[name])
    found = ds.sensitivity(scene, key)
    value = found.parameters[key]
    near = [settled(scene.replace(**{key: value * (1.0 + change)})) for change in (-1e-6, 1e-6)]
    measures = np.array([*found.cycle.values()])
    np.testing.assert_allclose(measures, settled(scene), rtol=1e-9)
    difference = (near[1] - near[0]) / 2e-6 / measures
    np.testing.assert_allclose(found.elasticities[:, 0], difference, rtol=1e-5, atol=1e-5)


def test_parameters() -> None:
    """By name with or without its group; by default all that the deck gives."""
    every = ds.sensitivity(FIG3)
    two = ds.sensitivity(FIG3, ["mass", "friction.v_f"])
    assert [*two.parameters.items()] == [("system.mass", 0.25), ("friction.v_f", 0.01)]
    given = FIG3.groups()
    keys = {f"{group}.{key}" for group in ("system", "friction", "drive") for key in given[group]}
    assert set(every.parameters) == keys - {"friction.law", "friction.contact"}
    places = [[*every.parameters].index(key) for key in two.parameters]
    np.testing.assert_array_equal(two.derivatives, every.derivatives[:, places])
    assert len(str(every).splitlines()) == 1 + len(every.parameters)


@pytest.mark.parametrize(
    ("groups", "key", "kind"),
    [
        ({"system": {"stiffness_y": 1e6}}, "mass", ds.UsageError),
        ({}, "scene.t_end", ds.UsageError),
        ({}, "mas", ds.DeckError),
        ({"friction": {"contact": "smoothed", "v_smooth": 1e-6}}, "mass", ds.DeckError),
        ({"drive": {"velocity": 0.5}}, "mass", ds.UsageError),
    ],
)
def test_what_has_no_derivative_is_refused(groups: dict, key: str, kind: type[ds.Error]) -> None:
    with pytest.raises(kind):
        ds.sensitivity(FIG3.replace(**groups), key)


@pytest.mark.deck
def test_the_command_says_the_same(executable: str, tmp_path) -> None:
    keys = ["system.mass", "drive.velocity"]
    done = Program((executable,), tmp_path)("cycles", INPUTS / "fig3.nml", "--sensitivity", ",".join(keys))
    rows = [line.split() for line in done.stdout.splitlines() if line.split()[:1] in ([key] for key in keys)]
    assert [row[0] for row in rows] == keys
    found = ds.sensitivity(FIG3, keys)
    np.testing.assert_allclose(np.array([row[1:] for row in rows], float).T, found.elasticities, atol=1e-4)


def test_figure() -> None:
    found = ds.sensitivity(FIG3)
    figure = ds.plot(found)
    assert len(figure.axes) == len(found.cycle)
    for axis, changes in zip(figure.axes, found.elasticities, strict=True):
        assert [bar.get_width() for bar in axis.patches] == list(changes)
    with pytest.raises(ds.UsageError):
        ds.plot(found, "map")


RUNS = {
    "Fig. 3": {"t_end": 0.2},
    "slip from a start, by a table, reversed": {
        "t_end": 0.4, "law": "table", "mu_0": None, "mu_inf": None, "v_f": None,
        "table_speed": (0.0, 0.01, 0.1), "table_mu": (0.2, 0.17, 0.15),
        "time": (0.0, 0.1, 0.3), "velocity": (0.01, 0.01, -0.02),
        "velocity_ratio": 0.5, "elongation_x": 5e-4, "elongation_y": -1e-7,
    },
    "dampers, a ramp and a jump": {
        "t_end": 0.35, "damping_x": 0.3, "damping_y": 20.0, "mu_static": 0.21,
        "time": (0.0, 0.1, 0.2, 0.2), "velocity": (8e-3, 8e-3, 2e-2, 5e-3),
    },
    "ageing": {"t_end": 0.4, "stiffness_y": 1e6, "misalignment_deg": 5.0, "ageing": 2e-3, "ageing_time": 1e-3},
    "ageing, dampers, a ramp and a jump": {
        "t_end": 0.35, "damping_x": 0.3, "damping_y": 20.0, "stiffness_y": 1e5, "mu_static": 0.21, "ageing": 0.01, "ageing_time": 2e-3,
        "time": (0.0, 0.1, 0.2, 0.2), "velocity": (8e-3, 8e-3, 2e-2, 5e-3),
    },
    "low_frequency": {"t_end": 1.2, "model": "low_frequency", "misalignment_deg": 3.0},
    "smoothed": {"t_end": 0.3, "contact": "smoothed", "v_smooth": 1e-5, "velocity": 1e-2},
}  # fmt: skip
COLUMNS = ("u_x", "u_y", "w_x", "w_y", "X", "theta", "friction", "pull_force")
KEYS_OF_RUNS = ("mass", "stiffness_y", "misalignment_deg", "normal_load")


def run_of(name: str) -> ds.Scene:
    settings = {"rtol": 1e-12, "cycle_map": "off"}
    output = {"interval": 3.3e-3, "fields": COLUMNS}
    return FIG3.replace(**RUNS[name]).replace(integrator=settings, output=output)


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.filterwarnings("ignore::dynstiction.SamplingWarning")
def test_derivatives_are_those_of_the_run(name: str) -> None:
    """Samples and events by differences of fourth order: of runs that are near where they magnify changes."""
    scene = run_of(name)
    keys = [key for key in KEYS_OF_RUNS if scene.scene.model == "full" or key != "stiffness_y"]
    found = ds.derivatives(scene, keys + [key for key in ("elongation_x", "ageing", "ageing_time") if key in RUNS[name]])
    run = ds.run(scene)
    np.testing.assert_array_equal(found.time, run.time)
    np.testing.assert_array_equal(found.events, run.events)
    for place, (key, value) in enumerate(found.parameters.items()):
        changes = {column: found.derivatives[column][:, place] * value for column in COLUMNS}
        size = {column: np.abs(run[column]).max() or 1.0 for column in COLUMNS}
        magnified = max(1.0, *(np.abs(changes[c]).max() / size[c] for c in ("u_x", "u_y", "w_x", "w_y")))
        step = min(1e-4, 1e-3 / magnified)
        near = [ds.run(scene.replace(**{key: value * (1.0 + i * step)})) for i in (-2, -1, 1, 2)]
        assert all(len(one.events) == len(run.events) for one in near)
        weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * step)
        shift = found.event_derivatives[:, place] * value
        by_runs = weights @ np.array([one.events["time"] for one in near])
        np.testing.assert_allclose(shift, by_runs, rtol=0.0, atol=1e-6 * run.time[-1])
        # Where slip begins or ends between the runs, their columns have kinks.
        ends = np.abs(found.time[:, np.newaxis] - run.events["time"]) < 3.0 * step * np.abs(shift)
        smooth = ~ends.any(axis=1)
        assert smooth.mean() > 0.9
        for column in COLUMNS:
            by_runs = weights @ np.array([one[column] for one in near])
            scale = max(np.abs(changes[column]).max(), size[column])
            np.testing.assert_allclose(
                changes[column][smooth], by_runs[smooth], rtol=0.0, atol=1e-6 * scale, err_msg=f"{key}, {column}"
            )


@pytest.mark.parametrize("name", ["Fig. 3", "few sticks", "Stribeck"])
def test_slow_cycles_of_a_run_change_as_the_cycle_does(name: str) -> None:
    """After some slow cycles the times between their slips change as the period does."""
    cycle = ds.sensitivity(FIG3.replace(**SCENES[name]))
    period = cycle.cycle["period"]
    scene = FIG3.replace(**SCENES[name]).replace(scene={"t_end": 9.0 * period}, integrator={"rtol": 1e-10})
    found = ds.derivatives(scene, [*cycle.parameters], times=[9.0 * period])
    releases = found.events["kind"] == 2
    times, shifts = found.events["time"][releases], found.event_derivatives[releases]
    last = np.flatnonzero(times > times[-1] - 2.5 * period)
    before = np.abs(times - (times[last][:, np.newaxis] - period)).argmin(axis=1)
    change = (shifts[last] - shifts[before]) * [*cycle.parameters.values()]
    same = np.abs(times[last] - times[before] - period) < 1e-7 * period
    assert same.sum() >= 3
    expected = np.broadcast_to(cycle.elasticities[0] * period, change.shape)
    np.testing.assert_allclose(change[same], expected[same], rtol=0.0, atol=1e-4 * np.abs(expected).max())


def test_columns_are_those_that_the_deck_names() -> None:
    found = ds.derivatives(FIG3, ["mass"], times=[0.0, 0.01])
    few = ds.derivatives(FIG3.replace(output={"fields": ["pull_force", "u_x"]}), ["mass"], times=[0.0, 0.01])
    assert list(few.columns) == list(few.derivatives) == ["pull_force", "u_x"]
    np.testing.assert_array_equal(few.derivatives["u_x"], found.derivatives["u_x"])


def test_many_events_and_samples() -> None:
    """More than a stack has room for."""
    times = np.linspace(0.0, 130.0, 50001)
    found = ds.derivatives(FIG3.replace(scene={"t_end": 130.0}, integrator={"rtol": 1e-6}), times=times)
    assert len(found.events) > 65536
    assert found.event_derivatives.shape == (len(found.events), len(found.parameters))
    assert np.isfinite(found.event_derivatives).all()
    assert found.derivatives["u_x"].shape == (50001, len(found.parameters))


@pytest.mark.deck
def test_derivatives_can_be_interrupted() -> None:
    """A long run ends at Ctrl-C."""
    code = (
        "import dynstiction as ds, sys; print('on', flush=True)\n"
        "try: ds.derivatives(ds.Scene(sys.argv[1]).replace(t_end=1e5, max_steps=0), times=[1e5])\n"
        "except KeyboardInterrupt: print('interrupted')"
    )
    work = SCRIPT.start(code, INPUTS / "fig3.nml", stdout=PIPE)
    assert work.stdout.readline() == "on\n"
    time.sleep(1.0)
    work.send_signal(signal.SIGINT)
    assert work.communicate(timeout=30.0)[0] == "interrupted\n"


def test_conditioning() -> None:
    """What an irregular motion had at its beginning is lost, at the rate of its exponent; a regular one only loses its phase."""
    ends = [np.linspace(0.0, end, 400) for end in (2.0, 8.0)]
    regular = [ds.derivatives(FIG3, times=times).conditioning for times in ends]
    irregular = FIG3.replace(system={"stiffness_y": 1e6})
    lost = [ds.derivatives(irregular, times=times).conditioning for times in ends]
    assert regular[1] < 1e3 * regular[0]
    assert lost[1] > 1e6 * lost[0]


@pytest.mark.parametrize(
    ("groups", "arguments", "kind"),
    [
        ({"scene": {"model": "high_frequency"}}, {}, ds.DeckError),
        ({}, {"times": [0.1, 0.1]}, ds.UsageError),
        ({}, {"times": [1.0, 20.0]}, ds.DeckError),
        ({"output": {"interval": 0.0}}, {}, ds.DeckError),
        ({}, {"keys": []}, ds.UsageError),
        ({"scene": {"model": "auto"}}, {}, ds.DeckError),
        ({"output": {"fields": "nothing"}}, {}, ds.DeckError),
        ({"integrator": {"max_steps": 100}}, {"times": [5.0]}, ds.SolverError),
    ],
)
def test_runs_without_derivatives_are_refused(groups: dict, arguments: dict, kind: type[ds.Error]) -> None:
    with pytest.raises(kind):
        ds.derivatives(FIG3.replace(**groups), **arguments)
