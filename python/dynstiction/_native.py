"""The one place that calls the compiled core: bytes to text, status codes to exceptions."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._closing import Closing, OneAtATime
from ._core import dst_python_api as _core
from ._stack import check_stack
from .errors import Error, UsageError, error_for
from .record import Info

__all__ = [
    "CHUNK_SECONDS",
    "Advance",
    "BuildInfo",
    "DeckSource",
    "DeckValues",
    "KeyInfo",
    "Run",
    "Session",
    "Sweep",
    "Value",
    "build_info",
    "creep_asymptotic",
    "creep_exact",
    "critical",
    "eigenvalues",
    "jacobian",
    "machine_info",
    "rhs",
    "schema",
    "slow_damping",
    "text_from",
]

CHUNK_SECONDS = 0.05
"""Wall time between two looks at Ctrl-C."""

RESOLVED_DECK, MESSAGE, MODEL, METHOD, MODEL_CHOICE = 2, 3, 4, 5, 6

Value = float | int | str | tuple[float, ...] | tuple[str, ...]
"""Value of a key: of a list with one element that element."""


class DeckSource(NamedTuple):
    """A deck as the core reads it."""

    text: str
    name: str
    settings: tuple[str, ...] = ()
    fields: Mapping[int, str] = {}
    """Group or key of each line of a text that was made from them: messages name it, not the line."""

    def encoded(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
        """Text, name and settings for the core, which is about to read them."""
        check_stack()
        return _bytes(self.text), _bytes(self.name), _bytes("\n".join(self.settings))

    def error(self, status: int, message: str) -> Error:
        """Exception for a status of the core; its text names keys where the user gave keys."""
        return error_for(status, "\n".join(map(self._with_key, message.splitlines())))

    def _with_key(self, line: str) -> str:
        place, _, rest = line.removeprefix(f"{self.name}:").partition(": ")
        if line.startswith(f"{self.name}:") and place.isdecimal() and int(place) in self.fields:
            return f"{self.fields[int(place)]}: {rest}"
        if match := re.match(r"--set (\d+) \(", line):
            setting = self.settings[int(match[1]) - 1]
            whole = f"{match[0]}{setting}): "
            rest = line[len(whole) :] if line.startswith(whole) else line.partition("...): ")[2]
            return f"{setting.partition('=')[0]}: {rest}"
        return line


class KeyInfo(NamedTuple):
    """What the schema says of a key of the deck."""

    group: str
    name: str
    kind: str
    """real, integer, text, choice, reals or texts"""
    required: bool
    """Whether it must be given where it is used."""
    units: str
    range: str
    choices: tuple[str, ...]
    default: str
    """As in a deck, text without quotes; empty if there is none."""
    condition: str
    """With what it is used; empty if always."""
    meaning: str


class Advance(NamedTuple):
    """What one call of `Run.advance` brought: samples (rows, columns; each column contiguous), event times and kinds."""

    finished: bool
    reached: bool
    samples: NDArray[np.float64]
    event_time: NDArray[np.float64]
    event_kind: NDArray[np.int32]


class BuildInfo(NamedTuple):
    """What the extension was built from."""

    version: str
    git_revision: str
    compiler: str
    build_flags: str


class MachineInfo(NamedTuple):
    """Where a process runs: the host, and the scheduler's name of the job, empty without one."""

    host: str
    job: str


class _Memory:
    """What the core holds under a handle. A call that is going on keeps it alive, so it may be given up at any time."""

    __slots__ = ("_free", "handle")

    def __init__(self, handle: int, free: Callable[[int], None]) -> None:
        self.handle = handle
        self._free = free

    def __del__(self) -> None:
        self._free(self.handle)


class Session(Closing):
    """What lives in the core under a handle; a context manager, so that it is always closed.

    In a process that is forked the copy of the memory is that process's own.
    """

    name: ClassVar[str]
    """What the user takes it for."""

    def __init__(self, handle: int) -> None:
        self._memory: _Memory | None = _Memory(handle, self._free)
        self._alone = OneAtATime(self.name)

    @property
    def closed(self) -> bool:
        """Whether the memory has been given up."""
        return self._memory is None

    def close(self) -> None:
        """Give the memory up: it is freed at once, or when the call that is going on returns."""
        self._memory = None

    def _opened(self) -> _Memory:
        """The memory, for a call that several threads may make at once."""
        memory = self._memory
        if memory is None:
            raise UsageError(f"the {self.name} is closed: make a new one")
        check_stack()
        return memory

    @contextmanager
    def _use(self) -> Iterator[int]:
        """The handle, for one thread at a time."""
        with self._alone:
            memory = self._opened()
            yield memory.handle

    @staticmethod
    @abstractmethod
    def _free(handle: int) -> None:
        """Free what the handle stands for."""


