"""What must not matter: pairs of scenes whose results must be the same, or follow from each other.

python tests/invariance/invariance.py [--scenes 100] [--seed 7] [--first 0] [--rows map,t_end]

`ROWS` is the table: what is changed, in which scenes, and the error that is allowed in every column, event and summary value. Scene
`number` of a row and a seed is always the same. A failure prints both decks.
"""

from __future__ import annotations

import argparse
import math
import random
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field

import dynstiction as ds
import motions as mo
import numpy as np
from dynstiction import _native
from fig3 import GROUPS, Groups, changed
from matrix import FIG3, KINDS, Kind, scene_of
from scenes import log_uniform, random_scene
from truth import differences

MOST_FAST_CYCLES = 20_000
RADAU = ("radau13", "radau13", "radau9", "radau9", "radau5")
EXPLICIT = ("dopri5", "dop853")
UNDERFLOW = 1e-290

# Units as powers of length, time, mass.
NUMBER, LENGTH, TIME, MASS = (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)
UNITS = {
    **dict.fromkeys(("1", "rad", "deg"), NUMBER),
    "m": LENGTH,
    "s": TIME,
    "kg": MASS,
    "Hz": (0, -1, 0),
    "N": (1, -2, 1),
    "J": (2, -2, 1),
    "W": (2, -3, 1),
}


def powers_of(unit: str) -> tuple[int, ...]:
    """Powers of a product of units over another one, like 'N s/m' or 'm/s2'."""
    found = np.zeros(3, dtype=int)
    for sign, product in zip((1, -1), unit.split("/"), strict=False):
        for name, power in re.findall(r"([A-Za-z]+|\b1\b)(\d*)", product):
            found += sign * int(power or 1) * np.array(UNITS[name])
    return tuple(found)


ACROSS = ("u_y", "w_y", "Y", "Y_rate", "spring_force_y", "theta", "psi")
SOFT = ("u_x", "w_x", "spring_force_x")
STIFF = ("u_y", "w_y", "spring_force_y")
OF_THE_LOAD = (
    *mo.MEANS,
    *(f"{key}_scatter" for key in mo.MEANS),
    "cycles",
    "first_peak_force",
    "swing",
    "slip_angle",
    "repeats",
    "regularity",
)
OF_THE_HALF = ("swing", "creep_share", "pull_peak", "pull_valley", "pull_swing", "pull_frequency")
"""Summary values of the second half of the run."""


@dataclass(frozen=True)
class Image:
    """How the results of the second scene follow from those of the first; the rest is the same."""

    negative: tuple[str, ...] = ()
    turned_back: tuple[str, ...] = ()
    """Angles that are greater by pi."""
    powers: tuple[int, int, int] = NUMBER
    """The second scene's units are these powers of two."""
    turn: float = 0.0
    """By which the principal axes are turned [rad]."""
    later: float = 0.0
    """When the motion begins [s]."""
    longer: bool = False
    """The second run goes on."""
    without: tuple[str, ...] = ()
    """Columns and summary values that have no image."""

    def factor(self, unit: str) -> float:
        return 2.0 ** sum(d * p for d, p in zip(powers_of(unit), self.powers, strict=True))

    def columns(self, result: ds.Result) -> dict[str, np.ndarray]:
        found = {name: values * self.factor(result.columns.units[name]) for name, values in mo.columns_of(result).items()}
        if self.turn:
            c, s = math.cos(self.turn), math.sin(self.turn)
            for x, y in zip(SOFT, STIFF, strict=True):
                found[x], found[y] = c * found[x] - s * found[y], s * found[x] + c * found[y]
            found["theta"] = found["theta"] + self.turn
        for name in self.negative:
            if name in found:
                found[name] = -found[name]
        for name in self.turned_back:
            if name in found:
                found[name] = found[name] + np.pi
        return found

    def summary(self, result: ds.Result) -> dict[str, float]:
        found = {key: mo.value_of(result, key) * self.factor(result.summary.units[key]) for key in result.summary}
        found |= {key: -value for key, value in found.items() if key.removeprefix("final_") in self.negative}
        if self.later:
            found["sticking_time"] += self.later
            # The hold is one more rest if the motion does not begin with one.
            begins = result.events["kind"][result.events["time"] == 0]
            found["sticks"] += not (begins == ds.record.STICK_BEGINS).any()
        return found


