"""Faults of a rank, of mpirun or of the disk of a sweep over MPI at any moment: it ends soon, says why once, and can be continued.

    python tests/mpi/faults.py                                  # the whole matrix, with Open MPI and with MPICH
    python tests/mpi/faults.py --flavour mpich --every 10       # a tenth of it
    python tests/mpi/faults.py --count 20 --seed 1              # twenty cases of it
    python tests/mpi/faults.py --only 'openmpi/merging/rank 0'  # those whose name has this in it; --list names them all

Needs the programs that run.sh builds, named by DYNSTICTION_OPENMPI_EXE and DYNSTICTION_MPICH_EXE, DYNSTICTION_EXE for the
reference of one process, mpirun of each, a C compiler, and for what fills the disk of all ranks the right to mount.

A case is a fault of something at a moment of a sweep of three ranks, which two cores share. Moments are not a matter of luck: a
rank is held there in a call of MPI or of the system (tests/faults/shim.c). Checked is that the command, and with
it every process, ends within ten seconds of the fault; its status, and that of each rank; that there is one message at most; that no
complete file holds anything but the bits of one process, and no file of others is touched. Then the sweep is started again
with another number of ranks: it must end, repeat no finished case, and give the same bits.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import itertools
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

sys.path.extend(str(Path(__file__).parents[1] / folder) for folder in ("python", "faults"))

from program import compiled_shim, is_complete
from programs import Program
from sweeps import GRID, SCENE, Sweep, cases_in, same, values
from test_sweep_kills import ALLOWED, MPI

RANKS, LAST = 3, 2
DECK = SCENE + GRID
CASES = list(range(1, 61))
SOON = 10.0  # seconds
DONE, USAGE_ERROR, DECK_ERROR, FILE_ERROR, STOPPED = 0, 1, 2, 3, 75
LIBC = ctypes.CDLL(None, use_errno=True)

# Before MPI is started, while all but one start it, ..., while all but one end it; and the call at which a rank is held there.
MOMENTS = ("launch", "init", "running", "stopping", "merging", "ending", "finalizing")
CALLS = {
    "launch": "init@1",
    "init": "init@1",
    "stopping": "write@4",
    "merging": "pwrite@20",
    "ending": "unlink@3",
    "finalizing": "finalize@1",
}
SLOWLY = "pause+:all:write@1"  # 20 ms a finished case

SIGNALS = {"SIGKILL": signal.SIGKILL, "SIGTERM": signal.SIGTERM, "SIGUSR1": signal.SIGUSR1}
ONE, ANY = ("rank 0", "another"), ("rank 0", "another", "mpirun", "all")
BEFORE, UNDER_WAY = ("launch",), ("running", "stopping", "merging", "ending")
ABSENT = ("exit 7", "missing program")
# When the rank has noticed all that it looks for, but has not begun to end MPI.
LATE = "late SIGTERM"
# Fault: whom it may befall, and when. What a file system does to one rank is a matter of its folder, so of its start.
MATRIX = [
    *((name, ANY, MOMENTS) for name in SIGNALS),
    ("full disk", ("rank 0", "another", "all"), ("launch", "running", "stopping")),
    ("full disk", ("rank 0", "all"), ("merging",)),
    *((name, ("rank 0", "another", "all"), BEFORE) for name in ("missing folder", "file exists", "bad deck")),
    *((name, ("all",), UNDER_WAY) for name in ("missing folder", "bad deck")),
    ("file exists", ("all",), ("running", "stopping", "merging")),
    ("slow", ANY, MOMENTS),
    ("slow, then SIGTERM", ONE, MOMENTS),
    (LATE, ONE, ("finalizing",)),
    ("exit 7", ("rank 0", "another", "all"), BEFORE),
    ("missing program", ("rank 0", "another", "all"), BEFORE),
]


@dataclass(frozen=True)
class Case:
    """A fault of someone at a moment."""

    flavour: str
    moment: str
    who: str
    fault: str

    def __str__(self) -> str:
        return f"{self.flavour}/{self.moment}/{self.who}/{self.fault}"

    @property
    def rank(self) -> int:
        """The rank it befalls: of the others the one that has most to do with the moment."""
        if self.who == "rank 0":
            return 0
        # A disk that is full matters to the rank that is held while it writes.
        return LAST if self.moment == "stopping" and self.fault == "full disk" else 1

    @property
    def ranks(self) -> list[int]:
        """The ranks it befalls."""
        return {"mpirun": [], "all": list(range(RANKS))}.get(self.who, [self.rank])


def every_case(flavours: list[str]) -> list[Case]:
    """The matrix."""
    return [
        Case(flavour, moment, who, fault)
        for flavour in flavours
        for fault, befallen, moments in MATRIX
        for moment in moments
        for who in befallen
    ]


@dataclass(frozen=True)
class Allowed:
    """How a case may end: status of mpirun, status of a rank (None: killed, or not begun), number of messages."""

    status: set[int]
    ranks: set[int | None]
    messages: set[int]


def allowed(case: Case) -> Allowed:
    """What the documentation says of a case; of mpirun it is its own documentation."""
    # A result that is all but there is finished, or is not.
    finished = {DONE} if case.moment in ("merging", "ending", "finalizing") else set()
    if case.fault in SIGNALS:
        right = after_signal(case, finished)
    elif case.fault == "slow, then SIGTERM":
        # mpirun may have to kill the rank, or lose patience.
        status = killed_by(signal.SIGTERM) | killed_by(signal.SIGKILL) | ended_mpirun(case)
        right = Allowed(status | finished, {STOPPED, None} | finished, {0, 1})
    elif case.fault == LATE:
        right = Allowed({STOPPED} | killed_by(signal.SIGKILL), {STOPPED, None}, {1})
    elif case.fault in ABSENT:
        status = {7} if case.fault == "exit 7" else {127, 1, 255}
        right = Allowed(status | killed_by(signal.SIGTERM) | ended_mpirun(case), {None}, {0})
    elif is_harmless(case):
        status = {STOPPED if case.moment == "stopping" else DONE}
        right = Allowed(status, status, {int(case.moment == "stopping")})
    else:
        right = after_fault_of_files(case)
    if may_fail_itself(case):
        right = Allowed(right.status | {-signal.SIGSEGV, -signal.SIGKILL}, right.ranks, right.messages)
    if case.flavour == "openmpi" and right.status != {DONE}:
        # When the first rank has ended with an error, mpirun ends the others, which may be about to.
        right = Allowed(right.status, right.ranks | {None}, right.messages)
    return right


def is_harmless(case: Case) -> bool:
    """Whether the sweep continues, or stops if it received a signal, as if nothing had happened."""
    if case.fault == "bad deck" and (case.moment != "launch" or case.who == "another"):
        # Rank 0 reads the deck, at the beginning.
        return True
    # A sweep that stops ends before it looks at files again.
    return case.fault == "slow" or (case.moment == "stopping" and case.fault != "full disk")


def after_fault_of_files(case: Case) -> Allowed:
    """How a deck, folder or disk ends a sweep."""
    codes = {DECK_ERROR if case.fault == "bad deck" else FILE_ERROR}
    if case.who == "all" and case.moment == "stopping":
        # What rank 2 still writes may have room.
        codes.add(STOPPED)
    if case.who == "another" and case.fault == "file exists":
        # Rank 1 is in a separate folder with its shard, which the others cannot see.
        codes.add(STOPPED)
    if case.moment == "ending":
        codes.add(DONE)
    return Allowed(codes, codes, {0, 1} if DONE in codes else {1})


def killed_by(number: int) -> set[int]:
    """The status of an mpirun one of whose ranks was killed: as a shell has it; MPICH's has all bits of the ranks' signals."""
    return {128 + number, number, number | signal.SIGKILL}


def ended_mpirun(case: Case) -> set[int]:
    """The status of an mpirun that was asked to end: that of Open MPI is 1, MPICH's may forget the status of the ranks."""
    return {1, STOPPED, 143} if case.flavour == "openmpi" else {0, STOPPED, 143, 15}


