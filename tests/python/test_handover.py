"""The executable makes way for Python where a command is Python's."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import dynstiction as ds
import h5py
import pytest

COMMANDS = ("plot", "report", "export", "animate", "paper", "validate-creep")


def call(
    program: Path, *arguments: object, cwd: Path, **environment: str | None
) -> subprocess.CompletedProcess[str]:
    """The executable with this interpreter, or with the variables that are given; None takes one out."""
    variables = {**os.environ, "DYNSTICTION_PYTHON": sys.executable, **environment}
    return subprocess.run(
        [program, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        env={name: value for name, value in variables.items() if value is not None},
    )


@pytest.fixture
def folder(tmp_path: Path, fig3: ds.Scene) -> Path:
    ds.run(fig3, scene={"t_end": 0.05}).save(tmp_path / "it's a run.h5")
    return tmp_path


def test_commands_of_python_are_those_of_the_executable(executable: Path, folder: Path) -> None:
    name = "it's a run"
    assert call(executable, "plot", f"{name}.h5", "--kind", "path", cwd=folder).returncode == 0
    assert call(executable, "report", f"{name}.h5", cwd=folder).returncode == 0
    export = call(executable, "export", f"{name}.h5", "--csv", "-o", "tables", cwd=folder)
    assert export.stdout.count(".csv\n") == 3
    assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / f"{name}.html").exists()
    for command in COMMANDS:
        helped = call(executable, command, "--help", cwd=folder)
        assert (helped.returncode, helped.stderr) == (0, "")
        assert helped.stdout.startswith(f"usage: dynstiction {command}")


def test_faults_have_the_exit_status_of_the_executable(executable: Path, folder: Path) -> None:
    for arguments, status, named in (
        (("plot", "none.h5"), 3, "none.h5"),
        (("plot", "it's a run.h5", "--kind", "hystory"), 1, "history"),
        (("export", "it's a run.h5"), 1, "see dynstiction export --help"),
        (("report", "--quiet", "plot.h5"), 1, "--quiet"),
        (("--quiet", "plot", "it's a run.h5"), 1, "'plot' comes first"),
        (("plto", "it's a run.h5"), 1, "the nearest is 'plot'"),
    ):
        done = call(executable, *arguments, cwd=folder)
        assert (done.returncode, done.stdout) == (status, ""), arguments
        assert done.stderr.startswith("dynstiction: ")
        assert named in done.stderr
        assert done.stderr.count("\n") == 1


def test_help_lists_them(executable: Path, tmp_path: Path) -> None:
    text = call(executable, "--help", cwd=tmp_path).stdout
    for command in COMMANDS:
        assert f"  dynstiction {command} " in text or f"  dynstiction {command}\n" in text
    assert "DYNSTICTION_PYTHON" in text


def test_without_interpreter_or_package_there_is_a_remedy(executable: Path, folder: Path) -> None:
    done = call(executable, "plot", "x.h5", cwd=folder, DYNSTICTION_PYTHON="/no/python3")
    assert done.returncode == 3
    assert "/no/python3: no Python interpreter" in done.stderr
    assert "DYNSTICTION_PYTHON" in done.stderr
    bare = folder / "bare"
    bare.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "$@"\n')
    bare.chmod(0o755)
    done = call(executable, "plot", "x.h5", cwd=folder, DYNSTICTION_PYTHON=str(bare))
    assert (done.returncode, done.stderr.count("\n")) == (3, 1)
    assert "No module named 'dynstiction'" in done.stderr
    assert "install the package there" in done.stderr


def test_a_missing_package_of_python_s_is_named(executable: Path, folder: Path) -> None:
    (folder / "matplotlib.py").write_text("raise ModuleNotFoundError('gone', name='matplotlib')")
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    done = call(executable, "plot", "it's a run.h5", cwd=folder, PYTHONPATH=path)
    assert done.returncode == 3
    assert "the Python package matplotlib is missing" in done.stderr
    assert "-m pip install matplotlib" in done.stderr


def interpreter(path: Path, says: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"#!/bin/sh\necho {says}\n")
    path.chmod(0o755)
    return path


def test_which_interpreter(executable: Path, tmp_path: Path) -> None:
    """The variable, then beside the executable, then PATH."""
    path = f"{interpreter(tmp_path / 'path' / 'python3', 'path').parent}:{os.environ['PATH']}"
    program = tmp_path / "bin" / "dynstiction"
    program.parent.mkdir()
    shutil.copy(executable, program)
    link = tmp_path / "link"
    link.symlink_to(program)

    def chosen(**variables: str | None) -> str:
        return call(link, "plot", "x.h5", cwd=tmp_path, PATH=path, **variables).stdout.strip()

    assert chosen(DYNSTICTION_PYTHON=None) == "path"
    interpreter(program.with_name("python3"), "beside")
    assert chosen(DYNSTICTION_PYTHON=None) == "beside"
    assert chosen(DYNSTICTION_PYTHON="") == "beside"
    assert chosen(DYNSTICTION_PYTHON=str(interpreter(tmp_path / "own" / "py", "own"))) == "own"


def test_a_folder_of_the_package_s_name_is_not_the_package(executable: Path, folder: Path) -> None:
    (folder / "dynstiction").mkdir()
    (folder / "dynstiction" / "__main__.py").write_text("raise SystemExit(99)")
    assert call(executable, "plot", "it's a run.h5", cwd=folder).returncode == 0


def test_trade_is_understood_before_python_and_carried_out_by_it(executable: Path, folder: Path, fig3_text: str) -> None:
    """Faults of words, deck and file need no Python; without it a sound command says what to install."""
    (folder / "-x.nml").write_text(fig3_text.replace("t_end = 10.0", "t_end = 0.002"))
    no_python = {"DYNSTICTION_PYTHON": "/no/python3"}
    for arguments, status, named in (
        (("--budgte", "3", "-x.nml"), 1, "the nearest is '--budget'"),
        (("no.nml",), 2, "no.nml: no such file"),
        (("--set", "system.mass=heavy", "--", "-x.nml"), 2, "--set 1 (system.mass=heavy)"),
        (("-o", "no/x.h5", "--", "-x.nml"), 3, "create it first"),
        (("--", "-x.nml"), 3, "/no/python3: no Python interpreter that can be started: install Python 3.11"),
    ):
        done = call(executable, "trade", *arguments, cwd=folder, **no_python)
        assert (done.returncode, done.stdout) == (status, ""), arguments
        assert named in done.stderr and done.stderr.count("\n") == 1
    # Options before the command, numbers as Fortran writes them, a value and a deck that look like options.
    done = call(executable, "--quiet", "--set", "scene.title=--x 'y'", "--budget", "5d0", "-o", "-y.h5", "trade", "--", "-x.nml", cwd=folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    with h5py.File(folder / "-y.h5") as file:
        assert file["parameters/title"].asstr()[()] == "--x 'y'"
        assert file.attrs["complete"] == 1
    assert not list(folder.glob("*.lock")) + list(folder.glob(".*"))
