"""The one place that calls the compiled core: bytes to text, status codes to exceptions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._core import dst_python_api as _core
from .errors import UsageError, error_for
from .record import Info

__all__ = [
    "Advance",
    "BuildInfo",
    "Comparison",
    "Run",
    "Sweep",
    "build_info",
    "creep_asymptotic",
    "creep_exact",
    "critical",
    "eigenvalues",
    "jacobian",
    "rhs",
    "slow_damping",
    "text_from",
]

RESOLVED_DECK, MESSAGE, MODEL, METHOD, MODEL_CHOICE = 2, 3, 4, 5, 6


class Advance(NamedTuple):
    """What one call of `Run.advance` brought: samples (rows, columns), event times and kinds."""

    finished: bool
    samples: NDArray[np.float64]
    event_time: NDArray[np.float64]
    event_kind: NDArray[np.int32]


class BuildInfo(NamedTuple):
    """What the extension was built from."""

    version: str
    git_revision: str
    compiler: str


class Run:
    """A run in the core, from deck to outcome; a context manager, so that it is always closed."""

    def __init__(self, text: str, name: str, settings: Sequence[str]) -> None:
        self._handle, status = _core.run_open(_bytes(text), _bytes(name), _bytes("\n".join(settings)))
        if status != 0:
            message = self._text(MESSAGE)
            self.close()
            raise error_for(status, message)
        self.columns = [
            _info(*_core.column_info(self._handle, i + 1)) for i in range(_core.run_columns(self._handle))
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
            samples = _core.run_samples(self._handle, len(self.columns), n_rows).T
        time, kind = np.empty(0), np.empty(0, dtype=np.int32)
        if n_events > 0:
            time, kind = _core.run_events(self._handle, n_events)
        return Advance(bool(finished), samples, time, kind)

    def outcome(self) -> tuple[int, str]:
        """Result code (0 done) and its text."""
        status = _core.run_outcome(self._handle)
        return status, self._text(MESSAGE) if status != 0 else "done"

    def summary(self) -> list[tuple[Info, float]]:
        """Summary values of a finished run."""
        n, _, _ = _core.run_counts(self._handle)
        return [_described(*_core.summary_info(self._handle, i + 1)) for i in range(n)]

    def statistics(self) -> list[tuple[Info, float]]:
        """Counters of the work done."""
        _, n, _ = _core.run_counts(self._handle)
        return [_described(*_core.statistics_info(self._handle, i + 1)) for i in range(n)]

    def parameters(self) -> list[tuple[Info, float | str]]:
        """Every key that the deck uses and its value."""
        _, _, n = _core.run_counts(self._handle)
        return [self._parameter(i + 1) for i in range(n)]

    def _parameter(self, i: int) -> tuple[Info, float | str]:
        *about, value, is_text = _core.parameter_info(self._handle, i)
        return _info(*about), _text(_core.parameter_text(self._handle, i)) if is_text else value

    def resolved_deck(self) -> str:
        """Every key as used."""
        return self._text(RESOLVED_DECK)

    def model(self) -> str:
        """The model integrated."""
        return self._text(MODEL)

    def method(self) -> str:
        """The method, or that there is none."""
        return self._text(METHOD)

    def model_choice(self) -> str:
        """Why the model 'auto' is the one integrated; empty if the deck names another."""
        return self._text(MODEL_CHOICE)

    def _text(self, which: int) -> str:
        length = _core.run_text_length(self._handle, which)
        return text_from(_core.run_text(self._handle, which, length).astype(np.uint8).tobytes())


class Comparison:
    """A comparison of settings in the core, from deck to table; a context manager, so that it is always closed."""

    def __init__(
        self, text: str, name: str, settings: Sequence[str], quantity: str, accuracy: float, budget: float
    ) -> None:
        self._handle, status = _core.trade_open(
            _bytes(text), _bytes(name), _bytes("\n".join(settings)), _bytes(quantity), accuracy, budget
        )
        self._raise(status)

    def __enter__(self) -> Comparison:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the comparison; closing twice does no harm."""
        handle, self._handle = self._handle, 0
        if handle != 0:
            _core.trade_close(handle)

    def _raise(self, status: int) -> None:
        if status != 0:
            message = self.shortfall()
            self.close()
            raise error_for(status, message)

    def advance(self, seconds: float) -> bool:
        """Go on for at most `seconds` of wall time, without the interpreter's lock; whether that was the end."""
        finished, status = _core.trade_advance(self._handle, seconds)
        self._raise(status)
        return bool(finished)

    def table(self) -> list[tuple[Info, NDArray[np.float64] | list[str]]]:
        """Columns of a finished comparison, one row a point."""
        n_columns, n_rows = _core.trade_size(self._handle)
        return [self._column(i + 1, n_rows) for i in range(n_columns)]

    def _column(self, i: int, n: int) -> tuple[Info, NDArray[np.float64] | list[str]]:
        *about, is_text = _core.trade_column(self._handle, i)
        if is_text:
            return _info(*about), [_text(column) for column in _core.trade_texts(self._handle, i, n).T]
        return _info(*about), _core.trade_numbers(self._handle, i, n)

    def report(self) -> str:
        """All points as a text, after `table`."""
        return self._any_text(1)

    def recommendation(self) -> str:
        """The recommended settings as namelist groups, after `table`; empty if there are none."""
        return self._any_text(2)

    def settings(self) -> list[str]:
        """The recommended settings, ``group.key=value`` each, after `table`."""
        return self._any_text(3).splitlines()

    def shortfall(self) -> str:
        """Why there is no recommendation, after `table`."""
        return self._any_text(4)

    def _any_text(self, which: int) -> str:
        length = _core.trade_text_length(self._handle, which)
        return text_from(_core.trade_text(self._handle, which, length).astype(np.uint8).tobytes())


