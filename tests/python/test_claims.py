"""What the manual says of the paper is what the program gives."""

from __future__ import annotations

import re
import sys

import pytest
from programs import ROOT, script

replicate = script(ROOT / "tools" / "replicate.py")


@pytest.mark.parametrize("claim", replicate.CLAIMS, ids=range(len(replicate.CLAIMS)))
def test_each_claim(claim, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    found = claim.value()
    assert abs(found - claim.expected) <= claim.tolerance, claim.command
    # A tolerance tells the value from nothing, and from one that is off by a tenth.
    assert claim.tolerance <= 0.05 * abs(claim.expected) or claim.expected == 0.0


def test_the_page_has_these_claims() -> None:
    page = (ROOT / "docs" / "claims.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| .*\|$", page, re.MULTILINE)[2:]
    shown = [claim.row(0.0).rpartition(" | ")[0] for claim in replicate.CLAIMS]
    assert [row.rpartition(" | ")[0] for row in rows] == shown


def test_what_is_not_as_expected_is_counted(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replicate, "CLAIMS", (replicate.Claim("here", "2", "holds", "1 + 2", 2.0, 0.5),))
    monkeypatch.setattr(sys, "argv", ["replicate.py"])
    assert replicate.main() == 1
    assert "| 3 |" in (told := capsys.readouterr().out) and told.endswith("0 as expected, 1 not\n")


def test_every_reference_has_an_entry() -> None:
    entries = set(re.findall(r"@\w+\{(\w+),", (ROOT / "docs" / "references.bib").read_text(encoding="utf-8")))
    text = "".join((ROOT / page).read_text(encoding="utf-8") for page in ("docs/claims.md", "paper/paper.md"))
    cited = {name for group in re.findall(r"\[([^\]]+)\](?!\()", text) for name in re.findall(r"\w+\d{4}", group)}
    assert cited == entries
