"""The result file: what it holds, who can read it, and what happens when it cannot be written."""

import os
import re
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest
from fig3 import DECK
from programs import FILE_ERROR, Program, wait_until

# With t_end=1e6: longer than any test waits, and writing fast; who limits the time needs no room for all.
ENDLESS = ("output.interval=1.0e-4", "output.wall_limit=1.0e6")

pytestmark = pytest.mark.deck


@dataclass(frozen=True)
class Run:
    """The executable, applied to the deck of Fig. 3."""

    program: Program

    def __call__(self, file: Path, *options: str, t_end: float = 0.05, **settings) -> subprocess.CompletedProcess:
        return self.program("run", DECK, "-o", file, "--quiet", "--set", f"scene.t_end={t_end}", *options, **settings)

    def start(self, file: Path, *settings: str) -> subprocess.Popen:
        """A run that ends only when it is stopped."""
        given = dict(setting.split("=") for setting in ("scene.t_end=1e6", *ENDLESS, *settings))
        return self.program.start("run", DECK, "-o", file, "--quiet", settings=map("=".join, given.items()))


@pytest.fixture(scope="module")
def run(executable) -> Run:
    return Run(Program((executable,)))


def assert_refused(done: subprocess.CompletedProcess, *words: str) -> None:
    assert done.returncode == FILE_ERROR, done
    assert done.stderr.startswith("dynstiction: ")
    for word in words:
        assert word in done.stderr


