"""Scenes: immutable descriptions of what to compute.

A scene is the text of a deck and a list of settings that override it. Neither is interpreted here:
the deck reader of the Fortran core merges, checks and completes them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from . import _native
from .errors import FileError, UsageError

__all__ = ["DeckLike", "Group", "Scene"]

Group: TypeAlias = Mapping[str, object]
"""Keys of one deck group and their values: numbers, strings, or sequences of them; None takes a key out."""

VALUES_PER_LINE = 6


class Scene:
    """Immutable description of a run.

    Parameters
    ----------
    deck : str, PathLike or Scene, optional
        Path of a deck, or the text of one (what contains a line break, or an ``&`` and is no file).
        Without it the scene is made of the keyword groups alone.
    **groups : mapping
        Deck groups, ``system={"misalignment_deg": 2.0}``; with a `deck` they override it, and a key that is
        None is used as if the deck did not set it.

    Raises
    ------
    FileError
        If the deck cannot be read. Its content is checked by `check` and by `dynstiction.run`.

    Examples
    --------
    >>> fig3 = Scene("inputs/fig3.nml")                             # doctest: +SKIP
    >>> scenes = [fig3.replace(system={"misalignment_deg": phi})    # doctest: +SKIP
    ...           for phi in (1.0, 2.0, 5.0)]
    """

    __slots__ = ("_name", "_settings", "_text")

    _text: str
    _name: str
    _settings: dict[str, str]

    def __init__(self, deck: DeckLike | None = None, /, **groups: Group) -> None:
        if isinstance(deck, Scene):
            self._text, self._name, self._settings = deck._text, deck._name, dict(deck._settings)
        elif deck is None:
            self._text, self._name, self._settings = _deck_text(groups), "scene", {}
            return
        elif isinstance(deck, str) and _is_text(deck):
            self._text, self._name, self._settings = deck, "deck", {}
        else:
            self._text, self._name, self._settings = _read(deck), os.fspath(deck), {}
        self._settings.update(_settings(groups))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Scene:
        """Scene of the deck in a file.

        Raises
        ------
        FileError
            If the file cannot be read.
        """
        return cls(Path(path))

    @property
    def text(self) -> str:
        """Text of the deck, without the settings that override it."""
        return self._text

    @property
    def name(self) -> str:
        """Where the deck comes from, as error messages show it."""
        return self._name

    @property
    def settings(self) -> tuple[str, ...]:
        """Overrides of the deck, ``group.key=value`` each."""
        return tuple(f"{name}={value}" for name, value in self._settings.items())

    def replace(self, **groups: Group) -> Scene:
        """Scene with some keys changed, ``scene.replace(system={"mass": 0.5})``."""
        return Scene(self, **groups)

    def check(self) -> str:
        """Every key of the scene as it will be used, defaults included.

        Raises
        ------
        DeckError
            If the scene is refused; all its faults are named.
        """
        with _native.Run(self._text, self._name, self.settings) as run:
            return run.resolved_deck()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        return (self._text, self._settings) == (other._text, other._settings)

    def __hash__(self) -> int:
        return hash((self._text, frozenset(self._settings.items())))

    def __repr__(self) -> str:
        return f"<Scene {', '.join([repr(self._name), *self.settings])}>"


DeckLike: TypeAlias = str | os.PathLike[str] | Scene
"""Path of a deck, text of a deck, or a scene."""


def _is_text(deck: str) -> bool:
    # Unlike Path.is_file, os.path.isfile takes a long text without complaint.
    return "\n" in deck or ("&" in deck and not os.path.isfile(deck))


def _read(path: str | os.PathLike[str]) -> str:
    try:
        return _native.text_from(Path(path).read_bytes())
    except OSError as error:
        raise FileError(f"{os.fspath(path)}: {error.strerror or error}: give the path of a deck") from error


def _deck_text(groups: Mapping[str, Group]) -> str:
    lines: list[str] = []
    for group, keys in groups.items():
        entries = [f"  {key} = {_value(value)}" for key, value in _items(group, keys) if value is not None]
        lines += [f"&{group}", *entries, "/"]
    return "\n".join(lines) + "\n"


def _settings(groups: Mapping[str, Group]) -> dict[str, str]:
    return {
        f"{group}.{key}".lower(): "" if value is None else _value(value).replace("\n", "")
        for group, keys in groups.items()
        for key, value in _items(group, keys)
    }


def _items(group: str, keys: Group) -> Iterable[tuple[str, object]]:
    if not isinstance(keys, Mapping):
        raise UsageError(f"{group}={keys!r}: a group is a mapping, {group}={{'key': value}}")
    return keys.items()


def _value(value: object) -> str:
    """Namelist form of a value; every float64 is read back as the same number."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    match value:
        case bool():
            return ".true." if value else ".false."
        case int() | float():
            return repr(value)
        case str() | os.PathLike():
            text = os.fspath(value)
            if "\n" in text or "\r" in text:
                raise UsageError(f"{text!r}: a value of a deck has no line breaks")
            return "'" + text.replace("'", "''") + "'"
        case Sequence():
            items = [_value(item) for item in value]
            rows = [items[i : i + VALUES_PER_LINE] for i in range(0, len(items), VALUES_PER_LINE)]
            return ",\n    ".join(", ".join(row) for row in rows)
    raise UsageError(f"{value!r}: a value of a deck is a number, a string, or a sequence of them")
