"""The force along the pull in the settled stick-slip of a scene, over the bins of a waveform."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from .._run import run, run_sampled
from ..errors import Error, SolverError
from ..result import Result
from ..scene import Scene, used_settings
from ..trace import Chain, pull_force
from .waveform import Waveform, bin_means, centred

_Floats = NDArray[np.float64]

SETTLED = 1e-6
"""The motion has settled if two cycles agree to this."""
LONGEST, SOONEST = (100.0, 1000.0), 10.0
"""Longest time to settle, in measured periods: the second for a regular motion if the errors are those of the trace, the last for a rough
mean."""
MOST_STEPS = 20_000
"""Largest number of steps of a slow run. In 4 fits, runs with stick-slip that repeats took 600 in the median and at most 17 000."""
MOST_STEPS_OF_OWN = 200_000
"""The same of the scene's own model: a run of parameters far from the truth does not stop a fit."""
TOLERANCE = 1e-7
"""Relative tolerance of the slow model: its error is far below the effect of a change of a parameter by a thousandth."""
SLOW_METHOD = "radau5"
"""Method whose steps are short enough for cubic polynomials between their ends."""
FINER = 4
"""Samples of the full model in the narrowest bin, if its motion repeats: where the samples of a trace are does not matter then. With a
chain that has a memory, samples for each sample of the trace."""
CYCLES = 2.3
"""Number of cycles of the full model that are run if its motion repeats."""
BEGINNING, LIBRARY, FEWER = 10.0, 240.0, 40.0
"""Periods that are left out, and those that are used, of a motion that does not repeat: so many cycles that each measured one is near;
fewer if the errors are not yet those of the trace."""
LEAST_LIBRARY, MOST_SAMPLES = 40.0, 5e5
"""Fewest of these periods, and the number of samples above which there are fewer than usual."""
MEAN_OF = 40.0
"""Periods that are used of a motion that does not repeat in time while a measured one does: for a rough mean."""
LOADED = 0.95
"""Runs begin at rest with this share of the measured peak of the load, just before a slip: their motion settles soon."""
SOON = 0.15
"""A cycle begins in the longest rest in this share of a period at the beginning of its window."""
LATER = 0.05
"""Step for the change of a cycle with the time of its slip, over the duration of the fall."""


FIELDS = ("spring_force_x", "pull_force", "u_x", "u_y", "sticking")
"""What the scene's own model is asked for."""


class NoCycleError(Error):
    """The scene has no stick-slip."""


class Cycles(NamedTuple):
    """Slow cycles of a model, over the bins of a waveform."""

    rows: _Floats
    """Of each cycle, shape (m, n + k): mean force of each bin [N], and, if the waveform has it, how far the object is ahead of the drive
    in the bins of the creep [m]. One row if cycles repeat."""
    period: float
    """Mean period [s]."""
    later: _Floats
    """Change of the rows with the time at which the measured slip is later, shape (m, n + k) [per second]."""
    sticks: float
    """Number of rests of the object in a slow cycle."""
    states: _Floats
    """A rest near the beginning of the window of each cycle, shape (m, 3): time after the slip [s], elongations [m]; none of the slow model."""


def _loaded(scene: Scene, wave: Waveform) -> Scene:
    """The scene, beginning shortly before a slip."""
    stiffness = float(scene.system.stiffness_x or 1.0)
    elongation = math.copysign(LOADED * float(wave.mean.max()) / stiffness, steady_velocity(scene))
    return scene.replace(initial={"elongation_x": elongation})


def slow_scene(scene: Scene) -> Scene:
    """The scene for the model low_frequency: without the keys that this model does not use."""
    return scene.replace(**cast(Any, used_settings(scene.groups(), {"scene": {"model": "low_frequency"}})))


