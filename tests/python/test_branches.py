"""Branches of limit cycles over a key: folds, doublings, ends."""

from __future__ import annotations

import dynstiction as ds
import numpy as np
import pytest
from dynstiction import branches
from programs import INPUTS

FIG3 = ds.Scene(INPUTS / "fig3.nml")
SLOW = FIG3.replace(scene={"model": "low_frequency"}, velocity=0.075)
RIG = FIG3.replace(
    system={"mass": 0.4, "stiffness_x": 2e4, "stiffness_y": 2e6, "misalignment_deg": 11.5},
    friction={"normal_load": 20.0, "mu_0": 0.25, "mu_inf": 0.18, "v_f": 4e-3},
)


def kinds(branch: ds.Branch) -> list[str]:
    return [point.kind for point in branch.points]


STEEP = ds.Scene(
    model="full", t_end=1.0, mass=0.10918646145675687, stiffness_x=22497.858782678424, stiffness_y=8609266.111155784,
    misalignment_deg=7.574044139449574, velocity=0.0005845125111558006, law="weakening", mu_0=0.15764749575838838,
    mu_inf=0.10286210525680704, v_f=0.0036301057478064056, normal_load=8.358273452438429,
)  # fmt: skip
"""Its map has slopes of some -300, and many cycles at hardly another place."""


@pytest.fixture(scope="module")
def cascade() -> ds.Branches:
    return ds.branch(RIG, "misalignment_deg", 11.0, 11.9, slow_cycles=1)


def test_a_fold_and_an_end_are_those_of_other_methods() -> None:
    """The fold of the slow motion as AUTO-07p finds it, the end in sliding as the theory says."""
    (found,) = ds.branch(SLOW, "misalignment_deg", 1.0, 6.0).branches
    assert kinds(found) == ["border", "fold", "sliding"]
    assert found.points[1].value == pytest.approx(4.3832563823545, rel=1e-9)
    assert found.points[2].value == pytest.approx(ds.critical_misalignment(FIG3.replace(velocity=0.075)).limit, rel=1e-9)
    fold = int(np.argmax(found.values))
    assert found.stable[1:fold].all() and not found.stable[fold + 1 : -1].any()


@pytest.mark.parametrize("key", ["system.mass", "friction.normal_load", "drive.velocity"])
def test_points_of_a_branch_are_the_cycles_there(key: str) -> None:
    own = {"system.mass": 0.25, "friction.normal_load": 10.0, "drive.velocity": 0.075}[key]
    found = ds.branch(SLOW, key, 0.8 * own, 1.2 * own)
    assert found.key == key
    (one, *_) = found.branches
    for i in (1, one.values.size // 2):
        there = ds.cycles(SLOW.replace(**{key: one.values[i]}))
        cycle = min(there.cycles, key=lambda each: abs(each.valley_force - one.valley_force[i]))
        for name in ("period", "peak_force", "valley_force", "stick_duration", "slip_duration", "slip_length"):
            assert getattr(one, name)[i] == pytest.approx(getattr(cycle, name), rel=1e-7), name
        assert one.multiplier[i] == pytest.approx(cycle.multiplier, rel=1e-6)


def test_periods_double_in_a_cascade(cascade: ds.Branches) -> None:
    """Each branch begins where the one of half its slow cycles loses its stability, in intervals that shrink by about 4.67."""
    at = {}
    for each in cascade.branches:
        for i, point in enumerate(each.points):
            if point.kind == "doubling" and 0 < i < len(each.points) - 1:
                at[each.slow_cycles] = point.value
    assert set(at) >= {1, 2, 4}
    born = {each.slow_cycles: each.points[-1] for each in cascade.branches if each.slow_cycles > 1}
    for count in (2, 4):
        assert born[count].kind == "doubling"
        assert born[count].value == pytest.approx(at[count // 2], rel=1e-8)
    assert 4.0 < (at[1] - at[2]) / (at[2] - at[4]) < 5.5


def test_runs_take_twice_as_long_to_repeat_beyond_a_doubling(cascade: ds.Branches) -> None:
    (doubling,) = (p for each in cascade.branches if each.slow_cycles == 1 for p in each.points if p.kind == "doubling")
    for shift, times in ((0.02, 1), (-0.02, 2)):
        run = ds.run(RIG, misalignment_deg=doubling.value + shift, t_end=60.0, rtol=1e-9, output={"interval": 10.0})
        assert run.summary["repeats"] * run.summary["period"] == pytest.approx(times * doubling.period, rel=0.01)


def test_a_fold_is_where_cycles_cease() -> None:
    found = ds.branch(RIG, "misalignment_deg", 10.5, 11.0, slow_cycles=1)
    (fold,) = {round(point.value, 7) for point in found.special("fold")}
    inside, outside = (
        [each for each in ds.cycles(RIG.replace(misalignment_deg=fold + shift)).cycles if 0.039 < each.period < 0.042]
        for shift in (-1e-4, 1e-4)
    )
    assert [each.slow_cycles for each in inside] == [1, 1] and not outside


def test_a_cycle_without_rest_ends_a_branch() -> None:
    (found,) = ds.branch(FIG3, "misalignment_deg", 7.5, 8.5).branches
    assert kinds(found) == ["border", "without rest"]
    assert found.points[1].value == pytest.approx(8.16628, abs=1e-4)
    assert found.stable.all()


@pytest.mark.full
def test_a_branch_does_not_leap_to_another() -> None:
    """Its period changes in each step as in the one before."""
    angle = STEEP.system.misalignment_deg
    the_map = branches._Map(STEEP, "system.misalignment_deg", 0.5 * angle, 1.5 * angle, "")
    found = branches._Curve(the_map, 2).follow(0.0, 0.956756)
    period = np.array([each.measures[0] for each in found])
    assert len(found) > 20 and np.all(np.abs(np.diff(period)) < 4e-3 * period[1:])


@pytest.mark.parametrize(
    ("key", "ends", "error", "text"),
    [
        ("system.phi", (1.0, 2.0), ds.UsageError, "'system.phi' is no real number of the deck"),
        ("misalignment_deg", (2.0, 1.0), ds.UsageError, "start = 2, end = 1: a range goes from a number to a larger one"),
        ("mass", (-0.1, 0.5), ds.DeckError, "mass"),
    ],
)
def test_what_is_no_range_is_refused(key: str, ends: tuple[float, float], error: type[ds.Error], text: str) -> None:
    with pytest.raises(error, match=text):
        ds.branch(SLOW, key, *ends)


def test_a_figure_shows_branches_alone_and_in_a_sweep(cascade: ds.Branches) -> None:
    assert "branch 1: 1 slow cycle" in str(cascade)
    figure = ds.plot(cascade)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[:2] == ["1 slow cycle", "2 slow cycles"] and {"stable", "unstable", "doubling"} <= set(labels)
    data = ds.sweep(RIG.replace(t_end=1.0, sweep={"keep": "cycles"}), {"misalignment_deg": [11.2, 11.6]})
    with_branches = ds.plot(data, "bifurcation", branches=cascade)
    assert len(with_branches.axes[0].lines) > len(ds.plot(data, "bifurcation").axes[0].lines)
    with pytest.raises(ds.UsageError, match="branches can be chosen for the kinds bifurcation, not for 'map'"):
        ds.plot(data, "map", branches=cascade)
    with pytest.raises(ds.UsageError, match="no quantity 'mass' of a branch"):
        ds.plot(cascade, quantity="mass")
