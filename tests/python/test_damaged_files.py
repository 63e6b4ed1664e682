"""Result files that are cut or bent are refused with a `FileError`; those to which a user has added something are read."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np
import pytest
from damage import CHECKSUM_LENGTH, changed, flipped, without_checksum
from programs import INPUTS, SCRIPT, Program

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


# Flipped bits in other places: test_no_flipped_bit_stays_unnoticed.
DAMAGES: dict[str, Callable[[Path], None]] = {
    "empty": cut(lambda size: 0),
    "cut in the superblock": cut(lambda size: 50),
    "cut late": cut(lambda size: size - 600),
    "cut before the seal by one byte": cut(lambda size: size - CHECKSUM_LENGTH - 1),
    "cut by one byte": cut(lambda size: size - 1),
    "bit of the seal": lambda file: changed(file, lambda data: flipped(data, -2)),
    "bytes behind the seal": lambda file: changed(file, lambda data: data + b"\n"),
    "text": lambda file: file.write_text("&scene /\n"),
    "another program's": edit(lambda data: data.attrs.__setitem__("program", "other")),
    "no program": edit(lambda data: data.attrs.__delitem__("program")),
    "no time series": edit(lambda data: data.__delitem__("time_series")),
    "no time": edit(lambda data: data.__delitem__("time_series/time")),
    "no events": edit(lambda data: data.__delitem__("events")),
    "no kinds of events": edit(lambda data: data.__delitem__("events/kind")),
    "no deck": edit(lambda data: data.__delitem__("deck/text")),
    "no checksum of the deck": edit(lambda data: data.attrs.__delitem__("deck_sha256")),
    "times beyond all memory": replace("time_series/time", shape=(10**14,), dtype="f8", chunks=(1000,)),
    "descending times": with_times([1.0, 0.5]),
    "a time that is no number": with_times([0.0, float("nan")]),
}


def add(data: h5py.File) -> None:
    """What a user may do to a file with h5py."""
    series = data["time_series"]
    for group in (data, series):
        group["mask"], group["spectrum"] = np.zeros(7, bool), np.zeros(5, complex)
        group.create_dataset("later", (10**9,), "f8", chunks=(1000,))
    series["positive"] = series["u_x"][:] > 0
    series["cube"], series["one"], series["texts"] = np.zeros((2, 3, 4)), 1.0, ["a", "b"]
    series["table"] = np.zeros(3, dtype=[("a", "f8"), ("b", "i4")])
    series.create_dataset("lzf", data=np.zeros(9), compression="lzf")
    series.create_group("mine")
    data["more"], series["nowhere"] = h5py.SoftLink("/time_series/time"), h5py.SoftLink("/nowhere")
    series["elsewhere"] = h5py.ExternalLink("none.h5", "/")
    data["copy"] = series["u_x"]
    attributes = {"remark": "mine", "list": ["a", "b"], "good": True, "nothing": h5py.Empty("f8"), "matrix": np.eye(3)}
    for name, value in attributes.items():
        series["u_x"].attrs[name] = value
    data.attrs["sample"] = 21.7


def compress(data: h5py.File) -> None:
    column = data["time_series/u_y"]
    values, attributes = column[:], {name: column.attrs[name] for name in ("units", "long_name")}
    del data["time_series/u_y"]
    data.create_dataset("time_series/u_y", data=values, compression="gzip", shuffle=True).attrs.update(attributes)


def test_what_a_user_added_is_left_alone(sound: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.h5"
    mine.write_bytes(sound.read_bytes())
    for change in (add, compress):
        edit(change)(mine)
    result, before = ds.open(mine), ds.open(sound)
    assert result.summary == before.summary
    for name in before.columns:
        np.testing.assert_array_equal(result[name], before[name])
    assert result.attributes["sample"] == 21.7
    result.save(tmp_path / "again.h5")
    assert ds.open(tmp_path / "again.h5").attributes["sample"] == 21.7


@pytest.mark.parametrize("group", ["/", "sweep", "sweep/summary", "sweep/cycles"])
def test_what_a_user_added_to_a_sweep_is_left_alone(executable: Path, tmp_path: Path, group: str) -> None:
    program = Program((executable,), tmp_path)
    angles = ("--vary", "system.misalignment_deg=1:4:4", "--set", "sweep.keep='cycles'")
    program("sweep", INPUTS / "low_frequency.nml", "-o", "map.h5", "--quiet", *angles, status=0)
    before = ds.open(tmp_path / "map.h5")
    with h5py.File(tmp_path / "map.h5", "r+") as data:
        mine = data[group]
        mine["mask"], mine["cube"], mine["pairs"] = np.zeros(4, bool), np.zeros((2, 3, 4)), np.zeros((4, 50), complex)
        mine["elsewhere"], mine["nowhere"] = h5py.ExternalLink("none.h5", "/"), h5py.SoftLink("/nowhere")
        mine.create_dataset("later", (10**12,), "f8", chunks=(1000,))
        mine.attrs["nothing"] = h5py.Empty("f8")
    assert before.identical(ds.open(tmp_path / "map.h5"))
    program("export", "map.h5", status=0)


def test_a_file_that_is_open_already_is_read(sound: Path) -> None:
    with h5py.File(sound):
        assert ds.open(sound).summary == ds.open(sound).summary


def test_nothing_leads_out_of_the_file(sound: Path, tmp_path: Path) -> None:
    """Neither a column nor the force of a trace is read from another file."""
    secret = tmp_path / "secret.bin"
    np.linspace(0.0, 1.0, 1000).tofile(secret)
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["force"] = np.linspace(0.0, 1.0, 1000)
    layout = h5py.VirtualLayout((1000,), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "force", (1000,))
    ways: dict[str, Callable[[h5py.File], object]] = {
        "storage": lambda data: data.create_dataset("force", (1000,), "f8", external=[(str(secret), 0, 8000)]),
        "link": lambda data: data.__setitem__("force", h5py.ExternalLink(str(tmp_path / "other.h5"), "/force")),
        "virtual": lambda data: data.create_virtual_dataset("force", layout),
    }
    for name, way in ways.items():
        trace = tmp_path / f"{name}.h5"
        with h5py.File(trace, "w") as data:
            data["time"] = np.linspace(0.0, 1.0, 1000)
            way(data)
        with pytest.raises(ds.FileError, match="another file"):
            ds.read_trace(trace)
        bent = tmp_path / "bent.h5"
        bent.write_bytes(sound.read_bytes())
        with h5py.File(bent, "r+") as data:
            del data["time_series/time"]
            way(data)
            data.move("force", "time_series/time")
        with pytest.raises(ds.FileError, match=r"bent\.h5"):
            ds.open(bent)


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
flips = [int(n) for n in sys.argv[4].split(",")]
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
        ds.open(file)
    except ds.FileError:
        refused += 1
print(refused)
"""


