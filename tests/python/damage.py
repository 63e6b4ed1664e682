"""Damage of files: single bits, the last line with its checksum. docs/file.md says what stands behind HDF5's end."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path

CHECKSUM_LENGTH = len("dynstiction CRC-32 01234567\n")


def flipped(data: bytes, place: int, bit: int = 0) -> bytes:
    """One bit the other way; a negative place counts from the end."""
    place %= len(data)
    return data[:place] + bytes([data[place] ^ (1 << bit)]) + data[place + 1 :]


def changed(path: Path, change: Callable[[bytes], bytes]) -> None:
    before = path.read_bytes()
    after = change(before)
    assert after != before
    path.write_bytes(after)


def without_checksum(data: bytes) -> bytes:
    assert data[-CHECKSUM_LENGTH:].startswith(b"dynstiction CRC-32 ")
    return data[:-CHECKSUM_LENGTH]


def sealed(data: bytes) -> bytes:
    """The bytes with the last line of a whole file."""
    return data + b"dynstiction CRC-32 %08X\n" % zlib.crc32(data)
