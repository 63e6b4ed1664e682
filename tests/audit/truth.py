"""The reference of the audit: builds tests/audit/reference.cpp, runs it, and keeps what it says of a scene.

The results belong to scene and program alone, so they are kept in a file and used again whatever becomes of the package.
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scenes import Scene

SOURCE = Path(__file__).with_name("reference.cpp")
CHECKOUT = Path(__file__).parents[2]
PERTURBED = ("normal_load", "mass", "stiffness_x", "stiffness_y", "velocity")
"""The conditioning is measured by small relative changes of these."""
CHANGE = 1e-9


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
    sticking: np.ndarray
    velocity: np.ndarray
    event_time: np.ndarray
    event_kind: np.ndarray
    gap: np.ndarray
    """1 - |K u|/F_0 of the rests that begin."""
    dips: np.ndarray
    """Minima of v that are no stops: time, v, largest speed since the release."""
    notes: dict[str, float]

    @property
    def sticks(self) -> int:
        return int(np.count_nonzero(self.event_kind == 1))


def build(folder: Path, quadruple: bool = False) -> Path:
    """Compile the reference; FileNotFoundError if there is no g++."""
    compiler = shutil.which("g++")
    if compiler is None:
        raise FileNotFoundError("no g++ on the PATH")
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / ("reference_quadruple" if quadruple else "reference")
    if not program.exists() or program.stat().st_mtime < SOURCE.stat().st_mtime:
        extra = ["-std=gnu++17", "-DQUADRUPLE", "-lquadmath"] if quadruple else ["-std=c++17"]
        subprocess.run([compiler, "-O2", SOURCE, "-o", program, *extra], check=True)
    return program


def parse(text: str) -> Truth:
    rows: dict[str, list[list[float]]] = {"sample": [], "event": [], "dip": []}
    notes = {}
    for line in text.splitlines():
        key, *words = line.split()
        if key == "failed":
            raise ReferenceFailed(line)
        if key == "note":
            notes[words[0]] = float(words[1])
        else:
            rows[key].append([float(word) for word in words])
    sample = np.array(rows["sample"]).reshape(-1, 9)
    event = np.array(rows["event"]).reshape(-1, 3)
    return Truth(
        time=sample[:, 0],
        u=sample[:, 1:3].T,
        w=sample[:, 3:5].T,
        X=sample[:, 5],
        theta=sample[:, 6],
        sticking=sample[:, 7].astype(int),
        velocity=sample[:, 8],
        event_time=event[:, 0],
        event_kind=event[:, 1].astype(int),
        gap=event[event[:, 1] == 1, 2],
        dips=np.array(rows["dip"]).reshape(-1, 3),
        notes=notes,
    )


class Reference:
    """The program with its memory."""

    def __init__(self, folder: Path = CHECKOUT / "build" / "audit", quadruple: bool = False) -> None:
        self.program = build(folder, quadruple)
        self.store = folder / "truth"
        self.store.mkdir(exist_ok=True)
        self.version = hashlib.sha256(SOURCE.read_bytes()).hexdigest() + (" quadruple" if quadruple else "")

    def run(self, scene: Scene, limit: float = 600.0, **settings: float) -> Truth:
        """The truth of one scene; what was computed before is not computed again."""
        text = scene.reference_input(**settings)
        name = hashlib.sha256((self.version + text).encode()).hexdigest()[:24]
        file = self.store / f"{name}.json"
        if file.exists():
            return parse(json.loads(file.read_text())["output"])
        try:
            done = subprocess.run([self.program], input=text, capture_output=True, text=True, timeout=limit, check=False)
            output = done.stdout
        except subprocess.TimeoutExpired:
            output = f"failed: more than {limit} s"
        file.write_text(json.dumps({"input": text, "output": output}))
        return parse(output)

    def perturbed(self, scene: Scene, change: float = CHANGE) -> list[Truth]:
        """The same scene with each of `PERTURBED` changed a little."""
        found = []
        for name in PERTURBED:
            value = getattr(scene, name)
            changed = tuple(v * (1 + change) for v in value) if isinstance(value, tuple) else value * (1 + change)
            found.append(self.run(replace(scene, **{name: changed})))
        return found


def columns(scene: Scene, truth: Truth) -> dict[str, np.ndarray]:
    """Every column that the package writes, from the reference's state."""
    (c, s), (k_x, k_y) = scene.along, (scene.stiffness_x, scene.stiffness_y)
    (u_x, u_y), (w_x, w_y) = truth.u, truth.w
    speed = np.hypot(w_x, w_y)
    rest = truth.sticking == 1
    slip_friction = (scene.mu_inf + (scene.mu_0 - scene.mu_inf) * np.exp(-speed / scene.v_f)) * scene.normal_load
    with np.errstate(divide="ignore"):
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
        "friction": np.where(rest, np.hypot(k_x * u_x, k_y * u_y), slip_friction),
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

    * u_x, X, Y: their largest size among the samples; u_y: the same, but at least F_0/k_y; Y = u_x sin(phi) - u_y cos(phi) at least 1e-3
      of the larger of its terms, because where the object never moved Y is nothing but their roundoff;
    * w_x, w_y, X_rate, Y_rate: the largest slip speed of the run (within steps, too);
    * spring_force_x, spring_force_y: k_x, k_y times the scale of u_x, u_y; friction: F_0;
    * theta, psi: 1 rad; zeta: what it is at theta = 90 degrees; for these three the direction must mean something: the slip speed is
      above 1e-3 of its largest, or the object rests under more than 1e-3 F_0. Elsewhere the scale is infinite.
    """
    every = columns(scene, truth)
    limit, k_x, k_y = scene.limit, scene.stiffness_x, scene.stiffness_y
    ones = np.ones_like(truth.time)
    fastest = max(truth.notes["fastest"], float(np.hypot(*truth.w).max()))
    tiny = 1e-300
    u_x = max(np.abs(every["u_x"]).max(), tiny)
    u_y = max(np.abs(every["u_y"]).max(), limit / k_y)
    across = max(np.abs(every["u_x"]).max() * abs(scene.along[1]), np.abs(every["u_y"]).max() * abs(scene.along[0]))
    load = np.hypot(every["spring_force_x"], every["spring_force_y"])
    told = np.where(truth.sticking == 1, load > 1e-3 * limit, np.hypot(*truth.w) > 1e-3 * fastest)
    angle = np.where(told, 1.0, np.inf)
    with np.errstate(divide="ignore"):
        damping = limit / (2 * np.abs(truth.velocity * scene.along[1]) * math.sqrt(scene.mass * scene.stiffness_x))
    found = {
        "u_x": u_x,
        "u_y": u_y,
        "X": max(np.abs(every["X"]).max(), tiny),
        "Y": max(np.abs(every["Y"]).max(), 1e-3 * across, tiny),
        "spring_force_x": k_x * u_x,
        "spring_force_y": k_y * u_y,
        "friction": limit,
        "theta": angle,
        "psi": angle,
        "zeta": damping * angle,
    }
    found |= dict.fromkeys(("w_x", "w_y", "X_rate", "Y_rate"), max(fastest, tiny))
    return {name: value * ones for name, value in found.items()}


def conditioning(scene: Scene, truth: Truth, perturbed: list[Truth]) -> dict[str, np.ndarray]:
    """Relative change of each column in its scale per relative change of a parameter, at each sample.

    The largest of all parameters and of the sample and its two neighbours: a sample may by chance be where the motion does not
    depend on a parameter. Samples where the changed scene is in the other state, rest or slip, count for the columns that are
    continuous in it only.
    """
    scale, here = scales(scene, truth), columns(scene, truth)
    found = {}
    for name in here:
        most = np.zeros_like(truth.time)
        for other in perturbed:
            gap = differences(name, columns(scene, other)[name], here[name]) / scale[name]
            if name in JUMPING:
                gap = np.where(other.sticking == truth.sticking, gap, 0.0)
            # What the changed scene's own parameters do to the column is in it where it is not in the state.
            most = np.maximum(most, np.nan_to_num(gap, nan=0.0) / CHANGE)
        found[name] = widest(most)
    return found


def widest(values: np.ndarray) -> np.ndarray:
    """At each sample the largest of it and its neighbours."""
    wide = np.concatenate([values[:1], values, values[-1:]])
    return np.maximum(np.maximum(wide[:-2], wide[1:-1]), wide[2:])


JUMPING = ("friction", "theta", "psi", "zeta")
"""What jumps where rest begins."""
