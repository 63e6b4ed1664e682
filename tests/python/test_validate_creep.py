"""Validation of Eq. (8): what it measures, and that it notices a wrong form; the notebook's evidence."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import dynstiction as ds
import matplotlib as mpl
import numpy as np
import pytest
from dynstiction import validate
from dynstiction.__main__ import main
from programs import ROOT

FORMS = dict(validate.LIBRARY_FORMS)
FIRST_POWER_OFF = "error of the first power, full model at 1 s, 1 deg"


@pytest.fixture(scope="module")
def validation() -> validate.Validation:
    return validate.validate_creep()


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


def failures(validation: validate.Validation) -> set[str]:
    return {check.name for check in validation.checks() if not check.holds}


def with_first_power(validation: validate.Validation, form: validate.Form) -> validate.Validation:
    """The same run of the full model with another form."""
    return dataclasses.replace(validation, forms={**FORMS, "first_power": form})


def test_every_check_holds(validation: validate.Validation) -> None:
    assert failures(validation) == set()
    assert validation.holds
    assert "first power" in validation.finding()[0]


@pytest.mark.parametrize("tau", validate.TAUS)
@pytest.mark.parametrize("form", validate.ORDERS)
def test_orders_of_the_forms(validation: validate.Validation, form: str, tau: float) -> None:
    assert validation.order(form, tau) == pytest.approx(validate.ORDERS[form], abs=0.05)


def test_full_model_creeps_as_the_closed_form(validation: validate.Validation, evidence: SimpleNamespace) -> None:
    for mean in (*validation.means, *evidence.by_phi, *evidence.late):
        assert mean.cycles > 20
    for mean in (*validation.means, *evidence.by_phi, *evidence.late, *evidence.by_mass):
        assert mean.full == pytest.approx(mean.exact, rel=1e-4)
    # Inertia: half the mass, half the difference; the sign is that of a delay.
    heavy, *_, light = evidence.by_mass
    assert heavy.difference < light.difference < 0
    assert heavy.difference / light.difference == pytest.approx(heavy.mass / light.mass, rel=0.01)
    assert evidence.order_in_mass == pytest.approx(1.0, abs=0.05)
    assert evidence.order_in_phi == pytest.approx(2.0, abs=0.1)


def test_inertia_of_creep(evidence: SimpleNamespace) -> None:
    """Late, the difference is about -m w_x'/F_0 on sin(alpha): X'/V = s^2 + s c tan(alpha), w_x' = V s (tan(alpha))'."""
    for mean in evidence.late:
        s, c = np.sin(mean.phi), np.cos(mean.phi)
        alpha = float(ds.creep_exact(mean.tau, mean.phi, 1e-4).alpha)
        slow = mean.mass * mean.velocity**2 / (validate.F_0 * validate.L_X)
        expected = -(s**2) * c * slow * np.cos(alpha + mean.phi) / np.cos(alpha) ** 7
        assert mean.difference == pytest.approx(expected, rel=0.25)


def test_fits_separate_the_contributions(evidence: SimpleNamespace) -> None:
    a, p, m, b, q, n = evidence.fits["full"]
    assert (a, b) == pytest.approx((1.0, 1.0), abs=0.05)
    assert (p, q) == pytest.approx((2.0, 1.0), abs=0.01)
    assert (m, n) == pytest.approx((1.0, 2.0), abs=0.01)
    assert evidence.fits["first_power"] == pytest.approx((1.0, 2.0, 1.0, 1.0, 1.0, 2.0), abs=1e-6)
    assert evidence.fits["printed"][5] == pytest.approx(3.0, abs=1e-6)
    # Without phi^2 the first power keeps its order, but not its first contribution.
    lost = FORMS["first_power"](evidence.tau, evidence.phi) - 0.3 * evidence.phi**2
    assert evidence.separate(evidence.phi, evidence.tau, lost)[0] != pytest.approx(1.0, abs=0.05)


def test_separate_finds_any_powers(evidence: SimpleNamespace) -> None:
    phi, tau = (grid.ravel() for grid in np.meshgrid([0.01, 0.02, 0.05, 0.1], [0.02, 0.05, 0.1, 0.2, 0.3]))
    rate = 0.7 * phi**1.8 * tau**0.1 + 1.3 * phi**1.1 * tau**1.4 / np.sqrt(1.0 - tau**2)
    assert evidence.separate(phi, tau, rate) == pytest.approx((0.7, 1.8, 1.1, 1.3, 1.1, 2.4), rel=1e-6)


def test_the_printed_form_does_not_pass_as_first_power(validation: validate.Validation) -> None:
    wrong = with_first_power(validation, FORMS["printed"])
    failed = failures(wrong)
    assert not wrong.holds
    for tau in validate.TAUS:
        assert f"order in phi of the error of first_power at tau = {tau:g}" in failed
    assert FIRST_POWER_OFF in failed
    assert "no finding" in wrong.finding()[0]
    assert "first power of Vt/l_x" not in wrong.report()


def test_a_lost_term_is_noticed(validation: validate.Validation) -> None:
    """Without phi^2 the first power keeps its order, but not its distance from the full model."""
    lost = with_first_power(validation, lambda tau, phi: FORMS["first_power"](tau, phi) - 0.3 * np.square(phi))
    assert failures(lost) == {FIRST_POWER_OFF}


def test_a_wrong_full_model_is_noticed(validation: validate.Validation) -> None:
    """As if the full model crept by 2e-4 too fast."""
    fast = [mean._replace(full=mean.full * 1.0002) for mean in validation.means]
    failed = failures(dataclasses.replace(validation, means=fast))
    assert "X'/V of the full model at 1 s, 1 deg" in failed
    assert "full model and exact creep, relative difference" in failed


def test_a_check_of_nan_fails() -> None:
    assert not validate.Check("", float("nan"), 0.0, 1.0).holds


def test_averages_do_not_depend_on_the_window(monkeypatch: pytest.MonkeyPatch) -> None:
    (short,) = validate.mean_creep((0.5,))
    monkeypatch.setattr(validate, "HALF_WIDTH", 0.05)
    (long,) = validate.mean_creep((0.5,))
    assert long.cycles > 2 * short.cycles
    assert long.difference == pytest.approx(short.difference, rel=0.05)


def test_without_oscillation_there_are_no_cycles() -> None:
    with pytest.raises(ds.UsageError, match="died out"):
        validate.mean_creep((1.6,), degrees=2.0)


def test_command(
    validation: validate.Validation, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(validate, "validate_creep", lambda: validation)
    assert main(["validate-creep", "-o", str(tmp_path / "new")]) == 0
    printed = capsys.readouterr().out
    assert "Eq. (8) holds with the first power" in printed
    assert "misprint" in printed
    assert (tmp_path / "new" / "creep_validation.png").read_bytes()[:4] == b"\x89PNG"
    with (tmp_path / "new" / "creep_validation.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == validate.COLUMNS
    checks = [row for row in rows if row["table"] == "check"]
    assert len(checks) == len(validation.checks())
    assert {row["holds"] for row in checks} == {"1"}
    one = [row for row in rows if (row["table"], row["quantity"]) == ("by_time", "full")]
    assert [float(row["value"]) for row in one] == [mean.full for mean in validation.means]

    wrong = with_first_power(validation, FORMS["printed"])
    monkeypatch.setattr(validate, "validate_creep", lambda: wrong)
    assert main(["validate-creep", "-o", str(tmp_path)]) == 1
    assert "order in phi of the error of first_power at tau = 0.5: 0.9997" in capsys.readouterr().out


def test_command_cannot_write(
    validation: validate.Validation, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(validate, "validate_creep", lambda: validation)
    (tmp_path / "file").touch()
    assert main(["validate-creep", "-o", str(tmp_path / "file")]) == 3
    assert "cannot be written" in capsys.readouterr().err
