"""Random calls of the public Python API (tests/fuzz/api.py): a share of them in each test."""

from __future__ import annotations

import sys

import pytest
from programs import ROOT, Program

FUZZER = Program((sys.executable, ROOT / "tests" / "fuzz" / "api.py"))


def fuzz(calls: int, seed: int) -> None:
    done = FUZZER("--calls", calls, "--seed", seed, timeout=None)
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
    assert f"{calls} calls, seed {seed}: 0 findings" in done.stdout


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.full)])
def test_random_calls(seed: int) -> None:
    fuzz(1000, seed)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(3, 13))
def test_many_random_calls(seed: int) -> None:
    fuzz(2000, seed)
