"""The pages "Add a …" are followed to the letter: their patches go into a copy of the source, which is built and run.

Each of them must take one file and one line.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from pages import DOCS, blocks, run_page
from programs import ROOT, Program

PAGES = {
    "friction_law": ("src/physics/friction.f90", "src/deck/schema.f90"),
    "method": ("src/numerics/runge_kutta_tableaux.f90", "src/deck/methods.f90"),
    "output_column": ("src/results/columns.f90", "src/deck/schema.f90"),
}
"""The file, and where the line stands."""


def patches(page: str) -> list[str]:
    return [block.text for block in blocks(DOCS / "howto" / f"{page}.md") if block.kind == "diff"]


def changed_file(patch: str) -> str:
    return patch.splitlines()[1].removeprefix("+++ b/")


@pytest.mark.parametrize("page", PAGES)
def test_one_file_and_one_line(page: str) -> None:
    first, second = patches(page)
    assert (changed_file(first), changed_file(second)) == PAGES[page]
    changes = [line[0] for line in second.splitlines()[2:] if line[0] in "+-"]
    assert changes in (["-", "+"], ["+"])


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program with the law, the method and the column of the three pages."""
    for tool in ("patch", "meson", "ninja", "gfortran"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    source = tmp_path_factory.mktemp("source")
    for part in ("meson.build", "meson.options"):
        shutil.copy(ROOT / part, source)
    for part in ("src", "bench", "inputs", "tools"):
        shutil.copytree(ROOT / part, source / part)
    for page in PAGES:
        for patch in patches(page):
            done = Program(("patch", "-p1"), source)(input=patch)
            assert done.returncode == 0, f"howto/{page}.md: {done.stdout}{done.stderr}"
    build = source / "build"
    for command in (("meson", "setup", build, "-Dpython=false", "-Dtests=false"), ("ninja", "-C", build)):
        Program(command, source)(timeout=None, status=0)
    return build / "src"


@pytest.mark.full
@pytest.mark.parametrize("page", PAGES)
def test_the_page_works(page: str, program: Path, tmp_path: Path) -> None:
    shutil.copy(ROOT / "inputs" / "fig3.nml", tmp_path)
    path = f"{program}:{os.environ['PATH']}"
    assert run_page(DOCS / "howto" / f"{page}.md", tmp_path, {"PATH": path}) >= 2
