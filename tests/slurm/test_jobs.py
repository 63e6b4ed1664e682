"""Sweeps through a real Slurm of one node: the scripts of jobs/ as they are, and steps in which something goes wrong.

tests/slurm/run.sh starts the Slurm and calls these tests. Whatever happens must end within 10 s of its cause, with the right status
and one message, and the next start must continue to the bits of one process.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import pytest
from programs import ROOT, Program, executable, small_disk, wait_until
from sweeps import GRID, SCENE, Sweep, cases_in, same, values

pytestmark = pytest.mark.skipif("SLURM_TEST_FOLDER" not in os.environ, reason="tests/slurm/run.sh starts the Slurm")

RANK = Path(__file__).with_name("rank.sh")
CASES = 60
MPI = {"pmix": "DYNSTICTION_OPENMPI_EXE", "pmi2": "DYNSTICTION_MPICH_EXE"}
AT_ONCE = 10.0  # s
SHORT = "scene.t_end=1"
FAILING = "integrator.max_steps=5"
ENDLESS = "scene.t_end=1e6"


def deck(t_end: float = 1.0) -> str:
    return SCENE.replace("t_end = 10.0 ", f"t_end = {t_end} ") + GRID


@pytest.fixture(scope="session")
def cpu_seconds(tmp_path_factory: pytest.TempPathFactory):
    """Gives a deck of 60 cases that take so long on one core: faster machines must not be done before the fault."""
    sweep = Sweep(tmp_path_factory.mktemp("pace"), deck(1000.0))
    begun = time.monotonic()
    sweep.run("pace.h5", "--shard", "1/15", threads=1, status=0)
    pace = (time.monotonic() - begun) * 15.0 / 1000.0
    return lambda seconds: deck(round(seconds / pace, 1))


def is_result_of_one_process(sweep: Sweep, output: str, *arguments: str) -> bool:
    """Whether a complete file has the bits of one process."""
    reference = Sweep(sweep.folder, sweep.deck.read_text())
    if not (sweep.folder / "one.h5").exists():
        assert reference.run("one.h5", *arguments).returncode in (0, 5)
    with h5py.File(sweep.folder / output) as file:
        assert file.attrs["complete"] == 1
    assert not sweep.shards(output)
    return same(values(sweep.folder / "one.h5"), values(sweep.folder / output))


def finished(sweep: Sweep, output: str) -> int:
    return sum(len(cases_in(shard)) for shard in sweep.shards(output))


def messages(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("dynstiction: ")]


# Jobs: the scripts


@dataclass
class Job:
    """A job of Slurm."""

    number: str
    log: Path

    @classmethod
    def submit(cls, folder: Path, *command, env=None) -> Job:
        """`sbatch` with what all jobs here have in common."""
        log = folder / f"{len(list(folder.glob('job*.log')))}.log"
        log = log.with_name("job" + log.name)
        log.touch()
        sbatch = Program(
            ("sbatch", "--parsable", "--cpus-per-task=1", f"--output={log}"), folder, {"DYNSTICTION": str(executable())}
        )
        return cls(sbatch(*command, env=env, status=0).stdout.strip(), log)

    def queued(self) -> bool:
        return bool(Program(("squeue", "-h", "-j", self.number))().stdout)

    def wait(self, seconds: float = 60.0) -> Job:
        end = time.monotonic() + seconds
        while self.queued():
            assert time.monotonic() < end, f"the job does not end:\n{self.text()}"
            time.sleep(0.1)
        return self

    def facts(self, name: str) -> list[str]:
        """A value of each task of the job, as scontrol prints it."""
        shown = Program(("scontrol", "--oneliner", "show", "job", self.number))(status=0).stdout
        return re.findall(rf"\b{name}=(\S+)", shown)

    def text(self) -> str:
        return self.log.read_text()


def array(sweep: Sweep, indices: str, output: str, *options: str, arguments=(), env=None) -> Job:
    script = ROOT / "jobs" / "slurm_array.sbatch"
    return Job.submit(sweep.folder, f"--array={indices}", *options, script, sweep.deck, output, *arguments, env=env)


def mpi_job(sweep: Sweep, flavour: str, output: str, *options: str, arguments=()) -> Job:
    script = ROOT / "jobs" / "slurm_mpi.sbatch"
    env = {"DYNSTICTION": mpi_program(flavour), "SLURM_MPI_TYPE": flavour}
    words = ("--ntasks-per-node=3", *options, script, sweep.deck, output, "--quiet", *arguments)
    return Job.submit(sweep.folder, *words, env=env)


def start_job(kind: str, sweep: Sweep, output: str) -> Job:
    """A job over MPI, or an array of two tasks."""
    return array(sweep, "1-2", output) if kind == "array" else mpi_job(sweep, kind, output)


def check_result(kind: str, sweep: Sweep, output: str) -> None:
    if kind == "array":
        sweep.run(output, command="merge", status=0)
    assert is_result_of_one_process(sweep, output)


def mpi_program(flavour: str) -> str:
    program = os.environ.get(MPI[flavour])
    if not program:
        pytest.skip(f"{MPI[flavour]} names no program")
    known = Program(("srun", "--mpi=list"))()
    if flavour not in known.stdout + known.stderr:
        pytest.skip(f"this srun does not know {flavour}")
    return program


@pytest.fixture(scope="session")
def limited_jobs(tmp_path_factory: pytest.TempPathFactory, cpu_seconds):
    """Two jobs that run while other tests do, until Slurm's signal before a limit of a minute: many cases, and a very long one.

    Slurm looks at limits every half a minute.
    """
    jobs = {}
    for name, text, grid in (("many", cpu_seconds(45.0), "12,5"), ("long", deck(1e7), "1,1")):
        sweep = Sweep(tmp_path_factory.mktemp(name), text)
        options = ("--time=1", "--signal=USR1@60")
        jobs[name] = sweep, array(sweep, "1", "m.h5", *options, arguments=("--set", f"sweep.count={grid}"))
    return jobs


@pytest.fixture(scope="session", autouse=True)
def started_early(limited_jobs):
    """What takes longest begins first."""


@pytest.mark.parametrize("indices", ["1-4", "0-3", "1-7:2"])
def test_any_range_of_an_array(tmp_path, indices):
    sweep = Sweep(tmp_path, deck())
    job = array(sweep, indices, "m.h5").wait()
    assert job.facts("JobState") == ["COMPLETED"] * 4, job.text()
    assert len(sweep.shards("m.h5")) == 4
    sweep.run("m.h5", command="merge", status=0)
    assert is_result_of_one_process(sweep, "m.h5")


def test_a_failed_index_is_run_again_by_its_number(tmp_path):
    """And so is an irregular list of them; a merge that waits for the array by afterany shows what is missing meanwhile."""
    sweep = Sweep(tmp_path, deck())
    dying = tmp_path / "dying.sh"
    dying.write_text('#!/bin/sh\ncase $SLURM_ARRAY_TASK_ID/$1 in [236]/run) kill -KILL $$ ;; esac\nexec "$REAL" "$@"\n')
    dying.chmod(0o755)
    first = array(sweep, "1-6", "m.h5", env={"DYNSTICTION": str(dying), "REAL": str(executable())})
    merge = f"{executable()} merge {sweep.deck} -o m.h5"
    look = Job.submit(tmp_path, f"--dependency=afterany:{first.number}", f"--wrap={merge}").wait()
    assert sorted(first.facts("JobState")) == ["COMPLETED"] * 3 + ["FAILED"] * 3
    assert "not requeued" in first.text()
    assert look.facts("ExitCode") == ["75:0"], look.text()
    with h5py.File(tmp_path / "m.h5") as file:
        assert file.attrs["complete"] == 0
    for indices, count in (("3", 1), ("2,6", 2)):
        again = array(sweep, indices, "m.h5").wait()
        assert again.facts("JobState") == ["COMPLETED"] * count, again.text()
    assert len(sweep.shards("m.h5")) == 6
    assert sorted(case for shard in sweep.shards("m.h5") for case in cases_in(shard)) == list(range(1, CASES + 1))
    sweep.run("m.h5", command="merge", status=0)
    assert is_result_of_one_process(sweep, "m.h5")


def test_what_no_array_can_divide_is_refused(tmp_path):
    sweep = Sweep(tmp_path, deck())
    irregular = array(sweep, "2,3,7", "m.h5")
    script = ROOT / "jobs" / "slurm_array.sbatch"
    single = Job.submit(tmp_path, script, sweep.deck, "m.h5")
    irregular.wait()
    single.wait()
    assert irregular.facts("ExitCode") == ["1:0"] * 3, irregular.text()
    assert "--array" in irregular.text() and "not requeued" in irregular.text()
    assert single.facts("JobState") == ["FAILED"] and "this is no job array: sbatch --array=" in single.text()
    assert not list(tmp_path.glob("m.h5*"))


def test_cases_that_fail_do_not_keep_the_merge_from_starting(tmp_path):
    sweep = Sweep(tmp_path, deck())
    job = array(sweep, "1-2", "m.h5", arguments=("--set", FAILING))
    merge = f"{executable()} merge {sweep.deck} -o m.h5 --set {FAILING}"
    merged = Job.submit(tmp_path, f"--dependency=afterany:{job.number}", f"--wrap={merge}").wait()
    assert job.facts("ExitCode") == ["5:0"] * 2 and job.facts("Restarts") == ["0"] * 2
    assert merged.facts("ExitCode") == ["5:0"], merged.text()
    assert is_result_of_one_process(sweep, "m.h5", "--set", FAILING)


@pytest.mark.parametrize("kind", ["array", *MPI])
def test_a_full_disk_ends_a_job(tmp_path, kind):
    """And room lets the same command go on."""
    sweep = Sweep(tmp_path, deck())
    with small_disk(tmp_path / "disk", "8k") as grow:
        job = start_job(kind, sweep, "disk/m.h5").wait()
        assert set(job.facts("ExitCode")) == {"3:0"} and set(job.facts("Restarts")) == {"0"}, job.text()
        said = messages(job.text())
        assert len(said) == len(job.facts("ExitCode")) and all("disk" in line for line in said), said
        assert "not requeued" in job.text()
        grow("8m")
        assert set(start_job(kind, sweep, "disk/m.h5").wait().facts("JobState")) == {"COMPLETED"}
        check_result(kind, sweep, "disk/m.h5")


@pytest.mark.parametrize("kind", ["array", *MPI])
def test_a_look_while_a_job_runs(tmp_path, cpu_seconds, kind):
    """A merge, then the signal before the limit; the job is requeued and goes on. Its log says what a support desk asks for."""
    sweep = Sweep(tmp_path, cpu_seconds(8.0), exe=None if kind == "array" else mpi_program(kind))
    job = start_job(kind, sweep, "m.h5")
    wait_until(lambda: finished(sweep, "m.h5") > 5)
    sweep.run("m.h5", command="merge", status=75)
    Program(("scancel", "--signal=USR1"))(job.number, status=0)
    job.wait(120.0)
    text = job.text()
    assert set(job.facts("JobState")) == {"COMPLETED"}, text
    assert "requeued" in text and "not requeued" not in text and "start 2" in text
    for fact in (f"on {os.uname().nodename}", f"job {job.number}", "start 1", "dynstiction 0", "MPI", "thread"):
        assert fact in text, fact
    check_result(kind, sweep, "m.h5")


@pytest.mark.parametrize("kind", ["array", *(pytest.param(name, marks=pytest.mark.full) for name in MPI)])
def test_a_job_that_is_cancelled(tmp_path, cpu_seconds, kind):
    """It is not requeued; started again it goes on."""
    sweep = Sweep(tmp_path, cpu_seconds(4.0))
    job = start_job(kind, sweep, "m.h5")
    wait_until(lambda: finished(sweep, "m.h5") > 5)
    done = finished(sweep, "m.h5")
    Program(("scancel",))(job.number, status=0)
    job.wait(AT_ONCE)
    assert set(job.facts("JobState")) == {"CANCELLED"} and set(job.facts("Restarts")) == {"0"}, job.text()
    assert "stopped by SIGTERM" in job.text() and finished(sweep, "m.h5") >= done
    assert set(start_job(kind, sweep, "m.h5").wait().facts("JobState")) == {"COMPLETED"}
    check_result(kind, sweep, "m.h5")


# Steps: srun

ALL_RANKS = Program(("scancel", "--user=root", "--name=rank.sh"))


@dataclass
class Step:
    """`srun` of a sweep over MPI, with its ranks' process ids in files."""

    sweep: Sweep
    flavour: str
    ranks: int = 3
    output: str = "m.h5"
    in_own_folder: bool = False  # each rank finds the output from its own working folder
    process: subprocess.Popen = field(init=False)

    def start(self, *arguments: str, fault: str = "", faulty=(), command: str = "run", program: str = "") -> Step:
        for pid in self.sweep.folder.glob("pid.*"):
            pid.unlink()
        srun = ("srun", f"--mpi={self.flavour}", f"--ntasks={self.ranks}", "--kill-on-bad-exit=0", "--wait=5", RANK)
        env = {"OMP_NUM_THREADS": "1", "FAULT": fault, "FAULT_RANKS": " ".join(map(str, faulty))}
        output = self.output if self.in_own_folder else self.sweep.folder / self.output
        words = (program or mpi_program(self.flavour), command, self.sweep.deck.name, "-o", output, "--quiet", *arguments)
        self.process = Program(srun, self.sweep.folder, env).start(*words, stdout=subprocess.PIPE)
        return self

    def end(self, seconds: float = AT_ONCE) -> tuple[int, str]:
        """Status and what was said. It must end in time."""
        try:
            said = "".join(self.process.communicate(timeout=seconds))
        except subprocess.TimeoutExpired:
            ALL_RANKS("--signal=KILL")
            self.process.kill()
            pytest.fail(f"it has not ended {seconds} s after its cause:\n{''.join(self.process.communicate())}")
        return self.process.returncode, said

    def until_running(self) -> Step:
        wait_until(lambda: finished(self.sweep, self.output) > 5)
        return self

    def send(self, number: signal.Signals, ranks) -> None:
        for rank in ranks:
            os.kill(int((self.sweep.folder / f"pid.{rank}").read_text()), number)

    def goes_on(self) -> None:
        """The next start is undisturbed and ends with the bits of one process."""
        status, said = self.start().end(120.0)
        assert status == 0, said
        assert is_result_of_one_process(self.sweep, self.output)


