"""A sweep by threads, shares, stops and kills gives one table, and nothing that belongs to anybody else is touched."""

from __future__ import annotations

import resource
import shutil

import h5py
import numpy as np
import pytest
from damage import flipped
from programs import end_group, limited, wait_until
from sweeps import GRID, SCENE, Sweep, same, values

# 12 cases of a moment; each of a second; 60 of some milliseconds.
SMALL = SCENE.replace("t_end = 10.0", "t_end = 1.0") + GRID.replace("count = 12, 5", "count = 4, 3")
ENDLESS = ("--set", "scene.t_end=2000000")


@pytest.fixture
def sweep(tmp_path):
    return Sweep(tmp_path, SMALL)


def names(folder):
    return sorted(path.name for path in folder.glob("*.h5*"))


def run_shares(sweep, count, *arguments, output="a.h5", **options):
    for i in range(1, count + 1):
        sweep.run(output, "--share", f"{i}/{count}", *arguments, **options)


# --- the same bits


@pytest.mark.parametrize("keep", ["summary", "series", "cycles"])
@pytest.mark.parametrize("method", ["radau9", "rodas4p"])
def test_threads_and_shares_change_nothing(sweep, tmp_path, keep, method):
    wanted = ("--set", f"sweep.keep={keep}", "--set", f"integrator.method={method}", "--set", "output.interval=auto")
    if keep == "series":
        if method == "rodas4p":
            pytest.skip("its lanes keep no series")
        wanted = (*wanted[:-1], "output.interval=0.1")
    for threads in (1, 5):
        sweep.run(f"{threads}.h5", *wanted, threads=threads, status=0)
    run_shares(sweep, 5, *wanted, threads=1, status=0)
    sweep.run("a.h5", *wanted, command="merge", status=0)
    first = values(tmp_path / "1.h5")
    assert same(first, values(tmp_path / "5.h5")) and same(first, values(tmp_path / "a.h5"))


def test_the_file_of_a_share(sweep, tmp_path):
    sweep.run("a.h5", status=0)
    sweep.run("a.h5", "--share", "2/5", status=0)
    whole, part = values(tmp_path / "a.h5"), values(tmp_path / "a.2-of-5.h5")
    assert part["case"].tolist() == [2, 7, 12]
    for name in ("system.misalignment_deg", "summary/period", "result_code"):
        assert part[name].tobytes() == whole[name][[1, 6, 11]].tobytes()
    with h5py.File(tmp_path / "a.2-of-5.h5") as file:
        assert file.attrs["share"] == "2/5" and file.attrs["complete"] == 1
        assert (file.attrs["cases_done"], file.attrs["cases_failed"]) == (3, 0)
        assert file["sweep"].attrs["grid"] == "list"


def test_many_blocks(tmp_path):
    """Rows are written in blocks of some thousand; shares of all are joined window by window."""
    sweep = Sweep(tmp_path, SMALL.replace("count = 4, 3", "count = 90, 70").replace("'radau9'", "'rodas4p'"))
    short = ("--set", "scene.t_end=0.01", "--set", "integrator.method=rodas4p", "--set", "integrator.rtol=1e-3")
    sweep.run("whole.h5", *short, status=0)
    run_shares(sweep, 2, *short, status=0)
    sweep.run("a.h5", *short, command="merge", status=0)
    assert same(values(tmp_path / "whole.h5"), values(tmp_path / "a.h5"))


def test_more_shares_than_cases_and_than_open_files(sweep, tmp_path):
    run_shares(sweep, 14, threads=1, status=0)
    assert len(names(tmp_path)) == 12
    sweep.run("a.h5", command="merge", preexec_fn=limited(resource.RLIMIT_NOFILE, 10), status=0)
    sweep.run("b.h5", status=0)
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))


# --- stops and kills


def test_the_wall_limit(sweep, tmp_path):
    limit = ("--set", "output.wall_limit=1e-3")
    assert "stopped at output.wall_limit" in sweep.run("a.h5", *ENDLESS, *limit, status=75).stderr
    assert names(tmp_path) == []
    # The limit is no part of what a case is.
    sweep.run("a.h5", "--set", "output.wall_limit=100", "--set", "scene.title=other", "--share", "1/2", status=0)
    sweep.run("a.h5", "--share", "2/2", status=0)
    sweep.run("a.h5", command="merge", status=0)


def test_interims_copy_what_there_is(tmp_path):
    """Series and failures come through any number of interim files, and through a merge."""
    sweep = Sweep(tmp_path)
    wanted = ("--set", "sweep.keep=series", "--set", "output.interval=0.05", "--set", "integrator.max_steps=600")
    sweep.run("b.h5", *wanted, status=5)
    sweep.run("a.h5", *wanted, "--set", "output.checkpoint_interval=1e-9", threads=1, status=5)
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))
    failed = values(tmp_path / "a.h5")["failures/case"]
    assert 0 < len(failed) < 60
    run_shares(sweep, 2, *wanted, output="c.h5")
    sweep.run("c.h5", *wanted, command="merge", status=5)
    assert same(values(tmp_path / "c.h5"), values(tmp_path / "b.h5"))


