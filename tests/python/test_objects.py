"""Objects and calls of the Python package where they meet: threads, copies, processes, full disks, small memories, wild arguments.

What used to end the interpreter runs in a process of its own, whose exit status is looked at.
"""

from __future__ import annotations

import contextlib
import copy
import errno
import os
import pickle
import resource
import stat
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import dynstiction as ds
import fig3 as fig3_deck
import h5py
import numpy as np
import programs
import pytest
from dynstiction import _native, errors
from dynstiction.errors import error_for
from programs import SCRIPT, Program, small_disk
from results import assert_same

hypothesis = pytest.importorskip("hypothesis", reason="pip install hypothesis")
st = hypothesis.strategies

SHORT = {"t_end": 0.05}

SLIDER = fig3_deck.SLIDER | {"misalignment_deg": 1.1}

CREEP = {k: SLIDER[k] for k in ("velocity", "misalignment_deg", "stiffness_x", "stiffness_y", "mu_0", "normal_load")}


def process(script: str, deck: str, **how: object) -> str:
    """Output of a script, which has the deck as DECK; it must end without help and with exit status 0."""
    head = f"import faulthandler; faulthandler.enable()\nimport dynstiction as ds\nDECK = {deck!r}\n"
    return SCRIPT(head + script, status=0, **how).stdout


# Threads


TWO_THREADS = """
from concurrent.futures import ThreadPoolExecutor
simulation = ds.Simulation(DECK, scene={"t_end": 3.0})
refused = []
def use(_):
    for i in range(1, 7):
        try:
            simulation.step_to(simulation.t_end * i / 6)
        except ds.UsageError as error:
            refused.append(str(error))
with ThreadPoolExecutor(4) as pool:
    list(pool.map(use, range(4)))
assert any("busy: another thread" in text for text in refused), refused
result, whole = simulation.finish(), ds.run(DECK, scene={"t_end": 3.0})
assert all(result[n].tobytes() == whole[n].tobytes() for n in whole)
"""

SWEEP = """
import time
from concurrent.futures import ThreadPoolExecutor
import numpy as np
from dynstiction import _native
core = _native.Sweep(ds.Scene(DECK).source, [("system.misalignment_deg", np.linspace(1.0, 9.0, 64))], False)
ends, done = [], []
def use(first):
    try:
        for case in range(first, 64, 3):
            done.append(core.run(case, 1))
    except ds.UsageError as error:
        ends.append(str(error))
with ThreadPoolExecutor(3) as pool:
    pool.map(use, range(3))
    while not done: time.sleep(0.01)
    core.close()
assert len(ends) == 3 and all("closed" in text for text in ends), (ends, len(done))
"""


@pytest.mark.parametrize("script", [TWO_THREADS, SWEEP], ids=["two", "sweep"])
def test_threads_are_refused_or_work(script: str, fig3_text: str) -> None:
    process(script, fig3_text)


def test_the_result_is_not_read_while_it_grows(fig3: ds.Scene) -> None:
    simulation = ds.Simulation(fig3, scene={"t_end": 1e5}, output={"interval": 1.0})

    def finish() -> None:
        with pytest.raises(ds.UsageError, match="closed"):
            simulation.finish()

    user = threading.Thread(target=finish)
    user.start()
    while simulation._lock.acquire(blocking=False):
        simulation._lock.release()
        time.sleep(0.001)
    for look in ("result", "events", "state"):
        with pytest.raises(ds.UsageError, match="busy"):
            getattr(simulation, look)
    assert "running" in repr(simulation)
    simulation.close()
    user.join()
    assert simulation.result["X"].shape == simulation.result.time.shape


# Copies and processes


def test_handles_are_not_copied(fig3: ds.Scene) -> None:
    with ds.Simulation(fig3, scene=SHORT) as simulation:
        for thing in (simulation, simulation._core):
            for copying in (copy.deepcopy, pickle.dumps, lambda x: pickle.dumps(x, 0), lambda x: pickle.dumps({"a": (x,)})):
                with pytest.raises(TypeError, match="the scene that it was made of, or its result"):
                    copying(thing)
            with pytest.raises(TypeError, match="cannot be copied"):
                copy.copy(thing)
        assert simulation.finish().complete


