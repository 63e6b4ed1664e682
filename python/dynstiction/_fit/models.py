"""The force along the pull in the settled stick-slip of a scene, over the bins of a waveform."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from .._run import run, run_sampled
from ..errors import Error, SolverError
from ..result import Result
from ..scene import Scene, used_settings
from ..trace import pull_force
from .waveform import Waveform, bin_means, centred

__all__ = ["NoCycleError", "fastest_slip", "full_means", "slow_means", "slow_scene", "steady_velocity"]

_Floats = NDArray[np.float64]

SETTLED = 1e-6
"""The motion has settled if two cycles agree to this."""
LONGEST = (100.0, 1000.0)
"""Longest time to settle, in measured periods: the second if the motion is known to be regular."""
MOST_STEPS = 20_000
"""Largest number of steps of a slow run. In 4 fits, runs with stick-slip that repeats took 600 in the median and at most 17 000."""
TOLERANCE = 1e-7
"""Relative tolerance of the slow model: its error is far below the effect of a change of a parameter by a thousandth."""
SLOW_METHOD = "radau5"
"""Method whose steps are short enough for cubic polynomials between their ends."""
FINER = 4
"""Samples of the full model for each sample of the trace."""
CYCLES = 2.3
"""Number of cycles of the full model that are used."""


class NoCycleError(Error):
    """The scene has no stick-slip that repeats."""


def slow_scene(scene: Scene) -> Scene:
    """The scene for the model low_frequency: without the keys that this model does not use."""
    return scene.replace(**cast(Any, used_settings(scene.groups(), {"scene": {"model": "low_frequency"}})))


@dataclass(frozen=True)
class _Curve:
    """Quantities that repeat: their integrals from `begin` on, over one period."""

    begin: float
    period: float
    slip: float

    def means(
        self, wave: Waveform, bins: _Floats, delay: float, integral: Callable[[_Floats], _Floats]
    ) -> _Floats:
        """Means of a quantity over bins of a waveform, at the same phases."""
        edges = bins * (self.period / wave.period) + self.slip + delay
        turns = np.floor((edges - self.begin) / self.period)
        whole = integral(np.array([self.begin + self.period]))[0]
        total = integral(edges - turns * self.period) + turns * whole
        means: _Floats = np.diff(total) / np.diff(edges)
        return means


def slow_means(scene: Scene, wave: Waveform, delay: float) -> _Floats:
    """The settled cycle of a scene with the model low_frequency, smooth in all its parameters.

    Parameters
    ----------
    scene : Scene
        The scene.
    wave : Waveform
        The waveform whose bins are used.
    delay : float
        Time by which the slips of the waveform are later than those of the model [s].

    Returns
    -------
    ndarray, shape (n + k + 1,)
        Mean force of each bin [N], how far the object is ahead of the drive in the bins of the creep [m] if the waveform has it, and the
        period [s].

    Raises
    ------
    NoCycleError
        If there is no stick-slip that repeats.
    """
    from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    result = _settled(scene, wave, {"interval": 0.0, "fields": ["u_x", "w_x", "pull_force"]}, precise=True)
    period = float(result.summary["period"])
    cosine, velocity = _geometry(scene)
    sense = np.sign(velocity)
    stiffness = sense * cosine * float(scene.system.stiffness_x or 0.0)
    keep = np.append(True, np.diff(result.time) > 0.0)
    keep[: max(0, int(np.searchsorted(result.time, result.time[-1] - period)) - 2)] = False
    time = result.time[keep]
    # The load is smooth; the force of the rigid spring jumps with the direction of friction, where steps are short. The forces of
    # dampers are added to the force of the rigid spring.
    load = CubicHermiteSpline(
        time, stiffness * result["u_x"][keep], stiffness * (velocity * cosine - result["w_x"][keep])
    )
    rest = PchipInterpolator(time, sense * result["pull_force"][keep] - stiffness * result["u_x"][keep])
    load_integral, rest_integral = load.antiderivative(), rest.antiderivative()
    end = float(time[-1])
    begin = end - period
    grid = np.linspace(begin, end, 400)
    middle = 0.5 * cosine * (float(result.summary["peak_force"]) + float(result.summary["valley_force"]))
    slip = _fall_through(middle, grid, load)

    def integral(t: _Floats) -> _Floats:
        total: _Floats = load_integral(t) + rest_integral(t) - load_integral(begin) - rest_integral(begin)
        return total

    def ahead(t: _Floats) -> _Floats:
        # X - V t = -u_x cos(phi) along the pull.
        way: _Floats = (load_integral(t) - load_integral(begin)) / -float(scene.system.stiffness_x or 0.0)
        return way

    curve = _Curve(begin, period, slip)
    means = [curve.means(wave, wave.edges, delay, integral)]
    if wave.ahead is not None:
        means.append(centred(curve.means(wave, wave.creep_edges, delay, ahead)))
    return np.append(np.hstack(means), period)


def full_means(scene: Scene, wave: Waveform, delay: float) -> _Floats:
    """As `slow_means`, for any model, from runs that are sampled more finely than the trace."""
    result = _settled(scene, wave, {"interval": LONGEST[-1] * wave.period, "fields": ["sticking"]})
    begin, period = float(result.time[-1]), float(result.summary["period"])
    end = begin + CYCLES * period
    fine = run(
        scene,
        times=np.arange(begin, end, wave.interval / FINER),
        progress=False,
        scene={"settle": 0.0, "t_end": end},
        output={"fields": ["spring_force_x", "pull_force", *(["X"] * (wave.ahead is not None))]},
    )
    time = fine.time
    cosine, velocity = _geometry(scene)
    force = np.sign(velocity) * pull_force(fine)
    load = np.sign(velocity) * cosine * fine["spring_force_x"]
    middle = 0.5 * cosine * (float(result.summary["peak_force"]) + float(result.summary["valley_force"]))
    k = np.flatnonzero((load[:-1] > middle) & (load[1:] <= middle))
    slips = time[k] + (load[k] - middle) / (load[k] - load[k + 1]) * np.diff(time)[k]
    edges = wave.edges * (period / wave.period) + delay
    inside = slips[(slips + edges[0] >= begin) & (slips + edges[-1] <= end)]
    if inside.size == 0:
        raise NoCycleError("no whole cycle is found")
    edges = edges + inside[-1]
    means = [_sampled_means(time, force, edges)]
    if wave.ahead is not None:
        way = np.sign(velocity) * (fine["X"] - velocity * time)
        means.append(centred(_sampled_means(time, way, edges[: wave.creep_edges.size])))
    return np.append(np.hstack(means), period)


def _sampled_means(time: _Floats, values: _Floats, edges: _Floats) -> _Floats:
    """Means over bins as a trace shows them: of straight lines between its samples, which are anywhere in the cycle."""
    means: _Floats = np.mean(
        [bin_means(time[k::FINER], values[k::FINER], edges) for k in range(FINER)], axis=0
    )
    return means


def fastest_slip(scene: Scene, wave: Waveform) -> float:
    """Fastest slip of a scene's settled cycle along the drive [m/s]."""
    return float(_settled(scene, wave, {"interval": wave.interval, "fields": ["u_x"]}).summary["max_X_rate"])