# --- started again


def test_a_complete_share_has_nothing_to_do(sweep, tmp_path):
    for limit, status in (((), 0), (("--set", "integrator.max_steps=25"), 5)):
        output = f"{status}.h5"
        sweep.run(output, "--share", "1/2", *limit, status=status)
        path = tmp_path / f"{status}.1-of-2.h5"
        before = path.read_bytes()
        sweep.run(output, "--share", "1/2", *limit, status=status)
        assert path.read_bytes() == before
        sweep.run(output, "--share", "1/2", "--overwrite", *limit, status=status)
        assert path.read_bytes() != before


def test_retry_runs_failed_cases_again(sweep, tmp_path):
    sweep.run("b.h5", status=0)
    sweep.run("a.h5", status=0)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        times = file["sweep/wall_time"][:]
        file["sweep/result_code"][[2, 9]] = 42
        file["sweep/failures/case"].resize((2,))
        file["sweep/failures/case"][:] = [3, 10]
        file["sweep/failures/result_text"].resize((2,))
        file["sweep/failures/result_text"][:] = ["one reason", "another"]
        file.attrs["cases_failed"] = 2
    assert "--retry" in sweep.run("a.h5", status=5).stderr
    sweep.run("a.h5", "--retry", status=0)
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))
    with h5py.File(tmp_path / "a.h5") as file:
        assert np.flatnonzero(file["sweep/wall_time"][:] != times).tolist() == [2, 9]
        assert file.attrs["cases_failed"] == 0


def test_what_may_be_replaced(sweep, tmp_path):
    other = ("--set", "integrator.rtol=1e-5")
    sweep.run("a.h5", status=0)
    before = (tmp_path / "a.h5").read_bytes()
    assert "the file exists" in sweep.run("a.h5", *other, status=3).stderr
    assert (tmp_path / "a.h5").read_bytes() == before
    sweep.run("a.h5", *other, "--overwrite", status=0)
    (tmp_path / "notes.h5").write_text("mine")
    sweep.run("notes.h5", "--overwrite", status=3)
    assert (tmp_path / "notes.h5").read_text() == "mine"
    # All names are checked before the first deck is run.
    (tmp_path / "other.nml").write_text(SMALL.replace("low_frequency.h5", "other.h5"))
    run = ("run", "map.nml", "other.nml", "--quiet")
    sweep.program(*run, cwd=tmp_path, status=0)
    (tmp_path / "low_frequency.h5").unlink()
    done = sweep.program(*run, "--set", "integrator.rtol=1e-5", cwd=tmp_path, status=3)
    assert done.stderr.count("the file exists") == 1 and not (tmp_path / "low_frequency.h5").exists()


def test_another_build(sweep, tmp_path):
    sweep.run("a.h5", "--share", "1/2", status=0)
    with h5py.File(tmp_path / "a.1-of-2.h5", "r+") as file:
        file.attrs["sweep_build"] = "0" * 16
    for command in (("--share", "1/2"), ()):
        done = sweep.run("a.h5", *command, command="run" if command else "merge", status=3)
        assert "is of another build of the program" in done.stderr
    sweep.run("a.h5", "--share", "1/2", "--overwrite", status=0)


def test_two_at_once(sweep, tmp_path):
    first = sweep.start("a.h5", *ENDLESS, "--share", "1/2")
    try:
        wait_until((tmp_path / "a.1-of-2.h5.part").exists)
        for extra in (ENDLESS, ("--overwrite",)):
            assert "another process is writing this file" in sweep.run("a.h5", "--share", "1/2", *extra, status=3).stderr
        assert first.poll() is None and names(tmp_path) == ["a.1-of-2.h5.part"]
    finally:
        end_group(first)
    sweep.run("a.h5", "--share", "1/2", status=0)


# --- merge


def test_a_merge_of_some_shares(sweep, tmp_path):
    assert "there is no file of a share" in sweep.run("a.h5", command="merge", status=3).stderr
    for i in (1, 3):
        sweep.run("a.h5", "--share", f"{i}/3", status=0)
    shown = sweep.program("show", tmp_path / "a.h5", status=0).stdout
    assert shown.count("4 of 4 cases done, 0 failed") == 2 and "no file of a share I/3 with I = 2\n" in shown
    assert "4 of 12 cases have not been run" in sweep.run("a.h5", command="merge", status=75).stderr
    found = values(tmp_path / "a.h5")
    assert np.flatnonzero(found["result_code"] == -1).tolist() == [1, 4, 7, 10]
    assert np.isnan(found["summary/period"][1::3]).all() and found["case"].tolist() == list(range(1, 13))
    shutil.copy(tmp_path / "a.h5", tmp_path / "c.h5")
    # What is missing comes from a share, or is run by a process that has no share.
    sweep.run("a.h5", "--share", "2/3", status=0)
    sweep.run("a.h5", command="merge", status=0)
    sweep.run("c.h5", status=0)
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "c.h5"))
    assert len(list(tmp_path.glob("a.*-of-3.h5"))) == 3
    assert "the file is complete" in sweep.run("a.h5", command="merge", status=3).stderr
    sweep.run("a.h5", "--overwrite", command="merge", status=0)


