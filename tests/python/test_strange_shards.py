"""Shards that somebody forged, and other files with the names of shards: nothing crashes, nothing of others is touched."""

from __future__ import annotations

import os
import random
import resource
import struct
import time

import h5py
import numpy as np
import pytest
from programs import INPUTS, limited
from sweeps import HEADER_BYTES, SCENE, Sweep, checksum, values

pytestmark = pytest.mark.deck

SHORT = SCENE.replace("t_end = 10.0", "t_end = 0.2")
GRID = "\n&sweep parameter = 'system.misalignment_deg' first = 1.0 last = 2.0 count = 3{} /\n"
SERIES, CYCLES = " keep = 'series'", " keep = 'cycles'"


# --- series of any length


@pytest.mark.parametrize(("main_kb", "threads"), [(8192, 1), (8192, 2), (1024, 1), (1024, 2)], ids=str)
def test_a_long_series_needs_no_stack(tmp_path, main_kb, threads):
    """1e5 samples of 15 columns are 12 MB; the stack of a thread is 128 kB here."""
    text = (INPUTS / "fig3.nml").read_text()
    sweep = Sweep(tmp_path, text + GRID.format(SERIES).replace("count = 3", "count = 2"))
    settings = ("--set", "output.interval=1e-4", "--set", "scene.t_end=10.0")
    stack = limited(resource.RLIMIT_STACK, main_kb * 1024)
    sweep.run("a.h5", *settings, threads=threads, env={"OMP_STACKSIZE": "128k"}, preexec_fn=stack, status=0)
    if (main_kb, threads) != (8192, 2):
        return
    with h5py.File(tmp_path / "a.h5") as merged:
        series = {name: merged["sweep/series"][name][:] for name in ("time", "u_x", "spring_force_x", "theta")}
    for i, angle in enumerate((1.0, 2.0)):
        single = tmp_path / f"{i}.h5"
        deck = tmp_path / "single.nml"
        deck.write_text(text)
        angle_set = ("--set", f"system.misalignment_deg={angle}")
        sweep.program("run", deck, "-o", single, "--quiet", *settings, *angle_set, status=0)
        with h5py.File(single) as alone:
            assert np.array_equal(series["time"], alone["time_series/time"][:])
            for name in ("u_x", "spring_force_x", "theta"):
                assert np.array_equal(series[name][i], alone["time_series"][name][:]), name


# --- forged records


def records(words):
    """Where the records of a shard begin, and their lengths."""
    place = HEADER_BYTES // 8
    while place < len(words):
        length = words[place + 1] & 0xFFFFFFFF
        yield place, length
        place += length


ABSURD = [0, 1, 2, 3, 7, 47, 2**15, 2**20, 2**31 - 1, 2**31, 2**32 - 1]


def forge(data, dice):
    """A shard in which one thing is absurd, and every checksum right."""
    words = list(struct.unpack(f"<{len(data) // 8}Q", data))
    assert words[11] == checksum(words[:11])
    if dice.random() < 0.15:
        place = dice.choice([9, 10, dice.randrange(1, 9)])
        words[place] = dice.choice([*ABSURD, dice.getrandbits(64)])
        words[11] = checksum(words[:11])
        return struct.pack(f"<{len(words)}Q", *words)
    place, length = dice.choice(list(records(words)))
    field, half = dice.choice([(0, 0), (0, 1), (1, 0), (1, 1)])
    value = dice.choice([*ABSURD, length + 1, length - 1, length + 15, length + 1500, dice.getrandbits(32)])
    old = words[place + field]
    words[place + field] = (value << 32 | old & 0xFFFFFFFF) if half else (old >> 32 << 32 | value)
    claimed = words[place + 1] & 0xFFFFFFFF
    if place + claimed > len(words) and dice.random() < 0.5 and claimed < 2**21:
        words += [dice.getrandbits(64) for _ in range(place + claimed - len(words))]
    if 2 < claimed <= len(words) - place:
        words[place + claimed - 1] = checksum(words[place : place + claimed - 1])
    return struct.pack(f"<{len(words)}Q", *words)