SAME = Image()
Pair = tuple[Groups, Groups, Image]
Change = Callable[[random.Random, Groups], Pair]
Family = Callable[[random.Random], Groups]


# --------------------------------------------------------------------------------------------------------------- families


def audited(chance: random.Random) -> Groups:
    """Some 40 to 1500 fast cycles of any apparatus and drive, from anywhere."""
    return random_scene(chance.randrange(2**30), 0).groups()


def steady(chance: random.Random) -> Groups:
    """The same, with a steady drive."""
    return random_scene(chance.randrange(2**30), 0, profiles=False).groups()


def rig(chance: random.Random) -> Groups:
    """Stick-slip of 3 to 60 slow cycles, from rest, with at most so many fast cycles as can be stepped in a moment."""
    while True:
        k_x, mu_0 = log_uniform(chance, 1e3, 1e5), chance.uniform(0.1, 0.6)
        mass, k_y = log_uniform(chance, 0.1, 5), k_x * log_uniform(chance, 10, 1e4)
        load, velocity = log_uniform(chance, 1, 50), log_uniform(chance, 1e-5, 1e-2)
        t_end = mu_0 * load / (k_x * velocity) * log_uniform(chance, 3, 60)
        if t_end * math.sqrt(k_y / mass) < 2 * math.pi * MOST_FAST_CYCLES:
            break
    return {
        "scene": {"model": "full", "t_end": float(f"{t_end:.6g}")},
        "system": {"mass": mass, "stiffness_x": k_x, "stiffness_y": k_y, "misalignment_deg": chance.uniform(0.2, 5)},
        "friction": {
            "law": "weakening",
            "mu_0": mu_0,
            "mu_inf": mu_0 * chance.uniform(0.3, 0.95),
            "v_f": log_uniform(chance, 1e-3, 5e-2),
            "normal_load": load,
        },
        "drive": {"velocity": velocity},
        "initial": {"velocity_ratio": 0.0, "elongation_x": 0.0, "elongation_y": 0.0},
        "integrator": {},
        "output": {},
    }


def near_fig3(chance: random.Random) -> Groups:
    """Fig. 3 at 1 to 9 degrees, its k_y and V within a factor of 2: the map leaps most of it."""
    return changed(
        GROUPS,
        {
            "scene": {"t_end": float(f"{log_uniform(chance, 5, 20):.4g}"), "title": None},
            "system": {"misalignment_deg": chance.uniform(1, 9), "stiffness_y": 1e7 * log_uniform(chance, 0.5, 2)},
            "drive": {"velocity": 1e-3 * log_uniform(chance, 0.5, 2)},
            "initial": {"elongation_x": 0.0, "elongation_y": 0.0},
        },
    )


def another_law(chance: random.Random) -> Groups:
    """The same with another law, a static limit or dampers."""
    friction = chance.choice(
        [
            {"mu_static": chance.uniform(0.2, 0.26)},
            {"law": "stribeck", "exponent": chance.uniform(0.5, 2), "viscous": chance.uniform(0, 0.5)},
            {},
        ]
    )
    damping = {key: chance.choice([None, log_uniform(chance, 0.1, 10)]) for key in ("damping_x", "damping_y")}
    return changed(near_fig3(chance), {"friction": friction, "system": damping})


def another_kind(chance: random.Random) -> Groups:
    """The same in every model, method and contact, as long as tests/extremes takes."""
    groups = changed(near_fig3(chance), {"scene": {"t_end": None}, "initial": {"elongation_x": chance.choice([0.0, 1e-4, -1e-3])}})
    return scene_of(groups, chance.choice(KINDS))


def another_model(chance: random.Random) -> Groups:
    """The same without `auto`, which takes the full model from 90 degrees on: it knows the errors of the others below."""
    while True:
        groups = another_kind(chance)
        if groups["scene"]["model"] != "auto":
            return groups


def slow(chance: random.Random) -> Groups:
    """A rig in the low-frequency model."""
    scene = rig(chance)
    angle = {"misalignment_deg": chance.choice([chance.uniform(0.2, 5), chance.uniform(5, 80)])}
    stretched = {"elongation_x": chance.choice([0.0, chance.uniform(-2, 2)]) * mo.limit_of(scene) / scene["system"]["stiffness_x"]}
    moving = {"velocity_ratio": chance.choice([0.0, 0.0, 1e-6, 1.0, -2.0]), "elongation_y": None}
    return changed(
        scene, {"scene": {"model": "low_frequency"}, "system": {"stiffness_y": None, **angle}, "initial": {**stretched, **moving}}
    )


