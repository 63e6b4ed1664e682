"""Sweeps through a real Slurm of one node, with the scripts of jobs/ as they are; tests/slurm/run.sh starts the Slurm and these tests.

Whatever happens to shares, the same command again completes the sweep, with the bits of one thread.
"""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass
from pathlib import Path

import h5py
import pytest
from programs import ROOT, Program, executable
from sweeps import GRID, SCENE, Sweep, same, values

pytestmark = pytest.mark.skipif("SLURM_TEST_FOLDER" not in os.environ, reason="tests/slurm/run.sh starts the Slurm")

SHARES = 16
FAILING = "integrator.max_steps=5"
KILLED, FULL, STOPPED = 3, 7, 11
"""The shares to which something happens."""

FAULTY = f"""#!/bin/bash
# The program; at their first start one share has a full disk in the place of the folder out, and two get a signal after 0.4 s of
# processor time.
share=${{SLURM_ARRAY_TASK_ID:-$((SLURM_PROCID + 1))}}
case $1/$share in run/{KILLED}) signal=KILL ;; run/{FULL}) signal= ;; run/{STOPPED}) signal=USR1 ;; *) exec "$REAL" "$@" ;; esac
[[ ! -e fault.$share ]] || exec "$REAL" "$@"
touch "fault.$share"
[[ -n $signal ]] || exec unshare --mount sh -c 'mount -t tmpfs -o size=4k none out && exec "$REAL" "$@"' sh "$@"
"$REAL" "$@" &
while kill -0 $! && (($(awk '{{ print $14 }}' /proc/$!/stat) < 40)); do sleep 0.02; done
kill -s "$signal" $!
wait $!
"""


def deck(t_end: float = 1.0, count: str = "12, 20") -> str:
    return SCENE.replace("t_end = 10.0 ", f"t_end = {t_end} ") + GRID.replace("12, 5", count)


@pytest.fixture(scope="session")
def cpu_seconds(tmp_path_factory: pytest.TempPathFactory):
    """Gives a deck of 240 cases that take so long on one core: faster machines must not be done before the fault."""
    sweep = Sweep(tmp_path_factory.mktemp("pace"), deck(100.0))
    begun = os.times()
    sweep.run("pace.h5", "--share", "1/15", threads=1, status=0)
    ended = os.times()
    pace = (ended.children_user - begun.children_user) * 15.0 / 100.0
    return lambda seconds: deck(round(seconds / pace, 1))


def is_result_of_one_thread(sweep: Sweep, output: str, *arguments: str) -> bool:
    """Whether a complete file has the bits of one process with one thread."""
    if not (sweep.folder / "one.h5").exists():
        assert sweep.run("one.h5", *arguments, threads=1).returncode in (0, 5)
    with h5py.File(sweep.folder / output) as file:
        assert file.attrs["complete"] == 1
    return same(values(sweep.folder / "one.h5"), values(sweep.folder / output))


@dataclass
class Job:
    """A job of Slurm."""

    number: str
    log: Path

    @classmethod
    def submit(cls, sweep: Sweep, *command, env=None) -> Job:
        """`sbatch` with what all jobs here have in common."""
        log = sweep.folder / f"job{len(list(sweep.folder.glob('job*.log')))}.log"
        log.touch()
        options = ("sbatch", "--parsable", "--cpus-per-task=1", f"--output={log}")
        sbatch = Program(options, sweep.folder, {"DYNSTICTION": str(executable()), **(env or {})})
        return cls(sbatch(*command, status=0).stdout.strip(), log)

    def wait(self, seconds: float = 120.0) -> Job:
        end = time.monotonic() + seconds
        while queue := Program(("squeue", "-h", "-j", self.number))().stdout:
            assert time.monotonic() < end, f"the job does not end:\n{queue}\n{self.text()}"
            time.sleep(0.1)
        return self

    def facts(self, name: str) -> list[str]:
        """A value of each task of the job, as scontrol prints it."""
        shown = Program(("scontrol", "--oneliner", "show", "job", self.number))(status=0).stdout
        return re.findall(rf"\b{name}=(\S+)", shown)

    def text(self) -> str:
        return self.log.read_text()


def array(sweep: Sweep, indices: str, *options: str, output="m.h5", arguments=(), env=None) -> Job:
    script = ROOT / "jobs" / "slurm_array.sbatch"
    return Job.submit(sweep, f"--array={indices}", *options, script, sweep.deck, output, *arguments, env=env)


def start_job(kind: str, sweep: Sweep, output: str, env=None) -> Job:
    """An array of 16 tasks, or one job of 16 tasks."""
    if kind == "array":
        return array(sweep, f"1-{SHARES}", output=output, env=env)
    script = ROOT / "jobs" / "slurm_srun.sbatch"
    return Job.submit(sweep, f"--ntasks={SHARES}", script, sweep.deck, output, env=env)


