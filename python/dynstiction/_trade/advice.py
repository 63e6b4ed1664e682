"""The cheapest settings that reach an accuracy, as `trade` measured them, ready to paste into the deck."""

from __future__ import annotations

import math
from collections.abc import Collection
from difflib import get_close_matches
from typing import Any

from .. import _native
from ..deck_text import deck_from, setting_value
from ..errors import Error, UsageError
from ..record import number_shown
from .measure import RESOLUTION, Comparison, Point, StoppedEarlyError
from .plan import Candidate
from .quantities import QUANTITIES

__all__ = ["advice", "advised_settings", "cheapest", "check_quantity", "front", "overview", "short"]

USUAL_QUANTITIES = ("final_elongation", "period", "peak_force", "creep_velocity")
"""The quantities that users need most often."""
MARGIN = 3.0
"""Errors scatter: a setting is recommended if its error is smaller than the accuracy by this factor."""
USUAL_ACCURACIES = (1e-2, 1e-3, 1e-6)
LOST = 0.5
"""From this error on a quantity is not reproduced."""


def short(value: float) -> str:
    """A number of two digits: 0.001, 3.7e-05."""
    return number_shown(float(value), 2)


def check_quantity(quantity: str, own: Collection[str]) -> None:
    """Refuse a name that is not a quantity; an empty name means the usual quantities."""
    names = ["all", *QUANTITIES, *own]
    if quantity in ("", *names):
        return
    near = "".join(f"the nearest is '{name}', " for name in get_close_matches(quantity, names, 1))
    raise UsageError(f"unknown quantity '{quantity}': {near}there are {' '.join(names)}")


def _counted(comparison: Comparison, quantity: str) -> list[str]:
    """Quantities of the scene to which an accuracy applies."""
    own = comparison.second.errors
    usual = {*USUAL_QUANTITIES, *(own.keys() - QUANTITIES.keys())}
    return [name for name in own if quantity in ("all", name) or (quantity == "" and name in usual)]


def front(comparison: Comparison, quantity: str) -> list[Point]:
    """Measured points for which no other one is both faster and more accurate, the fastest first.

    An error below 100 times that of the reference counts as this limit.
    """
    known = comparison.second.errors
    wanted = _counted(comparison, quantity) or list(known)
    best: list[Point] = []
    reached = math.inf
    for point in sorted(
        (point for point in comparison.points if point.done), key=lambda point: point.seconds
    ):
        error = max((max(point.errors[name], RESOLUTION * known[name]) for name in wanted), default=0.0)
        if error < reached:
            best.append(point)
            reached = error
    return best


def overview(comparison: Comparison, quantity: str) -> str:
    """The cheapest settings for three usual accuracies, one in each line."""
    counted = ", ".join(_counted(comparison, quantity))
    lines = (
        [f"Cheapest settings by the accuracy of {counted} (errors scatter: the margin is {MARGIN:g}):"]
        if counted
        else []
    )
    for accuracy in USUAL_ACCURACIES if counted else ():
        try:
            best = cheapest(comparison, accuracy, quantity)
            lines.append(f"  {short(accuracy):6} {_described(best.candidate)}: {short(best.seconds)} s")
        except Error:
            lines.append(f"  {short(accuracy):6} none was measured")
    return "".join(f"{line}\n" for line in lines)


def cheapest(comparison: Comparison, accuracy: float, quantity: str) -> Point:
    """The cheapest point whose errors stay below `accuracy` with the margin; an `Error` if there is none."""
    wanted = _counted(comparison, quantity)
    if not wanted:
        raise UsageError(f"the scene has no '{quantity}': choose another quantity, or a longer scene.t_end")
    done = [point for point in comparison.points if point.done]
    if not done:
        raise StoppedEarlyError("no setting was measured: raise --budget")
    largest = {id(point): max(point.errors[name] for name in wanted) for point in done}
    known = max(comparison.second.errors[name] for name in wanted)

    def is_trusted(point: Point) -> bool:
        """Whether a point reaches the accuracy with the margin, and all finer points of its family reach it too."""
        here = point.candidate
        finer = (
            other
            for other in done
            if other.candidate.family == here.family
            and (other.candidate.rtol < here.rtol or other.candidate.step < here.step)
        )
        return MARGIN * largest[id(point)] + known <= accuracy and all(
            largest[id(p)] <= accuracy for p in finer
        )

    trusted = [point for point in done if is_trusted(point)]
    if trusted:
        return min(trusted, key=lambda point: point.seconds)
    nearest = min(done, key=lambda point: largest[id(point)])
    raise StoppedEarlyError(
        f"no measured setting reaches {short(accuracy)} with a margin of {short(MARGIN)}: the best one, "
        f"{_described(nearest.candidate)}, has an error of {short(largest[id(nearest)])}, measured to {short(known)}: "
        "raise --budget or --accuracy"
    )


def advice(comparison: Comparison, best: Point) -> str:
    """The settings of a point as namelist groups, and as a command that also removes the keys that are no longer used."""
    names = [name for name in dict.fromkeys((*QUANTITIES, *best.errors)) if name in best.errors]
    lost = [name for name in names if best.errors[name] >= LOST]
    errors = ", ".join(f"{name} {short(best.errors[name])}" for name in names if name not in lost)
    lines = [f"! {_described(best.candidate)}: {short(best.seconds)} s, errors {errors}"]
    if lost:
        lines.append(f"! Not reproduced (errors of {LOST:.0%} and more): {', '.join(lost)}")
    lines += deck_from(best.candidate.settings(), "").text.splitlines()
    command = ""
    for group, settings in advised_settings(comparison, best).items():
        for key, setting in settings.items():
            command += f" --set {group}.{key}={_written(setting)}"
            if setting is None:
                lines.append(f"! Nothing uses {group}.{key} any more: remove it.")
    deck = comparison.subject.name
    return (
        "\n".join([*lines, f"! In place of the deck's own values; or: dynstiction run {deck}{command}"])
        + "\n"
    )


def advised_settings(comparison: Comparison, best: Point) -> dict[str, dict[str, Any]]:
    """The settings of a point by group; None removes a key that the deck sets and that is no longer used."""
    given = best.candidate.settings()
    gone = {
        (key.group, key.name)
        for key, value in comparison.subject.unused(given)
        if not _is_default(key, value)
    }
    settings: dict[str, dict[str, Any]] = {}
    for key in _native.schema():
        if key.name in given.get(key.group, {}) or (key.group, key.name) in gone:
            settings.setdefault(key.group, {})[key.name] = given.get(key.group, {}).get(key.name)
    return settings


def _is_default(key: _native.KeyInfo, value: object) -> bool:
    if isinstance(value, float):
        return key.default != "" and float(key.default) == value
    return key.default == str(value)


def _described(candidate: Candidate) -> str:
    """A candidate in words: low_frequency, radau9, rtol 1.0e-5."""
    words = [" ".join(filter(None, (candidate.model, candidate.form))), candidate.method]
    words += ["cycle_map off"] if candidate.cycle_map == "off" else []
    numbers = (("v_smooth", candidate.v_smooth), ("rtol", candidate.rtol), ("step", candidate.step))
    words += [f"{name} {value!r}" for name, value in numbers if value > 0.0]
    words += [f"{key} {_written(value)}" for keys in candidate.more.values() for key, value in keys.items()]
    return ", ".join(filter(None, words))


def _written(value: object) -> str:
    """A value as on the command line: as in a deck, but text has no quotes."""
    return value if isinstance(value, str) else setting_value(value)
