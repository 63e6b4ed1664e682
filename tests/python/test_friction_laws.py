"""The friction laws stribeck and table, and a static limit above F(0): closed forms, limits, other integrators, what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import dynstiction as ds
import moreau_jean
import numpy as np
import pytest
from fig3 import CONSTANT, FRICTION, TEXT
from programs import DONE, Program, executable
from results import assert_same
from scipy.integrate import solve_ivp

Deck = dict[str, dict[str, Any]]

EXACT = ["radau5", "radau9", "radau13", "dopri5", "dop853"]
TABLE = {"law": "table", "mu_0": None, "mu_inf": None, "v_f": None}
LOW = {"scene": {"model": "low_frequency"}, "system": {"stiffness_y": None}}
RNG = np.random.default_rng(11)


def changed(*changes: Deck) -> Deck:
    """One change after the other; None takes a key out."""
    groups = dict.fromkeys(group for change in changes for group in change)
    return {group: {key: value for change in changes for key, value in change.get(group, {}).items()} for group in groups}


def run(*changes: Deck) -> ds.Result:
    return ds.run(TEXT, **changed({"scene": {"t_end": 0.2}, "output": {"interval": 1e-3}}, *changes))


def refusal(*changes: Deck) -> str:
    with pytest.raises(ds.DeckError) as refused:
        run(*changes)
    return str(refused.value)


def friction(**keys: Any) -> Deck:
    return {"friction": keys}


def sampled(law: Callable[[Any], Any], last: float, panels: int) -> Deck:
    speed = np.linspace(0.0, last, panels + 1)
    return friction(**TABLE, table_speed=speed, table_mu=law(speed))


def weakening(speed: Any) -> Any:
    return 0.15 + 0.05 * np.exp(-speed / 0.01)


def same_numbers(one: ds.Result, other: ds.Result) -> None:
    """Time series and summary have the same bits."""
    assert_same(one, other)
    assert len(one["time"]) > 10
    assert dict(one.summary) == dict(other.summary)


# --- what is the same law gives the same bits


def scene(model: str) -> Deck:
    """A random scene in which the object slips and rests."""
    more: Deck = {
        "system": {"stiffness_y": 10.0 ** RNG.uniform(4, 7), "misalignment_deg": RNG.uniform(0.5, 30.0)},
        "drive": {"velocity": 10.0 ** RNG.uniform(-2.5, -1.0)},
        "initial": {"velocity_ratio": RNG.uniform(0.0, 1.0)},
    }
    return changed(more, LOW) if model == "low_frequency" else more


WAYS: dict[str, Deck] = {name: {"integrator": {"method": name}} for name in EXACT}
WAYS |= {
    "smoothed": {"friction": {"contact": "smoothed", "v_smooth": 1e-6}},
    "rk4": {"friction": {"contact": "smoothed", "v_smooth": 1e-3}, "integrator": {"method": "rk4", "rtol": None, "step": 1e-5}},
}


@pytest.mark.parametrize("way", EXACT)
@pytest.mark.parametrize("law", ["weakening", "stribeck"])
def test_static_limit_of_the_law_changes_no_bit(way: str, law: str) -> None:
    one = changed(scene("full"), WAYS[way], friction(law=law))
    if law == "stribeck":
        one = changed(one, friction(exponent=1.7, viscous=0.1))
    same_numbers(run(one), run(one, friction(mu_static=FRICTION["mu_0"])))


# --- convergence of a table, and what a run keeps of it


@pytest.mark.parametrize("model", ["full", "low_frequency"])
def test_table_converges_with_the_square_of_the_spacing(model: str) -> None:
    settle: Deck = {"scene": {"t_end": 4.5}, "integrator": {"method": "radau13", "rtol": 1e-12}}
    settle = changed(settle, LOW if model == "low_frequency" else {})
    panels = [8, 16, 32, 64]
    names = ("period", "valley_force", "max_X_rate")
    exact = run(settle).summary
    found = [run(settle, sampled(weakening, 0.04, n)).summary for n in panels]
    for name in names:
        errors = np.abs([summary[name] / exact[name] - 1.0 for summary in found])
        assert errors[0] > 1e-6 and errors[-1] < 3e-5, (name, errors)
        order = -np.polyfit(np.log(panels), np.log(errors), 1)[0]
        assert order >= 2.0, (name, errors)


def test_table_of_a_constant_is_the_constant_law() -> None:
    one = scene("full")
    constant = run(one, friction(**CONSTANT))
    table = run(one, friction(**TABLE, table_speed=[0.0, 0.3], table_mu=[0.2, 0.2]))
    for name in constant:
        scale = np.abs(constant[name]).max()
        assert np.abs(table[name] - constant[name]).max() <= 1e-6 * scale, name


def points_in(file: Path, text: str) -> Deck:
    file.write_text(text, encoding="utf-8")
    return friction(**TABLE, table=str(file))


@pytest.mark.parametrize(
    "text",
    [
        "0.0,0.2\n0.01,0.17\n0.05,0.15\n",
        "table_speed,table_mu\n0,0.2\n0.01,0.17\n0.05,0.15",
        '\ufeff"friction.table_speed";"Table_Mu"\r\n\r\n0.0;0.20\r\n1.0e-2;"0.17"\r\n5e-2;0.15\r\n',
        "0 0.2\r0.01   0.17\r0.05\t0.15\r".replace("\t", " "),
    ],
)
def test_points_of_a_file(tmp_path: Path, text: str) -> None:
    file = tmp_path / "points.csv"
    one = scene("full")
    listed = run(one, friction(**TABLE, table_speed=[0.0, 0.01, 0.05], table_mu=[0.2, 0.17, 0.15]))
    read = run(one, points_in(file, text))
    same_numbers(listed, read)
    # The result stands alone: its deck holds the points.
    file.unlink()
    assert read.parameters["mu_0"] == 0.2
    again = ds.Scene(read.resolved_deck)
    assert list(again.groups()["friction"]["table_speed"]) == [0.0, 0.01, 0.05]
    same_numbers(read, ds.run(read.resolved_deck))


def test_a_relative_name_is_looked_for_beside_the_deck(tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("0,0.2\n0.1,0.15\n")
    deck = tmp_path / "scene.nml"
    deck.write_text(TEXT.replace("'weakening'", "'table', table = 'points.csv'").replace("mu_0 = 0.20, mu_inf = 0.15", ""))
    deck.write_text("".join(line + "\n" for line in deck.read_text().splitlines() if "v_f" not in line))
    away = tmp_path / "away"
    away.mkdir()
    checked = Program((executable(),), away)("check", deck, status=DONE).stdout
    assert "table_speed = 0.0, 0.1" in checked and "table_mu = 0.2, 0.15" in checked
    assert "mu_0 = 0.2 " in checked


# What a file of points may be: tests/python/test_sweep_points.py.
BAD_FILES = {
    "0.0,0.2\n0.01\n": (":2:", "1 value(s), but the first line has 2"),
    "0.0\n0.01\n": (":1:", "1 value(s): give two in each row"),
    "speed,mu\n0.0,0.2\n0.01,0.1\n": (":1:", "name the columns in the first line: table_speed, table_mu"),
    "0.0,0.2\n\n0.02,0.19\n0.01,0.18\n": (":4:", "slip velocities must increase"),
    "0.0,0.2\n0.01,-0.19\n": (":2:", "must be >= 0"),
    "\n \n": ("points.csv: ", "0 point(s): give at least 2"),
    "0.01,0.2\n0.02,0.19\n": ("table_speed(1) = '0.01'", "the first slip velocity must be 0.0"),
    "".join(f"{i},0.2\n" for i in range(1001)): ("points.csv: ", "1001 point(s) in 'table_speed': give 2 to 1000"),
    "0,0.2\n1e-300,0.1\n": ("table_mu(2)", "give points further apart"),
    "0,0.2\n0.1,1e400\n": (":2:", "'1e400'"),
    "\x01\x02": (":1:", ""),
}


def test_bad_files_are_told_with_their_line(tmp_path: Path) -> None:
    for text, (place, remedy) in BAD_FILES.items():
        told = refusal(points_in(tmp_path / "points.csv", text))
        assert place in told and remedy in told and told.count("\n") == 0 and told.count("friction.table") == 1
    for file, words in ((tmp_path / "none.csv", "no such file: give the path of a CSV file"), (tmp_path, "is a folder")):
        told = refusal(friction(**TABLE, table=str(file)))
        assert str(file) in told and words in told


POINTS = {"table_speed": [0.0, 1.0], "table_mu": [0.2, 0.1]}
STRIBECK = {"law": "stribeck"}


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        (TABLE, "'table_speed' is missing"),
        (TABLE | {"table_speed": [0.0, 1.0], "table_mu": [0.2]}, "2 value(s) of 'table_speed' but 1 of 'table_mu'"),
        (TABLE | {"table_speed": [0.0], "table_mu": [0.2]}, "1 point(s) in 'table_speed': give 2 to 1000"),
        (TABLE | {"table_speed": [0.0, 1.0, 1.0], "table_mu": [0.2] * 3}, "table_speed(3) = '1.0' is not above"),
        (TABLE | POINTS | {"mu_0": 0.3}, "mu_0 = '0.3' is not the first"),
        (TABLE | {"table_speed": [0.0, 1.0], "table": "p.csv"}, "'table' beside 'table_speed' or 'table_mu'"),
        (TABLE | POINTS | {"mu_static": 0.1}, "mu_static = 0.1 is below"),
        (STRIBECK | {"exponent": 0.5}, "exponent = '0.5' is out of range: it must be >= 1.0 and <= 10.0"),
        (STRIBECK | {"viscous": -1.0}, "viscous = '-1.0' is out of range"),
        ({"exponent": 2.0}, "'exponent' is not used with law weakening"),
        ({"mu_static": 0.3, "contact": "smoothed", "v_smooth": 1e-5}, "'mu_static' is not used with contact smoothed"),
    ],
)
def test_what_is_no_law_is_refused(keys: dict[str, Any], told: str) -> None:
    answer = refusal(friction(**keys))
    assert told in answer
    assert "'mu_0' is missing" not in answer


# --- each law in every model and method, against one other way

LAWS: dict[str, tuple[dict[str, Any], Callable[[Any], Any]]] = {
    "stribeck": (
        {"law": "stribeck", "exponent": 2.0, "viscous": 0.4},
        lambda v: 0.15 + 0.05 * np.exp(-((v / 0.01) ** 2)) + 0.4 * v,
    ),
    "steep": ({"law": "stribeck", "exponent": 6.5, "viscous": 0.0}, lambda v: 0.15 + 0.05 * np.exp(-((v / 0.01) ** 6.5))),
    # One cubic from 0 to 1 m/s would be none of a straight line: two points are one.
    "table": (TABLE | {"table_speed": [0.0, 1.0], "table_mu": [0.2, 0.1]}, lambda v: 0.2 - 0.1 * v),
}
SLIDING: Deck = {
    "scene": {"t_end": 0.3},
    "system": {"stiffness_y": 1.0e5, "misalignment_deg": 5.0},
    "drive": {"velocity": 0.1},
    "initial": {"velocity_ratio": 1.0},
    "output": {"interval": 0.01, "fields": ["u_x", "u_y", "w_x", "w_y"]},
    "integrator": {"rtol": 1e-11},
}


def sliding(law: Callable[[Any], Any], rigid: bool) -> Any:
    """U and w of the scene at its samples, by SciPy in other unknowns: of both springs, or with the stiff one rigid."""
    stiffness, mass, load, drive = np.array([1e3, 1e5]), 0.25, 10.0, 0.1
    along = np.array([np.cos(np.radians(5.0)), np.sin(np.radians(5.0))])

    def rate(_: float, state: Any) -> Any:
        u, w = state[:2], state[2:]
        speed = np.hypot(*w)
        change = (stiffness * u - law(speed) * load * w / speed) / mass
        if rigid:
            change[1] = 0.0
        return np.concatenate([(drive * along - w) * ([1, 0] if rigid else [1, 1]), change])

    times = np.linspace(0.0, 0.3, 31)
    found = solve_ivp(rate, (0.0, 0.3), np.concatenate([[0, 0], drive * along]), "DOP853", times, rtol=1e-12, atol=1e-15)
    # At rest its right-hand side would have no direction; but slow enough that the laws weaken.
    slowest = np.hypot(*found.y[2:]).min()
    assert 5e-3 < slowest < 2e-2
    return found.y


@pytest.mark.parametrize("method", EXACT)
@pytest.mark.parametrize("model", ["full", "low_frequency"])
@pytest.mark.parametrize("name", LAWS)
def test_sliding_is_that_of_scipy(name: str, model: str, method: str) -> None:
    keys, law = LAWS[name]
    changes = changed(SLIDING, LOW if model == "low_frequency" else {}, WAYS[method], friction(**keys))
    result = run(changes if method != "radau5" else changed(changes, {"integrator": {"rtol": 1e-9}}))
    expected = sliding(law, model == "low_frequency")
    for i, column in enumerate(("u_x", "u_y", "w_x", "w_y")):
        if column in result:
            scale = np.abs(expected[i]).max()
            assert np.abs(result[column] - expected[i]).max() <= 1e-6 * max(scale, 1e-9), column
    assert abs(result.summary["energy_residual"]) < 1e-7


@pytest.mark.parametrize("name", LAWS)
def test_what_knows_only_two_laws_says_so(name: str) -> None:
    law = friction(**LAWS[name][0])
    result = run({"scene": {"model": "auto", "t_end": 0.05, "quantities": "stick_slip"}}, law)
    assert result.attributes["model"] == "full"
    high = run({"scene": {"model": "high_frequency", "t_end": 0.01}, "friction": {"contact": None}}, law)
    assert np.isfinite(high["u_y"]).all()
    deck = changed(LOW, law)
    with pytest.raises(ds.DeckError, match="rodas4p"):
        ds.sweep(TEXT, {"drive.velocity": [1e-3, 2e-3]}, **changed(deck, {"integrator": {"method": "rodas4p"}}))
    with pytest.raises(ds.DeckError, match="found only with the laws 'constant' and 'weakening'"):
        ds.cycles(ds.Scene(TEXT, **deck))


SLOW_CYCLES: dict[str, Deck] = {
    "stribeck": friction(law="stribeck", exponent=1.2, viscous=0.1),
    "table": sampled(weakening, 0.04, 16),
}


@pytest.mark.parametrize("name", SLOW_CYCLES)
def test_cycles_of_full_are_those_of_a_run(name: str) -> None:
    (cycle,) = ds.cycles(ds.Scene(TEXT, **SLOW_CYCLES[name])).cycles
    summary = run(SLOW_CYCLES[name], {"scene": {"t_end": 4.5}, "integrator": {"method": "radau13"}}).summary
    for value in ("period", "peak_force", "valley_force", "slip_length"):
        assert getattr(cycle, value) == pytest.approx(summary[value], rel=1e-7), value


def test_sweeps_vary_the_coefficients() -> None:
    deck = changed(LOW, {"scene": {"t_end": 3.0}}, friction(law="stribeck"))
    table = ds.sweep(TEXT, {"friction.exponent": [1.0, 1.5, 2.0], "friction.viscous": [0.0, 0.5]}, **deck)
    for exponent in (1.0, 1.5, 2.0):
        for viscous in (0.0, 0.5):
            one = ds.run(TEXT, **changed(deck, friction(exponent=exponent, viscous=viscous)))
            case = table.sel(exponent=exponent, viscous=viscous)
            assert float(case["max_X_rate"]) == one.summary["max_X_rate"]
    # In lanes where it is the weakening law, and not where it is none.
    with pytest.warns(ds.IncompleteWarning, match="friction that falls exponentially: use radau9"):
        lanes = ds.sweep(TEXT, {"friction.exponent": [1.0, 2.0]}, **changed(deck, {"integrator": {"method": "rodas4p"}}))
    assert next(int(code) for code in lanes["result_code"]) == 0 != int(lanes["result_code"][1])
    values = [0.0, 0.1, 0.25]
    with pytest.warns(ds.IncompleteWarning, match="mu_static = 0.1 is below"):
        static = ds.sweep(TEXT, {"friction.mu_static": values}, **changed({"scene": {"t_end": 0.3}}))
    assert [int(code) == 0 for code in static["result_code"]] == [True, False, True]
    rates = [float(static["max_X_rate"][i]) for i in (0, 2)]
    assert rates == [run({"scene": {"t_end": 0.3}}, friction(mu_static=values[i])).summary["max_X_rate"] for i in (0, 2)]
    assert rates[1] > 5.0 * rates[0]
    points = friction(**TABLE, table_speed=[0.0, 0.1], table_mu=[0.2, 0.15])
    with pytest.raises(ds.DeckError, match="is the first friction coefficient of the table"):
        ds.sweep(TEXT, {"friction.mu_0": [0.1, 0.2]}, **changed(points))


# --- the static limit: ordinary stick-slip along the drive, in closed form; in the plane: tests/audit, tests/invariance

MASS, STIFFNESS, LOAD = 0.25, 1.0e3, 10.0
KINETIC = 0.2


def stick_slip(mu_static: float, drive: float) -> dict[str, float]:
    """One stick-slip cycle of a mass on a spring with constant friction in slip."""
    omega = np.sqrt(STIFFNESS / MASS)
    swing = (mu_static - KINETIC) * LOAD / STIFFNESS
    slip = 2.0 * (np.pi - np.arctan(swing * omega / drive)) / omega
    fastest = np.hypot(drive, swing * omega)
    # From peak to valley the object is faster than the drive: half an oscillation.
    return {
        "period": 2.0 * swing / drive + slip,
        "slip_duration": np.pi / omega,
        "stick_duration": 2.0 * swing / drive + slip - np.pi / omega,
        "peak_force": KINETIC * LOAD + STIFFNESS * fastest / omega,
        "valley_force": KINETIC * LOAD - STIFFNESS * fastest / omega,
        "max_X_rate": drive + fastest,
        "slip_length": 2.0 * fastest / omega + drive * np.pi / omega,
    }


@pytest.mark.parametrize("method", EXACT[1:])
@pytest.mark.parametrize(("mu_static", "drive"), [(0.25, 1e-3), (0.21, 1e-2), (0.2001, 1e-3), (0.6, 0.3), (0.25, -1e-3)])
def test_static_limit_in_closed_form(method: str, mu_static: float, drive: float) -> None:
    expected = stick_slip(mu_static, abs(drive))
    along_the_drive: Deck = {
        "scene": {"t_end": mu_static * LOAD / STIFFNESS / abs(drive) + 6.3 * expected["period"]},
        "system": {"misalignment_deg": 0.0},
        "drive": {"velocity": drive},
        "initial": {"velocity_ratio": 0.0},
        "output": {"interval": 1e-2},
        "integrator": {"method": method, "rtol": 1e-12},
    }
    result = run(along_the_drive, friction(**CONSTANT, mu_static=mu_static))
    assert result.summary["cycles"] >= 4
    for name, value in expected.items():
        scale = 0.01 * expected["peak_force"] if name == "valley_force" else abs(value)
        assert abs(abs(result.summary[name]) - abs(value)) <= 1e-8 * max(scale, abs(value)), name
    assert abs(result.summary["energy_residual"]) < 1e-10


@pytest.mark.parametrize("mu_static", [0.2, 0.25, 0.3])
def test_a_scheme_without_events_converges_to_the_motion(mu_static: float) -> None:
    """Set-valued friction at the end of a step, in Python: the same rests, and the same path to first order."""
    one: Deck = {"scene": {"t_end": 1.0}, "system": {"stiffness_y": 1e4, "misalignment_deg": 10.0}}
    one = changed(one, {"drive": {"velocity": 0.01}}, friction(mu_static=mu_static), {"initial": {"velocity_ratio": 0.0}})
    exact = run(one, {"integrator": {"method": "radau13", "rtol": 1e-11}, "output": {"interval": 1e-3}})
    assert exact.summary["sticks"] >= 6
    law, load = FRICTION, FRICTION["normal_load"]

    def force(v: float) -> float:
        return float(load * (law["mu_inf"] + (law["mu_0"] - law["mu_inf"]) * np.exp(-v / law["v_f"])))

    steps, errors = np.array([1e-4, 5e-5, 2.5e-5]), []
    for step in steps:
        x, sticks = moreau_jean.positions(
            MASS, (STIFFNESS, 1e4), np.radians(10.0), 0.01, force, mu_static * load, step, round(1.0 / step)
        )
        assert sticks == exact.summary["sticks"]
        every = round(1e-3 / step)
        errors.append(np.abs(x[every - 1 :: every] - exact["X"][1:]).max() / exact["X"].max())
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 0.7 < order < 1.6 and errors[-1] < 1e-3, (order, errors)


def test_static_limit_where_it_means_nothing_is_refused() -> None:
    for model in ("low_frequency", "high_frequency", "creep", "creep_asymptotic"):
        assert f"'mu_static' is not used with model {model}" in refusal({"scene": {"model": model}}, friction(mu_static=0.3))
    with pytest.raises(ds.DeckError, match="found only without a separate static limit: remove mu_static"):
        ds.cycles(ds.Scene(TEXT, **friction(mu_static=0.3)), model="low_frequency")
    result = run({"scene": {"model": "auto", "t_end": 0.05}}, friction(mu_static=0.3))
    assert result.attributes["model"] == "full"


# --- numbers at the edges


@pytest.mark.parametrize(
    "keys",
    [
        {"law": "stribeck", "exponent": 10.0, "v_f": 1e-12},
        {"law": "stribeck", "exponent": 10.0, "v_f": 1e12},
        {"law": "stribeck", "exponent": 1.001, "viscous": 1e6},
        {"law": "stribeck", "exponent": 3.0, "mu_0": 0.0, "mu_inf": 0.0, "viscous": 1.0},
        TABLE | {"table_speed": [0.0, 1e-15, 1e15], "table_mu": [0.2, 0.1, 0.3]},
        TABLE | {"table_speed": [0.0, 1.0], "table_mu": [0.0, 0.5]},
        {"mu_static": 1e6},
        {"mu_static": 0.2 * (1 + 1e-15)},
        {"mu_0": 0.0, "mu_inf": 0.0, "mu_static": 0.1},
    ],
)
@pytest.mark.parametrize("way", ["radau9", "dopri5"])
def test_extreme_numbers_end_in_numbers_or_in_an_error(keys: dict[str, Any], way: str) -> None:
    limits: Deck = {"scene": {"t_end": 0.05}, "integrator": {"max_steps": 20000}}
    try:
        result = run(limits, friction(**keys), WAYS[way])
    except ds.Error as error:
        assert str(error)
    else:
        assert all(np.isfinite(result[name]).all() for name in result)
