"""The models that leave something out: their limits, their errors against the full one, and what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import dynstiction as ds
import numpy as np
import pytest
from fig3 import CONSTANT
from programs import INPUTS, Program
from results import assert_same

METHODS = ["radau5", "radau9", "radau13", "dopri5", "dop853"]


def run(deck: str, **changes: Any) -> ds.Result:
    return ds.run(INPUTS / f"{deck}.nml", **changes)


def refusal(deck: str, **changes: Any) -> str:
    with pytest.raises(ds.DeckError) as refused:
        run(deck, **changes)
    return str(refused.value)


# --- what each says of each column


def standings() -> dict[str, dict[str, str]]:
    """The table of docs/models.md: model, column, 'follows', 'average', 'constant' or '–'."""
    page = (INPUTS.parent / "docs" / "models.md").read_text(encoding="utf-8")
    rows = [
        [cell.strip(" `") for cell in line.strip("|").split("|")]
        for line in page.split("## What each model gives for each column")[1].split("\n* ")[0].splitlines()
        if line.startswith("|")
    ]
    models = rows[0][1:]
    return {model: {row[0]: row[i] for row in rows[2:]} for i, model in enumerate(models, 1)}


DECKS = ("low_frequency", "high_frequency", "creep", "creep_asymptotic")


@pytest.mark.parametrize("deck", DECKS)
def test_columns_are_what_the_table_says(deck: str) -> None:
    groups = {"scene": {"t_end": 0.03}} if deck == "high_frequency" else {}
    table = standings()[deck]
    absent = [name for name, standing in table.items() if standing == "–"]
    for name in absent:
        assert f"does not give {name}" in refusal(deck, **groups, output={"fields": [name]})
    given = [name for name in table if name not in absent]
    result = run(deck, **groups, output={"fields": given})
    constant = [name for name in given if np.ptp(result[name]) <= 1e-15 * np.abs(result[name]).max()]
    assert constant == [name for name in given if table[name] == "constant"]


# --- low_frequency


@pytest.fixture(scope="module")
def low() -> ds.Result:
    return run("low_frequency", integrator={"rtol": 1e-10})


def test_low_frequency_is_within_one_percent_of_full(low: ds.Result) -> None:
    full = run("fig3", output={"interval": 1e-2})
    for name in ("cycles", "period", "peak_force", "valley_force", "slip_length", "max_X_rate"):
        assert low.summary[name] == pytest.approx(full.summary[name], rel=1e-2), name


def test_low_frequency_does_not_oscillate_nor_stick(low: ds.Result) -> None:
    assert low.sticks() == 0
    assert np.all(low["sticking"] == 0.0)
    assert np.all(low["u_y"] == 0.0)
    np.testing.assert_allclose(low["w_y"], 1e-3 * np.sin(np.radians(1.0)), rtol=1e-12)
    # A rigid spring guides the object with what friction has across.
    np.testing.assert_allclose(low["spring_force_y"], low["friction"] * np.sin(low["theta"]), rtol=1e-12)
    creep = low.time < 1.5
    ripple = np.diff(low["X_rate"][creep])
    assert np.all(ripple[1:] > 0.0)


def test_rk4_follows_what_never_rests(low: ds.Result) -> None:
    rk4 = {"method": "rk4", "step": 2e-6, "rtol": None, "t_end": 0.1}
    other = run("low_frequency", **rk4)
    np.testing.assert_allclose(other["u_x"], low["u_x"][: other.time.size], rtol=1e-8)
    text = refusal("low_frequency", **rk4, misalignment_deg=0.0)
    assert "rk4" in text and "use an adaptive method" in text


def test_without_misalignment_it_is_the_full_model() -> None:
    system = {"misalignment_deg": 0.0}
    line = run("low_frequency", system=system, integrator={"rtol": 1e-10})
    full = run("fig3", system=system, integrator={"rtol": 1e-10}, output={"interval": 1e-3})
    for name in ("u_x", "w_x", "X", "theta", "sticking"):
        np.testing.assert_allclose(line[name], full[name], atol=1e-8 * np.abs(full[name]).max(), err_msg=name)
    np.testing.assert_array_equal(line.events["kind"], full.events["kind"])
    assert line.summary["peak_force"] == pytest.approx(2.0099, abs=1e-4)
    assert line.summary["valley_force"] == pytest.approx(1.1341, abs=1e-4)
    assert line.summary["period"] == pytest.approx(0.936, abs=1e-3)


@pytest.mark.parametrize("angle", [1e-12, 1e-6, -1e-9])
def test_misalignment_vanishes_continuously(angle: float) -> None:
    line = run("low_frequency", system={"misalignment_deg": 0.0}, integrator={"rtol": 1e-8})
    other = run("low_frequency", system={"misalignment_deg": angle}, integrator={"rtol": 1e-8})
    for name in ("cycles", "period", "peak_force", "valley_force", "slip_length"):
        assert other.summary[name] == pytest.approx(line.summary[name], rel=1e-5), name


@pytest.mark.parametrize("method", ["radau9", "dopri5"])
@pytest.mark.parametrize(
    ("times", "velocities"),
    [
        ([0, 2, 2, 4, 4, 6], [1e-3, 1e-3, 0, 0, 1e-3, 1e-3]),
        ([0, 2, 3, 4, 5], [1e-3, 1e-3, 0, 0, 1e-3]),
        ([0, 3, 5], [1e-3, 1e-3, -1e-3]),
        ([0, 1], [0, 1e-3]),
    ],
    ids=["hold with jumps", "hold with ramps", "reversal", "ramp from rest"],
)
def test_profiles(method: str, times: list[float], velocities: list[float]) -> None:
    groups = {"scene": {"t_end": 6.0}, "drive": {"time": times, "velocity": velocities}}
    result = run("low_frequency", **groups, integrator={"method": method, "rtol": 1e-8})
    assert abs(result.summary["energy_residual"]) < 1e-8
    # What slips already does not begin to.
    assert np.all(np.diff(result.events["kind"]) != 0)
    full = run("fig3", **groups, integrator={"rtol": 1e-7}, output={"interval": 1e-3})
    # Slip comes a little earlier in one of the two, which shows as a spike of the difference.
    apart = np.abs(result["u_x"] - full["u_x"]) / np.abs(full["u_x"]).max()
    assert np.median(apart) < 5e-3
    # A jump as a ramp between two samples.
    knots = np.array(times, dtype=float)
    knots[1:][np.diff(knots) == 0.0] += 1e-9
    driven = np.interp(result.time, knots, velocities)
    np.testing.assert_allclose(result["w_y"], driven * np.sin(np.radians(1.0)), atol=1e-9)
    if times == [0, 2, 2, 4, 4, 6]:
        # While the drive holds, the object comes to rest, and leaves it when the drive moves on.
        assert list(result.events["kind"]) == [1, 2]
        assert 2.0 < result.events["time"][0] < 2.01
        assert result.events["time"][1] == 4.0
        held = (result.time > 2.01) & (result.time < 4.0)
        assert np.all(result["w_x"][held] == 0.0)
        assert np.all(result["sticking"][held] == 1.0)


def test_a_drive_that_turns_while_the_object_slips_is_no_event(low: ds.Result) -> None:
    """For the instant in which the drive guides nothing across the object continues along its line."""
    fastest = float(low.time[np.argmax(low["X_rate"])])
    drive = {"time": [0.0, fastest, fastest + 1e-3], "velocity": [1e-3, 1e-3, -1e-3]}
    result = run("low_frequency", drive=drive, scene={"t_end": fastest + 2e-3})
    assert result["w_x"][-1] > 0.9 * low["X_rate"].max()
    assert len(result.events) == 0


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
@pytest.mark.parametrize(("velocity", "v_f"), [(1e-2, 1e-3), (1e-2, 1e-4), (1e-1, 1e-3)])
def test_a_release_where_friction_falls_within_a_tiny_slip(method: str, velocity: float, v_f: float) -> None:
    """By an explicit method as by an implicit one."""
    short = {"velocity": velocity, "v_f": v_f, "velocity_ratio": 0.0, "t_end": 1.3e-5 / velocity, "interval": 5e-7 / velocity}
    exact = run("fig3", **short, method="radau13", rtol=1e-12)
    found = run("fig3", **short, method=method, rtol=1e-8)
    assert np.abs(exact["w_y"]).max() > 0.0
    for name in ("w_y", "u_y"):
        assert np.abs(found[name] - exact[name]).max() < 1e-9 * np.abs(exact[name]).max(), name


# --- high_frequency


def test_frequency_of_the_fast_oscillation() -> None:
    """F = f_y sqrt(1 - (k_x u_x/F_0)^2) with constant friction, Eq. (9)."""
    for load in (0.0, 0.5, 0.9):
        result = run("high_frequency", friction=CONSTANT, elongation_x=2e-3 * load, t_end=0.05, interval=1e-6)
        w = result["w_y"] - 1e-3 * np.sin(np.radians(1.0))
        up = np.flatnonzero((w[:-1] < 0.0) & (w[1:] >= 0.0))
        crossings = result.time[up] - w[up] * 1e-6 / (w[up + 1] - w[up])
        frequency = (crossings.size - 1) / (crossings[-1] - crossings[0])
        assert frequency == pytest.approx(1006.58 * np.sqrt(1.0 - load**2), rel=1e-4)


@pytest.mark.parametrize("method", METHODS)
def test_fast_oscillation_sticks_and_slips(method: str) -> None:
    result, stepped = (run("high_frequency", integrator={"method": method, "cycle_map": how}) for how in ("auto", "off"))
    assert 150 < result.sticks() == stepped.sticks() < 200
    assert 10 * result.statistics["steps"] < stepped.statistics["steps"]
    np.testing.assert_allclose(result["X"], stepped["X"], rtol=1e-7)
    assert np.all(result["u_x"] == 1e-3)
    assert np.all(result["w_y"] >= 0.0)
    slipping = result["sticking"] == 0.0
    np.testing.assert_allclose(result["theta"][slipping], np.arccos(0.5), rtol=1e-9)
    force = np.hypot(result["spring_force_x"], result["spring_force_y"])
    assert np.all(force[~slipping] <= 2.0 * (1.0 + 1e-12))
    assert abs(result.summary["energy_residual"]) < 1e-8
    # It saturates where the slip velocity touches zero.
    assert (1e-3 * np.sin(np.radians(1.0)) - result["w_y"]).max() == pytest.approx(1e-3 * np.sin(np.radians(1.0)))


def test_fast_oscillation_without_load_is_that_of_the_full_model() -> None:
    groups = {"initial": {"elongation_x": 0.0}, "scene": {"t_end": 0.03}, "output": {"interval": 1e-5}}
    alone = run("high_frequency", **groups)
    full = run("fig3", initial={"velocity_ratio": 0.0}, scene=groups["scene"], output=groups["output"])
    assert alone.sticks() == full.sticks()
    late = alone.time > 0.02
    assert np.ptp(alone["spring_force_y"][late]) == pytest.approx(np.ptp(full["spring_force_y"][late]), rel=2e-2)


# --- creep and creep_asymptotic


def test_creep_is_the_closed_form() -> None:
    result = run("creep")
    exact = ds.creep_exact(result.time * 0.5, np.radians(1.0), 1e-4)
    slides = result["sticking"] == 0.0
    assert result.events["time"][-1] == pytest.approx(0.0114595, abs=1e-6)
    np.testing.assert_allclose(result["X_rate"][slides], 1e-3 * exact.X_rate[slides], rtol=1e-12)
    np.testing.assert_allclose(result["Y_rate"][slides], 1e-3 * exact.Y_rate[slides], rtol=1e-10, atol=1e-18)
    np.testing.assert_allclose(result["X"], 2e-3 * exact.X, rtol=1e-12)
    np.testing.assert_allclose(result["theta"][slides], exact.theta[slides], rtol=1e-12)
    np.testing.assert_allclose(np.hypot(*forces(result))[slides], 2.0, rtol=1e-12)
    assert result.attributes["method"] == "closed form"
    assert "zeta" not in result
    # X = V t - u_x c - u_y s, Eq. (6).
    c, s = np.cos(np.radians(1.0)), np.sin(np.radians(1.0))
    np.testing.assert_allclose(result["X"], 1e-3 * result.time - result["u_x"] * c - result["u_y"] * s, atol=1e-17)


def forces(result: ds.Result) -> tuple[np.ndarray, np.ndarray]:
    return result["spring_force_x"], result["spring_force_y"]


def test_creep_depends_on_the_distance_driven_only() -> None:
    steady = run("creep", scene={"t_end": 1.5}, output={"interval": 1.5})
    profile = {"time": [0, 1, 2, 2, 3, 3], "velocity": [5e-4, 1e-3, 1e-3, 0, 0, -0.0]}
    held = run("creep", drive=profile, scene={"t_end": 5.0}, output={"interval": 0.5})
    distance = 1.75e-3
    there = run("creep", scene={"t_end": distance * 1e3}, output={"interval": 10.0})
    assert held["X"][-1] == pytest.approx(there["X"][-1], rel=1e-12)
    assert held["X_rate"][-1] == 0.0
    assert steady["X"][-1] < there["X"][-1]


@pytest.mark.parametrize(("angle", "velocity"), [(-1.0, 1e-3), (179.0, 1e-3), (181.0, 1e-3), (1.0, -1e-3)])
def test_creep_in_other_quadrants(angle: float, velocity: float) -> None:
    result = run("creep")
    other = run("creep", system={"misalignment_deg": angle}, drive={"velocity": velocity})
    sign = np.sign(velocity)
    np.testing.assert_allclose(other["X"], sign * result["X"], rtol=1e-9)
    e = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    np.testing.assert_allclose(other["X"], velocity * other.time - other["u_x"] * e[0] - other["u_y"] * e[1], atol=1e-16)
    np.testing.assert_allclose(np.abs(other["w_y"]), np.abs(result["w_y"]), rtol=1e-9)


@pytest.mark.parametrize("form", ["first_power", "printed", "third_order"])
def test_forms_of_the_asymptotics(form: str) -> None:
    result = run("creep_asymptotic", scene={"form": form}, output={"interval": 1e-4})
    assert list(result) == ["time", "X", "X_rate"]
    rate = ds.creep_asymptotic(result.time * 0.5, np.radians(1.0), form=form)  # type: ignore[arg-type]
    np.testing.assert_allclose(result["X_rate"], 1e-3 * rate, rtol=1e-12)
    # X is the integral of X' (Simpson).
    rates = result["X_rate"]
    integral = 1e-4 / 3.0 * np.cumsum(rates[:-2:2] + 4.0 * rates[1:-1:2] + rates[2::2])
    np.testing.assert_allclose(result["X"][2::2], integral, rtol=1e-6)


@pytest.mark.parametrize(
    ("deck", "groups", "remedy"),
    [
        ("creep_asymptotic", {"scene": {"t_end": 2.0}}, "t_end < 2 s"),
        ("creep_asymptotic", {"system": {"misalignment_deg": 0.0}}, "0 < |misalignment_deg| < 90"),
        ("creep_asymptotic", {"system": {"misalignment_deg": 90.0}}, "no component along the soft axis"),
        ("creep", {"system": {"misalignment_deg": 0.0}}, "t_end < 2 s"),
        ("creep", {"system": {"misalignment_deg": -90.0}}, "no component along the soft axis"),
        ("creep", {"system": {"stiffness_y": 1e3}}, "stiffness_y > stiffness_x"),
        ("creep", {"friction": {"normal_load": 0.0}}, "must be > 0"),
        ("creep", {"drive": {"time": [0, 1], "velocity": [1e-3, -1e-3]}}, "never reverses"),
        ("creep", {"output": {"interval": 0.0}}, "output.interval must be > 0"),
        ("creep", {"output": {"fields": ["X", "zeta"]}}, "does not give zeta"),
        ("creep_asymptotic", {"output": {"fields": ["theta"]}}, "does not give theta"),
        ("high_frequency", {"initial": {"elongation_x": 2e-3}}, "|stiffness_x*elongation_x| must be < mu_0*normal_load = 2 N"),
    ],
    ids=str,
)
def test_refusals(deck: str, groups: dict[str, dict[str, Any]], remedy: str) -> None:
    assert remedy in refusal(deck, **groups)


def test_creep_is_rest_without_misalignment_and_before_it_begins() -> None:
    for result in (
        run("creep", system={"misalignment_deg": 0.0}, scene={"t_end": 1.9}),
        run("creep", scene={"t_end": 0.005}, output={"interval": 1e-3}),
    ):
        assert np.all(result["X"] == 0.0)
        assert np.all(result["sticking"] == 1.0)
    assert list(result.events["kind"]) == [1]
    assert result.summary["sticking_time"] == 0.005


# --- the same from the executable


@pytest.mark.parametrize("deck", [*DECKS, "auto"])
def test_executable_writes_what_python_returns(deck: str, program: Program, tmp_path: Path) -> None:
    program("run", INPUTS / f"{deck}.nml", status=0)
    written, returned = ds.open(tmp_path / f"{deck}.h5"), run(deck)
    assert_same(written, returned)
    for name in ("model", "method", "model_choice"):
        assert written.attributes.get(name) == returned.attributes.get(name)


@pytest.mark.deck
def test_decks_run(program: Program) -> None:
    program("run", *(INPUTS / f"{deck}.nml" for deck in (*DECKS, "auto")), status=0)


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 31.6])
@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13"])
@pytest.mark.parametrize("late", [0.0, 4e-16, 1e-14, 1e-11])
def test_a_release_just_before_the_end(method: str, late: float, degrees: float) -> None:
    """The spring reaches the static limit at 2 s. Where nothing can be seen of the slip before the end, it is rest."""
    short = {"t_end": 2.0 + late, "interval": 1.0, "misalignment_deg": degrees, "stiffness_y": 1e3}
    result = run("fig3", **short, method=method, rtol=1e-6)
    assert np.hypot(result["u_x"][-1], result["u_y"][-1]) == pytest.approx(2e-3, rel=1e-6)
    assert np.hypot(result["w_x"][-1], result["w_y"][-1]) < 1e-10
