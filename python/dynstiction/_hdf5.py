"""The HDF5 file of a run, in the layout of the executable (see the manual, "The result file").

It is created in memory and written as bytes, so that HDF5 itself never writes to a full disk; after such an error HDF5 would
fail again and again, also at the end of the process.
"""

from __future__ import annotations

import hashlib
import io
import os
import warnings
import zlib
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, TypeVar

import h5py  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from . import _native
from ._commands import PROGRAM
from ._open import SEAL, dataset_in, info_of, open_file, own_datasets, values_in
from ._output import check_outputs, put
from .errors import FileError, IncompleteWarning
from .record import EVENTS, LOG_DTYPE, Described, Info
from .result import Result

if TYPE_CHECKING:
    import xarray

__all__ = ["read", "write"]

COUNTS = ("complete", "result_code", "threads")
"""Attributes that are Python integers, as in a run in memory; every other one is what h5py reads, also what others have added."""

TEXTS = {"text": "the deck as read", "resolved": "the deck with every key as used"}
FORMAT = ("v108", "v108")
"""The oldest one in which the descriptions of the data have checksums."""
STORED_AS = {"sticking": np.int8, "kind": np.int8, "occurs": np.int64}

T = TypeVar("T")


def read(name: str) -> Result | xarray.Dataset:
    """Read a run or a sweep; see `dynstiction.open`."""
    with open_file(name) as file:
        if "sweep" in file:
            from ._sweep import read_sweep  # noqa: PLC0415

            return read_sweep(file, name)
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
    columns = _read_columns(file, "time_series")
    log_by_name = {info.name: values for info, values in _read_columns(file, "events").items()}
    log = np.empty(log_by_name["time"].size, dtype=LOG_DTYPE)
    for column in EVENTS:
        log[column] = log_by_name[column]
    parameters = list(_read_scalars(file, "parameters"))
    chosen = next((str(value) for info, value in parameters if info.name == "fields"), "default")
    ordered = _in_order(((info, info) for info in columns), "columns", ["time", *chosen.split()])
    for times in (columns[ordered[0][0]], log["time"]):
        # Also false for NaN.
        if not np.all(np.diff(times, prepend=0.0) >= 0.0):
            raise FileError(f"{name}: is damaged: its times do not ascend")
    deck = _read_text(file, "deck/text")
    if hashlib.sha256(deck.encode("utf-8", "surrogateescape")).hexdigest() != file.attrs["deck_sha256"]:
        raise FileError(f"{name}: is damaged: its deck does not have the checksum that the file states")
    attributes = {"complete": 0, **file.attrs}
    attributes |= {name: int(attributes[name]) for name in COUNTS if name in attributes}
    return Result(
        columns=Described(((info, columns[info]) for info, _ in ordered), "columns"),
        log=log,
        summary=Described(_in_order(_read_scalars(file, "summary"), "summary"), "summary"),
        statistics=Described(_in_order(_read_scalars(file, "statistics"), "statistics"), "statistics"),
        parameters=Described(_in_order(parameters, "keys"), "parameters"),
        attributes=attributes,
        deck=deck,
        resolved_deck=_read_text(file, "deck/resolved"),
    )


def _read_columns(file: h5py.File, path: str) -> dict[Info, NDArray[np.float64]]:
    """All columns of a group: those that are as long as its times."""
    group, time = file[path], dataset_in(file, f"{path}/time")
    columns = own_datasets(group, 1)
    return {
        info_of(name, dataset): dataset[:].astype(np.float64, copy=False)
        for name, dataset in columns
        if time is not None and dataset.shape == time.shape and dataset.dtype.kind in "iuf"
    }


def _read_scalars(file: h5py.File, path: str) -> Iterable[tuple[Info, Any]]:
    if path not in file:
        return
    for name, dataset in own_datasets(file[path], 0):
        value = dataset[()]
        yield info_of(name, dataset), value.decode() if isinstance(value, bytes) else value.tolist()


def _in_order(
    entries: Iterable[tuple[Info, T]], table: str, first: Iterable[str] = ()
) -> list[tuple[Info, T]]:
    """Entries in the same order as in a run in memory, while HDF5 lists them by name. Counts are integers."""
    names = [*first, *(entry["name"] for entry in _native.catalogue()[table])]
    place = {name: -i for i, name in enumerate(reversed(names), 1)}
    return _native.with_integers(
        sorted(entries, key=lambda entry: (place.get(entry[0].name, 0), entry[0].name))
    )


def _read_text(file: h5py.File, name: str) -> str:
    return "" if dataset_in(file, name) is None else values_in(file, name)


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
