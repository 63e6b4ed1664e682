"""Scenes: immutable descriptions of runs.

A scene is the text of a deck and a list of settings that override it. This module does not interpret them:
the deck reader of the Fortran core merges, checks and completes them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, Unpack, cast

from . import _native
from ._arguments import path_name, shown
from .deck_group import DeckGroup
from .deck_text import deck_from, setting_value
from .errors import DeckError, FileError, UsageError
from .groups import Changes, GroupValues, SceneGroups
from .html import page_table
from .record import number_shown, unit_shown

if TYPE_CHECKING:
    from .stability import Stability

Group: TypeAlias = DeckGroup | GroupValues
"""Value of a keyword for a group: its dataclass, which replaces the group, or a mapping, which changes keys."""

G = TypeVar("G", bound=DeckGroup)


class Scene(SceneGroups):
    """Immutable description of a run.

    Scenes are equal if they give every key the same value, in the deck or in a setting. They can be hashed, pickled, and
    changed with `replace` or ``copy.replace``. The attributes ``scene``, ``system``, ``friction``, ``drive``,
    ``initial``, ``integrator``, ``output`` and ``sweep`` are the groups as dataclasses.

    Parameters
    ----------
    deck : str, PathLike or Scene, optional
        Path of a deck, or the text of one (a string with a line break, or with an ``&`` if there is no such file).
        Without it the scene consists of the keyword groups alone.
    **changes : value of a key, or Setup, System, Friction, Drive, Initial, Integrator, Output, Sweep, or mapping
        Keys of the deck, ``misalignment_deg=2.0`` or ``**{"system.misalignment_deg": 2.0}``, and groups,
        ``system={"misalignment_deg": 2.0}`` or ``system=ds.System(mass=0.25, …)``. With a `deck` a
        dataclass replaces the group, and other values override keys; a key that is None is used as if the deck did
        not set it.

    Raises
    ------
    FileError
        If the deck cannot be read. Its content is checked by `check` and by `dynstiction.run`.
    UsageError
        If `deck` is none of these, a name is not a key or group, or a group is not a mapping of keys to values.

    Examples
    --------
    >>> fig3 = Scene("inputs/fig3.nml")                             # doctest: +SKIP
    >>> scenes = [fig3.replace(misalignment_deg=phi)                # doctest: +SKIP
    ...           for phi in (1.0, 2.0, 5.0)]
    >>> fig3.system.mass                                            # doctest: +SKIP
    0.25
    """

    __slots__ = ("_fields", "_name", "_settings", "_text", "_values")

    _text: str
    _name: str
    _fields: Mapping[int, str]
    _settings: dict[str, str]
    _values: dict[str, dict[str, _native.Value]]
    """Values that the core has read from the deck, which never changes; empty before."""

    def __init__(self, deck: DeckLike | None = None, /, **changes: Unpack[Changes]) -> None:
        given = _by_group(changes)
        self._fields, self._settings, self._values = {}, {}, {}
        if isinstance(deck, Scene):
            self._text, self._name, self._fields = deck._text, deck._name, deck._fields
            self._settings = dict(deck._settings)
        elif deck is None:
            groups: dict[str, dict[str, object]] = {}
            for name, keys in given:
                groups.setdefault(name, {}).update(_keys(name, keys))
            written = deck_from(groups, "scene")
            self._text, self._name, self._fields = written.text, written.name, written.fields
            return
        elif isinstance(deck, Mapping):
            raise UsageError(f"{shown(deck)}: a mapping is not a deck: write Scene(**groups)")
        elif isinstance(deck, str) and _is_text(deck):
            self._text, self._name = deck, "deck"
        else:
            self._name = path_name(deck)
            self._text = _read(self._name)
        self._settings |= {
            f"{group}.{key}".lower(): setting_value(value)
            for group, keys in given
            for key, value in _keys(group, keys).items()
        }

    @property
    def text(self) -> str:
        """Text of the deck, without the settings that override it."""
        return self._text

    @property
    def name(self) -> str:
        """Origin of the deck, as error messages show it."""
        return self._name

    @property
    def settings(self) -> tuple[str, ...]:
        """Overrides of the deck, each as ``group.key=value``."""
        return tuple(f"{name}={value}" for name, value in self._settings.items())

    @property
    def source(self) -> _native.DeckSource:
        """The input of the core."""
        return _native.DeckSource(self._text, self._name, self.settings, self._fields)

    def groups(self) -> dict[str, dict[str, _native.Value]]:
        """Every key that the scene gives, by group, with overrides: ``Scene(**scene.groups())`` is equal to the scene.

        Raises
        ------
        DeckError
            If a key or a value is refused.
        """
        return {group: dict(keys) for group, keys in self._given().items()}

    def _given(self) -> dict[str, dict[str, _native.Value]]:
        if not self._values:
            self._values = _native.deck_values(self.source)
        return self._values

    def to_deck(self) -> str:
        """Text of a deck with every key that the scene gives, with overrides.

        Raises
        ------
        DeckError
            If a key or a value is refused.
        """
        return deck_from(self.groups(), self._name).text

    def replace(self, **changes: Unpack[Changes]) -> Scene:
        """Scene with some keys or groups changed, ``scene.replace(mass=0.5)``; ``copy.replace`` does the same.

        Parameters
        ----------
        **changes : value of a key, or Setup, System, Friction, Drive, Initial, Integrator, Output, Sweep, or mapping
            As for `Scene`: keys, ``mass=0.5`` or ``**{"system.mass": 0.5}``, and groups, for which a mapping
            changes keys and a dataclass replaces the group.
        """
        return Scene(self, **changes)

    __replace__ = replace

    def check(self) -> str:
        """A deck with every key of the scene as it will be used, with defaults.

        Raises
        ------
        DeckError
            If the scene is refused; the text lists all its faults.
        """
        with _native.Run(self.source) as run:
            return run.resolved_deck

    def stability(self) -> Stability:
        """Whether steady sliding is stable, and above which misalignment it is stable.

        Returns
        -------
        Stability
            ``stable``, ``critical_misalignment_deg``, ``eigenvalues`` [1/s].

        Raises
        ------
        DeckError
            If the scene is refused.
        UsageError
            If its drive keeps no velocity other than 0, or several, or its model has no mass or only one stiffness.

        See Also
        --------
        critical_misalignment, steady_sliding_eigenvalues : the same for arrays of parameters.
        cycles : the motion that the object reaches where steady sliding is unstable.
        """
        from .stability import stability  # noqa: PLC0415  (it uses this module)

        return stability(self)

    def _group(self, kind: type[G]) -> G:
        return kind._read(self._given().get(kind.group, {}))

    def _identity(self) -> object:
        """Key for the comparison of scenes: the values, or the text if the scene cannot be read."""
        try:
            given = self._given()
        except DeckError:
            return self._text, frozenset(self._settings.items())
        kinds = (kind for kind in DeckGroup.__subclasses__() if kind.group in given)
        groups = (self._group(kind) for kind in kinds)
        return tuple(group for group in groups if group.given())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        return self._identity() == other._identity()

    def __hash__(self) -> int:
        return hash(self._identity())

    def __repr__(self) -> str:
        head = f"<Scene {', '.join([repr(self._name), *self.settings])}"
        try:
            groups = self.groups()
        except DeckError as error:
            return f"{head}\n  refused: {error}>"
        lines = (
            f"  {group}: {', '.join(f'{key} = {_shown(value, _native.key_info(group, key).units)}' for key, value in keys.items())}"
            for group, keys in groups.items()
        )
        return "\n".join([head, *lines]) + ">"

    def _repr_html_(self) -> str:
        rows, fault = list[tuple[str, ...]](), ""
        try:
            for group, keys in self.groups().items():
                for key, value in keys.items():
                    info = _native.key_info(group, key)
                    rows.append((group, key, _shown(value), unit_shown(info.units), info.meaning))
            if not self._given().get("sweep"):
                self.check()
        except DeckError as error:
            fault = str(error)
        return page_table(f"Scene {self._name}", ("group", "key", "value", "unit", ""), rows, fault)


DeckLike: TypeAlias = str | os.PathLike[str] | Scene
"""Path of a deck, text of a deck, or a scene."""


def _is_text(deck: str) -> bool:
    # Unlike Path.is_file, os.path.isfile accepts a long text.
    return "\n" in deck or ("&" in deck and not os.path.isfile(deck))


def _read(path: str) -> str:
    try:
        return _native.text_from(Path(path).read_bytes())
    except (OSError, ValueError) as error:  # ValueError: not a path
        reason = getattr(error, "strerror", None) or error
        raise FileError(f"{path}: {reason}: give the path of a deck") from error


def _by_group(changes: Mapping[str, object]) -> list[tuple[str, Group]]:
    """Changes of a scene by group, in the order in which they apply: groups, then single keys."""
    groups: list[tuple[str, Group]] = []
    single: list[tuple[str, Group]] = []
    for name, value in changes.items():
        place = _native.group_of(name)
        if place:
            single.append((place, {name.rpartition(".")[2].lower(): value}))
        elif name.lower() in _native.group_names():
            groups.append((name.lower(), cast(Group, value)))
        else:
            raise UsageError(_native.unknown_key(name))
    return groups + single


def _keys(group: str, keys: Group) -> Mapping[str, object]:
    """Keys that a group changes; a dataclass removes the keys that it does not give."""
    if isinstance(keys, DeckGroup):
        if keys.group != group:
            raise UsageError(f"{group}={shown(keys)}: a {type(keys).__name__} is the group '{keys.group}'")
        given = keys.given()
        return {field.name: given.get(field.name) for field in fields(keys)}
    if not isinstance(keys, Mapping):
        raise UsageError(
            f"{group}={shown(keys)}: a group is a mapping, {group}={{'key': value}}, or its dataclass"
        )
    for name in keys:
        if not (isinstance(name, str) and name.isprintable() and "=" not in name):
            raise UsageError(f"{shown(name)}: is not the name of a key of a deck")
    return keys


def used_settings(
    given: Mapping[str, GroupValues], settings: Mapping[str, GroupValues]
) -> dict[str, dict[str, Any]]:
    """The settings that have a use in a scene that gives these values by group, and None for what they leave without use there."""
    keys, values = {key.name: key for key in _native.schema()}, dict[str, object]()
    for group in (*given.values(), *settings.values()):
        values |= group

    def is_used(key: _native.KeyInfo) -> bool:
        """Whether the keys on which a key depends have values with which it is used."""
        return all(is_used(keys[on]) and values.get(on, keys[on].default) in them for on, them in key.used_by)

    found: dict[str, dict[str, Any]] = {}
    for key in keys.values():
        value = settings.get(key.group, {}).get(key.name) if is_used(key) else None
        if value is not None or (not is_used(key) and key.name in given.get(key.group, {})):
            found.setdefault(key.group, {})[key.name] = value
    return found


def _shown(value: _native.Value, units: str = "") -> str:
    shown = ", ".join(map(str, value)) if isinstance(value, tuple) else repr(value)
    if isinstance(value, tuple) and len(value) > 6 and isinstance(value[0], float):
        shown = f"{number_shown(value[0])}, {number_shown(value[1])}, … ({len(value)} values)"
    return f"{shown} {unit_shown(units)}".rstrip()
