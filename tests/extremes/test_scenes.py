"""The full model far away from Fig. 3: every run must end, be finite, close its energy balance and obey Coulomb's law at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import h5py
import numpy as np
import pytest
from fig3 import CONSTANT, GROUPS, Groups, changed
from programs import Program

pytestmark = pytest.mark.deck

METHODS = ("radau5", "radau9", "radau13")
RTOL = 1e-8
STICKS, SLIPS = 1, 2

FIG3 = changed(GROUPS, {"integrator": {"rtol": RTOL}, "output": {"interval": 0.0}})


def deck_text(groups: Groups) -> str:
    def value(x: object) -> str:
        if isinstance(x, (list, tuple)):
            return ", ".join(map(value, x))
        return f"'{x}'" if isinstance(x, str) else repr(x)

    return "".join(
        f"&{group}\n" + "".join(f"  {key} = {value(x)}\n" for key, x in keys.items()) + "/\n" for group, keys in groups.items()
    )


def first_release(groups: Groups) -> float:
    """Time at which an object that is stuck from time 0 on at u = 0 is released."""
    system, friction = groups["system"], groups["friction"]
    phi = math.radians(system["misalignment_deg"])
    rate = abs(groups["drive"]["velocity"]) * math.hypot(
        system["stiffness_x"] * math.cos(phi), system["stiffness_y"] * math.sin(phi)
    )
    return friction["mu_0"] * friction["normal_load"] / rate


def fast_period(groups: Groups) -> float:
    system = groups["system"]
    return 2 * math.pi * math.sqrt(system["mass"] / max(system["stiffness_x"], system["stiffness_y"]))


@dataclass
class Run:
    static_limit: float
    attributes: dict[str, object]
    series: dict[str, np.ndarray]
    events: dict[str, np.ndarray]
    summary: dict[str, float]
    statistics: dict[str, float]

    @property
    def load(self) -> np.ndarray:
        return np.hypot(self.series["spring_force_x"], self.series["spring_force_y"])


@dataclass
class Case:
    """A scene; without an end of its own it lasts for `cycles` fast periods after the first release."""

    name: str
    changes: Groups = field(default_factory=dict)
    t_end: float | None = None
    cycles: float = 300.0

    def groups(self, method: str, rtol: float = RTOL) -> Groups:
        groups = changed(FIG3, self.changes, {"integrator": {"method": method, "rtol": rtol}})
        lasts = first_release(groups) + self.cycles * fast_period(groups) if self.t_end is None else self.t_end
        return changed(groups, {"scene": {"t_end": lasts}})


def run(program: Program, groups: Groups) -> Run:
    (program.folder / "case.nml").write_text(deck_text(groups))
    done = program("run", "case.nml", "--quiet", "--overwrite")
    assert done.returncode == 0, f"exit status {done.returncode}: {done.stderr}\n{deck_text(groups)}"
    with h5py.File(program.folder / "case.h5") as opened:
        read = [
            {key: data[()] for key, data in opened[name].items()} for name in ("time_series", "events", "summary", "statistics")
        ]
        friction = groups["friction"]
        return Run(friction["mu_0"] * friction["normal_load"], dict(opened.attrs), *read)


def assert_sound(result: Run, groups: Groups, rtol: float = RTOL) -> None:
    """What holds for every scene."""
    assert result.attributes["result_code"] == 0
    assert result.attributes["complete"] == 1
    time = result.series["time"]
    assert time[-1] == groups["scene"]["t_end"]
    assert (np.diff(time) >= 0).all()
    for name, values in result.series.items():
        assert np.isfinite(values).all(), name
    # Where nothing is dissipated the error of every step stays in the balance.
    assert abs(result.summary["energy_residual"]) <= max(1e3, result.statistics["steps"]) * rtol
    sticking = result.series["sticking"] == 1
    assert (result.load[sticking] <= result.static_limit * (1 + 1e-9)).all()
    assert (result.series["w_x"][sticking] == 0).all()
    assert (result.series["w_y"][sticking] == 0).all()
    kinds = result.events["kind"]
    assert (np.diff(result.events["time"]) >= 0).all()
    assert (kinds[1:] != kinds[:-1]).all(), "stick and slip take turns"


def profile(*knots: tuple[float, float]) -> dict[str, list[float]]:
    return {"time": [t for t, _ in knots], "velocity": [v for _, v in knots]}


V = 1e-3
ALIGNED = {"system": {"misalignment_deg": 0.0}}


def family(
    name: str,
    group: str,
    key: str,
    values: tuple[float, ...],
    unit: float = 1.0,
    t_end: float | None = None,
    **more: dict[str, object],
) -> list[Case]:
    """One key with several values; the name has a place for each."""
    return [Case(name.format(value), {**more, group: {**more.get(group, {}), key: unit * value}}, t_end) for value in values]


def with_ratio(name: str, ratios: tuple[float, ...], t_end: float | None = None, **more: dict[str, object]) -> list[Case]:
    return family(name, "system", "stiffness_y", ratios, 1e3, t_end, **more)


CASES = [
    *family("phi = {} deg", "system", "misalignment_deg", (1e-9, 90.0, -90.0, -1.0, 45.0, 8.655, 30.0, 76.3, 89.999)),
    *family("phi = {} deg, cycles", "system", "misalignment_deg", (0.0, 180.0, 1e-9, 8.15), t_end=4.0),
    *with_ratio("k_y/k_x = {:g}", (0.1, 1.0, 10.0, 100.0), 3.0),
    *with_ratio("k_y/k_x = {:g}", (1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9)),
    *with_ratio("k_y/k_x = {:g}, constant friction", (0.1, 1.0, 1e3, 1e6, 1e9), friction=CONSTANT),
    *family("m = {:g} kg", "system", "mass", (1e-12, 1e-9, 1e-6, 1e-3, 1.0, 10.0, 100.0)),
    *family("m = {:g} kg, phi = 0", "system", "mass", (1e-12, 1e-9, 1e-6, 1e-3, 1.0, 100.0), t_end=4.0, **ALIGNED),
    *family("V = {:g} m/s", "drive", "velocity", (1e-9, 1e-8, 1e-6, 1e-5, 1e-4, -1e-3, 1e-2, 0.1, 1.0)),
    *family("V = {:g} m/s, cycles", "drive", "velocity", (1e-2, 0.02, 0.1, 1.0), t_end=0.5),
    *family("v_f = {:g} m/s", "friction", "v_f", (1e-5, 1e-4, 1e-3, 0.1, 1.0, 1e3)),
    *family("v_f = {:g} m/s, cycles", "friction", "v_f", (1e-5, 1e-3, 1e3), t_end=3.0),
    *family("phi = 0, v_f = {:g} m/s", "friction", "v_f", (1e-5, 1e-3, 1e3), t_end=4.0, **ALIGNED),
    Case("equal coefficients", {"friction": {"mu_inf": 0.20}}, t_end=3.0),
    Case("constant friction", {"friction": CONSTANT}, t_end=3.0),
    Case("strengthening", {"friction": {"mu_inf": 0.30}}, t_end=4.0),
    Case("friction that vanishes at speed", {"friction": {"mu_inf": 0.0}}, t_end=2.5),
    # Harmonic motion that touches w = 0 once a period without ever resting there.
    Case("grazing: constant friction, phi = 0", {**ALIGNED, "friction": CONSTANT}, t_end=10.0),
    Case("grazing: constant friction, phi = 90", {"system": {"misalignment_deg": 90.0}, "friction": CONSTANT}, t_end=0.1),
    Case(
        "grazing: constant friction, k_y = k_x",
        {"system": {"stiffness_y": 1e3, "misalignment_deg": 30.0}, "friction": CONSTANT},
        t_end=10.0,
    ),
    Case("no friction", {"friction": {**CONSTANT, "mu_0": 0.0}}, t_end=0.5),
    Case("no friction, weakening", {"friction": {"mu_0": 0.0, "mu_inf": 0.0}}, t_end=0.5),
    Case("no friction at rest", {"friction": {"mu_0": 0.0, "mu_inf": 0.1}}, t_end=0.5),
    Case("no friction, phi = 0", {**ALIGNED, "friction": {**CONSTANT, "mu_0": 0.0}}, t_end=0.5),
    Case("no friction, from rest", {"friction": {**CONSTANT, "mu_0": 0.0}, "initial": {"velocity_ratio": 0.0}}, t_end=0.5),
    Case(
        "no friction, phi = 0, from rest",
        {**ALIGNED, "friction": {**CONSTANT, "mu_0": 0.0}, "initial": {"velocity_ratio": 0.0}},
        t_end=3.0,
    ),
    Case("no load", {"friction": {"normal_load": 0.0}}, t_end=0.5),
    Case("no drive", {"drive": {"velocity": 0.0}}, t_end=1.0),
    Case(
        "no drive, no friction, let go",
        {
            "drive": {"velocity": 0.0},
            "friction": {**CONSTANT, "mu_0": 0.0},
            "initial": {"elongation_x": 1e-3, "elongation_y": 1e-6},
        },
        t_end=0.2,
    ),
    Case("no drive, let go", {"drive": {"velocity": 0.0}, "initial": {"elongation_x": 5e-3}}, t_end=1.0),
    Case("no drive, let go along y", {"drive": {"velocity": 0.0}, "initial": {"elongation_y": 2e-5}}, t_end=1.0),
    Case(
        "no drive, let go askew", {"drive": {"velocity": 0.0}, "initial": {"elongation_x": 4e-2, "elongation_y": 2e-5}}, t_end=3.0
    ),
    *family("velocity_ratio = {:g}", "initial", "velocity_ratio", (0.0, 1.0, -1.0, 1e3, -1e3), t_end=0.5),
    Case("velocity_ratio = 1, phi = 0", {**ALIGNED, "initial": {"velocity_ratio": 1.0}}, t_end=4.0),
    *(
        Case(f"elongation ({x:g}, {y:g}) m", {"initial": {"elongation_x": x, "elongation_y": y, "velocity_ratio": 0.0}}, t_end=0.5)
        for x, y in (
            (3e-3, 0.0),
            (-3e-3, 0.0),
            (0.0, 3e-7),
            (0.0, -3e-7),
            (1e-3, 1e-6),
            (-1e-3, -1e-6),
            (2e-3, 0.0),
            (-2e-3, 0.0),
            (0.0, 2e-7),
            (0.0, -2e-7),
            (1e-3, -1.7e-7),
            (-1.0, 0.0),
            (1.0, 1e-3),
        )
    ),
    *(
        Case(f"elongation {x:g} m, phi = 0", {**ALIGNED, "initial": {"elongation_x": x, "velocity_ratio": 0.0}}, t_end=3.0)
        for x in (2e-3, 2.1e-3, -2e-3, -2.1e-3, 4e-3, -4e-3, 6e-3, -1e-2)
    ),
    Case("load below the limit, thrown back", {"initial": {"elongation_x": 1.9e-3, "velocity_ratio": -10.0}}, t_end=0.5),
    Case("jump down and up", {"drive": profile((0, V), (1, V), (1, 0.1 * V), (1.5, 0.1 * V), (1.5, 3 * V))}, t_end=3.0),
    Case("hold from a jump", {"drive": profile((0, V), (1, V), (1, 0), (2, 0), (2, V))}, t_end=3.0),
    Case("hold from a ramp", {"drive": profile((0, V), (1, V), (1.5, 0), (2, 0), (2.5, V))}, t_end=3.0),
    Case("reversal at once", {"drive": profile((0, V), (1, V), (1, -V))}, t_end=4.0),
    Case("reversal by a ramp", {"drive": profile((0, V), (1, V), (2, -V))}, t_end=4.0),
    Case("reversal in the first stick", {"drive": profile((0, V), (0.01, V), (0.01, -V))}, t_end=0.5),
    Case("ramp from rest", {"drive": profile((0, 0), (1, V)), "initial": {"velocity_ratio": 0.0}}, t_end=2.5),
    Case("ramp without end of the hold", {"drive": profile((0, V), (0.5, 0))}, t_end=5.0),
    Case("hold first", {"drive": profile((0, 0), (1, 0), (1, V))}, t_end=2.0),
    Case("many short ramps", {"drive": profile(*((0.01 * i, V * (i % 3 - 0.5)) for i in range(50)))}, t_end=1.0),
    Case("kicks", {"drive": profile((0, V), (1, V), (1, 1.0), (1.00001, 1.0), (1.00001, V))}, t_end=2.0),
    Case("reversal, phi = 0", {**ALIGNED, "drive": profile((0, V), (2.5, V), (3, -V))}, t_end=8.0),
    Case("hold while it slips", {"drive": profile((0, V), (2.05, V), (2.05, 0), (3, 0), (3, V))}, t_end=4.0),
    Case("reversal while it slips", {"drive": profile((0, V), (2.05, V), (2.05, -V))}, t_end=4.0),
    *family("m = {:g} kg, cycles", "system", "mass", (1e-12, 1e-9, 1e-6, 1e-4), t_end=4.0),
    # Nearly without mass, friction that grows with speed makes u creep with the time constant F'(v)/k.
    *(
        Case(
            f"creep against viscosity, {name}",
            {
                "system": {"mass": 1e-12, **system},
                "friction": {"mu_inf": 0.24, "v_f": 1e-3},
                "initial": {"elongation_x": 3e-3, "velocity_ratio": 0.0},
            },
            t_end=4.0,
        )
        for name, system in (("phi = 0", {"misalignment_deg": 0.0}), ("phi = 1", {}), ("k_y = k_x", {"stiffness_y": 1e3}))
    ),
    *(
        Case(
            f"reversal at once against viscosity, v_f = {v_f:g} m/s, m = {mass:g} kg",
            {
                "system": {"mass": mass, "misalignment_deg": 0.0},
                "friction": {"mu_inf": 0.24, "v_f": v_f},
                "drive": profile((0, V), (3, V), (3, -V)),
            },
            t_end=6.0,
        )
        for v_f, mass in ((1e-3, 1e-12), (1.0, 1e-12), (400.0, 1e-12), (1e-3, 1e-6))
    ),
    # Straight back: the spring, far beyond the limit, turns the object at w = 0 without any rest.
    *(
        Case(
            f"turned back beyond the limit, phi = {phi:g}, {name}",
            {"system": {"misalignment_deg": phi}, "initial": initial},
            t_end=0.05,
        )
        for phi, name, initial in (
            (0.0, "thrown back", {"elongation_x": 5e-3, "velocity_ratio": -400.0}),
            (180.0, "thrown back", {"elongation_x": -5e-3, "velocity_ratio": -400.0}),
            (1e-9, "thrown back", {"elongation_x": 5e-3, "velocity_ratio": -400.0}),
            (90.0, "thrown back", {"elongation_y": 1e-5, "velocity_ratio": -100.0}),
            (-90.0, "thrown back", {"elongation_y": -1e-5, "velocity_ratio": -100.0}),
            (90.0, "thrown", {"velocity_ratio": -1e3}),
            (-90.0, "thrown", {"velocity_ratio": 1e3}),
        )
    ),
    # A release at which the load grows by little more than its own roundoff in one fast period.
    *(
        Case(
            f"slow release, V = {v:g} m/s, m = {mass:g} kg",
            {
                "system": {"mass": mass, "misalignment_deg": 180.0},
                "drive": {"velocity": v},
                "initial": {"elongation_x": 1e-3, "velocity_ratio": 0.0},
            },
            t_end=4.5e-3 / v,
        )
        for v, mass in ((1e-5, 1e-6), (1e-7, 1e-6), (1e-9, 1e-3), (1e-7, 1e-12))
    ),
    *(
        Case(f"smoothed, v_s = {v_s:g} m/s, {name}", {**changes, "friction": {"contact": "smoothed", "v_smooth": v_s}}, t_end=t_end)
        for name, changes, t_end in (
            ("Fig. 3", {}, 0.5),
            ("phi = 0", {"system": {"misalignment_deg": 0.0}}, 3.0),
            ("phi = -90", {"system": {"misalignment_deg": -90.0}}, 0.05),
            ("m = 1e-9 kg", {"system": {"mass": 1e-9}}, 3.0),
            ("m = 100 kg", {"system": {"mass": 100.0}}, 3.0),
            ("k_y = k_x", {"system": {"stiffness_y": 1e3}}, 3.0),
            ("reversal", {"drive": profile((0, V), (0.1, V), (0.1, -V), (0.2, 0))}, 0.3),
            ("V = 1 m/s", {"drive": {"velocity": 1.0}}, 0.05),
            ("no drive, let go", {"drive": {"velocity": 0.0}, "initial": {"elongation_x": 5e-3}}, 1.0),
        )
        for v_s in (1e-9, 1e-6, 1e-3)
    ),
    *(
        Case(
            f"smoothed, creep against viscosity, m = {mass:g} kg",
            {
                "system": {"mass": mass, "misalignment_deg": 0.0},
                "friction": {"mu_inf": 0.24, "v_f": 1e-3, "contact": "smoothed", "v_smooth": 1e-5},
                "initial": {"elongation_x": 3e-3},
            },
            t_end=4.0,
        )
        for mass in (1e-12, 1e-6)
    ),
]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_extreme(program: Program, case: Case, method: str) -> None:
    groups = case.groups(method)
    assert_sound(run(program, groups), groups)


def state(result: Run) -> tuple[np.ndarray, np.ndarray]:
    """Elongation and slip velocity, (2, time)."""
    series = result.series
    return np.array([series["u_x"], series["u_y"]]), np.array([series["w_x"], series["w_y"]])


@pytest.mark.parametrize(
    ("drive", "t_end"),
    [
        (profile((0, V), (1, V), (1, 0), (2, 0), (2, V), (2.5, V), (2.7, 0), (3, 0), (3, V)), 3.5),
        (profile((0, V), (1.5, V), (2, -V), (3.5, -V), (4, V)), 5.0),
    ],
    ids=["slide, hold, slide", "reversal"],
)
def test_orders_agree_on_profiles(program: Program, drive: dict[str, list[float]], t_end: float) -> None:
    changes = {"scene": {"t_end": t_end}, "drive": drive, "output": {"interval": 0.05}}
    nine, thirteen = (
        run(program, changed(FIG3, changes, {"integrator": {"method": method, "rtol": 1e-9}})) for method in ("radau9", "radau13")
    )
    (u, w), (other_u, other_w) = state(nine), state(thirteen)
    assert np.linalg.norm(u - other_u, axis=0).max() <= 1e-9 * np.linalg.norm(u, axis=0).max()
    assert np.linalg.norm(w - other_w, axis=0).max() <= 1e-6 * np.linalg.norm(w, axis=0).max()
    np.testing.assert_array_equal(nine.events["kind"], thirteen.events["kind"])
    np.testing.assert_allclose(nine.events["time"], thirteen.events["time"], rtol=0, atol=1e-7)
