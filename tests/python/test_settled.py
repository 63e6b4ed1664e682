"""The means of the summary are of the settled motion: whatever the way into the cycle, and none where it rings down."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from fig3 import slider

MEANS = ("period", "peak_force", "valley_force", "stick_duration", "slip_duration", "slip_length")

RAMP = {"velocity": (5e-4, 5e-4, 1e-3), "time": (0.0, 100.0, 150.0)}


def scene_of(phi: float, t_end: float, drive: dict[str, object], model: str = "low_frequency", **groups: object) -> ds.Scene:
    stiff = {} if model == "full" else {"stiffness_y": None}
    system = {"misalignment_deg": phi, **stiff}
    return ds.Scene(scene={"model": model, "t_end": t_end}, **slider({"system": system, "drive": drive}), **groups)


@pytest.fixture(scope="module")
def cycle() -> dict[str, float]:
    """The cycle at 1 mm/s and 8 degrees, reached without a ramp."""
    scene = scene_of(8.0, 40.0, {"velocity": 1e-3})
    return dict(ds.run(scene, integrator={"method": "radau13", "rtol": 1e-11}).summary)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13", "dopri5"])
def test_the_way_into_the_cycle_has_no_part(cycle: dict[str, float], method: str, rtol: float) -> None:
    """The ramp passes the critical speed; the beginning of stick-slip depends on the method, its cycles do not."""
    summary = ds.run(scene_of(8.0, 200.0, RAMP), integrator={"method": method, "rtol": rtol}).summary
    assert summary["cycles"] > 50
    for name in MEANS:
        assert summary[name] == pytest.approx(cycle[name], rel=10 * rtol if rtol > 1e-5 else 1e-5), name
        assert summary[f"{name}_scatter"] < 1e-3 * summary[name]


def test_the_full_model_settles_to_one_cycle() -> None:
    # At loose tolerances long steps may hold the unstable slide: tests of the integrators.
    ramp = {"velocity": (5e-4, 5e-4, 1e-3), "time": (0.0, 10.0, 15.0)}
    found = [
        ds.run(scene_of(8.0, 40.0, ramp, "full"), integrator={"method": method, "rtol": rtol}).summary
        for method, rtol in (("radau9", 1e-8), ("radau13", 1e-8), ("radau13", 1e-9))
    ]
    settled = ds.run(scene_of(8.0, 20.0, {"velocity": 1e-3}, "full")).summary
    for summary in found:
        for name in MEANS:
            assert summary[name] == pytest.approx(settled[name], rel=1e-3), name


@pytest.mark.parametrize("method", ["rodas4p", "radau9"])
def test_the_start_has_no_part_in_a_sweep(cycle: dict[str, float], method: str) -> None:
    starts = np.linspace(-3e-3, 3e-3, 16)
    data = ds.sweep(
        scene_of(8.0, 40.0, {"velocity": 1e-3}), {"initial.elongation_x": starts}, integrator={"method": method, "rtol": 1e-6}
    )
    for name in MEANS:
        np.testing.assert_allclose(data[name], cycle[name], rtol=1e-5, err_msg=name)


def test_the_first_peak_stands_apart() -> None:
    short = ds.run(scene_of(1.0, 2.5, {"velocity": 1e-3})).summary
    assert short["first_peak_force"] == pytest.approx(1.9933, abs=1e-4)
    assert short["cycles"] == 0
    assert not set(MEANS) & set(short)
    stretched = ds.run(scene_of(4.0, 20.0, {"velocity": 1e-3}, initial={"elongation_x": -3e-3, "velocity_ratio": -2.0}))
    peak = ds.stick_slip_statistics(stretched)["peak_force"][0]
    assert stretched.summary["first_peak_force"] == pytest.approx(peak, rel=1e-4)


# A start in which the oscillations shrink, to 0 or until the run ends.
RINGING = [
    (14.0, 5.0, 30e-3),
    (13.0, 5.0, 30e-3),
    (14.0, 1.0, 30e-3),
    (18.5, 20.0, 10e-3),
    (19.0, 3.0, 10e-3),
    (19.0, 0.6, 10e-3),
    (20.0, 3.0, 10e-3),
    (7.2, 20.0, 50e-3),
]


@pytest.mark.parametrize(("phi", "t_end", "velocity"), RINGING)
def test_what_rings_down_has_no_period(phi: float, t_end: float, velocity: float) -> None:
    result = ds.run(scene_of(phi, t_end, {"velocity": velocity}))
    assert result.summary["cycles"] > 0
    given = [name for name in (*MEANS, *(f"{name}_scatter" for name in MEANS)) if name in result.summary]
    assert given == []
    assert dict(ds.stick_slip_statistics(result).means()) == {}


@pytest.mark.parametrize("rtol", [1e-5, 1e-6, 10**-7.5, 1e-8, 1e-9])
def test_a_swing_that_just_counts_is_seen_inside_a_step(rtol: float) -> None:
    """Its peak and its valley lie inside steps, whose ends differ by less than counts."""
    result = ds.run(scene_of(20.0, 3.0, {"velocity": 10e-3}), integrator={"method": "radau13", "rtol": rtol})
    assert result.summary["cycles"] == 1


@pytest.mark.parametrize("method", ["rodas4p", "radau9"])
def test_what_rings_down_has_no_period_in_a_sweep(method: str) -> None:
    phi, t_end, velocity = np.transpose(RINGING)
    data = ds.sweep(
        scene_of(1.0, 1.0, {"velocity": 1e-3}),
        {"system.misalignment_deg": phi, "scene.t_end": t_end, "drive.velocity": velocity},
        points=True,
        integrator={"method": method, "rtol": 1e-6},
    )
    assert (data["cycles"] > 0).all()
    assert np.isnan(data["period"]).all()


@pytest.mark.parametrize("model", ["low_frequency", "full"])
def test_a_transition_out_of_stick_slip_has_no_period(model: str) -> None:
    """The drive speeds up, beyond the speed up to which there is stick-slip."""
    before = ds.run(scene_of(8.0, 6.0, {"velocity": 1e-3}, model)).summary
    assert "period" in before
    drive = {"velocity": (1e-3, 1e-3, 200e-3), "time": (0.0, 6.0, 6.2)}
    after = ds.run(scene_of(8.0, 12.0, drive, model)).summary
    assert after["cycles"] >= before["cycles"]
    assert "period" not in after


@pytest.mark.parametrize("t_end", [2.0, 5.0])
def test_a_small_cycle_that_lasts_has_a_period(t_end: float) -> None:
    """The first oscillations are larger than the cycle, and stay above it."""
    summary = ds.run(scene_of(17.5, t_end, {"velocity": 10e-3})).summary
    assert summary["period"] == pytest.approx(0.10094, rel=1e-3)


def irregular(seed: int, t_end: float = 30.0) -> ds.Result:
    """Stick-slip that a shaken drive makes irregular."""
    chance = np.random.default_rng(seed)
    times = np.arange(0.0, t_end, 0.35)
    drive = {"velocity": tuple(1e-3 * chance.uniform(0.2, 2.0, times.size)), "time": tuple(times)}
    return ds.run(scene_of(3.0, t_end, drive), output={"interval": 1e-4, "fields": ("spring_force_x", "X")})


@pytest.mark.parametrize("seed", range(3))
def test_irregular_stick_slip_lasts_and_its_scatter_is_that_of_the_series(seed: int) -> None:
    result = irregular(seed)
    force, time = result["spring_force_x"], result.time
    # Peaks and valleys of the sawtooth by another way: the largest and smallest force around the fast falls.
    falls = np.flatnonzero((force[50:] < force[:-50] - 0.1)[1:] & ~(force[50:] < force[:-50] - 0.1)[:-1])
    peaks = np.array([max(0, i - 2000) + int(np.argmax(force[max(0, i - 2000) : i + 1000])) for i in falls])
    valleys = np.array([i + int(np.argmin(force[i : i + 2000])) for i in falls])
    periods = np.diff(time[peaks])
    n = periods.size
    assert n == result.summary["cycles"]
    last = slice(n - n // 2, n)
    series = {
        "period": periods,
        "peak_force": force[peaks],
        "valley_force": force[valleys],
        "slip_duration": time[valleys] - time[peaks],
        "slip_length": result["X"][valleys] - result["X"][peaks],
        "stick_duration": time[peaks][1:] - time[valleys][:-1],
    }
    for name, values in series.items():
        chosen = values[last]
        tolerance = 1e-3 * np.abs(chosen).mean()
        assert result.summary[name] == pytest.approx(chosen.mean(), abs=tolerance), name
        assert result.summary[f"{name}_scatter"] == pytest.approx(chosen.std(ddof=1), abs=tolerance), name
    assert result.summary["period_scatter"] > 0.01 * result.summary["period"]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("t_end", [4.0, 6.0, 9.0])
def test_python_has_the_same_cycles(seed: int, t_end: float) -> None:
    result = irregular(seed, t_end)
    cycles = ds.stick_slip_statistics(result)
    whole = np.flatnonzero(np.isfinite(cycles["period"]))
    assert whole.size == result.summary["cycles"]
    for name in cycles.scatter():
        values = cycles[name][whole[-max(2, whole.size // 2) :]]
        mean, scatter = result.summary[name], result.summary[f"{name}_scatter"]
        assert (values.mean(), values.std(ddof=1)) == pytest.approx((mean, scatter), abs=2e-3 * mean)


def test_which_cycles_count() -> None:
    """All of two, the later half of more, at most a hundred: the drive changes its speed where they begin."""
    drive = {"velocity": (1e-3, 1e-3, 2e-3), "time": (0.0, 130.0, 130.0)}
    long = ds.run(scene_of(1.0, 240.0, drive))
    assert long.summary["cycles"] > 300
    assert long.summary["period"] == pytest.approx(ds.stick_slip_statistics(long)["period"][-2], rel=1e-3)
    for t_end, counted in ((2.5, 0), (3.5, 1), (4.5, 2), (5.0, 2), (7.0, 2), (10.0, 4)):
        found = ds.run(scene_of(1.0, t_end, {"velocity": 1e-3})).summary
        assert ("period" in found, "period_scatter" in found) == (counted > 0, counted > 1)


def test_a_long_slide_parts_two_motions() -> None:
    """Stick-slip sets in after 150 s, in which there was one peak only: that makes no cycle with the first of the new ones."""
    given = 0
    for t_end in (150.6, 151.0, 151.5, 152.0, 153.0, 156.0, 160.0):
        result = ds.run(scene_of(8.0, t_end, RAMP), integrator={"method": "radau13", "rtol": 1e-8})
        given += "period" in result.summary
        assert result.summary.get("period", 0.2) < 1.2, t_end
    assert given >= 3


def test_a_drive_that_rests_breaks_off_the_cycle() -> None:
    drive = {"velocity": (1e-3, 1e-3, 0.0, 0.0, 1e-3), "time": (0.0, 5.3, 5.3, 9.0, 9.0)}
    result = ds.run(scene_of(1.0, 14.0, drive))
    steady = ds.run(scene_of(1.0, 10.0, {"velocity": 1e-3})).summary
    for name in MEANS:
        assert result.summary[name] == pytest.approx(steady[name], rel=1e-4), name
    ended = ds.run(scene_of(1.0, 20.0, {"velocity": (1e-3, 1e-3, 0.0), "time": (0.0, 8.0, 8.0)}))
    assert ended.summary["period"] == pytest.approx(steady["period"], rel=1e-5)


def test_a_reversing_drive_has_the_cycles_of_its_strokes() -> None:
    """Six strokes, to and fro, have six times what one has, and no cycle is made of two strokes."""
    stroke = scene_of(1.0, 6.0, {"velocity": 1e-3})
    alone = ds.run(stroke)
    times, velocities = [], []
    for i in range(6):
        times += [6.0 * i, 6.0 * (i + 1)]
        velocities += [(-1) ** i * 1e-3] * 2
    there_and_back = ds.run(stroke, scene={"t_end": 36.0}, drive={"time": tuple(times), "velocity": tuple(velocities)})
    cycles = ds.stick_slip_statistics(there_and_back)
    assert np.nanmax(cycles["period"]) == pytest.approx(alone.summary["period"], rel=1e-3)
    assert np.isfinite(cycles["period"]).sum() == there_and_back.summary["cycles"]
    for name in MEANS:
        assert there_and_back.summary[name] == pytest.approx(alone.summary[name], rel=1e-5), name
