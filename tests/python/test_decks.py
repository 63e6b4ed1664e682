"""Decks as users write them: the executable on good, odd and bad decks."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from fig3 import TEXT
from programs import INPUTS, Program

DECKS = sorted(INPUTS.glob("*.nml"))

pytestmark = pytest.mark.deck

# The first four groups of Fig. 3, in 18 lines: &scene (1), &system (5), &friction (11), &drive (16).
GOOD = TEXT[: TEXT.index("&initial")].replace("Fig. 3, Nakano & Popov (2020)", "a test").replace("t_end = 10.0", "t_end = 1.0e-3")
GOOD = re.sub(r"\n  (model|law) = .*", "", GOOD)


def write(folder: Path, content: str | bytes, name: str = "deck.nml") -> str:
    data = content if isinstance(content, bytes) else content.encode()
    (folder / name).write_bytes(data)
    return name


def with_line(after: str, line: str) -> str:
    """The good deck with one more line, after the line that contains `after`."""
    lines = GOOD.splitlines()
    at = next(i for i, text in enumerate(lines) if after in text)
    return "\n".join([*lines[: at + 1], line, *lines[at + 1 :]]) + "\n"


def instead(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new, 1)


def values(text: str) -> list[str]:
    """A deck's lines without their comments."""
    return [line.split(" ! ")[0].rstrip() for line in text.splitlines() if not line.startswith("!")]


