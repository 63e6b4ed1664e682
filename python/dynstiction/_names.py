"""Names of columns and values: what they mean, and suggestions for those that do not exist."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

__all__ = ["Info", "nearest"]

ALIKE = 0.6
"""Similarity from which a name is suggested; the default of `difflib`."""


class Info(NamedTuple):
    """Name, unit and meaning of a column or a scalar."""

    name: str
    units: str
    long_name: str


def nearest(name: object, names: Iterable[str]) -> str:
    """The name that is most similar to another one, ignoring case; empty if no name is similar."""
    if not isinstance(name, str):
        return ""
    by_case = {known.lower(): known for known in names}
    from difflib import get_close_matches  # noqa: PLC0415  (only after a mistake)

    found = get_close_matches(name.lower(), by_case, n=1, cutoff=ALIKE)
    return by_case[found[0]] if found else ""
