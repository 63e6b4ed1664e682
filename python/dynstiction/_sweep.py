"""Many cases of one scene, on all cores."""

from __future__ import annotations

import os
import threading
import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._progress import progress_bar
from .errors import IncompleteWarning, UsageError
from .groups import Groups
from .record import Info
from .scene import DeckLike, Scene

if TYPE_CHECKING:
    import xarray

__all__ = ["sweep"]

NOT_RUN = -1
"""Result code of a case that has not been run."""

LONGEST_PIECE = 64
"""Cases that a thread takes at once, at most."""


def sweep(
    deck: DeckLike,
    parameters: Mapping[str, ArrayLike] | None = None,
    *,
    points: bool = False,
    threads: int | None = None,
    progress: bool | None = None,
    **groups: Unpack[Groups],
) -> xarray.Dataset:
    """Run a scene for many values of its parameters.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    parameters : mapping, optional
        Values by key, ``{"system.misalignment_deg": phi, "drive.velocity": V}``, in the deck's units: the sides
        of a grid. Without it the grid is that of the deck's ``&sweep``.
    points : bool
        Whether the values, all of one length, are those of the cases one by one, not the sides of a grid.
    threads : int, optional
        Cores to use; all by default. The results do not depend on it.
    progress : bool, optional
        Whether to show the number of cases done as a bar; by default as for `dynstiction.run`.
    **groups : Setup, System, Friction, Drive, Initial, Integrator, Output, Sweep, or mapping
        Overrides by group, as for `dynstiction.run`.

    Returns
    -------
    xarray.Dataset
        Summary of every case [SI units] with the parameters as coordinates (of a list: along ``case``),
        ``result_code`` (0 done, -1 not run), ``result_text`` (why a case failed) and ``wall_time`` [s].
        What a case does not have is NaN. Units are in the attributes.

    Warns
    -----
    IncompleteWarning
        If some cases failed, or Ctrl-C stopped the sweep: what is done by then is returned.

    Raises
    ------
    DeckError
        If the scene or a value is refused.
    UsageError
        If nothing is varied, or the lists have different lengths.

    Notes
    -----
    The model 'auto' is refused: a map would mix models. Other threads of the interpreter go on meanwhile.

    Examples
    --------
    >>> data = ds.sweep("inputs/low_frequency.nml",
    ...                 {"system.misalignment_deg": np.linspace(1, 8, 64)})      # doctest: +SKIP
    >>> data["period"].plot()                                                    # doctest: +SKIP
    """
    scene = Scene(deck, **groups)
    axes = [(key, np.atleast_1d(np.asarray(v, dtype=np.float64))) for key, v in (parameters or {}).items()]
    if any(axis.ndim != 1 for _, axis in axes):
        raise UsageError("each parameter takes a list of values")
    if points and len({axis.size for _, axis in axes}) > 1:
        raise UsageError("points=True takes lists of one length")
    with _native.Sweep(scene.source, axes, points) as core:
        work = _Work(core)
        with progress_bar(progress, core.cases, BAR) as show:
            work.run(threads or len(os.sched_getaffinity(0)), show)
        work.warn()
        return _dataset(core, work, points)


BAR = "{percentage:3.0f}%|{bar}| {n:.0f} of {total:.0f} cases [{elapsed}<{remaining}]"


class _Work:
    """The cases of a sweep, dealt out to threads a few at a time."""

    def __init__(self, core: _native.Sweep) -> None:
        self._core = core
        self._lock = threading.Lock()
        self._next = 0
        self._done = 0
        self._stopped = False
        self._error: BaseException | None = None
        self.values = np.full((core.cases, len(core.quantities)), np.nan)
        self.codes = np.full(core.cases, NOT_RUN, dtype=np.int32)
        self.messages: dict[int, str] = {}

    def run(self, n_threads: int, show: Callable[[float], None]) -> None:
        threads = [
            threading.Thread(target=self._one_thread, args=(n_threads,), daemon=True)
            for _ in range(n_threads)
        ]
        for thread in threads:
            thread.start()
        try:
            for thread in threads:
                while thread.is_alive():
                    thread.join(_native.CHUNK_SECONDS)
                    show(self._done)
            show(self._done)
        except KeyboardInterrupt:
            self._stopped = True
            self._core.stop()
            for thread in threads:
                thread.join()
        if self._error is not None:
            raise self._error

    def _one_thread(self, n_threads: int) -> None:
        try:
            while not self._stopped:
                with self._lock:
                    first = self._next
                    left = self._core.cases - first
                    count = max(1, min(LONGEST_PIECE, left // (4 * n_threads)))
                    self._next += count
                if left <= 0:
                    return
                values, codes, messages, done = self._core.run(first, count)
                self.values[first : first + done] = values
                self.codes[first : first + done] = codes
                self.messages.update(messages)
                with self._lock:
                    self._done += done
        except BaseException as error:
            self._error = error

    def warn(self) -> None:
        """Say if not all is done."""
        if self._stopped:
            text = f"stopped after {np.count_nonzero(self.codes != NOT_RUN)} of {self._core.cases} cases"
        elif self.messages:
            case, message = min(self.messages.items())
            text = f"{len(self.messages)} of {self._core.cases} cases failed; the first, number {case}: {message}"
        else:
            return
        warnings.warn(text, IncompleteWarning, stacklevel=3)


def _dataset(core: _native.Sweep, work: _Work, points: bool) -> xarray.Dataset:
    import xarray  # noqa: PLC0415  (optional)

    names = [info.name for info, _ in core.axes]
    dims, shape = (["case"], [core.cases]) if points else (names, [values.size for _, values in core.axes])
    coordinates = {
        info.name: ("case" if points else info.name, values, _about(info)) for info, values in core.axes
    }
    variables: dict[str, tuple[list[str], NDArray[np.generic], dict[str, str]]] = {
        info.name: (dims, work.values[:, i].reshape(shape), _about(info))
        for i, info in enumerate(core.quantities)
    }
    texts = np.array([work.messages.get(i, "") for i in range(core.cases)], dtype=object)
    about = {"units": "1", "long_name": "0 done, -1 not run, else why it failed"}
    variables["result_code"] = (dims, work.codes.reshape(shape), about)
    variables["result_text"] = (dims, texts.reshape(shape), {"long_name": "why a case failed"})
    return xarray.Dataset(variables, coordinates)


def _about(info: Info) -> dict[str, str]:
    return {"units": info.units, "long_name": info.long_name}