# name: deck, line (0 = none), offending word, remedy
BAD: dict[str, tuple[str | bytes, int, str, str]] = {
    "blank": ("  \n\n", 1, "no group", "&scene"),
    "comment only": ("! nothing\n", 1, "no group", "&scene"),
    "no scene": (GOOD[GOOD.index("&system") :], 14, "&scene", "t_end"),
    "no system": (GOOD[: GOOD.index("&system")] + GOOD[GOOD.index("&friction") :], 12, "&system", "stiffness_x"),
    "unknown group": (GOOD + "&sytem\n x = 1\n/\n", 19, "'&sytem'", "nearest is &system"),
    "unlike any group": (GOOD + "&zz\n/\n", 19, "'&zz'", "scene system friction"),
    "sweep": (GOOD + "&sweep\n count = 2\n/\n", 19, "&sweep varies nothing", "name parameter"),
    "repeated group": (GOOD + "&scene\n/\n", 19, "&scene", "line 1"),
    "repeated group in capitals": (GOOD + "&SCENE\n/\n", 19, "&scene", "line 1"),
    "no group name": (instead("&scene", "& scene"), 1, "'&'", "right after it"),
    "end without a group": (GOOD + "&end\n", 19, "'&end'", "remove it"),
    "unknown key": (with_line("title", " titel = 'x'"), 3, "'titel'", "nearest is 'title'"),
    "key with hyphen": (instead("t_end =", "t-end ="), 3, "'t-end'", "nearest is 't_end'"),
    "misnamed group": (instead("&system", "&sistem"), 5, "'&sistem'", "nearest is &system"),
    "short key": (instead("stiffness_x", "stiffness"), 7, "'stiffness'", "nearest is 'stiffness_x'"),
    "part of a key": (instead("misalignment_deg", "misalignment"), 9, "'misalignment'", "nearest is 'misalignment_deg'"),
    "unlike any key": (with_line("mass", " viscosity = 1.0"), 7, "'viscosity'", "mass stiffness_x"),
    "letter that is not ASCII": (with_line("mu_0", " µ_0 = 0.2"), 13, "'µ_0'", "mu_0"),
    "wrong group": (with_line("t_end", " rtol = 1e-6"), 4, "'rtol'", "&integrator"),
    "wrong group, physical": (instead("t_end = 1.0e-3", "t_end = 1.0e-3 v_f = 1"), 3, "'v_f'", "&friction"),
    "repeated key": (with_line("t_end", "  t_end = 2.0"), 4, "'t_end'", "line 3"),
    "repeated key in capitals": (with_line("t_end", "  T_END = 2.0"), 4, "'t_end'", "line 3"),
    "empty value": (instead("mass = 0.25", "mass ="), 6, "'mass' has an empty value", "give a value"),
    "empty value before the end": (instead("= 1.0e-3\n/\n&system", "=\n/\n&system"), 3, "'t_end'", "give a value"),
    "empty value before a comment": (instead("mass = 0.25", "mass = ! 0.25"), 6, "'mass'", "give a value"),
    "only a comma": (instead("mass = 0.25", "mass = ,"), 6, "'mass'", "remove the ','"),
    "two commas": (instead("mu_0 = 0.20,", "mu_0 = 0.20,,"), 12, "'mu_0'", "remove the ','"),
    "a word": (instead("0.25", "heavy"), 6, "'heavy'", "finite real number"),
    "a number in quotes": (instead("0.25", "'0.25'"), 6, "'0.25'", "without quotes"),
    "text without quotes": (instead("'a test'", "test"), 2, "'test'", "text in quotes"),
    "model without quotes": (with_line("title", " model = full"), 3, "'full'", "text in quotes"),
    "a logical": (instead("0.25", ".true."), 6, "'.true.'", "finite real number"),
    "a unit": (instead("0.25", "0.25kg"), 6, "'0.25 kg' has a unit", "in kg: 0.25"),
    "a unit apart": (instead("0.25", "0.25 kg"), 6, "'0.25 kg' has a unit", "in kg: 0.25"),
    "decimal comma": (instead("0.25", "0,25"), 6, "'mass', from '25' on: 2 given", "at most 1"),
    "underscore": (instead("1.0e7", "10_000_000"), 8, "'10_000_000'", "finite real number"),
    "exponent without letter": (instead("1.0e7", "1.0+7"), 8, "'1.0+7'", "finite real number"),
    "no exponent": (instead("1.0e7", "1.0e"), 8, "'1.0e'", "finite real number"),
    "hexadecimal": (instead("1.0e7", "0xFF"), 8, "'0xFF'", "finite real number"),
    "NaN": (instead("0.25", "NaN"), 6, "'NaN'", "finite real number"),
    "Infinity": (instead("0.25", "Infinity"), 6, "'Infinity'", "finite real number"),
    "overflow": (instead("0.25", "1e400"), 6, "'1e400'", "finite real number"),
    "underflow": (instead("0.25", "1e-400"), 6, "'1e-400'", "finite real number"),
    "complex": (instead("0.25", "(0.25, 0)"), 6, "(0.25, 0)", "separate values"),
    "real for integer": (GOOD + "&integrator max_steps = 10.0 /\n", 19, "'10.0'", "integer, like 1000"),
    "integer overflow": (GOOD + "&integrator max_steps = 99999999999999999999 /\n", 19, "99999999999999999999", "integer"),
    "negative integer": (GOOD + "&integrator max_steps = -1 /\n", 19, "'-1'", ">= 0"),
    "no mass": (instead("mass = 0.25", "mass = 0.0"), 6, "mass = '0.0'", "> 0.0 (in kg)"),
    "negative load": (instead("= 10.0", "= -10.0"), 14, "normal_load = '-10.0'", ">= 0.0 (in N)"),
    "more than a turn": (instead("_deg = 1.0", "_deg = 361"), 9, "misalignment_deg = '361'", "<= 360.0 (in deg)"),
    "tolerance too large": (GOOD + "&integrator rtol = 1.0 /\n", 19, "rtol = '1.0'", "<= 0.1"),
    "tolerance too small": (GOOD + "&integrator rtol = 1e-16 /\n", 19, "rtol = '1e-16'", ">= 1.0e-13"),
    "negative end": (instead("t_end = 1.0e-3", "t_end = -1"), 3, "t_end = '-1'", "> 0.0 (in s)"),
    "two values": (instead("0.25", "0.25 0.5"), 6, "'mass', from '0.5' on: 2 given", "at most 1"),
    "repeat count": (instead("0.25", "2*0.25"), 6, "'mass', from '0.25' on: 2 given", "at most 1"),
    "huge repeat count": (
        instead("= 1.0e-3\n/\n", "= 1.0e-3\n/\n&output fields = 999999999999*'u_x' /\n"),
        5,
        "'fields'",
        "at most",
    ),
    "zero repeat count": (instead("0.25", "0*0.25"), 6, "'0*'", "1 or more"),
    "repeated nothing": (instead("0.25", "2*"), 6, "'2*'", "after the '*'"),
    "long text": (instead("a test", "x" * 257), 2, "xxx", "at most 256"),
    "missing slash": (instead("1.0\n/\n&friction", "1.0\n&friction"), 10, "missing '/'", "end the group &system"),
    "missing last slash": (GOOD.rstrip("/\n"), 17, "missing '/'", "end the group &drive"),
    "unclosed quote": (instead("'a test'", "'a test"), 2, "unclosed quote 'a test", "close it with '"),
    "unclosed double quote": (instead("'a test'", "\"a test'"), 2, "unclosed quote \"a test'", 'close it with "'),
    "quote inside": (instead("'a test'", "'a dog's'"), 2, "'s''", "double a quote"),
    "text before": ("my deck\n" + GOOD, 1, "'my deck'", "after a '!'"),
    "text between": (instead("/\n&system", "/\n# system\n&system"), 5, "'# system'", "after a '!'"),
    "text after the slash": (instead("/\n&system", "/ end\n&system"), 4, "'end'", "after a '!'"),
    "hash comment in a group": (with_line("t_end", "  # comment"), 4, "'#'", "at most 1"),
    "dollar group": (GOOD + "$output interval = 1 $end\n", 19, "'$output", "&GROUP"),
    "value before a key": (instead("&drive\n", "&drive\n  3.0\n"), 17, "'3.0'", "KEY = VALUE"),
    "no equals": (instead("mass =", "mass"), 6, "'mass' without '='", "KEY = VALUE"),
    "colon": (instead("mass =", "mass:"), 6, "'mass:' without '='", "KEY = VALUE"),
    "two equals": (instead("mass =", "mass = ="), 6, "'= 0.25'", "separate values"),
    "array element": (instead("velocity =", "velocity(1) ="), 17, "velocity(1) = 1.0e-3", "all values at once"),
    "component": (instead("mass =", "mass%kg ="), 6, "mass%kg = 0.25", "all values at once"),
    "NUL": (GOOD.encode() + b"\0", 19, "NUL", "plain UTF-8 text"),
    "binary": (b"MZ\n" + bytes(range(1, 256)), 2, "control characters", "plain UTF-8 text"),
    "result": (b"\x89HDF\r\n\x1a\n" + bytes(range(256)), 0, "is a result or another HDF5 file", "dynstiction show"),
    "long result": (b"\x89HDF\r\n\x1a\n" + bytes(2_000_000), 0, "is a result or another HDF5 file", "dynstiction show"),
    "UTF-16": (GOOD.encode("utf-16"), 1, "NUL", "plain UTF-8 text"),
    "Latin-1": (instead("a test", "für").encode("latin-1"), 2, "not UTF-8", "save the deck as UTF-8"),
    "control character": (instead("a test", "a\x07test"), 2, "control characters", "plain UTF-8 text"),
    "huge": ("!" * 1_000_001, 0, "1000001 bytes", "at most 1000000"),
    "empty": ("", 0, "is empty", "&scene"),
    "unknown model": (with_line("title", " model = 'ful'"), 3, "'ful'", "nearest is 'full'"),
    "model in capitals": (with_line("title", " model = 'FULL'"), 3, "'FULL'", "nearest is 'full'"),
    "unknown law": (with_line("v_f", " law = 'weakenning'"), 14, "'weakenning'", "nearest is 'weakening'"),
    "unknown contact": (with_line("v_f", " contact = 'smooth'"), 14, "'smooth'", "nearest is 'smoothed'"),
    "unknown method": (GOOD + "&integrator method = 'radau7' /\n", 19, "'radau7'", "nearest is 'radau5'"),
    "unknown field": (GOOD + "&output fields = 'u_x', 'w_z' /\n", 19, "'w_z'", "nearest is 'w_x'"),
    "field twice": (GOOD + "&output fields = 'u_x', 'u_x' /\n", 19, "'u_x'", "once"),
    "v_f with constant": (with_line("v_f", " law = 'constant'"), 13, "'v_f'", "law weakening"),
    "v_smooth with exact": (with_line("v_f", " v_smooth = 1e-6"), 14, "'v_smooth'", "contact smoothed"),
    "step with radau13": (GOOD + "&integrator step = 1e-6 /\n", 19, "'step'", "only with method {methods}"),
    "v_cut with radau13": (GOOD + "&integrator v_cut = 1e-6 /\n", 19, "'v_cut'", "only with method {methods}"),
    "smoothed without v_smooth": (with_line("v_f", " contact = 'smoothed'"), 11, "'v_smooth'", "add v_smooth"),
    "rk4 with exact": (GOOD + "&integrator method = 'rk4' step = 1e-6 /\n", 19, "'rk4'", "contact = 'smoothed'"),
    "missing key": (instead("  mass = 0.25\n", ""), 5, "'mass'", "add mass = VALUE in kg"),
    "missing v_f": (instead("  v_f = 0.010\n", ""), 11, "'v_f'", "law weakening"),
    "missing end": (instead("  t_end = 1.0e-3\n", ""), 1, "'t_end'", "add t_end = VALUE in s"),
    "profile without times": (instead("velocity = 1.0e-3", "velocity = 1, 2"), 17, "2 value(s)", "one velocity for each time"),
    "profile too short": (with_line("velocity", " time = 0, 1"), 18, "1 value(s)", "one velocity for each time"),
    "profile backwards": (instead("velocity = 1.0e-3", "velocity = 1, 2, 3 time = 0, 2, 1"), 17, "'1.0'", "must not decrease"),
    "profile not from 0": (instead("velocity = 1.0e-3", "velocity = 1 time = 1"), 17, "'1.0'", "must be 0.0"),
    "profile, three equal": (instead("velocity = 1.0e-3", "velocity = 4*1 time = 0, 3*1"), 17, "time(4)", "twice for a jump"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_deck(name, program, tmp_path, catalogue):
    """Exit status 2; file, line, offending word and remedy in one message; nothing written, nothing overwritten."""
    content, line, word, remedy = BAD[name]
    methods = {key["name"]: key["used_by"].get("method", []) for key in catalogue["keys"]}
    remedy = remedy.replace("{methods}", " | ".join(methods.get(word.strip("'"), [])))
    deck = write(tmp_path, content)
    kept = b"results of last year"
    (tmp_path / "old.h5").write_bytes(kept)
    before = {path.name for path in tmp_path.iterdir()}

    result = program("run", deck, "-o", "old.h5", "--overwrite")
    place = f"dynstiction: {deck}:{line}: " if line else f"dynstiction: {deck}: "
    messages = result.stderr.splitlines()
    assert result.returncode == 2, messages
    assert any(m.startswith(place) and word in m and remedy in m for m in messages), messages
    assert all(re.match(r"dynstiction: deck\.nml(:\d+)?: .+: .+", m) for m in messages), messages
    assert result.stdout == ""
    assert (tmp_path / "old.h5").read_bytes() == kept

    assert program("run", deck).returncode == 2
    assert program("check", deck).returncode == 2
    assert {path.name for path in tmp_path.iterdir()} == before


# Decks with two faults on purpose; every other bad deck must give exactly one message.
SEVERAL = {"blank", "comment only", "v_f with constant"}


@pytest.mark.parametrize("name", sorted(BAD.keys() - SEVERAL))
def test_one_fault_one_message(name, program, tmp_path):
    result = program("check", write(tmp_path, BAD[name][0]))
    assert len(result.stderr.splitlines()) == 1, result.stderr


def test_good_deck_is_good(program, tmp_path):
    """What the bad decks are made from has no fault of its own."""
    result = program("check", write(tmp_path, GOOD))
    assert (result.returncode, result.stderr) == (0, "")


def test_all_faults_in_one_go(program, tmp_path):
    text = GOOD.replace("'a test'", "'a test").replace("0.25", "NaN").replace("v_f", "vf").replace("velocity", "speed")
    result = program("check", write(tmp_path, text + "&sytem /\nstray\n"))
    lines = [int(m.split(":")[2]) for m in result.stderr.splitlines()]
    assert lines == sorted(lines)
    assert {2, 6, 13, 17, 19, 20} <= set(lines)


def test_faults_of_several_decks(program, tmp_path):
    """All decks are checked before the first one runs."""
    write(tmp_path, GOOD, "good.nml")
    write(tmp_path, GOOD.replace("0.25", "x"), "one.nml")
    write(tmp_path, GOOD.replace("0.25", "y"), "two.nml")
    result = program("run", "good.nml", "one.nml", "two.nml")
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 2
    assert "one.nml:6: 'x'" in result.stderr
    assert "two.nml:6: 'y'" in result.stderr
    assert not list(tmp_path.glob("*.h5"))


@pytest.mark.parametrize("kind", ["missing", "folder", "pipe", "device", "no name"])
def test_not_a_file(kind, program, tmp_path):
    name = {"missing": "none.nml", "folder": "folder", "pipe": "pipe", "device": "/dev/zero", "no name": ""}[kind]
    if kind == "folder":
        (tmp_path / name).mkdir()
    if kind == "pipe":
        os.mkfifo(tmp_path / name)
    result = program("run", name)
    assert result.returncode == 2
    assert re.match(rf"dynstiction: {re.escape(name)}: .+: .+", result.stderr), result.stderr


GOOD_BUT_ODD = {
    "CRLF": GOOD.replace("\n", "\r\n"),
    "no final newline": GOOD.rstrip("\n"),
    "groups in any order": "".join(reversed(re.findall(r"&.*?\n/\n", GOOD, re.DOTALL))),
    "repeat counts": GOOD.replace("velocity = 1.0e-3", "time = 0.0 velocity = 1*1.0e-3").replace("0.25", "1*0.25"),
    "tabs": GOOD.replace(" = ", "\t=\t").replace("  ", "\t"),
    "comments with quotes": GOOD.replace("\n", " ! don't \" / & = mass = 3\n"),
    "comment without a blank": GOOD.replace("0.25", "0.25!it's"),
    "D exponents": GOOD.replace("1.0e7", "1.0D+7").replace("1.0e3", "1d3"),
    "bare points": GOOD.replace("0.25", ".25").replace("10.0", "10."),
    "capitals": GOOD.replace("mass", "MASS").replace("&system", "&System"),
    "&end": GOOD.replace("\n/\n", "\n&end\n"),
    "one line": GOOD.replace("\n", " "),
    "no blanks": GOOD.replace(" = ", "=").replace("\n/", "/").replace("  ", " "),
    "commas everywhere": re.sub(r"(= [^\n]*?),?\n", r"\1,\n", GOOD),
    "values in the next line": GOOD.replace(" = ", " =\n\n ! value\n "),
    "double quotes": GOOD.replace("'", '"'),
    "byte order mark": "\ufeff" + GOOD,
    "blank lines": GOOD.replace("\n", "\n\n   \n"),
    "long line": "! " + "x" * 200_000 + "\n" + GOOD,
    "other alphabets": "! 摩擦, трение, µ\n" + GOOD,
    "off switches of unused keys": GOOD.replace("v_f", "v_smooth = 0.0\n v_f") + "&integrator step = 0.0, v_cut = 0.0 /\n",
}


@pytest.mark.parametrize("name", GOOD_BUT_ODD)
def test_odd_deck_reads_as_the_plain_one(name, program, tmp_path):
    plain = program("check", write(tmp_path, GOOD, "plain.nml"))
    odd = program("check", write(tmp_path, GOOD_BUT_ODD[name]))
    assert (odd.returncode, odd.stderr) == (0, "")
    assert values(odd.stdout) == values(plain.stdout)


def test_text_survives(program, tmp_path):
    deck = GOOD.replace("'a test'", "'it''s \"φ = 1°\", a/b & c ! not a comment'")
    result = program("check", write(tmp_path, deck))
    assert "title = 'it''s \"φ = 1°\", a/b & c ! not a comment' ! user" in result.stdout


def resolved(program: Program, content: str, *settings: str) -> str:
    return program("check", write(program.folder, content), settings=settings, status=0).stdout


def test_settings_win(program, tmp_path):
    text = resolved(
        program,
        GOOD,
        "system.mass=0.5",
        "integrator.method=dopri5",
        "SCENE.Title=two words",
        "output.fields=u_x,X",
        "drive.time=0,1,1",
        "drive.velocity=1e-3,1e-3,0",
    )
    assert re.search(r"^  mass = 0\.5 +! user", text, re.MULTILINE)
    assert re.search(r"^  method = 'dopri5' +! user", text, re.MULTILINE)
    assert re.search(r"^  title = 'two words' +! user", text, re.MULTILINE)
    assert re.search(r"^  fields = 'u_x', 'X' +! user", text, re.MULTILINE)
    assert re.search(r"^  time = 0\.0, 1\.0, 1\.0 +! user", text, re.MULTILINE)
    assert re.search(r"^  stiffness_x = 1000\.0 +! user", text, re.MULTILINE)
    assert re.search(r"^  rtol = 1\.0e-8 +! default", text, re.MULTILINE)


@pytest.mark.parametrize(
    ("setting", "word", "remedy"),
    [
        ("mass", "no '='", "GROUP.KEY=VALUE"),
        ("mass=1", "no group", "system.mass=VALUE"),
        ("sytem.mass=1", "'&sytem'", "nearest is &system"),
        ("system.mas=1", "'mas'", "nearest is 'mass'"),
        ("system.rtol=1", "'rtol'", "&integrator"),
        ("system.mass=abc", "'abc'", "finite real number"),
        ("system.mass=-1", "mass = '-1'", "> 0.0"),
        ("system.mass=1,2", "2 given", "at most 1"),
        ("integrator.method=radau", "'radau'", "nearest is 'radau5'"),
        ("scene.title='x", "unclosed quote", "close it"),
        ("sweep.count=3", "&sweep varies nothing", "name parameter"),
    ],
)
def test_bad_setting(setting, word, remedy, program, tmp_path):
    result = program("run", write(tmp_path, GOOD), "--set", "scene.t_end=2e-3", "--set", setting)
    text = result.stderr
    assert result.returncode == 2
    assert f"dynstiction: --set {setting}: " in text
    assert word in text
    assert remedy in text
    assert {path.name for path in tmp_path.iterdir()} == {"deck.nml"}


def test_empty_setting_takes_a_key_out(program, tmp_path):
    text = resolved(program, GOOD, "friction.law=constant", "friction.mu_inf=", "friction.v_f= ", "scene.title=")
    assert "mu_inf" not in text
    assert "v_f" not in text
    assert re.search(r"^  title = '' +! default", text, re.MULTILINE)
    refused = program("check", "deck.nml", "--set", "system.mass=")
    assert refused.returncode == 2
    assert "deck.nml:5: 'mass' is missing" in refused.stderr


def test_resolved_deck_is_a_fixpoint(program, tmp_path):
    once = resolved(
        program,
        GOOD,
        "system.mass=0.1234567890123456789",
        "drive.velocity=-1e-300",
        "scene.title=it's",
        "friction.mu_0=3.3333333333333335e-1",
    )
    twice = resolved(program, once)
    assert values(twice) == values(once)
    assert resolved(program, twice) == twice
    assert "mass = 0.12345678901234568 " in once


def test_resolved_marks_user_and_default(program, tmp_path):
    keys = [line for line in resolved(program, GOOD).splitlines() if " = " in line]
    assert all(re.search(r" ! (user|default)[,;] ", line) for line in keys)
    marked = {line.split()[0] for line in keys if " ! user" in line}
    assert marked == {
        "title",
        "t_end",
        "mass",
        "stiffness_x",
        "stiffness_y",
        "misalignment_deg",
        "mu_0",
        "mu_inf",
        "v_f",
        "normal_load",
        "velocity",
    }


def test_template_is_a_deck(program, tmp_path):
    result = program("template")
    assert result.returncode == 0
    assert program("template", "full").stdout == result.stdout
    text = resolved(program, result.stdout)
    fig3 = program("check", str(INPUTS / "fig3.nml")).stdout
    own = ("  file = ", "  interval = ", "  method = ")
    assert [v for v in values(text) if not v.startswith(own)] == [v for v in values(fig3) if not v.startswith(own)]


@pytest.mark.parametrize("deck", DECKS, ids=lambda path: path.stem)
def test_inputs(deck, program, tmp_path):
    """Every deck of inputs/ is sound, begins with a comment that explains it, and writes a file of its own name."""
    result = program("check", str(deck))
    assert (result.returncode, result.stderr) == (0, "")
    text = deck.read_text()
    assert text.startswith("! ")
    assert f"  file = '{deck.stem}.h5'" in text


def test_there_are_inputs():
    figures = {"fig3", "fig3_constant", "phi10", "slide_hold_slide", "reversal"}
    models = {"low_frequency", "high_frequency", "creep", "creep_asymptotic", "auto"}
    assert figures | models <= {deck.stem for deck in DECKS}


def same(ours: dict, theirs: dict) -> bool:
    """Whether two f90nml decks agree on every key of the first, bit for bit."""
    return all(theirs[group][key] == value for group, keys in ours.items() for key, value in keys.items())


@pytest.mark.parametrize("source", [*DECKS, "template"], ids=lambda s: s if isinstance(s, str) else s.stem)
def test_f90nml_reads_the_same(source, program, tmp_path, catalogue):
    f90nml = pytest.importorskip("f90nml", reason="pip install f90nml")
    text = program("template").stdout if source == "template" else source.read_text()
    for points in INPUTS.glob("*.csv"):
        shutil.copy(points, tmp_path)
    used = f90nml.reads(resolved(program, text))
    given = f90nml.reads(text)
    # Keys that are switched off are in the template but are not used, nor are those of other laws.
    law = {key["name"] for key in catalogue["keys"] if "law" in key["used_by"]}
    for group, keys in given.items():
        for key in [k for k in keys if k not in used[group]]:
            assert key in {"v_smooth", "step", "v_cut", *law}
            del given[group][key]
    assert len(used) == 7 + ("sweep" in given)
    assert same(given, used)


def test_f90nml_reads_long_lists_and_quotes(program, tmp_path):
    f90nml = pytest.importorskip("f90nml", reason="pip install f90nml")
    times = [i**0.5 for i in range(300)]
    speeds = [1e-3 / (i + 3) for i in range(300)]
    text = GOOD.replace("velocity = 1.0e-3", f"velocity = {str(speeds)[1:-1]}\n time = {str(times)[1:-1]}")
    used = f90nml.reads(resolved(program, text.replace("a test", "it''s a ! test")))
    assert used["drive"]["time"] == times
    assert used["drive"]["velocity"] == speeds
    assert used["scene"]["title"] == "it's a ! test"


def test_existing_output_is_refused(program, tmp_path):
    (tmp_path / "deck.h5").write_bytes(b"kept")
    result = program("run", write(tmp_path, GOOD), "--quiet")
    assert result.returncode == 3
    assert "deck.h5" in result.stderr
    assert "--overwrite" in result.stderr
    assert (tmp_path / "deck.h5").read_bytes() == b"kept"


def test_output_folder_must_exist(program, tmp_path):
    result = program("run", write(tmp_path, GOOD), "-o", "none/out.h5")
    assert result.returncode == 3
    assert "the folder none does not exist: create it" in result.stderr


def test_two_decks_cannot_share_an_output(program, tmp_path):
    for name in ("one.nml", "two.nml"):
        write(tmp_path, GOOD + f"&output file = '{'./' if name == 'two.nml' else ''}same.h5' /\n", name)
    result = program("run", "one.nml", "two.nml")
    assert result.returncode == 3
    assert "two decks write this file" in result.stderr
    assert not (tmp_path / "same.h5").exists()


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        ([], "run | sweep | resume | merge | check | template"),
        (["rnu", "deck.nml"], "nearest is 'run'"),
        (["run"], "run DECK"),
        (["run", "deck.nml", "--overwite"], "nearest is '--overwrite'"),
        (["run", "deck.nml", "deck.nml", "-o", "x.h5"], "one by one"),
        (["run", "deck.nml", "-o"], "-o FILE"),
        (["check", "deck.nml", "--quiet"], "remove it"),
        (["resume"], "resume FILE.h5"),
        (["resume", "x.h5", "--overwrite"], "remove it"),
        (["template", "ful"], "nearest is 'full'"),
    ],
)
def test_wrong_usage(arguments, remedy, program, tmp_path):
    write(tmp_path, GOOD)
    result = program(*arguments)
    assert result.returncode == 1
    assert result.stderr.startswith("dynstiction: ")
    assert remedy in result.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"deck.nml"}


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["run", "--help"], ["check", "--help"], ["template", "-h"], ["stability", "--help"]],
)
def test_help(arguments, program):
    result = program(*arguments)
    assert (result.returncode, result.stderr) == (0, "")
    text = result.stdout
    assert "Usage:" in text
    assert "Exit status:" in text
    assert arguments[0] == "--help" or f"dynstiction {arguments[0]}" in text


