"""The HDF5 file of a run: the same layout as the executable's (see the manual, "The result file")."""

from __future__ import annotations

import hashlib
import os
import threading
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from ._open import add_seal, open_file
from .errors import FileError, IncompleteWarning
from .record import EVENT_DTYPE, Described, Info, Record

__all__ = ["read", "write"]

PROGRAM = "dynstiction"
EVENTS = {
    "time": Info("time", "s", "time of the event"),
    "kind": Info("kind", "1", "1 = stick begins, 2 = slip begins"),
}
TEXTS = {"text": "the deck as read", "resolved": "the deck with every key as used"}
# The oldest format with checksums of what describes the data.
FORMAT = ("v108", "v108")
STORED_AS = {"sticking": np.int8, "kind": np.int8}


def write(result: Record, path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Write a result; the file appears under its name only when it is whole."""
    target = Path(path)
    _refuse_to_replace(target, overwrite)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        with h5py.File(temporary, "x", libver=FORMAT) as file:
            _write_contents(file, result)
        add_seal(temporary)
        temporary.replace(target)
    except OSError as error:
        raise FileError(f"{target}: cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _refuse_to_replace(target: Path, overwrite: bool) -> None:
    if not target.exists():
        return
    if not overwrite:
        raise FileError(f"{target}: the file exists: pass overwrite=True or choose another name")
    if not target.is_file() or (target.stat().st_size > 0 and not h5py.is_hdf5(target)):
        raise FileError(f"{target}: exists and is no HDF5 file: choose another name or remove it")


def _write_contents(file: h5py.File, result: Record) -> None:
    for name, value in result.attributes.items():
        if name != "complete":
            file.attrs[name] = np.int32(value) if isinstance(value, int) else value
    for name, text in (("text", result.deck), ("resolved", result.resolved_deck)):
        data = text.encode("utf-8", "surrogateescape")
        dataset = file.create_dataset(f"deck/{name}", data=data, dtype=h5py.string_dtype("utf-8"))
        _describe(dataset, Info(name, "1", TEXTS[name]))
    _write_series(file.create_group("time_series"), result.columns.info())
    _write_series(file.create_group("events"), [(EVENTS[name], result.events[name]) for name in EVENTS])
    _write_group(file.create_group("summary"), result.summary.info())
    _write_group(file.create_group("statistics"), result.statistics.info())
    _write_group(file.create_group("parameters"), result.parameters.info())
    file.attrs["complete"] = np.int32(result.complete)


def _write_series(group: h5py.Group, entries: Iterable[tuple[Info, NDArray[np.generic]]]) -> None:
    """Columns over the group's time, which becomes the dimension scale of the others."""
    for info, values in entries:
        stored = values.astype(STORED_AS.get(info.name, np.float64), copy=False)
        # With a checksum, so that damage is found when it is read.
        _describe(group.create_dataset(info.name, data=stored, chunks=True, fletcher32=True), info)
    group["time"].make_scale("time")
    for name in group:
        if name != "time":
            group[name].dims[0].attach_scale(group["time"])


def _write_group(group: h5py.Group, entries: Iterable[tuple[Info, object]]) -> None:
    for info, value in entries:
        _describe(group.create_dataset(info.name, data=value), info)


def _describe(dataset: h5py.Dataset, info: Info) -> None:
    dataset.attrs["units"] = info.units
    dataset.attrs["long_name"] = info.long_name


def read(path: str | os.PathLike[str]) -> Record:
    """Read a result; see `dynstiction.open`."""
    name = os.fspath(path)
    with open_file(name) as file:
        result = _read_contents(file, name)
    if not result.complete:
        reached = f"ends at t = {result.time[-1]:g} s" if result.time.size else "holds no samples"
        warnings.warn(
            f"{name}: {reached}, before the run's end: {result.result_text or 'stopped or still running'}",
            IncompleteWarning,
            stacklevel=3,
        )
    return result


def _read_contents(file: h5py.File, name: str) -> Record:
    if file.attrs.get("program") != PROGRAM:
        raise FileError(f"{name}: is no file of {PROGRAM}")
    if "sweep" in file:
        raise FileError(f"{name}: holds a sweep, not one run: use dynstiction.open_sweep")
    if "time_series/time" not in file:
        raise FileError(f"{name}: holds no time series: the run was stopped before it began")
    columns = _read_columns(file["time_series"])
    events_by_name = {info.name: values for info, values in _read_columns(file["events"]).items()}
    events = np.empty(events_by_name["time"].size, dtype=EVENT_DTYPE)
    for column in EVENTS:
        events[column] = events_by_name[column]
    ordered = sorted(columns, key=lambda info: info.name != "time")
    for times in (columns[ordered[0]], events["time"]):
        # Also false for NaN.
        if not np.all(np.diff(times, prepend=0.0) >= 0.0):
            raise FileError(f"{name}: is damaged: its times do not ascend")
    deck = _read_text(file, "deck/text")
    if hashlib.sha256(deck.encode("utf-8", "surrogateescape")).hexdigest() != file.attrs["deck_sha256"]:
        raise FileError(f"{name}: is damaged: its deck does not have the checksum that the file states")
    attributes: dict[str, str | int] = {"complete": 0}
    for key, value in file.attrs.items():
        attributes[key] = value if isinstance(value, str) else int(value)
    return Record(
        columns=Described((info, columns[info]) for info in ordered),
        events=events,
        summary=Described(_read_scalars(file, "summary")),
        statistics=Described(_read_scalars(file, "statistics")),
        parameters=Described(_read_scalars(file, "parameters")),
        attributes=attributes,
        deck=deck,
        resolved_deck=_read_text(file, "deck/resolved"),
    )


def _read_columns(group: h5py.Group) -> dict[Info, NDArray[np.float64]]:
    """All columns of a group, cut to the length of the shortest: a killed run may have flushed them unevenly."""
    datasets = dict(_read_group(group))
    rows = min(dataset.shape[0] for dataset in datasets.values())
    return {info: dataset.astype(np.float64)[:rows] for info, dataset in datasets.items()}


def _read_group(group: h5py.Group) -> Iterable[tuple[Info, h5py.Dataset]]:
    for name, dataset in group.items():
        yield Info(name, dataset.attrs.get("units", "1"), dataset.attrs.get("long_name", "")), dataset


def _read_scalars(file: h5py.File, group: str) -> Iterable[tuple[Info, Any]]:
    if group not in file:
        return
    for info, dataset in _read_group(file[group]):
        value = dataset[()]
        yield info, value.decode() if isinstance(value, bytes) else value.tolist()


def _read_text(file: h5py.File, name: str) -> str:
    if name not in file:
        return ""
    data: bytes = file[name][()]
    return data.decode("utf-8", "surrogateescape")
