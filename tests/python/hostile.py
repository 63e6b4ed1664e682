"""Hostile HDF5 files of ten kinds, made from a sound one; the same seed makes the same file."""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

CANARY = "CANARY-7f3a91"
NUMBER = 4242.424242
"""Content of the other files that a hostile file points to."""

Damage = Callable[[h5py.File, random.Random, Path], None]


def put_canaries(folder: Path) -> None:
    """Other files of this machine, which must never be read."""
    (folder / "secret.txt").write_text((CANARY + " ") * 4000)
    (folder / "secret.bin").write_bytes(struct.pack("<d", NUMBER) * 8000)
    with h5py.File(folder / "secret.h5", "w") as file:
        file["numbers"] = np.full(2000, NUMBER)
        file["text"] = CANARY
        file["g/numbers"] = np.full(2000, NUMBER)


def members(file: h5py.File) -> list[str]:
    """Datasets that a reader reads."""
    found: list[str] = []
    file.visititems(lambda name, item: found.append(name) if isinstance(item, h5py.Dataset) else None)
    return sorted(found)


def victim(file: h5py.File, dice: random.Random, remove: bool = True) -> tuple[str, tuple[int, ...], bool]:
    """A dataset whose place something else takes: its name, its shape, and whether it is text."""
    name = dice.choice(members(file))
    shape, text = file[name].shape, h5py.check_string_dtype(file[name].dtype) is not None
    if remove:
        del file[name]
    return name, shape, text


def external(file: h5py.File, dice: random.Random, folder: Path) -> None:
    name, shape, text = victim(file, dice)
    put_external(file, name, tuple(min(n, 1000) for n in shape), text, folder)


def put_external(file: h5py.File, name: str, shape: tuple[int, ...], text: bool, folder: Path) -> None:
    """A dataset whose data are in a file beside the canaries."""
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_external(bytes(folder / ("secret.txt" if text else "secret.bin")), 0, 48000)
    stored_as = h5py.h5t.py_create(np.dtype("S24" if text else "<f8"))
    space = h5py.h5s.create_simple(shape) if shape else h5py.h5s.create(h5py.h5s.SCALAR)
    h5py.h5d.create(file.id, name.encode(), stored_as, space, creation)


def link(file: h5py.File, dice: random.Random, folder: Path) -> None:
    where = dice.choice(["dataset", "group", "soft", "self"])
    name, _, text = victim(file, dice)
    inside = "text" if text else "numbers"
    if where == "group":
        group = name.split("/")[0]
        del file[group]
        file[group] = h5py.ExternalLink(folder / "secret.h5", "/g")
    elif where == "dataset":
        file[name] = h5py.ExternalLink(folder / "secret.h5", f"/{inside}")
    else:
        file[name] = h5py.SoftLink(f"/{name}" if where == "self" else "/" + dice.choice(members(file)))


def virtual(file: h5py.File, dice: random.Random, folder: Path) -> None:
    name, _, _ = victim(file, dice)
    unlimited = dice.random() < 0.4
    layout = h5py.VirtualLayout((1000,), "<f8", maxshape=(None,) if unlimited else (1000,))
    source = h5py.VirtualSource(folder / "secret.h5", "numbers", shape=(1000,), maxshape=(None,) if unlimited else None)
    layout[: h5py.h5s.UNLIMITED if unlimited else 1000] = source[: h5py.h5s.UNLIMITED if unlimited else 1000]
    file.create_virtual_dataset(name, layout, fillvalue=0.0)


def strange_type(file: h5py.File, dice: random.Random, folder: Path) -> None:
    name, shape, _ = victim(file, dice)
    kind = dice.randrange(8)
    if kind == 0:
        file[name] = np.zeros(shape, [("a", "<f8"), ("b", "<i4")])
    elif kind == 1:
        file.create_dataset(name, shape, h5py.ref_dtype)
    elif kind == 2:
        file.create_dataset(name, shape, h5py.vlen_dtype(np.float64))
    elif kind == 3:
        file[name] = np.zeros(shape, "V16")
    elif kind == 4:
        file[name] = np.zeros(shape, bool)
    elif kind == 5:
        file["type"] = np.dtype("<f8")
        file.create_dataset(name, shape, file["type"])
    elif kind == 6:
        file[name] = np.zeros(shape, np.dtype(("<f8", (3,))))
    else:
        file[name] = h5py.Empty("f8")


def strange_filter(file: h5py.File, dice: random.Random, folder: Path) -> None:
    name, _, _ = victim(file, dice)
    which = dice.choice([h5py.h5z.FILTER_LZF, h5py.h5z.FILTER_SCALEOFFSET, h5py.h5z.FILTER_NBIT, 305, 32015, 40000])
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_chunk((100,))
    if which == h5py.h5z.FILTER_SCALEOFFSET:
        creation.set_scaleoffset(h5py.h5z.SO_FLOAT_DSCALE, 3)
    else:
        creation.set_filter(which, h5py.h5z.FLAG_OPTIONAL, ())
    group, _, leaf = name.rpartition("/")
    space = h5py.h5s.create_simple((1000,))
    dataset = h5py.h5d.create(file[group].id, leaf.encode(), h5py.h5t.IEEE_F64LE, space, creation)
    if which == h5py.h5z.FILTER_LZF:
        dataset.write(h5py.h5s.ALL, h5py.h5s.ALL, np.zeros(1000))


