"""Objects and calls of the Python package where they meet: threads, copies, processes, full disks, small memories, wild arguments.

What used to end the interpreter runs in a process of its own, whose exit status is looked at.
"""

from __future__ import annotations

import copy
import errno
import inspect
import os
import pickle
import resource
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import dynstiction as ds
import fig3 as fig3_deck
import h5py
import numpy as np
import programs
import pytest
from dynstiction import _native, _sweep, errors
from dynstiction.errors import error_for
from programs import SCRIPT, Program, small_disk
from results import assert_same

SHORT = {"t_end": 0.05}

SLIDER = fig3_deck.SLIDER | {"misalignment_deg": 1.1}

CREEP = {k: SLIDER[k] for k in ("velocity", "misalignment_deg", "stiffness_x", "stiffness_y", "mu_0", "normal_load")}


def process(script: str, deck: str, **how: object) -> str:
    """Output of a script, which has the deck as DECK; it must end without help and with exit status 0."""
    head = f"import faulthandler; faulthandler.enable()\nimport dynstiction as ds\nDECK = {deck!r}\n"
    return SCRIPT(head + script, status=0, **how).stdout


# Threads


TWO_THREADS = """
import threading
simulation = ds.Simulation(DECK, scene={"t_end": 3.0})
refused = []
def use():
    for i in range(1, 7):
        try:
            simulation.step_to(simulation.t_end * i / 6)
        except ds.UsageError as error:
            refused.append(str(error))
users = [threading.Thread(target=use) for _ in range(4)]
for user in users: user.start()
for user in users: user.join()
assert any("busy: another thread" in text for text in refused), refused
result, whole = simulation.finish(), ds.run(DECK, scene={"t_end": 3.0})
assert all(result[n].tobytes() == whole[n].tobytes() for n in whole)
"""

CLOSED_BY_ANOTHER = """
import threading, time
simulation = ds.Simulation(DECK, scene={"t_end": 1e5}, output={"interval": 1.0})
ends = []
def use():
    try:
        simulation.finish()
    except ds.UsageError as error:
        ends.append(str(error))
user = threading.Thread(target=use)
user.start()
time.sleep(0.2)
simulation.close()
user.join()
assert "closed" in ends[0], ends
assert simulation.result["X"].shape == simulation.result.time.shape
"""

SWEEP = """
import threading, time
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
users = [threading.Thread(target=use, args=(i,)) for i in range(3)]
for user in users: user.start()
while not done: time.sleep(0.01)
core.close()
for user in users: user.join()
assert len(ends) == 3 and all("closed" in text for text in ends), (ends, len(done))
"""


@pytest.mark.parametrize("script", [TWO_THREADS, CLOSED_BY_ANOTHER, SWEEP], ids=["two", "close", "sweep"])
def test_threads_are_refused_or_work(script: str, fig3_text: str) -> None:
    process(script, fig3_text)


def test_closed_handles_say_so(fig3: ds.Scene) -> None:
    run, values = _native.Run(fig3.source), _native.DeckValues(fig3.source, alone=True)
    sweep = _native.Sweep(fig3.source, [("drive.velocity", np.array([1e-3]))], False)
    uses: list[tuple[_native.Session, list[Callable[[], object]]]] = [
        (
            run,
            [
                lambda: run.advance(0.1),
                lambda: run.state(0.0),
                run.ending,
                run.parameters,
                lambda: run.sample_at(np.zeros(1)),
                run.time,
            ],
        ),
        (values, [values.given]),
        (sweep, [lambda: sweep.run(0, 1), sweep.stop]),
    ]
    for handle, methods in uses:
        handle.close()
        handle.close()
        assert handle.closed
        for method in methods:
            with pytest.raises(ds.UsageError, match="closed: make a new one"):
                method()


def test_the_result_is_not_read_while_it_grows(fig3: ds.Scene) -> None:
    simulation = ds.Simulation(fig3, scene={"t_end": 1e5}, output={"interval": 1.0})

    def finish() -> None:
        with pytest.raises(ds.UsageError, match="closed"):
            simulation.finish()

    user = threading.Thread(target=finish)
    user.start()
    while simulation._alone._lock.acquire(blocking=False):
        simulation._alone._lock.release()
        time.sleep(0.001)
    for look in ("result", "events", "state"):
        with pytest.raises(ds.UsageError, match="busy"):
            getattr(simulation, look)
    assert "running" in repr(simulation)
    simulation.close()
    user.join()
    assert simulation.result["X"].shape == simulation.result.time.shape