def lane(chance: random.Random) -> Groups:
    """One of these as a case of a sweep, with no series."""
    return changed(slow(chance), {"integrator": {"method": "rodas4p", "rtol": 10.0 ** -chance.randint(5, 8)}})


def fast(chance: random.Random) -> Groups:
    """A scene of the high-frequency model."""
    scene = steady(chance)
    share = chance.uniform(-0.95, 0.95) * mo.limit_of(scene) / scene["system"]["stiffness_x"]
    return changed(
        scene,
        {
            "scene": {"model": "high_frequency"},
            "system": {"damping_x": None},
            "friction": dict.fromkeys(("mu_static", "ageing", "ageing_time")),
            "initial": {"elongation_x": share, "elongation_y": 0.0},
        },
    )


def extreme(chance: random.Random) -> Groups:
    """Fig. 3 with every parameter anywhere within many decades, for every model and method, with their own keys."""

    def factor(decades: float) -> float:
        return 10.0 ** chance.uniform(-decades, decades)

    def side() -> float:
        return chance.choice([0.0, 1.0, 1.0, -1.0])

    groups = changed(FIG3)
    system, friction = groups["system"], groups["friction"]
    k_x, mu_0, load = 1e3 * factor(6), 0.2 * chance.choice([0.0, 1.0, factor(3)]), 10.0 * chance.choice([0.0, 1.0, factor(9)])
    system |= {"mass": 0.25 * factor(9), "stiffness_x": k_x, "stiffness_y": k_x * factor(7)}
    system["misalignment_deg"] = chance.choice([1.0, 8.655, 89.9, chance.uniform(-360, 360), 10.0 ** chance.uniform(-12, 0)])
    friction |= {"normal_load": load, "mu_0": mu_0, "mu_inf": mu_0 * chance.choice([0.75, 1.0, chance.uniform(0, 3)])}
    friction["v_f"] = 0.01 * factor(7)
    groups["drive"]["velocity"] = 1e-3 * chance.choice([1.0, factor(7), -factor(7)])
    limit = mu_0 * load or 2.0
    groups["initial"] = {
        "velocity_ratio": side() * factor(6),
        "elongation_x": limit / k_x * chance.choice([0.0, chance.uniform(-3, 3)]),
        "elongation_y": limit / system["stiffness_y"] * chance.choice([0.0, chance.uniform(-3, 3)]),
    }
    groups["integrator"]["rtol"] = chance.choice([1e-8, 1e-4, 1e-11])
    knots = sorted({0.0, *(chance.choice([0.1, 0.2, 0.5, 0.8]) for _ in range(chance.randrange(4)))})
    profile = tuple((share, chance.choice([1.0, 0.0, -1.0, 1e-6, 30.0])) for share in knots)
    kind: Kind = chance.choice(KINDS)
    return scene_of(groups, kind, ((0.0, 1.0), *profile[1:]) if len(profile) > 1 else ())


def extreme_motion(chance: random.Random) -> Groups:
    """One of these with a motion that is integrated."""
    while True:
        groups = extreme(chance)
        if groups["scene"]["model"] in {"full", "low_frequency", "high_frequency"}:
            return groups


EXTREME = (extreme, extreme_motion)


# ---------------------------------------------------------------------------------------------------------------- changes


def number_of(groups: Groups, group: str, key: str) -> float:
    return float(groups[group].get(key, 0.0))


def scaled(value: object, factor: float) -> object:
    return [x * factor for x in value] if isinstance(value, list | tuple) else value * factor


def cycle_map(chance: random.Random, groups: Groups) -> Pair:
    settle = {"scene": {"settle": chance.choice([None, None, 10.0 ** -chance.randint(3, 6)])}}
    groups = changed(groups, settle)
    return changed(groups, {"integrator": {"cycle_map": "off"}}), groups, Image(without=mo.OF_LEAPS)


def t_end(chance: random.Random, groups: Groups) -> Pair:
    settle = chance.choice([None, 10.0 ** -chance.randint(3, 6)])
    end = number_of(groups, "scene", "t_end")
    first = changed(groups, {"scene": {"settle": settle}})
    longer = end * (3 if settle is None else chance.choice([3, 30]))
    return first, changed(first, {"scene": {"t_end": longer}}), Image(longer=True)


