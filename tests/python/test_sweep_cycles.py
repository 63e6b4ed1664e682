"""Sweeps that keep the settled cycles of each case: those that the means are over, the same however the sweep is run."""

from __future__ import annotations

import dynstiction as ds
import h5py
import numpy as np
import pytest
from programs import INPUTS, Program
from sweeps import GRID, SCENE, Sweep, values

QUANTITIES = ("period", "peak_force", "valley_force", "stick_duration", "slip_duration", "slip_length")
MOST = 20
KEEP = f"  keep = 'cycles'\n  cycles = {MOST}\n/\n"
# 60 cases: stick-slip at small angles, steady sliding at large ones.
DECK = SCENE.replace("t_end = 10.0", "t_end = 12.0") + GRID.replace("last = 8.0", "last = 14.0").removesuffix("/\n") + KEEP


@pytest.fixture
def sweep(tmp_path) -> Sweep:
    return Sweep(tmp_path, DECK)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Sweep:
    made = Sweep(tmp_path_factory.mktemp("cycles"), DECK)
    made.run("a.h5", status=0)
    return made


@pytest.fixture(scope="module")
def found(whole) -> dict[str, np.ndarray]:
    return values(whole.folder / "a.h5")


def test_cycles_are_padded_counted_and_what_the_means_are_over(found):
    counts = found["cycles/count"]
    assert counts.min() == 0 and counts.max() == MOST and len(set(counts.tolist())) > 5
    for name in QUANTITIES:
        table = found[f"cycles/{name}"]
        assert table.shape == (60, MOST)
        np.testing.assert_array_equal(np.isfinite(table), np.arange(MOST) < counts[:, np.newaxis])
    np.testing.assert_allclose(found["cycles/period"], found["cycles/stick_duration"] + found["cycles/slip_duration"], rtol=1e-12)
    # Where there are more of them than are kept, the means are over more.
    whole = (counts > 1) & (counts < MOST)
    assert whole.sum() > 20
    for name in QUANTITIES:
        kept, scatter = found[f"cycles/{name}"][whole], found[f"summary/{name}_scatter"][whole]
        np.testing.assert_allclose(np.nanmean(kept, axis=1), found[f"summary/{name}"][whole], rtol=1e-13)
        np.testing.assert_allclose(np.nanstd(kept, axis=1, ddof=1), scatter, rtol=1e-6, atol=1e-12 * np.nanmax(np.abs(kept)))
    assert np.isnan(found["summary/period"][counts == 0]).all() and np.isfinite(found["summary/period"][counts > 0]).all()


@pytest.mark.parametrize("model", ["low_frequency", "full"])
def test_they_are_the_cycles_of_the_single_run(model):
    """By their samples, which are fine enough to tell peaks and valleys."""
    pytest.importorskip("xarray")
    deck = INPUTS / ("fig3.nml" if model == "full" else "low_frequency.nml")
    keep = {"keep": "cycles", "cycles": 4}
    stiffness = {"stiffness_y": 1e6} if model == "full" else {}
    data = ds.sweep(deck, {"system.misalignment_deg": [1.0, 3.0]}, scene={"t_end": 8.0}, sweep=keep, system=stiffness)
    for case, phi in enumerate((1.0, 3.0)):
        single = ds.run(deck, scene={"t_end": 8.0}, system={"misalignment_deg": phi, **stiffness}, output={"interval": 1e-4})
        table = ds.stick_slip_statistics(single)
        whole = np.flatnonzero(np.isfinite(table["period"]))
        count = int(data["cycle_count"][case])
        assert count == min(4, whole.size // 2) > 1
        for name in QUANTITIES:
            np.testing.assert_allclose(data[f"cycle_{name}"][case, :count], table[name][whole[-count:]], rtol=2e-3, err_msg=name)


@pytest.mark.parametrize("method", ["radau9", "rodas4p"])
def test_a_settled_case_keeps_its_last_cycle(method):
    """These are the cycles with which the motion continues; the cycles before only led to them."""
    pytest.importorskip("xarray")
    deck = ds.Scene(INPUTS / "low_frequency.nml", scene={"t_end": 60.0}, integrator={"method": method, "rtol": 1e-7})
    angles = {"system.misalignment_deg": np.linspace(1.0, 7.0, 7)}
    keep = {"keep": "cycles", "cycles": 10}
    settled, long = (ds.sweep(deck, angles, scene={"settle": settle}, sweep=keep) for settle in (1e-4, 0.0))
    assert (settled["cycle_count"] == 1).all() and (settled["settled_at"] < 20.0).all()
    assert (long["cycle_count"] == 10).all()
    for name in QUANTITIES:
        kept = settled[f"cycle_{name}"].values
        assert np.isnan(kept[:, 1:]).all()
        np.testing.assert_allclose(kept[:, 0], long[f"cycle_{name}"].values[:, -1], rtol=1e-3, err_msg=name)


def test_another_number_of_cycles_is_another_sweep(whole):
    for other in ("sweep.cycles=19", "sweep.keep=summary"):
        assert "the file exists" in whole.run("a.h5", "--set", other, status=3).stderr


def test_a_file_opens_as_what_the_sweep_returns(whole):
    xarray = pytest.importorskip("xarray")
    path = whole.folder / "a.h5"
    opened, made = ds.open(path), ds.sweep(whole.deck)
    xarray.testing.assert_identical(opened.drop_vars("wall_time"), made.drop_vars("wall_time"))
    assert made["cycle_peak_force"].dims == ("misalignment_deg", "velocity", "cycle")
    assert made["cycle_peak_force"].attrs["units"] == "N"
    assert made["cycle_count"].dtype == np.int32
    with h5py.File(path) as file:
        for name in QUANTITIES:
            table = file["sweep/cycles"][name]
            assert [table.dims[i][0].name for i in (0, 1)] == ["/sweep/case", "/sweep/cycles/cycle"]
            assert table.attrs["units"] and table.attrs["long_name"]
    pytest.importorskip("h5netcdf", reason="pip install h5netcdf")
    with xarray.open_dataset(path, group="sweep/cycles", engine="h5netcdf") as data:
        assert dict(data.sizes) == {"case": 60, "cycle": MOST}
        assert set(data.data_vars) == {"count", *QUANTITIES}


def test_it_is_exported(whole, tmp_path, package: Program, found):
    done = package("export", whole.folder / "a.h5", status=0)
    assert done.stdout.split() == ["a_sweep.csv", "a_cycles.csv"]
    head, *rows = (tmp_path / "a_cycles.csv").read_text().splitlines()
    assert head.split(",")[:4] == ["case", "misalignment_deg [deg]", "velocity [m/s]", "cycle"]
    assert len(rows) == found["cycles/count"].sum()
    table = np.loadtxt(tmp_path / "a_cycles.csv", delimiter=",", skiprows=1)
    peaks = table[:, head.split(",").index("peak_force [N]")]
    np.testing.assert_array_equal(peaks, found["cycles/peak_force"][np.isfinite(found["cycles/peak_force"])])
    np.testing.assert_array_equal(table[:, 0], np.repeat(found["case"], found["cycles/count"]))


def test_a_case_that_fails_keeps_what_it_has(sweep, tmp_path):
    sweep.run("f.h5", "--set", "integrator.max_steps=1000", status=5)
    some = values(tmp_path / "f.h5")
    failed = some["result_code"] != 0
    assert 0 < failed.sum() < 60
    assert np.isfinite(some["cycles/peak_force"]).sum() == some["cycles/count"].sum()
