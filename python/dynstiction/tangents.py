"""What a cycle, or a run, hangs on: derivatives with respect to the parameters, without further runs (docs/cycles.md)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._sweep import full_key
from .errors import UsageError
from .record import EVENT_DTYPE
from .scene import DeckLike, Scene

GROUPS = ("system", "friction", "drive")
"""Groups of the parameters on which a cycle hangs."""
OF_RUNS = (*GROUPS, "initial")
"""Groups of the parameters on which a run hangs."""


class Sensitivity(NamedTuple):
    """The cycle to which a motion settles, and its derivatives."""

    parameters: dict[str, float]
    """Parameters by ``group.key``, in the units of the deck."""
    cycle: dict[str, float]
    """Period, peak and valley of the load, durations and slip length, as in `dynstiction.LimitCycle` [SI]."""
    derivatives: NDArray[np.float64]
    """Change of each measure of the cycle per change of each parameter; shape (measure, parameter)."""

    @property
    def elasticities(self) -> NDArray[np.float64]:
        """Percent of each measure per percent of each parameter; shape (measure, parameter)."""
        measures = np.array([*self.cycle.values()])[:, np.newaxis]
        return np.asarray(self.derivatives * np.array([*self.parameters.values()]) / measures)

    def __str__(self) -> str:
        head = [f"{'percent per percent':32s}", *(f"{name:>15s}" for name in self.cycle)]
        rows = [
            "".join([f"{f'{key} = {value:.6g}':32s}", *(f"{change:15.4f}" for change in changes)])
            for (key, value), changes in zip(self.parameters.items(), self.elasticities.T, strict=True)
        ]
        return "\n".join(["".join(head), *rows])


def sensitivity(scene: DeckLike, keys: Iterable[str] | str | None = None) -> Sensitivity:
    """How the cycle to which a scene settles changes with its parameters.

    Parameters
    ----------
    scene : str, PathLike or Scene
        A deck or a scene of model 'full' with exact contact. Its drive must keep one velocity other than 0 and no second one.
    keys : str or iterable of str, optional
        Parameters of &system, &friction or &drive, as for `dynstiction.sweep`; by default all that the deck gives and that are
        not 0.

    Returns
    -------
    Sensitivity
        Derivatives and elasticities. ``print`` shows the elasticities, `dynstiction.plot` draws them.

    Raises
    ------
    DeckError, FileError, SolverError
        As for `dynstiction.cycles`.
    UsageError
        If a key has no small share, or the motion does not repeat, or repeats without rest.

    Notes
    -----
    They are exact derivatives of the cycle that is computed, by the tangent of the motion, and hold as long as the cycle has the
    same number of laps: one lap more or less in a slow cycle of N changes them by some 1/N. See docs/cycles.md.
    """
    whole = Scene(scene)
    with _native.Session(whole.source, "sensitivity", _names(whole, keys, GROUPS)) as found:
        names, numbers = found.infos("sensitivity"), found.numbers("sensitivity")
        measures = {info.name: value for info, value in zip(names, numbers[0].tolist(), strict=True)}
        return Sensitivity(_parameters(found), measures, numbers[1:].T)


class Derivatives(NamedTuple):
    """Samples and events of a run, and their derivatives."""

    parameters: dict[str, float]
    """Parameters by ``group.key``, in the units of the deck."""
    time: NDArray[np.float64]
    """Times of the samples [s]; shape (sample,)."""
    columns: dict[str, NDArray[np.float64]]
    """Columns of `output.fields` by name, in their units; each of shape (sample,)."""
    derivatives: dict[str, NDArray[np.float64]]
    """Change of each column, at its time, per change of each parameter; each of shape (sample, parameter)."""
    events: NDArray[np.void]
    """Times [s] and kinds of events, as in `dynstiction.Result`; shape (event,)."""
    event_derivatives: NDArray[np.float64]
    """Change of the time of each event per change of each parameter; shape (event, parameter)."""

    @property
    def conditioning(self) -> float:
        """The factor by which a small relative change of a parameter is larger in the samples.

        The largest change of a column at any sample, relative to its largest value, over the relative change of the parameter that
        matters most.
        """
        values = np.array([*self.parameters.values()])
        changes = [
            np.abs(self.derivatives[name] * values).max(initial=0.0) / scale
            for name, column in self.columns.items()
            if (scale := np.abs(column).max()) > 0.0
        ]
        return float(max(changes))


def derivatives(
    scene: DeckLike, keys: Iterable[str] | str | None = None, times: ArrayLike | None = None
) -> Derivatives:
    """How a run changes with its parameters: its samples and the times of its events.

    Parameters
    ----------
    scene : str, PathLike or Scene
        A deck or a scene of model 'full' or 'low_frequency' with an adaptive method.
    keys : str or iterable of str, optional
        Parameters of &system, &friction, &drive or &initial, as for `dynstiction.sweep`; by default all that the deck gives and
        that are not 0.
    times : array_like, optional
        Times of the samples [s], rising; shape (sample,). By default those of the run. The run ends with the last one.

    Returns
    -------
    Derivatives
        Samples, events and their derivatives.

    Raises
    ------
    DeckError, FileError, SolverError
        As for `dynstiction.run`; also for another model.
    UsageError
        If a key has no small share, the times do not rise, or the motion hangs on a release that just happens.

    Notes
    -----
    They are the exact derivatives of the numbers that the run has step by step, whatever `integrator.cycle_map` says. Those of an
    irregular motion grow without limit, as the motion itself loses what it began with: see
    `dynstiction.Derivatives.conditioning`. See docs/cycles.md.
    """
    whole = Scene(scene)
    at = np.asarray([] if times is None else times, float)
    if at.ndim != 1 or not (np.isfinite(at).all() and (np.diff(at) > 0.0).all() and (at >= 0.0).all()):
        raise UsageError(
            "times do not rise from 0 on: give one row of times [s], each later than the one before"
        )
    with _native.Session(whole.source, "derivatives", _names(whole, keys, OF_RUNS), at) as found:
        while not found.proceed():
            pass
        parameters, names = _parameters(found), [info.name for info in found.infos("columns")]
        # The values (column, sample), the time first, then as many of their changes for each parameter.
        values, *changes = found.numbers("samples").reshape(1 + len(parameters), len(names), -1)
        numbers = found.numbers("events")
        events = np.zeros(numbers.shape[1], EVENT_DTYPE)
        events["time"], events["kind"] = numbers[:2]
        return Derivatives(
            parameters,
            values[0],
            dict(zip(names[1:], values[1:], strict=True)),
            {
                name: np.array([each[place] for each in changes]).T
                for place, name in enumerate(names)
                if place
            },
            events,
            numbers[2:].T,
        )


def _parameters(found: _native.Session) -> dict[str, float]:
    """The parameters of derivatives, by ``group.key``."""
    cells, (values,) = found.table("parameters")
    return {key: value for (key,), value in zip(cells, values.tolist(), strict=True)}


def _names(scene: Scene, keys: Iterable[str] | str | None, groups: Iterable[str]) -> str:
    """Keys as ``group.key``; if none are given, all numbers of these groups that the scene gives and that are not 0."""
    if keys is None:
        given = scene.groups()
        return " ".join(
            f"{group}.{key}"
            for group in groups
            for key, value in given.get(group, {}).items()
            if isinstance(value, float) and value
        )
    return " ".join(full_key(name) for name in ([keys] if isinstance(keys, str) else keys))
