"""What `trade` tries on a scene: models, methods, tolerances, smoothing widths and fixed steps, the most informative first."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, cast

from .. import _native
from ..scene import Scene
from ..simulation import Simulation

__all__ = ["Candidate", "Subject", "candidates", "is_used"]

Settings = Mapping[str, Mapping[str, Any]]
"""Values by group and key."""

TOLERANCES = {6: 1, 4: 2, 8: 3, 3: 4, 10: 5, 5: 6, 7: 6, 9: 7, 11: 7}
"""Relative tolerances 10^-n, and their ranks: every second one first."""
DIRECT_TOLERANCES, DIRECT_RANK = {6: 1, 4: 2, 8: 3}, 7
"""Ranks of the tolerances at which the full model is also tried without the cycle map, and how much later than with it."""
SMOOTHING_SHARES = (0.1, 1.0, 1.0e-2, 1.0e-3)
"""Smoothing velocities over V sin(phi)."""
KEYS = {
    "scene": ("model", "form"),
    "friction": ("contact", "v_smooth"),
    "integrator": ("method", "rtol", "step", "cycle_map"),
}
"""The settings that distinguish candidates and have a column."""


@dataclass(frozen=True)
class Candidate:
    """Settings to compute the scene with. A setting that is not used is 0 or empty."""

    model: str
    method: str = ""
    contact: str = ""
    form: str = ""
    cycle_map: str = ""
    """Empty if cycles are never leapt."""
    rtol: float = 0.0
    step: float = 0.0
    """s"""
    v_smooth: float = 0.0
    """m/s"""
    rank: int = 0
    """Candidates with a lower rank are tried first."""
    obstacle: str = ""
    """Why the candidate cannot be tried."""
    more: Settings = field(default_factory=dict)
    """Settings of the user that have no column."""

    @property
    def family(self) -> tuple[object, ...]:
        """The same for all candidates that differ in tolerance or step only."""
        return (
            self.model,
            self.method,
            self.contact,
            self.form,
            self.cycle_map,
            self.v_smooth,
            repr(self.more),
        )

    @property
    def order(self) -> int:
        """Order of the method; 0 for a closed form."""
        orders = {method["name"]: int(method["order"]) for method in _native.catalogue()["methods"]}
        return orders.get(self.method, 0)

    def settings(self) -> dict[str, dict[str, Any]]:
        """All keys that the candidate sets, by group."""
        groups = {
            group: {key: getattr(self, key) for key in keys if getattr(self, key)}
            for group, keys in KEYS.items()
        }
        for group, keys in self.more.items():
            groups.setdefault(group, {}).update(keys)
        return {group: keys for group, keys in groups.items() if keys}


class Subject:
    """The scene of the comparison as the user gave it, and the scenes of the candidates."""

    def __init__(self, scene: Scene) -> None:
        self.name, self.given = scene.name, scene.groups()
        # For a sweep, the scene that its cases vary.
        self._scene = Scene(**cast(Any, self.given)) if self.given.pop("sweep", None) else scene
        self.value = {name: value for keys in self.given.values() for name, value in keys.items()}
        """Values by key; no two keys have the same name."""
        self.model = str(self.value.get("model", "full"))
        if self.model == "auto":
            self.model = "full"
        self.contact = str(self.value.get("contact", "exact"))
        self.has_cycle_map = (self.model, self.contact) == ("full", "exact")
        """Whether cycles may be leapt."""

    def number(self, key: str) -> float:
        """Value of a key with one number; NaN if the scene does not have it."""
        return float(cast(float, self.value.get(key, math.nan)))

    def interval(self) -> float:
        """Time between the samples of the scene [s]; 0 if every step is a sample."""
        with Simulation(self.scene()) as simulation:
            return float(simulation.result.parameters["interval"])

    def unused(self, settings: Settings) -> Iterator[tuple[_native.KeyInfo, object]]:
        """Keys of the scene that are not used with these settings, and their values."""
        values = self.value | {name: value for keys in settings.values() for name, value in keys.items()}
        for key in _native.schema():
            if key.name in self.given.get(key.group, {}) and not is_used(key, values):
                yield key, self.value[key.name]

    def scene(self, settings: Settings | None = None, **output: float | None) -> Scene:
        """The scene with the settings of a candidate and of the output, without unused keys and without limits on its run."""
        changes: dict[str, dict[str, Any]] = {"scene": {}, "integrator": {}, "output": dict(output)}
        if settings is not None:
            changes["integrator"]["max_steps"] = changes["output"]["wall_limit"] = None
            for key, _ in self.unused(settings):
                changes.setdefault(key.group, {})[key.name] = None
            for group, keys in settings.items():
                changes.setdefault(group, {}).update(keys)
        return self._scene.replace(**cast(Any, changes))


@cache
def _keys() -> dict[str, _native.KeyInfo]:
    return {key.name: key for key in _native.schema()}


@cache
def _adaptive_methods() -> list[str]:
    """Methods, the most informative first: the default, the other implicit ones, the explicit ones."""
    methods, default = _native.catalogue()["methods"], _keys()["method"].default
    implicit, explicit = (
        [method["name"] for method in methods if method["kind"] == kind] for kind in ("implicit", "explicit")
    )
    return sorted(reversed(implicit), key=lambda name: name != default) + explicit


def is_used(key: _native.KeyInfo, values: Mapping[str, object]) -> bool:
    """Whether a key has a meaning with these values by key, and the defaults of the others."""
    return all(
        is_used(_keys()[on], values) and values.get(on, _keys()[on].default) in choices
        for on, choices in key.used_by
    )


def candidates(subject: Subject, own: Iterable[Settings]) -> list[Candidate]:
    """Candidates in the order in which they are to be tried, those of the user first."""
    planned = [*(_own(subject, settings) for settings in own), *_planned(subject)]
    return sorted(planned, key=lambda candidate: candidate.rank)


def _own(subject: Subject, settings: Settings) -> Candidate:
    """A candidate of the user: keys that it does not set are as in the scene."""
    values = subject.value | {name: value for keys in settings.values() for name, value in keys.items()}
    values.setdefault("model", "full")
    if values["model"] == "auto":
        values["model"] = subject.model
    kept: dict[str, Any] = {}
    for key in _native.schema():
        if key.name in KEYS.get(key.group, ()) and is_used(key, values):
            kind = float if key.kind == "real" else str
            kept[key.name] = kind(cast(Any, values.get(key.name, key.default)))
    more = {
        group: {k: v for k, v in keys.items() if k not in KEYS.get(group, ())}
        for group, keys in settings.items()
    }
    return Candidate(**kept, more={group: keys for group, keys in more.items() if keys})


def _planned(subject: Subject) -> Iterator[Candidate]:
    model, contact = subject.model, subject.contact
    if subject.has_cycle_map:
        yield from _tolerances(model, contact, cycle_map="auto")
        yield from _tolerances(model, contact, cycle_map="off", ranks=DIRECT_TOLERANCES, later=DIRECT_RANK)
    else:
        yield from _tolerances(model, contact, subject.number("v_smooth") if contact == "smoothed" else 0.0)
    if model == "full":
        yield Candidate("creep", rank=1)
        for form in ("first_power", "third_order", "printed"):
            yield Candidate("creep_asymptotic", form=form, rank=1)
        yield from _tolerances("low_frequency")
        yield from _fixed_steps(subject)
        obstacle = "the load along the soft axis is fixed in it, which is not so in a whole scene"
        yield Candidate("high_frequency", rank=1, obstacle=obstacle)
        yield from _smoothed(subject)
        yield from _moreau_jean(subject)
    elif model == "low_frequency":
        yield from _fixed_steps(subject)


def _tolerances(
    model: str,
    contact: str = "",
    v_smooth: float = 0.0,
    cycle_map: str = "",
    ranks: Mapping[int, int] = TOLERANCES,
    later: int = 0,
) -> Iterator[Candidate]:
    """All adaptive methods at all tolerances on one model."""
    for exponent, rank in ranks.items():
        for method in _adaptive_methods():
            yield Candidate(
                model,
                method,
                contact,
                cycle_map=cycle_map,
                rtol=10.0**-exponent,
                v_smooth=v_smooth,
                rank=rank + later,
            )


def _largest_step(subject: Subject) -> float:
    """A sixteenth of the slow period, or of the duration of the scene [s]."""
    period = 2.0 * math.pi * math.sqrt(subject.number("mass") / subject.number("stiffness_x"))
    return min(period / 16.0, subject.number("t_end") / 16.0)


def _fixed_steps(subject: Subject) -> Iterator[Candidate]:
    """rk4 on the slow motion."""
    for i in range(4):
        yield Candidate("low_frequency", "rk4", step=_rounded(_largest_step(subject) / 4.0**i), rank=2 + i)


def _smoothed(subject: Subject) -> Iterator[Candidate]:
    """The smoothed contact, for smoothing velocities below V sin(phi).

    The friction direction relaxes at the rate F_0/(m v_smooth); rk4 is stable up to 2.8 of its inverse.
    """

    def smoothed(
        method: str, v_smooth: float, rank: int, rtol: float = 0.0, share: float = 0.0
    ) -> Iterator[Candidate]:
        onset = subject.number("mu_0") * subject.number("normal_load")
        if v_smooth > 0.0 and (share == 0.0 or onset > 0.0):
            step = _rounded(share * subject.number("mass") * v_smooth / onset) if share > 0.0 else 0.0
            yield Candidate("full", method, "smoothed", rtol=rtol, step=step, v_smooth=v_smooth, rank=rank)

    if subject.contact != "exact":
        yield from smoothed("rk4", subject.number("v_smooth"), rank=2, share=2.0)
        yield from smoothed("rk4", subject.number("v_smooth"), rank=3, share=0.5)
        return
    velocity = subject.value["velocity"]
    fastest = max(map(abs, cast(Any, velocity if isinstance(velocity, tuple) else (velocity,))))
    speed = fastest * max(abs(math.sin(math.radians(subject.number("misalignment_deg")))), 1.0e-3)
    for i, share in enumerate(SMOOTHING_SHARES, 1):
        v_smooth = _rounded(share * speed)
        yield from smoothed("radau9", v_smooth, i, rtol=1.0e-6)
        yield from smoothed("radau9", v_smooth, i + 1, rtol=1.0e-4)
        yield from smoothed("dopri5", v_smooth, i, rtol=1.0e-4)
        yield from smoothed("dopri5", v_smooth, i + 3, rtol=1.0e-6)
        yield from smoothed("rk4", v_smooth, i + 1, share=2.0)
        yield from smoothed("rk4", v_smooth, i + 2, share=0.5)


def _moreau_jean(subject: Subject) -> Iterator[Candidate]:
    """From a part of the slow period down to a thousandth of the fast one."""
    if subject.contact != "exact":
        obstacle = "it has only the exact contact, and the scene has the smoothed one"
        yield Candidate("full", "moreau_jean", "exact", rank=1, obstacle=obstacle)
        return
    stiffest = max(subject.number("stiffness_x"), subject.number("stiffness_y"))
    shortest = 1.0e-3 * 2.0 * math.pi * math.sqrt(subject.number("mass") / stiffest)
    for i in range(12):
        step = _largest_step(subject) / 4.0**i
        if step > shortest:
            yield Candidate("full", "moreau_jean", "exact", step=_rounded(step), rank=1 + (i + 1) // 2)


def _rounded(value: float) -> float:
    """A number of two digits, which are enough for a value that a user types."""
    return float(f"{value:.1e}")