@pytest.fixture(params=list(MPI))
def step(request, tmp_path) -> Step:
    mpi_program(request.param)
    return Step(Sweep(tmp_path, deck()), request.param)


WHO = {"rank 0": (0,), "another": (1,), "all": (0, 1, 2)}
SOME = [("rank 0", True), ("another", False), ("all", True)]
who = pytest.mark.parametrize(
    "faulty", [pytest.param(WHO[name], id=name, marks=pytest.mark.full if full else ()) for name, full in SOME]
)
every_who = pytest.mark.parametrize("faulty", WHO.values(), ids=list(WHO))


@who
@pytest.mark.parametrize(
    ("fault", "status"),
    [("kill -KILL $$", 137), ("exit 1", 1), pytest.param("kill -TERM $$", 143, marks=pytest.mark.full),
     pytest.param("kill -USR1 $$", 138, marks=pytest.mark.full)],
)  # fmt: skip
def test_a_rank_that_dies_before_mpi(step, faulty, fault, status):
    """The largest status of all ranks is srun's; those that wait in vain are killed by it."""
    found, said = step.start(fault=fault, faulty=faulty).end()
    assert found in (status, 137), said
    assert not messages(said)
    step.goes_on()


@every_who
def test_a_folder_that_a_rank_does_not_see(step, faulty):
    (step.sweep.folder / "elsewhere").mkdir()
    (step.sweep.folder / "results").mkdir()
    (step.sweep.folder / "elsewhere" / step.sweep.deck.name).write_text(step.sweep.deck.read_text())
    step.output, step.in_own_folder = "results/m.h5", True
    status, said = step.start(fault="cd elsewhere", faulty=faulty).end()
    assert status == 3 and len(messages(said)) == 1, said
    step.goes_on()


