"""Every file that is written in Python, by one rule, that of the executable: it is written as NAME.part, which is also the lock, and
gets its name when it is whole. Until then, and after every failure, the former file is there, or none.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Iterable, Iterator
from itertools import count

from .errors import FileError

__all__ = ["check_outputs", "make_folder", "put"]

Path = str | os.PathLike[str]

HDF5 = b"\x89HDF\r\n\x1a\n"
BEGINNING = 16
"""Bytes by which a part that a killed process has left is known: those of the file that is written."""


def check_outputs(
    outputs: Iterable[Path], inputs: Iterable[Path] = (), *, overwrite: bool, hdf5: bool = False
) -> None:
    """Refuse names of files that are to be written, before anything is computed.

    Parameters
    ----------
    outputs, inputs : iterable of str or PathLike
        Files that will be written, and files that are read.
    overwrite : bool
        Whether existing files may be replaced.
    hdf5 : bool
        Whether the outputs are HDF5 files; others never replace one.

    Raises
    ------
    FileError
        If a folder is missing, a file exists and may not be replaced, or an output is also an input or another output.
    """
    taken = {_place(path): f"the file {os.fspath(path)} is read" for path in inputs}
    for output in outputs:
        name = os.fspath(output)
        try:
            place = _place(output)
        except ValueError as error:
            raise FileError(f"{name}: cannot be written: {error}: choose another name") from None
        _check_name(name, overwrite=overwrite)
        if not hdf5 and os.path.exists(place) and _starts_with(place, HDF5):
            raise FileError(f"{name}: cannot be written: it is an HDF5 file: choose another name")
        if place in taken:
            raise FileError(f"{name}: cannot be written: {taken[place]}: choose another name")
        for input_place, what in taken.items():
            with contextlib.suppress(OSError):
                if os.path.samefile(input_place, place):
                    raise FileError(f"{name}: cannot be written: {what}: choose another name")
        taken[place] = f"{name} is written twice"


def make_folder(folder: Path) -> None:
    """Make a folder for files, with those above it."""
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise FileError(
            f"{os.fspath(folder)}: cannot be written: {error.strerror or error}: {_remedy(error)}"
        ) from None


def _place(path: Path) -> str:
    return os.path.realpath(path)


def _check_name(name: str, *, overwrite: bool) -> None:
    folder = os.path.dirname(name)
    if not os.path.basename(name):
        raise FileError(f"{name}: cannot be written: it is a folder: give a file name")
    if folder and not os.path.isdir(folder):
        raise FileError(f"{name}: cannot be written: the folder {folder} does not exist: create it first")
    if os.path.isdir(name):
        raise FileError(f"{name}: cannot be written: it is a folder: give a file name")
    if not os.path.lexists(name):
        return
    if not os.path.exists(name):
        raise FileError(
            f"{name}: cannot be written: it is a symbolic link to a file that does not exist: remove it"
        )
    if not overwrite:
        raise FileError(f"{name}: the file exists: use --overwrite (overwrite=True) or choose another name")
    if not os.path.isfile(name):
        raise FileError(f"{name}: cannot be written: it is not a regular file: choose another name")


def put(path: Path, data: bytes, *, overwrite: bool) -> None:
    """Write a file; it appears under its name when it is whole and on the disk.

    Parameters
    ----------
    path : str or PathLike
        The file. An HDF5 file is replaced only by another one.
    data : bytes
        All that it will hold.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    FileError
        If the file cannot be written, or may not be replaced.
    """
    name = os.fspath(path)
    check_outputs([name], overwrite=overwrite, hdf5=data.startswith(HDF5))
    place = _place(path)
    part = f"{place}.part"
    try:
        descriptor = _locked(name, part, data[:BEGINNING])
        try:
            # Another writer may have finished just before.
            check_outputs([name], overwrite=overwrite, hdf5=data.startswith(HDF5))
            former = os.stat(place) if os.path.exists(place) else None
            with open(descriptor, "wb", closefd=False) as stream:
                stream.truncate()
                stream.write(data)
                if former is not None:
                    with contextlib.suppress(OSError):
                        os.fchmod(descriptor, stat.S_IMODE(former.st_mode))
                stream.flush()
                os.fsync(descriptor)
            _name(name, part, place, former)
        finally:
            with contextlib.suppress(OSError):
                if os.path.samestat(os.lstat(part), os.fstat(descriptor)):
                    os.unlink(part)
            os.close(descriptor)
    except (OSError, ValueError) as error:  # ValueError: not a path
        if isinstance(error, FileError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise FileError(f"{name}: cannot be written: {reason}: {_remedy(error)}") from None


def _starts_with(name: str, beginning: bytes) -> bool:
    try:
        with open(name, "rb") as stream:
            return stream.read(len(beginning)) == beginning
    except OSError:  # what cannot be read is no result of ours
        return False


def _locked(name: str, part: str, beginning: bytes) -> int:
    """The descriptor of NAME.part, which this process has alone."""
    how = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    while True:
        with contextlib.suppress(FileNotFoundError):
            try:
                descriptor, is_new = os.open(part, how | os.O_CREAT | os.O_EXCL, 0o666), True
            except FileExistsError:
                descriptor, is_new = os.open(part, how), False
            try:
                _lock(name, part, descriptor, is_new=is_new)
                if os.path.samestat(os.lstat(part), os.fstat(descriptor)):
                    break
            except FileError:
                os.close(descriptor)
                raise
            os.close(descriptor)
    left = os.pread(descriptor, BEGINNING, 0)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode) or not beginning.startswith(left):
        os.close(descriptor)
        raise FileError(f"{name}: a file called {part} is in the way: move it away")
    return descriptor


def _lock(name: str, part: str, descriptor: int, *, is_new: bool) -> None:
    """Take a lock. Where a file system has none, the file itself is the lock of the process that made it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EAGAIN):
            raise FileError(
                f"{name}: another process is writing this file: wait until it ends, or use another name"
            ) from None
        if not is_new:
            raise FileError(
                f"{name}: this file system has no locks, and {part} is there: if no process writes it, remove it"
            ) from None