class DeckValues(Session):
    """The values that a deck gives.

    Parameters
    ----------
    deck : DeckSource
        The deck.
    alone : bool
        Whether each value is held against its own key only, so that a part of a deck will do.
    """

    name = "deck"

    def __init__(self, deck: DeckSource, *, alone: bool) -> None:
        handle, status, message = _core.deck_open(*deck.encoded(), int(alone))
        super().__init__(handle)
        if status != 0:
            raise deck.error(status, _text(message))

    @staticmethod
    def _free(handle: int) -> None:
        _core.deck_close(handle)

    def given(self) -> dict[str, dict[str, Value]]:
        """Values by group and key, of the keys that are given, in the schema's order."""
        groups: dict[str, dict[str, Value]] = {}
        with self._use() as handle:
            for i, key in enumerate(schema()):
                given, *sizes = _core.deck_given(handle, i + 1)
                if given:
                    groups.setdefault(key.group, {})[key.name] = self._value(handle, i + 1, key.kind, *sizes)
        return groups

    @staticmethod
    def _value(handle: int, i: int, kind: str, n_numbers: int, n_texts: int, integer: int) -> Value:
        if kind == "integer":
            return integer
        if kind in ("real", "reals"):
            numbers = tuple(_core.deck_numbers(handle, i, n_numbers).tolist())
            return numbers[0] if n_numbers == 1 else numbers
        texts = tuple(_text(text) for text in _core.deck_texts(handle, i, n_texts).T)
        return texts[0] if n_texts == 1 else texts


class Run(Session):
    """A run in the core, from deck to outcome."""

    name = "simulation"

    def __init__(self, deck: DeckSource) -> None:
        handle, status = _core.run_open(*deck.encoded())
        super().__init__(handle)
        if status != 0:
            raise deck.error(status, self._text(handle, MESSAGE))
        self.columns = [_info(*_core.column_info(handle, i + 1)) for i in range(_core.run_columns(handle))]
        self.resolved_deck = self._text(handle, RESOLVED_DECK)
        self.model = self._text(handle, MODEL)
        self.method = self._text(handle, METHOD)
        self.model_choice = self._text(handle, MODEL_CHOICE)
        """Why the model 'auto' is the one integrated; empty if the deck names another."""

    @staticmethod
    def _free(handle: int) -> None:
        _core.run_close(handle)

    def advance(self, seconds: float, until: float = np.inf) -> Advance:
        """Integrate for at most `seconds` of wall time or to the time `until`, without the interpreter's lock."""
        samples = np.empty((0, len(self.columns)))
        time, kind = np.empty(0), np.empty(0, dtype=np.int32)
        with self._use() as handle:
            finished, reached, n_rows, n_events = _core.run_advance(handle, seconds, until)
            if n_rows > 0:
                samples = _core.run_samples(handle, len(self.columns), n_rows)
            if n_events > 0:
                time, kind = _core.run_events(handle, n_events)
        return Advance(bool(finished), bool(reached), samples, time, kind)

    def state(self, time: float) -> list[tuple[Info, float]]:
        """What a sample at `time` would hold; it lies in the last advance."""
        with self._use() as handle:
            values = _core.run_state(handle, time, len(self.columns))
        return list(zip(self.columns, values.tolist(), strict=True))

    def sample_at(self, instants: NDArray[np.float64]) -> None:
        """Sample at these instants [s], from 0 to the end, of a run that is at its first sample."""
        with self._use() as handle:
            _core.run_instants(handle, instants)

    def time(self) -> float:
        """Simulated time reached [s]."""
        with self._use() as handle:
            return _core.run_time(handle)

    def outcome(self) -> tuple[int, str]:
        """Result code (0 done) and its text; summary and statistics are those of now."""
        with self._use() as handle:
            status = _core.run_outcome(handle)
            return status, self._text(handle, MESSAGE) if status != 0 else "done"

    def summary(self) -> list[tuple[Info, float]]:
        """Summary values when `outcome` was called."""
        with self._use() as handle:
            n, _, _ = _core.run_counts(handle)
            return [_described(*_core.summary_info(handle, i + 1)) for i in range(n)]

    def statistics(self) -> list[tuple[Info, float]]:
        """Counters of the work done when `outcome` was called."""
        with self._use() as handle:
            _, n, _ = _core.run_counts(handle)
            return [_described(*_core.statistics_info(handle, i + 1)) for i in range(n)]

    def parameters(self) -> list[tuple[Info, float | str]]:
        """Every key that the deck uses and its value."""
        with self._use() as handle:
            _, _, n = _core.run_counts(handle)
            return [self._parameter(handle, i + 1) for i in range(n)]

    @staticmethod
    def _parameter(handle: int, i: int) -> tuple[Info, float | str]:
        *about, value, is_text = _core.parameter_info(handle, i)
        return _info(*about), _text(_core.parameter_text(handle, i)) if is_text else value

    @staticmethod
    def _text(handle: int, which: int) -> str:
        length = _core.run_text_length(handle, which)
        return text_from(_core.run_text(handle, which, length).astype(np.uint8).tobytes())


