"""Result files that are cut, bent, or somebody else's: `ds.open` refuses them with a `FileError`, and soon."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np
import pytest
from damage import SEAL_LENGTH, changed, flipped, without_seal
from programs import SCRIPT, Program

SHORT = {"t_end": 0.05}


@pytest.fixture(scope="module", params=["executable", "python"])
def sound(request, executable: Path, fig3_text: str, tmp_path_factory) -> Path:
    """The file of a short run, as each of the two writers makes it."""
    folder = tmp_path_factory.mktemp("sound")
    file = folder / "run.h5"
    if request.param == "python":
        ds.run(fig3_text, scene=SHORT).save(file)
    else:
        (folder / "fig3.nml").write_text(fig3_text)
        Program((executable,), folder)("run", "fig3.nml", "-o", file, "--quiet", "--set", "scene.t_end=0.05", status=0)
    ds.open(file)
    return file


def cut(bytes_left: Callable[[int], int]) -> Callable[[Path], None]:
    """Damage that keeps only the beginning of a file, given its size."""
    return lambda file: os.truncate(file, bytes_left(file.stat().st_size))


def flip_at(place: int) -> Callable[[Path], None]:
    return lambda file: changed(file, lambda data: flipped(data, place))


def flip_in_column(name: str) -> Callable[[Path], None]:
    """Damage of the last bit of the second number of a column."""

    def damage(file: Path) -> None:
        with h5py.File(file) as data:
            place = data[name].id.get_chunk_info(0).byte_offset + data[name].dtype.itemsize
        flip_at(place)(file)

    return damage


def flip_after(mark: bytes) -> Callable[[Path], None]:
    """Damage of the byte after the first `mark`."""
    return lambda file: flip_at(file.read_bytes().index(mark) + len(mark))(file)


def edit(change: Callable[[h5py.File], object]) -> Callable[[Path], None]:
    """Damage that HDF5 itself takes for a sound file."""

    def damage(file: Path) -> None:
        with h5py.File(file, "r+") as data:
            change(data)

    return damage


def replace(name: str, **how: object) -> Callable[[Path], None]:
    """Damage that puts another dataset in the place of one."""

    def change(data: h5py.File) -> None:
        del data[name]
        data.create_dataset(name, **how)

    return edit(change)


def with_times(times: list[float]) -> Callable[[Path], None]:
    def change(data: h5py.File) -> None:
        data["time_series/time"][: len(times)] = times

    return edit(change)


DAMAGES: dict[str, Callable[[Path], None]] = {
    "empty": cut(lambda size: 0),
    "cut in the signature": cut(lambda size: 4),
    "cut in the superblock": cut(lambda size: 50),
    "cut after the superblock": cut(lambda size: 96),
    "cut early": cut(lambda size: 2048),
    "cut in the middle": cut(lambda size: size // 2),
    "cut late": cut(lambda size: size - 600),
    "cut before the seal by one byte": cut(lambda size: size - SEAL_LENGTH - 1),
    "cut by one byte": cut(lambda size: size - 1),
    "bit of the seal": flip_at(-2),
    "bytes behind the seal": lambda file: file.write_bytes(file.read_bytes() + b"\n") and None,
    "bit of the signature": flip_at(0),
    "bit of the superblock's version": flip_at(8),
    "bit of the size of offsets": flip_at(13),
    "bit of the size of lengths": flip_at(14),
    "bit of the end of file": flip_at(46),
    "bit of the root's address": flip_at(68),
    "bit of a time": flip_in_column("time_series/time"),
    "bit of an elongation": flip_in_column("time_series/u_x"),
    "bit of a sticking flag": flip_in_column("time_series/sticking"),
    "bit of an event's time": flip_in_column("events/time"),
    "bit of an event's kind": flip_in_column("events/kind"),
    "bit of the deck": flip_after(b"normal_load = 10"),
    "text": lambda file: file.write_text("&scene /\n"),
    "another program's": edit(lambda data: data.attrs.__setitem__("program", "other")),
    "no program": edit(lambda data: data.attrs.__delitem__("program")),
    "no time series": edit(lambda data: data.__delitem__("time_series")),
    "no time": edit(lambda data: data.__delitem__("time_series/time")),
    "no events": edit(lambda data: data.__delitem__("events")),
    "no kinds of events": edit(lambda data: data.__delitem__("events/kind")),
    "no deck": edit(lambda data: data.__delitem__("deck/text")),
    "no checksum of the deck": edit(lambda data: data.attrs.__delitem__("deck_sha256")),
    "a group as column": edit(lambda data: data.create_group("time_series/extra")),
    "a broken link as column": edit(lambda data: data["time_series"].__setitem__("extra", h5py.SoftLink("/nowhere"))),
    "a link to another file as column": edit(
        lambda data: data["time_series"].__setitem__("extra", h5py.ExternalLink("none.h5", "/"))
    ),
    "a table as column": replace("time_series/u_x", data=np.zeros((5, 5))),
    "a number as column": replace("time_series/u_x", data=1.0),
    "texts as column": replace("time_series/u_x", data=["a", "b"]),
    "a column beyond all memory": replace("time_series/u_x", shape=(10**14,), dtype="f8", chunks=(1000,)),
    "columns of ten gigabytes": replace("time_series/u_x", shape=(10**9,), dtype="f8", chunks=(1000,)),
    "descending times": with_times([1.0, 0.5]),
    "a time that is no number": with_times([0.0, float("nan")]),
    "a list as attribute": edit(lambda data: data.attrs.__setitem__("result_code", [1, 2])),
    "a number as deck": replace("deck/text", data=3.0),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
def test_damage_is_refused(sound: Path, tmp_path: Path, damage: Callable[[Path], None]) -> None:
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes(sound.read_bytes())
    damage(damaged)
    with pytest.raises(ds.FileError, match=r"damaged\.h5"):
        ds.open(damaged)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for place in (tmp_path, pipe, Path("/dev/zero")):
        with pytest.raises(ds.FileError, match="not a regular file"):
            ds.open(place)


# In a process of its own, because damage might end the process or never end.
FLIPS = """
import os, random, sys, warnings
import dynstiction as ds
warnings.simplefilter("ignore")
sound, folder, count = open(sys.argv[1], "rb").read(), sys.argv[2], int(sys.argv[3])
read, flips = getattr(ds, sys.argv[4]), [int(n) for n in sys.argv[5].split(",")]
file = os.path.join(folder, "bent.h5")
refused = 0
for seed in range(count):
    dice = random.Random(seed)
    bent = bytearray(sound)
    for _ in range(dice.choice(flips)):
        bent[dice.randrange(len(bent))] ^= 1 << dice.randrange(8)
    with open(file, "wb") as stream:
        stream.write(bent[: dice.randrange(len(bent))] if len(flips) > 1 and dice.random() < 0.2 else bent)
    try:
        read(file)
    except ds.FileError:
        refused += 1