def test_what_is_data_is_copied(fig3: ds.Scene, fig3_result: ds.Result) -> None:
    time = np.arange(500) * 1e-3
    things = [
        fig3,
        fig3_result,
        fig3_result.columns,
        ds.stick_slip_statistics(fig3_result),
        ds.spectrogram(time, np.sin(300 * time), window=0.05),
        ds.creep_exact([0.1, 0.5], 0.1),
        ds.critical_misalignment(**SLIDER),
        ds.System(mass=0.5),
        ds.trade(fig3, budget=1.0, scene={"t_end": 0.002}),
        ds.SolverError("gave up", 41, fig3_result),
        error_for(47, "no memory"),
        ds.ColumnError("no column"),
    ]
    for thing in things:
        for again in (copy.copy(thing), copy.deepcopy(thing), *(pickle.loads(pickle.dumps(thing, p)) for p in (2, 5))):
            assert type(again) is type(thing)
            assert repr(again) == repr(thing)
    assert_same(pickle.loads(pickle.dumps(fig3_result)), fig3_result)


def test_errors_are_made_again_by_new() -> None:
    """As tblib does, which sends what a case raises between the processes of dask."""
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, BaseException)]
    assert len(kinds) > 8
    for kind in (ds.DeckError, ds.SolverError, ds.FileError, ds.UsageError, ds.ColumnError):
        assert issubclass(kind, ds.Error)
    for kind in kinds:
        again = kind.__new__(kind)
        again.args = ("no memory", 47, None)
        assert type(again) is kind
        assert "no memory" in str(again)


FORKED = """
import multiprocessing, threading
idle = ds.Simulation(DECK, scene={"t_end": 0.5})
idle.step_to(0.2)
busy = ds.Simulation(DECK, scene={"t_end": 1e6}, output={"interval": 1.0})
def use():
    try:
        busy.finish()
    except ds.UsageError:
        pass
user = threading.Thread(target=use)
user.start()
def child():
    whole = ds.run(DECK, scene={"t_end": 0.5})
    result = idle.finish()
    assert all(result[n].tobytes() == whole[n].tobytes() for n in whole)
    try:
        busy.step_to(1e6)
    except ds.UsageError as error:
        assert "busy" in str(error), error
    else:
        raise AssertionError("used")
    busy.close()
for i in range(5):
    process = multiprocessing.get_context("fork").Process(target=child)
    process.start()
    process.join(60)
    assert process.exitcode == 0
busy.close()
user.join()
whole, result = ds.run(DECK, scene={"t_end": 0.5}), idle.finish()
assert all(result[n].tobytes() == whole[n].tobytes() for n in whole)
"""


def test_a_forked_process_has_its_own_copy(fig3_text: str) -> None:
    process(FORKED, fig3_text)


# Numbers at the edges


@pytest.mark.parametrize(
    ("powers", "time"),
    [
        *(({"mass": p, "stiffness_x": p, "stiffness_y": p, "normal_load": p}, 0) for p in (-200, -100, 100, 200)),
        *(({"stiffness_x": 2 * p, "stiffness_y": 2 * p, "normal_load": p}, p) for p in (-50, 100)),
    ],
)
def test_eigenvalues_depend_on_no_unit(powers: dict[str, int], time: int) -> None:
    """Units of mass and of time that are powers of two: the same bits, frequencies in 2**time 1/s."""
    scaled = SLIDER | {key: SLIDER[key] * 2.0**power for key, power in powers.items()}
    plain, critical = ds.steady_sliding_eigenvalues(**SLIDER), ds.critical_misalignment(**SLIDER)
    assert np.array_equal(ds.steady_sliding_eigenvalues(**scaled), plain * 2.0**time)
    found = ds.critical_misalignment(**scaled)
    assert np.array_equal(found.frequency, critical.frequency * 2.0**time)
    if time == 0:
        assert np.array_equal(found.angle, critical.angle) and np.array_equal(found.window, critical.window)
        assert np.array_equal(found.limit, critical.limit)


