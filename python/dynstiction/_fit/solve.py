"""Least squares fit of a scene's settled cycle to a measured waveform.

The period is known a hundred times better than anything else, so that steps along the curved surface of the correct period would be
short. While the waveform is fitted, one parameter is therefore not free: it is chosen so that the period is correct.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import Error
from .models import NoCycleError
from .waveform import Waveform

__all__ = ["Model", "Solution", "best_start", "least_squares_of", "residuals", "unfitted", "weights_of"]

_Floats = NDArray[np.float64]

Model = Callable[[_Floats, float], _Floats]
"""Mean forces [N] and the period [s] at the logarithms of the parameters and a delay [s]."""

STEP = 1e-4
"""Change of a logarithm for a derivative. A tenth of it, and ten times it, give the same fits."""
RANGE = 3.0
"""Largest change of a logarithm from its start."""
PRIOR = 2.3
"""Standard deviation of the prior of a logarithm about its start: a factor of ten."""
COARSE = 0.02
"""Errors relative to swing and period, for the comparison of starts and for the first fit."""
PERIOD = 1e-8
"""Relative tolerance of the period."""
PERIOD_STEPS = 4
FAILED = 1e3
"""Residual of parameters without stick-slip."""
MOST_STEPS = 30
CONVERGED = 1e-6


@dataclass(frozen=True)
class Solution:
    """A fit: the logarithms of the parameters and the delay over the fall, the cost and the Jacobian of the residuals there."""

    z: _Floats
    cost: float
    jacobian: _Floats
    evaluations: int


def unfitted(start: _Floats) -> Solution:
    """The logarithms of a start, without a delay."""
    return Solution(np.append(start, 0.0), np.inf, np.empty((0, 0)), 0)


def residuals(
    model: Model, wave: Waveform, weights: _Floats, offset: _Floats | float = 0.0
) -> Callable[[_Floats], _Floats]:
    """Weighted difference of a model and a waveform at z; 0 for bins that are not used."""
    measured = np.append(wave.rows.mean(axis=0), wave.period)

    def at(z: _Floats) -> _Floats:
        try:
            values = model(z[:-1], float(z[-1]) * wave.fall) + offset
        except Error:
            return np.full(measured.size, FAILED)
        off: _Floats = np.nan_to_num((values - measured) * weights, nan=FAILED, posinf=FAILED, neginf=-FAILED)
        return off

    return at


def weights_of(wave: Waveform, coarse: float) -> _Floats:
    """Inverse errors of the bins and of the period, with shares of the swing and of the period added to the errors."""
    bins = wave.counts / np.hypot(wave.errors, coarse * wave.sizes)
    return np.append(bins, 1.0 / np.hypot(wave.period_error, coarse * wave.period))


def best_start(model: Model, wave: Waveform, starts: Sequence[_Floats], count: int) -> list[_Floats]:
    """The `count` starts (logarithms of the parameters) that come nearest to the waveform."""
    at = residuals(model, wave, weights_of(wave, COARSE))
    costs = [float(np.sum(at(np.append(start, 0.0)) ** 2)) for start in starts]
    return [starts[i] for i in np.argsort(costs, kind="stable")[:count]]


def derivatives(at: Callable[[_Floats], _Floats], z: _Floats, here: _Floats, step: float) -> _Floats:
    """Jacobian by differences, shape (residuals, parameters); 0 where there is stick-slip on neither side."""
    columns = np.zeros((here.size, z.size))
    for i in range(z.size):
        for change in (step, -step):
            there = z.copy()
            there[i] += change
            values = at(there)
            if np.max(np.abs(values)) < FAILED:
                columns[:, i] = (values - here) / change
                break
    return columns


def central_derivatives(at: Callable[[_Floats], _Floats], z: _Floats, here: _Floats, step: float) -> _Floats:
    """The same by central differences: the weight of the period amplifies an error that is linear in the step."""
    columns = derivatives(at, z, here, step)
    for i in range(z.size):
        there, back = z.copy(), z.copy()
        there[i] += step
        back[i] -= step
        ends = at(there), at(back)
        if max(np.max(np.abs(values)) for values in ends) < FAILED:
            columns[:, i] = (ends[0] - ends[1]) / (2.0 * step)
    return columns


def least_squares_of(
    model: Model,
    wave: Waveform,
    start: _Floats,
    *,
    coarse: float = 0.0,
    offset: _Floats | float = 0.0,
    delay: float = 0.0,
    step: float = STEP,
) -> Solution:
    """Fit from one start.

    Parameters
    ----------
    model : callable
        Function of the logarithms of the parameters and of a delay.
    wave : Waveform
        The measured waveform.
    start : ndarray, shape (p,)
        Logarithms of the parameters.
    coarse : float
        Error relative to swing and period that is added.
    offset : ndarray or float
        Added to the model.
    delay : float
        Initial delay, over the fall.
    step : float
        Change of a logarithm for a derivative.
    """
    from scipy.optimize import least_squares  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    at = residuals(model, wave, weights_of(wave, coarse), offset)
    exact = 1.0 / weights_of(wave, coarse)[-1] / wave.period
    z = np.append(start, delay)
    jacobian = derivatives(at, z, at(z), step)
    held = int(np.argmax(np.abs(jacobian[-1, :-1])))
    free = np.delete(np.arange(z.size), held)
    known = {"z": z, "jacobian": jacobian}
    count = z.size + 1

    def whole(part: _Floats) -> tuple[_Floats, _Floats]:
        nonlocal count
        z, jacobian = known["z"], known["jacobian"]
        new = z.copy()
        new[free] = part
        slope = jacobian[-1]
        if abs(slope[held]) > 0.0:
            new[held] -= np.clip(slope[free] @ (part - z[free]) / slope[held], -0.5, 0.5)
        here = at(new)
        for _ in range(PERIOD_STEPS):
            count += 1
            if (
                abs(here[-1]) * exact <= max(PERIOD, 1e-3 * exact)
                or abs(here[-1]) >= FAILED
                or not abs(slope[held]) > 0.0
            ):
                break
            new[held] -= np.clip(here[-1] / slope[held], -0.5, 0.5)
            here = at(new)
        return new, here

    last: dict[bytes, tuple[_Floats, _Floats]] = {}

    def fun(part: _Floats) -> _Floats:
        key = part.tobytes()
        if key not in last:
            last.clear()
            last[key] = whole(part)
        return last[key][1]

    def jac(part: _Floats) -> _Floats:
        nonlocal count
        fun(part)
        z, here = last[part.tobytes()]
        full = derivatives(at, z, here, step)
        count += z.size
        known["z"], known["jacobian"] = z, full
        slope = full[-1]
        if not abs(slope[held]) > 0.0:
            return full[:, free]
        reduced: _Floats = full[:, free] - np.outer(full[:, held], slope[free] / slope[held])
        return reduced

    bounds = (np.append(start - RANGE, -2.0)[free], np.append(start + RANGE, 2.0)[free])
    found = least_squares(
        fun,
        z[free],
        jac,
        bounds,
        max_nfev=MOST_STEPS,
        ftol=CONVERGED,
        xtol=CONVERGED,
        gtol=1e-12,
        x_scale=1.0,
    )
    z, here = whole(found.x)
    if np.max(np.abs(here)) >= FAILED:
        raise NoCycleError("no stick-slip near this start")
    # One step with all parameters: it includes the error of the period.
    full = central_derivatives(at, z, here, step)
    change = -np.linalg.lstsq(full, here, rcond=1e-12)[0]
    there = at(z + change)
    if there @ there < here @ here:
        z, here = z + change, there
    return Solution(z, float(here @ here), full, count)
