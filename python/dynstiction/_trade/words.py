"""Numbers as the executable writes them."""

from __future__ import annotations

import math
from decimal import Decimal

__all__ = ["EPSILON", "as_in_a_deck", "duration", "plain", "short"]

EPSILON = math.ulp(1.0)


def short(value: float) -> str:
    """A number of two digits: 1.0E-03."""
    return f"{value:.1E}"


def plain(value: float) -> str:
    """A number for people: 0, 12.3, 0.00123, 123456, 1.23e7."""
    if not math.isfinite(value):
        return "infinite"
    mantissa, exponent = f"{value:.2e}".split("e")
    decades = int(exponent)
    if not -4 < decades < 6:
        return f"{_without_zeros(mantissa)}e{decades}"
    return _without_zeros(f"{value:.{max(0, 2 - decades)}f}")


def _without_zeros(digits: str) -> str:
    return digits.rstrip("0").rstrip(".") if "." in digits else digits


def as_in_a_deck(value: float) -> str:
    """A number with as many digits as it needs: 0.25, 1.0e-3, 9.7e-5."""
    digits, exponent = Decimal(repr(float(value))).normalize().as_tuple()[1:]
    decades = len(digits) - 1 + int(exponent)
    text = "".join(map(str, digits))
    if 0 <= decades <= 4:
        text = text.ljust(decades + 2, "0")
        return f"{text[: decades + 1]}.{text[decades + 1 :]}"
    if -2 <= decades < 0:
        return f"0.{'0' * (-decades - 1)}{text}"
    return f"{text[0]}.{text[1:] or '0'}e{decades}"


def duration(seconds: float) -> str:
    """Time as one says it: 0.5 s, 12 s, 3 min 20 s, 2 h 5 min."""
    if not seconds < 86.4e6:
        return "over 1000 d"
    if seconds < 9.5:
        return f"{plain(round(seconds, 1))} s"
    if seconds < 59.5:
        return f"{round(seconds)} s"
    larger, smaller, size, count = "min", "s", 1, 60
    if seconds >= 86370.0:
        larger, smaller, size, count = "d", "h", 3600, 24
    elif seconds >= 3599.5:
        larger, smaller, size, count = "h", "min", 60, 60
    whole, rest = divmod(round(seconds / size), count)
    return f"{whole} {larger}" + (f" {rest} {smaller}" if rest else "")
