"""Ctrl-C, after which the results until then are kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack


def interrupted(message: str, partial: Callable[[], object]) -> KeyboardInterrupt:
    """A `KeyboardInterrupt` with the results until then, which `partial` collects, as the attribute ``partial``.

    It does not have its own class: only a plain `KeyboardInterrupt` that is not caught ends a script as Ctrl-C does, so that
    a loop in the shell that called the script ends too. Of several Ctrl-C only the first one is raised: those that come in the
    meantime are dropped.
    """
    error = KeyboardInterrupt(message)
    with ExitStack() as stack:
        before = signal.getsignal(signal.SIGINT)
        if threading.current_thread() is threading.main_thread() and callable(before):
            stack.callback(signal.signal, signal.SIGINT, before)
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        error.partial = partial()  # type: ignore[attr-defined]
    return error
