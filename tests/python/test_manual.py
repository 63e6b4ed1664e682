"""The manual page and --version: made from what the program says, complete, and without complaints of man."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest
from programs import ROOT, Program


@pytest.fixture(scope="module")
def page(executable, tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("man") / "dynstiction.1"
    Program((sys.executable, ROOT / "tools" / "man_page.py"))(executable, file, status=0)
    return file


@pytest.fixture(scope="module")
def text(page) -> str:
    """The page as plain text, a paragraph a line."""
    source = page.read_text(encoding="utf-8").replace("\\-", "-").replace("\\&", "").replace("\\e", "\\")
    return re.sub(r"\s+", " ", source)


def said(executable: Path, *arguments: str) -> str:
    return Program((executable,))(*arguments, status=0).stdout


def test_man_takes_the_page_without_warning(page):
    man = shutil.which("man")
    if man is None:
        pytest.skip("man is not installed")
    shown = Program((man,))("--warnings", "-l", page, status=0)
    assert shown.stderr == ""
    assert "misalignment_deg" in shown.stdout


def test_every_key_is_in_the_page(catalogue, text):
    assert len(catalogue["keys"]) > 30
    for key in catalogue["keys"]:
        assert f".B {key['name']} {key['meaning']}" in text
        default = key["default"] if isinstance(key["default"], str) else ""
        for part in (key["units"], key["range"], " | ".join(key["choices"]), default):
            assert part in text.partition(f".B {key['name']} ")[2]


def test_everything_in_the_tables_is_in_the_page(catalogue, of_python, text):
    for command in [*catalogue["commands"], *of_python.values()]:
        section = text.partition(f'.SS "{command["name"]}"')[2].partition(".SS")[0]
        for part in (command["usage"], command["meaning"], command["examples"]):
            assert " ".join(part.split()) in section
        for option in catalogue["options"]:
            if command["name"] in option["commands"]:
                assert f"{option['name']} {option['argument']}".strip() + " " + option["meaning"] in section
        if command["name"] in of_python:
            assert all(f"{option} {meaning}" in section for option, meaning in command["options"])
    for entry in catalogue["exit_statuses"]:
        assert f".B {entry['status']} {entry['meaning']}" in text


def test_version_tells_how_the_program_was_built(executable):
    first, *facts = said(executable, "--version").splitlines()
    assert re.fullmatch(r"dynstiction \d+\.\d+\.\d+ \(\S+, \S+ [\d.]+\)", first)
    told = dict(re.split(r": +", fact, maxsplit=1) for fact in facts)
    assert list(told) == ["flags", "precision", "HDF5", "LAPACK", "OpenMP", "loops", "rounding"]
    assert told["flags"].startswith("-O")
    assert told["precision"] == "double"
    assert re.fullmatch(r"[\d.]+ \((serial|parallel)\)", told["HDF5"])
    assert told["OpenMP"] in {"yes", "no"}
    assert told["loops"] in {"plain", "x86-64-v3"}
    assert re.fullmatch("[0-9a-f]{8}", told["rounding"])


def test_the_version_is_written_in_one_place_only(executable):
    """In meson.build; everything else asks Meson."""
    version = re.search(r"^  version: '(.+)'", (ROOT / "meson.build").read_text(encoding="utf-8"), re.MULTILINE)[1]
    assert said(executable, "--version").split()[1] == version
    for name in ("pyproject.toml", "python/dynstiction/__init__.py", "src/meson.build"):
        assert not re.search(rf"\b{re.escape(version)}\b", (ROOT / name).read_text(encoding="utf-8")), name
    # What is cited is this version.
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))["version"] == version
