"""A result is never changed, only replaced: whatever happens to a run, under its name is nothing, the former file, or a whole one; and
from a whole one the run goes on to the same bits.
"""

from __future__ import annotations

import fcntl
import io
import random
import re
import resource
import shutil
import signal
import subprocess
import time
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import programs
import pytest
from damage import CHECKSUM_LENGTH, changed, flipped, sealed, without_checksum
from programs import FILE_ERROR, INPUTS, STOPPED, assert_refused, limited, opened
from programs import wait_until as wait_for

pytestmark = pytest.mark.deck

# What the closed forms do not use.
ABSENT = ("system.mass=", "friction.law=", "initial.velocity_ratio=", "integrator.method=", "integrator.rtol=")
# Longer than any test waits. Who limits the time needs no room for all.
ENDLESS = ("scene.t_end=1e6", "output.wall_limit=1e6")
# Each cycle made by steps: a run that lasts. With the map it ends before anybody can stop it.
STEPS = "integrator.cycle_map=off"
SMOOTHED = ("friction.contact=smoothed", "friction.v_smooth=1.0e-5")
# What a state may be in: a knot of the drive, a long rest with many samples, every step written. More: tests/unit/test_resume.f90.
SCENES: dict[str, tuple[str, ...]] = {
    "radau9": ("fig3", "integrator.method=radau9", STEPS, "scene.t_end=4.0"),
    "rk4": ("fig3", "integrator.method=rk4", "integrator.step=2e-6", "integrator.rtol=", *SMOOTHED, "scene.t_end=0.3"),
    "low_frequency": ("slide_hold_slide", "scene.model=low_frequency", "system.stiffness_y=", "output.interval=4e-5",
                      "output.fields=u_x,w_y,sticking", "scene.t_end=8.6"),
    "creep": ("fig3_constant", "scene.model=creep", *ABSENT, "output.interval=5e-6", "output.fields=u_x,X_rate", "scene.t_end=1.0"),
    "several seconds": ("fig3", "integrator.method=radau5", STEPS, "scene.t_end=12.0"),
    "auto": ("fig3", "scene.model=auto", "scene.t_end=4.0"),
    "every step": ("fig3", "output.interval=0.0", STEPS, "scene.t_end=2.2"),
    "cycles leapt": ("fig3", "output.interval=2e-5", "output.fields=u_x,w_y", "scene.t_end=6.0"),
    "many samples in one rest": ("fig3", "drive.velocity=1e-9", "initial.velocity_ratio=0", "output.fields=u_x", "output.interval=1e-5",
                                 "scene.t_end=4.0"),
}  # fmt: skip


class Program(programs.Program):
    """The executable, applied to scenes."""

    def command(self, scene: tuple[str, ...], file: Path, *settings: str) -> list[str]:
        values = dict(setting.split("=", 1) for setting in (*scene[1:], *settings))
        return self.words("run", INPUTS / f"{scene[0]}.nml", "-o", file, "--quiet", settings=map("=".join, values.items()))[1:]

    def run(self, *scene_file_and_settings, **options) -> subprocess.CompletedProcess[str]:
        return self(*self.command(*scene_file_and_settings), **options)

    def begin(self, scene: tuple[str, ...], file: Path, *settings: str, **options) -> subprocess.Popen[str]:
        """A run in the background, as soon as it has its part of the file."""
        process = self.start(*self.command(scene, file, *settings), **options)
        wait_for(part_of(file).exists, part_of(file))
        return process

    def resume(self, file: Path, **options) -> subprocess.CompletedProcess[str]:
        return self("resume", file, "--quiet", **options)


def ended(process: subprocess.Popen[str], how: Callable[[subprocess.Popen[str]], None] = subprocess.Popen.terminate) -> str:
    """End a process; what it says. The status of one that is stopped is that of a stop."""
    how(process)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == (-signal.SIGKILL if how == subprocess.Popen.kill else STOPPED), errors
    return errors


def part_of(file: Path) -> Path:
    return file.with_name(file.name + ".part")


