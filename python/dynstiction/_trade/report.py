"""The results of `trade` as text: a table of the best points, or of all of them."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from .advice import front, short
from .measure import RESOLUTION, Comparison, Point
from .quantities import QUANTITIES

__all__ = ["report", "selection"]

EPSILON = float(np.finfo(float).eps)

SHOWN = {"final_elongation": "u at end", "final_velocity": "w at end", "period": "period", "peak_force": "peak",
         "creep_velocity": "creep"}  # fmt: skip
"""Quantities that have a column, and the heading of the column."""
MOST_ROWS = 10
NAME_WIDTH = 53

LEGEND = (
    "Errors relative to the reference. u, w: elongation and slip velocity at t_end; period, peak: means of the load;\n"
    "creep: mean velocity in the first stick phase; <: below 100 times the error of the reference itself; -: the scene\n"
    "has no such value."
)
IRREGULAR = (
    "The motion is irregular: period, peak, valley and slip length have a distribution, not one value. Their errors\n"
    "are those of the means; an error below three standard errors is not resolved."
)


def selection(comparison: Comparison, quantity: str) -> str:
    """The table of the points than which no other one is both faster and more accurate, at most ten of them."""
    best = front(comparison, quantity)
    shown = (
        [best[i] for i in sorted({round(i) for i in np.linspace(0, len(best) - 1, MOST_ROWS)})]
        if best
        else []
    )
    measured = sum(point.done for point in comparison.points)
    last = f"{len(shown)} of {measured} measured settings: no other one is both faster and more accurate. --all prints all."
    return "\n".join([*_heading(comparison), *_rows(comparison, shown, ()), last]) + "\n"


def report(comparison: Comparison, quantity: str) -> str:
    """The table of all points, the fastest first, and what failed or was skipped, with the reason."""
    done = sorted((point for point in comparison.points if point.done), key=lambda point: point.seconds)
    lines = [*_heading(comparison), *_rows(comparison, done, front(comparison, quantity))]
    lines.append("*: no other setting is both faster and more accurate")
    failed = [f"{_name(point)}  {point.text}" for point in comparison.points if not point.done]
    return "\n".join([*lines, *(["Without result:", *failed] if failed else [])]) + "\n"


def _columns(comparison: Comparison) -> dict[str, str]:
    return SHOWN | {name: name[:10] for name in comparison.second.errors if name not in QUANTITIES}


def _heading(comparison: Comparison) -> list[str]:
    """Legend, headings, and the rows of the reference."""
    heads = "".join(f" {heading:>9}" for heading in _columns(comparison).values())
    names = f"{'model':21}{'method':10}{'rtol':>6}{'step s':>7}{'v_smooth':>9}".ljust(NAME_WIDTH)
    return [
        *LEGEND.splitlines(),
        *(IRREGULAR.splitlines() if comparison.is_irregular else ()),
        f"{'wall s':>8}   {names}{heads}    Newton       rhs",
        _row(comparison, comparison.best, "", dict.fromkeys(_columns(comparison), "")),
        _row(
            comparison,
            comparison.second,
            "",
            {name: short(error) for name, error in comparison.second.errors.items()},
        ),
    ]


def _rows(comparison: Comparison, points: list[Point], marked: Collection[Point]) -> list[str]:
    own = comparison.second.errors
    best = {id(point) for point in marked}

    def shown(quantity: str, error: float) -> str:
        floor = RESOLUTION * own[quantity]
        return f"<{short(max(floor, EPSILON))}" if error <= floor else short(error)

    return [
        _row(
            comparison,
            point,
            "*" if id(point) in best else "",
            {name: shown(name, error) for name, error in point.errors.items()},
        )
        for point in points
    ]


def _row(comparison: Comparison, point: Point, mark: str, errors: dict[str, str]) -> str:
    role = {"reference": "reference", "check": "its error"}.get(point.role, "")
    name = (
        f"{_name(point):{NAME_WIDTH}}" if not role else f"{f'{_name(point).rstrip()}, {role}':{NAME_WIDTH}}"
    )
    entries = "".join(f" {errors.get(name, '-'):>9}" for name in _columns(comparison))
    newton, rhs = round(point.newton), round(min(point.rhs, 2.0e9))
    return f"{short(point.seconds):>8} {mark:1} {name}{entries}{newton:10d}{rhs:10d}"


def _name(point: Point) -> str:
    candidate = point.candidate
    model = f"Eq. (8) {candidate.form}" if candidate.form else candidate.model
    model += ", cycle_map off" if candidate.cycle_map == "off" else ""
    numbers = (candidate.rtol, candidate.step, candidate.v_smooth)
    rtol, step, smooth = (short(value) if value > 0.0 else "" for value in numbers)
    return f"{model:21.21}{candidate.method:10.10}{rtol:>6}{step:>7}{smooth:>9}"
