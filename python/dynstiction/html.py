"""Small pieces of HTML for notebooks and for the report: escaped text, tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


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