def may_fail_itself(case: Case) -> bool:
    """Whether mpirun may crash, or hang alone: that of Open MPI 4.1.4, when a rank dies, or is slow, while others end MPI."""
    return case.flavour == "openmpi" and case.moment == "finalizing" and case.fault != "SIGUSR1"


def after_signal(case: Case, finished: set[int]) -> Allowed:
    """How a signal ends a sweep."""
    number, to_rank = SIGNALS[case.fault], case.who in ONE
    if number == signal.SIGKILL:
        # When mpirun is gone the MPI library ends the ranks, with statuses of its own.
        ranks = {None, STOPPED, 1, 15, 255} if case.who == "mpirun" else {None, STOPPED}
        return Allowed(killed_by(number) if to_rank else {-number}, ranks | finished, {0, 1})
    # Before and after the sweep a signal may have its usual effect.
    killed = case.moment in ("launch", "init", "finalizing")
    status = {STOPPED} if to_rank else ended_mpirun(case)
    if killed:
        status = status | killed_by(number) | {-number}
    ranks = {STOPPED, None} if killed or not to_rank else {STOPPED}
    messages = {1} if to_rank and not killed and not finished else {0, 1}
    return Allowed(status | finished, ranks | finished, messages)


class Launch:
    """A sweep under mpirun, from its start until nothing is left of it."""

    def __init__(self, room: Path, case: Case, shim: Path) -> None:
        self.room, self.case = room, case
        self.work = room / "work"
        self.mark = f"FAULT_CASE={room}".encode()
        self.exe = Path(os.environ[MPI[case.flavour]]).resolve()
        self.result = self.work / "res" / "x.h5"
        wrapper = Path(__file__).with_name("rank.sh")
        mpirun = Program(
            (f"mpirun.{case.flavour}", "-n", RANKS, wrapper, room, self.exe), self.work,
            ALLOWED | {"FAULT_CASE": str(room), "FAULT_SHIM": str(shim)},
        )  # fmt: skip
        deck, output = str(self.work / "map.nml"), str(self.result)
        if case.fault == "bad deck":
            deck = "map.nml"
        if case.fault in ("missing folder", "file exists"):
            output = "res/x.h5"
        with (room / "said").open("wb") as said:
            own = {"stdin": subprocess.DEVNULL, "stdout": said, "stderr": said, "start_new_session": True}
            self.process = mpirun.start("run", deck, "-o", output, "--quiet", **own)

    def processes(self) -> dict[int, list[bytes]]:
        """Remaining processes: the environment of each one."""
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                environment = (folder / "environ").read_bytes().split(b"\0")
                if self.mark in environment:
                    found[int(folder.name)] = environment
        return found

    def rank(self, number: int) -> int:
        """The process of a rank: of its wrapper, or the program; not a child of it."""
        signs = {b"OMPI_COMM_WORLD_RANK=%d" % number, b"PMI_RANK=%d" % number}
        found = {pid for pid, environment in self.processes().items() if signs & set(environment)}
        oldest = [pid for pid in found if parent(pid) not in {0, *found}]
        return oldest[0] if oldest else 0

    def targets(self, who: str, everything: bool) -> list[int]:
        """Processes: of 'all', mpirun and the ranks, or with `everything` also the helpers of mpirun."""
        if who == "mpirun":
            return [self.process.pid]
        if who == "all":
            return list(self.processes()) if everything else [self.process.pid, *map(self.rank, range(RANKS))]
        return [self.rank(self.case.rank)]

    def send(self, who: str, number: int) -> None:
        """Send a signal to those who are still there."""
        targets = [pid for pid in self.targets(who, number == signal.SIGKILL) if pid > 0]
        if number == signal.SIGKILL:
            # Nobody sees the others die.
            send(targets, signal.SIGSTOP)
        send(targets, number)

    def finished(self) -> list[int]:
        """The finished cases in the shards."""
        return [case for shard in self.result.parent.glob("x.h5.shard-??????") for case in cases_in(shard)]

    def is_held(self, rank: int) -> bool:
        """Whether the program of a rank is held in a call of the system."""
        log = self.room / f"log.{rank}"
        return log.exists() and any(line.startswith("hit ") and " hold " in line for line in log.read_text().splitlines())

    def has_come(self, moment: str) -> bool:
        """Whether it has come to this moment."""
        if moment == "running":
            return len(self.finished()) > 5
        started = moment != "init" or all((self.room / f"log.{rank}").exists() for rank in range(RANKS))
        return started and all(map(self.is_held, held(self.case)))

    def open_gates(self) -> None:
        """Continue the held processes."""
        for number in range(4):
            (self.room / f"gate{number}").touch()

    def has_ended(self) -> bool:
        """Whether nothing is left."""
        return self.process.poll() is not None and not self.processes()

    def has_left_mpirun(self) -> bool:
        """Whether mpirun alone is left; it is ended."""
        if set(self.processes()) != {self.process.pid}:
            return False
        self.end()
        return True

    def end(self) -> None:
        """Kill what is left."""
        while left := self.processes():
            send(left, signal.SIGKILL)
            time.sleep(0.01)
        self.process.wait(30)

    def statuses(self) -> list[int | None]:
        """Exit status of each rank; None if it was killed, or has not begun."""
        files = [self.room / f"status.{rank}" for rank in range(RANKS)]
        return [int(file.read_text()) if file.exists() and file.read_text() else None for file in files]


