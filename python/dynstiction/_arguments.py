"""Checks of the arguments of public functions: invalid ones are refused with the name of the argument and its range."""

from __future__ import annotations

import math
import numbers
import os
from collections.abc import Iterable
from decimal import Decimal
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import UsageError

ALIKE = 0.6
"""Similarity from which a name is suggested; the default of `difflib`."""

SMALLEST = float(np.finfo(np.float64).smallest_normal)
"""Smaller numbers have lost digits."""

LARGEST = float(np.finfo(np.float64).max)

MOST_POINTS = 2**31 - 1
"""The core counts with 32 bits."""

T = TypeVar("T")


def reals(
    name: str,
    values: ArrayLike,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    units: str = "",
    checked: bool = True,
) -> NDArray[np.float64]:
    """An argument as an array of float64.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    values : array_like
        The value given.
    above, least, below : float, optional
        Limits: values must be > above, or >= least, and < below.
    units : str
        Units of the limits, for messages.
    checked : bool
        Whether values are checked to be finite and within the limits; if not, the core checks them.

    Raises
    ------
    UsageError
        If the values are not real numbers, some are masked, or one is not finite or out of the limits.
    """
    array = _real_array(name, values)
    if checked:
        holds = np.isfinite(array)
        if above is not None:
            holds &= array > above
        if least is not None:
            holds &= array >= least
        if below is not None:
            holds &= array < below
        if not np.all(holds):
            worst = array.reshape(-1)[~holds.reshape(-1)][0]
            low = f"({-math.inf if above is None else above:g}" if least is None else f"[{least:g}"
            valid = f"{low}, {math.inf if below is None else below:g}) {units}".rstrip()
            raise UsageError(f"{name} = {worst:.17g}: {name} must be finite and in {valid}")
    return array


def _real_array(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        array = np.asarray(values)
        if array.dtype.kind == "O" and all(isinstance(x, numbers.Real | Decimal) for x in array.flat):
            array = array.astype(np.float64)
    except MemoryError:
        raise
    except Exception as error:  # an object of the user can raise anything when it is converted
        raise UsageError(f"{name} is not an array of real numbers: {error}") from None
    if array.dtype.kind not in "biuf":
        raise UsageError(f"{name} = {shown(values)}: {name} must be a real number or an array of them")
    if np.ma.is_masked(values):
        raise UsageError(f"{name} has masked elements: take them out, or fill them")
    if array.size > MOST_POINTS:
        raise UsageError(f"{name} has {array.size} elements: at most {MOST_POINTS} at once")
    with np.errstate(over="ignore"):
        return array.astype(np.float64, copy=False)


def number(name: str, value: ArrayLike, **limits: Any) -> float:
    """An argument that is one real number; `limits` as for `reals`."""
    array = reals(name, value, **limits)
    if array.ndim != 0:
        raise UsageError(f"{name} has the shape {array.shape}: {name} must be one number")
    return float(array)


def whole(name: str, value: object, *, least: int) -> int:
    """An argument that is a whole number, at least `least`."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < least:
        raise UsageError(f"{name} = {shown(value)}: {name} must be a whole number from {least} on")
    return int(value)


def generator(rng: int | np.random.Generator | None) -> np.random.Generator:
    """A source of random numbers as SPEC 7 has it: of a seed, one that is given, or a new one for None."""
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"rng = {shown(rng)}: give a seed, a numpy.random.Generator or None: {error}"
        ) from None


def flag(name: str, value: object) -> bool:
    """An argument that is true or false."""
    if not isinstance(value, bool | np.bool_):
        raise UsageError(f"{name} = {shown(value)}: {name} must be True or False")
    return bool(value)


def text(name: str, value: object) -> str:
    """An argument that is a string."""
    if not isinstance(value, str):
        raise UsageError(f"{name} = {shown(value)}: {name} must be a string")
    return value


def names_in(name: str, value: object) -> tuple[str, ...]:
    """An argument that is a sequence of names, or a string with commas between them."""
    try:
        listed = value.split(",") if isinstance(value, str) else tuple(value)  # type: ignore[arg-type]
    except TypeError:
        raise UsageError(
            f"{name} = {shown(value)}: give names, in a sequence or with commas between them"
        ) from None
    return tuple(text(name, each).strip() for each in listed)


def path_name(value: object) -> str:
    """An argument that is the path of a file."""
    name = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(name, str):
        raise UsageError(f"{shown(value)}: the path of a file must be a string or an os.PathLike")
    return name


def instance(name: str, value: object, kind: type[T], remedy: str) -> T:
    """An argument that is an object of the package."""
    if not isinstance(value, kind):
        raise UsageError(f"{name} = {shown(value)}: {name} must be a {kind.__name__}: {remedy}")
    return value


def shape_of(**arrays: NDArray[np.float64]) -> tuple[int, ...]:
    """The shape to which arguments broadcast.

    Raises
    ------
    UsageError
        If they do not, or have more points together than the core can count.
    """
    try:
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError:
        given = ", ".join(f"{name} {array.shape}" for name, array in arrays.items() if array.ndim)
        raise UsageError(f"arguments of shapes that do not broadcast: {given}") from None
    if math.prod(shape) > MOST_POINTS:
        raise UsageError(f"arguments of {math.prod(shape)} points together: at most {MOST_POINTS} at once")
    return shape


def finite(what: str, values: NDArray[T]) -> NDArray[T]:  # type: ignore[type-var]
    """A result, if all its values are numbers: finite arguments never give NaN or infinity silently."""
    good = np.isfinite(values)
    if not np.all(good):
        place = [int(i) for i in np.argwhere(~good)[0]]
        where = f"at {place} " if place else ""
        raise UsageError(
            f"{what} {where}is beyond the range of double precision: bring the arguments nearer to 1"
        )
    return values


def shown(value: object) -> str:
    """A value in short form, for a message."""
    try:
        words = " ".join(repr(value).split())
    except Exception:  # from an object of the user
        words = f"a {type(value).__name__}"
    return words if len(words) <= 60 else f"{words[:57]}..."


def nearest(name: object, names: Iterable[str]) -> str:
    """The name that is most similar to another one, ignoring case; empty if no name is similar."""
    if not isinstance(name, str):
        return ""
    by_case = {known.lower(): known for known in names}
    from difflib import get_close_matches  # noqa: PLC0415  (only after a mistake)

    found = get_close_matches(name.lower(), by_case, n=1, cutoff=ALIKE)
    return by_case[found[0]] if found else ""