@pytest.mark.deck
@pytest.mark.parametrize("setting", ["system.mass=1e-307", "friction.normal_load=1e307"])
def test_the_command_stability_says_what_is_out_of_range(program: Program, setting: str) -> None:
    assert "beyond the range" in program("stability", fig3_deck.DECK, "--set", setting, status=2).stderr


NUMERICAL: dict[str, tuple[Callable[..., object], dict[str, object]]] = {
    "rhs": (ds.rhs, {"state": [[1e-3, 1e-7, 1e-3, 1e-4]], **SLIDER, "v_smooth": 1e-5}),
    "jacobian": (ds.jacobian, {"state": [[1e-3, 1e-7, 1e-3, 1e-4]], **SLIDER, "v_smooth": 1e-5}),
    "steady_sliding_eigenvalues": (ds.steady_sliding_eigenvalues, {**SLIDER, "v_smooth": 1e-5}),
    "critical_misalignment": (ds.critical_misalignment, {**SLIDER, "v_smooth": 1e-5}),
    "creep_end": (ds.creep_end, {**SLIDER}),
    "damping_ratio": (ds.damping_ratio, {"theta": 0.3, **SLIDER}),
    "creep_exact": (ds.creep_exact, {"tau": 0.5, "phi": 0.1, "kappa": 1e-3}),
    "creep_asymptotic": (ds.creep_asymptotic, {"tau": 0.5, "phi": 0.1, "form": "printed"}),
    "creep_velocity": (ds.creep_velocity, {"t": 0.5, **CREEP}),
    "oscillation_frequency": (ds.oscillation_frequency, {"theta": 0.3, "mass": 0.25, "stiffness_x": 1e3, "stiffness_y": 1e7}),
    "spectrogram": (ds.spectrogram, {"time": np.arange(99) * 0.01, "values": np.sin(np.arange(99)), "window": 0.2}),
    "ridge": (ds.ridge, {"spectrum": ds.spectrogram(np.arange(99) * 0.01, np.sin(np.arange(99)), 0.2), "above": 1.0}),
}


NO_NUMBERS = ["x", b"x", 1j, [1j], {}, object(), [[1.0], [1.0, 2.0]], np.array(["a"]), np.datetime64("2020-01-01"),
              np.ma.array([1.0, 2.0], mask=[0, 1])]  # fmt: skip
POSITIVE = ("mass", "stiffness_x", "stiffness_y", "v_f")
"""Not 0 either; 0 is a friction of no creep alone, and a velocity has any sign elsewhere."""


@pytest.mark.parametrize("name", NUMERICAL)
def test_every_argument_that_cannot_be_meant_is_refused(name: str) -> None:
    function, good = NUMERICAL[name]
    function(**good)
    optional = {"mu_inf", "v_f", "v_smooth"} | ({"misalignment_deg"} if name == "critical_misalignment" else set())
    optional |= {"stiffness_y"} if name in ("damping_ratio", "creep_velocity") else set()
    of_creep = name == "creep_velocity"
    for argument in good:
        beyond = [np.nan, -np.inf] + ([] if (name, argument) == ("creep_velocity", "stiffness_y") else [np.inf])
        for value in [*([] if argument in optional else [None]), *NO_NUMBERS, *beyond]:
            with pytest.raises(ds.UsageError):
                function(**{**good, argument: value})
        negative = [-1.0] if argument in ("mu_0", "normal_load", *POSITIVE) or (argument == "velocity" and of_creep) else []
        zero = [0.0] if argument in POSITIVE or (argument in ("mu_0", "normal_load", "velocity") and of_creep) else []
        for value in negative + zero if name != "critical_misalignment" else []:
            with pytest.raises(ds.UsageError, match=argument):
                function(**{**good, argument: value})
        if name not in ("rhs", "jacobian", "spectrogram", "ridge") and argument != "form":
            other = next(key for key in good if key != argument)
            with pytest.raises(ds.UsageError, match="broadcast"):
                function(**{**good, argument: np.full(2, good[argument]), other: np.full(3, good[other])})


