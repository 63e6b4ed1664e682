"""The extremes matrix: every parameter at the ends where the model still means something, singly and in pairs.

A cell is Fig. 3 of Nakano & Popov (2020) with one or two parameters at an end, for one model and method. Its length follows from
its own time scales, so that a cell costs some thousand steps at most.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

from fig3 import CONSTANT, GROUPS, Groups, changed

MAX_STEPS = 20_000
RTOL = 1e-8
FAST_CYCLES = 60
"""Periods of the fast oscillation that a run of the full model follows after the first release."""

FIG3: Groups = {
    **changed(GROUPS, {"initial": {"elongation_x": 0.0, "elongation_y": 0.0}}),
    "scene": {},
    "integrator": {"rtol": RTOL, "max_steps": MAX_STEPS},
    "output": {},
}

Profile = tuple[tuple[float, float], ...]
"""Knots of a drive: shares of t_end and of V."""


@dataclass(frozen=True)
class End:
    """One parameter at one end; ends of one axis exclude each other."""

    axis: str
    name: str
    changes: tuple[tuple[str, str, object], ...] = ()
    profile: Profile = ()
    t_end: float | None = None
    slow_models_only: bool = False


def _ends(axis: str, group: str, key: str, *values: float) -> list[End]:
    return [End(axis, f"{key} = {value:g}", ((group, key, value),)) for value in values]


ENDS: list[End] = [
    *_ends("misalignment", "system", "misalignment_deg", 0.0, 1e-12, -1.0, 45.0, 90.0, 180.0),
    *(End("anisotropy", f"k_y/k_x = {ratio:g}", (("system", "stiffness_y", 1e3 * ratio),)) for ratio in (1e-3, 1.0, 1e12)),
    *_ends("mass", "system", "mass", 1e-12, 1e6),
    *_ends("damping_x", "system", "damping_x", 1e-12, 31.0, 1e12),
    *_ends("damping_y", "system", "damping_y", 1e-12, 3e3, 1e12),
    *_ends("velocity", "drive", "velocity", 0.0, 1e-12, -1e-3, 1e2),
    *_ends("v_f", "friction", "v_f", 1e-9, 1e9),
    End("coefficients", "mu_0 = mu_inf", (("friction", "mu_inf", 0.20),)),
    End("coefficients", "mu_0 < mu_inf", (("friction", "mu_inf", 0.30),)),
    End("coefficients", "mu_inf = 0", (("friction", "mu_inf", 0.0),)),
    End("coefficients", "mu = 0", (("friction", "mu_0", 0.0), ("friction", "mu_inf", 0.0))),
    End("coefficients", "constant", tuple(("friction", key, value) for key, value in CONSTANT.items())),
    *_ends("load", "friction", "normal_load", 0.0, 1e-9, 1e9),
    *_ends("start", "initial", "velocity_ratio", 0.0, -1.0, 1e3),
    *_ends("elongation_x", "initial", "elongation_x", 2e-3, -5e-3, 1.0),
    *_ends("elongation_y", "initial", "elongation_y", -2e-7, 1e-3),
    End("profile", "V = 0", profile=((0.0, 0.0), (1.0, 0.0))),
    End("profile", "jump from rest", profile=((0.0, 0.0), (0.3, 0.0), (0.3, 1.0))),
    End("profile", "hold from a jump", profile=((0.0, 1.0), (0.4, 1.0), (0.4, 0.0), (0.7, 0.0), (0.7, 1.0))),
    End("profile", "reversal at once", profile=((0.0, 1.0), (0.6, 1.0), (0.6, -1.0))),
    End("profile", "reversal by a ramp", profile=((0.0, 1.0), (0.4, 1.0), (0.8, -1.0))),
    End("duration", "t_end = 1e-12", t_end=1e-12),
    End("duration", "t_end = 1e5", t_end=1e5, slow_models_only=True),
]


@dataclass(frozen=True)
class Kind:
    """A model, with what its decks need beside Fig. 3."""

    name: str
    model: str
    method: str | None = None
    scene: tuple[tuple[str, object], ...] = ()
    smoothed: bool = False

    @property
    def closed_form(self) -> bool:
        return self.model in {"creep", "creep_asymptotic"}

    @property
    def slow(self) -> bool:
        return self.closed_form or self.model == "low_frequency"


RADAU = ("radau5", "radau9", "radau13")
KINDS: list[Kind] = [
    *(Kind(f"{model} {method}", model, method) for model in ("full", "low_frequency", "high_frequency") for method in RADAU),
    Kind("full radau9 smoothed", "full", "radau9", smoothed=True),
    *(Kind(f"full {method}", "full", method) for method in ("dopri5", "dop853")),
    Kind("full rk4 smoothed", "full", "rk4", smoothed=True),
    Kind("low_frequency dop853", "low_frequency", "dop853"),
    Kind("high_frequency dop853", "high_frequency", "dop853"),
    *(
        Kind(f"auto {quantities}", "auto", "radau9", (("quantities", quantities), ("accuracy", 0.03)))
        for quantities in ("stick_slip", "creep")
    ),
    Kind("creep", "creep"),
    *(Kind(f"creep_asymptotic {form}", "creep_asymptotic", None, (("form", form),)) for form in ("first_power", "third_order")),
]


@dataclass(frozen=True)
class Cell:
    """One scene of the matrix."""

    kind: Kind
    ends: tuple[End, ...]

    @property
    def name(self) -> str:
        return f"{self.kind.name}: {', '.join(end.name for end in self.ends) or 'Fig. 3'}"

    def groups(self) -> Groups:
        """The deck."""
        groups = {group: dict(keys) for group, keys in FIG3.items()}
        for end in self.ends:
            for group, key, value in end.changes:
                groups[group][key] = value
            if end.t_end is not None:
                groups["scene"]["t_end"] = end.t_end
        profile = next((end.profile for end in self.ends if end.profile), ())
        return scene_of(groups, self.kind, profile)


def scene_of(groups: Groups, kind: Kind, profile: Profile = ()) -> Groups:
    """The deck of one kind from the parameters of the full model; its length, unless given, follows from its time scales."""
    groups = {group: dict(keys) for group, keys in groups.items()}
    numbers = Scales.of(groups)
    scene = groups["scene"]
    scene["model"] = kind.model
    scene.update(kind.scene)
    scene.setdefault("t_end", numbers.length(kind))
    t_end = float(str(scene["t_end"]))
    if profile:
        groups["drive"] = {
            "time": [share * t_end for share, _ in profile],
            "velocity": [share * numbers.velocity for _, share in profile],
        }
    # Slow cycles that repeat are leapt, so that no `max_steps` ends a long run: with a row for each step it would have 2e7 of them.
    few_rows = kind.closed_form or kind.model == "auto" or t_end > numbers.length(kind)
    groups["output"]["interval"] = t_end / 50 if few_rows else 0.0
    if kind.method is not None:
        groups["integrator"]["method"] = kind.method
    if kind.method == "rk4":
        del groups["integrator"]["rtol"]
        groups["integrator"]["step"] = max(min(numbers.fast_period, numbers.stop, numbers.relaxation) / 50, t_end / MAX_STEPS)
    if kind.smoothed:
        groups["friction"].update(contact="smoothed", v_smooth=0.1 * (numbers.velocity_scale or 1e-3))
    _drop_unused(groups, kind)
    return changed(groups)


def _drop_unused(groups: Groups, kind: Kind) -> None:
    unused: dict[str, tuple[str, ...]] = {}
    if kind.model == "low_frequency":
        unused = {"system": ("stiffness_y", "damping_y"), "initial": ("elongation_y",)}
    elif kind.model == "high_frequency":
        unused = {"system": ("damping_x",)}
    elif kind.closed_form:
        unused = {
            "system": ("mass", "damping_x", "damping_y"),
            "friction": ("law", "mu_inf", "v_f"),
            "initial": tuple(groups["initial"]),
            "integrator": tuple(groups["integrator"]),
        }
        if kind.model == "creep_asymptotic":
            unused["system"] = ("mass", "stiffness_y", "damping_x", "damping_y")
    for group, keys in unused.items():
        for key in keys:
            groups[group].pop(key, None)


@dataclass(frozen=True)
class Scales:
    """What sets the time scales of a scene."""

    fast_period: float
    slow_period: float
    release: float
    travel: float
    stop: float
    relaxation: float
    velocity: float
    velocity_scale: float

    @classmethod
    def of(cls, groups: Groups) -> Scales:
        number = {
            key: float(str(value))
            for group in ("system", "friction", "drive", "initial")
            for key, value in groups[group].items()
            if isinstance(value, (int, float))
        }
        mass, soft, stiff = number["mass"], number["stiffness_x"], number["stiffness_y"]
        phi, velocity = math.radians(number["misalignment_deg"]), number["velocity"]
        limit = number["mu_0"] * number["normal_load"]
        speed = abs(velocity)
        growth = speed * math.hypot(soft * math.cos(phi), stiff * math.sin(phi))
        slow_period = 2 * math.pi * math.sqrt(mass / min(soft, stiff))
        fast_period = 2 * math.pi * math.sqrt(mass / max(soft, stiff))
        return cls(
            fast_period=fast_period,
            slow_period=slow_period,
            release=limit / growth if growth > 0 else fast_period,
            travel=limit / (soft * speed) if speed > 0 else slow_period,
            stop=mass * max(speed, 1e-12) / limit if limit > 0 else fast_period,
            relaxation=mass / max(number.get("damping_x", 0.0), number.get("damping_y", 0.0), 1e-300),
            velocity=velocity,
            velocity_scale=speed,
        )

    def length(self, kind: Kind) -> float:
        """t_end [s]: past the first release, and what the kind can afford beyond."""
        if kind.closed_form:
            return 0.9 * self.travel
        if kind.model == "auto":
            return min(self.release + 10 * FAST_CYCLES * self.fast_period, 2.5 * self.travel, 1e12)
        if kind.slow:
            return min(2.5 * self.travel + 3 * self.slow_period, 1e12)
        return min(self.release + FAST_CYCLES * self.fast_period, 1e12)


def cells(pairs: bool) -> Iterator[Cell]:
    """All singles, or all pairs; scenes that do not differ from another one count once."""
    sets = itertools.combinations(ENDS, 2) if pairs else iter([(), *((end,) for end in ENDS)])
    seen: set[str] = set()
    for ends in sets:
        if len({end.axis for end in ends}) < len(ends):
            continue
        for kind in KINDS:
            if any(end.slow_models_only for end in ends) and not kind.slow:
                continue
            cell = Cell(kind, tuple(ends))
            key = f"{kind.name} {sorted((g, sorted(k.items())) for g, k in cell.groups().items())}"
            if key not in seen:
                seen.add(key)
                yield cell
