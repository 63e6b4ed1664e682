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


def test_man_takes_the_page_without_warning(page):
    man = shutil.which("man")
    if man is None:
        pytest.skip("man is not installed")
    shown = Program((man,))("--warnings", "-l", page, status=0)
    assert shown.stderr == ""
    assert "misalignment_deg" in shown.stdout


def test_everything_in_the_tables_is_in_the_page(catalogue, of_python, page):
    # As plain text, in one line.
    source = page.read_text(encoding="utf-8").replace("\\-", "-").replace("\\&", "").replace("\\e", "\\")
    text = re.sub(r"\s+", " ", source)
    for command in [*catalogue["commands"], *of_python.values()]:
        section = text.partition(f'.SS "{command["name"]}"')[2].partition(".SS")[0]
        options = [each["name"] for each in catalogue["options"] if command["name"] in each["commands"]]
        if command["name"] in of_python:
            options = [option for option, _ in command["options"]]
        assert all(" ".join(part.split()) in section for part in (command["usage"], command["meaning"], *options))
    for entry in catalogue["exit_statuses"]:
        assert f".B {entry['status']} {entry['meaning']}" in text
    assert len(catalogue["keys"]) > 30
    for key in catalogue["keys"]:
        assert f".B {key['name']} {key['meaning']}" in text


def test_version_tells_how_the_program_was_built(executable):
    """The version itself is written in meson.build alone; everything else asks Meson, and what is cited is this version."""
    first, *facts = Program((executable,))("--version", status=0).stdout.splitlines()
    version = re.search(r"^  version: '(.+)'", (ROOT / "meson.build").read_text(encoding="utf-8"), re.MULTILINE)[1]
    assert re.fullmatch(rf"dynstiction {re.escape(version)} \(\S+, \S+ [\d.]+\)", first)
    told = dict(re.split(r": +", fact, maxsplit=1) for fact in facts)
    assert list(told) == ["flags", "precision", "HDF5", "LAPACK", "OpenMP", "rounding"]
    assert told["precision"] == "double"
    assert re.fullmatch("[0-9a-f]{8}", told["rounding"])
    for name in ("pyproject.toml", "python/dynstiction/__init__.py", "src/meson.build"):
        assert not re.search(rf"\b{re.escape(version)}\b", (ROOT / name).read_text(encoding="utf-8")), name
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))["version"] == version