print(refused)
"""


def refusals(file: Path, folder: Path, count: int, read: str = "open", flips: str = "1,1,10,100") -> int:
    """How many of so many damaged copies of a file are refused; every other ending is a failure."""
    # A read takes some 10 ms; one that never ends fails here.
    return int(SCRIPT(FLIPS, file, folder, count, read, flips, timeout=20 + count, status=0).stdout)


def unsealed(file: Path, folder: Path) -> Path:
    copy = folder / "unsealed.h5"
    copy.write_bytes(without_seal(file.read_bytes()))
    return copy


@pytest.mark.parametrize("count", [80, pytest.param(5000, marks=pytest.mark.full)])
def test_any_damage_is_read_or_refused(sound: Path, tmp_path: Path, count: int) -> None:
    """Damage of a file without a seal, as a killed run leaves it: HDF5 reads all of it."""
    assert refusals(unsealed(sound, tmp_path), tmp_path, count) > count / 4


@pytest.mark.parametrize("length", [2**64 - 16, 2**64 - 8, 2**63, 2**20])
def test_a_list_of_texts_without_end_is_refused(sound: Path, tmp_path: Path, length: int) -> None:
    """HDF5 goes from text to text by their lengths, and would never arrive."""
    data = bytearray(unsealed(sound, tmp_path).read_bytes())
    heap = data.find(b"GCOL\x01\0\0\0")
    data[heap + 24 : heap + 32] = length.to_bytes(8, "little")
    (tmp_path / "bent.h5").write_bytes(data)
    done = SCRIPT("import dynstiction as ds, sys; ds.open(sys.argv[1])", tmp_path / "bent.h5", timeout=30, status=1)
    assert "FileError" in done.stderr and "list of texts" in done.stderr


@pytest.mark.parametrize("count", [300, pytest.param(2000, marks=pytest.mark.full)])
def test_no_flipped_bit_stays_unnoticed(sound: Path, tmp_path: Path, count: int) -> None:
    """But in the seal's own words, when everything before it is sound."""
    in_words = 5 * count * SEAL_LENGTH / sound.stat().st_size
    assert refusals(sound, tmp_path, count, flips="1") >= count - 1 - in_words


@pytest.mark.parametrize("count", [40, pytest.param(2000, marks=pytest.mark.full)])
def test_a_damaged_comparison_is_read_or_refused(program: Program, fig3_text: str, tmp_path: Path, count: int) -> None:
    (tmp_path / "short.nml").write_text(fig3_text.replace("t_end = 10.0", "t_end = 0.02"))
    program("trade", "short.nml", "--budget", "2", "-o", "trade.h5", "--quiet", status=0)
    assert refusals(tmp_path / "trade.h5", tmp_path, count, "open_trade", "1") >= count - 1
    assert refusals(unsealed(tmp_path / "trade.h5", tmp_path), tmp_path, count, "open_trade") > count / 8
    for name in ("empty", "text", "folder", "pipe", "foreign"):
        place = tmp_path / name
        {"empty": Path.touch, "text": lambda path: path.write_text("&scene /"), "folder": Path.mkdir, "pipe": os.mkfifo,
         "foreign": lambda path: h5py.File(path, "w").close()}[name](place)  # fmt: skip
        with pytest.raises(ds.FileError, match=name):
            ds.open_trade(place)


def test_the_seal_is_the_checksum_that_everybody_can_compute(sound: Path) -> None:
    data = sound.read_bytes()
    assert data[-SEAL_LENGTH:] == b"dynstiction CRC-32 %08X\n" % zlib.crc32(data[:-SEAL_LENGTH])


def test_a_file_that_hdf5_changed_has_no_seal_and_is_read(sound: Path, tmp_path: Path) -> None:
    for change in (lambda data: data.attrs.__setitem__("note", "mine"), lambda data: None):
        edited = tmp_path / "edited.h5"
        edited.write_bytes(sound.read_bytes())
        with h5py.File(edited, "r+") as data:
            change(data)
        assert b"dynstiction CRC-32" not in edited.read_bytes()[-2 * SEAL_LENGTH :]
        assert ds.open(edited).summary["sticks"] == ds.open(sound).summary["sticks"]
