"""`ds.sweep` on executors: whatever runs the cases, the numbers are those of one process."""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from subprocess import PIPE

import dynstiction as ds
import numpy as np
import pytest
from dynstiction import _sweep_work
from programs import ROOT, SCRIPT, Program
from sweeps import GRID, SCENE

xarray = pytest.importorskip("xarray")

SHORT = SCENE.replace("t_end = 10.0", "t_end = 1.0")
ANGLES = {"misalignment_deg": np.linspace(1.0, 9.0, 30)}
LANES = Path(ROOT / "inputs" / "low_frequency.nml")


@contextmanager
def dask() -> Iterator[Executor]:
    """A cluster on this machine, with processes of its own."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed: pip install distributed")
    with distributed.Client(n_workers=2, threads_per_worker=1, dashboard_address=None) as client, client.get_executor() as executor:
        yield executor


ENGINES: dict[str, Callable[[], object]] = {
    "threads": lambda: ThreadPoolExecutor(2),
    "processes": lambda: ProcessPoolExecutor(2),
    "dask": dask,
}


def same(data: xarray.Dataset, other: xarray.Dataset) -> bool:
    return data.drop_vars("wall_time").identical(other.drop_vars("wall_time"))


@pytest.fixture(params=ENGINES)
def executor(request: pytest.FixtureRequest) -> Iterator[Executor]:
    with ENGINES[request.param]() as executor:
        yield executor


def test_results_do_not_depend_on_the_engine(executor: Executor) -> None:
    assert same(ds.sweep(SHORT + GRID, executor=executor), ds.sweep(SHORT + GRID, threads=1))
    points = {"misalignment_deg": [3.0, 1.0, 2.0], "velocity": [2e-3, 1e-3, 3e-3]}
    assert same(ds.sweep(SHORT, points, points=True, executor=executor), ds.sweep(SHORT, points, points=True))
    assert same(ds.sweep(LANES, ANGLES, method="rodas4p", executor=executor), ds.sweep(LANES, ANGLES, method="rodas4p"))


def test_threads_read_the_deck_and_its_files_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that changes while cases run changes none of them."""
    table = tmp_path / "law.csv"
    table.write_text("table_speed,table_mu\n0,0.2\n0.01,0.17\n0.1,0.15\n")
    scene = ds.Scene(ROOT / "inputs" / "fig3.nml", law="table", table=str(table), mu_0=None, mu_inf=None, v_f=None, t_end=0.05)
    expected = ds.sweep(scene, ANGLES, threads=1)
    begin = _sweep_work.Work.run

    def without_file(self: _sweep_work.Work, *args: object) -> None:
        table.unlink()
        begin(self, *args)

    monkeypatch.setattr(_sweep_work.Work, "run", without_file)
    assert same(ds.sweep(scene, ANGLES, threads=2), expected)


def test_cycles_and_failures_come_back(executor: Executor) -> None:
    kept = {"keep": "cycles", "cycles": 3}
    angles = {"misalignment_deg": [1.0, 2.0, 4.0]}
    data = ds.sweep(LANES, angles, sweep=kept, executor=executor)
    assert data["cycle_period"].dims[-1] == "cycle" and data["cycle_count"].values.min() > 0
    assert same(data, ds.sweep(LANES, angles, sweep=kept))
    with pytest.warns(ds.IncompleteWarning, match="of 60 cases failed; the first, number 3: ") as warned:
        data = ds.sweep(SHORT + GRID, integrator={"max_steps": 25}, executor=executor)
    assert warned[0].filename == __file__
    failed = np.count_nonzero(data["result_code"] == 42)
    assert 0 < failed < 60 and np.count_nonzero(data["result_text"] != "") == failed
    with pytest.warns(ds.IncompleteWarning):
        assert same(data, ds.sweep(SHORT + GRID, integrator={"max_steps": 25}))


