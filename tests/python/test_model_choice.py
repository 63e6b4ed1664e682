"""`model = 'auto'`: which model it is, why, and that its error stays below `accuracy`."""

from functools import cache
from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from fig3 import DRIVE, FRICTION, SYSTEM
from programs import Program

FIG3 = {name: value for name, value in {**SYSTEM, **FRICTION, **DRIVE}.items() if name not in ("law", "normal_load")}
ACCURACIES = (0.3, 0.1, 0.02, 1e-2, 1e-3, 1e-4, 1e-6)


def duration_of(scene: dict[str, float], lengths: float) -> float:
    """Until the drive has moved by so many l_x [s]."""
    return lengths * scene["mu_0"] * scene.get("normal_load", 10.0) / scene["stiffness_x"] / abs(scene["velocity"])


def deck(scene: dict[str, float], model: str, lengths: float, more: str = "") -> str:
    """A scene in which the drive moves by so many l_x."""
    t_end = duration_of(scene, lengths)
    law = "law='constant'" if scene["mu_inf"] == scene["mu_0"] else f"mu_inf={scene['mu_inf']}, v_f={scene['v_f']}"
    return f"""
    &scene model='{model}', t_end={t_end!r} {more} /
    &system mass={scene["mass"]}, stiffness_x={scene["stiffness_x"]}, stiffness_y={scene["stiffness_y"]},
        misalignment_deg={scene["misalignment_deg"]} /
    &friction {law}, mu_0={scene["mu_0"]}, normal_load={scene.get("normal_load", 10.0)} /
    &drive velocity={scene["velocity"]} /
    &integrator rtol=1e-7 /
    &output interval={t_end / 200!r} /
    """


@cache
def full_run(lengths: float, **scene: float) -> ds.Result:
    """What several choices are compared with."""
    return ds.run(deck(scene, "full", lengths))


def choice_of(scene: dict[str, float], lengths: float, accuracy: float, quantities: str = "stick_slip", /, **groups: object) -> str:
    """Why it is that model."""
    text = deck(scene, "auto", lengths, f"quantities='{quantities}', accuracy={accuracy}")
    return str(ds.run(text, **groups).attributes["model_choice"])


def error_in_creep(result: ds.Result, full: ds.Result) -> float:
    return float(np.abs(result["X"] - full["X"]).max() / np.abs(full["X"][-1]))


def error_in_stick_slip(result: ds.Result, full: ds.Result) -> float:
    names = [name for name in ("period", "peak_force", "slip_length") if name in full.summary]
    if not names:
        scale = np.abs(full["friction"]).max()
        return float(np.abs(result["spring_force_x"] - full["spring_force_x"]).max() / scale)
    return max(abs(result.summary.get(name, 0.0) / full.summary[name] - 1.0) for name in names)


SCENES = {
    "Fig. 3": {},
    "Fig. 3, constant": {"mu_inf": 0.20},
    "phi = 1e-3": {"misalignment_deg": 1e-3},
    "phi = 0.2": {"misalignment_deg": 0.2},
    "phi = -3": {"misalignment_deg": -3.0},
    "phi = 8": {"misalignment_deg": 8.0},
    "phi = 10": {"misalignment_deg": 10.0},
    "phi = 30, constant": {"misalignment_deg": 30.0, "mu_inf": 0.20},
    "phi = 85, constant": {"misalignment_deg": 85.0, "mu_inf": 0.20},
    "k_y/k_x = 1e2": {"stiffness_y": 1e5},
    "k_y/k_x = 1e3": {"stiffness_y": 1e6},
    "k_y/k_x = 1e6": {"stiffness_y": 1e9},
    "k_y/k_x = 1e6, constant": {"stiffness_y": 1e9, "mu_inf": 0.20},
    "m = 1e-3": {"mass": 3e-3},
    "m = 25": {"mass": 25.0},
    "m = 25, constant": {"mass": 25.0, "mu_inf": 0.20},
    "V = 1e-5, where the fast oscillation sets off slip": {"velocity": 1e-5, "stiffness_y": 1e6, "mass": 1.0},
    "V = 1e-4": {"velocity": 1e-4, "stiffness_y": 3e6},
    "V = 2e-2": {"velocity": 2e-2},
    "V = 0.5": {"velocity": 0.5},
    "v_f = 1e-3": {"v_f": 1e-3},
    "v_f = 1e-6": {"v_f": 1e-6},
    "v_f = 0.1": {"v_f": 0.1},
    "mu_inf = 0.19": {"mu_inf": 0.19},
    "mu_inf = 0.02": {"mu_inf": 0.02},
    "strengthening": {"mu_inf": 0.25},
}


