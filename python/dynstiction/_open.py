"""Opening files that may be damaged or forged: every possible check comes before HDF5 reads a byte of data.

A file that has the checksum in its seal is opened; every other one is read by a child process, which returns a copy
(`sound_copy`).
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ._guard import sound_copy
from .errors import FileError
from .record import Info, si_units

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

__all__ = ["groups_in", "has_seal", "info_of", "open_file"]

SIGNATURE = b"\x89HDF\r\n\x1a\n"
FORMAT = b"\x02\x08\x08"
"""Version of the superblock in files of the format of HDF5 1.8, the only one that is written: older versions have no checksums.
It is followed by the numbers of bytes of an address and of a length."""

SEAL = b"dynstiction CRC-32 %08X\n"
MARK = SEAL[:19]
SEAL_LENGTH = len(SEAL % 0)
BEGINNING = 4096
"""Bytes by which a deck is recognised that is given in place of a result."""

BLOCK = 2**20
"""Number of bytes that are read at once."""


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
        If the file is missing, is not a regular file, has another format, differs from its seal, refers to data outside the
        file (`judge`), or makes HDF5 crash or never end (`sound_copy`).
    """
    name = os.fspath(path)
    # Opening a pipe would wait for its writer without end.
    if os.path.exists(name) and not os.path.isfile(name):
        raise FileError(f"{name}: is not a regular file")
    import h5py  # noqa: PLC0415  (slow to import)

    from ._judge import judge  # noqa: PLC0415

    try:
        _check_format(name)
        sealed = has_seal(name)
        with h5py.File(name if sealed else sound_copy(name), "r") as file:
            if sealed:
                judge(file, name)
            yield file
    except FileError:
        raise
    except Exception as error:  # damaged files cause exceptions of any kind in h5py and NumPy
        reason = "no such file" if isinstance(error, FileNotFoundError) else str(error)
        raise FileError(f"{name}: cannot be read: {reason}") from error


def groups_in(path: str | os.PathLike[str]) -> set[str]:
    """Names at the root of a result file, which show what it holds."""
    with open_file(path) as file:
        return set(file)


def info_of(name: str, dataset: h5py.Dataset) -> Info:
    """Name, unit and meaning of a dataset, from its attributes."""
    units = si_units(str(dataset.attrs.get("units", "1")))
    return Info(name, units, str(dataset.attrs.get("long_name", "")))


def has_seal(name: str) -> bool:
    """Whether the last line of a file is its checksum; files of killed runs, edited files and those of others have no such line.

    Raises
    ------
    FileError
        If the file has such a line with another checksum, or after it something else.
    """
    # This includes a file that was truncated, or has something appended.
    with open(name, "rb") as stream:
        first = max(0, os.path.getsize(name) - 2 * SEAL_LENGTH)
        stream.seek(first)
        end = stream.read()
    place = end.find(MARK)
    if place >= 0 and end[place:] != SEAL % _crc32(name, first + place):
        raise FileError(f"{name}: is damaged: its bytes do not have the checksum in its last line")
    return place >= 0


def _check_format(name: str) -> None:
    """Refuse a file of another format."""
    with open(name, "rb") as stream:
        if stream.read(len(SIGNATURE)) != SIGNATURE:
            stream.seek(0)
            start = stream.read(BEGINNING)
            if b"&" in start and b"\0" not in start:
                raise FileError(f"{name}: is a deck, not a result: dynstiction run {name} makes one")
            raise FileError(f"{name}: cannot be read: it is no HDF5 file, or its beginning is damaged")
        if stream.read(len(FORMAT)) != FORMAT:
            raise FileError(
                f"{name}: is no file of dynstiction, or of another format of HDF5: h5repack -j 1 -k 1 makes that readable"
            )


def _crc32(name: str | os.PathLike[str], length: int) -> int:
    """CRC-32 of the first bytes of a file."""
    checksum = 0
    with open(name, "rb") as stream:
        while length > 0 and (data := stream.read(min(BLOCK, length))):
            checksum = zlib.crc32(data, checksum)
            length -= len(data)
    return checksum
