"""The list of changes that no test need notice (tests/mutation/equivalent.csv) speaks of code that is there."""

from __future__ import annotations

import csv
import re

import pytest
from programs import ROOT

ROWS = list(csv.DictReader((ROOT / "tests" / "mutation" / "equivalent.csv").read_text(encoding="utf-8").splitlines()))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['file']}-{row['procedure']}")
def test_the_statement_is_there(row: dict[str, str]) -> None:
    (source,) = ROOT.glob(f"src/*/{row['file']}")
    text = re.sub(r"\s*&\s*\n\s*", " ", source.read_text(encoding="utf-8"))
    procedure = re.search(rf"^ *[^!\n]*\b(subroutine|function) {row['procedure']}\b.*?^ *end \1", text, re.MULTILINE | re.DOTALL)
    assert procedure is not None and row["original"] in procedure[0]