DIES_OUT = {"mass": 0.197669, "stiffness_x": 828700.08, "stiffness_y": 1.51873811e9, "misalignment_deg": 0.848907}
DIES_OUT |= {"mu_0": 0.322611, "mu_inf": 0.322611, "velocity": -1.22994e-3}


@pytest.mark.parametrize("change", SCENES.values(), ids=SCENES.keys())
def test_error_stays_below_accuracy(change: dict[str, float]) -> None:
    scene = FIG3 | change
    checks = {"creep": (0.3, 0.95, error_in_creep), "stick_slip": (2.6, error_in_stick_slip)}
    for quantities, (*spans, error_of) in checks.items():
        for lengths in spans:
            full = full_run(lengths, **scene)
            errors: dict[str, float] = {}
            for accuracy in ACCURACIES:
                more = f"quantities='{quantities}', accuracy={accuracy}"
                chosen = ds.run(deck(scene, "auto", lengths, more))
                model = str(chosen.attributes["model"])
                assert str(chosen.attributes["model_choice"]).startswith(f"{model}: ")
                if model == "full":
                    continue
                errors.setdefault(model, error_of(chosen, full))
                assert errors[model] <= accuracy, (quantities, lengths, model)


@pytest.mark.parametrize(
    ("quantities", "accuracy", "lengths", "change", "model"),
    [
        ("creep", 2e-2, 0.5, {}, "creep_asymptotic"),
        ("creep", 1e-1, 0.9, {}, "creep_asymptotic"),
        ("creep", 6e-2, 0.95, {"misalignment_deg": 4.0}, "creep"),
        ("creep", 4e-2, 0.95, {"misalignment_deg": 4.0}, "low_frequency"),
        ("creep", 1e-9, 0.5, {}, "full"),
        ("creep", 3e-1, 5.0, {}, "full"),
        ("stick_slip", 3e-2, 5.0, {}, "low_frequency"),
        ("stick_slip", 1e-3, 5.0, {}, "full"),
        ("stick_slip", 1e-2, 2.6, {"stiffness_y": 1e9}, "low_frequency"),
        ("high_frequency", 1e-1, 0.5, {}, "full"),
        # Friction is constant, so that every oscillation dies out; the two models pass the share below which it has at different times.
        ("stick_slip", 0.03, 0.05, DIES_OUT, "low_frequency"),
        ("stick_slip", 0.03, 6.0, DIES_OUT, "full"),
    ],
)
def test_the_cheapest_is_found(quantities: str, accuracy: float, lengths: float, change: dict[str, float], model: str) -> None:
    assert choice_of(FIG3 | change, lengths, accuracy, quantities).startswith(f"{model}: ")


