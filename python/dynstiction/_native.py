"""The only module that calls the compiled core; it turns bytes into text and status codes into exceptions."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple, NoReturn, Self, SupportsIndex, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arguments import nearest, reals, shown
from ._core import dst_python_api  # type: ignore[import-not-found,import-untyped,unused-ignore]
from .errors import UsageError, error_for

# Compiled: f2py writes the arguments of each routine into its docstring, and checks them.
_core: Any = dst_python_api

CHUNK_SECONDS = 0.05
"""Wall time between two checks for Ctrl-C."""

NOT_RUN, GOING_ON, STOPPED_EARLY = -1, -1, 75
"""Result codes of a case that was not run, of a run that has not ended, and of one that stopped early; others are errors."""

COUNTS = ("cycles", "sticks", "repeats", "regularity")
"""Summary values that are whole numbers."""

Value = float | int | str | tuple[float, ...] | tuple[str, ...]
"""Value of a key; for a list with one element, that element."""

_Characters: TypeAlias = NDArray[np.bytes_]
T = TypeVar("T")


class DeckSource(NamedTuple):
    """A deck as the core reads it."""

    text: str
    name: str
    settings: tuple[str, ...] = ()
    fields: Mapping[int, str] = {}
    """Group or key of each line, if the text was made from groups: messages name the key, not the line."""

    def place(self, line: int, setting: int) -> str:
        """Where a fault is, by its line or, if it is in a setting, the number of that: the key, if the user gave keys."""
        if setting > 0:
            return self.settings[setting - 1].partition("=")[0]
        return self.fields.get(line) or (f"{self.name}:{line}" if line > 0 else self.name)


class Info(NamedTuple):
    """Name, unit and meaning of a column or a scalar."""

    name: str
    units: str
    long_name: str


class KeyInfo(NamedTuple):
    """Entry of the schema for a key of the deck."""

    group: str
    name: str
    kind: str
    """real, integer, text, choice, reals or texts"""
    required: bool
    """Whether the key must be given if it is used."""
    units: str
    range: str
    choices: tuple[str, ...]
    default: str
    """Default as in a deck, text without quotes; empty if there is none."""
    used_by: tuple[tuple[str, tuple[str, ...]], ...]
    """Keys on which the use of this key depends, and the choices with which it is used."""
    meaning: str


class Closing:
    """A context manager that closes itself, and that is neither copied nor pickled."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError(
            f"a {type(self).__name__} cannot be copied or pickled: it holds memory of this process; "
            "copy or send the scene that it was made of, or its result"
        )

    def close(self) -> None:
        """Free the memory of the core."""
        raise NotImplementedError


class _Handle(int):
    """The number of an object of the core, whose memory is freed with it: a running call, which has it, keeps both."""

    def __del__(self, release: Callable[[int], None] = _core.release) -> None:
        release(self)


class Session(Closing):
    """An object in the core. In a forked process the copy of the memory belongs to that process.

    Parameters
    ----------
    deck : DeckSource
        The deck.
    what : str
        Kind of the object: a name of the routine ``make`` of the core.
    words, numbers : str and array_like
        What it needs beside the deck.
    """

    def __init__(self, deck: DeckSource, what: str, words: str = "", numbers: ArrayLike = ()) -> None:
        texts = (deck.text, deck.name, "\n".join(deck.settings), words)
        handle, status = _core.make(what, *map(_characters, texts), np.asarray(numbers, dtype=np.float64))
        self._deck = deck
        self._handle: _Handle | None = _Handle(handle)
        self._check(status)

    @property
    def handle(self) -> _Handle:
        """The handle; to be taken once for a call, since another thread may close the object."""
        handle = self._handle
        if handle is None:
            raise UsageError("the simulation is closed: make a new one")
        return handle

    @property
    def closed(self) -> bool:
        """Whether the memory has been released."""
        return self._handle is None

    def close(self) -> None:
        """Free the memory of the core, at once or when a running call returns."""
        self._handle = None

    def _answer(self, which: str) -> tuple[bytes, NDArray[np.float64]]:
        """Text and numbers (column, row) of an answer of the core."""
        handle = self.handle
        text, numbers = _core.answer(handle, *_core.ask(handle, which))
        return text, numbers

    def text(self, which: str) -> str:
        """An answer that is a text."""
        return text_from(self._answer(which)[0])

    def table(self, which: str) -> tuple[list[Any], NDArray[np.float64]]:
        """An answer that is a table: texts by row, of which quantities begin with an `Info`, and numbers (column, row)."""
        text, numbers = self._answer(which)
        return _rows(text), numbers

    def numbers(self, which: str) -> NDArray[np.float64]:
        """An answer that is numbers alone: (column, row)."""
        return self._answer(which)[1]

    def infos(self, which: str) -> list[Info]:
        """An answer that is quantities."""
        return [info for info, *_ in self.table(which)[0]]

    def proceed(self) -> bool:
        """Continue what is made step by step, for `CHUNK_SECONDS` of wall time; whether it is done."""
        finished, _, _, status = _core.proceed(self.handle, CHUNK_SECONDS, np.inf)
        self._check(status)
        return bool(finished)

    def _check(self, status: int) -> None:
        """Raise an exception if the core has refused the deck."""
        if status != 0:
            texts, places = self.table("faults")
            faults = zip(texts, places.T.astype(int).tolist(), strict=True)
            lines = [f"{self._deck.place(*place)}: {text}" for (text,), place in faults]
            raise error_for(status, "\n".join(lines) or self.text("message"))


