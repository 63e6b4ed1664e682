"""Random scenes, their runs, and when two runs of one motion say the same.

The error that is allowed is 30 rtol (1 + C) in the scale of a value. C is its conditioning: how much it differs in runs at rtol = 1e-11
without the map when a parameter changes by 30 rtol, over this change. At this size, and not at a smaller one, C also tells what jumps: a
count, a first time, a cycle more in a mean. It is measured only where a value differs by more than 30 rtol.

Not judged is a value for which 30 rtol C is above 1 % of the scale, and one that differs almost as much if the parameters change by a tenth
of that: the motion is irregular, or at an edge, and no tolerance of this size decides it.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import dynstiction as ds
import numpy as np

sys.path.extend(str(Path(__file__).parents[1] / folder) for folder in ("audit", "python", "extremes"))

from drives import distance
from fig3 import Groups, changed
from truth import differences, widest

FACTOR = 30.0
STANDARD_ERRORS = 3.0
"""By how many of its standard errors an exponent may differ."""
UNJUDGED = 0.01
"""Largest 30 rtol C, in the scale, with which a value is judged. Twice: as many faults, a tenth fewer values without a judgement."""
IRREGULAR = 0.5
"""A value that differs by more than this share if the change is a tenth has no derivative. Twice: irregular means are taken for faults."""
ROUNDOFF = 1e-12
SHARP = {"method": "radau13", "rtol": 1e-11, "cycle_map": "off"}
MAX_STEPS, WALL_LIMIT = 400_000, 60.0
ENERGY = 400.0
"""As in tests/extremes: the largest |energy_residual| over rtol."""


def position_roundoff(steps: float) -> float:
    """By which X may differ from D - u.e: roundoff adds up over many steps."""
    return max(1e-13, 1e-16 * steps)


PERTURBED = {
    "system": ("mass", "stiffness_x", "stiffness_y", "misalignment_deg"),
    "friction": ("normal_load",),
    "drive": ("velocity",),
}
JUMPING = ("friction", "theta", "psi", "zeta")
"""Columns that jump where rest begins."""
COUNTS = ("cycles", "sticks")
OF_LEAPS = ("lyapunov_exponent", "lyapunov_error", "conditioning", "regularity", "repeats")
"""What only runs with leaps have."""
MEANS = ("period", "peak_force", "valley_force", "stick_duration", "slip_duration", "slip_length")


class Values(dict[str, float]):
    """Values with their units."""

    units: dict[str, str]


class Lane:
    """A case of a sweep, which has no series, in the form of a run."""

    def __init__(self, groups: Groups) -> None:
        speed = groups["drive"]["velocity"]
        found = ds.sweep(ds.Scene(**groups), {"drive.velocity": [speed]}, points=True, progress=False)
        numbers = {str(key): found[key] for key in found if found[key].dtype == np.float64 and "." not in str(key)}
        given = {key: values for key, values in numbers.items() if not np.isnan(values.values[0])}
        self.statistics = {"steps": float(given.pop("steps").values[0])}
        del given["wall_time"]
        self.summary = Values({key: float(values.values[0]) for key, values in given.items()})
        self.summary.units = {key: values.attrs["units"] for key, values in given.items()}
        self.attributes = {"result_code": int(found["result_code"].values[0]), "result_text": str(found["result_text"].values[0])}
        self.columns, self.time, self.events = Values(), np.zeros(1), {"kind": np.empty(0), "time": np.empty(0)}


def run(groups: Groups) -> ds.Result | str:
    """The result, or why there is none."""
    lane = groups["integrator"].get("method") == "rodas4p"
    limits: Groups = {"integrator": {"max_steps": MAX_STEPS}, "output": {"wall_limit": WALL_LIMIT}}
    if groups["scene"]["model"] in {"creep", "creep_asymptotic"}:
        limits = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            result = Lane(groups) if lane else ds.run(ds.Scene(**changed(limits, groups)))
        except (ds.SolverError, ds.DeckError) as error:
            return f"{type(error).__name__} {getattr(error, 'code', '')}: {error}"
    return result if result.attributes["result_code"] == 0 else str(result.attributes["result_text"])


def deck(groups: Groups) -> str:
    """The deck that a person can run."""
    return ds.Scene(**groups).to_deck()


def rtol_of(groups: Groups) -> float:
    return float(groups["integrator"].get("rtol", 1e-8))


def value_of(result: ds.Result, key: str) -> float:
    """A summary value; NaN where there is none."""
    return float(result.summary.get(key, math.nan))


def columns_of(result: ds.Result) -> dict[str, np.ndarray]:
    return {name: result[name] for name in result.columns if name != "time"}


def limit_of(groups: Groups) -> float:
    """The static limit F_s [N]."""
    friction = groups["friction"]
    coefficients = [friction.get(key, 0.0) for key in ("mu_0", "mu_static")]
    coefficients += friction.get("table_mu", [])[:1]
    return max(map(float, coefficients)) * float(friction["normal_load"])


def summary_scales(groups: Groups, result: ds.Result) -> dict[str, float]:
    """The scale in which a summary value is judged.

    Forces: F_s. Durations: the period, else t_end; other times: t_end, the time at rest by an explicit method t_end for each stick, as
    it leaves each event an error of its own. Works: what was exchanged. slip_length: at least the length that
    loads the spring up to F_s. max_X_rate: itself. pull_frequency: itself over the swing in F_s, as an error of the force, which is
    one of F_s, moves the peaks of a small swing as far. Angles and shares: 1. A scatter: as its mean. The exponent: 10, as steps are
    chosen for the motion, not for its derivative (on a line off the axes it was wrong by 310 rtol).
    """
    limit, t_end = limit_of(groups), float(groups["scene"]["t_end"])
    period = value_of(result, "period")
    works = ("drive_work", "friction_work", "damper_work")
    found = {
        **dict.fromkeys(("first_peak_force", "peak_force", "valley_force", "swing"), limit),
        **dict.fromkeys(("period", "slip_duration", "stick_duration"), period if period > 0 else t_end),
        **dict.fromkeys(("settled_at", "undecided_from"), t_end),
        "sticking_time": t_end * (max(1.0, value_of(result, "sticks")) if is_explicit(groups) else 1.0),
        **dict.fromkeys(works, sum(abs(float(result.summary.get(key, 0.0))) for key in works)),
        "max_X_rate": value_of(result, "max_X_rate"),
        "pull_frequency": value_of(result, "pull_frequency") * max(1.0, limit / max(value_of(result, "pull_swing"), 1e-300)),
        "lyapunov_exponent": 10.0,
        "slip_length": max(abs(value_of(result, "slip_length")), limit / float(groups["system"]["stiffness_x"])),
    }
    return {key: max(found.get(key.removesuffix("_scatter"), 1.0), 1e-300) for key in result.summary}


def is_explicit(groups: Groups) -> bool:
    return groups["integrator"].get("method") in {"dopri5", "dop853"}


def column_scales(groups: Groups, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The scale of each column at each sample; as in tests/audit/truth.py, from the run itself."""
    if "w_x" not in columns or "w_y" not in columns:
        return {name: np.full(values.size, np.abs(values).max(initial=1e-300)) for name, values in columns.items()}
    limit = limit_of(groups)
    largest = {name: float(np.abs(values).max(initial=0.0)) for name, values in columns.items()}
    speed = np.hypot(columns["w_x"], columns["w_y"])
    load = np.hypot(columns["spring_force_x"], columns["spring_force_y"])
    fastest = float(speed.max(initial=0.0))
    told = np.where(columns["sticking"] == 1, load > 1e-3 * limit, speed > 1e-3 * fastest)
    elongation = max(largest["u_x"], largest["u_y"])
    stiffness = float(groups["system"].get("stiffness_y", math.inf))
    found = {
        "u_x": largest["u_x"],
        "u_y": max(largest["u_y"], limit / stiffness),
        "X": max(largest["X"], 1e-3 * elongation),
        "Y": max(largest["Y"], 1e-3 * elongation),
        "spring_force_x": largest["spring_force_x"],
        "spring_force_y": max(largest["spring_force_y"], limit),
        "friction": limit,
        "sticking": 1.0,
        **dict.fromkeys(("w_x", "w_y", "X_rate", "Y_rate"), fastest),
        **dict.fromkeys(("theta", "psi"), np.where(told, 1.0, np.inf)),
        "zeta": np.where(told, largest.get("zeta", 0.0), np.inf),
    }
    return {name: np.maximum(found.get(name, largest[name]), 1e-300) * np.ones_like(speed) for name in columns}


