"""Evaluate the closed laws of docs/closed_laws.md, compare them with accurate values, and draw docs/figures/closed_laws.png.

    python docs/closed_laws.py [--short]

Prints the tables of the page in Markdown: where stick-slip of `low_frequency` ends by each law, the same for the universal
problem of slow drive, and the cycles at 75 mm/s and 3.5 degrees.
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from dynstiction.plot.style import BLACK, BLUE, DOTS_PER_INCH, GREEN, MM, ORANGE, SKY, STYLE, VERMILION
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

DOCS = Path(__file__).resolve().parent
Values = NDArray[np.float64]

END_OF_SWING = 0.05
"""Amplitude of k_x u_x, peak to peak, over F_0, below which stick-slip has ended if it fades gradually."""

ACCURATE = (
    (0.03, "swing", 1.507040136),
    (0.1, "swing", 2.740068864),
    (0.3, "swing", 4.689152700),
    (1.0, "swing", 8.184227267),
    (1.5, "swing", 9.677737129),
    (2.0, "swing", 10.782545988),
    (2.5, "swing", 11.647536479),
    (3.0, "swing", 12.356845809),
    (4.0, "swing", 13.488093213),
    (5.0, "swing", 14.389143281),
    (6.0, "swing", 15.151501019),
    (7.0, "swing", 15.813266759),
    (8.0, "swing", 16.377203637),
    (9.0, "swing", 16.830765215),
    (10.0, "swing", 17.166510492),
    (12.0, "swing", 17.506272718),
    (15.0, "swing", 17.373513305),
    (20.0, "swing", 16.153752523),
    (30.0, "swing", 12.443330415),
    (36.0, "swing", 10.217714671),
    (38.0, "fold", 9.550895447),
    (40.0, "fold", 8.966840336),
    (50.0, "fold", 6.881555673),
    (75.0, "fold", 4.383256382),
    (100.0, "fold", 3.226635834),
)
"""V [mm/s], how stick-slip ends there, phi [deg]. From the return map of the half-line w = V cos phi, integrated by Radau IIA of
seven stages at a relative tolerance of 1e-13; 1e-11 gives the same digits. bench/continuation.py computes them another way."""

ROWS = (0.03, 0.1, 0.3, 1.0, 10.0, 30.0, 50.0, 75.0, 100.0)
"""Those of the table in docs/maps.md."""

UNIVERSAL = (
    (2.2, 0.901073),
    (2.3, 0.914317),
    (2.5, 0.932482),
    (3.0, 0.957196),
    (3.1623, 0.962144),
    (4.0, 0.977565),
    (5.0, 0.98604),
    (8.0, 0.994701),
)
"""Gamma and tan phi_end/tan phi_c of the universal problem, by bisection of runs."""


@dataclass(frozen=True)
class Rig:
    """Mass, soft stiffness and weakening friction, in SI units: those of Fig. 3."""

    mass: float = 0.25
    stiffness: float = 1e3
    mu_0: float = 0.20
    mu_inf: float = 0.15
    v_f: float = 0.010
    load: float = 10.0

    @property
    def static_limit(self) -> float:
        return self.mu_0 * self.load

    @property
    def impedance(self) -> float:
        """The square root of m k_x, which turns a velocity into a force."""
        return math.sqrt(self.mass * self.stiffness)

    def friction(self, v: Values) -> tuple[Values, Values, Values]:
        """F and its first two derivatives."""
        drop = (self.mu_0 - self.mu_inf) * self.load * np.exp(-v / self.v_f)
        return self.mu_inf * self.load + drop, -drop / self.v_f, drop / self.v_f**2

    def phi(self, w: Values, across: Values) -> tuple[Values, Values, Values]:
        """Phi(w) = F(v) w/v and its first two derivatives; across is V sin phi."""
        v = np.hypot(w, across)
        f, f1, f2 = self.friction(v)
        x, y = w / v, across / v
        return f * x, f1 * x**2 + f * y**2 / v, f2 * x**3 + 3.0 * x * y**2 * (f1 / v - f / v**2)

    def taylor(self, w: float, across: float, count: int) -> Values:
        """Derivatives 0 to count - 1 of Phi at w, by arithmetic of power series."""
        square = np.zeros(count)
        square[:3] = [w**2 + across**2, 2.0 * w, 1.0][:count]
        speed, inverse = power(square, 0.5), power(square, -0.5)
        law = (self.mu_0 - self.mu_inf) * self.load * exponential(-speed / self.v_f)
        law[0] += self.mu_inf * self.load
        velocity = np.zeros(count)
        velocity[:2] = [w, 1.0][:count]
        series = np.convolve(np.convolve(law, inverse)[:count], velocity)[:count]
        return series * [math.factorial(n) for n in range(count)]


def power(series: Values, exponent: float) -> Values:
    result = np.zeros_like(series)
    result[0] = series[0] ** exponent
    for k in range(1, series.size):
        j = np.arange(1, k + 1)
        result[k] = ((exponent * j - (k - j)) * series[j] * result[k - j]).sum() / (k * series[0])
    return result


def exponential(series: Values) -> Values:
    result = np.zeros_like(series)
    result[0] = np.exp(series[0])
    for k in range(1, series.size):
        j = np.arange(1, k + 1)
        result[k] = (j * series[j] * result[k - j]).sum() / k
    return result


def hopf(rig: Rig, drive: float) -> float:
    """Critical angle of steady sliding [rad]."""
    f, f1, _ = rig.friction(np.array(drive))
    return float(np.arctan(np.sqrt(-drive * f1 / f)))


def bautin(rig: Rig) -> tuple[float, float]:
    """Velocity [m/s] and angle [rad] where the Hopf bifurcation becomes subcritical."""

    def third(drive: float) -> float:
        angle = hopf(rig, drive)
        return float(rig.taylor(drive * math.cos(angle), drive * math.sin(angle), 4)[3])

    drive = brentq(third, 2.0 * rig.v_f, 6.0 * rig.v_f, xtol=1e-15)
    return drive, hopf(rig, drive)


def near_bautin(rig: Rig, drive: float) -> float:
    """The fold of cycles for small cycles [rad]."""

    def excess(angle: float) -> float:
        p = rig.taylor(drive * math.cos(angle), drive * math.sin(angle), 6)
        return float(p[1] - 0.75 * p[3] ** 2 / p[5])

    start = hopf(rig, drive)
    return float(brentq(excess, start, 1.2 * start))


def small_cycle(rig: Rig, drive: float, order: int) -> float:
    """Angle of the cycle with the least amplitude, by the expansion to this order (2 or 4) in the amplitude [rad]; nan if none."""
    half = 0.5 * END_OF_SWING * rig.static_limit / rig.impedance

    def excess(angle: float) -> float:
        _, a, b, c, _, e = rig.taylor(drive * math.cos(angle), drive * math.sin(angle), 6)
        fourth = e / 192.0 - 7.0 * b**2 * c / (384.0 * rig.impedance**2) if order == 4 else 0.0
        return float(a + c * half**2 / 8.0 + fourth * half**4)

    return first_zero(excess, np.linspace(1.0, 0.5, 200) * hopf(rig, drive))


def first_zero(function: Callable[[float], float], places: Values) -> float:
    values = [function(place) for place in places]
    for low, high, before, after in zip(places, places[1:], values, values[1:], strict=False):
        if before * after < 0.0:
            return float(brentq(function, low, high, xtol=1e-15))
    return math.nan


def canard(rig: Rig, drive: float, order: int) -> float:
    """Where stick-slip ends under slow drive [rad], by the expansion to this order (1 to 3) in m k_x; nan if it has no solution."""

    def excess(angle: float) -> float:
        across = drive * math.sin(angle)
        top = maximum_of_phi(rig, across, drive)
        terms = canard_terms(rig.taylor(top, across, 8))[:order]
        shift = sum(term * rig.impedance ** (2 * n) for n, term in enumerate(terms, 1))
        return float(top + shift - drive * math.cos(angle))

    return first_zero(excess, np.linspace(1.0, 0.7, 200) * hopf(rig, drive) * (1.0 - 1e-9))


def canard_terms(derivatives: Values) -> tuple[float, float, float]:
    """The coefficients of m k_x, of its square and of its cube, from the derivatives 0 to 7 of Phi at its maximum."""
    _, _, a, b, c, d, e, f = map(float, derivatives)
    return (
        -b / (2.0 * a**3),
        -(3.0 * a**2 * d - 26.0 * a * b * c + 36.0 * b**3) / (24.0 * a**7),
        -(
            3.0 * a**4 * f
            - 51.0 * a**3 * b * e
            - 81.0 * a**3 * c * d
            + 432.0 * a**2 * b**2 * d
            + 556.0 * a**2 * b * c**2
            - 2268.0 * a * b**3 * c
            + 1557.0 * b**5
        )
        / (144.0 * a**11),
    )


def maximum_of_phi(rig: Rig, across: float, drive: float) -> float:
    """The smallest w at which Phi' = 0, not far beyond the drive velocity."""
    w = np.geomspace(across, 3.0 * drive, 400)
    falls = np.flatnonzero(rig.phi(w, np.array(across))[1] < 0.0)
    if not falls.size:
        return math.inf
    return float(
        brentq(lambda x: rig.phi(x, across)[1], w[max(falls[0] - 1, 0)], w[falls[0]], xtol=1e-18, rtol=1e-15)
    )


