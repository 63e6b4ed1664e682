"""The program in quadruple precision reproduces the reference, and is one for the program in double precision."""

from __future__ import annotations

import json
import os
from decimal import Decimal, localcontext
from pathlib import Path

import h5py
import numpy as np
import pytest
from fig3 import DECK
from programs import ROOT, Program

pytestmark = pytest.mark.full

# As decimals: the reference has up to 20 digits, a float 16.
REFERENCE = json.loads((ROOT / "tests" / "reference" / "fig3.json").read_text(), parse_float=Decimal)
SCENES = REFERENCE["scenes"]
COLUMNS = ("u_x", "u_y", "w_x", "w_y")
# Fig. 3 beyond its third cycle costs minutes; docs/numerics.md has 10 s.
LATEST = {"fig3": Decimal("2.5")}
STATES = [(name, state) for name, scene in SCENES.items() for state in scene["states"] if state[0] <= LATEST.get(name, Decimal(10))]


@pytest.fixture(scope="module")
def quad_executable() -> Path:
    """The program that -Dprecision=quad builds: DYNSTICTION_QUAD_EXE, or in build/quad."""
    named = Path(os.environ.get("DYNSTICTION_QUAD_EXE", ROOT / "build/quad/src/dynstiction-quad"))
    if not named.is_file():
        pytest.skip(f"{named} has not been built: meson setup build/quad -Dprecision=quad")
    return named


def run(executable: Path, folder: Path, name: str, rtol: str, **more: str) -> Path:
    """Run a reference scene from rest and return the result file."""
    settings = {
        "initial.velocity_ratio": "0",
        "integrator.method": "radau13",
        "integrator.rtol": rtol,
        "output.interval": "0.01",
        "output.fields": ",".join(f"'{column}'" for column in COLUMNS),
    }
    for group, keys in SCENES[name]["change"].items():
        for key, value in keys.items():
            settings[f"{group}.{key}"] = "" if value is None else str(value)
    if name in LATEST:
        settings["scene.t_end"] = str(LATEST[name])
    settings.update({key.replace("__", "."): value for key, value in more.items()})
    file = folder / f"{executable.name}-{name}-{len(list(folder.iterdir()))}.h5"
    given = [f"{key}={value}" for key, value in settings.items()]
    Program((executable,), folder)("run", DECK, "-o", file, "--quiet", settings=given, timeout=None, status=0)
    return file


def state_at(file: Path, time: Decimal) -> list[Decimal]:
    """The sample at a time with all its digits: column and remainder."""
    with h5py.File(file) as content, localcontext(prec=40):
        row = int(np.argmin(np.abs(content["time_series/time"][:] - float(time))))
        return [
            sum(Decimal(float(content[f"{group}/{column}"][row])) for group in ("time_series", "remainder/time_series"))
            for column in COLUMNS
        ]


@pytest.fixture(scope="module")
def files(quad_executable: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("quad")
    return {name: run(quad_executable, folder, name, "1e-18") for name in SCENES}


@pytest.mark.parametrize(("name", "state"), STATES)
def test_reference_is_reproduced(files: dict[str, Path], name: str, state: list[Decimal]) -> None:
    for column, value, expected in zip(COLUMNS, state_at(files[name], state[0]), state[1:], strict=True):
        assert abs(value - expected) <= Decimal("1e-16") * abs(expected), column


@pytest.mark.parametrize("name", SCENES)
def test_number_of_sticks(files: dict[str, Path], name: str) -> None:
    with h5py.File(files[name]) as content:
        times = content["events/time"][:][content["events/kind"][:] == 1]
    for until, count in SCENES[name]["sticks"]:
        if until <= LATEST.get(name, 10):
            assert np.count_nonzero(times <= float(until)) == count


def test_digits_beyond_those_of_a_double(quad_executable: Path, tmp_path: Path) -> None:
    # Here the reference has 20 digits.
    file = run(quad_executable, tmp_path, "fig3", "1e-20", scene__t_end="0.05")
    state = next(state for state in SCENES["fig3"]["states"] if state[0] == Decimal("0.05"))
    for value, expected in zip(state_at(file, state[0]), state[1:], strict=True):
        assert abs(value - expected) <= Decimal("1e-19") * abs(expected)


def test_double_precision_has_the_digits_that_the_manual_says(executable: Path, files: dict[str, Path], tmp_path: Path) -> None:
    """docs/numerics.md, section 8: radau9 at rtol = 1e-10."""
    in_double = run(executable, tmp_path, "fig3", "1e-10", integrator__method="'radau9'")
    times = [float(state[0]) for name, state in STATES if name == "fig3"]
    with h5py.File(in_double) as a, h5py.File(files["fig3"]) as b:
        rows = [int(np.argmin(np.abs(b["time_series/time"][:] - time))) for time in times]
        x, y = ({column: file[f"time_series/{column}"][:][rows] for column in COLUMNS} for file in (a, b))
    np.testing.assert_allclose(x["u_x"], y["u_x"], rtol=2e-13)
    np.testing.assert_allclose(x["u_y"], y["u_y"], rtol=3e-11)
    np.testing.assert_allclose(x["w_x"], y["w_x"], rtol=1.2e-10)
    np.testing.assert_allclose(x["w_y"], y["w_y"], rtol=1.2e-10)
