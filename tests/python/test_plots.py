"""Figures: what they show and what they refuse."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np
import pytest
from dynstiction import plot
from dynstiction._native import Info
from dynstiction.plot.paper import deck
from dynstiction.record import LOG_DTYPE
from matplotlib import image
from matplotlib.figure import Figure
from programs import INPUTS, Program

MM_PER_INCH = 25.4


def result_of(**columns: np.ndarray) -> ds.Result:
    """A result made of columns alone."""
    infos = [(Info(name, "1", name), np.asarray(values, dtype=float)) for name, values in columns.items()]
    return ds.Result(
        columns=ds.Described(infos),
        log=np.empty(0, dtype=LOG_DTYPE),
        summary=ds.Described([]),
        statistics=ds.Described([]),
        attributes={"complete": 1},
    )


def sawtooth(n: int = 20001) -> ds.Result:
    """Stick-slip with known peaks: force 2 N falls to 1 N at t = 2, 3, 4, …; a fast ripple on the rest."""
    time = np.linspace(0.0, 10.0, n)
    force = np.where(time < 2.0, time, 1.0 + np.mod(time, 1.0))
    ripple = 0.05 * np.sin(2 * np.pi * 1000.0 * time)
    return result_of(
        time=time,
        spring_force_x=force,
        spring_force_y=np.sqrt(np.maximum(4.0 - force**2, 0.0)) + ripple,
        friction=np.full(n, 2.0),
        theta=np.arccos(np.clip(force / 2.0, 0.0, 1.0)),
        psi=np.arccos(np.clip(force / 2.0, 0.0, 1.0)) - np.radians(1.0),
        X=np.where(time < 2.0, 1e-5 * time**2, 1e-3 * (np.floor(time) - 1.0)),
    )


def test_history_and_path_have_the_samples() -> None:
    result = sawtooth()
    panels = plot.draw(result, "history").axes[:5]
    labels = [axis.get_ylabel() for axis in panels]
    assert [label[label.index("[") :] for label in labels] == ["[N]", "[N]", "[N]", "[deg]", "[mm]"]
    assert {axis.get_xlim() for axis in panels} == {(0.0, 10.0)}
    drawn = [axis.lines[0].get_ydata() for axis in panels]
    for values, name in zip(drawn, ["spring_force_x", "spring_force_y", "friction"], strict=False):
        assert (values.min(), values.max()) == (result[name].min(), result[name].max())
    # Without the sample at t = 0, after which friction jumps.
    assert drawn[3].max() == np.degrees(result["psi"][1:].max())
    assert drawn[4].max() == 1e3 * result["X"].max()
    # The inset has the creep before the first slip.
    (inset,) = panels[4].child_axes
    before = result.time < 2.0
    assert inset.lines[0].get_xdata()[-1] == result.time[before][-1]
    assert inset.lines[0].get_ydata().max() == 1e6 * result["X"][before].max()
    path = plot.draw(result, "path").axes[0]
    np.testing.assert_allclose(np.hypot(*np.concatenate(path.collections[0].get_segments()).T), 2.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_first_release_of_a_sawtooth_and_of_a_plateau(sign: float) -> None:
    result = sawtooth()
    release = plot.first_release(sign * result["spring_force_x"])
    assert result.time[release] == pytest.approx(2.0, abs=1e-3)
    plateau = np.minimum(result.time / 2.0, 1.0)
    assert result.time[plot.first_release(sign * plateau)] == pytest.approx(1.98, abs=1e-3)


UNITLESS = (r"$\zeta$", r"$\Lambda$", r"$\dot X/V$", r"$\tau", "rest", "P(u)", "u = k_x u_x/F_0", "$u$")
"""Of labels of numbers without unit."""


def assert_readable_in_one_column(figure: Figure, units: bool = True) -> None:
    assert figure.get_size_inches()[0] * MM_PER_INCH == pytest.approx(86.0)
    figure.draw_without_rendering()
    insets = [inset for axis in figure.axes for inset in axis.child_axes]
    for axis in [*figure.axes, *insets]:
        texts = [axis.xaxis.label, axis.yaxis.label, *axis.get_xticklabels(), *axis.get_yticklabels()]
        legend = axis.get_legend()
        texts += [*axis.texts, *(legend.get_texts() if legend else [])]
        assert min(text.get_fontsize() for text in texts) >= 7.0
        for label in (axis.xaxis.label, axis.yaxis.label):
            text = label.get_text()
            assert not units or not text or "[" in text or any(each in text for each in UNITLESS), f"{text} has no unit"
            inside = label.get_window_extent()
            assert not label.get_text() or (inside.x0 >= 0 and inside.x1 <= figure.bbox.x1 and inside.y0 >= 0)


@pytest.mark.parametrize("kind", plot.KINDS)
def test_every_kind_is_readable_in_one_column(fig4_result: ds.Result, kind: str) -> None:
    assert_readable_in_one_column(plot.draw(fig4_result, kind))


def test_thinning_keeps_every_extreme() -> None:
    time = np.sort(np.random.default_rng(7).uniform(0.0, 3.0, 50_000))
    values = np.sin(2 * np.pi * 1000.0 * time) * np.exp(-time)
    bins = 500
    thin_time, thin_values = plot.thin(time, values, bins)
    assert thin_time.size <= 2 * bins + 2
    assert np.all(np.diff(thin_time) > 0)
    edges = np.linspace(time[0], time[-1], bins + 1)[1:-1]
    for kept, every in zip(
        np.split(thin_values, np.searchsorted(thin_time, edges)), np.split(values, np.searchsorted(time, edges)), strict=True
    ):
        assert (kept.min(), kept.max()) == (every.min(), every.max())
    # Gaps and short series stay as they are.
    time = np.arange(10.0)
    values = np.where(time == 4.0, np.nan, time)
    np.testing.assert_array_equal(plot.thin(time, values, 100)[1], values)
    time = np.arange(10_000.0)
    kept_time, kept = plot.thin(time, np.where(time < 5000.0, np.nan, time), 10)
    assert kept_time[np.isfinite(kept)].min() == 5000.0
    assert np.nanmax(kept) == 9999.0


NEEDED = {
    "history": "spring_force_x", "velocities": "w_x", "spectrogram": "w_x", "damping": "spring_force_x", "creep": "spring_force_x",
    "path": "friction",
}  # fmt: skip


@pytest.mark.parametrize("kind", NEEDED)
def test_missing_column_names_the_remedy(fig4_result: ds.Result, kind: str) -> None:
    kept = [(info, values) for info, values in fig4_result.columns.info() if info.name in ("time", "Y")]
    lacking = replace(fig4_result, columns=ds.Described(kept, "columns"))
    name = NEEDED[kind]
    with pytest.raises(
        ds.ColumnError, match=rf"no column '{name}'.*name it in the deck's output\.fields and run again; there are time, Y"
    ):
        plot.draw(lacking, kind)


# The default kind of a file, and several files


def test_the_kind_follows_from_the_file(fig3: ds.Scene, fig4_result: ds.Result) -> None:
    def panels(result: ds.Result, kind: str | None = None) -> list[str]:
        return [axis.get_ylabel() for axis in plot.draw(result, kind).axes]

    assert panels(fig4_result) == panels(fig4_result, "history")
    creep = ds.run(deck("creep"))
    assert panels(creep) == panels(creep, "creep")
    asymptotic = ds.run(deck("creep_asymptotic"))
    assert panels(asymptotic) == ["$X$ [µm]", r"$\dot X$ [µm/s]"]
    fast = ds.run(deck("high_frequency"))
    assert panels(fast) == panels(fast, "velocities")
    few = ds.run(fig3, scene={"t_end": 0.05}, output={"fields": ["theta", "sticking"]})
    assert panels(few) == [r"$\theta$ [deg]", "rest"]
    with pytest.raises(ds.UsageError, match="times only"):
        plot.draw(result_of(time=np.arange(5.0)))
    with pytest.raises(ds.UsageError, match="fewer than two samples"):
        plot.draw(result_of(time=np.empty(0)))
    with pytest.raises(ds.UsageError, match="history, velocities, spectrogram, damping, creep, path, columns"):
        plot.draw(sawtooth(), "hystory")


def test_a_comparison_shares_scales_and_says_what_differs(fig3: ds.Scene) -> None:
    runs = {f"phi{a}": ds.run(fig3, scene={"t_end": 3.0}, system={"misalignment_deg": a}) for a in (1, 5, 10)}
    figure = plot.draw(runs)
    figure.draw_without_rendering()
    axes = np.array(figure.axes).reshape(6, 3)
    for row in axes:
        assert len({axis.get_ylim() for axis in row}) == 1
        assert "[" in row[0].get_ylabel()
    for column, (name, run) in zip(axes.T, runs.items(), strict=True):
        assert column[0].get_title() == f"{name}\n$\\varphi$ = {run.parameters['misalignment_deg']:g}°"
        (line,) = column[0].lines
        assert line.get_ydata().max() == run["spring_force_x"].max()
        assert column[-1].get_xlabel()
    fewer = runs | {"x": ds.run(fig3, scene={"t_end": 0.05}, output={"fields": ["X", "psi"]})}
    assert len(plot.draw(fewer).axes) == 2 * 4
    for wrong in ({"a": runs["phi1"]}, {str(i): runs["phi1"] for i in range(7)}):
        with pytest.raises(ds.UsageError, match="two to 6"):
            plot.draw(wrong)
    with pytest.raises(ds.UsageError, match="share none"):
        plot.draw(runs | {"y": ds.run(fig3, scene={"t_end": 0.05}, output={"fields": "Y"})})


def test_command_draws_a_file(package: Program, tmp_path: Path, fig4_result: ds.Result) -> None:
    (tmp_path / "b").mkdir()
    for name in ("run.h5", "b/run.h5"):
        fig4_result.save(tmp_path / name)
    done = package("plot", "run.h5", "--kind", "spectrogram")
    assert (done.returncode, done.stdout, done.stderr) == (0, "run.png\n", "")
    pixels = image.imread(tmp_path / "run.png")
    assert pixels.shape[1] == pytest.approx(86.0 / MM_PER_INCH * plot.DOTS_PER_INCH, abs=1)
    coloured = np.ptp(pixels[..., :3], axis=2) > 0.2
    assert 0.001 < coloured.mean() < 0.7
    with h5py.File(tmp_path / "run.h5", "r+") as file:
        file.attrs["complete"] = 0
    assert "before the run's end" in package("plot", "run.h5", "-o", "other.pdf", status=0).stderr
    assert (tmp_path / "other.pdf").read_bytes().startswith(b"%PDF")
    # Several files are compared.
    assert package("plot", "run.h5", "b/run.h5", status=0).stdout == "comparison.png\n"
    refused = package("plot", "run.h5", "b/run.h5", "--kind", "path", "--overwrite", status=1)
    assert "--kind and --quantity are for one file" in refused.stderr


PHI, VELOCITY = np.array([1.0, 3.0, 9.0]), np.geomspace(1e-3, 8e-3, 4)
LOW = INPUTS / "low_frequency.nml"


@pytest.fixture(scope="module")
def grid():
    """A small map, coarse enough to be quick."""
    return ds.sweep(LOW, {"system.misalignment_deg": PHI, "drive.velocity": VELOCITY}, scene={"t_end": 5.0}, threads=1)


def colours(figure) -> np.ndarray:
    """Values that a map shows in colours, as an array (up, right)."""
    (mesh,) = [c for c in figure.axes[0].collections if hasattr(c, "get_coordinates")]
    return np.ma.filled(mesh.get_array(), np.nan)


def test_map_shows_the_grid_and_the_line_of_stability(grid) -> None:
    figure = plot.draw(grid)
    axis = figure.axes[0]
    np.testing.assert_array_equal(colours(figure), grid["swing"].values / 2.0)
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("$V$ [mm/s]", r"$\varphi$ [deg]")
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "log")
    # Each value lies within its cell.
    (mesh,) = [c for c in axis.collections if hasattr(c, "get_coordinates")]
    right, up = mesh.get_coordinates()[0, :, 0], mesh.get_coordinates()[:, 0, 1]
    assert np.all((right[:-1] < 1e3 * VELOCITY) & (right[1:] > 1e3 * VELOCITY))
    assert np.all((up[:-1] < PHI) & (up[1:] > PHI))
    # A rigid stiff axis: tan^2(phi) = -V F'(V)/F(V).
    (line,) = axis.lines
    speed = 1e-3 * line.get_xdata()
    fall = 0.5 * np.exp(-speed / 0.01)
    expected = np.degrees(np.arctan(np.sqrt(speed / 0.01 * fall / (1.5 + fall))))
    np.testing.assert_allclose(line.get_ydata(), expected, rtol=1e-9)
    # The same from a list in any order, with a third parameter that follows from the two.
    phi, velocity = (a.ravel()[np.random.default_rng(3).permutation(12)] for a in np.meshgrid(PHI, VELOCITY, indexing="ij"))
    cases = {"system.misalignment_deg": phi, "drive.velocity": velocity, "scene.t_end": 5.0 + 0.0 * phi}
    np.testing.assert_array_equal(colours(plot.draw(ds.sweep(LOW, cases, points=True, threads=1))), grid["swing"].values / 2.0)


def test_map_of_the_full_model_has_both_modes_and_the_crossover(fig3: ds.Scene) -> None:
    both = {"system.misalignment_deg": [0.1, 1.0, 10.0], "system.stiffness_y": [1e3, 1e5, 1e7]}
    data = ds.sweep(fig3, both, t_end=0.1, threads=1)
    axis = plot.draw(data, quantity="sticking_time").axes[0]
    slow, fast, crossover = axis.lines
    stiffness = crossover.get_xdata()
    np.testing.assert_allclose(np.tan(np.radians(crossover.get_ydata())), 1e3 / stiffness)
    window = stiffness / 1e3 > (1.0 + np.sqrt(353.4)) ** 2
    for line in (slow, fast):
        assert np.array_equal(np.isfinite(line.get_ydata()), window)
    assert slow.get_ydata()[-1] == pytest.approx(8.65603, abs=1e-4)
    assert fast.get_ydata()[-1] == pytest.approx(76.263, abs=1e-3)
    assert axis.get_xlabel() == "$k_y$ [N/m]"


def test_map_of_one_parameter_and_of_a_list(grid) -> None:
    line = ds.sweep(LOW, {"drive.velocity": VELOCITY}, threads=1)
    axis = plot.draw(line, quantity="period").axes[0]
    np.testing.assert_array_equal(axis.lines[0].get_ydata(), line["period"].values)
    assert axis.get_xscale() == "log" and axis.get_ylabel().endswith("[s]")
    points = ds.sweep(LOW, {"drive.velocity": VELOCITY[:3], "system.misalignment_deg": PHI}, points=True, threads=1)
    axis = plot.draw(points, quantity="slip_angle").axes[0]
    offsets = axis.collections[0].get_offsets()
    np.testing.assert_allclose(offsets, np.column_stack([1e3 * VELOCITY[:3], np.degrees(points["slip_angle"].values)]))


KEEP = {"keep": "cycles", "cycles": 8}


@pytest.fixture(scope="module")
def cycles():
    """Stick-slip below 8.2 degrees, steady sliding beyond."""
    return ds.sweep(LOW, {"system.misalignment_deg": np.linspace(1.0, 12.0, 23)}, scene={"t_end": 20.0}, sweep=KEEP, threads=1)


def dots(figure) -> np.ndarray:
    return np.asarray(figure.axes[0].collections[0].get_offsets())


def lines_of(figure) -> list[np.ndarray]:
    return [np.column_stack([line.get_xdata(), line.get_ydata()]) for line in figure.axes[0].lines]


def words(figure) -> str:
    return "; ".join(text.get_text() for legend in figure.legends for text in legend.get_texts())


def test_a_bifurcation_diagram_has_every_cycle_and_steady_sliding(cycles) -> None:
    figure = plot.draw(cycles, "bifurcation")
    axis = figure.axes[0]
    phi, counts = cycles["misalignment_deg"].values, cycles["cycle_count"].values
    expected = cycles["cycle_peak_force"].values
    np.testing.assert_array_equal(dots(figure), np.column_stack([np.repeat(phi, counts), expected[np.isfinite(expected)]]))
    assert axis.collections[0].get_rasterized()
    assert (axis.get_xscale(), axis.get_xlabel()) == ("linear", r"$\varphi$ [deg]")
    assert axis.get_ylabel() == "peak of the load $k_x u_x$ [N]"
    measured, limit, stable, unstable = lines_of(figure)
    # What ended in steady sliding is where k_x u_x = F(V) cos(phi).
    np.testing.assert_array_equal(measured[:, 0], phi[counts == 0])
    load = (1.5 + 0.5 * np.exp(-0.1)) * np.cos(np.radians(phi[counts == 0]))
    np.testing.assert_allclose(measured[:, 1], load, rtol=2e-3)
    np.testing.assert_allclose(limit[:, 0], 8.6560, atol=1e-3)
    assert "steady sliding stable above 8.66 deg" in words(figure)
    for line, is_stable in ((stable, True), (unstable, False)):
        there = np.isfinite(line[:, 1])
        np.testing.assert_array_equal(there, (line[:, 0] > limit[0, 0]) == is_stable)
        np.testing.assert_allclose(line[there, 1], (1.5 + 0.5 * np.exp(-0.1)) * np.cos(np.radians(line[there, 0])))
    assert_readable_in_one_column(figure, units=False)


def test_a_bifurcation_diagram_of_two_parameters_has_colours(cycles) -> None:
    data = ds.sweep(LOW, {"system.misalignment_deg": PHI, "drive.velocity": VELOCITY}, scene={"t_end": 5.0}, sweep=KEEP, threads=1)
    figure = plot.draw(data, "bifurcation")
    there = np.isfinite(data["cycle_peak_force"].values)
    shape = there.shape
    phi = np.broadcast_to(PHI[:, np.newaxis, np.newaxis], shape)[there]
    np.testing.assert_array_equal(dots(figure)[:, 0], phi)
    colours = np.broadcast_to(1e3 * VELOCITY[:, np.newaxis], shape)[there]
    np.testing.assert_allclose(figure.axes[0].collections[0].get_array(), colours)
    assert figure.axes[1].get_ylabel() == "$V$ [mm/s]"
    # On one axis only lines of one parameter mean something.
    assert "stable" not in words(figure)


def test_what_a_sweep_cannot_show_is_refused(grid, cycles, fig4_result: ds.Result) -> None:
    no_cycle, no_deck = grid.where(grid["period"] > 1e9), cycles.assign_attrs(deck="")
    many = ds.sweep(LOW, {"system.misalignment_deg": [1.0], "drive.velocity": [1e-3], "system.mass": [0.25]}, sweep=KEEP, threads=1)
    for data, kind, quantity, words in (
        (grid, "history", None, "the kinds are map, bifurcation"),
        (grid, None, "perod", r"no quantity 'perod': the nearest is 'period', there are .*swing"),
        (fig4_result, None, "period", "quantity can be chosen for the kinds branches, map, bifurcation, not for 'history'"),
        (grid, "bifurcation", None, r"keeps no cycles: run it with sweep\.keep = 'cycles'"),
        (cycles, "bifurcation", "swing", r"no quantity 'swing' of a cycle, only .*peak_force"),
        (many, "bifurcation", None, "one or two parameters, not 3"),
        (no_cycle, None, "period", "no case has a value of 'period'"),
        (no_deck, "bifurcation", None, "lacks a number 'mu_0'"),
    ):
        with pytest.raises(ds.UsageError, match=words):
            plot.draw(data, kind, quantity)
