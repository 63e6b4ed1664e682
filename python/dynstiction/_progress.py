"""Progress bars; tqdm is imported when the first one is drawn."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from typing import Any

from ._arguments import flag
from .errors import PackageError

DELAY = 1.0
"""Shorter tasks have no bar [s]."""

bars: list[Any] = []
"""Bars on the screen."""


@contextmanager
def progress_bar(wanted: bool | None, total: float, form: str) -> Iterator[Callable[[float], None]]:
    """Return a function to call with the part of `total` that is done; `form` is tqdm's ``bar_format``.

    If `wanted` is None, there is a bar only on a terminal or in a notebook, after a second, and if tqdm is installed.
    """
    if wanted is not None and flag("progress", wanted):
        try:
            import_module("tqdm.auto")
        except ImportError as error:
            raise PackageError(f"progress=True needs tqdm ({error}): pip install tqdm") from None
    begun = time.monotonic()
    delay = 0.0 if wanted else DELAY if wanted is None and _is_watched() else float("inf")
    bar: Any = None
    with ExitStack() as stack:

        def show(done: float) -> None:
            nonlocal bar
            if bar is None and time.monotonic() - begun >= delay:
                with suppress(ImportError):
                    from tqdm.auto import tqdm  # type: ignore[import-untyped]  # noqa: PLC0415  (optional)

                    bar = stack.enter_context(tqdm(total=total, bar_format=form))
                    bars.append(bar)
                    stack.callback(bars.remove, bar)
            if bar is not None and done > bar.n:
                bar.update(done - bar.n)

        yield show


def _is_watched() -> bool:
    return "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())
