"""Reading of files without a seal: a child process reads them and returns a copy, because HDF5 may crash or never end.

HDF5 follows the lengths and addresses that are in the file. One bit that differs can lead it in a circle, in every version, and
the process that reads cannot stop it; or HDF5 destroys its memory and crashes later. The child is ended by the system after
little processor time, and the file is refused. The parent reads only what the child has written.
"""

from __future__ import annotations

import io
import json
import math
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .errors import FileError

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

__all__ = ["sound_copy"]

PATIENCE = 2.0
"""Processor time that the child may use between two signs of life [s]. Waiting for a slow disk does not count."""

COPY, REFUSAL = b"C", b"R"
"""First byte of the child's answer: what follows are the bytes of a file, or the reason why there is none."""

BLOCK = 2**17
"""Number of values that are copied between two signs of life, or one chunk if that is larger."""

CHILD = """
import json, sys, types
folder, name, paths, sys.path[:] = json.loads(sys.argv[1])
package = sys.modules["dynstiction"] = types.ModuleType("dynstiction")
package.__path__ = [folder]
from dynstiction import _guard
_guard.send_copy(name, paths)
"""
"""Imports h5py and the modules of this package that are needed, which takes less time than the whole package."""


def sound_copy(name: str, paths: Sequence[Sequence[str]] | None = None) -> io.BytesIO:
    """A file as a child process has read and written it.

    Parameters
    ----------
    name : str
        The file.
    paths : sequence of sequence of str, optional
        For each dataset that will be read, the names by which it is sought; if there is none, the copy has an empty dataset for
        each name in the file. By default everything is copied, if `judge` accepts the file.

    Returns
    -------
    io.BytesIO
        An HDF5 file.

    Raises
    ------
    FileError
        If the child refuses the file, crashes, does not end, or cannot be started.
    """
    if getattr(sys, "frozen", False) or not sys.executable:
        raise FileError(
            f"{name}: has no checksum, and no Python interpreter is here that could check it: open it with an installed "
            "Python, and save the result under another name"
        )
    arguments = [os.path.dirname(__file__), name, paths, [path for path in sys.path if isinstance(path, str)]]
    command = [sys.executable, "-S", "-W", "ignore", "-c", CHILD, json.dumps(arguments)]
    try:
        child = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    except OSError as error:
        raise FileError(
            f"{name}: has no checksum, and no child process can be started that checks it: {error.strerror}: raise the limit of "
            "processes (ulimit -u)"
        ) from error
    kind, answer = child.stdout[:1], child.stdout[1:]
    if kind == REFUSAL:
        raise FileError(answer.decode("utf-8", "surrogateescape"))
    if child.returncode < 0:
        how = "never ends" if child.returncode == -signal.SIGPROF else "crashes"
        raise FileError(
            f"{name}: is damaged: reading it {how} in HDF5: take a sound copy, or make the file again"
        )
    if child.returncode > 0 or kind != COPY:
        reason = child.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise FileError(f"{name}: has no checksum, and the child process that checks it failed: {reason}")
    return io.BytesIO(answer)


def send_copy(name: str, paths: Sequence[Sequence[str]] | None) -> None:
    """In the child: write a copy of everything, or of the datasets with these names, to the standard output."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGPROF})
    show_life()
    try:
        answer = COPY + _copy(name, paths)
    except FileError as error:
        answer = REFUSAL + str(error).encode("utf-8", "surrogateescape")
    except Exception as error:  # damaged files cause exceptions of any kind in h5py and NumPy
        answer = REFUSAL + f"{name}: cannot be read: {error}".encode("utf-8", "surrogateescape")
    show_life()
    sys.stdout.buffer.write(answer)
    sys.stdout.buffer.flush()


def show_life() -> None:
    """The child has made progress: it may use `PATIENCE` once more."""
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)


def _copy(name: str, paths: Sequence[Sequence[str]] | None) -> bytes:
    """The bytes of a new file with the content of a file."""
    import h5py  # noqa: PLC0415  (slow to import)

    from ._judge import judge  # noqa: PLC0415

    memory = io.BytesIO()
    with h5py.File(name, "r") as file, h5py.File(memory, "w") as copy:
        if paths is None:
            judge(file, name, show_life)
            _copy_attributes(file, copy)
            _copy_members(file, copy)
        for names in paths or ():
            _copy_first(file, copy, names)
    return memory.getvalue()


def _copy_members(group: h5py.Group, copy: h5py.Group) -> None:
    """Everything in a group."""
    import h5py  # noqa: PLC0415

    for key in group:
        show_life()
        item = group[key]
        if isinstance(item, h5py.Dataset):
            _copy_values(item, copy, key)
        else:
            _copy_members(item, copy.create_group(key))
        _copy_attributes(item, copy[key])


def _copy_first(file: h5py.File, copy: h5py.File, names: Sequence[str]) -> None:
    """The first dataset with one of these names, only its unit and kind if it is no column of numbers; else the names of all."""
    import h5py  # noqa: PLC0415

    for name in names:
        show_life()
        item = file.get(name)
        if isinstance(item, h5py.Dataset):
            if name in copy:
                return
            if item.ndim == 1 and item.dtype.kind in "biuf":
                _copy_values(item, copy, name)
            else:
                copy.create_dataset(name, shape=item.shape, dtype=item.dtype)
            if "units" in item.attrs:
                copy[name].attrs["units"] = item.attrs["units"]
            return

    def remember(name: str, item: h5py.Group | h5py.Dataset) -> None:
        show_life()
        if isinstance(item, h5py.Dataset) and name not in copy:
            copy.create_dataset(name, shape=(0,))

    file.visititems(remember)


def _copy_attributes(item: h5py.Group | h5py.Dataset, copy: h5py.Group | h5py.Dataset) -> None:
    from ._judge import SCALES  # noqa: PLC0415

    for key in item.attrs:
        show_life()
        if key not in SCALES:
            copy.attrs[key] = item.attrs[key]


def _copy_values(dataset: h5py.Dataset, group: h5py.Group, name: str) -> None:
    copy = group.create_dataset(name, shape=dataset.shape, dtype=dataset.dtype)
    if dataset.ndim == 0:
        copy[()] = dataset[()]
        return
    rows = max(BLOCK // max(math.prod(dataset.shape[1:]), 1), 1)
    if dataset.chunks:
        rows = math.ceil(rows / dataset.chunks[0]) * dataset.chunks[0]
    for start in range(0, len(dataset), rows):
        show_life()
        copy[start : start + rows] = dataset[start : start + rows]
