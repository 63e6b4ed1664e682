"""Damage of files: single bits, seals, checkpoints whose digest is right again. docs/file.md says how files are sealed."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from pathlib import Path

SEAL_LENGTH = len("dynstiction CRC-32 01234567\n")


def flipped(data: bytes, place: int, bit: int = 0) -> bytes:
    """One bit the other way; a negative place counts from the end."""
    place %= len(data)
    return data[:place] + bytes([data[place] ^ (1 << bit)]) + data[place + 1 :]


def changed(path: Path, change: Callable[[bytes], bytes]) -> None:
    before = path.read_bytes()
    after = change(before)
    assert after != before
    path.write_bytes(after)


def without_seal(data: bytes) -> bytes:
    assert data[-SEAL_LENGTH:].startswith(b"dynstiction CRC-32 ")
    return data[:-SEAL_LENGTH]


def signed(data: bytes) -> bytes:
    """A checkpoint with the digest of what it now says."""
    body = data[: data.rindex(b"sha256 ")]
    return body + b"sha256 " + hashlib.sha256(body).hexdigest().encode() + b"\n"


def replaced(old: bytes, new: bytes) -> Callable[[bytes], bytes]:
    return lambda data: signed(re.sub(old, new, data, count=1))


killed = replaced(rb"result_checksum \S+", b"result_checksum -")
"""Turns the checkpoint of a stopped run into that of a running one: anybody can write such a file."""
