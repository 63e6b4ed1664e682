"""Follow the cycles of `low_frequency` with AUTO-07p, and compare folds and cycles with the values of this project.

    python bench/peers/continuation.py [--short]

AUTO-07p (Doedel and others, https://github.com/auto-07p/auto-07p; Debian: auto-07p) computes a cycle as a boundary value problem by
orthogonal collocation and follows it in a parameter: no step of its method is shared with a run or with a map of the half-line. It
is called as a program, with gcc and gfortran; its folder is AUTO_DIR, /usr/lib/auto-07p by default.
--short: one velocity, in seconds. Fails if a value differs by more than its limit.
"""

import argparse
import functools
import math
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import dynstiction as ds
import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from limit_cycles import end_of_stick_slip  # noqa: E402

AUTO = Path(os.environ.get("AUTO_DIR", "/usr/lib/auto-07p"))

# Fig. 3: m [kg], k_x [N/m], F_0 [N], mu_inf/mu_0, v_f [mm/s].
MASS, STIFFNESS, LIMIT, MU_RATIO, V_F = 0.25, 1e3, 2.0, 0.75, 10.0
OMEGA = math.sqrt(STIFFNESS / MASS)
IMPEDANCE = 1e-3 * math.sqrt(MASS * STIFFNESS) / LIMIT

VELOCITIES = (0.03, 0.1, 0.3, 1.0, 10.0, 30.0, 38.0, 40.0, 50.0, 75.0, 100.0)
"""Drive velocities [mm/s] at which the ends are compared."""

PHI, DRIVE, SWING, PERIOD = 1, 2, 3, 11
HOPF, FOLD, USER = 3, 5, -4
"""AUTO's types of points: a Hopf bifurcation, a fold of cycles, a requested value."""

CLOSE = 1e-7
"""Largest permitted relative difference from a reference value. It was at most 1e-9."""


def reference_values() -> dict[str, list[dict[str, float]]]:
    """Reference values for AUTO's, from `dynstiction.cycles` and `dynstiction.branch`.

    `ends` and `drive_ends` have V [mm/s] and phi [deg]; `cycles` V, phi, valley and peak of k_x u_x/F_0, period [s], multiplier.
    """
    # A stiff axis on which the slow motion holds at every velocity.
    fig3 = ds.Scene(Path(__file__).resolve().parents[2] / "inputs" / "fig3.nml").replace(
        system={"stiffness_y": 1e10}
    )

    def scene(velocity: float, angle: float) -> ds.Scene:
        return fig3.replace(drive={"velocity": 1e-3 * velocity}, system={"misalignment_deg": angle})

    ends = []
    for velocity in VELOCITIES:
        angle, _ = end_of_stick_slip(scene(velocity, 1.0), 0.5, 25.0)
        ends.append({"V": velocity, "phi": angle})
    (high,) = ds.branch(scene(75.0, 3.5), "drive.velocity", 0.05, 0.15, model="low_frequency").special("fold")
    cycles = [
        {
            "V": velocity,
            "phi": angle,
            "valley": cycle.valley_force / LIMIT,
            "peak": cycle.peak_force / LIMIT,
            "period": cycle.period,
            "multiplier": cycle.multiplier,
        }
        for velocity, angle in ((75.0, 3.5), (1.0, 1.0))
        for cycle in reversed(ds.cycles(scene(velocity, angle), model="low_frequency").cycles)
    ]
    return {"ends": ends, "drive_ends": [{"V": 1e3 * high.value, "phi": 3.5}], "cycles": cycles}


