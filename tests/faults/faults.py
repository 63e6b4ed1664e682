"""Whatever call of the system fails, and wherever a kill strikes: nothing computed is lost, no other file is touched.

    python tests/faults/faults.py                       # every fault at every call of every operation
    python tests/faults/faults.py --every 20            # at every 20th call
    python tests/faults/faults.py --operation run --kind kill --call 123

Each case is an operation (a run, a resume, a sweep ...) in a folder with files of others, and one fault at its n-th call of the
system. Checked is how the operation ends and what it leaves; then it is continued without faults, and must end with the bits of
an operation without faults. Clocks are those of the shim, so that calls are the same each time; see shim.c.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from program import Call, Ended, Program, content, fault_of_unfinished, is_complete, is_sealed, snapshot
from programs import DONE, FILE_ERROR, INPUTS, STOPPED, executable

DECK_ERROR = 2
CLOCK = 0.05
RESULT = "x.h5"
SHARE, LAST_SHARE = "x.1-of-2.h5", "x.2-of-2.h5"
BYSTANDERS = ("x.h5~", "x.h5.bak", "x.h5.lock", "x.h5.checkpoint", "x.h5.part~", "x.2-of-2.h5.bak", "x.3-of-2.h5x", "x", "x.part")
LINKS = {"x.h5.old": "victim", "y.h5": "x.h5.bak"}
SCENE = (INPUTS / "low_frequency.nml").read_text().replace("t_end = 10.0", "t_end = 1.0")
SCENE = SCENE.replace("interval = 1.0e-3", "fields = 'u_x', 'sticking', interval = 1.0e-2")
DECK = SCENE.replace("interval =", "checkpoint_interval = 0.7, interval =")
DECK = DECK.replace("rtol = 1.0e-6", "rtol = 1.0e-6, step_max = 5.0e-3")
OTHER_DECK = DECK.replace("misalignment_deg = 1.0", "misalignment_deg = 2.0")
GRID = """
&sweep
  parameter = 'system.misalignment_deg', 'drive.velocity'
  first = 1.0, 1.0e-3, last = 2.0, 2.0e-3, count = 3, 2
