"""Many cases of one scene, on all cores."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arguments import flag, reals, shown, whole
from ._interrupt import interrupted
from ._native import Info
from ._progress import progress_bar
from ._sweep_work import Work
from .errors import DeckError, StiffnessWarning, UsageError
from .groups import Changes
from .scene import DeckLike, Scene

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray

Floats: TypeAlias = NDArray[np.float64]
Values: TypeAlias = Floats | NDArray[np.int32]
Axis: TypeAlias = tuple[Info, Floats]
"""A parameter and its values: along one side of a grid, or for each case of a list."""

CYCLE_COUNT = Info("cycle_count", "1", "cycles that are kept of the case")

ORIGIN = ("version", "git_revision")
"""Attributes of a sweep beside its deck: which program computed it."""

BAR = "{percentage:3.0f}%|{bar}| {n:.0f} of {total:.0f} cases [{elapsed}<{remaining}]"


def sweep(
    deck: DeckLike,
    parameters: Mapping[str, ArrayLike] | None = None,
    *,
    points: bool = False,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: bool | None = None,
    **changes: Unpack[Changes],
) -> xarray.Dataset:
    """Run a scene for many values of its parameters.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    parameters : mapping, optional
        Values by key, ``{"misalignment_deg": phi, "drive.velocity": V}``, in the deck's units: the sides
        of a grid. The group of a key may be left out. Without `parameters` the grid, or the list of points, is that of the deck's
        ``&sweep``.
    points : bool
        Whether the values, all of one length, are those of the single cases, not the sides of a grid.
    threads : int, optional
        Number of cores, at least 1; by default all. The results do not depend on it.
    executor : concurrent.futures.Executor, optional
        Executor that runs the cases, in place of threads of this process: a ``ProcessPoolExecutor``, the
        ``client.get_executor()`` of dask.distributed, an ``MPIPoolExecutor`` of mpi4py, .... The package must be installed where
        the executor runs the cases, and files that the deck names must exist there. The results do not depend on the executor.
    progress : bool, optional
        Whether to show a bar with the number of finished cases; by default as for `dynstiction.run`.
    **changes : value of a key, or Setup, System, Friction, Drive, Initial, Integrator, Output, Sweep, or mapping
        Overrides of the deck, as for `dynstiction.run`.

    Returns
    -------
    xarray.Dataset
        Summary of every case [SI units] with the keys, without their groups, as coordinates (for a list along ``case``),
        ``result_code`` (0 done, -1 not run), ``result_text`` (why a case failed) and ``wall_time`` [s].
        Values that a case does not have are NaN. Units are in the attributes; the attribute ``deck`` is the deck with every
        key as used, ``version`` and ``git_revision`` are those of the program. With ``sweep.keep = 'cycles'`` there are also ``cycle_period``, ``cycle_peak_force``, ... with the
        additional dimension ``cycle``: the last cycles that the means include, the oldest first, at most ``sweep.cycles`` of
        them, and their number ``cycle_count``. Time series are not kept.

    Warns
    -----
    IncompleteWarning
        If some cases failed.
    StiffnessWarning
        If an explicit method will need a million steps or more, and an implicit one far fewer.

    Raises
    ------
    DeckError
        If the scene or a value is refused.
    FileError
        If the list of points of the deck cannot be read.
    UsageError
        If nothing is varied, a list does not contain numbers, the lists of points have different lengths, `threads`
        is not positive, `executor` is not an executor, or ``sweep.keep = 'series'``: only ``dynstiction run`` keeps time series.
    KeyboardInterrupt
        On Ctrl-C; its attribute ``partial`` is the dataset with the finished cases.
    MemoryError
        If the results of all cases do not fit into the memory.

    Notes
    -----
    The model 'auto' is refused: a map would mix models. Other threads of the interpreter continue during the sweep.

    An executor gets tasks that last about half a second each, three for each of its workers at a time. On Ctrl-C waiting tasks
    are cancelled; tasks that run in another process or on another machine end there without being stopped.

    Examples
    --------
    >>> data = ds.sweep("inputs/low_frequency.nml",
    ...                 {"misalignment_deg": np.linspace(1, 8, 64)})             # doctest: +SKIP
    >>> data["period"].plot()                                                    # doctest: +SKIP
    >>> with concurrent.futures.ProcessPoolExecutor() as pool:                   # doctest: +SKIP
    ...     data = ds.sweep("inputs/fig3.nml", {"mu_0": [0.2, 0.3]}, executor=pool)
    """
    scene = Scene(deck, **changes)
    if not (parameters is None or isinstance(parameters, Mapping)):
        raise UsageError(f"parameters = {shown(parameters)}: a mapping, {{'misalignment_deg': values}}")
    axes = [(full_key(key), _values(key, values)) for key, values in (parameters or {}).items()]
    points = flag("points", points)
    if points and len({axis.size for _, axis in axes}) != 1:
        raise UsageError("points=True takes lists of one length")
    if executor is not None and threads is not None:
        raise UsageError("threads and executor: give one of them; an executor has its own number of workers")
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise UsageError(
            f"executor = {shown(executor)}: give a concurrent.futures.Executor, like ProcessPoolExecutor(), client.get_executor() "
            "of dask.distributed, or MPIPoolExecutor() of mpi4py"
        )
    import xarray  # noqa: F401, PLC0415  (slow to import: before the cases, so that none are lost if it cannot be)

    threads = len(os.sched_getaffinity(0)) if threads is None else whole("threads", threads, least=1)
    with _native.Sweep(scene.source, axes, points) as core:
        if scene.groups().get("sweep", {}).get("keep") == "series":
            raise UsageError(
                "sweep.keep = 'series': this function keeps no time series; give sweep={'keep': 'summary'}, "
                "or run the deck with the command dynstiction run"
            )
        if note := core.text("stiffness_note"):
            warnings.warn(note, StiffnessWarning, stacklevel=2)
        work = Work(core, scene.source, threads, executor)
        with progress_bar(progress, core.cases, BAR) as show:
            work.run(show)
        if work.stopped:
            done = f"{np.count_nonzero(work.codes != _native.NOT_RUN)} of {core.cases} cases"
            raise interrupted(
                f"stopped after {done}; `partial` has their results", lambda: _data_of(core, work)
            )
        data = _data_of(core, work)
    work.warn(stacklevel=2)
    return data


def _data_of(core: _native.Sweep, work: Work) -> xarray.Dataset:
    """Results of the cases."""
    columns = [(info, work.values[:, i]) for i, info in enumerate(core.quantities)]
    if core.most_cycles > 0:
        columns.append((CYCLE_COUNT, work.counts))
        columns += [
            (info, work.cycles[:, :, i]) for i, info in enumerate(map(of_cycle, core.cycle_quantities))
        ]
    origin = _native.origin()
    about_all = {"deck": core.text("resolved")} | {name: origin[name] for name in ORIGIN}
    return dataset_of(core.axes, columns, work.codes, work.messages, core.is_list, about_all)


def of_cycle(info: Info) -> Info:
    """A quantity of a single cycle, named like its mean in the summary."""
    return info._replace(name=f"cycle_{info.name}")


def full_key(key: str) -> str:
    """``group.key`` of a key that is given with or without its group."""
    if not isinstance(key, str) or not key.isprintable():
        raise UsageError(
            f"{shown(key)} is not a key: write it like misalignment_deg or system.misalignment_deg"
        )
    group = _native.group_of(key)
    if not group:
        raise DeckError(_native.unknown_key(key))
    return f"{group}.{key.rpartition('.')[2]}"


def _values(key: str, values: ArrayLike) -> NDArray[np.float64]:
    axis = np.atleast_1d(reals(f"the list of {key!r}", values, checked=False))
    if axis.ndim != 1:
        raise UsageError(f"the values of {key!r} have {axis.ndim} dimensions: give a list of numbers")
    return axis


def dataset_of(
    axes: Sequence[Axis],
    values: Sequence[tuple[Info, Values]],
    codes: NDArray[np.int32],
    messages: Mapping[int, str],
    is_list: bool,
    about_all: Mapping[str, str],
) -> xarray.Dataset:
    """A sweep as a dataset: `values`, `codes` and cycles (case, cycle) by case, `messages` by number of the case from 0."""
    import xarray  # noqa: PLC0415  (slow to import)

    # Names of keys are unique without their groups.
    axes = [(info._replace(name=info.name.rpartition(".")[2]), axis) for info, axis in axes]
    dims = ["case"] if is_list else [info.name for info, _ in axes]
    shape = [codes.size] if is_list else [axis.size for _, axis in axes]
    coordinates = {info.name: ("case" if is_list else info.name, axis, _about(info)) for info, axis in axes}
    variables: dict[str, tuple[list[str], NDArray[np.generic], dict[str, str]]] = {
        info.name: (
            [*dims, "cycle"][: len(dims) + column.ndim - 1], column.reshape(*shape, *column.shape[1:]), _about(info)
        )
        for info, column in values
    }  # fmt: skip
    texts = np.array([messages.get(i, "") for i in range(codes.size)], dtype=object)
    about = {"units": "1", "long_name": "0 done, -1 not run, else why it failed"}
    variables["result_code"] = (dims, codes.reshape(shape), about)
    variables["result_text"] = (dims, texts.reshape(shape), {"long_name": "why a case failed"})
    return xarray.Dataset(variables, coordinates, about_all)


def _about(info: Info) -> dict[str, str]:
    return {"units": info.units, "long_name": info.long_name}