def _name(name: str, part: str, place: str, former: os.stat_result | None) -> None:
    """Give the file its name, if no other one has taken it meanwhile."""
    if former is None or not os.path.lexists(place):
        try:
            # Unlike renaming, this does not replace a file that was created in the meantime.
            os.link(part, place)
        except FileExistsError:
            pass
        except OSError:  # no links in this file system
            if not os.path.lexists(place):
                os.replace(part, place)
                return
        else:
            os.unlink(part)
            _make_durable(place)
            return
    else:
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.lstat(place), former):
                os.replace(part, place)
                _make_durable(place)
                return
    kept = next(kept for kept in _names_beside(place) if not os.path.lexists(kept))
    os.replace(part, kept)
    raise FileError(f"{name}: another file has taken the name: what was to be written is in {kept}")


def _names_beside(place: str) -> Iterator[str]:
    """FILE.kept, FILE.kept2, …: as the executable."""
    yield f"{place}.kept"
    yield from (f"{place}.kept{i}" for i in count(2))


def _make_durable(place: str) -> None:
    with contextlib.suppress(OSError):
        folder = os.open(os.path.dirname(place), os.O_RDONLY)
        os.fsync(folder)
        os.close(folder)


def _remedy(error: Exception) -> str:
    match getattr(error, "errno", None):
        case errno.ENOSPC | errno.EDQUOT:
            return "free some space, or choose another disk"
        case errno.EFBIG:
            return "raise the limit of file sizes (ulimit -f), or write less"
        case errno.ENOENT | errno.ENOTDIR:
            return "make its folder first"
        case errno.ELOOP:
            return "remove the symbolic link that ends with .part"
    return "choose another name or folder"
