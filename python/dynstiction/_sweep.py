"""Many cases of one scene, on all cores."""

from __future__ import annotations

import os
import threading
import time
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from .errors import IncompleteWarning, UsageError
from .record import Info
from .scene import DeckLike, Group, Scene

if TYPE_CHECKING:
    import xarray

__all__ = ["sweep"]

NOT_RUN = -1
"""Result code of a case that has not been run."""

LONGEST_PIECE = 64
"""Cases that a thread takes at once, at most."""

PIECE_SECONDS = 0.02
"""Time that the cases which a thread takes at once last, as far as can be foreseen."""


def sweep(
    deck: DeckLike,
    parameters: Mapping[str, ArrayLike] | None = None,
    *,
    points: bool = False,
    threads: int | None = None,
    **groups: Group,
) -> xarray.Dataset:
    """Run a scene for many values of its parameters.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    parameters : mapping, optional
        Values by key, ``{"system.misalignment_deg": phi, "drive.velocity": V}``, in the deck's units: the sides
        of a grid. Without it the cases are those of the deck's ``&sweep``, whose list of points must be a CSV file.
    points : bool
        Whether the values, all of one length, are those of the cases one by one, not the sides of a grid.
    threads : int, optional
        Cores to use, at least 1; all by default. The results do not depend on it.
    **groups : mapping
        Overrides by group, as for `dynstiction.run`.

    Returns
    -------
    xarray.Dataset
        Summary of every case [SI units] with the parameters as coordinates (of a list: along ``case``),
        ``result_code`` (0 done, -1 not run), ``result_text`` (why a case failed) and ``wall_time`` [s].
        What a case does not have is NaN. Units are in the attributes. Time series are not kept, whatever
        ``sweep.keep`` says.

    Warns
    -----
    IncompleteWarning
        If some cases failed, or Ctrl-C stopped the sweep: what is done by then is returned.

    Raises
    ------
    DeckError
        If the scene or a value is refused.
    FileError
        If the list of points of the deck cannot be read.
    UsageError
        If nothing is varied, a list is not one of numbers, the lists of points have different lengths, or `threads`
        is not positive.

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
    axes = [(_key(key), _values(key, values)) for key, values in (parameters or {}).items()]
    if points and len({axis.size for _, axis in axes}) != 1:
        raise UsageError("points=True takes lists of one length")
    if threads is None:
        threads = len(os.sched_getaffinity(0))
    if threads < 1:
        raise UsageError(f"{threads} threads: give 1 or more, or None for all cores")
    with _native.Sweep(scene.text, scene.name, scene.settings, axes, points) as core:
        work = _Work(core)
        work.run(threads)
        return _dataset(core, work)


def _key(key: str) -> str:
    if not isinstance(key, str) or "\n" in key:
        raise UsageError(f"{key!r} is no key: name it as GROUP.KEY, like system.misalignment_deg")
    return key


def _values(key: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        axis = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError):
        raise UsageError(f"the values of {key!r} are no numbers: give a list of numbers") from None
    if axis.ndim != 1:
        raise UsageError(f"the values of {key!r} have {axis.ndim} dimensions: give a list of numbers")
    return axis


class _Work:
    """The cases of a sweep, dealt out to threads a few at a time."""

    def __init__(self, core: _native.Sweep) -> None:
        self._core = core
        self._lock = threading.Lock()
        self._next = 0
        self._stopped = False
        self._error: BaseException | None = None
        self.values = np.full((core.cases, len(core.quantities)), np.nan)
        self.codes = np.full(core.cases, NOT_RUN, dtype=np.int32)
        self.messages: dict[int, str] = {}

    def run(self, n_threads: int) -> None:
        threads = [
            threading.Thread(target=self._one_thread, args=(n_threads,), daemon=True)
            for _ in range(n_threads)
        ]
        try:
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        except KeyboardInterrupt:
            self._stopped = True
        finally:
            self._wait(threads)
        if self._error is not None:
            raise self._error
        self._warn()

    def _wait(self, threads: list[threading.Thread]) -> None:
        """Let the threads end, whatever has happened: they use the core, which is freed afterwards."""
        while any(thread.is_alive() for thread in threads):
            try:
                self._core.stop()
                for thread in threads:
                    if thread.is_alive():
                        thread.join()
            except KeyboardInterrupt:
                self._stopped = True

    def _one_thread(self, n_threads: int) -> None:
        count = 1
        try:
            while not self._stopped:
                with self._lock:
                    first = self._next
                    left = self._core.cases - first
                    # The less is left, and the longer a case takes, the smaller the pieces.
                    count = max(1, min(count, LONGEST_PIECE, left // (4 * n_threads)))
                    self._next += count
                if left <= 0:
                    return
                begun = time.perf_counter()
                values, codes, messages, done = self._core.run(first, count)
                passed = time.perf_counter() - begun
                self.values[first : first + done] = values
                self.codes[first : first + done] = codes
                self.messages.update(messages)
                count = int(min(LONGEST_PIECE, count * PIECE_SECONDS / passed))
        except BaseException as error:
            self._error = error
            self._stopped = True

    def _warn(self) -> None:
        if self._stopped:
            text = f"stopped after {np.count_nonzero(self.codes != NOT_RUN)} of {self._core.cases} cases"
        elif self.messages:
            case, message = min(self.messages.items())
            text = f"{len(self.messages)} of {self._core.cases} cases failed; the first, number {case}: {message}"
        else:
            return
        warnings.warn(text, IncompleteWarning, stacklevel=4)


def _dataset(core: _native.Sweep, work: _Work) -> xarray.Dataset:
    import xarray  # noqa: PLC0415  (optional)

    names = [info.name for info, _ in core.axes]
    dims, shape = (
        (["case"], [core.cases]) if core.is_list else (names, [values.size for _, values in core.axes])
    )
    coordinates = {
        info.name: ("case" if core.is_list else info.name, values, _about(info)) for info, values in core.axes
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
