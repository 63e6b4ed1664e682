"""One HTML page with all that a result file holds; it needs neither network nor other files."""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Iterator
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np
from matplotlib.figure import Figure

from .. import plot
from ..errors import FileError, UsageError
from ..html import table
from ..plot.style import rendering
from ..record import Described, rows_of
from ..result import Result
from ..stick_slip import stick_slip_statistics

__all__ = ["report", "write_report"]

DOTS_PER_INCH = 220
"""Sharp on screens with two dots a pixel."""

FRAMES = 600
"""Of the animation."""

MOST_CYCLES = 50
"""Rows of the table of cycles."""

CAPTIONS = {
    "history": "Spring forces along the soft and the stiff axis, friction force, its angle to the soft axis, position.",
    "velocities": "Slip velocities along the soft and the stiff axis: the whole run, and a few periods of the stiff axis.",
    "spectrogram": "Slip velocities and their power density; dashed, the frequency that slow creep predicts.",
    "damping": "Damping ratio of the slow motion against the angle of friction.",
    "creep": "Mean velocity of the first creep against its closed form.",
    "path": "Tip of the friction vector in the plane of the principal axes, coloured by time.",
    "cycle_map": "From release to release: the change of the load and the time of fast cycles, and the iterates of the run.",
    "columns": "The columns of the file.",
}


def report(result: Result, name: str) -> str:
    """HTML page of a run: summary, figures, animation of the friction vector, parameters, statistics, provenance.

    The name is what the run is called, its file for example. The page loads nothing, and its security policy forbids it to.
    """
    pieces = files(__name__)
    title = str(result.parameters.get("title", "")) or name
    page = Template(pieces.joinpath("page.html").read_text(encoding="utf-8"))
    return page.substitute(
        title=escape(title),
        name=escape(name),
        heading=escape(_heading(result)),
        state="complete" if result.complete else "incomplete",
        style=pieces.joinpath("page.css").read_text(encoding="utf-8"),
        summary=_described(result.summary),
        figures="\n".join(_figures(result)) or "<p>Too few samples for a figure.</p>",
        animation=_animation(result, pieces.joinpath("animation.js").read_text(encoding="utf-8")),
        cycles=_cycles(result),
        parameters=_described(result.parameters),
        statistics=_described(result.statistics),
        provenance=table(("", ""), [(key, str(value)) for key, value in result.attributes.items()]),
        deck=escape(result.deck),
        resolved=escape(result.resolved_deck),
    )


def write_report(result: Result, path: str | os.PathLike[str], name: str, *, overwrite: bool = False) -> None:
    """Write the page of `report`; a `FileError` if the file exists, unless it may be overwritten, or cannot be written."""
    text = report(result, name)
    try:
        with Path(path).open("w" if overwrite else "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise FileError(
            f"{os.fspath(path)}: the file exists: use --overwrite or choose another name"
        ) from error
    except OSError as error:
        raise FileError(f"{os.fspath(path)}: cannot be written: {error.strerror or error}") from error


def _heading(result: Result) -> str:
    model, method = (str(result.attributes.get(key, "")) for key in ("model", "method"))
    end = f"{result.time[-1]:g} s" if result.time.size else "no samples"
    irregular = ""
    if result.summary.get("regularity") == -1.0:
        irregular = (
            ". The motion is irregular: its cycles have a distribution, of which means and scatters are told"
        )
    return f"Model {model}, method {method}, {end}, {result.sticks()} sticks{irregular}"


def _described(values: Described[float] | Described[float | str]) -> str:
    return table(("", "value", "unit", ""), rows_of(values)) if values else "<p>None.</p>"


def _figures(result: Result) -> Iterator[str]:
    """Every kind of figure that the run can show; the columns only if it can show no other."""
    drawn = 0
    for kind in plot.KINDS:
        if kind == "columns" and drawn:
            continue
        try:
            picture = _png(plot.draw(result, kind))
        except UsageError:
            continue
        drawn += 1
        yield (
            f'<figure><img alt="{kind}" src="data:image/png;base64,{picture}">'
            f"<figcaption>{escape(CAPTIONS[kind])}</figcaption></figure>"
        )


def _png(figure: Figure) -> str:
    data = io.BytesIO()
    with rendering():
        figure.savefig(data, format="png", dpi=DOTS_PER_INCH)
    return base64.b64encode(data.getvalue()).decode("ascii")


def _cycles(result: Result) -> str:
    try:
        cycles = stick_slip_statistics(result)
    except UsageError:
        return "<p>The file lacks the columns for it: spring_force_x and X.</p>"
    if len(cycles) == 0:
        return (
            "<p>No stick-slip cycle: the spring force never falls by more than 1 % of the static limit.</p>"
        )
    head = [f"{name} [{units}]" if units != "1" else name for name, units in cycles.columns.units.items()]
    values = np.stack([cycles[name] for name in cycles], axis=1)[:MOST_CYCLES]
    rows = [["" if np.isnan(value) else f"{value:.6g}" for value in row] for row in values]
    more = f"<p>The first {MOST_CYCLES} of {len(cycles)}.</p>" if len(cycles) > MOST_CYCLES else ""
    return table(head, rows) + more


def _animation(result: Result, script: str) -> str:
    needed = ("psi", "friction", "spring_force_x", "X")
    if result.time.size < 2 or any(name not in result for name in needed):
        return f"<p>The file lacks the columns for it: {', '.join(needed)}.</p>"
    page = Template(files(__name__).joinpath("animation.html").read_text(encoding="utf-8"))
    return page.substitute(data=json.dumps(_frames(result)), script=script)


def _frames(result: Result) -> dict[str, list[float]]:
    """Means over equal stretches of time: a frame shows no single swing of the fast oscillation."""
    edges = np.linspace(result.time[0], result.time[-1], FRAMES + 1)
    starts = np.unique(np.searchsorted(result.time, edges[:-1]))
    counts = np.diff(np.append(starts, result.time.size))

    def means(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[float]:
        return [float(f"{value:.6g}") for value in np.add.reduceat(values, starts) / counts]

    # Friction acts against the slip.
    return {
        "span": [float(result.time[0]), float(result.time[-1])],
        "time": means(result.time),
        "x": means(-result["friction"] * np.cos(result["psi"])),
        "y": means(-result["friction"] * np.sin(result["psi"])),
        "force": means(result["spring_force_x"]),
        "position": means(1e3 * result["X"]),
    }