def method(chance: random.Random, groups: Groups) -> Pair:
    rtol = 10.0 ** -chance.randint(5, 9)
    # An explicit one first: it sets the scale.
    one, other = sorted(chance.sample(sorted({*RADAU, *EXPLICIT}), 2))
    return (
        changed(groups, {"integrator": {"method": one, "rtol": rtol}}),
        changed(groups, {"integrator": {"method": other, "rtol": rtol}}),
        Image(without=mo.OF_LEAPS),
    )


def rtol(chance: random.Random, groups: Groups) -> Pair:
    return (
        changed(groups, {"integrator": {"rtol": 1e-9}}),
        changed(groups, {"integrator": {"rtol": 1e-6}}),
        Image(without=mo.OF_LEAPS),
    )


def interval(chance: random.Random, groups: Groups) -> Pair:
    step = number_of(groups, "output", "interval")
    return groups, changed(groups, {"output": {"interval": chance.choice([0.0, 2.0, 8.0, 64.0]) * step}}), SAME


def fields(chance: random.Random, groups: Groups) -> Pair:
    names = ["u_x", "w_x", "w_y", "X", "X_rate", "friction", "theta", "sticking"]
    return groups, changed(groups, {"output": {"fields": chance.sample(names, chance.randint(1, 5))}}), SAME


def knots(chance: random.Random, groups: Groups) -> Pair:
    """V(t) cut at more times, whether it is steady, a ramp or more."""
    times = [float(t) for t in np.atleast_1d(groups["drive"].get("time", 0.0))]
    values = [float(v) for v in np.atleast_1d(groups["drive"]["velocity"])]
    end = number_of(groups, "scene", "t_end")
    if times[-1] < end:
        times, values = [*times, end], [*values, values[-1]]
    for _ in range(int(log_uniform(chance, 1, 300))):
        t = chance.uniform(0, end)
        i = int(np.searchsorted(times, t))
        if 0 < i < len(times) and times[i - 1] < t < times[i]:
            share = (t - times[i - 1]) / (times[i] - times[i - 1])
            values.insert(i, values[i - 1] + share * (values[i] - values[i - 1]))
            times.insert(i, t)
    return groups, changed(groups, {"drive": {"time": times, "velocity": values}}), Image(without=("fast_decay",))


def rotation(chance: random.Random, groups: Groups) -> Pair:
    """Equal springs and dampers have no principal axes."""
    stiffness = groups["system"]["stiffness_y"]
    share = number_of(groups, "system", "stiffness_x") / number_of(groups, "system", "stiffness_y")
    phi, other = number_of(groups, "system", "misalignment_deg"), chance.uniform(-180, 180)
    turn = math.radians(other - phi)
    u_x, u_y = number_of(groups, "initial", "elongation_x") * share, number_of(groups, "initial", "elongation_y")
    first = changed(
        groups,
        {
            "system": {"stiffness_x": stiffness, "damping_x": groups["system"].get("damping_y")},
            "initial": {"elongation_x": u_x, "elongation_y": u_y},
        },
    )
    turned = {
        "elongation_x": u_x * math.cos(turn) - u_y * math.sin(turn),
        "elongation_y": u_x * math.sin(turn) + u_y * math.cos(turn),
    }
    without = (*OF_THE_LOAD, "zeta", "fast_decay", "undecided_from", "settled_at")
    return first, changed(first, {"system": {"misalignment_deg": other}, "initial": turned}), Image(turn=turn, without=without)


def shift(chance: random.Random, groups: Groups) -> Pair:
    """The drive holds first, and the object with it."""
    load = math.hypot(
        *(number_of(groups, "system", f"stiffness_{a}") * number_of(groups, "initial", f"elongation_{a}") for a in "xy")
    )
    shrink = min(1.0, chance.uniform(0.3, 0.99) * mo.limit_of(groups) / load) if load else 1.0
    start: dict[str, object] = {key: scaled(groups["initial"].get(key, 0.0), shrink) for key in ("elongation_x", "elongation_y")}
    if groups["scene"]["model"] == "low_frequency":
        del start["elongation_y"]
    # A limit that ages counts the time at rest from the beginning.
    ageless = dict.fromkeys(("ageing", "ageing_time"))
    first = changed(groups, {"initial": {"velocity_ratio": 0.0, **start}, "friction": ageless})
    later = chance.randint(1, 150) * number_of(first, "output", "interval")
    times = np.atleast_1d(first["drive"].get("time", 0.0))
    values = np.atleast_1d(first["drive"]["velocity"])
    drive = {"time": [0.0, later, *(later + times).tolist()], "velocity": [0.0, 0.0, *values.tolist()]}
    end = later + number_of(first, "scene", "t_end")
    without = (*OF_THE_HALF, "fast_decay", "undecided_from", "zeta")
    return first, changed(first, {"scene": {"t_end": end}, "drive": drive}), Image(later=later, without=without)


