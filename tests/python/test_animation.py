"""Animations: what a frame shows, what is written, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import dynstiction as ds
import numpy as np
import pytest
from dynstiction.plot.animation import _frame_times, animate, view_from_above
from dynstiction.plot.style import STYLE
from matplotlib import image, rc_context


def friction_vector(figure: object) -> tuple[np.ndarray, np.ndarray]:
    """Where the friction vector begins [mm], and the vector."""
    (quiver,) = [c for c in figure.axes[0].collections if hasattr(c, "U")]  # type: ignore[attr-defined]
    return np.asarray(quiver.get_offsets())[0], np.array([quiver.U[0], quiver.V[0]])


def test_a_frame_shows_the_motion(fig4_result: ds.Result) -> None:
    """Friction turns from across to along; the spring reaches from the object to the driven end; dots follow the traces."""
    times = np.array([0.1, 1.0, 1.5, 1.99])
    figure, show = view_from_above(fig4_result, times)
    view = figure.axes[0]
    lengths = []
    for frame, time in enumerate(times):
        show(frame)
        place, vector = friction_vector(figure)
        lengths.append(np.hypot(*vector))
        # Friction acts against the slip, at theta - phi to X; theta is that of the closed form but for inertia.
        theta = np.degrees(np.arctan2(-vector[1], -vector[0])) + 1.0
        expected = np.degrees(ds.creep_exact(0.5 * time, np.radians(1.0), 1e-4).theta)
        assert theta == pytest.approx(expected, abs=1.0)
        row = np.searchsorted(fig4_result.time, time)
        assert place == pytest.approx(1e3 * np.array([fig4_result["X"][row], fig4_result["Y"][row]]), abs=1e-3)
        assert view.texts[0].get_text() == f"$t$ = {time:.3f} s"
    assert np.ptp(lengths) < 0.02 * np.mean(lengths)

    show(2)
    (end,) = [line for line in view.lines if line.get_label() == "driven end"]
    # The driven end is at V t on the line Y = 0.
    assert end.get_xdata()[0] == pytest.approx(1.5, rel=5e-3)
    assert end.get_ydata()[0] == pytest.approx(0.0, abs=1e-6)
    (spring,) = [line for line in view.lines if line.get_label() == "spring"]
    assert spring.get_xydata()[-1] == pytest.approx(end.get_xydata()[0])
    row = np.searchsorted(fig4_result.time, 1.5)
    traces = (fig4_result["spring_force_x"][row], np.degrees(fig4_result["theta"][row]), 1e3 * fig4_result["X"][row])
    for axis, value in zip(figure.axes[1:], traces, strict=True):
        shown = value * (1e3 if "µm" in axis.get_ylabel() else 1.0)
        dot = axis.lines[1]
        assert dot.get_xdata()[0] == pytest.approx(1.5, abs=6e-3)
        assert dot.get_ydata()[0] == pytest.approx(shown, rel=0.02)


def test_frames_are_numbered(fig4_result: ds.Result, tmp_path: Path) -> None:
    animate(fig4_result, tmp_path / "frames", start=0.5, end=1.9, frames_per_second=3, seconds=1.0)
    files = sorted((tmp_path / "frames").iterdir())
    assert [file.name for file in files] == ["frame_0001.png", "frame_0002.png", "frame_0003.png"]
    first, *_, last = (image.imread(file) for file in files)
    assert first.shape[:2] == (520, 800)
    assert np.abs(first - last).mean() > 1e-3
    with pytest.raises(ds.FileError, match=r"frame_0001\.png: the file exists"):
        animate(fig4_result, tmp_path / "frames", frames_per_second=3, seconds=1.0, overwrite=False)
    with pytest.raises(ds.FileError, match="holds frames of another animation"):
        animate(fig4_result, tmp_path / "frames", frames_per_second=2, seconds=1.0)


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        ({"start": 3.0}, "from 0 to 2 s"),
        ({"start": 1.0, "end": 0.5}, "from 0 to 2 s"),
        ({"end": float("nan")}, "from 0 to 2 s"),
        ({"seconds": 0.0}, "from 2 to 20000 frames"),
        ({"seconds": float("inf")}, "from 2 to 20000 frames"),
        ({"seconds": 0.01}, "from 2 to 20000 frames"),
        ({"output": "film.mp4"}, r"X\.gif, or a folder"),
    ],
)
def test_unfit_arguments_are_refused(fig4_result: ds.Result, tmp_path: Path, arguments: dict[str, Any], remedy: str) -> None:
    with pytest.raises(ds.UsageError, match=remedy):
        animate(fig4_result, tmp_path / arguments.pop("output", "frames"), **arguments)
    assert list(tmp_path.iterdir()) == []


OWN = {
    "system": {"mass": 1.0, "stiffness_x": 5e3, "stiffness_y": 2e6, "misalignment_deg": 3.0},
    "friction": {"law": "weakening", "mu_0": 0.30, "mu_inf": 0.25, "v_f": 0.010, "normal_load": 20.0},
    "drive": {"velocity": 5e-3},
}


@pytest.fixture(scope="module")
def own() -> ds.Result:
    """80 cycles, 50 mm of way, 1.2 mm of elongation."""
    from dynstiction.plot.paper import deck  # noqa: PLC0415

    return ds.run(deck("fig3"), **OWN, scene={"t_end": 10.0}, output={"interval": 5e-4})


def test_a_film_shows_the_first_creep_and_three_cycles(own: ds.Result, fig4_result: ds.Result) -> None:
    peaks = ds.stick_slip_statistics(own)["peak_time"]
    times = _frame_times(own, None, None, 20, 10.0)
    assert (times[0], times.size) == (0.0, 200)
    assert peaks[3] < times[-1] < peaks[4]
    assert _frame_times(own, 0.0, None, 20, 10.0)[-1] == 10.0
    assert _frame_times(fig4_result, None, None, 20, 10.0)[-1] == 2.0


def test_frames_drawn_over_one_ground_are_those_drawn_anew(own: ds.Result, tmp_path: Path) -> None:
    animate(own, tmp_path / "frames", frames_per_second=2, seconds=2.0)
    times = _frame_times(own, None, None, 2, 2.0)
    with rc_context(STYLE):
        figure, show = view_from_above(own, times)
        show(3)
        figure.savefig(tmp_path / "anew.png", dpi=125)
    written, anew = (image.imread(tmp_path / name)[..., :3] for name in ("frames/frame_0004.png", "anew.png"))
    assert written.shape == anew.shape
    # Where a moving thing lies under one that stands.
    assert np.mean(np.abs(written - anew).max(axis=2) > 0.1) < 5e-3
