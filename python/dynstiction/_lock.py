"""The lock of a result file: FILE.h5.lock beside it, as long as a process writes it or prepares to. The executable has the same.

The operating system holds the lock (flock) while the process lives; the file's text says which process that is. A lock that nobody
holds is stale, and is taken over.
"""

from __future__ import annotations

import errno
import fcntl
import glob
import os
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from .errors import FileError

__all__ = ["locked"]

SIGNATURE = "dynstiction lock"
LONGEST_TEXT = 1024
MOST_TRIES = 100
"""Of taking a lock that others take and give up meanwhile."""


@contextmanager
def locked(path: str) -> Iterator[None]:
    """Hold the lock of a result file.

    Parameters
    ----------
    path : str
        Of the result.

    Raises
    ------
    FileError
        If another process holds it, or it cannot be made.
    """
    name = f"{path}.lock"
    try:
        descriptor = _taken(name)
    except BlockingIOError:
        owner = _owner(name)
        who = f" (process {owner['process']} on {owner.get('host', '')})" if "process" in owner else ""
        reason = f"locked: another process is writing this file{who}: wait until it ends, or use another name"
        raise FileError(f"{path}: cannot create: {reason}") from None
    except (OSError, ValueError) as error:  # ValueError: no path at all
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{path}: cannot create: {reason}: choose another name or folder") from None
    try:
        _remove_unfinished(path, _owner(name).get("tag", ""))
        os.truncate(descriptor, 0)
        tag = secrets.token_hex(5)
        text = f"{SIGNATURE}\nprocess {os.getpid()}\nhost {socket.gethostname()}\ntag {tag}\n"
        os.pwrite(descriptor, text.encode(), 0)
        yield
    finally:
        with suppress(OSError):
            if os.path.samestat(os.fstat(descriptor), os.lstat(name)):
                os.unlink(name)
        os.close(descriptor)


def _taken(name: str) -> int:
    """Descriptor of the lock file, locked."""
    for _ in range(MOST_TRIES):
        descriptor = os.open(
            name, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666
        )
        try:
            _lock(descriptor)
            if os.fstat(descriptor).st_size > 0 and not _owner(name):
                raise OSError(errno.EEXIST, f"{name} is no lock of this program: move it away")
            # Who had it may have removed it meanwhile.
            if os.path.samestat(os.fstat(descriptor), os.lstat(name)):
                return descriptor
        except FileNotFoundError:
            pass
        except OSError:
            os.close(descriptor)
            raise
        os.close(descriptor)
    raise BlockingIOError


def _lock(descriptor: int) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        # Of a file system without locks the text decides.
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL):
            raise
        if os.fstat(descriptor).st_size > 0:
            raise BlockingIOError from None


def _owner(name: str) -> dict[str, str]:
    """Lines of a name and a value, after the signature; nothing of what is no lock."""
    with suppress(OSError), open(name, encoding="utf-8", errors="replace") as stream:
        signature, *lines = stream.read(LONGEST_TEXT).split("\n")
        if signature == SIGNATURE:
            return dict(line.split(" ", 1) for line in lines if " " in line) | {"": signature}
    return {}


def _remove_unfinished(path: str, tag: str) -> None:
    """What a process that was killed left unfinished has its tag in the name."""
    if len(tag) == 10 and tag.isalnum():
        for name in glob.glob(f"{glob.escape(path)}.*{tag}.part"):
            with suppress(OSError):
                os.unlink(name)
