"""The executable makes way for Python where a command is Python's."""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Any

import dynstiction as ds
import pytest
from programs import Program


@pytest.fixture
def program(executable: Path, tmp_path: Path) -> Program:
    """The executable with this interpreter."""
    return Program((executable,), tmp_path, {"DYNSTICTION_PYTHON": sys.executable})


@pytest.fixture
def folder(tmp_path: Path, fig3: ds.Scene) -> Path:
    ds.run(fig3, scene={"t_end": 0.05}).save(tmp_path / "it's a run.h5")
    return tmp_path


def test_commands_of_python_are_those_of_the_executable(program: Program, folder: Path, of_python: dict[str, Any]) -> None:
    name = "it's a run"
    program("plot", f"{name}.h5", "--kind", "path", status=0)
    program("report", f"{name}.h5", status=0)
    export = program("export", f"{name}.h5", "-o", "tables")
    assert export.stdout.count(".csv\n") == 3
    assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / f"{name}.html").exists()
    for command in of_python:
        helped = program(command, "--help")
        assert program("help", command).stdout == helped.stdout
        assert (helped.returncode, helped.stderr) == (0, "")
        assert helped.stdout.startswith(f"Usage: dynstiction {command}")


def test_faults_have_the_exit_status_of_the_executable(program: Program, folder: Path) -> None:
    for arguments, status, named in (
        (("plot", "none.h5"), 3, "none.h5"),
        (("plot", "it's a run.h5", "--kind", "hystory"), 1, "history"),
        (("export", "it's a run.h5", "--cvs"), 1, "see dynstiction export --help"),
        (("report", "--quiet", "plot.h5"), 1, "--quiet"),
        (("--quiet", "plot", "it's a run.h5"), 1, "a command of the Python package comes first"),
        (("plto", "it's a run.h5"), 1, "the nearest is 'plot'"),
    ):
        done = program(*arguments)
        assert (done.returncode, done.stdout) == (status, ""), arguments
        assert done.stderr.startswith("dynstiction: ")
        assert named in done.stderr
        assert done.stderr.count("\n") == 1


def test_help_lists_them(program: Program, of_python: dict[str, Any]) -> None:
    text = program("help", "python").stdout
    for name, command in of_python.items():
        assert re.search(rf"^ +{name} +{command['brief']}$", text, re.MULTILINE), text
    assert "dynstiction help python" in program("--help").stdout


def test_without_interpreter_or_package_there_is_a_remedy(program: Program, folder: Path) -> None:
    done = program("plot", "x.h5", env={"DYNSTICTION_PYTHON": "/no/python3"}, status=3)
    assert "/no/python3: no Python interpreter" in done.stderr
    assert "DYNSTICTION_PYTHON" in done.stderr
    bare = folder / "bare"
    bare.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "$@"\n')
    bare.chmod(0o755)
    done = program("plot", "x.h5", env={"DYNSTICTION_PYTHON": str(bare)}, status=3)
    assert done.stderr.count("\n") == 1
    assert "No module named 'dynstiction'" in done.stderr
    assert "install the package there" in done.stderr


def test_a_missing_package_of_python_s_is_named(program: Program, folder: Path) -> None:
    (folder / "matplotlib.py").write_text("raise ModuleNotFoundError('gone', name='matplotlib')")
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    done = program("plot", "it's a run.h5", env={"PYTHONPATH": path}, status=3)
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
    copy, link = tmp_path / "bin" / "dynstiction", tmp_path / "link"
    copy.parent.mkdir()
    shutil.copy(executable, copy)
    link.symlink_to(copy)

    def chosen(variable: str | None) -> str:
        return Program((link,), tmp_path, {"PATH": path, "DYNSTICTION_PYTHON": variable})("plot", "x.h5").stdout.strip()

    assert chosen(None) == "path"
    interpreter(copy.with_name("python3"), "beside")
    assert chosen(None) == "beside"
    assert chosen("") == "beside"
    assert chosen(str(interpreter(tmp_path / "own" / "py", "own"))) == "own"


def test_a_folder_of_the_package_s_name_is_not_the_package(program: Program, folder: Path) -> None:
    (folder / "dynstiction").mkdir()
    (folder / "dynstiction" / "__main__.py").write_text("raise SystemExit(99)")
    program("plot", "it's a run.h5", status=0)


def test_ctrl_c_while_python_starts_is_no_traceback(program: Program, folder: Path) -> None:
    (folder / "start").mkdir()
    (folder / "start" / "sitecustomize.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    done = program("paper", "-o", "x", env={"PYTHONPATH": str(folder / "start")})
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")


def test_ctrl_c_while_modules_are_imported_is_no_traceback(program: Program, folder: Path) -> None:
    for wait in (0.05, 0.1, 0.15, 0.2, 0.3, 0.4):
        process = program.start("paper", "-o", f"{wait}")
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        errors = process.communicate(timeout=60)[1].splitlines()
        assert process.returncode == -signal.SIGINT
        assert [line for line in errors if not line.startswith(("deck ", "figure "))] in ([], ["dynstiction: stopped by SIGINT"]), (
            errors
        )