TURN = 2.0 * np.pi * np.arange(256) / 256
WAVES = np.arange(100)
SINES, COSINES = np.sin(np.outer(TURN, WAVES)), np.cos(np.outer(TURN, WAVES))


def averaged(rig: Rig, drive: float, angle: float, amplitude: float) -> tuple[float, float]:
    """The first cosine coefficient g_1 of Phi/sqrt(m k_x) on w = V c + A cos psi [m/s], and its derivative by A."""
    w = drive * math.cos(angle) + amplitude * np.cos(TURN)
    force, slope, _ = rig.phi(w, np.array(drive * math.sin(angle)))
    return (
        float(2.0 * np.mean(force * np.cos(TURN)) / rig.impedance),
        float(2.0 * np.mean(slope * np.cos(TURN) ** 2) / rig.impedance),
    )


def averaged_third(rig: Rig, drive: float, angle: float, amplitude: float) -> tuple[float, float, float]:
    """The condition for a cycle to third order, half of its amplitude (peak to peak) over sqrt(m k_x) [m/s], its frequency over omega."""
    w = drive * math.cos(angle) + amplitude * np.cos(TURN)
    force, slope, bend = (x / rig.impedance for x in rig.phi(w, np.array(drive * math.sin(angle))))
    higher = 1.0 / np.maximum(WAVES**2 - 1.0, 1.0) * (WAVES > 1)
    g = 2.0 * np.mean(force[:, None] * COSINES, axis=0)
    zeta_1_rate = -SINES @ (WAVES * g * higher)
    s = 2.0 * np.mean((slope * zeta_1_rate)[:, None] * SINES, axis=0)
    shift = s[1] / (2.0 * amplitude)
    zeta_2_rate = COSINES @ (WAVES * s * higher)
    push = slope * (shift * amplitude * np.cos(TURN) + zeta_2_rate) + 0.5 * bend * zeta_1_rate**2
    quarter = TURN.size // 4
    half = amplitude + SINES[quarter] @ (s * higher) + zeta_1_rate[quarter] ** 2 / (2.0 * amplitude)
    return float(g[1] + 2.0 * np.mean(push * np.cos(TURN))), float(half), float(1.0 + shift)


