"""The scripts of the checkout: each explains itself, and what they install is what the package needs."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from programs import ROOT, Program

NOT_STARTED = {"tools/setup.sh", "tests/package/checks.sh"}
"""Sourced."""


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
    ("script", "words", "answer"),
    [
        ("run.sh", (), "which deck? For example: tools/run.sh inputs/fig3.nml"),
        ("run.sh", ("missing.nml",), "missing.nml: no such deck"),
        ("run.sh", ("--set", "scene.t_end=1"), "the deck comes first"),
        ("test.sh", ("--standart",), "unknown option --standart; see tools/test.sh --help"),
    ],
)
def test_refusals_come_before_anything_is_installed(script: str, words: tuple[str, ...], answer: str, tmp_path: Path) -> None:
    done = Program(("bash", ROOT / "tools" / script), tmp_path)(*words, status=1)
    assert answer in done.stderr
    assert len(done.stderr.splitlines()) == 1


def requirements(name: str) -> set[str]:
    lines = (ROOT / "tools" / name).read_text(encoding="utf-8").splitlines()
    return {line for line in lines if not line.startswith("#")}


def test_what_is_installed_is_what_the_package_and_its_extras_need() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = {*project["dependencies"], "meson>=1.2", "ninja"}
    assert requirements("requirements.txt") | requirements("requirements_run.txt") == wanted
    extras = project["optional-dependencies"]
    named = [name for name in extras if name not in ("all", "test")]
    assert extras["all"] == [f"dynstiction[{','.join(named)}]"]
    wanted = {package for name in named for package in extras[name]}
    wanted |= {package for package in extras["test"] if not package.startswith("dynstiction")}
    assert requirements("requirements_test.txt") == wanted
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    assert all(f"[{name}]" in page for name in (*named, "all")), "docs/install.md does not name an extra"


STUB = """#!/usr/bin/env bash
# Stands for Python: makes an environment, and installs into it unless there is a file `offline`.
[[ $2 == - ]] || echo "$3" >> calls
case "$*" in
  "-I -m venv "*) mkdir -p "$4/bin" && cp "$0" "$4/bin/python" && : > "$4/bin/activate" ;;
  *" pip install "*) [[ ! -e offline ]] || { echo 'Collecting numpy'; echo 'ERROR: no network'; exit 1; } ;;
esac
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """One in a folder with a blank in its name, with the scripts alone, and a Python that notes how it is called."""
    folder = tmp_path / "a checkout"
    shutil.copytree(ROOT / "tools", folder / "tools")
    (folder / "python").write_text(STUB, encoding="utf-8")
    (folder / "python").chmod(0o755)
    return folder


def in_setup(checkout: Path, lines: str, **options: object) -> subprocess.CompletedProcess[str]:
    script = f"source tools/setup.sh\npython=$PWD/python python_version=3.11\n{lines}"
    return Program(("bash", "-c", script), checkout)(**options)


def calls(checkout: Path) -> list[str]:
    """The modules of Python that were called since the last look."""
    file = checkout / "calls"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    file.unlink(missing_ok=True)
    return lines


def test_an_environment_is_made_once_and_again_when_it_was_not_finished(checkout: Path) -> None:
    install = "create_environment; add_requirements test"
    (checkout / "offline").touch()
    said = in_setup(checkout, install, status=1).stderr
    assert "ERROR: no network" in said and "Collecting" not in said
    assert "start the same command again" in said
    assert calls(checkout) == ["venv", "pip"]
    (checkout / "offline").unlink()
    said = in_setup(checkout, install, status=0).stderr
    assert "again: meson" in said
    assert calls(checkout) == ["venv", "pip", "pip", "compileall"]
    assert in_setup(checkout, install, status=0).stderr == ""
    assert calls(checkout) == []
    # Packages of a further set alone.
    in_setup(checkout, "create_environment; add_requirements test package", status=0)
    assert calls(checkout) == ["pip", "compileall"]


def test_packages_come_beside_the_compilation(checkout: Path) -> None:
    build = "build_program() { busy build/log '' true; }\ncreate_environment\nlocked build_beside_packages\necho built"
    assert in_setup(checkout, build, status=0).stdout == "built\n"
    assert calls(checkout) == ["venv", "pip", "pip"]
    (checkout / "offline").touch()
    (checkout / ".venv" / "installed").write_text((checkout / ".venv" / "installed").read_text().replace("h5py", "other"))
    assert "built" not in in_setup(checkout, build, status=1).stdout


def test_an_environment_of_somebody_else_is_kept(checkout: Path) -> None:
    own = checkout / ".venv" / "own"
    own.parent.mkdir()
    own.touch()
    said = in_setup(checkout, "create_environment", status=0).stderr
    assert "not made by" in said and (checkout / ".venv.before" / "own").exists() and not own.exists()


def test_a_build_that_was_not_configured_to_the_end_is_configured_again(checkout: Path) -> None:
    meson = 'meson() { mkdir -p "$2"; echo "Compiler gfortran"; [[ ! -e broken ]] || { echo "ERROR: no HDF5"; return 1; }; : > "$2/build.ninja"; }\n'
    half = checkout / "build" / "debug"
    (checkout / "broken").touch()
    said = in_setup(checkout, meson + "configure build/debug", status=1).stderr
    assert "ERROR: no HDF5" in said and "configuring failed" in said
    assert not half.exists()
    (checkout / "broken").unlink()
    half.mkdir(parents=True)
    (half / "left_over").touch()
    in_setup(checkout, meson + "configure build/debug", status=0)
    assert (half / "build.ninja").exists() and not (half / "left_over").exists()
    (half / "kept").touch()
    assert in_setup(checkout, meson + "configure build/debug", status=0).stderr == ""
    assert (half / "kept").exists()
