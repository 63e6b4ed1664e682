"""One apparent stick as a displacement gives misalignment and creep length, by the exact form and with errors that hold."""

from __future__ import annotations

import warnings
from typing import Any

import dynstiction as ds
import numpy as np
import pytest
from dynstiction.creep_fit import creep_path
from numpy.typing import NDArray
from programs import INPUTS

SPEED = 2e-3
TIMES = np.arange(0.0, 1.85, 1e-3)


def law(speed: Any) -> Any:
    """The friction of Fig. 3, relative to that at rest."""
    return 0.75 + 0.25 * np.exp(-speed / 0.01)


@pytest.fixture(scope="module")
def stick() -> NDArray[np.float64]:
    """X [m] of the first stick of Fig. 3."""
    return np.asarray(ds.run(INPUTS / "fig3.nml", times=TIMES, output={"fields": ["X"]})["X"])


def noisy(x: NDArray[np.float64], noise: float, rng: int = 1) -> NDArray[np.float64]:
    return x + noise * np.random.default_rng(rng).standard_normal(x.size)


@pytest.mark.parametrize("kappa", [0.0, 1e-4, 1e-2, 0.3])
@pytest.mark.parametrize("degrees", [0.01, 0.3, 1.0, 4.0, 15.0, 40.0])
def test_the_path_is_that_of_the_closed_form(degrees: float, kappa: float) -> None:
    tau, phi = np.linspace(0.0, 1.5, 200), float(np.radians(degrees))
    exact = ds.creep_exact(tau, phi, kappa).X
    length = 3e-3
    found = creep_path(length / SPEED * tau, phi, length, SPEED, kappa) / length
    assert np.abs(found - exact).max() <= 1e-6 * max(exact.max(), phi)


def test_a_law_is_that_of_the_slow_model() -> None:
    """F(v) in the quadrature, against the model that integrates the same equation."""
    rig = {"scene": {"model": "low_frequency", "t_end": 1.8}, "initial": {"velocity_ratio": 0.0}}
    run = ds.run(INPUTS / "fig3.nml", times=np.linspace(0.0, 1.8, 200), **rig)
    # Its stiff axis is rigid.
    x = creep_path(run.time, np.radians(1.0), 2e-3, 1e-3, 0.0, law)
    constant = creep_path(run.time, np.radians(1.0), 2e-3, 1e-3)
    error = np.abs(x - run["X"]).max()
    assert error < 0.02 * np.abs(constant - run["X"]).max()
    assert error < 1e-3 * run["X"].max()


@pytest.mark.parametrize("noise", [1e-8, 1e-7, 1e-6])
def test_the_first_stick_of_fig_3(stick: NDArray[np.float64], noise: float) -> None:
    found = ds.fit_creep(TIMES, noisy(stick, noise), velocity=1e-3, stiffness_ratio=1e-4, law=law)
    # The fast oscillation, which is not in slow creep, is 0.06 %.
    assert abs(found.misalignment_deg - 1.0) < 6e-4 + 4.0 * found.misalignment_error
    assert abs(found.length - 2e-3) < 1.2e-6 + 4.0 * found.length_error
    assert found.misalignment_error < 2e-2 * noise / 1e-6 and found.residual == pytest.approx(noise, rel=0.1)
    assert 0.9 < found.misfit < 1.1


def test_the_price_of_the_misprint(stick: NDArray[np.float64]) -> None:
    right = ds.fit_creep(TIMES, noisy(stick, 1e-6), velocity=1e-3, form="first_power")
    printed = ds.fit_creep(TIMES, noisy(stick, 1e-6), velocity=1e-3, form="printed")
    assert abs(right.misalignment_deg - 1.0) < 0.02 + 4.0 * right.misalignment_error
    assert 2.9 < printed.misalignment_deg < 3.3 and printed.misfit < 1.1
    with pytest.warns(ds.FitWarning, match="creep does not explain the displacement"):
        assert ds.fit_creep(TIMES, noisy(stick, 1e-8), velocity=1e-3, form="printed").misfit > 5.0


