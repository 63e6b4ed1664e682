"""Pairs of scenes that must have the same motion: mirrored, in other units, with redundant knots, later.

python tests/audit/pairs.py [--pairs 1000] [--seed 12] [--kinds mirror_V,units,...] [--report FILE]

| kind | the second scene | equal |
| --- | --- | --- |
| `mirror_phi` | φ → −φ, elongation_y → −elongation_y | bit for bit |
| `mirror_V` | V → −V, elongations too | within tolerance |
| `mirror_x` | φ → 180° − φ, elongation_x → −elongation_x | within tolerance |
| `turned` | φ → 180° + φ, elongations with the other sign | within tolerance |
| `units` | lengths, times and masses by powers of two, up to 2^30 and 2^-30 | bit for bit, work counters too |
| `knots` | V(t) cut by redundant knots, up to thousands | within tolerance, same sticks |
| `shift` | V = 0 for a while at first | within tolerance, same events later |

Within tolerance means 30 rtol (1 + C) in a column's scale, with the conditioning C that runs of the package at rtol 1e-11 with
parameters changed by 1e-8 show. In every run of the full and the low-frequency model X = D(t) − u·e must hold to roundoff at every sample.
"""

from __future__ import annotations

import argparse
import collections
import math
import random
import sys
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path

import dynstiction as ds
import numpy as np
from scenes import Groups, Scene, log_uniform, random_scene
from truth import differences, widest

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))

from drives import distance

Columns = dict[str, np.ndarray]

KINDS = ("mirror_phi", "mirror_V", "mirror_x", "turned", "units", "knots", "shift")
EXACT = ("mirror_phi", "units")
SEED = 12
FACTOR = 30.0
FIXED = 1e-9
"""What stands for rtol with methods of a fixed step."""
POSITION = 1e-13
MAX_STEPS = 100_000
PERTURBED = ("normal_load", "mass", "stiffness_x", "stiffness_y", "velocity", "misalignment_deg")
CHANGE = 1e-8

JUMPING = ("friction", "theta", "psi", "zeta", "sticking")
"""What jumps where rest begins."""

CONTINUOUS = ("u_x", "u_y", "X", "Y", "spring_force_x")
"""What does not jump with V in any model."""

# What changes its sign, and what becomes of the angles.
SIGNS: dict[str, tuple[str, ...]] = {
    "mirror_phi": ("u_y", "w_y", "Y", "Y_rate", "spring_force_y", "theta", "psi"),
    "mirror_V": ("u_x", "u_y", "w_x", "w_y", "X", "Y", "X_rate", "Y_rate", "spring_force_x", "spring_force_y"),
    "mirror_x": ("u_x", "w_x", "Y", "Y_rate", "spring_force_x", "theta", "psi"),
    "turned": ("u_x", "u_y", "w_x", "w_y", "spring_force_x", "spring_force_y"),
}
HALF_TURNS = {"mirror_V": ("theta", "psi"), "mirror_x": ("theta",), "turned": ("theta",)}

# Units as powers of length, time, mass.
LENGTH, SPEED, FORCE = (1, 0, 0), (1, -1, 0), (1, -2, 1)
ENERGY, TIME, NUMBER = (2, -2, 1), (0, 1, 0), (0, 0, 0)
SCENE_UNITS = {
    "mass": (0, 0, 1),
    **dict.fromkeys(("stiffness_x", "stiffness_y"), (0, -2, 1)),
    **dict.fromkeys(("velocity", "v_f"), SPEED),
    **dict.fromkeys(("time", "t_end"), TIME),
    **dict.fromkeys(("elongation_x", "elongation_y"), LENGTH),
    "normal_load": FORCE,
}
COLUMN_UNITS = {
    **dict.fromkeys(("u_x", "u_y", "X", "Y"), LENGTH),
    **dict.fromkeys(("w_x", "w_y", "X_rate", "Y_rate"), SPEED),
    **dict.fromkeys(("spring_force_x", "spring_force_y", "friction"), FORCE),
    **dict.fromkeys(("theta", "psi", "sticking", "zeta"), NUMBER),
}
SUMMARY_UNITS = {
    **dict.fromkeys(("creep_share", "cycles", "energy_residual", "slip_angle", "sticks"), NUMBER),
    **dict.fromkeys(("fast_decay", "lyapunov_exponent", "lyapunov_error", "regularity"), NUMBER),
    **dict.fromkeys(("drive_work", "friction_work"), ENERGY),
    **dict.fromkeys(("first_peak_force", "peak_force", "valley_force", "swing"), FORCE),
    **dict.fromkeys(("period", "slip_duration", "stick_duration", "sticking_time"), TIME),
    "max_X_rate": SPEED,
    "slip_length": LENGTH,
}