@every_who
def test_a_bad_deck(step, faulty):
    """The first rank alone reads it."""
    (step.sweep.folder / "elsewhere").mkdir()
    (step.sweep.folder / "elsewhere" / step.sweep.deck.name).write_text("&scene t_ent = 1.0 /\n")
    status, said = step.start(fault="cd elsewhere", faulty=faulty).end()
    if 0 in faulty:
        assert status == 2 and len(messages(said)) == len(set(messages(said))) > 0, said
        step.goes_on()
    else:
        assert status == 0, said
        assert is_result_of_one_process(step.sweep, "m.h5")


def test_a_file_that_exists(step):
    (step.sweep.folder / "m.h5").write_text("somebody's")
    status, said = step.start().end()
    assert status == 3 and len(messages(said)) == 1, said
    assert (step.sweep.folder / "m.h5").read_text() == "somebody's"
    (step.sweep.folder / "m.h5").unlink()
    step.goes_on()


@who
def test_a_slow_start(step, faulty):
    status, said = step.start(fault="sleep 4", faulty=faulty).end(30.0)
    assert status == 0, said
    assert is_result_of_one_process(step.sweep, "m.h5")


@who
@pytest.mark.parametrize(
    ("number", "status"),
    [(signal.SIGKILL, (137,)), pytest.param(signal.SIGTERM, (75,), marks=pytest.mark.full),
     pytest.param(signal.SIGUSR1, (75,), marks=pytest.mark.full)],
)  # fmt: skip
def test_a_signal_to_a_running_rank(step, cpu_seconds, faulty, number, status):
    step.sweep.deck.write_text(cpu_seconds(4.0))
    step.start().until_running().send(number, faulty)
    found, said = step.end()
    assert found in status, said
    assert len(messages(said)) == (1 if status == (75,) else 0), said
    step.goes_on()