def mirror(groups: Groups, phi: float, negative: tuple[str, ...], image: Image) -> Pair:
    other: Groups = {"system": {"misalignment_deg": phi}, "initial": {}, "drive": {}}
    for group, key in (("initial", "elongation_x"), ("initial", "elongation_y"), ("drive", "velocity")):
        if key in negative and key in groups.get(group, {}):
            other[group][key] = scaled(groups[group][key], -1.0)
    return groups, changed(groups, other), image


def mirror_phi(chance: random.Random, groups: Groups) -> Pair:
    """What is across the soft axis changes its sign. Slip straight backwards has the angle pi in both."""
    return mirror(groups, -number_of(groups, "system", "misalignment_deg"), ("elongation_y",), Image(ACROSS))


def mirror_velocity(chance: random.Random, groups: Groups) -> Pair:
    image = Image((*SOFT, *STIFF, "X", "Y", "X_rate", "Y_rate", "pull_force"), ("theta", "psi"))
    return mirror(groups, number_of(groups, "system", "misalignment_deg"), ("elongation_x", "elongation_y", "velocity"), image)


def mirror_x(chance: random.Random, groups: Groups) -> Pair:
    image = Image((*SOFT, "Y", "Y_rate", "theta", "psi"), ("theta",))
    return mirror(groups, 180 - number_of(groups, "system", "misalignment_deg"), ("elongation_x",), image)


def half_turn(chance: random.Random, groups: Groups) -> Pair:
    image = Image((*SOFT, *STIFF), ("theta",))
    return mirror(groups, 180 + number_of(groups, "system", "misalignment_deg"), ("elongation_x", "elongation_y"), image)


def units(chance: random.Random, groups: Groups) -> Pair:
    image = Image(powers=tuple(chance.randint(-30, 30) for _ in range(3)))
    other: Groups = {}
    for group, keys in groups.items():
        for key, value in keys.items():
            if not isinstance(value, str) and (factor := image.factor(_native.key_info(group, key).units)) != 1:
                other.setdefault(group, {})[key] = scaled(value, factor)
    return groups, changed(groups, other), image


# ------------------------------------------------------------------------------------------------------------------ table


@dataclass(frozen=True)
class Row:
    """One thing that must not matter."""

    name: str
    change: Change
    families: tuple[Family, ...]
    exact: bool
    """Bit for bit; else 30 rtol (1 + C), as motions.py says."""


BITS, CLOSE = True, False
ROWS = {
    row.name: row
    for row in (
        Row("map", cycle_map, (rig, near_fig3, another_law), CLOSE),
        Row("t_end", t_end, (rig, near_fig3, slow, lane), CLOSE),
        Row("method", method, (audited, audited, slow, fast), CLOSE),
        Row("rtol", rtol, (audited, rig, near_fig3, slow, fast), CLOSE),
        Row("interval", interval, (audited, rig, near_fig3, slow, fast), BITS),
        Row("fields", fields, (audited, near_fig3, slow, fast), BITS),
        Row("knots", knots, (audited, rig, another_law, slow), CLOSE),
        Row("rotation", rotation, (audited,), CLOSE),
        Row("shift", shift, (steady, audited, rig, slow), CLOSE),
        Row("mirror phi", mirror_phi, (audited, another_law, slow, lane, fast, extreme_motion, extreme_motion), BITS),
        Row("mirror V", mirror_velocity, (audited, rig, slow, lane, fast, another_kind), CLOSE),
        Row("mirror x", mirror_x, (audited, rig, slow, lane, fast, another_model), CLOSE),
        Row("half turn", half_turn, (audited, rig, slow, lane, fast, another_model), CLOSE),
        Row("units", units, (audited, another_law, slow, lane, fast, extreme, extreme), BITS),
    )
}


