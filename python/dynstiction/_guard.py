"""Reading of files without a seal: a child process reads everything first, because HDF5 may crash or never end.

HDF5 follows the lengths and addresses that are in the file. One bit that differs can lead it in a circle, in every version, and
the process that reads cannot stop it. The child is ended by the system after little processor time, and the file is refused.
"""

from __future__ import annotations

import json
import math
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from .errors import FileError

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

__all__ = ["guard"]

PATIENCE = 2.0
"""Processor time that the child may use between two signs of life [s]. Waiting for a slow disk does not count."""

BLOCK = 2**17
"""Number of values that are read between two signs of life, or one chunk if that is larger."""

CHILD = """
import json, sys, types
folder, name, paths, sys.path[:] = json.loads(sys.argv[1])
package = sys.modules["dynstiction"] = types.ModuleType("dynstiction")
package.__path__ = [folder]
from dynstiction import _guard
_guard.read_all(name, paths)
"""
"""Imports h5py and the modules of this package that are needed, which takes less time than the whole package."""


def guard(name: str, paths: Sequence[Sequence[str]] | None = None) -> None:
    """Let a child process read a file as its reader will do afterwards.

    An exception in the child is no reason to refuse the file: the reader gets the same one, and can say what it means.

    Parameters
    ----------
    name : str
        The file.
    paths : sequence of sequence of str, optional
        For each dataset that will be read, the names by which it is sought. By default everything is read, as far as `judge`
        accepts the file.

    Raises
    ------
    FileError
        If the child crashes, does not end, or cannot be started.
    """
    if getattr(sys, "frozen", False) or not sys.executable:
        raise FileError(
            f"{name}: has no checksum, and no Python interpreter is here that could check it: open it with an installed "
            "Python, and save the result under another name"
        )
    arguments = [os.path.dirname(__file__), name, paths, [path for path in sys.path if isinstance(path, str)]]
    command = [sys.executable, "-S", "-W", "ignore", "-c", CHILD, json.dumps(arguments)]
    try:
        child = subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False
        )
    except OSError as error:
        raise FileError(
            f"{name}: has no checksum, and no child process can be started that checks it: {error.strerror}: raise the limit of "
            "processes (ulimit -u)"
        ) from error
    if child.returncode < 0:
        how = "never ends" if child.returncode == -signal.SIGPROF else "crashes"
        raise FileError(
            f"{name}: is damaged: reading it {how} in HDF5: take a sound copy, or make the file again"
        )
    if child.returncode > 0:
        reason = child.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise FileError(f"{name}: has no checksum, and the child process that checks it failed: {reason}")


def read_all(name: str, paths: Sequence[Sequence[str]] | None) -> None:
    """In the child: read everything, or the datasets with these names."""
    import h5py  # noqa: PLC0415  (slow to import)

    from ._judge import judge  # noqa: PLC0415

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGPROF})
    show_life()
    with suppress(Exception), h5py.File(name, "r") as file:
        if paths is None:
            judge(file, name, show_life)
            _read_object(file)
        for names in paths or ():
            _read_first(file, names)


def show_life() -> None:
    """The child has made progress: it may use `PATIENCE` once more."""
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)


def _read_object(item: h5py.Group | h5py.Dataset) -> None:
    """Attributes and values of a dataset, or everything in a group."""
    import h5py  # noqa: PLC0415

    from ._judge import SCALES  # noqa: PLC0415

    for key in item.attrs:
        show_life()
        if key not in SCALES:
            with suppress(Exception):
                item.attrs[key]
    if isinstance(item, h5py.Dataset):
        _read_values(item)
        return
    for key in item:
        show_life()
        with suppress(Exception):
            _read_object(item[key])


def _read_first(file: h5py.File, names: Sequence[str]) -> None:
    """The first dataset with one of these names; if there is none, the names of all datasets."""
    import h5py  # noqa: PLC0415

    for name in names:
        show_life()
        item = file.get(name)
        if isinstance(item, h5py.Dataset):
            with suppress(Exception):
                item.attrs.get("units")
            if item.ndim == 1 and item.dtype.kind in "biuf":
                _read_values(item)
            return
    file.visititems(lambda _, item: show_life())


def _read_values(dataset: h5py.Dataset) -> None:
    if dataset.ndim == 0:
        show_life()
        dataset[()]
        return
    rows = max(BLOCK // max(math.prod(dataset.shape[1:]), 1), 1)
    if dataset.chunks:
        rows = math.ceil(rows / dataset.chunks[0]) * dataset.chunks[0]
    for start in range(0, len(dataset), rows):
        show_life()
        dataset[start : start + rows]
