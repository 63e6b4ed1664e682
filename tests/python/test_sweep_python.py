"""`ds.sweep`: what it returns, what it refuses, and what Ctrl-C leaves."""

from __future__ import annotations

import pickle
import signal
import threading
import time
from subprocess import PIPE

import dynstiction as ds
import numpy as np
import pytest
from programs import SCRIPT
from sweeps import GRID, SCENE

pytest.importorskip("xarray")

ANGLES = {"system.misalignment_deg": [1.0, 2.0, 3.0]}
SHORT = SCENE.replace("t_end = 10.0", "t_end = 1.0")


def test_coordinates_units_and_order():
    data = ds.sweep(SHORT, ANGLES | {"drive.velocity": [1e-3, 2e-3]})
    assert dict(data.sizes) == {"misalignment_deg": 3, "velocity": 2}
    assert data["velocity"].attrs["units"] == "m/s"
    assert data["final_u_x"].attrs["units"] == "m" and data["wall_time"].attrs["units"] == "s"
    single = ds.run(SHORT, system={"misalignment_deg": 3.0}, drive={"velocity": 2e-3})
    chosen = data["final_u_x"].sel(misalignment_deg=3.0, velocity=2e-3)
    assert chosen.item() == single["u_x"][-1]


def test_a_small_sweep_prints_its_numbers():
    data = ds.sweep(SHORT, ANGLES | {"drive.velocity": [1e-3, 2e-3]})
    title, head, *rows = repr(data).splitlines()
    assert title == "<sweep: 6 cases>"
    assert head.split("  ")[0] == "misalignment_deg [deg]" and "velocity [m/s]" in head and "swing [N]" in head
    assert [row.split()[:2] for row in rows[:6]] == [[angle, velocity] for angle in "123" for velocity in ("0.001", "0.002")]
    place = head.index("swing [N]") + len("swing [N]")
    printed = [float(row[:place].split()[-1]) for row in rows[:6]]
    np.testing.assert_allclose(printed, data["swing"].values.reshape(-1), rtol=1e-4)
    also = " ".join(rows[6:])
    assert also.startswith("also: ") and "wall_time" in also and "NaN" not in repr(data)
    assert repr(data.isel(misalignment_deg=0, velocity=[1])).splitlines()[0] == "<sweep: 1 case>"
    transposed = data.transpose("velocity", "misalignment_deg")
    assert repr(transposed).splitlines()[3].split()[:3] == rows[2].split()[:3]
    assert repr(pickle.loads(pickle.dumps(data))) == repr(data)
    # What is no small sweep is shown by xarray.
    for other in (
        data[["period"]],
        data.mean(),
        ds.sweep(SHORT, {"misalignment_deg": np.linspace(1.0, 9.0, 61)}),
        data.drop_vars(list(data.coords)),
    ):
        assert "Dimensions:" in repr(other)
    with pytest.warns(ds.IncompleteWarning):
        failed = ds.sweep(SHORT + GRID, max_steps=25)
    assert (
        repr(failed).startswith("<sweep: 60 cases, 24 not done: see result_text>") and "result_code" in repr(failed).splitlines()[1]
    )


def test_a_sweep_in_a_file_prints_the_same(tmp_path, program):
    (tmp_path / "deck.nml").write_text(SHORT + GRID)
    program("run", "deck.nml", "-o", "map.h5", "--quiet", status=0)
    assert repr(ds.open(tmp_path / "map.h5")).splitlines()[:62] == repr(ds.sweep(SHORT + GRID)).splitlines()[:62]


def test_points_go_along_case():
    data = ds.sweep(SHORT, {"system.misalignment_deg": [1.0, 2.0], "drive.velocity": [1e-3, 2e-3]}, points=True)
    assert data["final_u_x"].dims == ("case",) and data["velocity"].dims == ("case",)


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_change_nothing(threads):
    names = ["final_u_x", "period", "steps"]
    one = ds.sweep(SHORT + GRID, threads=1)[names]
    assert ds.sweep(SHORT + GRID, threads=threads)[names].identical(one)


