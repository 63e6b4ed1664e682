"""Run what a page of the manual shows.

Blocks ``sh`` and ``python`` are executed in their order, in one folder; the Python blocks of a page share their names. A ``text``
block right after one is what it prints, held loosely: numbers to 2 %, `…` stands for anything, other lines may come in
between. Blocks ``console`` are shown only.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from programs import ROOT

DOCS = ROOT / "docs"
TOLERANCE = 0.02


@dataclass
class Block:
    kind: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(found[1], found[2], text.count("\n", 0, found.start()) + 1)
        for found in re.finditer(r"^```(\w+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    ]


def run_page(page: Path, folder: Path, environment: dict[str, str]) -> int:
    """Execute the page's blocks in `folder`; the number of blocks run. A failure names page and line."""
    names: dict[str, Any] = {}
    found = blocks(page)
    count = 0
    for index, block in enumerate(found):
        if block.kind not in ("sh", "python"):
            continue
        count += 1
        place = f"{page.name}:{block.line}"
        printed = run_shell(block, folder, environment, place) if block.kind == "sh" else run_python(block, folder, names)
        shown = found[index + 1] if index + 1 < len(found) else None
        if shown and shown.kind == "text":
            missing = first_missing(shown.text, printed)
            assert missing is None, f"{place}: does not print {missing!r} but\n{printed}"
    return count


def run_shell(block: Block, folder: Path, environment: dict[str, str], place: str) -> str:
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block.text],
        cwd=folder, env={**os.environ, **environment}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{place}: status {done.returncode}\n{done.stdout}"
    return done.stdout


def run_python(block: Block, folder: Path, names: dict[str, Any]) -> str:
    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        exec(compile(block.text, f"block at line {block.line}", "exec"), names)
    return printed.getvalue()


def first_missing(shown: str, printed: str) -> str | None:
    """The first line of `shown` that `printed` does not hold, after the lines before it."""
    lines = iter(printed.splitlines())
    for expected in shown.splitlines():
        if expected.strip() not in ("", "…") and not any(alike(expected, line) for line in lines):
            return expected
    return None


def alike(expected: str, line: str) -> bool:
    wanted, given = expected.split(), line.split()
    if "…" in wanted:
        wanted = wanted[: wanted.index("…")]
        given = given[: len(wanted)]
    return len(wanted) == len(given) and all(map(same_word, wanted, given))


def same_word(expected: str, word: str) -> bool:
    if expected == word:
        return True
    try:
        number, other = (float(text.rstrip(",:;)")) for text in (expected, word))
    except ValueError:
        return False
    return abs(number - other) <= TOLERANCE * abs(number)