def averaged_angle(rig: Rig, drive: float, amplitude: float) -> float:
    """The angle at which there is a cycle of this amplitude of velocity, by first-order averaging [rad]; nan if none."""
    angles = np.linspace(0.3, 8.0, 120) * hopf(rig, drive)
    values = np.array([averaged(rig, drive, angle, amplitude)[0] for angle in angles])
    rises = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    if not rises.size:
        return math.nan
    return float(
        brentq(
            lambda x: averaged(rig, drive, x, amplitude)[0],
            angles[rises[-1]],
            angles[rises[-1] + 1],
            xtol=1e-15,
        )
    )


def averaged_fold(rig: Rig, drive: float) -> tuple[float, float]:
    """Angle [rad] and amplitude of velocity [m/s] of the fold of cycles, g_1 = dg_1/dA = 0; nan below the Bautin point."""
    if drive <= bautin(rig)[0]:
        return math.nan, math.nan
    amplitudes = np.linspace(0.1, 0.95, 12) * drive
    angles = [averaged_angle(rig, drive, amplitude) for amplitude in amplitudes]
    best = int(np.nanargmax(angles))
    solution = root(
        lambda x: averaged(rig, drive, x[0], x[1] * drive),
        [angles[best], amplitudes[best] / drive],
        tol=1e-13,
    )
    return float(solution.x[0]), float(solution.x[1] * drive)


