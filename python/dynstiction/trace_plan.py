"""Which traces determine which parameters, before anybody measures (docs/fit.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ._arguments import number
from ._fit.models import steady_velocity
from ._fit.problem import Problem
from ._fit.shooting import shot_at
from ._run import run_sampled
from .errors import UsageError
from .scene import DeckLike, Scene
from .trace import Chain, Trace
from .trace_fit import problem_of

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]


_Floats = NDArray[np.float64]

BEGINNING = 4.0
"""Time that is left out, over that in which the drive loads the spring to mu_0 W."""


def plan_traces(
    scene: DeckLike,
    free: Sequence[str] | str,
    each: Mapping[str, Sequence[float]],
    *,
    duration: float,
    interval: float = 1e-3,
    noise: float = 0.01,
    chain: Chain | None = None,
) -> pandas.DataFrame:
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
    pandas.DataFrame
        Standard errors relative to the values, a row for each free parameter: of one trace at each value of the key, and, in the column
        ``together``, of traces at all of them, each in its part of the time.

    Raises
    ------
    UsageError, FileError
        As for `fit`, of a trace with these samples.
    """
    import pandas  # noqa: PLC0415  (slow to import)

    number("duration", duration, above=0.0, units="s")
    number("interval", interval, above=0.0, units="s")
    if len(each) != 1:
        raise UsageError("each: one key and its values, like {'drive.velocity': (3e-4, 1e-3)}")
    ((key, values),) = each.items()
    rigs = [Scene(scene).replace(**cast(Any, {key: float(value)})) for value in values]
    problems = []
    for rig in rigs:
        trace = _simulated(rig, duration, interval)
        noisy = trace.with_noise(noise * float(np.ptp(trace.force)), 0)
        problems.append(problem_of(rig, noisy, free, chain=chain))
    tables = [_information(problem) for problem in problems]
    named = {f"{value:g}": table for value, table in zip(values, tables, strict=True)}
    named["together"] = np.mean(tables, axis=0)
    names = problems[0].names
    errors = {
        at: np.sqrt(np.diag(np.linalg.inv(each + 1e-9 * np.eye(len(names))))) for at, each in named.items()
    }
    return pandas.DataFrame(errors, index=names).rename_axis(columns=key)


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
    begin = problem.place({})
    here = problem.at(begin) if problem.is_slow else shot_at(problem, begin)
    matrix = here.jacobian.T @ here.jacobian
    own = matrix[:p, :p] - matrix[:p, p:] @ np.linalg.pinv(matrix[p:, p:]) @ matrix[p:, :p]
    back = np.linalg.inv(problem.slopes(here.z[:p]))
    return np.asarray(back.T @ own @ back)