@dataclass
class Motion:
    """A scene, the tolerance at which it is judged, and its runs with changed parameters."""

    groups: Groups
    rtol: float
    known: dict[float, list[ds.Result]] = field(default_factory=dict)

    def perturbed(self, share: float = 1.0) -> list[ds.Result]:
        """The sharp run, and those of changed parameters; none if one of them ends early."""
        if share not in self.known:
            self.known[share] = self._perturb(share)
        return self.known[share]

    def _perturb(self, share: float) -> list[ds.Result]:
        integrator = {key: None for key in self.groups["integrator"]} | SHARP
        if self.groups["scene"]["model"] != "full":
            integrator["cycle_map"] = None
        sharp = changed(self.groups, {"integrator": integrator})
        scenes = [sharp]
        for group, keys in PERTURBED.items():
            for key in keys:
                value = sharp[group].get(key)
                for factor in () if value is None else (1 - share * FACTOR * self.rtol, 1 + share * FACTOR * self.rtol):
                    scaled = [x * factor for x in value] if isinstance(value, list | tuple) else value * factor
                    scenes.append(changed(sharp, {group: {key: scaled}}))
        runs: list[ds.Result] = []
        for scene in scenes:
            result = run(scene)
            if isinstance(result, str):
                return []
            runs.append(result)
        return runs

    def spread(self, key: str, share: float = 1.0) -> float:
        """30 rtol C of a summary value; infinite where a changed scene has none, or nothing is known."""
        runs = self.perturbed(share)
        gaps = [abs(value_of(other, key) - value_of(runs[0], key)) for other in runs[1:]]
        return max((math.inf if math.isnan(gap) else gap for gap in gaps), default=math.inf)

    def column_spread(self, name: str, size: int) -> np.ndarray:
        """The same of a column, at each sample the largest of it and its neighbours; of columns that jump where both rest or both slip.

        Infinite after the end of a run, which may settle.
        """
        here, *others = self.perturbed()
        found = np.zeros(size)
        for other in others:
            n = min(size, here.time.size, other.time.size)
            gap = differences(name, other[name][:n], here[name][:n])
            if name in JUMPING:
                gap = np.where(other["sticking"][:n] == here["sticking"][:n], gap, 0.0)
            found[:n] = np.fmax(found[:n], gap)
            found[n:] = np.inf
        return widest(found)

    def events(self, share: float = 1.0) -> tuple[np.ndarray, np.ndarray, float]:
        """Times of the events up to where a changed scene has other events or a spread above 1 % of t_end; 30 rtol C of each; until when [s]."""
        runs = [each.events for each in self.perturbed(share)]
        if not runs:
            return np.empty(0), np.empty(0), 0.0
        here, count = runs[0], min(each["kind"].size for each in runs)
        alike = np.all([each["kind"][:count] == here["kind"][:count] for each in runs], axis=0)
        spread = np.max([np.abs(each["time"][:count] - here["time"][:count]) for each in runs], axis=0)
        alike &= spread <= UNJUDGED * float(self.groups["scene"]["t_end"])
        told = count if alike.all() else int(np.argmin(alike))
        until = min((each["time"][told] for each in runs if each["time"].size > told), default=math.inf)
        return here["time"][:told], spread[:told], float(until)

    def regular_until(self) -> float:
        """When the spread of the events ceases to be in proportion to the change [s]."""
        events, spread, until = self.events()
        _, small, small_until = self.events(0.1)
        count = min(spread.size, small.size)
        plain = (FACTOR * self.rtol + ROUNDOFF) * float(self.groups["scene"]["t_end"])
        chaotic = (small[:count] > IRREGULAR * spread[:count]) & (spread[:count] > plain)
        return min(until, small_until, *events[:count][chaotic][:1])

    def untold(self, time: np.ndarray) -> np.ndarray:
        """Whether a time is as near to an event as its 30 rtol C, or after all that is told."""
        events, spread, until = self.events()
        reach = spread + (FACTOR * self.rtol + ROUNDOFF) * float(self.groups["scene"]["t_end"])
        entered, left = np.sort(events - reach), np.sort(events + reach)
        inside = np.searchsorted(entered, time, side="right") > np.searchsorted(left, time, side="left")
        return np.asarray(inside | (time >= until))