def content(file: Path) -> dict[str, object]:
    """Every bit of a result but the wall time, and the keys that say when to stop and to save."""
    found: dict[str, object] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith(("deck", "parameters", "statistics/wall_time")):
            found[name] = (item.shape, str(item.dtype), item[()].tobytes())

    with h5py.File(file) as data:
        data.visititems(visit)
        found |= {name: int(data.attrs[name]) for name in ("result_code", "complete")}
    return found


def assert_same(file: Path, expected: dict[str, object]) -> None:
    actual = content(file)
    assert [name for name in sorted(actual.keys() | expected.keys()) if actual.get(name) != expected.get(name)] == []


def assert_whole(file: Path) -> int:
    """An unfinished run with its checksum, and whole columns of equal length. Returns their length."""
    data_ = file.read_bytes()
    assert data_[-9:-1] == b"%08X" % zlib.crc32(data_[:-CHECKSUM_LENGTH])
    with opened(file) as data:
        assert data.attrs["complete"] == 0
        rows = {len(column[:]) for column in data["time_series"].values()}
        assert len(rows) == 1
        assert len(data["events/time"][:]) == len(data["events/kind"][:])
        assert (np.diff(data["time_series/time"][:]) > 0).all()
    return rows.pop()


@pytest.fixture(scope="module")
def program(executable) -> Program:
    return Program((executable,))


@pytest.fixture(scope="module")
def references(program, tmp_path_factory) -> Callable[[str], dict[str, object]]:
    """The content of each scene's file when the run is not stopped."""
    folder = tmp_path_factory.mktemp("references")
    found: dict[str, dict[str, object]] = {}

    def reference(name: str) -> dict[str, object]:
        if name not in found:
            file = folder / "reference.h5"
            program.run(SCENES[name], file, status=0)
            assert list(folder.iterdir()) == [file]
            found[name] = content(file)
            file.unlink()
        return found[name]

    return reference


def stopped_inside_a_leap(file: Path) -> bool:
    """The events of a leap come before its rows; in steps none is further than some oscillations from the last row."""
    with h5py.File(file) as data:
        times, events = data["time_series/time"], data["events/time"]
        return data["statistics/cycles_leapt"][()] > 0 and events.size > 0 and events[-1] - times[-1] > 0.1


@pytest.mark.parametrize("name", sorted(set(SCENES) - {"several seconds"}))
def test_resumed_again_and_again_it_ends_with_the_same_bits(program, references, tmp_path, name):
    file = tmp_path / "x.h5"
    done = program.run(SCENES[name], file, "output.wall_limit=0.01")
    stops = inside = 0
    while done.returncode == STOPPED:
        stops += 1
        assert "stopped at output.wall_limit at t = " in done.stderr
        assert f"dynstiction resume {file}" in done.stderr
        assert_whole(file)
        inside += stopped_inside_a_leap(file)
        done = program.resume(file)
    assert done.returncode == 0, done.stderr
    assert stops >= 1
    assert (inside > 0) or not name.startswith("cycles leapt")
    assert_same(file, references(name))
    assert list(tmp_path.iterdir()) == [file]


def test_a_result_behind_a_link_is_resumed_by_each_of_its_names(program, references, tmp_path):
    (tmp_path / "folder").mkdir()
    file, link = tmp_path / "folder" / "x.h5", tmp_path / "link.h5"
    program.run(SCENES["radau9"], file, "scene.t_end=0.01", status=0)
    link.symlink_to(file)
    done = program(*program.command(SCENES["radau9"], link, "output.wall_limit=0.01"), "--overwrite")
    names = [link, file]
    while done.returncode == STOPPED:
        done = program.resume(names[0])
        names.reverse()
    assert done.returncode == 0, done.stderr
    assert_same(file, references("radau9"))
    assert link.is_symlink() and list((tmp_path / "folder").iterdir()) == [file]


