"""The package against an independent reference on random scenes, and pairs of scenes that must have the same motion.

The bounded form runs always, the whole with --full. docs/testing.md says what is compared and how.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import replace

import audit
import numpy as np
import pytest
import truth as tr
import validate_reference
from scenes import random_scene, random_scenes

SCENES, PAIRS = 12, 63
TOLERANCES = (1e-5, 1e-7, 1e-9)

full = pytest.mark.skipif("DYNSTICTION_FULL" not in os.environ, reason="set DYNSTICTION_FULL=1")


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tr.Reference:
    if shutil.which("g++") is None:
        pytest.skip("no g++ on the PATH: the independent reference of the audit is a C++ program")
    # What the reference says does not depend on the package: the many scenes of --full keep it.
    folder = tr.CHECKOUT / "build" / "audit"
    return tr.Reference(folder if "DYNSTICTION_FULL" in os.environ else tmp_path_factory.mktemp("audit"))


def test_reference_has_the_published_values(reference: tr.Reference) -> None:
    assert validate_reference.against_published(reference.program, until=0.5) < 2e-14


@pytest.mark.full
@full
def test_reference_has_all_published_values(reference: tr.Reference) -> None:
    """After 5398 sticks, 10 s of Fig. 3, the roundoff of 80 bits has grown to 2e-13."""
    assert validate_reference.against_published(reference.program) < 3e-13


def test_reference_depends_on_neither_stages_nor_tolerance(reference: tr.Reference) -> None:
    for number in (3, 5, 26):
        scene = random_scene(audit.SEED, number)
        truth, again = reference.run(scene), reference.run(scene, stages=9, tolerance=1e-14)
        scale, here, there = tr.scales(scene, truth), tr.columns(scene, truth), tr.columns(scene, again)
        np.testing.assert_array_equal(again.event_kind, truth.event_kind)
        for name in here:
            assert (tr.differences(name, there[name], here[name]) <= 1e-13 * scale[name]).all(), (number, name)


def failures(verdicts: list[audit.Verdict]) -> list[str]:
    return [audit.line(v) for v in verdicts if not v.good]


def test_scenes(reference: tr.Reference) -> None:
    scenes = dict(enumerate(random_scenes(audit.SEED, SCENES)))
    cases, verdicts, skipped = audit.audit(scenes, audit.METHODS, TOLERANCES, reference, say=False)
    assert skipped == []
    assert len(verdicts) == SCENES * len(audit.METHODS) * len(TOLERANCES)
    assert sum(case.truth.sticks > 1 for case in cases.values()) > SCENES / 3
    assert failures(verdicts) == []


@pytest.mark.full
@full
def test_two_hundred_scenes(reference: tr.Reference) -> None:
    scenes = dict(enumerate(random_scenes(audit.SEED, 200)))
    _, verdicts, skipped = audit.audit(scenes, audit.METHODS, audit.TOLERANCES, reference, say=False)
    assert skipped == []
    assert failures(verdicts) == []


# The checks see what they are for.


def test_an_error_of_the_size_of_a_looser_tolerance_is_found(reference: tr.Reference, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = random_scene(audit.SEED, 1)
    case = audit.judge(reference, 1, scene)
    assert case.truth.sticks > 10
    run = audit.ds.run
    monkeypatch.setattr(audit.ds, "run", lambda deck: run(audit.ds.Scene(**scene.groups(method="radau9", rtol=1e-4))))
    assert not audit.compare(reference, case, "radau9", 1e-10).good


def test_a_change_of_a_parameter_is_found(reference: tr.Reference) -> None:
    """The conditioning allows for rtol's worth of a parameter, not for a thousand times that."""
    scene = random_scene(audit.SEED, 1)
    case = audit.judge(reference, 1, scene)
    heavier = replace(scene, normal_load=scene.normal_load * (1 + 1e-6))
    moved = audit.Judged(**{**vars(case), "scene": heavier})
    assert not audit.compare(reference, moved, "radau13", 1e-10).good
