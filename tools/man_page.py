"""Write the manual page dynstiction.1 from what `dynstiction template --json` prints, and from Python's table of commands.

    python tools/man_page.py PROGRAM OUTPUT

The build runs this script.
"""

from __future__ import annotations

import argparse
import json
import runpy
import subprocess
from itertools import groupby
from pathlib import Path
from typing import Any

# A file of its own, because the package needs the compiled core.
TABLE_OF_PYTHON = Path(__file__).resolve().parents[1] / "python" / "dynstiction" / "_commands.py"

ABOUT = """\
.B dynstiction
computes the motion of a mass on two springs, a soft and a stiff one, that is pulled over a floor with friction: slow creep,
stick-slip and steady sliding, after Nakano and Popov, Phys. Rev. E 102, 063001 (2020).
It reads a deck and writes an HDF5 file.
"""
BY_PYTHON = """\
The Python package carries out this command, with the interpreter
.BR DYNSTICTION_PYTHON ,
else the python3 in the folder of the executable, else that of PATH.
"""
FILES = """\
.TP
.I FILE.h5
The results: time series, events, summary, statistics, every parameter, and the deck.
.TP
.I FILE.h5.part
The file while a process writes it.
"""


def main(program: str, output: Path) -> None:
    said = subprocess.run([program, "template", "--json"], capture_output=True, text=True, check=True).stdout
    # Numbers stay as the program writes them.
    catalogue = json.loads(said, parse_int=str, parse_float=str)
    about = catalogue["program"]
    statuses = [(entry["status"], entry["meaning"]) for entry in catalogue["exit_statuses"]]
    parts = [
        f'.TH DYNSTICTION 1 "" "dynstiction {catalogue["version"]}" "User Commands"\n',
        ".SH NAME\ndynstiction \\- dynamic stiction by rotation of the friction vector\n",
        ".SH SYNOPSIS\n.B dynstiction\n.I COMMAND\n[...]\n.P\n.B dynstiction\n\\-\\-version | \\-\\-help\n",
        ".SH DESCRIPTION\n" + ABOUT + ".P\n" + line(about["meaning"]) + verbatim(about["examples"]),
        ".SH COMMANDS\n",
        *map(describe, all_commands(catalogue)),
        ".SH DECK\nGroups and keys in any order; a key with a default may be left out.\n",
    ]
    for group, keys in groupby(catalogue["keys"], key=lambda key: key["group"]):
        parts += [f'.SS "&{escape(group)}"\n', entries([(key["name"], explain(key)) for key in keys])]
    parts += [".SH EXIT STATUS\n", entries(statuses), ".SH FILES\n", FILES, ".SH SEE ALSO\n.BR h5dump (1)\n"]
    output.write_text("".join(parts), encoding="utf-8")


def all_commands(catalogue: dict[str, Any]) -> list[dict[str, Any]]:
    """The commands of the executable and of Python, each with its options as pairs of name and meaning."""
    own = [
        {
            **command,
            "is_python": False,
            "options": [
                (f"{option['name']} {option['argument']}".strip(), option["meaning"])
                for option in catalogue["options"]
                if command["name"] in option["commands"]
            ],
        }
        for command in catalogue["commands"]
    ]
    return own + [
        {**command, "is_python": True} for command in runpy.run_path(str(TABLE_OF_PYTHON))["described"]()
    ]


def describe(command: dict[str, Any]) -> str:
    """A subsection: usage, meaning, options, examples."""
    parts = [
        f'.SS "{escape(command["name"])}"\n',
        verbatim(command["usage"]),
        ".P\n",
        line(command["meaning"]),
        BY_PYTHON if command["is_python"] else "",
        entries(command["options"]),
        ".P\nExamples:\n",
        verbatim(command["examples"]),
    ]
    return "".join(parts)


def explain(key: dict[str, Any]) -> str:
    """Meaning, condition, kind, unit, range or choices, and default of a key."""
    needed = (f"{name} {' | '.join(choices)}" for name, choices in key["used_by"].items())
    condition = "; only with " + " and ".join(needed) if key["used_by"] else ""
    units = key["units"] if key["units"] != "1" else ""
    details = [" | ".join(key["choices"]) or key["kind"], units, key["range"]]
    default = (
        "no default" if key["required"] or key["default"] is None else f"default {key['default'] or 'empty'}"
    )
    return f"{key['meaning']}{condition}.\n{', '.join(filter(None, details))}; {default}."


def entries(rows: list[tuple[str, str]]) -> str:
    """Words in bold, each with its meaning; its lines are kept."""
    return "".join(
        f".TP\n.B {escape(word)}\n" + ".br\n".join(map(line, text.split("\n"))) for word, text in rows
    )


def verbatim(text: str) -> str:
    return ".P\n.EX\n" + "".join(map(line, text.split("\n"))) + ".EE\n"


def line(text: str) -> str:
    """A line of text; a full stop or a quote at its begin is escaped, because it would start a request."""
    return ("\\&" if text.startswith((".", "'")) else "") + escape(text) + "\n"


def escape(text: str) -> str:
    return text.replace("\\", "\\e").replace("-", "\\-")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("program", help="the executable dynstiction")
    parser.add_argument("output", type=Path)
    arguments = parser.parse_args()
    main(arguments.program, arguments.output)
