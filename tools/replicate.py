"""What the paper says, and what holds: each claim with a command, the value expected and the value found (docs/claims.md).

    tools/replicate.sh [--page]

runs all claims and prints them as a table; the exit status is 1 if one is not as expected. With --page the table of docs/claims.md
is written anew. A command is a Python expression of the packages dynstiction (ds) and numpy (np).
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from pathlib import Path
from typing import NamedTuple

import dynstiction as ds
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "claims.md"
BEGIN, END = "<!-- tools/replicate.sh --page -->", "<!-- end -->"
FIG3 = "'inputs/fig3.nml'"


class Claim(NamedTuple):
    """A statement of the paper, and the number that decides it."""

    where: str
    says: str
    """Empty if it is the statement above."""
    verdict: str
    command: str
    """An expression in Python, in the folder of the checkout."""
    expected: float
    tolerance: float
    """Absolute."""

    def value(self) -> float:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return float(eval(self.command, {"ds": ds, "np": np}))

    def row(self, found: float) -> str:
        expected = f"{self.expected:.8g}" + (f" ± {self.tolerance:.1g}" if self.tolerance else "")
        return (
            f"| {self.where} | {self.says} | {self.verdict} | `{self.command}` | {expected} | {found:.8g} |"
        )


CLAIMS = (
    Claim("Eqs. 1–5, Fig. 3", "stick-slip with a period of 0.915 s, without static friction", "holds",
          f"ds.run({FIG3}, t_end=10.0).summary['period']", 0.91506460, 1e-7),
    Claim("Fig. 3 (a)", "the load rises to F_0 = 2 N, nearly", "holds: 1.9926 N",
          f"ds.run({FIG3}, t_end=10.0).summary['first_peak_force']", 1.9926, 5e-5),
    Claim("Fig. 3 (a)", "and falls to 1.17 N in a slip", "holds",
          f"ds.run({FIG3}, t_end=10.0).summary['valley_force']", 1.1686, 5e-5),
    Claim("Fig. 3 (b)", "the size of F is practically constant during creep", "holds: within 0.7 % (smallest value over F_0)",
          f"ds.run({FIG3}, times=np.arange(0.02, 1.9, 1e-4))['friction'].min()/2", 0.9936, 2e-4),
    Claim("Fig. 3 (c)", "ψ jumps to almost 90°", "holds at the start: 88.67°; after a slip θ begins near 54°",
          f"np.degrees(ds.run({FIG3}, t_end=1e-5, interval=1e-6)['psi'][1])", 88.672, 1e-3),
    Claim("Fig. 3 (e)", "the object never moves back", "holds (smallest velocity along the drive)",
          f"ds.run({FIG3}, t_end=10.0, interval=1e-4)['X_rate'].min()", 0.0, 1e-15),
    Claim("title, Sec. III", "“the object never comes to a full stop”",
          "**contradicted**: its Eqs. (1)–(5) have a limit in which it rests once in each fast oscillation (number of rests in 10 s)",
          f"ds.run({FIG3}, t_end=10.0).sticks()", 5398, 0),
    Claim("the same", "", "with a smoothed contact it never rests, like the paper's own numerics (smallest slip velocity is above 0)",
          f"ds.run({FIG3}, contact='smoothed', v_smooth=1e-8, t_end=4.0, interval=1e-4)['X_rate'].min() > 0", 1, 0),
    Claim("the same", "", "but the period approaches that of the exact contact: the difference at v_smooth = 1e-6 m/s",
          f"ds.run({FIG3}, contact='smoothed', v_smooth=1e-6, t_end=10.0).summary['period'] - 0.91506460", -4.13e-5, 5e-7),
    Claim("the same", "", "and at 1e-8 m/s",
          f"ds.run({FIG3}, contact='smoothed', v_smooth=1e-8, t_end=10.0).summary['period'] - 0.91506460", -8.9e-7, 1e-8),
    Claim("title", "dynamic stiction needs no static friction",
          "holds: the slow motion, which never rests, has it too (period, 0.19 % longer)",
          "ds.run('inputs/low_frequency.nml', t_end=10.0).summary['period']/0.91506460 - 1", 0.0019, 5e-5),
    Claim("Sec. III", "almost perfect stick, blurred at larger angles", "holds: the object creeps 90 % of the time at 1°",
          f"ds.run({FIG3}, t_end=10.0).summary['creep_share']", 0.903, 5e-4),
    Claim("the same", "", "22 % at 5°", f"ds.run({FIG3}, misalignment_deg=5.0, t_end=10.0).summary['creep_share']", 0.2165, 5e-4),
    Claim("the same", "", "not at all at 10°, where stick-slip has ended (swing of the load)",
          f"ds.run({FIG3}, misalignment_deg=10.0, t_end=10.0).summary['swing']", 0.0, 1e-9),
    Claim("Fig. 4", "an oscillation of 1 kHz whose frequency falls during creep", "holds: √(k_y/m)/2π at the start",
          "ds.oscillation_frequency(np.pi/2, mass=0.25, stiffness_x=1e3, stiffness_y=1e7)", 1006.58, 1e-2),
    Claim("Eqs. 6, 7", "slow creep of a rotating friction vector", "holds; it has a closed form (X/l_x at τ = 0.9)",
          "ds.creep_exact(0.9, np.radians(1.0)).X", 0.009941358658365, 1e-15),
    Claim("Eq. 8", "X′/V ≈ φ (φ + τ²/√(1 − τ²))",
          "**misprint**: the numerator is τ, and so the error has order φ² (error as printed at 0.1°, over φ²)",
          "(ds.creep_asymptotic(0.5, np.radians(0.1), 'printed') - ds.creep_exact(0.5, np.radians(0.1)).X_rate)/np.radians(0.1)**2",
          -165.19, 0.05),
    Claim("the same", "", "with the first power (the same)",
          "(ds.creep_asymptotic(0.5, np.radians(0.1)) - ds.creep_exact(0.5, np.radians(0.1)).X_rate)/np.radians(0.1)**2", 0.2063, 2e-3),
    Claim("Eq. 9", "across, the spring carries the friction: mean of k_y u_y is F_0", "holds: 0.998 F_0",
          f"ds.run({FIG3}, times=np.linspace(0.01, 0.05, 20001))['spring_force_y'].mean()/2", 0.998, 2e-3),
    Claim("Eq. 10", "ζ = Λ sin³ θ with Λ = 3.6e3", "holds",
          "ds.damping_ratio(np.pi/2, 'inputs/fig3_constant.nml')", 3623.9, 0.05),
    Claim("Eq. 10", "ζ = 1.9e-2 at θ = φ = 1°: weakly damped", "holds",
          "ds.damping_ratio(np.radians(1.0), 'inputs/fig3_constant.nml')", 0.0193, 5e-5),
    Claim("Eq. 10", "at φ = 10° the motion stays overdamped", "holds",
          "ds.damping_ratio(np.radians(10.0), ds.Scene('inputs/fig3_constant.nml', misalignment_deg=10.0))", 1.907, 5e-4),
    Claim("Fig. 5", "a misalignment suppresses stick-slip", "holds: steady sliding is stable from 8.656° on",
          f"ds.critical_misalignment({FIG3}).angle[0]", 8.65603, 1e-5),
    Claim("beyond", "is the stick-slip regular?", "at 1° yes: one slow cycle, which repeats with the multiplier e^−9.17",
          f"ds.run({FIG3}, t_end=60.0).summary['lyapunov_exponent']", -9.169, 5e-3),
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--page", action="store_true", help="write the table into docs/claims.md")
    options = parser.parse_args()
    os.chdir(ROOT)
    rows = ["| where | the paper says | verdict | command | expected | found |", "|" + " --- |" * 6]
    wrong = 0
    print(*rows, sep="\n", flush=True)
    for claim in CLAIMS:
        found = claim.value()
        wrong += not abs(found - claim.expected) <= claim.tolerance
        rows.append(claim.row(found))
        print(rows[-1], flush=True)
    if options.page:
        text = PAGE.read_text(encoding="utf-8")
        before, after = text.partition(BEGIN)[0], text.partition(END)[2]
        PAGE.write_text("\n".join([before + BEGIN, "", *rows, "", END]) + after, encoding="utf-8")
    print(f"{len(CLAIMS) - wrong} as expected, {wrong} not")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
