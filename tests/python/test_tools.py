"""The scripts of the checkout: each explains itself, and what they install is what the package needs."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest
from programs import ROOT, Program

NOT_STARTED = {"tools/setup.sh", "tests/package/checks.sh", "tests/slurm/rank.sh"}
"""Sourced, or what srun starts."""


def scripts() -> list[str]:
    """Every script that a person may start, by its path in the checkout; not those that pytest or another script reads."""
    shell = [*ROOT.glob("tools/*.sh"), *ROOT.glob("bench/**/*.sh"), *ROOT.glob("tests/*/*.sh")]
    python = [path for folder in ("tools", "docs", "bench", "python") for path in ROOT.glob(f"{folder}/*.py")]
    python += [path for path in ROOT.glob("tests/*/*.py") if not path.name.startswith("test_")]
    started = [path for path in python if 'if __name__ == "__main__"' in path.read_text(encoding="utf-8")]
    return sorted({str(path.relative_to(ROOT)) for path in (*shell, *started)} - NOT_STARTED)


@pytest.mark.parametrize("script", scripts())
def test_help_says_what_it_does_and_does_nothing_else(script: str, tmp_path: Path) -> None:
    interpreter = ("bash",) if script.endswith(".sh") else (sys.executable, "-W", "error::SyntaxWarning")
    done = Program((*interpreter, ROOT / script), tmp_path)("--help", status=0)
    assert len(done.stdout.split()) > 12, "no explanation"
    # How it is called: its name, and, of scripts that take any, what follows it.
    assert Path(script).name in done.stdout
    assert not list(tmp_path.iterdir())
    # Nothing of the script itself is taken for its explanation.
    assert not re.search(r"^(source|set -|import) ", done.stdout, re.MULTILINE)


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ((), "which deck? For example: tools/run.sh inputs/fig3.nml"),
        (("missing.nml",), "missing.nml: no such deck"),
        (("--set", "scene.t_end=1"), "the deck comes first"),
    ],
)
def test_run_refuses_before_it_installs_anything(words: tuple[str, ...], answer: str, tmp_path: Path) -> None:
    done = Program(("bash", ROOT / "tools" / "run.sh"), tmp_path)(*words, status=1)
    assert answer in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_test_refuses_an_unknown_option(tmp_path: Path) -> None:
    done = Program(("bash", ROOT / "tools" / "test.sh"), tmp_path)("--standart", status=1)
    assert "unknown option --standart; see tools/test.sh --help" in done.stderr


def requirements(name: str) -> set[str]:
    lines = (ROOT / "tools" / name).read_text(encoding="utf-8").splitlines()
    return {line for line in lines if not line.startswith("#")}


def test_run_installs_what_the_package_needs_and_the_tools_of_the_build_alone() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert requirements("requirements.txt") == {*project["dependencies"], "meson>=1.1", "ninja"}


def test_the_tests_have_every_extra() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    named = {name for name in extras if name not in ("all", "test")}
    assert extras["all"] == [f"dynstiction[{','.join(name for name in extras if name in named)}]"]
    wanted = {package for name in named for package in extras[name]}
    wanted |= {package for package in extras["test"] if not package.startswith("dynstiction")}
    assert requirements("requirements_test.txt") == wanted
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    for name in (*named, "all"):
        assert f"`[{name}]`" in page or f"[{name}]" in page, f"docs/install.md does not name the extra {name}"