def test_a_signal_stops_a_command_with_several_decks(program, tmp_path):
    decks = (INPUTS / "fig3.nml", INPUTS / "reversal.nml")
    process = program.start("run", *decks, "--quiet", settings=("scene.t_end=1e5", "output.interval=0.1"), cwd=tmp_path)
    wait_for((tmp_path / "fig3.h5.part").exists, "fig3.h5.part")
    ended(process)
    assert not (tmp_path / "reversal.h5").exists()


def test_a_second_ctrl_c_ends_the_program_at_once(program, tmp_path):
    codes = set()
    for i in range(10):
        file = tmp_path / f"{i}.h5"
        process = program.begin(SCENES["radau9"], file, *ENDLESS)
        process.send_signal(signal.SIGINT)
        time.sleep(0.002)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        codes.add(process.returncode)
        assert not file.exists() or assert_whole(file) > 0
    assert -signal.SIGINT in codes
    assert codes <= {-signal.SIGINT, STOPPED}


def test_an_ignored_ctrl_c_stays_ignored(program, tmp_path):
    file = tmp_path / "x.h5"
    ignore = partial(signal.signal, signal.SIGINT, signal.SIG_IGN)
    process = program.begin(SCENES["radau9"], file, *ENDLESS, preexec_fn=ignore)
    process.send_signal(signal.SIGINT)
    time.sleep(0.2)
    assert process.poll() is None
    ended(process)


def test_a_signal_stops_within_one_long_advance(program, tmp_path):
    """A rest of 1e6 s with a sample every ms is one piece of the motion."""
    file = tmp_path / "x.h5"
    rest = ("drive.velocity=0", "initial.velocity_ratio=0", "output.fields=u_x", "output.interval=1e-3")
    ended(program.begin(("fig3", *ENDLESS, *rest), file))
    assert assert_whole(file) < 1e8


# Files that are made whole while the run goes on.


def test_a_file_is_made_whole_from_time_to_time(program, references, tmp_path):
    """Each holds more than the last; the last one is there after a kill, and the run goes on from it to the same bits."""
    file = tmp_path / "x.h5"
    process = program.begin(SCENES["several seconds"], file, "output.checkpoint_interval=0.02")
    rows: list[int] = []
    for _ in range(3):
        before = file.stat().st_ino if file.exists() else None
        wait_for(lambda before=before: file.exists() and file.stat().st_ino != before, "a new file")
        rows.append(assert_whole(file))
    ended(process, subprocess.Popen.kill)
    assert rows == sorted(rows) and rows[0] < rows[-1]
    with h5py.File(file) as data:
        assert data.attrs["result_text"].startswith("not finished: this is the run at t = ")
    assert part_of(file).exists()
    program.resume(file, status=0)
    assert_same(file, references("several seconds"))
    assert list(tmp_path.iterdir()) == [file]


# Files of others. Kills at every moment, and several processes: test_faults.py.


def test_a_part_of_others_is_refused(program, tmp_path):
    file = tmp_path / "x.h5"
    part_of(file).mkdir()
    assert_refused(program.run(SCENES["radau9"], file), "x.h5")
    part_of(file).rmdir()
    (tmp_path / "other").write_text("precious")
    part_of(file).symlink_to(tmp_path / "other")
    assert_refused(program.run(SCENES["radau9"], file), "symbolic link")
    assert (tmp_path / "other").read_text() == "precious"


# Damage, and what cannot be resumed.


@pytest.fixture(scope="module")
def stopped(program, tmp_path_factory) -> Path:
    """A run that was stopped."""
    file = tmp_path_factory.mktemp("stopped") / "x.h5"
    program.run(SCENES["radau9"], file, "output.wall_limit=0.01", status=STOPPED)
    return file


@pytest.fixture
def copied(stopped, tmp_path) -> Path:
    return Path(shutil.copy(stopped, tmp_path))


