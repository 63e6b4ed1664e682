"""Write the page docs/errors.md as a Fortran module, for `dynstiction help errors`: an installed package has no docs/.

    embed_errors.py PAGE OUTPUT

The build runs this script. Each row of a table becomes a line, with what to do indented below it.
"""

import argparse
import re
import sys
import textwrap
from pathlib import Path

WIDTH = 100
CHUNK = 90
"""Largest number of bytes of a literal: lines of Fortran are short."""

# The generated file uses no module of the core: the build would not see the dependence, and would compile the file too rarely.
HEAD = """!> The page on errors as text. Made by tools/embed_errors.py from docs/errors.md.
module dst_error_page
  implicit none
  private

  public :: error_page

contains

  !> The text of docs/errors.md, for a terminal.
  function error_page() result(text)
    character(:), allocatable :: text
    character(*), parameter :: newline = new_line('a')

    text = ''
"""
TAIL = """  end function error_page
end module dst_error_page
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("page", type=Path, metavar="PAGE")
    parser.add_argument("output", type=Path, metavar="OUTPUT")
    options = parser.parse_args()
    lines = plain(options.page.read_text(encoding="utf-8").split("\n"))
    options.output.write_text(HEAD + "".join(map(statement, lines)) + TAIL, encoding="utf-8")
    return 0


def plain(lines: list[str]) -> list[str]:
    """Lines for a terminal."""
    said: list[str] = []
    paragraph: list[str] = []
    heads: list[str] = []
    for line in [*lines, ""]:
        if line and line[0] not in "|#":
            paragraph.append(without_marks(line))
            continue
        if paragraph:
            said += [*textwrap.wrap(" ".join(paragraph), WIDTH), ""]
            paragraph = []
        if line.startswith("#"):
            said += [without_marks(line.lstrip("# ")).upper(), ""]
        elif line.startswith("|"):
            cells = [without_marks(cell.strip()) for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            if not heads:
                heads = cells
            elif not re.fullmatch(r"[| :-]+", line):
                said += row(heads, cells)
        elif not line and said and said[-1]:
            said.append("")
        if not line.startswith("|"):
            heads = []
    return said[:-1]


def row(heads: list[str], cells: list[str]) -> list[str]:
    """A row of a table: its subject, and the other cells indented."""
    about = (
        cells[0] if heads[0] == "message" or heads[0].startswith("the message") else f"{heads[0]} {cells[0]}"
    )
    lines = textwrap.wrap(about, WIDTH)
    for head, cell in zip(heads[1:], cells[1:], strict=True):
        if cell:
            lines += textwrap.wrap(
                f"{head}: {cell}", WIDTH, initial_indent="    ", subsequent_indent="        "
            )
    return lines


def without_marks(text: str) -> str:
    """Text without the marks of Markdown."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return text.replace("`", "").replace("\\|", "|")


def statement(line: str) -> str:
    """The statement that adds a line."""
    chunks, chunk = [], ""
    for letter in line:
        if len((chunk + letter).encode()) > CHUNK:
            chunks.append(chunk)
            chunk = ""
        chunk += letter
    quoted = ["'" + each.replace("'", "''") + "'" for each in [*chunks, chunk]]
    return "    text = text//" + "// &\n      ".join(quoted) + "//newline\n"


if __name__ == "__main__":
    sys.exit(main())
