"""The stack of the thread that calls the core."""

from __future__ import annotations

import ctypes
import threading

from .errors import UsageError

__all__ = ["check_stack"]

LEAST = 224 * 1024
"""Number of bytes that the deepest call of the core needs, with a margin."""

_of_thread = threading.local()


def check_stack() -> None:
    """Refuse a thread whose stack is too small for the core: an overflow would end the interpreter."""
    if not hasattr(_of_thread, "size"):
        _of_thread.size = _stack_size()
    if _of_thread.size < LEAST:
        raise UsageError(
            f"this thread has a stack of {_of_thread.size // 1024} kB, and {LEAST // 1024} are needed: "
            "call threading.stack_size(0) before the thread is made"
        )


def _stack_size() -> int:
    """Number of bytes of the stack of this thread; a sufficient number if the limit is not known."""
    library = ctypes.CDLL(None)
    attributes, size = ctypes.create_string_buffer(256), ctypes.c_size_t(LEAST)
    try:
        library.pthread_self.restype = ctypes.c_void_p
        if library.pthread_getattr_np(ctypes.c_void_p(library.pthread_self()), attributes) == 0:
            library.pthread_attr_getstacksize(attributes, ctypes.byref(size))
            library.pthread_attr_destroy(attributes)
    except AttributeError:  # a system without this function
        pass
    return size.value