# Copies and processes


@pytest.mark.parametrize("wrapped", [lambda x: x, lambda x: [x], lambda x: {"a": (x,)}], ids=["it", "list", "dict"])
def test_handles_are_not_copied(fig3: ds.Scene, wrapped: Callable[[object], object]) -> None:
    with ds.Simulation(fig3, scene=SHORT) as simulation:
        for thing in (simulation, simulation._core):
            for copying in (copy.deepcopy, pickle.dumps, lambda x: pickle.dumps(x, protocol=0)):
                with pytest.raises(TypeError, match="the scene that it was made of, or its result"):
                    copying(wrapped(thing))
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
    for kind in kinds:
        again = kind.__new__(kind)
        again.args = ("no memory", 47, None)
        assert type(again) is kind
        assert "no memory" in str(again)


SENT = """
import multiprocessing, pickle
from concurrent.futures import ProcessPoolExecutor
import os, sys
simulation = ds.Simulation(DECK)
with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
    try:
        pool.submit(repr, simulation).result(timeout=60)
    except TypeError as error:
        print(error)
    result = pool.submit(ds.run, ds.Scene(DECK), scene={"t_end": 0.05}).result(timeout=60)
    print(result.complete)
with multiprocessing.get_context("spawn").Pool(1) as pool:
    try:
        pool.map(repr, [simulation])
    except TypeError as error:
        print(error)
"""


def test_spawned_processes_get_scenes_not_simulations(fig3_text: str) -> None:
    lines = process(SENT, fig3_text).splitlines()
    assert len(lines) == 3
    assert "scene" in lines[0]
    assert lines[1] == "True"
    assert "scene" in lines[2]


FORKED = """
import os, threading, multiprocessing
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
        assert "when this process was forked" in str(error), error
    else:
        raise AssertionError("used")
    busy.close()
for i in range(5):
    pid = os.fork()
    if pid == 0:
        status = 1
        try:
            child()
            status = 0
        finally:
            os._exit(status)
    assert os.waitpid(pid, 0)[1] == 0
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


INTERPRETERS = """
import _xxsubinterpreters as interpreters
code = "import dynstiction as ds; assert 0 < ds.creep_exact(0.5, 0.1).v < 1"
for _ in range(3):
    try:
        interpreters.run_string(interpreters.create(), code)
    except interpreters.RunFailedError as error:
        print(error)
exec(code)
"""


def test_further_interpreters_say_what_to_do(fig3_text: str) -> None:
    pytest.importorskip("_xxsubinterpreters")
    for line in process(INTERPRETERS, fig3_text).splitlines():
        assert "PackageError" in line
        assert "in one of them, or use processes" in line


# Numbers at the edges


def test_linear_theory_at_the_edges_of_the_numbers(fig3_text: str) -> None:
    """Values, or an error; never the end of the interpreter. NaN only where there is no critical angle, or creep does not end."""
    script = f"""
import numpy as np
slider = {SLIDER!r}
rng = np.random.default_rng(5)
def extreme(key):
    if key == "misalignment_deg":
        return rng.uniform(-92, 92)
    return 10.0 ** rng.uniform(-323, 308) if rng.random() < 0.5 else slider[key]
edges = [{{key: value}} for key in slider for value in (5e-324, 1e-307, 1e-150, 1e150, 1e307, 1.7e308)]
edges += [{{"v_smooth": value}} for value in (5e-324, 1e-150, 1e150, 1e308)]
edges += [{{key: extreme(key) for key in slider}} for _ in range(3000)]
done = 0
for change in edges:
    case = {{**slider, **change}}
    try:
        values = ds.steady_sliding_eigenvalues(**case)
        assert np.all(np.isfinite(values)), case
        done += 1
        found = ds.critical_misalignment(**case)
        for pair in (found.angle, found.frequency, found.window):
            assert np.all(np.isnan(pair)) or np.all(np.isfinite(pair)), (case, found)
        case.pop("v_smooth", None)
        end = np.array(ds.creep_end(**case))
        assert np.all(np.isnan(end)) or np.all(np.isfinite(end) & (end >= 0)), (case, end)
        assert np.isfinite(ds.damping_ratio(0.3, **case))
    except ds.UsageError:
        pass
