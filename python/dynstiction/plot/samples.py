"""Columns of a result for figures."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .._native import catalogue
from ..errors import ColumnError
from ..result import Result
from ..thinning import extremes
from .style import COLUMN_WIDTH, DOTS_PER_INCH

__all__ = ["BINS", "Floats", "columns", "thin"]

Floats: TypeAlias = NDArray[np.float64]

# Twice the number of dots in a column's width, so that no bin is wider than a dot.
BINS = 2 * int(COLUMN_WIDTH * DOTS_PER_INCH)


def columns(result: Result, *names: str) -> Mapping[str, Floats]:
    """Columns by name; if the result lacks one, a `ColumnError` says how to get it."""
    missing = [name for name in names if name not in result]
    for name in missing:
        _refuse_unknown(name)
    if missing:
        listed = ", ".join(repr(name) for name in (*(n for n in result if n != "time"), *missing))
        raise ColumnError(
            f"the result lacks {', '.join(missing)}: run the deck again with output.fields = {listed}"
        )
    return {name: result[name] for name in names}


def _refuse_unknown(name: str) -> None:
    """Refuse a column that no run can have, which is a mistyped name."""
    known = [column["name"] for column in catalogue()["columns"]]
    if name not in known:
        near = get_close_matches(name, known, n=1)
        meant = f"did you mean '{near[0]}'? " if near else ""
        raise ColumnError(f"no column '{name}': {meant}The columns are {', '.join(known)}")


def thin(time: Floats, values: Floats, bins: int = BINS) -> tuple[Floats, Floats]:
    """Smallest and largest value in each interval of time that is drawn as one dot: see `extremes`."""
    return extremes(time, values, bins)
