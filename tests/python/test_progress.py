"""How far a run has come: one line that updates on a terminal, plain lines elsewhere, nothing when that is asked for."""

from __future__ import annotations

import re
from functools import partial

import pytest
from fig3 import DECK
from programs import INPUTS, Program, on_terminal

WIPED = "\r\x1b[K"

pytestmark = pytest.mark.deck
# Each cycle by steps: longer than any test waits.
LASTING = ("scene.t_end=1e5", "output.interval=1e5", "integrator.cycle_map=off")
ENDLESS = ("run", DECK, "-o", "x.h5", *(word for setting in LASTING for word in ("--set", setting)))


def shown_by(program: Program, *arguments: object) -> str:
    return on_terminal(partial(program.start, *arguments, env={"OMP_NUM_THREADS": "2"}))


def test_a_run_on_a_terminal(program):
    text = shown_by(program, *ENDLESS, "--set", "output.wall_limit=0.7")
    shown = re.findall(r"\r(\S+fig3\.nml): +([\d.]+) %, t = (\S+) of (\S+) s, ([\w. ]+) left\x1b\[K", text)
    assert len(shown) >= 2
    times = [float(time) for _, _, time, _, _ in shown]
    assert times == sorted(times)
    assert {float(total) for *_, total, _ in shown} == {1e5}
    assert all(abs(float(share) - time / 1e3) < 0.06 + 6e-3 * time / 1e3 for (_, share, *_), time in zip(shown, times, strict=True))
    # The line is wiped before the last word, which stays.
    assert WIPED + "dynstiction: " in text
    assert text.count("\n") == 1


def test_a_sweep_on_a_terminal(program, tmp_path):
    deck = tmp_path / "map.nml"
    grid = "\n&sweep\n parameter = 'system.misalignment_deg', first = 1.0, last = 8.0, count = 400000\n/\n"
    deck.write_text((INPUTS / "low_frequency.nml").read_text() + grid)
    text = shown_by(program, "run", "map.nml", "-o", "x.h5", "--set", "output.wall_limit=0.7")
    shown = re.findall(r"\rmap\.nml: (\d+) of 400000 cases, 0 failed, [\d.e]+ cases/s, ([\w. ]+) left\x1b\[K", text)
    assert len(shown) >= 2
    assert 0 < int(shown[0][0]) <= int(shown[-1][0]) < 400000
    assert WIPED in text


def test_nothing_is_said_when_that_is_asked_for(program):
    text = shown_by(program, *ENDLESS, "--quiet", "--set", "output.wall_limit=0.5")
    assert text.startswith("dynstiction: ")
    assert text.count("\n") == 1


@pytest.mark.full
def test_plain_lines_elsewhere(program):
    """Every 10 s."""
    done = program(*ENDLESS, "--set", "output.wall_limit=21")
    lines = done.stderr.splitlines()
    assert len(lines) == 3
    assert all(re.search(r"%, t = .* left$", line) for line in lines[:2])
    assert "\x1b" not in done.stderr
