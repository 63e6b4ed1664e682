"""Where stick-slip begins and ends in any number of a deck, for the scene as it is (docs/howto/stick_slip_range.md)."""

from __future__ import annotations

import itertools
import math
import os
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from . import _native
from ._arguments import names_in
from ._progress import progress_bar
from ._run import run
from ._slider import held_drive, held_velocity
from .errors import DeckError, SolverError, UsageError
from .scene import DeckLike, Scene
from .simulation import Simulation
from .stability import steady_sliding_eigenvalues

__all__ = ["KEYS", "KeyRange", "StickSlipRange", "stick_slip_range"]

KEYS = (
    "system.misalignment_deg",
    "drive.velocity",
    "system.damping_x",
    "system.mass",
    "system.stiffness_x",
    "friction.normal_load",
)
"""Keys of a table without a choice."""
GROUPS = ("system", "friction", "drive")
LEAST_SWING = 0.05
"""Swing of k_x u_x over F_0 above which a motion is stick-slip; the same as for `stick_slip_ends`."""
UNDECIDED, IRREGULAR, STEADY_SLIDING, RINGS_DOWN = 0, -1, 2, 3
"""Values of the summary's regularity."""
LENGTHS = {UNDECIDED: 100.0}
LONGER = {UNDECIDED: 1000.0, IRREGULAR: 300.0}
"""How long a motion is followed, in times to load the spring up to F_0 and to oscillate once; and how long if it is then undecided or
irregular: near the end of stick-slip its last cycles pass slowly."""
FIRST_STEP, MOST = 1.2, 1e3
"""The first neighbour of a value that is tried, and the last, over the value; each step is FIRST_STEP times longer in ratio."""
MOST_STEPS = 500_000
"""Steps of a run, some seconds: a value that needs more ends the search."""
ACCURACY = 1e-4
"""Relative accuracy of an end."""
JUMP = 2.0
"""Swing on the inner side of an end over LEAST_SWING above which stick-slip ends in a jump."""


class KeyRange(NamedTuple):
    """The range of one key around its value in the scene in which stick-slip, and unstable steady sliding, exist or do not exist."""

    key: str
    units: str
    value: float
    stick_slip: tuple[float, float]
    """Nearest values below and above at which stick-slip ends (or begins, if the scene has none), to 1e-4; NaN if there is none."""
    jumps: tuple[bool, bool]
    """Whether its swing jumps there: then stick-slip and sliding may both be stable, and the end is that of a motion from rest."""
    sliding: tuple[float, float]
    """The same for the stability of steady sliding."""
    searched: tuple[float, float]
    """How far was searched."""


class StickSlipRange(NamedTuple):
    """Whether a scene has stick-slip, and up to where; ``print`` shows a table."""

    velocity: float
    """|V| [m/s]."""
    swing: float
    """Swing of k_x u_x of the motion from rest [N]; 0 in steady sliding."""
    limit: float
    """F_0 = mu_0 W [N]."""
    sliding_is_stable: bool
    keys: tuple[KeyRange, ...]

    @property
    def has_stick_slip(self) -> bool:
        """Whether the swing is at least 5 % of F_0."""
        return self.swing >= LEAST_SWING * self.limit

    def __str__(self) -> str:
        motion = (
            f"stick-slip with a swing of {self.swing:.4g} N ({100 * self.swing / self.limit:.0f} % of mu_0 W)"
        )
        if not self.has_stick_slip:
            motion = (
                f"no stick-slip (swing {self.swing:.2g} N, {100 * self.swing / self.limit:.2g} % of mu_0 W)"
            )
        stable = "stable" if self.sliding_is_stable else "not stable"
        lines = [f"at V = {self.velocity:.6g} m/s: {motion}; steady sliding is {stable}", ""]
        change = "ends" if self.has_stick_slip else "begins"
        other = "is stable" if not self.sliding_is_stable else "is unstable"
        lines.append(f"{'key':28}{'value':>12}  {f'stick-slip {change}':40}  sliding {other}")
        for each in self.keys:
            name = f"{each.key} [{each.units}]" if each.units != "1" else each.key
            lines.append(
                f"{name:28}{each.value:>12.6g}  {_ends(each.stick_slip, each.jumps):40}  {_ends(each.sliding, (False, False))}".rstrip()
            )
        return "\n".join(lines)


