"""One run, from a deck to its result."""

from __future__ import annotations

import warnings
from typing import Unpack

from .errors import SamplingWarning
from .groups import Groups
from .result import Result
from .scene import DeckLike
from .simulation import Simulation

__all__ = ["run", "run_sampled"]


def run(deck: DeckLike, *, progress: bool | None = None, **groups: Unpack[Groups]) -> Result:
    """Integrate a scene.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    progress : bool, optional
        Whether to show the simulated time as a bar (needs ``tqdm``); by default only on a terminal or in a notebook,
        after a second, and if tqdm is installed.
    **groups : Setup, System, Friction, Drive, Initial, Integrator, Output, or mapping
        Overrides by group, ``system={"misalignment_deg": 2.0}, drive={"velocity": 2e-3}``. Groups, keys,
        units and defaults are the deck's: see ``dynstiction template``. None takes a key out of the deck; a dataclass
        (``system=ds.System(...)``) replaces the group.

    Returns
    -------
    Result
        Time series [SI units], events, summary and statistics. Nothing is written to disk.

    Warns
    -----
    IncompleteWarning
        If the run was stopped at ``output.wall_limit``; the result ends there.
    SamplingWarning
        If the scene has a fast oscillation that ``output.interval`` is too long to show.

    Raises
    ------
    DeckError
        If the scene is refused; the text names all its faults with line or key, and remedy.
    SolverError
        If the solver gave up; its ``result`` holds what was computed until then.
    FileError
        If the deck cannot be read.

    See Also
    --------
    Simulation : the same, step by step.

    Notes
    -----
    Runs of several threads do not disturb each other, and other threads go on while one runs.

    Examples
    --------
    >>> result = run("inputs/fig3.nml", system={"misalignment_deg": 2.0})   # doctest: +SKIP
    >>> result.time[-1], result["u_x"].max(), result.sticks()               # doctest: +SKIP
    """
    with Simulation(deck, **groups) as simulation:
        if note := simulation._core.sampling_note:
            warnings.warn(note, SamplingWarning, stacklevel=2)
        return simulation._finish(progress, stacklevel=4)


def run_sampled(deck: DeckLike, *, progress: bool | None = None, **groups: Unpack[Groups]) -> Result:
    """As `run`, of a caller that has chosen the samples for a purpose: no word about them."""
    with Simulation(deck, **groups) as simulation:
        return simulation._finish(progress, stacklevel=5)