@pytest.mark.parametrize(
    ("groups", "reason"),
    [
        ({"friction": {"contact": "smoothed", "v_smooth": 1e-7}}, "exact contact"),
        ({"drive": {"time": [0.0, 1.0], "velocity": [1e-3, 2e-3]}}, "constant drive velocity"),
        ({"drive": {"velocity": 0.0}}, "constant drive velocity"),
        ({"initial": {"elongation_x": 1e-4}}, "unstretched springs"),
        ({"initial": {"elongation_x": -1e-4}}, "unstretched springs"),
        ({"initial": {"elongation_y": -1e-9}}, "unstretched springs"),
        ({"initial": {"elongation_x": 1e-4, "elongation_y": -1e-4}}, "unstretched springs"),
        ({"initial": {"velocity_ratio": 10.0}}, "slow start"),
        ({"initial": {"velocity_ratio": -10.0}}, "slow start"),
        ({"system": {"misalignment_deg": 0.0}}, "0 < |misalignment_deg| < 90"),
        ({"system": {"misalignment_deg": 90.0}}, "0 < |misalignment_deg| < 90"),
        ({"system": {"misalignment_deg": 135.0}}, "0 < |misalignment_deg| < 90"),
        ({"system": {"misalignment_deg": 1e-3}}, "the misalignment is not above"),
        ({"system": {"stiffness_y": 2.9e5}}, "below 300 stiffness_x"),
        ({"friction": {"normal_load": 0.0}}, "without friction"),
    ],
    ids=str,
)
def test_scenes_beyond_the_estimates_are_full(groups: dict[str, dict[str, object]], reason: str) -> None:
    """Each says why; what it says is what is the matter."""
    choice = choice_of(FIG3, 0.05, 1.0, "creep", **groups)
    assert choice.startswith("full: ")
    assert reason in choice


@pytest.mark.parametrize("change", [{"stiffness_y": 1e6}, {"velocity": 2e-4}, {"v_f": 1e-3}], ids=str)
@pytest.mark.parametrize("lengths", [1.3, 5.0])
def test_where_the_fast_oscillation_sets_off_slip_it_is_full(change: dict[str, float], lengths: float) -> None:
    """D < 1: slow cycles need not repeat, and no accuracy is promised."""
    assert choice_of(FIG3 | change, lengths, 1.0).startswith("full: low_frequency is not known to be that accurate here")
    assert ds.creep_end(**FIG3 | change, normal_load=10.0).decay < 1.0


COLUMNS = tuple(name for name in ds.run(deck(FIG3, "full", 1e-4)) if name != "time")
SPANS = (("creep", 0.1), ("creep", 0.5), ("creep", 0.95), ("stick_slip", 2.6), ("stick_slip", 4.0))


def chosen_for(column: str, scene: dict[str, float], quantities: str, lengths: float, accuracy: float) -> ds.Result | None:
    """What `auto` gives of one column; None if it takes the full model."""
    more = f"quantities='{quantities}', accuracy={accuracy}"
    with ds.Simulation(deck(scene, "auto", lengths, more), output={"fields": [column]}) as simulation:
        if simulation.result.attributes["model"] == "full":
            return None
        return simulation.finish()


def errors_of_columns(scene: dict[str, float], quantities: str, lengths: float) -> dict[tuple[str, float], float]:
    """Largest error over the largest value, by column and accuracy, where the model is not the full one."""
    full: ds.Result | None = None
    errors = {}
    for column in COLUMNS:
        for accuracy in (0.3, 0.03, 1e-3):
            result = chosen_for(column, scene, quantities, lengths, accuracy)
            if result is not None:
                full = full or full_run(lengths, **scene)
                error = np.abs(result[column] - full[column]).max() / np.abs(full[column]).max()
                errors[column, accuracy] = float(error)
    return errors


@pytest.mark.parametrize("change", SCENES.values(), ids=SCENES.keys())
def test_every_column_is_that_of_full(change: dict[str, float]) -> None:
    for span in SPANS:
        errors = errors_of_columns(FIG3 | change, *span)
        assert {of: error for of, error in errors.items() if error > of[1]} == {}, span


