"""The object from above, while friction turns and the spring force and the position evolve."""

from __future__ import annotations

import io
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from PIL import Image

from .._output import check_outputs, make_folder, put
from ..errors import FileError, UsageError
from ..result import Result
from .notation import label_of
from .samples import Floats, columns, thin
from .schematics import coil, principal_axes
from .style import BLACK, BLUE, GREEN, PURPLE, STYLE, VERMILION
from .theory import stiff_frequency
from .view import cycles_of, usual_end, window

__all__ = ["animate", "view_from_above"]

# 800 by 520 dots: MP4 wants even numbers.
SIZE = (6.4, 4.16)
DOTS_PER_INCH = 125
PANEL_RATIO = 2.35
"""Width of the view from above over its height."""
AVERAGED_PERIODS = 10.0
TRACES = ("spring_force_x", "theta", "X")
COLUMNS = ("X", "Y", "u_x", "u_y", "spring_force_x", "friction", "theta", "psi")
FILMS = (".gif", ".mp4")
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
    progress: Callable[[int, int], None] | None = None,
    overwrite: bool = True,
) -> None:
    """Write an animation of a run as seen from above.

    Parameters
    ----------
    result : Result
        A run with the columns X, Y, u_x, u_y, spring_force_x, friction, theta and psi.
    output : Path
        ``X.gif``, ``X.mp4`` (needs the program ffmpeg), or a folder for ``frame_0001.png``, …
    start, end : float
        The part of the run [s]; without both, the first creep and three cycles, or the whole run if it has no cycles.
    frames_per_second : int
        Frame rate.
    seconds : float
        Length of the animation [s].
    progress : callable
        Function of the number of the frame and the number of all frames.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    UsageError
        If an argument is not valid, or a column or ffmpeg is missing.
    FileError
        If the animation cannot be written, or the folder holds frames of another animation.
    """
    times = _frame_times(result, start, end, frames_per_second, seconds)
    suffix = _kind_of(output)
    outputs = [output] if suffix else _frame_names(output, times.size)
    if suffix or output.is_dir():
        check_outputs(outputs, overwrite=overwrite)
    with rc_context(STYLE):
        figure, show = view_from_above(result, times)
        pictures = _pictures(figure, show, times.size, progress)
        try:
            if suffix == ".gif":
                put(output, _gif(pictures, frames_per_second), overwrite=overwrite)
            elif suffix == ".mp4":
                put(output, _mp4(pictures, frames_per_second), overwrite=overwrite)
            else:
                _write_frames(outputs, pictures, overwrite=overwrite)
        except subprocess.CalledProcessError as error:
            raise FileError(f"{output}: ffmpeg failed: write a GIF or a folder of frames instead") from error


def _pictures(
    figure: Figure,
    show: Callable[[int], Sequence[Artist]],
    count: int,
    progress: Callable[[int, int], None] | None,
) -> Iterator[Image.Image]:
    """The frames one by one; parts that do not move are drawn once."""
    canvas: Any = FigureCanvasAgg(figure)
    moving = show(0)
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    ground = canvas.copy_from_bbox(figure.bbox)
    width, height = canvas.get_width_height()
    for frame in range(count):
        canvas.restore_region(ground)
        for artist in sorted(show(frame), key=lambda each: each.get_zorder()):
            figure.draw_artist(artist)
        yield Image.frombuffer("RGBA", (width, height), bytes(canvas.buffer_rgba())).convert("RGB")
        if progress is not None:
            progress(frame + 1, count)


def _gif(pictures: Iterator[Image.Image], frames_per_second: int) -> bytes:
    # One palette for all frames: the others have the colours of the first.
    first = next(pictures)
    palette = first.quantize(colors=255, method=Image.Quantize.MEDIANCUT)
    others = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    duration = round(1000 / frames_per_second)
    film = io.BytesIO()
    palette.save(
        film,
        "GIF",
        save_all=True,
        append_images=others,
        duration=duration,
        loop=0,
        disposal=1,
        optimize=False,
    )
    return film.getvalue()


def _mp4(pictures: Iterator[Image.Image], frames_per_second: int) -> bytes:
    first = next(pictures)
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder, "film.mp4")
        _encode(film, first, pictures, frames_per_second)
        return film.read_bytes()


def _encode(
    output: Path, first: Image.Image, pictures: Iterator[Image.Image], frames_per_second: int
) -> None:
    command = [
        "ffmpeg", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.width}x{first.height}",
        "-r", str(frames_per_second), "-i", "-", "-pix_fmt", "yuv420p", str(output),
    ]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as encoder:
        assert encoder.stdin is not None
        try:
            for picture in chain([first], pictures):
                encoder.stdin.write(picture.tobytes())
        except BrokenPipeError:
            pass  # the exit status shows that it failed
    if encoder.returncode != 0:
        raise subprocess.CalledProcessError(encoder.returncode, command)


