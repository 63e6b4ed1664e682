"""The reference of the audit: builds tests/audit/reference.cpp, runs it, and keeps what it says of a scene.

The results belong to scene and program alone, so they are kept in a file and used again whatever becomes of the package.
"""

from __future__ import annotations

import hashlib
import math
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scenes import Scene

SOURCE = Path(__file__).with_name("reference.cpp")
CHECKOUT = Path(__file__).parents[2]
PERTURBED = (
    ("normal_load",),
    ("mass",),
    ("stiffness_x",),
    ("stiffness_y",),
    ("velocity",),
    ("mu_static",),
    ("damping_x", "damping_y"),
)
"""The conditioning is measured by small relative changes of these, if the scene has them."""
CHANGE = 1e-9
TOUCH = 1e-3
"""A rest that lasts no longer than this share of a radian of the fast oscillation, or of the loading from zero to F_s, is no stick."""


class ReferenceFailed(Exception):
    """The reference gave up."""


@dataclass
class Truth:
    """What the reference says of one scene; arrays go over the samples."""

    time: np.ndarray
    u: np.ndarray
    w: np.ndarray
    X: np.ndarray
    theta: np.ndarray
    friction: np.ndarray
    sticking: np.ndarray
    velocity: np.ndarray
    event_time: np.ndarray
    event_kind: np.ndarray
    """1: a stick begins; 2: slip begins. Without touches."""
    touches: np.ndarray
    """When touches begin."""
    notes: dict[str, float]

    @property
    def sticks(self) -> int:
        return int(np.count_nonzero(self.event_kind == 1))


def build(folder: Path) -> Path:
    """Compile the reference; FileNotFoundError if there is no g++."""
    compiler = shutil.which("g++")
    if compiler is None:
        raise FileNotFoundError("no g++ on the PATH")
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / "reference"
    if not program.exists() or program.stat().st_mtime < SOURCE.stat().st_mtime:
        subprocess.run([compiler, "-O2", "-std=c++17", SOURCE, "-o", program], check=True)
    return program


def parse(text: str, scene: Scene | None = None) -> Truth:
    """What the reference printed of a scene; without the scene, touches count as sticks."""
    rows: dict[str, list[list[float]]] = {"sample": [], "event": []}
    notes = {}
    for line in text.splitlines():
        key, *words = line.split()
        if key == "failed":
            raise ReferenceFailed(line)
        if key == "note":
            notes[words[0]] = float(words[1])
        else:
            rows[key].append([float(word) for word in words])
    sample = np.array(rows["sample"]).reshape(-1, 10)
    time, kind = np.array(rows["event"]).reshape(-1, 2).T
    # A touch begins after t = 0 and ends with a release.
    longest = TOUCH * shortest_time(scene, time[:-1]) if scene else 0.0
    begins = np.flatnonzero((kind[:-1] == 1) & (time[:-1] > 0) & (np.diff(time) <= longest))
    counted = np.delete(np.arange(kind.size), np.concatenate([begins, begins + 1]))
    return Truth(
        time=sample[:, 0],
        u=sample[:, 1:3].T,
        w=sample[:, 3:5].T,
        X=sample[:, 5],
        theta=sample[:, 6],
        friction=sample[:, 7],
        sticking=sample[:, 8].astype(int),
        velocity=sample[:, 9],
        event_time=time[counted],
        event_kind=kind[counted].astype(int),
        touches=time[begins],
        notes=notes,
    )


