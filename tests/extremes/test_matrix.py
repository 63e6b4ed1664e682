"""Every parameter at its ends, singly and in pairs: each cell ends in a sound result or in an error that helps."""

from __future__ import annotations

import collections
import itertools
import os
import random

import pytest
from invariants import finish
from matrix import ENDS, KINDS, MAX_STEPS, Cell, Kind, cells

SHARE, SEED = 400, 20201
"""Pairs of the default run, and what chooses them."""


def faults_of(chosen: list[Cell]) -> list[str]:
    """Faults with the names of their cells."""
    return [f"{cell.name}: {fault}" for cell in chosen for fault in finish(cell.groups()).faults]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_singles(kind: Kind) -> None:
    chosen = [cell for cell in cells(pairs=False) if cell.kind == kind]
    assert len(chosen) > 20
    assert faults_of(chosen) == []


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


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13"])
def test_radau_methods_give_up_rarely(method: str) -> None:
    """Of the singles of the full model all but the frontier of tests/extremes/README.md end in a result."""
    kind = next(kind for kind in KINDS if kind.name == f"full {method}")
    codes = collections.Counter(finish(cell.groups()).code for cell in cells(pairs=False) if cell.kind == kind)
    assert codes[0] >= sum(codes.values()) - 2


def test_every_pair_of_axes_is_there() -> None:
    pairs = {tuple(sorted(end.axis for end in cell.ends)) for cell in cells(pairs=True)}
    axes = sorted({end.axis for end in ENDS})
    assert pairs == set(itertools.combinations(axes, 2))


def test_a_run_cannot_hang() -> None:
    steps = [cell.groups() for cell in cells(pairs=False) if not cell.kind.closed_form]
    assert {groups["integrator"].get("max_steps") for groups in steps} == {MAX_STEPS}