class Run(Session):
    """A run in the core, from deck to outcome; with `times` [s], its samples are at these, at 0 and at the end."""

    def __init__(self, deck: DeckSource, times: ArrayLike = ()) -> None:
        super().__init__(deck, "run", "", times)
        self.columns = self.infos("columns")
        self.model, self.method, self.model_choice, *notes, self.resolved_deck = self.text("about").split(
            "\n", 5
        )
        """`model_choice` is why 'auto' chose the model; empty if the deck names another model."""
        self.sampling_note, self.stiffness_note = notes
        """What the samples will not show, and why the method is slow on this scene; empty if that is not so."""

    def advance(self, seconds: float, until: float = np.inf) -> tuple[tuple[int, str] | None, bool, float]:
        """Integrate for at most `seconds` of wall time or to the time `until`, without the interpreter's lock.

        Returns the result code and its text, if the run has ended; whether `until` is reached; the time that is reached [s].
        """
        finished, reached, time, status = _core.proceed(self.handle, seconds, until)
        text = self.text("message") if status != 0 else "done"
        return (status, text) if finished else None, bool(reached), time

    def samples(self) -> NDArray[np.float64]:
        """The samples so far (columns, rows), C-contiguous."""
        samples = np.empty((len(self.columns), int(self.numbers("rows")[0, 0])))
        if samples.size > 0:
            _core.run_samples(self.handle, samples.T)
        return samples

    def state(self, time: float) -> list[tuple[Info, float]]:
        """Values of a sample at `time`, which must be in the last advance."""
        values = _core.run_state(self.handle, time, len(self.columns))
        return list(zip(self.columns, values.tolist(), strict=True))

    def ending(self) -> tuple[list[tuple[Info, float]], list[tuple[Info, float]]]:
        """Summary values and counters of the work of a finished run."""
        infos, (values, kinds) = self.infos("ending"), self.numbers("ending").tolist()
        entries = list(zip(infos, values, kinds, strict=True))
        summary = with_integers((info, value) for info, value, kind in entries if kind < 0)
        return summary, [(info, int(value) if kind else value) for info, value, kind in entries if kind >= 0]

    def parameters(self) -> list[tuple[Info, float | str]]:
        """Every key that the deck uses and its value."""
        cells, (values, is_text) = self.table("parameters")
        return with_integers(
            (info, text if is_one else value)
            for (info, text), value, is_one in zip(cells, values.tolist(), is_text.tolist(), strict=True)
        )


def returned(deck: DeckSource, model: str, place: float, slow_cycles: int) -> list[float]:
    """Where a motion in a model ('' for that of the deck) returns to some slow cycles after a place of its map.

    The place is the direction of the force at a release [rad], or, in the slow motion, the load at a valley [N]. Then follow the
    slope of the map, its logarithm, and the measures of the cycle.
    """
    with Session(deck, "return", model, [place, slow_cycles]) as found:
        return cast(list[float], found.numbers("found")[:, 0].tolist())