def _frame_names(folder: Path, count: int) -> list[Path]:
    """Names of the frames; refuses a folder with frames that would stay there among them."""
    digits = max(4, len(str(count)))
    names = [folder / f"frame_{frame:0{digits}d}.png" for frame in range(1, count + 1)]
    others = set(folder.glob("frame_*.png")).difference(names)
    if others:
        raise FileError(f"{folder}: holds frames of another animation: name another folder, or remove them")
    return names


def _write_frames(names: Sequence[Path], pictures: Iterator[Image.Image], *, overwrite: bool) -> None:
    make_folder(names[0].parent)
    for name, picture in zip(names, pictures, strict=True):
        image = io.BytesIO()
        picture.save(image, "PNG", dpi=(DOTS_PER_INCH, DOTS_PER_INCH))
        put(name, image.getvalue(), overwrite=overwrite)


def view_from_above(result: Result, times: Floats) -> tuple[Figure, Callable[[int], Sequence[Artist]]]:
    """Figure of a run, and a function that draws one of the increasing `times` [s] by its number and returns the moving parts.

    The upper panel shows the object in the plane of the floor, to scale, with the friction that acts on it; the lower panels show
    spring force, angle of friction and position against time. Oscillating quantities are drawn as means over ten periods of the
    stiff axis, at most since the last frame, and the tip of the friction vector as its path in this time.
    """
    needed = columns(result, *COLUMNS)
    first, last = np.searchsorted(result.time, [times[0], times[-1]])
    part = slice(int(first), int(last) + 1)
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.subplot_mosaic([["above"] * 3, [*TRACES]], height_ratios=(2.3, 1.0))
    scene = _Scene(axes["above"], result, needed, part)
    traces = _draw_traces([axes[name] for name in TRACES], result.time, needed, part)
    ends = np.clip(np.searchsorted(result.time, times, side="right"), 1, result.time.size)
    averaged = min(times[1] - times[0], AVERAGED_PERIODS / (stiff_frequency(result) or np.inf))
    begins = np.minimum(np.searchsorted(result.time, times - averaged), ends - 1)

    def show(frame: int) -> Sequence[Artist]:
        now = slice(int(begins[frame]), int(ends[frame]))
        return [*scene.show(now, times[frame]), *traces(now)]

    show(0)
    # Later frames keep the layout of the first: they must not shift, and the layout is slow.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure, show


def _ends(place: Floats, driven: Floats) -> tuple[float, float]:
    """Smallest and largest X of both."""
    both = np.concatenate([place[:, 0], driven[:, 0]])
    return float(both.min()), float(both.max())


class _Scene:
    """The object, the spring, its driven end, the soft axis and the friction vector in the plane of the floor."""

    def __init__(self, axis: Axes, result: Result, needed: Mapping[str, Floats], part: slice) -> None:
        phi = np.radians(float(result.parameters.get("misalignment_deg", 0.0)))
        soft, stiff = principal_axes(phi)
        self.place = MM * np.stack([needed["X"], needed["Y"]], axis=1)
        self.driven = self.place + MM * (np.outer(needed["u_x"], soft) + np.outer(needed["u_y"], stiff))
        # Friction acts against the slip.
        direction = np.stack([np.cos(needed["psi"]), np.sin(needed["psi"])], axis=1)
        self.friction = -needed["friction"][:, np.newaxis] * direction
        place, driven = self.place[part], self.driven[part]
        stretch = float(np.hypot(*(driven - place).T).max())
        left, right = _ends(place, driven)
        label = "$X$ [mm]"
        if right - left > MOST_TRAVEL * stretch > 0.0:
            # On the scale of the distance of the object, it would hide the spring: instead the driven end is at rest.
            along = np.stack([self.driven[:, 0], np.zeros(len(self.driven))], axis=1)
            self.place, self.driven = self.place - along, self.driven - along
            left, right = _ends(self.place[part], self.driven[part])
            label = "$X$ − driven end [mm]"
        self.length = max(stretch, 0.05 * (right - left)) or 1.0
        """Length of the longest friction vector, as drawn [mm]."""
        self.per_newton = self.length / (float(needed["friction"][part].max()) or 1.0)
        self.soft = soft
        self._draw(axis, left, right, label)

    def _draw(self, axis: Axes, left: float, right: float, label: str) -> None:
        unit = self.length
        left, right = left - 1.25 * unit, right + 0.5 * unit
        height = max(2.5 * unit, (right - left) / PANEL_RATIO)
        spare = max(0.0, PANEL_RATIO * height - (right - left))
        axis.set(aspect="equal", xlabel=label, ylabel="$Y$ [mm]", ylim=(-0.46 * height, 0.54 * height))
        axis.set_xlim(left - 0.5 * spare, right + 0.5 * spare)
        self.half = 0.13 * unit
        self.limit = Circle((0.0, 0.0), unit, fill=False, color="0.6", linewidth=0.6, linestyle=":")
        axis.add_patch(self.limit)
        (self.axis_line,) = axis.plot(
            [], [], color="0.6", linewidth=0.8, linestyle=(0, (8, 3, 2, 3)), label="soft axis"
        )
        (self.spring,) = axis.plot([], [], color=BLUE, linewidth=1.0, label="spring")
        (self.end,) = axis.plot(
            [], [], "D", color=GREEN, markersize=5.0, linestyle="none", label="driven end"
        )
        (self.trail,) = axis.plot([], [], color=PURPLE, linewidth=0.8, alpha=0.5)
        self.body = Rectangle(
            (0.0, 0.0), 2 * self.half, 2 * self.half, facecolor="0.85", edgecolor=BLACK, zorder=3
        )
        self.body.set_angle(np.degrees(math.atan2(self.soft[1], self.soft[0])))
        self.body.rotation_point = "center"
        axis.add_patch(self.body)
        self.vector = axis.quiver(
            [0.0], [0.0], [0.0], [0.0], color=PURPLE, angles="xy", scale_units="xy", scale=1.0, width=0.006, zorder=4,
            label="friction on the object",
        )  # fmt: skip
        self.clock = axis.text(0.012, 0.96, "", transform=axis.transAxes, va="top")
        axis.legend(loc="upper right", ncols=4, columnspacing=1.2, handlelength=1.6, borderaxespad=0.3)

    def show(self, now: slice, time: float) -> Sequence[Artist]:
        """Set the moving parts to the mean of some samples, and return them."""
        place, driven = self.place[now].mean(axis=0), self.driven[now].mean(axis=0)
        tips = place + self.per_newton * self.friction[now]
        reach = np.array([[-1.0], [1.0]]) * 20.0 * self.length
        self.axis_line.set_data(*(place + reach * self.soft).T)
        self.spring.set_data(*coil(place, driven, turns=10, width=0.06 * self.length).T)
        self.end.set_data(driven[:1], driven[1:])
        self.trail.set_data(*tips.T)
        self.limit.center = (float(place[0]), float(place[1]))
        self.body.set_xy((place[0] - self.half, place[1] - self.half))
        mean = tips.mean(axis=0) - place
        self.vector.set_offsets(place)
        self.vector.set_UVC(mean[:1], mean[1:])
        self.clock.set_text(f"$t$ = {time:.3f} s")
        return (
            self.axis_line, self.spring, self.end, self.trail, self.limit, self.body, self.vector, self.clock,
        )  # fmt: skip


