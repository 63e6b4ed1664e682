"""Random scenes for each row of what must not matter, and that each row sees what it is for.

The bounded run has the same scenes each time, --full fresh ones: DYNSTICTION_SEED repeats them.
"""

from __future__ import annotations

import os

import invariance as iv
import pytest
from fig3 import changed

FULL = "DYNSTICTION_FULL" in os.environ
SEED = int(os.environ["DYNSTICTION_SEED"]) if FULL else 2
SCENES = 200 if FULL else 40


@pytest.mark.parametrize("row", iv.ROWS)
def test_what_must_not_matter(row: str) -> None:
    outcomes = [iv.judge(iv.ROWS[row], SEED, number) for number in range(SCENES)]
    wrong = [f"{outcome}\n{outcome.decks}" for outcome in outcomes if outcome.said.faults]
    if wrong:
        pytest.fail(f"{row}: {len(wrong)} of {SCENES} scenes of seed {SEED}\n" + "\n".join(wrong), pytrace=False)
    # A suite that judges nothing would be silent, too.
    assert sum(bool(outcome.ended) for outcome in outcomes) < SCENES / 4, f"seed {SEED}"
    assert sum(len(outcome.said.unjudged) for outcome in outcomes) < sum(outcome.said.values for outcome in outcomes) / 4, (
        f"seed {SEED}"
    )


@pytest.mark.parametrize("row", iv.ROWS)
def test_a_difference_is_seen(row: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundredth more load in the second scene."""
    make = iv.pair_of

    def heavier(*arguments: object) -> iv.Pair:
        first, second, image = make(*arguments)
        load = iv.number_of(second, "friction", "normal_load")
        return first, changed(second, {"friction": {"normal_load": 1.01 * load}}), image

    monkeypatch.setattr(iv, "pair_of", heavier)
    assert any(iv.judge(iv.ROWS[row], 1, number).said.faults for number in range(6))
