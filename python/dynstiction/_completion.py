"""Candidates for the word that is being typed in a shell: ``dynstiction complete WORD...``, which the scripts of tools/completion call.

The words are those after the program's name; the last one is being typed. A candidate ``*.nml`` stands for the files with that
ending, ``*/`` for folders, and one that ends in ``=`` is only the beginning of a word.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise

from ._commands import ARGUMENTS, argument_of
from ._native import catalogue


def completions(commands: Mapping[str, argparse.ArgumentParser], words: Sequence[str]) -> list[str]:
    """Candidates for the last of the words after the program's name; `commands`: those that Python carries out."""
    *before, typed = words or [""]
    own = dict(_commands_of_executable())
    if not before:
        return [name for name in (*own, "--help", "--version", *commands) if name.startswith(typed)]
    commands = {**commands, **own}
    if before[0] not in commands:
        return []
    actions = commands[before[0]]._actions
    options = {name: action for action in actions for name in action.option_strings}
    last = options.get(before[-1])
    if last is not None and last.nargs != 0:
        return _values(last, typed)
    option, equals, begun = typed.partition("=")
    if equals and option in options:
        return [f"{option}={candidate}" for candidate in _values(options[option], begun)]
    if typed.startswith("-"):
        offered = [
            action.option_strings[0] for action in actions if action.option_strings and action.dest != "help"
        ]
        return [name for name in [*offered, "--help"] if name.startswith(typed)]
    operands = [action for action in actions if not action.option_strings]
    given = sum(
        not word.startswith("-") and not (previous in options and options[previous].nargs != 0)
        for previous, word in pairwise(before)
    )
    return _values(operands[min(given, len(operands) - 1)], typed) if operands else []


def _commands_of_executable() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The commands of the executable, in the form of those of Python."""
    for command in catalogue()["commands"]:
        parser = argparse.ArgumentParser(add_help=False)
        for name in command["options"]:
            entries = (entry for entry in catalogue()["options"] if entry["name"] == name)
            kinds = [entry["argument"] for entry in entries if command["name"] in entry["commands"]]
            if any(kinds):
                parser.add_argument(name, metavar="|".join(kinds))
            else:
                parser.add_argument(name, action="store_true")
        if command["operands"]:
            parser.add_argument("operands", metavar=command["operands"].strip("[]."), nargs="*")
        yield command["name"], parser


def _values(action: argparse.Action, typed: str) -> list[str]:
    kind = argument_of(action)
    if files := ARGUMENTS.get(kind, (str, ()))[1]:
        return list(files)
    # The last word of a list with commas is being typed.
    first = typed[: typed.rfind(",") + 1] if kind in ("COLUMNS", "KEYS", "NAMES") else ""
    return [first + word for word in _words(kind, typed) if (first + word).startswith(typed)]


def _words(kind: str, typed: str) -> Iterable[str]:
    if kind == "KIND":
        from .plot import KINDS, SWEEP_KINDS  # noqa: PLC0415

        return (*KINDS, *SWEEP_KINDS)
    names = catalogue()
    keys = {f"{key['group']}.{key['name']}": key for key in names["keys"]}
    name, equals, _ = typed.partition("=")
    fitted = [n for n, k in keys.items() if k["kind"] == "real" and k["group"] in ("system", "friction")]
    summary = [entry["name"] for entry in names["summary"]]
    words = {
        "NAME": summary,
        "NAMES": summary,
        "COLUMNS": [entry["name"] for entry in names["columns"]],
        "KEYS": fitted,
        "MODEL": keys["scene.model"]["choices"],
        "QUANTITY=UNIT": ["time=", "force="],
        "GROUP.KEY=VALUE": [f"{name}={each}" for each in keys[name]["choices"]]
        if equals and name in keys
        else [f"{key}=" for key in keys],
        "KEY=": [f"{n}=" for n, key in keys.items() if key["kind"] in ("real", "reals")],
    }
    return words.get(
        "KEY=" if kind.startswith("KEY=") else kind,
        filter(str.islower, kind.split("|")) if "|" in kind else [],
    )
