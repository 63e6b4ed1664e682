"""Output that cannot be written is never a success, and descriptors that are closed are nobody else's."""

from __future__ import annotations

import os
import signal
import subprocess

import dynstiction as ds
import pytest
from fig3 import DECK
from programs import FILE_ERROR, INPUTS, STOPPED

pytestmark = pytest.mark.deck

PRINTING = {
    "version": ("--version",),
    "help": ("--help",),
    "template": ("template",),
    "check": ("check", DECK),
    "stability": ("stability", DECK),
}
PYTHON = {
    "export": ("export", "x.h5", "--overwrite"),
    "trade": ("trade", INPUTS / "low_frequency.nml", "--budget", "1", "--set", "scene.t_end=1", "--accuracy", "0.1",
              "--overwrite"),
    "help": ("--help",),
    "completion": ("complete", "ru"),
}  # fmt: skip
# Each cycle by steps: longer than any test waits.
ENDLESS = ("run", DECK, "-o", "x.h5", "--set", "scene.t_end=1e5", "--set", "output.interval=1", "--set", "integrator.cycle_map=off")


def unread() -> int:
    """The end of a pipe whose reader has gone."""
    read, write = os.pipe()
    os.close(read)
    return write


def complaint(done: subprocess.CompletedProcess[str]) -> bool:
    """One line that says what is the matter."""
    lines = [line for line in done.stderr.splitlines() if "wall time" not in line]
    return len(lines) == 1 and lines[0].startswith("dynstiction: cannot write to the standard output: ")


def without_output(command, arguments) -> subprocess.CompletedProcess[str]:
    """How it ends in a pipe without a reader; with a full disk and without a descriptor it complains."""
    command(*arguments, status=0)
    with open("/dev/full", "w") as full:
        for how in ({"stdout": full}, {"preexec_fn": lambda: os.close(1), "stdout": subprocess.DEVNULL}):
            done = command(*arguments, **how)
            assert done.returncode == FILE_ERROR and complaint(done), done
    pipe = unread()
    done = command(*arguments, stdout=pipe)
    os.close(pipe)
    return done


@pytest.mark.parametrize("command", PRINTING)
def test_what_the_executable_cannot_print(program, command):
    done = without_output(program, PRINTING[command])
    assert done.returncode == -signal.SIGPIPE and not complaint(done), done


@pytest.mark.parametrize("command", [pytest.param(name, marks=pytest.mark.full if name == "trade" else ()) for name in PYTHON])
def test_what_python_cannot_print(program, package, command):
    pytest.importorskip("h5py")
    program("run", DECK, "-o", "x.h5", "--quiet", "--set", "scene.t_end=0.01", status=0)
    done = without_output(package, PYTHON[command])
    assert (done.returncode, done.stderr) == (-signal.SIGPIPE, ""), done


@pytest.mark.full
def test_a_reader_of_the_progress_that_leaves_stops_no_run(program):
    pipe = unread()
    process = program.start(*ENDLESS, "--set", "output.wall_limit=12", stderr=pipe)
    os.close(pipe)
    # The first line of progress comes after 10 s.
    assert process.wait(60) == STOPPED


@pytest.mark.parametrize("variable", ["GFORTRAN_STDERR_UNIT=7", "GFORTRAN_STDOUT_UNIT=9", "GFORTRAN_CONVERT_UNIT=big_endian"])
def test_the_fortran_runtime_may_be_set_up_oddly(program, tmp_path, variable):
    """Unit numbers and byte order of the runtime change no file, and no child's answer is lost."""
    odd = {"env": dict([variable.split("=")])}
    run = ("run", DECK, "-o", "x.h5", "--quiet", "--set", "scene.t_end=0.1")
    program(*run, "--set", "output.wall_limit=1e-9", status=STOPPED, **odd)
    assert program("resume", "x.h5", "--quiet", **odd).returncode in {0, STOPPED}
    program(*run, "--overwrite", status=0, **odd)
    ds.open(tmp_path / "x.h5")