print(done)
"""
    assert int(process(script, fig3_text)) > 1000


@pytest.mark.parametrize("power", [-980, -600, -200, 200, 600, 980])
def test_eigenvalues_do_not_depend_on_the_unit_of_mass(power: int) -> None:
    """Mass, stiffness and load in another unit, a power of two: the same bits."""
    plain = ds.steady_sliding_eigenvalues(**SLIDER)
    critical = ds.critical_misalignment(**SLIDER)
    scaled = SLIDER | {k: SLIDER[k] * 2.0**power for k in ("mass", "stiffness_x", "stiffness_y", "normal_load")}
    assert np.array_equal(ds.steady_sliding_eigenvalues(**scaled), plain)
    for a, b in zip(ds.critical_misalignment(**scaled), critical, strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("power", [-500, -200, 200, 480])
def test_eigenvalues_follow_the_unit_of_time(power: int) -> None:
    """Stiffnesses in 2**2p N/m, damping in 2**p N s/m: frequencies in 2**p 1/s, bit for bit."""
    scaled = SLIDER | {
        "stiffness_x": SLIDER["stiffness_x"] * 2.0 ** (2 * power),
        "stiffness_y": SLIDER["stiffness_y"] * 2.0 ** (2 * power),
        "normal_load": SLIDER["normal_load"] * 2.0**power,
    }
    plain, found = ds.steady_sliding_eigenvalues(**SLIDER), ds.steady_sliding_eigenvalues(**scaled)
    assert np.array_equal(found, plain * 2.0**power)
    frequency = ds.critical_misalignment(**SLIDER).frequency
    assert np.array_equal(ds.critical_misalignment(**scaled).frequency, frequency * 2.0**power)


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
    "creep_frequency": (ds.creep_frequency, {"t": 0.5, "mass": 0.25, **CREEP}),
    "oscillation_frequency": (ds.oscillation_frequency, {"theta": 0.3, "mass": 0.25, "stiffness_x": 1e3, "stiffness_y": 1e7}),
    "spectrogram": (ds.spectrogram, {"time": np.arange(99) * 0.01, "values": np.sin(np.arange(99)), "window": 0.2, "count": 20}),
    "ridge": (ds.ridge, {"spectrum": ds.spectrogram(np.arange(99) * 0.01, np.sin(np.arange(99)), 0.2), "above": 1.0}),
}

NO_NUMBERS = ["x", b"x", 1j, [1j], {}, object(), [[1.0], [1.0, 2.0]], np.array(["a"]), np.datetime64("2020-01-01"),
              np.ma.array([1.0, 2.0], mask=[0, 1])]  # fmt: skip


@pytest.mark.parametrize("name", NUMERICAL)
def test_every_argument_that_cannot_be_meant_is_refused(name: str) -> None:
    function, good = NUMERICAL[name]
    function(**good)
    optional = {"mu_inf", "v_f", "v_smooth"} | ({"misalignment_deg"} if name == "critical_misalignment" else set())
    optional |= {"stiffness_y"} if name == "damping_ratio" else set()
    for argument in good:
        missing = [] if argument in optional or (name, argument) == ("creep_velocity", "stiffness_y") else [None]
        beyond = [np.nan, -np.inf] + ([] if (name, argument) == ("creep_velocity", "stiffness_y") else [np.inf])
        for value in [*missing, *NO_NUMBERS, *beyond]:
            with pytest.raises(ds.UsageError):
                function(**{**good, argument: value})
        if name not in ("rhs", "jacobian", "spectrogram", "ridge") and argument != "form":
            other = next(key for key in good if key != argument)
            with pytest.raises(ds.UsageError, match="broadcast"):
                function(**{**good, argument: np.full(2, good[argument]), other: np.full(3, good[other])})


def test_every_numerical_function_is_tried() -> None:
    public = {n for n in ds.__all__ if inspect.isfunction(getattr(ds, n))}
    others = {
        "open",
        "run",
        "sweep",
        "trade",
        "stick_slip_statistics",
        "branch",
        "cycles",
        "derivatives",
        "fold_curve",
        "sensitivity",
        "stick_slip_range",
        "slip_problem",
    }
    others |= {"read_trace", "find_cycles", "mean_waveform", "mean_slip", "compare", "fit", "plan_traces", "fit_creep", "fit_friction_law", "creep_test"}
    assert set(NUMERICAL) == public - others


@pytest.mark.parametrize("argument", ["mass", "stiffness_x", "velocity", "mu_0", "normal_load", "v_f"])
def test_a_negative_or_no_mass_gives_no_frequency(argument: str) -> None:
    for name in ("rhs", "jacobian", "steady_sliding_eigenvalues", "creep_end", "damping_ratio", "creep_velocity", "creep_frequency",
                 "oscillation_frequency"):  # fmt: skip
        function, good = NUMERICAL[name]
        for value in (-1.0, 0.0):
            if argument not in good or (argument == "velocity" and name not in ("creep_velocity", "creep_frequency")):
                continue
            if value == 0.0 and argument in ("mu_0", "normal_load") and name not in ("creep_velocity", "creep_frequency"):
                continue
            with pytest.raises(ds.UsageError, match=argument):
                function(**{**good, argument: value})


def test_no_rate_where_friction_has_no_direction() -> None:
    at_rest = [[0.0, 0.0, 0.0, 0.0]]
    for function in (ds.rhs, ds.jacobian):
        with pytest.raises(ds.UsageError, match=r"w = 0, .* give v_smooth > 0"):
            function(at_rest, **SLIDER)
        assert np.all(np.isfinite(function(at_rest, **SLIDER, v_smooth=1e-5)))
        with pytest.raises(ds.UsageError, match="beyond the range"):
            function([[1e308, 1e308, 1e308, 1.0]], **SLIDER)


def test_products_beyond_the_numbers_give_no_creep() -> None:
    for change in ({"mu_0": 1e200, "normal_load": 1e200}, {"mu_0": 1e-200, "normal_load": 1e-200},
                   {"velocity": 1e-200, "stiffness_x": 1e-200}):  # fmt: skip
        with pytest.raises(ds.UsageError, match="must be finite and in"):
            ds.creep_velocity(0.5, **{**CREEP, "stiffness_y": 1e307, **change})


WILD: dict[str, Callable[[ds.Scene], object]] = {
    "run(None-like deck)": lambda scene: ds.run(3),
    "run(bytes)": lambda scene: ds.run(b"&scene /"),
    "run(group is text)": lambda scene: ds.run(scene, system="mass"),
    "run(key with line break)": lambda scene: ds.run(scene, system={"mass\nsystem.mass": 1.0}),
    "run(key is number)": lambda scene: ds.run(scene, system={1: 1.0}),
    "run(half a character)": lambda scene: ds.run(scene, scene={"title": "\ud800"}),
    "run(progress)": lambda scene: ds.run(scene, progress="yes"),
    "Scene(self-containing list)": lambda scene: ds.Scene(scene, drive={"velocity": LOOP}),
    "Scene(huge number)": lambda scene: ds.Scene(scene, drive={"velocity": 10**5000}),
    "Scene": lambda scene: ds.Scene(5),
    "sweep(parameters)": lambda scene: ds.sweep(scene, "x"),
    "sweep(values)": lambda scene: ds.sweep(scene, {"system.mass": [None]}),
    "sweep(threads)": lambda scene: ds.sweep(scene, {"system.mass": [1.0]}, threads=1.5),
    "sweep(points)": lambda scene: ds.sweep(scene, {"system.mass": [1.0]}, points="x"),
    "trade(quantities)": lambda scene: ds.trade(scene, quantities=1),
    "trade(quantities, 1)": lambda scene: ds.trade(scene, quantities=[1]),
    "trade(budget)": lambda scene: ds.trade(scene, budget=None),
    "trade(budget nan)": lambda scene: ds.trade(scene, budget=np.nan),
    "ridge": lambda scene: ds.ridge(1),
    "ridge(empty)": lambda scene: ds.ridge(ds.Spectrogram(np.empty(0), np.empty(0), np.empty((0, 0)))),
    "spectrogram(count)": lambda scene: ds.spectrogram(np.arange(99.0), np.ones(99), 20.0, count=0),
    "spectrogram(overflow)": lambda scene: ds.spectrogram(np.arange(99.0), np.arange(99) * 1e300, 20.0),
    "stick_slip_statistics": lambda scene: ds.stick_slip_statistics(None),
    "open": lambda scene: ds.open(None),
    "open(3)": lambda scene: ds.open(3),
    "Described": lambda scene: ds.Described([1]),
    "step_to": lambda scene: ds.Simulation(scene).step_to(None),
}

LOOP: list[object] = []
LOOP.append(LOOP)


@pytest.mark.parametrize("name", WILD)
def test_wild_calls_are_refused(name: str, fig3: ds.Scene) -> None:
    with pytest.raises(ds.UsageError):
        WILD[name](fig3)


def test_wild_calls_of_results_are_refused(fig3_result: ds.Result) -> None:
    for call in (
        lambda: fig3_result.sticks("x"),
        lambda: fig3_result.sticks(np.nan),
        lambda: fig3_result.to_pandas(np.ones(2)),
        lambda: fig3_result[["X"]],
        lambda: fig3_result.save(None),
        lambda: fig3_result.save(3),
        lambda: fig3_result.save("x.h5", overwrite="no"),
        lambda: ds.stick_slip_statistics(fig3_result)[[1]],
    ):
        with pytest.raises(ds.UsageError):
            call()


# Saving


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk(tmp_path / "disk", "64k"):
        yield tmp_path / "disk"


SAVED = """
import os, sys
folder, overwrite = {folder!r}, {overwrite!r}
result = ds.run(DECK, scene={{"t_end": 0.3}})
try:
    result.save(folder + "/x.h5", overwrite=overwrite)
