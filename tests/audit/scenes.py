"""Random scenes of the full model: every law of friction, static limits, dampers and drives, over all decades where they mean something.

There are two families. `any` draws all of it. In `turning` friction weakens strongly and rest holds more than slip begins with, so that
many a slip nearly stops where |f| is between F_0 and F_s: there it turns and goes on.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field, fields, replace

Groups = dict[str, dict[str, object]]
FAMILIES = ("any", "turning")


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
    mu_static: float = 0.0
    ageing: float = 0.0
    ageing_time: float = 1.0
    damping_x: float = 0.0
    damping_y: float = 0.0
    exponent: float = 1.0
    viscous: float = 0.0
    table_speed: tuple[float, ...] = ()
    table_mu: tuple[float, ...] = ()
    law: str = "weakening"
    kinds: tuple[str, ...] = field(default=(), compare=False)
    """What is special about it, for the tables."""

    @property
    def limit(self) -> float:
        """F_0 [N]."""
        return self.mu_0 * self.normal_load

    @property
    def static_limit(self) -> float:
        """F_s [N]."""
        return max(self.mu_static, self.mu_0) * self.normal_load

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
        of_law = {
            "constant": ("mu_0",),
            "weakening": ("mu_0", "mu_inf", "v_f"),
            "stribeck": ("mu_0", "mu_inf", "v_f", "exponent", "viscous"),
            "table": ("table_speed", "table_mu"),
        }[self.law]
        optional = [name for name in ("damping_x", "damping_y") if getattr(self, name) > 0]
        if self.mu_static > 0:
            of_law += ("mu_static",)
        if self.ageing > 0 and model == "full":
            of_law += ("ageing", "ageing_time")
        groups: Groups = {
            "scene": {"model": model, "t_end": self.t_end},
            "system": self._keys("mass", "stiffness_x", "stiffness_y", "misalignment_deg", *optional),
            "friction": {"law": self.law, **self._keys(*of_law, "normal_load")},
            "drive": self._keys("velocity", "time") if len(self.velocity) > 1 else {"velocity": self.velocity[0]},
            "initial": self._keys("velocity_ratio", "elongation_x", "elongation_y"),
            "integrator": dict(integrator),
            "output": {"interval": self.interval},
        }
        if model == "low_frequency":
            del groups["system"]["stiffness_y"], groups["initial"]["elongation_y"]
            groups["system"].pop("damping_y", None)
        elif model == "high_frequency":
            groups["system"].pop("damping_x", None)
        return groups

    def reference_input(self, **settings: float) -> str:
        """What tests/audit/reference.cpp reads."""
        given = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in {"law", "kinds"}}
        given["samples"] = tuple(k * self.interval for k in range(100))
        lines = []
        for key, value in (given | settings).items():
            values = value if isinstance(value, tuple) else (value,)
            if values:
                lines.append(f"{key} {' '.join(map(repr, values))}\n")
        return "".join(lines)


def log_uniform(chance: random.Random, least: float, most: float) -> float:
    return math.exp(chance.uniform(math.log(least), math.log(most)))


def random_scene(seed: int, number: int, profiles: bool = True, family: str = "any") -> Scene:
    """Scene `number` of a family and seed: always the same, whatever the others are."""
    chance = random.Random(f"{seed}/{number}" if family == "any" else f"{family} {seed}/{number}")
    while True:
        scene = _draw_turning(chance) if family == "turning" else _draw(chance, profiles)
        if scene is not None:
            return _age(random.Random(f"ageing {family} {seed}/{number}"), scene)


def _age(chance: random.Random, scene: Scene) -> Scene:
    """One of five has a static limit that ages."""
    if chance.random() > 0.2:
        return scene
    release, fast, _ = _times(scene)
    ageing, time = scene.mu_0 * log_uniform(chance, 1e-4, 0.1), chance.choice([release, fast]) * log_uniform(chance, 1e-3, 1e2)
    return replace(scene, ageing=ageing, ageing_time=time, kinds=(*scene.kinds, "ageing"))


def _rig(chance: random.Random) -> Scene:
    """Springs, mass, load and a constant drive."""
    soft = log_uniform(chance, 1e2, 1e4)
    return Scene(
        mass=log_uniform(chance, 1e-4, 10),
        stiffness_x=soft,
        stiffness_y=soft * log_uniform(chance, 10, 1e8),
        misalignment_deg=log_uniform(chance, 0.01, 85),
        mu_0=chance.uniform(0.1, 0.6),
        mu_inf=0.0,
        v_f=log_uniform(chance, 1e-4, 1),
        normal_load=log_uniform(chance, 0.5, 20),
        velocity=(chance.choice([1.0, 1.0, -1.0]) * log_uniform(chance, 1e-5, 0.1),),
    )


def _times(scene: Scene) -> tuple[float, float, float]:
    """Until the first release from relaxed springs, of a fast cycle, until the soft spring alone is at the static limit [s]."""
    (c, s), speed, limit = scene.along, abs(scene.velocity[0]), scene.static_limit
    fast = 2 * math.pi * math.sqrt(scene.mass / scene.stiffness_y)
    return limit / (speed * math.hypot(scene.stiffness_x * c, scene.stiffness_y * s)), fast, limit / (scene.stiffness_x * speed * c)


def _draw_turning(chance: random.Random) -> Scene | None:
    scene = _rig(chance)
    drop, fall = scene.mu_0 * chance.uniform(0.6, 1), scene.limit / math.sqrt(scene.mass * scene.stiffness_x)
    scene = replace(
        scene,
        misalignment_deg=log_uniform(chance, 0.01, 20),
        mu_inf=scene.mu_0 - drop,
        # Of the speed of a slip along the soft spring, so that it weakens friction.
        v_f=fall * log_uniform(chance, 1e-3, 1),
        mu_static=scene.mu_0 * chance.uniform(1.05, 1.6),
        kinds=("mu_static",),
    )
    if chance.random() < 0.2:
        scene = _damp(chance, scene)
    release, fast, slow = _times(scene)
    slips = chance.uniform(1.2, 6) * slow
    if slips > 1000 * fast:
        if chance.random() < 0.9:
            return None
        slips = release + log_uniform(chance, 100, 1000) * fast
    return _ending(scene, slips)


def _draw(chance: random.Random, profiles: bool) -> Scene | None:
    scene = _law(chance, _rig(chance))
    if chance.random() < 0.35:
        scene = replace(scene, mu_static=scene.mu_0 * chance.uniform(1.05, 1.6), kinds=(*scene.kinds, "mu_static"))
    if chance.random() < 0.3:
        scene = _damp(chance, scene)
    release, fast, slow = _times(scene)
    if chance.random() < 0.45:
        scene, release = _stretch(chance, scene, release)
    if chance.random() < 0.2:
        ratio = chance.choice([1e-6, chance.uniform(-2, 2), chance.uniform(0, 1)])
        scene = replace(scene, velocity_ratio=ratio, kinds=(*scene.kinds, "moving"))
    # The first creep and the slip that ends it, where that is not much longer. A rest that takes almost the whole time says nothing.
    wanted = chance.uniform(1.1, 2.5) * slow
    end = release + log_uniform(chance, 40, 300) * fast
    found = _ending(scene, wanted if end < wanted < 800 * fast else end)
    return _drive(chance, found, release) if found and profiles and chance.random() < 0.35 else found


def _ending(scene: Scene, t_end: float) -> Scene | None:
    return replace(scene, t_end=float(f"{t_end:.6g}")) if 1e-9 < t_end < 1e5 else None


def _law(chance: random.Random, scene: Scene) -> Scene:
    law = chance.choice(["weakening", "weakening", "constant", "stribeck", "table"])
    ratio = chance.choice([chance.uniform(0, 1), chance.uniform(0, 1), chance.uniform(0, 2), 0.0])
    scene = replace(scene, law=law, mu_inf=scene.mu_0 * (1.0 if law == "constant" else ratio), kinds=(law,))
    if law == "stribeck":
        exponent = chance.choice([1.0, 2.0, chance.uniform(1, 3), chance.uniform(1, 10)])
        return replace(scene, exponent=exponent, viscous=chance.choice([0.0, log_uniform(chance, 1e-3, 10)]))
    if law == "table":
        speeds = sorted(scene.v_f * log_uniform(chance, 0.1, 10) for _ in range(chance.randint(1, 7)))
        mu = [scene.mu_0 * chance.uniform(min(ratio, 1), max(ratio, 1)) for _ in speeds]
        if chance.random() < 0.6:
            mu.sort(reverse=ratio < 1)
        return replace(scene, table_speed=(0.0, *speeds), table_mu=(scene.mu_0, *mu))
    return scene


def _damp(chance: random.Random, scene: Scene) -> Scene:
    """Dampers up to three times critical."""
    x, y = (chance.choice([0.0, log_uniform(chance, 1e-3, 3)]) for _ in range(2))
    return replace(
        scene,
        damping_x=x * 2 * math.sqrt(scene.mass * scene.stiffness_x),
        damping_y=y * 2 * math.sqrt(scene.mass * scene.stiffness_y),
        kinds=(*scene.kinds, "dampers"),
    )


def _stretch(chance: random.Random, scene: Scene, release: float) -> tuple[Scene, float]:
    """Springs stretched to some share of F_0, within it or beyond."""
    share = chance.choice([chance.uniform(0, 1), chance.uniform(0.9, 1), chance.uniform(1, 1.5), chance.uniform(0, 3)])
    angle = chance.choice([0.0, math.pi, chance.uniform(-math.pi, math.pi)])
    if angle == 0.0 and scene.velocity[0] < 0:
        angle = math.pi
    force = share * scene.limit
    stretched = replace(
        scene,
        elongation_x=force * math.cos(angle) / scene.stiffness_x,
        elongation_y=force * math.sin(angle) / scene.stiffness_y,
        kinds=(*scene.kinds, "stretched"),
    )
    return stretched, release * max(0.0, 1 - share) * 2


def _drive(chance: random.Random, scene: Scene, release: float) -> Scene:
    """A piecewise-linear drive: a sine of many knots, or 3 to 8 knots with ramps, holds, reversals, jumps."""
    velocity = scene.velocity[0]
    if chance.random() < 0.2:
        count, turns, size = chance.randint(20, 60), chance.uniform(0.3, 3), chance.uniform(0.1, 2)
        shares = [k / count for k in range(count + 1)]
        values = [velocity * (1 + size * math.sin(2 * math.pi * turns * share)) for share in shares]
        return replace(scene, time=tuple(scene.t_end * x for x in shares), velocity=tuple(values), kinds=(*scene.kinds, "sine"))
    count = chance.randint(3, 8)
    begin = 0.0 if chance.random() < 0.5 else min(release, 0.5 * scene.t_end)
    times = [0.0, *sorted(begin + chance.random() * (scene.t_end - begin) for _ in range(count - 1))]
    values = [velocity]
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
    return replace(scene, time=tuple(times), velocity=tuple(values), kinds=(*scene.kinds, "profile"))
