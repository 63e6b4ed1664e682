"""What `trade` measures of a run: quantities that users need, and their errors relative to a reference.

A quantity that the reference has and the run does not have counts as an error of 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Error
from ..record import Described
from ..result import Result
from ..simulation import Simulation
from ..stick_slip import first_release
from .plan import Subject

__all__ = ["QUANTITIES", "Observer", "Quantity", "of_distributions"]

Quantity = Callable[[Result], ArrayLike]
"""A quantity of the user: a function of a result that returns a number or an array, NaN where there is no value."""

Floats = NDArray[np.float64]

QUANTITIES = {
    "final_elongation": "elongation of the springs at t_end, over the largest one",
    "final_velocity": "slip velocity at t_end, over the largest one",
    "period": "mean time from peak to peak of the load",
    "peak_force": "mean peak of the load",
    "valley_force": "mean valley of the load",
    "slip_length": "mean advance in X from peak to valley",
    "max_X_rate": "largest slip speed along the drive",
    "creep_velocity": "mean of X' over the middle half of the first stick phase",
    "fast_amplitude": "amplitude of the fast oscillation of k_y u_y",
    "fast_phase": "phase of the fast oscillation of k_y u_y, error over pi",
    "sticks": "times that the object came to rest",
    "first_peak_force": "first peak of the load",
}
PERIODS, SAMPLES_PER_PERIOD = 8, 24
"""Length of the window in which the fast oscillation is fitted."""
LEAST_AMPLITUDE = 1.0e-6
"""Smallest amplitude of an oscillation over the static limit. Below it the fit shows a remaining trend, not an oscillation."""


class Observer:
    """When runs of a scene are sampled, which quantities are computed, and the scales of their errors.

    The survey is a run of the scene with samples at equal distances. For quantities of the user, `own`, runs are also sampled
    as the scene says.
    """

    def __init__(self, subject: Subject, survey: Result, own: Mapping[str, Quantity]) -> None:
        self._own = own
        time, load = survey.time, subject.number("stiffness_x") * survey["u_x"]
        self._static_limit = subject.number("mu_0") * subject.number("normal_load")
        self._scales = {
            "final_elongation": float(np.hypot(survey["u_x"], survey["u_y"]).max()),
            "final_velocity": float(np.hypot(survey["w_x"], survey["w_y"]).max()),
            "fast_phase": math.pi,
        }
        end = float(time[first_release(load) or -1])  # of the first stick phase
        # The frequency in creep, with friction along theta.
        theta = survey["theta"][np.abs(time - 0.5 * end) <= max(0.02 * end, time[1])]
        stiffness = np.array([subject.number("stiffness_x"), subject.number("stiffness_y")])
        along = np.array([np.sum(np.cos(theta) ** 2), np.sum(np.sin(theta) ** 2)])
        along /= max(along.sum(), np.finfo(float).tiny)
        self._frequency = math.sqrt(stiffness @ along / subject.number("mass")) / (2.0 * math.pi)
        window = np.empty(0)
        if subject.model != "low_frequency" and 0.2 * end * self._frequency > PERIODS:
            window = 0.5 * end + np.arange(PERIODS * SAMPLES_PER_PERIOD + 1) / (
                SAMPLES_PER_PERIOD * self._frequency
            )
        looks = np.concatenate([[0.0, 0.25 * end], window, [0.75 * end, time[-1]]])
        series = _series(subject.interval(), time) if own else np.empty(0)
        self.instants = np.unique(np.concatenate([looks, series]))
        """Times to sample [s], from 0 to the end."""
        self._looks, self._series = (
            np.searchsorted(self.instants, looks),
            np.searchsorted(self.instants, series),
        )
        self._window = window - 0.5 * (window[0] + window[-1]) if window.size else window

    def tune(self, result: Result) -> None:
        """Use the frequency at which the oscillation of a run is fitted best, within 15 %."""
        if not self._window.size:
            return
        trial = self._frequency * np.linspace(0.85, 1.15, 61)
        force = result["spring_force_y"][self._looks[2:-2]]
        residual = np.array([self._fit(force, frequency)[1] for frequency in trial])
        best = min(max(int(np.argmin(residual)), 1), trial.size - 2)
        before, here, after = residual[best - 1 : best + 2]
        self._frequency, curvature = float(trial[best]), before - 2.0 * here + after
        if curvature > 0.0:
            shift = max(-1.0, min(1.0, (before - after) / curvature))
            self._frequency += float(0.5 * (trial[1] - trial[0]) * shift)

    def _fit(self, force: Floats, frequency: float) -> tuple[Floats, float]:
        """Least squares of 1, t, t^2, cos, sin(2 pi f t): coefficients, and the sum of the squares left."""
        t, angle = self._window / self._window[-1], 2.0 * math.pi * frequency * self._window
        basis = np.stack([np.ones_like(t), t, t**2, np.cos(angle), np.sin(angle)], axis=1)
        coefficients = np.linalg.lstsq(basis, force, rcond=None)[0]
        return coefficients, float(np.sum((force - basis @ coefficients) ** 2))

    def observe(self, simulation: Simulation) -> dict[str, Floats]:
        """Quantities that a finished run has; it was sampled at `instants`."""
        result = simulation.result
        columns = {name: values[self._looks] for name, values in result.columns.items()}
        seen = {name: [result.summary[name]] for name in QUANTITIES if name in result.summary}
        for name, x, y in (("final_elongation", "u_x", "u_y"), ("final_velocity", "w_x", "w_y")):
            if x in columns and y in columns:
                seen[name] = [columns[x][-1], columns[y][-1]]
        distance, duration = (columns[name][-2] - columns[name][1] for name in ("X", "time"))
        seen["creep_velocity"] = [distance / duration]
        if self._window.size and "spring_force_y" in columns:
            *_, c, s = self._fit(columns["spring_force_y"][2:-2], self._frequency)[0]
            if math.hypot(c, s) > LEAST_AMPLITUDE * self._static_limit:
                seen["fast_amplitude"], seen["fast_phase"] = [math.hypot(c, s)], [math.atan2(-s, c)]
        observed = {name: np.array(values, dtype=np.float64) for name, values in seen.items()}
        return observed | (self._observe_own(result) if self._own else {})

    def _observe_own(self, result: Result) -> dict[str, Floats]:
        """The user's quantities, from the samples that the scene defines."""
        columns = Described(
            ((info, values[self._series]) for info, values in result.columns.info()), "columns"
        )
        shown, seen = replace(result, columns=columns), {}
        for name, quantity in self._own.items():
            try:
                values = np.asarray(quantity(shown), dtype=np.float64)
            except (Error, KeyError):  # a column or a value of the summary that the run does not have
                continue
            if values.size and np.all(np.isfinite(values)):
                seen[name] = values
        return seen

    def errors(self, seen: Mapping[str, Floats], reference: Mapping[str, Floats]) -> dict[str, float]:
        """Errors of a run relative to the reference, for each quantity that the reference has."""
        errors = {}
        for name, true in reference.items():
            scale = self._scales.get(name) or float(np.linalg.norm(true))
            if scale > 0.0:
                values = seen.get(name)
                errors[name] = (
                    1.0
                    if values is None or values.shape != true.shape
                    else _distance(name, values - true) / scale
                )
        return errors


def of_distributions(summary: Mapping[str, float]) -> dict[str, float]:
    """Relative difference that the means of two runs of an irregular motion have by chance, as its cycles have a distribution.

    It is the standard error of a difference, from the scatter over the later half of the cycles. Empty if the motion is regular,
    or if its regularity is not known.
    """
    if summary.get("regularity") != -1.0:
        return {}
    cycles = max(2.0, min(100.0, summary["cycles"] // 2))
    return {
        name: math.sqrt(2.0 / cycles) * summary[f"{name}_scatter"] / abs(summary[name])
        for name in ("period", "peak_force", "valley_force", "slip_length")
        if f"{name}_scatter" in summary
    }


def _distance(name: str, difference: Any) -> float:
    distance = float(np.linalg.norm(difference))
    return min(distance, 2.0 * math.pi - distance) if name == "fast_phase" else distance


def _series(interval: float, time: Floats) -> Floats:
    """Times of the samples that the scene defines [s]; those of the survey if their distances are not equal."""
    if interval == 0.0:
        return time
    end = float(time[-1])
    times = interval * np.arange(math.ceil(end / interval) + 1)
    return np.append(times[times < end * (1.0 - 4.0 * np.finfo(float).eps)], end)