class Reference:
    """The program with its memory."""

    def __init__(self, folder: Path = CHECKOUT / "build" / "audit") -> None:
        self.program = build(folder)
        self.store = folder / "truth"
        self.store.mkdir(exist_ok=True)
        self.version = hashlib.sha256(SOURCE.read_bytes()).hexdigest()

    def run(self, scene: Scene, limit: float = 120.0, **settings: float) -> Truth:
        """The truth of one scene; what was computed before is not computed again."""
        text = scene.reference_input(**settings)
        file = self.store / hashlib.sha256((self.version + text).encode()).hexdigest()[:24]
        if not file.exists():
            try:
                done = subprocess.run([self.program], input=text, capture_output=True, text=True, timeout=limit, check=False)
                output = done.stdout
            except subprocess.TimeoutExpired:
                output = f"failed more than {limit} s"
            file.write_text(output)
        return parse(file.read_text(), scene)

    def perturbed(self, scene: Scene, change: float = CHANGE) -> list[Truth]:
        """The same scene with each of `PERTURBED` changed a little, and with a drive that jumps by as little all the time.

        Parameters may change no more than the size of a fast oscillation that grows from nearly nothing; jumps begin one, as errors do.
        """

        def scaled(value: float | tuple[float, ...]) -> float | tuple[float, ...]:
            return tuple(v * (1 + change) for v in value) if isinstance(value, tuple) else value * (1 + change)

        changed: list[dict[str, Any]] = [
            {name: scaled(getattr(scene, name)) for name in names if getattr(scene, name)} for names in PERTURBED
        ]
        return [self.run(replace(scene, **values)) for values in [*changed, unsteady(scene, change)] if values]


def unsteady(scene: Scene, change: float) -> dict[str, tuple[float, ...]]:
    """The drive with jumps by +- a small share between all samples."""
    ends = [(k + 0.5) * scene.interval for k in range(100)]
    knots = sorted(
        [*zip(scene.time, scene.velocity, strict=True), *((t, None) for t in ends for _ in range(2))], key=lambda knot: knot[0]
    )
    time, velocity, sign = [], [], 1
    for k, (t, v) in enumerate(knots):
        if v is None and k and knots[k - 1] == (t, None):
            sign = -sign
        time.append(t)
        velocity.append((np.interp(t, scene.time, scene.velocity) if v is None else v) * (1 + sign * change))
    return {"time": tuple(map(float, time)), "velocity": tuple(map(float, velocity))}


def shortest_time(scene: Scene, time: np.ndarray) -> np.ndarray:
    """A radian of the fast oscillation, or the loading from zero to F_s if that is shorter [s], at some times."""
    c, s = scene.along
    with np.errstate(divide="ignore"):
        loading = np.abs(np.interp(time, scene.time, scene.velocity)) * math.hypot(scene.stiffness_x * c, scene.stiffness_y * s)
        shortest: np.ndarray = np.minimum(
            math.sqrt(scene.mass / max(scene.stiffness_x, scene.stiffness_y)), scene.static_limit / loading
        )
    return shortest


def long_rests(scene: Scene, kind: np.ndarray, time: np.ndarray, share: float) -> int:
    """How many rests last longer than a share of `shortest_time`, the last one included."""
    lasted = np.append(np.diff(time), np.inf)
    return int(np.count_nonzero((kind == 1) & (lasted > share * shortest_time(scene, time))))


def columns(scene: Scene, truth: Truth) -> dict[str, np.ndarray]:
    """Every column that the package writes, from the reference's state."""
    (c, s), (k_x, k_y) = scene.along, (scene.stiffness_x, scene.stiffness_y)
    (u_x, u_y), (w_x, w_y) = truth.u, truth.w
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = scene.limit * np.abs(np.sin(truth.theta)) ** 3 / (2 * np.abs(truth.velocity * s) * math.sqrt(scene.mass * k_x))
    return {
        "u_x": u_x,
        "u_y": u_y,
        "w_x": w_x,
        "w_y": w_y,
        "X": truth.X,
        "Y": u_x * s - u_y * c,
        "X_rate": w_x * c + w_y * s,
        "Y_rate": w_y * c - w_x * s,
        "spring_force_x": k_x * u_x,
        "spring_force_y": k_y * u_y,
        "pull_force": (k_x * u_x + scene.damping_x * (truth.velocity * c - w_x)) * c
        + (k_y * u_y + scene.damping_y * (truth.velocity * s - w_y)) * s,
        "friction": truth.friction,
        "theta": truth.theta,
        "psi": truth.theta - math.atan2(s, c),
        "zeta": damping,
    }


ANGLES = ("theta", "psi")