class Sweep:
    """The cases of a sweep in the core; a context manager, so that it is always closed."""

    def __init__(
        self,
        text: str,
        name: str,
        settings: Sequence[str],
        axes: Sequence[tuple[str, NDArray[np.float64]]],
        is_list: bool,
    ) -> None:
        values = [np.asarray(axis, dtype=np.float64) for _, axis in axes]
        self._handle, self.cases, n_axes, status = _core.sweep_open(
            _bytes(text),
            _bytes(name),
            _bytes("\n".join(settings)),
            _bytes("\n".join(key for key, _ in axes)),
            np.array([axis.size for axis in values], dtype=np.int32),
            np.concatenate([np.empty(0), *values]),
            int(is_list),
        )
        if status != 0:
            message = _text(_core.sweep_message(self._handle))
            self.close()
            raise error_for(status, message)
        self.axes = [self._axis(i + 1) for i in range(n_axes)]
        _, self._n_values, list_flag = _core.sweep_sizes(self._handle, 1)
        self.is_list = bool(list_flag)
        self.quantities = [_info(*_core.sweep_value_info(i + 1)) for i in range(self._n_values)]

    def _axis(self, i: int) -> tuple[Info, NDArray[np.float64]]:
        size, _, _ = _core.sweep_sizes(self._handle, i)
        name, units, long_name, values = _core.sweep_axis(self._handle, i, size)
        return _info(name, units, long_name), values

    def __enter__(self) -> Sweep:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def run(
        self, first: int, count: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int32], dict[int, str], int]:
        """Run cases `first` (from 0) and following: values (done, value), codes, messages, number done."""
        values, codes, messages, done = _core.sweep_run(self._handle, first + 1, count, self._n_values)
        failed = {first + int(i): _text(messages[:, i]) for i in np.flatnonzero(codes[:done])}
        return values.T[:done], codes[:done], failed, done

    def stop(self) -> None:
        """Let all threads give up what they do."""
        _core.sweep_stop(self._handle)

    def close(self) -> None:
        """Free the sweep; closing twice does no harm."""
        handle, self._handle = self._handle, 0
        if handle != 0:
            _core.sweep_close(handle)


