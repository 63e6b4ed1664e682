"""Writing the HDF5 file of a run, in the layout of the executable (see the manual, "The result file").

The file is created in memory and written as bytes, so that HDF5 itself never writes to a full disk; after such an error HDF5 would
fail again and again, also at the end of the process.
"""

from __future__ import annotations

import io
import os
import zlib
from collections.abc import Iterable
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from ._commands import PROGRAM
from ._open import SEAL, open_file
from ._output import check_outputs, put
from .errors import FileError
from .record import EVENTS, Described, Info
from .result import Result

__all__ = ["refuse_to_replace", "write"]

TEXTS = {"text": "the deck as read", "resolved": "the deck with every key as used"}
# The oldest format in which the descriptions of the data have checksums.
FORMAT = ("v108", "v108")
STORED_AS = {"sticking": np.int8, "kind": np.int8, "occurs": np.int64}


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
    refuse_to_replace(path, overwrite=overwrite)
    image = _image(result)
    put(path, image + SEAL % zlib.crc32(image), overwrite=overwrite)


def refuse_to_replace(path: str, *, overwrite: bool) -> None:
    """Raise if a result cannot have this name because of an existing file."""
    check_outputs([path], overwrite=overwrite, hdf5=True)
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


def _image(result: Result) -> bytes:
    """The bytes of the file.

    They are not taken from `H5Fget_file_image`, whose superblock has a wrong checksum in HDF5 1.14.
    """
    with io.BytesIO() as stream:
        with h5py.File(stream, "w", libver=FORMAT) as file:
            _write_contents(file, result)
        return stream.getvalue()


def _write_contents(file: h5py.File, result: Result) -> None:
    for name, value in result.attributes.items():
        if name != "complete":
            file.attrs[name] = np.int32(value) if isinstance(value, int) else value
    for name, text in (("text", result.deck), ("resolved", result.resolved_deck)):
        data = text.encode("utf-8", "surrogateescape")
        dataset = file.create_dataset(f"deck/{name}", data=data, dtype=h5py.string_dtype("utf-8"))
        _describe(dataset, Info(name, "1", TEXTS[name]))
    _write_series(file.create_group("time_series"), result.columns.info(), "time")
    _write_series(file.create_group("events"), [(EVENTS[name], result.log[name]) for name in EVENTS], "time")
    _write_group(file.create_group("summary"), _as_reals(result.summary))
    _write_group(file.create_group("statistics"), result.statistics.info())
    _write_group(file.create_group("parameters"), _as_reals(result.parameters))
    file.attrs["complete"] = np.int32(result.complete)


def _write_series(group: h5py.Group, entries: Iterable[tuple[Info, NDArray[Any]]], scale: str) -> None:
    """Write columns over one of the group's columns, which becomes their dimension scale."""
    for info, values in entries:
        stored = values.astype(STORED_AS.get(info.name, np.float64), copy=False)
        _describe(group.create_dataset(info.name, data=stored, chunks=True), info)
    group[scale].make_scale(scale)
    for name in group:
        if name != scale:
            group[name].dims[0].attach_scale(group[scale])


def _as_reals(values: Described[Any]) -> Iterable[tuple[Info, object]]:
    """Numbers as the executable writes them: its counts are real numbers."""
    return ((info, value if isinstance(value, str) else float(value)) for info, value in values.info())


def _write_group(group: h5py.Group, entries: Iterable[tuple[Info, object]]) -> None:
    for info, value in entries:
        _describe(group.create_dataset(info.name, data=value), info)


def _describe(dataset: h5py.Dataset, info: Info) -> None:
    dataset.attrs["units"] = info.units
    dataset.attrs["long_name"] = info.long_name
