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


# One of each kind; tests/unit/test_deck.f90 has the others. Name: deck, line (0 = none), offending word, remedy.
BAD: dict[str, tuple[str | bytes, int, str, str]] = {
    "blank": ("  \n\n", 1, "no group", "&scene"),
    "no scene": (GOOD[GOOD.index("&system") :], 14, "&scene", "t_end"),
    "unknown group": (GOOD + "&sytem\n x = 1\n/\n", 19, "'&sytem'", "nearest is &system"),
    "repeated group in capitals": (GOOD + "&SCENE\n/\n", 19, "&scene", "line 1"),
    "no group name": (instead("&scene", "& scene"), 1, "'&'", "right after it"),
    "unknown key": (with_line("title", " titel = 'x'"), 3, "'titel'", "nearest is 'title'"),
    "key with hyphen": (instead("t_end =", "t-end ="), 3, "'t-end'", "nearest is 't_end'"),
    "short key": (instead("stiffness_x", "stiffness"), 7, "'stiffness'", "nearest is 'stiffness_x'"),
    "letter that is not ASCII": (with_line("mu_0", " µ_0 = 0.2"), 13, "'µ_0'", "mu_0"),
    "wrong group, physical": (instead("t_end = 1.0e-3", "t_end = 1.0e-3 v_f = 1"), 3, "'v_f'", "&friction"),
    "repeated key in capitals": (with_line("t_end", "  T_END = 2.0"), 4, "'t_end'", "line 3"),
    "empty value before a comment": (instead("mass = 0.25", "mass = ! 0.25"), 6, "'mass'", "give a value"),
    "decimal comma": (instead("0.25", "0,25"), 6, "'mass', from '25' on: 2 given", "at most 1"),
    "underscore": (instead("1.0e7", "10_000_000"), 8, "'10_000_000'", "finite real number"),
    "negative integer": (GOOD + "&integrator max_steps = -1 /\n", 19, "'-1'", ">= 0"),
    "negative load": (instead("= 10.0", "= -10.0"), 14, "normal_load = '-10.0'", ">= 0.0 (in N)"),
    "more than a turn": (instead("_deg = 1.0", "_deg = 361"), 9, "misalignment_deg = '361'", "<= 360.0 (in deg)"),
    "tolerance too large": (GOOD + "&integrator rtol = 1.0 /\n", 19, "rtol = '1.0'", "<= 0.1"),
    "tolerance too small": (GOOD + "&integrator rtol = 1e-16 /\n", 19, "rtol = '1e-16'", ">= 1.0e-13"),
    "huge repeat count": (
        instead("= 1.0e-3\n/\n", "= 1.0e-3\n/\n&output fields = 999999999999*'u_x' /\n"),
        5,
        "'fields'",
        "at most",
    ),
    "zero repeat count": (instead("0.25", "0*0.25"), 6, "'0*0.25'", "1 or more"),
    "missing last slash": (GOOD.rstrip("/\n"), 17, "missing '/'", "end the group &drive"),
    "unclosed double quote": (instead("'a test'", "\"a test'"), 2, "unclosed quote \"a test'", 'close it with "'),
    "text after the slash": (instead("/\n&system", "/ end\n&system"), 4, "'end'", "after a '!'"),
    "hash comment in a group": (with_line("t_end", "  # comment"), 4, "'#'", "at most 1"),
    "value before a key": (instead("&drive\n", "&drive\n  3.0\n"), 17, "'3.0'", "KEY = VALUE"),
    "colon": (instead("mass =", "mass:"), 6, "'mass:' without '='", "KEY = VALUE"),
    "binary": (b"MZ\n" + bytes(range(1, 256)), 2, "control characters", "plain UTF-8 text"),
    "result": (b"\x89HDF\r\n\x1a\n" + bytes(range(256)), 0, "is a result or another HDF5 file", "dynstiction show"),
    "long result": (b"\x89HDF\r\n\x1a\n" + bytes(2_000_000), 0, "is a result or another HDF5 file", "dynstiction show"),
    "UTF-16": (GOOD.encode("utf-16"), 1, "NUL", "plain UTF-8 text"),
    "empty": ("", 0, "is empty", "&scene"),
    "unknown model": (with_line("title", " model = 'ful'"), 3, "'ful'", "nearest is 'full'"),
    "model in capitals": (with_line("title", " model = 'FULL'"), 3, "'FULL'", "nearest is 'full'"),
    "v_smooth with exact": (with_line("v_f", " v_smooth = 1e-6"), 14, "'v_smooth'", "contact smoothed"),
    "missing key": (instead("  mass = 0.25\n", ""), 5, "'mass'", "add mass = VALUE in kg"),
    "profile, three equal": (instead("velocity = 1.0e-3", "velocity = 4*1 time = 0, 3*1"), 17, "time(4)", "twice for a jump"),
}


# A deck with two faults on purpose; every other bad deck must give exactly one message.
SEVERAL = {"blank"}


@pytest.mark.parametrize("name", BAD)
def test_bad_deck(name, program, tmp_path):
    """Exit status 2; file, line, offending word and remedy in one message; nothing written, nothing overwritten."""
    content, line, word, remedy = BAD[name]
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
    assert len(messages) == 1 or name in SEVERAL
    assert result.stdout == ""
    assert (tmp_path / "old.h5").read_bytes() == kept

    assert program("run", deck).returncode == 2
    assert program("check", deck).stderr == result.stderr
    assert {path.name for path in tmp_path.iterdir()} == before


def test_good_deck_is_good(program, tmp_path):
    """What the bad decks are made from has no fault of its own."""
    result = program("check", write(tmp_path, GOOD))
    assert (result.returncode, result.stderr) == (0, "")


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


def resolved(program: Program, content: str, *settings: str) -> str:
    return program("check", write(program.folder, content), settings=settings, status=0).stdout


def test_resolved_marks_user_and_default(program, tmp_path):
    keys = [line for line in resolved(program, GOOD).splitlines() if " = " in line]
    assert all(re.search(r" ! (user|default)[,;] ", line) for line in keys)
    marked = {line.split()[0] for line in keys if " ! user" in line}
    assert marked == set(re.findall(r"(\w+) = ", GOOD))


def test_template_is_a_deck(program, tmp_path):
    result = program("template")
    assert result.returncode == 0
    assert program("template", "full").stdout == result.stdout
    text = resolved(program, result.stdout)
    fig3 = program("check", str(INPUTS / "fig3.nml")).stdout
    own = ("  file = ", "  interval = ", "  method = ")
    assert [v for v in values(text) if not v.startswith(own)] == [v for v in values(fig3) if not v.startswith(own)]


def test_inputs():
    """Each begins with a comment that explains it, and writes a file of its own name."""
    for deck in DECKS:
        text = deck.read_text()
        assert text.startswith("! ")
        assert f"  file = '{deck.stem}.h5'" in text
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
            assert key in {"v_smooth", "step", *law}
            del given[group][key]
    assert len(used) == 7 + ("sweep" in given)
    assert same(given, used)


def test_two_decks_cannot_share_an_output(program, tmp_path):
    for name in ("one.nml", "two.nml"):
        write(tmp_path, GOOD + f"&output file = '{'./' if name == 'two.nml' else ''}same.h5' /\n", name)
    result = program("run", "one.nml", "two.nml")
    assert result.returncode == 3
    assert "two decks write this file" in result.stderr
    assert not (tmp_path / "same.h5").exists()


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
