"""The manual: its commands work, its generated pages are those of this program, what is public is documented."""

from __future__ import annotations

import importlib
import os
import re
import shutil
import sys
from pathlib import Path

import dynstiction as ds
import programs
import pytest
from pages import DOCS, blocks, first_missing, run_page

ROOT = DOCS.parent
PAGES = (
    "tutorial",
    "python_ten_minutes",
    "howto/drive_profile",
    "howto/model_and_accuracy",
    "howto/slurm",
    "howto/read_files",
    "howto/measured_traces",
    "howto/fit_a_trace",
    "howto/fit_creep",
    "howto/stick_slip_range",
    "howto/branches",
    "howto/fit_friction_law",
)
GENERATED = {"make_pages": ("command_line.md", "deck.md"), "make_file_page": ("file.md",)}


EXTRAS = {"howto/read_files": "h5netcdf"}
"""What the commands of a page need besides the package's own dependencies."""


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page(page: str, executable: Path, tmp_path: Path) -> None:
    if shutil.which("h5dump") is None:
        pytest.skip("h5dump is not installed")
    if package := EXTRAS.get(page):
        pytest.importorskip(package, reason=f"pip install {package}")
    for deck in ("fig3", "map_anisotropy"):
        shutil.copy(ROOT / "inputs" / f"{deck}.nml", tmp_path)
    folders = [str(executable.parent), str(Path(sys.executable).parent), os.environ["PATH"]]
    assert run_page(DOCS / f"{page}.md", tmp_path, {"PATH": ":".join(folders)}) > 1


def test_the_commands_of_the_readme(executable: Path, tmp_path: Path) -> None:
    """With the reader's own deck, as the README shows it."""
    readme = ROOT / "README.md"
    (deck,) = [block.text for block in blocks(readme) if block.kind == "fortran"]
    assert len(deck.splitlines()) <= 12
    (tmp_path / "rig.nml").write_text(deck, encoding="utf-8")
    folders = [str(executable.parent), str(Path(sys.executable).parent), os.environ["PATH"]]
    assert run_page(readme, tmp_path, {"PATH": ":".join(folders)}) == 4
    assert {"rig.png", "hold.png", "phi.png"} <= {file.name for file in tmp_path.iterdir()}


def test_outputs_are_compared() -> None:
    assert first_missing("period 0.915 s", "noise\nperiod 0.9151 s") is None
    assert first_missing("period 0.915 s", "period 0.95 s") == "period 0.915 s"
    assert first_missing("a …", "a b c") is None
    assert first_missing("b\na", "a\nb") == "a"


@pytest.mark.parametrize("script", GENERATED)
def test_generated_pages(script: str, executable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = programs.script(DOCS / f"{script}.py")
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    monkeypatch.setattr(sys, "argv", [script, str(executable)])
    module.main()
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(GENERATED[script])
    for page in GENERATED[script]:
        made, kept = ((folder / page).read_text(encoding="utf-8") for folder in (tmp_path, DOCS))
        assert made == kept, f"docs/{page} is old: python docs/{script}.py"


def test_python_names_are_in_the_manual() -> None:
    text = (DOCS / "python.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\.\. auto\w+:: (?:\w+\.)*(\w+)$", text, re.MULTILINE))
    by_module = {name for name in ds.__all__ if getattr(ds, name).__module__ == "dynstiction.errors"}
    assert set(ds.__all__) - by_module <= listed, "add what is missing to docs/python.md"


def test_links_lead_somewhere() -> None:
    broken = []
    for page in [ROOT / "README.md", *DOCS.rglob("*.md"), *(ROOT / "bench").rglob("*.md"), *(ROOT / "tests").rglob("*.md")]:
        text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for target in re.findall(r"\]\(([^)#\s]+)", text):
            if "://" not in target and not (page.parent / target).exists():
                broken.append(f"{page.relative_to(ROOT)}: {target}")
    assert not broken
    # Package indexes show the README without the files that it refers to: it names them in words.
    links = re.findall(r"(?<!!)\[([^\]]*)\]\(([^)#\s]+)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(links) > 20
    assert not [(text, target) for text, target in links if text != target]


def test_every_page_is_in_the_table_of_contents() -> None:
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    trees = re.findall(r"^```\{toctree\}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    listed = {line.strip() for tree in trees for line in tree.splitlines()}
    names = {page.relative_to(DOCS).with_suffix("").as_posix() for page in DOCS.rglob("*.md")}
    assert not {name for name in names - {"index", "ford"} - listed if not name.startswith("notebooks/")}


def test_every_equation_can_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("latex2mathml", "docutils", "sphinx"):
        pytest.importorskip(package)
    monkeypatch.syspath_prepend(DOCS)
    mathml = importlib.import_module("mathml").mathml
    count = 0
    for page in DOCS.rglob("*.md"):
        text = re.sub(r"^```.*?^```$|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for display, inline in re.findall(r"\$\$(.+?)\$\$|\$([^$]+?)\$", text, re.DOTALL):
            count += 1
            drawn = mathml(display or inline, "block")
            assert "\\" not in drawn and not re.search(r"&(?!#?\w+;)", drawn), f"{page.name}: {display or inline}"
    assert count > 50
