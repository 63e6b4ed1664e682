"""What the Python tests share: Fig. 3 and its results, the executable and the package as commands in the test's folder."""

from __future__ import annotations

import json
import os
import runpy
import secrets
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

sys.path.insert(0, str(Path(__file__).with_name("python")))

import fig3 as fig3_deck
import programs
from programs import Program

# The tests of the executable need no Python extension, so it is imported where it is used.
if TYPE_CHECKING:
    import dynstiction as ds

# Tests that were started in the background would not hear Ctrl-C, nor would the programs that they start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# The same of nohup.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# Random scenes are new in each run; the seed gives them again. The processes of pytest-xdist inherit it.
SEED = os.environ.setdefault("DYNSTICTION_SEED", str(secrets.randbits(32)))


def pytest_report_header() -> list[str]:
    lines = [f"random scenes: DYNSTICTION_SEED={SEED}"]
    library = next((file for folder in sys.path for file in Path(folder).glob("dynstiction/_core*.so")), None)
    named = Path(os.environ.get("DYNSTICTION_EXE", ""))
    if library is not None and named.is_file() and named.stat().st_mtime > library.stat().st_mtime + 60.0:
        lines.append(
            f"{library} is older than {named}: tests of the package test the former core; tools/run.sh installs the new one"
        )
    return lines


@pytest.fixture(scope="session")
def fig3_text() -> str:
    return fig3_deck.TEXT


@pytest.fixture(scope="session")
def fig3() -> ds.Scene:
    import dynstiction as ds  # noqa: PLC0415

    return ds.Scene(fig3_deck.TEXT)


@pytest.fixture(scope="session")
def fig3_result(fig3: ds.Scene) -> ds.Result:
    import dynstiction as ds  # noqa: PLC0415

    return ds.run(fig3)


@pytest.fixture(scope="session")
def fig4_result() -> ds.Result:
    """The first creep, sampled at 20 kHz: the deck of Fig. 4 as it was installed."""
    import dynstiction as ds  # noqa: PLC0415
    from dynstiction.plot.paper import deck  # noqa: PLC0415

    return ds.run(deck("fig4"))


@pytest.fixture(scope="session")
def executable() -> Path:
    return programs.executable()


@pytest.fixture
def program(executable: Path, tmp_path: Path) -> Program:
    """The executable, in the test's folder."""
    return Program((executable,), tmp_path)


@pytest.fixture
def package(tmp_path: Path) -> Program:
    """`python -m dynstiction`, in the test's folder."""
    return Program(programs.PACKAGE.first, tmp_path)


@pytest.fixture(scope="session")
def catalogue(executable: Path) -> dict[str, Any]:
    """Commands, options, keys, columns, ... as the program names them."""
    return json.loads(Program((executable,))("template", "--json", status=0).stdout)


@pytest.fixture(scope="session")
def of_python() -> dict[str, dict[str, Any]]:
    """Entry of each command that Python carries out."""
    table = runpy.run_path(str(programs.ROOT / "python" / "dynstiction" / "_commands.py"))
    return {command["name"]: command for command in table["described"]()}