def test_version(program):
    result = program("--version")
    assert result.returncode == 0
    assert re.match(r"dynstiction \d+\.\d+", result.stdout)


def bounded(executable: Path, folder: Path, megabytes: int, *arguments: str) -> tuple[int, str, float]:
    """Exit status, first words on standard error and processor time [s] of a call that may have so much memory for its data."""
    errors = folder / "errors"
    # AddressSanitizer needs more room for itself.
    limit = "" if "ASAN_OPTIONS" in os.environ else f"ulimit -d {1000 * megabytes}; "
    command = ["sh", "-c", limit + 'exec "$@"', "sh", executable, *arguments]
    with errors.open("wb") as stream:
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=stream)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    with errors.open("rb") as stream:
        words = stream.read(1000).decode(errors="replace")
    return process.returncode, words, usage.ru_utime + usage.ru_stime


def test_a_deck_of_100_MB_is_refused_by_its_size(executable, tmp_path):
    deck = tmp_path / "deck.nml"
    with deck.open("wb") as stream:
        for _ in range(100):
            stream.write((GOOD + "!" * 10**6)[: 10**6].encode())
    status, words, seconds = bounded(executable, tmp_path, 90, "run", "deck.nml")
    assert (status, words.count("\n")) == (2, 1)
    assert "100000000 bytes are too many, at most 1000000 are read" in words
    assert seconds < 1.0