def test_what_is_refused_is_refused_here(executor: Executor) -> None:
    with pytest.raises(ds.DeckError, match="out of range"):
        ds.sweep(SHORT, {"misalignment_deg": [1e3]}, executor=executor)
    with pytest.raises(ds.UsageError, match="give one of them"):
        ds.sweep(SHORT, ANGLES, threads=2, executor=executor)
    with pytest.raises(ds.UsageError, match=r"give a concurrent\.futures\.Executor, like ProcessPoolExecutor\(\)"):
        ds.sweep(SHORT, ANGLES, executor="threads")


def test_an_engine_that_fails_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    with ThreadPoolExecutor(1) as executor:
        submit = executor.submit
        monkeypatch.setattr(executor, "submit", lambda *_: submit(lambda: 1 / 0))
        with pytest.raises(ZeroDivisionError):
            ds.sweep(SHORT, ANGLES, executor=executor)


INTERRUPTED = """
import os, signal, sys, threading, time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
import dynstiction as ds
import numpy as np
import xarray  # which takes a second, or more where others work

if __name__ == "__main__":
    ends = np.where(np.arange(60) < 20, 1.0, 3e5)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    pool = {"threads": ThreadPoolExecutor, "processes": ProcessPoolExecutor}[sys.argv[2]](2)
    print("begun", flush=True)
    try:
        ds.sweep(sys.argv[1], {"t_end": ends}, points=True, executor=pool, misalignment_deg=1.0)
    except KeyboardInterrupt as error:
        codes = error.partial["result_code"].values
        print(error)
        print(np.count_nonzero(codes == 0), np.count_nonzero(codes == -1), flush=True)
    if sys.argv[2] == "threads":
        pool.shutdown()
"""


@pytest.mark.parametrize("engine", ["threads", "processes"])
def test_interrupt_keeps_what_is_done_and_gives_up_the_rest(engine: str, tmp_path: Path) -> None:
    """Twenty short cases, then endless ones; the terminal sends Ctrl-C to all processes of the group."""
    deck = tmp_path / "deck.nml"
    deck.write_text(SCENE)
    process = SCRIPT.start(INTERRUPTED, deck, engine, stdout=PIPE, start_new_session=True)
    try:
        assert process.stdout.readline() == "begun\n"
        time.sleep(4.0)
        begun = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)
        output, errors = process.communicate(timeout=30)
        assert time.monotonic() - begun < 10.0
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert "stopped after" in output, errors
    done, left = map(int, output.splitlines()[-1].split())
    assert done + left == 60 and 1 <= done <= 20, output


# MPI

MPI_SCRIPT = """
import sys
import dynstiction as ds
import numpy as np
from mpi4py.futures import MPIPoolExecutor

if __name__ == "__main__":
    with MPIPoolExecutor() as pool:
        data = ds.sweep(sys.argv[1], {"misalignment_deg": np.linspace(1.0, 9.0, 30)}, executor=pool)
        one = ds.sweep(sys.argv[1], {"misalignment_deg": np.linspace(1.0, 9.0, 30)})
        print(pool.num_workers, data.drop_vars("wall_time").identical(one.drop_vars("wall_time")))
"""


def test_mpi_processes(tmp_path: Path) -> None:
    if importlib.util.find_spec("mpi4py") is None:
        pytest.skip("mpi4py is not installed: pip install mpi4py")
    if shutil.which("mpiexec") is None:
        pytest.skip("there is no mpiexec: apt-get install openmpi-bin")
    (tmp_path / "script.py").write_text(MPI_SCRIPT)
    (tmp_path / "deck.nml").write_text(SHORT)
    root = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_rmaps_base_oversubscribe": "1"}
    mpiexec = Program(("mpiexec", "-n", "3", sys.executable, "-m", "mpi4py.futures"), tmp_path, env=root)
    assert mpiexec("script.py", "deck.nml", status=0).stdout.split() == ["2", "True"]