def _ends(at: tuple[float, float], jumps: tuple[bool, bool]) -> str:
    words = [f"{word} {value:.5g}{' (jump)' if jump else ''}"
             for word, value, jump in zip(("below", "above"), at, jumps, strict=True) if not math.isnan(value)]  # fmt: skip
    return ", ".join(words) or "nowhere"


def stick_slip_range(
    scene: DeckLike, keys: str | Sequence[str] = KEYS, *, progress: bool | None = None
) -> StickSlipRange:
    """Find where stick-slip ends, or begins, in numbers of a deck, by runs of the scene's own model.

    Every friction law, dampers and ``mu_static`` are those of the scene; nothing is assumed about its motion. Each value is a run from
    rest until it has settled; values are tried at growing distance up to a thousand times the scene's, and the first change
    is narrowed to 1e-4. A value that the deck refuses, or at which a run takes more than half a million steps, ends the search.

    Parameters
    ----------
    scene : str, PathLike or Scene
        The scene, of model 'full' ('auto' is taken as it), with one velocity of the drive that is held.
    keys : str or sequence of str
        Keys ``GROUP.KEY`` of &system, &friction and &drive, in a string with commas between them. A damper of 0 is searched upwards.
    progress : bool, optional
        Whether to show progress as a bar; by default as for `dynstiction.run`.

    Returns
    -------
    StickSlipRange
        Both verdicts for the scene, and a `KeyRange` for each key.

    Raises
    ------
    UsageError
        If a key is none of those, or is 0, or if the drive holds no or several velocities.
    DeckError
        If the scene is refused.

    See Also
    --------
    stick_slip_ends : the ends of the slow motion, with folds and stable and unstable cycles.

    Notes
    -----
    A motion is stick-slip if its load swings by 5 % of F_0 or more. Windows of a key that are narrower than the distance of two values
    that are tried, at first a factor of 1.2, can be missed. Where stick-slip and sliding are both stable, a run from rest comes to
    stick-slip; a `jump` warns of it.

    Examples
    --------
    >>> print(stick_slip_range("inputs/fig3.nml", "system.damping_x"))         # doctest: +SKIP
    """
    rig = _Rig(Scene(scene))
    wanted = [name.lower() for name in names_in("keys", keys)]
    starts = {name: rig.start(name) for name in wanted}
    swing, sliding = rig.swing({}), rig.slides({})
    sides = [(name, side) for name in wanted for side in (-1, 1)]
    done, lock = 0, threading.Lock()
    bar = progress_bar(progress, len(sides), "{percentage:3.0f}%|{bar}| {elapsed}")
    # Here, because threads share the filter of warnings.
    with bar as show, warnings.catch_warnings():
        warnings.simplefilter("ignore")

        def search(place: tuple[str, int]) -> _Side:
            nonlocal done
            found = _search(rig, *place, starts[place[0]], swing >= LEAST_SWING, sliding)
            with lock:
                done += 1
                show(done)
            return found

        pool = ThreadPoolExecutor(os.cpu_count() or 1)
        try:
            found = dict(zip(sides, pool.map(search, sides), strict=True))
        finally:
            # After Ctrl-C searches end with the run that they are in.
            rig.stopped = True
            pool.shutdown(cancel_futures=True)
    ranges = [
        KeyRange(
            name,
            rig.units(name),
            starts[name][0],
            (low.stick_slip, high.stick_slip),
            (low.jumps, high.jumps),
            (low.sliding, high.sliding),
            (low.searched, high.searched),
        )
        for name in wanted
        for low, high in [(found[name, -1], found[name, 1])]
    ]
    return StickSlipRange(rig.velocity, swing * rig.limit, rig.limit, sliding, tuple(ranges))


class _Side(NamedTuple):
    stick_slip: float
    jumps: bool
    sliding: float
    searched: float