class Hostile:
    """An object that refuses whatever is asked of it."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("no array")

    def __float__(self) -> float:
        raise RuntimeError("no float")


NUMBERS = st.floats() | st.sampled_from([5e-324, 1e-307, 1e-150, 1e150, 1.7e308, 2**64, 10**400, np.pi / 2])
ARGUMENTS = NUMBERS | st.lists(NUMBERS, max_size=4) | st.lists(st.lists(NUMBERS, min_size=4, max_size=4), max_size=2)
ODD = st.sampled_from([None, "", "nan", "\0", [], [[]], set(), ..., Hostile(), [None], np.empty((0, 4)), np.ones((2,) * 9),
                       np.broadcast_to(1.0, 2**40), iter((1, 2)), memoryview(b"12")])  # fmt: skip


@hypothesis.settings(max_examples=1000, deadline=None)
@hypothesis.given(st.sampled_from([*NUMERICAL]), st.data())
def test_any_arguments_give_numbers_or_an_error(name: str, data: Any) -> None:
    """Never the end of the interpreter. NaN only where there is no critical angle, no ridge, or creep does not end."""
    function, good = NUMERICAL[name]
    changes = data.draw(st.dictionaries(st.sampled_from([*good]), ARGUMENTS | ODD, max_size=4))
    try:
        returned = function(**{**good, **changes})
    except (ds.Error, MemoryError):
        return
    for array in returned if isinstance(returned, tuple) else (returned,):
        assert array.dtype.kind in "fc" and not np.any(np.isinf(array))
        assert name in ("ridge", "critical_misalignment", "creep_end") or not np.any(np.isnan(array))


def test_no_rate_where_there_is_no_direction_and_no_creep_beyond_the_numbers() -> None:
    at_rest = [[0.0, 0.0, 0.0, 0.0]]
    for function in (ds.rhs, ds.jacobian):
        with pytest.raises(ds.UsageError, match=r"w = 0, .* give v_smooth > 0"):
            function(at_rest, **SLIDER)
        assert np.all(np.isfinite(function(at_rest, **SLIDER, v_smooth=1e-5)))
        with pytest.raises(ds.UsageError, match="beyond the range"):
            function([[1e308, 1e308, 1e308, 1.0]], **SLIDER)
    for *product, value in (("mu_0", "normal_load", 1e200), ("mu_0", "normal_load", 1e-200), ("velocity", "stiffness_x", 1e-200)):
        with pytest.raises(ds.UsageError, match="must be finite and in"):
            ds.creep_velocity(0.5, **{**CREEP, "stiffness_y": 1e307, **dict.fromkeys(product, value)})


LOOP: list[object] = []
LOOP.append(LOOP)


def test_wild_calls_are_refused(fig3: ds.Scene, fig3_result: ds.Result) -> None:
    scene, result, samples = fig3, fig3_result, np.arange(99.0)
    calls: list[Callable[[], object]] = [
        lambda: ds.run(3),
        lambda: ds.run(b"&scene /"),
        lambda: ds.run(scene, system={"mass\nsystem.mass": 1.0}),
        lambda: ds.run(scene, system={1: 1.0}),
        lambda: ds.run(scene, scene={"title": "\ud800"}),
        lambda: ds.run(scene, progress="yes"),
        lambda: ds.Scene(scene, drive={"velocity": LOOP}),
        lambda: ds.Scene(scene, drive={"velocity": 10**5000}),
        lambda: ds.sweep(scene, "x"),
        lambda: ds.sweep(scene, {"system.mass": [1.0]}, threads=1.5),
        lambda: ds.sweep(scene, {"system.mass": [1.0]}, points="x"),
        lambda: ds.trade(scene, quantities=1),
        lambda: ds.trade(scene, quantities=[1]),
        lambda: ds.trade(scene, budget=np.nan),
        lambda: ds.ridge(1),
        lambda: ds.ridge(ds.Spectrogram(np.empty(0), np.empty(0), np.empty((0, 0)))),
        lambda: ds.spectrogram(samples, samples * 1e300, 20.0),
        lambda: ds.stick_slip_statistics(None),
        lambda: ds.open(None),
        lambda: ds.Described([1]),
        lambda: ds.Simulation(scene).step_to(None),
        lambda: result.save(3),
        lambda: result.save("x.h5", overwrite="no"),
        lambda: ds.stick_slip_statistics(result)[[1]],
    ]
    for number, call in enumerate(calls):
        with pytest.raises(ds.UsageError):
            pytest.fail(f"call {number} returned {call()}")


# Saving


SAVED = """
ds.run(DECK, scene={"t_end": 1e-3}, output={"fields": ["X"]}).save(FOLDER + "/old.h5")
result = ds.run(DECK, scene={"t_end": 0.3})
for name in ("new", "old"):
    try:
        result.save(f"{FOLDER}/{name}.h5", overwrite=name == "old")
    except OSError as error:
        assert isinstance(error, ds.FileError)
        print(error)
