"""What the Python tests share: the deck of Fig. 3 and the executable."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

# The tests of the executable need no Python extension, so it is imported where it is used.
if TYPE_CHECKING:
    import dynstiction as ds

# Tests that were started in the background would not hear Ctrl-C, nor would the programs that they start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

FIG3_TEXT = """\
&scene
  title = 'Fig. 3, Nakano & Popov (2020)'
  model = 'full'
  t_end = 10.0
/
&system
  mass = 0.25
  stiffness_x = 1.0e3
  stiffness_y = 1.0e7
  misalignment_deg = 1.0
/
&friction
  law = 'weakening'
  mu_0 = 0.20, mu_inf = 0.15
  v_f = 0.010
  normal_load = 10.0
/
&drive
  velocity = 1.0e-3
/
&initial
  velocity_ratio = 1.0e-6
/
&integrator
  method = 'radau9'
  rtol = 1.0e-8
/
&output
  interval = 1.0e-4
/
"""


@pytest.fixture(scope="session")
def fig3_text() -> str:
    return FIG3_TEXT


@pytest.fixture(scope="session")
def fig3() -> ds.Scene:
    import dynstiction as ds  # noqa: PLC0415

    return ds.Scene(FIG3_TEXT)


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
    """The program under test: DYNSTICTION_EXE, beside this Python, or on the PATH."""
    named = os.environ.get("DYNSTICTION_EXE")
    if named:
        assert Path(named).is_file(), f"DYNSTICTION_EXE={named} is no file"
        return Path(named)
    search = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    found = shutil.which("dynstiction", path=search)
    if found is None:
        pytest.fail("no executable: set DYNSTICTION_EXE or put dynstiction on the path")
    return Path(found)


@pytest.fixture(scope="session")
def catalogue(executable: Path) -> dict[str, Any]:
    """Commands, options, keys, columns, ... as the program names them."""
    return json.loads(
        subprocess.run([executable, "keys", "--json"], capture_output=True, timeout=60, check=True).stdout
    )