def _settled(scene: Scene, wave: Waveform, output: dict[str, object], precise: bool = False) -> Result:
    integrator = {"method": SLOW_METHOD, "rtol": TOLERANCE, "max_steps": MOST_STEPS} if precise else {}
    for longest in LONGEST:
        try:
            result = run_sampled(
                scene,
                progress=False,
                scene={"settle": SETTLED, "t_end": longest * wave.period},
                integrator=integrator,
                output=output,
            )
        except SolverError as error:
            raise NoCycleError(str(error)) from error
        if "settled_at" in result.summary and result.summary["period"] < result.time[-1]:
            return result
        if precise or result.summary.get("regularity") != 1:
            break
    raise NoCycleError(f"{scene.name}: no stick-slip that repeats within {longest:g} measured periods")


def steady_velocity(scene: Scene) -> float:
    """Drive velocity [m/s]; 0 if it has several values."""
    given = scene.drive.velocity
    velocity = np.ravel(np.asarray(0.0 if given is None else given, dtype=np.float64))
    return float(velocity[0]) if velocity.size == 1 else 0.0


def _geometry(scene: Scene) -> tuple[float, float]:
    """Cosine of the misalignment, and the drive velocity [m/s]."""
    return float(np.cos(np.radians(scene.system.misalignment_deg or 0.0))), steady_velocity(scene)


def _fall_through(level: float, grid: _Floats, load: Callable[[_Floats], _Floats]) -> float:
    """Last time at which the load falls through a level; the first time of the grid if it does so between two periods."""
    from scipy.optimize import brentq  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    values = load(grid)
    falls = np.flatnonzero((values[:-1] > level) & (values[1:] <= level))
    if falls.size == 0:
        return float(grid[0])
    k = falls[-1]
    return float(brentq(lambda t: float(load(t)) - level, grid[k], grid[k + 1], xtol=1e-15, rtol=1e-14))