"""


@pytest.mark.parametrize("full", [True, False], ids=["a full disk", "a limit of file sizes"])
def test_what_cannot_be_written_is_a_file_error(tmp_path: Path, fig3_text: str, full: bool) -> None:
    """The old file stays, and nothing is beside it."""
    folder = tmp_path / "disk"
    limit = {} if full else {"preexec_fn": programs.limited(resource.RLIMIT_FSIZE, 64 * 1024)}
    with small_disk(folder, "64k") if full else contextlib.nullcontext(folder.mkdir()):
        told = process(f"FOLDER = {str(folder)!r}\n{SAVED}", fig3_text, **limit).splitlines()
        words = "No space left on device: free some space" if full else "File too large: raise the limit"
        for name, line in zip(("new", "old"), told, strict=True):
            assert f"{name}.h5: cannot be written: {words}" in line
        assert [file.name for file in folder.iterdir()] == ["old.h5"]
        assert list(ds.open(folder / "old.h5")) == ["time", "X"]


def test_each_failing_call_is_a_file_error(tmp_path: Path, fig3_result: ds.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the system refuses, and when: the old file stays, and nothing beside it."""
    target = tmp_path / "x.h5"
    (tmp_path / "plain").touch()
    fig3_result.save(target)
    before = target.read_bytes()
    assert stat.S_IMODE(target.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)
    for name, number in (("fsync", errno.EIO), ("fsync", errno.EDQUOT), ("replace", errno.EROFS), ("replace", errno.EACCES)):
        with monkeypatch.context() as patch:

            def fail(*_: object, number: int = number, **__: object) -> None:
                raise OSError(number, os.strerror(number))

            patch.setattr(os, name, fail)
            with pytest.raises(ds.FileError, match=rf"x\.h5: cannot be written: {os.strerror(number)}: "):
                fig3_result.save(target, overwrite=True)
        assert target.read_bytes() == before
    for place in ("no/x.h5", "plain/x.h5", "x" * 300, "a\0b", "."):
        with pytest.raises(ds.FileError):
            fig3_result.save(tmp_path / place)
    assert {file.name for file in tmp_path.iterdir()} == {"x.h5", "plain"}