# -------------------------------------------------------------------------------------------------------------- comparing


@dataclass
class Outcome:
    """One pair compared."""

    row: str
    number: int
    first: Groups
    second: Groups
    said: mo.Judgement = field(default_factory=mo.Judgement)
    ended: str = ""
    """Why there was nothing to compare: both runs ended early alike."""

    def __str__(self) -> str:
        return f"{self.row}, scene {self.number}: " + "; ".join(map(str, self.said.faults))

    @property
    def decks(self) -> str:
        return f"! first\n{mo.deck(self.first).strip()}\n! second\n{mo.deck(self.second).strip()}\n"


def pair_of(row: Row, seed: int, number: int) -> Pair:
    chance = random.Random(f"{row.name} {seed}/{number}")
    family = row.families[number % len(row.families)]
    groups = family(chance)
    if family not in (*EXTREME, another_kind, lane):
        groups = changed(groups, {"integrator": {"method": chance.choice(RADAU), "rtol": 10.0 ** -chance.randint(5, 9)}})
    if family not in EXTREME:
        groups = changed(groups, {"output": {"interval": number_of(groups, "scene", "t_end") / 128}})
    return row.change(chance, groups)


def judge(row: Row, seed: int, number: int) -> Outcome:
    first, second, image = pair_of(row, seed, number)
    outcome = Outcome(row.name, number, first, second)
    ours, theirs = mo.run(first), mo.run(second)
    if isinstance(ours, str) or isinstance(theirs, str):
        codes = [text.split(":")[0] if isinstance(text, str) else "done" for text in (ours, theirs)]
        outcome.ended = f"{ours if isinstance(ours, str) else theirs}"
        if codes[0] != codes[1] and "SolverError 42" not in codes:
            outcome.said.add("end", f"{codes[1]} for {codes[0]}: {outcome.ended}")
        return outcome
    for name, groups, result in (("first", first, ours), ("second", second, theirs)):
        faults = [*mo.order_faults(result)]
        if row.families[number % len(row.families)] not in EXTREME:
            faults += mo.position_faults(groups, result)
        for fault in faults:
            outcome.said.add(name, fault)
    compare = compare_exactly if row.exact else compare_closely
    compare(outcome, image, ours, theirs)
    return outcome


def compare_exactly(outcome: Outcome, image: Image, ours: ds.Result, theirs: ds.Result) -> None:
    said = outcome.said
    mirrored = bool(image.negative)
    time = image.factor("s")
    _, here, there = np.intersect1d(ours.time * time, theirs.time, return_indices=True)
    way = max(float(np.abs(ours[name]).max(initial=0.0)) if name in ours.columns else 0.0 for name in ("X", "u_x"))
    for name, every in image.columns(ours).items():
        if name not in theirs.columns:
            continue
        said.values += 1
        right, found = every[here], theirs[name][there]
        size = float(np.abs(right).max(initial=0.0))
        wrong = (found != right) & (np.maximum(np.abs(found), np.abs(right)) > max(1e-250 * size, UNDERFLOW))
        if name in {"theta", "psi"}:
            # Backwards is pi, and not -pi, also in the mirror and where w_y underflows.
            wrong &= differences(name, found, right) > 1e-15
        elif mirrored and name == "X":
            wrong &= np.abs(found - right) > 1e-15 * way
        if wrong.any():
            k = int(np.argmax(wrong))
            said.add(
                name, f"{found[k]!r} for {right[k]!r} at t = {theirs.time[there][k]:.9g} and {wrong.sum() - 1} more of {wrong.size}"
            )
    said.values += 1
    if not np.array_equal(ours.events["kind"], theirs.events["kind"]):
        said.add("events", f"{theirs.events['kind'].size} for {ours.events['kind'].size}")
    elif (ours.events["time"] * time != theirs.events["time"]).any():
        said.add("events", "other times")
    right_values, found_values = image.summary(ours), dict(theirs.summary)
    for key in sorted({*right_values, *found_values}):
        said.values += 1
        a, b = float(found_values.get(key, math.nan)), right_values.get(key, math.nan)
        allowed = max(1e-14 * (1.0 if key == "energy_residual" else abs(b)) if mirrored else 0.0, UNDERFLOW)
        if not (abs(a - b) <= allowed or (math.isnan(a) and math.isnan(b))):
            said.add(key, f"{a!r} for {b!r}")
    for key, count in ours.statistics.items():
        if not mirrored and key not in {"wall_time", "map_error"} and count != theirs.statistics[key]:
            said.add(key, f"{theirs.statistics[key]} for {count}")


