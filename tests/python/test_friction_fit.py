"""Measured points become the simplest law of a deck that explains them, with errors that hold."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import dynstiction as ds
import numpy as np
import pytest
from programs import INPUTS

SPEEDS = np.geomspace(1e-4, 1.0, 24)
LAWS: dict[str, dict[str, float]] = {
    "constant": {"mu_0": 0.3},
    "weakening": {"mu_0": 0.2, "mu_inf": 0.15, "v_f": 0.01},
    "stribeck": {"mu_0": 0.2, "mu_inf": 0.15, "v_f": 0.01, "exponent": 2.0, "viscous": 0.05},
}


def friction(values: dict[str, float], v: Any) -> Any:
    mu_0, mu_inf = values["mu_0"], values.get("mu_inf", values["mu_0"])
    steep = (v / values.get("v_f", 1.0)) ** values.get("exponent", 1.0)
    return mu_inf + (mu_0 - mu_inf) * np.exp(-steep) + values.get("viscous", 0.0) * v


@pytest.mark.parametrize("law", LAWS)
def test_each_law_is_found(law: str) -> None:
    exact = ds.fit_friction_law(SPEEDS, friction(LAWS[law], SPEEDS))
    assert exact.law == law and exact.values == pytest.approx(LAWS[law], rel=1e-6)
    mixed = np.random.default_rng(3).permutation(SPEEDS.size)
    again = ds.fit_friction_law(SPEEDS[mixed], friction(LAWS[law], SPEEDS)[mixed])
    assert again.values == exact.values
    assert exact.mu(SPEEDS) == pytest.approx(friction(LAWS[law], SPEEDS), rel=1e-6)


def test_errors_hold() -> None:
    """95 % intervals of coefficients and slopes of 60 sets of points, where the law is found."""
    rng, inside = np.random.default_rng(5), []
    true = LAWS["weakening"]
    for _ in range(60):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ds.FitWarning)
            found = ds.fit_friction_law(SPEEDS, friction(true, SPEEDS) + 1e-3 * rng.standard_normal(SPEEDS.size))
        if found.law != "weakening":
            continue
        inside += [abs(found.values[key] - true[key]) < 2.08 * found.errors[key] for key in true]
        slope, error = found.slope(0.005)
        inside.append(abs(slope + 0.05 / 0.01 * np.exp(-0.5)) < 2.08 * error)
    assert len(inside) > 180 and 0.91 <= np.mean(inside) <= 0.98


def test_the_lines_run_as_a_deck(tmp_path: Path) -> None:
    found = ds.fit_friction_law(SPEEDS, friction(LAWS["stribeck"], SPEEDS))
    scene = ds.Scene(INPUTS / "fig3.nml").replace(friction=ds.Friction(law=found.law, normal_load=10.0, **found.values), t_end=0.1)
    lines = found.deck.replace("\n/", "\n  normal_load = 10.0\n/")
    before, _, rest = scene.to_deck().partition("&friction")
    deck = tmp_path / "rig.nml"
    deck.write_text(before + lines + rest.partition("\n/")[2])
    a, b = ds.run(scene), ds.run(deck)
    assert np.abs(a["u_x"] - b["u_x"]).max() < 1e-9 * np.abs(a["u_x"]).max()


def test_noise_that_would_decide_is_told() -> None:
    noise = 5e-3 * np.random.default_rng(1).standard_normal(SPEEDS.size)
    found = ds.fit_friction_law(SPEEDS, friction(LAWS["weakening"], SPEEDS) + noise)
    assert found.turns > 3 and "rise and fall by their noise" in str(found)
    smooth = ds.fit_friction_law(SPEEDS, friction(LAWS["weakening"], SPEEDS))
    assert smooth.turns == 0 and "noise" not in str(smooth)
    mild = ds.fit_friction_law(
        SPEEDS, friction(LAWS["weakening"], SPEEDS) + 1e-3 * np.random.default_rng(4).standard_normal(SPEEDS.size)
    )
    assert mild.law == "weakening" and str(mild).count("its sign is not known") == 1


def test_a_coefficient_that_is_not_determined_is_told() -> None:
    slow = np.linspace(1e-5, 2e-4, 12)
    mu = friction({"mu_0": 0.2, "mu_inf": 0.15, "v_f": 1e-3}, slow) + 3e-4 * np.random.default_rng(2).standard_normal(12)
    with pytest.warns(ds.FitWarning, match="is not determined by these points"):
        ds.fit_friction_law(slow, mu)


def test_tables_are_read_as_traces_are(tmp_path: Path) -> None:
    expected = ds.fit_friction_law(SPEEDS, friction(LAWS["weakening"], SPEEDS)).values
    rows = [(1e3 * v, 100.0 * mu) for v, mu in zip(SPEEDS, friction(LAWS["weakening"], SPEEDS), strict=True)]
    path = tmp_path / "points.csv"
    for text, options in (
        ("speed [mm/s];mu [%]\n" + "".join(f"{v:.12g};{mu:.12g}\n".replace(".", ",") for v, mu in rows), {}),
        ("mu (%)\tv (mm/s)\n" + "".join(f"{mu:.12g}\t{v:.12g}\n" for v, mu in rows), {}),
        ("".join(f"{v:.12g} {mu:.12g}\n" for v, mu in rows), {"units": {"speed": "mm/s", "mu": 0.01}}),
    ):
        path.write_text(text)
        assert ds.fit_friction_law(path, **options).values == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("speed [furlong];mu\n1;0.2\n2;0.2\n", "furlong"),
        ("speed;mu\n1;0.2\n2;much\n3;0.2\n4;0.2\n5;0.1\n", r":3: mu \(column 1\) is 'much'"),
        ("speed;mu\n1;0.2\n2;0.2\n", "at least 5 points"),
        ("speed;mu\n-1;0.2\n2;0.2\n3;1\n4;1\n5;1\n", "speed"),
        ("", "has no samples: a table has one a line, speed and mu"),
    ],
)
def test_faults_of_tables(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises((ds.FileError, ds.UsageError), match=told):
        ds.fit_friction_law(path)


def test_wrong_use() -> None:
    with pytest.raises(ds.UsageError, match="each with both"):
        ds.fit_friction_law(SPEEDS, SPEEDS[1:])
    with pytest.raises(ds.UsageError, match="in SI units"):
        ds.fit_friction_law(SPEEDS, SPEEDS, units={"speed": "mm/s"})
    with pytest.raises(ds.UsageError, match="speed and mu"):
        ds.fit_friction_law(INPUTS / "fig3.nml", units={"time": "s"})
