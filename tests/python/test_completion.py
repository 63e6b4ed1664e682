"""Completion of the command line: what the program offers, and that bash, zsh and fish take it."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import signal
import time
from pathlib import Path

import pytest
from programs import ROOT, Program

SCRIPTS = ROOT / "tools" / "completion"


def offered(executable: Path, line: str) -> list[str]:
    """What the program offers after `line`; a blank at its end begins a new word."""
    said = Program((executable, "complete"))(*line.split(" ")[1:], status=0)
    assert said.stderr == ""
    return said.stdout.splitlines()


def test_every_option_of_the_table_is_offered_and_taken(executable, catalogue):
    arguments = {option["name"]: option["argument"] for option in reversed(catalogue["options"])}
    values = {"--set": "scene.t_end=1", "--share": "1/2", "--vary": "system.mass=1:2:2", "-o": "x.h5"}
    for command in catalogue["commands"]:
        name = command["name"]
        assert offered(executable, f"dynstiction {name} -") == [*command["options"], "--help"]
        for option in command["options"]:
            value = [values.get(option, "1")] if arguments[option] else []
            taken = Program((executable,))(name, "missing.nml", option, *value)
            assert "takes no -" not in taken.stderr
            assert "unknown option" not in taken.stderr


# A line, and what is offered after it.
OFFERED = {
    "run --set=friction.mu_i": ["--set=friction.mu_inf="],
    "check --set system.mass=": [],
    "check --set==": [],
    "run ": ["*.nml"],
    "run -o x.h5 a.nml ": ["*.nml"],
    "run -o ": ["*.h5"],
    "plot ": ["*.h5"],
    "plot --kind c": ["creep", "columns"],
    "run --share ": ["auto"],
    "paper --format p": ["png", "pdf"],
    "fit a.nml a.csv --free system.mass,friction.mu_i": ["system.mass,friction.mu_inf"],
    "fit a.nml a.csv --fitted ": ["*.nml"],
    "compare a.nml a.csv --unit ": ["time=", "force="],
    "compare a.nml --set friction.law=st": ["friction.law=stribeck"],
}


def test_what_is_offered(executable, catalogue):
    for line, words in OFFERED.items():
        assert offered(executable, f"dynstiction {line}") == words, line
    keys = [f"{key['group']}.{key['name']}=" for key in catalogue["keys"]]
    assert len(keys) > 30
    assert offered(executable, "dynstiction run --set ") == keys
    laws = next(key["choices"] for key in catalogue["keys"] if key["name"] == "law")
    for before in ("", "--set="):
        words = [f"{before}friction.law={law}" for law in laws]
        assert offered(executable, f"dynstiction check {before or '--set '}friction.law=") == words
    assert "low_frequency" in offered(executable, "dynstiction template ")
    free = {word.split(".")[0] for word in offered(executable, "dynstiction fit a.nml a.csv --free ")}
    assert free == {"system", "friction"}


def test_kinds_and_quantities_are_those_of_the_package(executable, catalogue, of_python):
    plot = pytest.importorskip("dynstiction.plot")
    kinds = offered(executable, "dynstiction plot own.h5 --kind ")
    assert kinds == [*plot.KINDS, *plot.SWEEP_KINDS]
    assert set(kinds) <= set(re.findall(r"\w+", dict(of_python["plot"]["options"])["--kind KIND"]))
    quantities = offered(executable, "dynstiction plot map.h5 --quantity ")
    assert quantities == [value["name"] for value in catalogue["summary"]]


LINES = {
    "dynstiction mer": "dynstiction merge ",
    "dynstiction run --overw": "dynstiction run --overwrite ",
    "dynstiction run --set system.mis": "dynstiction run --set system.misalignment_deg=",
    "dynstiction run only": "dynstiction run only_this.nml ",
    "dynstiction resume only": "dynstiction resume only_this.h5 ",
    "dynstiction plot only_this.h5 --kind spec": "dynstiction plot only_this.h5 --kind spectrogram ",
    "dynstiction paper -o some": "dynstiction paper -o some_folder/",
}


@pytest.fixture
def folder(tmp_path):
    for name in ("only_this.nml", "only_this.h5", "only_this.txt"):
        (tmp_path / name).touch()
    (tmp_path / "some_folder").mkdir()
    return tmp_path


# Options, and what is needed before completion.
INTERACTIVE = {
    "bash": (("--norc", "--noprofile", "-i"), ":", f"source '{SCRIPTS}/dynstiction.bash'"),
    "zsh": (("-f", "-i"), "autoload -Uz compinit; compinit -u -D", f"fpath=('{SCRIPTS}' $fpath)"),
}


def shell(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not installed")
    return path


def environment(executable: Path, folder: Path) -> dict[str, str]:
    """One in which the program goes by its name, and nobody's own settings are read."""
    if executable.name != "dynstiction":
        pytest.skip("completion is for dynstiction by that name")
    return {
        **os.environ,
        "PATH": f"{executable.resolve().parent}:{os.environ['PATH']}",
        "HOME": str(folder),
        "ZDOTDIR": str(folder),
        "TERM": "dumb",
        "PS1": "> ",
    }


def typed(command: list[str], setup: str, line: str, wanted: str, cwd: Path, env: dict[str, str]) -> str:
    """What a terminal shows after `line` and the tab key; waits until that is `wanted`."""
    process, terminal = pty.fork()
    if process == 0:
        os.chdir(cwd)
        os.execve(command[0], command, env)
    try:
        os.write(terminal, f"{setup}; echo rea''dy\n".encode())
        assert "\nready" in shown_until(terminal, "\nready")
        os.write(terminal, f"{line}\t".encode())
        return shown_until(terminal, wanted)
    finally:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        os.close(terminal)


def shown_until(terminal: int, wanted: str) -> str:
    """What a terminal shows, without bells and returns, up to `wanted` or for 20 s."""
    shown = ""
    deadline = time.monotonic() + 20
    while wanted not in shown and time.monotonic() < deadline:
        if select.select([terminal], [], [], 0.1)[0]:
            shown += re.sub("[\a\r]", "", os.read(terminal, 65536).decode(errors="replace"))
    return shown


@pytest.mark.parametrize(("line", "completed"), LINES.items())
@pytest.mark.parametrize("name", INTERACTIVE)
def test_completion_on_a_terminal(executable, folder, name, line, completed):
    options, prepared, ours = INTERACTIVE[name]
    shown = typed([shell(name), *options], f"{ours}; {prepared}", line, completed, folder, environment(executable, folder))
    assert completed in shown


@pytest.mark.parametrize(("line", "completed"), LINES.items())
def test_fish(executable, folder, line, completed):
    fish = Program((shell("fish"), "--no-config", "-c"), folder, environment(executable, folder))
    said = fish(f"source '{SCRIPTS}/dynstiction.fish'; complete -C '{line}'", status=0)
    offers = [offer.split("\t")[0] for offer in said.stdout.splitlines()]
    assert offers == [completed.split(" ")[-1] or completed.split(" ")[-2]]
