"""The reference motions for simulators are those of this program, and a simulator can be compared with them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from programs import ROOT, Program, script

FOLDER = ROOT / "bench" / "simulators"


def test_the_files_are_the_motions(tmp_path: Path) -> None:
    done = Program((sys.executable, FOLDER / "scenes.py"), tmp_path)("--check", status=0)
    assert done.stdout.count("as stated") == len(list(FOLDER.glob("*.csv"))) == len(list(FOLDER.glob("*.nml"))) == 5


def test_a_wrong_file_is_found(tmp_path: Path) -> None:
    for path in (*FOLDER.glob("creep.*"), FOLDER / "scenes.py"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    table = tmp_path / "creep.csv"
    lines = table.read_text().splitlines()
    time, x, *rest = lines[-1].split(",")
    lines[-1] = ",".join([time, repr(float(x) * (1 + 1e-11)), *rest])
    table.write_text("\n".join(lines) + "\n")
    assert "creep.csv: DIFFERS" in Program((sys.executable, tmp_path / "scenes.py"), tmp_path)("--check", status=1).stdout


def test_a_simulator_agrees_with_a_stiff_contact() -> None:
    pytest.importorskip("mujoco", reason="pip install mujoco")
    mujoco_peer = script(FOLDER / "mujoco_peer.py")
    keys, knots, table = mujoco_peer.read(FOLDER / "creep.csv")
    x = mujoco_peer.advance(keys, knots, table, 1e-5, "elliptic", 100, 0, 0.002)
    assert abs(x[-1] / table[-1, 1] - 1.0) < 0.02
