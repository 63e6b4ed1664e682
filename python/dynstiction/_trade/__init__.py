"""Measured error against cost: which model, method and tolerance a scene needs."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import NDArray

from .._arguments import number, path_name, shown, text
from .._open import info_of, open_file, own_datasets, values_in
from .._progress import progress_bar
from ..errors import Error, FileError, UsageError, printable
from ..groups import Changes
from ..html import table
from ..record import Described, Table
from ..scene import DeckLike, Scene
from .advice import advice, advised_settings, cheapest, check_quantity
from .measure import RESOLUTION, Comparison
from .plan import Settings
from .quantities import QUANTITIES, Quantity
from .report import report

if TYPE_CHECKING:
    import xarray

__all__ = ["Trade", "open_trade", "trade"]

BAR = "{percentage:3.0f}%|{bar}| {n:.0f} of {total:.0f} s"

Column = NDArray[np.float64] | NDArray[np.str_]


@dataclass(frozen=True, repr=False, eq=False)
class Trade(Table[Any], Mapping[str, Any]):
    """Results of `trade`: a table with one row for each point.

    Row 0 is the reference. Row 1 is the run whose difference from the reference is the reference's error. The other rows are
    the candidates in the order in which they were planned, including those that were skipped or failed.

    Attributes
    ----------
    columns : Described of ndarray, shape (n,)
        ``role``, ``model``, ``form``, ``method``, ``contact``, ``cycle_map``, ``text`` (str); ``rtol``, ``step`` [s],
        ``v_smooth`` [m/s], ``seconds`` [s], ``steps``, ``rhs``, ``newton``, ``result_code``, and ``error_<quantity>`` [1], NaN where
        there is none.
    report : str
        The table as ``dynstiction trade --all`` prints it; empty if it was read from a file.
    recommendation : str
        Cheapest settings that reach the accuracy, as namelist groups; empty if there are none or no accuracy was given.
    settings : dict
        The same settings by group, for ``dynstiction.run(deck, **trade.settings)``.
    shortfall : str
        Why there is no recommendation.
    """

    columns: Described[Column]
    report: str = ""
    recommendation: str = ""
    settings: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    shortfall: str = ""

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Quantities that the scene has."""
        names = (name for name in self.columns if name.startswith("error_"))
        return tuple(n.removeprefix("error_") for n in names if not np.isnan(self.error(n[6:])[1]))

    @property
    def done(self) -> NDArray[np.bool_]:
        """Whether each row is a candidate that was measured."""
        return np.asarray((self["role"] == "candidate") & (self["result_code"] == 0))

    def error(self, quantity: str) -> NDArray[np.float64]:
        """Errors of a quantity in all rows, NaN where there is none.

        Parameters
        ----------
        quantity : str
            One of `quantities`.
        """
        return self.number(f"error_{quantity}")

    def number(self, name: str) -> NDArray[np.float64]:
        """A column of numbers, shape (n,).

        Parameters
        ----------
        name : str
            Of the column.

        Raises
        ------
        UsageError
            If there is no such column, or it holds texts.
        """
        column = self[name]
        if column.dtype.kind not in "iuf":
            raise UsageError(f"the column '{name}' holds texts: trade['{name}'] gives them")
        return np.asarray(column, dtype=np.float64)

    def floor(self, quantity: str) -> float:
        """Smallest error that counts as measured: 100 times the error of the reference.

        Parameters
        ----------
        quantity : str
            One of `quantities`.
        """
        return max(RESOLUTION * float(self.error(quantity)[1]), float(np.finfo(float).eps))

    def to_xarray(self) -> xarray.Dataset:
        """The table as an `xarray.Dataset` over ``point``."""
        return self._dataset("point", {})

    def _repr_html_(self) -> str:
        title, shown = repr(self).partition("\n")[0].strip("<>"), [name for name in self if name != "text"]
        columns = [
            [f"{value:.3g}" if isinstance(value, float) else str(value) for value in self[name].tolist()]
            for name in shown
        ]
        points = table(shown, zip(*columns, strict=True))
        return (
            f"<div><b>{escape(title)}</b><pre>{escape(self.recommendation or self.shortfall)}</pre>"
            f"<details><summary>{len(columns[0])} points</summary>{points}</details></div>"
        )

    def __repr__(self) -> str:
        n, done = len(self["role"]) - 2, int(np.count_nonzero(self.done))
        head = printable(f"<Trade: {n} candidates, {done} measured: {', '.join(self.quantities)}")
        return "\n".join(part for part in (head, self.recommendation or self.shortfall) if part) + ">"


