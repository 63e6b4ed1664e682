"""Sweeps over real MPI processes on this machine, with Open MPI and with MPICH; tests/mpi/run.sh builds what they need."""

from __future__ import annotations

import os
import re
import signal
import struct
import time
from pathlib import Path

import h5py
import pytest
from programs import INPUTS, Program, end_group, executable, wait_until
from sweeps import GRID, HEADER_BYTES, SCENE, Sweep, cases_in, same, values
from test_sweep_kills import ALLOWED, MPI, Ranks, skip_without

SHORT = SCENE.replace("t_end = 10.0", "t_end = 1.0")
# After a signal to itself MPICH's mpirun may forget the status of the ranks.
STOPPED = {"openmpi": (75,), "mpich": (75, 0)}
ENDLESS = ("--set", "scene.t_end=20000")


class Launched(Sweep):
    """A sweep under mpirun."""

    def __init__(self, folder, flavour, exe, text=SHORT + GRID):
        super().__init__(folder, text, exe)
        self.flavour = flavour

    def ranks(self, number, *first):
        return Program((f"mpirun.{self.flavour}", "-n", number, *first), self.folder, ALLOWED)

    def run(self, output, *arguments, ranks=2, **options):
        return self.ranks(ranks, self.exe)(*self.command(output, *arguments), timeout=300, **options)

    def go(self, output, *arguments, ranks=2, **options):
        launcher = self.ranks(ranks).words()
        return self.start(output, *arguments, launcher=launcher, env=ALLOWED, **options)


@pytest.fixture(params=list(MPI))
def launched(request, tmp_path):
    return Launched(tmp_path, request.param, skip_without(request.param))


@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_the_number_of_ranks_changes_nothing(launched, tmp_path, ranks):
    launched.run("m.h5", "--keep-shards", ranks=ranks, status=0)
    assert len(launched.shards("m.h5")) == ranks
    assert sorted(case for shard in launched.shards("m.h5") for case in cases_in(shard)) == list(range(1, 61))
    assert Sweep(tmp_path, SHORT + GRID).run("s.h5").returncode == 0
    assert same(values(tmp_path / "m.h5"), values(tmp_path / "s.h5"))


def seconds_in(shard):
    """Wall time of all cases in a shard [s]: the last value of a record, before its checksum."""
    data, place, total = shard.read_bytes(), HEADER_BYTES, 0.0
    while place < len(data):
        length = 8 * int.from_bytes(data[place + 8 : place + 12], "little")
        total += struct.unpack_from("<d", data, place + length - 16)[0]
        place += length
    return total


@pytest.mark.parametrize("costly", ["first", "last"])
def test_expensive_cases_in_a_row_are_shared(launched, tmp_path, costly):
    """24 of 240 cases cost 1000 times the others, one after the other."""
    ends = [2000.0] * 24 + [2.0] * 216
    if costly == "last":
        ends.reverse()
    (tmp_path / "points.csv").write_text("\n".join(["scene.t_end", *map(str, ends)]))
    launched.deck.write_text(SCENE + "&sweep points = 'points.csv' /\n")
    launched.run("m.h5", "--keep-shards", status=0)
    spent = [seconds_in(shard) for shard in launched.shards("m.h5")]
    # No more than two cases of a difference; half as much again for the scheduler of a busy machine.
    assert abs(spent[0] - spent[1]) < 3.0 * sum(spent) / 24


def test_failed_cases(launched, tmp_path):
    assert launched.run("m.h5", "--set", "integrator.max_steps=25", status=5).stderr.count("cases failed") == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_to_one_rank_stops_all(launched, tmp_path, number):
    process = launched.go("m.h5", *ENDLESS, ranks=3)
    ranks = Ranks.__new__(Ranks)
    ranks.sign = f"{tmp_path / 'm.h5'}".encode()
    try:
        wait_until(lambda: sum(len(cases_in(shard)) for shard in launched.shards("m.h5")) > 1)
        os.kill(ranks.workers()[-1], number)
        assert process.wait(60) == 75
        assert process.stderr.read().count("start it again") == 1
    finally:
        end_group(process)
    done = {case for shard in launched.shards("m.h5") for case in cases_in(shard)}
    # With another number of ranks it continues, and repeats nothing.
    launched.run("m.h5", *ENDLESS, "--set", "output.wall_limit=2", ranks=2, status=75)
    now = [case for shard in launched.shards("m.h5") for case in cases_in(shard)]
    assert done <= set(now) and len(now) == len(set(now))


