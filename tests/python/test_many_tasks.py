"""What docs/howto/many_tasks.md shows works, engine by engine; shares give the numbers of one process (test_executors: executors too)."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
from pathlib import Path

import pytest
from pages import DOCS, run_page
from programs import Program
from sweeps import Sweep, same, values

PAGE = DOCS / "howto" / "many_tasks.md"


def has_gnu_parallel() -> bool:
    """Other packages have programs of this name too."""
    return shutil.which("parallel") is not None and Program(("parallel",))("--version", input="").stdout.startswith("GNU parallel")


ENGINES = {"GNU parallel": has_gnu_parallel, "dask": lambda: importlib.util.find_spec("distributed") is not None}


def sections() -> dict[str, str]:
    """The text below each heading of the page."""
    parts = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    return {title: text for title, _, text in (part.partition("\n") for part in parts)}


@pytest.mark.parametrize("engine", sections())
def test_the_lines_for_an_engine(engine: str, executable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not ENGINES[engine]():
        pytest.skip(f"{engine} is not installed")
    sweep = Sweep(tmp_path, exe=str(executable))
    sweep.run("one.h5", status=0)
    folders = [str(executable.parent), str(Path(sys.executable).parent), os.environ["PATH"]]
    monkeypatch.setenv("PATH", ":".join(folders))
    page = tmp_path / "section.md"
    page.write_text(sections()[engine], encoding="utf-8")
    assert run_page(page, tmp_path, {}) >= 1
    if engine == "GNU parallel":
        assert same(values(tmp_path / "one.h5"), values(tmp_path / "map.h5"))
        assert len(list(tmp_path.glob("map.*-of-6.h5"))) == 6
