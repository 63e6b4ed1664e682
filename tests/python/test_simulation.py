"""Runs step by step, and bars that show how far they are."""

from __future__ import annotations

import sys
import threading
import time
import types
import warnings
import weakref
from typing import ClassVar

import dynstiction as ds
import numpy as np
import pytest
import results
from dynstiction import _progress
from programs import INPUTS

hypothesis = pytest.importorskip("hypothesis", reason="pip install hypothesis")
st = hypothesis.strategies

SHORT = {"t_end": 0.05}

SCENES = {
    "full": ds.Scene(INPUTS / "fig3.nml", scene={"t_end": 0.05}),
    "every step": ds.Scene(INPUTS / "fig3.nml", scene={"t_end": 0.02}, output={"interval": 0.0}),
    "low_frequency": ds.Scene(INPUTS / "low_frequency.nml"),
    "high_frequency": ds.Scene(INPUTS / "high_frequency.nml"),
    "creep": ds.Scene(INPUTS / "creep.nml"),
    "dopri5": ds.Scene(INPUTS / "fig3.nml", scene={"t_end": 0.05}, integrator={"method": "dopri5"}),
}


def assert_same(a: ds.Result, b: ds.Result) -> None:
    """Two results agree to the last bit, but for the wall time and when they were made."""
    results.assert_same(a, b)
    assert list(a) == list(b)
    assert all(a[name].flags.c_contiguous for name in a)
    assert dict(a.summary) == dict(b.summary)
    assert {**a.statistics, "wall_time": 0} == {**b.statistics, "wall_time": 0}
    assert {**a.attributes, "created": ""} == {**b.attributes, "created": ""}


@pytest.mark.parametrize("name", SCENES)
@hypothesis.given(shares=st.lists(st.floats(0.0, 1.0), max_size=8))
@hypothesis.settings(max_examples=8, deadline=None)
def test_steps_end_in_the_bits_of_the_run(name: str, shares: list[float]) -> None:
    scene = SCENES[name]
    whole = ds.run(scene)
    with ds.Simulation(scene) as simulation:
        for share in sorted(shares):
            time = share * simulation.t_end
            simulation.step_to(time)
            assert simulation.time == time
            so_far = simulation.result
            assert so_far.time.size == np.searchsorted(whole.time, time, side="right")
            np.testing.assert_array_equal(so_far["X"], whole["X"][: so_far.time.size])
            np.testing.assert_array_equal(simulation.events, whole.events[whole.events["time"] <= time])
        result = simulation.finish()
        assert simulation.finished
    assert_same(result, whole)


