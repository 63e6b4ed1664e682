"""How a sweep is divided, and that every share can be run again: job arrays and launchers of all forms, wrong divisions refused with
the right one, shards of other builds and divisions, partial results, and what `show` prints about them.
"""

from __future__ import annotations

import contextlib
import re
import signal
import struct
import subprocess
import time

import h5py
import pytest
from programs import end_group, wait_until
from sweeps import GRID, HEADER_BYTES, SCENE, Sweep, cases_in, checksum, same, values

SHORT = SCENE.replace("t_end = 10.0", "t_end = 0.2")
SMALL = GRID.replace("count = 12, 5", "count = 4, 3")
ENDLESS = ("--set", "scene.t_end=2000000")
ALL = list(range(1, 13))


@pytest.fixture
def sweep(tmp_path):
    return Sweep(tmp_path, SHORT + SMALL)


def array(index, indices, step=1):
    """What Slurm says to a task of the array `indices`."""
    told = {"ID": index, "MIN": min(indices), "MAX": max(indices), "STEP": step, "COUNT": len(indices)}
    return {f"SLURM_ARRAY_TASK_{name}": str(value) for name, value in told.items()}


LAUNCHERS = {
    "Open MPI": ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"),
    "PMI": ("PMI_SIZE", "PMI_RANK"),
    "Slurm": ("SLURM_STEP_NUM_TASKS", "SLURM_PROCID"),
}


def process(launcher, number, count):
    size, rank = LAUNCHERS[launcher]
    return {size: str(count), rank: str(number)}


def every_file(folder, output="a.h5"):
    return sorted(folder.glob(f"{output}.shard-*"))


def done_once(folder, output="a.h5"):
    """Whether the shards have every case once."""
    return sorted(case for file in every_file(folder, output) for case in cases_in(file)) == ALL


def head_of(path):
    return list(struct.unpack("<12Q", path.read_bytes()[:HEADER_BYTES]))


def reforge(path, places, *values):
    """Change words of the head of a shard, with a right checksum."""
    words, data = head_of(path), path.read_bytes()
    words[places] = values
    words[11] = checksum(words[:11])
    path.write_bytes(struct.pack("<12Q", *words) + data[HEADER_BYTES:])


def of_another_build(path):
    reforge(path, slice(4, 6), *struct.unpack("<2Q", b"0123456789abcdef"))


@contextlib.contextmanager
def at_once(sweep, starts):
    """Runs that are begun together, and ended at last."""
    started = [sweep.start(output, *arguments) for output, *arguments in starts]
    try:
        yield started
    finally:
        for process in started:
            end_group(process)


# --- every form of an array, and of processes

FORMS = {
    "1-4": (range(1, 5), 1),
    "0-3": (range(4), 1),
    "1-7:2": (range(1, 8, 2), 2),
    "single": ([7], 1),
    "more than cases": (range(100, 114), 1),
}


@pytest.mark.parametrize("form", FORMS)
def test_an_array_of_any_range_runs_every_case_once(sweep, tmp_path, form):
    indices, step = FORMS[form]
    for index in indices:
        sweep.run("a.h5", "--shard", "auto", env=array(index, indices, step), threads=1, status=0)
    assert done_once(tmp_path) and len(every_file(tmp_path)) == len(indices)
    assert sweep.run("a.h5", command="merge").returncode == 0 and not every_file(tmp_path)
    sweep.run("b.h5", status=0)
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))


@pytest.mark.parametrize(
    ("failed", "again"),
    [([2], [2]), ([1, 2], [1, 2]), ([0, 1, 3], [0, 1, 3]), ([3], [0, 1, 2, 3]), ([0, 2], [0, 2])],
    ids=["an index", "a part", "a list", "all again", "two"],
)
def test_a_failed_index_is_started_again(sweep, tmp_path, failed, again):
    for index in set(range(4)) - set(failed):
        sweep.run("a.h5", "--shard", "auto", env=array(index, range(4)), threads=1, status=0)
    sweep.run("a.h5", command="merge", status=75)
    for index in again:
        sweep.run("a.h5", "--shard", "auto", env=array(index, again), threads=1, status=0)
    assert done_once(tmp_path)
    names = [f"a.h5.shard-00000{i}" for i in (1, 2, 3, 4)]
    assert [file.name for file in every_file(tmp_path)] == names