@dataclass
class Fault:
    """A value that differs by more than is allowed."""

    name: str
    text: str
    over: float
    """Difference over the allowed one."""

    def __str__(self) -> str:
        return f"{self.name}: {self.text} ({self.over:.3g} of the allowed error)"


@dataclass
class Judgement:
    """What was compared: how many values, which were not judged, and which are wrong."""

    values: int = 0
    unjudged: list[str] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)

    def add(self, name: str, text: str, over: float = math.inf) -> None:
        self.faults.append(Fault(name, text, over))


def compare_summary(
    motion: Motion, found: dict[str, float], right: dict[str, float], scales: dict[str, float], said: Judgement
) -> None:
    """Every summary value."""
    # An exponent by the growth in the cycles so far is an estimate with an error; by the multiplier of one that repeats it has none.
    errors = [of.get("lyapunov_error", 0.0) for of in (found, right)]
    for key in sorted({*found, *right}):
        said.values += 1
        a, b, scale = found.get(key, math.nan), right.get(key, math.nan), scales[key]
        plain = ((ENERGY if key == "energy_residual" else FACTOR) * motion.rtol + ROUNDOFF) * scale
        if key == "lyapunov_exponent":
            plain += STANDARD_ERRORS * sum(errors)
        elif key == "lyapunov_error":
            plain = max(plain, *errors)
        gap = math.inf if math.isnan(a) != math.isnan(b) else abs(a - b)
        if gap <= plain or (math.isnan(a) and math.isnan(b)):
            continue
        spread = motion.spread(key)
        if gap <= plain + spread < math.inf:
            continue
        if spread > (0.5 if key in COUNTS else UNJUDGED * scale) or (
            spread > plain and motion.spread(key, 0.1) > IRREGULAR * spread
        ):
            said.unjudged.append(key)
        else:
            said.add(key, f"{a:.12g} for {b:.12g}", gap / (plain + spread))


