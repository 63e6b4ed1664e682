"""The folders of src/ are layers: each uses only the layers that it names, and the picture agrees with the folders."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import ModuleType

import pytest
from programs import ROOT, script


@pytest.fixture(scope="module")
def architecture() -> ModuleType:
    return script(ROOT / "docs" / "architecture.py")


def test_rooms_use_what_they_name(architecture: ModuleType) -> None:
    assert architecture.complaints(ROOT / "src") == []


def test_the_picture_is_that_of_the_folders(architecture: ModuleType) -> None:
    drawn = (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8")
    assert drawn == architecture.picture(ROOT / "src"), "run docs/architecture.py"


@pytest.mark.parametrize(
    ("file", "line", "rule", "complaint"),
    [
        ("physics/friction.f90", "use dst_radau, only: radau_t", "", "physics/friction uses methods/radau"),
        ("base/text.f90", "use dst_nothing, only: nothing", "", "base/text uses nothing, which is in no layer"),
        ("base/kinds.f90", "use dst_schema, only: schema", "deck", "layers use each other in a circle"),
    ],
)
def test_it_would_be_seen(architecture: ModuleType, tmp_path: Path, file: str, line: str, rule: str, complaint: str) -> None:
    """With a line more in a file, and what the layer may use."""
    shutil.copytree(ROOT / "src", tmp_path / "src")
    shutil.copytree(ROOT / "python" / "core", tmp_path / "python" / "core")
    source = tmp_path / "src" / file
    source.write_text(source.read_text(encoding="utf-8").replace("  use ", f"  {line}\n  use ", 1), encoding="utf-8")
    if rule:
        rules = source.with_name("meson.build")
        rules.write_text(rules.read_text(encoding="utf-8").replace("# Uses: nothing", f"# Uses: {rule}"), encoding="utf-8")
    assert [found for found in architecture.complaints(tmp_path / "src") if found.startswith(complaint)]
