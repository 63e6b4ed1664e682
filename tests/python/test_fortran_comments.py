"""The Fortran sources, read as text: what is public has a documenting comment, `!>` before it or `!!` behind it, and nothing hides a unit."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from programs import ROOT

FOLDER = ROOT / "src"
SOURCES = sorted([*FOLDER.rglob("*.f90*"), *(ROOT / "python" / "core").glob("*.f90")])
PREFIX = r"(?:(?:pure|elemental|impure|recursive|module|logical|integer|real\(\w+\)|type\(\w+\)|character\([^)]*\))\s+)*"
DEFINITION = (
    rf"^ *(?:{PREFIX}(?:subroutine|function)|type(?:, *[^:\n]*)?(?: *::)?|interface|enumerator *::.*"
    r"|[a-z(][^!\n]*\b(?:parameter|protected|save|bind\(c\))[^:\n]*::(?:[^!\n]|&\n)*?) *\b{name}\b(?! *::).*"
)
COMMENT = r"^ *!>.*\n(?: *!.*\n|.*\bparameter\b[^:\n]*::.*\n)*"


def public_names(text: str) -> set[str]:
    lists = re.findall(r"^ *public :: ((?:[^!\n&]|& *\n)*)", text, re.MULTILINE)
    return {name.strip(" &\n").lower() for names in lists for name in names.split(",")}


def undocumented(text: str) -> list[str]:
    missing = [] if text.startswith("!>") else ["the file"]
    for name in sorted(public_names(text)):
        definition = DEFINITION.replace("{name}", re.escape(name))
        found = re.findall(definition, text, re.MULTILINE | re.IGNORECASE)
        # What is only passed on from another module is documented there.
        if (
            found
            and not any("!!" in line for line in found)
            and not re.search(COMMENT + definition, text, re.MULTILINE | re.IGNORECASE)
        ):
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