@pytest.mark.parametrize("kept", ["", SERIES, CYCLES], ids=["summaries", "series", "cycles"])
@pytest.mark.parametrize("count", [80, pytest.param(500, marks=pytest.mark.full)])
def test_forged_shards_are_read_or_refused(tmp_path, kept, count):
    sweep = Sweep(tmp_path, (SCENE if kept == CYCLES else SHORT) + GRID.format(kept))
    assert sweep.run("good.h5").returncode == 0
    assert sweep.run("a.h5", "--shard", "1/1", threads=1).returncode == 0
    (shard,) = sweep.shards("a.h5")
    good, right = shard.read_bytes(), values(tmp_path / "good.h5")
    refused = taken = 0
    for seed in range(count):
        shard.write_bytes(forge(good, random.Random(seed)))
        merged = sweep.run("a.h5", "--overwrite", "--keep-shards", command="merge")
        assert merged.returncode in (0, 3, 5, 75), (seed, merged)
        assert all(line.startswith("dynstiction: ") for line in merged.stderr.splitlines()), (seed, merged)
        refused += merged.returncode == 3
        taken += merged.returncode != 3
        if seed % 8 == 0:
            again = sweep.run("a.h5", "--overwrite", "--keep-shards")
            assert again.returncode in (0, 3, 5), (seed, again)
            if again.returncode == 0:
                assert values(tmp_path / "a.h5").keys() == right.keys()
    assert refused > count / 20 and taken > count / 20


def test_an_absurd_text_length_ends_what_is_read(sweep_with_shard):
    """The field by which a merge was crashed: the cases before it stay."""
    sweep, shard = sweep_with_shard
    words = list(struct.unpack(f"<{shard.stat().st_size // 8}Q", shard.read_bytes()))
    place, length = list(records(words))[1]
    words[place + 1] = length | (2**31 - 1) << 32
    words[place + length - 1] = checksum(words[place : place + length - 1])
    shard.write_bytes(struct.pack(f"<{len(words)}Q", *words))
    merged = sweep.run("a.h5", command="merge")
    assert merged.returncode == 75 and "2 of 3 cases have not been run" in merged.stderr


def test_a_record_with_exchanged_words_is_run_again(tmp_path):
    """64 words apart a checksum that only rotates by some bits would not see it."""
    sweep = Sweep(tmp_path, SHORT + GRID.format(SERIES))
    assert sweep.run("a.h5", "--keep-shards", threads=1).returncode == 0
    (shard,) = sweep.shards("a.h5")
    words = list(struct.unpack(f"<{shard.stat().st_size // 8}Q", shard.read_bytes()))
    place, length = list(records(words))[1]
    one = next(i for i in range(place + 60, place + length - 65) if words[i] != words[i + 64])
    words[one], words[one + 64] = words[one + 64], words[one]
    shard.write_bytes(struct.pack(f"<{len(words)}Q", *words))
    # Of the three cases the first is left.
    merged = sweep.run("a.h5", "--overwrite", command="merge")
    assert merged.returncode == 75 and "2 of 3 cases" in merged.stderr


def test_a_failed_case_s_words_cannot_control_a_terminal(sweep_with_shard):
    sweep, shard = sweep_with_shard
    words = list(struct.unpack(f"<{shard.stat().st_size // 8}Q", shard.read_bytes()))
    place, length = list(records(words))[2]
    text = b"\x1b[31mred\r\ndynstiction: forged \x9b"
    extra = struct.unpack(f"<{-(-len(text) // 8)}Q", text + bytes(-len(text) % 8))
    words[place] |= 41 << 32
    words[place + 1] = (length + len(extra)) | len(text) << 32
    words[place + length - 1 : place + length] = [*extra, 0]
    words[-1] = checksum(words[place:-1])
    shard.write_bytes(struct.pack(f"<{len(words)}Q", *words))
    assert sweep.run("a.h5", command="merge").returncode == 5
    with h5py.File(shard.parent / "a.h5") as file:
        (shown,) = file["sweep/failures/result_text"].asstr()[:]
    assert shown == "?[31mred??dynstiction: forged ?"


# --- other files with the names of shards