@pytest.mark.parametrize("name", ["TERM", pytest.param("USR1", marks=pytest.mark.full)])
def test_a_signal_to_all_ranks(step, cpu_seconds, name):
    """As the time limit sends it."""
    step.sweep.deck.write_text(cpu_seconds(4.0))
    step.start().until_running()
    ALL_RANKS(f"--signal={name}", status=0)
    status, said = step.end()
    assert status == 75 and len(messages(said)) == 1, said
    step.goes_on()


@pytest.mark.full
def test_a_signal_to_srun(step, cpu_seconds):
    """Of SIGTERM it makes SIGKILL."""
    step.sweep.deck.write_text(cpu_seconds(4.0))
    step.start().until_running().process.terminate()
    status, said = step.end()
    assert status == 137 and not messages(said), said
    step.goes_on()


@pytest.mark.parametrize("faulty", [pytest.param((0,), id="rank 0", marks=pytest.mark.full), pytest.param((1,), id="another")])
@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGUSR1, marks=pytest.mark.full)])
def test_a_rank_that_stands_still_while_the_others_stop(step, cpu_seconds, faulty, number):
    step.sweep.deck.write_text(cpu_seconds(4.0))
    step.start().until_running().send(signal.SIGSTOP, faulty)
    step.send(number, set(range(step.ranks)) - set(faulty))
    status, said = step.end()
    assert status in (75, 137), said
    assert len(messages(said)) == 1, said
    step.goes_on()


