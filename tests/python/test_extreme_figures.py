"""Figures of results whose numbers are extreme: drawn or refused, and soon."""

from __future__ import annotations

import json

import pytest
from programs import SCRIPT

MOST_SECONDS = 15.0
"""For one figure, on a busy machine; what never ended took more than ten minutes."""

DRAW = """
import io, json, sys, time, warnings
import numpy as np
import dynstiction as ds
from dynstiction import plot
from dynstiction.record import Described
warnings.simplefilter("ignore")
text, wanted = sys.stdin.read(), sys.argv[1:]
def short(t_end):
    return ds.run(text, scene={"t_end": t_end}, output={"interval": t_end / 10})
base = short(0.02)
n = base.time.size
alternating = np.where(np.arange(n) % 2, 1.0, -1.0)
def changed(values=None, time=None):
    columns = [(i, np.asarray(v if (i.name == "time" and time is None) else time if i.name == "time" else v if values is None
                else values, float)) for i, v in base.columns.info()]
    return ds.Result(**(vars(base) | {"columns": Described(columns)}))
MADE = {
    "zeros": lambda: changed(np.zeros(n)),
    "minus one": lambda: changed(-np.ones(n)),
    "spike": lambda: changed(np.where(np.arange(n) == n // 2, 1e308, 1e-308)),
    "last bit": lambda: changed(2.0 + 2.0**-51 * (np.arange(n) % 2)),
    "times tiny": lambda: changed(time=5e-324 * np.arange(n)),
    "times huge": lambda: changed(time=1e306 * np.arange(n)),
    "times equal": lambda: changed(time=np.zeros(n)),
    "times late": lambda: changed(time=1e9 + 1e-7 * np.arange(n)),
    "times clustered": lambda: changed(time=np.concatenate([1e-300 * np.arange(n - 1), [1e3]])),
    "one sample": lambda: changed(np.ones(1), np.zeros(1)),
    "two samples": lambda: changed(np.ones(2), np.array([0.0, 1.0])),
    "no events": lambda: ds.Result(**(vars(base) | {"log": base.log[:0]})),
}
for value in (5e-324, 1e-300, 1e-20, 1e20, 1e300):
    MADE[f"constant {value}"] = lambda value=value: changed(np.full(n, value))
    MADE[f"alternating {value}"] = lambda value=value: changed(value * alternating)
for name in wanted:
    kind_of, _, about = name.partition(" in ")
    result = short(float(about)) if about[0].isdigit() and about[-1].isdigit() else MADE[about]()
    begun = time.perf_counter()
    outcome = "drawn"
    try:
        plot.draw(result, kind_of).savefig(io.BytesIO(), dpi=100)
    except ds.UsageError as error:
        outcome = f"refused: {error}"
    print(json.dumps([name, outcome, time.perf_counter() - begun]), flush=True)
"""

SCENES = [
    "1e-12", "1e-11", "1e-10", "1e-09", "1e-06", "zeros", "minus one", "spike", "last bit", "times tiny", "times huge", "times equal",
    "times late", "times clustered", "one sample", "two samples", "no events",
    *(f"{how} {value}" for how in ("constant", "alternating") for value in (5e-324, 1e-300, 1e-20, 1e20, 1e300)),
]  # fmt: skip


def draw(text, names):
    """Draw in another process: matplotlib cannot be interrupted where it does not end."""
    done = SCRIPT(DRAW, *names, input=text, timeout=30 + MOST_SECONDS * len(names))
    assert done.returncode == 0, done.stderr[-2000:]
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert [name for name, _, _ in found] == names
    for name, outcome, seconds in found:
        assert seconds < MOST_SECONDS, (name, seconds)
        assert outcome == "drawn" or outcome.startswith("refused: "), (name, outcome)
    return {name: outcome for name, outcome, _ in found}


def test_the_path_of_a_moment_is_drawn(fig3_text):
    """Its circle of friction is 10^10 times as large as what is shown."""
    found = draw(fig3_text, [f"path in {t_end}" for t_end in ("1e-12", "1e-11", "1e-10")])
    assert set(found.values()) == {"drawn"}


@pytest.mark.parametrize("kind", ["history", "path", "velocities"])
def test_extreme_numbers_are_drawn_or_refused(fig3_text, kind):
    some = SCENES if kind == "path" else ["zeros", "spike", "times huge", "times tiny", "alternating 1e+20", "two samples"]
    draw(fig3_text, [f"{kind} in {scene}" for scene in some])
