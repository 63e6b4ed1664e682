"""Random calls of the public Python API (tests/fuzz/api.py): a share of them in each test."""

from __future__ import annotations

import sys

import pytest
from programs import ROOT, Program

FUZZER = Program((sys.executable, ROOT / "tests" / "fuzz" / "api.py"))


@pytest.mark.parametrize(
    ("seed", "calls"),
    [(1, 1000), *(pytest.param(seed, 1000 if seed == 2 else 2000, marks=pytest.mark.full) for seed in range(2, 13))],
)
def test_random_calls(seed: int, calls: int) -> None:
    done = FUZZER("--calls", calls, "--seed", seed, timeout=None)
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
    assert f"{calls} calls, seed {seed}: 0 findings" in done.stdout
