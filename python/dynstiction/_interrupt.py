"""Ctrl-C at points where it does no harm."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


def interrupted(message: str, partial: object) -> KeyboardInterrupt:
    """A `KeyboardInterrupt` with the results until then as the attribute ``partial``.

    It does not have its own class: only a plain `KeyboardInterrupt` that is not caught ends a script as Ctrl-C does, so that
    a loop in the shell that called the script ends too.
    """
    error = KeyboardInterrupt(message)
    error.partial = partial  # type: ignore[attr-defined]
    return error


@contextmanager
def held_back(*, forget: bool = False) -> Iterator[None]:
    """Hold an interrupt (SIGINT) back until the block has ended, in the thread that gets it; elsewhere do nothing.

    With `forget` it is dropped: of several Ctrl-C only the first one is raised. The block can store all that the core returns:
    without this, Ctrl-C during a call of the core is raised right after the call, before its results have been assigned.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    came: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came and not forget:
            before(*came[0])
