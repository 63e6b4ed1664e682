"""Stick-slip cycle by cycle against the summary of the core and against waves that are known."""

from __future__ import annotations

import pickle

import dynstiction as ds
import numpy as np
import pytest
from dynstiction._native import Info
from dynstiction.record import LOG_DTYPE
from programs import INPUTS

SAME = ("period", "peak_force", "valley_force", "stick_duration", "slip_duration", "slip_length")


def made(force: np.ndarray, time: np.ndarray, events: list[tuple[float, int]] | None = None) -> ds.Result:
    """A result with a known spring force; friction limit 1 N."""
    columns = {"time": time, "spring_force_x": force, "X": time - force}
    parameters = {"mu_0": 0.5, "normal_load": 2.0}
    return ds.Result(
        columns=ds.Described((Info(n, "1", n), np.asarray(v, dtype=float)) for n, v in columns.items()),
        log=np.array([(*event, 1, 0.0) for event in events or []], dtype=LOG_DTYPE),
        summary=ds.Described([]),
        statistics=ds.Described([]),
        parameters=ds.Described((Info(n, "1", n), v) for n, v in parameters.items()),
    )


@pytest.mark.parametrize("deck", ["fig3", "fig3_constant", "low_frequency", "reversal", "slide_hold_slide"])
def test_means_agree_with_the_summary(deck: str) -> None:
    result = ds.run(INPUTS / f"{deck}.nml")
    interval = float(result.parameters["interval"])
    cycles = ds.stick_slip_statistics(result)
    whole, means = np.flatnonzero(np.isfinite(cycles["period"])), cycles.means()
    speed = result.summary["max_X_rate"]
    # The force falls no faster than the object slips.
    allowed = dict(zip(SAME, np.multiply(interval, [1, 1e3 * speed, 1e3 * speed, 2, 2, 2 * speed]), strict=True))
    for name in SAME:
        assert (name in means) == (name in result.summary)
        if name in means:
            assert abs(cycles[name][whole[-max(2, whole.size // 2) :]].mean() - means[name]) <= allowed[name], name
            assert means.units[name] == result.summary.units[name]
    assert whole.size == result.summary["cycles"]


def test_fig3_is_periodic_cycle_by_cycle(fig3_result: ds.Result) -> None:
    cycles = ds.stick_slip_statistics(fig3_result)
    assert len(cycles) == 9
    whole = slice(0, 8)
    np.testing.assert_allclose(cycles["period"][whole], 0.91506, atol=1e-4)
    np.testing.assert_array_equal(cycles["rests"][whole], 434)
    assert np.isnan(cycles["period"][-1])
    # The object is at rest in no part of the slip and in a small one of the stiction.
    assert np.all((cycles["rest_time"][whole] > 0.0) & (cycles["rest_time"][whole] < cycles["stick_duration"][whole]))
    within = (fig3_result.time >= cycles["peak_time"][0]) & (fig3_result.time < cycles["peak_time"][-1])
    sticking = fig3_result["sticking"][within].mean() * (cycles["peak_time"][-1] - cycles["peak_time"][0])
    assert cycles["rest_time"][whole].sum() == pytest.approx(sticking, rel=0.05)


def test_a_known_wave() -> None:
    time = np.linspace(0.0, 5.25, 5251)
    result = made(np.sin(2 * np.pi * time), time, [(0.1, 2), (0.5, 1), (0.75, 2), (1.0, 1), (2.75, 2), (5.0, 1)])
    cycles = ds.stick_slip_statistics(result)
    np.testing.assert_allclose(cycles["peak_time"], [0.25, 1.25, 2.25, 3.25, 4.25], atol=1e-6)
    np.testing.assert_allclose(cycles["peak_force"], 1.0, atol=1e-9)
    np.testing.assert_allclose(cycles["valley_force"], -1.0, atol=1e-9)
    np.testing.assert_allclose(cycles["slip_duration"], 0.5, atol=1e-6)
    np.testing.assert_allclose(cycles["slip_length"], 2.5, atol=1e-5)
    np.testing.assert_allclose(cycles["period"][:-1], 1.0, atol=1e-6)
    np.testing.assert_array_equal(cycles["rests"][:-1], [2, 0, 0, 0])
    np.testing.assert_allclose(cycles["rest_time"][:-1], [0.5, 1.0, 0.5, 0.0], atol=1e-6)


def test_ripple_below_the_threshold_is_no_cycle() -> None:
    time = np.linspace(0.0, 4.0, 4001)
    assert len(ds.stick_slip_statistics(made(0.5 + 0.0049 * np.sin(50 * time), time))) == 0
    assert len(ds.stick_slip_statistics(made(0.5 + 0.0051 * np.sin(50 * time), time))) > 20
    ripple = 0.004 * np.sin(2000 * time)
    assert len(ds.stick_slip_statistics(made(np.sin(2 * np.pi * time) + ripple, time))) == 4


def test_runs_without_cycles_and_without_columns(fig3: ds.Scene) -> None:
    for still in (ds.run(INPUTS / "phi10.nml"), made(np.empty(0), np.empty(0))):
        cycles = ds.stick_slip_statistics(still)
        assert len(cycles) == 0 and dict(cycles.means()) == {}
    with pytest.raises(ds.ColumnError, match="spring_force_x"):
        ds.stick_slip_statistics(ds.run(fig3, scene={"t_end": 0.02}, output={"fields": "X"}))
    with pytest.raises(ds.UsageError, match="'mu_0'"):
        result = made(np.zeros(3), np.arange(3.0))
        ds.stick_slip_statistics(ds.Result(**{**vars(result), "parameters": ds.Described([])}))


def test_the_table_is_tabled_and_pickled(fig3_result: ds.Result) -> None:
    cycles = ds.stick_slip_statistics(fig3_result)
    assert "period = 0.91506" in repr(cycles) and "dynamic stiction" in cycles._repr_html_()
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(cycles))["period"], cycles["period"])
    with pytest.raises(ds.ColumnError, match="no column 'lambda'"):
        cycles["lambda"]
    frame = cycles.to_pandas()
    assert list(frame) == list(cycles) and frame.attrs["units"]["slip_length"] == "m"
