"""Every file that is written in Python, by one rule: it is written under a name of its own, and gets its name when it is whole.
Until then, and after every failure, the former file is there, or none.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterable

from .errors import FileError

Path = str | os.PathLike[str]

HDF5 = b"\x89HDF\r\n\x1a\n"

unfinished: set[str] = set()
"""Files that are being written."""


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
    taken = {os.path.realpath(path): f"the file {os.fspath(path)} is read" for path in inputs}
    for output in outputs:
        name = os.fspath(output)
        try:
            place = os.path.realpath(name)
            problem = _problem(name)
        except ValueError as error:
            problem = f"{error}: choose another name"
        if not problem and os.path.exists(name):
            if not overwrite:
                raise FileError(_EXISTS.format(name))
            if not os.path.isfile(name):
                problem = "it is not a regular file: choose another name"
            elif not hdf5 and _starts_with(place, HDF5):
                problem = "it is an HDF5 file: choose another name"
        if not problem and place in taken:
            problem = f"{taken[place]}: choose another name"
        if problem:
            raise FileError(f"{name}: cannot be written: {problem}")
        taken[place] = f"{name} is written twice"


def make_folder(folder: Path) -> None:
    """Make a folder for files, with those above it."""
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise FileError(
            f"{os.fspath(folder)}: cannot be written: {error.strerror or error}: {_remedy(error)}"
        ) from None


_EXISTS = "{}: the file exists: use --overwrite (overwrite=True) or choose another name"


def _problem(name: str) -> str:
    """Why there can be no file of this name, and what to do; '' if there can."""
    folder = os.path.dirname(name)
    if not os.path.basename(name) or os.path.isdir(name):
        return "it is a folder: give a file name"
    if folder and not os.path.isdir(folder):
        return f"the folder {folder} does not exist: create it first"
    if os.path.lexists(name) and not os.path.exists(name):
        return "it is a symbolic link to a file that does not exist: remove it"
    return ""


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
    place = os.path.realpath(name)
    part = f"{place}.{os.urandom(4).hex()}.part"
    unfinished.add(part)
    try:
        with open(part, "xb") as stream:
            stream.write(data)
            with contextlib.suppress(OSError):
                os.fchmod(stream.fileno(), stat.S_IMODE(os.stat(place).st_mode))
            stream.flush()
            os.fsync(stream.fileno())
        _name(part, place, overwrite=overwrite)
    except FileExistsError:
        raise FileError(_EXISTS.format(name)) from None
    except OSError as error:
        reason = error.strerror or error
        raise FileError(f"{name}: cannot be written: {reason}: {_remedy(error)}") from None
    finally:
        with contextlib.suppress(OSError):
            os.unlink(part)
        unfinished.discard(part)


def _name(part: str, place: str, *, overwrite: bool) -> None:
    if not overwrite:
        try:
            # Unlike renaming, this does not replace a file that was created in the meantime.
            os.link(part, place)
        except FileExistsError:
            raise
        except OSError:  # no links in this file system
            pass
        else:
            return
    os.replace(part, place)


def _starts_with(name: str, beginning: bytes) -> bool:
    try:
        with open(name, "rb") as stream:
            return stream.read(len(beginning)) == beginning
    except OSError:  # what cannot be read is no result of ours
        return False


def _remedy(error: OSError) -> str:
    match error.errno:
        case errno.ENOSPC | errno.EDQUOT:
            return "free some space, or choose another disk"
        case errno.EFBIG:
            return "raise the limit of file sizes (ulimit -f), or write less"
        case errno.ENOENT | errno.ENOTDIR:
            return "make its folder first"
    return "choose another name or folder"