def _draw_traces(
    axes: Sequence[Axes], time: Floats, needed: Mapping[str, Floats], part: slice
) -> Callable[[slice], Sequence[Artist]]:
    """Spring force, angle and position against time; the function moves the dots that mark a frame."""
    dots = []
    for axis, name in zip(axes, TRACES, strict=True):
        label, scale, colour = label_of(name, "", needed[name][part])
        values = scale * needed[name]
        axis.plot(*thin(time[part], values[part]), color=colour)
        dots.append((axis.plot([], [], "o", color=VERMILION, markersize=4.5)[0], values))
        axis.set_xlim(time[part][0], time[part][-1])
        axis.margins(y=0.1)
        axis.locator_params(axis="x", nbins=4)
        axis.set_xlabel("$t$ [s]")
        axis.set_ylabel(label)

    def show(now: slice) -> Sequence[Artist]:
        for dot, values in dots:
            dot.set_data([time[now].mean()], [values[now].mean()])
        return [dot for dot, _ in dots]

    return show


def _frame_times(
    result: Result, start: float | None, end: float | None, frames_per_second: int, seconds: float
) -> Floats:
    if result.time.size < 2:
        raise UsageError("nothing to show: the result has fewer than two samples")
    if start is None and end is None:
        begin, finish = float(result.time[0]), usual_end(result, cycles_of(result), CYCLES, CYCLES + 1)
    else:
        begin, finish = window(result, start, end)
    if not (frames_per_second > 0 and 0.0 < seconds < math.inf):
        raise UsageError("frames per second and seconds must be positive")
    count = round(frames_per_second * seconds)
    if count > MOST_FRAMES:
        raise UsageError(
            f"{frames_per_second} frames per second for {seconds:g} s are {count} frames, at most {MOST_FRAMES} are drawn: "
            "give fewer frames per second, or fewer seconds"
        )
    if count < 2:
        raise UsageError(
            f"{frames_per_second} frames per second for {seconds:g} s: an animation has at least two frames"
        )
    return np.linspace(begin, finish, count)


def _kind_of(output: Path) -> str:
    """Suffix of an animation, empty for a folder of frames; refuses a bad name before anything is computed."""
    suffix = output.suffix.lower()
    if suffix == "" or output.is_dir():
        return ""
    if suffix not in FILMS:
        raise UsageError(f"{output}: an animation is X.gif, X.mp4, or a folder for PNG frames")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise UsageError(
            f"{output}: needs ffmpeg, which is not installed: install it, or write a GIF or a folder of frames"
        )
    return suffix