def slow_cycles(scene: Scene, wave: Waveform, delay: float, chain: Chain, patient: bool) -> Cycles:
    """The settled cycle of a scene with the model low_frequency, smooth in all its parameters.

    The slips of the waveform, of whose bins it has the means, are later than those of the model by a delay [s]. Of the chain only gain and
    tare are applied: for starts its filter does not matter. A patient run may take very long to settle.

    Raises
    ------
    NoCycleError
        If there is no stick-slip that repeats.
    """
    from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

    scene = _loaded(scene, wave)
    result = _settled(
        scene, wave, {"interval": 0.0, "fields": ["u_x", "w_x", "pull_force"]}, patient, is_slow=True
    )
    if "settled_at" not in result.summary:
        raise NoCycleError(f"{scene.name}: no stick-slip that repeats within {LONGEST[0]:g} measured periods")
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
    middle = 0.5 * cosine * (float(result.summary["peak_force"]) + float(result.summary["valley_force"]))
    slip = _fall_through(middle, np.linspace(begin, end, 400), load)

    def means(bins: _Floats, of: Callable[[_Floats], _Floats]) -> _Floats:
        """Means over bins at the same phases, of what repeats and has this integral."""
        edges = bins * (period / wave.period) + slip + delay
        turns = np.floor((edges - begin) / period)
        whole = of(np.array([begin + period]))[0]
        return np.asarray(np.diff(of(edges - turns * period) + turns * whole) / np.diff(edges))

    def force(t: _Floats) -> _Floats:
        return np.asarray(load_integral(t) + rest_integral(t) - load_integral(begin) - rest_integral(begin))

    def ahead(t: _Floats) -> _Floats:
        # X - V t = -u_x cos(phi) along the pull.
        return np.asarray((load_integral(t) - load_integral(begin)) / -float(scene.system.stiffness_x or 0.0))

    rows = [chain.gain * means(wave.edges, force) + chain.tare]
    if wave.creep_edges.size:
        rows.append(centred(means(wave.creep_edges, ahead)))
    row = np.hstack(rows)[np.newaxis]
    return Cycles(row, period, np.zeros(row.shape), 0.0, np.zeros((0, 3)))


def full_cycles(scene: Scene, wave: Waveform, delay: float, chain: Chain, patient: bool) -> Cycles:
    """Cycles of any model as a chain shows them: one, if the motion repeats, else those of a long run.

    Arguments and errors are as for `slow_cycles`.
    """
    scene = _loaded(scene, wave)
    repeats, summary = False, None
    begin = BEGINNING * wave.period
    # Long cycles have many samples.
    most = max(LEAST_LIBRARY, MOST_SAMPLES * wave.interval / wave.period)
    end = begin + min(LIBRARY if patient else FEWER, most) * wave.period
    if wave.repeats:
        result = _settled(
            scene, wave, {"interval": LONGEST[-1] * wave.period, "fields": ["sticking"]}, patient
        )
        summary = result.summary
        repeats = "settled_at" in summary
        end = begin + MEAN_OF * wave.period
        if repeats:
            begin = float(result.time[-1])
            end = begin + CYCLES * float(summary["period"])
    finer = finer_of(wave, chain) if repeats and patient else 1
    fine, begin, end = _sampled(scene, wave, begin, end, wave.interval / finer, repeats)
    summary = summary or fine.summary
    if "period" not in summary or "valley_force" not in summary:
        raise NoCycleError(
            f"{scene.name}: no stick-slip within {(begin + end) / wave.period:g} measured periods"
        )
    period = float(summary["period"])
    time = fine.time
    cosine, velocity = _geometry(scene)
    sense = np.sign(velocity)
    force = chain.response(wave.interval / finer, sense * pull_force(fine))
    load = chain.response(wave.interval / finer, sense * cosine * fine["spring_force_x"])
    middle = (
        0.5 * chain.gain * cosine * (float(summary["peak_force"]) + float(summary["valley_force"]))
        + chain.tare
    )
    k = np.flatnonzero((load[:-1] > middle) & (load[1:] <= middle))
    slips = time[k] + (load[k] - middle) / (load[k] - load[k + 1]) * np.diff(time)[k]
    stretch = period / wave.period if repeats else 1.0
    edges = wave.edges * stretch + delay
    later = LATER * wave.fall
    inside = slips[(slips + edges[0] >= begin) & (slips + edges[-1] + later <= end)]
    if inside.size == 0:
        raise NoCycleError("no whole cycle is found")
    if repeats:
        inside = inside[-1:]
    elif slips.size > 1:
        period = float(np.mean(np.diff(slips)))
    way = sense * (fine["X"] - velocity * time) if wave.creep_edges.size else None
    phases = [np.arange(k, time.size, finer) for k in range(finer)]

    def rows(delays: float) -> _Floats:
        at = edges + delays + inside[:, np.newaxis]
        found = [sampled_means(time, force, at, phases)]
        if way is not None:
            found.append(centred(sampled_means(time, way, at[:, : wave.creep_edges.size], phases)))
        return np.hstack(found)

    here = rows(0.0)
    there = np.zeros(here.shape) if wave.repeats else (rows(later) - here) / later
    at = _rests(time, fine["sticking"] > 0.0, inside + edges[0], SOON * wave.period)
    states = np.column_stack([time[at] - inside, fine["u_x"][at], fine["u_y"][at]])
    return Cycles(here, period, there, float(fine.summary.get("sticks", 0.0)) * period / end, states)