def send(targets: Iterable[int], number: int) -> None:
    """Send a signal to those who are still there."""
    for pid in targets:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def parent(pid: int) -> int:
    """The parent of a process."""
    with contextlib.suppress(OSError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return 0


def held(case: Case) -> list[int]:
    """The ranks that are held at the case's moment: such as live on when others die, but for what only rank 0 does."""
    if case.moment == "launch":
        return list(range(RANKS)) if case.fault in SIGNALS or case.fault == "slow, then SIGTERM" else []
    if case.moment in ("merging", "ending") or (case.fault == "full disk" and case.who == "rank 0"):
        return [0]
    return [LAST]


def orders(case: Case) -> dict[int, list[str]]:
    """What each rank is to do before, or while, it runs: lines of its wrapper."""
    found: dict[int, list[str]] = {rank: [] for rank in range(RANKS)}
    faults: dict[int, list[str]] = {rank: [] for rank in range(RANKS)}
    for rank in range(RANKS):
        if case.moment in ("running", "stopping"):
            faults[rank].append(SLOWLY)
        if case.moment in CALLS and rank in held(case):
            faults[rank].append(f"hold:all:{CALLS[case.moment]}")
    for rank in case.ranks:
        if case.fault == "full disk" and case.who != "all":
            call = {"launch": "write@1", "running": "write@4"}.get(case.moment) or CALLS[case.moment]
            faults[rank].append(f"ENOSPC+:all:{call}")
        if case.fault == "slow" and case.moment == "launch":
            found[rank].append("sleep 3")
        if case.fault == "exit 7":
            found[rank].append("exit 7")
        if case.fault == "missing program":
            found[rank].append('exec "$room/no such program"')
        if case.moment == "launch" and case.who != "all" and case.fault in ("missing folder", "file exists", "bad deck"):
            found[rank].append('cd "$room/elsewhere"')
    for rank, what in faults.items():
        if case.fault == LATE and rank in case.ranks:
            what.append("TERM:all:unlisten@1")
        if what:
            found[rank].append(f"export FAULT={shlex.quote(';'.join(what))}")
    return found


@dataclass
class Laboratory:
    """Where cases are tried."""

    folder: Path
    shim: Path
    reference: dict = field(repr=False)
    foreign: bytes = field(repr=False)  # a result of another deck
    numbers: Iterator[int]

    def try_case(self, case: Case) -> list[str]:
        """Everything that is wrong."""
        room = self.folder / f"{next(self.numbers)}"
        (room / "work" / "res").mkdir(parents=True)
        (room / "elsewhere").mkdir()
        (room / "work" / "map.nml").write_text(DECK)
        for rank, lines in orders(case).items():
            (room / f"rank.{rank}").write_text("\n".join(lines) + "\n")
        on_a_disk = case.fault == "full disk" and case.who == "all"
        with disk(room / "work" / "res") if on_a_disk else contextlib.nullcontext():
            self.prepare(case, room)
            launch = Launch(room, case, self.shim)
            try:
                wrong = self.strike(launch)
                wrong += self.look(launch)
            finally:
                launch.end()
            wrong += self.repair(launch)
            wrong += self.go_on(launch)
        if not wrong:
            shutil.rmtree(room)
        return wrong

    def prepare(self, case: Case, room: Path) -> None:
        """Faults that are there before the start."""
        if case.moment != "launch":
            return
        if case.fault == "file exists":
            place = room / ("work" if case.who == "all" else "elsewhere") / "res"
            place.mkdir(exist_ok=True)
            (place / "x.h5").write_bytes(self.foreign)
        elif case.who == "all":
            self.break_files(case, room / "work")

    def break_files(self, case: Case, work: Path) -> None:
        """What befalls the files of all ranks."""
        if case.fault == "full disk":
            fill(work / "res")
        elif case.fault == "missing folder":
            (work / "res").rename(work / "gone")
        elif case.fault == "bad deck":
            (work / "map.nml").write_text(DECK.replace("t_end = 10.0", "t_end = 'late'"))
        elif case.fault == "file exists":
            (work / "res" / "x.h5").unlink(missing_ok=True)
            (work / "res" / "x.h5").write_bytes(self.foreign)

    def strike(self, launch: Launch) -> list[str]:
        """Wait for the moment, do what the case wants, and wait for the end."""
        case = launch.case
        if not until(lambda: launch.has_come(case.moment) or launch.process.poll() is not None, 20.0):
            return [f"never came to {case.moment}"]
        if launch.process.poll() is not None:
            return [f"ended before {case.moment}"]
        if case.moment == "init":
            # From the start of the program to its wait for the others.
            time.sleep(0.5)
        if case.moment == "stopping":
            os.kill(launch.rank(1), signal.SIGUSR1)
            time.sleep(0.1)
        lasting = self.strike_now(launch)
        # A rank that never begins does not prevent a signal from ending all. SIGUSR1 asks to stop, which is for all to do; and a
        # rank that is held here does not see mpirun die.
        ends_all = case.fault in ("SIGKILL", "SIGTERM", LATE) and case.who != "mpirun"
        for_ever = case.moment in ("init", "finalizing") and ends_all
        if not for_ever and case.fault != "slow, then SIGTERM":
            time.sleep(0.2)
            launch.open_gates()
        if not until(launch.has_ended, SOON + lasting) and not (may_fail_itself(case) and launch.has_left_mpirun()):
            left = {pid: name_of(pid) for pid in launch.processes()}
            return [f"hangs: {', '.join(sorted(left.values())) or 'mpirun'}"]
        return []

    def strike_now(self, launch: Launch) -> float:
        """The fault itself; seconds that it lasts."""
        case = launch.case
        if case.fault in SIGNALS:
            launch.send(case.who, SIGNALS[case.fault])
        elif case.fault == "slow" and case.moment == "launch":
            if case.who == "mpirun":
                launch.send("mpirun", signal.SIGSTOP)
                time.sleep(2.0)
                launch.send("mpirun", signal.SIGCONT)
            return 3.0
        elif case.fault == "slow":
            launch.send(case.who, signal.SIGSTOP)
            launch.open_gates()
            time.sleep(2.0)
            launch.send(case.who, signal.SIGCONT)
        elif case.fault == "slow, then SIGTERM":
            launch.send(case.who, signal.SIGSTOP)
            time.sleep(0.5)
            launch.send("mpirun", signal.SIGTERM)
        elif case.fault in ABSENT and case.flavour == "mpich":
            # MPICH's mpirun lets a rank go that has not begun with MPI, whatever its status is: the user has to end the others.
            launch.open_gates()
            time.sleep(2.0)
            launch.send("mpirun", signal.SIGTERM)
        elif case.who == "all" and case.moment != "launch":
            self.break_files(case, launch.work)
        return 0.0

    def look(self, launch: Launch) -> list[str]:
        """How it ended."""
        case, wrong = launch.case, []
        right = allowed(case)
        status, ranks = launch.process.poll(), launch.statuses()
        said = (launch.room / "said").read_text(errors="replace")
        messages = [line for line in said.splitlines() if line.startswith("dynstiction:")]
        if status not in right.status:
            wrong.append(f"status {status}, not {shown(right.status)}")
        if not set(ranks) <= right.ranks:
            wrong.append(f"status of the ranks {shown(ranks)}, not {shown(right.ranks)}")
        if len({rank for rank in ranks if rank is not None}) > 1 and case.who != "mpirun":
            wrong.append(f"the ranks end differently: {shown(ranks)}")
        if len(messages) not in right.messages:
            wrong.append(f"{len(messages)} messages: {' | '.join(messages)}")
        if any(sign in said for sign in ("Error termination", "Backtrace for", "SIGSEGV")):
            wrong.append("it crashed")
        if wrong:
            wrong.append(f"it said: {' | '.join(said.splitlines()[:12])}")
        return wrong

    def repair(self, launch: Launch) -> list[str]:
        """What a user does before the next start."""
        work, wrong = launch.work, []
        if launch.case.fault == "file exists":
            files = [folder / "res" / "x.h5" for folder in (work, launch.room / "elsewhere")]
            if not any(file.exists() and file.read_bytes() == self.foreign for file in files):
                wrong.append("a file of others was changed")
            launch.result.unlink(missing_ok=True)
        (work / "res" / "filler").unlink(missing_ok=True)
        if (work / "gone").exists():
            shutil.rmtree(work / "res", ignore_errors=True)
            (work / "gone").rename(work / "res")
        (work / "map.nml").write_text(DECK)
        return wrong

    def go_on(self, launch: Launch) -> list[str]:
        """Start it again, and look at the bits."""
        wrong = []
        before, result = launch.finished(), launch.result
        if len(before) != len(set(before)):
            wrong.append("a case was done twice")
        if is_complete(result):
            if not same(values(result), self.reference):
                return [*wrong, "the complete file has other bits"]
            if not before:
                return wrong
        keep = () if is_complete(result) else ("--keep-shards",)
        number = 1 + next(self.numbers) % 2
        mpirun = Program((f"mpirun.{launch.case.flavour}", "-n", number, launch.exe), env=ALLOWED)
        again = mpirun("run", launch.work / "map.nml", "-o", result, "--quiet", *keep, timeout=60)
        if again.returncode != DONE:
            return [*wrong, f"started again it ends with {again.returncode}: {' '.join(again.stderr.split())[:300]}"]
        if keep:
            now = launch.finished()
            if not set(before) <= set(now):
                wrong.append("a finished case was lost")
            if sorted(now) != CASES:
                wrong.append("started again it repeats cases, or leaves some out")
        elif launch.finished():
            wrong.append("shards of a complete file are left")
        if not is_complete(result) or not same(values(result), self.reference):
            wrong.append("started again it gives other bits")
        return wrong


def until(condition: Callable[[], bool], seconds: float) -> bool:
    """Wait until something is so; False if it is not so in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.005)
    return True


def name_of(pid: int) -> str:
    """The name of a process, and what it waits for."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/comm").read_text().strip()
    return "?"


