"""One HTML page with the content of a result file, or with a fit; it needs neither network nor other files."""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from html import escape
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import plot
from .._output import put
from ..errors import Error, UsageError
from ..html import table
from ..plot.style import image_of
from ..plot.traces import FIRST
from ..plot.view import view_of
from ..record import Described, headed, number_shown, rows_of, unit_shown
from ..result import Result
from ..scene import Scene
from ..stick_slip import stick_slip_statistics
from ..trace_fit import verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..trace_fit import Fit


DOTS_PER_INCH = 220
"""Resolution for screens with two dots for each pixel."""

HEAD = ("", "value", "unit", "")
"""Of a table of names, values, units and meanings."""

KEY = re.compile(r"^(?:&|  )(\w+)(?: = .*? +! (\w+)(?:, ([^;\n]*))?; ([^\n]*))?$", re.MULTILINE | re.DOTALL)
"""A group of the resolved deck, or a key: its name, source (user or default), unit and meaning."""

MOST_CYCLES = 50
"""Largest number of rows in the table of cycles."""

MOST_VALUES = 12
"""Largest number of values of a list that are shown."""

CAPTIONS = {
    "history": "Spring forces along the soft and the stiff axis, friction force, its angle to the soft axis, position.",
    "velocities": "Slip velocities along the soft and the stiff axis, and a few periods of the stiff axis enlarged.",
    "spectrogram": "Slip velocities and their power density; dashed, the frequency that slow creep predicts.",
    "damping": "Damping ratio of the slow motion against the angle of friction.",
    "creep": "Mean velocity of the first creep, compared with its closed form.",
    "path": "Tip of the friction vector in the plane of the principal axes, coloured by time.",
    "columns": "The columns of the file.",
}

STRETCHES = 10
"""Largest number of figures over time that together show a trace."""

FIT_CAPTIONS = {
    "time": "Force of the first cycles, what the fit makes of each, and the difference; dotted, two standard deviations of the noise.",
    "waveform": "Mean of the cycles and that of the fit, over a cycle and around the slip, and the residuals over their errors.",
    "cycles": "Residuals of each cycle over their errors; periods and peaks of the trace, and of a run with the fitted values.",
}
"""Figures of each trace of a fit."""


def report(result: Result, name: str) -> str:
    """HTML page of a run: summary, figures, parameters, statistics, provenance.

    The name identifies the run, for example by its file. The page loads nothing, and its security policy does not allow it.
    """
    sections = {
        "What was set": _given(result),
        "Summary": _described(result.summary),
        "Figures": _samples(result) + _figures(result),
        "Stick-slip cycles": _cycles(result),
        "Every parameter": _described(result.parameters),
        "Work done by the solver": _described(result.statistics),
        "Provenance": table(("", ""), [(key, str(value)) for key, value in result.attributes.items()]),
        "Deck": f"<pre>{escape(result.deck)}</pre>"
        + _folded("every key as used", f"<pre>{escape(result.resolved_deck)}</pre>"),
    }
    title = str(result.parameters.get("title", "")) or name
    return _page(title, name, _heading(result), "complete" if result.complete else "incomplete", sections)