def test_a_signal_to_mpirun_reaches_the_ranks(launched):
    process = launched.go("m.h5", *ENDLESS)
    try:
        wait_until(lambda: sum(len(cases_in(shard)) for shard in launched.shards("m.h5")) > 1)
        process.send_signal(signal.SIGUSR1)
        assert process.wait(60) in STOPPED[launched.flavour]
        assert "stopped by SIGUSR1" in process.stderr.read()
    finally:
        end_group(process)


def test_progress_is_of_rank_0_only_and_of_all_ranks(launched):
    process = launched.go("m.h5", *ENDLESS, quiet=False, ranks=2)
    try:
        line = process.stderr.readline()
        assert " of 60 cases, 0 failed" in line
        process.send_signal(signal.SIGUSR1)
        assert process.wait(60) in STOPPED[launched.flavour]
        assert process.stderr.read().count(" of 60 cases, 0 failed") == 0
    finally:
        end_group(process)


def test_shards_are_not_for_ranks(launched):
    assert "--shard is for processes that do not communicate" in launched.run("m.h5", "--shard", "1/2", status=1).stderr


class Ended:
    """How a command of some ranks ended: the status of each, what they printed, and the messages of the program."""

    def __init__(self, launched, *command, ranks=2):
        script = 'rank=${OMPI_COMM_WORLD_RANK:-$PMI_RANK}; "$@"; echo $? > "status.$rank"'
        done = launched.ranks(ranks, "sh", "-c", script, "sh", launched.exe)(*command)
        files = [launched.folder / f"status.{rank}" for rank in range(ranks)]
        self.statuses = [int(file.read_text()) for file in files]
        self.output, self.messages = done.stdout, messages(done.stderr)
        for file in files:
            file.unlink()


def messages(text):
    """What the program says, without what mpirun adds."""
    return [line for line in text.splitlines() if line.startswith("dynstiction:")]


def alone(launched, *command):
    """The same command without mpirun."""
    return Program((launched.exe,), launched.folder)(*command)


UNNAMED = re.sub("file = '.*'", "", SHORT)
# A run of some tenths of a second.
ONE = UNNAMED.replace("t_end = 1.0", "t_end = 2000.0").replace("interval = 1.0e-3", "interval = 1.0e-2")
DECKS = {
    "one.nml": ONE,
    "map.nml": UNNAMED + GRID,
    "other.nml": UNNAMED.replace("normal_load = 10.0", "normal_load = 9.0") + GRID,
    "failing.nml": UNNAMED.replace("&integrator", "&integrator\n  max_steps = 5") + GRID,
    "full.nml": (INPUTS / "fig3.nml").read_text().replace("t_end = 10.0", "t_end = 0.1"),
    "bad.nml": UNNAMED.replace("t_end = 1.0", "t_end = 'late'"),
}


@pytest.fixture
def decks(launched, tmp_path):
    for name, text in DECKS.items():
        (tmp_path / name).write_text(text)


def columns(path):
    """The columns of a run."""
    with h5py.File(path) as file:
        return {name: item[()] for name, item in file.items() if isinstance(item, h5py.Dataset)}


def results(folder):
    return sorted(path.name for path in folder.glob("*.h5*"))


def test_all_ranks_end_with_one_status(launched, decks):
    """Also when the cases that failed were run before, by others."""
    for _ in range(2):
        ended = Ended(launched, "run", "failing.nml", "-o", "f.h5", "--keep-shards", "--quiet", "--overwrite")
        assert ended.statuses == [5, 5]
        assert len(ended.messages) == 1 and "60 of 60 cases failed" in ended.messages[0]


PRINT_ONLY = ["--version", "--help", "run --help", "keys", "template", "template creep"]
REFUSED = [
    "",
    "no_command",
    "template none",
    "run",
    "run --no-option",
    "run bad.nml map.nml",
    "run map.nml no.nml",
    "run one.nml --shard 1/2",
    "run one.nml -o no/folder.h5",
    "run map.nml -o no/folder.h5",
    "run one.nml map.nml -o x.h5",
    "check bad.nml",
    "check no.nml map.nml",
    "stability map.nml",
    "resume no.h5",
    "merge map.nml",
    "merge one.nml",
]


