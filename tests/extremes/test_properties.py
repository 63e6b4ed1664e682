"""What holds for every scene, searched for in the space between and beyond the ends of the matrix.

All values are drawn as factors of Fig. 3's, so that a counterexample shrinks towards Fig. 3.
"""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from dynstiction.record import Described
from invariants import balance_faults, finish
from matrix import FIG3, KINDS, Groups, Kind, Profile, scene_of

hypothesis = pytest.importorskip("hypothesis", reason="pip install hypothesis")
given, settings, st = hypothesis.given, hypothesis.settings, hypothesis.strategies

FULL = "DYNSTICTION_FULL" in os.environ

# The examples are the same in every run: what is found once is found again. The many come with --full.
examples = settings(
    max_examples=2000 if FULL else 150,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=list(hypothesis.HealthCheck),
    phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate, hypothesis.Phase.shrink),
)


def factor(least: float, most: float) -> st.SearchStrategy[float]:
    """Log-uniform between 10**least and 10**most."""
    return st.floats(least, most, allow_nan=False).map(lambda exponent: 10.0**exponent)


def signed(strategy: st.SearchStrategy[float]) -> st.SearchStrategy[float]:
    return st.one_of(st.just(0.0), st.builds(lambda x, side: x * side, strategy, st.sampled_from([1.0, -1.0])))


def linear(least: float, most: float) -> st.SearchStrategy[float]:
    """Not so close to 0 that squares underflow."""
    return st.floats(least, most, allow_nan=False).map(lambda x: round(x, 12))


misalignments = st.one_of(st.sampled_from([1.0, 0.0, 90.0, -90.0, 180.0, 8.655]), signed(factor(-12, 0)), linear(-360.0, 360.0))


@st.composite
def parameters(draw: st.DrawFn) -> Groups:
    """Parameters of the full model; lengths, loads and velocities are tied so that most scenes move."""
    groups: Groups = {group: dict(keys) for group, keys in FIG3.items()}
    system, friction = groups["system"], groups["friction"]
    system["mass"] = 0.25 * draw(factor(-12, 6))
    system["stiffness_x"] = 1e3 * draw(factor(-6, 6))
    system["stiffness_y"] = system["stiffness_x"] * 1e4 * draw(factor(-7, 8))
    system["misalignment_deg"] = draw(misalignments)
    friction["normal_load"] = 10.0 * draw(st.one_of(st.just(1.0), st.just(0.0), factor(-9, 9)))
    friction["mu_0"] = 0.20 * draw(st.one_of(st.just(1.0), st.just(0.0), factor(-3, 3)))
    friction["mu_inf"] = friction["mu_0"] * draw(st.one_of(st.just(0.75), st.just(1.0), linear(0, 3)))
    friction["v_f"] = 0.010 * draw(factor(-7, 11))
    groups["drive"]["velocity"] = 1e-3 * draw(st.one_of(st.just(1.0), signed(factor(-9, 5))))
    limit = 0.20 * 10.0 if friction["mu_0"] * friction["normal_load"] == 0 else friction["mu_0"] * friction["normal_load"]
    initial = groups["initial"]
    initial["velocity_ratio"] = draw(st.one_of(st.just(0.0), signed(factor(-9, 3))))
    initial["elongation_x"] = limit / system["stiffness_x"] * draw(st.one_of(st.just(0.0), linear(-3, 3)))
    initial["elongation_y"] = limit / system["stiffness_y"] * draw(st.one_of(st.just(0.0), linear(-3, 3)))
    groups["integrator"]["rtol"] = draw(st.sampled_from([1e-8, 1e-4, 1e-11]))
    return groups


@st.composite
def profiles(draw: st.DrawFn) -> Profile:
    """Mostly none; else up to six knots with jumps, holds and reversals."""
    shares = sorted(draw(st.lists(st.sampled_from([0.1, 0.2, 0.2, 0.5, 0.5, 0.8]), max_size=5)))
    if not shares:
        return ()
    knots = [0.0, *(share for i, share in enumerate(shares) if i < 2 or share > shares[i - 2])]
    return tuple((share, draw(st.sampled_from([1.0, 0.0, -1.0, 1e-6, 30.0]))) for share in knots)


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_an_open_balance_is_seen(rtol: float) -> None:
    """A twentieth of all energy at the loosest tolerance, and in proportion."""
    groups = scene_of(FIG3, KINDS[1])
    groups["integrator"]["rtol"] = rtol
    result = finish(groups).result
    assert result is not None and balance_faults(result, groups) == []
    for lost in (5e2 * rtol, -5e2 * rtol, np.nan):
        summary = Described([(info, lost if info.name == "energy_residual" else x) for info, x in result.summary.info()])
        assert len(balance_faults(replace(result, summary=summary), groups)) == 1


@examples
@given(parameters(), st.sampled_from(KINDS), profiles())
def test_any_scene_ends_well(groups: Groups, kind: Kind, profile: Profile) -> None:
    assert finish(scene_of(groups, kind, profile)).faults == []
