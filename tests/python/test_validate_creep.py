"""Validation of Eq. (8): what it measures, and that it notices a wrong form."""

from __future__ import annotations

import csv
import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from dynstiction import validate
from dynstiction.__main__ import main

FORMS = dict(validate.LIBRARY_FORMS)


@pytest.fixture(scope="module")
def validation() -> validate.Validation:
    runs = []
    found = validate.validate_creep(advance=lambda: runs.append(1))
    assert len(runs) == validate.RUNS
    return found


def failures(validation: validate.Validation) -> set[str]:
    return {check.name for check in validation.checks() if not check.holds}


def with_forms(validation: validate.Validation, forms: dict[str, validate.Form]) -> validate.Validation:
    """The same runs of the full model with other forms."""
    return dataclasses.replace(
        validation,
        forms=forms,
        errors=tuple(validate.form_error(n, f, tau) for n, f in forms.items() for tau in validate.TAUS),
        fits=validate.fits_of(validation.fit_points, forms),
    )


def test_every_check_holds(validation: validate.Validation) -> None:
    assert failures(validation) == set()
    assert validation.holds
    assert "first power" in validation.finding()[0]


@pytest.mark.parametrize("form", validate.ORDERS)
def test_orders_of_the_forms(validation: validate.Validation, form: str) -> None:
    entries = [entry for entry in validation.errors if entry.form == form]
    assert [entry.tau for entry in entries] == [0.25, 0.5, 0.8]
    for entry in entries:
        assert entry.order == pytest.approx(validate.ORDERS[form], abs=0.05)


def test_full_model_creeps_as_the_closed_form(validation: validate.Validation) -> None:
    for mean in (*validation.by_time, *validation.by_phi, *validation.late):
        assert mean.cycles > 20
        assert mean.full == pytest.approx(mean.exact, rel=1e-4)
    # Inertia: half the mass, half the difference; the sign is that of a delay.
    heavy, *_, light = validation.by_mass
    assert heavy.difference < light.difference < 0
    assert heavy.difference / light.difference == pytest.approx(heavy.mass / light.mass, rel=0.01)


def test_inertia_of_creep(validation: validate.Validation) -> None:
    """Late, the difference is about -m w_x'/F_0 on sin(alpha): X'/V = s^2 + s c tan(alpha), w_x' = V s (tan(alpha))'."""
    for mean in validation.late:
        s, c = np.sin(mean.phi), np.cos(mean.phi)
        alpha = float(ds.creep_exact(mean.tau, mean.phi, 1e-4).alpha)
        slow = mean.mass * mean.velocity**2 / (validate.F_0 * validate.L_X)
        expected = -(s**2) * c * slow * np.cos(alpha + mean.phi) / np.cos(alpha) ** 7
        assert mean.difference == pytest.approx(expected, rel=0.25)


def test_fits_separate_the_contributions(validation: validate.Validation) -> None:
    fit = validation.fits["full"]
    assert fit.powers_of_phi == pytest.approx((2.0, 1.0), abs=0.01)
    assert fit.powers_of_velocity == pytest.approx((1.0, 2.0), abs=0.01)
    assert validation.fits["printed"].powers_of_velocity[1] == pytest.approx(3.0, abs=1e-6)


def test_separate_finds_any_powers() -> None:
    phi, tau = (grid.ravel() for grid in np.meshgrid([0.01, 0.02, 0.05, 0.1], [0.02, 0.05, 0.1, 0.2, 0.3]))
    rate = 0.7 * phi**1.8 * tau**0.1 + 1.3 * phi**1.1 * tau**1.4 / np.sqrt(1.0 - tau**2)
    fit = validate.separate(phi, tau, rate)
    assert fit.coefficients == pytest.approx((0.7, 1.3), rel=1e-6)
    assert fit.powers_of_phi == pytest.approx((1.8, 1.1), rel=1e-6)
    assert fit.powers_of_velocity == pytest.approx((1.1, 2.4), rel=1e-6)
    assert fit.residual < 1e-8


def test_the_printed_form_does_not_pass_as_first_power(validation: validate.Validation) -> None:
    wrong = with_forms(validation, {**FORMS, "first_power": FORMS["printed"]})
    failed = failures(wrong)
    assert not wrong.holds
    for tau in validate.TAUS:
        assert f"order in phi of the error of first_power at tau = {tau:g}" in failed
    assert "power of V, second contribution, first_power" in failed
    assert "first power off the full model at 1 s, 1 deg" in failed
    assert "no finding" in wrong.finding()[0]
    assert "first power of Vt/l_x" not in wrong.report()


def test_a_lost_term_is_noticed(validation: validate.Validation) -> None:
    """Without phi^2 the first power keeps its order, but not its first contribution."""
    lost = with_forms(validation, {**FORMS, "first_power": lambda tau, phi: FORMS["first_power"](tau, phi) - 0.3 * np.square(phi)})
    assert "coefficient, first contribution, first_power" in failures(lost)


def test_a_wrong_full_model_is_noticed(validation: validate.Validation) -> None:
    """As if the full model crept by 2e-4 too fast."""
    fast = [dataclasses.replace(mean, full=mean.full * 1.0002) for mean in validation.by_phi]
    failed = failures(dataclasses.replace(validation, by_phi=tuple(fast)))
    assert "X'/V of the full model at 1 s, 1 deg" in failed
    assert "full model against the exact creep, relative difference" in failed


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
    monkeypatch.setattr(validate, "validate_creep", lambda advance: validation)
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
    one = [row for row in rows if (row["table"], row["quantity"], row["phi_deg"]) == ("by_phi", "full", "1.0")]
    assert [float(row["value"]) for row in one] == [mean.full for mean in validation.by_phi if mean.degrees == 1.0]

    wrong = with_forms(validation, {**FORMS, "first_power": FORMS["printed"]})
    monkeypatch.setattr(validate, "validate_creep", lambda advance: wrong)
    assert main(["validate-creep", "-o", str(tmp_path)]) == 1
    assert "order in phi of the error of first_power at tau = 0.5: 0.9997" in capsys.readouterr().out


def test_command_counts_the_runs(
    validation: validate.Validation, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def validate_creep(advance: Callable[[], None]) -> validate.Validation:
        for _ in range(validate.RUNS):
            advance()
        return validation

    monkeypatch.setattr(validate, "validate_creep", validate_creep)
    monkeypatch.setitem(sys.modules, "tqdm", None)
    assert main(["validate-creep", "-o", str(tmp_path)]) == 0
    assert f"{validate.RUNS} of {validate.RUNS} runs" in capsys.readouterr().err


def test_command_cannot_write(
    validation: validate.Validation, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(validate, "validate_creep", lambda advance: validation)
    (tmp_path / "file").touch()
    assert main(["validate-creep", "-o", str(tmp_path / "file")]) == 3
    assert "cannot be written" in capsys.readouterr().err
