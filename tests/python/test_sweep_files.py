"""What can happen to a sweep's files and processes: limits, foreign and damaged shards, full disks, two at once, progress."""

from __future__ import annotations

import re
import resource
import shutil
import signal
import time
from functools import partial
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np
import pytest
from programs import end_group, limited, on_terminal, wait_until
from sweeps import GRID, HEADER_BYTES, SCENE, Sweep, cases_in, same, values

SHORT = SCENE.replace("t_end = 10.0", "t_end = 1.0")
SMALL = GRID.replace("count = 12, 5", "count = 4, 3")
# 60 cases of a second each.
ENDLESS = ("--set", "scene.t_end=2000000")


@pytest.fixture
def sweep(tmp_path):
    return Sweep(tmp_path, SHORT + SMALL)


# --- series


def test_series_are_those_of_single_runs(sweep, tmp_path):
    sweep.run("a.h5", "--set", "sweep.keep=series", "--set", "output.interval=0.3", status=0)
    found = values(tmp_path / "a.h5")
    # The last sample is at t_end, which is no multiple of the interval.
    assert list(found["series/time"]) == [0.0, 0.3, 0.6, 3 * 0.3, 1.0]
    for case in (0, 7, 11):
        single = ds.run(
            SHORT,
            system={"misalignment_deg": found["system.misalignment_deg"][case]},
            drive={"velocity": found["drive.velocity"][case]},
            output={"interval": 0.3},
        )
        assert np.allclose(single.time, found["series/time"], rtol=1e-15, atol=0.0)
        for name in ("u_x", "X_rate", "friction", "theta", "sticking"):
            assert found[f"series/{name}"].shape == (12, 5)
            assert found[f"series/{name}"][case].tobytes() == single[name].tobytes()
    assert "series/zeta" not in found


def test_series_of_the_fields_that_are_asked_for(sweep, tmp_path):
    wanted = ("--set", "sweep.keep=series", "--set", "output.fields=theta,u_x", "--set", "output.interval=1e-3")
    sweep.run("a.h5", *wanted, status=0)
    with h5py.File(tmp_path / "a.h5") as file:
        assert sorted(file["sweep/series"]) == ["theta", "time", "u_x"]
        u_x = file["sweep/series/u_x"]
        assert u_x.shape == (12, 1001) and u_x.attrs["units"] == "m"
        assert [u_x.dims[i][0].name for i in (0, 1)] == ["/sweep/case", "/sweep/series/time"]
        assert np.array_equal(u_x[:, -1], file["sweep/summary/final_u_x"])
        assert file["sweep/summary/final_X"].shape == (12,)
    # Shards and threads change nothing in series either.
    for shard in ("1/2", "2/2"):
        sweep.run("b.h5", *wanted, "--shard", shard, threads=1, status=0)
    sweep.run("b.h5", *wanted, command="merge", status=0)
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))


def test_series_that_end_early_are_padded(sweep, tmp_path):
    limits = ("--set", "sweep.keep=series", "--set", "integrator.max_steps=25", "--set", "output.interval=0.01")
    sweep.run("a.h5", *limits, status=5)
    found = values(tmp_path / "a.h5")
    failed = found["result_code"] != 0
    assert failed.any()
    for row in found["series/u_x"][failed]:
        length = np.count_nonzero(np.isfinite(row))
        assert 0 < length < 101 and np.isnan(row[length:]).all()
    assert np.isfinite(found["series/u_x"][~failed]).all()


def test_series_need_common_times(sweep):
    series = ("--set", "sweep.keep=series")
    assert "give output.interval > 0" in sweep.run("a.h5", *series, "--set", "output.interval=0", status=2).stderr
    done = sweep.run("a.h5", *series, "--set", "sweep.parameter=scene.t_end,drive.velocity", status=2)
    assert "do not vary scene.t_end" in done.stderr
    (sweep.folder / "t.csv").write_text("scene.t_end\n1\n2\n")
    sweep.deck.write_text(SHORT + "&sweep points = 't.csv', keep = 'series' /\n")
    assert "do not vary scene.t_end" in sweep.run("a.h5", status=2).stderr


