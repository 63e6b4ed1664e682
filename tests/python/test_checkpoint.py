"""A run that is stopped or killed resumes from its checkpoint, and ends with the same bits; damaged files are not resumed."""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import programs
import pytest
from damage import changed, flipped, killed, replaced, signed, without_seal
from programs import FILE_ERROR, INPUTS, STOPPED, limited, small_disk
from programs import wait_until as wait_for

sys.path.insert(0, str(Path(__file__).parents[1] / "faults"))

from program import compiled_shim

pytestmark = pytest.mark.deck

# What the closed forms do not use.
ABSENT = ("system.mass=", "friction.law=", "initial.velocity_ratio=", "integrator.method=", "integrator.rtol=")
# Longer than any test waits. Who limits the time needs no room for all.
ENDLESS = ("scene.t_end=1e6", "output.wall_limit=1e6")
# Each cycle made by steps: a run that lasts. With the map it ends before anybody can stop it.
STEPS = "integrator.cycle_map=off"
SMOOTHED = ("friction.contact=smoothed", "friction.v_smooth=1.0e-5")
# Every method, and what a state may be in: a knot of the drive, a long rest with many samples, every step written.
SCENES: dict[str, tuple[str, ...]] = {
    "radau5": ("fig3", "integrator.method=radau5", STEPS, "scene.t_end=2.2"),
    "radau9": ("fig3", "integrator.method=radau9", STEPS, "scene.t_end=4.0"),
    "radau13": ("fig3", "integrator.method=radau13", STEPS, "scene.t_end=4.0"),
    "dopri5": ("fig3", "integrator.method=dopri5", "integrator.rtol=1e-6", STEPS, "scene.t_end=0.6"),
    "dop853": ("fig3", "integrator.method=dop853", "integrator.rtol=1e-6", STEPS, "scene.t_end=0.4"),
    "rk4": ("fig3", "integrator.method=rk4", "integrator.step=2e-6", "integrator.rtol=", *SMOOTHED, "scene.t_end=0.3"),
    "moreau_jean": ("fig3", "integrator.method=moreau_jean", "integrator.step=2e-6", "integrator.rtol=", "scene.t_end=0.3"),
    "dopri5, smoothed": ("fig3", "integrator.method=dopri5", *SMOOTHED, "scene.t_end=0.4"),
    "radau9, smoothed": ("fig3", "integrator.method=radau9", *SMOOTHED, "scene.t_end=15.0"),
    "low_frequency": ("slide_hold_slide", "scene.model=low_frequency", "system.stiffness_y=", "output.interval=4e-5",
                      "output.fields=u_x,w_y,sticking", "scene.t_end=8.6"),
    "low_frequency, dopri5": ("reversal", "scene.model=low_frequency", "system.stiffness_y=", "integrator.method=dopri5",
                              "output.interval=1e-4", "output.fields=u_x,w_y", "scene.t_end=4.2"),
    "high_frequency": ("slide_hold_slide", "scene.model=high_frequency", "output.interval=4e-5", "output.fields=u_y,X",
                       "scene.t_end=5.2"),
    "creep": ("fig3_constant", "scene.model=creep", *ABSENT, "output.interval=1e-6", "output.fields=u_x,X_rate", "scene.t_end=1.0"),
    "creep_asymptotic": ("fig3_constant", "scene.model=creep_asymptotic", *ABSENT, "system.stiffness_y=",
                         "output.interval=1e-6", "output.fields=X,X_rate", "scene.t_end=1.0"),
    "auto": ("fig3", "scene.model=auto", "scene.t_end=4.0"),
    "every step": ("fig3", "output.interval=0.0", STEPS, "scene.t_end=2.2"),
    "knots": ("slide_hold_slide", STEPS, "scene.t_end=8.6"),
    "reversal": ("reversal", "integrator.method=radau13", STEPS, "scene.t_end=8.5"),
    "cycles leapt": ("fig3", "output.interval=2e-5", "output.fields=u_x,w_y", "scene.t_end=6.0"),
    "cycles leapt, dopri5": ("fig3", "integrator.method=dopri5", "integrator.rtol=1e-7", "output.interval=2e-5", "output.fields=u_y",
                             "scene.t_end=4.2"),
    "cycles leapt, knots": ("slide_hold_slide", "output.interval=4e-5", "output.fields=u_x,w_y", "scene.t_end=8.6"),
    "cycles leapt, settled": ("fig3", "scene.settle=1e-5", "output.interval=2e-5", "output.fields=u_x,w_y"),
    # No slow cycle is like another.
    "cycles leapt, irregular": ("fig3", "drive.velocity=2e-4", "output.interval=2e-4", "output.fields=u_x,w_y", "scene.t_end=30.0"),
    "few cycles, irregular": ("fig3", "system.stiffness_y=1e6", "output.interval=1e-4", "output.fields=u_x,w_y", "scene.t_end=12.0"),
    # The rows of a leap are written without a stop.
    "every step, also of leaps": ("fig3", "output.interval=0.0", "scene.t_end=60.0"),
    "many samples in one rest": ("fig3", "drive.velocity=1e-9", "initial.velocity_ratio=0", "output.fields=u_x", "output.interval=1e-5",
                                 "scene.t_end=4.0"),
}  # fmt: skip