class Sweep(Session):
    """The cases of a sweep in the core."""

    name = "sweep"

    def __init__(
        self, deck: DeckSource, axes: Sequence[tuple[str, NDArray[np.float64]]], is_list: bool
    ) -> None:
        values = [np.asarray(axis, dtype=np.float64) for _, axis in axes]
        handle, self.cases, n_axes, status = _core.sweep_open(
            *deck.encoded(),
            _bytes("\n".join(key for key, _ in axes)),
            np.array([axis.size for axis in values], dtype=np.int32),
            np.concatenate([np.empty(0), *values]),
            int(is_list),
        )
        super().__init__(handle)
        if status != 0:
            raise deck.error(status, _text(_core.sweep_message(handle)))
        self.axes = [self._axis(handle, i + 1) for i in range(n_axes)]
        _, self._n_values, self.at_once, found_list = _core.sweep_sizes(handle, 1)
        self.is_list = found_list == 1
        self.quantities = [_info(*_core.sweep_value_info(i + 1)) for i in range(self._n_values)]
        length = _core.sweep_deck_length(handle)
        self.resolved_deck = text_from(_core.sweep_deck(handle, length).astype(np.uint8).tobytes())

    @staticmethod
    def _axis(handle: int, i: int) -> tuple[Info, NDArray[np.float64]]:
        size, _, _, _ = _core.sweep_sizes(handle, i)
        name, units, long_name, values = _core.sweep_axis(handle, i, size)
        return _info(name, units, long_name), values

    @staticmethod
    def _free(handle: int) -> None:
        _core.sweep_close(handle)

    def run(self, first: int, count: int) -> tuple[NDArray[np.float64], NDArray[np.int32], dict[int, str]]:
        """Run cases `first` (from 0) and following: values (case, value), codes (-1 if stopped), messages.

        Several threads may do so at once.
        """
        memory = self._opened()
        values, codes, messages = _core.sweep_run(memory.handle, first + 1, count, self._n_values)
        values[:, codes < 0] = np.nan
        failed = {first + int(i): _text(messages[:, i]) for i in np.flatnonzero(codes > 0)}
        return values.T, codes, failed

    def stop(self) -> None:
        """Let all threads give up what they do."""
        memory = self._opened()
        _core.sweep_stop(memory.handle)


@cache
def build_info() -> BuildInfo:
    """Version, revision and compiler of the core."""
    return BuildInfo(*(_text(_core.build_text(which)) for which in (1, 2, 3, 4)))


def machine_info() -> MachineInfo:
    """Where this process runs."""
    return MachineInfo(*(_text(_core.build_text(which)) for which in (5, 6)))


KINDS = ("real", "integer", "text", "choice", "reals", "texts")
"""Kinds of keys, in the order of the core's numbers for them."""


@cache
def schema() -> tuple[KeyInfo, ...]:
    """Every key that a deck may have: the one table of src/deck/schema.f90."""
    return tuple(_key(i + 1) for i in range(_core.key_total()))


def _key(i: int) -> KeyInfo:
    kind, required, *about = _core.key_info(i)
    group, name, units, limits, choices, condition, meaning = map(_text, about)
    return KeyInfo(
        group,
        name,
        KINDS[kind - 1],
        bool(required),
        units,
        limits,
        tuple(choices.split()),
        _text(_core.key_default(i)),
        condition,
        meaning,
    )


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
    try:
        data = text.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError as error:
        raise UsageError(f"{text[:40]!r}: holds a half of a character: {error.reason}") from None
    return np.frombuffer(data, dtype=np.uint8).astype(np.int32)


def _text(array: NDArray[np.int32]) -> str:
    return text_from(array.astype(np.uint8).tobytes()).rstrip(" ")


def text_from(data: bytes) -> str:
    """UTF-8 text that turns back into the same bytes even where it is none."""
    return data.decode("utf-8", "surrogateescape")