def shared(commands, part):
    """Of many commands those in `part` are tried always, the others with the heavier proofs."""
    return [command if command in part else pytest.param(command, marks=pytest.mark.full) for command in commands]


ALWAYS = {"--version", "template creep", "check map.nml", "", "template none", "run bad.nml map.nml", "run map.nml -o no/folder.h5",
          "run one.nml map.nml -o x.h5", "check bad.nml", "resume no.h5", "merge map.nml"}  # fmt: skip


@pytest.mark.parametrize("command", shared([*PRINT_ONLY, "check map.nml", "stability full.nml", *REFUSED], ALWAYS))
def test_ranks_say_what_one_process_says(launched, decks, tmp_path, command):
    expected = alone(launched, *command.split())
    assert (expected.returncode != 0) == (command in REFUSED)
    ended = Ended(launched, *command.split())
    assert ended.statuses == [expected.returncode] * 2
    assert ended.output == expected.stdout
    assert ended.messages == messages(expected.stderr)
    assert not results(tmp_path)


def test_several_decks(launched, decks, tmp_path):
    names = ("map", "failing", "one", "other")
    ended = Ended(launched, "run", *(f"{name}.nml" for name in names), "--quiet", ranks=3)
    assert ended.statuses == [5, 5, 5] and len(ended.messages) == 1
    assert results(tmp_path) == sorted(f"{name}.h5" for name in names)
    for name in names:
        done = alone(launched, "run", f"{name}.nml", "-o", "alone.h5", "--quiet", "--overwrite")
        assert done.returncode == (5 if name == "failing" else 0)
        contents = columns if name == "one" else values
        assert same(contents(tmp_path / f"{name}.h5"), contents(tmp_path / "alone.h5"))


def test_a_run_is_stopped_resumed_and_complete(launched, decks, tmp_path):
    """Rank 0 does what is for one process; all end with its status."""
    stopped = Ended(launched, "run", "one.nml", "--set", "output.wall_limit=0.05", "--quiet", ranks=3)
    assert stopped.statuses == [75, 75, 75] and len(stopped.messages) == 1
    assert results(tmp_path) == ["one.h5", "one.h5.checkpoint"]
    exists = Ended(launched, "run", "one.nml", "--quiet")
    assert exists.statuses == [3, 3]
    assert len(exists.messages) == 1 and "the file exists" in exists.messages[0]
    # The limit of the deck stops it again.
    for _ in range(100):
        resumed = Ended(launched, "resume", "one.h5", "--quiet", ranks=3)
        if resumed.statuses != [75, 75, 75]:
            break
    assert resumed.statuses == [0, 0, 0] and not resumed.messages
    assert alone(launched, "run", "one.nml", "-o", "alone.h5", "--quiet").returncode == 0
    assert same(columns(tmp_path / "one.h5"), columns(tmp_path / "alone.h5"))


def test_merge_works_once(launched, decks, tmp_path):
    for shard, status in (("1/2", 75), ("2/2", 0)):
        assert alone(launched, "run", "map.nml", "--shard", shard, "--quiet").returncode == 0
        merged = Ended(launched, "merge", "map.nml", "--keep-shards", ranks=3)
        assert merged.statuses == [status] * 3 and len(merged.messages) == (status != 0)
        found = values((tmp_path / "map.h5").rename(tmp_path / "seen.h5"))
    assert alone(launched, "run", "map.nml", "-o", "alone.h5", "--quiet").returncode == 0
    assert same(found, values(tmp_path / "alone.h5"))


@pytest.mark.parametrize("deck", ["full.nml", "bad.nml"])
def test_trade_is_refused_before_it_becomes_python(launched, decks, tmp_path, deck):
    """A process that MPI has started cannot make way for another program."""
    ended = Ended(launched, "trade", deck, "--budget", "1", "-o", "t.h5", ranks=3)
    assert ended.statuses == [1, 1, 1] and not ended.output
    assert len(ended.messages) == 1 and "'trade' is for one process" in ended.messages[0]
    assert not results(tmp_path)


