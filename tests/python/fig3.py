"""Fig. 3 of Nakano & Popov (2020), from inputs/fig3.nml: as a text, as the groups of a deck, as arguments of the package's functions."""

from __future__ import annotations

import ast
import re

from programs import INPUTS

Groups = dict[str, dict[str, object]]

DECK = INPUTS / "fig3.nml"
# Without comments, what is so by default, and the name of the file; twice as many samples.
TEXT = re.sub(r" *!.*|\n  (contact|file) = .*", "", DECK.read_text(encoding="utf-8")).lstrip().replace("2.0e-4", "1.0e-4")
GROUPS: Groups = {
    group: {key: ast.literal_eval(value) for key, value in re.findall(r"(\w+) = ('[^']*'|[^\s,]+)", keys)}
    for group, keys in re.findall(r"&(\w+)\n(.*?)\n/", TEXT, re.DOTALL)
} | {"integrator": {"rtol": 1e-8}}
SYSTEM, FRICTION, DRIVE = GROUPS["system"], GROUPS["friction"], GROUPS["drive"]
CONSTANT = {"law": "constant", "mu_inf": None, "v_f": None}
"""What makes friction constant."""
SLIDER: dict[str, float] = {key: value for group in (SYSTEM, FRICTION, DRIVE) for key, value in group.items() if key != "law"}


def changed(groups: Groups, *changes: Groups) -> Groups:
    """Groups with other values, one change after the other; None takes a key out."""
    found = {group: dict(keys) for group, keys in groups.items()}
    for change in changes:
        for group, keys in change.items():
            found.setdefault(group, {}).update(keys)
    return {group: {key: value for key, value in keys.items() if value is not None} for group, keys in found.items()}


def slider(*changes: Groups) -> Groups:
    """The apparatus of Fig. 3, changed: &system, &friction, &drive."""
    return changed({"system": SYSTEM, "friction": FRICTION, "drive": DRIVE}, *changes)