class _Rig:
    """A scene as a function of its keys: what its motion from rest comes to."""

    def __init__(self, scene: Scene) -> None:
        self.stopped = False
        self.velocity = held_velocity(scene)
        if scene.scene.model not in ("full", "auto"):
            raise UsageError(
                f"model {scene.scene.model!r}: a range of stick-slip is that of model 'full': give model='full'"
            )
        self.scene = held_drive(scene).replace(scene={"model": "full"})
        with Simulation(self.scene) as simulation:
            self.parameters = simulation.result.parameters
        self.limit = self.number("mu_0") * self.number("normal_load")

    def number(self, key: str) -> float:
        value = self.parameters.get(key, 0.0)
        if not isinstance(value, float):
            raise UsageError(f"no range of '{key}': it is no real number")
        return value

    @staticmethod
    def units(name: str) -> str:
        group, _, key = name.partition(".")
        return _native.key_info(group, key).units or "1"

    def start(self, name: str) -> tuple[float, float]:
        """The value of a key in the scene, and one from which a search begins: of a damper that is 0, a share of the critical one."""
        group, _, key = name.partition(".")
        if group not in GROUPS or _native.group_of(name) != group:
            raise UsageError(
                f"no range of {name!r}: name numbers of &system, &friction and &drive as GROUP.KEY"
            )
        value = self.velocity if key == "velocity" else self.number(key)
        if value == 0.0 and key in ("damping_x", "damping_y"):
            return 0.0, 2e-2 * math.sqrt(self.number(f"stiffness_{key[-1]}") * self.number("mass"))
        if not value > 0.0:
            raise UsageError(f"{name} = {value:g}: ranges are found around positive values: give a small one")
        return value, value

    def swing(self, change: Mapping[str, Any]) -> float:
        """Swing over F_0 of the motion from rest."""
        if self.stopped:
            raise KeyboardInterrupt
        number = {key: self.number(key) for key in ("mu_0", "normal_load", "stiffness_x", "mass")}
        number |= {"velocity": self.velocity} | {
            name.partition(".")[2]: value for name, value in change.items()
        }
        limit = number["mu_0"] * number["normal_load"]
        loading = limit / (number["stiffness_x"] * number["velocity"])
        length = loading + 2.0 * math.pi * math.sqrt(number["mass"] / number["stiffness_x"])
        scene, verdict = self.scene.replace(**change), UNDECIDED
        for lengths in (LENGTHS, LONGER):
            result = run(scene, scene={"t_end": lengths[verdict] * length, "settle": 1e-6}, initial={"velocity_ratio": 0.0},
                         integrator={"method": "radau13", "rtol": 1e-6, "max_steps": MOST_STEPS},
                         output={"interval": 0.0, "fields": ["u_x"]})  # fmt: skip
            verdict = int(result.summary.get("regularity", UNDECIDED))
            if verdict in (STEADY_SLIDING, RINGS_DOWN):
                return 0.0
            if verdict not in LONGER:
                break
        return float(result.summary["swing"]) / limit

    def slides(self, change: Mapping[str, Any]) -> bool:
        """Whether steady sliding is stable."""
        return bool(np.max(steady_sliding_eigenvalues(self.scene.replace(**change)).real) < 0.0)


def _search(rig: _Rig, name: str, side: int, start: tuple[float, float], sticks: bool, slides: bool) -> _Side:
    """What changes on one side of a value."""
    value, begin = start
    if value == 0.0 and side < 0:
        return _Side(math.nan, False, math.nan, 0.0)
    swings: dict[float, float] = {}
    is_angle = name == KEYS[0]

    def stops(at: float) -> bool:
        swings[at] = rig.swing({name: at})
        return (swings[at] >= LEAST_SWING) != sticks

    def turns(at: float) -> bool:
        return rig.slides({name: at}) != slides

    ends, reached = _nearest(stops, value, begin, side, is_angle)
    sliding, _ = _nearest(turns, value, begin, side, is_angle)
    beside = [
        swing
        for at, swing in swings.items()
        if swing >= LEAST_SWING and abs(at / ends - 1.0) < 3.0 * ACCURACY
    ]
    return _Side(ends, bool(beside) and min(beside) > JUMP * LEAST_SWING, sliding, reached)


def _nearest(
    has_changed: Callable[[float], bool], value: float, begin: float, side: int, is_angle: bool
) -> tuple[float, float]:
    """The nearest change on one side of a value, NaN if there is none, and how far was searched; beyond 90 deg is the mirror image."""
    ratio, last = FIRST_STEP if value else 1.0, value
    try:
        for count in itertools.count(2):
            at = begin * ratio**side
            if ratio >= MOST or (is_angle and at >= 90.0):
                return math.nan, last
            if has_changed(at):
                break
            last = at
            ratio *= FIRST_STEP**count
        before, after = last, at
        while abs(after - before) > ACCURACY * after:
            middle = math.sqrt(before * after) if before > 0.0 else 0.5 * after
            before, after = (before, middle) if has_changed(middle) else (middle, after)
    except (DeckError, SolverError, UsageError):
        # Beyond what the key may be, or what the solver can do.
        return math.nan, last
    return 0.5 * (before + after), at