# As long as a deck may be.
MONOTONOUS = ("&", "&scene ", "&scene\n/\n", "/", "'", '"', "!", "\n", "\r\n", "\t", ",", "=", "9", "1*", "99999999*1.0 ", "-", "(", "µ",
              "fields = ", "mass = 1\n", "&output fields = 'u_x' /\n", "&output fields(1)%x = 1 /\n", "$", "\\", "a")  # fmt: skip


@pytest.mark.parametrize("pattern", MONOTONOUS, ids=ascii)
def test_a_monotonous_deck_is_refused_soon(executable, tmp_path, pattern):
    for beginning in ("", "&system mass = ", "&output fields = "):
        repeated = beginning.encode() + (pattern * (10**6 // len(pattern.encode()))).encode()
        write(tmp_path, repeated[: 10**6])
        status, words, seconds = bounded(executable, tmp_path, 500, "check", "deck.nml")
        assert status == 2, words
        assert words.startswith("dynstiction: deck.nml:")
        assert seconds < 10.0


def test_a_setting_as_long_as_a_command_line_may_have(executable, tmp_path):
    write(tmp_path, GOOD)
    for pattern in ("1*", "9", "'", "µ", "scene.t_end="):
        setting = "scene.t_end=" + pattern * (100_000 // len(pattern.encode()))
        status, words, seconds = bounded(executable, tmp_path, 500, "check", "deck.nml", "--set", setting)
        assert status == 2, words
        assert seconds < 2.0
