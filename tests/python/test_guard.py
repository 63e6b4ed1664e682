"""No file keeps a reader in an endless loop: what has no seal is read by a child process first, and one that crashes or loops is refused."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import dynstiction as ds
import h5py
import numpy as np
import pytest
from damage import changed, without_seal
from dynstiction import _guard, _open
from programs import FILE_ERROR, SCRIPT, Program

MOST_SECONDS = _guard.PATIENCE + 3.0
"""Processor time of a read, with that of the child and of its start [s]."""

READERS = {"run": "open", "sweep": "open_sweep", "trade": "open_trade", "trace": "read_trace"}

BEND = """
import json, random, resource, sys, warnings
import dynstiction as ds
warnings.simplefilter("ignore")
def used():
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in both)
sound, file, count, reader = open(sys.argv[1], "rb").read(), sys.argv[2], int(sys.argv[3]), getattr(ds, sys.argv[4])
found = {"refused": 0, "never ends": 0, "crashes": 0, "most": 0.0}
for seed in range(count):
    dice = random.Random(seed)
    data = bytearray(sound)
    data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    with open(file, "wb") as stream:
        stream.write(data)
    before = used()
    try:
        reader(file)
    except ds.Error as error:
        assert isinstance(error, ds.FileError) or reader is ds.read_trace, error
        assert file in str(error), error
        found["refused"] += 1
        for how in ("never ends", "crashes"):
            found[how] += how in str(error)
    found["most"] = max(found["most"], used() - before)
print(json.dumps(found))
"""
"""In a process of its own, because damage might end the process or never end."""


@pytest.fixture(scope="module")
def files(executable: Path, fig3_text: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A sound file of each kind."""
    folder = tmp_path_factory.mktemp("sound")
    program = Program((executable,), folder)
    (folder / "short.nml").write_text(fig3_text.replace("t_end = 10.0", "t_end = 0.02"))
    program("run", "short.nml", "-o", "run.h5", "--quiet", status=0)
    program("sweep", "short.nml", "--vary", "system.misalignment_deg=1:3:3", "-o", "sweep.h5", "--quiet", status=0)
    program("trade", "short.nml", "--budget", "1", "-o", "trade.h5", "--quiet", status=0)
    with h5py.File(folder / "trace.h5", "w") as file:
        for name, units in (("time", "s"), ("force", "N")):
            file[name] = np.linspace(0.0, 1.0, 50)
            file[name].attrs["units"], file[name].attrs["note"] = units, "of the rig in the cellar"
    found = {kind: folder / f"{kind}.h5" for kind in READERS}
    for kind, file in found.items():
        getattr(ds, READERS[kind])(file)
    return found


def bare(file: Path, folder: Path) -> Path:
    """A copy without a seal, as a killed run or another program leaves it."""
    copy = folder / f"bare_{file.name}"
    data = file.read_bytes()
    copy.write_bytes(data if file.name == "trace.h5" else without_seal(data))
    return copy


@pytest.mark.parametrize("count", [40, pytest.param(400, marks=pytest.mark.full)])
@pytest.mark.parametrize(
    ("kind", "sealed"), [(kind, sealed) for kind in READERS for sealed in (True, False) if kind != "trace" or not sealed]
)
def test_a_bent_file_is_read_or_refused_soon(files: dict[str, Path], tmp_path: Path, kind: str, sealed: bool, count: int) -> None:
    sound = files[kind] if sealed else bare(files[kind], tmp_path)
    done = SCRIPT(BEND, sound, tmp_path / "bent.h5", count, READERS[kind], timeout=60 + MOST_SECONDS * count, status=0)
    found = json.loads(done.stdout)
    print(f"{kind}, sealed: {sealed}: {found}")
    assert found["most"] < MOST_SECONDS, found
    assert found["refused"] >= (count - 2 if sealed else count / 10 if kind != "trace" else 0), found


