"""The results of `trade` as text: the reference, all measured points, and the other points with the reason."""

from __future__ import annotations

import numpy as np

from .measure import RESOLUTION, Comparison, Point
from .quantities import QUANTITIES

__all__ = ["report", "short"]

EPSILON = float(np.finfo(float).eps)

SHOWN = {"final_elongation": "final u", "final_velocity": "final w", "period": "period", "peak_force": "peak",
         "creep_velocity": "creep"}  # fmt: skip
"""Quantities that have a column, and the heading of the column."""
HEAD = "model                method      rtol      step s    v_smooth"
NAME_WIDTH, ROLE_PLACE = 63, 53


def short(value: float) -> str:
    """A number of two digits: 1.0E-03."""
    return f"{value:.1E}"


def report(comparison: Comparison) -> str:
    """The table of a comparison as text."""
    own = comparison.second.errors
    shown = SHOWN | {name: name[:10] for name in own if name not in QUANTITIES}
    heads = "".join(f" {heading:10}" for heading in shown.values())

    def row(point: Point, role: str = "", *, errors: bool = True) -> str:
        name = _name(point) if not role else f"{_name(point):.{ROLE_PLACE}}{role}"
        entries = "".join(f" {entry(point, name, role, errors):10}" for name in shown)
        newton, rhs = round(point.newton), round(min(point.rhs, 2.0e9))
        return f"{name:{NAME_WIDTH}}{entries}{point.seconds:13.2E}{newton:12d}{rhs:12d}"

    def entry(point: Point, quantity: str, role: str, errors: bool) -> str:
        if quantity not in own:
            return "-"
        if not errors:
            return ""
        floor = RESOLUTION * own[quantity]
        if not role and point.errors[quantity] <= floor:
            return f"<{short(max(floor, EPSILON))}"
        return f" {short(point.errors[quantity])}"

    lines = [
        "Errors relative to the reference; <: below 100 times its own error; -: the scene has no such value.",
        f"{HEAD:{NAME_WIDTH}}{heads}       wall s      Newton         rhs",
        row(comparison.best, "reference", errors=False),
        row(comparison.second, "its error"),
        *(row(point) for point in comparison.points if point.done),
    ]
    if comparison.is_irregular:
        lines.insert(
            1,
            "The motion is irregular: period, peak, valley and slip length have a distribution, not one value. Their errors\n"
            "are those of the means; an error below three standard errors is not resolved.",
        )
    failed = [f"{_name(point)}  {point.text}" for point in comparison.points if not point.done]
    return "\n".join([*lines, *(["Without result:", *failed] if failed else [])]) + "\n"


def _name(point: Point) -> str:
    candidate = point.candidate
    model = f"Eq. (8) {candidate.form}" if candidate.form else candidate.model
    model += ", cycle_map off" if candidate.cycle_map == "off" else ""
    numbers = (candidate.rtol, candidate.step, candidate.v_smooth)
    columns = "  ".join(f"{short(value) if value > 0.0 else '':>8}" for value in numbers)
    return f"{model:21.21}{candidate.method:12.12}{columns}".ljust(NAME_WIDTH)