@pytest.mark.parametrize("group", ["sweep", "sweep/summary", "sweep/series", "sweep/failures"])
def test_xarray_opens_every_group(sweep, tmp_path, group):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    sweep.run("a.h5", "--set", "sweep.keep=series", "--set", "integrator.max_steps=25", status=5)
    with xarray.open_dataset(tmp_path / "a.h5", group=group, engine="h5netcdf") as data:
        failed = np.count_nonzero(values(tmp_path / "a.h5")["result_code"])
        assert 0 < failed < 12
        expected = {"sweep/series": {"case": 12, "time": 1001}, "sweep/failures": {"case": failed}}
        assert dict(data.sizes) == expected.get(group, {"case": 12})
        assert all(variable.attrs["long_name"] for variable in data.variables.values())


# --- limits, and starting again


def test_the_wall_limit_is_of_the_whole_sweep_and_it_goes_on(sweep, tmp_path):
    assert "stopped at output.wall_limit" in sweep.run("a.h5", *ENDLESS, "--set", "output.wall_limit=1.0", status=75).stderr
    assert not (tmp_path / "a.h5").exists() and len(sweep.shards("a.h5")) == 1
    sweep.run("a.h5", *ENDLESS, "--set", "output.wall_limit=1e-3", status=75)
    # The limit is no part of what a case is: without it the shard is the same sweep's.
    assert sweep.run("a.h5", *ENDLESS, command="merge").returncode in (3, 75)


def test_nothing_to_do(sweep, tmp_path):
    sweep.run("a.h5", "--keep-shards", status=0)
    shard = sweep.shards("a.h5")[0]
    before, first = shard.read_bytes(), values(tmp_path / "a.h5")
    assert "the file exists" in sweep.run("a.h5", "--shard", "1/2", status=3).stderr
    sweep.run("a.h5", "--overwrite", "--keep-shards", status=0)
    assert shard.read_bytes() == before and same(first, values(tmp_path / "a.h5"))
    sweep.run("a.h5", "--shard", "2/3", "--overwrite", status=0)
    sweep.run("a.h5", "--overwrite", status=0)
    assert not sweep.shards("a.h5") and same(first, values(tmp_path / "a.h5"))


@pytest.mark.parametrize("threads", ["1", "4"])
def test_fewer_threads_than_asked_for(sweep, threads):
    """The first thread waits for those that there are, not for those that were asked for."""
    sweep.run("a.h5", env={"OMP_THREAD_LIMIT": "2"}, threads=threads, status=0)


@pytest.mark.parametrize("value", ["0/3", "4/3", "1", "1/", "/3", "-1/3", "a/b", "1/0", "1/3/5", "1.5/3", "1/9999999"])
def test_bad_shards(sweep, value):
    assert "write --shard I/N" in sweep.run("a.h5", "--shard", value, status=1).stderr
    assert not sweep.shards("a.h5")


def test_merge_of_nothing_and_of_a_part(sweep, tmp_path):
    assert "no finished case to merge" in sweep.run("a.h5", command="merge", status=3).stderr
    for shard in ("1/3", "2/3"):
        sweep.run("a.h5", "--shard", shard, status=0)
    assert "4 of 12 cases have not been run" in sweep.run("a.h5", command="merge", status=75).stderr
    assert sorted(values(tmp_path / "a.h5")["result_code"]) == [-1] * 4 + [0] * 8
    with h5py.File(tmp_path / "a.h5") as file:
        assert file.attrs["complete"] == 0 and file.attrs["result_code"] == 75
    # What is missing can be run in any way.
    sweep.run("a.h5", status=0)
    assert set(values(tmp_path / "a.h5")["result_code"]) == {0}


def test_more_shards_than_a_process_may_open(sweep, tmp_path):
    for i in range(1, 13):
        sweep.run("a.h5", "--shard", f"{i}/12", threads=1, status=0)
    assert len(sweep.shards("a.h5")) == 12
    sweep.run("a.h5", command="merge", preexec_fn=limited(resource.RLIMIT_NOFILE, 10), status=0)
    sweep.run("b.h5", status=0)
    assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))


# --- shards of others, damaged shards


def identities(text):
    found = re.search(r"identity ([0-9a-f]{12}), this sweep ([0-9a-f]{12}):", text)
    return found.groups() if found else None


