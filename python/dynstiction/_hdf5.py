"""The HDF5 file of a run, in the layout of the executable (see the manual, "The result file").

It is created in memory and written as bytes, so that HDF5 itself never writes to a full disk; after such an error HDF5 would
fail again and again, also at the end of the process. Of other files h5py reads what h5py reads: a checksum is compared, and nothing
leads out of the file.
"""

from __future__ import annotations

import hashlib
import io
import mmap
import os
import struct
import warnings
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

import h5py  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from . import _native
from ._commands import PROGRAM
from ._native import Info
from ._output import check_outputs, put
from ._sweep import CYCLE_COUNT, ORIGIN, dataset_of, of_cycle
from .errors import Error, FileError, IncompleteWarning
from .record import EVENTS, LOG_DTYPE, Described
from .result import Result

if TYPE_CHECKING:
    import xarray

COUNTS = ("complete", "result_code", "threads")
"""Attributes that are Python integers, as in a run in memory; every other one is what h5py reads, also what others have added."""

TEXTS = {"text": "the deck as read", "resolved": "the deck with every key as used"}
FORMAT = ("v108", "v108")
"""The oldest one in which the descriptions of the data have checksums."""
STORED_AS = {"sticking": np.int8, "kind": np.int8, "occurs": np.int64}

SEAL = b"dynstiction CRC-32 %08X\n"
"""The last line of a whole file: CRC-32 of all bytes before it. Who changes a file with HDF5 takes it away."""
MARK = SEAL[:19]
SEAL_LENGTH = len(SEAL % 0)
BEGINNING = 4096
"""Bytes by which a deck is recognised that is given in place of a result."""
HEAP, HEAD = b"GCOL\x01\0\0\0", 16
"""How a list of texts begins in a file; bytes before its texts, and before each of them."""
MOST_COMPRESSED = 1100
"""More bytes than this for one byte in the file no filter of HDF5 gives back: the dataset claims what it does not have."""
UNREAD = 2**20
"""Bytes that may be claimed all the same."""

T = TypeVar("T")


def read(name: str) -> Result | xarray.Dataset:
    """Read a run or a sweep; see `dynstiction.open`."""
    with open_file(name) as file:
        if "sweep" in file:
            return _read_sweep(file, name)
        result = _read_contents(file, name)
    if not result.complete:
        reached = f"ends at t = {result.time[-1]:g} s" if result.time.size else "holds no samples"
        warnings.warn(
            f"{name}: {reached}, before the run's end: {result.result_text or 'stopped or still running'}",
            IncompleteWarning,
            stacklevel=3,
        )
    return result


def _read_contents(file: h5py.File, name: str) -> Result:
    if file.attrs.get("program") != PROGRAM:
        raise FileError(f"{name}: is no file of {PROGRAM}")
    if "time_series/time" not in file:
        raise FileError(f"{name}: holds no time series: the run was stopped before it began")
    series, events = (_read_columns(file[path]) for path in ("time_series", "events"))
    by_name = {info.name: values for info, values in events}
    log = np.empty(by_name["time"].size, dtype=LOG_DTYPE)
    for column in EVENTS:
        log[column] = by_name[column]
    parameters = _read_scalars(file, "parameters", "keys")
    columns = Described(
        _in_order(series, "columns", ["time", *str(parameters.get("fields", "")).split()]), "columns"
    )
    for times in (dict(columns)["time"], log["time"]):
        # Also false for NaN.
        if not np.all(np.diff(times, prepend=0.0) >= 0.0):
            raise FileError(f"{name}: is damaged: its times do not ascend")
    deck = _read_text(file, "deck/text")
    if hashlib.sha256(deck.encode("utf-8", "surrogateescape")).hexdigest() != file.attrs["deck_sha256"]:
        raise FileError(f"{name}: is damaged: its deck does not have the checksum that the file states")
    attributes = {"complete": 0, **file.attrs}
    attributes |= {name: int(attributes[name]) for name in COUNTS if name in attributes}
    return Result(
        columns=columns,
        log=log,
        summary=_read_scalars(file, "summary", "summary"),
        statistics=_read_scalars(file, "statistics", "statistics"),
        parameters=parameters,
        attributes=attributes,
        deck=deck,
        resolved_deck=_read_text(file, "deck/resolved"),
    )


def _read_columns(group: h5py.Group) -> list[tuple[Info, NDArray[np.float64]]]:
    """All columns of a group: those that are as long as its times."""
    time = dataset_in(group, "time")
    found = () if time is None else quantities_in(group, time.shape)
    return [(info, values.astype(np.float64, copy=False)) for info, values in found]