def _sampled(
    scene: Scene, wave: Waveform, begin: float, end: float, interval: float, repeats: bool
) -> tuple[Result, float, float]:
    """A run with samples from one time to another, and both; they are later if a motion that repeats does not do so yet."""
    while True:
        times = np.arange(begin, end, interval)
        fine = run(
            scene,
            times=times,
            progress=False,
            scene={"settle": 0.0, "t_end": max(end, float(times[-1]))},
            integrator={"max_steps": MOST_STEPS_OF_OWN},
            output={"fields": [*FIELDS, *(["X"] * (wave.creep_edges.size > 0))]},
        )
        if not repeats or fine.summary.get("repeats") or end > LONGEST[0] * wave.period:
            return fine, begin, end
        # An irregular beginning may last longer than in the run that has settled.
        begin, end = 2.0 * begin, begin + end


def _rests(time: _Floats, sticking: NDArray[np.bool_], times: _Floats, soon: float) -> NDArray[np.intp]:
    """Samples in the middle of the longest rests that are soon after these times; where there is none, in that of the nearest one."""
    changes = np.diff(sticking.astype(int), prepend=0, append=0)
    first, last = np.flatnonzero(changes > 0), np.flatnonzero(changes < 0) - 1
    found = []
    for low, high in zip(np.searchsorted(time, times), np.searchsorted(time, times + soon), strict=True):
        begin, end = np.maximum(first, low), np.minimum(last, high)
        k = int(np.argmax(end - begin)) if first.size else 0
        if first.size and end[k] >= begin[k]:
            found.append((begin[k] + end[k]) // 2)
        else:
            middles = np.append((first + last) // 2, time.size - 1)
            found.append(middles[np.argmin(np.abs(middles - low))])
    return np.array(found, dtype=np.intp)


def has_memory(chain: Chain) -> bool:
    """Whether a chain shows what was before: it then needs all samples."""
    return chain.filter is not None or chain.resonance is not None


def finer_of(wave: Waveform, chain: Chain) -> int:
    """Samples of a model for each sample of a trace."""
    if has_memory(chain):
        return FINER
    return max(1, math.ceil(FINER * wave.interval / float(np.diff(wave.edges).min())))


def sampled_means(
    time: _Floats, values: _Floats, edges: _Floats, phases: Sequence[NDArray[np.intp]]
) -> _Floats:
    """Means over bins as a trace shows them: of straight lines between its samples, which are anywhere in the cycle: at one of the phases."""
    return np.asarray(np.mean([bin_means(time[each], values[..., each], edges) for each in phases], axis=0))


def fastest_slip(scene: Scene, wave: Waveform) -> float:
    """Fastest slip of a scene's settled cycle along the drive [m/s]."""
    return float(
        _settled(scene, wave, {"interval": wave.interval, "fields": ["u_x"]}, False).summary["max_X_rate"]
    )


def _settled(
    scene: Scene, wave: Waveform, output: dict[str, object], patient: bool, is_slow: bool = False
) -> Result:
    integrator: dict[str, object] = {"max_steps": MOST_STEPS_OF_OWN}
    if is_slow:
        integrator = {"method": SLOW_METHOD, "rtol": TOLERANCE, "max_steps": MOST_STEPS}
    for longest in LONGEST if patient or is_slow else (SOONEST,):
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
        if "settled_at" in result.summary or not patient or result.summary.get("regularity") != 1:
            break
    # A motion that has ended in steady sliding has no period.
    if not 0.0 < result.summary.get("period", 0.0) < result.time[-1]:
        raise NoCycleError(f"{scene.name}: no stick-slip within {longest:g} measured periods")
    return result


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
