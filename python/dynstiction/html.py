"""Tables for terminals; small pieces of HTML for notebooks and for the report: escaped text, tables, lines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

__all__ = ["aligned", "page_table", "sparkline", "table"]

SPARKLINE = (220, 28)
"""Width and height [px]."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Table of texts, which are escaped."""
    top = "".join(f"<th style='text-align:left'>{escape(name)}</th>" for name in head)
    body = "".join(
        "<tr>" + "".join(f"<td style='text-align:left'>{escape(cell)}</td>" for cell in row) + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def page_table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], fault: str = "") -> str:
    """A table with a title for a notebook, and an error message above it."""
    warning = f"<pre style='color:#b00020'>{escape(fault)}</pre>" if fault else ""
    return f"<div><b>{escape(title)}</b>{warning}{table(head, rows) if rows else ''}</div>"


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table for a terminal: the first column begins, the others end below each other."""
    first, *others = (max(map(len, column)) for column in zip(*rows, strict=True))
    return ["  ".join([row[0].ljust(first), *map(str.rjust, row[1:], others)]).rstrip() for row in rows]


def sparkline(time: NDArray[np.float64], values: NDArray[np.float64]) -> str:
    """A line without axes, as inline SVG in the colour of the surrounding text."""
    width, height = SPARKLINE
    span = float(time[-1] - time[0]) or 1.0
    low, high = float(np.min(values)), float(np.max(values))
    x = 1.0 + (width - 2) * (time - time[0]) / span
    y = height - 2.0 - (height - 4) * (values - low) / ((high - low) or 1.0)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return (
        f"<svg width='{width}' height='{height}' viewBox='0 0 {width} {height}' role='img'>"
        f"<polyline points='{points}' fill='none' stroke='currentColor' stroke-width='1'/></svg>"
    )
