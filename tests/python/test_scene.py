"""Scenes: the deck's groups as dataclasses, made from the schema and checked by the deck reader."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import json
import math
import pickle
import re
import sys
from pathlib import Path
from typing import Any

import dynstiction as ds
import fig3 as fig3_deck
import numpy as np
import pytest
from dynstiction import _native
from dynstiction._native import schema
from dynstiction.groups import DeckGroup
from programs import ROOT, Program
from results import assert_same

f90nml = pytest.importorskip("f90nml", reason="pip install f90nml")
hypothesis = pytest.importorskip("hypothesis", reason="pip install hypothesis")
st = hypothesis.strategies

GROUPS = {group.group: group for group in DeckGroup.__subclasses__()}
# But for what is so by default.
FIG3 = {
    name: GROUPS[name](**{key: value for key, value in keys.items() if key not in ("model", "law")})
    for name, keys in fig3_deck.GROUPS.items()
    if name != "integrator"
}


FIG3_TEXT = ds.Scene(**FIG3).text


# The classes and the schema


def test_the_module_of_groups_is_that_of_the_schema(executable: Path, tmp_path: Path) -> None:
    made = tmp_path / "groups.py"
    Program((sys.executable, ROOT / "tools" / "generate_groups.py", executable, made))(status=0)
    assert made.read_text(encoding="utf-8") == Path(inspect.getfile(ds.System)).read_text(encoding="utf-8")


def test_a_scene_of_groups_is_that_of_its_deck(fig3: ds.Scene) -> None:
    scene = ds.Scene(**FIG3)
    assert scene == fig3
    assert hash(scene) == hash(fig3)
    assert scene.check().count("user") < fig3.check().count("user"), "defaults are not written"


def test_groups_of_a_deck_are_typed_values(fig3: ds.Scene) -> None:
    for name, group in FIG3.items():
        assert getattr(fig3, name) == group
    assert fig3.integrator == ds.Integrator() == ds.Integrator(rtol=1e-8, method="radau13")
    assert (fig3.integrator.rtol, fig3.integrator.max_steps, fig3.scene.model) == (1e-8, 0, "full")
    assert isinstance(fig3.integrator.max_steps, int)
    profile = fig3.replace(drive={"time": [0, 1, 1, 3], "velocity": [1e-3, 1e-3, 0, 0]})
    assert profile.drive == ds.Drive(time=np.array([0.0, 1, 1, 3]), velocity=(1e-3, 1e-3, 0, 0))
    assert profile.drive.velocity == (1e-3, 1e-3, 0.0, 0.0)
    assert fig3.replace(output={"fields": ["X", "theta"]}).output.fields == ("X", "theta")


# Refusals: the words are the deck reader's


@pytest.mark.parametrize(
    ("group", "values", "key"),
    [
        (ds.System, {"mass": -1.0}, "mass"),
        (ds.System, {"mass": 10**400}, "mass"),
        (ds.System, {"mass": True}, "mass"),
        (ds.System, {"mass": [1.0, 2.0]}, "mass"),
        (ds.Setup, {"title": "a" * 300}, "title"),
        (ds.Integrator, {"max_steps": 1.5}, "max_steps"),
        (ds.Output, {"fields": ["u_x", "u_z"]}, "fields"),
        (ds.Drive, {"velocity": [1.0, math.inf]}, "velocity"),
    ],
)
def test_a_wrong_field_is_refused_at_once_in_the_deck_reader_s_words(
    program: Program, group: type[DeckGroup], values: dict[str, Any], key: str
) -> None:
    with pytest.raises(ds.DeckError) as refused:
        group(**values)
    (line,) = str(refused.value).splitlines()
    place, _, words = line.partition(": ")
    assert place == f"{group.group}.{key}"
    value = ds.Scene(**{group.group: values}).text.partition(" = ")[2].removesuffix("\n/\n")
    assert words in program("check", fig3_deck.DECK, settings=[f"{place}={value}"], status=2).stderr


def test_what_a_scene_lacks_is_found_when_it_is_checked() -> None:
    scene = ds.Scene(scene=ds.Setup(t_end=1.0), system=ds.System(mass=1.0))
    assert scene.system.mass == 1.0
    with pytest.raises(ds.DeckError) as refused:
        scene.check()
    assert "system: 'stiffness_x' is missing in &system" in str(refused.value)
    assert "group &friction is missing" in str(refused.value)
    with pytest.raises(ds.DeckError, match=r"^integrator\.step: 'step' is not used with method radau13"):
        ds.Scene(**{**FIG3, "integrator": ds.Integrator(step=1e-5)}).check()


def test_faults_name_keys_not_lines_of_a_text_that_nobody_wrote(fig3: ds.Scene) -> None:
    velocity = [1e-3] * 29 + [math.inf]
    with pytest.raises(ds.DeckError) as refused:
        fig3.replace(
            system={"mass": -1.0}, scene={"title": "x" * 300 + "): "}, drive={"time": list(range(30)), "velocity": velocity}
        ).check()
    places = [line.partition(": ")[0] for line in str(refused.value).splitlines()]
    assert sorted(places) == ["drive.velocity", "scene.title", "system.mass"]


@hypothesis.given(st.lists(st.sampled_from(["x", "): ", "...", "=", ":7: ", "\x07", "\x7f", "ä", "'", "--set 1 ("]), max_size=40))
def test_a_fault_is_told_whole_whatever_the_value_is(parts: list[str]) -> None:
    law = "y" + "".join(parts)
    made = ds.Scene(**{**FIG3, "friction": {**FIG3["friction"].given(), "law": law}})
    for scene in (made, ds.Scene(FIG3_TEXT, friction={"law": law})):
        with pytest.raises(ds.DeckError) as refused:
            scene.check()
        first = str(refused.value).splitlines()[0]
        assert first.startswith("friction.law: ")
        assert "constant" in first or "plain UTF-8 text" in first, "the remedy"


def test_the_name_of_a_deck_may_be_anything(tmp_path: Path) -> None:
    for name in ("a:3: b.nml", "--set 1 (x).nml", "tab\t.nml"):
        path = tmp_path / name
        path.write_text(FIG3_TEXT)
        with pytest.raises(ds.DeckError, match=r"^system\.mass: mass = '-1'"):
            ds.Scene(path, system={"mass": -1}).check()
        path.write_text(FIG3_TEXT.replace("mass = ", "mass = -"))
        with pytest.raises(ds.DeckError) as refused:
            ds.Scene(path).check()
        shown = str(path).replace("\t", "?")
        assert re.fullmatch(re.escape(shown) + r":\d+: mass = '-.*", str(refused.value).splitlines()[0])


def test_the_values_of_a_scene_are_its_own(fig3: ds.Scene) -> None:
    values = fig3.groups()
    values["system"]["mass"] = 7.0
    values.clear()
    assert fig3.groups()["system"]["mass"] == fig3.system.mass == 0.25


def test_wrong_groups_are_refused(fig3: ds.Scene) -> None:
    with pytest.raises(ds.UsageError, match="a System is the group 'system'"):
        fig3.replace(friction=ds.System(mass=1.0))
    for call in (ds.Scene, ds.run, ds.Simulation):
        with pytest.raises(ds.UsageError, match=r"a mapping is not a deck: write Scene\(\*\*groups\)"):
            call(fig3.groups())
    for thing, name in ((ds.System(mass=1.0), "mass"), (fig3, "text")):
        with pytest.raises(AttributeError):
            setattr(thing, name, "other")


@pytest.mark.parametrize(
    "changes",
    [
        {"misalignment_deg": 2.0, "mu_0": 0.3, "velocity": [1e-3, 2e-3], "time": [0.0, 1.0]},
        {"system.misalignment_deg": 2.0, "friction.mu_0": 0.3, "drive.velocity": [1e-3, 2e-3], "drive.time": [0.0, 1.0]},
        {"System.Misalignment_deg": 2.0, "friction": {"mu_0": 0.3}, "drive": ds.Drive(velocity=(1e-3, 2e-3), time=(0.0, 1.0))},
        {"friction": {"mu_0": 0.1}, "mu_0": 0.3, "misalignment_deg": 2.0, "drive": {"velocity": [1e-3, 2e-3]}, "time": [0.0, 1.0]},
    ],
    ids=["keys", "dotted", "mixed", "a key comes after its group"],
)
def test_keys_are_keywords(fig3: ds.Scene, changes: dict[str, Any]) -> None:
    by_group = {
        "system": {"misalignment_deg": 2.0},
        "friction": {"mu_0": 0.3},
        "drive": {"velocity": [1e-3, 2e-3], "time": [0.0, 1.0]},
    }
    expected = ds.Scene(fig3, **by_group)
    assert expected != fig3
    assert fig3.replace(**changes) == ds.Scene(fig3, **changes) == expected
    assert ds.Scene(**(fig3.groups() | changes)).friction.mu_0 == 0.3
    short = {"t_end": 0.01}
    assert_same(ds.run(fig3, **changes, **short), ds.run(expected, **short))
    with ds.Simulation(fig3, **changes, **short) as simulation:
        assert simulation.scene == expected.replace(**short)


def test_every_key_can_be_a_keyword(fig3: ds.Scene) -> None:
    names = [key.name for key in _native.schema()]
    assert len(set(names)) == len(names), "a key without its group has to be the only one of its name"
    assert not set(names) & set(_native.group_names())
    for key in _native.schema():
        scene = fig3.replace(**{key.name: key.default or "1"})
        assert scene.settings[-1].startswith(f"{key.group}.{key.name}=")
    assert fig3.replace(mass=None).groups()["system"].keys() == fig3.groups()["system"].keys() - {"mass"}


def test_scenes_of_dictionaries(fig3: ds.Scene) -> None:
    flat = {f"{group}.{key}": value for group, keys in fig3.groups().items() for key, value in keys.items()}
    assert ds.Scene(**flat) == ds.Scene(**json.loads(json.dumps(fig3.groups()))) == fig3


# Changing, copying


def test_a_dataclass_replaces_a_group_and_a_mapping_changes_keys(fig3: ds.Scene) -> None:
    heavier = dataclasses.replace(fig3.system, mass=1.0)
    assert fig3.replace(system=heavier) == fig3.replace(system={"mass": 1})
    assert fig3.replace(system={"mass": 1}).system == heavier
    constant = fig3.replace(friction=ds.Friction(law="constant", mu_0=0.2, normal_load=10.0))
    assert constant.friction.mu_inf is None and constant.check()


def test_scenes_are_copied_pickled_and_compared_by_value(fig3: ds.Scene, fig3_text: str) -> None:
    scene = ds.Scene(**FIG3).replace(system={"mass": 1.0})
    for other in (copy.copy(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert other == scene
        assert other.settings == scene.settings
    assert scene.__replace__(system={"mass": 0.25}) == fig3
    if sys.version_info >= (3, 13):
        assert copy.replace(scene, system={"mass": 0.25}) == fig3
        assert copy.replace(fig3.system, mass=1.0).mass == 1.0
    broken = pickle.loads(pickle.dumps(ds.Scene(system={"mass": -1.0})))
    with pytest.raises(ds.DeckError, match=r"^system\.mass: "):
        broken.groups()
    assert pickle.loads(pickle.dumps(fig3.system)) == fig3.system
    assert ds.Scene(fig3) == ds.Scene(fig3.text) == fig3
    assert ds.Scene(fig3_text.replace("0.25", "2.5e-1").replace("/\n", "/ ! end\n")) == fig3
    for other in (ds.Scene(fig3_text.replace("0.25", "0.26")), ds.Scene(fig3_text + "&system\n/\n"), fig3_text):
        assert other != fig3


# Round trips


def as_dicts(deck: f90nml.Namelist) -> dict[str, dict[str, Any]]:
    return {group: dict(keys) for group, keys in deck.items()}


@pytest.mark.parametrize("path", sorted((ROOT / "inputs").glob("*.nml")), ids=lambda path: path.stem)
def test_f90nml_reads_what_a_scene_writes_and_a_scene_what_f90nml_reads(path: Path) -> None:
    deck = as_dicts(f90nml.read(path))
    scene = ds.Scene(**deck)
    assert scene == ds.Scene(path)
    assert as_dicts(f90nml.reads(scene.text)) == deck
    assert as_dicts(f90nml.reads(ds.Scene(path).to_deck())) == deck


def numbers(key: Any) -> st.SearchStrategy[float]:
    """Values that the schema's range allows."""
    bounds = dict(re.findall(r"([<>]=?) ([-+.\de]+)", key.range))
    low = float(bounds.get(">=", bounds.get(">", -1e300)))
    high = float(bounds.get("<=", bounds.get("<", 1e300)))
    # The reader refuses numbers at the lower end of double precision.
    allowed = st.floats(low, high, exclude_max="<" in bounds).filter(lambda v: v == 0.0 or abs(v) > 1e-307)
    return allowed.filter(lambda value: value > low) if ">" in bounds else allowed