@pytest.fixture(scope="module")
def result_file(run, tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("file") / "fig3.h5"
    run(file, status=0)
    return file


def test_root_attributes(result_file):
    with h5py.File(result_file) as file:
        attributes = dict(file.attrs)
    texts = {"program", "version", "git_revision", "compiler", "created", "deck_sha256", "model", "method", "result_text"}
    assert texts <= attributes.keys()
    assert all(isinstance(attributes[name], str) for name in texts)
    assert attributes["program"] == "dynstiction"
    assert (attributes["model"], attributes["method"]) == ("full", "radau13")
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", attributes["created"])
    assert re.fullmatch(r"[0-9a-f]{64}", attributes["deck_sha256"])
    assert (attributes["result_code"], attributes["complete"]) == (0, 1)


def test_created_is_now_in_utc(run, tmp_path):
    before = time.time()
    run(tmp_path / "now.h5", env={"TZ": "Pacific/Kiritimati"})
    with h5py.File(tmp_path / "now.h5") as file:
        created = np.datetime64(file.attrs["created"].rstrip("Z")).astype("datetime64[s]").astype(int)
    assert int(before) <= created <= time.time()


def test_every_dataset_has_units_and_a_long_name(result_file):
    lacking = []

    def visit(name, item):
        if isinstance(item, h5py.Dataset) and not all(
            isinstance(item.attrs.get(key), str) and item.attrs[key] for key in ("units", "long_name")
        ):
            lacking.append(name)

    with h5py.File(result_file) as file:
        file.visititems(visit)
    assert lacking == []


def test_strings_are_variable_length_utf8(result_file):
    with h5py.File(result_file) as file:
        kinds = [h5py.check_string_dtype(file["deck/text"].dtype), h5py.check_string_dtype(file.attrs.get_id("model").dtype)]
        assert file["deck/text"].asstr()[()] == DECK.read_text(encoding="utf-8")
    assert all(kind.encoding == "utf-8" and kind.length is None for kind in kinds)


def test_types_and_shapes(result_file):
    with h5py.File(result_file) as file:
        series = file["time_series"]
        rows = len(series["time"])
        assert all(column.shape == (rows,) for column in series.values())
        assert {name for name, column in series.items() if column.dtype != np.float64} <= {"sticking"}
        assert series["sticking"].dtype == np.int8
        assert set(np.unique(series["sticking"])) <= {0, 1}
        assert len(file["events/time"]) == len(file["events/kind"])
        assert set(np.unique(file["events/kind"])) <= {1, 2}
        assert file["statistics/steps"].dtype == np.int64
        assert file["statistics/wall_time"].dtype == np.float64
        assert file["parameters/mass"][()] == 0.25
        assert file["parameters/mass"].attrs["units"] == "kg"


def test_samples_are_in_order_and_end_at_t_end(result_file):
    with h5py.File(result_file) as file:
        moments = file["time_series/time"][:]
    assert (moments[0], moments[-1]) == (0.0, 0.05)
    assert (np.diff(moments) > 0).all()


def test_xarray_opens_it_without_options(result_file):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf", reason="pip install h5netcdf")
    with xarray.open_dataset(result_file, group="time_series", engine="h5netcdf") as data:
        assert list(data.dims) == ["time"]
        assert list(data.coords) == ["time"]
        assert data["u_x"].dims == ("time",)
        assert data["u_x"].attrs["units"] == "m"
        assert data["time"].dtype == np.float64
        assert np.isfinite(data["u_x"].sel(time=0.025, method="nearest"))


@pytest.mark.skipif(shutil.which("h5dump") is None, reason="h5dump is not installed")
def test_h5dump_reads_all_of_it(result_file):
    done = Program(("h5dump",))(result_file, status=0)
    assert done.stderr == ""
    assert "H5T_CSET_UTF8" in done.stdout


def test_an_existing_file_is_kept_without_overwrite(run, result_file):
    before = result_file.read_bytes()
    assert_refused(run(result_file), str(result_file), "--overwrite")
    assert result_file.read_bytes() == before


def test_overwrite_replaces_the_file(run, tmp_path):
    file = tmp_path / "twice.h5"
    run(file, status=0)
    run(file, "--overwrite", t_end=0.02, status=0)
    with h5py.File(file) as data:
        assert data["time_series/time"][-1] == 0.02
    assert list(tmp_path.iterdir()) == [file]


def test_overwrite_spares_what_is_no_result(run, tmp_path):
    deck = tmp_path / "fig3.nml"
    shutil.copy(DECK, deck)
    assert_refused(run(deck, "--overwrite"), str(deck), "not an HDF5 file")
    assert deck.read_bytes() == DECK.read_bytes()


def test_overwrite_spares_a_file_that_is_being_written(run, tmp_path):
    file = tmp_path / "busy.h5"
    process = run.start(file)
    try:
        wait_until(file.with_name("busy.h5.part").exists, file)
        assert_refused(run(file, "--overwrite"), str(file), "another process is writing")
    finally:
        process.kill()
        process.communicate(timeout=60)
    run(file, "--overwrite", status=0)


def test_a_deck_that_is_refused_leaves_the_existing_file(run, tmp_path):
    file = tmp_path / "kept.h5"
    run(file, status=0)
    before = file.read_bytes()
    run(file, "--overwrite", "--set", "system.mass=-1.0", status=2)
    assert file.read_bytes() == before


def test_a_folder_that_does_not_exist(run, tmp_path):
    assert_refused(run(tmp_path / "no" / "x.h5"), str(tmp_path / "no"), "does not exist")


def test_a_folder_that_is_a_file(run, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    assert_refused(run(tmp_path / "file" / "x.h5"), "folder")


def test_a_file_name_that_is_a_folder(run, tmp_path):
    assert_refused(run(tmp_path, "--overwrite"), "folder")


def test_a_folder_without_permission(run, tmp_path):
    # Permission bits do not stop root; /proc stops everyone.
    folder = Path("/proc") if os.geteuid() == 0 else tmp_path / "closed"
    if folder == Path("/proc"):
        if not folder.is_dir():
            pytest.skip("root may write everywhere, and there is no /proc")
    else:
        folder.mkdir(mode=0o500)
    assert_refused(run(folder / "x.h5"), "cannot create")


@pytest.mark.parametrize("device", ["/dev/null", "/dev/full"])
def test_a_device_is_no_result(run, device):
    assert_refused(run(Path(device), "--overwrite"), device, "not a regular file")
