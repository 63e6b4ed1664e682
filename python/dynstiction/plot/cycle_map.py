"""The motion of the full model as a map of one number: from release to release."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import FigureBase
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from ..errors import Error, UsageError
from ..record import SLIP_BEGINS
from ..result import Result
from ..scene import Scene
from ..simulation import Simulation
from .samples import Floats
from .style import VERMILION, sized
from .theory import slider

__all__ = ["Releases", "draw_cycle_map", "releases_of"]

MOST_RELEASES = 20_000
"""Largest number of releases that are drawn: the run is repeated up to the last of them."""

LEAST_RELEASES = 3

FAR = 10.0
"""An excursion is a step back, opposite to the fast cycles, by more than this many times their median step."""

STAIRS = 6
"""Number of fast cycles before an excursion that are shown enlarged."""

NARROWEST = 1e-6
"""Least width of a view of u; smaller differences are ignored."""

INSTEAD = "draw the kind 'history' or 'path' instead"


@dataclass(frozen=True)
class Releases:
    """Releases of a run in the order of time; of a run with too many, the first ones.

    Attributes
    ----------
    time : ndarray, shape (n,)
        When slip begins [s].
    u : ndarray, shape (n,)
        ``k_x u_x/F_0`` there.
    excursion : ndarray of bool, shape (n - 1,)
        Whether u decreases by more than `FAR` fast cycles until the next release.
    total : int
        Releases of the whole run.
    """

    time: Floats
    u: Floats
    excursion: NDArray[np.bool_]
    total: int

    @property
    def step(self) -> Floats:
        """P(u) - u of each release except the last."""
        return np.diff(self.u)

    @property
    def duration(self) -> Floats:
        """T(u) of each release except the last [s]."""
        return np.diff(self.time)


def draw_cycle_map(result: Result, figure: FigureBase) -> None:
    """P(u) - u and T(u) of the fast cycles, and the iterates of the whole run, coloured by time.

    The run is repeated in memory to obtain the state at each release; only the beginning of a long run is drawn.
    """
    releases = releases_of(result)
    far = bool(releases.excursion.any())
    sized(figure, 186.0 if far else 140.0)
    heights = [31.0, 31.0, 60.0, *([32.0] if far else [])]
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    above = figure.add_subplot(grid[0, :])
    middle = figure.add_subplot(grid[1, :], sharex=above)
    whole = figure.add_subplot(grid[2, :], sharex=above)
    axes = [above, middle, whole]
    colours = Normalize(releases.time[0], releases.time[-1])
    _draw_fast_cycles(above, middle, releases, colours)
    whole.set(xlabel="$u = k_x u_x/F_0$ at a release", ylabel="$P(u)$, at the next one")
    web = _draw_cobweb(whole, releases, colours, slice(None))
    whole.set(xlim=_around(releases.u), ylim=_around(releases.u))
    if far:
        near, jumps = (figure.add_subplot(grid[3, place]) for place in (0, 1))
        _draw_stairs(near, releases, colours)
        _draw_excursions(jumps, releases, colours)
        axes += [near, jumps]
    for axis, name in zip(axes, "abcde", strict=False):
        _letter(axis, name, outside=axis in axes[:3])
    if releases.total > releases.time.size:
        above.set_title(
            f"the first {releases.time.size} of {releases.total} releases, up to {releases.time[-1]:.4g} s",
            fontsize=7.5,
        )
    figure.colorbar(web, ax=axes, label="$t$ [s]", pad=0.02, aspect=50.0)


def releases_of(result: Result) -> Releases:
    """Releases of a run, which is repeated; a `UsageError` says why it has no map."""
    parameters = _parameters(result)
    limit = parameters["mu_0"] * parameters["normal_load"]
    events = result.events
    found = events["time"][events["kind"] == SLIP_BEGINS]
    if found.size < LEAST_RELEASES:
        raise UsageError(
            f"the run has {found.size} releases from a stick, and a map needs {LEAST_RELEASES}: {INSTEAD}"
        )
    stop = float(found[MOST_RELEASES - 1] if found.size > MOST_RELEASES else result.time[-1])
    try:
        time, u_x = _repeat(result, stop)
    except Error as error:
        raise UsageError(f"the run cannot be repeated, for its states at the releases: {error}") from error
    time, u = time[:MOST_RELEASES], parameters["stiffness_x"] * u_x[:MOST_RELEASES] / limit
    if time.size < LEAST_RELEASES:
        raise UsageError(
            f"the run, repeated, has {time.size} releases, and a map needs {LEAST_RELEASES}: {INSTEAD}"
        )
    if np.ptp(u) < NARROWEST:
        raise UsageError(
            f"all releases are at k_x u_x/F_0 = {u[0]:.6g}: the cycle map is one point: {INSTEAD}"
        )
    usual = float(np.median(np.diff(u)))
    excursion = np.diff(u) * np.sign(usual) < -FAR * abs(usual)
    return Releases(time, u, excursion, max(int(found.size), time.size))


def _parameters(result: Result) -> dict[str, float]:
    model = str(result.attributes.get("model", ""))
    if model != "full":
        raise UsageError(
            f"the cycle map is defined for the full model, where one number describes a release: "
            f"run with scene.model = 'full' (this is '{model}'), or {INSTEAD}"
        )
    if result.parameters.get("contact", "exact") != "exact":
        raise UsageError(
            "with a smoothed contact the object never rests, so that there is no release and no cycle map: "
            f"run with friction.contact = 'exact', or {INSTEAD}"
        )
    parameters = slider(result)
    if parameters["velocity"] * parameters["mu_0"] * parameters["normal_load"] == 0.0:
        raise UsageError(
            "without drive or friction nothing sticks and is released, so that there is no cycle map: "
            f"run with velocity, mu_0 and normal_load not 0, or {INSTEAD}"
        )
    if not result.resolved_deck:
        raise UsageError(
            "the result has no deck to repeat the run with: draw the file of a run, or what ds.run returned"
        )
    return parameters


def _repeat(result: Result, stop: float) -> tuple[Floats, Floats]:
    """Times [s] and u_x [m] of the releases of a run up to `stop`, from the states of the same run at these times."""
    end = float(result.parameters["t_end"])
    scene = Scene(
        result.resolved_deck,
        output={"interval": end, "fields": ["u_x"], "wall_limit": 0.0},
    )
    with Simulation(scene) as simulation:
        simulation.step_to(min(stop, end))
        events = simulation.events
    time = events["time"][events["kind"] == SLIP_BEGINS]
    u_x = np.empty(time.size)
    with Simulation(scene) as simulation:
        for place, instant in enumerate(time):
            simulation.step_to(float(instant))
            u_x[place] = simulation.state["u_x"]
    return time, u_x


def _draw_fast_cycles(above: Axes, below: Axes, releases: Releases, colours: Normalize) -> None:
    """P(u) - u and T(u); triangles at the edge mark excursions, which are far beyond it."""
    fast = ~releases.excursion
    drawn: Any = {
        "c": releases.time[:-1][fast],
        "norm": colours,
        "s": 2.0,
        "linewidths": 0.0,
        "rasterized": True,
    }
    exponent = _exponent(releases.step[fast])
    above.scatter(releases.u[:-1][fast], releases.step[fast] / 10.0**exponent, **drawn)
    unit, seconds = _time_unit(releases.duration[fast])
    below.scatter(releases.u[:-1][fast], releases.duration[fast] / seconds, **drawn)
    above.set_ylabel(r"$P(u) - u$" if exponent == 0 else rf"$P(u) - u$ [$10^{{{exponent}}}$]")
    below.set_ylabel(f"$T(u)$ [{unit}]")
    above.axhline(0.0, color="0.6", linewidth=0.6, linestyle=":", zorder=0)
    for axis in (above, below):
        axis.tick_params(labelbottom=False)
    far = releases.excursion
    if not far.any():
        return
    place = np.unique(releases.u[:-1][far])
    unit, seconds = _time_unit(releases.duration[far])
    downward = bool(np.median(releases.step[far]) < 0.0)
    _mark(above, place, _range(releases.step[far], "excursions: {}"), bottom=downward)
    _mark(below, place, _range(releases.duration[far] / seconds, f"excursions: {{}} {unit}"), bottom=False)


def _mark(axis: Axes, place: Floats, text: str, bottom: bool) -> None:
    """Draw triangles at an edge for the values beyond it."""
    low, high = axis.get_ylim()
    room = 0.22 * (high - low)
    axis.set_ylim(low - room * bottom, high + room * (not bottom))
    height, marker = (0.06, "v") if bottom else (0.94, "^")
    across = axis.get_xaxis_transform()
    axis.plot(
        place,
        np.full(place.size, height),
        marker,
        color=VERMILION,
        markersize=3.0,
        transform=across,
        rasterized=True,
    )
    left = float(np.median(place)) >= 0.0
    style: Any = {"ha": "left" if left else "right", "va": "center", "fontsize": 7.5, "color": VERMILION}
    axis.text(0.03 if left else 0.97, 0.09 if bottom else 0.91, text, transform=axis.transAxes, **style)


def _range(values: Floats, text: str) -> str:
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return text.format(low if low == high else f"{low} … {high}").replace("-", "−")


def _draw_cobweb(axis: Axes, releases: Releases, colours: Normalize, shown: slice) -> LineCollection:
    """The iterates u_n -> u_n+1 between the diagonal and the map, with points on the map."""
    u, time = releases.u[shown], releases.time[shown]
    corners = np.repeat(np.stack([u, u], axis=1), 2, axis=0)
    corners[1:-1:2, 1] = u[1:]
    corners = corners[:-1]
    segments = np.stack([corners[:-1], corners[1:]], axis=1)
    web = LineCollection(list(segments), array=np.repeat(time[:-1], 2), norm=colours, linewidths=0.6)
    web.set_rasterized(True)
    ends = np.array([u.min(), u.max()]) + np.array([-1.0, 1.0]) * max(np.ptp(u), NARROWEST)
    axis.plot(ends, ends, color="0.6", linewidth=0.6, linestyle=":", zorder=0)
    axis.add_collection(web)
    far = releases.excursion[shown][: u.size - 1]
    axis.plot(u[:-1][far], u[1:][far], "o", color=VERMILION, markersize=2.5, rasterized=True)
    return web


def _draw_stairs(axis: Axes, releases: Releases, colours: Normalize) -> None:
    """The last fast cycles before the last excursion, enlarged."""
    last = int(np.flatnonzero(releases.excursion)[-1])
    before = np.flatnonzero(releases.excursion[:last])
    first = max(last - STAIRS, int(before[-1]) + 1 if before.size else 0)
    stairs = slice(first, last + 1)
    u = releases.u[stairs]
    _draw_cobweb(axis, releases, colours, stairs)
    axis.plot(u[:-1], u[1:], "o", color="0.2", markersize=2.0)
    axis.plot(u[-1], u[-1], "v", color=VERMILION, markersize=3.0)
    axis.set(xlim=_around(u), ylim=_around(u))
    axis.set_title("before an excursion", fontsize=7.5)
    _label_finely(axis)


def _draw_excursions(axis: Axes, releases: Releases, colours: Normalize) -> None:
    """The map of the excursions."""
    far = releases.excursion
    u, next_u = releases.u[:-1][far], releases.u[1:][far]
    axis.scatter(u, next_u, c=releases.time[:-1][far], norm=colours, s=6.0, linewidths=0.0, rasterized=True)
    axis.set(xlim=_around(u), ylim=_around(next_u))
    axis.set_title("excursions", fontsize=7.5)
    _label_finely(axis)


def _label_finely(axis: Axes) -> None:
    """Ticks as differences from a round number, if the view is narrow."""
    for side, name, bins in ((axis.xaxis, "u", 3), (axis.yaxis, "P(u)", 4)):
        low, high = side.get_view_interval()
        round_to = -int(np.floor(np.log10(high - low)))
        origin = round(0.5 * (low + high), round_to) if round_to > 1 else 0.0
        exponent = _exponent(np.array([low, high]) - origin)
        side.set_major_locator(_Shifted(origin, bins))
        side.set_major_formatter(FuncFormatter(partial(_difference, origin, exponent)))
        sign = "-" if origin >= 0.0 else "+"
        difference = f"{name} {sign} {abs(origin):.10g}" if origin else name
        side.set_label_text(f"${difference}$" if exponent == 0 else rf"${difference}$ [$10^{{{exponent}}}$]")


def _difference(origin: float, exponent: int, value: float, _: object) -> str:
    return f"{(value - origin) / 10.0**exponent:.4g}".replace("-", "−")


class _Shifted(MaxNLocator):
    """A few ticks at round distances from an origin."""

    def __init__(self, origin: float, bins: int) -> None:
        super().__init__(nbins=bins, min_n_ticks=2)
        self._origin = origin

    def tick_values(self, vmin: float, vmax: float) -> Any:
        return self._origin + np.asarray(super().tick_values(vmin - self._origin, vmax - self._origin))


def _around(values: Floats) -> tuple[float, float]:
    """Limits of an axis around values, with at least the smallest width that the axis can show."""
    low, high = float(values.min()), float(values.max())
    margin = max(0.06 * (high - low), 0.5 * NARROWEST, 1e-6 * max(abs(low), abs(high)))
    return low - margin, high + margin


def _letter(axis: Axes, name: str, outside: bool) -> None:
    """Letter of a panel, on its left or above its left end."""
    shift, vertical = ((-34.0, 0.0), "top") if outside else ((-27.0, 3.0), "bottom")
    style: Any = {
        "xycoords": "axes fraction",
        "textcoords": "offset points",
        "va": vertical,
        "fontweight": "bold",
    }
    axis.annotate(f"({name})", (0.0, 1.0), shift, **style)


def _exponent(values: Floats) -> int:
    """Power of ten that makes values easy to read: 0, or a negative multiple of 3."""
    largest = float(np.max(np.abs(values), initial=0.0))
    if not 0.0 < largest < 0.1:
        return 0
    return 3 * int(np.floor((np.log10(largest) + 1.0) / 3.0))


def _time_unit(duration: Floats) -> tuple[str, float]:
    typical = float(np.median(duration)) if duration.size else 1.0
    for unit, seconds in (("s", 1.0), ("ms", 1e-3)):
        if typical >= 0.3 * seconds:
            return unit, seconds
    return "µs", 1e-6