except OSError as error:
    assert isinstance(error, ds.FileError)
    print(error)
"""


def test_a_full_disk_is_a_file_error(full_disk: Path, fig3_text: str) -> None:
    told = process(SAVED.format(folder=str(full_disk), overwrite=False), fig3_text)
    assert "x.h5: cannot be written: No space left on device: free some space" in told
    assert list(full_disk.iterdir()) == []


def test_a_full_disk_keeps_the_old_file(full_disk: Path, fig3: ds.Scene, fig3_text: str) -> None:
    ds.run(fig3, scene={"t_end": 1e-3}, output={"fields": ["X"]}).save(full_disk / "x.h5")
    before = (full_disk / "x.h5").read_bytes()
    told = process(SAVED.format(folder=str(full_disk), overwrite=True), fig3_text)
    assert "No space left on device" in told
    assert (full_disk / "x.h5").read_bytes() == before
    assert [file.name for file in full_disk.iterdir()] == ["x.h5"]


def test_a_limit_of_file_sizes_is_a_file_error(tmp_path: Path, fig3_text: str) -> None:
    limit = programs.limited(resource.RLIMIT_FSIZE, 50_000)
    told = process(SAVED.format(folder=str(tmp_path), overwrite=False), fig3_text, preexec_fn=limit)
    assert "x.h5: cannot be written: File too large: raise the limit" in told
    assert list(tmp_path.iterdir()) == []


def test_each_failing_call_is_a_file_error(tmp_path: Path, fig3_result: ds.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the system refuses, and when: the old file stays, and nothing beside it."""
    target = tmp_path / "x.h5"
    fig3_result.save(target)
    before = target.read_bytes()
    for name, number in (("fsync", errno.EIO), ("fsync", errno.EDQUOT), ("replace", errno.EROFS), ("replace", errno.EACCES)):
        with monkeypatch.context() as patch:

            def fail(*_: object, number: int = number, **__: object) -> None:
                raise OSError(number, os.strerror(number))

            patch.setattr(os, name, fail)
            with pytest.raises(ds.FileError, match=rf"x\.h5: cannot be written: {os.strerror(number)}: "):
                fig3_result.save(target, overwrite=True)
        assert target.read_bytes() == before
        assert [file.name for file in tmp_path.iterdir()] == ["x.h5"]


