"""What a load cell on the drive shows: extremes and frequency of the pull force."""

from __future__ import annotations

from typing import Any

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS

FIG3 = ds.Scene(INPUTS / "fig3.nml")
NAMES = ("pull_peak", "pull_valley", "pull_swing", "pull_frequency")

RIG = FIG3.replace(mass=0.4, stiffness_x=2e4, stiffness_y=2e6, normal_load=20.0, mu_0=0.25, mu_inf=0.18, v_f=4e-3, t_end=1.5)


def rig(phi: float, **changes: Any) -> ds.Scene:
    return RIG.replace(misalignment_deg=phi, **changes)


SCENES = {
    "stick-slip": FIG3,
    "damped": FIG3.replace(system={"damping_x": 2.0, "damping_y": 5.0}),
    "slow model": FIG3.replace(scene={"model": "low_frequency", "t_end": 8.0}),
    "rig": rig(1.0),
    "two oscillations": rig(12.0),
    "fast oscillation": rig(40.0),
    "pulled backwards": rig(12.0, drive={"velocity": -1e-3}),
    "constant friction": rig(1.0, friction={"law": "constant", "mu_inf": None, "v_f": None}),
    "explicit": rig(12.0, integrator={"method": "dop853"}),
    "smoothed": rig(12.0, scene={"t_end": 0.3}, friction={"contact": "smoothed", "v_smooth": 1e-6}),
}


def peaks_of(time: np.ndarray, force: np.ndarray) -> list[float]:
    """Times of the peaks from which the force falls by more than half of its range before it exceeds them."""
    least = 0.5 * np.ptp(force)
    found, heading, extreme = [], 1, 0
    for i in range(force.size):
        if heading * (force[i] - force[extreme]) >= 0.0:
            extreme = i
        elif abs(force[i] - force[extreme]) > least:
            if heading > 0 and extreme > 0:
                found.append(float(time[extreme]))
            heading, extreme = -heading, i
    return found


@pytest.mark.parametrize("name", SCENES)
def test_values_are_those_of_the_column(name: str) -> None:
    scene = SCENES[name].replace(output={"fields": "pull_force", "interval": 2e-5})
    result = ds.run(scene)
    late = result.time >= 0.5 * result.time[-1]
    force = result["pull_force"][late] * np.sign(result.parameters["velocity"])
    summary, size = result.summary, float(np.abs(force).max())
    assert summary["pull_peak"] == pytest.approx(force.max(), abs=2e-5 * size)
    assert summary["pull_valley"] == pytest.approx(force.min(), abs=2e-5 * size)
    assert summary["pull_peak"] >= force.max() - 1e-7 * size
    assert summary["pull_valley"] <= force.min() + 1e-7 * size
    assert summary["pull_swing"] == summary["pull_peak"] - summary["pull_valley"]
    peaks = peaks_of(result.time[late], force)
    if len(peaks) < 2:
        # One creep, which comes to its end, or one stick: nothing that is periodic is larger.
        assert "pull_frequency" not in summary
        return
    assert summary["pull_frequency"] == pytest.approx((len(peaks) - 1) / (peaks[-1] - peaks[0]), rel=2e-3)


@pytest.mark.parametrize("name", [name for name in SCENES if name not in ("slow model", "smoothed", "explicit")])
def test_the_map_does_not_change_them(name: str) -> None:
    leapt, stepped = (ds.run(SCENES[name], integrator={"cycle_map": way}, output={"interval": 0.1}) for way in ("auto", "off"))
    for each in NAMES:
        if each in stepped.summary or each in leapt.summary:
            assert leapt.summary[each] == pytest.approx(stepped.summary[each], rel=2e-7), each


@pytest.mark.parametrize("times", [(0.0, 0.4), (0.0, 0.4, 0.4, 1.0), (0.0, 0.8, 0.8)])
@pytest.mark.parametrize("speed", [1e-3, -1e-3])
def test_a_drive_that_rests_is_seen_in_its_direction(times: tuple[float, ...], speed: float) -> None:
    """It moves and rests, or rests at first and moves in the second half: the force counts in the direction in which it moves."""
    velocity = {2: (speed, 0.0), 3: (0.0, 0.0, speed), 4: (speed, speed, 0.0, 0.0)}[len(times)]
    drive = {"time": list(times), "velocity": list(velocity)}
    scene = rig(12.0, drive=drive, scene={"t_end": 1.0}, initial={"elongation_x": 1e-5})
    result = ds.run(scene, output={"fields": "pull_force", "interval": 1e-4})
    force = np.sign(speed) * result["pull_force"][result.time >= 0.5]
    assert result.summary["pull_peak"] == pytest.approx(force.max(), abs=1e-4)
    assert result.summary["pull_valley"] == pytest.approx(force.min(), abs=1e-4)
    assert np.abs(force).max() > 0.1


def test_where_the_load_is_quiet_the_load_cell_swings() -> None:
    """At 20 deg the stick-slip of k_x u_x is gone; an independent simulator found 4.190 to 5.049 N."""
    summary = ds.run(rig(20.0)).summary
    assert summary["swing"] < 0.02 * 5.0
    assert summary["pull_valley"] == pytest.approx(4.190, abs=1e-3)
    assert summary["pull_peak"] == pytest.approx(5.049, abs=1e-3)
    fast = np.sqrt(2e6 / 0.4) / (2 * np.pi)
    assert 0.2 * fast < summary["pull_frequency"] < fast


def test_long_and_settled_runs_and_sweeps_have_the_same_values() -> None:
    short, long = (ds.run(FIG3, scene={"t_end": end}, output={"interval": end / 10}).summary for end in (10.0, 3e4))
    settled = ds.run(FIG3, scene={"settle": 1e-6, "t_end": 100.0}).summary
    cases = ds.sweep(rig(1.0), {"misalignment_deg": [1.0, 20.0]})
    alone = [ds.run(rig(phi)).summary for phi in (1.0, 20.0)]
    for name in NAMES:
        assert long[name] == pytest.approx(short[name], rel=1e-9), name
        assert settled[name] == pytest.approx(short[name], rel=1e-6), name
        assert cases[name].values.tolist() == [summary[name] for summary in alone], name