class Program:
    """The executable, with runs that write checkpoints all the time."""

    def __init__(self, executable: Path) -> None:
        self.executable = str(executable)

    def command(self, scene: tuple[str, ...], file: Path, *settings: str) -> list[str]:
        deck = INPUTS / f"{scene[0]}.nml"
        command = [self.executable, "run", str(deck), "-o", str(file), "--quiet"]
        values = dict(setting.split("=", 1) for setting in (*scene[1:], *settings))
        for key, value in values.items():
            command += ["--set", f"{key}={value}"]
        return command

    def run(self, scene: tuple[str, ...], file: Path, *settings: str) -> subprocess.CompletedProcess[str]:
        return finished(self.command(scene, file, *settings))

    def start(self, scene: tuple[str, ...], file: Path, *settings: str, **options) -> subprocess.Popen[str]:
        command = self.command(scene, file, *settings)
        return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **options)

    def resume(self, file: Path, **options) -> subprocess.CompletedProcess[str]:
        return finished([self.executable, "resume", str(file), "--quiet"], **options)


def finished(command: list[str], timeout: float = 300.0, **options) -> subprocess.CompletedProcess[str]:
    return programs.Program(tuple(command))(timeout=timeout, **options)


def checkpoint_of(file: Path) -> Path:
    return file.with_name(file.name + ".checkpoint")


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


def assert_readable(file: Path) -> int:
    """A plain reader opens it: an unfinished file, whole columns of equal length. Returns their length."""
    with h5py.File(file) as data:
        assert data.attrs["complete"] == 0
        rows = {len(column[:]) for column in data["time_series"].values()}
        assert len(rows) == 1
        assert len(data["events/time"][:]) == len(data["events/kind"][:])
        assert (np.diff(data["time_series/time"][:]) > 0).all()
    return rows.pop()


@pytest.fixture(scope="module")
def program(executable) -> Program:
    return Program(executable)


@pytest.fixture(scope="module")
def references(program, tmp_path_factory) -> Callable[[str], dict[str, object]]:
    """The content of each scene's file when the run is not stopped."""
    folder = tmp_path_factory.mktemp("references")
    found: dict[str, dict[str, object]] = {}

    def reference(name: str) -> dict[str, object]:
        if name not in found:
            file = folder / "reference.h5"
            done = program.run(SCENES[name], file)
            assert done.returncode == 0, done.stderr
            assert list(folder.iterdir()) == [file]
            found[name] = content(file)
            file.unlink()
        return found[name]

    return reference


def stopped_inside_a_leap(file: Path) -> bool:
    """The events of a leap follow its rows; in steps none is further than some oscillations from the last row."""
    with h5py.File(file) as data:
        times, events = data["time_series/time"], data["events/time"]
        return data["statistics/cycles_leapt"][()] > 0 and times[-1] - events[-1] > 0.1