@pytest.mark.parametrize("place", ["no/x.h5", "text/x.h5", "x" * 300, "a\0b", "."])
def test_places_without_a_file_are_file_errors(tmp_path: Path, fig3_result: ds.Result, place: str) -> None:
    (tmp_path / "text").write_text("mine")
    with pytest.raises(ds.FileError):
        fig3_result.save(tmp_path / place)
    assert [file.name for file in tmp_path.iterdir()] == ["text"]


def test_files_of_others_are_never_replaced(tmp_path: Path, fig3_result: ds.Result) -> None:
    foreign = tmp_path / "foreign.h5"
    with h5py.File(foreign, "w") as file:
        file["data"] = np.arange(3)
        file.attrs["program"] = "another"
    (tmp_path / "text.h5").write_text("mine")
    os.symlink(tmp_path / "text.h5", tmp_path / "link.h5")
    (tmp_path / "folder.h5").mkdir()
    os.mkfifo(tmp_path / "pipe.h5")
    for name in ("foreign", "text", "link", "folder", "pipe"):
        path = tmp_path / f"{name}.h5"
        before = path.read_bytes() if path.is_file() else path.stat().st_ino
        with pytest.raises(ds.FileError, match=r"overwrite=True|it is a folder"):
            fig3_result.save(path)
        with pytest.raises(ds.FileError, match=r"is no result of dynstiction|not a regular file|it is a folder"):
            fig3_result.save(path, overwrite=True)
        assert before == (path.read_bytes() if path.is_file() else path.stat().st_ino)
    assert len(list(tmp_path.iterdir())) == 5