def compare_columns(
    motion: Motion,
    found: dict[str, np.ndarray],
    right: dict[str, np.ndarray],
    scales: dict[str, np.ndarray],
    time: np.ndarray,
    near: np.ndarray,
    said: Judgement,
) -> None:
    """Every column at every sample but those `near` an event, where rest and slip are both true."""
    same = found["sticking"] == right["sticking"] if "sticking" in right else np.ones(time.size, dtype=bool)
    untold = None
    for name, true in right.items():
        said.values += 1
        gap = differences(name, found[name], true)
        plain = (FACTOR * motion.rtol + ROUNDOFF) * scales[name]
        wrong = ~(gap <= plain) & ~near & (same | (name not in JUMPING))
        if not wrong.any():
            continue
        if not motion.perturbed():
            said.unjudged.append(name)
            continue
        spread = motion.column_spread(name, time.size)
        untold = motion.untold(time) if untold is None else untold
        judged = ~untold & (spread <= UNJUDGED * scales[name])
        wrong &= judged & (gap > plain + spread)
        if wrong.any():
            wrong &= time < motion.regular_until()
            judged &= wrong.any()
        if wrong.any():
            k = int(np.argmax(np.where(wrong, gap / (plain + spread), 0.0)))
            said.add(name, f"{found[name][k]:.12g} for {true[k]:.12g} at t = {time[k]:.9g}", float(gap[k] / (plain + spread)[k]))
        elif np.count_nonzero(judged) < 0.5 * judged.size:
            said.unjudged.append(name)


