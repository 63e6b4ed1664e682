"""Sweeps over real MPI processes on this machine; needs a build with -Dmpi=enabled named by DYNSTICTION_MPI_EXE."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest
from test_sweep import deck, dynstiction_exe, same, sweep, values  # noqa: F401

EXE = os.environ.get("DYNSTICTION_MPI_EXE")
needs_mpi = pytest.mark.skipif(
    not (EXE and shutil.which("mpirun")), reason="no mpirun, or DYNSTICTION_MPI_EXE names no MPI build"
)


@needs_mpi
@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_the_number_of_ranks_changes_nothing(deck, sweep, tmp_path, ranks):  # noqa: F811
    allowed = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMP_NUM_THREADS": "2"}
    command = ["mpirun", "-n", str(ranks), EXE, "run", deck, "-o", tmp_path / "m.h5", "--quiet"]
    # More ranks than cores are fine for a test.
    oversubscribe = {"OMPI_MCA_rmaps_base_oversubscribe": "1"}
    subprocess.run(command, env=os.environ | allowed | oversubscribe, check=True, timeout=120)
    serial = [EXE, "run", deck, "-o", tmp_path / "s.h5", "--quiet"]
    subprocess.run(serial, check=True, timeout=120)
    assert same(values(tmp_path / "m.h5"), values(tmp_path / "s.h5"))
