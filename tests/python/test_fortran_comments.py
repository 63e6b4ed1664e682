"""The Fortran sources, read as text: what is public has a documenting comment, `!>` before it or `!!` behind it, and nothing hides a unit."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from programs import ROOT

FOLDER = ROOT / "src"
SOURCES = sorted([*FOLDER.rglob("*.f90*"), *(ROOT / "python" / "core").glob("*.f90")])
PREFIX = r"(?:(?:pure|elemental|impure|recursive|module|logical|integer|real\(\w+\)|type\(\w+\)|character\([^)]*\))\s+)*"


def statements(text: str) -> list[tuple[int, str]]:
    """Line number and text of each statement, continuation lines joined."""
    found: list[tuple[int, str]] = []
    going_on = False
    for number, line in enumerate(text.splitlines()):
        code = line.strip()
        if code.startswith("!"):
            continue
        if going_on:
            found[-1] = (found[-1][0], found[-1][1].rstrip("& ") + " " + code.lstrip("&"))
        else:
            found.append((number, code))
        going_on = bool(re.search(r"&\s*(!.*)?$", code))
    return found


def public_names(text: str) -> set[str]:
    lists = (re.match(r"public :: (.*)", statement) for _, statement in statements(text))
    return {name.strip().lower() for names in lists if names for name in names[1].split("!")[0].split(",")}


def defines(statement: str, name: str) -> bool:
    word = re.escape(name)
    return bool(
        re.match(rf"{PREFIX}(?:subroutine|function)\s+{word}\b", statement, re.IGNORECASE)
        or re.match(rf"type(?:\s*,[^:]*)?(?:\s*::)?\s*{word}$", statement, re.IGNORECASE)
        or re.match(rf"interface\s+{word}\b", statement, re.IGNORECASE)
        or re.match(rf"[a-z].*\b(?:parameter|protected|save|bind\(c\)).*::.*\b{word}\b\s*(?:\([^)]*\))?\s*=?", statement, re.IGNORECASE)
        or re.match(rf"enumerator\s*::.*\b{word}\b", statement, re.IGNORECASE)
    )  # fmt: skip


def has_comment(lines: list[str], number: int) -> bool:
    """Whether line `number`, or its paragraph of declarations, has a comment."""
    if "!!" in lines[number]:
        return True
    declaration = "::" in lines[number] and "procedure" not in lines[number]
    while number > 0:
        number -= 1
        above = lines[number].strip()
        if above.startswith("!>"):
            return True
        if not (declaration and "::" in above and "parameter" in above):
            return False
    return False


def undocumented(text: str) -> list[str]:
    lines = text.splitlines()
    missing = [] if lines[0].startswith("!>") else ["the file"]
    for name in sorted(public_names(text)):
        places = [number for number, statement in statements(text) if defines(statement, name)]
        # What is only passed on from another module is documented there.
        if places and not any(has_comment(lines, number) for number in places):
            missing.append(name)
    return missing


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.name)
def test_what_is_public_is_documented(source: Path) -> None:
    missing = undocumented(source.read_text(encoding="utf-8"))
    assert not missing, f"src/{source.name}: no documenting comment (!>) at {', '.join(missing)}"


FORBIDDEN = {
    # gfortran compiles it with a scale that begins at 1, so that its last bits change with the unit.
    r"\bnorm2\s*\(": "hypot or sqrt(sum(x**2)) in place of norm2",
    # Memory that gfortran 12 frees twice.
    r"=>\s*(trim|adjustl|repeat)\s*\(": "associate with the text itself, or a variable",
}


def forbidden(text: str) -> list[tuple[int, str]]:
    """Line numbers, and what to write in place of what stands there."""
    code = [line.split("!")[0] for line in text.lower().splitlines()]
    return [(number, why) for what, why in FORBIDDEN.items() for number, line in enumerate(code, 1) if re.search(what, line)]


@pytest.mark.parametrize("source", [*SOURCES, *sorted(FOLDER.rglob("*.inc"))], ids=lambda source: source.name)
def test_nothing_is_written_that_the_compiler_makes_wrong(source: Path) -> None:
    assert forbidden(source.read_text(encoding="utf-8")) == []


def test_the_check_finds_it() -> None:
    assert [line for line, _ in forbidden("a = 1\nb = Norm2 (w) ! no\n! norm2(w)\nnorm2_of = 1\n")] == [2]
    assert [line for line, _ in forbidden("associate (a => b, c => trim (d))\nassociate (e => f) ! => trim(f)\n")] == [1]


def test_the_check_finds_what_is_missing() -> None:
    module = "!> What it is.\nmodule m\n  public :: one, two, three\n  integer, parameter :: three = 3\ncontains\n"
    routines = "  !> Said.\n  subroutine one()\n  end subroutine one\n  pure real(wp) function two()\n  end function two\n"
    assert undocumented(module + routines) == ["three", "two"]
    assert undocumented("module m\nend module m\n") == ["the file"]
