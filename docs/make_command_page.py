"""Write docs/command_line.md, the manual page of the command line, from what `dynstiction keys --json` prints.

    python docs/make_command_page.py [EXECUTABLE]
"""

import json
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parent / "command_line.md"

INTRODUCTION = """\
# The command line

<!-- Made by docs/make_command_page.py from `dynstiction keys --json`: change src/app/command_table.f90 or the script, not this page. -->

Every command explains itself with `--help`. Exit statuses and messages: [errors.md](errors.md). Commands marked *Python* are
carried out by the Python package, also as `python -m dynstiction COMMAND`; the executable finds the interpreter by the environment
variable `DYNSTICTION_PYTHON`, else beside itself, else in `PATH`.

## For other programs

`dynstiction keys --json` prints one JSON object with all that has a name:

| member | is a list of |
| --- | --- |
| `commands` | `name`, `by` (`dynstiction` or `Python`), `operands`, `brief`, `meaning`, `usage`, names of `options`, `examples` (one a line) |
| `options` | `name`, `argument`, `commands` that take it, `times` (`?` at most once, `1` once, `*` any number), `meaning`; an entry for each kind of argument |
| `exit_statuses` | `status`, `meaning` |
| `keys` | of decks: `group`, `name`, `kind` (`real`, `integer`, `text`, `choice`, `reals`, `texts`), `required`, `units`, `range`, `choices`, `default` (`null`: none), `models` with which it may be used, `used_by` (key: those of its choices that use this one), `meaning` |
| `columns`, `summary`, `statistics` | of results: `name`, `units`, `long_name` |

Besides these there are `version`, and `program` with what the help says of it.

## Commands
"""


def main() -> None:
    executable = sys.argv[1] if len(sys.argv) > 1 else "dynstiction"
    said = subprocess.run([executable, "keys", "--json"], capture_output=True, text=True, check=True).stdout
    catalogue = json.loads(said)
    parts = [INTRODUCTION, table(("command", "meaning", "by"), [(code(c["name"]), c["brief"], c["by"]) for c in catalogue["commands"]])]
    for command in catalogue["commands"]:
        taken = [option for option in catalogue["options"] if command["name"] in option["commands"]]
        rows = [(code(f"{o['name']} {o['argument']}".strip()), o["meaning"]) for o in taken]
        parts += [
            f"## {command['name']}{' (Python)' if command['by'] == 'Python' else ''}\n",
            block(command["usage"]),
            command["meaning"].replace("*", r"\*") + "\n",
            *([table(("option", "meaning"), rows)] if rows else []),
            block(command["examples"]),
        ]
    statuses = [(str(s["status"]), s["meaning"]) for s in catalogue["exit_statuses"]]
    parts += ["## Exit statuses\n", table(("status", "meaning"), statuses)]
    PAGE.write_text("\n".join(parts), encoding="utf-8")


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def code(word: str) -> str:
    return f"`{word}`".replace("|", r"\|")


def block(text: str) -> str:
    return f"```none\n{text}\n```\n"


if __name__ == "__main__":
    main()
