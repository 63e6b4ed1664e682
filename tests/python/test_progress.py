"""How far a run has come: one line that updates on a terminal, plain lines elsewhere, nothing when that is asked for."""

from __future__ import annotations

import os
import pty
import re
import subprocess
from pathlib import Path

import pytest

INPUTS = Path(__file__).parents[2] / "inputs"
WIPED = "\r\x1b[K"

pytestmark = pytest.mark.deck


def on_terminal(executable: Path, folder: Path, *arguments: str) -> str:
    """What a command writes to a terminal as its standard error, until it ends."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"OMP_NUM_THREADS": "2"}
    process = subprocess.Popen(
        [executable, *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=theirs, env=environment
    )
    os.close(theirs)
    text = b""
    try:
        while data := os.read(ours, 4096):
            text += data
    except OSError:  # Linux: the other end was closed
        pass
    os.close(ours)
    process.wait(timeout=60)
    return text.decode()


def test_a_run_on_a_terminal(executable, tmp_path):
    limits = ("--set", "scene.t_end=1e5", "--set", "output.interval=1.0", "--set", "output.wall_limit=0.7")
    text = on_terminal(executable, tmp_path, "run", str(INPUTS / "fig3.nml"), "-o", "x.h5", *limits)
    shown = re.findall(r"\r(\S+fig3\.nml): +([\d.]+) %, t = (\S+) of (\S+) s, ([\w. ]+) left\x1b\[K", text)
    assert len(shown) >= 2
    times = [float(time) for _, _, time, _, _ in shown]
    assert times == sorted(times)
    assert {float(total) for *_, total, _ in shown} == {1e5}
    assert all(
        abs(float(share) - time / 1e3) < 0.06 + 6e-3 * time / 1e3 for (_, share, *_), time in zip(shown, times, strict=True)
    )
    # The line is wiped before the last word, which stays.
    assert WIPED + "dynstiction: " in text
    assert text.count("\n") == 1


def test_a_sweep_on_a_terminal(executable, tmp_path):
    deck = tmp_path / "map.nml"
    grid = "\n&sweep\n parameter = 'system.misalignment_deg', first = 1.0, last = 8.0, count = 400000\n/\n"
    deck.write_text((INPUTS / "low_frequency.nml").read_text() + grid)
    text = on_terminal(executable, tmp_path, "run", "map.nml", "-o", "x.h5", "--set", "output.wall_limit=0.7")
    shown = re.findall(r"\rmap\.nml: (\d+) of 400000 cases, 0 failed, [\d.e]+ cases/s, ([\w. ]+) left\x1b\[K", text)
    assert len(shown) >= 2
    assert 0 < int(shown[0][0]) <= int(shown[-1][0]) < 400000
    assert WIPED in text


def test_a_comparison_on_a_terminal(executable, tmp_path):
    text = on_terminal(executable, tmp_path, "trade", str(INPUTS / "fig3.nml"), "-o", "x.h5", "--budget", "1")
    shown = re.findall(r"%, (.+?) = +(\S+) of +(\S+) s, ", text)
    assert shown
    assert {what for what, *_ in shown} == {"wall time"}
    assert all(float(done) <= float(total) == 1.0 for _, done, total in shown)


def test_nothing_is_said_when_that_is_asked_for(executable, tmp_path):
    limits = ("--set", "scene.t_end=1e5", "--set", "output.interval=1.0", "--set", "output.wall_limit=0.5")
    text = on_terminal(
        executable, tmp_path, "run", str(INPUTS / "fig3.nml"), "-o", "x.h5", "--quiet", *limits
    )
    assert text.startswith("dynstiction: ")
    assert text.count("\n") == 1


@pytest.mark.full
def test_plain_lines_elsewhere(executable, tmp_path):
    """Every 10 s."""
    limits = ("--set", "scene.t_end=1e5", "--set", "output.interval=1.0", "--set", "output.wall_limit=21")
    command = [executable, "run", INPUTS / "fig3.nml", "-o", tmp_path / "x.h5", *limits]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    lines = done.stderr.splitlines()
    assert len(lines) == 3
    assert all(re.search(r"%, t = .* left$", line) for line in lines[:2])
    assert "\x1b" not in done.stderr
