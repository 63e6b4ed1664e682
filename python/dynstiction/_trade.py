"""Measured error against cost: which model, method and tolerance a scene needs.

A candidate is the scene with other settings, computed by `dynstiction.run`. Its errors are the differences of what the run shows
from a reference, which is computed step by step with a small tolerance, and whose own error is the difference from another method.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Unpack, cast

import numpy as np
import pandas as pd  # type: ignore[import-untyped]
from matplotlib.figure import Figure
from numpy.typing import NDArray

from . import _native
from ._arguments import names_in, number
from ._progress import progress_bar
from ._run import run
from .deck_text import deck_from, setting_value
from .errors import DeckError, Error, UsageError
from .groups import Changes
from .record import number_shown
from .result import Result
from .scene import DeckLike, Scene, used_settings
from .stick_slip import first_release

Settings = dict[str, dict[str, Any]]
"""Values by group and key; None removes a key."""

USUAL = ("elongation", "period", "peak_force", "creep_velocity")
"""The quantities that users need most often."""
QUANTITIES = (*USUAL, "slip_velocity", "slip_length", "max_X_rate", "sticks")
"""The quantities in the table."""
MARGIN, RESOLUTION = 3.0, 100.0
"""Settings are taken if MARGIN times their error is below the accuracy; RESOLUTION times the error of the reference is known."""
WORST_REFERENCE, ROUNDOFF = 1e-2, 10.0 * float(np.finfo(float).eps)
"""Largest error of the reference in a quantity that is used, and the smallest one: two runs may agree by chance."""
TOLERANCES = (1e-6, 1e-4, 1e-8, 1e-3, 1e-5, 1e-10, 1e-7, 1e-9, 1e-11)
"""The most informative first."""
RTOL, NO_TIME = ", rtol ", "the budget did not suffice"
"""What is before the tolerance of settings in words, and the outcome of those that were not measured."""
SHARES = (0.08, 1.0)
"""Of the budget left: what a candidate may take in each round."""


class _NoTimeError(Error):
    exit_status = _native.STOPPED_EARLY


@dataclass(frozen=True, repr=False, eq=False)
class Trade:
    """Results of `trade`.

    Attributes
    ----------
    table : pandas.DataFrame
        A row for each candidate in the order of the trials: ``settings``, ``seconds``, ``steps``, ``rhs``, ``newton``, ``outcome``
        ('done', or why there is no result), and a column with the error of each quantity of the scene [1].
    candidates : list of dict
        The settings of each row, as for ``dynstiction.run(deck, **settings)``; None removes a key without use.
    reference_error : dict of float
        The error of the reference in each quantity.
    counted : list of str
        The quantities to which an accuracy applies.
    notes : str
        What limits the errors: an irregular motion, or its conditioning.
    """

    table: pd.DataFrame
    candidates: list[Settings]
    reference_error: dict[str, float]
    counted: list[str]
    notes: str

    @property
    def done(self) -> pd.DataFrame:
        """The candidates that were measured, the fastest first, with the largest of their counted errors as ``worst``."""
        known = RESOLUTION * max((self.reference_error[name] for name in self.counted), default=np.nan)
        worst = np.fmax(self.table[self.counted].max(axis=1).to_numpy(float), known)
        return self.table.assign(worst=worst)[self.table["outcome"] == "done"].sort_values("seconds")

    def recommend(self, accuracy: float) -> tuple[Settings, str]:
        """The cheapest settings whose errors are below an accuracy, with a margin of 3; also as lines of a deck, with errors.

        All finer tolerances of the same settings must reach it too, so that no error that is small by chance is taken.

        Parameters
        ----------
        accuracy : float
            Of the counted quantities, > 0.

        Returns
        -------
        dict, str
            For ``dynstiction.run(deck, **settings)``, and for the deck.

        Raises
        ------
        Error
            If no measured settings reach it.
        """
        wanted = number("accuracy", accuracy, above=0.0)
        done = self.done
        if not self.counted or done.empty:
            raise _NoTimeError("nothing of these quantities was measured: give a larger budget or t_end")
        known = max(self.reference_error[name] for name in self.counted)
        error = done[self.counted].max(axis=1)
        parts = done["settings"].str.partition(RTOL)
        family, rtol = parts[0], pd.to_numeric(parts[2])
        for i in done.index:
            finer = error[(family == family[i]) & (rtol < rtol[i])]
            if MARGIN * error[i] + known <= wanted and all(finer <= wanted):
                return self.candidates[i], self._deck_lines(i)
        best = done["worst"].idxmin()
        raise _NoTimeError(
            f"no measured settings reach {_short(wanted)} with a margin of {MARGIN:g}: the best ones, "
            f"{done['settings'][best]}, have an error of {_short(error[best])}: give a larger budget or accuracy"
        )

    def report(self) -> str:
        """The settings than which no other ones are both faster and more accurate, as a table."""
        done = self.done
        rows = done[done["worst"] < done["worst"].cummin().shift(fill_value=np.inf)]
        text = rows[["seconds", "settings", "newton", "rhs", *self.counted]].astype(
            {"newton": int, "rhs": int}
        )
        text["seconds"] = [_short(value) for value in rows["seconds"]]
        for name in self.counted:
            low = RESOLUTION * self.reference_error[name]
            text[name] = [f"<{_short(low)}" if value <= low else _short(value) for value in rows[name]]
        lines = ["Errors relative to the reference; <: too small to be told apart from its own.", self.notes]
        lines += [text.to_string(index=False), f"The best {len(rows)} of {len(done)} measured settings."]
        return "\n".join(filter(None, lines))

    def _deck_lines(self, i: int) -> str:
        row, settings = self.table.loc[i], self.candidates[i]
        errors = ", ".join(f"{name} {_short(row[name])}" for name in self.reference_error)
        gone = [f"{group}.{key}" for group, keys in settings.items() for key in keys if keys[key] is None]
        head = f"! {row['settings']}: {_short(row['seconds'])} s, errors {errors}\n"
        return (
            head
            + deck_from(settings, "").text
            + "".join(f"! Nothing uses {key} any more: remove it.\n" for key in gone)
        )

    def plot(self) -> Figure:
        """Cost against the largest error in the counted quantities; a line joins the tolerances of a method."""
        from .plot.style import PALETTE, new_figure, one_axes  # noqa: PLC0415

        done = self.done
        if not self.counted or done.empty:
            raise UsageError("nothing to draw: no settings were measured: give a larger budget")

        def draw(figure: Figure) -> None:
            axes = one_axes(figure, 95.0)
            family = done["settings"].str.partition(RTOL)[0]
            for k, (label, rows) in enumerate(done.sort_values("worst").groupby(family)):
                style = "o-" if str(label).startswith("full") else "^--"
                axes.plot(rows["worst"], rows["seconds"], style, color=PALETTE[k % 8], ms=3.5, label=label)
            what = f"largest error of\n{', '.join(self.counted)}".replace("_", " ")
            axes.set(xscale="log", yscale="log", xlabel=what, ylabel="wall time [s]")
            figure.legend(loc="outside lower center", ncols=2)

        return new_figure(draw)

    def __repr__(self) -> str:
        return f"<Trade: {len(self.table)} candidates, {len(self.done)} measured: {', '.join(self.reference_error)}>"

    def _repr_html_(self) -> str:
        return str(self.table.to_html())


def trade(
    deck: DeckLike,
    budget: float = 10.0,
    quantities: Sequence[str] | str = (),
    *,
    progress: bool | None = None,
    **changes: Unpack[Changes],
) -> Trade:
    """Measure error against cost of models, methods and tolerances on a scene.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    budget : float
        Wall time [s].
    quantities : sequence of str, or str, optional
        Quantities to which an accuracy applies: values of the summary, elongation and slip_velocity (at eight
        times of the first stick phase and at the end) or creep_velocity; by default elongation, period, peak_force and
        creep_velocity, if the scene has them.
    progress : bool, optional
        Whether to show a bar with the time used of the budget; by default as for `dynstiction.run`.
    **changes : value of a key, or Setup, System, Friction, Drive, Initial, Integrator, Output, or mapping
        Overrides of the deck, as for `dynstiction.run`.

    Returns
    -------
    Trade
        Error and cost of all candidates.

    Raises
    ------
    DeckError
        If the scene is refused, or is a closed form.
    UsageError
        If the budget is not valid, or the scene does not have one of the quantities.
    Error
        If the budget is too small for the reference, or the solver gave up.

    Examples
    --------
    >>> run(deck, **trade(deck).recommend(1e-3)[0])                          # doctest: +SKIP
    """
    wanted = [name for name in names_in("quantities", quantities) if name]
    found = _Measurement(Scene(deck, **changes), number("budget", budget, above=0.0, units="s"), wanted)
    with progress_bar(progress, found.budget, "{percentage:3.0f}%|{bar}| {n:.0f} of {total:.0f} s") as show:
        for _ in found.steps():
            show(min(found.budget, found.elapsed))
    counted = wanted or [name for name in USUAL if name in found.errors]
    columns = ["settings", "seconds", "steps", "rhs", "newton", "outcome", *found.errors]
    table = pd.DataFrame(found.rows, columns=columns)
    return Trade(table, found.candidates, found.errors, counted, found.notes)


class _Measurement:
    """A scene, its reference, and what was measured."""

    def __init__(self, scene: Scene, budget: float, wanted: list[str]) -> None:
        self.budget, self._begun, self._wanted, self.notes = budget, time.monotonic(), wanted, ""
        self._given = {group: keys for group, keys in scene.groups().items() if group != "sweep"}
        self._model = str(self._given["scene"].get("model", "full")).replace("auto", "full")
        if self._model.startswith("creep"):
            raise DeckError(
                f"model '{self._model}' is a closed form: choose 'full', which is compared with it"
            )
        self._given["scene"]["model"] = self._model
        # Samples, end and limits are those of the measurement.
        self._scene = Scene(**cast(Any, self._given)).replace(
            scene=dict.fromkeys(("settle", "accuracy", "quantities")),
            output=dict.fromkeys(("fields", "wall_limit")),
            integrator={"max_steps": None},
        )
        self.candidates = [used_settings(self._given, settings) for settings in self._planned()]
        words = map(_described, self.candidates)
        self.rows: list[dict[str, Any]] = [{"settings": w, "outcome": NO_TIME} for w in words]
        self.errors: dict[str, float] = {}

    @property
    def elapsed(self) -> float:
        return time.monotonic() - self._begun

    def steps(self) -> Iterator[None]:
        """Find the reference, and measure the candidates until the budget is used up."""
        yield from self._find_reference()
        for share in SHARES:
            slowest: dict[str, float] = {}
            for row, settings in zip(self.rows, self.candidates, strict=True):
                # What a looser tolerance had no time for waits for the next round.
                family, _, rtol = row["settings"].partition(RTOL)
                if row["outcome"] == NO_TIME and float(rtol or 0.0) >= slowest.get(family, 0.0):
                    self._measure(row, settings, share * (self.budget - self.elapsed))
                    if row["outcome"] == NO_TIME:
                        slowest[family] = float(rtol or 0.0)
                yield

    def _measure(self, row: dict[str, Any], settings: Settings, limit: float) -> None:
        """Measure a candidate in `limit` seconds."""
        try:
            scene = self._scene.replace(**cast(Any, settings))
            results = [self._run(scene, limit, self._times)]
            # Of a short run, the shortest of three times counts.
            while results[-1].statistics["wall_time"] < 0.02 and len(results) < 3:
                results.append(self._run(scene, limit, self._times))
            row |= {name: results[0].statistics[name] for name in ("steps", "rhs", "newton")}
            row |= self._differences(self._look(results[0]), {name: self._true[name] for name in self.errors})
            row |= {"seconds": min(each.statistics["wall_time"] for each in results), "outcome": "done"}
        except _NoTimeError:
            pass
        except Error as error:
            row["outcome"] = str(error).partition("\n")[0]

    @staticmethod
    def _run(scene: Scene, limit: float, times: NDArray[np.float64]) -> Result:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = run(scene, times=times, progress=False, output={"wall_limit": max(limit, 1e-9)})
        if not result.complete:
            raise _NoTimeError("the budget does not suffice for the reference: give a larger one")
        return result

    def _find_reference(self) -> Iterator[None]:
        """The reference does not use the cycle map, which it is to judge."""
        t_end = float(cast(Any, self._given["scene"]["t_end"]))
        base = self._scene.replace(integrator={"method": "radau9", "step": None, "rtol": 1e-6})
        survey = self._run(base, self.budget, np.linspace(0.0, t_end, 4001))
        stick = float(survey.time[first_release(survey["spring_force_x"]) or -1])  # the first stick phase
        self._times = np.append(stick * np.arange(8) / 8.0, t_end)
        runs = []
        for method, rtol in (("radau13", 1e-12), ("radau9", 1e-11)):
            yield
            tight = {"integrator": {"method": method, "rtol": rtol, "cycle_map": "off"}}
            scene = base.replace(**cast(Any, used_settings(self._given, tight)))
            runs.append(self._run(scene, self.budget - self.elapsed, self._times))
        self._true, summary = self._look(runs[0]), runs[0].summary
        for name in set(self._wanted) - self._true.keys():
            raise UsageError(f"there is no '{name}' in this scene: there are {' '.join(sorted(self._true))}")
        chance = _of_distributions(summary)
        for name, error in self._differences(self._look(runs[1]), self._true).items():
            if name in {*QUANTITIES, *self._wanted} and (name in chance or error <= WORST_REFERENCE):
                self.errors[name] = chance.get(name, max(error, ROUNDOFF))
        for name in set(self._wanted) - self.errors.keys():
            raise UsageError(
                f"'{name}' is 0 in this scene, or not determined to 1 % by any method: choose another one"
            )
        if chance:
            self.notes = "The motion is irregular: means of its cycles are known to three standard errors."
        elif summary.get("conditioning", 0.0) > RESOLUTION:
            factor = _short(summary["conditioning"])
            self.notes = f"Conditioning: errors of a slow cycle are {factor} times larger at the end."

    @staticmethod
    def _look(result: Result) -> dict[str, NDArray[np.float64]]:
        """What a run shows."""
        seen: dict[str, Any] = {name: [value] for name, value in result.summary.items() if np.isreal(value)}
        if "u_x" in result and "w_x" in result:
            seen["elongation"], seen["slip_velocity"] = [[*result[f"{c}_x"], *result[f"{c}_y"]] for c in "uw"]
        seen["creep_velocity"] = [result["X"][6] - result["X"][2]]
        return {name: np.array(values, float) for name, values in seen.items()}

    @staticmethod
    def _differences(seen: Mapping[str, Any], true: Mapping[str, Any]) -> dict[str, float]:
        """Errors over the largest value; what the reference has and the run has not counts as an error of 1."""
        size = {name: np.abs(values).max() for name, values in true.items() if np.any(values)}
        lost = {name: 2.0 * values for name, values in true.items()} | dict(seen)
        return {name: float(np.abs(lost[name] - true[name]).max() / size[name]) for name in size}

    def _planned(self) -> Iterator[Settings]:
        """The candidates, the most informative first."""
        listed, whole = _native.catalogue()["methods"][::-1], self._model == "full"
        methods = [m["name"] for kind in ("implicit", "explicit") for m in listed if m["kind"] == kind]
        for form in ("", "first_power", "third_order", "printed") if whole else ():
            yield {"scene": {"model": "creep_asymptotic", "form": form} if form else {"model": "creep"}}
        for rtol in TOLERANCES:
            for model in (self._model, "low_frequency")[: 1 + whole]:
                for method in methods:
                    yield {"scene": {"model": model}, "integrator": {"method": method, "rtol": rtol}}


def _of_distributions(summary: Mapping[str, float]) -> dict[str, float]:
    """Relative difference that means of an irregular motion have by chance, over RESOLUTION: three standard errors."""
    if summary.get("regularity") != -1.0:
        return {}
    factor = 3.0 * math.sqrt(2.0 / max(2.0, min(100.0, summary["cycles"] // 2))) / RESOLUTION
    names = ("period", "peak_force", "valley_force", "slip_length")
    return {n: factor * summary[f"{n}_scatter"] / abs(summary[n]) for n in names if f"{n}_scatter" in summary}


def _described(settings: Settings) -> str:
    """Settings in words: low_frequency, radau9, rtol 1e-05."""
    values = [(k, v) for keys in settings.values() for k, v in keys.items() if v is not None]
    return ", ".join(v if isinstance(v, str) else f"{k} {setting_value(v)}" for k, v in values)


def _short(value: float) -> str:
    return number_shown(float(value), 2)