def trade(
    deck: DeckLike,
    accuracy: float | None = None,
    budget: float = 10.0,
    *,
    quantity: str = "",
    quantities: Mapping[str, Quantity] | None = None,
    candidates: Iterable[Settings] = (),
    progress: bool | None = None,
    **changes: Unpack[Changes],
) -> Trade:
    """Measure error against cost of models, methods and tolerances on a scene.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    accuracy : float, optional
        Look for the cheapest settings whose errors are below it, with a margin of 3.
    budget : float
        Wall time [s].
    quantity : str
        The quantity to which the accuracy applies, or ``"all"``; by default final_elongation, period, peak_force and
        creep_velocity, if the scene has them, and those of `quantities`.
    quantities : dict of callable, optional
        Quantities of your own by name: each is a function that takes the `Result` of a run, with samples every
        ``output.interval``, and returns a number or an array. The error is the norm of the difference from the reference over
        the norm of the reference. If the function returns NaN, or raises a `KeyError` or an `Error` of the package (for a column
        or a value of the summary that the run does not have), the run does not have this quantity.
    candidates : iterable of dict, optional
        Settings of your own by group, as for `dynstiction.run`; they are tried first, with everything else as in the scene.
    progress : bool, optional
        Whether to show a bar with the time used of the budget; by default as for `dynstiction.run`.
    **changes : value of a key, or Setup, System, Friction, Drive, Initial, Integrator, Output, or mapping
        Overrides of the deck, as for `dynstiction.run`.

    Returns
    -------
    Trade
        All points, and the recommended settings.

    Raises
    ------
    DeckError
        If the scene is refused.
    UsageError
        If accuracy, budget, quantity, quantities or candidates are not valid.
    Error
        If the budget is too small for the reference, or there is no reference.

    Examples
    --------
    >>> result = trade("inputs/fig3.nml", accuracy=1e-3)                   # doctest: +SKIP
    >>> print(result.recommendation)                                       # doctest: +SKIP
    >>> run("inputs/fig3.nml", **result.settings)                          # doctest: +SKIP
    >>> trade("inputs/fig3.nml", quantities={"work": lambda run: run["friction"] @ run["X_rate"]},
    ...       candidates=[{"integrator": {"method": "radau9", "rtol": 3e-6}}])  # doctest: +SKIP
    """
    wanted = None if accuracy is None else number("accuracy", accuracy, checked=False)
    if wanted is not None and not 0.0 < wanted <= 1.0:
        raise UsageError(f"accuracy={shown(accuracy)}: it must be > 0 and <= 1")
    comparison = begin(Scene(deck, **changes), wanted, budget, quantity, quantities, candidates)
    with progress_bar(progress, comparison.budget, BAR) as show:
        for _ in comparison.steps():
            show(min(comparison.budget, comparison.elapsed))
    recommendation, settings, shortfall = "", {}, ""
    if wanted is not None:
        try:
            best = cheapest(comparison, wanted, quantity)
            recommendation, settings = advice(comparison, best), advised_settings(comparison, best)
        except Error as error:
            shortfall = str(error)
    return Trade(comparison.table(), report(comparison, quantity), recommendation, settings, shortfall)


def begin(
    scene: Scene,
    accuracy: float | None,
    budget: float,
    quantity: str,
    quantities: Mapping[str, Quantity] | None = None,
    candidates: Iterable[Settings] = (),
) -> Comparison:
    """A comparison that has not begun, if all arguments are valid: see `trade`."""
    budget, quantity = number("budget", budget, above=0.0, units="s"), text("quantity", quantity)
    own = {} if quantities is None else quantities
    if not isinstance(own, Mapping):
        raise UsageError(f"quantities={shown(own)}: give functions of a Result by name")
    for name, function in own.items():
        known = (*QUANTITIES, "all")
        if not (isinstance(name, str) and name.isidentifier() and name not in known and callable(function)):
            raise UsageError(
                f"quantities: {shown(name)}: give functions of a Result, each by a name that is an identifier and not taken"
            )
    tried = list(candidates) if isinstance(candidates, Iterable) else [candidates]
    for settings in tried:
        groups = settings.values() if isinstance(settings, Mapping) else [settings]
        if not all(isinstance(keys, Mapping) for keys in groups):
            raise UsageError(
                f"candidates: {shown(settings)}: give settings by group, like {{'integrator': {{'rtol': 1e-5}}}}"
            )
    if accuracy is not None:
        check_quantity(quantity, own)
    return Comparison(scene, budget, own, tried)


def open_trade(path: str | os.PathLike[str]) -> Trade:
    """Points in a file written by ``dynstiction trade``.

    Parameters
    ----------
    path : str or PathLike
        The file.

    Raises
    ------
    FileError
        If the file is missing or damaged, or does not hold points of `trade`.
    UsageError
        If `path` is not a path.
    """
    path = path_name(path)
    with open_file(path) as file:
        if "trade" not in file:
            raise FileError(f"{path}: holds no comparison of dynstiction trade")
        entries = []
        points = values_in(file, "trade/point").shape
        for name, dataset in own_datasets(file["trade"], 1):
            if dataset.shape != points:
                continue
            info, values = info_of(name, dataset), values_in(file["trade"], name)
            if values.dtype.kind == "O":
                values = values.astype(np.str_)
            if name.startswith("error_"):
                values = np.where(values < 0.0, np.nan, values)
            entries.append((info, values))
    return Trade(Described(entries, "table"))
