"""The one table of names: what `template --json` prints is what the program, its help, its results and Python's commands have."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import dynstiction as ds
from dynstiction import __main__ as commands_of_python
from dynstiction import _native
from programs import Program


def said(executable: Path, *arguments: str) -> str:
    """What a command prints, its lines joined."""
    done = Program((executable,))(*arguments, status=0)
    assert done.stderr == ""
    return " ".join(done.stdout.split())


def test_the_python_package_has_the_same_table(executable: Path, catalogue: dict[str, Any]) -> None:
    text = Program((executable,))("template", "--json", status=0).stdout
    assert json.loads(text, parse_int=str, parse_float=str) == _native.catalogue()
    assert catalogue["version"] == ds.__version__ == said(executable, "--version").split()[1]


def test_names_are_unique_and_what_is_named_exists(catalogue: dict[str, Any]) -> None:
    for kind in ("commands", "columns", "summary", "statistics", "keys"):
        names = [entry["name"] for entry in catalogue[kind]]
        assert len(names) == len(set(names)) > 5
        for entry in catalogue[kind]:
            assert entry.get("meaning") or entry.get("long_name")
    commands = {command["name"] for command in catalogue["commands"]}
    assert all(set(option["commands"]) <= commands for option in catalogue["options"])
    keys = {key["name"]: key for key in catalogue["keys"]}
    for key in catalogue["keys"]:
        assert set(key["models"]) <= set(keys["model"]["choices"])
        for name, choices in key["used_by"].items():
            assert choices
            assert set(choices) <= set(keys[name]["choices"])
        if key["kind"] in ("real", "reals"):
            # A word that a real key takes in place of a number is its only choice.
            assert key["default"] is None or isinstance(key["default"], float) or key["choices"] == [key["default"]]


def test_the_help_says_what_the_table_says(executable: Path, catalogue: dict[str, Any]) -> None:
    overview = said(executable, "--help")
    for command in catalogue["commands"]:
        assert " ".join(f"{command['name']} {command['operands']} {command['brief']}".split()) in overview
        text = said(executable, command["name"], "--help")
        for part in ("usage", "meaning", "examples"):
            assert " ".join(command[part].split()) in text
        for option in catalogue["options"]:
            if command["name"] in option["commands"]:
                assert " ".join(f"{option['name']} {option['argument']} {option['meaning']}".split()) in text
        assert set(re.findall(r"(?<= )(-o|--[a-z-]+)", text.partition(" Examples: ")[0])) <= set(command["options"])
        for entry in catalogue["exit_statuses"]:
            assert f"{entry['status']} {entry['meaning']}" in text


def test_every_command_of_python_has_a_function(of_python: dict[str, Any], catalogue: dict[str, Any]) -> None:
    assert list(commands_of_python.COMMANDS) == list(of_python)
    assert not set(of_python) & {command["name"] for command in catalogue["commands"]}


def test_results_have_the_columns_and_values_of_the_table(fig3_result: ds.Result, catalogue: dict[str, Any]) -> None:
    def described(infos: Any) -> list[dict[str, str]]:
        return [{"name": i.name, "units": i.units, "long_name": i.long_name} for i, _ in infos.info()]

    on_request = ("theta_deg", "u_x_rate", "u_y_rate")
    assert described(fig3_result.columns) == [each for each in catalogue["columns"] if each["name"] not in on_request]
    assert described(fig3_result.statistics) == catalogue["statistics"]
    found = described(fig3_result.summary)
    assert [value for value in catalogue["summary"] if value in found] == found
    assert len(found) > 15
