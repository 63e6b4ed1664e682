"""Suggestions for names that do not exist."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["nearest"]

ALIKE = 0.6
"""Similarity from which a name is suggested; the default of `difflib`."""


def nearest(name: object, names: Iterable[str]) -> str:
    """The name that is most similar to another one, ignoring case; empty if no name is similar."""
    if not isinstance(name, str):
        return ""
    by_case = {known.lower(): known for known in names}
    from difflib import get_close_matches  # noqa: PLC0415  (only after a mistake)

    found = get_close_matches(name.lower(), by_case, n=1, cutoff=ALIKE)
    return by_case[found[0]] if found else ""
