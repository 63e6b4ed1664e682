"""The motion of the full model as a map of one number: from release to release."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import FigureBase
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator
from numpy.typing import NDArray

from .._run import run
from ..errors import Error, UsageError
from ..record import SLIP_BEGINS
from ..result import Result
from ..scene import Scene
from .notation import Floats, prefixed
from .style import VERMILION, sized
from .theory import slider
from .view import View

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

DOTS: Any = {"linewidths": 0.0, "rasterized": True}
ZERO: Any = {"color": "0.6", "linewidth": 0.6, "linestyle": ":", "zorder": 0}
"""Lines where the next release is at the same place."""

INSTEAD = "draw the kind 'history' or 'path' instead"


class Releases(NamedTuple):
    """Releases of a run in the order of time; of a run with too many, the first ones."""

    time: Floats
    """When slip begins [s], shape (n,)."""
    u: Floats
    """``k_x u_x/F_0`` there, shape (n,)."""
    excursion: NDArray[np.bool_]
    """Whether u decreases by more than `FAR` fast cycles until the next release, shape (n - 1,)."""
    total: int
    """Releases of the whole run."""


def draw_cycle_map(view: View, figure: FigureBase) -> None:
    """P(u) - u and T(u) of the fast cycles, and the iterates of the whole run, coloured by time.

    The run is repeated in memory to obtain the state at each release; only the beginning of a long run is drawn.
    """
    releases = releases_of(view.whole)
    far = bool(releases.excursion.any())
    sized(figure, 186.0 if far else 140.0)
    heights = [31.0, 31.0, 60.0, *([32.0] if far else [])]
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    above = figure.add_subplot(grid[0, :])
    middle, whole = (figure.add_subplot(grid[row, :], sharex=above) for row in (1, 2))
    axes = [above, middle, whole]
    colours = Normalize(releases.time[0], releases.time[-1])
    _draw_fast_cycles(above, middle, releases, colours)
    whole.set(xlabel="$u = k_x u_x/F_0$ at a release", ylabel="$P(u)$, at the next one")
    web = _draw_cobweb(whole, releases, colours, slice(None))
    whole.set(xlim=_around(releases.u), ylim=_around(releases.u))
    if far:
        axes += [figure.add_subplot(grid[3, place]) for place in (0, 1)]
        _draw_stairs(axes[3], releases, colours)
        u, next_u = releases.u[:-1][releases.excursion], releases.u[1:][releases.excursion]
        times = releases.time[:-1][releases.excursion]
        axes[4].scatter(u, next_u, c=times, norm=colours, s=6.0, **DOTS)
        _enlarge(axes[4], u, next_u, "excursions")
    for axis, name in zip(axes, "abcde", strict=False):
        # On the left of a panel, or above its left end.
        shift, vertical = ((-34.0, 0.0), "top") if name in "abc" else ((-27.0, 3.0), "bottom")
        style: Any = {"textcoords": "offset points", "va": vertical, "fontweight": "bold"}
        axis.annotate(f"({name})", (0.0, 1.0), shift, xycoords="axes fraction", **style)
    if releases.total > releases.time.size:
        count, end = releases.time.size, releases.time[-1]
        above.set_title(f"the first {count} of {releases.total} releases, up to {end:.4g} s", fontsize=7.5)
    figure.colorbar(web, ax=axes, label="$t$ [s]", pad=0.02, aspect=50.0)


def releases_of(result: Result) -> Releases:
    """Releases of a run, which is repeated; a `UsageError` says why it has no map."""
    model = str(result.attributes.get("model", ""))
    if model != "full":
        raise UsageError(
            f"the cycle map is defined for the full model, where one number describes a release: "
            f"run with scene.model = 'full' (this is '{model}'), or {INSTEAD}"
        )
    parameters, events = slider(result), result.events
    found = events["time"][events["kind"] == SLIP_BEGINS]
    if found.size < LEAST_RELEASES:
        raise UsageError(
            f"the run has {found.size} releases from a stick, and a map needs {LEAST_RELEASES}: {INSTEAD}"
        )
    stop = float(found[MOST_RELEASES] if found.size > MOST_RELEASES else result.time[-1])
    # One of its steps ends at each release.
    output = {"interval": 0.0, "fields": ["u_x"], "wall_limit": 0.0}
    try:
        again = run(Scene(result.resolved_deck, scene={"t_end": stop}, output=output), progress=False)
    except Error as error:
        raise UsageError(f"the run cannot be repeated, for its states at the releases: {error}") from error
    time = again.events["time"][again.events["kind"] == SLIP_BEGINS][:MOST_RELEASES]
    u_x = again["u_x"][np.searchsorted(again.time, time)]
    u = parameters["stiffness_x"] * u_x / (parameters["mu_0"] * parameters["normal_load"])
    if np.ptp(u) < NARROWEST:
        raise UsageError(
            f"all releases are at k_x u_x/F_0 = {u[0]:.6g}: the cycle map is one point: {INSTEAD}"
        )
    usual = float(np.median(np.diff(u)))
    excursion = np.diff(u) * np.sign(usual) < -FAR * abs(usual)
    return Releases(time, u, excursion, int(found.size))


def _draw_fast_cycles(above: Axes, below: Axes, releases: Releases, colours: Normalize) -> None:
    """P(u) - u and T(u); triangles at the edge mark excursions, which are far beyond it."""
    far = releases.excursion
    u, step, duration = releases.u[:-1], np.diff(releases.u), np.diff(releases.time)
    drawn = {"c": releases.time[:-1][~far], "norm": colours, "s": 2.0, **DOTS}
    exponent = _exponent(step[~far])
    above.scatter(u[~far], step[~far] / 10.0**exponent, **drawn)
    factor, unit = _time_unit(duration[~far])
    below.scatter(u[~far], factor * duration[~far], **drawn)
    above.set_ylabel("$P(u) - u$" + _power(exponent))
    below.set_ylabel(f"$T(u)$ [{unit}]")
    above.axhline(0.0, **ZERO)
    for axis in (above, below):
        axis.tick_params(labelbottom=False)
    if far.any():
        place = np.unique(u[far])
        factor, unit = _time_unit(duration[far])
        downward = bool(np.median(step[far]) < 0.0)
        _mark(above, place, _range(step[far], "excursions: {}"), bottom=downward)
        _mark(below, place, _range(factor * duration[far], f"excursions: {{}} {unit}"), bottom=False)


def _mark(axis: Axes, place: Floats, text: str, bottom: bool) -> None:
    """Draw triangles at an edge for the values beyond it."""
    low, high = axis.get_ylim()
    room = 0.22 * (high - low)
    axis.set_ylim(low - room * bottom, high + room * (not bottom))
    height, marker, level = (0.06, "v", 0.09) if bottom else (0.94, "^", 0.91)
    across: Any = {"transform": axis.get_xaxis_transform(), "rasterized": True}
    axis.plot(place, np.full(place.size, height), marker, color=VERMILION, markersize=3.0, **across)
    start, side = (0.03, "left") if float(np.median(place)) >= 0.0 else (0.97, "right")
    style: Any = {"ha": side, "va": "center", "fontsize": 7.5, "color": VERMILION}
    axis.text(start, level, text, transform=axis.transAxes, **style)


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
    axis.plot(ends, ends, **ZERO)
    axis.add_collection(web)
    far = releases.excursion[shown][: u.size - 1]
    axis.plot(u[:-1][far], u[1:][far], "o", color=VERMILION, markersize=2.5, rasterized=True)
    return web


def _draw_stairs(axis: Axes, releases: Releases, colours: Normalize) -> None:
    """The last fast cycles before the last excursion, enlarged."""
    last = int(np.flatnonzero(releases.excursion)[-1])
    before = np.flatnonzero(releases.excursion[:last])
    stairs = slice(max(last - STAIRS, int(before[-1]) + 1 if before.size else 0), last + 1)
    u = releases.u[stairs]
    _draw_cobweb(axis, releases, colours, stairs)
    axis.plot(u[:-1], u[1:], "o", color="0.2", markersize=2.0)
    axis.plot(u[-1], u[-1], "v", color=VERMILION, markersize=3.0)
    _enlarge(axis, u, u, "before an excursion")


def _enlarge(axis: Axes, u: Floats, next_u: Floats, title: str) -> None:
    """Limits around some releases, with ticks as differences from a round number if the view is narrow."""
    axis.set(xlim=_around(u), ylim=_around(next_u))
    axis.set_title(title, fontsize=7.5)
    for side, name, bins in ((axis.xaxis, "u", 3), (axis.yaxis, "P(u)", 4)):
        low, high = side.get_view_interval()
        round_to = -int(np.floor(np.log10(high - low)))
        origin = round(0.5 * (low + high), round_to) if round_to > 1 else 0.0
        exponent = _exponent(np.array([low, high]) - origin)
        places = np.asarray(MaxNLocator(nbins=bins, min_n_ticks=2).tick_values(low - origin, high - origin))
        words = [f"{place / 10.0**exponent:.4g}".replace("-", "−") for place in places]
        side.set_major_locator(FixedLocator(list(origin + places)))
        side.set_major_formatter(FixedFormatter(words))
        sign = "-" if origin >= 0.0 else "+"
        difference = f"{name} {sign} {abs(origin):.10g}" if origin else name
        side.set_label_text(f"${difference}$" + _power(exponent))


def _around(values: Floats) -> tuple[float, float]:
    """Limits of an axis around values, with at least the smallest width that the axis can show."""
    low, high = float(values.min()), float(values.max())
    margin = max(0.06 * (high - low), 0.5 * NARROWEST, 1e-6 * max(abs(low), abs(high)))
    return low - margin, high + margin


def _exponent(values: Floats) -> int:
    """Power of ten that makes values easy to read: 0, or a negative multiple of 3."""
    largest = float(np.max(np.abs(values), initial=0.0))
    if not 0.0 < largest < 0.1:
        return 0
    return 3 * int(np.floor((np.log10(largest) + 1.0) / 3.0))


def _power(exponent: int) -> str:
    return "" if exponent == 0 else rf" [$10^{{{exponent}}}$]"


def _time_unit(duration: Floats) -> tuple[float, str]:
    typical = float(np.median(duration)) if duration.size else 1.0
    return prefixed("s", typical, 0.3, ("", "m", "µ"))
