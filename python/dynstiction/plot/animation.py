"""The object from above, while friction turns and the spring force and the position evolve."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from PIL import Image

from .._output import check_outputs, make_folder, put
from .._progress import progress_bar
from ..errors import FileError, UsageError
from ..result import Result
from .notation import Floats, label_of, thin
from .schematics import coil, principal_axes
from .style import BLACK, BLUE, GREEN, PURPLE, STYLE, VERMILION
from .theory import stiff_frequency
from .view import shown_part

# 800 by 520 dots: films want even numbers.
SIZE = (6.4, 4.16)
DOTS_PER_INCH = 125
PANEL_RATIO = 2.35
"""Width of the view from above over its height."""
AVERAGED_PERIODS = 10.0
TRACES = ("spring_force_x", "theta", "X")
COLUMNS = ("X", "Y", "u_x", "u_y", "spring_force_x", "friction", "theta", "psi")
MOST_TRAVEL = 6.0
"""Largest distance of the object, over the longest elongation of the spring, for which the floor is at rest in the picture."""
CYCLES = 3
"""Number of cycles after the first slip that an animation shows by default."""
MOST_FRAMES = 20000
MM = 1e3
"""Millimetres in a metre."""


def animate(
    result: Result,
    output: Path,
    *,
    start: float | None = None,
    end: float | None = None,
    frames_per_second: int = 20,
    seconds: float = 10.0,
    progress: bool | None = None,
    overwrite: bool = True,
) -> None:
    """Write an animation of a run as seen from above.

    Parameters
    ----------
    result : Result
        A run with the columns X, Y, u_x, u_y, spring_force_x, friction, theta and psi.
    output : Path
        ``X.gif``, or a folder for ``frame_0001.png``, …
    start, end : float
        The part of the run [s]; without both, the first creep and three cycles, or the whole run if it has no cycles.
    frames_per_second : int
        Frame rate.
    seconds : float
        Length of the animation [s].
    progress : bool, optional
        Whether to show a bar; by default as for `dynstiction.run`.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    UsageError
        If an argument is not valid, or a column is missing.
    FileError
        If the animation cannot be written, or the folder holds frames of another animation.
    """
    times = _frame_times(result, start, end, frames_per_second, seconds)
    is_film = output.suffix != "" and not output.is_dir()
    if is_film and output.suffix.lower() != ".gif":
        raise UsageError(f"{output}: an animation is X.gif, or a folder for PNG frames")
    digits = max(4, len(str(times.size)))
    frames = [output / f"frame_{frame:0{digits}d}.png" for frame in range(1, times.size + 1)]
    if not is_film and set(output.glob("frame_*.png")).difference(frames):
        raise FileError(f"{output}: holds frames of another animation: name another folder, or remove them")
    if is_film or output.is_dir():
        check_outputs([output] if is_film else frames, overwrite=overwrite)
    with rc_context(STYLE), progress_bar(progress, times.size, "frame {n:.0f}/{total:.0f}|{bar}|") as told:
        pictures = _pictures(*view_from_above(result, times), times.size, told)
        if is_film:
            # One palette for all frames: the others have the colours of the first.
            first = next(pictures).quantize(colors=255, method=Image.Quantize.MEDIANCUT)
            others = (picture.quantize(palette=first, dither=Image.Dither.NONE) for picture in pictures)
            how: Any = {"duration": round(1000 / frames_per_second), "loop": 0, "disposal": 1}
            put(
                output,
                _encoded(first, "GIF", save_all=True, append_images=others, optimize=False, **how),
                overwrite=overwrite,
            )
            return
        make_folder(output)
        for name, picture in zip(frames, pictures, strict=True):
            put(name, _encoded(picture, "PNG", dpi=(DOTS_PER_INCH, DOTS_PER_INCH)), overwrite=overwrite)


def _encoded(picture: Image.Image, form: str, **how: Any) -> bytes:
    content = io.BytesIO()
    picture.save(content, form, **how)
    return content.getvalue()


def _pictures(
    figure: Figure, show: Callable[[int], Sequence[Artist]], count: int, told: Callable[[float], None]
) -> Iterator[Image.Image]:
    """The frames one by one; parts that do not move are drawn once."""
    canvas: Any = FigureCanvasAgg(figure)
    for artist in show(0):
        artist.set_animated(True)
    canvas.draw()
    ground = canvas.copy_from_bbox(figure.bbox)
    for frame in range(count):
        canvas.restore_region(ground)
        for artist in sorted(show(frame), key=Artist.get_zorder):
            figure.draw_artist(artist)
        yield Image.frombuffer("RGBA", canvas.get_width_height(), bytes(canvas.buffer_rgba())).convert("RGB")
        told(frame + 1)


def view_from_above(result: Result, times: Floats) -> tuple[Figure, Callable[[int], Sequence[Artist]]]:
    """Figure of a run, and a function that draws one of the increasing `times` [s] by its number and returns the moving parts.

    The upper panel shows the object in the plane of the floor, to scale, with the friction that acts on it; the lower panels show
    spring force, angle of friction and position against time. Oscillating quantities are drawn as means over ten periods of the
    stiff axis, at most since the last frame, and the tip of the friction vector as its path in this time.
    """
    first, last = np.searchsorted(result.time, [times[0], times[-1]])
    part = slice(int(first), int(last) + 1)
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.subplot_mosaic([["above"] * 3, [*TRACES]], height_ratios=(2.3, 1.0))
    scene = _draw_scene(axes["above"], result, part)
    traces = [_draw_trace(axes[name], result, name, part) for name in TRACES]
    ends = np.clip(np.searchsorted(result.time, times, side="right"), 1, result.time.size)
    averaged = min(times[1] - times[0], AVERAGED_PERIODS / (stiff_frequency(result) or np.inf))
    begins = np.minimum(np.searchsorted(result.time, times - averaged), ends - 1)

    def show(frame: int) -> Sequence[Artist]:
        now = slice(int(begins[frame]), int(ends[frame]))
        for dot, values in traces:
            dot.set_data([result.time[now].mean()], [values[now].mean()])
        return [*scene(now, times[frame]), *(dot for dot, _ in traces)]

    show(0)
    # Later frames keep the layout of the first: they must not shift, and the layout is slow.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure, show


def _draw_scene(axis: Axes, result: Result, part: slice) -> Callable[[slice, float], Sequence[Artist]]:
    """The object, the spring, its driven end, the soft axis and the friction vector in the plane of the floor; the function sets
    them to the mean of some samples.
    """
    soft, stiff = principal_axes(np.radians(float(result.parameters.get("misalignment_deg", 0.0))))
    places = MM * np.stack([result["X"], result["Y"]], axis=1)
    ends = places + MM * (np.outer(result["u_x"], soft) + np.outer(result["u_y"], stiff))
    # Friction acts against the slip.
    friction = -result["friction"] * np.stack([np.cos(result["psi"]), np.sin(result["psi"])])
    stretch = float(np.hypot(*(ends - places)[part].T).max())
    label = "$X$ [mm]"
    if np.ptp([places[part, 0], ends[part, 0]]) > MOST_TRAVEL * stretch > 0.0:
        # On the scale of the distance of the object, it would hide the spring: instead the driven end is at rest.
        along = ends * (1.0, 0.0)
        places, ends, label = places - along, ends - along, "$X$ − driven end [mm]"
    both = np.stack([places[part, 0], ends[part, 0]])
    # The length of the longest friction vector, as drawn [mm].
    unit = max(stretch, 0.05 * float(np.ptp(both))) or 1.0
    vectors = unit / (float(result["friction"][part].max()) or 1.0) * friction.T
    left, right = both.min() - 1.25 * unit, both.max() + 0.5 * unit
    height = max(2.5 * unit, (right - left) / PANEL_RATIO)
    spare = max(0.0, PANEL_RATIO * height - (right - left))
    axis.set(aspect="equal", xlabel=label, ylabel="$Y$ [mm]", ylim=(-0.46 * height, 0.54 * height))
    axis.set_xlim(left - 0.5 * spare, right + 0.5 * spare)
    half, angle = 0.13 * unit, np.degrees(math.atan2(soft[1], soft[0]))
    style: Any = {"rotation_point": "center", "facecolor": "0.85", "edgecolor": BLACK, "zorder": 3}
    limit = Circle((0.0, 0.0), unit, fill=False, color="0.6", linewidth=0.6, linestyle=":")
    (line,) = axis.plot([], [], color="0.6", linewidth=0.8, dashes=(8, 3, 2, 3), label="soft axis")
    (spring,) = axis.plot([], [], color=BLUE, linewidth=1.0, label="spring")
    (end,) = axis.plot([], [], "D", color=GREEN, markersize=5.0, label="driven end")
    (trail,) = axis.plot([], [], color=PURPLE, linewidth=0.8, alpha=0.5)
    body = Rectangle((0.0, 0.0), 2 * half, 2 * half, angle=angle, **style)
    for patch in (limit, body):
        axis.add_patch(patch)
    arrow: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.006, "zorder": 4}
    vector = axis.quiver(*np.zeros((4, 1)), color=PURPLE, label="friction on the object", **arrow)
    clock = axis.text(0.012, 0.96, "", transform=axis.transAxes, va="top")
    axis.legend(loc="upper right", ncols=4, columnspacing=1.2, handlelength=1.6, borderaxespad=0.3)

    def show(now: slice, time: float) -> Sequence[Artist]:
        place, driven = places[now].mean(axis=0), ends[now].mean(axis=0)
        line.set_data(*(place + np.array([[-1.0], [1.0]]) * 20.0 * unit * soft).T)
        spring.set_data(*coil(place, driven, turns=10, width=0.06 * unit).T)
        end.set_data(driven[:1], driven[1:])
        trail.set_data(*(place + vectors[now]).T)
        limit.center = (float(place[0]), float(place[1]))
        body.set_xy((place[0] - half, place[1] - half))
        vector.set_offsets(place)
        vector.set_UVC(*vectors[now].mean(axis=0)[:, np.newaxis])
        clock.set_text(f"$t$ = {time:.3f} s")
        return line, spring, end, trail, limit, body, vector, clock

    return show


def _draw_trace(axis: Axes, result: Result, name: str, part: slice) -> tuple[Line2D, Floats]:
    """A column against time; the dot that marks a frame, and the column in the unit of the figure."""
    label, scale, colour = label_of(name, "", result[name][part])
    time, values = result.time, scale * result[name]
    axis.plot(*thin(time[part], values[part]), color=colour)
    (dot,) = axis.plot([], [], "o", color=VERMILION, markersize=4.5)
    axis.set(xlim=time[part][[0, -1]], xlabel="$t$ [s]", ylabel=label)
    axis.margins(y=0.1)
    axis.locator_params(axis="x", nbins=4)
    return dot, values


def _frame_times(
    result: Result, start: float | None, end: float | None, frames_per_second: int, seconds: float
) -> Floats:
    _, begin, finish = shown_part(result, start, end, shown=CYCLES, most=CYCLES + 1)
    if not 1.5 < frames_per_second * seconds < MOST_FRAMES or frames_per_second < 0:
        raise UsageError(
            f"{frames_per_second} frames per second for {seconds:g} s: an animation has from 2 to {MOST_FRAMES} frames"
        )
    return np.linspace(begin, finish, round(frames_per_second * seconds))
