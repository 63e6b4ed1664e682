"""The Python package: runs, scenes, results, files, errors, threads, signals."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import dynstiction as ds
import fig3 as fig3_deck
import h5py
import numpy as np
import pytest
import xarray
from dynstiction._interrupt import interrupted
from fig3 import SLIDER
from programs import SCRIPT, Program
from results import assert_same

SHORT = {"t_end": 0.05}


# Scenes and overrides


def test_path_text_and_scene_give_the_same_run(tmp_path: Path, fig3: ds.Scene, fig3_text: str) -> None:
    path = tmp_path / "a & b.nml"
    path.write_text(fig3_text)
    others = {"scene": {"title": "it's Fig. 3", **SHORT}, "system": {"misalignment_deg": 1}, "friction": {"normal_load": 10}}
    groups = fig3_deck.changed(fig3_deck.GROUPS, others, {"initial": {"velocity_ratio": np.float64(1e-6)}})
    from_text = ds.run(fig3_text, scene=SHORT)
    for deck in (str(path), path, fig3, ds.Scene(path), " ".join(fig3_text.split()), fig3.check()):
        assert_same(ds.run(deck, scene=SHORT), from_text)
    assert_same(ds.run(ds.Scene(**groups)), from_text)


def test_overrides_reach_the_core(fig3: ds.Scene) -> None:
    scene = fig3.replace(scene={"t_end": 1.0}).replace(scene={"T_END": 0.02})
    assert ds.run(scene).time[-1] == 0.02
    result = ds.run(scene, scene=SHORT, drive={"velocity": 2e-3}, output={"interval": 1e-3})
    assert result.time[-1] == 0.05
    assert result.time.size == 51
    # A stuck object stretches its spring at the rate V.
    stretch = np.hypot(result["u_x"], result["u_y"])[1]
    assert stretch == pytest.approx(2e-3 * result.time[1], rel=1e-6)
    chosen = ds.run(fig3, scene=SHORT, output={"fields": ["X", "theta"]})
    assert set(chosen.columns) == {"time", "X", "theta"}
    np.testing.assert_array_equal(ds.run(fig3, scene=SHORT, output={"fields": "X"})["X"], chosen["X"])


def test_none_takes_a_key_out(fig3: ds.Scene) -> None:
    friction = {"law": "constant", "mu_inf": None, "v_f": None}
    constant = ds.run(fig3, scene=SHORT, friction=friction)
    assert constant.parameters["law"] == "constant"
    assert not {"mu_inf", "v_f"} & set(constant.parameters)
    again = fig3.replace(friction=friction).replace(friction={"law": None, "mu_inf": 0.15, "v_f": 0.01})
    assert_same(ds.run(again, scene=SHORT), ds.run(fig3, scene=SHORT))
    assert ds.Scene(scene={"t_end": 1.0, "title": None}) == ds.Scene(scene={"t_end": 1.0})


def test_list_of_values_is_a_drive_profile(fig3: ds.Scene) -> None:
    times, velocities = np.array([0.0, 0.01, 0.01, 0.05]), (1e-3, 1e-3, 0, 0)
    stopped = ds.run(fig3, scene=SHORT, drive={"time": times, "velocity": velocities})
    # Released at 11.5 ms at the earliest: the drive stops before, and the object never moves again.
    assert stopped["X"][-1] == pytest.approx(stopped["X"][1], abs=1e-12)
    assert stopped["u_x"][-1] == pytest.approx(1e-5, rel=1e-3)
    long = ds.Scene(drive={"velocity": list(np.linspace(1e-3, 2e-3, 500))})
    values = long.text.split("=")[1].removesuffix("\n/\n").split(",")
    assert [float(value) for value in values] == list(np.linspace(1e-3, 2e-3, 500))
    assert max(map(len, long.text.splitlines())) < 200


# Errors


@pytest.mark.parametrize(
    ("groups", "error", "named"),
    [
        ({"system": {"mas": 1.0}}, ds.DeckError, "mass"),
        ({"system": {"mass": float("nan")}}, ds.DeckError, "mass"),
        ({"scene": {"model": "full', t_end = '1"}}, ds.DeckError, "model"),
        ({"drive": {"velocity": []}}, ds.DeckError, "velocity"),
        ({"system": {"mass": None}}, ds.DeckError, "'mass' is missing"),
        ({"sytem": {"mass": 1.0}}, ds.UsageError, "did you mean 'system'"),
        ({"system": 3.0}, ds.UsageError, "a group is a mapping"),
        ({"drive": {"velocity": [1e-3, None]}}, ds.UsageError, "a number, a string"),
        ({"scene": {"title": "two\nlines"}}, ds.UsageError, "line breaks"),
    ],
)
def test_wrong_override_is_refused(fig3: ds.Scene, groups: dict[str, Any], error: type[ds.Error], named: str) -> None:
    with pytest.raises(error, match=named):
        ds.run(fig3, **groups)


def test_missing_deck_is_a_file_error(tmp_path: Path) -> None:
    for path, words in ((tmp_path / "none.nml", r"none\.nml"), ("none.nml", "No such file"), (tmp_path, None)):
        with pytest.raises(ds.FileError, match=words):
            ds.run(path)


def test_solver_error_carries_code_and_what_was_computed(fig3: ds.Scene) -> None:
    whole = ds.run(fig3, scene=SHORT)
    with pytest.raises(ds.SolverError, match="step") as gave_up:
        ds.run(fig3, integrator={"max_steps": int(whole.statistics["steps"]) // 2})
    again = pickle.loads(pickle.dumps(gave_up.value))
    assert str(again) == str(gave_up.value)
    for error in (gave_up.value, again):
        part = error.result
        assert part is not None
        assert (error.code, part.result_code, part.complete) == (42, 42, False)
        assert 0 < part.time.size < whole.time.size
        np.testing.assert_array_equal(part["u_x"], whole["u_x"][: part.time.size])


# Results


def test_result_describes_itself(fig3: ds.Scene, fig3_result: ds.Result) -> None:
    assert (fig3_result.complete, fig3_result.result_code) == (True, 0)
    assert (fig3_result.attributes["model"], fig3_result.attributes["method"]) == ("full", "radau13")
    assert "5398 sticks" in repr(fig3_result)
    assert next(iter(fig3_result)) == "time"
    for values in fig3_result.values():
        assert values.dtype == np.float64
        assert values.flags.c_contiguous
        assert values.shape == fig3_result.time.shape
    assert (fig3_result.time[0], fig3_result.time[-1]) == (0.0, 10.0)
    assert np.all(np.diff(fig3_result.time) > 0)
    assert len(fig3_result._repr_html_()) < 50_000


def test_missing_names_name_the_nearest(fig3: ds.Scene, fig3_result: ds.Result) -> None:
    """A slip of the pen is not answered with the advice for a column that was not asked for, nor the reverse."""
    short = ds.run(fig3, t_end=0.1, fields=["X", "theta"])
    for error, call, words in (
        (ds.ColumnError, lambda: fig3_result["tehta"], r"no column 'tehta': did you mean 'theta'\?"),
        (ds.ColumnError, lambda: fig3_result["quite else"], r"no column 'quite else': there are time, u_x"),
        (ds.ColumnError, lambda: short["u_x"], r"no column 'u_x' .*output\.fields and run again; there are time, X, theta"),
        (ds.ColumnError, lambda: fig3_result.summary["perod"], "no summary value 'perod': did you mean 'period'"),
        (ds.UsageError, lambda: fig3.replace(**{"system.mas": 2.0}), r"did you mean 'system\.mass'"),
        (ds.UsageError, lambda: ds.run(fig3, systm=2.0), "not a group of a deck: did you mean 'system'"),
        (ds.UsageError, lambda: ds.run(fig3, qqqqq=2.0), r"nor a group of a deck \(scene, system, .*template"),
    ):
        with pytest.raises(error, match=words) as missing:
            call()
        assert isinstance(missing.value, KeyError) == (error is ds.ColumnError)
    # A value that other runs have: what is there says more than an error.
    assert np.isnan(short.summary["period"]) and "period" not in short.summary and short.summary.get("period") is None


def test_a_result_is_a_mapping(fig3_result: ds.Result) -> None:
    assert isinstance(fig3_result, Mapping)
    names = list(fig3_result)
    assert names == list(fig3_result.keys()) == list(fig3_result.columns)
    assert len(fig3_result) == len(names) == len(list(fig3_result.values())) > 10
    assert dict(fig3_result)["u_x"] is fig3_result["u_x"]
    assert fig3_result.get("none of these") is None
    assert "u_x" in fig3_result and "tehta" not in fig3_result
    other = ds.Result(**vars(fig3_result))
    assert fig3_result != other and len({fig3_result, other}) == 2


def test_units_have_one_grammar_and_counts_are_integers(fig3_result: ds.Result) -> None:
    units = {*fig3_result.columns.units.values(), *fig3_result.summary.units.values(), *fig3_result.parameters.units.values()}
    assert {"m/s", "1", "N"} <= units
    assert not [unit for unit in units if "-" in unit]
    assert type(fig3_result.summary["cycles"]) is type(fig3_result.summary["sticks"]) is int
    assert type(fig3_result.parameters["max_steps"]) is type(fig3_result.statistics["steps"]) is int


def test_events_alternate_and_agree_with_the_samples(fig3_result: ds.Result) -> None:
    kinds, times = fig3_result.events["kind"], fig3_result.events["time"]
    assert kinds[0] == 1
    assert np.all(np.diff(kinds) != 0)
    assert np.all(np.diff(times) > 0)
    after_first = fig3_result.time >= times[0]
    last_event = np.searchsorted(times, fig3_result.time[after_first], side="right") - 1
    np.testing.assert_array_equal(kinds[last_event] == 1, fig3_result["sticking"][after_first] == 1)


# Files


TABLES = ("columns", "summary", "statistics", "parameters")
ADDED: dict[str, object] = {
    "temperature_C": 21.7,
    "humidity": np.float32(0.45),
    "position": np.array([1.5, 2.5]),
    "operator": np.bytes_(b"K. N."),
    "note": "mine: é",
    "checked": np.True_,
    "serial": 2**40,
}


def test_saved_result_opens_as_the_same_with_what_others_have_added(tmp_path: Path, fig3_result: ds.Result) -> None:
    first, second = tmp_path / "run.h5", tmp_path / "again.h5"
    fig3_result.save(first)
    assert [file.name for file in tmp_path.iterdir()] == ["run.h5"]
    opened = ds.open(first)
    assert opened.attributes == fig3_result.attributes
    with h5py.File(first, "r+") as file:
        file.attrs.update(ADDED)
        kinds = {name: file.attrs.get_id(name).dtype for name in file.attrs}
    ds.open(first).save(second)
    for found in (opened, ds.open(second)):
        assert_same(found, fig3_result)
        for table in TABLES:
            ours, theirs = getattr(fig3_result, table), getattr(found, table)
            assert list(ours) == list(theirs), "in the same order"
            assert ours.units == theirs.units
            assert ours.long_names == theirs.long_names
            if table != "columns":
                assert dict(ours) == dict(theirs)
                assert [type(value) for value in ours.values()] == [type(value) for value in theirs.values()]
        assert (found.deck, found.resolved_deck) == (fig3_result.deck, fig3_result.resolved_deck)
    assert set(found.attributes) == {*fig3_result.attributes, *ADDED}
    assert all(np.array_equal(found.attributes[name], value) for name, value in ADDED.items())
    assert found.to_xarray().attrs["temperature_C"] == 21.7
    with h5py.File(second) as file:
        assert {name: file.attrs.get_id(name).dtype for name in file.attrs} == kinds
    dataset = fig3_result.to_xarray()
    with xarray.open_dataset(second, group="time_series", engine="h5netcdf") as saved:
        assert set(saved.variables) == set(dataset.variables)
        for name in dataset.variables:
            np.testing.assert_array_equal(saved[name], dataset[name])
            assert saved[name].dims == ("time",)
            assert saved[name].attrs["units"] == dataset[name].attrs["units"]


def layout(file: h5py.File) -> dict[str, object]:
    """Every object of a file with its kind, type and attributes; every attribute with its type and text."""
    found: dict[str, object] = {}

    def note(name: str, item: h5py.Group | h5py.Dataset) -> None:
        found[name] = kind_of(item.id.get_type(), item.shape) if isinstance(item, h5py.Dataset) else "group"
        for key in item.attrs:
            attribute = item.attrs.get_id(key)
            value = item.attrs[key] if key in ("units", "long_name", "NAME", "CLASS") else None
            found[f"{name}@{key}"] = (*kind_of(attribute.get_type(), attribute.shape), value)

    note("", file)
    file.visititems(note)
    return found


def kind_of(kind: h5py.h5t.TypeID, shape: tuple[int, ...]) -> tuple[object, ...]:
    if isinstance(kind, h5py.h5t.TypeStringID):
        return "text", kind.get_cset(), kind.is_variable_str(), shape
    return kind.dtype.str, shape


@pytest.mark.parametrize("fields", ["default", ["theta", "X", "u_x"]])
def test_saved_file_is_that_of_the_executable(fields: str | list[str], tmp_path: Path, program: Program, fig3: ds.Scene) -> None:
    (tmp_path / "deck.nml").write_text(fig3.replace(t_end=0.05, fields=fields).to_deck())
    program("run", "deck.nml", "-o", "theirs.h5", "--quiet", status=0)
    result = ds.run(tmp_path / "deck.nml")
    result.save(tmp_path / "ours.h5")
    with h5py.File(tmp_path / "ours.h5") as ours, h5py.File(tmp_path / "theirs.h5") as theirs:
        assert layout(ours) == layout(theirs)
        for name in set(ours.attrs) - {"created"}:
            assert ours.attrs[name] == theirs.attrs[name], name
        for group in ("deck", "parameters", "time_series", "events", "summary"):
            for name in ours[group]:
                assert np.all(ours[group][name][()] == theirs[group][name][()]), name
    opened = ds.open(tmp_path / "theirs.h5")
    assert_same(opened, result)
    for table in TABLES:
        assert list(getattr(opened, table)) == list(getattr(result, table)), "in the order of memory"
        assert getattr(opened, table).units == getattr(result, table).units


def test_incomplete_file_opens_with_a_warning(tmp_path: Path, fig3_result: ds.Result) -> None:
    path = tmp_path / "run.h5"
    fig3_result.save(path)
    with h5py.File(path, "r+") as file:
        file.attrs["complete"] = 0
        del file["summary"], file["statistics"]
    with pytest.warns(ds.IncompleteWarning, match="before the run's end"):
        opened = ds.open(path)
    assert not opened.complete
    assert_same(opened, fig3_result)
    assert len(opened.summary) == 0


# Threads, signals, memory


UNUSED_IN_CREEP = dict.fromkeys(("mass", "law", "mu_inf", "v_f", "velocity_ratio", "method", "rtol"))
# Every model and method, one scene each: what one run leaves behind would change the next.
THREAD_SCENES: list[dict[str, Any]] = [
    {"method": "radau5"},
    {"method": "radau9", "misalignment_deg": 5.0},
    {"method": "radau13", "misalignment_deg": 10.0},
    {"method": "dopri5", "misalignment_deg": 20.0},
    {"method": "dop853", "velocity": 3e-3},
    {"method": "rk4", "step": 1e-6, "contact": "smoothed", "v_smooth": 1e-6},
    {"model": "low_frequency", "stiffness_y": None},
    {"model": "high_frequency", "elongation_x": 1e-4},
    {"model": "creep", **UNUSED_IN_CREEP},
    {"model": "creep_asymptotic", **UNUSED_IN_CREEP, "stiffness_y": None},
    {"model": "auto"},
]


@pytest.fixture(scope="module")
def alone(fig3: ds.Scene) -> dict[ds.Scene, ds.Result]:
    scenes = [fig3.replace(t_end=0.2, **changes) for changes in THREAD_SCENES]
    return {scene: ds.run(scene) for scene in scenes}


def everything(_: int) -> list[bytes]:
    """The bits of what the functions give."""
    motion = np.random.default_rng(1).normal(scale=1e-3, size=(2000, 4))
    found = [
        ds.rhs(motion, **SLIDER),
        ds.jacobian(motion, **SLIDER),
        ds.damping_ratio(np.linspace(0.01, 3.0, 2000), **SLIDER),
        ds.steady_sliding_eigenvalues(**SLIDER),
        *ds.critical_misalignment(**SLIDER),
    ]
    return [np.asarray(values).tobytes() for values in found]


@pytest.mark.parametrize("threads", [2, 4, 16])
def test_threads_give_the_same_bits(threads: int, alone: dict[ds.Scene, ds.Result]) -> None:
    expected = everything(0)
    with ThreadPoolExecutor(threads) as pool:
        for together, result in zip(pool.map(ds.run, [*alone] * 2), [*alone.values()] * 2, strict=True):
            assert_same(together, result)
        assert all(found == expected for found in pool.map(everything, range(2 * threads)))


def test_other_threads_go_on_during_a_run(fig3: ds.Scene) -> None:
    """Chunks of 50 ms that held the lock would leave a tick each, at most."""
    ticks, done = [], threading.Event()

    def tick() -> None:
        while not done.wait(0.001):
            ticks.append(time.perf_counter())

    with ThreadPoolExecutor(1) as pool:
        pool.submit(tick)
        begin = time.perf_counter()
        try:
            ds.run(fig3, scene={"t_end": 20.0}, integrator={"rtol": 1e-10})
        finally:
            end = time.perf_counter()
            done.set()
    during = np.array([tick for tick in ticks if begin <= tick <= end])
    assert during.size > 5 * (end - begin) / 0.05
    assert np.median(np.diff(during)) < 0.01


def test_errors_in_threads_keep_their_texts(fig3: ds.Scene) -> None:
    scenes = [fig3.replace(integrator={"max_steps": n}) for n in (100, 300, 1000)]

    def message(n: int) -> str:
        try:
            if n % 2:
                ds.run(scenes[n % 3])
            else:
                ds.damping_ratio(1.0, **{**SLIDER, "mass": -(10.0 ** -(n % 5))})
        except ds.Error as error:
            return str(error)
        return "no error"

    expected = [message(n) for n in range(30)]
    assert "no error" not in expected
    with ThreadPoolExecutor(16) as pool:
        for n, found in zip(range(300), pool.map(lambda n: message(n % 30), range(300)), strict=True):
            assert found == expected[n % 30]


def test_an_interrupt_is_dropped_while_the_results_of_another_are_collected() -> None:
    def collect() -> str:
        os.kill(os.getpid(), signal.SIGINT)
        return "kept"

    assert interrupted("stopped", collect).partial == "kept"  # type: ignore[attr-defined]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


INTERRUPT_A_RUN = """
import os, signal, sys, threading, time
import dynstiction as ds

