"""Results as CSV, and result files opened with other programs."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np
import pytest
import xarray
from dynstiction.__main__ import main
from programs import INPUTS, Program


@pytest.fixture(scope="module")
def result(fig3: ds.Scene) -> ds.Result:
    return ds.run(fig3, scene={"t_end": 0.1})


@pytest.fixture(scope="module", params=["program", "package"])
def file(request: pytest.FixtureRequest, executable: Path, tmp_path_factory: pytest.TempPathFactory, result: ds.Result) -> Path:
    """A result file of the executable, and one of `Result.save`."""
    path = tmp_path_factory.mktemp(request.param) / "run.h5"
    if request.param == "package":
        result.save(path)
        return path
    path.with_suffix(".nml").write_text(result.deck)
    Program((executable,), path.parent)("run", "run.nml", "--set", "scene.t_end=0.1", "--quiet", status=0)
    return path


# CSV


def read_csv(path: Path) -> dict[str, np.ndarray]:
    """Columns of numbers, read by Python, which keeps every bit."""
    with path.open(newline="", encoding="utf-8") as lines:
        head, *rows = csv.reader(lines)
    return {name: np.array([float(row[i]) for row in rows]) for i, name in enumerate(head)}


def test_a_run_as_csv_keeps_every_bit(file: Path, result: ds.Result, tmp_path: Path) -> None:
    assert main(["export", str(file), "-o", str(tmp_path / "new" / "folder")]) == 0
    folder = tmp_path / "new" / "folder"
    assert sorted(path.name for path in folder.iterdir()) == ["run_events.csv", "run_summary.csv", "run_time_series.csv"]
    series = read_csv(folder / "run_time_series.csv")
    assert "u_x [m]" in series
    assert "w_x [m/s]" in series
    assert len(series) == len(result.columns)
    for column in series:
        np.testing.assert_array_equal(series[column], result[column.partition(" [")[0]], err_msg=column)
    events = read_csv(folder / "run_events.csv")
    np.testing.assert_array_equal(events["time [s]"], result.events["time"])
    np.testing.assert_array_equal(events["kind"], result.events["kind"])
    with (folder / "run_summary.csv").open(newline="") as lines:
        rows = {(row["table"], row["name"]): row for row in csv.DictReader(lines)}
    assert float(rows["summary", "max_X_rate"]["value"]) == result.summary["max_X_rate"]
    assert rows["summary", "max_X_rate"]["unit"] == "m/s"
    assert rows["parameters", "law"]["value"] == "weakening"
    assert int(rows["statistics", "steps"]["value"]) == result.statistics["steps"]


def test_a_sweep_as_csv(program: Program, tmp_path: Path) -> None:
    program("run", INPUTS / "map_anisotropy.nml", "-o", "map.h5", "--quiet", "--set", "sweep.count=3,2", status=0)
    assert main(["export", str(tmp_path / "map.h5"), "-o", str(tmp_path)]) == 0
    table = read_csv(tmp_path / "map_sweep.csv")
    assert next(iter(table)) == "case"
    np.testing.assert_array_equal(table["case"], range(1, 7))
    with h5py.File(tmp_path / "map.h5") as file:
        for name in ("summary/period", "system.stiffness_y", "result_code", "summary/steps"):
            (column,) = [c for c in table if c.partition(" [")[0] == name.rpartition("/")[2].rpartition(".")[2]]
            np.testing.assert_array_equal(table[column], file["sweep"][name][:])


# Other programs


@pytest.mark.skipif(shutil.which("h5dump") is None, reason="no h5dump: apt-get install hdf5-tools")
def test_h5dump_shows_the_file(file: Path, result: ds.Result) -> None:
    h5dump = Program(("h5dump",))
    contents = h5dump("-n", file, status=0).stdout
    assert all(f"/time_series/{name}" in contents for name in result)
    values = h5dump("-y", "-w", "0", "-m", "%.17g", "-d", "/time_series/u_x", file, status=0).stdout
    data = values.partition("DATA {")[2].partition("}")[0]
    np.testing.assert_array_equal(np.array(data.replace(",", " ").split(), dtype=float), result["u_x"])
    assert '"N"' in h5dump("-a", "/time_series/friction/units", file, status=0).stdout


def test_xarray_opens_each_group_without_options(file: Path, result: ds.Result) -> None:
    with xarray.open_dataset(file, group="time_series", engine="h5netcdf") as series:
        assert series["X"].dims == ("time",)
        np.testing.assert_array_equal(series["X"], result["X"])
        assert series["X"].sel(time=0.05, method="nearest") == result["X"][np.argmin(abs(result.time - 0.05))]
    with xarray.open_dataset(file, group="events", engine="h5netcdf") as events:
        np.testing.assert_array_equal(events["kind"], result.events["kind"])
    with xarray.open_dataset(file, group="summary", engine="h5netcdf") as summary:
        assert float(summary["max_X_rate"]) == result.summary["max_X_rate"]
        assert summary["max_X_rate"].attrs["units"] == "m/s"
    with xarray.open_dataset(file, group="parameters", engine="h5netcdf") as parameters:
        assert float(parameters["mass"]) == 0.25


def test_to_pandas(file: Path, result: ds.Result) -> None:
    frame = ds.open(file).to_pandas()
    assert frame.index.name == "time"
    np.testing.assert_array_equal(frame.index, result.time)
    np.testing.assert_array_equal(frame["u_x"], result["u_x"])
    assert frame.attrs["units"]["u_x"] == "m"
    assert (frame.dtypes == np.float64).all()