def averaged_end(rig: Rig, drive: float) -> float:
    """Where stick-slip ends by first-order averaging [rad]."""
    angle, _ = averaged_fold(rig, drive)
    if math.isfinite(angle):
        return angle
    return averaged_angle(rig, drive, 0.5 * END_OF_SWING * rig.static_limit / rig.impedance)


def averaged_third_end(rig: Rig, drive: float) -> float:
    """Where stick-slip ends by third-order averaging [rad]; nan if Newton's method finds nothing near the first-order angle."""
    half_swing = 0.5 * END_OF_SWING * rig.static_limit / rig.impedance
    angle, amplitude = averaged_fold(rig, drive)
    if math.isfinite(angle):
        step = 1e-3 * amplitude

        def fold(x: Values) -> list[float]:
            low, middle, high = (
                averaged_third(rig, drive, x[0], x[1] * amplitude + d)[0] for d in (-step, 0.0, step)
            )
            return [middle / amplitude, (high - low) / (2.0 * step)]

        solution = root(fold, [angle, 1.0], tol=1e-9)
    else:

        def end(x: Values) -> list[float]:
            condition, half, _ = averaged_third(rig, drive, x[0], x[1] * half_swing)
            return [condition / half_swing, half / half_swing - 1.0]

        angle = averaged_angle(rig, drive, half_swing)
        solution = root(end, [angle, 1.0], tol=1e-12)
    near = math.isfinite(angle) and abs(solution.x[0] / angle - 1.0) < 0.2
    return float(solution.x[0]) if near and np.max(np.abs(solution.fun)) < 1e-7 else math.nan


def universal(gamma: float, order: int) -> float:
    """The ratio tan phi_end/tan phi_c for V << v_f."""
    return 1.0 - sum(c / gamma ** (2 * n) for n, c in enumerate((1 / 3, 29 / 81, 1529 / 2187)[:order], 1))


def next_valley(rig: Rig, drive: float, angle: float, valley: float) -> tuple[float, float, float, float]:
    """From a smallest k_x u_x [N] to the next: the next one and the peak in between [N], the time [s], the integral of Phi'/m."""
    across, centre = drive * math.sin(angle), drive * math.cos(angle)

    def motion(_: float, y: Values) -> list[float]:
        force, slope, _ = rig.phi(y[1], np.array(across))
        return [rig.stiffness * (centre - y[1]), (y[0] - float(force)) / rig.mass, float(slope) / rig.mass]

    def turn(_: float, y: Values) -> float:
        return float(y[1] - centre)

    turn.terminal = 2
    start = [valley, centre * (1.0 - 1e-15), 0.0]
    run = solve_ivp(motion, (0.0, 1e3), start, "DOP853", events=turn, rtol=1e-11, atol=1e-14)
    (peak, *_), (last, _, damping) = run.y_events[0]
    return float(last), float(peak), float(run.t_events[0][1]), float(damping)


