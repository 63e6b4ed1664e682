"""One run, from a deck to its result."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

import numpy as np

from . import _native
from .errors import IncompleteWarning, SolverError, UsageError, error_for
from .record import EVENT_DTYPE, Described, Info
from .result import Result
from .scene import DeckLike, Group, Scene

__all__ = ["run"]

CHUNK_SECONDS = 0.05
"""Wall time between two looks at Ctrl-C."""

STOPPED_EARLY = 75


def run(deck: DeckLike, *, progress: bool = False, **groups: Group) -> Result:
    """Integrate a scene.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    progress : bool
        Whether to show the simulated time as a bar (needs ``tqdm``).
    **groups : mapping
        Overrides by group, ``system={"misalignment_deg": 2.0}, drive={"velocity": 2e-3}``. Groups, keys,
        units and defaults are the deck's: see ``dynstiction template``. None takes a key out of the deck.

    Returns
    -------
    Result
        Time series [SI units], events, summary and statistics. Nothing is written to disk.

    Warns
    -----
    IncompleteWarning
        If the run was stopped at ``output.wall_limit``; the result ends there.

    Raises
    ------
    DeckError
        If the scene is refused; the text names all its faults with line and remedy.
    SolverError
        If the solver gave up; its ``result`` holds what was computed until then.
    FileError
        If the deck cannot be read.

    Notes
    -----
    Runs of several threads do not disturb each other, and other threads go on while one runs.

    Examples
    --------
    >>> result = run("inputs/fig3.nml", system={"misalignment_deg": 2.0})   # doctest: +SKIP
    >>> result.time[-1], result["u_x"].max(), result.sticks()               # doctest: +SKIP
    """
    scene = Scene(deck, **groups)
    with _native.Run(scene.text, scene.name, scene.settings) as core, _progress(progress, core) as show:
        samples = [np.empty((0, len(core.columns)))]
        events = [np.empty(0, dtype=EVENT_DTYPE)]
        finished = False
        while not finished:
            finished, rows, time, kind = core.advance(CHUNK_SECONDS)
            samples.append(rows)
            events.append(np.empty(time.size, dtype=EVENT_DTYPE))
            events[-1]["time"], events[-1]["kind"] = time, kind
            if rows.size:
                show(rows[-1, 0])
        code, text = core.outcome()
        result = Result(
            columns=Described(
                (info, np.concatenate([rows[:, i] for rows in samples]))
                for i, info in enumerate(core.columns)
            ),
            events=np.concatenate(events),
            summary=Described(core.summary()),
            statistics=Described(map(_counted, core.statistics())),
            parameters=Described(core.parameters()),
            attributes=_attributes(scene, core, code, text),
            deck=scene.text,
            resolved_deck=core.resolved_deck(),
        )
    if code == STOPPED_EARLY:
        warnings.warn(text, IncompleteWarning, stacklevel=2)
    elif code != 0:
        error = error_for(code, text)
        if isinstance(error, SolverError):
            error.result = result
        raise error
    return result


def _counted(entry: tuple[Info, float]) -> tuple[Info, float]:
    info, value = entry
    return info, int(value) if info.units == "1" else value


def _attributes(scene: Scene, core: _native.Run, code: int, text: str) -> dict[str, str | int]:
    choice = core.model_choice()
    return {
        "program": "dynstiction",
        **_native.build_info()._asdict(),
        "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "deck_sha256": hashlib.sha256(scene.text.encode("utf-8", "surrogateescape")).hexdigest(),
        "model": core.model(),
        "method": core.method(),
        **({"model_choice": choice} if choice else {}),
        "result_code": code,
        "result_text": text,
        "complete": int(code == 0),
    }


@contextmanager
def _progress(wanted: bool, core: _native.Run) -> Iterator[Callable[[float], None]]:
    if not wanted:
        yield lambda time: None
        return
    try:
        from tqdm.auto import tqdm  # type: ignore[import-untyped]  # noqa: PLC0415  (optional)
    except ImportError as error:
        raise UsageError("progress=True needs tqdm: pip install tqdm") from error
    (t_end,) = (value for info, value in core.parameters() if info.name == "t_end")
    form = "{percentage:3.0f}%|{bar}| t = {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]"
    with tqdm(total=t_end, bar_format=form) as bar:

        def show(time: float) -> None:
            bar.update(time - bar.n)

        yield show