# Of the scenes with the cycle map one is enough here; tests/unit/test_resume.f90 has the others in short.
LONG = ("cycles leapt, dopri5", "cycles leapt, knots", "cycles leapt, settled", "cycles leapt, irregular", "few cycles, irregular",
        "every step, also of leaps")  # fmt: skip


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.full if name in LONG else ()) for name in SCENES])
def test_resumed_again_and_again_it_ends_with_the_same_bits(program, references, tmp_path, name):
    file = tmp_path / "x.h5"
    done = program.run(SCENES[name], file, "output.wall_limit=0.01")
    stops = inside = 0
    while done.returncode == STOPPED:
        stops += 1
        assert "stopped at output.wall_limit at t = " in done.stderr
        assert f"dynstiction resume {file}" in done.stderr
        assert_readable(file)
        inside += stopped_inside_a_leap(file)
        done = program.resume(file)
    assert done.returncode == 0, done.stderr
    assert stops >= 1
    assert (inside > 0) or not name.startswith("cycles leapt")
    assert_same(file, references(name))
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM, signal.SIGINT, signal.SIGUSR1])
def test_a_signal_stops_with_a_checkpoint(program, references, tmp_path, number):
    file = tmp_path / "x.h5"
    process = program.start(SCENES["radau5"], file)
    wait_for(file.exists, str(file))
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == STOPPED
    assert f"stopped by {number.name} at t = " in errors
    assert "dynstiction help errors" in errors
    with h5py.File(file) as data:
        assert (data.attrs["result_code"], data.attrs["complete"]) == (STOPPED, 0)
        assert number.name in data.attrs["result_text"]
        assert "steps" in data["statistics"]
    assert program.resume(file).returncode == 0
    assert_same(file, references("radau5"))


def test_a_result_behind_a_link_is_resumed_by_each_of_its_names(program, references, tmp_path):
    (tmp_path / "folder").mkdir()
    file, link = tmp_path / "folder" / "x.h5", tmp_path / "link.h5"
    assert program.run(SCENES["radau9"], file, "scene.t_end=0.01").returncode == 0
    link.symlink_to(file)
    command = program.command(SCENES["radau9"], link, "output.wall_limit=0.01")
    done = finished([*command, "--overwrite"])
    names = [link, file]
    while done.returncode == STOPPED:
        done = program.resume(names[0])
        names.reverse()
    assert done.returncode == 0, done.stderr
    assert_same(file, references("radau9"))
    assert link.is_symlink() and list((tmp_path / "folder").iterdir()) == [file]