def with_endless_heap(file: Path) -> None:
    """The first list of texts says after its first text: the rest is free, and takes no bytes. HDF5 never comes to its end."""
    data = bytearray(file.read_bytes())
    heap = data.index(b"GCOL\x01\0\0\0")
    (length,) = struct.unpack_from("<Q", data, heap + 24)
    struct.pack_into("<HHIQ", data, heap + 32 + -(-length // 8) * 8, 0, 0, 0, 0)
    file.write_bytes(data)


@pytest.mark.parametrize("kind", READERS)
def test_a_file_without_end_is_refused(files: dict[str, Path], tmp_path: Path, kind: str) -> None:
    file = bare(files[kind], tmp_path)
    getattr(ds, READERS[kind])(file)
    with_endless_heap(file)
    code = f"import dynstiction as ds, sys; ds.{READERS[kind]}(sys.argv[1])"
    done = SCRIPT(code, file, status=1, timeout=60)
    assert "FileError" in done.stderr and file.name in done.stderr and "damaged" in done.stderr, done
    if kind == "trace":
        assert "never ends in HDF5" in done.stderr


def test_commands_refuse_a_trace_without_end(files: dict[str, Path], tmp_path: Path, package: Program, fig3_text: str) -> None:
    file = bare(files["trace"], tmp_path)
    with_endless_heap(file)
    (tmp_path / "deck.nml").write_text(fig3_text)
    assert "never ends" in package("compare", "deck.nml", file, status=FILE_ERROR, timeout=60).stderr


def test_a_loop_that_only_the_child_finds(files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the search for damaged lists: as with any other damage that leads HDF5 in a circle."""
    file = bare(files["run"], tmp_path)
    with_endless_heap(file)
    child = "\nimport dynstiction._judge as judge\njudge._Judge.heaps = lambda self: None\n"
    place = _guard.CHILD.index("_guard.send_copy")
    monkeypatch.setattr(_guard, "CHILD", _guard.CHILD[:place] + child + _guard.CHILD[place:])
    with pytest.raises(ds.FileError, match=r"bare_run\.h5: is damaged: reading it never ends in HDF5: take a sound copy"):
        ds.open(file)


@pytest.mark.parametrize(
    ("child", "message"),
    [
        ("import os; os.abort()", "reading it crashes in HDF5"),
        ("raise ImportError('no h5py here')", "the child process that checks it failed: ImportError: no h5py here"),
    ],
)
def test_a_child_that_fails(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, child: str, message: str
) -> None:
    monkeypatch.setattr(_guard, "CHILD", child)
    with pytest.raises(ds.FileError, match=rf"bare_run\.h5: .*{message}"):
        ds.open(bare(files["run"], tmp_path))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("executable", "/none/python", "no child process can be started"), ("frozen", True, "no Python interpreter is here")],
)
def test_a_child_that_cannot_be_started(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: object, message: str
) -> None:
    file = bare(files["run"], tmp_path)
    monkeypatch.setattr(sys, name, value, raising=False)
    with pytest.raises(ds.FileError, match=rf"bare_run\.h5: has no checksum, and {message}"):
        ds.open(file)
    assert ds.open(files["run"]).time.size


def test_a_sealed_file_needs_no_child(files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[object] = []
    run = subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda *words, **options: calls.append(words) or run(*words, **options))
    for kind, file in files.items():
        getattr(ds, READERS[kind])(file)
        assert len(calls) == (kind == "trace"), kind
    ds.open(bare(files["run"], tmp_path))
    assert len(calls) == 2


def test_the_child_has_the_path_of_its_parent(files: dict[str, Path], tmp_path: Path) -> None:
    """Where h5py was found by a path that the program has set itself."""
    file = bare(files["run"], tmp_path)
    code = "import json, os, sys; sys.path[:] = json.loads(sys.argv[2]); os.chdir('/'); import dynstiction as ds; print(ds.open(sys.argv[1]).time[-1])"
    done = subprocess.run(
        [sys.executable, "-S", "-c", code, file, json.dumps([path for path in sys.path if path])],
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(done.stdout) == pytest.approx(0.02)


def test_a_name_of_any_bytes(files: dict[str, Path], tmp_path: Path) -> None:
    for name in (b"-c.h5", b"a\xff\n'.h5", "µ und Ω.h5".encode()):
        file = Path(os.fsdecode(bytes(tmp_path) + b"/" + name))
        file.write_bytes(bare(files["run"], tmp_path).read_bytes())
        assert ds.open(file).time[-1] == pytest.approx(0.02)


def test_a_changed_seal_is_refused_in_a_trace_too(files: dict[str, Path], tmp_path: Path) -> None:
    file = tmp_path / "run.h5"
    file.write_bytes(files["run"].read_bytes())
    assert ds.read_trace(file, force="time_series/u_x", units={"force": 1.0}).time.size
    changed(file, lambda data: data[:5000] + bytes([data[5000] ^ 1]) + data[5001:])
    assert _open.MARK in file.read_bytes()[-40:]
    with pytest.raises(ds.FileError, match="checksum in its last line"):
        ds.read_trace(file, force="time_series/u_x", units={"force": 1.0})
