"""What the cycle of a rig hangs on: derivatives with respect to the parameters, without further runs (docs/cycles.md)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._sweep import full_key
from .scene import DeckLike, Scene

__all__ = ["Sensitivity", "sensitivity"]

GROUPS = ("system", "friction", "drive")
"""Groups of the parameters on which a cycle hangs."""


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
        result: NDArray[np.float64] = self.derivatives * np.array([*self.parameters.values()]) / measures
        return result

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
    if keys is None:
        given = whole.groups()
        keys = [
            f"{group}.{key}"
            for group in GROUPS
            for key, value in given.get(group, {}).items()
            if isinstance(value, float) and value
        ]
    names = [keys] if isinstance(keys, str) else list(keys)
    with _native.Sensitivity(whole.source, [full_key(name) for name in names]) as found:
        return Sensitivity(
            dict(zip(found.keys, found.parameters.tolist(), strict=True)),
            dict(zip([info.name for info in found.quantities], found.values.tolist(), strict=True)),
            found.derivatives,
        )
