"""Opening files with h5py, which reads what h5py reads: a checksum is compared, and nothing leads out of the file."""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from .errors import Error, FileError
from .record import Info

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

__all__ = [
    "SEAL",
    "check_seal",
    "dataset_in",
    "info_of",
    "open_file",
    "own_datasets",
    "values_in",
]

SEAL = b"dynstiction CRC-32 %08X\n"
"""The last line of a whole file: CRC-32 of all bytes before it. Who changes a file with HDF5 takes it away."""
MARK = SEAL[:19]
SEAL_LENGTH = len(SEAL % 0)
BEGINNING = 4096
"""Bytes by which a deck is recognised that is given in place of a result."""
BLOCK = 2**18
"""Number of bytes that are read at once, few enough to stay in the processor's cache."""
TEXTS, HEAD = b"GCOL\x01\0\0\0", 16
"""How a list of texts begins in a file; bytes before its texts, and before each of them."""
MOST_COMPRESSED = 1100
"""More bytes than this for one byte in the file no filter of HDF5 gives back: the dataset claims what it does not have."""
UNREAD = 2**20
"""Bytes that may be claimed all the same."""


@contextmanager
def open_file(path: str | os.PathLike[str]) -> Iterator[h5py.File]:
    """A result file, open for reading.

    Parameters
    ----------
    path : str or PathLike
        The file.

    Yields
    ------
    h5py.File
        Exceptions that h5py and NumPy raise while it is used become a `FileError` too.

    Raises
    ------
    FileError
        If the file is missing, is no HDF5 file, or does not have the checksum in its last line.
    """
    name = os.fspath(path)
    # Opening a pipe would wait for its writer without end.
    if os.path.exists(name) and not os.path.isfile(name):
        raise FileError(f"{name}: is not a regular file")
    import h5py  # noqa: PLC0415  (slow to import)

    try:
        sealed = check_seal(name)
        if not h5py.is_hdf5(name):
            raise FileError(f"{name}: {_what_it_is(name)}")
        if not sealed:
            _check_texts(name)
        with _opened(name) as file:
            yield file
    except Error:
        raise
    except Exception as error:  # damaged files cause exceptions of any kind in h5py and NumPy
        reason = "no such file" if isinstance(error, FileNotFoundError) else str(error)
        raise FileError(f"{name}: cannot be read: {reason}") from error


def _opened(name: str) -> h5py.File:
    """The file without a lock: nobody changes one that has its name."""
    import h5py  # noqa: PLC0415

    try:
        return h5py.File(name, "r", locking=False)
    except OSError as error:
        # The caller has opened the file with a lock; HDF5 wants the same from all openings of a process.
        if "locking" not in str(error):
            raise
        return h5py.File(name, "r")


def dataset_in(group: h5py.Group, path: str) -> h5py.Dataset | None:
    """A dataset whose data are in this file, and are as many as it says; None if there is none.

    Raises
    ------
    FileError
        If the dataset, or a group on the way, is in another file, or it claims more values than the file can hold.
    """
    import h5py  # noqa: PLC0415

    item = _item_in(group, path)
    if not isinstance(item, h5py.Dataset):
        return None
    if item.external or item.is_virtual:
        raise FileError(
            f"{group.file.filename}: {path} has its data in another file: copy them into this one"
        )
    if item.size and item.size * item.dtype.itemsize > MOST_COMPRESSED * item.id.get_storage_size() + UNREAD:
        raise FileError(f"{group.file.filename}: is damaged: {path} claims {item.size} values, and has fewer")
    return item


def values_in(group: h5py.Group, path: str) -> Any:
    """All values of a dataset of the program; texts as Python's.

    Raises
    ------
    FileError
        If there is no such dataset, or as for `dataset_in`.
    """
    import h5py  # noqa: PLC0415

    dataset = dataset_in(group, path)
    if dataset is None:
        raise FileError(f"{group.file.filename}: is damaged: it has no {group.name.rstrip('/')}/{path}")
    is_text = h5py.check_string_dtype(dataset.dtype) is not None
    return dataset.asstr(errors="surrogateescape")[()] if is_text else dataset[()]