@who
def test_a_slow_rank(step, cpu_seconds, faulty):
    step.sweep.deck.write_text(cpu_seconds(3.0))
    step.start().until_running().send(signal.SIGSTOP, faulty)
    time.sleep(3.0)
    step.send(signal.SIGCONT, faulty)
    status, said = step.end(60.0)
    assert status == 0, said
    assert is_result_of_one_process(step.sweep, "m.h5")


@pytest.mark.full
@every_who
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_while_all_stop(step, cpu_seconds, faulty, number):
    step.sweep.deck.write_text(cpu_seconds(4.0))
    step.start().until_running().send(signal.SIGUSR1, (2,))
    with contextlib.suppress(ProcessLookupError):
        step.send(number, faulty)
    status, said = step.end()
    assert status in ((75, 137) if number == signal.SIGKILL else (75, 128 + number)), said
    assert len(messages(said)) <= 1, said
    step.goes_on()


@pytest.mark.full
@every_who
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGUSR1])
def test_a_signal_while_the_shards_are_merged(step, faulty, number):
    """200 000 cases, so that it takes a while."""
    step.sweep.deck.write_text(deck(0.01).replace("count = 12, 5", "count = 400, 500").replace("'radau9'", "'rodas4p'"))
    before = set(step.sweep.folder.iterdir())

    def merging() -> bool:
        new = {path.name for path in set(step.sweep.folder.iterdir()) - before}
        return any(not re.match(r"m\.h5\.shard-|pid\.", name) for name in new)

    step.start()
    wait_until(lambda: merging() or step.process.poll() is not None)
    with contextlib.suppress(ProcessLookupError):
        step.send(number, faulty)
    status, said = step.end()
    assert status in (0, 75, 128 + number, 137), said
    assert len(messages(said)) <= 1, said
    if not (step.sweep.folder / "m.h5").exists():
        step.goes_on()
    elif step.sweep.shards("m.h5"):
        assert step.start().end(60.0)[0] == 0
    assert is_result_of_one_process(step.sweep, "m.h5")