def ranks_in(folder):
    """Processes of the ranks that work in a folder, by rank."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            settings = (process / "environ").read_bytes().split(b"\0")
            here = (process / "cwd").resolve() == folder.resolve()
        except OSError:
            continue
        for name in (b"OMPI_COMM_WORLD_RANK=", b"PMI_RANK="):
            found |= {int(text[len(name) :]): process for text in settings if here and text.startswith(name)}
    return found


def processor_seconds(process):
    """Processor time of a process, of a folder in /proc [s]."""
    user, system = (process / "stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


LONG = ("run", "one.nml", "--set", "scene.t_end=1e6", "--set", "output.interval=1", "--quiet")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGUSR1])
@pytest.mark.parametrize("command", ["run", "resume"])
def test_a_signal_stops_what_rank_0_does(launched, decks, tmp_path, command, number):
    """Over mpirun: it ends with a checkpoint. Meanwhile the others have used no core."""
    arguments = LONG
    if command == "resume":
        process = Program((launched.exe,), tmp_path).start(*LONG, start_new_session=True)
        wait_until((tmp_path / "one.h5").exists)
        time.sleep(0.3)
        process.send_signal(signal.SIGUSR1)
        assert process.wait(30) == 75
        arguments = ("resume", "one.h5", "--quiet")
    process = launched.ranks(3, launched.exe).start(*arguments, start_new_session=True)
    try:
        wait_until(lambda: len(ranks_in(tmp_path)) == 3 and (tmp_path / "one.h5").exists())
        rank = ranks_in(tmp_path)
        before = [processor_seconds(rank[i]) for i in range(3)]
        wall = time.monotonic()
        time.sleep(2.0)
        spent = [processor_seconds(rank[i]) - before[i] for i in range(3)]
        wall = time.monotonic() - wall
        assert spent[0] > 0.0
        assert max(spent[1:]) < 0.25 * wall
        # Open MPI's own answer to SIGTERM is to kill the ranks after a while.
        process.send_signal(number)
        assert process.wait(10) in {*STOPPED[launched.flavour], *({1} if number == signal.SIGTERM else set())}
    finally:
        end_group(process)
    assert len(messages(process.stderr.read())) <= 1
    # The checkpoint is that of the stop: the run resumes from it.
    assert (tmp_path / "one.h5.checkpoint").exists()
    with h5py.File(tmp_path / "one.h5") as file:
        assert file.attrs["result_code"] == 75


@pytest.fixture
def strangers(launched, request):
    """A program without MPI, or with another MPI, under mpirun: copies that do not communicate."""
    launched.exe = executable()
    if request.param != "serial":
        launched.exe = skip_without(next(flavour for flavour in MPI if flavour != launched.flavour))
    return launched


FOR_ONE = ["run one.nml", "run map.nml other.nml", "resume one.h5", "merge map.nml", "check map.nml", "stability full.nml",
           "trade full.nml"]  # fmt: skip


@pytest.mark.parametrize("strangers", ["serial", "other MPI"], indirect=True)
@pytest.mark.parametrize("command", shared(["run map.nml", *FOR_ONE], {"run map.nml", "run one.nml", "resume one.h5"}))
def test_copies_that_know_nothing_of_each_other_are_refused(strangers, decks, tmp_path, command):
    ended = Ended(strangers, *command.split())
    assert ended.statuses == [1, 1] and not ended.output
    assert len(ended.messages) == 1 and "this is one of 2 copies" in ended.messages[0]
    assert ("is for one process" if command in FOR_ONE else "they do not communicate") in ended.messages[0]
    assert not results(tmp_path)


@pytest.mark.parametrize("strangers", ["serial", "other MPI"], indirect=True)
@pytest.mark.parametrize(
    "command", shared([*PRINT_ONLY, "", "no_command", "template none", "run --no-option"], {"--version", "template none"})
)
def test_the_first_of_such_copies_speaks_for_all(strangers, command):
    expected = alone(strangers, *command.split())
    ended = Ended(strangers, *command.split())
    assert ended.statuses == [expected.returncode] * 2
    assert (ended.output, ended.messages) == (expected.stdout, messages(expected.stderr))
