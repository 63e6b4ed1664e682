"""Which traces determine which parameters, before anybody measures (docs/fit.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ._arguments import number
from ._fit.models import steady_velocity
from ._fit.problem import Problem
from ._run import run_sampled
from .errors import UsageError
from .html import aligned, page_table
from .scene import DeckLike, Scene
from .trace import Trace
from .trace_chain import Chain
from .trace_fit import problem_of

__all__ = ["TracePlan", "plan_traces"]

_Floats = NDArray[np.float64]

BEGINNING = 4.0
"""Time that is left out, over that in which the drive loads the spring to mu_0 W."""


@dataclass(frozen=True, repr=False, eq=False)
class TracePlan:
    """Expected errors of parameters.

    Attributes
    ----------
    key : str
        What differs from trace to trace, ``group.key``.
    names : tuple of str
        The free parameters.
    errors : dict of str to ndarray, shape (p,)
        For one trace at each value of the key, and for ``together``, traces at all values in the same time: expected standard errors of
        the logarithms.
    """

    key: str
    names: tuple[str, ...]
    errors: Mapping[str, _Floats]

    def _rows(self) -> list[tuple[str, ...]]:
        return [
            (name, *(f"{100.0 * each[i]:.2g} %" for each in self.errors.values()))
            for i, name in enumerate(self.names)
        ]

    def __str__(self) -> str:
        rows = [(f"standard error at {self.key} =", *self.errors), *self._rows()]
        return "\n".join(aligned(rows))

    def __repr__(self) -> str:
        return f"<TracePlan\n{self}>"

    def _repr_html_(self) -> str:
        return page_table("expected standard errors", ("", *self.errors), self._rows())


def plan_traces(
    scene: DeckLike,
    free: Sequence[str] | str,
    each: Mapping[str, Sequence[float]],
    *,
    duration: float,
    interval: float = 1e-3,
    noise: float = 0.01,
    chain: Chain | None = None,
) -> TracePlan:
    """Expected errors of a fit to traces that have not been measured.

    Parameters
    ----------
    scene : str, PathLike or Scene
        The rig, with likely values of its free parameters.
    free : sequence of str, or str
        Parameters to be found, as for `fit`.
    each : mapping of str to sequence of float
        One key and its values, ``{"drive.velocity": (3e-4, 1e-3, 3e-3)}``, of the traces that may be measured.
    duration : float
        Time of all traces together [s].
    interval : float
        Time between two samples [s].
    noise : float
        Standard deviation of the noise of a sample, over the swing of the force.
    chain : Chain, optional
        The measuring chain.

    Returns
    -------
    TracePlan
        Standard errors of one trace at each value, and of all together, each in its part of the time.

    Raises
    ------
    UsageError, FileError
        As for `fit`, of a trace with these samples.
    """
    number("duration", duration, above=0.0, units="s")
    number("interval", interval, above=0.0, units="s")
    if len(each) != 1:
        raise UsageError("each: one key and its values, like {'drive.velocity': (3e-4, 1e-3)}")
    ((key, values),) = each.items()
    rig = Scene(scene)
    tables: dict[str, _Floats] = {}
    names: tuple[str, ...] = ()
    with ThreadPoolExecutor() as pool:
        for value in values:
            there = rig.replace(**cast(Any, {key: float(value)}))
            trace = _simulated(there, duration, interval)
            noisy = trace.with_noise(noise * float(np.ptp(trace.force)), 0)
            problem = problem_of(there, noisy, free, pool.map, chain=chain)
            names = problem.names
            tables[f"{value:g}"] = _information(problem)
    errors = {at: _errors(table, names) for at, table in tables.items()}
    errors["together"] = _errors(np.mean(list(tables.values()), axis=0), names)
    return TracePlan(key, names, errors)


def _simulated(scene: Scene, duration: float, interval: float) -> Trace:
    """A run that has settled."""
    limit = float(scene.friction.mu_0 or 0.0) * float(scene.friction.normal_load or 0.0)
    begin = BEGINNING * limit / abs(float(scene.system.stiffness_x or 1.0) * steady_velocity(scene))
    result = run_sampled(
        scene,
        progress=False,
        scene={"t_end": begin + duration},
        output={"interval": interval, "fields": ["spring_force_x", "spring_force_y", "pull_force"]},
    )
    return Trace.of(result).part(start=begin)


def _information(problem: Problem) -> _Floats:
    """Information of a trace about the logarithms of the parameters, whatever the delay of its slips."""
    p = len(problem.names)
    here = problem.at(problem.place({}))
    matrix = here.jacobian.T @ here.jacobian
    own = matrix[:p, :p] - matrix[:p, p:] @ np.linalg.pinv(matrix[p:, p:]) @ matrix[p:, :p]
    back = np.linalg.inv(problem.slopes(here.z[:p]))
    return np.asarray(back.T @ own @ back)


def _errors(information: _Floats, names: Sequence[str]) -> _Floats:
    return np.sqrt(np.diag(np.linalg.inv(information + 1e-9 * np.eye(len(names)))))