def random_scene(random: np.random.Generator) -> dict[str, float]:
    """Log-uniform over several decades of every parameter."""
    scene = dict(FIG3)
    scene["mass"] = 0.25 * 10 ** random.uniform(-2, 2)
    scene["stiffness_x"] = 1e3 * 10 ** random.uniform(-1.5, 1.5)
    scene["stiffness_y"] = scene["stiffness_x"] * 10 ** random.uniform(2.5, 6.5)
    scene["mu_0"] = random.uniform(0.05, 0.9)
    scene["mu_inf"] = scene["mu_0"] * random.choice([1.0, random.uniform(0.1, 1.2)])
    scene["v_f"] = 10 ** random.uniform(-4, 0)
    scene["velocity"] = float(random.choice([-1, 1], p=[0.2, 0.8]) * 10 ** random.uniform(-5, -1))
    scene["misalignment_deg"] = float(random.choice([-1, 1]) * 10 ** random.uniform(-2, 1.9))
    return scene


def fast_cycles(scene: dict[str, float], lengths: float) -> float:
    """Periods of the oscillation on the stiff spring."""
    return float(duration_of(scene, lengths) * np.sqrt(scene["stiffness_y"] / scene["mass"]) / (2.0 * np.pi))


def test_every_column_is_that_of_full_in_random_scenes() -> None:
    random = np.random.default_rng(1)
    reduced = 0
    scenes = 0
    while scenes < 100:
        scene, span = random_scene(random), SPANS[random.integers(len(SPANS))]
        if fast_cycles(scene, span[1]) > 3e3:
            continue
        scenes += 1
        errors = errors_of_columns(scene, *span)
        reduced += len(errors)
        assert {of: error for of, error in errors.items() if error > of[1]} == {}, (scene, span)
    # Of 100 times 16 columns at three accuracies.
    assert reduced > 50


def test_a_column_that_a_model_lacks_rules_it_out() -> None:
    def choice(*fields: str) -> str:
        return choice_of(FIG3, 0.5, 2e-2, "creep", output={"fields": list(fields)})

    assert choice("X").startswith("creep_asymptotic: ")
    found = choice("X", "spring_force_x")
    assert found.startswith("creep: ") and "; creep_asymptotic does not give spring_force_x" in found
    assert choice("u_y") == (
        "full: creep_asymptotic does not give u_y; creep gives u_y without the fast oscillation; low_frequency holds u_y constant"
    )
    assert choice("X", "X_rate").startswith("full: creep_asymptotic gives X_rate without the fast oscillation; ")


@pytest.mark.parametrize(("quantities", "lengths"), [("creep", 0.5), ("creep", 0.95), ("stick_slip", 5.0)])
@pytest.mark.parametrize("angle", [1.0, 5.0])
def test_no_column_is_a_constant_in_place_of_a_motion(quantities: str, lengths: float, angle: float) -> None:
    """With `fields = 'default'` the file has what the model taken says something of."""
    scene = FIG3 | {"misalignment_deg": angle}
    for accuracy in (0.1, 0.05, 0.03, 1e-9):
        result = ds.run(deck(scene, "auto", lengths, f"quantities='{quantities}', accuracy={accuracy}"))
        assert "X" in result
        assert [name for name in result if np.ptp(result[name]) == 0] == []


@pytest.mark.deck
def test_the_choice_is_in_the_file_and_on_the_terminal(program: Program, tmp_path: Path) -> None:
    (tmp_path / "auto.nml").write_text(deck(FIG3, "auto", 0.5, "quantities='creep', accuracy=2e-2"))
    assert "auto.nml: model 'auto' is creep_asymptotic: " in program("run", "auto.nml", status=0).stderr
    attributes = ds.open(tmp_path / "auto.h5").attributes
    assert attributes["model"] == "creep_asymptotic"
    assert attributes["method"] == "closed form"
    assert str(attributes["model_choice"]).startswith("creep_asymptotic: ")
    assert program("run", "auto.nml", "--quiet", "--overwrite", status=0).stderr == ""
    assert "model_choice" not in ds.run(deck(FIG3, "full", 0.05)).attributes