"""
DECKS = {
    "run.nml": DECK,
    "other.nml": OTHER_DECK,
    "sweep.nml": DECK + GRID + "/\n",
    "series.nml": DECK + GRID + "  keep = 'series'\n/\n",
}


# The calls by which a file is removed: it is examined first, and a file that may be a stranger's is not removed.
REMOVING = {"unlink", "remove", "statx", "lstat"}

# What may happen to a call: the fault of the shim, and the calls (by the letters of the log) whose failure is not yet covered by others.
CHANGES = "cowtusxlki"
KINDS: dict[str, tuple[str, str]] = {
    "kill": ("kill:all", CHANGES),
    "ENOSPC": ("ENOSPC:all", "cws"),
    "ENOSPC from there on": ("ENOSPC+:all", "cws"),
    "EDQUOT from there on": ("EDQUOT+:all", "cws"),
    "EIO": ("EIO:all", "cOrwsxtui"),
    "EIO from there on": ("EIO+:all", "cOrwsxtui"),
    "EINTR": ("EINTR:all", "OrwsxtlWi"),
    "EROFS from there on": ("EROFS+:all", "cowtui"),
    "EACCES": ("EACCES:all", "cOu?"),
    "EBADF": ("EBADF:all", "rwsxtli"),
    "short write": ("short:all", "wi"),
    "EMFILE": ("EMFILE:all", "O"),
    "no hard links": ("EPERM+:all", "k"),
    "no locks (ENOLCK)": ("ENOLCK+:all", "l"),
    "no locks (EOPNOTSUPP)": ("EOPNOTSUPP+:all", "l"),
    "SIGTERM": ("TERM:parent", CHANGES + "O?r"),
    "SIGHUP": ("HUP:parent", CHANGES + "O?r"),
    "SIGINT": ("INT:parent", CHANGES + "O?r"),
    "SIGUSR1": ("USR1:parent", CHANGES + "O?r"),
}
# Only the first one differs from the others: a file system has no locks or links at all.
ONCE = ("no hard links", "no locks (ENOLCK)", "no locks (EOPNOTSUPP)")
SIGNALS = {"SIGTERM": -15, "SIGHUP": -1, "SIGINT": -2, "SIGUSR1": -10}
SECOND = ("kill", "ENOSPC from there on", "EIO", "SIGTERM")
"""Faults that strike again when the operation is done again."""


def write_decks(folder: Path) -> None:
    for name, text in DECKS.items():
        (folder / name).write_text(text)


def write_bystanders(folder: Path) -> None:
    """Files of others, with names like those of a result."""
    for name in (*BYSTANDERS, "victim"):
        (folder / name).write_text(f"precious {name}\n")
    for name, target in LINKS.items():
        (folder / name).symlink_to(target)


OTHERS = {*BYSTANDERS, *LINKS, "victim", *DECKS}


Command = tuple[str, ...]


@dataclass(frozen=True)
class Operation:
    """A command in a folder that is prepared by other commands, each with the fault that ends it, and at which part of its calls."""

    command: Command
    prepared: tuple[tuple[Command, str, float], ...] = ()
    stop: float = 0.0  # at which part of its calls it is itself asked to stop
    status: int = DONE
    file: str = RESULT
    again: Command = ()  # how a user continues, besides `resume` of a run

    @property
    def reference(self) -> Command:
        """The command that gives the same without a fault."""
        whole = RUN if self.command[0] == "resume" else ("run", *self.command[1:])
        return tuple(word for word in whole if word not in ("--overwrite", "--retry"))


RUN = ("run", "run.nml", "-o", RESULT, "--quiet")
RESUME = ("resume", RESULT, "--quiet")
STOP_RUN, STOP_RESUME = (RUN, "TERM:parent", 0.5), (RESUME, "TERM:parent", 0.3)
KILL_RUN, KILL_RESUME = (RUN, "kill:parent", 0.7), (RESUME, "kill:parent", 0.5)
OTHER_RUN = ("run", "other.nml", "-o", RESULT, "--quiet")
OTHER, OTHER_STOPPED = (OTHER_RUN, "", 1.0), (OTHER_RUN, *STOP_RUN[1:])
SWEEP = ("run", "sweep.nml", "-o", RESULT, "--quiet")
SERIES = ("run", "series.nml", "-o", RESULT, "--quiet")
FIRST, LAST = ((*SWEEP, "--share", share) for share in ("1/2", "2/2"))
MERGE = ("merge", *SWEEP[1:])
OPERATIONS = {
    "run": Operation(RUN),
    "run, name is taken": Operation(RUN, (OTHER,), status=FILE_ERROR),
    "run --overwrite": Operation((*RUN, "--overwrite"), (OTHER,)),
    "run --overwrite of a stopped run": Operation((*RUN, "--overwrite"), (OTHER_STOPPED,)),
    "run, stopped": Operation(RUN, stop=0.5, status=STOPPED),
    "run after a kill": Operation((*RUN, "--overwrite"), (KILL_RUN,)),
    "resume after a stop": Operation(RESUME, (STOP_RUN,)),
    "resume after a kill": Operation(RESUME, (KILL_RUN,)),
    "resume, stopped": Operation(RESUME, (STOP_RUN,), stop=0.3, status=STOPPED),
    "resume after resume and stop": Operation(RESUME, (STOP_RUN, STOP_RESUME)),
    "resume after resume and kill": Operation(RESUME, (STOP_RUN, KILL_RESUME)),
    "sweep": Operation(SWEEP, again=SWEEP),
    "sweep with series": Operation(SERIES, again=SERIES),
    "sweep after a kill": Operation(SWEEP, ((SWEEP, "kill:parent", 0.7),), again=SWEEP),
    "sweep --retry after a stop": Operation((*SWEEP, "--retry"), ((SWEEP, "TERM:parent", 0.4),), again=SWEEP),
    "share": Operation(FIRST, file=SHARE, again=FIRST),
    "merge": Operation(MERGE, ((FIRST, "", 1.0), (LAST, "", 1.0)), again=MERGE),
    "merge of a part": Operation(MERGE, ((FIRST, "", 1.0),), status=STOPPED, again=MERGE),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    operation: str
    kind: str
    call: int
    name: str = ""
    second: str = ""  # the fault that strikes when it is done again


class Laboratory:
    """Operations with faults, each in a new folder."""

    def __init__(self, program: Program, room: Path) -> None:
        self.program, self.room = program, room
        self.prepared: dict[tuple, Path] = {}
        self.expected: dict[Command, dict[str, tuple]] = {}
        self.stops: dict[str, str] = {}
        self.count = 0

    def folder(self, name: str) -> Path:
        """A new folder in which the operation can begin."""
        operation = OPERATIONS[name]
        if operation.prepared not in self.prepared:
            folder = self.room / f"prepared-{len(self.prepared)}"
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            write_decks(folder)
            for command, fault, part in operation.prepared:
                self.prepare(folder, command, fault, part)
            self.prepared[operation.prepared] = folder
        self.count += 1
        folder = self.room / f"case-{self.count}"
        shutil.copytree(self.prepared[operation.prepared], folder, symlinks=True)
        write_bystanders(folder)
        return folder

    def prepare(self, folder: Path, command: Command, fault: str, part: float) -> None:
        """Run a command until it is stopped or killed."""
        at = f"{fault}:{self.call_at(folder, command, part)}" if fault else ""
        ended = self.program.run(folder, *command, fault=at, clock=CLOCK)
        wanted = -9 if "kill" in fault else STOPPED if fault else DONE
        if ended.status != wanted:
            raise RuntimeError(f"cannot prepare: {command} with {at}: {ended.status} {ended.text}")

    def call_at(self, folder: Path, command: Command, part: float) -> int:
        """Number of the call of the first process at this part of all in a command; tried in a copy of the folder."""
        copy = folder.with_name(f"{folder.name}-copy")
        shutil.copytree(folder, copy, symlinks=True)
        calls = self.program.run(copy, *command, clock=CLOCK, log=True).calls
        shutil.rmtree(copy)
        return round(part * sum(call.who == "parent" for call in calls))

    def stop_of(self, name: str) -> str:
        """The fault by which the operation is itself stopped."""
        operation = OPERATIONS[name]
        if operation.stop <= 0.0:
            return ""
        if name not in self.stops:
            folder = self.folder(name)
            self.stops[name] = f"TERM:parent:{self.call_at(folder, operation.command, operation.stop)}"
            shutil.rmtree(folder)
        return self.stops[name]

    def reference(self, operation: Operation) -> dict[str, tuple]:
        """What the file holds after the operation without faults."""
        command = operation.reference
        if command not in self.expected:
            folder = self.room / f"reference-{len(self.expected)}"
            folder.mkdir()
            write_decks(folder)
            ended = self.program.run(folder, *command, clock=CLOCK)
            assert ended.status == DONE, ended
            self.expected[command] = content(folder / operation.file)
        return self.expected[command]

    def calls(self, name: str) -> list[Call]:
        """The calls of the operation without a fault."""
        operation = OPERATIONS[name]
        folder = self.folder(name)
        ended = self.program.run(folder, *operation.command, fault=self.stop_of(name), clock=CLOCK, log=True)
        shutil.rmtree(folder)
        if ended.status != operation.status:
            raise RuntimeError(f"{name} ends with {ended.status} without a fault: {ended.text}")
        return ended.calls

    def cases(self, name: str, kinds: list[str]) -> Iterator[Case]:
        """All faults that can strike the operation."""
        calls = self.calls(name)
        for kind in kinds:
            fault, letters = KINDS[kind]
            who = fault.split(":")[1]
            struck = [c for c in calls if set(c.letters) & set(letters) and who in ("all", c.who)]
            for i, call in enumerate(struck[:1] if kind in ONCE else struck):
                second = SECOND[i % len(SECOND)] if kind in SECOND and i % 3 == 0 else ""
                yield Case(name, kind, call.all if who == "all" else call.own, call.name, second)

    def try_case(self, case: Case) -> list[str]:
        """What is wrong after the fault; empty if all is well."""
        operation = OPERATIONS[case.operation]
        folder = self.folder(case.operation)
        try:
            before = snapshot(folder)
            fault = f"{KINDS[case.kind][0]}:{case.call}"
            ended = self.program.run(folder, *operation.command, fault=";".join(filter(None, (self.stop_of(case.operation), fault))),
                                     clock=CLOCK, seconds=20.0)  # fmt: skip
            return [*self.faults_of_end(case, ended, before, folder), *self.faults_of_sequel(case, ended, before, folder)]
        finally:
            shutil.rmtree(folder)

    # What must hold whatever happened.

    def faults_of_end(self, case: Case, ended: Ended, before: dict, folder: Path) -> Iterator[str]:
        """How the operation may end, and what may be there then."""
        operation = OPERATIONS[case.operation]
        struck = [hit for hit in ended.hits if hit.letters not in ("TERM",) or case.kind in SIGNALS]
        killed = ended.status < 0 or ended.hung
        yield from self.faults_of_status(case, ended)
        if killed and case.kind in SIGNALS and snapshot(folder) != before:
            yield f"{case.kind} ends it as if it were no request to stop"
        file = folder / operation.file
        if ended.status == DONE:
            yield from self.faults_of_result(operation, file)
        elif file.exists() and not self.is_old(file, before):
            yield from self.faults_of_part(operation, file)
        if operation.status == FILE_ERROR and not self.is_old(file, before):
            yield "the existing result is touched"
        if file.name in before and not file.exists():
            yield "the former file is gone"
        yield from self.faults_of_bystanders(before, folder)
        # What cannot be removed or looked at stays, and what was there before.
        if not (killed or any(hit.name in REMOVING for hit in struck)):
            yield from (f"{name} is left behind" for name in self.litter(folder) if name not in before)

    def faults_of_part(self, operation: Operation, file: Path) -> Iterator[str]:
        """What is wrong with a file that is new and not the end: it is whole all the same, and has a part of the rows."""
        if not is_sealed(file):
            yield "the file is not whole"
        elif not operation.again and (what := fault_of_unfinished(file, self.reference(operation))):
            yield f"the file {what}"

    @staticmethod
    def faults_of_status(case: Case, ended: Ended) -> Iterator[str]:
        """The exit status, and what is said with it."""
        if ended.hung:
            yield "it hangs"
        elif ended.status == -9 and not case.kind.startswith("kill"):
            yield "killed by nobody"
        elif ended.status < 0 and ended.status not in (-9, SIGNALS.get(case.kind)):
            yield f"ended by signal {-ended.status}"
        elif ended.status == DECK_ERROR and any(hit.path.endswith(".nml") for hit in ended.hits):
            pass  # the deck could not be read
        elif ended.status not in (DONE, FILE_ERROR, STOPPED, -9, SIGNALS.get(case.kind)):
            yield f"exit status {ended.status}"
        if ended.status == STOPPED and OPERATIONS[case.operation].status != STOPPED and case.kind not in SIGNALS:
            yield "exit status 75 without a stop"
        if ended.status > 0 and not ended.hung and not ended.text.startswith("dynstiction: "):
            yield "it says nothing about its failure"
        if any(word in ended.text for word in ("Fortran runtime error", "HDF5-DIAG", "Backtrace")):
            yield "internal errors are printed"

    @staticmethod
    def is_old(file: Path, before: dict) -> bool:
        return file.exists() and file.name in before and file.read_bytes() == before[file.name][2]

    def faults_of_result(self, operation: Operation, file: Path) -> Iterator[str]:
        """What is wrong with the file of an operation that says that all is well."""
        if not is_complete(file):
            yield "all seems well, but the file is not complete"
        elif content(file) != self.reference(operation):
            yield "all seems well, but the numbers differ"
        elif not is_sealed(file):
            yield "all seems well, but the file is not sealed"

    @staticmethod
    def faults_of_bystanders(before: dict, folder: Path) -> Iterator[str]:
        after = snapshot(folder)
        for name, was in before.items():
            if name in OTHERS and after.get(name) != was:
                yield f"the file of others {name} is {'changed' if name in after else 'gone'}"

    @staticmethod
    def litter(folder: Path) -> list[str]:
        """Names that are of nobody else, and no results."""
        return sorted({path.name for path in folder.iterdir()} - OTHERS - {RESULT, SHARE, LAST_SHARE})

    def faults_of_sequel(self, case: Case, ended: Ended, before: dict, folder: Path) -> Iterator[str]:
        """Done again, it must come to the end that it would have had."""
        operation = OPERATIONS[case.operation]
        if operation.status == FILE_ERROR or (operation.command == MERGE and operation.status == STOPPED):
            return
        file = folder / operation.file
        if ended.status != DONE:
            if case.second:
                self.go_on(operation, file, before, f"{KINDS[case.second][0]}:{max(1, case.call // 2)}")
                if file.exists() and not self.is_old(file, before):
                    yield from self.faults_of_part(operation, file)
            if why := self.went(self.go_on(operation, file, before)):
                yield why
                return
            yield from (f"afterwards {what}" for what in self.faults_of_result(operation, file))
        if not any(hit.name in REMOVING for hit in ended.hits):
            yield from (f"{name} is never removed" for name in self.litter(folder))
        yield from (f"afterwards {what}" for what in self.faults_of_bystanders(before, folder))

    def go_on(self, operation: Operation, file: Path, before: dict, fault: str = "") -> Ended | None:
        """Continue as a user would; None if there is nothing to do."""

        def tried(*command: str) -> Ended:
            return self.program.run(file.parent, *command, clock=CLOCK, seconds=20.0, fault=fault)

        if operation.again:
            again = tried(*operation.again)
            # What stands under the name after a stop of a merge is complete, or a part.
            return tried(*operation.again, "--overwrite") if again.status == FILE_ERROR and file.exists() and not fault else again
        if operation.command[0] == "resume" or (file.exists() and not self.is_old(file, before)):
            return None if is_complete(file) and not self.is_old(file, before) else tried(*RESUME)
        return tried(*operation.command) if not file.exists() or "--overwrite" in operation.command else tried(*RUN, "--overwrite")

    @staticmethod
    def went(ended: Ended | None) -> str:
        if ended is None or ended.status == DONE:
            return ""
        if ended.hung:
            return "done again, it hangs"
        message = ended.text.strip().splitlines()[-1:] or [""]
        return f"done again, it ends with {ended.status}: {message[0].removeprefix('dynstiction: ')[:110]}"


def room_for_files() -> str | None:
    """Memory, where that can be had: a disk would be waited for at each fsync."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


