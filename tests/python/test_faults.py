"""Nothing computed is lost, and no file of others is touched, whatever call of the system fails or wherever a kill strikes."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "faults"))

import faults
from faults import CLOCK, OPERATIONS, RESULT, RESUME, RUN, Laboratory
from program import Call, Ended, Program, Running, content, is_complete, is_sealed, snapshot
from programs import DONE, FILE_ERROR, STOPPED

pytestmark = pytest.mark.deck

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
        folders.append(folder)
        return folder

    yield begun
    lab.program.end_all()
    for folder in folders:
        shutil.rmtree(folder)


@pytest.fixture
def expected(lab) -> dict[str, tuple]:
    return lab.reference(OPERATIONS["run"])


def assert_done(ended: Ended, folder: Path, expected: dict[str, tuple]) -> None:
    assert ended.status == DONE, ended.text
    assert_right(folder, expected)


def assert_right(folder: Path, expected: dict[str, tuple]) -> None:
    assert is_complete(folder / RESULT)
    assert is_sealed(folder / RESULT)
    assert content(folder / RESULT) == expected
    assert not (folder / f"{RESULT}.part").exists()


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
    """So many of them, the first and the last among them; none of none."""
    return [] if not calls else [calls[round(i * (len(calls) - 1) / (count - 1))] for i in range(count)]


# A share of the whole proof.


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


def test_the_harness_finds_a_file_that_is_not_whole(lab, monkeypatch):
    """A file with one wrong byte behind the program's back."""
    run = lab.program.run

    def spoiled(folder: Path, *command: str, **how: object) -> Ended:
        ended = run(folder, *command, **how)
        if (folder / RESULT).exists() and ended.hits:
            data = bytearray((folder / RESULT).read_bytes())
            data[-100] ^= 1
            (folder / RESULT).write_bytes(data)
        return ended

    cases = [case for case in lab.cases("run", ["SIGTERM"])]
    monkeypatch.setattr(lab.program, "run", spoiled)
    assert "the file is not whole" in lab.try_case(cases[len(cases) // 2])


# Two programs at once.


@pytest.mark.parametrize("operation", ["resume after a stop", "resume after a kill", "run"])
def test_a_second_program_is_refused_at_any_moment(program, begin, expected, operation):
    """As soon as the first one has its NAME.part, and until its last file has its name."""
    command = OPERATIONS[operation].command
    folder = begin(operation)
    calls = calls_of(program, folder, *command)
    locked = next(i for i, call in enumerate(calls) if call.name == "flock")
    last = max(i for i, call in enumerate(calls) if call.name.startswith(("link", "rename")))
    renamed = [i for i, call in enumerate(calls[:last]) if call.name.startswith(("link", "rename"))]
    between_files = [call for i in renamed for call in calls[i + 1 : i + 4]]
    for call in [*spread(calls[locked + 1 : last], 6), *spread(between_files, 6)]:
        folder = begin(operation)
        run = held(program, folder, *command, at=f"all:{call.all}")
        before = snapshot(folder)
        for second in (RESUME, OVERWRITE) if (folder / RESULT).exists() else (OVERWRITE,):
            assert_refused(program.run(folder, *second), "another process is writing this file")
        assert snapshot(folder) == before
        run.release()
        assert_done(run.wait(), folder, expected)


def test_started_together_one_does_it(program, begin, lab):
    """Two runs of two decks into one name, the first of which is held at one of its first calls."""
    other = faults.Operation(faults.OTHER_RUN)
    for number in (1, 3, 5, 7, 9, 13, 20):
        folder = begin("run")
        first = held(program, folder, *RUN, at=f"all:{number}")
        second = program.run(folder, *faults.OTHER_RUN, fault="TERM:parent:130", clock=CLOCK)
        assert second.status in (STOPPED, FILE_ERROR)
        first.release()
        status = first.wait().status
        assert sorted((status, second.status)) in ([DONE, FILE_ERROR], [FILE_ERROR, STOPPED])
        if second.status == STOPPED:
            assert_done(program.run(folder, *RESUME), folder, lab.reference(other))
        else:
            assert_right(folder, lab.reference(OPERATIONS["run"]))


def test_a_file_that_took_the_name_meanwhile_is_not_changed(program, begin, expected):
    """What was computed is kept, and goes on to the same bits; of a run that had its name once already, it is whole, or was taken with it."""
    folder = begin("run --overwrite")
    (folder / RESULT).rename(folder / "good.h5")
    calls = calls_of(program, folder, *RUN)
    named = [i for i, call in enumerate(calls) if call.name.startswith(("link", "rename"))]
    writing = [call for call in calls[: named[-1]] if call.path.endswith(".part") and set(call.letters) & set("wis")]
    for call in spread(writing, 6):
        run = held(program, folder, *RUN, at=f"all:{call.all}")
        (folder / RESULT).unlink(missing_ok=True)
        shutil.copy(folder / "good.h5", folder / RESULT)
        run.release()
        assert_refused(run.wait(), "another file has taken the name")
        assert (folder / RESULT).read_bytes() == (folder / "good.h5").read_bytes(), call
        kept = folder / f"{RESULT}.kept"
        if not kept.exists():
            assert call not in calls[: named[0]], call
            assert not (folder / f"{RESULT}.part").exists()
            (folder / RESULT).unlink()
            continue
        assert is_sealed(kept)
        if call in calls[: named[0]]:
            program.run(folder, "resume", kept.name, "--quiet", clock=CLOCK)
            assert is_complete(kept) and content(kept) == expected, call
        kept.unlink()
        (folder / RESULT).unlink()


def test_without_locks_of_the_file_system_the_part_keeps_others_out(program, begin, expected):
    for error in ("ENOLCK", "EOPNOTSUPP"):
        folder = begin("run")
        no_locks = f"{error}+:all:flock@1"
        middle = len(calls_of(program, folder, *RUN)) // 3
        run = program.start(folder, *RUN, fault=f"{no_locks};hold:all:{middle}", clock=CLOCK)
        run.wait_for_hold()
        assert_refused(program.run(folder, *OVERWRITE, fault=no_locks), "if no process writes it, remove it")
        run.release(1)
        assert_done(run.wait(), folder, expected)


@pytest.mark.parametrize("closed", ["0", "1", "2", "012"])
@pytest.mark.parametrize("operation", ["resume after a stop", "run"])
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
