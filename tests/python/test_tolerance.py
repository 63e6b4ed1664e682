"""The smallest and the largest tolerances: what they give, and what they cost. True errors of random scenes: tests/audit."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS


def fig3(method: str, rtol: float, t_end: float = 10.0) -> ds.Result:
    return ds.run(INPUTS / "fig3.nml", t_end=t_end, method=method, rtol=rtol, cycle_map="off", interval=t_end)


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13"])
def test_loose_tolerances_are_of_use(method: str) -> None:
    """Fig. 3 after 5398 sticks: the longest steps still give the motion."""
    exact = fig3(method="radau13", rtol=1e-11)
    for rtol in (1e-3, 1e-4, 1e-5):
        found = fig3(method=method, rtol=rtol)
        assert found.sticks() == exact.sticks() == 5398
        gap = np.hypot(found["w_x"][-1] - exact["w_x"][-1], found["w_y"][-1] - exact["w_y"][-1])
        assert gap < 100 * rtol * np.hypot(exact["w_x"][-1], exact["w_y"][-1]), rtol


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13"])
def test_tolerances_that_save_nothing_are_tightened(method: str) -> None:
    """Beyond 1e-3 steps get no longer: they would take more Newton iterations."""
    loosest, loose, tight = (fig3(method=method, rtol=rtol, t_end=0.5) for rtol in (0.1, 3e-3, 1e-4))
    assert loosest.statistics["newton"] < 1.1 * loose.statistics["newton"] < 1.2 * tight.statistics["newton"]
    exact = fig3(method="radau13", rtol=1e-11, t_end=0.5)
    assert loosest["u_x"][-1] == pytest.approx(exact["u_x"][-1], rel=1e-3)


@pytest.mark.parametrize("method", ["radau9", "radau13"])
def test_smallest_tolerance_is_above_roundoff(method: str) -> None:
    """An estimate that is roundoff would let no step be accepted."""
    scene = ds.Scene(INPUTS / "fig3.nml", t_end=0.162415, velocity=0.008696861398735376, velocity_ratio=0.0, interval=0.162415)
    result = ds.run(
        scene, method=method, rtol=1e-13,
        mass=3.480169648166425, stiffness_x=995.9, stiffness_y=9463507165.97595, misalignment_deg=0.397373,
        mu_0=0.42109980163498795, mu_inf=0.1383628731788608, v_f=0.7513, normal_load=1.2848338195258513,
    )  # fmt: skip
    assert len(result.events) == 4