def fit_report(fit: Fit) -> str:
    """HTML page of a fit: what it says, parameters, every figure, and the traces beside runs with its values."""
    explains, words = verdict(fit)
    names = [each.trace.name for each in fit.traces]
    rows = []
    for one in fit.parameters.values():
        low, high = fit.interval(one.name)
        values = (one.value, one.error, low, high) if one.told else ()
        texts = [f"{value:.6g}" for value in values] or ["not determined", "", "", ""]
        rows.append((one.name, *texts, unit_shown(one.unit)))
    sections = {
        "Parameters": table(("", "value", "standard error", "from", "to (95 %)", "unit"), rows)
        + f"<pre>{escape(words)}\n{escape(str(fit))}</pre>"
    }
    for k, each in enumerate(fit.traces):
        figures = [_figure(fit.plot(kind, trace=k), kind, caption) for kind, caption in FIT_CAPTIONS.items()]
        text = ""
        with suppress(Error):
            text = f"<pre>{escape(each.comparison.report())}</pre>"
        wave, stretches = each.waveform, []
        for part in np.array_split(wave.slips, min(STRETCHES, -(-wave.slips.size // FIRST))):
            ends = float(part[0] + wave.edges[0]), float(part[-1] + wave.edges[-1])
            figure = fit.plot("time", trace=k, start=ends[0], end=ends[1])
            stretches.append(_figure(figure, "time", f"From {ends[0]:.4g} to {ends[1]:.4g} s."))
        text += _folded("Every cycle over time", f'<div class="figures">{"".join(stretches)}</div>')
        title = f"Trace {k + 1}: {escape(names[k])}"
        sections[title] = f'<div class="figures">{"".join(figures)}</div>{text}'
    corner = _figure(
        fit.plot("corner"), "corner", "The parameters two by two, with one and two standard errors."
    )
    sections["All parameters together"] = f'<div class="figures">{corner}</div>'
    sections["The fitted deck"] = f"<pre>{escape(fit.scene.to_deck())}</pre>"
    heading = f"{fit.scene.name} fitted to {len(names)} traces, {sum(len(each.waveform.rows) for each in fit.traces)} cycles"
    state = "explains" if explains else "does not explain"
    return _page(f"Fit to {names[0]}", ", ".join(names), heading, state, sections)


def _page(title: str, name: str, heading: str, state: str, sections: Mapping[str, str]) -> str:
    page = Template(files(__name__).joinpath("page.html").read_text(encoding="utf-8"))
    return page.substitute(
        title=escape(title),
        name=escape(name),
        heading=escape(heading),
        state=state,
        good="complete" if state in ("complete", "explains") else "incomplete",
        sections="\n".join(f"<section><h2>{title}</h2>{body}</section>" for title, body in sections.items()),
    )


def _figure(figure: Figure, kind: str, caption: str) -> str:
    data = base64.b64encode(image_of(figure, "png", DOTS_PER_INCH)).decode("ascii")
    return f'<figure><img alt="{kind}: {caption}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'


def _folded(title: str, content: str) -> str:
    return f"<details><summary>{title}</summary>{content}</details>"


def write_report(result: Result, path: str | os.PathLike[str], name: str, *, overwrite: bool = False) -> None:
    """Write the page of `report`. A `FileError` is raised if the file cannot be written, or exists and may not be overwritten."""
    text = report(result, name)
    put(path, text.encode(), overwrite=overwrite)


def _heading(result: Result) -> str:
    model, method = (str(result.attributes.get(key, "")) for key in ("model", "method"))
    end = f"{result.time[-1]:g} s" if result.time.size else "no samples"
    about = f"Model {model}, method {method}, {end}, the object came to rest {result.sticks()} times"
    if result.summary.get("regularity") == -1.0:
        about += (
            ". The motion is irregular: its cycles have a distribution; the page shows its means and scatters"
        )
    return about


def _given(result: Result) -> str:
    """Keys that the user has set, in the deck or by settings, which the resolved deck marks, with the values used."""
    rows, group = [], ""
    try:
        values = Scene(result.resolved_deck).groups()
    except Error:
        values = {}
    for name, source, units, meaning in KEY.findall(result.resolved_deck if values else ""):
        if not source:
            group = name
        elif source == "user" and name in values.get(group, {}):
            rows.append((f"{group}.{name}", _shown(values[group][name]), units, meaning))
    return table(HEAD, rows) if rows else "<p>The file does not contain the deck.</p>"


def _shown(value: Any) -> str:
    """A value in six digits; a list with commas."""
    if isinstance(value, str) or not np.ndim(value):
        return number_shown(value)
    values = np.ravel(np.asarray(value)).tolist()
    more = f", … ({len(values)} values)" if len(values) > MOST_VALUES else ""
    return ", ".join(_shown(each) for each in values[:MOST_VALUES]) + more


def _described(values: Described[float] | Described[float | str]) -> str:
    return table(HEAD, rows_of(values, 6)) if values else "<p>None.</p>"


def _samples(result: Result) -> str:
    """A note if the samples do not show the oscillation, or figures show only a part of the run."""
    try:
        notes = view_of(result).notes
    except UsageError:
        return ""
    kind = ' class="caution"' if plot.coarseness(result) else ""
    return f"<p{kind}>In the figures: {escape('; '.join(notes))}.</p>" if notes else ""


def _figures(result: Result) -> str:
    """All kinds of figure that the run can show, the columns only if there is no other; and why it cannot show the others."""
    drawn: list[str] = []
    missing: list[str] = []
    for kind, caption in CAPTIONS.items():
        if kind == "columns" and drawn:
            continue
        try:
            drawn.append(_figure(plot.draw(result, kind), kind, caption))
        except UsageError as error:
            missing.append(f"<li><b>{kind}</b>: {escape(str(error))}</li>")
    why = f"<p>Figures that this run does not have, and why:</p><ul>{''.join(missing)}</ul>"
    figures = "".join(drawn) or "<p>Too few samples for a figure.</p>"
    return f'<div class="figures">{figures}</div>' + (why if missing else "")


def _cycles(result: Result) -> str:
    try:
        cycles = stick_slip_statistics(result)
    except UsageError:
        return "<p>The file lacks the columns for it: spring_force_x and X.</p>"
    if len(cycles) == 0:
        return (
            "<p>No stick-slip cycle: the spring force never falls by more than 1 % of the static limit.</p>"
        )
    means, scatter = cycles.means(), cycles.scatter()
    if means:
        rows = [
            (
                name,
                number_shown(value),
                number_shown(scatter.get(name, ""), 2),
                unit_shown(units),
                meaning,
            )
            for (name, units, meaning), value in means.info()
        ]
        settled = f"<p>Settled cycles, of {len(cycles)} slips:</p>"
        settled += table(("", "mean", "standard deviation", "unit", ""), rows)
    else:
        settled = f"<p>{len(cycles)} slips; no cycles persist, so there are no means.</p>"
    head = [headed(name, units) for name, units in cycles.columns.units.items()]
    values = np.stack([cycles[name] for name in cycles], axis=1)[:MOST_CYCLES]
    cells = [["" if np.isnan(value) else f"{value:.6g}" for value in row] for row in values]
    more = f"<p>The first {MOST_CYCLES} of {len(cycles)}.</p>" if len(cycles) > MOST_CYCLES else ""
    return settled + _folded("Every cycle", table(head, cells) + more)
