"""One run, from a deck to its result."""

from __future__ import annotations

import warnings
from typing import Unpack

from numpy.typing import ArrayLike

from .errors import SamplingWarning, StiffnessWarning
from .groups import Changes
from .result import Result
from .scene import DeckLike
from .simulation import Simulation


def run(
    deck: DeckLike,
    *,
    times: ArrayLike | None = None,
    progress: bool | None = None,
    **changes: Unpack[Changes],
) -> Result:
    """Integrate a scene.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    times : array_like, optional
        Times of the samples [s], ascending and within the run, in place of those every ``output.interval``. The motion is computed
        at any time, so that these samples are as accurate as others. If a run ends before `t_end` because it has settled, there
        are no samples at the times after its end.
    progress : bool, optional
        Whether to show the simulated time as a bar (needs ``tqdm``). By default there is a bar only on a terminal or in a
        notebook, after a second, and if tqdm is installed.
    **changes : value of a key, or Setup, System, Friction, Drive, Initial, Integrator, Output, or mapping
        Overrides of the deck: keys, ``misalignment_deg=2.0`` or ``**{"system.misalignment_deg": 2.0}``, and groups,
        ``system={"misalignment_deg": 2.0}, drive={"velocity": 2e-3}``. Groups, keys,
        units and defaults are the deck's: see ``dynstiction template``. None removes a key from the deck; a dataclass
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
    StiffnessWarning
        If an explicit method will need a million steps or more, and an implicit one far fewer.

    Raises
    ------
    DeckError
        If the scene is refused; the text lists all its faults with line or key, and what to do.
    SolverError
        If the solver gave up; its ``result`` holds the results until then.
    FileError
        If the deck cannot be read.
    UsageError
        If a name is not a key or group, or `times` do not ascend within the run.
    KeyboardInterrupt
        On Ctrl-C; its attribute ``partial`` is the result until then, which is not `complete`.

    See Also
    --------
    Simulation : the same, step by step.

    Notes
    -----
    Runs in several threads do not disturb each other, and other threads continue during a run.

    Examples
    --------
    >>> result = run("inputs/fig3.nml", misalignment_deg=2.0)   # doctest: +SKIP
    >>> result.time[-1], result["u_x"].max(), result.sticks()               # doctest: +SKIP
    """
    with Simulation(deck, times=times, **changes) as simulation:
        if times is None and (note := simulation._core.sampling_note):
            warnings.warn(note, SamplingWarning, stacklevel=2)
        if note := simulation._core.stiffness_note:
            warnings.warn(note, StiffnessWarning, stacklevel=2)
        return simulation._finish(progress, stacklevel=4)


def run_sampled(deck: DeckLike, *, progress: bool | None = None, **changes: Unpack[Changes]) -> Result:
    """As `run`, without warnings about samples, for callers that choose the samples for a purpose."""
    with Simulation(deck, **changes) as simulation:
        return simulation._finish(progress, stacklevel=5)