def cycle_through(
    rig: Rig, drive: float, valley: float, low: float, high: float
) -> tuple[float, float, float]:
    """The cycle with this smallest k_x u_x [N], its angle between two [rad]: angle, peak [N], multiplier."""
    angle = float(brentq(lambda x: next_valley(rig, drive, x, valley)[0] - valley, low, high, xtol=1e-13))
    _, peak, _, damping = next_valley(rig, drive, angle, valley)
    return angle, peak, math.exp(-damping)


@dataclass(frozen=True)
class Law:
    """The angle it gives [rad] for a rig and a drive velocity, the velocities it is shown for [mm/s], and how it is drawn."""

    angle: Callable[[Rig, float], float]
    velocities: tuple[float, float]
    colour: str
    line: str
    label: str


LAWS = {
    "canard 1": Law(partial(canard, order=1), (0.0, 5.0), SKY, ":", "canard, order 1"),
    "canard 2": Law(partial(canard, order=2), (0.0, 5.0), SKY, "--", "order 2"),
    "canard 3": Law(partial(canard, order=3), (0.0, 5.0), BLUE, "-", "order 3"),
    "small 2": Law(partial(small_cycle, order=2), (8.0, 36.0), GREEN, ":", "small cycle, order 2"),
    "small 4": Law(partial(small_cycle, order=4), (8.0, 36.0), GREEN, "--", "order 4"),
    "averaged": Law(averaged_end, (6.0, 110.0), ORANGE, "--", "averaging, order 1"),
    "averaged 3": Law(averaged_third_end, (6.0, 110.0), VERMILION, "-", "order 3"),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--short",
        action="store_true",
        help="a short form of some seconds, to check that it runs; writes nothing",
    )
    options = parser.parse_args()
    rig = Rig()
    table = compare(rig, [row for row in ACCURATE if not options.short or row[0] in (1.0, 10.0, 75.0)])
    print_table(table)
    print_universal()
    drive, angle = bautin(rig)
    print(
        f"\nBautin point: {drive * 1e3:.4f} mm/s = {drive / rig.v_f:.5f} v_f, {math.degrees(angle):.4f} deg"
    )
    if not options.short:
        draw(rig, table, DOCS / "figures" / "closed_laws.png")


Table = list[tuple[float, str, float, dict[str, float]]]


def compare(rig: Rig, accurate: list[tuple[float, str, float]]) -> Table:
    """For each row V, kind, accurate angle, and the angle of each law [deg]."""
    table = []
    for velocity, kind, angle in accurate:
        drive = velocity * 1e-3
        laws = {"Hopf": hopf(rig, drive)}
        for name, law in LAWS.items():
            if law.velocities[0] <= velocity <= law.velocities[1]:
                laws[name] = law.angle(rig, drive)
        table.append((velocity, kind, angle, {name: math.degrees(value) for name, value in laws.items()}))
    return table


def print_table(table: Table) -> None:
    names = ("Hopf", *LAWS)
    print("| V [mm/s] | accurate | " + " | ".join(names) + " |")
    print("| --- " * (2 + len(names)) + "|")
    for velocity, kind, angle, laws in table:
        cells = []
        for name in names:
            value = laws.get(name, math.nan)
            cells.append(
                f"{value:.4f}° {100.0 * (value / angle - 1.0):+.3g} %" if math.isfinite(value) else ""
            )
        print(f"| {velocity:g} | {angle:.6f}°, {kind} | " + " | ".join(cells) + " |")


def print_universal() -> None:
    print("\n| Γ | accurate | order 1 | order 2 | order 3 |\n| --- | --- | --- | --- | --- |")
    for gamma, accurate in UNIVERSAL:
        values = [universal(gamma, order) for order in (1, 2, 3)]
        print(
            f"| {gamma:g} | {accurate} | "
            + " | ".join(f"{value:.5f} {100.0 * (value / accurate - 1.0):+.2g} %" for value in values)
            + " |"
        )