def test_a_signal_stops_a_command_with_several_decks(program, tmp_path):
    decks = [str(INPUTS / "fig3.nml"), str(INPUTS / "reversal.nml")]
    command = [program.executable, "run", *decks, "--quiet", "--set", "scene.t_end=1e5", "--set", "output.interval=0.1"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    wait_for((tmp_path / "fig3.h5").exists, "fig3.h5")
    process.terminate()
    process.communicate(timeout=60)
    assert process.returncode == STOPPED
    assert not (tmp_path / "reversal.h5").exists()


def test_a_second_ctrl_c_ends_the_program_at_once(program, tmp_path):
    codes = set()
    for i in range(10):
        file = tmp_path / f"{i}.h5"
        process = program.start(SCENES["radau9"], file, *ENDLESS)
        wait_for(file.exists, str(file))
        process.send_signal(signal.SIGINT)
        time.sleep(0.002)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        codes.add(process.returncode)
        assert_readable(file)
    assert -signal.SIGINT in codes
    assert codes <= {-signal.SIGINT, STOPPED}


def test_an_ignored_ctrl_c_stays_ignored(program, tmp_path):
    file = tmp_path / "x.h5"
    ignore = partial(signal.signal, signal.SIGINT, signal.SIG_IGN)
    process = program.start(SCENES["radau9"], file, *ENDLESS, preexec_fn=ignore)
    wait_for(file.exists, str(file))
    process.send_signal(signal.SIGINT)
    time.sleep(0.2)
    assert process.poll() is None
    process.terminate()
    process.communicate(timeout=60)
    assert process.returncode == STOPPED


def test_a_signal_stops_within_one_long_advance(program, tmp_path):
    """A rest of 1e6 s with a sample every ms is one piece of the motion."""
    file = tmp_path / "x.h5"
    rest = ("drive.velocity=0", "initial.velocity_ratio=0", "output.fields=u_x", "output.interval=1e-3")
    process = program.start(("fig3", *ENDLESS, *rest), file)
    wait_for(file.exists, str(file))
    process.terminate()
    process.communicate(timeout=60)
    assert process.returncode == STOPPED
    assert assert_readable(file) < 1e8


def test_a_checkpoint_is_written_every_interval(program, references, tmp_path):
    """Each is newer than the last; none holds less than what the file holds after a kill."""
    file = tmp_path / "x.h5"
    process = program.start(SCENES["radau5"], file, *ENDLESS, "output.checkpoint_interval=0.05")
    seen = set()
    wait_for(file.exists, str(file))

    def three() -> bool:
        seen.add(checkpoint_of(file).read_bytes())
        return len(seen) >= 3

    wait_for(three, "three checkpoints")
    process.kill()
    process.communicate(timeout=60)
    assert assert_readable(file) > 0


def test_without_an_interval_only_a_stop_writes_a_checkpoint(program, tmp_path):
    file = tmp_path / "x.h5"
    process = program.start(SCENES["radau5"], file, *ENDLESS, "output.checkpoint_interval=0")
    wait_for(file.exists, str(file))
    first = checkpoint_of(file).read_bytes()
    time.sleep(0.3)
    assert checkpoint_of(file).read_bytes() == first
    process.terminate()
    process.communicate(timeout=60)
    assert checkpoint_of(file).read_bytes() != first


def kill_and_resume(program: Program, name: str, file: Path, expected: dict[str, object], delays: list[float]) -> int:
    """Start, kill after each delay, resume, until the run ends. Returns the number of kills of an unfinished run."""
    often = ("output.checkpoint_interval=0.05", "output.flush_seconds=0.02")
    command = program.command(SCENES[name], file, *often)
    kills = 0
    for delay in delays:
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        try:
            _, errors = process.communicate(timeout=delay)
        except subprocess.TimeoutExpired:
            process.kill()
            _, errors = process.communicate()
        if process.returncode == 0:
            break
        assert process.returncode == -signal.SIGKILL, errors
        if not file.exists():
            continue
        with h5py.File(file) as data:
            if data.attrs["complete"] == 1:
                break
        assert_readable(file)
        kills += 1
        command = [program.executable, "resume", str(file), "--quiet"]
    else:
        done = finished(command)
        assert done.returncode == 0, done.stderr
    assert_same(file, expected)
    return kills


def test_killed_at_random_moments_it_goes_on(program, references, tmp_path):
    assert random_kills(program, references, tmp_path, least=20, seed=1) >= 20


@pytest.mark.full
def test_200_kills_at_random_moments(program, references, tmp_path):
    assert random_kills(program, references, tmp_path, least=200, seed=2) >= 200


def random_kills(program: Program, references, folder: Path, least: int, seed: int) -> int:
    """Kill runs of every scene until that many were killed unfinished; print nothing unless one fails."""
    chance = random.Random(seed)
    kills = 0
    names = list(SCENES)
    for i in range(3 * least):
        if kills >= least:
            break
        name = names[i % len(names)]
        file = folder / f"{i}.h5"
        kills += kill_and_resume(program, name, file, references(name), [chance.uniform(0.0, 0.3) for _ in range(3)])
        for left in folder.glob(f"{i}.h5*"):
            left.unlink()
    return kills


@pytest.fixture(scope="module")
def shim(tmp_path_factory) -> Path:
    """A library that kills at a call of the system: see tests/faults/shim.c."""
    return compiled_shim(tmp_path_factory.mktemp("shim"))


def run_with_shim(program: Program, shim: Path, file: Path, fault: str = "") -> subprocess.CompletedProcess[str]:
    """A run that flushes as often as it can."""
    environment = {
        "LD_PRELOAD": str(shim),
        "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0",
        "FAULT_DIR": str(file.parent),
        "FAULT": fault,
        "FAULT_LOG": str(log_of(file)),
    }
    return finished(program.command(SCENES["radau9"], file, "output.flush_seconds=0.0"), env=environment)


def log_of(file: Path) -> Path:
    return file.parent.with_suffix(".log")


@pytest.fixture(scope="module")
def writes(program, shim, tmp_path_factory) -> dict[str, int]:
    """How often a run writes to its file itself, and how often its children do."""
    file = tmp_path_factory.mktemp("writes") / "x.h5"
    done = run_with_shim(program, shim, file)
    assert done.returncode == 0, done.stderr
    calls = [line.split() for line in log_of(file).read_text().splitlines()]
    count = {who: sum(call[0] == who and call[3] == "pwrite" for call in calls) for who in ("parent", "child")}
    assert min(count.values()) > 100
    return count


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
def test_killed_in_the_middle_of_a_write(program, shim, writes, references, tmp_path, share):
    """A write to the file is the last thing that the process does."""
    file = tmp_path / "x.h5"
    write = round(share * writes["parent"])
    done = run_with_shim(program, shim, file, f"kill:parent:pwrite@{write}")
    # A machine that is slower than a moment ago writes less often: then an earlier write.
    while done.returncode == 0 and write > 0.3 * writes["parent"]:
        file.unlink()
        write = round(0.8 * write)
        done = run_with_shim(program, shim, file, f"kill:parent:pwrite@{write}")
    assert done.returncode == -signal.SIGKILL, done.stderr
    # The first writes are to a file that has not got its name; how many there are in all depends on the machine's pace.
    if share <= 0.01 or share >= 0.3:
        assert file.exists() == (share >= 0.3)
    if file.exists():
        assert_readable(file)
        assert program.resume(file).returncode == 0
        assert_same(file, references("radau9"))


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 0.5, 0.8])
def test_a_child_killed_in_the_middle_of_a_write_does_no_harm(program, shim, writes, references, tmp_path, share):
    """The process writes again what its child writes to be safe from a kill."""
    file = tmp_path / "x.h5"
    done = run_with_shim(program, shim, file, f"kill:child:pwrite@{round(share * writes['child'])}")
    assert (done.returncode, done.stderr) == (0, "")
    assert_same(file, references("radau9"))