@dataclass(frozen=True)
class Side:
    """One scene of a pair: what the deck gets."""

    scene: Scene
    model: str
    method: str
    rtol: float
    step: float = 0.0
    v_smooth: float = 0.0
    interval: float = 0.0

    def groups(self) -> Groups:
        integrator: dict[str, object] = {"method": self.method, "max_steps": MAX_STEPS}
        if self.step > 0:
            integrator["step"] = self.step
        else:
            integrator["rtol"] = self.rtol
        groups = self.scene.groups(self.model, **integrator)
        groups["output"] = {"interval": self.interval or self.scene.interval}
        if self.v_smooth > 0:
            groups["friction"] |= {"contact": "smoothed", "v_smooth": self.v_smooth}
        return groups

    def deck(self) -> ds.Scene:
        return ds.Scene(**self.groups())

    def run(self) -> ds.Result | str:
        """The result, or why there is none."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ds.IncompleteWarning)
            try:
                return ds.run(self.deck())
            except (ds.SolverError, ds.DeckError) as error:
                return f"{type(error).__name__} {getattr(error, 'code', '')}: {error}"


@dataclass
class Outcome:
    """One pair compared."""

    number: int
    kind: str
    first: Side
    second: Side
    faults: list[str] = field(default_factory=list)
    ended: str = ""
    """Why there was nothing to compare: both runs ended early alike."""
    exact: bool = False

    @property
    def name(self) -> str:
        rtol = f"step {self.first.step:.1g}" if self.first.step else f"{self.first.rtol:.0e}"
        return f"{self.number} {self.kind} {self.first.model} {self.first.method} {rtol}"


# ------------------------------------------------------------------------------------------------------- making the pairs


def random_pair(seed: int, number: int, kinds: tuple[str, ...] = KINDS) -> tuple[str, Side, Side, float, float]:
    """Kind, both sides, the time by which the second is later, and the power of two of each unit packed in `units_of`."""
    chance = random.Random(f"pair {seed}/{number}")
    kind = kinds[number % len(kinds)]
    model = chance.choice(["full"] * 13 + ["low_frequency"] * 5 + (["high_frequency"] * 2 if kind != "shift" else []))
    scene = random_scene(seed + 1000, number, profiles=model == "full" and kind != "knots")
    if model == "low_frequency":
        scene = _slow(chance, scene)
    elif model == "high_frequency":
        share = chance.uniform(-0.95, 0.95)
        scene = replace(scene, elongation_x=share * scene.limit / scene.stiffness_x, elongation_y=0.0)
    if kind == "shift":
        share = math.hypot(scene.stiffness_x * scene.elongation_x, scene.stiffness_y * scene.elongation_y) / scene.limit
        shrink = chance.uniform(0.3, 0.99) / share if share > 0.99 else 1.0
        scene = replace(
            scene, velocity_ratio=0.0, elongation_x=scene.elongation_x * shrink, elongation_y=scene.elongation_y * shrink
        )
    if kind == "knots":
        scene = _ramp(chance, scene)
    first = _with_method(chance, kind, scene, model)
    return kind, *_second(chance, kind, first)


def _slow(chance: random.Random, scene: Scene) -> Scene:
    """Long enough for the slow motion."""
    speed = max(map(abs, scene.velocity))
    end = chance.uniform(0.8, 4) * scene.limit / (scene.stiffness_x * speed * scene.along[0])
    end = min(end, 300 * 2 * math.pi * math.sqrt(scene.mass / scene.stiffness_x))
    return replace(scene, t_end=float(f"{end:.6g}"), elongation_y=0.0)


def _ramp(chance: random.Random, scene: Scene) -> Scene:
    """Constant V or a ramp."""
    if chance.random() < 0.5:
        return scene
    end = scene.velocity[0] * chance.uniform(-1, 2)
    return replace(scene, time=(0.0, scene.t_end), velocity=(scene.velocity[0], end))


def _with_method(chance: random.Random, kind: str, scene: Scene, model: str) -> Side:
    methods = ["radau5", "radau9", "radau9", "radau13", "radau13", "dopri5", "dop853"]
    if kind in EXACT:
        methods += ["moreau_jean"] if model == "full" else []
        methods += ["rk4"] if model == "full" else []
    method = chance.choice(methods)
    rtol = chance.choice([1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10])
    fast = 2 * math.pi * math.sqrt(scene.mass / max(scene.stiffness_x, scene.stiffness_y))
    if method == "moreau_jean":
        return Side(scene, model, method, FIXED, step=fast / 40)
    if method == "rk4":
        return Side(scene, model, method, FIXED, step=fast / 40, v_smooth=0.3 * abs(scene.velocity[0]))
    return Side(scene, model, method, rtol)


def _second(chance: random.Random, kind: str, first: Side) -> tuple[Side, Side, float, tuple[int, int, int]]:
    scene = first.scene
    none = (0, 0, 0)
    if kind == "units":
        powers = tuple(chance.randint(-30, 30) for _ in range(3))
        return first, in_units(first, powers), 0.0, powers
    if kind == "knots":
        return first, replace(first, scene=cut(chance, scene)), 0.0, none
    if kind == "shift":
        return *shifted(chance, first), none
    phi, u_x, u_y = scene.misalignment_deg, scene.elongation_x, scene.elongation_y
    velocity = scene.velocity
    if kind == "mirror_phi":
        phi, u_y = -phi, -u_y
    elif kind == "mirror_V":
        velocity, u_x, u_y = tuple(-v for v in velocity), -u_x, -u_y
    elif kind == "mirror_x":
        phi, u_x = 180 - phi, -u_x
    elif kind == "turned":
        phi, u_x, u_y = 180 + phi, -u_x, -u_y
    other = replace(scene, misalignment_deg=phi, velocity=velocity, elongation_x=u_x, elongation_y=u_y)
    return first, replace(first, scene=other), 0.0, none


def unit(dimension: tuple[int, int, int], powers: tuple[int, int, int]) -> float:
    return 2.0 ** sum(d * p for d, p in zip(dimension, powers, strict=True))


def in_units(side: Side, powers: tuple[int, int, int]) -> Side:
    """The same scene in other units."""

    def scaled(value: float | tuple[float, ...], dimension: tuple[int, int, int]) -> float | tuple[float, ...]:
        factor = unit(dimension, powers)
        return tuple(x * factor for x in value) if isinstance(value, tuple) else value * factor

    scene = replace(side.scene, **{name: scaled(getattr(side.scene, name), of) for name, of in SCENE_UNITS.items()})
    step, v_smooth = scaled(side.step, TIME), scaled(side.v_smooth, SPEED)
    return replace(side, scene=scene, step=step, v_smooth=v_smooth, interval=scaled(side.scene.interval, TIME))


def cut(chance: random.Random, scene: Scene) -> Scene:
    """The same V(t) with redundant knots."""
    count = int(log_uniform(chance, 1, 4000))
    times = {0.0, *(chance.uniform(0, scene.t_end) for _ in range(count))}
    if len(scene.velocity) > 1:
        times.add(scene.time[-1])
    ordered = sorted(times)
    return replace(scene, time=tuple(ordered), velocity=tuple(drive_velocity(scene, t) for t in ordered))


def shifted(chance: random.Random, first: Side) -> tuple[Side, Side, float]:
    scene = first.scene
    k = chance.randint(1, 150)
    interval = scene.interval
    later = k * interval
    second = replace(
        scene, time=(0.0, later, *(later + t for t in scene.time)), velocity=(0.0, 0.0, *scene.velocity), t_end=later + scene.t_end
    )
    first = replace(first, interval=interval)
    return first, replace(first, scene=second), later


def drive_velocity(scene: Scene, t: float) -> float:
    return float(np.interp(t, scene.time, scene.velocity))


# -------------------------------------------------------------------------------------------------------- comparing them


def columns_of(result: ds.Result) -> Columns:
    return {name: result[name] for name in result.columns if name != "time"}


def scales_of(side: Side, columns: Columns) -> dict[str, np.ndarray]:
    """The scale of each column; as in truth.py, from the run itself."""
    scene, limit = side.scene, side.scene.limit
    largest = {name: float(np.abs(values).max(initial=0.0)) for name, values in columns.items()}
    speed = np.hypot(columns["w_x"], columns["w_y"])
    load = np.hypot(columns["spring_force_x"], columns["spring_force_y"])
    fastest = float(speed.max(initial=0.0))
    told = np.where(columns["sticking"] == 1, load > 1e-3 * limit, speed > 1e-3 * fastest)
    elongation = max(largest["u_x"], largest["u_y"])
    found = {
        "u_x": largest["u_x"],
        "u_y": max(largest["u_y"], limit / scene.stiffness_y),
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
    return {name: np.maximum(found[name], 1e-300) * np.ones_like(speed) for name in columns}


@dataclass
class Conditioning:
    """How columns, events and summary values change with the parameters."""

    columns: Columns
    events: float
    summary: dict[str, float]
    sticks_vary: bool
    worst: float


def conditioning(side: Side) -> Conditioning | None:
    sharp = replace(side, method="radau9", rtol=1e-11, step=0.0)
    here = sharp.run()
    if isinstance(here, str):
        return None
    columns = columns_of(here)
    scales = scales_of(side, columns)
    found = {name: np.zeros_like(values, dtype=float) for name, values in columns.items()}
    summary: dict[str, float] = dict.fromkeys(here.summary, 0.0)
    events, vary = 0.0, False
    for name in PERTURBED:
        value = getattr(side.scene, name)
        changed = tuple(v * (1 + CHANGE) for v in value) if isinstance(value, tuple) else value * (1 + CHANGE)
        there = replace(sharp, scene=replace(side.scene, **{name: changed})).run()
        if isinstance(there, str) or there.time.size != here.time.size:
            return None
        same = there["sticking"] == here["sticking"]
        always = np.ones_like(same)
        for column, values in columns.items():
            comparable = same if column in JUMPING else always
            gap = np.where(comparable, differences(column, there[column], values) / scales[column], 0.0)
            found[column] = np.maximum(found[column], gap / CHANGE)
        if np.array_equal(there.events["kind"], here.events["kind"]):
            shift = np.abs(there.events["time"] - here.events["time"]).max(initial=0.0)
            events = max(events, float(shift) / side.scene.t_end / CHANGE)
        else:
            vary = True
        for key, number in here.summary.items():
            if key in there.summary and number != 0:
                summary[key] = max(summary[key], abs(there.summary[key] / number - 1) / CHANGE)
            elif key not in there.summary:
                summary[key] = np.inf
    found = {column: widest(values) for column, values in found.items()}
    worst = max(float(values.max(initial=0.0)) for name, values in found.items() if name != "sticking")
    return Conditioning(found, events, summary, vary, worst)


def expected(kind: str, columns: Columns, powers: tuple[int, int, int]) -> Columns:
    """What the second scene's columns must be, from the first's."""
    found = {}
    for name, values in columns.items():
        image = values * unit(COLUMN_UNITS[name], powers)
        if name in SIGNS.get(kind, ()):
            image = -image
        if name in HALF_TURNS.get(kind, ()):
            image = image + np.pi
        found[name] = image
    return found


def compare_exactly(outcome: Outcome, ours: ds.Result, theirs: ds.Result, powers: tuple[int, int, int]) -> None:
    images = expected(outcome.kind, columns_of(ours), powers)
    for name, image in images.items():
        values = theirs[name]
        if outcome.kind == "mirror_phi" and name in {"theta", "psi"}:
            wrong = differences(name, values, image) > 1e-15  # backwards is pi, and not -pi, in both
        elif outcome.kind == "mirror_phi" and name == "X":
            way = max(float(np.abs(ours[key]).max()) for key in ("X", "u_x"))
            wrong = np.abs(values - image) > 1e-15 * way
        else:
            # e^(-v/v_f) at v >> v_f may reach the end of the range of doubles in one of the units.
            floor = 1e-250 * float(np.abs(image).max())
            wrong = (values != image) & ((np.abs(values) > floor) | (np.abs(image) > floor))
        if wrong.any():
            k = int(np.argmax(wrong))
            scale = float(np.abs(image).max()) or 1.0
            largest = float(differences(name, values, image).max()) / scale
            outcome.faults.append(
                f"{name} differs in {np.count_nonzero(wrong)} of {wrong.size} samples, first at t = {ours.time[k]:.9g}, at most by {largest:.1e}"
            )
    time = unit(TIME, powers)
    if not np.array_equal(ours.events["kind"], theirs.events["kind"]):
        outcome.faults.append(f"{ours.events['kind'].size} events, {theirs.events['kind'].size} in the image")
    elif (ours.events["time"] * time != theirs.events["time"]).any():
        outcome.faults.append("event times differ")
    compare_summary_exactly(outcome, ours, theirs, powers)


def compare_summary_exactly(outcome: Outcome, ours: ds.Result, theirs: ds.Result, powers: tuple[int, int, int]) -> None:
    for key in sorted({*ours.summary} | {*theirs.summary}):
        a, b = ours.summary.get(key), theirs.summary.get(key)
        if a is None or b is None:
            outcome.faults.append(f"summary {key}: {a} and {b}")
            continue
        image = a * unit(SUMMARY_UNITS[key.removesuffix("_scatter")], powers)
        if key == "energy_residual" and outcome.kind == "mirror_phi":
            good = abs(image - b) < 1e-14
        else:
            good = image == b or (outcome.kind == "mirror_phi" and abs(image - b) <= 1e-14 * abs(b))
        if not good:
            outcome.faults.append(f"summary {key}: {image!r} and {b!r}")
    if outcome.kind == "units":
        for key, count in ours.statistics.items():
            if key != "wall_time" and count != theirs.statistics[key]:
                outcome.faults.append(f"statistics {key}: {count} and {theirs.statistics[key]}")


def compare_closely(outcome: Outcome, ours: ds.Result, theirs: ds.Result, later: float) -> None:
    side = outcome.first
    condition = conditioning(side)
    if condition is None:
        outcome.ended = "the sharp run failed"
        return
    allowed = FACTOR * side.rtol
    columns = columns_of(ours)
    scales = scales_of(side, columns)
    images = expected(outcome.kind, columns, (0, 0, 0))
    first = round(later / side.interval) if later else 0
    rows = slice(first, first + ours.time.size)
    shift = theirs.time[rows] - later
    if shift.size != ours.time.size or np.abs(shift - ours.time).max() > 4e-16 * theirs.time[-1]:
        outcome.faults.append("samples at other times")
        return
    same = theirs["sticking"][rows] == ours["sticking"]
    always = np.ones_like(same)
    # Where the hold ends V jumps, and with it the velocity across of the low-frequency model: both states are true there.
    apart = ~always
    apart[0] = later > 0
    near = (allowed * (1 + condition.events) + 1e-13) * side.scene.t_end
    for name, image in images.items():
        if name not in theirs:
            continue  # zeta has no value where the drive holds
        if name == "sticking":
            event = np.concatenate([ours.events["time"], theirs.events["time"] - later])
            off = [np.abs(event - t).min(initial=np.inf) for t in ours.time[~same]]
            if any(distance > near for distance in off) and not condition.sticks_vary:
                outcome.faults.append(f"sticking differs in {len(off)} samples, up to {max(off):.3g} s from an event")
            continue
        comparable = same if name in JUMPING else always
        if name not in CONTINUOUS:
            comparable = comparable & ~apart
        gap = np.where(comparable, differences(name, theirs[name][rows], image) / scales[name], 0.0)
        over = np.maximum(0, gap / (1 + condition.columns[name]) - 1e-12) / side.rtol
        k = int(np.argmax(over))
        if over[k] > FACTOR:
            outcome.faults.append(
                f"{name} at t = {ours.time[k]:.9g}: {theirs[name][rows][k]:.12g} for {image[k]:.12g}, "
                f"difference/rtol {gap[k] / side.rtol:.3g}, over conditioning {over[k]:.3g}"
            )
    if compare_events(outcome, ours, theirs, later, condition) and not later:
        compare_summary(outcome, ours, theirs, condition)


def compare_events(outcome: Outcome, ours: ds.Result, theirs: ds.Result, later: float, condition: Conditioning) -> bool:
    """Whether the events are the same; a fault if they must be."""
    side = outcome.first
    # What is before the shift is the first rest and, unless the scene begins at rest, its end.
    begin = 0.0 if later else -1.0
    kept, theirs_kept = ours.events["time"] > begin, theirs.events["time"] - later > begin
    ours_kind, theirs_kind = ours.events["kind"][kept], theirs.events["kind"][theirs_kept]
    if not np.array_equal(ours_kind, theirs_kind):
        if condition.sticks_vary:
            outcome.ended = "events differ, and vary with the parameters"
        else:
            outcome.faults.append(f"{ours_kind.size} events, {theirs_kind.size} in the other")
        return False
    gap = np.abs(ours.events["time"][kept] - (theirs.events["time"][theirs_kept] - later)).max(initial=0.0)
    if gap > (FACTOR * side.rtol * (1 + condition.events) + 1e-13) * side.scene.t_end:
        outcome.faults.append(f"event times differ by {gap / side.scene.t_end:.1e} t_end")
    return True


def compare_summary(outcome: Outcome, ours: ds.Result, theirs: ds.Result, condition: Conditioning) -> None:
    """Every summary value to 30 rtol (1 + C) of its scale, where C is also its own conditioning.

    The scales: forces F_0, times t_end, max_X_rate the fastest slip, slip_length the distance of slip, works the sum of both.
    """
    allowed = FACTOR * outcome.first.rtol
    scene = outcome.first.scene
    fastest = float(np.hypot(ours["w_x"], ours["w_y"]).max(initial=0.0))
    scale = {
        **dict.fromkeys(("first_peak_force", "peak_force", "valley_force", "swing"), scene.limit),
        **dict.fromkeys(("period", "slip_duration", "stick_duration", "sticking_time"), scene.t_end),
        **dict.fromkeys(
            ("drive_work", "friction_work"), sum(abs(ours.summary.get(k, 0.0)) for k in ("drive_work", "friction_work"))
        ),
        "max_X_rate": fastest,
        "slip_length": float(np.ptp(ours["X"])),
        "slip_angle": 1.0,
    }
    for key in sorted({*ours.summary} | {*theirs.summary} - {"energy_residual"}):
        a, b, own = ours.summary.get(key), theirs.summary.get(key), condition.summary.get(key, 0.0)
        if key == "energy_residual" or own == np.inf:
            continue
        if a is None or b is None:
            outcome.faults.append(f"summary {key}: {a} and {b}")
            continue
        bound = (allowed * (1 + max(own, condition.worst)) + 1e-12) * max(scale.get(key.removesuffix("_scatter"), 1.0), abs(a))
        if key in {"cycles", "sticks"}:
            good = a == b or own > 0
        elif key == "creep_share":
            good = abs(a - b) <= max(1e-3, bound)
        else:
            good = abs(a - b) <= bound
        if not good:
            outcome.faults.append(f"summary {key}: {a!r} and {b!r}")


def position_fault(side: Side, result: ds.Result) -> str:
    """X = D(t) - u.e to roundoff."""
    if side.model == "high_frequency" or side.method in {"moreau_jean", "rk4"}:
        return ""
    c, s = side.scene.along
    driven = distance(side.scene.velocity, side.scene.time, result.time)
    stretch = result["u_x"].astype(np.longdouble) * c + result["u_y"].astype(np.longdouble) * s
    open_ = np.asarray(result["X"] - (driven - stretch), dtype=float)
    way = float(
        np.abs(np.diff(np.asarray((*side.scene.time, side.scene.t_end), dtype=float))) @ np.abs(np.asarray(side.scene.velocity))
    )
    scale = max(way, float(np.abs(stretch).max()))
    gap = float(np.abs(open_).max())
    k = int(np.argmax(np.abs(open_)))
    return f"X differs from D - u.e by {gap / scale:.1e} at t = {result.time[k]:.9g}" if gap > POSITION * scale else ""


def compare(seed: int, number: int, kinds: tuple[str, ...] = KINDS) -> Outcome:
    kind, first, second, later, powers = random_pair(seed, number, kinds)
    outcome = Outcome(number, kind, first, second)
    ours, theirs = first.run(), second.run()
    if isinstance(ours, str) or isinstance(theirs, str):
        codes = [text.split(":")[0] if isinstance(text, str) else "done" for text in (ours, theirs)]
        if codes[0] == codes[1]:
            outcome.ended = str(ours)
        elif "SolverError 42" in codes:
            outcome.ended = f"one reached max_steps: {codes}"
        else:
            outcome.faults.append(f"one ended: {ours if isinstance(ours, str) else theirs}")
        return outcome
    for side, result in ((first, ours), (second, theirs)):
        fault = position_fault(side, result)
        if fault:
            outcome.faults.append(f"{'first' if side is first else 'second'}: {fault}")
    if kind in EXACT:
        compare_exactly(outcome, ours, theirs, powers)
    else:
        compare_closely(outcome, ours, theirs, later)
    return outcome


def summary(outcomes: list[Outcome]) -> str:
    text = ["| kind | pairs | equal | unequal | nothing to compare |", "| --- | --- | --- | --- | --- |"]
    for kind in KINDS:
        rows = [o for o in outcomes if o.kind == kind]
        if rows:
            faulty, ended = (sum(bool(o.faults) for o in rows), sum(bool(o.ended) and not o.faults for o in rows))
            text.append(f"| {kind} | {len(rows)} | {len(rows) - faulty - ended} | {faulty} | {ended} |")
    by_method = collections.Counter((o.first.model, o.first.method) for o in outcomes if o.faults)
    text.append("unequal by model and method: " + ", ".join(f"{' '.join(k)} {n}" for k, n in sorted(by_method.items())))
    good = sum(not o.faults for o in outcomes)
    text.append(f"{good} of {len(outcomes)} pairs equal as they must be")
    return "\n".join(text)


def report(outcomes: list[Outcome]) -> str:
    text = []
    for outcome in outcomes:
        if outcome.faults:
            text += [f"## {outcome.name}", *(f"  {fault}" for fault in outcome.faults)]
            for side in (outcome.first, outcome.second):
                shown = repr(side.groups())
                text.append(
                    f"ds.run(ds.Scene(**{shown}))"
                    if len(shown) < 3000
                    else f"({len(side.scene.time)} knots: pairs.random_pair(SEED, {outcome.number}))"
                )
            text.append("")
    return "\n".join(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=lambda s: [int(x) for x in s.split(",")])
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--kinds", default=",".join(KINDS), help="of the pairs that are compared")
    parser.add_argument("--report", type=Path)
    parser.add_argument("--quiet", action="store_true")
    arguments = parser.parse_args()
    wanted = set(arguments.kinds.split(","))
    numbers = arguments.only or range(arguments.first, arguments.first + arguments.pairs)
    outcomes = []
    for number in numbers:
        if KINDS[number % len(KINDS)] not in wanted:
            continue
        outcomes.append(compare(arguments.seed, number))
        if outcomes[-1].faults and not arguments.quiet:
            print(f"{outcomes[-1].name}: {'; '.join(outcomes[-1].faults[:3])}", flush=True)
    text = summary(outcomes)
    if arguments.report:
        arguments.report.write_text(text + "\n\n" + report(outcomes))
    print(text)
    sys.exit(1 if any(outcome.faults for outcome in outcomes) else 0)


if __name__ == "__main__":
    main()