def test_failed_cases_are_reported():
    with pytest.warns(ds.IncompleteWarning, match="of 60 cases failed"):
        data = ds.sweep(SHORT + GRID, integrator={"max_steps": 25})
    failed = data["result_code"].values == 42
    assert 0 < np.count_nonzero(failed) < 60
    assert all("max_steps" in text for text in data["result_text"].values[failed])
    assert all(text == "" for text in data["result_text"].values[~failed])


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({}, ds.UsageError, "nothing is varied"),
        ({"parameters": {}}, ds.UsageError, "nothing is varied"),
        ({"parameters": {"system.mas": [1.0]}}, ds.DeckError, r"'system\.mas' is not a key .*'system\.mass'"),
        ({"parameters": {"output.interval": [1.0]}}, ds.DeckError, "cannot be varied"),
        ({"parameters": {"drive.velocity": []}}, ds.DeckError, "from 1 to"),
        ({"parameters": {"drive.velocity": [[1.0]]}}, ds.UsageError, "2 dimensions"),
        ({"parameters": {"drive.velocity": ["fast"]}}, ds.UsageError, "real number"),
        ({"parameters": {"drive.velocity": [1j]}}, ds.UsageError, "real number"),
        ({"parameters": {"drive.velocity": None}}, ds.UsageError, "real number"),
        ({"parameters": {"drive.velocity": [1e-3, float("nan")]}}, ds.DeckError, "value 2: .*not finite"),
        ({"parameters": {"drive.velocity": [float("inf")]}}, ds.DeckError, "not finite"),
        ({"parameters": {"system.misalignment_deg": [1e3]}}, ds.DeckError, "out of range"),
        ({"parameters": {"drive.velocity": [1.0], "Drive.Velocity": [1.0]}}, ds.DeckError, "varied twice"),
        ({"parameters": {"drive.velocity\nsystem.mass": [1.0]}}, ds.UsageError, "is not a key"),
        ({"parameters": {3: [1.0]}}, ds.UsageError, "is not a key"),
        ({"parameters": {**ANGLES, "drive.velocity": [1.0]}, "points": True}, ds.UsageError, "one length"),
        ({"parameters": {}, "points": True}, ds.UsageError, "one length"),
        ({"parameters": ANGLES, "threads": 0}, ds.UsageError, "threads = 0"),
        ({"parameters": ANGLES, "threads": -2}, ds.UsageError, "threads = -2"),
        ({"parameters": ANGLES, "scene": {"model": "auto"}, "system": {"stiffness_y": 1e7}}, ds.DeckError, "auto"),
        ({"parameters": {"drive.velocity": np.ones(40000), "system.mass": np.ones(40000)}}, ds.DeckError, "from 1 to"),
    ],
)
def test_refused(arguments, error, words):
    with pytest.raises(error, match=words):
        ds.sweep(SHORT, **arguments)


def test_other_threads_go_on():
    """The interpreter's lock is free while the core works."""
    counts = []
    stop = threading.Event()

    def count():
        while not stop.wait(0.001):
            counts.append(time.monotonic())

    counter = threading.Thread(target=count)
    counter.start()
    try:
        begun = time.monotonic()
        ds.sweep(SCENE, {"scene.t_end": [10000.0]}, threads=1)
        ended = time.monotonic()
    finally:
        stop.set()
        counter.join()
    meanwhile = sum(begun < moment < ended for moment in counts)
    assert meanwhile > 20


INTERRUPTED = """
import signal, sys
import dynstiction as ds
import numpy as np
import xarray  # which takes a second, or more where others work
ends = np.where(np.arange(400) < 200, 1.0, 3e5)

stopped = False

def interrupt(number, frame):
    # As Python's own handler, but not once the cases have ended: that interrupts what follows, as it should.
    global stopped
    works = False
    while frame is not None:
        works = works or frame.f_code.co_qualname in ("Work.run", "Work.run_on", "Work._wait")
        frame = frame.f_back
    if works or not stopped:
        stopped = True
        raise KeyboardInterrupt
    print("late", file=sys.stderr, flush=True)

signal.signal(signal.SIGINT, interrupt)
print("begun", flush=True)
try:
    ds.sweep(sys.argv[1], {"scene.t_end": ends}, points=True, threads=2)
except KeyboardInterrupt as error:
    data = error.partial
    assert "of 400 cases" in str(error), error
# An interpreter that ends is not asked any more.
signal.signal(signal.SIGINT, signal.SIG_IGN)
codes = data["result_code"].values
print(np.count_nonzero(codes == 0), np.count_nonzero(codes == -1), np.isfinite(data["final_u_x"].values[codes == 0]).all())
"""


@pytest.mark.parametrize("number_of_signals", [1, 5])
def test_interrupt_keeps_what_is_done(tmp_path, number_of_signals):
    """Two hundred short cases, then endless ones; impatient users press Ctrl-C more than once."""
    deck = tmp_path / "deck.nml"
    deck.write_text(SCENE)
    process = SCRIPT.start(INTERRUPTED, deck, stdout=PIPE)
    try:
        assert process.stdout.readline() == "begun\n"
        time.sleep(2.0)
        begun = time.monotonic()
        for _ in range(number_of_signals):
            process.send_signal(signal.SIGINT)
            time.sleep(0.0005)
        output, errors = process.communicate(timeout=30)
        assert time.monotonic() - begun < 10.0
    finally:
        process.kill()
    assert process.returncode == 0, errors
    assert set(errors.splitlines()) <= {"late"}
    done, left, finite = output.split()
    assert int(done) >= 150 and int(done) + int(left) == 400 and finite == "True"