class Steady(Session):
    """Linear theory of the steady sliding of a scene."""

    def __init__(self, deck: DeckSource) -> None:
        super().__init__(deck, "steady")
        values = self.numbers("found")[:, 0]
        self.velocity, self.misalignment = values[:2].tolist()
        self.eigenvalues = values[2:6] + 1j * values[6:10]
        self.critical = values[10:]
        """The numbers that `theory` gives for ``'critical'``."""


class Cases(NamedTuple):
    """Results of some cases of a sweep."""

    values: NDArray[np.float64]
    """(case, value)"""
    cycles: NDArray[np.float64]
    """(case, cycle, quantity); NaN where there are fewer cycles."""
    counts: NDArray[np.int32]
    """Number of cycles of each case."""
    codes: NDArray[np.int32]
    """-1 if stopped."""
    messages: dict[int, str]
    """Messages of the cases that failed, by their place from 0."""


class Sweep(Session):
    """The cases of a sweep in the core."""

    def __init__(
        self, deck: DeckSource, axes: Sequence[tuple[str, NDArray[np.float64]]], is_list: bool
    ) -> None:
        values = [np.asarray(axis, dtype=np.float64) for _, axis in axes]
        super().__init__(
            deck,
            "sweep",
            "\n".join(key for key, _ in axes),
            np.concatenate([[is_list], [axis.size for axis in values], *values]),
        )
        self.cases, self.at_once, is_one = map(int, self.numbers("size")[:, 0])
        self.is_list = is_one == 1
        edges = np.cumsum(self.numbers("axes")[0], dtype=int)[:-1]
        self.axes = list(zip(self.infos("axes"), np.split(self.numbers("points")[:, 0], edges), strict=True))
        self.quantities = self.infos("quantities")
        self.cycle_quantities = self.infos("cycles")
        self.most_cycles = int(self.numbers("cycles").max(initial=0))

    def run(self, first: int, count: int) -> Cases:
        """Run cases `first` (from 0) and following. Several threads may do so at once."""
        values, cycles, counts, codes, messages = _core.sweep_run(
            self.handle,
            first + 1,
            count,
            len(self.quantities),
            len(self.cycle_quantities),
            self.most_cycles,
        )
        values[:, codes < 0] = np.nan
        failed = {int(i): text_from(messages[i]).rstrip() for i in np.flatnonzero(codes > 0)}
        return Cases(values.T, cycles.T, counts, codes, failed)

    def stop(self) -> None:
        """Make all threads stop their work."""
        _core.sweep_stop(self.handle)


def deck_values(deck: DeckSource) -> dict[str, dict[str, Value]]:
    """Values that a deck gives by group and key, in the order of the schema.

    Each is checked only against the range of its own key, so that a part of a deck is enough.
    """
    cells, numbers = Session(deck, "deck").table("values")
    groups: dict[str, dict[str, Any]] = {}
    for (place, text), number in zip(cells, numbers[0].tolist(), strict=True):
        group, _, name = place.partition(".")
        kind = key_info(group, name).kind
        # A real key may have a word in place of a number.
        value = int(text) if kind == "integer" else number if kind in ("real", "reals") and not text else text
        groups.setdefault(group, {}).setdefault(name, []).append(value)
    return {
        group: {name: values[0] if len(values) == 1 else tuple(values) for name, values in keys.items()}
        for group, keys in groups.items()
    }


@cache
def _library() -> Session:
    return Session(DeckSource("", ""), "library")


@cache
def origin() -> dict[str, str]:
    """Source and build of the core, and the host of this process; `job` is the name that the scheduler gives the job, or empty."""
    names = ("version", "git_revision", "compiler", "build_flags", "host", "job")
    return dict(zip(names, _library().text("origin").split("\n"), strict=True))


@cache
def catalogue() -> dict[str, Any]:
    """The output of ``dynstiction template --json``: commands, options, keys, columns, ...; numbers as texts, as in a deck."""
    found: dict[str, Any] = json.loads(_library().text("catalogue"), parse_int=str, parse_float=str)
    return found


@cache
def schema() -> tuple[KeyInfo, ...]:
    """Every key that a deck may have: the table of src/deck/schema.f90."""
    return tuple(map(_key, catalogue()["keys"]))