def test_of_two_savers_one_is_refused(tmp_path: Path, fig3: ds.Scene) -> None:
    """Without overwrite: whoever comes first."""
    result = ds.run(fig3, scene={"t_end": 1e-3})
    refused: list[str] = []
    for i in range(20):
        start = threading.Barrier(2)

        def save(i: int = i, start: threading.Barrier = start) -> None:
            start.wait()
            try:
                result.save(tmp_path / f"{i}.h5")
            except ds.FileError as error:
                refused.append(str(error))

        savers = [threading.Thread(target=save) for _ in range(2)]
        for saver in savers:
            saver.start()
        for saver in savers:
            saver.join()
    assert len(refused) == 20
    assert len(list(tmp_path.iterdir())) == 20


def test_a_saved_file_has_the_usual_permissions(tmp_path: Path, fig3_result: ds.Result) -> None:
    (tmp_path / "plain").touch()
    fig3_result.save(tmp_path / "x.h5")
    assert stat.S_IMODE((tmp_path / "x.h5").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


# Packages, series, memory, stacks


def test_a_missing_package_is_told_before_anything_is_computed(
    fig3: ds.Scene, fig3_result: ds.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_sweep._native, "Sweep", lambda *_: pytest.fail("computed"))
    for package, call in (
        ("xarray", lambda: ds.sweep(fig3, {"system.mass": [1.0]})),
        ("xarray", fig3_result.to_xarray),
        ("pandas", fig3_result.to_pandas),
        ("pandas", ds.stick_slip_statistics(fig3_result).to_pandas),
        ("tqdm", lambda: ds.run(fig3, progress=True)),
    ):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, package, None)
            patch.delitem(sys.modules, f"{package}.auto", raising=False)
            with pytest.raises(ds.PackageError, match=f"needs {package} .*pip install {package}") as missing:
                call()
        assert isinstance(missing.value, ImportError)


def test_series_are_refused_not_dropped(fig3: ds.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_native.Sweep, "run", lambda *_: pytest.fail("computed"))
    grid = {"parameter": "drive.velocity", "first": 1e-3, "last": 2e-3, "count": 2, "keep": "series"}
    with pytest.raises(ds.UsageError, match=r"keep = 'series': .* sweep=\{'keep': 'summary'\}"):
        ds.sweep(fig3, sweep=grid)
    with pytest.raises(ds.UsageError, match="keep = 'series'"):
        ds.sweep(fig3, {"drive.velocity": [2e-3]}, sweep=grid)


