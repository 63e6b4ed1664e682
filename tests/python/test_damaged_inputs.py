"""Every kind of input file, damaged in every way: refused with exit status 2 or 3 and a message, or read as the sound one.

Kinds: deck, points of a sweep, result of a stopped run, file of a share of a sweep. Damage within HDF5's structures and at random
places: test_damaged_files.py, test_checkpoint.py; of the text of decks: test_decks.py, tests/fuzz.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from damage import CHECKSUM_LENGTH, flipped
from programs import INPUTS, STOPPED, Program

LIMIT = 10.0
"""Wall time that a refusal may take on a busy machine [s]."""

pytestmark = pytest.mark.deck

POINTS = "system.misalignment_deg,drive.velocity\n1.5,1.0e-3\n2.5,2.0e-3\n3.5,3.0e-3\n"
SWEEP = "\n&sweep\n  points = 'cases.csv'\n/\n"


def blank(data: bytes, place: int) -> bytes:
    """32 zeros, from the place on where there was another byte."""
    while data[place : place + 1] == b"\0":
        place += 1
    return data[:place] + bytes(32) + data[place + 32 :]


def foreign_hdf5(file: Path) -> None:
    with h5py.File(file, "w") as data:
        data["x"] = np.arange(1000.0)
        data.attrs["program"] = "another"


def replace_by(make: Callable[[Path], object]) -> Callable[[Path], None]:
    def damage(file: Path) -> None:
        file.unlink()
        make(file)

    return damage


def of_bytes(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    return lambda file: file.write_bytes(change(file.read_bytes())) and None


DAMAGES: dict[str, Callable[[Path], None]] = {
    "empty": of_bytes(lambda data: b""),
    "cut in its first line": of_bytes(lambda data: data[:10]),
    "cut in the middle": of_bytes(lambda data: data[: len(data) // 2 - 3]),
    "cut near the end": of_bytes(lambda data: data[: -CHECKSUM_LENGTH - 7]),
    "first byte missing": of_bytes(lambda data: data[1:]),
    "first bytes zero": of_bytes(lambda data: blank(data, 0)),
    "zeros in the middle": of_bytes(lambda data: blank(data, len(data) // 2)),
    "zeros only": of_bytes(lambda data: bytes(len(data))),
    "bit at the beginning": of_bytes(lambda data: flipped(data, 2, 7)),
    "bit at a third": of_bytes(lambda data: flipped(data, len(data) // 3, 7)),
    "bit near the end": of_bytes(lambda data: flipped(data, -CHECKSUM_LENGTH - 9, 7)),
    "as UTF-16": of_bytes(lambda data: data.decode("latin-1").encode("utf-16")),
    "compressed": of_bytes(lambda data: b"\x1f\x8b\x08\0" + hashlib.sha512(data).digest() * 20),
    "another text": of_bytes(lambda data: b"Dear colleague,\nplease find enclosed the file.\n"),
    "another HDF5 file": replace_by(foreign_hdf5),
    "an older NetCDF file": of_bytes(lambda data: b"CDF\x01" + bytes(200)),
    "a folder": replace_by(Path.mkdir),
    "a pipe": replace_by(os.mkfifo),
    "a device": replace_by(lambda file: file.symlink_to("/dev/zero")),
    "a link to itself": replace_by(lambda file: file.symlink_to(file)),
    "missing": replace_by(lambda file: None),
    "no permission": lambda file: file.chmod(0),
}  # fmt: skip


def call(program: Program, *arguments: object, **options: object) -> subprocess.CompletedProcess[str]:
    return program(*arguments, "--quiet", timeout=LIMIT, **options)


# The file that is damaged, the command that reads it, and whom its refusal must name.
KINDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "deck": ("deck.nml", ("run", "deck.nml", "-o", "deck.h5")),
    "points": ("cases.csv", ("run", "map.nml", "-o", "other.h5")),
    "result of a stopped run": ("stopped.h5", ("resume", "stopped.h5")),
    "share": ("map.1-of-2.h5", ("merge", "map.nml", "-o", "map.h5")),
}


@pytest.fixture(scope="module")
def sound(executable: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a sound file of every kind."""
    folder = tmp_path_factory.mktemp("sound")
    program = Program((executable,), folder)
    deck = re.sub(r"t_end = \S+", "t_end = 0.2", (INPUTS / "low_frequency.nml").read_text())
    (folder / "deck.nml").write_text(deck)
    (folder / "map.nml").write_text(deck + SWEEP)
    (folder / "cases.csv").write_text(POINTS)
    for part in ("1/2", "2/2"):
        call(program, "run", "map.nml", "-o", "map.h5", "--share", part, status=0)
    stop = ("scene.t_end=8.0", "output.interval=1e-4", "output.wall_limit=0.001")
    call(program, "run", INPUTS / "fig3.nml", "-o", "stopped.h5", settings=stop, status=STOPPED)
    return folder


@pytest.fixture
def folder(sound: Path, tmp_path: Path) -> Path:
    """The test's folder, with copies of them."""
    shutil.copytree(sound, tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_input_is_refused(program: Program, folder: Path, kind: str, damage: str) -> None:
    if damage == "no permission" and os.geteuid() == 0:
        pytest.skip("root reads everything")
    name, command = KINDS[kind]
    DAMAGES[damage](folder / name)
    others = {path: path.read_bytes() for path in folder.iterdir() if path.is_file() and path.name != name}
    done = call(program, *command)
    if kind == "share" and damage == "missing":
        assert done.returncode == 75, done
        assert "of 3 cases have not been run" in done.stderr
        return
    assert done.returncode == (2 if kind == "deck" else 3), done
    assert done.stderr.startswith("dynstiction: ")
    assert name in done.stderr
    assert all(line.startswith("dynstiction: ") for line in done.stderr.splitlines())
    # Nothing else was changed, and no result was written.
    assert {path: path.read_bytes() for path in others} == others
    assert not (folder / "deck.h5").exists()


def test_sound_inputs_are_accepted(program: Program, folder: Path) -> None:
    """What is refused above is refused for its damage."""
    for kind, (_, command) in KINDS.items():
        done = call(program, *command)
        assert done.returncode == (75 if "stopped" in command[1] else 0), (kind, done)
