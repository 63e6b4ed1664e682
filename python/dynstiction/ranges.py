"""Where stick-slip begins and ends in any number of a deck, for the scene as it is (docs/howto/stick_slip_range.md)."""

from __future__ import annotations

import functools
import itertools
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from . import _native
from ._arguments import names_in
from ._progress import progress_bar
from ._slider import held_drive, number_key, own_number
from .errors import DeckError, SolverError, UsageError
from .record import headed
from .scene import DeckLike, Scene
from .stability import steady_sliding_eigenvalues

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
FIRST_STEP, MOST = 1.2, 1e3
"""The first neighbour of a value that is tried, and the last, over the value; each step is FIRST_STEP times longer in ratio."""
ACCURACY, JUMP_ACCURACY = 1e-4, 3e-4
"""Relative accuracy of an end, and of one at which the swing jumps."""
JUMP = 2.0
"""Swing on the inner side of an end over the least one of stick-slip above which stick-slip ends in a jump."""


class KeyRange(NamedTuple):
    """The range of one key around its value in the scene in which stick-slip, and unstable steady sliding, exist or do not exist."""

    key: str
    units: str
    value: float
    stick_slip: tuple[float, float]
    """Nearest values below and above at which stick-slip ends (or begins, if the scene has none), to 3e-4; NaN if there is none."""
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
    least: float
    """Swing from which on it is stick-slip, 5 % of F_0 [N]."""
    sliding_is_stable: bool
    keys: tuple[KeyRange, ...]

    @property
    def has_stick_slip(self) -> bool:
        """Whether the swing is that of stick-slip."""
        return self.swing >= self.least

    def __str__(self) -> str:
        share = 100 * self.swing / self.limit
        motion = f"no stick-slip (swing {self.swing:.2g} N, {share:.2g} % of mu_0 W)"
        if self.has_stick_slip:
            motion = f"stick-slip with a swing of {self.swing:.4g} N ({share:.0f} % of mu_0 W)"
        stable = "stable" if self.sliding_is_stable else "not stable"
        lines = [f"at V = {self.velocity:.6g} m/s: {motion}; steady sliding is {stable}", ""]
        change = "ends" if self.has_stick_slip else "begins"
        other = "is stable" if not self.sliding_is_stable else "is unstable"
        lines.append(f"{'key':28}{'value':>12}  {f'stick-slip {change}':40}  sliding {other}")
        for each in self.keys:
            ends, stable = _ends(each.stick_slip, each.jumps), _ends(each.sliding, (False, False))
            lines.append(
                f"{headed(each.key, each.units):28}{each.value:>12.6g}  {ends:40}  {stable}".rstrip()
            )
        return "\n".join(lines)


def _ends(at: tuple[float, float], jumps: tuple[bool, bool]) -> str:
    words = [f"{word} {value:.5g}{' (jump)' if jump else ''}"
             for word, value, jump in zip(("below", "above"), at, jumps, strict=True) if not math.isnan(value)]  # fmt: skip
    return ", ".join(words) or "nowhere"


