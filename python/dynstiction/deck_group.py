"""Base of the dataclasses of the deck's groups, whose values are checked by the deck reader of the core."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Self

from . import _native
from .deck_text import deck_from, plain


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class DeckGroup:
    """Base of the groups: a frozen dataclass with one field for each key, in the deck's units.

    A field that is not given has the key's default, or None if it has none. ``dataclasses.replace`` and
    ``copy.replace`` change fields; ``dataclasses.fields`` gives units and meanings as metadata.

    Raises
    ------
    DeckError
        If the deck reader would refuse a value: wrong kind, out of range, no such choice. Missing keys and combinations
        that are not valid are found when the scene is checked or run.
    """

    group: ClassVar[str]

    def __init_subclass__(cls) -> None:
        for key in _native.schema():
            if key.group == cls.group and key.name in cls.__annotations__:
                about = {"units": key.units or "1", "long_name": key.meaning}
                setattr(cls, key.name, dataclasses.field(default=getattr(cls, key.name), metadata=about))

    def __post_init__(self) -> None:
        defaults = self._defaults()
        # None means the default.
        given = {name: plain(getattr(self, name)) for name in defaults}
        given = {n: v for n, v in given.items() if v is not None and v != defaults[n]}
        deck = deck_from({self.group: given}, type(self).__name__)
        self._fill(defaults | _native.deck_values(deck).get(self.group, {}))

    @classmethod
    def _defaults(cls) -> dict[str, Any]:
        return {field.name: field.default for field in dataclasses.fields(cls)}

    @classmethod
    def _read(cls, given: Mapping[str, _native.Value]) -> Self:
        """Group with the values that the core has read."""
        group = cls.__new__(cls)
        group._fill(cls._defaults() | dict(given))
        return group

    def _fill(self, values: Mapping[str, object]) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def given(self) -> dict[str, Any]:
        """Values of the keys that differ from their defaults."""
        return {n: getattr(self, n) for n, default in self._defaults().items() if getattr(self, n) != default}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{n}={v!r}' for n, v in self.given().items())})"
