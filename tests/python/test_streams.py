"""Output that cannot be written is never a success, and descriptors that are closed are nobody else's."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import dynstiction as ds
import pytest

INPUTS = Path(__file__).parents[2] / "inputs"

pytestmark = pytest.mark.deck

PRINTING = {
    "version": ("--version",),
    "help": ("--help",),
    "help on a command": ("run", "--help"),
    "keys": ("keys",),
    "template": ("template",),
    "check": ("check", str(INPUTS / "fig3.nml")),
    "stability": ("stability", str(INPUTS / "fig3.nml")),
    "completion": ("complete", "ru"),
}
PYTHON = {
    "export": ("export", "x.h5", "--csv", "--overwrite"),
    "trade": ("trade", str(INPUTS / "low_frequency.nml"), "--budget", "3", "--set", "scene.t_end=1", "--overwrite"),
    "help": ("--help",),
    "help on a command": ("plot", "--help"),
}


def closed(descriptor: int = 1):
    """For `preexec_fn`, after the standard streams have been set."""
    return lambda: os.close(descriptor)


def unread() -> int:
    """The end of a pipe whose reader has gone."""
    read, write = os.pipe()
    os.close(read)
    return write


@pytest.fixture
def start(executable, tmp_path):
    """A command of the executable, or of the package where the first word is `python`."""

    def run(*arguments, stdout=subprocess.DEVNULL, preexec=None):
        command = [str(executable), *arguments]
        if arguments[0] == "python":
            command = [sys.executable, "-m", "dynstiction", *arguments[1:]]
        return subprocess.run(
            command, cwd=tmp_path, stdout=stdout, stderr=subprocess.PIPE, preexec_fn=preexec, text=True, timeout=120, check=False
        )

    return run


def complaint(done: subprocess.CompletedProcess[str]) -> bool:
    """One line that says what is the matter."""
    lines = [line for line in done.stderr.splitlines() if "wall time" not in line]
    return len(lines) == 1 and lines[0].startswith("dynstiction: cannot write to the standard output: ")


@pytest.mark.parametrize("command", PRINTING)
def test_what_the_executable_cannot_print(start, command):
    arguments = PRINTING[command]
    assert start(*arguments).returncode == 0
    with open("/dev/full", "w") as full:
        done = start(*arguments, stdout=full)
    assert done.returncode == 3 and complaint(done), done
    done = start(*arguments, preexec=closed())
    assert done.returncode == 3 and complaint(done), done
    pipe = unread()
    done = start(*arguments, stdout=pipe)
    os.close(pipe)
    assert done.returncode == -signal.SIGPIPE and not complaint(done), done


@pytest.mark.parametrize("command", PYTHON)
def test_what_python_cannot_print(start, tmp_path, command):
    pytest.importorskip("h5py")
    settings = ("--set", "scene.t_end=0.01")
    assert start("run", str(INPUTS / "fig3.nml"), "-o", "x.h5", "--quiet", *settings).returncode == 0
    arguments = ("python", *PYTHON[command])
    assert start(*arguments).returncode == 0
    with open("/dev/full", "w") as full:
        done = start(*arguments, stdout=full)
    assert done.returncode == 3 and complaint(done), done
    done = start(*arguments, preexec=closed())
    assert done.returncode == 3 and complaint(done), done
    pipe = unread()
    done = start(*arguments, stdout=pipe)
    os.close(pipe)
    assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, ""), done


@pytest.mark.full
def test_a_reader_of_the_progress_that_leaves_stops_no_run(executable, tmp_path):
    command = [executable, "run", INPUTS / "fig3.nml", "-o", "x.h5", "--set", "scene.t_end=1e5", "--set", "output.interval=1"]
    pipe = unread()
    process = subprocess.Popen([*command, "--set", "output.wall_limit=12"], cwd=tmp_path, stderr=pipe)
    os.close(pipe)
    # The first line of progress comes after 10 s.
    assert process.wait(60) == 75


@pytest.mark.parametrize("descriptors", [(0,), (1,), (2,), (0, 1, 2)])
def test_no_file_gets_a_descriptor_that_was_closed(executable, tmp_path, descriptors):
    def close_all() -> None:
        for descriptor in descriptors:
            os.close(descriptor)

    command = [executable, "run", INPUTS / "fig3.nml", "-o", "x.h5", "--quiet", "--set", "scene.t_end=1e5"]
    process = subprocess.Popen(
        [*command, "--set", "output.interval=1"], cwd=tmp_path, stdin=0, stdout=1, stderr=2, preexec_fn=close_all
    )
    try:
        end = time.monotonic() + 20
        while not (tmp_path / "x.h5").exists() and time.monotonic() < end:
            time.sleep(0.01)
        opened = {number: os.readlink(f"/proc/{process.pid}/fd/{number}") for number in descriptors}
        assert set(opened.values()) == {"/dev/null"}
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 75
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    "variable", ["GFORTRAN_STDERR_UNIT=7", "GFORTRAN_STDOUT_UNIT=9", "GFORTRAN_CONVERT_UNIT=big_endian"]
)
def test_the_fortran_runtime_may_be_set_up_oddly(executable, tmp_path, variable):
    """Unit numbers and byte order of the runtime change no file, and no child's answer is lost."""
    environment = os.environ | dict([variable.split("=")])
    deck = str(INPUTS / "fig3.nml")
    short = ["-o", "x.h5", "--quiet", "--set", "scene.t_end=0.1"]

    def call(*arguments: str) -> int:
        return subprocess.run(
            [str(executable), *arguments], cwd=tmp_path, env=environment, timeout=60, check=False
        ).returncode

    assert call("run", deck, *short, "--set", "output.wall_limit=1e-9") == 75
    assert call("resume", "x.h5", "--quiet") in {0, 75}
    assert call("run", deck, *short, "--overwrite") == 0
    ds.open(tmp_path / "x.h5")