def stick_slip_range(
    scene: DeckLike, keys: str | Sequence[str] = KEYS, *, progress: bool | None = None
) -> StickSlipRange:
    """Find where stick-slip ends, or begins, in numbers of a deck, by runs of the full model.

    Every friction law, dampers and ``mu_static`` are those of the scene; nothing is assumed about its motion. Each value is a run from
    rest until it has settled; values are tried at growing distance up to a thousand times the scene's, and where the swing first passes
    5 % of F_0 is found to 1e-4 as a root, to 3e-4 where it jumps. A value that the deck refuses, or at which the solver gives up, ends the
    search.

    Parameters
    ----------
    scene : str, PathLike or Scene
        The scene, of model 'full' ('auto' is taken as it), with one velocity of the drive that is held.
    keys : str or sequence of str
        Numbers of &system, &friction and &drive, ``GROUP.KEY`` or ``KEY``, in a string with commas between them. A damper of 0 is
        searched upwards.
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
    branch : the cycles over a key, stable and unstable, with their folds: where stick-slip and sliding are both stable.

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
    starts: dict[str, tuple[float, float]] = {}
    for key in names_in("keys", keys):
        name = number_key(key)
        if name.partition(".")[0] not in GROUPS:
            raise UsageError(
                f"no range of {key!r}: name numbers of &system, &friction and &drive as GROUP.KEY"
            )
        starts[name] = rig.start(name)
    own, sliding = rig.own, rig.growth({}) < 0.0
    if not own.limit > 0.0:
        raise UsageError("without friction there is no stick-slip: give mu_0 and normal_load that are > 0")
    sides = [(name, side, *starts[name], sliding) for name in starts for side in (-1, 1)]
    found: list[_Side] = []
    bar = progress_bar(progress, len(sides), "{percentage:3.0f}%|{bar}| {elapsed}")
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool, bar as show:
        try:
            for each in pool.map(lambda side: _search(rig, *side), sides):
                found.append(each)
                show(len(found))
        finally:
            rig.stopped = True
    ranges = []
    for name, *both in zip(starts, found[::2], found[1::2], strict=True):
        units = _native.key_info(*name.split(".")).units or "1"
        ranges.append(KeyRange._make((name, units, starts[name][0], *zip(*both, strict=True))))
    return StickSlipRange(rig.velocity, own.swing, own.limit, own.least, sliding, tuple(ranges))


_Side = tuple[float, bool, float, float]
"""Of one side of a value, what `KeyRange` has of both: stick_slip, jumps, sliding, searched."""


class _Settled(NamedTuple):
    """F_0, the swing of the load of a settled motion, and that from which on it is stick-slip [N]."""

    limit: float
    swing: float
    least: float


class _Rig:
    """A scene as a function of its keys: what its motion from rest comes to."""

    def __init__(self, scene: Scene) -> None:
        self.stopped = False
        if scene.scene.model not in ("full", "auto"):
            raise UsageError(
                f"model {scene.scene.model!r}: a range of stick-slip is that of model 'full': give model='full'"
            )
        self.scene = held_drive(scene)
        self.velocity = own_number(self.scene, "drive.velocity")
        self.own = self.motion({})

    def start(self, name: str) -> tuple[float, float]:
        """The value of a key in the scene, and one from which a search begins: of a damper that is 0, a share of the critical one."""
        value = own_number(self.scene, name)
        if value == 0.0 and "damping_" in name:
            stiffness = own_number(self.scene, f"system.stiffness_{name[-1]}")
            return 0.0, 2e-2 * math.sqrt(stiffness * own_number(self.scene, "system.mass"))
        if not value > 0.0:
            raise UsageError(f"{name} = {value:g}: ranges are found around positive values: give a small one")
        return value, value

    def motion(self, change: dict[str, Any]) -> _Settled:
        """What the motion from rest settles to, in model 'full', by a method and for a time of the core's own choice."""
        with _native.Session(self.scene.replace(**change).source, "settling") as motion:
            while not motion.proceed():
                if self.stopped:
                    raise KeyboardInterrupt
            return _Settled(*motion.numbers("settling")[:, 0].tolist())

    def growth(self, change: dict[str, Any]) -> float:
        """The largest growth of a disturbance of steady sliding [1/s]."""
        return float(np.max(steady_sliding_eigenvalues(self.scene.replace(**change)).real))


def _search(rig: _Rig, name: str, side: int, value: float, begin: float, slides: bool) -> _Side:
    """What changes on one side of a value, searched from `begin` on."""
    from scipy.optimize import brentq  # type: ignore[import-untyped]  # noqa: PLC0415

    if value == 0.0 and side < 0:
        return math.nan, False, math.nan, 0.0
    swings: dict[float, float] = {}
    last = 90.0 if name == KEYS[0] else math.inf

    def excess(at: float) -> float:
        motion = rig.own if at == value else rig.motion({name: at})
        swings[at] = motion.swing / motion.least
        return swings[at] - 1.0

    def nearest(function: Callable[[float], float], is_positive: bool, gap: float) -> tuple[float, float]:
        """The nearest change of the sign of a function, NaN if there is none, and how far was searched; values of the function that
        differ by more than `gap` say only where it changes.
        """
        reached, seen = value, functools.cache(function)
        # Beyond may be what the key may not be, or what the solver cannot do.
        with suppress(DeckError, SolverError, UsageError):
            for count in itertools.count(1 if value else 0):
                ratio = FIRST_STEP ** (count * (count + 1) // 2)
                at = begin * ratio**side
                if ratio >= MOST or at >= last:
                    break
                if (seen(at) >= 0.0) == is_positive:
                    reached = at
                    continue
                inside, outside = reached, at
                while abs(seen(inside) - seen(outside)) > gap:
                    # The line between both says little.
                    middle = 0.5 * (inside + outside)
                    if abs(outside - inside) < 2.0 * JUMP_ACCURACY * middle:
                        return middle, at
                    is_inside = (seen(middle) >= 0.0) == is_positive
                    inside, outside = (middle, outside) if is_inside else (inside, middle)
                return float(brentq(seen, inside, outside, xtol=1e-300, rtol=0.5 * ACCURACY)), at
        return math.nan, reached

    end, reached = nearest(excess, rig.own.swing >= rig.own.least, JUMP)
    sliding, _ = nearest(lambda at: rig.growth({name: at}), not slides, math.inf)
    near = [swing for at, swing in swings.items() if abs(at / end - 1.0) < 2.0 * JUMP_ACCURACY]
    return end, min((swing for swing in near if swing >= 1.0), default=0.0) > JUMP, sliding, reached
