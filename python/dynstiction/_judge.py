"""Files from strangers: every object is checked by its description in HDF5, before anything in it is read.

An HDF5 file can make its reader open other files of the machine (external storage, links, virtual datasets), run code from
plugins (filters), and use more memory than there is (compression, one dataset under many names, forged sizes). Files of
dynstiction need none of these. Only compression by gzip is accepted, because ``h5repack`` may have added it; the data are first
decompressed under a limit.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from math import ceil, prod
from typing import NamedTuple, NoReturn, TypeAlias

import h5py  # type: ignore[import-untyped]
import numpy as np
from h5py import h5a, h5d, h5o, h5s, h5t, h5z

from .errors import FileError

__all__ = ["judge"]

MOST_OBJECTS = 5000
"""Largest number of groups, datasets and attributes of a file; a run with all columns has about 400."""

DEEPEST = 3
"""Number of names in the longest path: sweep/summary/period."""

LONGEST_TEXT = 2**16
LONGEST_DECK = 2**23
"""Largest number of bytes of a text. A deck has at most 10^6; with every key as used it may be longer."""

LEAST_MEMORY = 2**25
MOST_EXPANSION = 32
"""All data that are read from a file take at most this many bytes, or this many times the bytes of the file."""

GZIP, SHUFFLE, CHECKSUM = h5z.FILTER_DEFLATE, h5z.FILTER_SHUFFLE, h5z.FILTER_FLETCHER32
PIPELINES = {
    (*first, *middle, *last) for first in ((), (SHUFFLE,)) for middle in ((), (GZIP,)) for last in ((), (CHECKSUM,))
}  # fmt: skip

NUMBER = 8
"""Bytes of the longest number, and of each as it is read."""

TEXT_POINTER = 16
"""Number of bytes that refer to a text of variable length: length, address of its heap, number in the heap."""

HEAP = b"GCOL\x01\0\0\0"
"""Bytes at the begin of a collection of texts in the file; no text has these bytes, and numbers hardly ever."""

HEAP_HEAD = 16
"""Numbers of bytes before the first text of a collection, and before each text: its number, references to it, and its length."""

BLOCK = 2**20
"""Number of bytes of the file that are searched at once."""

TEXT_OBJECT = 100
"""Number of bytes that Python needs for a text, besides its characters."""

# Internal attributes of HDF5's dimension scales, which are not read here.
SCALES = {"DIMENSION_LIST", "REFERENCE_LIST"}


Piece: TypeAlias = tuple[int, int, int]
"""Place and length of a part of a dataset in the file, and its mask of filters."""


class Kind(NamedTuple):
    """Permitted types and shapes of the datasets of a group."""

    ranks: tuple[int, ...]
    numbers: bool = True
    texts: bool = False


COLUMN = Kind((1,))
KINDS = {
    "time_series": COLUMN,
    "events": COLUMN,
    "remainder/time_series": COLUMN,
    "remainder/events": COLUMN,
    "summary": Kind((0,)),
    "statistics": Kind((0,)),
    "parameters": Kind((0,), texts=True),
    "deck": Kind((0,), numbers=False, texts=True),
    "sweep": COLUMN,
    "sweep/summary": COLUMN,
    "sweep/failures": Kind((1,), texts=True),
    "sweep/series": Kind((1, 2)),
    "sweep/cycles": Kind((1, 2)),
    "trade": Kind((1,), texts=True),
}
"""Groups of the files that dynstiction writes."""

ADDED = Kind((0, 1, 2), texts=True)
"""Other objects, which a user may have added; they are not read."""


def judge(file: h5py.File, name: str, show_life: Callable[[], None] = lambda: None) -> None:
    """Refuse a newly opened file that refers to data outside itself; the `FileError` names the object.

    `show_life` is called before each step whose time does not depend on the size of the file.
    """
    judge = _Judge(file, name, show_life)
    judge.heaps()
    judge.group(file.id, "")


class _Judge:
    def __init__(self, file: h5py.File, name: str, show_life: Callable[[], None]) -> None:
        self.name = name
        self.show_life = show_life
        self.descriptor = file.id.get_vfd_handle()
        self.size = os.fstat(self.descriptor).st_size
        self.most_memory = max(LEAST_MEMORY, MOST_EXPANSION * self.size)
        self.objects = 0
        self.memory = 0
        """Number of bytes in memory for the data that may be read."""
        self.stored = 0
        """Number of bytes of the file that the datasets and texts so far claim to have."""
        self.addresses: set[int] = set()

    def refuse(self, path: str, why: str) -> NoReturn:
        raise FileError(
            f"{self.name}: '{path or '/'}' {why}, as nothing that dynstiction writes: do not trust the file, "
            "or remove that from it"
        )

    def heaps(self) -> None:
        """Refuse collections of texts that HDF5 would read without end: a text of size 0, or of a size that wraps around."""
        before = b""
        for start in range(0, self.size, BLOCK):
            self.show_life()
            block = before + os.pread(self.descriptor, BLOCK, start)
            place = block.find(HEAP)
            while place >= 0:
                self.heap(start - len(before) + place)
                place = block.find(HEAP, place + 1)
            before = block[-len(HEAP) + 1 :]

    def heap(self, start: int) -> None:
        """One collection: its length, then texts, each with its number (0: the remaining space) and its length."""
        size = int.from_bytes(os.pread(self.descriptor, 8, start + 8), "little")
        if size > self.size - start:
            self.refuse("", "holds a list of texts that is longer than the file")
        data, place = os.pread(self.descriptor, size, start), HEAP_HEAD
        while place + HEAP_HEAD <= len(data):
            number, length = struct.unpack_from("<H6xQ", data, place)
            place += HEAP_HEAD + -(-length // 8) * 8 if number else length
            if place > size or (not number and length < HEAP_HEAD):
                self.refuse("", "holds a list of texts with a damaged length")

    def group(self, group: h5py.h5g.GroupID, path: str) -> None:
        self.attributes(group, path)
        if group.get_num_objs() + self.objects > MOST_OBJECTS:
            self.refuse(path, "holds too many objects")
        for raw in group:
            try:
                name = raw.decode()
            except UnicodeDecodeError:
                name = ""
            inner = f"{path}/{name}" if path else name
            if not name.isprintable() or not name:
                self.refuse(path, f"holds something with the name {raw[:80]!r}")
            link = group.links.get_info(raw)
            if link.type != h5py.h5l.TYPE_HARD:
                self.refuse(inner, "is a link to another place or file")
            if inner.count("/") >= DEEPEST:
                self.refuse(inner, "is a group in a group in a group in a group")
            self.object(h5o.open(group, raw), inner)

    def object(self, item: h5py.h5o.ObjectID, path: str) -> None:
        self.show_life()
        address = h5o.get_info(item).addr
        if address in self.addresses:
            self.refuse(path, "is the same object as another one")
        self.addresses.add(address)
        self.objects += 1
        kind = KINDS.get(path.rpartition("/")[0], ADDED)
        if isinstance(item, h5d.DatasetID):
            if path in KINDS:
                self.refuse(path, "is not a group")
            self.dataset(item, path, kind)
            self.attributes(item, path)
        elif isinstance(item, h5py.h5g.GroupID):
            if path.rpartition("/")[0] in KINDS and path not in KINDS:
                self.refuse(path, "is a group among datasets")
            self.group(item, path)
        else:
            self.refuse(path, "is neither a group nor a dataset")

    def attributes(self, item: h5py.h5o.ObjectID, path: str) -> None:
        count = h5a.get_num_attrs(item)
        self.objects += count
        if self.objects > MOST_OBJECTS:
            self.refuse(path, "has too many attributes")
        for i in range(count):
            self.show_life()
            attribute = h5a.open(item, index=i)
            name = attribute.name.decode("utf-8", "replace")
            if name not in SCALES:
                self.attribute(attribute, f"{path}@{name}")

    def attribute(self, attribute: h5a.AttrID, where: str) -> None:
        stored_as, space = attribute.get_type(), attribute.get_space()
        if not where.isprintable() or space.get_simple_extent_type() == h5s.NULL or len(attribute.shape) > 1:
            self.refuse(where, "is no attribute of a usual form")
        if max(attribute.get_storage_size(), prod(attribute.shape)) > LONGEST_TEXT:
            self.refuse(where, "is too long")
        if stored_as.get_class() != h5t.STRING:
            # HDF5 has no truth values: h5py stores them as an enumeration.
            if not self.is_number(stored_as) and attribute.dtype != np.bool_:
                self.refuse(where, "is neither a number nor a text")
        elif stored_as.is_variable_str():
            if attribute.shape != ():
                self.refuse(where, "is a list of texts")
            # One text takes no more memory than the file has bytes; neither must all texts together.
            value = np.zeros((), attribute.dtype)
            attribute.read(value)
            length = len(value[()])
            if length > LONGEST_TEXT:
                self.refuse(where, "is too long")
            self.take(where, length, length + TEXT_OBJECT)

    @staticmethod
    def is_number(stored_as: h5t.TypeID) -> bool:
        return stored_as.get_class() in (h5t.INTEGER, h5t.FLOAT) and stored_as.get_size() <= NUMBER

    def take(self, path: str, stored: int, memory: int) -> None:
        """Count bytes of the file and of the memory."""
        self.stored += stored
        self.memory += memory
        if self.stored > self.size:
            self.refuse(path, "claims more than the file holds")
        if self.memory > self.most_memory:
            self.refuse(
                path, "is larger than a file of this size may become (h5repack -f NONE makes it readable)"
            )

    def dataset(self, dataset: h5d.DatasetID, path: str, kind: Kind) -> None:
        creation = dataset.get_create_plist()
        layout = creation.get_layout()
        # This check is first: reading the extent of a virtual dataset opens its sources.
        if layout not in (h5d.COMPACT, h5d.CONTIGUOUS, h5d.CHUNKED):
            self.refuse(path, "is put together from other datasets")
        if creation.get_external_count():
            self.refuse(path, "has its data in another file")
        filters = tuple(creation.get_filter(i)[0] for i in range(creation.get_nfilters()))
        if filters not in PIPELINES:
            self.refuse(path, f"needs the filters {filters}")
        stored_as, space = dataset.get_type(), dataset.get_space()
        if space.get_simple_extent_type() == h5s.NULL or len(dataset.shape) not in kind.ranks:
            self.refuse(path, f"does not have {' or '.join(map(str, kind.ranks))} dimensions")
        is_text = stored_as.get_class() == h5t.STRING
        if stored_as.committed() or not (
            kind.texts if is_text else kind.numbers and self.is_number(stored_as)
        ):
            self.refuse(path, "holds another type of values")
        varies = is_text and stored_as.is_variable_str()
        size, count = TEXT_POINTER if varies else stored_as.get_size(), prod(dataset.shape)
        if layout == h5d.CHUNKED:
            piece = prod(creation.get_chunk()) * size
            expected = prod(map(ceil, np.divide(dataset.shape, creation.get_chunk())))
            pieces = self.chunks(dataset, path, filters, piece, expected)
        else:
            piece = dataset.get_storage_size()
            pieces = [(dataset.get_offset(), piece, 0)]
            if piece < count * size:
                self.refuse(path, "claims more than it has")
            self.take(path, piece, 0)
        self.take(path, 0, count * (size if is_text else NUMBER))
        if is_text:
            longest = LONGEST_DECK if path.startswith("deck/") else LONGEST_TEXT
            if varies:
                if layout == h5d.COMPACT or SHUFFLE in filters:
                    self.refuse(path, "keeps texts in another form")
                self.texts(path, filters, pieces, piece, longest)
            elif size > longest:
                self.refuse(path, "is too long")

    def chunks(
        self, dataset: h5d.DatasetID, path: str, filters: tuple[int, ...], length: int, expected: int
    ) -> list[Piece]:
        """Positions of the chunks, if all exist and none becomes longer than `length` bytes."""
        if expected * length > self.most_memory:
            self.take(path, 0, expected * length)
        found: list[Piece] = []

        def note(info: h5d.StoreInfo) -> bool | None:
            self.show_life()
            found.append((info.byte_offset, info.size, info.filter_mask))
            return True if len(found) > expected else None

        dataset.chunk_iter(note)
        if len(found) != expected:
            self.refuse(path, "lacks the chunks that its size needs")
        for _, size, _ in found:
            self.take(path, size, 0)
            # Data that gzip cannot compress grow by less than that.
            if size > length + length // 512 + 64:
                self.refuse(path, "has a chunk that is too long")
        if GZIP in filters and any(len(self.unpacked(piece, filters, length)) > length for piece in found):
            self.refuse(path, "has a compressed chunk that becomes too long")
        return found

    def unpacked(self, piece: Piece, filters: tuple[int, ...], length: int) -> bytes:
        """Decompressed bytes of a piece, at most one more than `length`."""
        self.show_life()
        place, size, mask = piece
        data = os.pread(self.descriptor, size, place)
        if GZIP in filters and not mask & 1 << filters.index(GZIP):
            return zlib.decompressobj().decompress(data, length + 1)
        return data[:length]

    def texts(
        self, path: str, filters: tuple[int, ...], pieces: list[Piece], length: int, longest: int
    ) -> None:
        """Count the characters of texts of variable length, which are stored elsewhere in the file."""
        for piece in pieces:
            data = self.unpacked(piece, filters, length)
            for i in range(0, len(data), TEXT_POINTER):
                text = int.from_bytes(data[i : i + 4], "little")
                if text > longest:
                    self.refuse(path, "holds a text that is too long")
                self.take(path, text, text + TEXT_OBJECT)
