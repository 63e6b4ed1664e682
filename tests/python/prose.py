"""Words that pages should not use: proselint with the list of docs/vocabulary.md.

`faults(page)` are the places of a page, code left out; of a source file, those of its comments and texts. From a shell:
`python tests/python/prose.py README.md docs/*.md src/*/*.f90`.
"""

from __future__ import annotations

import argparse
import io
import re
import sys
import tokenize
from functools import cache
from pathlib import Path

from proselint import checks
from proselint.registry.checks import Check, Padding
from proselint.registry.checks.engine import Fancy
from proselint.registry.checks.types import PreferredForms
from proselint.tools import LintFile

ROOT = Path(__file__).resolve().parents[2]
VOCABULARY = ROOT / "docs" / "vocabulary.md"

CODE = re.compile(
    r"^(?P<fence>```|~~~).*?^(?P=fence)\s*?$|^<!--.*?-->|`[^`\n]*`|\$\$.*?\$\$|\$[^$\n]+\$|^(?: {4}|\t)[^*\s-].*?$|\]\([^)]*\)|\{[^}\n]*\}",
    re.MULTILINE | re.DOTALL,
)
"""Fenced and indented blocks, comments, names in code font, equations, targets of links."""

GENERAL = ("archaism", "cliches", "malapropisms", "mondegreens", "nonwords", "redundancy")
"""Proselint's own checks that fit technical pages; its typography and its American spelling do not."""


def forbidden(text: str) -> dict[str, str]:
    """Pattern and replacement of each form in the table of section "Words"."""
    table = text.partition("\n## Words\n")[2]
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \|$", table, re.MULTILINE)[1:]
    return {pattern(form): instead for forms, instead in rows if "---" not in forms for form in forms.split(", ")}


def pattern(form: str) -> str:
    """Blanks match line ends, too; an ellipsis up to five words of a sentence."""
    some = r"(?:\s+[^\s.;:|]+){0,5}?"
    return re.escape(form.strip()).replace(r"\ …", some).replace(r"\ ", r"\s+")


@cache
def rules() -> tuple[Check, ...]:
    """Ours, then proselint's."""
    words = PreferredForms(forbidden(VOCABULARY.read_text(encoding="utf-8")), Padding.STRICT_WORDS_IN_TEXT)
    ours = Check(words, engine=Fancy(), path="vocabulary", message="'{1}': write '{0}'")
    return (ours, *(check for check in checks.__register__ if check.path.split(".")[0] in GENERAL))


def prose(text: str) -> str:
    """The text with code replaced by blanks, so that lines and columns stay."""
    return CODE.sub(lambda code: re.sub(r"[^\n]", "\u2007", code[0]), text)


NAME_AND_TYPE = re.compile(r"^ *[*\w, ]+ : \S.*$")
"""Line of a docstring with a parameter's name and type."""


def python_prose(source: str) -> str:
    """Comments and texts of a Python file, line by line, without the names and types of parameters and texts of one word."""
    lines = [[" "] * len(line) for line in source.split("\n")]
    kinds = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in kinds and " " in token.string:
            row, column = token.start
            for i, line in enumerate(token.string.split("\n")):
                begin = 0 if i else column
                lines[row - 1 + i][begin : begin + len(line)] = line
    # Without the indentation, which would make it code.
    return "\n".join(NAME_AND_TYPE.sub("", "".join(line)).lstrip() for line in lines)


def fortran_prose(source: str) -> str:
    """Comments and texts of a Fortran file, line by line."""
    found = (re.findall(r"'[^'\n]*'|![^\n]*", line) for line in source.split("\n"))
    return "\n".join(" ".join(part.strip("'!<>") for part in parts) for parts in found)


READERS = {".py": python_prose, ".f90": fortran_prose, ".inc": fortran_prose, ".in": fortran_prose}


def faults_in(text: str, name: str) -> list[str]:
    """`name:line: 'word': write 'other word'`, in the order of the text."""
    file = LintFile(name, prose(READERS.get(Path(name).suffix, str)(text)))
    found = {
        (file.line_col_of(result.span[0])[0], " ".join(result.message.split()))
        for rule in rules()
        for result in rule.check_with_flags(file.content)
    }
    return [f"{name}:{line}: {message}" for line, message in sorted(found)]


def faults(page: Path) -> list[str]:
    text = page.read_text(encoding="utf-8")
    if page == VOCABULARY:
        text = text.partition("\n## Words\n")[0]
    return faults_in(text, page.relative_to(ROOT).as_posix())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Print the words of files that docs/vocabulary.md replaces, with file and line.")
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    places = [place for file in parser.parse_args().files for place in faults(file.resolve())]
    print(*places, sep="\n", end="\n" if places else "")
    sys.exit(bool(places))