def _read_scalars(file: h5py.File, path: str, table: str) -> Described[Any]:
    """All values of a group. Counts are integers."""
    found = quantities_in(file[path], ()) if path in file else ()
    return Described(_native.with_integers(_in_order(found, table)), path)


def _in_order(
    entries: Iterable[tuple[Info, T]], table: str, first: Iterable[str] = ()
) -> list[tuple[Info, T]]:
    """Entries in the same order as in a run in memory, while HDF5 lists them by name."""
    names = dict.fromkeys([*first, *(entry["name"] for entry in _native.catalogue()[table])])
    place = {name: i for i, name in enumerate(names)}
    return sorted(entries, key=lambda entry: (place.get(entry[0].name, len(place)), entry[0].name))


def _read_text(file: h5py.File, name: str) -> str:
    return "" if dataset_in(file, name) is None else values_in(file, name)


def _read_sweep(file: h5py.File, name: str) -> xarray.Dataset:
    """The sweep in a file, as `sweep` gives it; see `dynstiction.open`."""
    code, text = int(file.attrs["result_code"]), str(file.attrs["result_text"])
    if code != 0:
        warnings.warn(f"{name}: {text}", IncompleteWarning, stacklevel=4)
    group = file["sweep"]
    grid = str(group.attrs["grid"])
    is_list = grid == "list"
    axes = []
    for i, key in enumerate(str(group.attrs["parameters"]).split()):
        values = values_in(group, key)
        if not is_list:
            # Along its own side, at the first place of the others.
            side = np.moveaxis(values.reshape([int(size) for size in grid.split()]), i, 0)
            values = np.ascontiguousarray(side.reshape(len(side), -1)[:, 0])
        axes.append((info_of(key, group[key]), values))
    codes = values_in(group, "result_code").astype(np.int32)
    columns = [*quantities_in(group["summary"], codes.shape)]
    columns.append((info_of("wall_time", group["wall_time"]), values_in(group, "wall_time")))
    if "cycles" in group:
        cycles = group["cycles"]
        columns.append((CYCLE_COUNT, values_in(cycles, "count").astype(np.int32)))
        found = quantities_in(cycles, (codes.size, values_in(cycles, "cycle").size))
        columns += [(of_cycle(info), values) for info, values in found]
    failures = group["failures"]
    messages = dict(zip(values_in(failures, "case") - 1, values_in(failures, "result_text"), strict=True))
    about_all = {"deck": values_in(file, "deck/resolved")} | {name: str(file.attrs[name]) for name in ORIGIN}
    return dataset_of(axes, columns, codes, messages, is_list, about_all)


def write(result: Result, path: str, *, overwrite: bool) -> None:
    """Write a result; the file appears under its name only when it is complete and on the disk.

    Parameters
    ----------
    result : Result
        The result.
    path : str
        The file.
    overwrite : bool
        Whether an existing result may be replaced.

    Raises
    ------
    FileError
        If the file cannot be written, or an existing file may not be replaced.
    """
    check_outputs([path], overwrite=overwrite, hdf5=True)
    _refuse_what_is_not_ours(path)
    # Not by `H5Fget_file_image`, whose superblock has a wrong checksum in HDF5 1.14.
    with io.BytesIO() as stream:
        with h5py.File(stream, "w", libver=FORMAT) as file:
            _write_contents(file, result)
        image = stream.getvalue()
    put(path, image + SEAL % zlib.crc32(image), overwrite=overwrite)


def _refuse_what_is_not_ours(path: str) -> None:
    if not os.path.exists(path) or os.path.getsize(path) == 0:
        return
    try:
        with open_file(path) as file:
            ours = file.attrs.get("program") == PROGRAM
    except FileError:
        ours = False
    if not ours:
        raise FileError(
            f"{path}: exists and is no result of {PROGRAM} (no HDF5 file, of another program, or damaged): "
            "choose another name or remove it"
        )


def _write_contents(file: h5py.File, result: Result) -> None:
    for name, value in result.attributes.items():
        if name != "complete":
            file.attrs[name] = np.int32(value) if isinstance(value, int) else value
    group = file.create_group("deck")
    for name, text in (("text", result.deck), ("resolved", result.resolved_deck)):
        data = text.encode("utf-8", "surrogateescape")
        _put(group, Info(name, "1", TEXTS[name]), data, dtype=h5py.string_dtype("utf-8"))
    log = [(EVENTS[name], result.log[name]) for name in EVENTS]
    for path, columns in (("time_series", result.columns.info()), ("events", log)):
        group = file.create_group(path)
        for info, values in columns:
            _put(group, info, values.astype(STORED_AS.get(info.name, np.float64), copy=False), chunks=True)
        group["time"].make_scale("time")
        for name in group:
            if name != "time":
                group[name].dims[0].attach_scale(group["time"])
    for table in ("summary", "statistics", "parameters"):
        group = file.create_group(table)
        for info, value in getattr(result, table).info():
            # The executable writes counts as real numbers, except those of the statistics.
            keeps = table == "statistics" or isinstance(value, str)
            _put(group, info, value if keeps else float(value))
    file.attrs["complete"] = np.int32(result.complete)


