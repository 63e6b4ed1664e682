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
    ("file", "line", "complaint"),
    [
        ("src/physics/friction.f90", "  use dst_radau, only: radau_t", "physics/friction uses methods/radau"),
        ("src/numerics/collocation.f90", "  use dst_slider, only: slider_t", "numerics/collocation uses physics/slider"),
        ("src/base/text.f90", "  use dst_nothing, only: nothing", "base/text uses nothing, which is in no layer"),
    ],
)
def test_it_would_be_seen(architecture: ModuleType, tmp_path: Path, file: str, line: str, complaint: str) -> None:
    shutil.copytree(ROOT / "src", tmp_path / "src")
    shutil.copytree(ROOT / "python" / "core", tmp_path / "python" / "core")
    source = tmp_path / file
    text = source.read_text(encoding="utf-8")
    source.write_text(text.replace("  use ", line + "\n  use ", 1), encoding="utf-8")
    assert [found for found in architecture.complaints(tmp_path / "src") if found.startswith(complaint)]


def test_a_circle_would_be_seen(architecture: ModuleType, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "src", tmp_path / "src")
    shutil.copytree(ROOT / "python" / "core", tmp_path / "python" / "core")
    base = tmp_path / "src" / "base"
    rule = (base / "meson.build").read_text(encoding="utf-8")
    (base / "meson.build").write_text(rule.replace("# Uses: nothing", "# Uses: deck"), encoding="utf-8")
    kinds = (base / "kinds.f90").read_text(encoding="utf-8")
    (base / "kinds.f90").write_text(kinds.replace("  use ", "  use dst_schema, only: schema\n  use ", 1), encoding="utf-8")
    assert architecture.complaints(tmp_path / "src") == ["layers use each other in a circle"]