def limited(megabytes: int) -> str:
    """Beginning of a script with so much memory beyond what the interpreter has."""
    return f"""
import resource, xarray, h5py, numpy as np
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + {megabytes} * 2**20,) * 2)
try:
    CALL
except MemoryError as error:
    print("MemoryError", error)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no /proc")
@pytest.mark.parametrize(
    "call",
    [
        'ds.sweep(DECK, {"drive.velocity": np.ones(30000), "system.mass": np.ones(30000)})',
        'ds.run(DECK, scene={"t_end": 1e4}, output={"interval": 1e-6})',
        "ds.creep_exact(np.broadcast_to(0.5, 10**8), 0.1)",
        "ds.steady_sliding_eigenvalues(**dict(mass=np.broadcast_to(0.5, 10**8), stiffness_x=1e3, stiffness_y=1e7, "
        "misalignment_deg=5.0, mu_0=0.2, normal_load=10.0, velocity=1e-3))",
        "ds.spectrogram(np.arange(10**6) * 1e-3, np.ones(10**6), window=100.0, count=10**6)",
    ],
    ids=["sweep", "run", "creep", "eigenvalues", "spectrogram"],
)
def test_memory_that_cannot_be_had_is_a_memory_error(call: str, fig3_text: str) -> None:
    assert "MemoryError" in process(limited(300).replace("CALL", call), fig3_text)


def test_the_core_s_lack_of_memory_is_a_memory_error() -> None:
    error = error_for(47, "no memory for more than 5 samples")
    assert isinstance(error, ds.OutOfMemoryError)
    assert isinstance(error, MemoryError)
    assert isinstance(error, ds.SolverError)
    assert error.exit_status == 4


SMALL_STACK = """
import threading
import numpy as np, xarray, scipy.signal
errors = []
def use():
    try:
        ds.run(DECK, scene={"t_end": 0.05, "model": "auto"})
        for method in ("radau13", "dopri5", "dop853"):
            ds.run(DECK, scene={"t_end": 0.05}, integrator={"method": method})
        ds.sweep(DECK, {"system.misalignment_deg": np.linspace(1, 8, 4)}, scene={"t_end": 0.05})
        ds.trade(DECK, budget=2.0, scene={"t_end": 0.05})
        n = 10000
        ds.rhs(np.ones((n, 4)), **SLIDER)
        ds.steady_sliding_eigenvalues(**{**SLIDER, "mass": np.ones(n)})
        ds.creep_exact(np.linspace(0, 1, n), 0.1)
        try:
            ds.run("&scene " + "x" * 900000 + " /")
        except ds.DeckError:
            pass
    except BaseException as error:
        errors.append(error)
threading.stack_size(SIZE)
user = threading.Thread(target=use)
user.start()
user.join()
assert not errors, errors
"""


@pytest.mark.parametrize("kilobytes", [256, 1024])
def test_small_stacks_of_threads_suffice(kilobytes: int, fig3_text: str) -> None:
    script = f"SLIDER = {SLIDER!r}\n{SMALL_STACK}".replace("SIZE", str(kilobytes * 1024))
    process(script, fig3_text)


@pytest.mark.parametrize("kilobytes", [32, 64, 128, 192])
def test_smaller_stacks_are_refused(kilobytes: int, fig3_text: str) -> None:
    script = """
import threading
idle = ds.Simulation(DECK)
refused = []
def use():
    for call in (lambda: ds.run(DECK), lambda: ds.Scene(DECK).groups(), idle.finish, lambda: idle.state):
        try:
            call()
        except ds.UsageError as error:
            refused.append(str(error))
threading.stack_size(SIZE)
user = threading.Thread(target=use)
user.start()
user.join()
assert len(refused) == 4 and all("threading.stack_size(0)" in text for text in refused), refused
"""
    process(script.replace("SIZE", str(kilobytes * 1024)), fig3_text)


def test_any_number_of_threads_may_be_asked_for(fig3: ds.Scene) -> None:
    many = ds.sweep(fig3, {"system.mass": [0.2, 0.3]}, threads=10**5, scene=SHORT)
    assert many.equals(ds.sweep(fig3, {"system.mass": [0.2, 0.3]}, threads=1, scene=SHORT).assign(wall_time=many.wall_time))
