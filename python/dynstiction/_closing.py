"""Objects that hold memory of the core: closed at the end of a ``with`` block, used by one thread at a time, and never copied."""

from __future__ import annotations

import os
import threading
from abc import ABC, abstractmethod
from typing import NoReturn, Self, SupportsIndex

from .errors import UsageError

__all__ = ["Closing", "OneAtATime"]


class OneAtATime:
    """A block for one thread at a time: a second thread is refused and does not wait.

    Parameters
    ----------
    name : str
        Name of the object that is used in the block, for the message.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.Lock()
        self._process = os.getpid()

    def __enter__(self) -> None:
        if self._lock.acquire(blocking=False):
            return
        if os.getpid() != self._process:
            raise UsageError(
                f"the {self._name} was in use when this process was forked, so its copy here is half done: make a new one"
            )
        raise UsageError(
            f"the {self._name} is busy: another thread is using it: wait for that, or make one for each thread"
        )

    def __exit__(self, *_: object) -> None:
        self._lock.release()


class Closing(ABC):
    """A context manager that closes itself, and that is neither copied nor pickled."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError(
            f"a {type(self).__name__} cannot be copied or pickled: it holds memory of this process; "
            "copy or send the scene that it was made of, or its result"
        )

    @abstractmethod
    def close(self) -> None:
        """Free the memory."""
