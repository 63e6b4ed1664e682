"""Validation of Eq. (8): what the script measures, that it notices a wrong form, and the notebook's evidence."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import dynstiction as ds
import matplotlib as mpl
import numpy as np
import pytest
from dynstiction import creep_validation
from dynstiction.creep_validation import F_0, L_X, TIMES, Mean, checks, draw, mean_creep, report
from numpy.typing import NDArray
from programs import ROOT, SCRIPT, Program

OFF = "relative error of first_power there"


@pytest.fixture(scope="module")
def means() -> list[Mean]:
    return mean_creep(TIMES)


@pytest.fixture(scope="module")
def evidence() -> SimpleNamespace:
    """What the cells of the notebook compute."""
    found: dict[str, object] = {}
    cells = json.loads((ROOT / "docs" / "notebooks" / "creep.ipynb").read_text(encoding="utf-8"))["cells"]
    with mpl.rc_context({"backend": "agg"}):
        for cell in cells:
            if cell["cell_type"] == "code":
                exec("".join(line for line in cell["source"] if not line.startswith("%")), found)
    return SimpleNamespace(**found)


def failures(means: list[Mean]) -> set[str]:
    return {name for name, (value, expected, tolerance) in checks(means).items() if not abs(value - expected) <= tolerance}


def test_every_check_holds(means: list[Mean]) -> None:
    assert len(checks(means)) == 13 and failures(means) == set()
    text, holds = report(means)
    assert holds and "misprint" in text


def test_the_script(tmp_path: Path) -> None:
    code = "import runpy, sys; sys.argv = ['x', 'x.png']; runpy.run_module('dynstiction.creep_validation', run_name='__main__')"
    done = Program(SCRIPT.first, tmp_path)(code)
    assert done.returncode == 0 and "Eq. (8) holds with the first power" in done.stdout
    assert (tmp_path / "x.png").stat().st_size > 10000


def test_the_figure(means: list[Mean]) -> None:
    errors, creep = draw(means).axes
    assert len(errors.get_lines()) == 6 and len(creep.get_lines()) == 5
    np.testing.assert_array_equal(creep.get_lines()[-1].get_ydata(), [1e3 * mean.full for mean in means])


def test_full_model_creeps_as_the_closed_form(means: list[Mean], evidence: SimpleNamespace) -> None:
    for mean in (*means, *evidence.by_phi, *evidence.late):
        assert mean.cycles > 20
    for mean in (*means, *evidence.by_phi, *evidence.late, *evidence.by_mass):
        assert mean.full == pytest.approx(mean.exact, rel=1e-4)
    # Inertia: half the mass, half the difference; the sign is that of a delay.
    heavy, *_, light = evidence.by_mass
    slow = [mean.full - mean.exact for mean in (heavy, light)]
    assert slow[0] < slow[1] < 0
    assert slow[0] / slow[1] == pytest.approx(heavy.mass / light.mass, rel=0.01)
    assert evidence.order_in_mass == pytest.approx(1.0, abs=0.05)
    assert evidence.order_in_phi == pytest.approx(2.0, abs=0.1)


def test_inertia_of_creep(evidence: SimpleNamespace) -> None:
    """Late, the difference is about -m w_x'/F_0 on sin(alpha): X'/V = s^2 + s c tan(alpha), w_x' = V s (tan(alpha))'."""
    for mean in evidence.late:
        s, c = np.sin(mean.phi), np.cos(mean.phi)
        alpha = float(ds.creep_exact(mean.tau, mean.phi, 1e-4).alpha)
        slow = mean.mass * 1e-3**2 / (F_0 * L_X)
        expected = -(s**2) * c * slow * np.cos(alpha + mean.phi) / np.cos(alpha) ** 7
        assert mean.full - mean.exact == pytest.approx(expected, rel=0.25)


def test_fits_separate_the_contributions(evidence: SimpleNamespace) -> None:
    a, p, m, b, q, n = evidence.fits["full"]
    assert (a, b) == pytest.approx((1.0, 1.0), abs=0.05)
    assert (p, q) == pytest.approx((2.0, 1.0), abs=0.01)
    assert (m, n) == pytest.approx((1.0, 2.0), abs=0.01)
    assert evidence.fits["first_power"] == pytest.approx((1.0, 2.0, 1.0, 1.0, 1.0, 2.0), abs=1e-6)
    assert evidence.fits["printed"][5] == pytest.approx(3.0, abs=1e-6)
    # Without phi^2 the first power keeps its order, but not its first contribution.
    lost = ds.creep_asymptotic(evidence.tau, evidence.phi, "first_power") - 0.3 * evidence.phi**2
    assert evidence.separate(evidence.phi, evidence.tau, lost)[0] != pytest.approx(1.0, abs=0.05)


def test_separate_finds_any_powers(evidence: SimpleNamespace) -> None:
    phi, tau = (grid.ravel() for grid in np.meshgrid([0.01, 0.02, 0.05, 0.1], [0.02, 0.05, 0.1, 0.2, 0.3]))
    rate = 0.7 * phi**1.8 * tau**0.1 + 1.3 * phi**1.1 * tau**1.4 / np.sqrt(1.0 - tau**2)
    assert evidence.separate(phi, tau, rate) == pytest.approx((0.7, 1.8, 1.1, 1.3, 1.1, 2.4), rel=1e-6)


def test_a_wrong_form_is_noticed(means: list[Mean], monkeypatch: pytest.MonkeyPatch) -> None:
    """The printed form in place of the first power; and the first power without phi^2, which keeps its order."""

    def printed(tau: float, phi: NDArray[np.float64], form: str) -> NDArray[np.float64]:
        return ds.creep_asymptotic(tau, phi, "printed" if form == "first_power" else form)

    def lost(tau: float, phi: NDArray[np.float64], form: str) -> NDArray[np.float64]:
        return ds.creep_asymptotic(tau, phi, form) - (0.3 * np.square(phi) if form == "first_power" else 0.0)

    monkeypatch.setattr(creep_validation, "creep_asymptotic", printed)
    assert failures(means) == {OFF, *(f"order in phi of the error of first_power, tau = {tau}" for tau in (0.25, 0.5, 0.8))}
    assert "no finding" in report(means)[0]
    monkeypatch.setattr(creep_validation, "creep_asymptotic", lost)
    assert failures(means) == {OFF}


def test_a_wrong_full_model_is_noticed(means: list[Mean]) -> None:
    """As if the full model crept by 2e-4 too fast."""
    fast = [mean._replace(full=1.0002 * mean.full, at_time=mean.at_time + 2e-4 * mean.full) for mean in means]
    wanted = {"X'/V of the full model at 1 s, 1 deg", "full model and exact creep, largest relative difference"}
    assert wanted <= failures(fast)
    assert failures([means[0]._replace(full=float("nan")), *means[1:]]) != set()


def test_averages_do_not_depend_on_the_window() -> None:
    ((short,), (long,)) = (mean_creep((0.5,), half_width) for half_width in (0.02, 0.05))
    assert long.cycles > 2 * short.cycles
    assert long.full - long.exact == pytest.approx(short.full - short.exact, rel=0.05)
