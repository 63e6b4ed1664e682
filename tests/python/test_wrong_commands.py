"""Wrong commands and decks: each is answered with what is wrong and with what would be right, never with silence."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from programs import DONE, FILE_ERROR, INPUTS, Program

USAGE, DECK = 1, 2

# Words of the command; its exit status; what the answer must hold: what is wrong, and what would be right.
COMMANDS: list[tuple[str, int, tuple[str, ...]]] = [
    ("", USAGE, ("no command", "run | sweep", "dynstiction --help")),
    ("rnu own.nml", USAGE, ("unknown command 'rnu'", "the nearest is 'run'")),
    ("run", USAGE, ("'run' without a deck", "write dynstiction run DECK")),
    ("run own.nml --overwite", USAGE, ("unknown option '--overwite'", "the nearest is '--overwrite'", "dynstiction run --help")),
    ("run own.nml -o", USAGE, ("-o without", "write -o FILE")),
    ("run own.nml fig3.nml -o x.h5", USAGE, ("-o names one file", "several decks")),
    ("run none.nml", DECK, ("none.nml: no such file", "dynstiction template > my.nml")),
    ("run run.h5", DECK, ("run.h5: is a result", "not a deck", "dynstiction show")),
    ("run own.nml", FILE_ERROR, ("own.h5", "the file exists", "--overwrite or another name")),
    ("run own.nml -o stopped.h5", FILE_ERROR, ("the file exists", "dynstiction resume stopped.h5", "--overwrite")),
    ("run own.nml -o none/x.h5", FILE_ERROR, ("the folder none does not exist", "create it first")),
    ("run own.nml -o own.nml", FILE_ERROR, ("own.nml", "use another name")),
    ("resume own.nml", FILE_ERROR, ("own.nml", "is a deck", "dynstiction run own.nml")),
    ("resume own.h5", FILE_ERROR, ("cannot resume", "the run is complete")),
    ("show none.h5", FILE_ERROR, ("none.h5", "there is no such file", "give the -o of the run")),
    ("show text.txt", FILE_ERROR, ("text.txt", "no result of this program", "give a result file")),
    ("merge own.nml -o m.h5", USAGE, ("has no &sweep", "nothing to merge")),
    ("template ful", USAGE, ("unknown model 'ful'", "the nearest is 'full'")),
    ("sweep own.nml", USAGE, ("varies nothing", "--vary system.misalignment_deg=0.5:20:40")),
    (
        "sweep own.nml --vary system.mass=1:2",
        USAGE,
        ("does not have the parts FIRST:LAST:COUNT", "--vary GROUP.KEY=FIRST:LAST:COUNT"),
    ),
    ("sweep own.nml --vary friction.law=1:2:3", DECK, ("'friction.law' cannot be varied", "name a number")),
    ("check own.nml --set misalignment_deg=2", DECK, ("no group", "write --set system.misalignment_deg=VALUE")),
    ("check own.nml --set system.mass=250g", DECK, ("'250 g' has a unit", "in kg: 0.25")),
    ("check own.nml --set integrator.method=radau", DECK, ("unknown method 'radau'", "the nearest is 'radau5'")),
]

PYTHON_COMMANDS: list[tuple[str, int, tuple[str, ...]]] = [
    ("plot own.nml", FILE_ERROR, ("own.nml", "is a deck, not a result", "dynstiction run own.nml")),
    ("plot none.h5", FILE_ERROR, ("none.h5", "no such file")),
    ("plot run.h5 --kind spectogram", USAGE, ("'spectogram'", "the nearest is 'spectrogram'")),
    ("plot run.h5 -o none/x.png", FILE_ERROR, ("the folder none does not exist", "create it first")),
    ("report sweep.h5", FILE_ERROR, ("holds a sweep, not one run", "dynstiction plot")),
    ("animate run.h5 -o x.gif --from 0.05 --to 0.01", USAGE, ("--from 0.05 is not before --to 0.01", "exchange them")),
    ("export run.h5 more.h5", USAGE, ("too many operands, from 'more.h5' on", "export --help")),
    ("run own.nml", USAGE, ("'run' is a command of the executable", "HDF5", "dynstiction run", "ds.run")),
]

# What `check` accepts with a note: what is changed, and what the note says.
NOTES: list[tuple[str, tuple[str, ...]]] = [
    ("system.stiffness_x=1e8", ("stiffness_x = 1e8 is above stiffness_y = 1e7", "exchange them")),
    ("friction.mu_inf=0.3", ("mu_inf = 0.3 is above mu_0 = 0.2", "mu_inf < mu_0")),
    ("system.misalignment_deg=91", ("misalignment_deg = 91", "-89 is the same axis")),
    ("friction.v_f=10", ("v_f = 10 m/s is far above the velocities", "friction hardly falls")),
    ("drive.velocity=5", ("5 m/s is far above v_f = 0.01 m/s", "sliding is steady")),
    ("drive.velocity=0", ("the drive never moves", "give a velocity")),
    ("output.interval=1e-3", ("do not show the fast oscillation", "output.interval = 'auto'")),
]


@pytest.fixture(scope="module")
def folder(executable: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Decks and results to mistake."""
    here = tmp_path_factory.mktemp("wrong")
    program = Program((executable,), here)
    (here / "own.nml").write_text(program("template", status=DONE).stdout.replace("t_end = 10.0", "t_end = 0.1 "))
    (here / "fig3.nml").write_text((INPUTS / "fig3.nml").read_text())
    (here / "text.txt").write_text("A text, and no more.\n")
    program("run", "own.nml", "-o", "run.h5", status=DONE)
    program("run", "own.nml", status=DONE)
    program("sweep", "own.nml", "--vary", "misalignment_deg=1:2:2", "-o", "sweep.h5", status=DONE)
    endless = ("scene.t_end=1e6", "output.interval=1e6", "output.wall_limit=0.05", "integrator.cycle_map=off")
    program("run", "own.nml", "-o", "stopped.h5", settings=endless, status=75)
    return here


