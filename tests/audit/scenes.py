"""Random scenes of the full model, over all decades where it means something."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field, fields, replace

Groups = dict[str, dict[str, object]]


@dataclass(frozen=True)
class Scene:
    """One scene; the names are those of the deck."""

    mass: float
    stiffness_x: float
    stiffness_y: float
    misalignment_deg: float
    mu_0: float
    mu_inf: float
    v_f: float
    normal_load: float
    velocity: tuple[float, ...]
    time: tuple[float, ...] = (0.0,)
    velocity_ratio: float = 0.0
    elongation_x: float = 0.0
    elongation_y: float = 0.0
    t_end: float = 0.0
    kinds: tuple[str, ...] = field(default=(), compare=False)
    """What is special about it, for the tables."""

    @property
    def limit(self) -> float:
        """F_0 [N]."""
        return self.mu_0 * self.normal_load

    @property
    def along(self) -> tuple[float, float]:
        """Direction of the drive in the principal axes."""
        phi = math.radians(self.misalignment_deg)
        return math.cos(phi), math.sin(phi)

    @property
    def interval(self) -> float:
        """Time between the samples of the audit [s]."""
        return self.t_end / 100

    def _keys(self, *names: str) -> dict[str, object]:
        return {name: getattr(self, name) for name in names}

    def groups(self, model: str = "full", **integrator: object) -> Groups:
        """The groups of a deck."""
        groups: Groups = {
            "scene": {"model": model, "t_end": self.t_end},
            "system": self._keys("mass", "stiffness_x", "stiffness_y", "misalignment_deg"),
            "friction": {"law": "weakening", **self._keys("mu_0", "mu_inf", "v_f", "normal_load")},
            "drive": {"velocity": self.velocity[0]},
            "initial": self._keys("velocity_ratio", "elongation_x", "elongation_y"),
            "integrator": dict(integrator),
            "output": {"interval": self.interval},
        }
        if len(self.velocity) > 1:
            groups["drive"] = {"velocity": list(self.velocity), "time": list(self.time)}
        if model == "low_frequency":
            del groups["system"]["stiffness_y"], groups["initial"]["elongation_y"]
        return groups

    def reference_input(self, samples: bool = True, **settings: float) -> str:
        """What tests/audit/reference.cpp reads."""
        names = [field.name for field in fields(self) if field.type == "float"]
        lines = [f"{name} {getattr(self, name)!r}" for name in names]
        lines += [f"velocity {' '.join(map(repr, self.velocity))}", f"time {' '.join(map(repr, self.time))}"]
        if samples:
            lines.append(f"samples {' '.join(repr(k * self.interval) for k in range(100))}")
        lines += [f"{key} {value!r}" for key, value in settings.items()]
        return "\n".join(lines) + "\n"


def log_uniform(chance: random.Random, least: float, most: float) -> float:
    return math.exp(chance.uniform(math.log(least), math.log(most)))


def random_scene(seed: int, number: int, profiles: bool = True) -> Scene:
    """Scene `number` of the family `seed`: always the same, whatever the others are."""
    chance = random.Random(f"{seed}/{number}")
    while True:
        scene = _draw(chance, profiles)
        if scene is not None:
            return scene


def random_scenes(seed: int, count: int, profiles: bool = True) -> list[Scene]:
    return [random_scene(seed, number, profiles) for number in range(count)]


def _draw(chance: random.Random, profiles: bool) -> Scene | None:
    mass = log_uniform(chance, 1e-4, 10)
    soft, stiff = log_uniform(chance, 1e2, 1e4), log_uniform(chance, 1e5, 1e10)
    phi = log_uniform(chance, 0.05, 85)
    speed = log_uniform(chance, 1e-5, 0.1)
    side = chance.choice([1.0, 1.0, -1.0])
    mu_0, load = chance.uniform(0.1, 0.6), log_uniform(chance, 0.5, 20)
    ratio = chance.choice([chance.uniform(0, 1), chance.uniform(0, 1), chance.uniform(0, 2), 0.0, 1.0])
    v_f = log_uniform(chance, 1e-4, 1)
    limit = mu_0 * load
    kinds = []

    scene = Scene(mass, soft, stiff, phi, mu_0, mu_0 * ratio, v_f, load, (side * speed,))
    c, s = scene.along
    cycle = 2 * math.pi * math.sqrt(mass / max(soft, stiff))
    slow = limit / (soft * speed * c)
    release = limit / (speed * math.hypot(soft * c, stiff * s))

    if chance.random() < 0.45:
        scene, release = _stretch(chance, scene, release)
        kinds.append("stretched")
    if chance.random() < 0.2:
        scene = replace(scene, velocity_ratio=chance.choice([1e-6, chance.uniform(-2, 2), chance.uniform(0, 1)]))
        kinds.append("moving")

    cycles = log_uniform(chance, 40, 500)
    # The first creep and the slip that ends it, where that is not much longer.
    wanted = chance.uniform(1.1, 2.5) * slow
    end = release + cycles * cycle
    if end < wanted < 1500 * cycle:
        end = wanted
    # A rest that takes almost the whole time says nothing.
    if end < 1e-9 or end > 1e5:
        return None
    end = float(f"{end:.6g}")
    scene = replace(scene, t_end=end)
    if profiles and chance.random() < 0.35:
        scene = _drive(chance, scene, side * speed, release, cycle)
        kinds.append("profile")
    if ratio == 1.0:
        kinds.append("constant")
    return replace(scene, kinds=tuple(kinds))


def _stretch(chance: random.Random, scene: Scene, release: float) -> tuple[Scene, float]:
    """Springs stretched to some share of the static limit, within it or beyond."""
    share = chance.choice([chance.uniform(0, 1), chance.uniform(0.9, 1), chance.uniform(1, 1.5), chance.uniform(0, 3)])
    angle = chance.choice([0.0, math.pi, chance.uniform(-math.pi, math.pi)])
    if angle == 0.0 and scene.velocity[0] < 0:
        angle = math.pi
    force = share * scene.limit
    stretched = replace(
        scene, elongation_x=force * math.cos(angle) / scene.stiffness_x, elongation_y=force * math.sin(angle) / scene.stiffness_y
    )
    return stretched, release * max(0.0, 1 - share) * 2


def _drive(chance: random.Random, scene: Scene, velocity: float, release: float, cycle: float) -> Scene:
    """A piecewise-linear drive of 3 to 8 knots: ramps, holds, reversals, jumps."""
    count = chance.randint(3, 8)
    begin = 0.0 if chance.random() < 0.5 else min(release, 0.5 * scene.t_end)
    times = [0.0, *sorted(begin + chance.random() * (scene.t_end - begin) for _ in range(count - 1))]
    values: list[float] = [velocity]
    for _ in range(count - 1):
        step = chance.random()
        if step < 0.3:
            values.append(values[-1])  # on, or a hold
        elif step < 0.45:
            values.append(0.0)
        elif step < 0.6:
            values.append(-values[-1] if values[-1] else -velocity)
        else:
            values.append(velocity * chance.choice([chance.uniform(0, 2), chance.uniform(-1, 1), 1.0]))
    # Some knots twice: a jump.
    for i in range(count - 1, 1, -1):
        if len(times) < 8 and chance.random() < 0.2:
            times.insert(i, times[i])
            values.insert(i, values[i - 1])
    return replace(scene, time=tuple(times), velocity=tuple(values))
