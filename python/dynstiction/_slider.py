"""Parameters of a slider, from keywords and from a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from .errors import UsageError
from .scene import DeckLike, Scene

DRIVE_VELOCITY = "drive.velocity"
ANGLE = 3
"""Place of the misalignment, which the core has in radians, among the parameters of the core."""


class SliderParameters(TypedDict, total=False):
    """Keywords of the functions of a slider, by their names in a deck and in its units; None is as not given."""

    mass: ArrayLike | None
    stiffness_x: ArrayLike | None
    stiffness_y: ArrayLike | None
    misalignment_deg: ArrayLike | None
    mu_0: ArrayLike | None
    mu_inf: ArrayLike | None
    v_f: ArrayLike | None
    normal_load: ArrayLike | None
    velocity: ArrayLike | None
    v_smooth: ArrayLike | None
    damping_x: ArrayLike | None
    damping_y: ArrayLike | None


OPTIONAL = {"mu_inf": None, "v_f": None, "v_smooth": 0.0, "damping_x": 0.0, "damping_y": 0.0}
"""Optional parameters and their defaults. Without `mu_inf` and `v_f` friction is constant."""


def slider_parameters(
    scene: DeckLike | None, given: Mapping[str, object], **fixed: float
) -> dict[str, ArrayLike]:
    """Every parameter of sliders by its key in the deck, in its unit, in the order of the core.

    Parameters
    ----------
    scene : str, PathLike or Scene, optional
        A deck or a scene, for the parameters that are not given.
    given : mapping
        Parameters by name; None means not given.
    **fixed : float
        Parameters that have this value whatever the scene says.

    Raises
    ------
    UsageError
        If a parameter is missing or is none of these, or only one of `mu_inf` and `v_f` is given; also as for `_scene_parameters`.
    """
    # The core has this angle in radians.
    names = ["misalignment_deg" if name == "misalignment" else name for name in _native.slider_parameters()]
    for name in given:
        if name not in names or name in fixed:
            known = ", ".join(each for each in names if each not in fixed)
            raise UsageError(f"{name!r} is no parameter of this function: it has {known}")
    chosen = {name: value for name, value in given.items() if value is not None}
    of_scene = {} if scene is None else _scene_parameters(Scene(scene), "velocity" not in chosen)
    found: dict[str, Any] = {**OPTIONAL, **of_scene, **chosen, **fixed}
    missing = [name for name in names if name not in found]
    if missing:
        raise UsageError(
            f"{', '.join(missing)}: not given{'' if scene is None else ', and not in the scene'}: "
            f"give {'a scene, or ' if scene is None else ''}{', '.join(f'{name}=…' for name in missing)}"
        )
    if (found["mu_inf"] is None) != (found["v_f"] is None):
        raise UsageError("mu_inf and v_f belong together: both for weakening friction, neither for constant")
    if found["mu_inf"] is None:
        found |= {"mu_inf": found["mu_0"], "v_f": 1.0}
    return {name: found[name] for name in names}


def _scene_parameters(scene: Scene, with_velocity: bool = True) -> dict[str, float]:
    """Parameters of the slider of a scene, as far as the scene gives them.

    Raises
    ------
    DeckError
        If the scene cannot be read.
    UsageError
        If these functions do not have its friction law, or its drive keeps no velocity other than 0, or several.
    """
    friction = scene.friction
    used = ["mass", "stiffness_x", "stiffness_y", "misalignment_deg", "damping_x", "damping_y"]
    used += ["mu_0", "normal_load"] + ["v_smooth"] * (friction.contact == "smoothed")
    if friction.law == "weakening" or (
        friction.law == "stribeck" and (friction.exponent, friction.viscous) == (1.0, 0.0)
    ):
        used += ["mu_inf", "v_f"]
    elif friction.law != "constant":
        raise UsageError(
            f"friction.law = '{friction.law}': with keywords these functions have the laws 'weakening' and 'constant'; "
            "for other laws critical_misalignment and steady_sliding_eigenvalues take the scene alone"
        )
    given: dict[str, Any] = {**scene.groups().get("system", {}), **scene.groups().get("friction", {})}
    values = {name: given[name] for name in used if name in given}
    return values | ({"velocity": held_velocity(scene)} if with_velocity else {})


def drive_of(scene: Scene) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Corners of the drive of a scene: times [s] and velocities [m/s] there."""
    times, velocities = scene.drive.time, scene.drive.velocity
    if velocities is None:
        raise UsageError("drive.velocity is missing in the scene: give velocity=…")
    return tuple(np.atleast_1d(times).tolist()), tuple(np.atleast_1d(velocities).tolist())


def held_velocity(scene: Scene) -> float:
    """The only constant velocity [m/s] of the drive of a scene that is not 0, without its sign."""
    times, velocities = drive_of(scene)
    held = {
        abs(velocity)
        for i, velocity in enumerate(velocities)
        if i == len(velocities) - 1 or (times[i + 1] > times[i] and velocities[i + 1] == velocity)
    } - {0.0}
    if len(held) != 1:
        count = "several velocities" if held else "no velocity but 0"
        raise UsageError(f"the drive of the scene holds {count}: give velocity=…")
    return held.pop()


def held_drive(scene: Scene) -> Scene:
    """The scene under the velocity that its drive holds, without a profile."""
    return scene.replace(drive={"velocity": held_velocity(scene), "time": None})


def number_key(key: str) -> str:
    """The full name GROUP.KEY of a key of the deck that is a number.

    Raises
    ------
    UsageError
        If the deck has no such key, or it is no real number; the drive's velocity is one.
    """
    group, name = _native.group_of(key), key.rpartition(".")[2].lower()
    full = f"{group}.{name}"
    if not group or (full != DRIVE_VELOCITY and _native.key_info(group, name).kind != "real"):
        raise UsageError(
            f"{key!r} is no real number of the deck: name one as GROUP.KEY, like system.misalignment_deg"
        )
    return full


def own_number(scene: Scene, key: str) -> float:
    """The value of a key GROUP.KEY in a scene; NaN if it is used there without one; of the drive, the velocity that it holds."""
    if key == DRIVE_VELOCITY:
        return held_velocity(scene)
    with _native.Run(scene.source) as run:
        used = {info.name: value for info, value in run.parameters()}
    return float(used.get(key.partition(".")[2], math.nan))