def answered(done: object, status: int, words: tuple[str, ...]) -> None:
    stderr, code = done.stderr, done.returncode  # type: ignore[attr-defined]
    assert code == status and stderr.startswith("dynstiction: "), done
    for word in words:
        assert word in stderr, done
    # No traces of a programming language, no Fortran exponents, no page that an installation lacks.
    assert not re.search(r"Traceback|Errno|E[+-]\d\d|docs/", stderr), done


@pytest.mark.parametrize(("command", "status", "words"), [*COMMANDS, *PYTHON_COMMANDS])
def test_wrong_command(command: str, status: int, words: tuple[str, ...], executable: Path, package: Program, folder: Path) -> None:
    before = sorted(folder.iterdir())
    first = package.first if (command, status, words) in PYTHON_COMMANDS else (executable,)
    answered(Program(first, folder)(*command.split()), status, words)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(("setting", "words"), NOTES)
def test_what_is_seldom_meant_has_a_note(setting: str, words: tuple[str, ...], program: Program, folder: Path) -> None:
    done = program("check", folder / "own.nml", "--set", setting, status=DONE)
    assert done.stderr.count("note: ") == 1 and f"--set {setting}: note: " in done.stderr, done
    for word in words:
        assert word in done.stderr


@pytest.mark.parametrize(
    ("setting", "keys"), [("scene.model=low_frequency", ["stiffness_y"]), ("friction.law=constant", ["mu_inf", "v_f"])]
)
def test_a_key_of_the_deck_that_a_setting_makes_useless_is_left_out(
    setting: str, keys: list[str], program: Program, folder: Path
) -> None:
    done = program("check", folder / "own.nml", "--set", setting, status=DONE)
    notes = done.stderr.splitlines()
    lines = (folder / "own.nml").read_text().splitlines()
    assert len(notes) == len(keys), done
    for note, key in zip(notes, keys, strict=True):
        line = int(note.partition("own.nml:")[2].partition(":")[0])
        assert f"note: '{key}' is not used with {setting.partition('.')[2].replace('=', ' ')} and is left out" in note
        assert lines[line - 1].split()[0] == key
        assert not re.search(rf"^  {key} = ", done.stdout, re.MULTILINE)
    # What a --set gives is refused.
    also = program("check", folder / "own.nml", settings=(setting, "system.stiffness_y=1e6", "friction.v_f=0.2"), status=2)
    assert f"'{keys[-1]}' is not used with" in also.stderr


def test_no_note_on_the_template_and_the_decks_of_the_paper(program: Program, folder: Path) -> None:
    decks = [folder / "own.nml", *sorted(INPUTS.glob("*.nml"))]
    assert program("check", *decks, status=DONE).stderr == ""


def test_a_run_says_what_it_has_found(program: Program, folder: Path) -> None:
    own = folder / "own.nml"
    said = program("run", own, "--output=x.h5", "--set", "scene.t_end=4", status=DONE)
    assert said.stderr == "" and said.stdout.count("\n") == 1 and " 2 cycles: " in said.stdout
    assert program("run", own, "--output", "y.h5", "--quiet", status=DONE).stdout == ""
    stopped = program("run", own, "-o", "s.h5", settings=("scene.t_end=30", "output.wall_limit=1e-9"), status=75)
    assert "continue with dynstiction resume s.h5" in stopped.stderr
