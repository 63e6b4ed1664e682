"""What docs/architecture.md says of adding something is followed to the letter: the patches of docs/tour go into a copy of the
source, which is built and run, and the files that they change are counted.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np
import pytest
from pages import DOCS, run_page
from programs import ROOT, Program

PAGES = {
    "friction_law": ("src/physics/friction.f90", "src/deck/schema.f90"),
    "method": ("src/numerics/runge_kutta_tableaux.f90", "src/deck/methods.f90"),
    "output_column": ("src/results/columns.f90", "src/deck/schema.f90"),
}
"""The file, and where the line stands."""

TOUR = {path.stem: path for path in sorted((DOCS / "tour").glob("*.diff"))}
# What can be added, how many files that takes, and the page or the patch that does it.
ROW = re.compile(r"^\| [^|]+ \| \[(?P<files>\d+)\]\((?P<change>[\w./]+)\) \|", re.MULTILINE)
ROWS = {Path(row["change"]).stem: row for row in ROW.finditer((DOCS / "architecture.md").read_text(encoding="utf-8"))}


def patches(name: str) -> list[str]:
    return re.split(r"^(?=--- )", TOUR[name].read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]


def changed_file(patch: str) -> str:
    return patch.splitlines()[1].removeprefix("+++ b/")


def test_the_rows_are_those_that_are_followed() -> None:
    assert set(ROWS) == set(TOUR)
    assert all((DOCS / row["change"]).exists() for row in ROWS.values())


@pytest.mark.parametrize("name", ROWS)
def test_so_many_files_are_touched(name: str) -> None:
    files = [changed_file(patch) for patch in patches(name)]
    assert len(set(files)) == int(ROWS[name]["files"])
    if name in PAGES:
        # One file and one line.
        assert tuple(files) == PAGES[name]
        changes = [line[0] for line in patches(name)[1].splitlines()[2:] if line[0] in "+-"]
        assert changes in (["-", "+"], ["+"])


def changed_program(source: Path, names: list[str]) -> Path:
    """The folder of the program with these changes, built in `source`."""
    for tool in ("patch", "meson", "ninja", "gfortran"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    for part in ("meson.build", "meson.options"):
        shutil.copy(ROOT / part, source)
    for part in ("src", "bench", "inputs", "tools", "python"):
        shutil.copytree(ROOT / part, source / part)
    shutil.copytree(ROOT / "tests" / "invariance", source / "tests" / "invariance")
    (source / "docs").mkdir()
    shutil.copy(ROOT / "docs" / "errors.md", source / "docs")
    for name in names:
        for patch in patches(name):
            done = Program(("patch", "-p1"), source)(input=patch)
            assert done.returncode == 0, f"{name}: {done.stdout}{done.stderr}"
    build = source / "build"
    for command in (("meson", "setup", build, "-Dpython=false", "-Dtests=false"), ("ninja", "-C", build)):
        Program(command, source)(timeout=None, status=0)
    return build / "src"


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return changed_program(tmp_path_factory.mktemp("pages"), [*PAGES, "model"])


@pytest.fixture(scope="module")
def toured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return changed_program(tmp_path_factory.mktemp("tour"), [name for name in TOUR if name not in (*PAGES, "model")])


@pytest.mark.full
@pytest.mark.parametrize("page", (*PAGES, "model"))
def test_the_page_works(page: str, program: Path, tmp_path: Path) -> None:
    shutil.copy(ROOT / "inputs" / "fig3.nml", tmp_path)
    path = f"{program}:{os.environ['PATH']}"
    assert run_page(DOCS / "howto" / f"{page}.md", tmp_path, {"PATH": path}) >= 2


def values(program: Path, folder: Path, *settings: str) -> dict[str, float]:
    """Summary and first position of a short run of Fig. 3."""
    result = folder / "result.h5"
    words = [word for setting in settings for word in ("--set", setting)]
    Program((program / "dynstiction",), folder)(
        "run", ROOT / "inputs" / "fig3.nml", "-o", result, "--quiet", "--overwrite", *words, status=0
    )
    with h5py.File(result) as file:
        found = {name: float(number[()]) for name, number in file["summary"].items()}
        return {**found, "start": float(file["time_series/X"][0]), "end": float(file["time_series/X"][-1])}


@pytest.mark.full
def test_the_tour_works(toured: Path, tmp_path: Path) -> None:
    short = ("scene.t_end=2.5", "integrator.rtol=1e-5")
    plain = values(toured, tmp_path, *short)
    same = values(toured, tmp_path, *short, "friction.law=rational", "friction.power=1e8")
    other = values(toured, tmp_path, *short, "friction.law=rational", "friction.power=1", "initial.position=1.5")
    assert same["swing"] == pytest.approx(plain["swing"], rel=1e-6)
    assert other["swing"] != pytest.approx(plain["swing"], rel=0.01)
    assert other["start"] == 1.5 and plain["start"] == 0
    assert plain["highest_load"] == pytest.approx(plain["first_peak_force"], rel=1e-6)

    smoothed = ("friction.contact=smoothed", "friction.v_smooth=1e-5", "scene.t_end=0.2")
    reference = values(toured, tmp_path, *smoothed)
    first = values(toured, tmp_path, *smoothed, "integrator.method=symplectic", "integrator.step=2e-6")
    second = values(toured, tmp_path, *smoothed, "integrator.method=symplectic", "integrator.step=1e-6")
    order = np.log2((first["end"] - reference["end"]) / (second["end"] - reference["end"]))
    assert order == pytest.approx(1, abs=0.1)

    done = Program((toured / "dynstiction",), tmp_path)("limits", ROOT / "inputs" / "fig3.nml", status=0)
    assert "static limit 2.0 N" in done.stdout

    # No test of the executable lists what there is.
    quick = [f"test_{name}.py" for name in ("decks", "sizes", "error_codes", "manual", "sampling")]
    suite = Program(
        (sys.executable, "-m", "pytest", "-q", "-m", "not full", "-p", "no:cacheprovider", *quick), Path(__file__).parent
    )
    tested = suite(env={"DYNSTICTION_EXE": str(toured / "dynstiction")})
    assert tested.returncode == 0, tested.stdout

    # The package as it is installed, with the files of the tour.
    package, source = tmp_path / "dynstiction", toured.parents[1] / "python" / "dynstiction"
    shutil.copytree(Path(ds.__file__).parent, package)
    for name in ("_commands.py", "__main__.py"):
        shutil.copy(source / name, package)
    command = Program((sys.executable, "-m", "dynstiction", "periods"), tmp_path, {"PYTHONPATH": str(tmp_path)})
    assert command("result.h5", status=0).stdout == ""
    assert '.SS "periods"' in (toured / "dynstiction.1").read_text(encoding="utf-8")