# Files that must not be resumed.


@pytest.fixture(scope="module")
def stopped(program, tmp_path_factory) -> Path:
    """A run that was stopped at its wall limit."""
    file = tmp_path_factory.mktemp("stopped") / "x.h5"
    done = program.run(SCENES["radau9"], file, "output.wall_limit=0.05")
    assert done.returncode == STOPPED, done.stderr
    return file


@pytest.fixture(params=["stopped", "killed"])
def copied(stopped, tmp_path, request) -> Path:
    """A copy with its checkpoint; that of a killed run does not know the whole file."""
    for path in (stopped, checkpoint_of(stopped)):
        shutil.copy(path, tmp_path)
    file = tmp_path / stopped.name
    if request.param == "killed":
        changed(file, without_seal)
        changed(checkpoint_of(file), killed)
    return file


def assert_refused(done: subprocess.CompletedProcess[str], *words: str) -> None:
    assert done.returncode == FILE_ERROR, done
    assert done.stderr.startswith("dynstiction: ")
    assert done.stderr.count("\n") == 1
    for word in words:
        assert word in done.stderr


def after(data: bytes, name: bytes) -> int:
    """Where the value of a line of the checkpoint begins."""
    return data.index(b"\n" + name + b" ") + len(name) + 2


def state(data: bytes) -> int:
    return data.index(b"\n", after(data, b"state")) + 1


