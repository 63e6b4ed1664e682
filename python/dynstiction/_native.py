"""The one place that calls the compiled core: bytes to text, status codes to exceptions."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._core import dst_python_api as _core
from .errors import error_for

__all__ = ["Advance", "Info", "Run", "jacobian", "rhs", "text_from"]

RESOLVED_DECK = 2


class Info(NamedTuple):
    """What a column or a scalar is."""

    name: str
    units: str
    long_name: str


class Advance(NamedTuple):
    """What one call of `Run.advance` brought: samples (rows, columns), event times and kinds."""

    finished: bool
    samples: NDArray[np.float64]
    event_time: NDArray[np.float64]
    event_kind: NDArray[np.int32]


class Run:
    """A run in the core, from deck to outcome; a context manager, so that it is always closed."""

    def __init__(self, text: str, name: str, settings: Sequence[str]) -> None:
        self._handle, status, message = _core.run_open(
            _bytes(text), _bytes(name), _bytes("\n".join(settings))
        )
        if status != 0:
            self.close()
            raise error_for(status, _text(message))
        self.columns = [
            Info(*map(_text, _core.column_info(self._handle, i + 1)))
            for i in range(_core.run_columns(self._handle))
        ]

    def __enter__(self) -> Run:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the run; closing twice does no harm."""
        handle, self._handle = self._handle, 0
        if handle != 0:
            _core.run_close(handle)

    def advance(self, seconds: float) -> Advance:
        """Integrate for at most `seconds` of wall time, without the interpreter's lock."""
        # The status is kept by the core and comes back from `outcome`, with its text.
        finished, n_rows, n_events, _ = _core.run_advance(self._handle, seconds)
        samples = np.empty((0, len(self.columns)))
        if n_rows > 0:
            samples = _core.run_samples(self._handle, n_rows, len(self.columns))
        time, kind = np.empty(0), np.empty(0, dtype=np.int32)
        if n_events > 0:
            time, kind = _core.run_events(self._handle, n_events)
        return Advance(bool(finished), samples, time, kind)

    def outcome(self) -> tuple[int, str]:
        """Result code (0 done) and its text."""
        status, message = _core.run_outcome(self._handle)
        return int(status), _text(message)

    def summary(self) -> list[tuple[Info, float]]:
        """Summary values of a finished run."""
        n, _ = _core.run_counts(self._handle)
        return [_described(_core.summary_info(self._handle, i + 1)) for i in range(n)]

    def statistics(self) -> list[tuple[Info, float]]:
        """Counters of the work done."""
        _, n = _core.run_counts(self._handle)
        return [_described(_core.statistics_info(self._handle, i + 1)) for i in range(n)]

    def resolved_deck(self) -> str:
        """Every key as used."""
        text, status = _core.run_deck_text(self._handle, RESOLVED_DECK)
        if status != 0:
            raise error_for(status, _text(text))
        return _text(text)


def rhs(slider: NDArray[np.float64], states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-hand sides (n, 4) of the states (n, 4), C-contiguous."""
    return _core.rhs(slider, states.T).T


def jacobian(slider: NDArray[np.float64], states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Jacobians (n, 4, 4) of the states (n, 4), C-contiguous: row = equation, column = unknown."""
    return np.ascontiguousarray(_core.jacobian(slider, states.T).transpose(2, 0, 1))


def _described(
    entry: tuple[NDArray[np.int8], NDArray[np.int8], NDArray[np.int8], float],
) -> tuple[Info, float]:
    *texts, value = entry
    return Info(*map(_text, texts)), float(value)


def _bytes(text: str) -> NDArray[np.int8]:
    return np.frombuffer(text.encode("utf-8", "surrogateescape"), dtype=np.int8)


def _text(array: NDArray[np.int8]) -> str:
    return text_from(array.tobytes()).rstrip()


def text_from(data: bytes) -> str:
    """UTF-8 text that turns back into the same bytes even where it is none."""
    return data.decode("utf-8", "surrogateescape")