@pytest.mark.full
@pytest.mark.parametrize("fault", ["folder", "file"])
def test_what_is_in_the_way_at_the_end(step, cpu_seconds, fault):
    """The folder is renamed, or somebody takes the result's name, while cases run."""
    step.sweep.deck.write_text(cpu_seconds(3.0))
    results, renamed = step.sweep.folder / "results", step.sweep.folder / "renamed"
    results.mkdir()
    step.output = "results/m.h5"
    step.start().until_running()
    if fault == "folder":
        results.rename(renamed)
    else:
        (results / "m.h5").write_text("somebody's")
    status, said = step.end(30.0)
    assert status == 3 and len(messages(said)) == 1, said
    if fault == "folder":
        renamed.rename(results)
    else:
        (results / "m.h5").unlink()
    step.goes_on()


def test_a_step_of_tasks_without_mpi(step):
    """Each task takes its share; without --shard they are refused."""
    status, said = step.start(program=executable()).end()
    assert status == 1 and len(messages(said)) == 1, said
    status, said = step.start("--shard", "auto", program=executable()).end()
    assert status == 0, said
    assert len(step.sweep.shards("m.h5")) == step.ranks
    step.sweep.run("m.h5", command="merge", status=0)
    assert is_result_of_one_process(step.sweep, "m.h5")


def test_what_is_no_sweep_is_run_once(step):
    step.sweep.deck.write_text(SCENE)
    for command, status in (("run", 0), ("run", 3)):
        found, said = step.start(command=command).end(30.0)
        assert found == status and len(messages(said)) == status // 3, said


# At the end: the jobs that were started first


def test_a_job_is_requeued_until_its_cases_are_done(limited_jobs):
    sweep, job = limited_jobs["many"]
    job.wait(300.0)
    assert job.facts("JobState") == ["COMPLETED"], job.text()
    assert int(job.facts("Restarts")[0]) > 0 and "stopped by SIGUSR1" in job.text()
    sweep.run("m.h5", command="merge", status=0)
    assert is_result_of_one_process(sweep, "m.h5")


def test_a_case_longer_than_the_limit_is_not_tried_for_ever(limited_jobs):
    _, job = limited_jobs["long"]
    job.wait(120.0)
    assert job.facts("ExitCode") == ["75:0"] and job.facts("Restarts") == ["0"], job.text()
    assert "not requeued: no case was finished" in job.text() and "--time" in job.text()
