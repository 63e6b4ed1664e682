"""Every output of every Python command follows one rule: whole or not there, and never in place of what the command reads."""

from __future__ import annotations

import resource
import shutil
import signal
import time
from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from programs import FILE_ERROR, INPUTS, PACKAGE, Program, limited, wait_until

DECK = (INPUTS / "low_frequency.nml").read_text()
FREE = ("--free", "system.misalignment_deg")


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A deck, its run, its trace."""
    folder = tmp_path_factory.mktemp("sources")
    (folder / "rig.nml").write_text(DECK)
    result = ds.run(DECK)
    result.save(folder / "rig.h5")
    noise = 2e-3 * np.random.default_rng(0).standard_normal(result.time.size)
    table = np.c_[result.time, result["pull_force"] + noise][::5]
    np.savetxt(folder / "trace.csv", table, delimiter=",", header="time [s],force [N]", comments="")
    shutil.copy(folder / "trace.csv", folder / "trace.svg")
    shutil.copy(folder / "rig.h5", folder / "run.gif")
    return folder


@pytest.fixture
def folder(sources: Path, tmp_path: Path) -> Path:
    shutil.copytree(sources, tmp_path, dirs_exist_ok=True)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def assert_refused(folder: Path, *command: str, words: str = "", status: int = FILE_ERROR) -> None:
    """Before the work, in one line, and nothing has changed."""
    before, begun = contents(folder), time.monotonic()
    done = Program(PACKAGE.first, folder)(*command, status=status)
    assert time.monotonic() - begun < 30.0
    assert done.stderr.startswith("dynstiction: ") and len(done.stderr.splitlines()) == 1, done.stderr
    assert words in done.stderr
    assert contents(folder) == before


@pytest.mark.parametrize(
    "command",
    [
        ("report", "rig.h5", "-o", "rig.h5", "--overwrite"),
        ("fit", "rig.nml", "trace.csv", *FREE, "--fitted", "rig.nml", "--overwrite"),
        ("fit", "rig.nml", "trace.csv", *FREE, "--fitted", "same.png", "-o", "same.png"),
        ("fit", "rig.nml", "trace.csv", *FREE, "--fitted", "link.csv", "--overwrite"),
        ("compare", "rig.nml", "trace.svg", "-o", "trace.svg", "--overwrite"),
        ("animate", "run.gif", "-o", "run.gif", "--overwrite"),
        ("plot", "rig.h5", "-o", "../x/rig.h5", "--overwrite"),
        ("fit", "rig.nml", "trace.csv", *FREE, "--fitted", "other.h5", "--overwrite"),
        ("report", "rig.h5", "-o", "page.png"),
        ("export", "rig.h5", "-o", "tables"),
    ],
)
def test_no_output_replaces_an_input(folder: Path, command: tuple[str, ...]) -> None:
    (folder / "link.csv").symlink_to("trace.csv")
    (folder / "x").mkdir()
    shutil.copy(folder / "rig.h5", folder / "other.h5")
    (folder / "tables").mkdir()
    (folder / "tables" / "rig_summary.csv").write_text("mine")
    assert_refused(folder, *command)
    assert [file.name for file in (folder / "tables").iterdir()] == ["rig_summary.csv"]


@pytest.mark.parametrize(
    ("command", "output"),
    [
        (("plot", "rig.h5"), "rig.png"),
        (("report", "rig.h5"), "rig.html"),
        (("export", "rig.h5"), "rig_time_series.csv"),
        (("compare", "rig.nml", "trace.csv"), "trace_compared.png"),
        pytest.param(("fit", "rig.nml", "trace.csv", *FREE), "trace_fitted.png", marks=pytest.mark.full),
        (("animate", "rig.h5", "-o", "rig.gif", "--seconds", "0.2"), "rig.gif"),
    ],
)
def test_what_exists_is_replaced_only_with_overwrite(folder: Path, command: tuple[str, ...], output: str) -> None:
    (folder / output).write_text("precious")
    (folder / output).chmod(0o640)
    assert_refused(folder, *command, words="use --overwrite")
    limit = limited(resource.RLIMIT_FSIZE, 512)
    done = Program(PACKAGE.first, folder)(*command, "--overwrite", preexec_fn=limit)
    assert done.returncode == FILE_ERROR and "ulimit -f" in done.stderr
    assert (folder / output).read_text() == "precious"
    assert not list(folder.glob("*.part"))
    Program(PACKAGE.first, folder)(*command, "--overwrite", status=0)
    assert (folder / output).stat().st_size > 1000
    assert (folder / output).stat().st_mode & 0o777 == 0o640
    assert not list(folder.glob("*.part"))


def test_what_cannot_be_written_is_refused_before_the_work(folder: Path) -> None:
    (folder / "x").mkdir()
    (folder / "nowhere.nml").symlink_to("nodir/x.nml")
    fit = ("fit", "rig.nml", "trace.csv", *FREE, "--overwrite")
    for fitted in ("nodir/a.nml", "x", "/dev/full", "nowhere.nml"):
        assert_refused(folder, *fit, "--fitted", fitted, words="cannot be written")
    assert_refused(folder, *fit, "-o", "b.xyz", words="no format 'xyz'")
    assert_refused(folder, "animate", "rig.h5", "-o", "x.gif", "--seconds", "1e9", words="from 2 to 20000 frames", status=1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("command", [("fit", "rig.nml", "trace.csv", "--free", "system.misalignment_deg,friction.mu_0,friction.v_f", "--starts", "99"),
                                     ("animate", "rig.h5", "-o", "x.gif", "--seconds", "100"), ("paper", "-o", "figures")])  # fmt: skip
def test_a_signal_ends_a_command_with_one_line(folder: Path, command: tuple[str, ...], number: signal.Signals) -> None:
    process = Program(PACKAGE.first, folder).start(*command)
    status = Path(f"/proc/{process.pid}/status")
    # The package, once imported, has a handler for SIGTERM; for SIGINT it has Python's.
    wait_until(lambda: int(status.read_text().partition("SigCgt:")[2].split()[0], 16) >> (signal.SIGTERM - 1) & 1, "the handler")
    time.sleep(0.5)
    process.send_signal(number)
    errors = process.communicate(timeout=60)[1]
    assert process.returncode == -number, errors
    lines = [line for line in errors.splitlines() if not line.startswith(("deck ", "figure "))]
    assert lines == [f"dynstiction: stopped by {number.name}"]
    assert not list(folder.rglob("*.part"))


STRANGERS = ("json", "numpy", "h5py", "matplotlib", "csv", "argparse", "xarray", "scipy", "dynstiction", "typing", "struct", "mmap",
             "_signal", "signal", "enum")  # fmt: skip


def test_nothing_in_a_working_folder_is_imported(folder: Path, executable: Path) -> None:
    for name in STRANGERS:
        (folder / f"{name}.py").write_text(f"open('imported_{name}', 'w')\nraise SystemExit(9)\n")
    (folder / "changed.h5").write_bytes((folder / "rig.h5").read_bytes()[:-28])
    commands = [
        ("plot", "changed.h5"), ("report", "rig.h5"), ("export", "rig.h5"), ("fit", "rig.nml", "trace.csv", *FREE),
        ("animate", "rig.h5", "-o", "a.gif", "--seconds", "0.2"), ("trade", "rig.nml", "--budget", "2"),
    ]  # fmt: skip
    for command in commands:
        done = Program((executable,), folder)(*command, env={"PYTHONPATH": None})
        # 6: the trace has k_x u_x in place of the force along the pull.
        assert done.returncode in (0, 6, 75), (command, done.stderr)
    assert not list(folder.glob("imported_*"))
