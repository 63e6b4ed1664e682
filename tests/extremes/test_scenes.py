"""The full model where a scene has a property of its own: every run ends, and is sound (invariants.py). Ends of the parameters:
test_matrix.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import dynstiction as ds
import pytest
from fig3 import CONSTANT, GROUPS, Groups, changed
from invariants import faults_of
from matrix import RTOL, Scales
from programs import Program

pytestmark = pytest.mark.deck

METHODS = ("radau5", "radau9", "radau13")
FIG3 = changed(GROUPS, {"integrator": {"rtol": RTOL}, "output": {"interval": 0.0}})


@dataclass
class Case:
    """A scene; without an end of its own it lasts for 300 fast periods after the first release."""

    name: str
    changes: Groups = field(default_factory=dict)
    t_end: float | None = None

    def groups(self, method: str) -> Groups:
        groups = changed(FIG3, self.changes, {"integrator": {"method": method}})
        if self.t_end is not None:
            return changed(groups, {"scene": {"t_end": self.t_end}})
        scales = Scales.of(groups)
        return changed(groups, {"scene": {"t_end": scales.release + 300 * scales.fast_period}})


def run(program: Program, groups: Groups) -> ds.Result:
    (program.folder / "case.nml").write_text(ds.Scene(**groups).text)
    program("run", "case.nml", "-o", "case.h5", "--quiet", "--overwrite", status=0)
    return ds.open(program.folder / "case.h5")


def profile(*knots: tuple[float, float]) -> dict[str, list[float]]:
    return {"time": [t for t, _ in knots], "velocity": [v for _, v in knots]}


def begin(x: float, y: float, ratio: float | None = None) -> Groups:
    """A start with stretched springs; X'(0)/V is that of Fig. 3 unless given."""
    return {"initial": {"elongation_x": x, "elongation_y": y, **({} if ratio is None else {"velocity_ratio": ratio})}}


def driven(name: str, t_end: float, *knots: tuple[float, float], **changes: dict[str, object]) -> Case:
    return Case(name, {"drive": profile(*knots), **changes}, t_end)


def smoothed(v_s: float) -> dict[str, object]:
    return {"contact": "smoothed", "v_smooth": v_s}


V = 1e-3
ALIGNED, STILL = {"system": {"misalignment_deg": 0.0}}, {"drive": {"velocity": 0.0}}
ROUND, FREE, VISCOUS = {"stiffness_y": 1e3}, {**CONSTANT, "mu_0": 0.0}, {"mu_inf": 0.24, "v_f": 1e-3}


def family(
    name: str, group: str, key: str, values: tuple[float, ...], t_end: float | None = None, **more: dict[str, object]
) -> list[Case]:
    """One key with several values; the name has a place for each."""
    return [Case(name.format(value), {**more, group: {**more.get(group, {}), key: value}}, t_end) for value in values]


