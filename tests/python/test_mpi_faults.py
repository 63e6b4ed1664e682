"""A share of what may befall a sweep over MPI (tests/mpi/faults.py), which the marker `full` makes the whole."""

from __future__ import annotations

import importlib.util
import sys

import pytest
from programs import ROOT
from test_sweep_kills import MPI, skip_without

# Another `faults` is that of the system's calls.
SPECIFICATION = importlib.util.spec_from_file_location("mpi_faults", ROOT / "tests" / "mpi" / "faults.py")
mpi_faults = sys.modules["mpi_faults"] = importlib.util.module_from_spec(SPECIFICATION)
SPECIFICATION.loader.exec_module(mpi_faults)

# Every moment, and everyone it befalls.
SHARE = (
    "launch/rank 0/missing folder",
    "launch/another/bad deck",
    "launch/all/file exists",
    "launch/another/exit 7",
    "init/rank 0/SIGTERM",
    "init/mpirun/SIGKILL",
    "running/another/SIGKILL",
    "running/another/full disk",
    "running/mpirun/SIGUSR1",
    "running/all/slow",
    "stopping/another/SIGTERM",
    "stopping/rank 0/full disk",
    "merging/rank 0/SIGKILL",
    "merging/all/full disk",
    "merging/rank 0/slow, then SIGTERM",
    "ending/all/SIGKILL",
    "finalizing/another/SIGTERM",
    "finalizing/another/late SIGTERM",
)
CASES = mpi_faults.every_case(list(MPI))
QUICK = [case for case in CASES if str(case).partition("/")[2] in SHARE]


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return mpi_faults.laboratory(tmp_path_factory.mktemp("mpi-faults"))


def try_case(lab, case):
    skip_without(case.flavour)
    try:
        wrong = lab.try_case(case)
    except PermissionError as reason:
        pytest.skip(str(reason))
    assert not wrong, "; ".join(wrong)


def test_the_share_has_everything():
    assert len(QUICK) == len(MPI) * len(SHARE)
    for what in ("moment", "who"):
        assert {getattr(case, what) for case in QUICK} == {getattr(case, what) for case in CASES}


@pytest.mark.parametrize("case", QUICK, ids=str)
def test_a_sweep_survives(lab, case):
    try_case(lab, case)


@pytest.mark.full
@pytest.mark.parametrize("case", [case for case in CASES if case not in QUICK], ids=str)
def test_a_sweep_survives_the_rest(lab, case):
    try_case(lab, case)
