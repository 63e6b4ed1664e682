"""Every parameter at its ends, singly and in pairs: each cell ends in a sound result or in an error that helps."""

from __future__ import annotations

import os
import random

import pytest
from invariants import finish
from matrix import KINDS, Cell, Kind, cells

SHARE, SEED = 400, 20201
"""Pairs of the default run, and what chooses them."""


def faults_of(chosen: list[Cell]) -> list[str]:
    """Faults with the names of their cells."""
    return [f"{cell.name}: {fault}" for cell in chosen for fault in finish(cell.groups()).faults]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_singles(kind: Kind) -> None:
    """Of the full model all but the frontier of tests/extremes/README.md end in a result with the Radau methods."""
    chosen = [cell for cell in cells(pairs=False) if cell.kind == kind]
    assert len(chosen) > 20
    endings = [finish(cell.groups()) for cell in chosen]
    assert [f"{cell.name}: {fault}" for cell, ending in zip(chosen, endings, strict=True) for fault in ending.faults] == []
    if kind.name in {"full radau5", "full radau9", "full radau13"}:
        assert sum(ending.code == 0 for ending in endings) >= len(endings) - 2


def test_a_share_of_the_pairs() -> None:
    every = list(cells(pairs=True))
    chosen = random.Random(SEED).sample(every, SHARE)
    assert {cell.kind for cell in chosen} == set(KINDS)
    assert faults_of(chosen) == []


@pytest.mark.full
@pytest.mark.skipif("DYNSTICTION_FULL" not in os.environ, reason="set DYNSTICTION_FULL=1")
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_all_pairs(kind: Kind) -> None:
    assert faults_of([cell for cell in cells(pairs=True) if cell.kind == kind]) == []