def test_errors_hold() -> None:
    """95 % intervals of 60 traces of slow creep, for random rigs, with the time of the relaxed spring known or free."""
    rng = np.random.default_rng(7)
    inside = []
    for k in range(60):
        degrees, length, free = rng.uniform(0.3, 8.0), 10.0 ** rng.uniform(-3.5, -2.0), k % 2 == 1
        begins = rng.uniform(0.05, 0.3) if free else 0.0
        time = length / SPEED * np.linspace(begins, rng.uniform(0.8, 1.0), 600)
        x = noisy(creep_path(time, np.radians(degrees), length, SPEED), 1e-5 * length, k)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ds.FitWarning)
            found = ds.fit_creep(time, x, velocity=SPEED, relaxed_at=None if free else 0.0)
        inside += [
            abs(found.misalignment_deg - degrees) < 1.96 * found.misalignment_error,
            abs(found.length - length) < 1.96 * found.length_error,
        ]
    assert 0.88 <= np.mean(inside) <= 0.99


@pytest.mark.parametrize("rng", range(8))
def test_an_object_at_rest_has_no_angle(rng: int) -> None:
    """As under k_y/k_x = 70 at 0.4 deg, where it really sticks."""
    time = np.linspace(0.0, 0.9, 555)
    with pytest.warns(ds.FitWarning, match="no creep is seen above the noise"):
        found = ds.fit_creep(time, noisy(np.zeros(555), 1e-7, rng), velocity=1e-3, stiffness_ratio=1.0 / 70.0, law=law)
    assert np.isnan([found.misalignment_deg, found.length]).all() and np.isinf([found.misalignment_error, found.length_error]).all()
    assert found.residual == pytest.approx(1e-7, rel=0.15)


@pytest.mark.parametrize(("unit", "later", "shift"), [(1e-3, 0.0, 0.0), (1e3, -5.0, 0.7), (1.0, 3.0, -1.0), (25.4, 0.1, 1.0)])
def test_units_and_origins_do_not_matter(unit: float, later: float, shift: float) -> None:
    time = np.linspace(0.0, 0.9, 200)
    x = noisy(creep_path(time, np.radians(2.0), 1e-3, 1e-3), 1e-9)
    first = ds.fit_creep(time, x, velocity=1e-3)
    second = ds.fit_creep(time + later, unit * (x + shift * 1e-4), velocity=unit * 1e-3, relaxed_at=later)
    assert second.misalignment_deg == pytest.approx(first.misalignment_deg, rel=1e-5)
    assert second.length == pytest.approx(unit * first.length, rel=1e-5)
    assert second.misalignment_error == pytest.approx(first.misalignment_error, rel=1e-2)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"velocity": 0.0}, "velocity"),
        ({"stiffness_ratio": 1.0}, "stiffness_ratio"),
        ({"form": "second"}, "form"),
        ({"relaxed_at": 0.5}, "give a time before it"),
        ({"time": np.zeros(50)}, "ascend"),
        ({"time": np.arange(49.0)}, "samples of both"),
        ({"X": np.full(50, np.nan)}, "X"),
    ],
)
def test_wrong_use(arguments: dict[str, Any], told: str) -> None:
    good: dict[str, Any] = {"time": np.linspace(0.0, 0.9, 50), "X": np.linspace(0.0, 1e-6, 50), "velocity": 1e-3}
    with pytest.raises(ds.UsageError, match=told):
        ds.fit_creep(**(good | arguments))


@pytest.mark.filterwarnings("ignore::dynstiction.FitWarning")
def test_a_fit_of_the_force_uses_the_displacement() -> None:
    run = ds.run(
        INPUTS / "fig3.nml", scene={"t_end": 12.0}, output={"interval": 2e-3, "fields": ["spring_force_x", "spring_force_y", "X"]}
    )
    both = ds.Trace.of(run).part(start=3.0).with_noise(0.005, rng=1)
    assert both.displacement is not None
    name = "system.misalignment_deg"
    with_way, alone = (
        ds.fit(INPUTS / "fig3.nml", trace, [name]).parameters[name] for trace in (both, ds.Trace(both.time, both.force))
    )
    assert with_way.error < 0.7 * alone.error
    for found in (with_way, alone):
        assert abs(found.value - 1.0) < 4.0 * found.error
