"""The four mirror images of a scene have one summary, whatever the model, the method and the profile of the drive."""

from __future__ import annotations

from collections.abc import Iterator

import dynstiction as ds
import numpy as np
import pytest
from fig3 import Groups, changed, slider

pytest.importorskip("xarray")

# What becomes of V, phi and the elongations of the springs at the start.
IMAGES = {
    "V -> -V": lambda v, phi, x, y: (-v, phi, -x, -y),
    "phi -> -phi": lambda v, phi, x, y: (v, -phi, x, -y),
    "phi -> 180 - phi": lambda v, phi, x, y: (v, 180.0 - phi, -x, y),
    "phi -> 180 + phi": lambda v, phi, x, y: (v, 180.0 + phi, -x, -y),
}
# Of the state at the end, which sweeps keep: what an image does to its sign.
SIGNS = {
    "V -> -V": {"final_u_x": -1, "final_u_y": -1, "final_X": -1, "final_X_rate": -1},
    "phi -> -phi": {"final_u_y": -1},
    "phi -> 180 - phi": {"final_u_x": -1},
    "phi -> 180 + phi": {"final_u_x": -1, "final_u_y": -1},
}
MADE_OF_ROUNDOFF = ("energy_residual",)

FIG3 = slider({"system": {"stiffness_y": None}})
STIFF = {"stiffness_y": 1e7}
SOFTER = {"stiffness_y": 3e4, "misalignment_deg": 5.0}

SCENES: dict[str, Groups] = {
    "low_frequency": {"scene": {"model": "low_frequency", "t_end": 10.0}},
    "low_frequency, no cycle": {"scene": {"model": "low_frequency", "t_end": 2.5}},
    "low_frequency, dopri5": {"scene": {"model": "low_frequency", "t_end": 5.0}, "integrator": {"method": "dopri5"}},
    "low_frequency, stretched": {
        "scene": {"model": "low_frequency", "t_end": 6.0},
        "system": {"misalignment_deg": 4.0},
        "initial": {"elongation_x": -3e-3, "velocity_ratio": -2.0},
    },
    "full": {"scene": {"model": "full", "t_end": 3.0}, "system": STIFF, "integrator": {"rtol": 1e-9}},
    "full, stretched both ways": {
        "scene": {"model": "full", "t_end": 3.0},
        "system": SOFTER,
        "initial": {"elongation_x": 5e-4, "elongation_y": 2e-5},
    },
    **{
        f"full, {method}": {
            "scene": {"model": "full", "t_end": 3.0},
            "system": SOFTER,
            "integrator": {"method": method, **({"step": 1e-4} if method == "moreau_jean" else {})},
        }
        for method in ("radau5", "radau13", "dopri5", "moreau_jean")
    },
    "full, smoothed": {
        "scene": {"model": "full", "t_end": 3.0},
        "system": SOFTER,
        "friction": {"contact": "smoothed", "v_smooth": 1e-5},
    },
    "full, 83 degrees": {"scene": {"model": "full", "t_end": 0.5}, "system": {"stiffness_y": 3e4, "misalignment_deg": 83.0}},
    "full, 90 degrees": {
        "scene": {"model": "full", "t_end": 0.5},
        "system": {"stiffness_y": 3e4, "misalignment_deg": 90.0},
        "initial": {"elongation_x": 1e-4},
    },
    "high_frequency": {"scene": {"model": "high_frequency", "t_end": 0.05}, "system": STIFF, "initial": {"elongation_x": 1e-3}},
    "creep": {
        "scene": {"model": "creep", "t_end": 1.5},
        "system": {**STIFF, "mass": None},
        "friction": {"law": None, "mu_inf": None, "v_f": None},
    },
    "a drive that reverses": {
        "scene": {"model": "low_frequency", "t_end": 16.0},
        "drive": {"velocity": (1e-3, 1e-3, -2e-3, -2e-3, 1e-3), "time": (0.0, 5.0, 6.0, 9.0, 10.0)},
    },
    "a drive that reverses and rests, full": {
        "scene": {"model": "full", "t_end": 9.0},
        "system": SOFTER,
        "drive": {"velocity": (0.0, 0.0, -1e-3, -1e-3, 0.0, 0.0, 2e-3), "time": (0, 0.5, 0.5, 4, 4.2, 5.0, 5.0)},
    },
    "a drive that rests": {
        "scene": {"model": "full", "t_end": 1.0},
        "system": SOFTER,
        "drive": {"velocity": 0.0},
        "initial": {"elongation_x": 3e-3},
    },
}


def image(scene: Groups, name: str) -> Groups:
    initial = scene.get("initial", {})
    velocity, phi, x, y = IMAGES[name](
        np.atleast_1d(scene["drive"]["velocity"]),
        scene["system"]["misalignment_deg"],
        initial.get("elongation_x", 0.0),
        initial.get("elongation_y", 0.0),
    )
    drive = {**scene["drive"], "velocity": tuple(velocity.tolist())}
    elongations = {k: v for k, v in {"elongation_x": x, "elongation_y": y}.items() if k in initial}
    return changed(scene, {"system": {"misalignment_deg": phi}, "drive": drive, "initial": elongations})


def scale_of(name: str, summary: dict[str, float]) -> float:
    """A scatter is as large as nothing: it counts by the mean that it belongs to."""
    return abs(summary[name.removesuffix("_scatter")])


