"""Write docs/deck.md, the manual page of the deck's keys, from what `dynstiction template` prints.

    python docs/make_deck_page.py [EXECUTABLE]

The template comes from the schema (src/deck/schema.f90), so every key, unit, range and default has one source.
"""

import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

PAGE = Path(__file__).resolve().parent / "deck.md"

INTRODUCTION = """\
# The deck

<!-- Made by docs/make_deck_page.py from `dynstiction template`: change src/deck/schema.f90 or the script, not this page. -->

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

MODELS = ("full", "low_frequency", "high_frequency", "creep", "creep_asymptotic", "auto")
KINDS = {"real": "real", "list of reals": "reals", "integer": "integer", "text": "text"}


class Key(NamedTuple):
    name: str
    meaning: str
    condition: str
    values: str
    unit: str
    default: str


def main() -> None:
    executable = sys.argv[1] if len(sys.argv) > 1 else "dynstiction"
    keys: dict[str, dict[str, Key]] = {}
    models: dict[str, list[str]] = {}
    for model in MODELS:
        template = subprocess.run(
            [executable, "template", model], capture_output=True, text=True, check=True
        ).stdout
        for group, body in re.findall(r"^&(\w+)\n(.*?)^/$", template, re.MULTILINE | re.DOTALL):
            for entry in re.findall(r"^  ! (.*)\n  (.*)$", body, re.MULTILINE):
                key = key_of(*entry)
                keys.setdefault(group, {}).setdefault(key.name, key)
                models.setdefault(key.name, []).append(model)
    parts = [INTRODUCTION]
    for group, found in keys.items():
        parts.append(table(group, [of_models(key, models[key.name]) for key in found.values()]))
    PAGE.write_text("\n".join(parts), encoding="utf-8")


def of_models(key: Key, models: list[str]) -> Key:
    """Say with which models a key is used, unless with all."""
    if len(models) == len(MODELS):
        return key
    condition = "model " + " | ".join(models) + (" and " + key.condition if key.condition else "")
    return key._replace(condition=condition)


def key_of(comment: str, line: str) -> Key:
    """From `meaning; only with condition` and `name = value ! kind, unit, range; default`."""
    meaning, _, condition = comment.partition("; only with ")
    name, _, rest = line.partition(" = ")
    kind, _, default = rest.rpartition(" ! ")[2].rpartition("; ")
    kind, *details = kind.split(", ")
    listed, _, choices = kind.rpartition("list: ")
    values = KINDS.get(kind) or ("list of " if kind.startswith("list: ") else "") + words(choices or listed)
    limits = [detail for detail in details if detail[0] in "<>"]
    units = [detail for detail in details if detail[0] not in "<>"]
    default = "" if default == "no default" else default.removeprefix("default ")
    return Key(name.strip(), meaning, condition, ", ".join([values, *limits]), " ".join(units), code(default))


def table(group: str, keys: list[Key]) -> str:
    rows = [
        f"| {code(k.name)} | {describe(k)} | {k.values} | {k.unit} | {k.default or '(none)'} |" for k in keys
    ]
    head = [
        f"## &{group}",
        "",
        "| key | meaning | values | unit | default |",
        "| --- | --- | --- | --- | --- |",
    ]
    return "\n".join([*head, *rows, ""])


def describe(key: Key) -> str:
    text = key.meaning.replace("|w|", "abs(w)").replace("|", r"\|").replace("*", r"\*")
    if key.condition:
        text += "; only with " + key.condition.replace(" | ", " or ")
    return text


def words(alternatives: str) -> str:
    return ", ".join(code(word) for word in alternatives.split(" | "))


def code(word: str) -> str:
    return f"`{word}`" if word else ""


if __name__ == "__main__":
    main()
