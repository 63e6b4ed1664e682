"""The full model against reference values of known provenance (tests/reference/fig3.json)."""

from __future__ import annotations

import json
from decimal import Decimal
from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from fig3 import changed
from programs import INPUTS, ROOT, Program
from results import assert_same

REFERENCE = json.loads((ROOT / "tests/reference/fig3.json").read_text())
SCENES = REFERENCE["scenes"]
STATES = [(name, state) for name, scene in SCENES.items() for state in scene["states"]]
STICKS = [(name, *row) for name, scene in SCENES.items() for row in scene["sticks"]]

# At 1e-6 the lowest order is too coarse to see every stick; every other pair must find all of them.
METHODS = [
    (method, rtol)
    for method in ("radau5", "radau9", "radau13")
    for rtol in (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
    if (method, rtol) != ("radau5", 1e-6)
]


def scene_of(change: dict[str, dict[str, object]], **more: dict[str, object]) -> ds.Scene:
    """The reference deck with changes."""
    return ds.Scene(**changed(REFERENCE["deck"], change, more))


def reference_scene(name: str, method: str = "radau9", rtol: float = 1e-10) -> ds.Scene:
    return scene_of(SCENES[name]["change"], integrator={"method": method, "rtol": rtol}, output={"interval": 0.01})


@pytest.fixture(scope="module")
def results_in_memory() -> dict[str, ds.Result]:
    return {name: ds.run(reference_scene(name)) for name in SCENES}


@pytest.fixture(scope="module")
def results_by_the_sharpest() -> dict[str, ds.Result]:
    return {name: ds.run(reference_scene(name, "radau13", 1e-11)) for name in SCENES}


@pytest.fixture(scope="module")
def results_in_files(executable: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, ds.Result]:
    program = Program((executable,), tmp_path_factory.mktemp("references"))
    results = {}
    for i, name in enumerate(SCENES):
        (program.folder / f"{i}.nml").write_text(reference_scene(name).text)
        program("run", f"{i}.nml", "-o", f"{i}.h5", "--quiet", status=0)
        results[name] = ds.open(program.folder / f"{i}.h5")
    return results


@pytest.fixture(params=["in_memory", "by_the_sharpest", pytest.param("in_files", marks=pytest.mark.deck)])
def results(request: pytest.FixtureRequest) -> dict[str, ds.Result]:
    return request.getfixturevalue(f"results_{request.param}")


@pytest.mark.parametrize(("name", "state"), STATES)
def test_state_agrees_with_quadruple_precision(
    request: pytest.FixtureRequest, results: dict[str, ds.Result], name: str, state: list[float]
) -> None:
    """The sample at a reference's time: u_x to 1e-10, u_y to its bound, w to 1e-7 of |w| (1e-6 at 10 s)."""
    t, u_x, u_y, *w = state
    # At 10 s roundoff has grown: 3.4e-11 of u_y was measured with radau9, and other machines round otherwise.
    u_y_bound = 3e-10 if t == 10.0 and "sharpest" not in request.node.name else 1e-10
    result = results[name]
    row = int(np.argmin(np.abs(result.time - t)))
    assert result.time[row] == pytest.approx(t, abs=1e-12)
    assert result["u_x"][row] == pytest.approx(u_x, rel=1e-10, abs=0.0)
    assert result["u_y"][row] == pytest.approx(u_y, rel=u_y_bound, abs=0.0)
    error = np.hypot(result["w_x"][row] - w[0], result["w_y"][row] - w[1])
    assert error <= (1e-6 if t == 10.0 else 1e-7) * np.hypot(*w)


@pytest.mark.parametrize(("name", "t", "count"), STICKS)
def test_number_of_sticks_is_exact(results: dict[str, ds.Result], name: str, t: float, count: int) -> None:
    assert results[name].sticks(until=t) == count


@pytest.mark.parametrize(
    ("method", "rtol"), [pytest.param(*each, marks=pytest.mark.full if each == ("radau5", 1e-11) else ()) for each in METHODS]
)
def test_number_of_sticks_depends_neither_on_order_nor_on_tolerance(method: str, rtol: float) -> None:
    result = ds.run(reference_scene("fig3", method, rtol))
    assert [[t, result.sticks(until=t)] for t, _ in SCENES["fig3"]["sticks"]] == SCENES["fig3"]["sticks"]


def test_equal_coefficients_are_constant_friction(results_in_memory: dict[str, ds.Result]) -> None:
    change = {"scene": {"t_end": 10.0}, "friction": {"mu_inf": 0.20}}
    equal = ds.run(scene_of(change, integrator={"method": "radau9", "rtol": 1e-10}, output={"interval": 0.01}))
    constant = results_in_memory["constant friction"]
    assert equal.sticks() == 1
    np.testing.assert_allclose(equal["u_x"], constant["u_x"], rtol=1e-9, atol=1e-15)


def test_writing_a_file_changes_no_number(results_in_memory: dict[str, ds.Result], results_in_files: dict[str, ds.Result]) -> None:
    for name, in_memory in results_in_memory.items():
        assert_same(results_in_files[name], in_memory)


def agrees(value: float, printed: str) -> bool:
    """Whether a value rounds to the printed digits, or misses them by one in the last place."""
    last_place = float(Decimal(1).scaleb(int(Decimal(printed).as_tuple().exponent)))
    return abs(value - float(printed)) <= last_place


def extrema(result: ds.Result) -> tuple[list[int], list[int]]:
    """Rows of the peaks and valleys of the stick-slip sawtooth."""
    force = result["spring_force_x"]
    threshold = 0.1 * np.ptp(force)
    peaks, valleys, row, rising = [], [], 0, True
    for i, value in enumerate(force):
        ahead = value - force[row] if rising else force[row] - value
        if ahead >= 0:
            row = i
        elif -ahead > threshold:
            (peaks if rising else valleys).append(row)
            row, rising = i, not rising
    return peaks, valleys


@pytest.mark.parametrize("row", REFERENCE["cycles"]["rows"])
def test_stick_slip_cycle(row: list[object]) -> None:
    misalignment, velocity, peak, valley, period = row
    interval = 1e-5 / min(velocity, 1.0)
    change = {"system": {"misalignment_deg": misalignment}, "drive": {"velocity": 1e-3 * velocity}}
    output = {"interval": interval, "fields": ["spring_force_x"]}
    result = ds.run(scene_of(change, scene={"t_end": 4.5 / velocity + 0.2}, output=output))
    peaks, valleys = extrema(result)
    force = result["spring_force_x"]
    assert agrees(force[peaks[0]], peak)
    assert agrees(force[valleys[0]], valley)
    last_period = result.time[peaks[-1]] - result.time[peaks[-2]]
    assert agrees(last_period, period)
    # The summary needs no samples. From the first peak on the cycles differ by less than 1e-4 of themselves.
    assert result.summary["period"] == pytest.approx(last_period, rel=1e-4, abs=2 * interval)
    assert result.summary["peak_force"] == pytest.approx(force[peaks].max(), rel=1e-3)
    assert result.summary["valley_force"] == pytest.approx(force[valleys].min(), rel=1e-3)


def test_extremes_of_fig3() -> None:
    fields = ["spring_force_x", "spring_force_y", "X_rate", "friction", "sticking"]
    result = ds.run(scene_of({"scene": {"t_end": 2.5}, "output": {"interval": 2e-5, "fields": fields}}))
    peaks, valleys = extrema(result)
    found = {
        "time of the first peak [s]": result.time[peaks[0]],
        "fall from the first peak to the first valley [s]": result.time[valleys[0]] - result.time[peaks[0]],
        "largest X' [mm/s]": 1e3 * result["X_rate"].max(),
        "smallest F while sliding [N]": result["friction"][result["sticking"] == 0].min(),
        # Samples 0.2 ms apart show the printed value; the oscillation of 1 kHz reaches higher between them.
        "largest k_y u_y [N]": result["spring_force_y"][::10].max(),
    }
    for name, printed in REFERENCE["fig3_extremes"].items():
        assert agrees(found[name], printed), (name, found[name], printed)
    # The same to 1e-6 with radau9 and radau13, at 1e-8 and 1e-11; Moreau-Jean gives 2.027 N.
    assert result["spring_force_y"].max() == pytest.approx(2.02737, abs=2e-5)


@pytest.mark.parametrize(("method", "rtol"), [("radau5", 1e-3), ("radau9", 1e-4), ("radau13", 1e-5), ("radau9", 1e-8)])
def test_steep_pull_touches_rest_as_often_whatever_the_method(method: str, rtol: float) -> None:
    """At 30 degrees the slip speed just reaches zero in each oscillation: dips that are shallow are decided at their lowest point."""
    result = ds.run(INPUTS / "fig3.nml", misalignment_deg=30.0, t_end=1.0, method=method, rtol=rtol, interval=1.0)
    assert result.summary["sticks"] == 724