def differences(one: dict[str, float], other: dict[str, float], rel: float) -> Iterator[str]:
    if set(one) != set(other):
        yield f"only one has {set(one) ^ set(other)}"
    for name in set(one) & set(other) - set(MADE_OF_ROUNDOFF):
        if abs(one[name] - other[name]) > rel * scale_of(name, one) + 1e-12:
            yield f"{name}: {one[name]} and {other[name]}"


@pytest.mark.parametrize("name", SCENES)
def test_the_images_have_one_summary(name: str) -> None:
    scene = changed(FIG3, SCENES[name])
    summary = dict(ds.run(ds.Scene(**scene)).summary)
    for mirror in IMAGES:
        mirrored = dict(ds.run(ds.Scene(**image(scene, mirror))).summary)
        assert list(differences(summary, mirrored, 1e-5)) == [], mirror


def test_loads_and_lengths_are_counted_along_the_drive() -> None:
    scene = changed(FIG3, SCENES["low_frequency"])
    for mirror in IMAGES:
        summary = ds.run(ds.Scene(**image(scene, mirror))).summary
        assert summary["peak_force"] == pytest.approx(1.9933, abs=1e-4)
        assert summary["valley_force"] == pytest.approx(1.1671, abs=1e-4)
        assert summary["stick_duration"] > 10 * summary["slip_duration"]
        assert summary["slip_length"] == pytest.approx(8.843e-4, rel=1e-3)
        assert summary["max_X_rate"] == pytest.approx(0.02636, rel=1e-3)


def random_points(n: int) -> dict[str, np.ndarray]:
    chance = np.random.default_rng(12)
    # Angles that 180 - phi and 180 + phi keep to the last bit.
    angle = np.round(10 ** chance.uniform(-1, 1.9, n) * 256) / 256
    points = {
        "system.misalignment_deg": angle,
        "system.mass": 10 ** chance.uniform(-3, 1, n),
        "system.stiffness_x": 10 ** chance.uniform(2, 4, n),
        "friction.mu_0": chance.uniform(0.1, 0.5, n),
        "friction.v_f": 10 ** chance.uniform(-3, -1, n),
        "drive.velocity": 10 ** chance.uniform(-4, -2, n),
        "initial.velocity_ratio": chance.choice([0.0, 1e-6, 1.0, -2.0], n),
        "initial.elongation_x": chance.choice([0.0, 1e-4, -1e-3], n),
    }
    length = points["friction.mu_0"] * 10.0 / points["system.stiffness_x"]
    points["scene.t_end"] = length / points["drive.velocity"] * chance.uniform(1, 12, n)
    return points


@pytest.mark.parametrize("method", ["rodas4p", "radau9"])
def test_the_images_of_random_sweeps_have_one_summary(method: str) -> None:
    points = random_points(100)
    deck = ds.Scene(**changed(FIG3, SCENES["low_frequency"]))

    def swept(values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        data = ds.sweep(deck, values, points=True, integrator={"method": method, "rtol": 1e-7})
        assert (data["result_code"] == 0).all()
        return {str(name): data[name].values for name in data.data_vars if data[name].dtype == np.float64}

    kept = swept(points)
    assert (kept["cycles"] > 0).sum() > 20
    for mirror, become in IMAGES.items():
        v, phi, x, _ = become(points["drive.velocity"], points["system.misalignment_deg"], points["initial.elongation_x"], 0.0)
        mirrored = swept({**points, "drive.velocity": v, "system.misalignment_deg": phi, "initial.elongation_x": x})
        for name, values in kept.items():
            if name in (*MADE_OF_ROUNDOFF, "wall_time", "steps") or "." in name:
                continue
            other = SIGNS[mirror].get(name, 1) * mirrored[name]
            np.testing.assert_array_equal(np.isnan(values), np.isnan(other), err_msg=f"{mirror}: {name}")
            scale = np.abs(kept[name.removesuffix("_scatter")])
            wrong = np.abs(values - other) > 1e-5 * scale + 1e-12
            assert not wrong.any(), f"{mirror}: {name}: {values[wrong]}, {other[wrong]}"


def test_a_reversing_drive_has_the_cycles_of_its_strokes() -> None:
    """Six strokes, to and fro, have six times what one has, and no cycle is made of two strokes."""
    stroke = changed(FIG3, SCENES["low_frequency"])
    stroke["scene"] = {**stroke["scene"], "t_end": 6.0}
    alone = ds.run(ds.Scene(**stroke))
    times, velocities = [], []
    for i in range(6):
        times += [6.0 * i, 6.0 * (i + 1)]
        velocities += [(-1) ** i * 1e-3] * 2
    there_and_back = ds.run(ds.Scene(**stroke), scene={"t_end": 36.0}, drive={"time": tuple(times), "velocity": tuple(velocities)})
    cycles = ds.stick_slip_statistics(there_and_back)
    assert np.nanmax(cycles["period"]) == pytest.approx(alone.summary["period"], rel=1e-3)
    assert np.isfinite(cycles["period"]).sum() == there_and_back.summary["cycles"]
    for name in ("period", "peak_force", "valley_force", "stick_duration", "slip_duration", "slip_length"):
        assert there_and_back.summary[name] == pytest.approx(alone.summary[name], rel=1e-5), name
