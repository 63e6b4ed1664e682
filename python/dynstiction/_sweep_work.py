"""The cases of a sweep, given a few at a time to an executor: threads of this process, or what the user gives."""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from .errors import IncompleteWarning

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

__all__ = ["Work"]

SHORTEST_TASK = 4
"""If several cases run side by side in a thread, each place is used this many times before the thread fetches more."""

LONGEST_TASK = 4096
"""Largest number of cases in a task."""

MOST_THREADS = 1024
"""Largest number of threads; more are useful on no machine."""

THREAD_SECONDS = 0.05
"""Estimated duration of the cases that a thread takes at once."""

TASK_SECONDS = 0.5
"""The same for a task of an executor: sending it may take milliseconds, and a deck is read for it."""

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
        self._next = 0
        self._done = 0
        self.stopped = False
        self.values = np.full((core.cases, len(core.quantities)), np.nan)
        self.codes = np.full(core.cases, _native.NOT_RUN, dtype=np.int32)
        self.cycles = np.full((core.cases, core.most_cycles, len(core.cycle_quantities)), np.nan)
        self.counts = np.zeros(core.cases, dtype=np.int32)
        self.messages: dict[int, str] = {}

    def run(self, n_threads: int, show: Callable[[float], None]) -> None:
        """Run all cases in threads of this process; Ctrl-C ends it early."""
        n_threads = min(n_threads, self._core.cases, MOST_THREADS)
        threads = ThreadPoolExecutor(n_threads)
        going_on: dict[Future[_Answer], int] = {}
        try:
            self._run(
                going_on,
                lambda count: threads.submit(_run_cases, self._core, self._next, count),
                n_threads,
                THREAD_SECONDS,
                show,
            )
        finally:
            while True:
                # However often Ctrl-C is pressed: the threads end, and what they have finished is kept.
                try:
                    self._core.stop()
                    wait([future for future in going_on if not future.cancel()])
                    self._keep_done(going_on)
                    break
                except KeyboardInterrupt:
                    self.stopped = True
            threads.shutdown(wait=False)

    def run_on(self, executor: Executor, deck: _native.DeckSource, show: Callable[[float], None]) -> None:
        """Run all cases as tasks of an executor; Ctrl-C ends it early.

        A task is the deck with the parameters of some cases: it needs nothing but the package where it runs. Tasks that have not begun
        are cancelled, and those in this process stop; tasks elsewhere end later, and their results are ignored.
        """
        token = os.urandom(16).hex()
        going_on: dict[Future[_Answer], int] = {}
        try:
            self._run(
                going_on,
                lambda count: executor.submit(_run_task, self._task(deck, count, token)),
                _workers_of(executor),
                TASK_SECONDS,
                show,
            )
        finally:
            if going_on:
                _given_up.add(token)
                for future in going_on:
                    future.cancel()
                self._keep_done(going_on)

    def _run(
        self,
        going_on: dict[Future[_Answer], int],
        submit: Callable[[int], Future[_Answer]],
        workers: int,
        seconds: float,
        show: Callable[[float], None],
    ) -> None:
        """Keep the workers busy with tasks of some `seconds`, smaller ones towards the end, until all cases are done, or Ctrl-C."""
        # The places for cases side by side do not stay empty.
        fewest = max(1, SHORTEST_TASK * (self._core.at_once - 1))
        count = 1
        try:
            while self._next < self._core.cases or going_on:
                while self._next < self._core.cases and len(going_on) < TASKS_PER_WORKER * workers:
                    left = self._core.cases - self._next
                    count = min(left, max(fewest, min(count, math.ceil(left / (4 * workers)))))
                    going_on[submit(count)] = self._next
                    self._next += count
                for future in wait(going_on, _native.CHUNK_SECONDS, FIRST_COMPLETED).done:
                    answer = future.result()
                    self._keep(going_on.pop(future), answer.cases)
                    count = int(min(LONGEST_TASK, len(answer.cases.codes) * seconds / answer.seconds))
                show(self._done)
        except KeyboardInterrupt:
            self.stopped = True

    def _keep(self, first: int, cases: _native.Cases) -> None:
        here = slice(first, first + len(cases.codes))
        self.values[here], self.codes[here] = cases.values, cases.codes
        self.cycles[here], self.counts[here] = cases.cycles, cases.counts
        self.messages |= {first + case: text for case, text in cases.messages.items()}
        self._done += len(cases.codes)

    def _keep_done(self, going_on: dict[Future[_Answer], int]) -> None:
        for future, first in going_on.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                self._keep(first, future.result().cases)

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


_given_up: set[str] = set()
"""Tokens of sweeps that have ended early."""


def _run_cases(core: _native.Sweep, first: int, count: int) -> _Answer:
    """Run a few cases in a thread of the process that has the sweep."""
    begun = time.perf_counter()
    return _Answer(core.run(first, count), time.perf_counter() - begun)


def _run_task(task: _Task) -> _Answer:
    """Run a few cases anywhere."""

    def go_on(_: float) -> None:
        if task.token in _given_up:
            raise KeyboardInterrupt

    go_on(0.0)
    begun = time.perf_counter()
    work = Work(_native.Sweep(task.deck, task.points, True))
    # In a separate thread, so that Ctrl-C also ends it in the main thread of a process.
    work.run(1, go_on)
    if work.stopped:
        # A Ctrl-C that all processes of a terminal receive also ends the tasks that this process has not begun.
        _given_up.add(task.token)
        raise KeyboardInterrupt
    cases = _native.Cases(work.values, work.cycles, work.counts, work.codes, work.messages)
    return _Answer(cases, time.perf_counter() - begun)


def _workers_of(executor: Executor) -> int:
    """Number of workers of an executor, if it gives it."""
    for name in ("num_workers", "_max_workers"):
        count = getattr(executor, name, None)
        if isinstance(count, int) and count > 0:
            return count
    return UNKNOWN_WORKERS