def _item_in(group: h5py.Group, path: str) -> Any:
    """What has a name in a group, or is where soft links lead; None if there is nothing in this file."""
    import h5py  # noqa: PLC0415

    item: Any = group
    for part in path.strip("/").split("/"):
        link = item.get(part, getlink=True) if isinstance(item, h5py.Group) else None
        if isinstance(link, h5py.ExternalLink):
            raise FileError(
                f"{group.file.filename}: {path} leads to another file: copy the data into this one"
            )
        if isinstance(link, h5py.SoftLink):
            item = _item_in(item.file if link.path.startswith("/") else item, link.path)
        else:
            item = item[part] if isinstance(link, h5py.HardLink) else None
    return item


def own_datasets(group: h5py.Group, ndim: int) -> Iterator[tuple[str, h5py.Dataset]]:
    """The datasets of numbers or texts with so many dimensions in a group. What else somebody has put there is left alone."""
    import h5py  # noqa: PLC0415

    for name in group:
        dataset = group[name] if isinstance(group.get(name, getlink=True), h5py.HardLink) else None
        if not isinstance(dataset, h5py.Dataset) or dataset.shape is None or dataset.ndim != ndim:
            continue
        is_plain = dataset.dtype.kind in "iuf" or h5py.check_string_dtype(dataset.dtype) is not None
        if is_plain and not (dataset.is_virtual or dataset.external):
            yield name, dataset


def info_of(name: str, dataset: h5py.Dataset) -> Info:
    """Name, unit and meaning of a dataset, from its attributes."""
    about = dataset.attrs
    return Info(name, str(about.get("units", "1")), str(about.get("long_name", "")))


def check_seal(name: str) -> bool:
    """Whether a file has a checksum in its last line. Refuse a file whose last line is not the checksum of its bytes. Edited files and those of others have no such line.

    Raises
    ------
    FileError
        If the file has such a line with another checksum, or after it something else.
    """
    # This includes a file that was truncated, or has something appended.
    with open(name, "rb", buffering=0) as stream:
        first = max(0, os.path.getsize(name) - 2 * SEAL_LENGTH)
        stream.seek(first)
        end = stream.read()
        place = end.find(MARK)
        if place < 0:
            return False
        stream.seek(0)
        checksum, left, block = 0, first + place, memoryview(bytearray(BLOCK))
        while left > 0 and (size := stream.readinto(block[: min(BLOCK, left)])):
            checksum = zlib.crc32(block[:size], checksum)
            left -= size
    if end[place:] != SEAL % checksum:
        raise FileError(f"{name}: is damaged: its bytes do not have the checksum in its last line")
    return True


def _check_texts(name: str) -> None:
    """Refuse lists of texts that HDF5 would read without end: a text of length 0, or of one that wraps around.

    A list begins with its length, and has texts, each with its number (0: the room that is left) and its length.
    """
    with open(name, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start = data.find(TEXTS)
        while start >= 0:
            end = start + int.from_bytes(data[start + 8 : start + 16], "little")
            place = start + HEAD
            while place + HEAD <= min(end, len(data)):
                number, length = struct.unpack_from("<H6xQ", data, place)
                place += HEAD + -(-length // 8) * 8 if number else length
                if place > end or (not number and length < HEAD):
                    raise FileError(f"{name}: is damaged: a list of texts has a wrong length")
            start = data.find(TEXTS, start + 1)


def _what_it_is(name: str) -> str:
    with open(name, "rb") as stream:
        start = stream.read(BEGINNING)
    if b"&" in start and b"\0" not in start:
        return f"is a deck, not a result: dynstiction run {name} makes one"
    return "cannot be read: it is no HDF5 file, or its beginning is damaged"