@pytest.fixture
def sweep_with_shard(tmp_path):
    sweep = Sweep(tmp_path, SHORT + GRID.format(""))
    assert sweep.run("a.h5", "--shard", "1/1", threads=1).returncode == 0
    (shard,) = sweep.shards("a.h5")
    return sweep, shard


FOREIGN = {
    "long text": b"Dear colleague, these are my notes.\n" * 20,
    "short text": b"notes\n",
    "one byte": b"x",
    "as long as a head": b"y" * HEADER_BYTES,
}


@pytest.mark.parametrize("number", ["000000", "000001", "123456"])
@pytest.mark.parametrize("content", FOREIGN)
def test_a_foreign_file_is_refused_and_left_alone(tmp_path, content, number):
    sweep = Sweep(tmp_path, SHORT + GRID.format(""))
    notes = tmp_path / f"a.h5.shard-{number}"
    notes.write_bytes(FOREIGN[content])
    for arguments in (("--overwrite",), (), ("--overwrite", "--shard", "1/2")):
        done = sweep.run("a.h5", *arguments)
        assert done.returncode == 3 and notes.name in done.stderr and "move it away" in done.stderr, done
        assert notes.read_bytes() == FOREIGN[content]
    assert not (tmp_path / "a.h5").exists()


@pytest.mark.parametrize("victim", ["shard", "text", "nothing"])
@pytest.mark.parametrize("number", ["000000", "000001", "000007"])
def test_a_link_is_never_followed(tmp_path, victim, number):
    sweep = Sweep(tmp_path, SHORT + GRID.format(""))
    target = tmp_path / "victim"
    if victim == "shard":
        assert sweep.run("b.h5", "--set", "integrator.rtol=1e-4", "--shard", "1/1").returncode == 0
        sweep.shards("b.h5")[0].rename(target)
    elif victim == "text":
        target.write_text("precious\n")
    before = target.read_bytes() if target.exists() else None
    link = tmp_path / f"a.h5.shard-{number}"
    link.symlink_to(target)
    for command, arguments in (("run", ("--overwrite",)), ("run", ("--overwrite", "--shard", "1/2")), ("merge", ())):
        done = sweep.run("a.h5", *arguments, command=command)
        assert done.returncode == 3 and link.name in done.stderr and "symbolic link" in done.stderr, done
        assert link.is_symlink()
        assert (target.read_bytes() if target.exists() else None) == before


def test_what_is_no_file_is_refused_at_once(tmp_path):
    sweep = Sweep(tmp_path, SHORT + GRID.format(""))
    for make in (os.mkfifo, os.mkdir):
        place = tmp_path / "a.h5.shard-000003"
        make(place)
        for command in ("run", "merge"):
            done = sweep.run("a.h5", command=command)
            assert done.returncode == 3 and place.name in done.stderr, done
        place.rmdir() if place.is_dir() else place.unlink()


def test_a_shard_of_another_sweep_is_emptied_and_removed(sweep_with_shard):
    """What --overwrite is for."""
    sweep, shard = sweep_with_shard
    shard.rename(shard.with_name("a.h5.shard-000009"))
    done = sweep.run("a.h5", "--overwrite", "--set", "integrator.rtol=1e-4")
    assert done.returncode == 0 and not sweep.shards("a.h5"), done


def test_a_shard_that_vanishes_gets_a_true_message(sweep_with_shard):
    """Many are listed at once, and the last ones are gone before their turn comes."""
    sweep, shard = sweep_with_shard
    copies = [shard.with_name(f"a.h5.shard-{i:06}") for i in range(100, 3100)]
    data, errors = shard.read_bytes(), ""
    for attempt in range(12):
        for copy in copies:
            copy.write_bytes(data)
        process = sweep.start("a.h5")
        time.sleep(0.005 * (1 + attempt))
        for copy in reversed(copies):
            copy.unlink(missing_ok=True)
        _, error = process.communicate(timeout=60)
        errors += error
        (shard.parent / "a.h5").unlink(missing_ok=True)
        shard.write_bytes(data)
        if error:
            break
    assert "a.h5.shard-" in errors and "it was removed meanwhile" in errors and "permission" not in errors
