"""README, manual and the comments and texts of the sources use the words of docs/vocabulary.md."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from pages import DOCS, ROOT

if importlib.util.find_spec("proselint") is None:
    pytest.skip("proselint is not installed: pip install proselint", allow_module_level=True)

from prose import VOCABULARY, faults, faults_in, forbidden, pattern

PAGES = sorted({ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")})
FORTRAN = ("src", "python/core", "tests/unit")
PYTHON = ("python/dynstiction", "bench", "docs", "tools", "tests")
ENDINGS = {"f90": FORTRAN, "inc": FORTRAN, "py": PYTHON}
# They contain the words to be found.
EXCEPT = {"prose.py", "test_prose.py"}
FOUND = {path for ending, folders in ENDINGS.items() for folder in folders for path in (ROOT / folder).rglob(f"*.{ending}")}
SOURCES = sorted(path for path in FOUND if path.name not in EXCEPT)


@pytest.mark.parametrize("page", [*PAGES, *SOURCES], ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_words_of_a_page(page: Path) -> None:
    found = faults(page)
    assert not found, "\n".join(["see docs/vocabulary.md", *found])


def test_a_word_is_found_with_its_line_and_its_replacement() -> None:
    text = "# A title\n\nThe tests hold the law\nagainst its formula, and `hold x against y`.\n\n```sh\ngo on with this\n```\n\nThen it goes\non with it.\n"
    assert faults_in(text, "page.md") == [
        "page.md:3: 'hold the law against': write 'compare with, check against'",
        "page.md:10: 'goes on with': write 'resume, continue'",
        "page.md:10: 'goes on': write 'continue'",
    ]


def test_comments_and_texts_of_source_files_are_read() -> None:
    fortran = "!> It goes on.\nknows = told('a \\\"mend\\\"') ! by itself\n"
    assert [place.split(":")[1:3] for place in faults_in(fortran, "x.f90")] == [
        ["1", " 'goes on'"],
        ["2", " 'by itself'"],
        ["2", " 'mend'"],
    ]
    python = 'told = 1  # it tells\n"""A text.\n\nIt knows.\n"""\n'
    assert [place.split(":")[1:3] for place in faults_in(python, "x.py")] == [["1", " 'tells'"], ["4", " 'knows'"]]
    indented = '    """The fit.\n\n    told : bool\n        It knows.\n    """\n    return "told"\n'
    assert [place.split(":")[1:3] for place in faults_in("def f():\n" + indented, "x.py")] == [["5", " 'knows'"]]


def test_a_check_of_proselint_is_used() -> None:
    assert any("page.md:2:" in place for place in faults_in("Fine.\nThe end result is an added bonus.\n", "page.md"))


def test_every_row_of_the_list_is_found() -> None:
    rules = forbidden(VOCABULARY.read_text(encoding="utf-8"))
    assert len(rules) > 60
    assert pattern("hold … against") in rules
    for rule in rules:
        form = rule.replace(r"(?:\s+[^\s.;:|]+){0,5}?", " two words").replace(r"\s+", " ").replace("\\", "")
        assert faults_in(f"Before {form} after.\n", "page.md"), form
