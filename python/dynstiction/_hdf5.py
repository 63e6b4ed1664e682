"""Reading the HDF5 file of a run (see the manual, "The result file")."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, TypeVar

import h5py  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from . import _native
from ._commands import PROGRAM
from ._open import dataset_in, info_of, open_file, own_datasets, values_in
from .errors import FileError, IncompleteWarning
from .record import EVENTS, LOG_DTYPE, Described, Info
from .result import Result

if TYPE_CHECKING:
    import xarray

__all__ = ["read"]

COUNTS = ("complete", "result_code", "threads")
"""Attributes that are Python integers, as in a run in memory; every other one is what h5py reads, also what others have added."""

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
