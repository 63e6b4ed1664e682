"""Write docs/deck.md, the manual page of the deck's keys, from what `dynstiction keys --json` prints.

    python docs/make_deck_page.py [EXECUTABLE]

It comes from the schema (src/deck/schema.f90), so every key, unit, range and default has one source.
"""

import json
import subprocess
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parent / "deck.md"

INTRODUCTION = """\
# The deck

<!-- Made by docs/make_deck_page.py from `dynstiction keys --json`: change src/deck/schema.f90 or the script, not this page. -->

A deck is a text file of Fortran namelist groups: `&group`, then `key = value` lines, then `/`. Groups and
keys come in any order, in upper or lower case. `!` begins a comment. Text stands in quotes, numbers do not.
Lists are separated by commas; `3*0.0` means three zeros. Units are SI, angles are in degrees.

```
dynstiction template > my.nml     # a deck with every key explained; its values are those of Fig. 3
dynstiction check my.nml          # every key as it will be used, marked user or default; runs nothing
dynstiction run my.nml            # the same checks, then the run
```

A deck with any fault is refused, and all its faults are reported at once ([errors.md](errors.md)).
What passes `check` runs: it also sets the scene up, reads a list of points, and compares what will be written with the
room on the disk of the output: `samples × columns × 8 bytes` of a run with `interval` > 0, and a sweep's cases
([sweeps.md](sweeps.md)). With `wall_limit` the room is not compared: such a run writes what it computes until then.
A key without default must be given where it is used. A key that the chosen model, law, contact or method does
not use is refused, unless its value is the one that switches it off (the default, or 0 for `step` and
`v_smooth`). `--set group.key=value` on the command line replaces a value of the deck; text needs no
quotes there. The resolved deck is kept in the result file (`/deck/resolved`), beside the deck as it was
read (`/deck/text`).
"""

KINDS = {"reals": "list of reals", "texts": "list of texts"}


def main() -> None:
    executable = sys.argv[1] if len(sys.argv) > 1 else "dynstiction"
    # Numbers stay as the schema writes them.
    said = subprocess.run([executable, "keys", "--json"], capture_output=True, text=True, check=True).stdout
    keys = json.loads(said, parse_int=str, parse_float=str)["keys"]
    models = next(key["choices"] for key in keys if key["name"] == "model")
    parts = [INTRODUCTION]
    for group, found in groupby(keys, key=lambda key: key["group"]):
        lines = [
            f"## &{group}",
            "",
            "| key | meaning | values | unit | default |",
            "| --- | --- | --- | --- | --- |",
            *(row(key, models) for key in found),
            "",
        ]
        parts.append("\n".join(lines))
    PAGE.write_text("\n".join(parts), encoding="utf-8")


def row(key: dict[str, Any], models: list[str]) -> str:
    meaning = key["meaning"].replace("|w|", "abs(w)").replace("|", r"\|").replace("*", r"\*")
    conditions = {} if key["models"] == models else {"model": key["models"]}
    conditions |= {name: choices for name, choices in key["used_by"].items() if name != "model"}
    if conditions:
        needed = (f"{name} {' or '.join(choices)}" for name, choices in conditions.items())
        meaning += "; only with " + " and ".join(needed)
    values = ", ".join(map(code, key["choices"])) or KINDS.get(key["kind"], key["kind"])
    if key["choices"] and key["kind"] == "texts":
        values = "list of " + values
    if key["range"]:
        values += f", {key['range']}"
    default = None if key["required"] else key["default"]
    if default is not None and key["kind"] in ("text", "texts", "choice"):
        default = f"'{default}'"
    units = key["units"] if key["units"] != "1" else ""
    return f"| {code(key['name'])} | {meaning} | {values} | {units} | {'(none)' if default is None else code(default)} |"


def code(word: str) -> str:
    return f"`{word}`"


if __name__ == "__main__":
    main()