@pytest.mark.parametrize("name", [name for name in SCENES if name != "every step"])
def test_the_state_is_what_a_sample_there_holds(name: str) -> None:
    whole = ds.run(SCENES[name])
    with ds.Simulation(SCENES[name]) as simulation:
        for i in (0, whole.time.size // 3, whole.time.size // 2, whole.time.size - 1):
            simulation.step_to(whole.time[i])
            state = simulation.state
            assert {column: whole[column][i] for column in whole} == dict(state)
            assert state.units == whole.columns.units


def test_what_is_not_finished_says_so(fig3: ds.Scene) -> None:
    with ds.Simulation(fig3, scene=SHORT) as simulation:
        simulation.step_to(0.01)
        part = simulation.result
        assert not simulation.finished
        assert "t = 0.01 of 0.05 s, running" in repr(simulation)
    assert (part.complete, part.result_code, len(part.summary)) == (False, -1, 0)
    assert part.parameters["mass"] == 0.25
    assert "closed" in repr(simulation)
    assert_same(simulation.result, part)
    for use in (lambda: simulation.step_to(0.02), lambda: simulation.state, simulation.finish):
        with pytest.raises(ds.UsageError, match="closed"):
            use()


def test_no_way_back_and_none_beyond_the_end(fig3: ds.Scene) -> None:
    with ds.Simulation(fig3, scene=SHORT) as simulation:
        simulation.step_to(0.01)
        for time in (0.005, 0.06, -1.0, np.nan, np.inf):
            with pytest.raises(ds.UsageError, match=r"has reached 0\.01 s and ends at 0\.05 s"):
                simulation.step_to(time)
            assert simulation.time == 0.01
        simulation.step_to(0.05)
        simulation.step_to(0.05)
        assert simulation.finish().complete


def test_a_solver_that_gives_up_raises_with_what_there_is(fig3: ds.Scene) -> None:
    with ds.Simulation(fig3, scene=SHORT, integrator={"max_steps": 50}) as simulation:
        with pytest.raises(ds.SolverError, match="max_steps") as gave_up:
            simulation.step_to(0.05)
        assert simulation.finished
        assert simulation.time == gave_up.value.result.time[-1] < 0.05
        for again in (simulation.finish, lambda: simulation.step_to(0.05)):
            with pytest.raises(ds.SolverError, match="max_steps"):
                again()


def test_a_wall_limit_warns_where_it_was_called(fig3: ds.Scene) -> None:
    long = {"scene": {"t_end": 1e6}, "output": {"wall_limit": 0.05, "interval": 1.0}}

    def finish() -> ds.Result:
        with ds.Simulation(fig3, **long) as simulation:
            return simulation.finish()

    for call in (lambda: ds.run(fig3, **long), finish):
        with warnings.catch_warnings(record=True, action="always") as caught:
            result = call()
        assert not result.complete
        assert [w.filename for w in caught if w.category is ds.IncompleteWarning] == [__file__]


def test_a_refused_scene_and_a_lost_simulation_leave_nothing(fig3: ds.Scene) -> None:
    with pytest.raises(ds.DeckError, match=r"system\.mass"):
        ds.Simulation(fig3, system={"mass": -1.0})
    simulation = ds.Simulation(fig3)
    core = weakref.ref(simulation._core)
    del simulation
    assert core() is None


def test_simulations_interleave_and_run_in_threads(fig3: ds.Scene) -> None:
    scenes = [fig3.replace(scene=SHORT, system={"misalignment_deg": angle}) for angle in (1.0, 2.0, 5.0)]
    simulations = [ds.Simulation(scene) for scene in scenes]
    for t in (0.01, 0.02, 0.03):
        for simulation in simulations:
            simulation.step_to(t)
    threads = [threading.Thread(target=simulation.finish) for simulation in simulations]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for simulation, scene in zip(simulations, scenes, strict=True):
        assert_same(simulation.result, ds.run(scene))


# Bars


class Bar:
    """In the place of tqdm's."""

    shown: ClassVar[list[Bar]] = []

    def __init__(self, total: float, **_: object) -> None:
        self.n, self.total, self.made = 0.0, total, time.monotonic()
        self.shown.append(self)

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self.closed = True

    def update(self, step: float) -> None:
        assert step > 0
        self.n += step


@pytest.fixture
def bars(monkeypatch: pytest.MonkeyPatch) -> list[Bar]:
    monkeypatch.setitem(sys.modules, "tqdm.auto", types.SimpleNamespace(tqdm=Bar))
    monkeypatch.setattr(Bar, "shown", [])
    return Bar.shown


CALLS = {
    "run": (ds.run, 0.05),
    "sweep": (lambda scene, **how: ds.sweep(scene, {"system.misalignment_deg": [1.0, 2.0, 3.0]}, **how), 3.0),
    "trade": (lambda scene, **how: ds.trade(scene, budget=1.0, **how), None),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_bar_is_drawn_if_it_is_wanted(fig3: ds.Scene, bars: list[Bar], name: str) -> None:
    call, end = CALLS[name]
    scene = fig3.replace(scene=SHORT)
    call(scene, progress=False)
    call(scene)
    assert bars == [], "neither a terminal nor a notebook"
    call(scene, progress=True)
    (bar,) = bars
    assert bar.closed
    assert 0.0 < bar.n <= bar.total
    assert end is None or bar.n == pytest.approx(end) == bar.total


def test_on_a_terminal_only_what_takes_a_second_has_a_bar(fig3: ds.Scene, bars: list[Bar], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    ds.run(fig3, scene=SHORT)
    assert bars == []
    begun = time.monotonic()
    with _progress.progress_bar(None, 1.0, "") as show:
        while not bars and time.monotonic() < begun + 5.0:
            show(0.5)
            time.sleep(0.01)
    assert 1.0 <= bars[0].made - begun < 2.0
    ds.run(fig3, scene=SHORT, progress=False)
    monkeypatch.setattr(_progress, "DELAY", 0.0)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    ds.run(fig3, scene=SHORT)
    assert len(bars) == 1


@pytest.mark.filterwarnings("ignore::dynstiction.SamplingWarning")
def test_very_many_events_need_no_stack() -> None:
    """An irregular motion lists every event: far more than fit on the stack."""
    scene = ds.Scene(INPUTS / "fig3.nml", stiffness_y=1e6, t_end=3000.0, interval=1e4, rtol=1e-6)
    events = ds.run(scene).events
    assert len(events) > 700_000
    assert (np.diff(events["time"]) >= 0.0).all()
