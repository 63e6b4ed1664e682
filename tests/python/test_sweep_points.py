"""Points of a sweep from CSV files: every way to write them, and faults named with their place."""

from __future__ import annotations

import dynstiction as ds
import h5py
import numpy as np
import pytest
from sweeps import SCENE, Sweep, same, values

LIST = "&sweep points = 'cases.csv' /\n"
NAMES = "system.misalignment_deg,drive.velocity"
ANGLES, VELOCITIES = [1.0, 2.5, 4.0], [1e-3, 2e-3, 4e-3]
ROWS = [f"{angle},{velocity}" for angle, velocity in zip(ANGLES, VELOCITIES, strict=True)]


@pytest.fixture
def sweep(tmp_path):
    return Sweep(tmp_path, SCENE.replace("t_end = 10.0", "t_end = 2.0") + LIST)


@pytest.fixture
def expected(sweep, tmp_path):
    (tmp_path / "cases.csv").write_text("\n".join([NAMES, *ROWS]) + "\n")
    sweep.run("expected.h5", status=0)
    return values(tmp_path / "expected.h5")


def test_a_list_has_a_case_a_row(sweep, expected, tmp_path):
    assert list(expected["system.misalignment_deg"]) == ANGLES
    assert list(expected["drive.velocity"]) == VELOCITIES
    with h5py.File(tmp_path / "expected.h5") as file:
        assert file["sweep"].attrs["grid"] == "list"
        assert file["sweep"].attrs["parameters"] == "system.misalignment_deg drive.velocity"
    data = ds.sweep(sweep.deck)
    assert data["final_u_x"].dims == ("case",)
    assert list(data["velocity"].values) == VELOCITIES
    assert np.array_equal(data["final_u_x"].values, expected["summary/final_u_x"])
    single = ds.run(sweep.deck.read_text().replace(LIST, ""), drive={"velocity": 4e-3}, system={"misalignment_deg": 4.0})
    assert expected["summary/final_u_x"][2] == single["u_x"][-1]


PLAIN = "\n".join([NAMES, *ROWS])
WAYS = {
    "no newline": PLAIN,
    "CRLF": "\r\n".join([NAMES, *ROWS, ""]),
    "CR": "\r".join([NAMES, *ROWS, ""]),
    "BOM": "\ufeff" + PLAIN,
    "blank lines": "\n\n".join(["", NAMES, *ROWS, "  ", ""]),
    **{ascii(separator): PLAIN.replace(",", separator) for separator in (";", "\t", "   ", " , ", "," + 3000 * " ")},
    "quoted": "\n".join('"' + line.replace(",", '","') + '"' for line in [NAMES, *ROWS]),
    "capitals": "\n".join([NAMES.upper(), *ROWS]),
}


def test_ways_to_write_the_same(sweep, expected, tmp_path):
    for name, text in WAYS.items():
        (tmp_path / "cases.csv").write_bytes(text.encode())
        sweep.run("a.h5", "--overwrite", status=0)
        assert same(values(tmp_path / "a.h5"), expected), name


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("", "", "is empty"),
        (NAMES + "\n", "", "holds no points"),
        ("system.stiffness_y\n1\n", ":1:", "'system.stiffness_y' is not used with"),
        ("drive.velocity\n1e-3\n\n\nfast\n", ":5:", "'fast' is not a real number"),
        ("drive.velocity\n1e-3\nnan\n", ":3:", "'nan' is not a real number"),
        ("system.misalignment_deg\n\n1e3\n", ":3:", "out of range for misalignment_deg"),
        (NAMES + "\n1,1e-3\n2\n", ":3:", "1 value(s), but the first line has 2"),
        (NAMES + ",\n1,1e-3,\n", ":1:", "an empty field: give each column a name"),
        ("drive.velocity,Drive.Velocity\n1,1\n", ":1:", "named twice"),
        ("drive.velocity\n\0\n", ":2:", "'?' is not a real number"),
        ("integrator.max_steps\n1.5\n", ":2:", "takes integers"),
        # A line that would need gigabytes if each field had room for the longest.
        (",".join(["1" * 200_000, *["1"] * 200_000]) + "\n1\n", ":1:", "200001 columns: give at most 1000"),
    ],
)
def test_faults_have_their_place(sweep, tmp_path, text, place, words):
    path = tmp_path / "cases.csv"
    path.write_text(text)
    done = sweep.run("a.h5", status=3)
    assert done.stderr.startswith(f"dynstiction: {path}{place}") and words in done.stderr
    assert not list(tmp_path.glob("a*"))
    with pytest.raises(ds.FileError, match=r"cases\.csv"):
        ds.sweep(sweep.deck)


def test_names_are_relative_to_the_deck_and_may_be_absolute(sweep, expected, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    moved = tmp_path / "elsewhere" / "points.csv"
    (tmp_path / "cases.csv").rename(moved)
    for name in ("elsewhere/points.csv", moved):
        sweep.run("a.h5", "--overwrite", "--set", f"sweep.points={name}", cwd="/", status=0)
        assert same(values(tmp_path / "a.h5"), expected)


def test_a_list_is_a_csv_file(sweep, tmp_path):
    with h5py.File(tmp_path / "cases.h5", "w") as file:
        file["drive.velocity"] = VELOCITIES
    done = sweep.run("a.h5", "--set", "sweep.points=cases.h5", status=3)
    assert done.stderr.startswith(f"dynstiction: {tmp_path}/cases.h5: is an HDF5 file: write its columns as CSV")


def test_very_long_lists_need_no_stack(sweep, tmp_path):
    (tmp_path / "cases.csv").write_text("system.misalignment_deg,drive.velocity\n" + "1.5,1e-3\n" * 600_000)
    sweep.program("check", sweep.deck, status=0)