@cache
def build_info() -> BuildInfo:
    """Version, revision and compiler of the core."""
    return BuildInfo(*(_text(_core.build_text(which)) for which in (1, 2, 3)))


def rhs(slider: NDArray[np.float64], states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-hand sides (n, 4) of the states (n, 4), C-contiguous."""
    return _core.rhs(slider, states.T).T


def jacobian(slider: NDArray[np.float64], states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Jacobians (n, 4, 4) of the states (n, 4), C-contiguous: row = equation, column = unknown."""
    return np.ascontiguousarray(_core.jacobian(slider, states.T).transpose(2, 0, 1))


def creep_exact(
    tau: NDArray[np.float64], phi: NDArray[np.float64], kappa: NDArray[np.float64]
) -> tuple[NDArray[np.float64], int, int]:
    """Creep (8, n), and of the first point out of range its index and its fault (0 if there is none)."""
    creep, point, fault = _core.creep_exact(tau, phi, kappa)
    return creep.T, point - 1, fault


def creep_asymptotic(
    form: int, tau: NDArray[np.float64], phi: NDArray[np.float64]
) -> tuple[NDArray[np.float64], int, int]:
    """X'/V (n), and index and fault as for `creep_exact`."""
    x_rate, point, fault = _core.creep_asymptotic(form, tau, phi)
    return x_rate, point - 1, fault


def eigenvalues(sliders: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Eigenvalues (n, 4) of steady sliding for the parameter rows (n, 10)."""
    if len(sliders) == 0:
        return np.empty((0, 4), dtype=np.complex128)
    real, imaginary, failed, message = _core.eigenvalues(sliders.T)
    _refuse(failed, message, len(sliders))
    return np.ascontiguousarray((real + 1j * imaginary).T)


def critical(
    sliders: NDArray[np.float64],
) -> tuple[
    NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]
]:
    """Existence (n), angles (n, 2), frequencies (n, 2), stable windows (n, 2), limits (n)."""
    if len(sliders) == 0:
        pairs = np.empty((0, 2))
        return np.empty(0, dtype=np.bool_), pairs, pairs, pairs, np.empty(0)
    exists, angle, frequency, window, limit, failed, message = _core.critical(sliders.T)
    _refuse(failed, message, len(sliders))
    return exists == 1, angle.T, frequency.T, window.T, limit


def slow_damping(
    sliders: NDArray[np.float64], theta: NDArray[np.float64], weakening: bool
) -> NDArray[np.float64]:
    """Damping ratios (n) at the angles (n) for the parameter rows (n, 10)."""
    if len(sliders) == 0:
        return np.empty(0)
    zeta, failed, message = _core.slow_damping(sliders.T, theta, int(weakening))
    _refuse(failed, message, len(sliders))
    return zeta


def _refuse(failed: int, message: NDArray[np.int32], cases: int) -> None:
    if failed > 0:
        where = f"element {failed - 1} of {cases}: " if cases > 1 else ""
        raise UsageError(where + _text(message))


def _described(
    name: NDArray[np.int32], units: NDArray[np.int32], long_name: NDArray[np.int32], value: float
) -> tuple[Info, float]:
    return _info(name, units, long_name), value


def _info(name: NDArray[np.int32], units: NDArray[np.int32], long_name: NDArray[np.int32]) -> Info:
    return _decoded_info(name.tobytes(), units.tobytes(), long_name.tobytes())


@lru_cache(maxsize=512)
def _decoded_info(*texts: bytes) -> Info:
    # The same few descriptions come with every run; decoding them would take as long as a short run.
    return Info(*(_text(np.frombuffer(text, dtype=np.int32)) for text in texts))


def _bytes(text: str) -> NDArray[np.int32]:
    return np.frombuffer(text.encode("utf-8", "surrogateescape"), dtype=np.uint8).astype(np.int32)


def _text(array: NDArray[np.int32]) -> str:
    return text_from(array.astype(np.uint8).tobytes()).rstrip(" ")


def text_from(data: bytes) -> str:
    """UTF-8 text that turns back into the same bytes even where it is none."""
    return data.decode("utf-8", "surrogateescape")
