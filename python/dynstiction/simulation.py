"""A run step by step."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arguments import number, reals
from ._interrupt import interrupted
from ._progress import progress_bar
from .errors import IncompleteWarning, SolverError, UsageError, error_for
from .groups import Changes
from .record import EVENTS, LOG_DTYPE, Described, events_between, log_until
from .result import Result
from .scene import DeckLike, Scene

BAR = "{percentage:3.0f}%|{bar}| t = {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]"


class Simulation(_native.Closing):
    """A run that you advance step by step; at the end its result is the one of `dynstiction.run`, bit for bit.

    It is a context manager: at the end of the block the memory of the core is freed, and the computed results stay. One thread at
    a time can use it: a second thread gets a `UsageError`, and `close` from another thread ends a running call in the same way. A
    simulation cannot be copied or pickled, but its `scene` and its `result` can. In a forked process its copy continues
    independently.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    times : array_like, optional
        Times of the samples [s], as for `dynstiction.run`.
    **changes : value of a key, or Setup, System, Friction, Drive, Initial, Integrator, Output, or mapping
        Overrides of the deck, as for `dynstiction.run`.

    Raises
    ------
    DeckError
        If the scene is refused.
    FileError
        If the deck cannot be read.
    UsageError
        If a name is not a key or group, or `times` do not ascend within the run.

    Examples
    --------
    >>> with ds.Simulation("inputs/fig3.nml") as simulation:                # doctest: +SKIP
    ...     simulation.step_to(0.5)
    ...     print(simulation.state["spring_force_x"], len(simulation.events))
    ...     result = simulation.finish()
    """

    def __init__(self, deck: DeckLike, *, times: ArrayLike | None = None, **changes: Unpack[Changes]) -> None:
        self._scene = Scene(deck, **changes)
        self._times = None if times is None else _ascending(times)
        self._lock = threading.Lock()
        self._core = _native.Run(self._scene.source, () if self._times is None else self._times)
        self._parameters = Described(self._core.parameters(), "parameters")
        self._t_end = float(self._parameters["t_end"])
        self._outcome: tuple[int, str] | None = None
        self._last: Result | None = None
        """The result of a run that has ended, or was closed; until then the core has it."""
        self._closing = False
        self._time = self._reached = 0.0
        self._advance(0.0)
        if self._times is not None and not self._times[-1] <= self._t_end:
            raise UsageError(
                f"times end at {self._times[-1]:g} s, and the run at {self._t_end:g} s: give t_end={self._times[-1]:g}"
            )

    def close(self) -> None:
        """Free the memory of the core; a run that is not finished then cannot be continued."""
        self._closing = True
        # Another thread that is using the simulation frees the memory when it ends.
        with suppress(UsageError), self._alone():
            pass

    @property
    def scene(self) -> Scene:
        """The scene, overrides included."""
        return self._scene

    @property
    def time(self) -> float:
        """Simulated time reached [s]."""
        return self._time

    @property
    def t_end(self) -> float:
        """End of the simulated time [s]."""
        return self._t_end

    @property
    def finished(self) -> bool:
        """Whether the run has ended, at `t_end` or before."""
        return self._outcome is not None and (self._outcome[0] != 0 or self._time >= self._t_end)

    @property
    def state(self) -> Described[float]:
        """The values of a sample at `time`: the columns of the time series, interpolated as samples are.

        Raises
        ------
        UsageError
            If the simulation is closed, or another thread is using it.
        """
        with self._alone():
            return Described(self._core.state(self._time), "columns")

    @property
    def events(self) -> NDArray[np.void]:
        """Events so far: ``time`` [s] and ``kind`` (1 = stick begins, 2 = slip begins).

        Raises
        ------
        UsageError
            If another thread is using the simulation.
        """
        with self._alone():
            log = self._last.log if self._last is not None else self._log_so_far()
        return events_between(log, 0.0, self._t_end)

    def _log_so_far(self) -> NDArray[np.void]:
        columns = self._core.numbers("events")
        log = np.empty(columns.shape[1], dtype=LOG_DTYPE)
        for name, values in zip(EVENTS, columns, strict=True):
            log[name] = values
        return log if self.finished else log_until(log, self._time)

    @property
    def result(self) -> Result:
        """The result up to `time`; it has a summary and statistics when the run has ended.

        Raises
        ------
        UsageError
            If another thread is using the simulation.
        """
        with self._alone():
            return self._result_so_far()

    def _result_so_far(self) -> Result:
        if self._last is not None:
            return self._last
        columns = self._core.samples()
        if self._times is not None:
            asked_for = np.isin(columns[0], self._times)
            columns = np.compress(asked_for, columns, axis=1)
        if not self.finished:
            columns = columns[:, : np.searchsorted(columns[0], self._time, side="right")]
        summary, statistics = self._core.ending() if self.finished else ([], [])
        result = Result(
            columns=Described(zip(self._core.columns, columns, strict=True), "columns"),
            log=self._log_so_far(),
            summary=Described(summary, "summary"),
            statistics=Described(statistics, "statistics"),
            parameters=self._parameters,
            attributes=self._attributes(),
            deck=self._scene.text,
            resolved_deck=self._core.resolved_deck,
        )
        self._last = result
        return result

    def step_to(self, time: float) -> None:
        """Integrate up to a time.

        The steps are those of an undisturbed run: the last one may end later, and samples and events after `time` are held
        back until the run reaches them.

        Parameters
        ----------
        time : float
            Simulated time [s], between the time reached and `t_end`; `t_end` ends the run.

        Raises
        ------
        UsageError
            If the time is before the time reached or beyond the end, the simulation is closed, or another thread is using it.
        SolverError
            If the solver gave up; its ``result`` holds what was computed until then.

        Warns
        -----
        IncompleteWarning
            If the run was stopped at ``output.wall_limit``.
        """
        with self._alone():
            aim = number("time", time, checked=False)
            if not self._time <= aim <= self._t_end:
                raise UsageError(
                    f"time = {aim:g} s: the run has reached {self._time:g} s and ends at {self._t_end:g} s"
                )
            while not (self.finished or self._advance(aim)):
                pass
            self._tell(stacklevel=3)

    def finish(self, progress: bool | None = None) -> Result:
        """Integrate to the end.

        Parameters
        ----------
        progress : bool, optional
            Whether to show the simulated time as a bar; by default as for `dynstiction.run`.

        Returns
        -------
        Result
            The result of `dynstiction.run`.

        Raises
        ------
        SolverError
            If the solver gave up; its ``result`` holds what was computed until then.
        UsageError
            If the simulation is closed, or another thread is using it.
        KeyboardInterrupt
            On Ctrl-C; its attribute ``partial`` is the result until then. The simulation can still be finished.

        Warns
        -----
        IncompleteWarning
            If the run was stopped at ``output.wall_limit``.
        """
        return self._finish(progress, stacklevel=4)

    def _finish(self, progress: bool | None, stacklevel: int) -> Result:
        with self._alone():
            if not self.finished:
                try:
                    with progress_bar(progress, self._t_end, BAR) as show:
                        while not self._advance(self._t_end):
                            show(self._reached)
                        show(self._time)
                except KeyboardInterrupt:
                    if not self.finished:
                        self._last = None
                        self._time = self._reached
                    raise interrupted(
                        f"stopped at t = {self._time:g} of {self._t_end:g} s; `partial` has the result until then",
                        self._result_so_far,
                    ) from None
            self._tell(stacklevel)
            return self._result_so_far()

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """A block for one thread at a time: a second thread is refused and does not wait."""
        if not self._lock.acquire(blocking=False):
            raise UsageError(
                "the simulation is busy: another thread is using it: wait for that, or make one for each thread"
            )
        try:
            yield
        finally:
            try:
                if self._closing and not self._core.closed:
                    self._last = self._result_so_far()
                    self._core.close()
            finally:
                self._lock.release()

    def _advance(self, until: float) -> bool:
        """Advance for a while, at most to `until`; return whether `until` has been reached, or the run has ended before."""
        reached = False
        self._last = None
        if self._closing:
            raise UsageError("the simulation is closed: make a new one")
        if self._outcome is None:
            # The end is more than a time that is reached: there the summary is computed.
            aim = until if until < self._t_end else np.inf
            self._outcome, reached, self._reached = self._core.advance(_native.CHUNK_SECONDS, aim)
        if self._outcome is not None and self._outcome[0] != 0:
            times = self._core.samples()[0]
            self._time = float(times[-1]) if times.size > 0 else 0.0
        elif self._outcome is not None or reached:
            # The last step may have ended the run beyond a time that lies before its end.
            self._time = float(until)
        else:
            return False
        return True

    def _tell(self, stacklevel: int) -> None:
        """Raise or warn if the run did not reach its end."""
        code, text = self._outcome or (0, "")
        if code == _native.STOPPED_EARLY:
            warnings.warn(text, IncompleteWarning, stacklevel=stacklevel)
        elif code != 0:
            error = error_for(code, text)
            if isinstance(error, SolverError):
                error.result = self._result_so_far()
            raise error

    def _attributes(self) -> dict[str, str | int]:
        from hashlib import sha256  # noqa: PLC0415  (slow to import)

        going_on = _native.GOING_ON, f"reached t = {self._time:g} s"
        code, text = self._outcome if self.finished and self._outcome else going_on
        choice = self._core.model_choice
        return {
            "program": "dynstiction",
            **_native.origin(),
            "threads": 1,
            "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "deck_sha256": sha256(self._scene.text.encode("utf-8", "surrogateescape")).hexdigest(),
            "model": self._core.model,
            "method": self._core.method,
            **({"model_choice": choice} if choice else {}),
            "result_code": code,
            "result_text": text,
            "complete": int(code == 0),
        }

    def __repr__(self) -> str:
        state = "finished" if self.finished else "closed" if self._core.closed else "running"
        return f"<Simulation {self._scene.name!r}: t = {self._time:g} of {self._t_end:g} s, {state}>"


def _ascending(times: ArrayLike) -> NDArray[np.float64]:
    """Times of samples [s], if they are a list that starts at 0 or later and increases."""
    given = reals("times", times, least=0.0, units="s")
    if given.ndim != 1 or given.size == 0:
        raise UsageError(f"times of shape {given.shape}: give a list of times [s]")
    if not np.all(np.diff(given) > 0.0):
        raise UsageError("times do not ascend: numpy.unique(times) sorts them and leaves out repetitions")
    return given