def draw(rig: Rig, table: Table, file: Path) -> None:
    with rc_context(STYLE):
        figure = Figure(figsize=(178.0 * MM, 66.0 * MM), layout="constrained")
        ends, errors, both = figure.subplots(1, 3)
        draw_ends(rig, table, ends)
        draw_errors(table, errors)
        draw_bistability(rig, both)
        for axes, letter in zip((ends, errors, both), "abc", strict=True):
            axes.set_title(f"({letter})", loc="left", fontsize=8.0)
        figure.savefig(file, dpi=0.5 * DOTS_PER_INCH)


def draw_ends(rig: Rig, table: Table, axes: Axes) -> None:
    velocities = np.concatenate([np.geomspace(0.025, 35.9, 100), np.geomspace(36.1, 110.0, 20)])
    for law in LAWS.values():
        shown = velocities[(velocities >= law.velocities[0]) & (velocities <= law.velocities[1])]
        ratio = [law.angle(rig, 1e-3 * velocity) / hopf(rig, 1e-3 * velocity) for velocity in shown]
        axes.plot(shown, ratio, law.line, color=law.colour, linewidth=1.0)
    axes.plot(
        [row[0] for row in table],
        [row[2] / row[3]["Hopf"] for row in table],
        "o",
        color=BLACK,
        markersize=2.5,
    )
    axes.axhline(1.0, color=BLACK, linewidth=0.5)
    axes.set(
        xscale="log",
        xlim=(0.02, 120.0),
        ylim=(0.84, 1.16),
        xlabel="$V$ [mm/s]",
        ylabel=r"$\varphi_\mathrm{end}/\varphi_\mathrm{Hopf}$",
    )


def draw_errors(table: Table, axes: Axes) -> None:
    for name, law in LAWS.items():
        points = [
            (velocity, 100.0 * abs(laws[name] / angle - 1.0))
            for velocity, _, angle, laws in table
            if name in laws
        ]
        axes.plot(
            *zip(*points, strict=True),
            law.line,
            color=law.colour,
            linewidth=1.0,
            marker="o",
            markersize=2.0,
            label=law.label,
        )
    axes.axhline(0.5, color=BLACK, linewidth=0.5)
    axes.set(
        xscale="log",
        yscale="log",
        xlim=(0.02, 120.0),
        ylim=(1e-6, 30.0),
        xlabel="$V$ [mm/s]",
        ylabel="deviation [%]",
    )
    axes.legend(loc="lower left", fontsize=6.5, handlelength=1.8)


def draw_bistability(rig: Rig, axes: Axes, drive: float = 0.075) -> None:
    amplitudes = np.linspace(0.02, 1.0, 60) * drive
    angles = np.degrees([averaged_angle(rig, drive, amplitude) for amplitude in amplitudes])
    swings = 2.0 * amplitudes * rig.impedance / rig.static_limit
    fold = int(np.nanargmax(angles))
    axes.plot(angles[fold:], swings[fold:], color=VERMILION, linewidth=1.0)
    axes.plot(angles[: fold + 1], swings[: fold + 1], "--", color=VERMILION, linewidth=1.0)
    for valley in (0.3, 0.34, 0.42, 0.52, 0.6, 0.68, 0.8, 1.0, 1.2, 1.36):
        low, high = np.radians((1.5, 4.6))
        angle, peak, multiplier = cycle_through(rig, drive, valley, low, high)
        face = VERMILION if multiplier < 1.0 else "white"
        axes.plot(
            math.degrees(angle),
            (peak - valley) / rig.static_limit,
            "o",
            color=VERMILION,
            markerfacecolor=face,
            markersize=3.5,
        )
    critical = math.degrees(hopf(rig, drive))
    axes.plot([1.5, critical], [0.0, 0.0], "--", color=BLACK, linewidth=1.0)
    axes.plot([critical, 5.0], [0.0, 0.0], color=BLACK, linewidth=1.5)
    axes.set(
        xlim=(1.5, 5.0), ylim=(-0.05, 1.4), xlabel=r"$\varphi$ [deg]", ylabel="$k_x u_x/F_0$, peak to peak"
    )
    axes.text(0.97, 0.95, "75 mm/s", transform=axes.transAxes, ha="right", va="top")


if __name__ == "__main__":
    main()