def interrupt():
    time.sleep(0.2)
    for _ in range(int(sys.argv[2])):
        os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
simulation = ds.Simulation(sys.argv[1], t_end=400.0)
threading.Thread(target=interrupt).start()
try:
    simulation.finish()
except KeyboardInterrupt as error:
    part = error.partial
time.sleep(0.1)
assert not part.complete and 0.0 < part.time[-1] <= simulation.time < 400.0, (part, simulation)
assert simulation.state["time"] == simulation.time and part.events["time"][-1] <= simulation.time
result, whole = simulation.finish(), ds.run(sys.argv[1], t_end=400.0)
for name in whole:
    assert result[name].tobytes() == whole[name].tobytes(), name
    assert part[name].tobytes() == whole[name][: part.time.size].tobytes(), name
assert result.events.tobytes() == whole.events.tobytes()
assert part.events.tobytes() == whole.events[: part.events.size].tobytes()
assert dict(result.summary) == dict(whole.summary)
print("the same")
"""


@pytest.mark.parametrize("signals", [1, 3])
def test_interrupt_gives_what_is_done_and_the_run_can_go_on(signals: int, fig3_text: str) -> None:
    assert SCRIPT(INTERRUPT_A_RUN, fig3_text, signals, status=0).stdout == "the same\n"


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_a_thousand_runs_leak_nothing(fig3: ds.Scene) -> None:
    scene = fig3.replace(scene={"t_end": 1e-3})
    wrong = fig3.replace(system={"mas": 1.0})

    def call(times: int) -> None:
        for _ in range(times):
            ds.run(scene)
            with pytest.raises(ds.DeckError):
                ds.run(wrong)
        gc.collect()

    resident = []
    for times in (200, 1000):
        call(times)
        resident.append(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"))
    # One deck text or buffer of 64 KiB forgotten a call would be 64 MB.
    assert resident[1] - resident[0] < 4_000_000


# Equations


def numpy_rhs(state: np.ndarray, v_smooth: float = 0.0) -> np.ndarray:
    """Eqs. (1)-(5), written a second time."""
    p = SLIDER
    u, w = state[..., :2], state[..., 2:]
    v = np.linalg.norm(w, axis=-1, keepdims=True)
    force = (p["mu_inf"] + (p["mu_0"] - p["mu_inf"]) * np.exp(-v / p["v_f"])) * p["normal_load"]
    angle = np.radians(p["misalignment_deg"])
    along = np.array([np.cos(angle), np.sin(angle)])
    stiffness = np.array([p["stiffness_x"], p["stiffness_y"]])
    acceleration = (stiffness * u - force * w / np.sqrt(v**2 + v_smooth**2)) / p["mass"]
    return np.concatenate([p["velocity"] * along - w, acceleration], axis=-1)


def some_states(*shape: int) -> np.ndarray:
    scale = np.array([2e-3, 2e-7, 1e-3, 1e-4])
    return np.random.default_rng(3).normal(size=(*shape, 4)) * scale


@pytest.mark.parametrize("shape", [(), (1,), (7,), (3, 5), (2, 0, 4)])
@pytest.mark.parametrize("v_smooth", [0.0, 1e-5])
def test_rhs_and_jacobian_have_the_shape_of_the_states(shape: tuple[int, ...], v_smooth: float) -> None:
    states = some_states(*shape)
    rates = ds.rhs(states, **SLIDER, v_smooth=v_smooth)
    assert rates.shape == (*shape, 4)
    assert rates.flags.c_contiguous
    np.testing.assert_allclose(rates, numpy_rhs(states, v_smooth), rtol=1e-12, atol=1e-14)
    derivative = ds.jacobian(states, **SLIDER, v_smooth=v_smooth)
    assert derivative.shape == (*shape, 4, 4)
    assert derivative.flags.c_contiguous


def test_rhs_takes_any_array_and_any_law() -> None:
    states = some_states(6)
    kept = states.copy()
    expected = ds.rhs(states, **SLIDER)
    np.testing.assert_array_equal(ds.rhs(states.tolist(), **SLIDER), expected)
    np.testing.assert_array_equal(ds.rhs(np.asfortranarray(states), **SLIDER), expected)
    np.testing.assert_array_equal(ds.rhs(states[::2], **SLIDER), expected[::2])
    np.testing.assert_array_equal(states, kept)
    constant = {k: v for k, v in SLIDER.items() if k not in ("mu_inf", "v_f")}
    equal = SLIDER | {"mu_inf": SLIDER["mu_0"]}
    np.testing.assert_array_equal(ds.rhs(states, **constant), ds.rhs(states, **equal))
    np.testing.assert_array_equal(ds.jacobian(states, **constant), ds.jacobian(states, **equal))
    with pytest.raises(ds.UsageError, match="belong together"):
        ds.rhs(states, **constant, mu_inf=0.1)
    with pytest.raises(ds.UsageError, match="last dimension"):
        ds.rhs(np.zeros((4, 3)), **SLIDER)
