"""Sweeps over real MPI processes on this machine, with Open MPI and with MPICH; tests/mpi/run.sh builds what they need."""

from __future__ import annotations

import os
import signal
import struct
import subprocess

import pytest
from sweeps import GRID, HEADER_BYTES, SCENE, Sweep, cases_in, end_group, executable, same, values, wait_until
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

    def run(self, output, *arguments, ranks=2, **kwargs):
        command = [f"mpirun.{self.flavour}", "-n", str(ranks), *self.command(output, *arguments)]
        environment = os.environ | ALLOWED | {"OMP_NUM_THREADS": "1"}
        return subprocess.run(
            command, env=environment, capture_output=True, text=True, check=False, timeout=300, **kwargs
        )

    def go(self, output, *arguments, ranks=2, **kwargs):
        launcher = (f"mpirun.{self.flavour}", "-n", str(ranks))
        return self.start(
            output, *arguments, launcher=launcher, env=ALLOWED | {"OMP_NUM_THREADS": "1"}, text=True, **kwargs
        )


@pytest.fixture(params=list(MPI))
def launched(request, tmp_path):
    return Launched(tmp_path, request.param, skip_without(request.param))


@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_the_number_of_ranks_changes_nothing(launched, tmp_path, ranks):
    done = launched.run("m.h5", "--keep-shards", ranks=ranks)
    assert done.returncode == 0, done.stderr
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
    assert launched.run("m.h5", "--keep-shards").returncode == 0
    spent = [seconds_in(shard) for shard in launched.shards("m.h5")]
    # No more than two cases of a difference; half as much again for the scheduler of a busy machine.
    assert abs(spent[0] - spent[1]) < 3.0 * sum(spent) / 24


def test_failed_cases(launched, tmp_path):
    done = launched.run("m.h5", "--set", "integrator.max_steps=25")
    assert done.returncode == 5 and done.stderr.count("cases failed") == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_to_one_rank_stops_all(launched, tmp_path, number):
    process = launched.go("m.h5", *ENDLESS, ranks=3, stderr=subprocess.PIPE)
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
    # With another number of ranks it goes on, and repeats nothing.
    again = launched.run("m.h5", *ENDLESS, "--set", "output.wall_limit=2", ranks=2)
    assert again.returncode == 75
    now = [case for shard in launched.shards("m.h5") for case in cases_in(shard)]
    assert done <= set(now) and len(now) == len(set(now))


def test_a_signal_to_mpirun_reaches_the_ranks(launched):
    process = launched.go("m.h5", *ENDLESS, stderr=subprocess.PIPE)
    try:
        wait_until(lambda: sum(len(cases_in(shard)) for shard in launched.shards("m.h5")) > 1)
        process.send_signal(signal.SIGUSR1)
        assert process.wait(60) in STOPPED[launched.flavour]
        assert "stopped by SIGUSR1" in process.stderr.read()
    finally:
        end_group(process)


def test_progress_is_of_rank_0_only_and_of_all_ranks(launched):
    process = launched.go("m.h5", *ENDLESS, quiet=False, ranks=2, stderr=subprocess.PIPE)
    try:
        line = process.stderr.readline()
        assert " of 60 cases, 0 failed" in line
        process.send_signal(signal.SIGUSR1)
        assert process.wait(60) in STOPPED[launched.flavour]
        assert process.stderr.read().count(" of 60 cases, 0 failed") == 0
    finally:
        end_group(process)


def test_shards_are_not_for_ranks(launched):
    done = launched.run("m.h5", "--shard", "1/2")
    assert done.returncode == 1 and "--shard is for processes that know nothing of each other" in done.stderr


@pytest.mark.parametrize("other", ["serial", "other MPI"])
def test_copies_of_rank_0_of_1_are_refused(launched, tmp_path, other):
    """A program without MPI, or with another MPI, under mpirun."""
    launched.exe = executable()
    if other != "serial":
        launched.exe = skip_without(next(flavour for flavour in MPI if flavour != launched.flavour))
    done = launched.run("m.h5")
    assert done.returncode == 1 and done.stderr.count("this is one of 2 copies") == 1
    assert "they know nothing of each other" in done.stderr
    assert not (tmp_path / "m.h5").exists() and not launched.shards("m.h5")


def statuses(launched, *command):
    """Exit status of each of two ranks, and what they say."""
    script = 'rank=${OMPI_COMM_WORLD_RANK:-$PMI_RANK}; "$@"; echo $? > "status.$rank"'
    done = subprocess.run(
        [f"mpirun.{launched.flavour}", "-n", "2", "sh", "-c", script, "sh", launched.exe, *command],
        cwd=launched.folder,
        env=os.environ | ALLOWED | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    return [int((launched.folder / f"status.{rank}").read_text()) for rank in (0, 1)], done.stderr


def test_all_ranks_end_with_one_status(launched, tmp_path):
    """Also when the cases that failed were run before, by others."""
    deck = tmp_path / "failing.nml"
    deck.write_text(SHORT.replace("&integrator", "&integrator\n  max_steps = 5") + GRID)
    command = ("run", "failing.nml", "-o", "f.h5", "--keep-shards", "--quiet", "--overwrite")
    for _ in range(2):
        status, words = statuses(launched, *command)
        assert status == [5, 5]
        assert words.count("60 of 60 cases failed") == 1


@pytest.mark.parametrize(
    "command",
    [("run", "one.nml"), ("run", "map.nml", "failing.nml"), ("resume", "x.h5"), ("merge", "map.nml"), ("trade", "one.nml")],
)
def test_what_is_for_one_process_is_refused_to_ranks(launched, tmp_path, command):
    for name, text in (("one.nml", SHORT), ("map.nml", SHORT + GRID), ("failing.nml", SHORT + GRID)):
        (tmp_path / name).write_text(text)
    status, words = statuses(launched, *command)
    assert status == [1, 1]
    assert words.count("is for one process") == 1
    assert not list(tmp_path.glob("*.h5*"))
