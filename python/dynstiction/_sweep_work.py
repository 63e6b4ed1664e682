"""The cases of a sweep as tasks of an executor: one with threads of this process, or what the user gives.

A task is the deck with the parameters of some cases: it needs nothing but the package where it runs.
"""

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

SHORTEST_TASK = 4
"""If several cases run side by side in a thread, each place is used this many times before the thread fetches more."""

LONGEST_TASK = 4096
"""Largest number of cases in a task."""

MOST_THREADS = 1024
"""Largest number of threads; more are useful on no machine."""

TASK_SECONDS = 0.5
"""Estimated duration of a task: sending it may take milliseconds, and a deck is read for it."""

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

    def __init__(
        self, core: _native.Sweep, deck: _native.DeckSource, threads: int, executor: Executor | None
    ) -> None:
        threads = min(threads, core.cases, MOST_THREADS)
        self._core, self._deck, self._token = core, deck, os.urandom(16).hex()
        self._is_own = executor is None
        self._pool = ThreadPoolExecutor(threads) if executor is None else executor
        self._workers = threads if executor is None else _workers_of(executor)
        self._going_on: dict[Future[_Answer], int] = {}
        self._done = 0
        self.stopped = False
        self.values = np.full((core.cases, len(core.quantities)), np.nan)
        self.codes = np.full(core.cases, _native.NOT_RUN, dtype=np.int32)
        self.cycles = np.full((core.cases, core.most_cycles, len(core.cycle_quantities)), np.nan)
        self.counts = np.zeros(core.cases, dtype=np.int32)
        self.messages: dict[int, str] = {}

    def run(self, show: Callable[[float], None]) -> None:
        """Run all cases in the executor, else in so many threads of this process; Ctrl-C ends it early.

        Tasks that have not begun are cancelled at the end, and those in this process stop; tasks elsewhere end later, and their results
        are ignored.
        """
        _cores[self._token] = self._core
        try:
            self._run(show)
        except KeyboardInterrupt:
            self.stopped = True
        finally:
            while self._going_on:
                # However often Ctrl-C is pressed: the threads end, and what they have finished is kept.
                try:
                    self._core.stop()
                    left = [future for future in self._going_on if not future.cancel()]
                    wait(left, None if self._is_own else 0.0)
                    for future in left:
                        if future.done() and future.exception() is None:
                            self._keep(self._going_on[future], future.result().cases)
                    break
                except KeyboardInterrupt:
                    self.stopped = True
            if self._is_own:
                self._pool.shutdown(wait=False)
            del _cores[self._token]

    def _run(self, show: Callable[[float], None]) -> None:
        """Keep the workers busy with tasks, smaller ones towards the end, until all cases are done."""
        # The places for cases side by side do not stay empty.
        fewest = max(1, SHORTEST_TASK * (self._core.at_once - 1))
        first, count = 0, 1
        while first < self._core.cases or self._going_on:
            while first < self._core.cases and len(self._going_on) < TASKS_PER_WORKER * self._workers:
                left = self._core.cases - first
                count = min(left, max(fewest, min(count, math.ceil(left / (4 * self._workers)))))
                self._going_on[self._pool.submit(_run_task, self._task(first, count))] = first
                first += count
            for future in wait(self._going_on, _native.CHUNK_SECONDS, FIRST_COMPLETED).done:
                answer = future.result()
                self._keep(self._going_on.pop(future), answer.cases)
                count = int(min(LONGEST_TASK, len(answer.cases.codes) * TASK_SECONDS / answer.seconds))
            show(self._done)

    def _keep(self, first: int, cases: _native.Cases) -> None:
        here = slice(first, first + len(cases.codes))
        self.values[here], self.codes[here] = cases.values, cases.codes
        self.cycles[here], self.counts[here] = cases.cycles, cases.counts
        self.messages |= {first + case: text for case, text in cases.messages.items()}
        self._done += len(cases.codes)

    def _task(self, first: int, count: int) -> _Task:
        cases = np.arange(first, first + count)
        if self._core.is_list:
            places = [cases] * len(self._core.axes)
        else:
            # The last parameter varies fastest.
            places = list(np.unravel_index(cases, [axis.size for _, axis in self._core.axes]))
        points = [(info.name, axis[at]) for (info, axis), at in zip(self._core.axes, places, strict=True)]
        return _Task(self._deck, points, first, self._token)

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
    first: int
    """Number of the first case in the sweep."""
    token: str
    """Token of the sweep, the same for all its tasks."""


class _Answer(NamedTuple):
    cases: _native.Cases
    seconds: float


_cores: dict[str, _native.Sweep] = {}
"""By token the sweeps of this process, or of the one of which it is a fork: their decks and files have been read."""

_given_up: set[str] = set()
"""Tokens of sweeps of other processes that a Ctrl-C has ended here."""


def _run_task(task: _Task) -> _Answer:
    """Run a few cases anywhere."""
    if task.token in _given_up:
        raise KeyboardInterrupt
    begun = time.perf_counter()
    core, first = _cores.get(task.token), task.first
    if core is None:
        core, first = _native.Sweep(task.deck, task.points, True), 0
    # In a separate thread, so that Ctrl-C also ends it in the main thread of a process.
    with ThreadPoolExecutor(1) as thread:
        running = thread.submit(core.run, first, len(task.points[0][1]))
        try:
            while not wait([running], _native.CHUNK_SECONDS).done:
                pass
        except KeyboardInterrupt:
            # A Ctrl-C that all processes of a terminal receive also ends the tasks that this process has not begun.
            _given_up.add(task.token)
            core.stop()
            raise
    return _Answer(running.result(), time.perf_counter() - begun)


def _workers_of(executor: Executor) -> int:
    """Number of workers of an executor, if it gives it."""
    for name in ("num_workers", "_max_workers"):
        count = getattr(executor, name, None)
        if isinstance(count, int) and count > 0:
            return count
    return UNKNOWN_WORKERS