def shown(values: object) -> str:
    """Statuses as text."""
    return ", ".join("killed" if value is None else str(value) for value in values)


@contextlib.contextmanager
def disk(folder: Path) -> Iterator[None]:
    """A file system of a megabyte at `folder`."""
    if LIBC.mount(b"tmpfs", os.fsencode(folder), b"tmpfs", 0, b"size=1m"):
        raise PermissionError("only root can mount a small disk")
    try:
        yield
    finally:
        detached = 2
        LIBC.umount2(os.fsencode(folder), detached)


def fill(folder: Path) -> None:
    """Leave no room."""
    with (folder / "filler").open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))


def laboratory(folder: Path) -> Laboratory:
    """What all cases need, in a folder."""
    other = Sweep(folder, DECK.replace("count = 12, 5", "count = 2, 2"))
    assert other.run("other.h5").returncode == DONE
    assert Sweep(folder, DECK).run("reference.h5").returncode == DONE
    reference = values(folder / "reference.h5")
    return Laboratory(folder, compiled_shim(folder), reference, (folder / "other.h5").read_bytes(), itertools.count())


@cache
def flavours() -> list[str]:
    """The MPIs whose mpirun and build are there."""
    return [name for name, variable in MPI.items() if os.environ.get(variable) and shutil.which(f"mpirun.{name}")]


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--flavour", action="append", choices=list(MPI))
    options.add_argument("--only", default="", help="cases whose name has this in it")
    options.add_argument("--every", type=int, default=1, help="try every so manieth case")
    options.add_argument("--count", type=int, help="try so many cases, chosen by --seed")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--list", action="store_true", help="print the names of the cases")
    given = options.parse_args()
    cases = [case for case in every_case(given.flavour or flavours()) if given.only in str(case)][:: given.every]
    if given.count is not None:
        cases = random.Random(given.seed).sample(cases, min(given.count, len(cases)))
    if given.list:
        print(*cases, sep="\n")
        return 0
    failed = 0
    with tempfile.TemporaryDirectory(prefix="mpi-faults-", ignore_cleanup_errors=True) as folder:
        lab = laboratory(Path(folder))
        for case in cases:
            begun = time.monotonic()
            wrong = lab.try_case(case)
            failed += bool(wrong)
            print(f"{time.monotonic() - begun:5.1f} s  {case}: {'; '.join(wrong) or 'passed'}", flush=True)
    print(f"{len(cases) - failed} passed, {failed} failed")
    return failed > 0


if __name__ == "__main__":
    sys.exit(main())
