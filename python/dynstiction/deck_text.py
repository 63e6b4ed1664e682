"""Values as a deck writes them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np

from ._arguments import shown
from ._native import DeckSource
from .errors import UsageError

VALUES_PER_LINE = 6


def deck_from(groups: Mapping[str, Mapping[str, object]], name: str) -> DeckSource:
    """Deck of some groups; None leaves a key out. Messages about the deck name the keys."""
    lines: list[str] = []
    fields: dict[int, str] = {}
    for group, keys in groups.items():
        lines.append(f"&{group}")
        fields[len(lines)] = group
        for key, value in keys.items():
            if value is None:
                continue
            written = f"  {key} = {_namelist(value)}".split("\n")
            lines += written
            fields |= {len(lines) - i: f"{group}.{key}" for i in range(len(written))}
        lines.append("/")
    return DeckSource("\n".join(lines) + "\n", name, fields=fields)


def setting_value(value: object) -> str:
    """A value in one line; empty for None, which removes a key from the deck."""
    return "" if value is None else _namelist(value).replace("\n", "")


def plain(value: object) -> object:
    """A value without NumPy, sequences as tuples."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        try:
            return tuple(plain(item) for item in value)
        except RecursionError:
            raise UsageError("a value of a deck is no list that contains itself") from None
    return value


def _namelist(value: object) -> str:
    """Namelist form of a value; every float64 is read back as the same number."""
    match plain(value):
        case bool() as flag:
            return ".true." if flag else ".false."
        case int() | float() as number:
            try:
                return repr(number)
            except ValueError as error:  # a number of thousands of digits
                raise UsageError(
                    f"a value of a deck is a number, a string, or a sequence of them: {error}"
                ) from None
        case str() as text:
            if "\n" in text or "\r" in text:
                raise UsageError(f"{shown(text)}: a value of a deck has no line breaks")
            return "'" + text.replace("'", "''") + "'"
        case tuple() as values:
            items = [_namelist(item) for item in values]
            rows = [items[i : i + VALUES_PER_LINE] for i in range(0, len(items), VALUES_PER_LINE)]
            return ",\n    ".join(", ".join(row) for row in rows)
    raise UsageError(f"{shown(value)}: a value of a deck is a number, a string, or a sequence of them")