def _key(key: dict[str, Any]) -> KeyInfo:
    used_by = tuple((name, tuple(choices)) for name, choices in key["used_by"].items())
    given = {"choices": tuple(key["choices"]), "default": key["default"] or "", "used_by": used_by}
    return KeyInfo(**{name: key.get(name) for name in KeyInfo._fields} | given)


@cache
def key_info(group: str, name: str) -> KeyInfo:
    """Entry of the schema for one key."""
    return next(key for key in schema() if (key.group, key.name) == (group, name))


@cache
def group_names() -> tuple[str, ...]:
    """Names of the groups of a deck."""
    return tuple(dict.fromkeys(key.group for key in schema()))


@cache
def _places() -> dict[str, str]:
    """Group of each key, by its name, which is unique, and by ``group.key``."""
    return {name: key.group for key in schema() for name in (key.name, f"{key.group}.{key.name}")}


def group_of(name: str) -> str:
    """Group of a key that is given alone or as ``group.key``; empty if there is no such key."""
    return _places().get(name.lower(), "")


def unknown_key(name: object) -> str:
    """Message for a name that is neither a key nor a group."""
    near = nearest(name, [*_places(), *group_names()])
    if near:
        kind = "group" if near in group_names() else "key"
        return f"{shown(name)} is not a {kind} of a deck: did you mean {near!r}?"
    return (
        f"{shown(name)} is neither a key nor a group of a deck ({', '.join(group_names())}): "
        "dynstiction template shows all keys"
    )


@cache
def slider_parameters() -> tuple[str, ...]:
    """Names of the parameters of a slider, in the order in which `theory` takes them."""
    return tuple(_library().text("slider").split())


@cache
def _counts() -> frozenset[str]:
    """Names of summary values and keys that are whole numbers."""
    return frozenset(COUNTS) | {key.name for key in schema() if key.kind == "integer"}


def with_integers(entries: Iterable[tuple[Info, T]]) -> list[tuple[Info, T]]:
    """Described values, with counts as integers; the core has all numbers as reals."""
    counts = _counts()
    return [
        (info, cast(T, int(value)) if isinstance(value, float) and info.name in counts else value)
        for info, value in entries
    ]


def creep(
    form: str, n_values: int, tau: NDArray[np.float64], phi: NDArray[np.float64], kappa: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Creep (n_values, n) at the points (n)."""
    reals("kappa", kappa, least=0.0, below=1.0)
    reals("phi", phi, above=-0.5 * np.pi, below=0.5 * np.pi, units="rad")
    below, where = (None, "") if form == "exact" else (1.0, "where Eq. (8) holds")
    reals("tau", tau, least=0.0, below=below, units=where)
    slips = (phi == 0.0) & (tau >= 1.0)
    if np.any(slips):
        raise UsageError(
            f"tau = {tau[slips][0]:.17g} with phi = 0: without misalignment the object creeps in tau = [0, 1) only, then it slips"
        )
    return np.ascontiguousarray(theory(form, n_values, np.stack([tau, phi, kappa], axis=1)).T)


def theory(what: str, n_values: int, given: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (n, n_values) of a function of the core's `evaluate` for rows of its arguments (n, ...)."""
    if len(given) == 0:
        return np.empty((0, n_values))
    values: NDArray[np.float64]
    values, failed, message = _core.evaluate(what, given.T, n_values)
    if failed > 0:
        where = f"element {failed - 1} of {len(given)}: " if len(given) > 1 else ""
        raise UsageError(where + text_from(message))
    return values.T


@lru_cache(maxsize=64)
def _rows(text: bytes) -> list[Any]:
    # The same few descriptions come with every run; decoding them would take as long as a short run.
    rows = [row.split("\x1f") for row in text_from(text).split("\n")[:-1]]
    return [(Info(*row[:3]), *row[3:]) if len(row) > 2 else row for row in rows]


def _characters(text: str) -> _Characters:
    try:
        return np.frombuffer(text.encode("utf-8", "surrogateescape"), dtype="S1")
    except UnicodeEncodeError as error:
        raise UsageError(f"{text[:40]!r}: holds a half of a character: {error.reason}") from None


def text_from(data: bytes) -> str:
    """Text that is encoded as the same bytes again, even if these are not UTF-8."""
    return data.decode("utf-8", "surrogateescape")