DAMAGED_CHECKPOINTS: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda data: b"",
    "first byte missing": lambda data: data[1:],
    "last byte missing": lambda data: data[:-1],
    "half": lambda data: data[: len(data) // 2],
    "text only": lambda data: data[: state(data)],
    "one byte more": lambda data: data + b"\n",
    "zeros": lambda data: bytes(len(data)),
    "zeros at the end": lambda data: data[:-1000] + bytes(1000),
    "a word missing": lambda data: data[: state(data)] + data[state(data) + 8 :],
    "line ends of Windows": lambda data: data.replace(b"\n", b"\r\n"),
    "bit in the signature": lambda data: flipped(data, 3),
    "bit in the format": lambda data: flipped(data, data.index(b"\n") - 1),
    "bit in the version": lambda data: flipped(data, after(data, b"version")),
    "bit in the deck's hash": lambda data: flipped(data, after(data, b"deck_sha256")),
    "bit in the run's date": lambda data: flipped(data, after(data, b"created") + 18),
    "bit in the length of the state": lambda data: flipped(data, after(data, b"state")),
    "bit in the first word": lambda data: flipped(data, state(data), 7),
    "bit in the middle": lambda data: flipped(data, len(data) // 2, 3),
    "bit in the last word": lambda data: flipped(data, -80),
    "bit in the digest": lambda data: flipped(data, -2),
    "another format": replaced(rb"format \d+", b"format 1"),
    "another version": replaced(rb"version \S+", b"version 9.9"),
    "another run": replaced(rb"created ....", b"created 1999"),
    "another deck": replaced(rb"\ndeck_sha256 ....", b"\ndeck_sha256 0000"),
    "another deck as used": replaced(rb"(?s)(deck_resolved .*?mass += )0", rb"\g<1>1"),
    "another state": lambda data: signed(data[: state(data)] + flipped(data[state(data) :], 4)),
}


@pytest.mark.parametrize("damage", DAMAGED_CHECKPOINTS)
def test_a_damaged_checkpoint_is_refused(program, copied, damage):
    changed(checkpoint_of(copied), DAMAGED_CHECKPOINTS[damage])
    before = copied.read_bytes()
    assert_refused(program.resume(copied), str(copied))
    assert copied.read_bytes() == before


def test_a_checkpoint_of_another_format_version_deck_or_run_says_both(program, copied):
    original = checkpoint_of(copied).read_bytes()
    for damage, words in {
        "another format": ("format 1", original.splitlines()[0].decode().partition(", ")[2]),
        "another version": ("version 9.9", "this program is version"),
        "another run": ("run begun at 1999", "that begun at 20"),
        "another deck": ("another deck", "SHA-256 0000", original[after(original, b"deck_sha256") :][:64].decode()),
    }.items():
        checkpoint_of(copied).write_bytes(DAMAGED_CHECKPOINTS[damage](original))
        assert_refused(program.resume(copied), *words)


def first_chunk(file: Path, column: str) -> int:
    with h5py.File(file) as data:
        return data[column].id.get_chunk_info(0).byte_offset


def edit(file: Path, change: Callable[[h5py.File], None]) -> None:
    with h5py.File(file, "r+") as data:
        change(data)


def shorten(data: h5py.File) -> None:
    data["time_series/u_y"].resize((1,))


def exchange(data: h5py.File) -> None:
    data.move("time_series/u_x", "time_series/old")
    data.move("time_series/u_y", "time_series/u_x")
    data.move("time_series/old", "time_series/u_y")


def exchange_rows(data: h5py.File) -> None:
    column = data["time_series/u_x"]
    column[3], column[67] = column[67], column[3]


def make_matrix(data: h5py.File) -> None:
    del data["time_series/psi"]
    data["time_series/psi"] = np.zeros((10, 10))


def make_number(data: h5py.File) -> None:
    data.attrs["deck_sha256"] = 1.0


def forget_hash(data: h5py.File) -> None:
    del data.attrs["deck_sha256"]


def forget_deck(data: h5py.File) -> None:
    del data["deck/resolved"]


def forget_column(data: h5py.File) -> None:
    del data["time_series/w_x"]


def forget_events(data: h5py.File) -> None:
    del data["events"]


def claim_complete(data: h5py.File) -> None:
    data.attrs["complete"] = 1


def claim_failure(data: h5py.File) -> None:
    data.attrs["result_code"] = 44


DAMAGED_RESULTS: dict[str, Callable[[Path], None]] = {
    "empty": lambda file: file.write_bytes(b"") and None,
    "text": lambda file: file.write_text("no HDF5 file") and None,
    "half": lambda file: os.truncate(file, file.stat().st_size // 2),
    "last byte missing": lambda file: os.truncate(file, file.stat().st_size - 1),
    "signature": lambda file: changed(file, lambda data: flipped(data, 1)),
    "length in the superblock": lambda file: changed(file, lambda data: flipped(data, 43)),
    "root group": lambda file: changed(file, lambda data: flipped(data, 65, 5)),
    "first block of zeros": lambda file: changed(file, lambda data: bytes(4096) + data[4096:]),
    "bit in the deck": lambda file: changed(file, lambda data: flipped(data, data.index(b"&scene") + 3)),
    "bit in a column": lambda file: changed(file, lambda data: flipped(data, first_chunk(file, "time_series/w_y") + 800)),
    "a column's first rows zero": lambda file: changed(file, partial(zeroed, place=first_chunk(file, "time_series/X"))),
    "bit in the events": lambda file: changed(file, lambda data: flipped(data, first_chunk(file, "events/kind") + 5)),
    "column shortened": lambda file: edit(file, shorten),
    "columns exchanged": lambda file: edit(file, exchange),
    "rows exchanged": lambda file: edit(file, exchange_rows),
    "column of two dimensions": lambda file: edit(file, make_matrix),
    "column missing": lambda file: edit(file, forget_column),
    "events missing": lambda file: edit(file, forget_events),
    "deck missing": lambda file: edit(file, forget_deck),
    "hash missing": lambda file: edit(file, forget_hash),
    "hash a number": lambda file: edit(file, make_number),
    "complete": lambda file: edit(file, claim_complete),
    "solver gave up": lambda file: edit(file, claim_failure),
}


def zeroed(data: bytes, place: int) -> bytes:
    return data[:place] + bytes(2000) + data[place + 2000 :]


def test_any_bit_of_a_stopped_run_counts(program, stopped, tmp_path):
    chance = random.Random(3)
    for path in (stopped, checkpoint_of(stopped)):
        shutil.copy(path, tmp_path)
    file = tmp_path / stopped.name
    whole = file.read_bytes()
    for _ in range(50):
        file.write_bytes(flipped(whole, chance.randrange(len(whole)), chance.randrange(8)))
        assert_refused(program.resume(file), "changed or damaged")
    file.write_bytes(whole)
    assert program.resume(file).returncode in (0, STOPPED)


def bends(whole: bytes, structure: list[int], chance: random.Random) -> bytes:
    """The file with damage in what describes its data: one of the kinds that disks and careless programs make."""
    bent = bytearray(whole)
    place, length = chance.choice(structure), chance.choice((1, 8, 64, 512, 4096))
    kind = chance.choice(("flip", "flip", "flips", "zeros", "noise", "another address", "another place", "cut"))
    if kind == "flip":
        bent[place] ^= 1 << chance.randrange(8)
    elif kind == "flips":
        for _ in range(chance.choice((3, 30))):
            bent[chance.choice(structure)] ^= 1 << chance.randrange(8)
    elif kind == "zeros":
        bent[place : place + length] = bytes(length)
    elif kind == "noise":
        bent[place : place + length] = chance.randbytes(length)
    elif kind == "another address":
        bent[place // 8 * 8 :][:8] = chance.choice(structure).to_bytes(8, "little")
    elif kind == "another place":
        source = chance.choice(structure)
        bent[place : place + length] = whole[source : source + length]
    else:
        del bent[place:]
    return bytes(bent[: len(whole)])


def bytes_of_structure(file: Path) -> list[int]:
    """Where a file describes its data, not where the data are; without long stretches of zeros."""
    whole = file.read_bytes()
    data: set[int] = set()
    with h5py.File(file) as content_:
        for group in ("time_series", "events"):
            for column in content_[group].values():
                for i in range(column.id.get_num_chunks()):
                    chunk = column.id.get_chunk_info(i)
                    data.update(range(chunk.byte_offset // 64, (chunk.byte_offset + chunk.size) // 64))
    blocks = (64 * i for i in range(len(whole) // 64) if i not in data)
    return [place for block in blocks if any(whole[block : block + 64]) for place in range(block, block + 64)]


@pytest.mark.parametrize("count", [40, pytest.param(1000, marks=pytest.mark.full)])
def test_damage_of_a_killed_run_is_refused_or_does_no_harm(program, references, stopped, tmp_path, count):
    """HDF5 itself crashes, hangs or reads other numbers on some of these files; the last part of the result is written again."""
    file = tmp_path / "x.h5"
    whole, checkpoint = without_seal(stopped.read_bytes()), checkpoint_of(stopped).read_bytes()
    structure = bytes_of_structure(stopped)
    tally = {0: 0, FILE_ERROR: 0}
    for seed in range(count):
        file.write_bytes(bends(whole, structure, random.Random(seed)))
        checkpoint_of(file).write_bytes(killed(checkpoint))
        done = program.resume(file, timeout=20)
        # On a busy machine the limit of the run is met again.
        while done.returncode == STOPPED:
            done = program.resume(file, timeout=20)
        assert done.returncode in tally, (seed, done)
        tally[done.returncode] += 1
        if done.returncode == 0:
            assert_same(file, references("radau9"))
            assert file.read_bytes().endswith(b"\n")
        else:
            assert_refused(done, str(file), "run the deck again")
        assert {path.name for path in tmp_path.iterdir()} <= {file.name, checkpoint_of(file).name}
    assert min(tally.values()) > count / 20


@pytest.mark.parametrize("damage", DAMAGED_RESULTS)
def test_a_damaged_result_file_is_refused(program, copied, damage):
    DAMAGED_RESULTS[damage](copied)
    before = copied.read_bytes(), checkpoint_of(copied).read_bytes()
    assert_refused(program.resume(copied), str(copied))
    assert (copied.read_bytes(), checkpoint_of(copied).read_bytes()) == before


def test_what_is_not_there_is_refused(program, copied, tmp_path):
    assert_refused(program.resume(tmp_path / "no.h5"), "no such file")
    assert_refused(program.resume(tmp_path), "folder")
    checkpoint_of(copied).unlink()
    assert_refused(program.resume(copied), str(checkpoint_of(copied)), "no such file")
    checkpoint_of(copied).mkdir()
    assert_refused(program.resume(copied), "folder")


def test_a_complete_run_is_refused(program, tmp_path):
    file = tmp_path / "x.h5"
    assert program.run(SCENES["radau9"], file, "scene.t_end=0.1").returncode == 0
    assert_refused(program.resume(file), "the run is complete")


def test_a_solver_that_gave_up_is_refused(program, tmp_path):
    file = tmp_path / "x.h5"
    done = program.run(SCENES["radau9"], file, "integrator.max_steps=100")
    assert done.returncode == 4
    assert not checkpoint_of(file).exists()
    assert_refused(program.resume(file), "gave up", "max_steps = 100")


@pytest.mark.skipif(os.environ.get("HDF5_USE_FILE_LOCKING", "TRUE") != "TRUE", reason="HDF5 does not lock files")
def test_a_locked_file_is_refused(program, copied):
    before = copied.read_bytes()
    with copied.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert_refused(program.resume(copied), "locked", "close the other program")
    assert copied.read_bytes() == before


def test_a_run_under_way_is_not_resumed(program, tmp_path):
    file = tmp_path / "x.h5"
    process = program.start(SCENES["radau9"], file, *ENDLESS)
    try:
        wait_for(file.exists, str(file))
        assert_refused(program.resume(file), "locked")
        assert process.poll() is None
    finally:
        process.kill()
        process.communicate(timeout=60)


# Checkpoints that cannot be written.


def test_a_checkpoint_that_fails_keeps_the_one_before(program, references, tmp_path):
    file = tmp_path / "x.h5"
    process = program.start(SCENES["radau5"], file, "output.checkpoint_interval=0.05")
    wait_for(lambda: file.exists() and file.stat().st_size > 10_000, str(file))
    kept = tmp_path / "kept"
    while not checkpoint_of(file).is_dir():
        # The next checkpoint may come in between.
        with contextlib.suppress(FileNotFoundError):
            checkpoint_of(file).rename(kept)
        with contextlib.suppress(FileExistsError):
            (checkpoint_of(file) / "something").mkdir(parents=True)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == FILE_ERROR, errors
    assert "cannot write the checkpoint" in errors
    with h5py.File(file) as data:
        assert (data.attrs["complete"], data.attrs["result_code"]) == (0, FILE_ERROR)
    shutil.rmtree(checkpoint_of(file))
    assert {path.name for path in tmp_path.iterdir()} == {file.name, kept.name}
    kept.rename(checkpoint_of(file))
    assert program.resume(file).returncode == 0
    assert_same(file, references("radau5"))


def test_a_run_that_cannot_write_its_first_checkpoint_leaves_nothing(program, tmp_path):
    file = tmp_path / "x.h5"
    checkpoint_of(file).mkdir()
    done = program.run(SCENES["radau9"], file)
    assert_refused(done, "cannot write the checkpoint")
    assert list(tmp_path.iterdir()) == [checkpoint_of(file)]


def test_a_limit_that_is_met_is_not_the_end(program, references, tmp_path):
    """The file-size limit ends the run; with a higher limit it continues."""
    file = tmp_path / "x.h5"
    limit = limited(resource.RLIMIT_FSIZE, 1_500_000)
    process = program.start(SCENES["every step"], file, "output.checkpoint_interval=0.02", preexec_fn=limit)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == FILE_ERROR, errors
    assert "file-size limit" in errors
    assert_readable(file)
    assert_refused(program.resume(file, preexec_fn=limit), "file-size limit")
    assert_readable(file)
    assert program.resume(file).returncode == 0
    assert_same(file, references("every step"))


def test_a_disk_that_was_full(program, references, tmp_path):
    with small_disk(tmp_path / "disk", "1m") as grow:
        file = tmp_path / "disk" / "x.h5"
        done = program.run(SCENES["every step"], file, "output.checkpoint_interval=0.02")
        assert done.returncode == FILE_ERROR
        assert "disk is full" in done.stderr
        assert_readable(file)
        grow("40m")
        assert program.resume(file).returncode == 0
        assert_same(file, references("every step"))


def test_a_folder_that_vanishes(program, tmp_path):
    folder = tmp_path / "vanishing"
    folder.mkdir()
    process = program.start(SCENES["radau9"], folder / "x.h5", *ENDLESS, "output.checkpoint_interval=0.1")
    wait_for((folder / "x.h5").exists, "x.h5")
    shutil.rmtree(folder)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == FILE_ERROR
    assert "removed or renamed" in errors


def test_overwriting_drops_the_checkpoint_of_the_run_before(program, copied):
    done = program.run(SCENES["radau13"], copied, "scene.t_end=0.1")
    assert_refused(done, "--overwrite")
    assert checkpoint_of(copied).exists()
    command = program.command(SCENES["radau13"], copied, "scene.t_end=0.1")
    assert finished([*command, "--overwrite"]).returncode == 0
    assert not checkpoint_of(copied).exists()