@contextmanager
def laboratory() -> Iterator[Laboratory]:
    with tempfile.TemporaryDirectory(prefix="faults-", dir=room_for_files()) as room, Program(executable().resolve()) as program:
        yield Laboratory(program, Path(room))


def try_cases(cases: list[Case]) -> list[tuple[Case, list[str]]]:
    """For a process of its own."""
    with laboratory() as lab:
        return [(case, lab.try_case(case)) for case in cases]


def list_cases(operations: list[str], kinds: list[str], every: int) -> tuple[list[Case], dict[str, str]]:
    """Every so manieth case, and the operations that fail without any fault."""
    cases, broken = [], {}
    with laboratory() as lab:
        for name in operations:
            try:
                found = list(lab.cases(name, kinds))
            except RuntimeError as error:
                broken[name] = str(error)
            else:
                cases += found[len(cases) % every :: every]
    return cases, broken


def report(results: list[tuple[Case, list[str]]], broken: dict[str, str], put: Callable[[str], object] = print) -> int:
    """Each symptom with some of the cases that have it; the number of failures."""
    symptoms: dict[tuple[str, str], list[Case]] = {}
    for case, found in results:
        for fault in found:
            symptoms.setdefault((case.operation, fault), []).append(case)
    for (operation, fault), cases in symptoms.items():
        where = ", ".join(f"{case.kind} {case.call} ({case.name})" for case in cases[:3])
        put(f"{len(cases):5} x {fault}  [{operation}: {where}]")
    for text in broken.values():
        put(f"not tried: {text.strip()}")
    total = sum(bool(found) for _, found in results) + len(broken)
    put(f"{len(results)} cases, {total} failures")
    return total


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--every", type=int, default=1, help="try every so manieth case")
    options.add_argument("--operation", action="append", choices=OPERATIONS)
    options.add_argument("--kind", action="append", choices=KINDS)
    options.add_argument("--call", type=int, help="the fault strikes at this call only")
    options.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    given = options.parse_args()
    cases, broken = list_cases(given.operation or list(OPERATIONS), given.kind or list(KINDS), given.every)
    if given.call is not None:
        cases = [case for case in cases if case.call == given.call]
    # Small pieces, dealt out as they are done.
    pieces = [cases[i : i + 100] for i in range(0, len(cases), 100)]
    results = []
    with ProcessPoolExecutor(given.jobs) as pool:
        for done in pool.map(try_cases, pieces):
            results += done
            if sys.stderr.isatty():
                print(f"\r{len(results)} of {len(cases)}", end="", file=sys.stderr)
    return report(results, broken) > 0


if __name__ == "__main__":
    sys.exit(main())