def _put(group: h5py.Group, info: Info, data: Any, **how: Any) -> None:
    """Write a dataset with its unit and its meaning."""
    dataset = group.create_dataset(info.name, data=data, **how)
    dataset.attrs["units"], dataset.attrs["long_name"] = info.units, info.long_name


@contextmanager
def open_file(name: str) -> Iterator[h5py.File]:
    """A result file, open for reading.

    Parameters
    ----------
    name : str
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
    # Opening a pipe would wait for its writer without end.
    if os.path.exists(name) and not os.path.isfile(name):
        raise FileError(f"{name}: is not a regular file")
    try:
        if not h5py.is_hdf5(name):
            raise FileError(f"{name}: {_what_it_is(name)}")
        _check_bytes(name)
        with _opened(name) as file:
            yield file
    except Error:
        raise
    except Exception as error:  # damaged files cause exceptions of any kind in h5py and NumPy
        reason = "no such file" if isinstance(error, FileNotFoundError) else str(error)
        raise FileError(f"{name}: cannot be read: {reason}") from error


def _opened(name: str) -> h5py.File:
    """The file without a lock: nobody changes one that has its name."""
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
    dataset = dataset_in(group, path)
    if dataset is None:
        raise FileError(f"{group.file.filename}: is damaged: it has no {group.name.rstrip('/')}/{path}")
    is_text = h5py.check_string_dtype(dataset.dtype) is not None
    return dataset.asstr(errors="surrogateescape")[()] if is_text else dataset[()]


def _item_in(group: h5py.Group, path: str) -> Any:
    """What has a name in a group, or is where soft links lead; None if there is nothing in this file."""
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


def quantities_in(group: h5py.Group, shape: tuple[int, ...]) -> Iterator[tuple[Info, Any]]:
    """The numbers of this shape in a group, and texts if they are single. What else somebody has put there is left alone."""
    for name in group:
        dataset = group[name] if isinstance(group.get(name, getlink=True), h5py.HardLink) else None
        if (
            not isinstance(dataset, h5py.Dataset)
            or dataset.shape != shape
            or dataset.is_virtual
            or dataset.external
        ):
            continue
        if dataset.dtype.kind in "iuf":
            yield info_of(name, dataset), dataset[()] if shape else dataset[()].tolist()
        elif not shape and h5py.check_string_dtype(dataset.dtype) is not None:
            yield info_of(name, dataset), dataset.asstr(errors="surrogateescape")[()]


def info_of(name: str, dataset: h5py.Dataset) -> Info:
    """Name, unit and meaning of a dataset, from its attributes."""
    about = dataset.attrs
    return Info(name, str(about.get("units", "1")), str(about.get("long_name", "")))


def _check_bytes(name: str) -> None:
    """Refuse a file whose last line is not the checksum of the bytes before it; also one that was cut, or has something appended.

    Edited files and those of others have no such line. There, refuse lists of texts that HDF5 would read without end: a text of
    length 0, or of one that wraps around. A list begins with its length, and has texts, each with its number (0: the room that is
    left) and its length.
    """
    with open(name, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        seal = data.find(MARK, max(0, len(data) - 2 * SEAL_LENGTH))
        if seal >= 0:
            with memoryview(data) as whole, whole[:seal] as part:
                checksum = zlib.crc32(part)
            if data[seal:] != SEAL % checksum:
                raise FileError(f"{name}: is damaged: its bytes do not have the checksum in its last line")
            return
        start = data.find(HEAP)
        while start >= 0:
            end = start + int.from_bytes(data[start + 8 : start + 16], "little")
            place = start + HEAD
            while place + HEAD <= min(end, len(data)):
                number, length = struct.unpack_from("<H6xQ", data, place)
                place += HEAD + -(-length // 8) * 8 if number else length
                if place > end or (not number and length < HEAD):
                    raise FileError(f"{name}: is damaged: a list of texts has a wrong length")
            start = data.find(HEAP, start + 1)


def _what_it_is(name: str) -> str:
    with open(name, "rb") as stream:
        start = stream.read(BEGINNING)
    if b"&" in start and b"\0" not in start:
        return f"is a deck, not a result: dynstiction run {name} makes one"
    return "cannot be read: it is no HDF5 file, or its beginning is damaged"
