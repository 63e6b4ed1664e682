"""Write docs/command_line.md and docs/deck.md from what `dynstiction template --json` prints, and from Python's table of commands.

    python docs/make_pages.py [EXECUTABLE]

It comes from src/app/command_table.f90, python/dynstiction/_commands.py and src/deck/schema.f90, so every command, key, unit, range
and default has one source.
"""

import argparse
import json
import subprocess
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent / "tools"))
from man_page import all_commands  # noqa: E402

COMMAND_LINE = """\
# The command line

<!-- Made by docs/make_pages.py: change src/app/command_table.f90, python/dynstiction/_commands.py or the script, not this page. -->

Options follow what a heading shows: `dynstiction help COMMAND` explains those of a command, and the manual page (`man dynstiction`) all of them. Exit statuses: [errors.md](errors.md).
Commands marked *Python* are carried out by the Python package, also as `python -m dynstiction COMMAND`; the executable hands them to
the interpreter of the environment variable `DYNSTICTION_PYTHON`, else to that in its own folder, else to that of `PATH`.

For other programs, `dynstiction template --json` prints all names of the executable and of its results as one JSON object: `version`, `program`, and the lists
`commands`, `options`, `exit_statuses`, `keys` of decks, and `columns`, `summary` and `statistics` of results. `times` of an option is `?` (at most once), `1` or `*`;
a `default` of a key is `null` if there is none; `used_by` of a key are other keys, with those of their choices that use it.
"""

DECK = """\
# The deck

<!-- Made by docs/make_pages.py from `dynstiction template --json`: change src/deck/schema.f90 or the script, not this page. -->

A deck is a text file of Fortran namelist groups: `&group`, then `key = value` lines, then `/`. Groups and
keys come in any order, in upper or lower case. `!` begins a comment. Text is in quotes, numbers are not.
The values of a list are separated by commas; `3*0.0` means three zeros. Units are SI, angles are in degrees.

`dynstiction template` prints a deck with every key explained, `check` one with every key as it will be used.

* A deck with any fault is refused, and all its faults are reported at once ([errors.md](errors.md)). A deck that passes `check` runs: the size of the results (`samples × columns × 8 bytes`; of a [sweep](sweeps.md) its cases)
  is compared with the free space on the disk, unless `wall_limit` is given.
* A key without default must be given if it is used. A key that the chosen model, law, contact or method does
  not use is refused, unless its value is the one that switches it off (the default, or 0 for `step` and `v_smooth`).
* `--set group.key=value` on the command line replaces a value of the deck; text needs no quotes there. If a setting makes a key of the deck useless, the key
  is left out with a note.
* `cycle_map` and `settle`: [the cycle map](cycle_map.md).
* `interval = 'auto'` gives at least 10 samples in a period of the fast oscillation, 2π/√(k_y/m), if the model has it, 100 in a period of the slow oscillation,
  2π/√(k_x/m), and 1000 in a run; for creep in closed form, 500 in the time in which the drive loads the soft spring to the static limit. A run has at most 10⁶
  samples: if these do not show the fast oscillation, `check` and `run` print a note. In a sweep with `keep = 'series'` it follows from the deck itself and is the same in all cases.
* The column `pull_force` is k_x u_x cos φ + k_y u_y sin φ, plus the force of dampers, positive if it pulls the object along X. `theta_deg` is `theta` in degrees; `u_x_rate` = V cos φ − w_x and
  `u_y_rate` = V sin φ − w_y (v_x, v_y in the preprint) are written if `fields` names them.

A range without a type is of a real number. The column *of* below names the models that use a key, if not all do: F `full`, L `low_frequency`, H `high_frequency`, C `creep`, A `creep_asymptotic`. `auto` uses what
`full` uses.
"""

KINDS = {"reals": "list of reals", "texts": "list of texts"}
LETTERS = {"full": "F", "low_frequency": "L", "high_frequency": "H", "creep": "C", "creep_asymptotic": "A"}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("executable", nargs="?", default="dynstiction", help="default: the one on PATH")
    executable = parser.parse_args().executable
    said = subprocess.run(
        [executable, "template", "--json"], capture_output=True, text=True, check=True
    ).stdout
    # Numbers stay as the program writes them.
    catalogue = json.loads(said, parse_int=str, parse_float=str)
    for name, parts in (("command_line", command_line(catalogue)), ("deck", deck(catalogue["keys"]))):
        (FOLDER / f"{name}.md").write_text("\n".join(parts), encoding="utf-8")


def command_line(catalogue: dict[str, Any]) -> list[str]:
    parts = [COMMAND_LINE]
    for command in all_commands(catalogue):
        heading = " ".join(
            [f"## {command['name']}", *command["operands"].split(), *["(Python)"] * command["is_python"]]
        )
        parts += [
            f"{heading}\n",
            command["meaning"].replace("*", r"\*") + "\n",
            *examples(command["examples"]),
        ]
    return parts


def examples(text: str) -> list[str]:
    """Those that show more than the heading."""
    telling = [line for line in text.splitlines() if " -" in line]
    return [block("\n".join(telling))] if telling else []


def deck(keys: list[dict[str, Any]]) -> list[str]:
    models = next(key["choices"] for key in keys if key["name"] == "model")
    parts = [DECK]
    for group, found in groupby(keys, key=lambda key: key["group"]):
        head = ("key", "meaning", "values", "of", "default")
        parts += [f"## &{group}\n", table(head, [row(key, models) for key in found])]
    return parts


def row(key: dict[str, Any], models: list[str]) -> tuple[str, ...]:
    meaning = key["meaning"].replace("|w|", "abs(w)").replace("|", r"\|").replace("*", r"\*")
    for name, choices in key["used_by"].items():
        if name != "model":
            meaning += f"; with {name} {', '.join(choices)}"
    values = ", ".join(map(code, key["choices"])) or KINDS.get(key["kind"], key["kind"])
    if key["choices"] and key["kind"] == "texts":
        values = "list of " + values
    if key["range"]:
        values = key["range"] if key["kind"] == "real" else f"{values}, {key['range']}"
    if key["units"] not in ("", "1"):
        values += f" [{key['units']}]"
    of = (
        ""
        if key["models"] == models
        else "".join(LETTERS.get(model, "") for model in key["models"]) or "`auto`"
    )
    default = None if key["required"] else key["default"]
    if default is not None and key["kind"] in ("text", "texts", "choice"):
        default = f"'{default}'"
    return code(key["name"]), meaning, values, of, "" if default is None else code(default)


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def code(word: str) -> str:
    return f"`{word}`".replace("|", r"\|")


def block(text: str) -> str:
    return f"```none\n{text}\n```\n"


if __name__ == "__main__":
    main()
