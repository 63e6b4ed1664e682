"""The result file: what it holds, who can read it, and what happens when it cannot be written."""

import re
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from fig3 import DECK
from programs import Program, assert_refused

pytestmark = pytest.mark.deck


@pytest.fixture(scope="module")
def run(executable) -> Callable[..., subprocess.CompletedProcess]:
    """The executable, applied to the deck of Fig. 3."""

    def done(file: Path, *options: str, t_end: float = 0.05, **settings) -> subprocess.CompletedProcess:
        return Program((executable,))("run", DECK, "-o", file, "--quiet", "--set", f"scene.t_end={t_end}", *options, **settings)

    return done


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


def test_types_shapes_and_order(result_file):
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
        moments = series["time"][:]
    assert (moments[0], moments[-1]) == (0.0, 0.05)
    assert (np.diff(moments) > 0).all()


def test_overwrite_replaces_the_file(run, tmp_path):
    """Only then, only by a result, and with the former permissions."""
    file = tmp_path / "twice.h5"
    run(file, status=0)
    file.chmod(0o640)
    before = file.read_bytes()
    assert_refused(run(file), str(file), "--overwrite")
    run(file, "--overwrite", "--set", "system.mass=-1.0", status=2)
    assert file.read_bytes() == before
    run(file, "--overwrite", t_end=0.02, status=0)
    assert file.stat().st_mode & 0o777 == 0o640
    with h5py.File(file) as data:
        assert data["time_series/time"][-1] == 0.02
    assert list(tmp_path.iterdir()) == [file]