def values(key: Any) -> st.SearchStrategy[Any]:
    """Any value of one key alone."""
    plain = st.text(st.characters(min_codepoint=32, exclude_categories=["C", "Z"]), min_size=1, max_size=40)
    match key.kind:
        case "real":
            return numbers(key)
        case "reals":
            return st.lists(numbers(key), min_size=1, max_size=40)
        case "integer":
            bounds = dict(re.findall(r"([<>]=) (\d+)", key.range))
            return st.integers(int(bounds[">="]), int(bounds.get("<=", 2**53 - 1)))
        case "choice":
            return st.sampled_from(key.choices)
        case "texts":
            choices = st.sampled_from(key.choices) if key.choices else plain
            return st.lists(choices, min_size=1, max_size=5)
        case _:
            return plain


@st.composite
def decks(draw: st.DrawFn) -> dict[str, dict[str, Any]]:
    keys = draw(st.lists(st.sampled_from(schema()), min_size=1, max_size=12, unique=True))
    deck: dict[str, dict[str, Any]] = {}
    for key in keys:
        deck.setdefault(key.group, {})[key.name] = draw(values(key))
    return deck


def flat(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return value[0] if len(value) == 1 else tuple(value)
    return value


@hypothesis.given(decks())
def test_every_value_survives_deck_python_deck_and_f90nml(deck: dict[str, dict[str, Any]]) -> None:
    wanted = {group: {key: flat(value) for key, value in keys.items()} for group, keys in deck.items()}
    scene = ds.Scene(**deck)
    assert scene.groups() == wanted
    again = ds.Scene(scene.to_deck())
    assert again.groups() == wanted
    assert again == scene == ds.Scene("&scene\n/\n", **deck)
    groups = {name: getattr(scene, name) for name in wanted}
    assert ds.Scene(**groups) == scene
    for name, group in groups.items():
        assert all(getattr(group, key) == value for key, value in wanted[name].items())
    # f90nml takes an apostrophe doubled in quotes for the end of the text.
    found = f90nml.reads(scene.text.replace("''", "")).todict()
    for name, keys in wanted.items():
        for key, value in keys.items():
            quoted = any("'" in str(part) for part in (value if isinstance(value, tuple) else [value]))
            assert quoted or flat(found[name][key]) == value


# Shown