CASES = [
    *family("phi = {} deg", "system", "misalignment_deg", (8.655, 30.0, 76.3, 89.999)),
    *family("k_y = {:g} N/m, constant friction", "system", "stiffness_y", (1e2, 1e3, 1e12), friction=CONSTANT),
    *family("m = {:g} kg, phi = 0", "system", "mass", (1e-12, 100.0), t_end=4.0, **ALIGNED),
    *family("V = {:g} m/s, cycles", "drive", "velocity", (0.02, 1.0), t_end=0.5),
    *family("phi = 0, v_f = {:g} m/s", "friction", "v_f", (1e-5, 1e3), t_end=4.0, **ALIGNED),
    Case("equal coefficients", {"friction": {"mu_inf": 0.20}}, 3.0),
    Case("constant friction", {"friction": CONSTANT}, 3.0),
    Case("strengthening", {"friction": {"mu_inf": 0.30}}, 4.0),
    Case("friction that vanishes at speed", {"friction": {"mu_inf": 0.0}}, 2.5),
    # Harmonic motion that touches w = 0 once a period without ever resting there.
    Case("grazing: constant friction, phi = 0", {**ALIGNED, "friction": CONSTANT}, 10.0),
    Case("grazing: constant friction, phi = 90", {"system": {"misalignment_deg": 90.0}, "friction": CONSTANT}, 0.1),
    Case("grazing: constant friction, k_y = k_x", {"system": {**ROUND, "misalignment_deg": 30.0}, "friction": CONSTANT}, 10.0),
    Case("no friction", {"friction": FREE}, 0.5),
    Case("no friction, weakening", {"friction": {"mu_0": 0.0, "mu_inf": 0.0}}, 0.5),
    Case("no friction at rest", {"friction": {"mu_0": 0.0, "mu_inf": 0.1}}, 0.5),
    Case("no friction, phi = 0", {**ALIGNED, "friction": FREE}, 0.5),
    Case("no friction, from rest", {"friction": FREE, **begin(0.0, 0.0, 0.0)}, 0.5),
    Case("no friction, phi = 0, from rest", {**ALIGNED, "friction": FREE, **begin(0.0, 0.0, 0.0)}, 3.0),
    Case("no load", {"friction": {"normal_load": 0.0}}, 0.5),
    Case("no drive", STILL, 1.0),
    Case("no drive, no friction, let go", {**STILL, "friction": FREE, **begin(1e-3, 1e-6)}, 0.2),
    *(
        Case(f"no drive, let go from {x:g}, {y:g} m", {**STILL, **begin(x, y)}, t_end)
        for x, y, t_end in ((5e-3, 0.0, 1.0), (0.0, 2e-5, 1.0), (4e-2, 2e-5, 3.0))
    ),
    *family("velocity_ratio = {:g}", "initial", "velocity_ratio", (0.0, 1.0, -1.0, 1e3, -1e3), t_end=0.5),
    Case("velocity_ratio = 1, phi = 0", {**ALIGNED, **begin(0.0, 0.0, 1.0)}, 4.0),
    *(
        Case(f"elongation {x:g} m, {name}", {**system, **begin(x, 0.0, 0.0)}, t_end)
        for name, system, t_end, elongations in (
            ("phi = 1", {}, 0.5, (3e-3, -3e-3, 2e-3, -2e-3, -1.0)),
            ("phi = 0", ALIGNED, 3.0, (2e-3, 2.1e-3, -2e-3, -2.1e-3, 4e-3, -4e-3, 6e-3, -1e-2)),
        )
        for x in elongations
    ),
    *(
        Case(f"elongation {x:g}, {y:g} m", begin(x, y, 0.0), 0.5)
        for x, y in (
            (0.0, 3e-7),
            (0.0, -3e-7),
            (0.0, 2e-7),
            (0.0, -2e-7),
            (1e-3, 1e-6),
            (-1e-3, -1e-6),
            (1e-3, -1.7e-7),
            (1.0, 1e-3),
        )
    ),
    Case("load below the limit, thrown back", begin(1.9e-3, 0.0, -10.0), 0.5),
    driven("jump down and up", 3.0, (0, V), (1, V), (1, 0.1 * V), (1.5, 0.1 * V), (1.5, 3 * V)),
    driven("hold from a jump", 3.0, (0, V), (1, V), (1, 0), (2, 0), (2, V)),
    driven("hold from a ramp", 3.0, (0, V), (1, V), (1.5, 0), (2, 0), (2.5, V)),
    driven("reversal at once", 4.0, (0, V), (1, V), (1, -V)),
    driven("reversal by a ramp", 4.0, (0, V), (1, V), (2, -V)),
    driven("reversal in the first stick", 0.5, (0, V), (0.01, V), (0.01, -V)),
    driven("ramp from rest", 2.5, (0, 0), (1, V), **begin(0.0, 0.0, 0.0)),
    driven("ramp without end of the hold", 5.0, (0, V), (0.5, 0)),
    driven("hold first", 2.0, (0, 0), (1, 0), (1, V)),
    driven("many short ramps", 1.0, *((0.01 * i, V * (i % 3 - 0.5)) for i in range(50))),
    driven("kicks", 2.0, (0, V), (1, V), (1, 1.0), (1.00001, 1.0), (1.00001, V)),
    driven("reversal, phi = 0", 8.0, (0, V), (2.5, V), (3, -V), **ALIGNED),
    driven("hold while it slips", 4.0, (0, V), (2.05, V), (2.05, 0), (3, 0), (3, V)),
    driven("reversal while it slips", 4.0, (0, V), (2.05, V), (2.05, -V)),
    # Nearly without mass, friction that grows with speed makes u creep with the time constant F'(v)/k.
    *(
        Case(
            f"creep against viscosity, {name}",
            {"system": {"mass": 1e-12, **system}, "friction": {**VISCOUS, **contact}, **begin(3e-3, 0.0, ratio)},
            4.0,
        )
        for name, system, contact, ratio in (
            ("phi = 0", ALIGNED["system"], {}, 0.0),
            ("phi = 1", {}, {}, 0.0),
            ("k_y = k_x", ROUND, {}, 0.0),
            ("smoothed", ALIGNED["system"], smoothed(1e-5), None),
            ("smoothed, m = 1e-6 kg", {**ALIGNED["system"], "mass": 1e-6}, smoothed(1e-5), None),
        )
    ),
    *(
        driven(
            f"reversal at once against viscosity, v_f = {v_f:g} m/s, m = {mass:g} kg",
            6.0,
            (0, V),
            (3, V),
            (3, -V),
            system={"mass": mass, "misalignment_deg": 0.0},
            friction={"mu_inf": 0.24, "v_f": v_f},
        )
        for v_f, mass in ((1e-3, 1e-12), (1.0, 1e-12), (400.0, 1e-12), (1e-3, 1e-6))
    ),
    # Straight back: the spring, far beyond the limit, turns the object at w = 0 without any rest.
    *(
        Case(
            f"turned back beyond the limit, phi = {phi:g}, from {x:g}, {y:g} m",
            {"system": {"misalignment_deg": phi}, **begin(x, y, ratio)},
            0.05,
        )
        for phi, x, y, ratio in (
            (0.0, 5e-3, 0.0, -400.0),
            (180.0, -5e-3, 0.0, -400.0),
            (1e-9, 5e-3, 0.0, -400.0),
            (90.0, 0.0, 1e-5, -100.0),
            (-90.0, 0.0, -1e-5, -100.0),
            (90.0, 0.0, 0.0, -1e3),
            (-90.0, 0.0, 0.0, 1e3),
        )
    ),
    # A release at which the load grows by little more than its own roundoff in one fast period.
    *(
        Case(
            f"slow release, V = {v:g} m/s, m = {mass:g} kg",
            {"system": {"mass": mass, "misalignment_deg": 180.0}, "drive": {"velocity": v}, **begin(1e-3, 0.0, 0.0)},
            4.5e-3 / v,
        )
        for v, mass in ((1e-5, 1e-6), (1e-7, 1e-6), (1e-9, 1e-3), (1e-7, 1e-12))
    ),
    *(
        Case(f"smoothed, v_s = {v_s:g} m/s, {name}", {**changes, "friction": smoothed(v_s)}, t_end)
        for name, changes, t_end in (
            ("Fig. 3", {}, 0.5),
            ("phi = 0", ALIGNED, 3.0),
            ("phi = -90", {"system": {"misalignment_deg": -90.0}}, 0.05),
            ("m = 1e-9 kg", {"system": {"mass": 1e-9}}, 3.0),
            ("m = 100 kg", {"system": {"mass": 100.0}}, 3.0),
            ("k_y = k_x", {"system": ROUND}, 3.0),
            ("reversal", {"drive": profile((0, V), (0.1, V), (0.1, -V), (0.2, 0))}, 0.3),
            ("V = 1 m/s", {"drive": {"velocity": 1.0}}, 0.05),
            ("no drive, let go", {**STILL, **begin(5e-3, 0.0)}, 1.0),
        )
        for v_s in (1e-9, 1e-6, 1e-3)
    ),
]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_extreme(program: Program, case: Case, method: str) -> None:
    groups = case.groups(method)
    assert faults_of(run(program, groups), groups) == []
