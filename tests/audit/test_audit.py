"""The package against an independent reference on random scenes.

The scenes are fresh in each run: `DYNSTICTION_SEED`, which pytest prints, gives them again. The bounded form runs always, the whole with
--full. tests/README.md says what is compared and how.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import audit
import numpy as np
import pytest
import truth as tr
from scenes import FAMILIES, random_scene

SEED = 12
SCENES = {"any": 30, "turning": 20}
FULL_SCENES = 500
EXCUSED = 0.1
"""Of all runs, at most. Three times what 1000 scenes had."""
PUBLISHED = tr.CHECKOUT / "tests" / "reference" / "fig3.json"

full = pytest.mark.skipif("DYNSTICTION_FULL" not in os.environ, reason="set DYNSTICTION_FULL=1")


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tr.Reference:
    if shutil.which("g++") is None:
        pytest.skip("no g++ on the PATH: the independent reference of the audit is a C++ program")
    return tr.Reference(tmp_path_factory.mktemp("audit"))


# The reference is right.


def published(until: float) -> Iterator[tuple[str, list[list[float]], list[list[float]]]]:
    """Inputs for the scenes of tests/reference/fig3.json, with their states and sticks, up to a time [s]."""
    document = json.loads(PUBLISHED.read_text())
    for scene in document["scenes"].values():
        keys = {
            key: value
            for groups in (document["deck"], scene["change"])
            for group in groups.values()
            for key, value in group.items()
        }
        if keys.pop("law", "weakening") == "constant":
            keys |= {"mu_inf": keys["mu_0"], "v_f": 1.0}
        keys["velocity_ratio"] = 0.0  # the values belong to a start from rest
        keys.pop("model")
        states = [state for state in scene["states"] if state[0] <= until]
        if states:
            keys["t_end"] = max(state[0] for state in states)
            lines = ["decimal 1", *(f"{key} {value!r}" for key, value in keys.items())]
            lines.append(f"samples {' '.join(repr(state[0]) for state in states)}")
            yield "\n".join(lines), states, [row for row in scene["sticks"] if row[0] <= keys["t_end"]]


def against_published(program: Path, until: float) -> float:
    """Largest difference: u relative to itself, w relative to |w|. The number of sticks must be the same."""
    worst = 0.0
    for text, states, sticks in published(until):
        truth = tr.parse(subprocess.run([program], input=text, capture_output=True, text=True, check=True).stdout)
        for t, u_x, u_y, w_x, w_y in states:
            k = int(np.argmin(np.abs(truth.time - t)))
            apart = np.hypot(truth.w[0][k] - w_x, truth.w[1][k] - w_y) / np.hypot(w_x, w_y)
            worst = max(worst, abs(truth.u[0][k] / u_x - 1), abs(truth.u[1][k] / u_y - 1), float(apart))
        for t, count in sticks:
            assert np.count_nonzero((truth.event_kind == 1) & (truth.event_time <= t)) == count
    return worst


def test_reference_has_the_published_values(reference: tr.Reference) -> None:
    assert against_published(reference.program, until=0.5) < 2e-14


@pytest.mark.full
@full
def test_reference_has_all_published_values(reference: tr.Reference) -> None:
    """After 5398 sticks, 10 s of Fig. 3, the roundoff of 80 bits has grown to 2e-13."""
    assert against_published(reference.program, until=np.inf) < 3e-13


@pytest.mark.parametrize("family", FAMILIES)
def test_reference_depends_on_neither_stages_nor_tolerance(reference: tr.Reference, family: str) -> None:
    for number in range(3):
        scene = random_scene(SEED, number, family=family)
        truth, again = reference.run(scene), reference.run(scene, stages=9, tolerance=1e-14)
        condition = tr.conditioning(scene, truth, reference.perturbed(scene))
        np.testing.assert_array_equal(again.event_kind, truth.event_kind)
        for name, change in tr.changes(scene, truth, again).items():
            assert (change <= 1e-12 * (1 + condition[name])).all(), (number, name)


# The package agrees with it.


@pytest.mark.parametrize("family", FAMILIES)
def test_fresh_scenes(reference: tr.Reference, family: str) -> None:
    """At 1e-4 with --full only: of some 300 scenes one has a sample inside a step that passes over a narrow part of a friction table."""
    is_full = "DYNSTICTION_FULL" in os.environ
    numbers = range(FULL_SCENES if is_full else SCENES[family])
    runs = [run for run in audit.RUNS if is_full or run[1] < 1e-5]
    outcome = audit.audit(reference, audit.random_scenes(family, int(os.environ["DYNSTICTION_SEED"]), numbers), runs)
    assert not outcome.failures, "\n".join(outcome.failures)
    assert len(outcome.verdicts) == len(numbers) * len(runs)
    assert sum(v.excused for v in outcome.verdicts) <= EXCUSED * len(outcome.verdicts), outcome.table()


# The checks see what they are for.


@pytest.fixture(scope="module")
def case(reference: tr.Reference) -> audit.Case:
    """A scene with many sticks."""
    scenes = (scene for number in range(100) if set((scene := random_scene(SEED, number)).kinds) <= {"weakening", "ageing"})
    return next(case for scene in scenes if (case := audit.Case(reference, "a scene", scene)).truth.sticks > 10)


def test_an_error_of_the_size_of_a_looser_tolerance_is_found(
    reference: tr.Reference, case: audit.Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = audit.run
    monkeypatch.setattr(audit, "run", lambda scene, method, _, cycle_map: run(scene, method, 1e-4, cycle_map))
    assert not audit.compare(case, "radau9", 1e-10).good


def test_a_change_of_a_parameter_is_found(reference: tr.Reference, case: audit.Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """The conditioning allows for rtol's worth of a parameter, not for a thousand times that."""
    run, heavier = audit.run, replace(case.scene, normal_load=case.scene.normal_load * (1 + 1e-6))
    monkeypatch.setattr(audit, "run", lambda _, *settings: run(heavier, *settings))
    assert not audit.compare(case, "radau13", 1e-10).good


def test_a_run_that_fails_is_shown_as_its_deck(reference: tr.Reference, case: audit.Case) -> None:
    verdict = audit.compare(case, "radau13", 1e-8)
    again, result = audit.ds.run(audit.shown(case, verdict)), audit.run(case.scene, "radau13", 1e-8, case.cycle_map)
    for name in result.columns:
        np.testing.assert_array_equal(again[name], result[name])
