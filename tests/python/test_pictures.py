"""Figures of scenes that are not the paper's: which part is shown, what is marked, and what the figure says of its samples."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from dynstiction import plot
from dynstiction.plot.paper import deck
from dynstiction.plot.theory import driven_length
from matplotlib.figure import Figure

OWN = ds.Scene(deck("fig3")).replace(
    mass=1.0, stiffness_x=5e3, stiffness_y=2e6, misalignment_deg=3.0,
    mu_0=0.30, mu_inf=0.25, v_f=0.010, normal_load=20.0, velocity=5e-3,
)  # fmt: skip
"""A heavier object on a softer spring, pulled faster: 80 cycles in 10 s; f_y = 225 Hz."""


def own(interval: float = 5e-4, t_end: float = 10.0, **others: object) -> ds.Result:
    return ds.run(OWN, t_end=t_end, interval=interval, **others)


@pytest.fixture(scope="module")
def result() -> ds.Result:
    return own()


@pytest.fixture(scope="module")
def coarse() -> ds.Result:
    return own(5e-3)


@pytest.fixture(scope="module")
def held() -> ds.Result:
    return ds.run(deck("slide_hold_slide"), output={"interval": 2e-4})


def notes_of(figure: Figure) -> str:
    return "; ".join(axis.get_title("right") for axis in figure.axes).replace("\n", "; ").strip("; ")


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


# Which part is shown


def test_a_run_of_many_cycles_is_shown_up_to_its_first_ones(result: ds.Result) -> None:
    peaks = ds.stick_slip_statistics(result)["peak_time"]
    assert peaks.size > 70
    for kind in ("history", "velocities", "spectrogram", "path", "columns"):
        figure = plot.draw(result, kind)
        if kind != "path":
            start, end = figure.axes[0].get_xlim()
            assert start == 0.0
            assert np.count_nonzero(peaks < end) == 9
        assert "first 1.29 s of 10 s" in notes_of(figure), kind


def test_few_cycles_a_settled_motion_and_a_profile_are_shown_as_a_whole(fig3_result: ds.Result, held: ds.Result) -> None:
    settling = own(t_end=2.0, misalignment_deg=25.0)
    slower = own(t_end=4.0, time=[0.0, 2.0, 2.1], velocity=[5e-3, 5e-3, 4e-3])
    assert np.isfinite(ds.stick_slip_statistics(slower)["period"]).sum() > 12
    for whole in (fig3_result, held, settling, slower):
        figure = plot.draw(whole, "history")
        assert figure.axes[0].get_xlim() == (0.0, whole.time[-1])
        assert "first" not in notes_of(figure)


def test_a_part_is_the_samples_between_its_ends(result: ds.Result) -> None:
    figure = plot.draw(result, "history", start=2.0, end=2.5)
    for axis in figure.axes:
        assert axis.get_xlim() == (2.0, 2.5)
    time, drawn = figure.axes[0].lines[0].get_data()
    inside = (result.time >= 2.0) & (result.time <= 2.5)
    np.testing.assert_array_equal(time, result.time[inside])
    np.testing.assert_array_equal(drawn, result["spring_force_x"][inside])
    assert plot.draw(result, "history", start=9.0).axes[0].get_xlim() == (9.0, 10.0)
    assert plot.draw(result, "history", end=1.0).axes[0].get_xlim() == (0.0, 1.0)
    assert plot.draw(result, end=10.0).axes[0].get_xlim() == (0.0, 10.0)
    assert not notes_of(figure)
    for start, end in ((2.0, 1.0), (1.0, 1.0), (-1.0, 1.0), (0.0, 11.0), (float("nan"), 1.0), (20.0, None)):
        with pytest.raises(ds.UsageError, match=r"the run has samples from 0 to 10 s.*begins before it ends"):
            plot.draw(result, start=start, end=end)
    with pytest.raises(ds.UsageError, match="fewer than two samples there"):
        plot.draw(result, start=1.0001, end=1.0002)
    for kind in ("creep", "damping"):
        with pytest.raises(ds.UsageError, match=f"history, velocities, .*not for '{kind}'"):
            plot.draw(result, kind, start=1.0)


# What is marked


def test_the_history_has_its_limits_and_its_slips(result: ds.Result) -> None:
    figure = plot.draw(result, "history")
    assert legend_of(figure) == ["$F_0$", "steady sliding", "driven end", "slip"]
    load, _, _, friction, _, place = figure.axes
    steady = 20.0 * (0.25 + 0.05 * np.exp(-0.5))
    for axis, along in ((load, np.cos(np.radians(3.0))), (friction, 1.0)):
        levels = [float(line.get_ydata()[0]) for line in axis.lines[1:]]
        np.testing.assert_allclose(levels, [6.0, steady * along], rtol=1e-12)
    driven = place.lines[1]
    np.testing.assert_allclose(driven.get_ydata(), 5.0 * driven.get_xdata(), rtol=1e-12)
    cycles = ds.stick_slip_statistics(result)
    slips = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in load.patches]
    np.testing.assert_allclose(slips, np.stack([cycles["peak_time"], cycles["valley_time"]], axis=1)[: len(slips)])
    assert len(slips) == 9
    assert slips[0][0] == pytest.approx(0.2612, abs=2e-3)
    back = plot.draw(own(t_end=1.0, velocity=-5e-3), "history").axes[0]
    levels = [float(line.get_ydata()[0]) for line in back.lines[1:]]
    assert levels == [-6.0, pytest.approx(-steady * np.cos(np.radians(3.0)))]
    # Without weakening there is one limit.
    constant = own(t_end=1.0, law="constant", mu_inf=None, v_f=None)
    assert "steady sliding" not in legend_of(plot.draw(constant, "history"))


def test_a_profile_is_drawn_above(held: ds.Result) -> None:
    figure = plot.draw(held, "history")
    drive = figure.axes[0]
    assert drive.get_ylabel() == "$V$ [mm/s]"
    time, speed = drive.lines[0].get_data()
    np.testing.assert_array_equal(time, [0.0, 3.0, 3.0, 5.0, 5.0, 7.0, 7.5, 8.5, 8.5, 10.0])
    np.testing.assert_array_equal(speed, [1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0])
    # The spring reaches from the object to the driven end: its elongation along the drive.
    phi = np.radians(1.0)
    along = held["u_x"] * np.cos(phi) + held["u_y"] * np.sin(phi)
    np.testing.assert_allclose(driven_length(held, held.time), held["X"] + along, rtol=0.0, atol=1e-9)


def test_the_start_velocity_draws_no_line(result: ds.Result) -> None:
    """At t = 0 the object has its start velocity, |F| = F_0 and psi = 0; a moment later it rests under no load."""
    assert (result["friction"][0], result["friction"][1] < 1.0) == (pytest.approx(6.0), True)
    _, _, _, friction, angle, _ = plot.draw(result, "history").axes
    for axis, name in ((friction, "friction"), (angle, "psi")):
        assert axis.lines[0].get_xdata()[0] == result.time[1]
        assert result[name][1] != result[name][0]
    segments = plot.draw(result, "path").axes[0].collections[0].get_segments()
    start = 6.0 * np.array([np.cos(np.radians(3.0)), np.sin(np.radians(3.0))])
    assert np.hypot(*(segments[0][0] - start)) > 1.0


# What the figure says of its samples


def test_coarse_samples_are_marked(result: ds.Result, coarse: ds.Result, held: ds.Result) -> None:
    said = "samples 0.005 s apart do not show the fast oscillation of 225 Hz"
    for kind in ("history", "velocities", "path", "columns", "creep"):
        assert said in notes_of(plot.draw(coarse, kind)).replace(";", ""), kind
        assert "do not show" not in notes_of(plot.draw(result, kind)), kind
    assert plot.coarseness(coarse) == said
    assert plot.coarseness(held) is None
    # Two samples a period are the limit of Nyquist, four draw a line.
    stiff = np.sqrt(2e6) / (2.0 * np.pi)
    assert plot.coarseness(own(0.24 / stiff, 1.0)) is None
    assert plot.coarseness(own(0.26 / stiff, 1.0)) is not None
    # A damper beyond the critical one leaves no oscillation, and the slow model has none.
    assert plot.coarseness(own(5e-3, 1.0, damping_y=2.1 * np.sqrt(2e6))) is None
    assert plot.coarseness(ds.run(deck("low_frequency"))) is None
    assert plot.coarseness(ds.run(deck("creep"), output={"interval": 0.01})) is None
    # Without misalignment nothing excites it, but an elongation across does.
    assert plot.coarseness(own(5e-3, 1.0, misalignment_deg=0.0)) is None
    pulled = ds.run(deck("fig3"), t_end=0.5, misalignment_deg=0.0, elongation_y=1e-7, interval=5e-3)
    assert plot.coarseness(pulled) is not None


def test_the_spectrogram_needs_samples_for_the_top_of_its_axis(result: ds.Result) -> None:
    figure = plot.draw(result, "spectrogram")
    top = 1e3 * figure.axes[1].get_ylim()[1]
    assert top == pytest.approx(2.5 * 225.08, rel=0.05)
    assert top <= 0.5 / 5e-4
    # The fundamental alone would be within the limit of Nyquist.
    between = own(0.3 / 225.08, 1.0)
    with pytest.raises(ds.UsageError, match=r"overtones up to 562\.7 Hz: run again with output\.interval = 0\.0002"):
        plot.draw(between, "spectrogram")
    assert "overtones above 1 kHz fold back" in notes_of(figure)
    assert "fold" not in notes_of(plot.draw(own(4e-4, 1.0), "spectrogram"))


# Columns, figures and axes of the user


def test_columns_figures_and_axes_of_the_user(result: ds.Result) -> None:
    figure = plot.draw(result, columns=["X_rate", "theta"], start=1.0, end=1.3)
    assert [axis.get_ylabel() for axis in figure.axes] == [r"$\dot X$ [mm/s]", r"$\theta$ [deg]"]
    assert [axis.get_ylabel() for axis in plot.draw(result, columns="Y").axes] == ["$Y$ [µm]"]
    mine = Figure(figsize=(7.0, 5.0))
    left, right = mine.subfigures(1, 2)
    for part, kind in ((left, "history"), (right, "velocities")):
        assert plot.draw(result, kind, figure=part) is mine
    mine.draw_without_rendering()
    assert tuple(mine.get_size_inches()) == (7.0, 5.0)
    assert (len(left.axes), len(right.axes)) == (6, 4)
    whole = Figure(figsize=(4.0, 4.0))
    for kind in ("spectrogram", "creep", "path", "damping", "columns"):
        whole.clear()
        assert plot.draw(result, kind, figure=whole) is whole
        whole.draw_without_rendering()
        assert tuple(whole.get_size_inches()) == (4.0, 4.0)
        assert whole.axes
    mine = Figure()
    first, second = mine.subplots(1, 2)
    assert plot.draw(result, columns=["friction", "X"], end=1.0, ax=[first, second]) is mine
    assert [axis.get_ylabel() for axis in mine.axes] == ["$|F|$ [N]", "$X$ [mm]"]
    for kind, label in (("path", "$F_x$ [N]"), ("damping", r"$\Lambda$")):
        assert plot.draw(result, kind, ax=Figure().subplots()).axes[0].get_xlabel() == label
    for error, wrong, how in (
        (ds.ColumnError, "no column 'tehta': did you mean 'theta'", {"columns": ["tehta"]}),
        (ds.UsageError, "not for 'path'", {"kind": "path", "columns": ["theta"]}),
        (ds.UsageError, "as many axes as panels", {"columns": ["X"], "ax": [first, second]}),
        (ds.UsageError, "not both", {"figure": mine, "ax": first}),
        (ds.UsageError, "matplotlib Axes", {"ax": "here"}),
        (ds.UsageError, "kinds history, damping, path, not for 'spectrogram'", {"kind": "spectrogram", "ax": first}),
    ):
        with pytest.raises(error, match=wrong):
            plot.draw(result, **how)  # type: ignore[arg-type]


# Several runs


def test_an_overlay_has_a_line_for_each_run(result: ds.Result) -> None:
    runs = {"3": result, "6": own(t_end=3.0, misalignment_deg=6.0)}
    figure = plot.draw(runs, "overlay")
    assert [axis.get_ylabel() for axis in figure.axes] == ["$k_x u_x$ [N]", r"$\psi$ [deg]", "$X$ [mm]"]
    assert legend_of(figure) == [r"3, $\varphi$ = 3°", r"6, $\varphi$ = 6°"]
    for axis in figure.axes:
        assert len(axis.lines) == 2
        assert len({(line.get_color(), str(line.get_linestyle())) for line in axis.lines}) == 2
    part = plot.draw(runs, "overlay", columns="friction", start=1.0, end=1.5)
    assert part.axes[0].get_xlim() == (1.0, 1.5)
    assert [axis.get_ylabel() for axis in plot.draw(runs, columns=["X"], end=2.0).axes] == ["$X$ [mm]", ""]
    with pytest.raises(ds.ColumnError, match="3: no column 'nonsense'"):
        plot.draw(runs, "overlay", columns="nonsense")
    # What differs is the physics.
    finer = own(1e-4, 1.0)
    assert "interval" not in "".join(axis.get_title() for axis in plot.draw({"a": result, "b": finer}).axes[:2])
    assert plot.draw({"a": finer, "b": replace(finer)}).axes[0].get_title() == "a"


def test_fonts_are_fonts(result: ds.Result, tmp_path: Path) -> None:
    """Type 3 fonts are refused by journals; words in an SVG are text."""
    plot.save(result, tmp_path / "run.pdf", "history")
    pdf = (tmp_path / "run.pdf").read_bytes()
    assert b"/Subtype /Type3" not in pdf and b"/FontFile2" in pdf
    plot.save(result, tmp_path / "run.svg", "history")
    assert ">slip</text>" in (tmp_path / "run.svg").read_text(encoding="utf-8")


# Sweeps


@pytest.fixture(scope="module")
def angles():
    """Stick-slip below 13.1 degrees, steady sliding beyond."""
    return ds.sweep(OWN, {"system.misalignment_deg": np.linspace(0.5, 20.0, 40)}, t_end=6.0, threads=1)


def test_no_period_where_no_cycle_persists(angles) -> None:
    figure = plot.draw(angles, quantity="period")
    axis = figure.axes[0]
    drawn = axis.lines[0].get_ydata()
    steady = angles["swing"].values <= 0.01 * 6.0
    assert 10 < np.count_nonzero(steady) < 20
    np.testing.assert_array_equal(np.isfinite(drawn), ~steady)
    (marks,) = [line for line in axis.lines if line.get_marker() == "|"]
    np.testing.assert_array_equal(marks.get_xdata(), angles["misalignment_deg"].values[steady])
    assert "no stick-slip" in legend_of(figure)
    # Ringing down towards steady sliding has had cycles, and none now.
    ringing = angles.assign(period=angles["period"].fillna(1.0))
    np.testing.assert_array_equal(np.isfinite(plot.draw(ringing, quantity="period").axes[0].lines[0].get_ydata()), ~steady)


def test_each_reason_for_an_absent_value_has_its_colour() -> None:
    grid = {"system.misalignment_deg": [1.0, 2.0], "drive.velocity": [1e-3, 2e-3, 3e-3]}
    data = ds.sweep(deck("low_frequency"), grid, t_end=6.0, threads=1)
    for name, given in {
        "period": [[1.0, np.nan, np.nan], [np.nan] * 3],
        "swing": [[1.0, 0.0, 1.0], [1.0, np.nan, np.nan]],
        "cycles": [[9.0, 9.0, 9.0], [0.0, np.nan, np.nan]],
        "result_code": [[0, 0, 0], [0, 44, -1]],
    }.items():
        data[name] = data[name].copy(data=np.array(given))
    figure = plot.draw(data, quantity="period")
    colours = {patch.get_label(): patch.get_facecolor() for patch in figure.legends[0].get_patches()}
    seen = {}
    for mesh in figure.axes[0].collections[1:]:
        (cell,) = np.argwhere(~np.ma.getmaskarray(mesh.get_array()))
        seen[next(text for text, colour in colours.items() if colour == mesh.cmap(0))] = tuple(cell)
    # The misalignment is upwards.
    places = {"no stick-slip": (0, 1), "rings down": (0, 2), "no cycle yet": (1, 0), "failed": (1, 1), "not run": (1, 2)}
    assert seen == places
    assert len(set(colours.values())) == 5
    values = np.ma.masked_invalid(figure.axes[0].collections[0].get_array())
    assert values.count() == 1
    line = plot.draw(data.isel(misalignment_deg=0), quantity="period")
    assert {"no stick-slip", "rings down"} <= set(legend_of(line))