@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_processes_of_a_launcher_share_the_cases(sweep, tmp_path, launcher):
    for number in range(3):
        sweep.run("a.h5", "--shard", "auto", env=process(launcher, number, 3), threads=1, status=0)
    assert done_once(tmp_path) and len(every_file(tmp_path)) == 3


def test_tasks_of_an_array_may_have_several_processes(sweep, tmp_path):
    for index in (1, 2):
        for number in range(2):
            env = array(index, [1, 2]) | process("PMI", number, 2)
            sweep.run("a.h5", "--shard", "auto", env=env, threads=1, status=0)
    assert done_once(tmp_path) and len(every_file(tmp_path)) == 4
    sweep.run("a.h5", "--shard", "auto", env=array(2, [2]) | process("PMI", 1, 2), status=0)
    assert len(every_file(tmp_path)) == 4
    assert "2 processes a task), here a task has 1" in sweep.run("a.h5", "--shard", "auto", env=array(2, [2]), status=1).stderr


# --- what is refused, and with what words

FOUR = [("--shard", "2/4")]
BEGUN = [array(index, range(4)) for index in (0, 1)]
REFUSED = {
    "of no division": ([], ("--shard", "3"), {}, "the number of shards is not known yet: write --shard I/N"),
    "nothing around": ([], ("--shard", "auto"), {}, "there is no job array"),
    "share beyond": ([], ("--shard", "3/1"), {}, "no such shard: write --shard I/N with 1 <= I <= N"),
    "share 0": ([], ("--shard", "0/4"), {}, "no such shard"),
    "share 0 of four": (FOUR, ("--shard", "0/4"), {}, "with 1 <= I <= 4"),
    "share 5 of four": (FOUR, ("--shard", "5"), {}, "with 1 <= I <= 4"),
    "the count of a task": (FOUR, ("--shard", "3/1"), {}, "divided by 4: write --shard 3/4"),
    "another division": (FOUR, ("--shard", "2/3"), {}, "divided by 4: write --shard 2/4"),
    "beyond both": (FOUR, ("--shard", "6/8"), {}, "divided by 4: write --shard I/4 with 1 <= I <= 4"),
    "other processes": (FOUR, ("--shard", "auto"), process("Slurm", 1, 3), "divided by 4: write --shard I/4"),
    "other array": (FOUR, ("--shard", "auto"), array(3, [3]), "divided by 4: write --shard I/4"),
    "list first": ([], ("--shard", "auto"), array(5, [1, 2, 5]), "like --array=1-5"),
    "list, no array": (FOUR, ("--shard", "auto"), array(5, [1, 2, 5]), "write --shard I/4"),
    "index outside": (BEGUN, ("--shard", "auto"), array(4, [4]), "divided by 4 (--array=0-3)"),
    "range outside": (BEGUN, ("--shard", "auto"), array(1, [1, 2, 3, 4]), "divided by 4 (--array=0-3)"),
    "no COUNT": ([], ("--shard", "auto"), {"SLURM_ARRAY_TASK_ID": "3"}, "no SLURM_ARRAY_TASK_COUNT"),
    "redivide alone": ([], ("--redivide",), {}, "--redivide without --shard"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_a_wrong_division_is_refused_with_the_right_one(sweep, tmp_path, kind):
    before, arguments, env, words = REFUSED[kind]
    for start in before:
        given = ("--shard", "auto") if isinstance(start, dict) else start
        told = start if isinstance(start, dict) else {}
        sweep.run("a.h5", *given, env=told, threads=1, status=0)
    files = {file: file.read_bytes() for file in every_file(tmp_path)}
    done = sweep.run("a.h5", *arguments, env=env, status=1)
    assert words in done.stderr, done.stderr
    assert done.stderr.count("\n") == 1
    assert {file: file.read_bytes() for file in every_file(tmp_path)} == files


def test_a_number_alone_goes_on_with_the_division(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "2/3", status=0)
    sweep.run("a.h5", "--shard", "1", status=0)
    sweep.run("a.h5", "--shard", "3", status=0)
    assert done_once(tmp_path)


def test_another_division_is_begun_on_purpose_only(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/2", status=0)
    first = tmp_path / "a.h5.shard-000001"
    kept = first.read_bytes()
    sweep.run("a.h5", "--shard", "1/3", status=1)
    sweep.run("a.h5", "--shard", "1/3", "--redivide", status=0)
    assert len(every_file(tmp_path)) == 2 and (tmp_path / "a.h5.shard-000001.1").exists()
    # Now both are known, and the new one counts.
    sweep.run("a.h5", "--shard", "2/3", status=0)
    sweep.run("a.h5", "--shard", "3", status=0)
    assert done_once(tmp_path) and first.read_bytes() == kept
    sweep.run("a.h5", "--shard", "2/2", status=0)
    assert done_once(tmp_path)
    assert sweep.run("a.h5").returncode == 0 and not every_file(tmp_path)
    sweep.run("b.h5", status=0)
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))


@pytest.mark.parametrize("share", [(2, 2), (1, 1)], ids=["own division", "another division"])
def test_of_its_own_division_a_process_reads_heads_only(sweep, tmp_path, share):
    """A shard with all cases is used only if it is of another division: none of the same can have a case of this share."""
    sweep.run("a.h5", "--shard", "1/1", status=0)
    whole = tmp_path / "a.h5.shard-000001"
    reforge(whole, slice(8, 9), share[0] | share[1] << 32)
    whole.rename(tmp_path / "a.h5.shard-000002")
    sweep.run("a.h5", "--shard", "1/2", "--redivide", status=0)
    assert len(cases_in(tmp_path / "a.h5.shard-000001")) == (6 if share == (2, 2) else 0)


# --- shards of another build


def test_shards_of_another_build_are_left_alone_and_used_never(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/2", status=0)
    theirs = tmp_path / "a.h5.shard-000001"
    of_another_build(theirs)
    before = theirs.read_bytes()
    # A shard of another division, too: it does not count.
    done = sweep.program(*sweep.command("a.h5", "--shard", "1/3", quiet=False), status=0)
    assert done.stderr.count("of another build") == 1, done.stderr
    assert len(cases_in(tmp_path / "a.h5.shard-000001.1")) == 4
    assert sweep.run("a.h5", status=0).stderr == ""
    assert every_file(tmp_path) == [theirs] and theirs.read_bytes() == before
    with h5py.File(tmp_path / "a.h5") as file:
        assert file.attrs["complete"] == 1
    sweep.run("c.h5", command="merge", status=3)
    assert sweep.run("a.h5", "--overwrite").returncode == 0 and not every_file(tmp_path)


def test_a_merge_of_another_build_s_shards_alone_finds_nothing(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/2", status=0)
    of_another_build(tmp_path / "a.h5.shard-000001")
    assert "no finished case to merge" in sweep.run("a.h5", command="merge", status=3).stderr


# Without the fused instructions that newer processors have, glibc rounds a few values differently.
ROUNDS_DIFFERENTLY = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"}


def rounding(sweep, env):
    (line,) = (line for line in sweep.program("--version", env=env, status=0).stdout.splitlines() if line.startswith("rounding:"))
    return line.split()[1]


def test_shards_of_a_machine_that_rounds_differently_are_not_mixed(sweep, tmp_path):
    if rounding(sweep, {}) == rounding(sweep, ROUNDS_DIFFERENTLY):
        pytest.skip("this machine rounds as it does without fused instructions")
    sweep.run("a.h5", "--shard", "1/2", env=ROUNDS_DIFFERENTLY, status=0)
    theirs = (tmp_path / "a.h5.shard-000001").read_bytes()
    done = sweep.program(*sweep.command("a.h5", "--shard", "2/2", quiet=False), status=0)
    assert "of a machine that rounds differently" in done.stderr, done.stderr
    merged = sweep.run("a.h5", "--keep-shards", command="merge", status=75)
    assert "6 of 12 cases have not been run" in merged.stderr, merged.stderr
    assert (tmp_path / "a.h5.shard-000001").read_bytes() == theirs
    assert sweep.run("a.h5", status=0).stderr == ""


# --- partial results


def attributes(path):
    with h5py.File(path) as file:
        return dict(file.attrs)


def test_a_look_with_merge_stops_nothing(sweep, tmp_path):
    sweep.run("b.h5", status=0)
    for index in range(4):
        sweep.run("a.h5", "--shard", "auto", env=array(index, range(4)), threads=1, status=0)
        for _ in range(2):
            merged = sweep.run("a.h5", "--keep-shards", command="merge")
            assert merged.returncode == (75 if index < 3 else 0), merged.stderr
        said = attributes(tmp_path / "a.h5")
        assert said["cases_done"] == 3 * (index + 1) and said["complete"] == (index == 3)
        assert said["begun"] <= said["ended"]
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))


def test_a_run_replaces_the_partial_result(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/2", status=0)
    sweep.run("a.h5", command="merge", status=75)
    sweep.run("a.h5", status=0)
    assert attributes(tmp_path / "a.h5")["complete"] == 1 and not every_file(tmp_path)


def test_a_partial_result_with_more_cases_is_kept(sweep, tmp_path):
    for share in ("1/3", "2/3"):
        sweep.run("a.h5", "--shard", share, status=0)
    sweep.run("a.h5", command="merge", status=75)
    before = (tmp_path / "a.h5").read_bytes()
    (tmp_path / "a.h5.shard-000001").unlink()
    assert "the file holds 8 cases, the shards 4" in sweep.run("a.h5", command="merge", status=3).stderr
    assert (tmp_path / "a.h5").read_bytes() == before
    sweep.run("a.h5", "--overwrite", command="merge", status=75)


def test_a_partial_result_of_another_sweep_is_refused_before_anything_runs(sweep, tmp_path):
    other = ("--set", "integrator.rtol=1e-5")
    sweep.run("a.h5", "--shard", "1/2", *other, status=0)
    sweep.run("a.h5", *other, command="merge", status=75)
    (tmp_path / "a.h5.shard-000001").unlink()
    before = (tmp_path / "a.h5").read_bytes()
    for arguments in ((), ("--shard", "1/2")):
        assert "the file exists" in sweep.run("a.h5", *arguments, status=3).stderr
    assert not every_file(tmp_path) and (tmp_path / "a.h5").read_bytes() == before


def test_a_single_run_does_not_take_the_name_of_a_partial_sweep(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/2", status=0)
    sweep.run("a.h5", command="merge", status=75)
    single = tmp_path / "single.nml"
    single.write_text(SHORT)
    done = sweep.program("run", single, "-o", tmp_path / "a.h5")
    assert done.returncode == 3 and "the file exists" in done.stderr


@pytest.mark.parametrize("command", ["run", "merge"])
@pytest.mark.parametrize("limit", ["integrator.max_steps=0", "integrator.max_steps=3"])
@pytest.mark.parametrize("lost", [0, 1])
def test_what_was_killed_while_it_removed_shards_is_ended(sweep, tmp_path, command, limit, lost):
    status = 5 if limit.endswith("=3") else 0
    for share in ("1/2", "2/2"):
        sweep.run("a.h5", "--shard", share, "--set", limit, status=status)
    sweep.run("a.h5", "--set", limit, "--keep-shards", command="merge", status=status)
    before = (tmp_path / "a.h5").read_bytes()
    for file in every_file(tmp_path)[:lost]:
        file.unlink()
    done = sweep.run("a.h5", "--set", limit, command=command)
    assert done.returncode == status and not every_file(tmp_path), done.stderr
    assert (tmp_path / "a.h5").read_bytes() == before
    # Now it is a result as any other.
    sweep.run("a.h5", "--set", limit, command=command, status=3)


def test_a_complete_result_without_a_sound_seal_is_not_trusted(sweep, tmp_path):
    sweep.run("a.h5", "--keep-shards", status=0)
    with open(tmp_path / "a.h5", "ab") as file:
        file.write(b"x")
    assert "the file exists" in sweep.run("a.h5", status=3).stderr and every_file(tmp_path)


# --- processes at once


def test_of_many_that_want_one_shard_one_gets_it(sweep, tmp_path):
    with at_once(sweep, [("a.h5", *ENDLESS, "--shard", "1/2")] * 6) as started:
        wait_until(lambda: sum(process.poll() is None for process in started) == 1)
        (writer,) = [process for process in started if process.poll() is None]
        for process in started:
            if process is not writer:
                assert process.returncode == 3 and "another process is writing it" in process.stderr.read()
        assert [file.name for file in every_file(tmp_path)] == ["a.h5.shard-000001"]


def test_divisions_that_begin_at_once_get_files_of_their_own(sweep, tmp_path):
    for attempt in range(3):
        output = f"{attempt}.h5"
        with at_once(sweep, [(output, *ENDLESS, "--redivide", "--shard", f"1/{n}") for n in (2, 3, 4)]) as started:

            def begun(output=output):
                return [file.stat().st_size >= HEADER_BYTES for file in every_file(tmp_path, output)] == [True] * 3

            wait_until(begun)
            assert all(process.poll() is None for process in started)
            assert sorted(head_of(file)[8] >> 32 for file in every_file(tmp_path, output)) == [2, 3, 4]


def test_tasks_that_overwrite_another_sweep_at_once_do_not_stop_each_other(sweep, tmp_path):
    """Each finds shards of the other sweep that a third one empties and takes in this moment."""
    for _ in range(3):
        for i in range(1, 7):
            sweep.run("a.h5", "--shard", f"{i}/6", "--redivide", "--overwrite", threads=1, status=0)
        arguments = (*ENDLESS, "--overwrite", "--redivide", "--set", "output.wall_limit=1.5")
        with at_once(sweep, [("a.h5", *arguments, "--shard", f"{i}/6") for i in range(1, 7)]) as started:
            for process in started:
                assert process.wait(60) == 75, process.stderr.read()
        assert len(every_file(tmp_path)) == 6


def test_shards_of_an_older_program_are_refused_as_such(sweep, tmp_path):
    """Their heads held 64 characters of the identity."""
    words = [int.from_bytes(b"KRAHSTSD", "little"), *struct.unpack("<8Q", b"0123456789abcdef" * 4), 16, 0]
    path = tmp_path / "a.h5.shard-000000"
    path.write_bytes(struct.pack("<12Q", *words, checksum(words)))
    assert "another version of deck or program" in sweep.run("a.h5", status=3).stderr
    sweep.run("a.h5", "--overwrite", status=0)


# --- messages


def show(sweep, *outputs):
    return sweep.program("show", *[sweep.folder / output for output in outputs])


def test_a_stopped_share_speaks_of_its_own_cases(sweep):
    done = sweep.run("a.h5", *ENDLESS, "--shard", "1/3", "--set", "output.wall_limit=0.05", status=75)
    assert "after 0 of 4 cases" in done.stderr, done.stderr


def test_failed_cases_of_a_share_are_told_every_time(sweep):
    for _ in range(2):
        done = sweep.run("a.h5", "--shard", "1/3", "--set", "integrator.max_steps=3", status=5)
        assert "4 of 4 cases of shard 1/3 failed" in done.stderr


def test_show_of_nothing_and_of_no_result(sweep, tmp_path):
    done = show(sweep, "none.h5")
    assert done.returncode == 3 and "no such file" in done.stderr and done.stdout == ""
    (tmp_path / "text.h5").write_text("no result")
    done = show(sweep, "text.h5")
    assert done.returncode == 3 and "no result of this program" in done.stderr
    (tmp_path / "b.h5.shard-000000").write_text("notes, which are no shard")
    done = show(sweep, "b.h5")
    assert done.returncode == 3 and "move it away" in done.stderr


def test_show_of_a_sweep_that_is_running(sweep, tmp_path):
    sweep.run("a.h5", *ENDLESS, "--shard", "2/4", "--set", "output.wall_limit=0.05", status=75)
    with at_once(sweep, [("a.h5", *ENDLESS, "--shard", "4/4")]) as (process,):
        shard = tmp_path / "a.h5.shard-000004"
        wait_until(lambda: shard.exists() and shard.stat().st_size >= HEADER_BYTES)
        for _ in range(5):
            done = show(sweep, "a.h5")
            assert done.returncode == 0, done.stderr
        assert "0 of 12 cases done, 0 failed" in done.stdout
        (second,) = [line for line in done.stdout.splitlines() if line.startswith("  2/4 ")]
        (fourth,) = [line for line in done.stdout.splitlines() if line.startswith("  4/4 ")]
        assert "0 of 3" in second and "being written" not in second
        assert fourth.endswith(f"being written by process {process.pid}") or fourth.endswith("being written")
        assert re.search(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\dZ", second)
        assert "not begun: 1, 3 of 4" in done.stdout
        # A file of another sweep beside it: the heads tell them apart.
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 75
        assert "being written" not in show(sweep, "a.h5").stdout


def test_nobody_is_refused_because_somebody_looks(sweep, tmp_path):
    """A shard that is looked at all the time can be opened to write."""
    sweep.run("a.h5", "--shard", "1/2", status=0)
    loop = f"while :; do {sweep.exe} show {tmp_path}/a.h5 > /dev/null; done"
    looking = subprocess.Popen(["bash", "-c", loop], start_new_session=True)
    try:
        for _ in range(8):
            sweep.run("a.h5", "--shard", "1/2", status=0)
        assert sweep.run("a.h5").returncode == 0 and not every_file(tmp_path)
    finally:
        end_group(looking)


def test_show_of_divisions_builds_and_results(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/2", status=0)
    time.sleep(1.1)
    sweep.run("a.h5", "--shard", "2/3", "--redivide", status=0)
    said = show(sweep, "a.h5").stdout
    # What the older division has done counts for the shares of the newer one.
    done = len(cases_in(tmp_path / "a.h5.shard-000001")) + len(cases_in(tmp_path / "a.h5.shard-000002"))
    assert f"{done} of 12 cases done" in said and re.search(r"^  2/3 +4 of 4 ", said, re.MULTILINE)
    assert re.search(r"^  1/2 +6 of 6 ", said, re.MULTILINE) and "not begun: 1, 3 of 3" in said
    of_another_build(tmp_path / "a.h5.shard-000001")
    said = show(sweep, "a.h5").stdout
    assert said.count("shards of a sweep") == 2 and "build 0123456789ab)" in said
    (tmp_path / "a.h5.shard-000001").unlink()
    sweep.run("a.h5", command="merge", status=75)
    left = 12 - len(cases_in(tmp_path / "a.h5.shard-000002"))
    assert f"not complete, {left} of 12 cases have not been run" in show(sweep, "a.h5").stdout
    sweep.run("a.h5", status=0)
    single = tmp_path / "single.nml"
    single.write_text(SHORT)
    sweep.program("run", single, "-o", tmp_path / "r.h5", "--quiet", status=0)
    done = show(sweep, "a.h5", "r.h5")
    said = done.stdout.splitlines()
    assert "a.h5: sweep of model low_frequency" in said[0] and said[0].endswith("complete, done")
    assert any("r.h5: run of model low_frequency" in line for line in said) and done.returncode == 0


def test_show_of_shards_with_absurd_heads(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/1", status=0)
    shard = tmp_path / "a.h5.shard-000001"
    good = shard.read_bytes()
    for place in range(6, 11):
        for value in (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**62 + 2**31 - 1, 2**64 - 1, 2**33 + 1):
            shard.write_bytes(good)
            reforge(shard, slice(place, place + 1), value)
            if place == 7 and value % 2**32 > 10**6:
                continue
            done = show(sweep, "a.h5")
            assert done.returncode in (0, 3), (place, value, done)
            assert all(line.startswith("dynstiction: ") for line in done.stderr.splitlines()), (place, value, done)


# --- a signal while the result is written


def test_a_merge_ends_when_it_is_told_to(tmp_path):
    """The shards keep everything, and no part of a result is left."""
    big = Sweep(tmp_path, SCENE.replace("t_end = 10.0", "t_end = 0.01") + GRID.replace("count = 12, 5", "count = 400, 1000"))
    fast = ("--set", "integrator.method=rodas4p")
    big.run("a.h5", "--shard", "1/1", *fast, status=0)
    shards = {file: file.read_bytes() for file in every_file(tmp_path)}
    process = big.program.start("merge", big.deck, "-o", tmp_path / "a.h5", *fast)
    wait_until(lambda: list(tmp_path.glob("a.h5.*.part")))
    process.send_signal(signal.SIGTERM)
    _, words = process.communicate(timeout=10)
    assert process.returncode == 75 and "stopped by SIGTERM while the result was written" in words
    assert sorted(tmp_path.glob("a.h5*")) == sorted(shards)
    assert all(file.read_bytes() == data for file, data in shards.items())
    big.run("a.h5", *fast, command="merge", status=0)
