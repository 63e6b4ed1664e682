"""Candidates for the word that is being typed in a shell: ``dynstiction complete WORD...``, which the scripts of tools/completion call.

The words are those after the program's name; the last one is being typed. A candidate ``*.nml`` stands for the files with that
ending, ``*/`` for folders, and one that ends in ``=`` is only the beginning of a word.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

from ._commands import ARGUMENTS, described
from ._native import catalogue


def completions(words: Iterable[str]) -> list[str]:
    """Candidates for the last of the words after the program's name."""
    *before, typed = [*words] or [""]
    own, others = _of_executable(), _of_python()
    if not before:
        return [name for name in (*own, "--help", "--version", *others) if name.startswith(typed)]
    options, operands = (own | others).get(before[0], ({}, []))
    if kind := options.get(before[-1]):
        return _values(kind, typed)
    option, equals, begun = typed.partition("=")
    if equals and option in options:
        return [f"{option}={candidate}" for candidate in _values(options[option], begun)]
    if typed.startswith("-"):
        return [name for name in (*options, "--help") if name.startswith(typed)]
    given = sum(not word.startswith("-") and not options.get(previous) for previous, word in pairwise(before))
    return _values(operands[min(given, len(operands) - 1)], typed) if operands else []


Commands = dict[str, tuple[dict[str, str], list[str]]]
"""By name of a command its options, each with what follows it, and its operands."""


def _of_executable() -> Commands:
    """The commands of the executable."""
    arguments: dict[tuple[str, str], list[str]] = {}
    for option in catalogue()["options"]:
        for command in option["commands"]:
            arguments.setdefault((command, option["name"]), []).append(option["argument"])
    return {
        command["name"]: (
            {name: "|".join(arguments[command["name"], name]) for name in command["options"]},
            command["operands"].split(),
        )
        for command in catalogue()["commands"]
    }


def _of_python() -> Commands:
    """The commands of Python."""
    return {
        command["name"]: (
            dict(about.partition(" ")[::2] for about, _ in command["options"]),
            command["operands"].split(),
        )
        for command in described()
    }


def _values(kind: str, typed: str) -> list[str]:
    kind = kind.strip("[].")
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
    words: dict[str, Iterable[str]] = {
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
