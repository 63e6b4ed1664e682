"""`ds.sweep`: what it returns, what it refuses, and what Ctrl-C leaves."""

from __future__ import annotations

import signal
import time
from subprocess import PIPE

import dynstiction as ds
import numpy as np
import pytest
from programs import SCRIPT
from sweeps import SCENE

pytest.importorskip("xarray")

ANGLES = {"system.misalignment_deg": [1.0, 2.0, 3.0]}
SHORT = SCENE.replace("t_end = 10.0", "t_end = 1.0")


def test_coordinates_and_order():
    data = ds.sweep(SHORT, ANGLES | {"drive.velocity": [1e-3, 2e-3]})
    assert dict(data.sizes) == {"misalignment_deg": 3, "velocity": 2}
    single = ds.run(SHORT, system={"misalignment_deg": 3.0}, drive={"velocity": 2e-3})
    assert data["final_u_x"].sel(misalignment_deg=3.0, velocity=2e-3).item() == single["u_x"][-1]
    assert data["velocity"].attrs["units"] == "m/s"


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({}, ds.UsageError, "nothing is varied"),
        ({"parameters": {"system.mas": [1.0]}}, ds.DeckError, r"'system\.mas' is not a key .*'system\.mass'"),
        ({"parameters": {"drive.velocity": []}}, ds.DeckError, "from 1 to"),
        ({"parameters": {"drive.velocity": [[1.0]]}}, ds.UsageError, "2 dimensions"),
        ({"parameters": {"drive.velocity": [1j]}}, ds.UsageError, "real number"),
        ({"parameters": {"drive.velocity": [1e-3, float("nan")]}}, ds.DeckError, "value 2: .*not finite"),
        ({"parameters": {"system.misalignment_deg": [1e3]}}, ds.DeckError, "out of range"),
        ({"parameters": {"drive.velocity": [1.0], "Drive.Velocity": [1.0]}}, ds.DeckError, "varied twice"),
        ({"parameters": {"drive.velocity\nsystem.mass": [1.0]}}, ds.UsageError, "is not a key"),
        ({"parameters": {**ANGLES, "drive.velocity": [1.0]}, "points": True}, ds.UsageError, "one length"),
        ({"parameters": ANGLES, "threads": 0}, ds.UsageError, "threads = 0"),
        ({"parameters": ANGLES, "scene": {"model": "auto"}, "system": {"stiffness_y": 1e7}}, ds.DeckError, "auto"),
        ({"parameters": {"drive.velocity": np.ones(40000), "system.mass": np.ones(40000)}}, ds.DeckError, "from 1 to"),
    ],
)
def test_refused(arguments, error, words):
    with pytest.raises(error, match=words):
        ds.sweep(SHORT, **arguments)


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
        works = works or frame.f_code.co_qualname.startswith("Work.")
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