def test_files_of_others_are_never_replaced(tmp_path: Path, fig3: ds.Scene, fig3_result: ds.Result) -> None:
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["data"] = np.arange(3)
        file.attrs["program"] = "another"
    (tmp_path / "text.h5").write_text("mine")
    os.symlink(tmp_path / "text.h5", tmp_path / "link.h5")
    (tmp_path / "folder.h5").mkdir()
    os.mkfifo(tmp_path / "pipe.h5")
    fig3_result.save(tmp_path / "own.h5")
    for name in ("foreign", "text", "link", "folder", "pipe", "own"):
        path = tmp_path / f"{name}.h5"
        before = path.read_bytes() if path.is_file() else path.stat().st_ino
        with pytest.raises(ds.FileError, match=r"overwrite=True|it is a folder"):
            fig3_result.save(path)
        if name != "own":
            with pytest.raises(ds.FileError, match=r"is no result of dynstiction|not a regular file|it is a folder"):
                fig3_result.save(path, overwrite=True)
        assert before == (path.read_bytes() if path.is_file() else path.stat().st_ino)
    short = ds.run(fig3, scene=SHORT)
    short.save(path, overwrite=True)
    assert_same(ds.open(path), short)
    assert len(list(tmp_path.iterdir())) == 6


def test_of_two_savers_one_is_refused(tmp_path: Path, fig3: ds.Scene) -> None:
    """Without overwrite: whoever comes first."""
    result = ds.run(fig3, scene={"t_end": 1e-3})
    start = threading.Barrier(2)

    def is_refused(i: int) -> bool:
        start.wait()
        try:
            result.save(tmp_path / f"{i // 2}.h5")
        except ds.FileError:
            return True
        return False

    with ThreadPoolExecutor(2) as pool:
        assert sum(pool.map(is_refused, range(40))) == 20
    assert len(list(tmp_path.iterdir())) == 20


# Packages, series, memory


def test_a_missing_package_is_named(fig3: ds.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.delitem(sys.modules, "tqdm.auto", raising=False)
    with pytest.raises(ds.PackageError, match=r"needs tqdm .*pip install tqdm") as missing:
        ds.run(fig3, progress=True)
    assert isinstance(missing.value, ImportError)


def test_series_are_refused_not_dropped(fig3: ds.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_native.Sweep, "run", lambda *_: pytest.fail("computed"))
    grid = {"parameter": "drive.velocity", "first": 1e-3, "last": 2e-3, "count": 2, "keep": "series"}
    with pytest.raises(ds.UsageError, match=r"keep = 'series': .* sweep=\{'keep': 'summary'\}"):
        ds.sweep(fig3, sweep=grid)
    with pytest.raises(ds.UsageError, match="keep = 'series'"):
        ds.sweep(fig3, {"drive.velocity": [2e-3]}, sweep=grid)


LIMITED = """
import resource, xarray, h5py, numpy as np
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 300 * 2**20,) * 2)
many = np.broadcast_to(0.5, 10**8)
for call in (
    lambda: ds.sweep(DECK, {"drive.velocity": np.ones(30000), "system.mass": np.ones(30000)}),
    lambda: ds.run(DECK, scene={"t_end": 1e4}, output={"interval": 1e-6}),
    lambda: ds.creep_exact(many, 0.1),
    lambda: ds.steady_sliding_eigenvalues(**SLIDER | {"mass": many}),
    lambda: ds.spectrogram(np.arange(10**6) * 1e-3, np.ones(10**6), window=100.0),
):
    try:
        call()
    except MemoryError as error:
        print("MemoryError", error)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no /proc")
def test_memory_that_cannot_be_had_is_a_memory_error(fig3_text: str) -> None:
    """Beyond what the interpreter has there are 300 MiB."""
    assert process(f"SLIDER = {SLIDER!r}\n{LIMITED}", fig3_text).count("MemoryError") == 5
    error = error_for(47, "no memory for more than 5 samples")
    assert isinstance(error, ds.OutOfMemoryError)
    assert isinstance(error, MemoryError)
    assert isinstance(error, ds.SolverError)
    assert error.exit_status == 4


def test_any_number_of_threads_may_be_asked_for(fig3: ds.Scene) -> None:
    many = ds.sweep(fig3, {"system.mass": [0.2, 0.3]}, threads=10**5, scene=SHORT)
    assert many.equals(ds.sweep(fig3, {"system.mass": [0.2, 0.3]}, threads=1, scene=SHORT).assign(wall_time=many.wall_time))
