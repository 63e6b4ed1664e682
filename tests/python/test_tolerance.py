"""What rtol means: true errors of random scenes and of Fig. 3. bench/tolerance.py does the same with 100 scenes."""

from __future__ import annotations

import functools
import math

import dynstiction as ds
import numpy as np
import pytest
from programs import ROOT

RANGES = {"mass": (1e-4, 10.0), "k_y": (1e5, 1e10), "phi": (0.05, 30.0), "V": (1e-4, 0.1), "v_f": (1e-3, 1.0)}
SCENES, TOLERANCES = 6, (1e-4, 1e-6, 1e-8)
LIMIT = 2.0
"""F_0 of Fig. 3 [N]."""


@functools.cache
def values(number: int) -> dict[str, float]:
    random = np.random.default_rng([71, number])
    return {name: float(10.0 ** random.uniform(*np.log10(bounds))) for name, bounds in RANGES.items()}


def run(number: int, method: str, rtol: float, heavier: float = 1.0) -> ds.Result:
    """From unstretched springs through 150 fast periods of slip."""
    scene = values(number)
    angle = math.radians(scene["phi"])
    stick = LIMIT / math.hypot(1e3 * math.cos(angle), scene["k_y"] * math.sin(angle)) / scene["V"]
    t_end = stick + 150 * 2 * math.pi * math.sqrt(scene["mass"] / scene["k_y"])
    return ds.run(
        ROOT / "inputs" / "fig3.nml",
        scene={"t_end": t_end},
        system={"mass": heavier * scene["mass"], "stiffness_y": scene["k_y"], "misalignment_deg": scene["phi"]},
        friction={"v_f": scene["v_f"]},
        drive={"velocity": scene["V"]},
        initial={"velocity_ratio": 0.0},
        integrator={"method": method, "rtol": rtol, "cycle_map": "off"},
        output={"interval": t_end / 5000, "fields": ["w_x", "w_y", "spring_force_x", "spring_force_y"]},
    )


def error(found: ds.Result, true: ds.Result) -> float:
    """Of the slip velocity relative to the largest slip speed, or of the spring force relative to F_0."""
    w, force = (
        np.hypot(found[x] - true[x], found[y] - true[y]).max() for x, y in (("w_x", "w_y"), ("spring_force_x", "spring_force_y"))
    )
    return float(max(w / np.hypot(true["w_x"], true["w_y"]).max(), force / LIMIT))


@pytest.fixture(scope="module")
def truths() -> list[tuple[ds.Result, float]]:
    """Each with its conditioning: what a change of the mass does, over its size."""
    exact = [run(number, "radau13", 1e-12) for number in range(SCENES)]
    return [(true, error(run(number, "radau13", 1e-12, 1.0 + 1e-7), true) / 1e-7) for number, true in enumerate(exact)]


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13"])
def test_errors_are_as_large_as_rtol(truths: list[tuple[ds.Result, float]], method: str) -> None:
    """Within 0.01 and 30 times rtol, more only where a scene magnifies errors."""
    for rtol in TOLERANCES:
        over = [error(run(number, method, rtol), true) / rtol for number, (true, _) in enumerate(truths)]
        assert all(ratio <= 30.0 * (1.0 + conditioning) for ratio, (_, conditioning) in zip(over, truths, strict=True)), (
            rtol,
            over,
        )
        assert 0.01 < np.median(over) < 30.0, (rtol, over)


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


def fig3(method: str, rtol: float, t_end: float = 10.0) -> ds.Result:
    return ds.run(
        ROOT / "inputs" / "fig3.nml",
        scene={"t_end": t_end},
        integrator={"method": method, "rtol": rtol, "cycle_map": "off"},
        output={"interval": t_end},
    )


@pytest.mark.parametrize("method", ["radau9", "radau13"])
def test_smallest_tolerance_is_above_roundoff(method: str) -> None:
    """An estimate that is roundoff would let no step be accepted."""
    result = ds.run(
        ROOT / "inputs" / "fig3.nml",
        scene={"t_end": 0.162415},
        system={"mass": 3.480169648166425, "stiffness_x": 995.9, "stiffness_y": 9463507165.97595, "misalignment_deg": 0.397373},
        friction={"mu_0": 0.42109980163498795, "mu_inf": 0.1383628731788608, "v_f": 0.7513, "normal_load": 1.2848338195258513},
        drive={"velocity": 0.008696861398735376},
        initial={"velocity_ratio": 0.0},
        integrator={"method": method, "rtol": 1e-13},
        output={"interval": 0.162415},
    )
    assert len(result.events) == 4