@pytest.fixture(scope="session", autouse=True)
def limited_jobs(tmp_path_factory: pytest.TempPathFactory, cpu_seconds):
    """Two jobs that run while other tests do, until Slurm's signal before a limit of a minute: many cases, and a very long one.

    Slurm looks at limits every half a minute.
    """
    jobs = {}
    for name, text in (("many", cpu_seconds(45.0)), ("long", deck(1e7, "1, 2"))):
        sweep = Sweep(tmp_path_factory.mktemp(name), text)
        jobs[name] = sweep, array(sweep, "1-2", "--time=1", "--signal=USR1@60")
    return jobs


@pytest.mark.parametrize("kind", ["array", "srun"])
def test_a_killed_a_stopped_share_and_one_whose_disk_is_full(tmp_path, cpu_seconds, kind):
    """A stopped task of the array is requeued by itself; the same command again runs what is missing."""
    sweep = Sweep(tmp_path, cpu_seconds(16.0))
    faulty, out = tmp_path / "faulty.sh", tmp_path / "out"
    faulty.write_text(FAULTY)
    faulty.chmod(0o755)
    out.mkdir()
    if Program(("unshare", "--mount", "mount", "-t", "tmpfs", "none", out))().returncode:
        pytest.skip("a small disk cannot be mounted here")
    env = {"DYNSTICTION": str(faulty), "REAL": str(executable())}
    first = start_job(kind, sweep, "out/m.h5", env).wait()
    text = first.text()
    assert "stopped by SIGUSR1" in text and "not requeued" in text, text
    assert len([line for line in text.splitlines() if line.startswith("dynstiction: ") and "disk" in line]) == 1, text
    if kind == "array":
        assert sorted(first.facts("ExitCode")) == ["0:0"] * (SHARES - 2) + ["137:0", "3:0"], text
        assert ": requeued" in text and "start 2" in text and sorted(first.facts("Restarts"))[-2:] == ["0", "1"]
    else:
        assert first.facts("ExitCode") == ["137:0"], text
    finished = {i for i in range(1, SHARES + 1) if (out / f"m.{i}-of-{SHARES}.h5").exists()}
    assert finished == set(range(1, SHARES + 1)) - {KILLED, FULL}
    sweep.run("out/m.h5", command="merge", status=75)
    again = start_job(kind, sweep, "out/m.h5", env).wait()
    assert set(again.facts("JobState")) == {"COMPLETED"}, again.text()
    if kind == "array":
        sweep.run("out/m.h5", command="merge", status=0)
    assert is_result_of_one_thread(sweep, "out/m.h5")
    assert not list(out.glob("*.part"))


@pytest.mark.parametrize("indices", ["0-3", "1-7:2"])
def test_any_range_of_an_array(tmp_path, indices):
    sweep = Sweep(tmp_path, deck())
    job = array(sweep, indices).wait()
    assert job.facts("JobState") == ["COMPLETED"] * 4, job.text()
    assert len(list(tmp_path.glob("m.*-of-4.h5"))) == 4
    sweep.run("m.h5", command="merge", status=0)
    assert is_result_of_one_thread(sweep, "m.h5")


def test_what_no_array_can_divide_is_refused(tmp_path):
    sweep = Sweep(tmp_path, deck())
    irregular = array(sweep, "2,3,7")
    single = Job.submit(sweep, ROOT / "jobs" / "slurm_array.sbatch", sweep.deck, "m.h5").wait()
    irregular.wait()
    assert irregular.facts("ExitCode") == ["1:0"] * 3, irregular.text()
    assert "--share I/N" in irregular.text() and "not requeued" in irregular.text()
    assert single.facts("JobState") == ["FAILED"] and "this is no job array: sbatch --array=" in single.text()
    assert not list(tmp_path.glob("m.*"))


def test_cases_that_fail_do_not_keep_the_merge_from_starting(tmp_path):
    sweep = Sweep(tmp_path, deck())
    job = array(sweep, "1-2", arguments=("--set", FAILING))
    merge = f"{executable()} merge {sweep.deck} -o m.h5 --set {FAILING}"
    merged = Job.submit(sweep, f"--dependency=afterany:{job.number}", f"--wrap={merge}").wait()
    assert job.facts("ExitCode") == ["5:0"] * 2 and job.facts("Restarts") == ["0"] * 2
    assert merged.facts("ExitCode") == ["5:0"], merged.text()
    assert is_result_of_one_thread(sweep, "m.h5", "--set", FAILING)


def test_a_job_is_requeued_until_its_cases_are_done(limited_jobs):
    sweep, job = limited_jobs["many"]
    job.wait(300.0)
    assert job.facts("JobState") == ["COMPLETED"] * 2, job.text()
    assert "0" not in job.facts("Restarts") and "stopped by SIGUSR1" in job.text()
    for fact in (f"on {os.uname().nodename}", f"job {job.number}_1", "start 2", "m.2-of-2.h5"):
        assert fact in job.text(), fact
    sweep.run("m.h5", command="merge", status=0)
    assert is_result_of_one_thread(sweep, "m.h5")


def test_a_case_longer_than_the_limit_is_not_tried_for_ever(limited_jobs):
    _, job = limited_jobs["long"]
    job.wait(120.0)
    assert job.facts("ExitCode") == ["75:0"] * 2 and job.facts("Restarts") == ["0"] * 2, job.text()
    assert "not requeued: no case was finished" in job.text() and "--time" in job.text()
