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


def test_commands_are_those_of_the_table(executable, catalogue):
    commands = [word for word in offered(executable, "dynstiction ") if not word.startswith("-")]
    ours_first = sorted(catalogue["commands"], key=lambda command: command["by"] == "Python")
    assert commands == [command["name"] for command in ours_first]
    assert offered(executable, "dynstiction mer") == ["merge"]
    assert offered(executable, "dynstiction nonsense") == []


def test_every_option_of_the_table_is_offered_and_taken(executable, catalogue):
    arguments = {option["name"]: option["argument"] for option in reversed(catalogue["options"])}
    values = {"--set": "scene.t_end=1", "--shard": "1/2", "-o": "x.h5"}
    for command in catalogue["commands"]:
        name = command["name"]
        assert offered(executable, f"dynstiction {name} -") == [*command["options"], "--help"]
        for option in command["options"] if command["by"] == "dynstiction" else []:
            value = [values.get(option, "1")] if arguments[option] else []
            taken = Program((executable,))(name, "missing.nml", option, *value)
            assert "takes no -" not in taken.stderr
            assert "unknown option" not in taken.stderr


def test_an_option_of_another_command_is_refused(executable):
    for line in ("check --quiet", "resume --set a.b=1", "merge --shard 1/2", "trade --shard 1/2", "template -o x"):
        said = Program((executable,))(*line.split(), status=1)
        assert f"takes no {line.split()[1]}: " in said.stderr


def test_keys_are_offered_after_set(executable, catalogue):
    names = [f"{key['group']}.{key['name']}=" for key in catalogue["keys"]]
    assert len(names) > 30
    assert offered(executable, "dynstiction run --set ") == names
    assert offered(executable, "dynstiction run --set=friction.mu_i") == ["--set=friction.mu_inf="]


@pytest.mark.parametrize("form", ["--set ", "--set="])
def test_choices_are_offered_after_a_key(executable, form):
    before = "--set=" if form == "--set=" else ""
    assert offered(executable, f"dynstiction check {form}friction.law=") == [
        f"{before}friction.law=constant",
        f"{before}friction.law=table",
        f"{before}friction.law=weakening",
        f"{before}friction.law=stribeck",
    ]
    assert offered(executable, f"dynstiction check {form}system.mass=") == []
    assert offered(executable, f"dynstiction check {form}system.mess=") == []
    assert offered(executable, f"dynstiction check {form}=") == []


def test_operands(executable):
    assert offered(executable, "dynstiction run ") == ["*.nml"]
    assert offered(executable, "dynstiction run -o x.h5 a.nml ") == ["*.nml"]
    assert offered(executable, "dynstiction run -o ") == ["*.h5"]
    assert offered(executable, "dynstiction resume ") == ["*.h5"]
    assert "low_frequency" in offered(executable, "dynstiction template ")
    assert offered(executable, "dynstiction trade --quantity per") == ["period"]
    assert offered(executable, "dynstiction keys ") == []
    assert offered(executable, "dynstiction plot ") == ["*.h5"]
    assert offered(executable, "dynstiction plot x.h5 -o ") == ["*.png"]
    assert offered(executable, "dynstiction run --shard ") == ["auto"]
    assert offered(executable, "dynstiction paper --format p") == ["png", "pdf"]


LINES = {
    "dynstiction mer": "dynstiction merge ",
    "dynstiction run --overw": "dynstiction run --overwrite ",
    "dynstiction run --set system.mis": "dynstiction run --set system.misalignment_deg=",
    "dynstiction run --set friction.law=w": "dynstiction run --set friction.law=weakening ",
    "dynstiction run only": "dynstiction run only_this.nml ",
    "dynstiction resume only": "dynstiction resume only_this.h5 ",
}


@pytest.fixture
def folder(tmp_path):
    for name in ("only_this.nml", "only_this.h5", "only_this.txt"):
        (tmp_path / name).touch()
    return tmp_path


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


def typed(command: list[str], setup: str, line: str, wanted: str, **options) -> str:
    """What a terminal shows after `line` and the tab key; waits until that is `wanted`."""
    process, terminal = pty.fork()
    if process == 0:
        os.chdir(options["cwd"])
        os.execve(command[0], command, options["env"])
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
def test_bash(executable, folder, line, completed):
    command = [shell("bash"), "--norc", "--noprofile", "-i"]
    shown = typed(command, f"source '{SCRIPTS}/dynstiction.bash'", line, completed, cwd=folder, env=environment(executable, folder))
    assert completed in shown


@pytest.mark.parametrize(("line", "completed"), LINES.items())
def test_zsh(executable, folder, line, completed):
    shown = typed(
        [shell("zsh"), "-f", "-i"],
        f"fpath=('{SCRIPTS}' $fpath); autoload -Uz compinit; compinit -u -D",
        line,
        completed,
        cwd=folder,
        env=environment(executable, folder),
    )
    assert completed in shown


@pytest.mark.parametrize(("line", "completed"), LINES.items())
def test_fish(executable, folder, line, completed):
    fish = Program((shell("fish"), "--no-config", "-c"), folder, environment(executable, folder))
    said = fish(f"source '{SCRIPTS}/dynstiction.fish'; complete -C '{line}'", status=0)
    offers = [offer.split("\t")[0] for offer in said.stdout.splitlines()]
    assert offers == [completed.split(" ")[-1] or completed.split(" ")[-2]]
