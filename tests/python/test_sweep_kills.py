"""SIGKILL of a random worker at random moments: no finished case is lost, none is done twice, the final file has the same bits.

A few kills by default; `python tests/python/test_sweep_kills.py KILLS SEED` makes as many as wanted and prints what it saw.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from programs import end_group
from sweeps import GRID, SCENE, Sweep, cases_in, same, values

# 240 cases of some milliseconds.
DECK = SCENE.replace("t_end = 10.0", "t_end = 120.0") + GRID.replace("count = 12, 5", "count = 24, 10")
CASES = list(range(1, 241))
MPI = {"openmpi": "DYNSTICTION_OPENMPI_EXE", "mpich": "DYNSTICTION_MPICH_EXE"}
QUIET = {"stderr": subprocess.DEVNULL}
# More ranks than cores, and root, are fine for a test.
ALLOWED = dict.fromkeys(
    ("OMP_NUM_THREADS", "OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "OMPI_MCA_rmaps_base_oversubscribe"), "1"
)


class Threads:
    """One process with two threads; its workers die together."""

    longest_wait = 0.5

    def __init__(self, sweep, output):
        self.start = lambda: sweep.start(output, "--overwrite", "--keep-shards", **QUIET)
        self.process = self.start()

    def workers(self):
        return [self.process.pid] if self.process.poll() is None else []

    def restart(self):
        self.process.wait(60)
        self.process = self.start()

    def close(self):
        end_group(self.process)


class Array:
    """Three processes with a shard each; one dies, the others continue."""

    longest_wait = 0.5

    def __init__(self, sweep, output):
        shards = [("--shard", f"{i}/3", "--overwrite") for i in (1, 2, 3)]
        one = {"OMP_NUM_THREADS": "1"}
        self.starts = [lambda shard=shard: sweep.start(output, *shard, env=one, **QUIET) for shard in shards]
        self.processes = [start() for start in self.starts]

    def workers(self):
        return [process.pid for process in self.processes if process.poll() is None]

    def restart(self):
        for i, start in enumerate(self.starts):
            if self.processes[i].poll() not in (None, 0):
                self.processes[i] = start()

    def close(self):
        for process in self.processes:
            end_group(process)


class Ranks:
    """Three ranks of one MPI run; when one dies, mpirun ends the others. An mpirun that does not is killed too."""

    # It takes mpirun a while to start them.
    longest_wait = 2.0

    def __init__(self, sweep, output, flavour):
        self.sign = f"{sweep.folder / output}".encode()
        launcher = (f"mpirun.{flavour}", "-n", "3")
        options = ("--overwrite", "--keep-shards")
        self.start = lambda: sweep.start(output, *options, launcher=launcher, env=ALLOWED, **QUIET)
        self.process = self.start()

    def workers(self):
        """The ranks: processes with the output's name among their arguments, but for mpirun and its helpers."""
        found = []
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                arguments = (folder / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if self.sign in arguments and arguments[1:2] == [b"run"]:
                found.append(int(folder.name))
        return found

    def restart(self):
        try:
            if self.process.wait(20) == 0:
                # The rank had done all its work.
                return
        except subprocess.TimeoutExpired:
            print(f"{self.sign.decode()}: mpirun hangs after the death of a rank", file=sys.stderr)
            self.close()
        self.process = self.start()

    def close(self):
        end_group(self.process)
        for worker in self.workers():
            os.kill(worker, signal.SIGKILL)


def finished(sweep, output):
    """All finished cases in the shards."""
    return [case for shard in sweep.shards(output) for case in cases_in(shard)]


def check_partial_file(sweep, output, done):
    """The file that `merge` makes from the shards at any time is readable and holds at least the finished cases."""
    merged = sweep.run(output, "--overwrite", "--keep-shards", command="merge")
    assert merged.returncode in (0, 75), merged.stderr
    with h5py.File(sweep.folder / output) as file:
        assert file["sweep/case"][:].tolist() == CASES
        there = set(file["sweep/case"][:][file["sweep/result_code"][:] == 0].tolist())
        assert np.isfinite(file["sweep/summary/final_u_x"][:][file["sweep/result_code"][:] == 0]).all()
    assert done <= there


def kill_some(sweep, output, kind, kills, chance, reference):
    """Kill workers of one sweep until it is done, or `kills` times; what happened is returned."""
    seen = {"kills": 0, "cases at kills": []}
    workers = kind(sweep, output)
    try:
        while seen["kills"] < kills:
            before = set(finished(sweep, output))
            time.sleep(chance.uniform(0.0, workers.longest_wait))
            alive = workers.workers()
            if not alive:
                break
            os.kill(chance.choice(alive), signal.SIGKILL)
            seen["kills"] += 1
            seen["cases at kills"].append(len(finished(sweep, output)))
            workers.restart()
            now = finished(sweep, output)
            assert before <= set(now), "a finished case was lost"
            assert len(now) == len(set(now)), "a case was done twice"
            if chance.random() < 0.3 and now:
                check_partial_file(sweep, output, set(now))
    finally:
        workers.close()
    sweep.run(output, "--overwrite", "--keep-shards", status=0)
    assert sorted(finished(sweep, output)) == CASES, "cases are missing, or were done twice"
    assert same(values(sweep.folder / output), reference)
    return seen


def kill_workers(folder, kind, kills, seed, exe=None):
    """Sweep after sweep, until there have been enough kills."""
    sweep = Sweep(folder, DECK, exe)
    assert Sweep(folder, DECK).run("reference.h5").returncode == 0
    reference = values(folder / "reference.h5")
    chance = random.Random(seed)
    sweeps, done = [], 0
    while done < kills:
        sweeps.append(kill_some(sweep, f"{len(sweeps)}.h5", kind, kills - done, chance, reference))
        done += sweeps[-1]["kills"]
    return sweeps


def ranks_of(flavour):
    return lambda sweep, output: Ranks(sweep, output, flavour)


def skip_without(flavour):
    exe = os.environ.get(MPI[flavour])
    if not (exe and shutil.which(f"mpirun.{flavour}")):
        pytest.skip(f"no mpirun.{flavour}, or {MPI[flavour]} names no build with it: see tests/mpi/run.sh")
    return exe


@pytest.mark.parametrize("kind", [Threads, Array])
def test_a_few_kills(tmp_path, kind):
    kill_workers(tmp_path, kind, 3, 7)


@pytest.mark.parametrize("flavour", MPI)
def test_a_few_kills_of_ranks(tmp_path, flavour):
    kill_workers(tmp_path, ranks_of(flavour), 2, 11, skip_without(flavour))


@pytest.mark.full
@pytest.mark.parametrize(("kind", "kills"), [(Threads, 20), (Array, 20)])
def test_many_kills(tmp_path, kind, kills):
    kill_workers(tmp_path, kind, kills, 13)


@pytest.mark.full
@pytest.mark.parametrize("flavour", MPI)
def test_many_kills_of_ranks(tmp_path, flavour):
    kill_workers(tmp_path, ranks_of(flavour), 10, 17, skip_without(flavour))


def main():
    kills, seed = int(sys.argv[1]), int(sys.argv[2])
    kinds = {"threads": (Threads, None), "array": (Array, None)}
    for flavour, variable in MPI.items():
        if variable in os.environ:
            kinds[flavour] = (ranks_of(flavour), os.environ[variable])
    for i, (name, (kind, exe)) in enumerate(kinds.items()):
        share = kills // len(kinds) + (i < kills % len(kinds))
        with tempfile.TemporaryDirectory() as folder:
            sweeps = kill_workers(Path(folder), kind, share, seed + i, exe)
        total = sum(seen["kills"] for seen in sweeps)
        at = [count for seen in sweeps for count in seen["cases at kills"]]
        print(f"{name}: {total} kills in {len(sweeps)} sweeps, with {at} of 240 cases done: none lost, none twice", flush=True)


if __name__ == "__main__":
    main()