def test_shards_of_another_deck_are_refused_with_both_identities(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/2", status=0)
    shard = sweep.shards("a.h5")[0]
    before = shard.read_bytes()
    done = sweep.run("a.h5", "--set", "integrator.rtol=1e-5", status=3)
    assert str(shard) in done.stderr and "another sweep" in done.stderr
    theirs, ours = identities(done.stderr)
    assert theirs != ours and theirs.encode() in before
    sweep.run("a.h5", "--set", "integrator.rtol=1e-5", command="merge", status=3)
    assert shard.read_bytes() == before
    sweep.run("a.h5", "--set", "integrator.rtol=1e-5", "--overwrite", status=0)
    assert not sweep.shards("a.h5")


def test_what_is_no_part_of_a_case_changes_no_identity(sweep):
    sweep.run("a.h5", "--shard", "1/2", status=0)
    others = ("--set", "scene.title=other", "--set", "output.wall_limit=100", "--set", "output.file=x.h5")
    sweep.run("a.h5", "--shard", "2/2", *others, status=0)


@pytest.mark.parametrize("change", ["other values", "rows exchanged", "columns exchanged"])
def test_another_list_is_another_sweep(sweep, tmp_path, change):
    sweep.deck.write_text(SHORT + "&sweep points = 'p.csv' /\n")
    rows = [f"{1 + i / 20},{1 + i / 20}" for i in range(130)]
    points = tmp_path / "p.csv"
    points.write_text("\n".join(["system.misalignment_deg,friction.normal_load", *rows]))
    sweep.run("a.h5", "--shard", "1/2", status=0)
    if change == "other values":
        rows[99] = "1.0,1.0"
    elif change == "rows exchanged":
        rows[0], rows[64], rows[128] = rows[128], rows[0], rows[64]
    names = "system.misalignment_deg,friction.normal_load"
    if change == "columns exchanged":
        names = "friction.normal_load,system.misalignment_deg"
    points.write_text("\n".join([names, *rows]))
    assert "another sweep" in sweep.run("a.h5", "--shard", "2/2", status=3).stderr


def test_a_cut_shard_loses_what_was_cut_only(sweep, tmp_path):
    sweep.run("b.h5", status=0)
    sweep.run("a.h5", "--keep-shards", threads=1, status=0)
    shard = sweep.shards("a.h5")[0]
    whole = shard.read_bytes()
    record = (len(whole) - HEADER_BYTES) // 12
    for length in (0, 1, HEADER_BYTES - 1, HEADER_BYTES, HEADER_BYTES + 7, HEADER_BYTES + record, len(whole) - 1):
        shard.write_bytes(whole[:length])
        sweep.run("a.h5", "--overwrite", "--keep-shards", status=0)
        assert sorted(cases_in(shard)) == list(range(1, 13))
        # A head that is written again has another time.
        first = HEADER_BYTES if length < HEADER_BYTES else 0
        last = HEADER_BYTES + max(0, (length - HEADER_BYTES) // record) * record
        assert shard.read_bytes()[first:last] == whole[first:last]
        assert same(values(tmp_path / "a.h5"), values(tmp_path / "b.h5"))


def test_no_flipped_bit_comes_into_the_result(sweep, tmp_path):
    sweep.run("b.h5", status=0)
    good = values(tmp_path / "b.h5")
    sweep.run("a.h5", "--keep-shards", threads=1, status=0)
    shard = sweep.shards("a.h5")[0]
    whole = shard.read_bytes()
    chance = np.random.default_rng(5)
    for place in (*chance.integers(0, len(whole), 12), 3, HEADER_BYTES, HEADER_BYTES + 4, HEADER_BYTES + 8, len(whole) - 1):
        data = bytearray(whole)
        data[place] ^= 1 << int(chance.integers(8))
        shard.write_bytes(data)
        merged = sweep.run("a.h5", "--overwrite", command="merge")
        # A shard whose head is damaged is refused; of another one the damaged case and those after it are run again.
        assert merged.returncode in ((3,) if place < HEADER_BYTES else (3, 75))
        done = sweep.run("a.h5", "--overwrite", "--keep-shards")
        if place < len("DSTSHARK"):
            # Without its first word it might be anybody's.
            assert done.returncode == 3 and "move it away" in done.stderr and shard.read_bytes() == data
            continue
        assert done.returncode == 0
        assert same(values(tmp_path / "a.h5"), good)


def test_other_files_with_a_similar_name_are_left_alone(sweep, tmp_path):
    notes = [tmp_path / f"a.h5.shard-{name}" for name in ("notes", "1", "0000001", "00000x")]
    for path in notes:
        path.write_text("mine")
    sweep.run("a.h5", "--overwrite", status=0)
    assert all(path.read_text() == "mine" for path in notes)


# --- two at once


def test_two_processes_do_not_share_a_shard(sweep, tmp_path):
    first = sweep.start("a.h5", *ENDLESS, "--shard", "1/2")
    try:
        shard = tmp_path / "a.h5.shard-000001"
        wait_until(lambda: shard.exists() and shard.stat().st_size >= HEADER_BYTES)
        assert "another process is writing it" in sweep.run("a.h5", *ENDLESS, "--shard", "1/2", status=3).stderr
        # Nor does another deck take it away.
        assert "another process is writing it" in sweep.run("a.h5", "--shard", "1/2", "--overwrite", status=3).stderr
        assert shard.stat().st_size >= HEADER_BYTES
    finally:
        end_group(first)


# --- the disk


def test_a_folder_that_nobody_may_write(sweep):
    if not Path("/proc/self").exists():
        pytest.skip("there is no /proc, and permission bits do not stop root")
    assert sweep.run("/proc/a.h5", status=3).stderr.startswith("dynstiction: /proc/a.h5.shard-000000: ")


def test_a_folder_that_vanishes(sweep, tmp_path):
    (tmp_path / "gone").mkdir()
    process = sweep.start("gone/a.h5", "--set", "scene.t_end=500")
    try:
        shard = tmp_path / "gone" / "a.h5.shard-000000"
        wait_until(lambda: len(cases_in(shard)) > 0)
        shutil.rmtree(tmp_path / "gone")
        assert process.wait(120) == 3
        assert f"the folder {tmp_path / 'gone'} does not exist" in process.stderr.read()
    finally:
        end_group(process)


@pytest.mark.parametrize("limit", [50, HEADER_BYTES + 1000, HEADER_BYTES + 1700])
def test_a_full_disk_keeps_what_is_done(sweep, tmp_path, limit):
    """A limit on the size of files stands for it: a part of a record is written, as on a full disk."""
    done = sweep.run("a.h5", threads=1, preexec_fn=limited(resource.RLIMIT_FSIZE, limit), status=3)
    assert "a.h5.shard-000000: the file-size limit is reached" in done.stderr
    shard = tmp_path / "a.h5.shard-000000"
    kept = cases_in(shard)
    assert shard.stat().st_size == limit
    sweep.run("a.h5", "--keep-shards", threads=1, status=0)
    assert cases_in(shard)[: len(kept)] == kept and sorted(cases_in(shard)) == list(range(1, 13))


def test_a_result_that_finds_no_room_keeps_the_shards(sweep, tmp_path):
    sweep.run("a.h5", "--shard", "1/1", status=0)
    done = sweep.run("a.h5", command="merge", preexec_fn=limited(resource.RLIMIT_FSIZE, 10000), status=3)
    assert "a.h5: cannot write: the file-size limit is reached" in done.stderr
    assert not (tmp_path / "a.h5").exists() and not list(tmp_path.glob("*.part"))
    sweep.run("a.h5", command="merge", status=0)


def test_overwrite_replaces_results_only(sweep, tmp_path):
    (tmp_path / "a.h5").write_text("my notes")
    assert "is not an HDF5 file" in sweep.run("a.h5", "--overwrite", status=3).stderr
    assert (tmp_path / "a.h5").read_text() == "my notes" and not sweep.shards("a.h5")


# --- progress

LINE = re.compile(r"map\.nml: (\d+) of 12 cases, 0 failed(, [\d.e]+ cases/s, ([\w. ]+) left)?")


def test_progress_on_a_terminal(sweep):
    text = on_terminal(partial(sweep.start, "a.h5", "--set", "scene.t_end=3000", quiet=False))
    lines = [found for piece in text.split("\r") if (found := LINE.search(piece))]
    counts = [int(line[1]) for line in lines]
    assert counts == sorted(counts) and len(counts) > 1
    assert any(line[2] for line in lines)
    # One line, wiped at the end.
    assert "\n" not in text and text.endswith("\r\x1b[K")
    assert (sweep.folder / "a.h5").exists()


def test_progress_in_a_pipe_is_a_plain_line_every_ten_seconds(sweep):
    begun = time.monotonic()
    process = sweep.start("a.h5", *ENDLESS, quiet=False)
    try:
        line = process.stderr.readline()
        assert time.monotonic() - begun > 9.0
        assert LINE.search(line) and "\x1b" not in line and "\r" not in line
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 75
        assert process.stderr.read().count("\n") == 1
    finally:
        end_group(process)


def test_no_progress_when_quiet(sweep):
    assert on_terminal(partial(sweep.start, "a.h5")) == ""
    assert (sweep.folder / "a.h5").exists()