@dataclass
class Solution:
    """A labelled solution of AUTO: its polynomials on mesh intervals, and its parameters."""

    label: int
    kind: int
    time: NDArray[np.float64]
    states: NDArray[np.float64]
    degree: int
    parameters: NDArray[np.float64]

    def parameter(self, number: int) -> float:
        return float(self.parameters[number - 1])

    @functools.cached_property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest k_x u_x/F_0 of the polynomials."""
        values = []
        for begin in range(0, self.time.size - 1, self.degree):
            piece = slice(begin, begin + self.degree + 1)
            place = np.linspace(-1.0, 1.0, self.degree + 1)
            fit = polynomial.polyfit(place, self.states[piece, 0], self.degree)
            slope = polynomial.polyroots(polynomial.polyder(fit))
            inside = slope[(np.abs(slope.imag) < 1e-6) & (np.abs(slope.real) <= 1.0)].real
            values.extend(polynomial.polyval(np.concatenate([inside, [-1.0, 1.0]]), fit))
        return float(min(values)), float(max(values))

    @property
    def swing(self) -> float:
        return self.extremes[1] - self.extremes[0]

    @property
    def period(self) -> float:
        return self.parameter(PERIOD) / OMEGA

    @property
    def multiplier(self) -> float:
        """exp(-integral of Phi'/m over the cycle), by Gauss quadrature of the polynomials."""
        nodes, weights = np.polynomial.legendre.leggauss(12)
        drive = self.parameter(DRIVE)
        across = math.sin(math.radians(self.parameter(PHI)))
        total = 0.0
        for begin in range(0, self.time.size - 1, self.degree):
            piece = slice(begin, begin + self.degree + 1)
            fit = polynomial.polyfit(
                np.linspace(-1.0, 1.0, self.degree + 1), self.states[piece, 1], self.degree
            )
            w = polynomial.polyval(nodes, fit)
            v = np.hypot(w, across)
            weakening = (1.0 - MU_RATIO) * np.exp(-drive * v / V_F)
            slope = (MU_RATIO + weakening) * across**2 / v**3 - weakening * drive / V_F * (w / v) ** 2
            total += 0.5 * (self.time[begin + self.degree] - self.time[begin]) * float(weights @ slope)
        return math.exp(-total * self.parameter(PERIOD) / (drive * IMPEDANCE))


class Continuation:
    """AUTO's program for these equations, built in a separate folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        source = HERE / "continuation.c"
        headers = [
            f"-I{path}" for path in (AUTO / "include", Path("/usr/include")) if (path / "auto_f2c.h").exists()
        ]
        command(["gcc", "-O2", *headers[:1], "-c", str(source), "-o", "equations.o"], folder)
        objects = [str(path) for path in sorted((AUTO / "lib").glob("*.o"))]
        command(
            [
                "gfortran",
                "-fopenmp",
                "equations.o",
                *objects,
                str(AUTO / "lib" / "libauto_c.a"),
                "-o",
                "continuation",
            ],
            folder,
        )

    def steady_sliding(self, drive: float, first: float, last: float) -> list[Solution]:
        """Settings to go from one angle to another [deg]."""
        start = (first, drive, IMPEDANCE, V_F, MU_RATIO)
        (self.folder / "start.txt").write_text(" ".join(map(repr, start)), encoding="utf-8")
        step = 0.01 * (last - first)
        return self.run(None, IPS=1, ICP=[PHI], DS=step, DSMAX=abs(step), NMX=200, UZSTOP={PHI: last})

    def run(self, start: Solution | None, restart: str = "", **constants: object) -> list[Solution]:
        """Follow `start`, a solution in the file `restart`; return all labelled solutions, in AUTO's order."""
        settings: dict[str, object] = {
            "NDIM": 2, "NTST": 100, "NCOL": 7, "IAD": 3, "ISW": 1, "ILP": 0, "ISP": 2, "IID": 0, "MXBF": 0,
            "ITMX": 12, "ITNW": 9, "NWTN": 4, "EPSL": 1e-9, "EPSU": 1e-9, "EPSS": 1e-7, "NPR": 0,
            "RL0": -1e9, "RL1": 1e9, "A1": 1e9, "DSMIN": 1e-9, "IADS": 1,
        }  # fmt: skip
        settings |= {"IRS": start.label if start else 0} | constants
        (self.folder / "fort.2").write_text(
            "".join(f"{name} = {value!r}\n" for name, value in settings.items()), encoding="utf-8"
        )
        if start:
            shutil.copy(self.folder / restart, self.folder / "fort.3")
        command(["./continuation"], self.folder)
        return solutions(self.folder / "fort.8")

    def keep(self, name: str) -> None:
        shutil.copy(self.folder / "fort.8", self.folder / name)


def command(words: list[str], folder: Path) -> None:
    done = subprocess.run(
        words,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    if done.returncode:
        raise SystemExit(
            f"continuation.py: {' '.join(words[:2])} … failed:\n{done.stdout[-1000:]}{done.stderr[-2000:]}"
        )


def solutions(file: Path) -> list[Solution]:
    lines = file.read_text(encoding="utf-8").splitlines()
    found, row = [], 0
    while row < len(lines):
        head = [int(word) for word in lines[row].split()]
        kind, label, points, width, rows, degree, count = (head[i] for i in (2, 3, 6, 7, 8, 10, 11))
        numbers = np.array(" ".join(lines[row + 1 : row + 1 + rows]).replace("D", "E").split(), dtype=float)
        table = numbers[: points * width].reshape(points, width)
        found.append(Solution(label, kind, table[:, 0], table[:, 1:], degree, numbers[-count:]))
        row += rows + 1
    return found


def first(found: list[Solution], kind: int) -> Solution:
    for solution in found:
        if solution.kind % 10 == kind % 10 and abs(solution.kind) < 10:
            return solution
    raise SystemExit(f"continuation.py: AUTO found no point of type {kind}")


def hopf_angle(drive: float) -> float:
    """Critical angle of steady sliding [deg], at which AUTO should find a Hopf bifurcation."""
    weakening = (1.0 - MU_RATIO) * math.exp(-drive / V_F)
    return math.degrees(math.atan(math.sqrt(drive / V_F * weakening / (MU_RATIO + weakening))))


def cycles_at(auto: Continuation, drive: float, file: str, **constants: object) -> list[Solution]:
    """The family of cycles that begins at the Hopf bifurcation, stored in a file."""
    angle = hopf_angle(drive)
    # No step may end on the Hopf bifurcation itself, which AUTO would then miss.
    sliding = auto.steady_sliding(drive, 1.0237 * angle, 0.98 * angle)
    auto.keep("sliding")
    found = auto.run(
        first(sliding, HOPF), "sliding", **({"IPS": 2, "ICP": [PHI, PERIOD, SWING], "DS": 0.01} | constants)
    )
    auto.keep(file)
    return found


def end_of_swing(auto: Continuation, drive: float) -> tuple[float, list[Solution]]:
    """Where k_x u_x has an amplitude of 5 % of F_0, peak to peak [deg], and the cycles on from there to phi = V [mm/s] in degrees."""
    slow = drive < 5.0
    mesh = (
        {"NTST": 400, "NCOL": 5, "IAD": 1, "DSMAX": 5.0, "NMX": 4000}
        if slow
        else {"NTST": 200, "DSMAX": 0.05, "NMX": 300}
    )
    stop = {PHI: drive} if slow else {SWING: 0.065}
    family = cycles_at(
        auto, drive, "cycles", **mesh, UZR={SWING: [0.04, 0.045, 0.05, 0.055, 0.06]}, UZSTOP=stop
    )
    # AUTO has the amplitude at mesh points only: interpolate between the amplitudes of the polynomials.
    near = [solution for solution in family if 0.035 < solution.swing < 0.0625]
    swings = np.array([solution.swing for solution in near]) - 0.05
    fit = polynomial.polyfit(swings / 0.01, [solution.parameter(PHI) for solution in near], len(near) - 1)
    return float(fit[0]), family


def folds(auto: Continuation, start: Solution) -> list[Solution]:
    """The locus of folds in phi and V, from one fold in both directions."""
    two = {"IPS": 2, "ISW": 2, "ICP": [PHI, DRIVE, PERIOD], "DSMAX": 1.0, "NMX": 600}
    prepared = auto.run(start, "fast", **two, DS=0.02)
    auto.keep("fold")
    found = list(prepared)
    for step in (0.02, -0.02):
        found += auto.run(
            prepared[-1],
            "fold",
            **two,
            DS=step,
            UZR={DRIVE: [38.0, 40.0, 50.0, 100.0]},
            UZSTOP={DRIVE: [37.5, 105.0]},
        )
    return found


class Comparison:
    """Prints each value and the reference, and keeps the largest difference."""

    def __init__(self) -> None:
        self.largest = 0.0
        print(
            "| V [mm/s] | value | AUTO-07p | this project | relative difference |\n| --- | --- | --- | --- | --- |"
        )

    def add(self, drive: float, what: str, value: float, reference: float) -> None:
        difference = abs(value - reference) / abs(reference)
        self.largest = max(self.largest, difference)
        print(f"| {drive:g} | {what} | {value:.10g} | {reference:.10g} | {difference:.0e} |", flush=True)

    def cycle(self, solution: Solution, reference: dict[str, float]) -> None:
        drive, name = reference["V"], f"φ = {reference['phi']:g}°"
        valley, peak = solution.extremes
        self.add(drive, f"{name}, valley", valley, reference["valley"])
        self.add(drive, f"{name}, peak", peak, reference["peak"])
        self.add(drive, f"{name}, period [s]", solution.period, reference["period"])
        if reference["multiplier"]:
            self.add(drive, f"{name}, multiplier", solution.multiplier, reference["multiplier"])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--short", action="store_true", help="75 mm/s alone")
    options = parser.parse_args()
    missing = [name for name in ("gcc", "gfortran") if shutil.which(name) is None]
    if not (AUTO / "lib" / "libauto_c.a").exists():
        missing.append("AUTO-07p")
    if missing:
        raise SystemExit(
            f"continuation.py: not found: {', '.join(missing)}. Debian: apt install auto-07p gcc gfortran. Elsewhere build "
            "https://github.com/auto-07p/auto-07p and set AUTO_DIR to its folder"
        )
    known = reference_values()
    ends = {end["V"]: end["phi"] for end in known["ends"]}
    comparison = Comparison()
    with tempfile.TemporaryDirectory() as folder:
        auto = Continuation(Path(folder))
        fast(auto, known, ends, comparison, options.short)
        if not options.short:
            for drive in (drive for drive in ends if drive < 35.0):
                angle, family = end_of_swing(auto, drive)
                comparison.add(drive, "amplitude 5 % of F_0 at φ [°]", angle, ends[drive])
                for cycle in known["cycles"]:
                    if cycle["V"] == drive:
                        comparison.cycle(family[-1], cycle)
    print(f"\nLargest relative difference: {comparison.largest:.0e}")
    if comparison.largest > CLOSE:
        raise SystemExit(f"continuation.py: more than {CLOSE:.0e}")


def fast(
    auto: Continuation,
    known: dict[str, list[dict[str, float]]],
    ends: dict[float, float],
    comparison: Comparison,
    short: bool,
) -> None:
    """Both cycles and the fold at 75 mm/s, and the locus of folds from there."""
    family = cycles_at(auto, 75.0, "fast", ILP=1, DSMAX=0.1, NMX=300, UZR={PHI: 3.5}, UZSTOP={PHI: 2.0})
    at_angle = [solution for solution in family if abs(solution.parameter(PHI) - 3.5) < 1e-6]
    for cycle in (cycle for cycle in known["cycles"] if cycle["V"] == 75.0):
        comparison.cycle(
            min(at_angle, key=lambda solution: abs(solution.extremes[0] - cycle["valley"])), cycle
        )
    locus = folds(auto, first(family, FOLD))
    for drive in (drive for drive in ends if drive > 37.0):
        near = min(locus, key=lambda solution: abs(solution.parameter(DRIVE) - drive))
        comparison.add(drive, "fold at φ [°]", near.parameter(PHI), ends[drive])
    if short:
        return
    outer = min(at_angle, key=lambda solution: solution.extremes[0])
    in_drive = auto.run(
        outer,
        "fast",
        IPS=2,
        ILP=1,
        ICP=[DRIVE, PERIOD, SWING],
        DS=0.1,
        DSMAX=1.0,
        NMX=300,
        UZSTOP={DRIVE: [60.0, 95.0]},
    )
    (end,) = known["drive_ends"]
    comparison.add(end["V"], "fold at V [mm/s], φ = 3.5°", first(in_drive, FOLD).parameter(DRIVE), end["V"])


if __name__ == "__main__":
    main()
