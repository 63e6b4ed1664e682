"""Write the manual page dynstiction.1 from what the program says itself: its help, and its keys.

Usage: man_page.py PROGRAM OUTPUT
"""

from __future__ import annotations

import re
import subprocess
import sys
from itertools import groupby
from pathlib import Path

ABOUT = """\
.B dynstiction
follows a mass on two springs, a soft and a stiff one, that is pulled over a floor with friction: slow creep, stick-slip and steady
sliding, after Nakano and Popov, Phys. Rev. E 102, 063001 (2020).
It reads a deck and writes an HDF5 file.
"""
FILES = """\
.TP
.I FILE.h5
The results: time series, events, summary, statistics, every parameter, and the deck.
.TP
.I FILE.h5.checkpoint
The state of a run that is not complete; removed at its end.
"""
SEE_ALSO = """\
.BR h5dump (1)
.P
Figures of a result file:
.B python \\-m dynstiction plot
.I FILE.h5
"""
OPTION = re.compile(r"^  (-.*?)(?:   *(\S.*))?$")


def main(program: str, output: Path) -> None:
    overview = said_by(program, "--help")
    commands = re.findall(r"^dynstiction ([a-z]+)", "\n".join(usage_lines(overview)), re.MULTILINE)
    version = said_by(program, "--version").split()[1]
    parts = [
        f'.TH DYNSTICTION 1 "" "dynstiction {version}" "User Commands"\n',
        ".SH NAME\ndynstiction \\- dynamic stiction by rotation of the friction vector\n",
        ".SH SYNOPSIS\n" + verbatim(usage_lines(overview)),
        ".SH DESCRIPTION\n" + ABOUT + describe_rest(overview),
        ".SH COMMANDS\n"
        + "".join(describe_command(said_by(program, name, "--help"), name) for name in commands),
        ".SH DECK\n" + describe_keys(said_by(program, "keys")),
        ".SH EXIT STATUS\n" + describe_status(overview),
        ".SH FILES\n" + FILES,
        ".SH SEE ALSO\n" + SEE_ALSO,
    ]
    output.write_text("".join(parts), encoding="utf-8")


def said_by(program: str, *arguments: str) -> str:
    return subprocess.run([program, *arguments], capture_output=True, text=True, check=True).stdout


def usage_lines(overview: str) -> list[str]:
    """The lines below 'Usage:', without what they mean."""
    lines = overview.partition("Usage:\n")[2].partition("\n\n")[0].splitlines()
    return [re.split(r"   +", line.strip())[0] for line in lines]


def describe_rest(overview: str) -> str:
    """The paragraphs of the overview after the usage; indented lines are commands."""
    paragraphs = overview.partition("Usage:\n")[2].partition("\n\nExit status:")[0].split("\n\n")[1:]
    parts = []
    for paragraph in paragraphs:
        for indented, lines in groupby(paragraph.splitlines(), key=lambda line: line.startswith("  ")):
            stripped = [line.strip() for line in lines]
            parts.append(verbatim(stripped) if indented else ".P\n" + prose("\n".join(stripped)))
    return "".join(parts)


def describe_command(text: str, name: str) -> str:
    """A subsection from the help on one command: usage, what it does, options, examples."""
    paragraphs = text.partition("\nExit status:")[0].strip().split("\n\n")
    usage = paragraphs[0].removeprefix("Usage: ").splitlines()
    parts = [f'.SS "{escape(name)}"\n', verbatim([usage[0], *(line.rstrip() for line in usage[1:])])]
    for paragraph in paragraphs[1:]:
        lines = paragraph.splitlines()
        if OPTION.match(lines[0]):
            parts.append(describe_options(lines))
        elif re.match(r"Examples?:$", lines[0]):
            parts.append(".P\n" + escape(lines[0]) + "\n" + verbatim([line.strip() for line in lines[1:]]))
        else:
            parts.append(".P\n" + prose(paragraph))
    return "".join(parts)


def describe_options(lines: list[str]) -> str:
    """Option and meaning of each, a meaning over several lines joined."""
    entries: list[list[str]] = []
    for line in lines:
        if found := OPTION.match(line):
            entries.append([found[1], found[2] or ""])
        else:
            entries[-1][1] += " " + line.strip()
    return "".join(f".TP\n.B {escape(option)}\n{prose(meaning)}" for option, meaning in entries)


def describe_keys(table: str) -> str:
    parts = ["Groups and keys in any order; a key with a default may be left out.\n"]
    rows = [line.split("\t") for line in table.splitlines()]
    for group, keys in groupby(rows, key=lambda row: row[0].partition(".")[0]):
        parts.append(f'.SS "&{escape(group)}"\n')
        for name, kind, meaning in keys:
            parts.append(
                f".TP\n.B {escape(name.partition('.')[2])}\n{prose(meaning + '.')}.br\n{prose(kind)}"
            )
    return "".join(parts)


def describe_status(overview: str) -> str:
    lines = overview.partition("Exit status:\n")[2].strip().splitlines()
    entries = [line.split(maxsplit=1) for line in lines]
    return "".join(f".TP\n.B {code}\n{prose(meaning)}" for code, meaning in entries)


def verbatim(lines: list[str]) -> str:
    return ".P\n.EX\n" + "".join(f"{protect(escape(line))}\n" for line in lines) + ".EE\n"


def prose(text: str) -> str:
    return "".join(f"{protect(escape(line))}\n" for line in text.splitlines())


def protect(line: str) -> str:
    """A full stop or a quote that begins a line would begin a request."""
    return "\\&" + line if line.startswith((".", "'")) else line


def escape(text: str) -> str:
    return text.replace("\\", "\\e").replace("-", "\\-")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
