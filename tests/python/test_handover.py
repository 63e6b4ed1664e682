"""The executable makes way for Python where a command is Python's."""

from __future__ import annotations

import os
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
    """With a run, and with what has the package's name and is not the package."""
    ds.run(fig3, scene={"t_end": 0.05}).save(tmp_path / "it's a run.h5")
    (tmp_path / "dynstiction").mkdir()
    (tmp_path / "dynstiction" / "__main__.py").write_text("raise SystemExit(99)")
    return tmp_path


def test_commands_of_python_are_those_of_the_executable(program: Program, folder: Path, of_python: dict[str, Any]) -> None:
    name = "it's a run"
    program("plot", f"{name}.h5", "--kind", "path", status=0)
    program("report", f"{name}.h5", status=0)
    export = program("export", f"{name}.h5", "-o", "tables")
    assert export.stdout.count(".csv\n") == 3
    assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / f"{name}.html").exists()
    listed = program("help", "python", status=0).stdout.split()
    for command in of_python:
        helped = program(command, "--help", status=0)
        assert program("help", command).stdout == helped.stdout
        assert helped.stdout.startswith(f"Usage: dynstiction {command}") and helped.stderr == ""
        assert command in listed


def test_faults_have_the_exit_status_of_the_executable_and_a_remedy(program: Program, folder: Path) -> None:
    bare, gone = folder / "bare", folder / "gone"
    bare.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "$@"\n')
    bare.chmod(0o755)
    gone.mkdir()
    (gone / "matplotlib.py").write_text("raise ModuleNotFoundError('gone', name='matplotlib')")
    without_matplotlib = {"PYTHONPATH": os.pathsep.join([str(gone), *filter(None, sys.path)])}
    for arguments, env, status, named in (
        (("plot", "none.h5"), {}, 3, ("none.h5",)),
        (("export", "it's a run.h5", "--cvs"), {}, 1, ("see dynstiction export --help",)),
        (("--quiet", "plot", "it's a run.h5"), {}, 1, ("a command of the Python package comes first",)),
        (("plto", "it's a run.h5"), {}, 1, ("the nearest is 'plot'",)),
        (("plot", "x.h5"), {"DYNSTICTION_PYTHON": "/no/python3"}, 3, ("/no/python3: no Python interpreter", "DYNSTICTION_PYTHON")),
        (("plot", "x.h5"), {"DYNSTICTION_PYTHON": str(bare)}, 3, ("No module named 'dynstiction'", "install the package there")),
        (("plot", "it's a run.h5"), without_matplotlib, 3, ("package matplotlib is missing", "-m pip install matplotlib")),
    ):
        done = program(*arguments, env=env, status=status)
        assert done.stdout == "" and done.stderr.startswith("dynstiction: ") and done.stderr.count("\n") == 1, done
        assert all(words in done.stderr for words in named), done


def test_ctrl_c_while_python_starts_is_no_traceback(program: Program, folder: Path) -> None:
    (folder / "start").mkdir()
    (folder / "start" / "sitecustomize.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    done = program("paper", "-o", "x", env={"PYTHONPATH": str(folder / "start")})
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")
    # And while modules are imported.
    for wait in (0.05, 0.1, 0.15, 0.2, 0.3, 0.4):
        process = program.start("paper", "-o", f"{wait}")
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        errors = process.communicate(timeout=60)[1].splitlines()
        assert process.returncode == -signal.SIGINT
        said = [line for line in errors if not line.startswith(("deck ", "figure "))]
        assert said in ([], ["dynstiction: stopped by SIGINT"]), errors


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
