"""Sweeps: a case is a single run, a failure is a row, Python gives what the file has."""

from __future__ import annotations

import dynstiction as ds
import h5py
import numpy as np
import pytest
from sweeps import SCENE, Sweep, values


@pytest.fixture
def sweep(tmp_path):
    return Sweep(tmp_path)


def test_a_case_that_fails_is_a_row(sweep, tmp_path):
    assert "cases failed" in sweep.run("f.h5", "--set", "integrator.max_steps=600", status=5).stderr
    found = values(tmp_path / "f.h5")
    failed = found["result_code"] != 0
    assert 0 < np.count_nonzero(failed) < 60
    assert set(found["result_code"][failed]) == {42}
    assert list(found["failures/case"]) == list(found["case"][failed])
    assert all(b"max_steps" in text for text in found["failures/result_text"])
    assert np.isnan(found["summary/final_u_x"][failed]).all()


def identical(a, b):
    """Whether two datasets are the same but for the clock."""
    xarray = pytest.importorskip("xarray")
    xarray.testing.assert_identical(a.drop_vars("wall_time"), b.drop_vars("wall_time"))
    return a["wall_time"].attrs == b["wall_time"].attrs and a["wall_time"].dims == b["wall_time"].dims


def test_a_file_opens_as_what_the_sweep_returns_and_a_case_is_a_single_run(sweep, tmp_path):
    path = tmp_path / "o.h5"
    sweep.run(path.name, status=0)
    data = ds.open(path)
    assert data["period"].dims == ("misalignment_deg", "velocity")
    assert (data["velocity"].attrs["units"], data["period"].attrs["units"]) == ("m/s", "s")
    assert identical(data, ds.sweep(sweep.deck))
    found = values(path)
    assert np.array_equal(data["period"].values.ravel(), found["summary/period"], equal_nan=True)
    case = 33
    single = ds.run(
        SCENE,
        system={"misalignment_deg": found["system.misalignment_deg"][case]},
        drive={"velocity": found["drive.velocity"][case]},
    )
    assert found["summary/period"][case] == single.summary["period"]
    assert found["summary/final_u_x"][case] == single["u_x"][-1]
    with h5py.File(path, "r+") as file:
        del file["sweep/result_code"]
    with pytest.raises(ds.FileError, match="is damaged"):
        ds.open(path)


def test_a_file_of_a_list_with_failures_opens_too(sweep, tmp_path):
    (tmp_path / "points.csv").write_text("system.misalignment_deg,scene.t_end\n1,3\n2,6\n3,30\n")
    sweep.deck.write_text(SCENE + "&sweep points = 'points.csv' /\n")
    limit = "integrator.max_steps=600"
    sweep.run("l.h5", "--set", limit, status=5)
    with pytest.warns(ds.IncompleteWarning, match="1 of 3 cases failed"):
        data = ds.open(tmp_path / "l.h5")
    assert list(data["t_end"].values) == [3.0, 6.0, 30.0]
    assert list(data["result_code"].values) == [0, 0, 42] and "max_steps" in str(data["result_text"].values[2])
    with pytest.warns(ds.IncompleteWarning):
        assert identical(data, ds.sweep(sweep.deck, integrator={"max_steps": 600}))


def test_a_partial_file_opens_with_a_warning(sweep, tmp_path):
    sweep.run("h.h5", "--share", "1/2", status=0)
    sweep.run("h.h5", command="merge", status=75)
    with pytest.warns(ds.IncompleteWarning, match="30 of 60 cases have not been run"):
        data = ds.open(tmp_path / "h.h5")
    assert np.count_nonzero(data["result_code"] == -1) == np.count_nonzero(np.isnan(data["final_u_x"])) == 30


@pytest.mark.parametrize(
    ("first", "last", "spacing", "expected"),
    [
        (-9.6e307, 9.6e307, "linear", [-9.6e307, -4.8e307, 0.0, 4.8e307, 9.6e307]),
        (9.2e307, -9.0e307, "linear", [9.2e307, 4.65e307, 1.0e306, -4.45e307, -9.0e307]),
        (1.0e-300, 1.0e300, "log", [1.0e-300, 1.0e-150, 1.0, 1.0e150, 1.0e300]),
        (-1.0e300, -1.0e-300, "log", [-1.0e300, -1.0e150, -1.0, -1.0e-150, -1.0e-300]),
        (1.0e-306, 1.0e-302, "log", [1.0e-306, 1.0e-305, 1.0e-304, 1.0e-303, 1.0e-302]),
    ],
)
def test_limits_whose_difference_or_ratio_is_beyond_the_range_of_the_numbers(tmp_path, first, last, spacing, expected):
    limits = f" parameter = 'initial.elongation_x'\n first = {first!r}\n last = {last!r}\n"
    sweep = Sweep(tmp_path, f"{SCENE}&sweep\n{limits} count = 5\n spacing = '{spacing}'\n/\n")
    sweep.run("wide.h5", "--set", "scene.t_end=1e-4")
    assert values(tmp_path / "wide.h5")["initial.elongation_x"] == pytest.approx(expected, rel=1e-12, abs=0.0)
