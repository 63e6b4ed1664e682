"""What the file of a sweep holds of the series of its cases. Its progress: test_progress.py."""

from __future__ import annotations

import dynstiction as ds
import h5py
import numpy as np
import pytest
from sweeps import GRID, SCENE, Sweep, values

SHORT = SCENE.replace("t_end = 10.0", "t_end = 1.0")
SMALL = GRID.replace("count = 12, 5", "count = 4, 3")


@pytest.fixture
def sweep(tmp_path):
    return Sweep(tmp_path, SHORT + SMALL)


def test_series_are_those_of_single_runs(sweep, tmp_path):
    sweep.run("a.h5", "--set", "sweep.keep=series", "--set", "output.interval=0.3", status=0)
    found = values(tmp_path / "a.h5")
    # The last sample is at t_end, which is no multiple of the interval.
    assert list(found["series/time"]) == [0.0, 0.3, 0.6, 3 * 0.3, 1.0]
    for case in (0, 7, 11):
        single = ds.run(
            SHORT,
            system={"misalignment_deg": found["system.misalignment_deg"][case]},
            drive={"velocity": found["drive.velocity"][case]},
            output={"interval": 0.3},
        )
        assert np.allclose(single.time, found["series/time"], rtol=1e-15, atol=0.0)
        for name in ("u_x", "X_rate", "friction", "theta", "sticking"):
            assert found[f"series/{name}"].shape == (12, 5)
            assert found[f"series/{name}"][case].tobytes() == single[name].tobytes()
    assert "series/zeta" not in found


def test_series_of_the_fields_that_are_asked_for(sweep, tmp_path):
    wanted = ("--set", "sweep.keep=series", "--set", "output.fields=theta,u_x", "--set", "output.interval=1e-3")
    sweep.run("a.h5", *wanted, status=0)
    with h5py.File(tmp_path / "a.h5") as file:
        assert sorted(file["sweep/series"]) == ["theta", "time", "u_x"]
        u_x = file["sweep/series/u_x"]
        assert u_x.shape == (12, 1001) and u_x.attrs["units"] == "m"
        assert [u_x.dims[i][0].name for i in (0, 1)] == ["/sweep/case", "/sweep/series/time"]
        assert np.array_equal(u_x[:, -1], file["sweep/summary/final_u_x"])
        assert file["sweep/summary/final_X"].shape == (12,)


def test_series_need_common_times(sweep):
    for setting in ("output.interval=0", "sweep.parameter=scene.t_end,drive.velocity"):
        done = sweep.run("a.h5", "--set", "sweep.keep=series", "--set", setting, status=2)
        assert ("give output.interval > 0" if "interval" in setting else "do not vary scene.t_end") in done.stderr
    (sweep.folder / "t.csv").write_text("scene.t_end\n1\n2\n")
    sweep.deck.write_text(SHORT + "&sweep points = 't.csv', keep = 'series' /\n")
    assert "do not vary scene.t_end" in sweep.run("a.h5", status=2).stderr


def test_series_that_end_early_are_padded_and_xarray_opens_every_group(sweep, tmp_path):
    sweep.run("a.h5", "--set", "sweep.keep=series", "--set", "integrator.max_steps=25", status=5)
    found = values(tmp_path / "a.h5")
    failed = found["result_code"] != 0
    for row in found["series/u_x"][failed]:
        length = np.count_nonzero(np.isfinite(row))
        assert 0 < length < 1001 and np.isnan(row[length:]).all()
    assert np.isfinite(found["series/u_x"][~failed]).all()
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    count = np.count_nonzero(failed)
    assert 0 < count < 12
    sizes = {"": {"case": 12}, "/summary": {"case": 12}, "/series": {"case": 12, "time": 1001}, "/failures": {"case": count}}
    for group, expected in sizes.items():
        with xarray.open_dataset(tmp_path / "a.h5", group=f"sweep{group}", engine="h5netcdf") as data:
            assert dict(data.sizes) == expected
            assert all(variable.attrs["long_name"] for variable in data.variables.values())


def test_fewer_threads_than_asked_for(sweep):
    """The first thread waits for those that there are, not for those that were asked for."""
    sweep.run("a.h5", env={"OMP_THREAD_LIMIT": "2"}, threads=4, status=0)


def test_another_list_is_another_sweep(sweep, tmp_path):
    """Other values, rows exchanged, columns exchanged."""
    sweep.deck.write_text(SHORT + "&sweep points = 'p.csv' /\n")
    rows = ["system.misalignment_deg,friction.normal_load", *(f"{1 + i / 20},{1 + i / 20}" for i in range(130))]
    points = tmp_path / "p.csv"
    points.write_text("\n".join(rows))
    sweep.run("a.h5", "--share", "1/2", status=0)
    for changed in (
        [*rows[:100], "1.0,1.0", *rows[101:]],
        [rows[0], rows[129], *rows[2:65], rows[1], *rows[66:129], rows[65], *rows[130:]],
        ["friction.normal_load,system.misalignment_deg", *rows[1:]],
    ):
        points.write_text("\n".join(changed))
        assert "the file exists" in sweep.run("a.h5", "--share", "1/2", status=3).stderr
        assert "is no share of this sweep" in sweep.run("a.h5", command="merge", status=3).stderr