@pytest.mark.parametrize("count", [60, pytest.param(400, marks=pytest.mark.full)])
def test_any_bit_of_a_stopped_run_counts(program, stopped, copied, count):
    """But for the last line: where that is none any more, nothing says what the bytes should be, and the file is not resumed either."""
    chance = random.Random(3)
    whole = stopped.read_bytes()
    for _ in range(count):
        copied.write_bytes(flipped(whole, chance.randrange(len(whole)), chance.randrange(8)))
        assert_refused(program.resume(copied), "cannot resume: the file ", "run the deck again")
    copied.write_bytes(whole)
    assert program.resume(copied).returncode in (0, STOPPED)


# What no damage of the bytes alone is: test_damaged_inputs.py has that.
DAMAGED: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "without its last line": (without_checksum, "no checksum"),
    "the state cut off": (lambda data: sealed(data[: data.rindex(b"dynstiction state ")]), "no state"),
    "another length of the state": (lambda data: sealed(re.sub(rb"(dynstiction state  +)\d+", rb"\g<1>8", without_checksum(data))), ""),
    "another format": (lambda data: sealed(with_first_number(without_checksum(data))), "another state"),
    "another version": (lambda data: sealed(with_version(without_checksum(data))), "of version 9.9"),
}  # fmt: skip


def with_first_number(data: bytes) -> bytes:
    line = data.rindex(b"dynstiction state ")
    first = line - int(data[line:].split()[2])
    return data[: first + 8] + (99).to_bytes(8, "little") + data[first + 16 :]


def with_version(data: bytes) -> bytes:
    """The text of the attribute `version` stands in a heap."""
    with h5py.File(io.BytesIO(data)) as file:
        version = file.attrs["version"].encode()
    new = b"9.9".ljust(len(version), b" ")
    assert data.count(version + b"\0") == 1
    return data.replace(version + b"\0", new + b"\0")


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_file_is_refused(program, copied, damage):
    change, words = DAMAGED[damage]
    changed(copied, change)
    before = copied.read_bytes()
    assert_refused(program.resume(copied), str(copied), words)
    assert copied.read_bytes() == before
    assert list(copied.parent.iterdir()) == [copied]


def test_what_was_changed_with_h5py_is_read_but_not_resumed(program, copied):
    with h5py.File(copied, "r+") as data:
        data.attrs["remark"] = "mine"
    assert_refused(program.resume(copied), "was changed since it was written")
    program("show", copied, status=0)


def test_a_solver_that_gave_up_is_refused(program, tmp_path):
    file = tmp_path / "x.h5"
    program.run(SCENES["radau9"], file, "integrator.max_steps=100", status=4)
    assert assert_whole(file) > 0
    assert_refused(program.resume(file), "gave up", "max_steps = 100")


# Disks.


def test_a_limit_that_is_met_is_not_the_end(program, references, tmp_path):
    """The last whole file stays, and with a higher limit the run continues from it. A second name, which a kill has left, is removed."""
    file = tmp_path / "x.h5"
    limit = limited(resource.RLIMIT_FSIZE, 5_000_000)
    done = program.run(SCENES["several seconds"], file, "output.checkpoint_interval=0.01", preexec_fn=limit)
    assert_refused(done, "file-size limit")
    assert_whole(file)
    assert_refused(program.resume(file, preexec_fn=limit), "file-size limit")
    assert_whole(file)
    part_of(file).hardlink_to(file)
    program.resume(file, status=0)
    assert_same(file, references("several seconds"))
    assert list(tmp_path.iterdir()) == [file]


def test_a_folder_that_vanishes(program, tmp_path):
    folder = tmp_path / "vanishing"
    folder.mkdir()
    process = program.begin(SCENES["radau9"], folder / "x.h5", *ENDLESS, "output.checkpoint_interval=0.1")
    wait_for((folder / "x.h5").exists, "x.h5")
    for _ in range(2):
        shutil.rmtree(folder, ignore_errors=True)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == FILE_ERROR
    assert "removed" in errors


def test_a_reader_with_a_lock_is_no_obstacle(program, copied):
    with copied.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_SH)
        assert program.resume(copied).returncode in (0, STOPPED)