def compare_closely(outcome: Outcome, image: Image, ours: ds.Result, theirs: ds.Result) -> None:
    # What a change does is measured where it is judged: in the frame of the second scene, if that is turned.
    said, groups = outcome.said, outcome.second if image.turn else outcome.first
    judged_at = max(mo.rtol_of(outcome.first), mo.rtol_of(outcome.second))
    motion = mo.Motion(groups, judged_at)
    t_end, interval = number_of(groups, "scene", "t_end"), number_of(groups, "output", "interval")
    skip = round(image.later / interval)
    settled, later_settled = ("settled_at" in each.summary for each in (ours, theirs))
    count = min(ours.time.size - (settled or image.longer), theirs.time.size - skip - later_settled)
    time, rows = ours.time[:count], slice(skip, skip + count)
    if np.abs(theirs.time[rows] - image.later - time).max(initial=0.0) > 4e-16 * theirs.time[-1]:
        said.add("time", "samples at other times")
        return
    kept = [
        ours.events["time"] > (0.0 if image.later else -1.0),
        theirs.events["time"] - image.later > (0.0 if image.later else -1.0),
    ]
    if image.longer:
        kept[1] &= theirs.events["time"] <= ours.time[-1]
    right = {"kind": ours.events["kind"][kept[0]], "time": ours.events["time"][kept[0]]}
    found = {"kind": theirs.events["kind"][kept[1]], "time": theirs.events["time"][kept[1]] - image.later}
    mo.compare_events(motion, found, right, t_end, said)
    columns = {
        name: values[:count] for name, values in image.columns(ours).items() if name in theirs.columns and name not in image.without
    }
    events = np.sort(np.concatenate([right["time"], found["time"]]))
    near = np.abs(time[:, None] - nearest(events, time)).min(axis=1) <= (mo.FACTOR * judged_at + mo.ROUNDOFF) * t_end
    near[:1] |= image.later > 0  # V jumps there
    scales = {name: values[:count] for name, values in mo.column_scales(groups, mo.columns_of(ours)).items()}
    mo.compare_columns(motion, {name: theirs[name][rows] for name in columns}, columns, scales, time, near, said)
    summary, other = image.summary(ours), {key: float(value) for key, value in theirs.summary.items()}
    sizes = mo.summary_scales(groups, theirs) | mo.summary_scales(groups, ours)
    keys = {*summary, *other} - {*image.without}
    if image.longer and not settled:
        keys = {"first_peak_force", "slip_angle"} & {*summary}
        regular = [key for key in mo.MEANS if f"{key}_scatter" in summary]
        if all(summary[f"{key}_scatter"] <= mo.FACTOR * judged_at * sizes[key] for key in regular):
            keys |= {*regular}
    mo.compare_summary(motion, {k: other[k] for k in keys & {*other}}, {k: summary[k] for k in keys & {*summary}}, sizes, said)


def nearest(events: np.ndarray, time: np.ndarray) -> np.ndarray:
    """The events before and after each time."""
    if events.size == 0:
        return np.full((time.size, 1), np.inf)
    after = np.searchsorted(events, time)
    return np.stack([events[np.clip(after - 1, 0, events.size - 1)], events[np.clip(after, 0, events.size - 1)]], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=100, help="of each row")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rows", default=",".join(ROWS))
    arguments = parser.parse_args()
    print(f"seed {arguments.seed}", flush=True)
    wrong = 0
    for name in arguments.rows.split(","):
        outcomes = []
        for number in range(arguments.first, arguments.first + arguments.scenes):
            outcomes.append(judge(ROWS[name], arguments.seed, number))
            if outcomes[-1].said.faults:
                print(outcomes[-1], outcomes[-1].decks, sep="\n", flush=True)
        faulty = sum(bool(o.said.faults) for o in outcomes)
        wrong += faulty
        values, unjudged = sum(o.said.values for o in outcomes), sum(len(o.said.unjudged) for o in outcomes)
        ended = sum(bool(o.ended) for o in outcomes)
        print(
            f"{name}: {faulty} of {len(outcomes)} scenes wrong; {values} values, {unjudged} not judged; {ended} scenes ended early"
        )
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