def compare_events(
    motion: Motion, found: dict[str, np.ndarray], right: dict[str, np.ndarray], t_end: float, said: Judgement
) -> None:
    """Kinds and times."""
    said.values += 1
    alike = np.array_equal(found["kind"], right["kind"])
    plain = (FACTOR * motion.rtol + ROUNDOFF) * t_end
    if alike and (np.abs(found["time"] - right["time"]) <= plain).all():
        return
    events, spread, until = motion.events()
    count = min(events.size, *(int(np.count_nonzero(each["time"] < until)) for each in (found, right)))
    wrong = ~(np.abs(found["time"][:count] - right["time"][:count]) <= plain + spread[:count])
    wrong |= found["kind"][:count] != right["kind"][:count]
    alike |= wrong.any()
    if wrong.any():
        until = motion.regular_until()
        wrong &= events[:count] < until
    if wrong.any():
        k = int(np.argmax(wrong))
        gap = abs(found["time"][k] - right["time"][k])
        said.add(
            "events", f"number {k} at {found['time'][k]:.12g} s for {right['time'][k]:.12g} s", float(gap / (plain + spread[k]))
        )
    elif until == math.inf and not alike:
        said.add("events", f"{found['kind'].size} for {right['kind'].size}")
    elif until < 0.5 * t_end:
        said.unjudged.append("events")


def order_faults(result: ds.Result) -> Iterator[str]:
    """What holds in every run: time runs on, events take turns, nothing is after the end, the balance is closed."""
    time, kind, end = result.events["time"], result.events["kind"], result.time[-1]
    if (np.diff(result.time) < 0).any():
        yield "the samples run back"
    if (np.diff(time) < 0).any():
        yield f"the events run back by {-np.diff(time).min():.3g} s"
    if time.size and not 0 <= time[0] <= time[-1] <= end:
        yield f"events from {time[0]:.9g} to {time[-1]:.9g} s, the end is at {end:.9g} s"
    if (kind[1:] == kind[:-1]).any():
        yield "stick and slip do not take turns"


def position_faults(groups: Groups, result: ds.Result) -> Iterator[str]:
    """X = D(t) - u.e to roundoff, in the full and the low-frequency model."""
    if groups["scene"]["model"] not in {"full", "low_frequency"} or not {"X", "u_y"} <= {*result.columns}:
        return
    if groups["integrator"].get("method") == "rk4":
        return
    phi = math.radians(float(groups["system"]["misalignment_deg"]))
    knots = groups["drive"].get("time", 0.0)
    driven = distance(groups["drive"]["velocity"], knots, result.time)
    stretch = result["u_x"].astype(np.longdouble) * math.cos(phi) + result["u_y"].astype(np.longdouble) * math.sin(phi)
    gap = np.abs(np.asarray(result["X"] - (driven - stretch), dtype=float))
    way = np.abs(np.diff([*np.atleast_1d(knots), result.time[-1]])) @ np.abs(np.atleast_1d(groups["drive"]["velocity"]))
    scale = max(float(way), float(np.abs(stretch).max()))
    if (gap > position_roundoff(result.statistics["steps"]) * scale).any():
        yield f"X differs from D - u.e by {gap.max() / scale:.1e}"
