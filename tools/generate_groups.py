"""Write groups.py of the Python package, the deck's groups as dataclasses, from the program's description of its keys.

    python tools/generate_groups.py PROGRAM OUTPUT

The build runs this script. The schema is src/deck/schema.f90. Editors, type checkers and readers can see a file, but not classes
that are made at import, and a file saves time at import.
"""

import argparse
import json
import subprocess
import textwrap
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace as Key

WIDTH, INDENT = 110, " " * 8

CLASS_NAMES = {"scene": "Setup"}
"""Class names of groups whose own name is used for something else."""

TYPES = {
    "real": "float",
    "integer": "int",
    "text": "str",
    "reals": "float | Sequence[float]",
    "texts": "str | Sequence[str]",
}

TAKEN = ("accuracy", "points", "quantities")
"""Keys with the name of another argument of functions that take changes."""

HEAD = '''"""The groups of a deck as dataclasses.

Made by tools/generate_groups.py from the schema of the core, src/deck/schema.f90.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, TypedDict, TypeVar

from .deck_group import DeckGroup
'''


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("program", help="the executable dynstiction")
    parser.add_argument("output", type=Path)
    options = parser.parse_args()
    said = subprocess.run([options.program, "template", "--json"], stdout=subprocess.PIPE, check=True).stdout
    # Numbers as texts, as the schema writes them.
    keys = [Key(**key) for key in json.loads(said, parse_int=str, parse_float=str)["keys"]]
    options.output.write_text(module(keys), encoding="utf-8")


def module(table: list[Key]) -> str:
    """Text of the module."""
    groups = {name: list(keys) for name, keys in groupby(table, lambda key: key.group)}
    names = {group: CLASS_NAMES.get(group, group.capitalize()) for group in groups}
    listed = sorted([*names.values(), "Changes", "GroupValues", "Groups", "SceneGroups"])
    parts = [HEAD, "__all__ = [", *(f'    "{name}",' for name in listed), "]", ""]
    for group, keys in groups.items():
        parts += group_class(group, names[group], keys)
    parts += groups_by_name(names, table)
    parts += scene_base(names)
    return "\n".join(parts) + "\n"


def group_class(group: str, name: str, keys: list[Key]) -> list[str]:
    """One group."""
    about = [
        "",
        "@dataclass(frozen=True, kw_only=True, repr=False)",
        f"class {name}(DeckGroup):",
        f'    """Group ``&{group}`` of a deck.',
        "",
        "    Parameters",
        "    ----------",
    ]
    for key in keys:
        about.append(f"    {key.name} : {type_of(key)}")
        about += textwrap.wrap(
            meaning_of(key),
            WIDTH,
            initial_indent=INDENT,
            subsequent_indent=INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        )
    about += ['    """', "", f'    group: ClassVar[str] = "{group}"', ""]
    about += [f"    {key.name}: {type_of(key)} = {default_of(key)}" for key in keys]
    return [*about, ""]


def type_of(key: Key) -> str:
    """Annotation of a field."""
    kind = TYPES.get(key.kind) or literal(key)
    if key.kind == "real" and key.choices:
        kind += f" | {literal(key)}"
    return kind if default_of(key) != "None" else f"{kind} | None"


def literal(key: Key) -> str:
    """The words that a key accepts."""
    return f"Literal[{', '.join(quoted(choice) for choice in key.choices)}]"


def default_of(key: Key) -> str:
    """Default of a field."""
    if key.kind in ("text", "choice") or (key.kind == "texts" and key.default) or key.default in key.choices:
        return quoted(key.default)
    if not key.default:
        return "None"
    return str(int(key.default)) if key.kind == "integer" else repr(float(key.default))


def meaning_of(key: Key) -> str:
    """Unit, range, choices, default and condition in words."""
    unit = f" [{key.units}]" if key.units else ""
    text = f"{key.meaning[0].upper()}{key.meaning[1:]}{unit}"
    if key.range:
        text += f"; {key.range}"
    if key.choices and key.kind == "real":
        text += f" or {' | '.join(quoted(choice) for choice in key.choices)}"
    if key.choices and key.kind == "texts":
        text += f"; of {', '.join(key.choices)}"
    if key.used_by:
        text += "; only with " + " and ".join(
            f"{name} {' | '.join(choices)}" for name, choices in key.used_by.items()
        )
    if key.default:
        text += f". Default {key.default}"
    elif key.required:
        text += ". No default"
    return text.replace("|w|", "abs(w)").replace("*", " ") + "."


def quoted(text: str) -> str:
    """A Python string with double quotes."""
    return f'"{text}"'


def groups_by_name(names: dict[str, str], table: list[Key]) -> list[str]:
    """The keywords of `Scene`, `run` and others, for type checkers and editors."""
    return [
        "",
        "GroupValues = Mapping[str, object]",
        '"""Keys of one deck group and their values: numbers, strings, or sequences of them; None removes a key."""',
        "",
        "",
        "class Groups(TypedDict, total=False):",
        '    """Keywords for the groups of a deck: a dataclass replaces a group, a mapping changes keys of it."""',
        "",
        *(f"    {group}: {name} | GroupValues" for group, name in names.items()),
        "",
        "",
        "class Changes(Groups, total=False):",
        '    """Keywords that change a scene: groups, or keys, whose names are unique; None removes a key.',
        "",
        "    No key takes a mapping; type checkers accept one, so that ``**settings`` by group is accepted.",
        '    """',
        "",
        *(f"    {key.name}: {of_change(key)}" for key in table if key.name not in TAKEN),
        "",
    ]


def of_change(key: Key) -> str:
    """Annotation of a key as a keyword."""
    return f"{type_of(key).removesuffix(' | None')} | GroupValues | None"


def scene_base(names: dict[str, str]) -> list[str]:
    """The groups as attributes of a scene."""
    lines = [
        "",
        'G = TypeVar("G", bound=DeckGroup)',
        "",
        "",
        "class SceneGroups:",
        '    """The groups of a scene as attributes."""',
        "",
        "    __slots__ = ()",
        "",
        "    @abstractmethod",
        "    def _group(self, kind: type[G]) -> G: ...",
    ]
    for group, name in names.items():
        lines += [
            "",
            "    @property",
            f"    def {group}(self) -> {name}:",
            f'        """Group ``&{group}``, with defaults for keys that are not given."""',
            f"        return self._group({name})",
        ]
    return lines


if __name__ == "__main__":
    main()
