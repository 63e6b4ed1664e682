"""The cases of a sweep, given a few at a time to threads of this process or to an executor."""

from __future__ import annotations

import math
import os
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from .errors import Error, IncompleteWarning

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

__all__ = ["MOST_THREADS", "Work"]

LONGEST_PIECE = 64
"""Largest number of cases that a thread takes at once."""

SHORTEST_PIECE = 4
"""If several cases run side by side in a thread, each place is used this many times before the thread fetches more."""

MOST_THREADS = 1024
"""Largest number of threads; more are useful on no machine."""

PIECE_SECONDS = 0.02
"""Estimated duration of the cases that a thread takes at once."""

TASK_SECONDS = 0.5
"""The same for a task of an executor: sending it may take milliseconds, and a deck is read for it."""

LONGEST_TASK = 4096
"""Largest number of cases in a task."""

TASKS_PER_WORKER = 3
"""Number of tasks that wait or run, for each worker."""

UNKNOWN_WORKERS = 128
"""Assumed number of workers if the executor does not give it."""


class Work:
    """The cases of a sweep and their results.

    Attributes
    ----------
    values, codes, cycles, counts : ndarray
        For each case: summary (case, value), result code, kept cycles (case, cycle, quantity), and their number.
    messages : dict
        Why a case failed, by its number from 0.
    stopped : bool
        Whether Ctrl-C has ended it.
    """

    def __init__(self, core: _native.Sweep) -> None:
        self._core = core
        self._lock = threading.Lock()
        self._next = 0
        self._done = 0
        self.stopped = False
        self._error: BaseException | None = None
        self.values = np.full((core.cases, len(core.quantities)), np.nan)
        self.codes = np.full(core.cases, _native.NOT_RUN, dtype=np.int32)
        self.cycles = np.full((core.cases, core.most_cycles, len(core.cycle_quantities)), np.nan)
        self.counts = np.zeros(core.cases, dtype=np.int32)
        self.messages: dict[int, str] = {}

    def run(self, n_threads: int, show: Callable[[float], None]) -> None:
        """Run all cases in threads of this process; Ctrl-C ends it early."""
        # After a Ctrl-C in Thread.join a running thread seems to have ended (Python 3.11).
        ends = [threading.Event() for _ in range(n_threads)]
        threads = [
            threading.Thread(target=self._one_thread, args=(n_threads, end), daemon=True) for end in ends
        ]
        try:
            for thread in threads:
                _start(thread)
            for end in ends:
                while not end.wait(_native.CHUNK_SECONDS):
                    show(self._done)
            show(self._done)
        except KeyboardInterrupt:
            self.stopped = True
        finally:
            self._wait([end for thread, end in zip(threads, ends, strict=True) if thread.ident is not None])
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """Stop the unfinished cases, from any thread."""
        self.stopped = True
        self._core.stop()

    def _wait(self, ends: list[threading.Event]) -> None:
        """Wait for the end of the threads in any case: they use the core, which is freed afterwards."""
        while not all(end.is_set() for end in ends):
            try:
                self._core.stop()
                for end in ends:
                    end.wait()
            except KeyboardInterrupt:
                self.stopped = True

    def _one_thread(self, n_threads: int, end: threading.Event) -> None:
        count = 1
        try:
            while not self.stopped:
                with self._lock:
                    first = self._next
                    left = self._core.cases - first
                    # The pieces are smaller if fewer cases are left and if a case takes longer, but not so small that
                    # places for cases side by side stay empty.
                    count = min(count, LONGEST_PIECE, left // (4 * n_threads))
                    count = min(left, max(1, count, self._fewest()))
                    self._next += count
                if left <= 0:
                    return
                begun = time.perf_counter()
                cases = self._core.run(first, count)
                passed = time.perf_counter() - begun
                self._keep(first, cases)
                count = int(min(LONGEST_PIECE, count * PIECE_SECONDS / passed))
        except BaseException as error:
            self._error = error
            self.stopped = True
        finally:
            end.set()

    def _fewest(self) -> int:
        """Number of cases that fills every place for cases side by side."""
        return SHORTEST_PIECE * (self._core.at_once - 1)

    def _keep(self, first: int, cases: _native.Cases) -> None:
        here = slice(first, first + len(cases.codes))
        self.values[here], self.codes[here] = cases.values, cases.codes
        self.cycles[here], self.counts[here] = cases.cycles, cases.counts
        self.messages.update(cases.messages)
        with self._lock:
            self._done += len(cases.codes)

    def run_on(self, executor: Executor, deck: _native.DeckSource, show: Callable[[float], None]) -> None:
        """Run all cases as tasks of an executor; Ctrl-C ends it early.

        A task is the deck with the parameters of some cases: it needs nothing but the package where it runs.
        """
        from concurrent.futures import FIRST_COMPLETED, wait  # noqa: PLC0415  (only here)

        token = os.urandom(16).hex()
        workers = _workers_of(executor)
        going_on: dict[Future[_Answer], int] = {}
        count = 1
        try:
            while self._next < self._core.cases or going_on:
                while self._next < self._core.cases and len(going_on) < TASKS_PER_WORKER * workers:
                    left = self._core.cases - self._next
                    count = min(left, max(1, min(count, math.ceil(left / (4 * workers))), self._fewest()))
                    going_on[executor.submit(_run_task, self._task(deck, count, token))] = self._next
                    self._next += count
                done, _ = wait(going_on, _native.CHUNK_SECONDS, FIRST_COMPLETED)
                for future in done:
                    answer = future.result()
                    self._keep_answer(going_on.pop(future), answer)
                    count = int(min(LONGEST_TASK, len(answer.cases.codes) * TASK_SECONDS / answer.seconds))
                show(self._done)
        except KeyboardInterrupt:
            self.stopped = True
            for future, first in going_on.items():
                if future.done() and not future.cancelled() and future.exception() is None:
                    self._keep_answer(first, future.result())
        finally:
            _give_up(token, going_on)

    def _keep_answer(self, first: int, answer: _Answer) -> None:
        messages = {first + case: text for case, text in answer.cases.messages.items()}
        self._keep(first, answer.cases._replace(messages=messages))

    def _task(self, deck: _native.DeckSource, count: int, token: str) -> _Task:
        cases = np.arange(self._next, self._next + count)
        if self._core.is_list:
            places = [cases] * len(self._core.axes)
        else:
            # The last parameter varies fastest.
            places = list(np.unravel_index(cases, [axis.size for _, axis in self._core.axes]))
        points = [(info.name, axis[at]) for (info, axis), at in zip(self._core.axes, places, strict=True)]
        return _Task(deck, points, token)

    def warn(self, stacklevel: int) -> None:
        """Warn if cases failed."""
        if self.messages:
            case, message = min(self.messages.items())
            text = f"{len(self.messages)} of {self._core.cases} cases failed; the first, number {case}: {message}"
            warnings.warn(text, IncompleteWarning, stacklevel=stacklevel + 1)

    def progress(self) -> str:
        """Number of finished cases, as text."""
        return f"{np.count_nonzero(self.codes != _native.NOT_RUN)} of {self._core.cases} cases"


def _start(thread: threading.Thread) -> None:
    try:
        thread.start()
    except RuntimeError as error:
        raise MemoryError(f"{error}: give fewer threads, or smaller stacks (threading.stack_size)") from None


# Tasks of an executor. They may run in this process, in another, or on another machine.


class _Task(NamedTuple):
    deck: _native.DeckSource
    points: list[tuple[str, NDArray[np.float64]]]
    """Parameters and their values, one for each case."""
    token: str
    """Token of the sweep, the same for all its tasks."""


class _Answer(NamedTuple):
    cases: _native.Cases
    seconds: float


_works: dict[str, set[Work]] = {}
"""Work that runs in this process, by the token of its sweep."""

_given_up: set[str] = set()


def _run_task(task: _Task) -> _Answer:
    """Run a few cases."""
    begun = time.perf_counter()
    with _native.Sweep(task.deck, task.points, True) as core:
        work = Work(core)
        works = _works.setdefault(task.token, set())
        works.add(work)
        try:
            if task.token not in _given_up:
                # In a separate thread, so that Ctrl-C also ends it in the main thread of a process.
                work.run(1, lambda done: None)
        finally:
            works.discard(work)
            if not works:
                _works.pop(task.token, None)
    if work.stopped:
        # A Ctrl-C that all processes of a terminal receive also ends the tasks that this process has not begun.
        _given_up.add(task.token)
        raise KeyboardInterrupt
    cases = _native.Cases(work.values, work.cycles, work.counts, work.codes, work.messages)
    return _Answer(cases, time.perf_counter() - begun)


def _give_up(token: str, futures: dict[Future[_Answer], int]) -> None:
    """Cancel tasks that have not begun, and stop those in this process. Tasks elsewhere end later; their results are ignored."""
    if not futures:
        return
    _given_up.add(token)
    for future in futures:
        future.cancel()
    for work in list(_works.get(token, ())):
        with suppress(Error):  # it has just ended
            work.stop()


def _workers_of(executor: Executor) -> int:
    """Number of workers of an executor, if it gives it."""
    for name in ("num_workers", "_max_workers"):
        count = getattr(executor, name, None)
        if isinstance(count, int) and count > 0:
            return count
    return UNKNOWN_WORKERS
