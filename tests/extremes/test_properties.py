"""What holds for every scene, searched for in the space between and beyond the ends of the matrix.

All values are drawn as factors of Fig. 3's, so that a counterexample shrinks towards Fig. 3.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import dynstiction as ds
import numpy as np
import pytest
from dynstiction.record import Described
from invariants import Ending, balance_faults, finish
from matrix import FIG3, KINDS, Groups, Kind, Profile, scene_of

hypothesis = pytest.importorskip("hypothesis", reason="pip install hypothesis")
assume, given, settings, st = hypothesis.assume, hypothesis.given, hypothesis.settings, hypothesis.strategies

FULL = "DYNSTICTION_FULL" in os.environ
MOTIONS = [kind for kind in KINDS if kind.model in {"full", "low_frequency", "high_frequency"}]
SMOOTH_STEP = [kind for kind in MOTIONS if kind.method in {"radau5", "radau9", "radau13"}]

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


def columns(ending: Ending) -> dict[str, np.ndarray]:
    assert ending.result is not None, ending.text
    result = ending.result
    return {**{name: result[name] for name in result}, "event time": result.events["time"], "event": result.events["kind"]}


@examples
@given(parameters(), st.sampled_from(MOTIONS), profiles())
def test_mirror_image(groups: Groups, kind: Kind, profile: Profile) -> None:
    """In the mirror, phi -> -phi, what is across the soft axis changes its sign, and nothing else, bit for bit.

    Slip straight backwards has the angle pi and not -pi also in the mirror, and sin(pi) is not quite 0: there must be a motion across.
    """
    pulled = groups["drive"]["velocity"] != 0 and (not profile or profile[0][1] != 0)
    assume(groups["system"]["misalignment_deg"] % 180 != 0)  # type: ignore[operator]
    assume(pulled or groups["initial"]["elongation_y"] != 0)
    mirrored = {group: dict(keys) for group, keys in groups.items()}
    for group, key in (("system", "misalignment_deg"), ("initial", "elongation_y")):
        mirrored[group][key] = -groups[group][key]  # type: ignore[operator]
    here, there = (finish(scene_of(each, kind, profile)) for each in (groups, mirrored))
    assert here.code == there.code
    if here.code == 2:
        return
    ours, theirs = columns(here), columns(there)
    for name in ("time", "u_x", "w_x", "X_rate", "spring_force_x", "friction", "sticking", "event time", "event"):
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
    for name in ("u_y", "w_y", "Y", "Y_rate", "spring_force_y"):
        np.testing.assert_array_equal(ours[name], -theirs[name], err_msg=name)
    way = max(np.abs(ours[name]).max() for name in ("X", "u_x"))
    np.testing.assert_allclose(ours["X"], theirs["X"], rtol=0, atol=1e-15 * way)


powers = st.integers(-20, 20).map(lambda exponent: 2.0**exponent)
few_examples = settings(examples, max_examples=400 if FULL else 30)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@few_examples
@given(parameters(), profiles(), powers, powers, powers)
def test_units(kind: Kind, groups: Groups, profile: Profile, length: float, time: float, mass: float) -> None:
    """Other units of length, time and mass, powers of two of ours, give the same numbers, bit for bit."""
    units = Units(length, time, mass)
    scene = scene_of(groups, kind, profile)
    here, there = finish(scene), finish(units.rescaled(scene))
    assert here.code == there.code, there.text
    if here.result is None or there.result is None:
        assert here.result is there.result
        return
    ours, theirs = numbers(here.result), numbers(there.result)
    assert list(ours) == list(theirs)
    for name, (values, unit) in ours.items():
        difference = theirs[name][0] - units.factor(unit) * values
        if unit in ("rad", "deg"):
            # pi and -pi, where w_y has underflowed.
            turn = 2 * np.pi if unit == "rad" else 360.0
            difference -= turn * np.rint(difference / turn)
        # What underflows loses digits.
        np.testing.assert_allclose(difference, 0.0, rtol=0, atol=1e-290, err_msg=name)


@pytest.mark.filterwarnings("ignore::dynstiction.IncompleteWarning")
@few_examples
@given(parameters(), st.sampled_from(["rodas4p", "radau5", "radau9", "radau13", "dopri5", "dop853"]), powers, powers, powers)
def test_units_of_a_sweep(groups: Groups, method: str, length: float, time: float, mass: float) -> None:
    """The cases of a sweep of the slow motion, side by side (rodas4p) and one by one."""
    pytest.importorskip("xarray")
    units = Units(length, time, mass)
    scene = scene_of(groups, Kind("slow", "low_frequency", method))
    speed = float(str(scene["drive"]["velocity"])) or 1e-3
    angles, speeds = np.linspace(0.5, 60.0, 12), speed * 2.0 ** np.arange(-6.0, 6.0)
    ours, theirs = (
        ds.sweep(
            ds.Scene(**each), {"system.misalignment_deg": angles, "drive.velocity": unit * speeds}, points=True, progress=False
        )
        for each, unit in ((scene, 1.0), (units.rescaled(scene), length / time))
    )
    assert np.array_equal(ours["result_code"], theirs["result_code"])
    assert set(ours) == set(theirs)
    for name in set(ours) - {"result_text", "wall_time"}:
        factor = units.factor(ours[name].attrs["units"])
        np.testing.assert_allclose(theirs[name].values, factor * ours[name].values, rtol=0, atol=1e-290, err_msg=name)


def numbers(result: ds.Result) -> dict[str, tuple[np.ndarray, str]]:
    """Everything that a run gives, with its unit: columns, events, summary, and what the work was counted to."""
    found = {name: (result[name], result.columns.units[name]) for name in result}
    found["event time"] = result.events["time"], "s"
    found["event"] = result.events["kind"].astype(float), "1"
    for described in (result.summary, result.statistics):
        for name, value in described.items():
            if name != "wall_time":
                found[name] = np.array([float(value)]), described.units[name]
    return found


@dataclass(frozen=True)
class Units:
    """How many of the other units one of ours is."""

    length: float
    time: float
    mass: float

    def factor(self, unit: str) -> float:
        """Of a value in an SI unit as the files write it."""
        return {
            "1": 1.0,
            "rad": 1.0,
            "deg": 1.0,
            "s": self.time,
            "m": self.length,
            "m/s": self.length / self.time,
            "N": self.mass * self.length / self.time**2,
            "J": self.mass * self.length**2 / self.time**2,
        }[unit]

    def rescaled(self, scene: Groups) -> Groups:
        """The same scene."""
        keys = {
            ("scene", "t_end"): self.time,
            ("system", "mass"): self.mass,
            ("system", "stiffness_x"): self.mass / self.time**2,
            ("system", "stiffness_y"): self.mass / self.time**2,
            ("friction", "normal_load"): self.factor("N"),
            ("friction", "v_f"): self.length / self.time,
            ("friction", "v_smooth"): self.length / self.time,
            ("drive", "time"): self.time,
            ("drive", "velocity"): self.length / self.time,
            ("initial", "elongation_x"): self.length,
            ("initial", "elongation_y"): self.length,
            ("integrator", "step"): self.time,
            ("output", "interval"): self.time,
        }
        return {
            group: {key: times(value, keys.get((group, key), 1.0)) for key, value in values.items()}
            for group, values in scene.items()
        }


def times(value: object, unit: float) -> object:
    if isinstance(value, list):
        return [unit * x for x in value]
    return unit * value if isinstance(value, float) and unit != 1.0 else value


@pytest.mark.parametrize("kind", SMOOTH_STEP, ids=lambda kind: kind.name)
def test_the_search_starts_at_fig3(kind: Kind) -> None:
    """What the counterexamples shrink to is itself sound."""
    assert finish(scene_of(FIG3, kind)).code == 0
