"""Samples at times that are given: they are what a run has there, to the last bit."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest

MODELS = {
    "full": {},
    "every step": {"interval": 0.0},
    "smoothed": {"contact": "smoothed", "v_smooth": 1e-6},
    "rk4": {"method": "rk4", "step": 1e-6, "rtol": None, "contact": "smoothed", "v_smooth": 1e-5},
    "dopri5": {"method": "dopri5"},
    "low_frequency": {"model": "low_frequency", "stiffness_y": None, "cycle_map": None, "contact": None, "method": "radau9"},
}


@pytest.mark.parametrize("name", MODELS)
def test_samples_are_those_of_a_grid(name: str, fig3: ds.Scene) -> None:
    scene = fig3.replace(**({"t_end": 0.3, "interval": 1e-4} | MODELS[name]))
    grid = ds.run(scene.replace(interval=1e-4))
    chosen = np.unique(np.random.default_rng(1).integers(0, grid.time.size, 200))
    result = ds.run(scene, times=grid.time[chosen])
    for column in grid:
        assert result[column].tobytes() == grid[column][chosen].tobytes(), column
    assert result.events.tobytes() == grid.events.tobytes()
    assert result.complete


def test_times_between_samples(fig3: ds.Scene) -> None:
    """Dense output, not interpolation between samples."""
    times = np.sort(np.random.default_rng(2).uniform(0.0, 0.3, 50))
    result = ds.run(fig3, t_end=0.3, times=times)
    assert result.time.tobytes() == times.tobytes()
    with ds.Simulation(fig3, t_end=0.3) as simulation:
        for i, time in enumerate(times):
            simulation.step_to(time)
            for column, value in simulation.state.items():
                assert result[column][i] == value, (column, time)


@pytest.mark.parametrize("times", [[0.0], [0.3], np.array([0.1, 0.2]), (0, 0.05, 0.3)])
def test_nothing_but_the_given_times(times: object, fig3: ds.Scene) -> None:
    with ds.Simulation(fig3, t_end=0.3, times=times) as simulation:
        simulation.step_to(0.12)
        assert simulation.result.time.tolist() == [float(time) for time in times if time <= 0.12]  # type: ignore[attr-defined]
        assert simulation.finish().time.tolist() == list(map(float, times))  # type: ignore[call-overload]


def test_what_settles_has_no_samples_after_its_end(fig3: ds.Scene) -> None:
    scene = fig3.replace(model="low_frequency", stiffness_y=None, cycle_map=None, contact=None, method="radau9", settle=1e-3)
    times = np.arange(0.0, 10.0, 0.5)
    result, whole = ds.run(scene, times=times), ds.run(scene)
    assert 0.5 < whole.time[-1] < 9.0
    assert result.time.tolist() == times[times <= whole.time[-1]].tolist()


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([0.2, 0.1], "do not ascend: numpy.unique"),
        ([0.1, 0.4], r"times end at 0.4 s, and the run at 0.3 s: give t_end=0.4"),
        ([-0.1, 0.1], r"times = -0.1.*must be finite and in \[0"),
        ([], "give a list of times"),
        ([[0.1]], "give a list of times"),
        ("x", "real number"),
    ],
)
def test_times_that_cannot_be_meant(times: object, words: str, fig3: ds.Scene) -> None:
    with pytest.raises(ds.UsageError, match=words):
        ds.run(fig3, t_end=0.3, times=times)
