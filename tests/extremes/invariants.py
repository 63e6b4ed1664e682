"""What every scene must end in: a sound result, or an error that says what is wrong and what would help."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass

import dynstiction as ds
import numpy as np
from drives import distance
from matrix import FIG3, Groups

WALL_LIMIT = 60.0
"""A run that lasts longer hangs [s]; `max_steps` ends every sound one long before."""


@dataclass
class Ending:
    """How one scene ended: the result code, the faults found, and the result unless the scene was refused."""

    code: int
    faults: list[str]
    result: ds.Result | None = None


def finish(groups: Groups) -> Ending:
    """Run a scene and look for whatever must not be."""
    deck = {**groups, "output": {**groups.get("output", {}), "wall_limit": WALL_LIMIT}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ds.IncompleteWarning)
        try:
            result = ds.run(ds.Scene(**deck))
        except ds.DeckError as error:
            return Ending(2, refusal_faults(str(error)))
        except ds.SolverError as error:
            assert isinstance(error.result, ds.Result)
            faults = solver_error_faults(str(error)) + state_faults(error.result, groups)
            return Ending(error.code, faults, error.result)
    return Ending(result.result_code, faults_of(result, groups), result)


def faults_of(result: ds.Result, groups: Groups) -> list[str]:
    """What must not be in the result of a run that has ended."""
    faults = state_faults(result, groups) + balance_faults(result, groups)
    if result.result_code != 0:
        faults.append(f"hangs: {result.attributes['result_text']}")
    elif result.time[-1] != groups["scene"]["t_end"]:
        faults.append(f"ends at {result.time[-1]!r} and not at t_end")
    return faults


def refusal_faults(text: str) -> list[str]:
    """A refusal names the key or the model that is at fault."""
    keys = "|".join({key for keys in FIG3.values() for key in keys} | {"t_end", "method", "model", "time"})
    named = re.search(rf"\b({keys})\b|V t/l_x|Eq\. \(8\)", text)
    return [] if named else [f"says nothing of a key: {text}"]


def solver_error_faults(text: str) -> list[str]:
    """A solver that gives up says where, and what to do."""
    faults = []
    if not re.search(r"t = -?[0-9.]+(e-?\d+)? s", text):
        faults.append(f"gives no time: {text}")
    if not re.search(r"\b(use|raise|see|reduce)\b", text):
        faults.append(f"gives no remedy: {text}")
    return faults


def state_faults(result: ds.Result, groups: Groups) -> list[str]:
    """Finite values, Coulomb's law, the sequence of events, and the position."""
    faults = [name for name in result if not np.isfinite(result[name]).all()]
    if faults:
        return [f"not finite: {', '.join(faults)}"]
    time = result.time
    if time.size and (time[0] != 0 or (np.diff(time) < 0).any()):
        faults.append("the time does not run on from 0")
    if "u_x" in result:
        faults += contact_faults(result, groups) + position_faults(result, groups)
    faults += event_faults(result)
    return faults


def contact_faults(result: ds.Result, groups: Groups) -> list[str]:
    friction = groups["friction"]
    limit = friction["mu_0"] * friction["normal_load"]  # type: ignore[operator]
    # `auto` leaves out what the model that it takes holds constant.
    stuck = result["sticking"] == 1 if "sticking" in result else np.zeros(result.time.shape, dtype=bool)
    load = np.hypot(result["spring_force_x"], result["spring_force_y"])
    if groups["system"].get("damping_x") or groups["system"].get("damping_y"):
        # Springs and dampers together: what friction holds.
        load = result["friction"]
    speed = np.hypot(result["X_rate"], result["Y_rate"])
    forward = result["X_rate"] * np.cos(result["psi"]) + result["Y_rate"] * np.sin(result["psi"])
    faults = []
    if (load[stuck] > limit * (1 + 1e-9)).any():
        faults.append(f"sticks under {load[stuck].max() / limit if limit else np.inf:.16g} of the static limit")
    if speed[stuck].any():
        faults.append("moves while it sticks")
    if (forward < -1e-9 * speed.max(initial=0.0)).any():
        faults.append("friction along the slip: v < 0")
    if (result["friction"] < 0).any():
        faults.append("negative friction")
    return faults


def position_faults(result: ds.Result, groups: Groups) -> list[str]:
    """X = D(t) - u.e but for a constant, where both elongations move."""
    if result.attributes["model"] not in {"full", "creep"}:
        return []
    phi = np.radians(groups["system"]["misalignment_deg"])  # type: ignore[call-overload]
    stretch = result["u_x"] * np.cos(phi) + result["u_y"] * np.sin(phi)
    driven = distance(groups["drive"]["velocity"], groups["drive"].get("time", 0.0), result.time)
    open_ = result["X"] - (driven - stretch)
    scale = max(np.abs(driven).max(), np.abs(result["u_x"]).max(), np.abs(result["u_y"]).max())
    gap = np.abs(open_ - open_[0]).max()
    return [f"X differs from D - u.e by {gap / scale:.1e}"] if gap > 1e-9 * scale else []


def event_faults(result: ds.Result) -> list[str]:
    # Where the motion repeats there can be more events than anybody counts: the table of the file has one repetition.
    log = result.log
    time, kind = log["time"], log["kind"]
    faults = []
    if (np.diff(time) < 0).any():
        faults.append("events out of order")
    if (kind[1:] == kind[:-1]).any():
        faults.append("stick and slip do not take turns")
    if "sticking" in result and time.size and (log["occurs"] == 1).all():
        # At the instant of an event both states are true. In a cycle that is repeated its time may be another sum, by one roundoff.
        instants = (result.time, np.nextafter(result.time, -np.inf), np.nextafter(result.time, np.inf))
        between = ~np.any([np.isin(instant, time) for instant in instants], axis=0)
        last = np.searchsorted(time, result.time, side="right") - 1
        known = between & (last >= 0)
        state = kind[last[known]] == ds.record.STICK_BEGINS
        if (state != (result["sticking"][known] == 1)).any():
            faults.append("the column sticking contradicts the events")
    return faults


ENERGY = 400.0
"""Most that the balance may be open, over rtol: of 7000 random scenes the worst is at 190, and one in twenty above 1."""
STIFF_DAMPER, STIFFLY_DAMPED_ENERGY = 1e9, 1e4
"""With a damper of at least so much [N s/m]: a step may pass over the layer of m/c in which it takes hold, and its force is the
small difference of large ones. The worst of 3000 random pairs of ends is at 5100 and 4e-9."""
FIXED_STEP_ENERGY = 1e-3
"""Of rk4, which has no tolerance, with 50 steps a period."""


def balance_faults(result: ds.Result, groups: Groups) -> list[str]:
    """The energy balance is closed to the tolerance of the steps, over the first energy and all that was exchanged."""
    summary = result.summary
    if "energy_residual" not in summary:
        return []
    if not np.isfinite(summary["drive_work"] + summary["friction_work"]):
        return ["infinite work"]
    residual = summary["energy_residual"]
    method = str(result.attributes["method"])
    dampers = [float(str(groups["system"].get(key, 0.0))) for key in ("damping_x", "damping_y")]
    stiff = max(dampers) >= STIFF_DAMPER
    rtol = float(groups["integrator"].get("rtol", 1e-8))  # type: ignore[arg-type]
    tolerance = FIXED_STEP_ENERGY if method == "rk4" else (STIFFLY_DAMPED_ENERGY if stiff else ENERGY) * rtol
    # Not '>': it may not be a number.
    return [] if abs(residual) <= tolerance else [f"energy balance open by {residual:.1e}"]