def test_foreign_and_damaged_shares_are_refused_and_left(sweep, tmp_path):
    run_shares(sweep, 2, status=0)
    share = tmp_path / "a.2-of-2.h5"
    good = share.read_bytes()
    sweep.run("b.h5", "--share", "2/2", "--set", "integrator.rtol=1e-5", status=0)
    other = (tmp_path / "b.2-of-2.h5").read_bytes()
    first = (tmp_path / "a.1-of-2.h5").read_bytes()
    for content, words in (
        (flipped(good, len(good) // 2, 2), "its checksum is not that of its bytes"),
        (good[: len(good) // 2], "cannot be read"),
        (b"my notes", "cannot be read"),
        (other, "is no share of this sweep"),
        (first, "is no share of this sweep"),
    ):
        share.write_bytes(content)
        done = sweep.run("a.h5", command="merge", status=3)
        assert words in done.stderr and str(share) in done.stderr
        assert share.read_bytes() == content and not (tmp_path / "a.h5").exists()
    share.write_bytes(good)
    (tmp_path / "a.1-of-3.h5").write_bytes(first)
    assert "of different divisions" in sweep.run("a.h5", command="merge", status=3).stderr
    assert "is of another division: use --share I/" in sweep.run("a.h5", "--share", "2/4", status=3).stderr


# --- the environment

ARRAY = {"SLURM_ARRAY_TASK_ID": "7", "SLURM_ARRAY_TASK_MIN": "3", "SLURM_ARRAY_TASK_MAX": "9", "SLURM_ARRAY_TASK_STEP": "2"}
STEP = {"SLURM_STEP_NUM_TASKS": "3", "SLURM_PROCID": "1", "SLURM_NTASKS": "3"}


@pytest.mark.parametrize(
    ("environment", "share"),
    [
        ({**ARRAY, "SLURM_ARRAY_TASK_COUNT": "4"}, "3-of-4"),
        (STEP, "2-of-3"),
        ({**ARRAY, "SLURM_ARRAY_TASK_COUNT": "4", **STEP}, "8-of-12"),
        ({"OMPI_COMM_WORLD_SIZE": "4", "OMPI_COMM_WORLD_RANK": "3", **STEP}, "4-of-4"),
        ({"PMI_SIZE": "4", "PMI_RANK": "0"}, "1-of-4"),
        ({"PMI_SIZE": "4", "PMIX_RANK": "2"}, "3-of-4"),
        ({"SGE_TASK_ID": "2", "SGE_TASK_FIRST": "1", "SGE_TASK_LAST": "6", "SGE_TASK_STEPSIZE": "1"}, "2-of-6"),
        ({}, None),
        ({"SLURM_NTASKS": "3", "SLURM_PROCID": "0"}, None),
        ({**ARRAY, "SLURM_ARRAY_TASK_COUNT": "3"}, None),
        ({"PBS_ARRAY_INDEX": "3"}, None),
        ({"PMI_SIZE": "4"}, None),
        ({"PMI_SIZE": "4", "PMI_RANK": "4"}, None),
        ({"SGE_TASK_ID": "undefined"}, None),
        ({**ARRAY, "SLURM_ARRAY_TASK_COUNT": "4", "PMI_SIZE": "999999", "PMI_RANK": "0"}, None),
    ],
)
def test_auto(sweep, tmp_path, environment, share):
    """The share that the environment names, or a refusal where it names none."""
    done = sweep.run("a.h5", "--share", "auto", env=environment, status=0 if share else 1)
    assert names(tmp_path) == ([f"a.{share}.h5"] if share else []) and ("--share auto: " in done.stderr) == (not share)


def test_several_processes_without_shares_are_refused(sweep):
    done = sweep.run("a.h5", env={"PMI_SIZE": "4", "PMI_RANK": "1"}, status=1)
    assert "this is one of 4 processes (PMI_SIZE)" in done.stderr and "--share auto" in done.stderr
    sweep.deck.write_text(SCENE)
    assert "has no &sweep" in sweep.run("a.h5", "--share", "1/2", status=1).stderr
    assert "has no &sweep" in sweep.run("a.h5", command="merge", status=1).stderr