def hard_links(file: h5py.File, dice: random.Random, folder: Path) -> None:
    group = dice.choice(["time_series", "parameters", "new"])
    times = dice.choice([1, 5, 300])
    if dice.random() < 0.5:
        first = file.create_dataset("many", data=np.zeros(2**21), chunks=(2**18,), compression="gzip")
    else:
        first = file[dice.choice(members(file))]
    for i in range(times):
        file.require_group(group)[f"copy_{i}"] = first


def bomb(file: h5py.File, dice: random.Random, folder: Path) -> None:
    name, _, _ = victim(file, dice)
    if dice.random() < 0.5:
        chunk = 2 ** dice.randrange(10, 21)
        file.create_dataset(name, (2**25,), "<f8", chunks=(chunk,), compression="gzip", compression_opts=9)
        zeros = zlib.compress(bytes(8 * chunk), 9)
        for i in range(0, 2**25 if chunk > 2**16 else 100 * chunk, chunk):
            file[name].id.write_direct_chunk((i,), zeros)
    else:
        # The chunk says that it has 8 kB; its bytes become up to 300 MB.
        file.create_dataset(name, (1000,), "<f8", chunks=(1000,), compression="gzip")
        packer = zlib.compressobj(1)
        data = b"".join(packer.compress(bytes(2**20)) for _ in range(300 if dice.random() < 0.3 else 16))
        file[name].id.write_direct_chunk((0,), data + packer.flush())


def size(file: h5py.File, dice: random.Random, folder: Path) -> None:
    name, _, _ = victim(file, dice)
    count = dice.choice([10**6, 10**8, 5 * 10**8, 2**40])
    kind = dice.randrange(5)
    if kind == 0:
        file.create_dataset(name, (count,), "<f8")
    elif kind == 1:
        file.create_dataset(name, (count,), "<f8", chunks=(10000,), fletcher32=True)
    elif kind == 2:
        file.create_dataset(name, (), f"S{min(count, 2**31 - 1)}")
    elif kind == 3:
        file.create_dataset(name, (100,), "<f8", maxshape=(None,), chunks=(2**28,), compression="gzip")
    else:
        file.create_dataset(name, (count,), h5py.string_dtype(), chunks=(1000,))


def length(file: h5py.File, dice: random.Random, folder: Path) -> None:
    """Texts whose length or place is forged, and one text that many claim; `make` edits the bytes."""
    data = file.create_dataset("parameters/forged", data="x" * 3000, dtype=h5py.string_dtype())
    many = file.create_dataset("more/forged", (20000,), h5py.string_dtype())
    many[0] = "y" * 60000
    data.attrs["units"] = "1"
    file.attrs["forged"] = "z" * 900


def structure(file: h5py.File, dice: random.Random, folder: Path) -> None:
    kind = dice.randrange(7)
    name = dice.choice(["time_series", "summary", "deck"])
    if kind in (0, 1):
        file[f"{name}/loop"] = file[dice.choice(["/", name, "events"])]
    elif kind == 2:
        group = file
        for _ in range(dice.choice([4, 50, 600])):
            group = group.create_group("d")
        group["deep"] = 1.0
    elif kind == 3:
        group = file.create_group("wide")
        for i in range(dice.choice([6000, 9000])):
            group[f"n{i}"] = h5py.SoftLink("/deck/text")
    elif kind == 4:
        file[name].attrs.create("huge", np.zeros(dice.choice([9000, 2 * 10**6])))
    elif kind == 5:
        for i in range(6000):
            file[name].attrs[f"a{i}"] = i
    else:
        file[name].attrs.create("text", "t" * 300000)


KINDS: dict[str, Damage] = {
    "external": external,
    "link": link,
    "virtual": virtual,
    "type": strange_type,
    "filter": strange_filter,
    "hard links": hard_links,
    "bomb": bomb,
    "size": size,
    "length": length,
    "structure": structure,
}


def make(sound: Path, file: Path, kind: str, seed: int) -> None:
    """Write a hostile file beside the canaries."""
    dice = random.Random(f"{kind} {seed}")
    file.write_bytes(sound.read_bytes())
    with h5py.File(file, "r+", libver=("v108", "latest" if kind == "virtual" else "v108")) as data:
        KINDS[kind](data, dice, file.parent)
        places = {}
        if kind == "length":
            places = {"one": data["parameters/forged"].id.get_offset(), "many": data["more/forged"].id.get_offset()}
    if places:
        _forge_lengths(file, places, dice)


def _forge_lengths(file: Path, places: dict[str, int], dice: random.Random) -> None:
    data = bytearray(file.read_bytes())
    which = dice.randrange(4)
    absurd = dice.choice([2**32 - 1, 2**31, 2**20, 3001, 2**16 + 1])
    if which == 0:
        struct.pack_into("<I", data, places["one"], absurd)
    elif which == 1:
        struct.pack_into("<Q", data, places["one"] + 4, dice.choice([2**63, len(data) - 8, 8, 2**40]))
    elif which == 2:
        first = data[places["many"] : places["many"] + 16]
        data[places["many"] : places["many"] + 16 * 20000] = first * 20000
    else:
        heap = data.index(b"GCOL")
        struct.pack_into("<Q", data, heap + dice.choice([8, 24]), dice.choice([2**62, 2**32, absurd]))
    file.write_bytes(data)
