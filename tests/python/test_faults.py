"""Nothing computed is lost, and no file of others is touched, whatever call of the system fails or wherever a kill strikes."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "faults"))

import faults
import sequences
from faults import CLOCK, OPERATIONS, RESULT, Laboratory
from program import Call, Ended, Program, Running, content, is_complete, is_sealed, snapshot
from programs import DONE, FILE_ERROR, STOPPED

pytestmark = pytest.mark.deck

RUN = ("run", "run.nml", "-o", RESULT, "--quiet")
RESUME = ("resume", RESULT, "--quiet")
OVERWRITE = (*RUN, "--overwrite")


@pytest.fixture(scope="module")
def program(executable) -> Iterator[Program]:
    with Program(executable.resolve()) as running:
        yield running


@pytest.fixture(scope="module")
def lab(program, tmp_path_factory) -> Iterator[Laboratory]:
    with contextlib.ExitStack() as stack:
        room = faults.room_for_files()
        path = Path(room or tmp_path_factory.getbasetemp()) / f"faults-{os.getpid()}"
        path.mkdir()
        stack.callback(shutil.rmtree, path, ignore_errors=True)
        yield Laboratory(program, path)


@pytest.fixture
def begin(lab) -> Iterator[Callable[[str], Path]]:
    """A new folder in which an operation of faults.py can begin."""
    folders = []

    def begun(operation: str) -> Path:
        folder = lab.folder(operation)
        for name in ("x.h5.checkpoint~", "victim"):
            (folder / name).unlink()
        folders.append(folder)
        return folder

    yield begun
    lab.program.end_all()
    for folder in folders:
        shutil.rmtree(folder)


@pytest.fixture
def expected(lab) -> dict[str, tuple]:
    return lab.reference("run.nml")


def assert_done(ended: Ended, folder: Path, expected: dict[str, tuple]) -> None:
    assert ended.status == DONE, ended.text
    assert_right(folder, expected)


def assert_right(folder: Path, expected: dict[str, tuple]) -> None:
    assert is_complete(folder / RESULT)
    assert is_sealed(folder / RESULT)
    assert content(folder / RESULT) == expected
    names = {path.name for path in folder.glob(f"{RESULT}.*")}
    assert not {name for name in names if name.endswith((".lock", ".checkpoint"))}


def assert_refused(ended: Ended, *words: str) -> None:
    assert ended.status == FILE_ERROR, ended
    assert ended.text.startswith("dynstiction: ")
    assert ended.text.count("\n") == 1
    for word in words:
        assert word in ended.text


def held(program: Program, folder: Path, *command: str, at: str, **settings: object) -> Running:
    """A program that is held at a call."""
    run = program.start(folder, *command, fault=f"hold:{at}", clock=CLOCK, **settings)
    run.wait_for_hold()
    return run


def calls_of(program: Program, folder: Path, *command: str) -> list[Call]:
    """The calls of a command, tried in a copy of the folder."""
    copy = folder.with_name(f"{folder.name}-copy")
    shutil.copytree(folder, copy, symlinks=True)
    ended = program.run(copy, *command, clock=CLOCK, log=True)
    shutil.rmtree(copy)
    return ended.calls


def spread(calls: list[Call], count: int) -> list[Call]:
    """So many of them, the first and the last among them."""
    return [calls[round(i * (len(calls) - 1) / (count - 1))] for i in range(count)]


def changes(calls: list[Call]) -> list[Call]:
    return [call for call in calls if set(call.letters) & set("cwtuRl")]


def named(calls: list[Call]) -> int:
    """Number of the call that gives the result its name, and of its process."""
    return next(call.all for call in calls if call.name in ("link", "linkat", "rename", "renameat2") and call.path.endswith(RESULT))


# Shares of the whole proof.


@pytest.mark.parametrize("name", OPERATIONS)
def test_a_fault_at_any_call_loses_nothing(lab, name):
    """A share; all: python tests/faults/faults.py."""
    cases = list(lab.cases(name, list(faults.KINDS)))
    share = cases[len(name) % 7 :: max(1, len(cases) // 9)]
    results = [(case, lab.try_case(case)) for case in share]
    lines: list[str] = []
    assert faults.report(results, {}, lines.append) == 0, "\n".join(lines)


@pytest.mark.full
def test_faults_at_every_fifth_call_of_everything(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["faults.py", "--every", "5"])
    assert faults.main() == 0


def test_random_lives_end_with_the_same_bits(lab):
    """A share; more: python tests/faults/sequences.py."""
    lives = sequences.Lives(lab)
    results = {seed: sequences.try_sequence(lives, seed) for seed in (f"share-{i}" for i in range(12))}
    assert [(seed, faults, trace) for seed, (faults, trace) in results.items() if faults] == []


@pytest.mark.full
def test_500_random_lives(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["sequences.py", "--count", "500"])
    assert sequences.main() == 0


# A kill, a full disk.


def test_a_killed_resume_can_be_resumed(program, begin, expected):
    folder = begin("resume after a stop")
    for call in spread(changes(calls_of(program, folder, *RESUME)), 6):
        folder = begin("resume after a stop")
        for _ in range(3):
            program.run(folder, *RESUME, fault=f"kill:all:{call.all}", clock=CLOCK)
        ended = program.run(folder, *RESUME)
        if "the run is complete" not in ended.text:
            assert_done(ended, folder, expected)
        assert_right(folder, expected)


def test_a_resume_on_a_full_disk_can_be_resumed(program, begin, expected):
    for more in (0, 512, 2048, 8192, 30000):
        folder = begin("resume after a stop")
        limit = (folder / RESULT).stat().st_size + more
        ended = program.run(folder, *RESUME, clock=CLOCK, FAULT_FSIZE=limit)
        if ended.status != DONE:
            assert_refused(ended, "limit")
            with h5py.File(folder / RESULT) as file:
                assert len(file["time_series/time"]) > 0
        ended = program.run(folder, *RESUME)
        if "the run is complete" not in ended.text:
            assert_done(ended, folder, expected)


@pytest.mark.parametrize("word", ["HUP", "TERM", "INT", "USR1"])
def test_a_signal_stops_with_a_checkpoint(program, begin, expected, word):
    folder = begin("run")
    number = len(calls_of(program, folder, *RUN)) // 3
    ended = program.run(folder, *RUN, fault=f"{word}:parent:{number}", clock=CLOCK)
    assert ended.status == STOPPED
    assert f"SIG{word}" in ended.text
    assert_done(program.run(folder, *RESUME), folder, expected)


def test_nothing_stays_of_runs_killed_at_their_beginning(program, begin, expected):
    folder = begin("run")
    before = set(snapshot(folder))
    calls = calls_of(program, folder, *RUN)
    early = [call for call in changes(calls) if call.all <= named(calls) and call.who == "parent"]
    for call in spread(early, 8):
        program.run(folder, *RUN, fault=f"kill:parent:{call.own}", clock=CLOCK)
    assert_done(program.run(folder, *RUN, clock=CLOCK), folder, expected)
    assert set(snapshot(folder)) == before | {RESULT}


# Two programs at once.


@pytest.mark.parametrize("operation", ["resume after a stop", "resume after a kill", "run"])
def test_a_second_program_is_refused_at_any_moment(program, begin, expected, operation):
    """As the holder of the name is anywhere between its lock and its end, also within a flush and between rename and open."""
    command = OPERATIONS[operation].command
    folder = begin(operation)
    calls = calls_of(program, folder, *command)
    first = next((c.all for c in calls if c.path.endswith(".lock") and set(c.letters) & set("wi")), 8) + 1
    last = next((call.all for call in reversed(calls) if call.path.endswith(".lock")), len(calls)) - 3
    between = [call for call in calls if first <= call.all < last and call.letters not in ("?", "W")]
    for call in spread(between, 7):
        folder = begin(operation)
        run = held(program, folder, *command, at=f"all:{call.all}")
        before = snapshot(folder)
        for second in (RESUME, OVERWRITE) if (folder / RESULT).exists() else (OVERWRITE,):
            assert_refused(program.run(folder, *second), "process", str(run.process), os.uname().nodename)
        assert program.run(folder, *RUN).status == FILE_ERROR
        assert snapshot(folder) == before
        run.release()
        assert_done(run.wait(), folder, expected)


def test_of_two_runs_of_one_name_the_loser_changes_nothing(program, begin, expected):
    """A second run leaves the checkpoint of the first as it is, so that this one can be resumed when it is killed."""
    for second in (("run", "other.nml", *RUN[2:]), ("run", "other.nml", *OVERWRITE[2:])):
        folder = begin("run")
        middle = len(calls_of(program, folder, *RUN)) * 2 // 3
        first = held(program, folder, *RUN, at=f"all:{middle}")
        assert program.run(folder, *second).status == FILE_ERROR
        first.kill_group()
        first.release()
        first.wait()
        assert_done(program.run(folder, *RESUME), folder, expected)


def test_started_together_one_does_it(program, begin, lab):
    """Two runs of two decks into one name: who is killed as the winner can be resumed."""
    for number in (1, 5, 9, 13, 17, 25, 40, 60):
        folder = begin("run")
        first = held(program, folder, *RUN, at=f"all:{number}")
        second = program.run(folder, "run", "other.nml", *RUN[2:], fault="TERM:parent:130", clock=CLOCK)
        assert second.status in (STOPPED, FILE_ERROR)
        first.release()
        status = first.wait().status
        assert sorted((status, second.status)) in ([DONE, FILE_ERROR], [FILE_ERROR, STOPPED])
        if second.status == STOPPED:
            assert_done(program.run(folder, *RESUME), folder, lab.reference("other.nml"))
        else:
            assert_right(folder, lab.reference("run.nml"))


def test_a_reader_does_not_open_the_way_for_another_writer(program, begin, expected):
    """A reader that opens the file during a flush keeps HDF5 from locking it again; the run keeps its own lock."""
    folder = begin("run")
    calls = calls_of(program, folder, *RUN)
    forks = [call.all for call in calls if call.name == "fork" and call.all > named(calls)]
    second = (forks[0] + forks[1]) // 2
    run = program.start(folder, *RUN, fault=f"hold:all:{forks[0]};hold:all:{second}", clock=CLOCK)
    run.wait_for_hold()
    with h5py.File(folder / RESULT):
        run.release(0)
        run.wait_for_hold(2)
    assert_refused(program.run(folder, *OVERWRITE), str(run.process))
    run.release(1)
    assert_done(run.wait(), folder, expected)


def test_without_locks_of_the_file_system_the_lock_file_keeps_others_out(program, begin, expected):
    for error in ("ENOLCK", "EOPNOTSUPP"):
        folder = begin("run")
        no_locks = f"{error}+:all:flock@1;{error}+:all:lockf@1;{error}+:all:fcntl@1"
        middle = len(calls_of(program, folder, *RUN)) // 2
        without: dict[str, object] = {"HDF5_USE_FILE_LOCKING": "FALSE"}
        run = program.start(folder, *RUN, fault=f"{no_locks};hold:all:{middle}", clock=CLOCK, **without)
        run.wait_for_hold()
        for second in (RESUME, OVERWRITE):
            assert_refused(program.run(folder, *second, fault=no_locks, **without), str(run.process))
        run.kill_group()
        run.release(3)
        run.wait()
        assert_done(program.run(folder, *RESUME, fault=no_locks, **without), folder, expected)


# Files of others.


def test_files_of_others_beside_the_result_are_kept(program, begin):
    folder = begin("run")
    (folder / "model.checkpoint").write_text("precious\n")
    (folder / "model.checkpoint~").write_text("precious\n")
    before = snapshot(folder)
    command = ("run", "run.nml", "-o", "model", "--quiet")
    assert_refused(program.run(folder, *command), "model.checkpoint")
    assert snapshot(folder) == before
    (folder / "model.checkpoint").unlink()
    (folder / "model.lock").write_text("precious\n")
    before = snapshot(folder)
    assert_refused(program.run(folder, *command), "model.lock")
    assert snapshot(folder) == before
    (folder / "model.lock").unlink()
    assert program.run(folder, *command).status == DONE
    assert (folder / "model.checkpoint~").read_text() == "precious\n"


def test_a_file_that_took_the_name_meanwhile_is_not_changed(program, begin):
    folder = begin("run --overwrite")
    (folder / RESULT).rename(folder / "good.h5")
    calls = calls_of(program, folder, *RUN)
    written = [call.all for call in calls if set(call.letters) & set("wi") and ".checkpoint" not in call.path]
    last = max(written)
    for call in spread([call for call in calls if named(calls) + 9 < call.all <= last - 9], 8):
        run = held(program, folder, *RUN, at=f"all:{call.all}")
        (folder / RESULT).unlink()
        shutil.copy(folder / "good.h5", folder / RESULT)
        run.release()
        ended = run.wait()
        assert (folder / RESULT).read_bytes() == (folder / "good.h5").read_bytes(), call
        assert_refused(ended)
        (folder / RESULT).unlink()
        (folder / f"{RESULT}.checkpoint").unlink(missing_ok=True)


def test_overwrite_replaces_results_of_this_program_only(program, begin):
    folder = begin("run")
    points = folder / "q.h5"
    with h5py.File(points, "w") as file:
        file["drive.velocity"] = [1e-3, 2e-3]
    (folder / "q.nml").write_text(faults.SCENE.replace("file = 'low_frequency.h5'", "") + "&sweep points = 'q.h5' /\n")
    (folder / "foreign.h5").write_bytes(points.read_bytes())
    before = snapshot(folder)
    for deck, output in (("q.nml", ()), ("run.nml", ("-o", "foreign.h5")), ("sweep.nml", ("-o", "foreign.h5"))):
        assert_refused(program.run(folder, "run", deck, *output, "--overwrite", "--quiet"))
        assert snapshot(folder) == before


def test_links_under_names_of_scratch_files_are_not_followed(program, begin, expected):
    folder = begin("run")
    victim = folder / "victim"
    victim.write_text("precious\n")
    run = held(program, folder, *RUN, at="all:1")
    scratch = [folder / name for name in (f"{RESULT}.checkpoint~", f"{RESULT}.{run.process}.part")]
    for path in scratch:
        path.symlink_to("victim")
    run.release()
    assert_done(run.wait(), folder, expected)
    assert victim.read_text() == "precious\n"
    assert all(path.is_symlink() for path in scratch)


def test_files_called_like_shards_are_kept(program, begin):
    folder = begin("sweep")
    victim, foreign = folder / "victim", folder / f"{RESULT}.shard-123456"
    victim.write_text("precious\n")
    foreign.write_text("precious\n")
    (folder / f"{RESULT}.shard-000007").symlink_to("victim")
    before = snapshot(folder)
    program.run(folder, "run", "sweep.nml", "-o", RESULT, "--quiet", "--overwrite")
    after = snapshot(folder)
    assert {name: after.get(name) for name in before} == before


def test_a_scratch_name_of_another_host_is_not_taken(program, begin, expected):
    """Two hosts or containers have the same process numbers."""
    folder = begin("run")
    other = folder / f"{RESULT}.7.part"
    other.write_text("of a process 7 elsewhere\n")
    assert_done(program.run(folder, *RUN, clock=CLOCK, FAULT_PID=7), folder, expected)
    assert other.read_text() == "of a process 7 elsewhere\n"


# Missing descriptors and processes.


@pytest.mark.parametrize("closed", ["0", "1", "2", "012"])
@pytest.mark.parametrize("operation", ["resume after a stop", "resume after a kill", "run"])
def test_without_standard_descriptors_it_does_the_same(program, begin, expected, operation, closed):
    folder = begin(operation)
    command = OPERATIONS[operation].command
    middle = len(calls_of(program, folder, *command)) * 2 // 3
    run = held(program, folder, *command, at=f"all:{middle}", FAULT_CLOSE=closed)
    for number in closed:
        with contextlib.suppress(FileNotFoundError):
            assert str(folder) not in os.readlink(f"/proc/{run.process}/fd/{number}")
    run.release()
    assert_done(run.wait(), folder, expected)


@pytest.mark.parametrize("operation", ["resume after a stop", "resume after a kill", "run"])
def test_without_child_processes_it_works_or_says_so(program, begin, expected, operation):
    folder = begin(operation)
    command = OPERATIONS[operation].command
    ended = program.run(folder, *command, fault="EAGAIN+:all:fork@1", clock=CLOCK)
    if ended.status != DONE:
        assert_refused(ended, "process")
        assert "damaged" not in ended.text
        ended = program.run(folder, *RESUME)
    assert_done(ended, folder, expected)
