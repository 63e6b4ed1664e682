"""Least squares for residuals that jump and are noisy."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from .models import NoCycleError

if TYPE_CHECKING:
    from .problem import Problem


_Floats = NDArray[np.float64]
_Place = TypeVar("_Place")
_Value = TypeVar("_Value")

Residuals = Callable[[_Floats], _Floats]
"""Weighted residuals at z; all are `FAILED` where there is no stick-slip."""

FAILED = 1e6
"""Residual of parameters without stick-slip."""
RANGE = 3.0
"""Largest change of a coordinate from its start."""
SECANT = 0.6
"""Change of a coordinate for a derivative, over the share that is added to the errors: smaller steps of the cost do not matter then."""
PERIOD = 1e-8
"""Relative tolerance of the period."""
PERIOD_STEPS = 4
MOST_STEPS = 30
CONVERGED, ROUGHLY = 1e-6, 1e-2
"""Relative changes of cost and coordinates at which a search ends: with the errors of the traces, and with larger ones."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A fit: the coordinates, the cost and the Jacobian of the residuals there, shape (residuals, coordinates)."""

    z: _Floats
    cost: float
    jacobian: _Floats
    left: _Floats | None = None
    """Residuals without what the states of the cycles take, if they are known."""


def spread(at: Callable[[_Place], _Value], places: Sequence[_Place]) -> list[_Value]:
    """Values at several places, which threads compute side by side."""
    if len(places) == 1:
        return [at(places[0])]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(at, places))


def has_failed(residuals: _Floats) -> bool:
    """Whether there is no stick-slip."""
    return bool(np.all(residuals == FAILED))


def derivatives(at: Residuals, z: _Floats, here: _Floats, step: float, central: bool = False) -> _Floats:
    """Jacobian by differences: to one side with stick-slip, or central ones; 0 where there is stick-slip on neither side.

    The weight of the period amplifies an error that is linear in the step: central differences have none.
    """

    def column(unit: _Floats) -> _Floats:
        ahead, behind = at(z + step * unit), here
        if central or has_failed(ahead):
            behind = at(z - step * unit)
        if has_failed(ahead):
            return np.zeros(here.size) if has_failed(behind) else (here - behind) / step
        if has_failed(behind):
            behind = here
        return (ahead - behind) / (step if behind is here else 2.0 * step)

    return np.column_stack(spread(column, list(np.eye(z.size))))


def least_squares_of(
    problem: Problem, start: _Floats, coarse: float, last: bool = True, offset: _Floats | float = 0.0
) -> Solution:
    """Fit from one start.

    The period is known a hundred times better than anything else: steps along the curved surface of the correct period would be short.
    One coordinate is therefore not free: it is chosen so that the period is correct.

    A share `coarse` of swing and period is added to the errors. The `last` fit has a Jacobian that is of use, since none with smaller errors
    follows; `offset` is added to the residuals.

    Raises
    ------
    NoCycleError
        If there is no stick-slip near this start.
    """
    from scipy.optimize import least_squares  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    def at(z: _Floats) -> _Floats:
        return problem.residuals(z, coarse) + offset

    first = problem.recordings[0]
    # The residual of the period, and its error relative to the period.
    period, exact = first.size - 1, first.period_error(coarse) / first.waveform.period
    step = max(problem.step, SECANT * coarse)
    z, here = start, at(start)
    if has_failed(here):
        raise NoCycleError("no stick-slip near this start")
    jacobian = derivatives(at, z, here, step)
    held = int(np.argmax(np.abs(jacobian[period])))
    free = np.delete(np.arange(z.size), held)
    known = {"z": z, "jacobian": jacobian}

    def whole(part: _Floats) -> tuple[_Floats, _Floats]:
        z, slope = known["z"], known["jacobian"][period]
        new = z.copy()
        new[free] = part
        if not abs(slope[held]) > 0.0:
            return new, at(new)
        new[held] -= np.clip(slope[free] @ (part - z[free]) / slope[held], -0.5, 0.5)
        here = at(new)
        for _ in range(PERIOD_STEPS):
            if abs(here[period]) * exact <= max(PERIOD, 1e-3 * exact) or has_failed(here):
                break
            new[held] -= np.clip(here[period] / slope[held], -0.5, 0.5)
            here = at(new)
        return new, here

    latest: dict[bytes, tuple[_Floats, _Floats]] = {}

    def at_latest(part: _Floats) -> tuple[_Floats, _Floats]:
        key = part.tobytes()
        if key not in latest:
            latest.clear()
            latest[key] = whole(part)
        return latest[key]

    def jac(part: _Floats) -> _Floats:
        z, here = at_latest(part)
        full = derivatives(at, z, here, step)
        known["z"], known["jacobian"] = z, full
        slope = full[period]
        if not abs(slope[held]) > 0.0:
            return full[:, free]
        reduced: _Floats = full[:, free] - np.outer(full[:, held], slope[free] / slope[held])
        return reduced

    found = least_squares(
        lambda part: at_latest(part)[1],
        z[free],
        jac,
        bounds=(z[free] - RANGE, z[free] + RANGE),
        max_nfev=MOST_STEPS,
        ftol=CONVERGED if last else ROUGHLY,
        xtol=CONVERGED if last else ROUGHLY,
        gtol=1e-12,
        x_scale=1.0,
    )
    z, here = whole(found.x)
    if has_failed(here):
        raise NoCycleError("no stick-slip near this start")
    if not last:
        return Solution(z, float(here @ here), known["jacobian"])
    # One step with all parameters: it includes the error of the period.
    full = derivatives(at, z, here, step, central=True)
    change = -np.linalg.lstsq(full, here, rcond=1e-12)[0]
    there = at(z + change)
    if there @ there < here @ here:
        z, here = z + change, there
    return Solution(z, float(here @ here), full)