def refusals(file: Path, folder: Path, count: int, flips: str = "1,1,10,100") -> int:
    """How many of so many damaged copies of a file are refused; every other ending is a failure."""
    # A read takes some 10 ms; one that never ends fails here.
    return int(SCRIPT(FLIPS, file, folder, count, flips, timeout=20 + count, status=0).stdout)


def unsealed(file: Path, folder: Path) -> Path:
    copy = folder / "unsealed.h5"
    copy.write_bytes(without_checksum(file.read_bytes()))
    return copy


@pytest.mark.parametrize("count", [80, pytest.param(2000, marks=pytest.mark.full)])
def test_any_damage_is_read_or_refused(sound: Path, tmp_path: Path, count: int) -> None:
    """Damage of a file without a checksum: HDF5 reads all of it."""
    assert refusals(unsealed(sound, tmp_path), tmp_path, count) > count / 4


def test_a_list_of_texts_without_end_is_refused(sound: Path, tmp_path: Path) -> None:
    """HDF5 goes from text to text by their lengths, and would never arrive."""
    data = bytearray(unsealed(sound, tmp_path).read_bytes())
    heap = data.find(b"GCOL\x01\0\0\0")
    for length in (2**64 - 16, 2**64 - 8, 2**63, 2**20):
        data[heap + 24 : heap + 32] = length.to_bytes(8, "little")
        (tmp_path / "bent.h5").write_bytes(data)
        done = SCRIPT("import dynstiction as ds, sys; ds.open(sys.argv[1])", tmp_path / "bent.h5", timeout=30, status=1)
        assert "FileError" in done.stderr and "list of texts" in done.stderr


@pytest.mark.parametrize("count", [300, pytest.param(2000, marks=pytest.mark.full)])
def test_no_flipped_bit_stays_unnoticed(sound: Path, tmp_path: Path, count: int) -> None:
    """But in the seal's own words, when everything before it is sound."""
    in_words = 5 * count * CHECKSUM_LENGTH / sound.stat().st_size
    assert refusals(sound, tmp_path, count, flips="1") >= count - 1 - in_words


def test_the_seal_is_a_checksum_that_hdf5_removes(sound: Path, tmp_path: Path) -> None:
    """Everybody can compute it; a file that HDF5 has changed is read without."""
    data = sound.read_bytes()
    assert data[-CHECKSUM_LENGTH:] == b"dynstiction CRC-32 %08X\n" % zlib.crc32(data[:-CHECKSUM_LENGTH])
    for change in (lambda data: data.attrs.__setitem__("note", "mine"), lambda data: None):
        edited = tmp_path / "edited.h5"
        edited.write_bytes(sound.read_bytes())
        edit(change)(edited)
        assert b"dynstiction CRC-32" not in edited.read_bytes()[-2 * CHECKSUM_LENGTH :]
        assert ds.open(edited).summary["sticks"] == ds.open(sound).summary["sticks"]