def differences(name: str, found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """|found - true|, of angles without whole turns."""
    with np.errstate(invalid="ignore"):
        gap = found - true
    if name in ANGLES:
        gap = gap - 2 * math.pi * np.round(gap / (2 * math.pi))
    return np.asarray(np.abs(gap))


def scales(scene: Scene, truth: Truth) -> dict[str, np.ndarray]:
    """The scale in which a column is judged, at each sample. This is the one place that says so.

    * u_x, X, Y: their largest size among the samples; u_y: the same, but at least F_0/k_y; Y = u_x sin(phi) - u_y cos(phi) at least what
      its u_y is judged in, and 1e-3 of u_x sin(phi): where the object hardly moved, Y is what they leave of each other;
    * w_x, w_y, X_rate, Y_rate: the largest slip speed of the run (within steps, too);
    * spring_force_x, spring_force_y: k_x, k_y times the scale of u_x, u_y; friction, pull_force: F_0, or the largest friction or force;
    * theta, psi: 1 rad; zeta: what it is at theta = 90 degrees; for these three the direction must mean something: the slip speed is
      above 1e-3 of its largest, or the object rests under more than 1e-3 F_0. Elsewhere the scale is infinite.
    """
    every = columns(scene, truth)
    limit, k_x, k_y = scene.limit, scene.stiffness_x, scene.stiffness_y
    ones = np.ones_like(truth.time)
    largest = {name: float(np.abs(column).max()) for name, column in every.items()}
    speed = np.hypot(*truth.w)
    fastest = max(truth.notes["fastest"], float(speed.max()), 1e-300)
    u_y = max(largest["u_y"], limit / k_y)
    across = max(1e-3 * largest["u_x"] * abs(scene.along[1]), u_y * abs(scene.along[0]))
    told = np.where(truth.sticking == 1, truth.friction > 1e-3 * limit, speed > 1e-3 * fastest)
    angle = np.where(told, 1.0, np.inf)
    with np.errstate(divide="ignore"):
        damping = limit / (2 * np.abs(truth.velocity * scene.along[1]) * math.sqrt(scene.mass * k_x))
    found = {
        "u_x": max(largest["u_x"], 1e-300),
        "u_y": u_y,
        "X": max(largest["X"], 1e-300),
        "Y": max(largest["Y"], across, 1e-300),
        "spring_force_x": max(k_x * largest["u_x"], 1e-300),
        "spring_force_y": k_y * u_y,
        "pull_force": max(largest["pull_force"], limit),
        "friction": max(largest["friction"], limit),
        "theta": angle,
        "psi": angle,
        "zeta": damping * angle,
    }
    found |= dict.fromkeys(("w_x", "w_y", "X_rate", "Y_rate"), fastest)
    return {name: value * ones for name, value in found.items()}


def changes(scene: Scene, truth: Truth, other: Truth) -> dict[str, np.ndarray]:
    """Change of each column in its scale, at each sample, between two motions.

    Samples where the other motion is in the other state, rest or slip, count for the columns that are continuous in it only.
    """
    scale, here, there = scales(scene, truth), columns(scene, truth), columns(scene, other)
    found = {}
    for name in here:
        gap = differences(name, there[name], here[name]) / scale[name]
        if name in JUMPING:
            gap = np.where(other.sticking == truth.sticking, gap, 0.0)
        found[name] = np.nan_to_num(gap, nan=0.0)
    return found


def conditioning(scene: Scene, truth: Truth, perturbed: list[Truth]) -> dict[str, np.ndarray]:
    """Relative change of each column in its scale per relative change of a parameter, at each sample.

    The largest of all parameters and of the sample and its two neighbours: a sample may by chance be where the motion does not
    depend on a parameter.
    """
    found = [changes(scene, truth, other) for other in perturbed]
    return {name: widest(np.max([gap[name] for gap in found], axis=0) / CHANGE) for name in found[0]}


def widest(values: np.ndarray) -> np.ndarray:
    """At each sample the largest of it and its neighbours."""
    wide = np.concatenate([values[:1], values, values[-1:]])
    return np.asarray(np.maximum(np.maximum(wide[:-2], wide[1:-1]), wide[2:]))


JUMPING = ("friction", "theta", "psi", "zeta")
"""What jumps where rest begins."""
