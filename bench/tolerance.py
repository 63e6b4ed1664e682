"""True error and cost by rtol and method, on random scenes, without leaps over cycles (`cycle_map = 'off'`).

    python bench/tolerance.py [--scenes N] [--seed N] [--methods radau9,...] [--short]

A scene begins at rest, with a random load of the soft spring, and slips for 150 fast periods, or up to ten times as long if it
then reaches the end of the slow cycle. The true motion is radau13 at rtol = 1e-12. Scenes in which dop853 at 1e-12 (radau9, if
dop853 takes more than 200,000 steps) differs from it by more than 1e-9 are listed and left out. The error of a run is its largest
difference from the true motion at 20,000 samples: of the slip velocity relative to the largest slip speed, or of the spring force
relative to the static limit F_0, whichever is larger. The conditioning C is the difference caused by a change of the mass, over
the relative change.

Prints, for every method and tolerance, quantiles of error/rtol, the shares of scenes below 0.01, up to 30 and above, the share
beyond 30 (1 + C), and the work; then the work of the Radau methods for a given error, interpolated between the tolerances, as
geometric means over the scenes. Work is in millions of instructions of Newton iterations and steps, as callgrind counts them on
Fig. 3 (without valgrind: the number of evaluations). It takes about six minutes.
"""

import math
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import dynstiction as ds
import numpy as np
from common import FIG3, instructions, parser_of, progress, random_values
from dynstiction.result import Result

STAGES = {"radau5": 3, "radau9": 5, "radau13": 7}
METHODS = (*STAGES, "dopri5", "dop853")
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
MORE_TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
TARGETS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
BAND = (0.01, 30.0)
SEED = 17
FAST_PERIODS, MOST_FAST_PERIODS, SLOW_CYCLES = 150.0, 1500.0, 1.3
COLUMNS = ("w_x", "w_y", "spring_force_x", "spring_force_y")
SAMPLES = 20_000
TRUTH, AGREE, CHANGE = 1e-12, 1e-9, 1e-7
MOST_STEPS = 200_000


@dataclass
class Scene:
    """A random scene and its true motion."""

    number: int
    values: dict[str, float]
    load: float
    """Initial load of the soft spring, over the static limit."""
    t_end: float
    truth: dict[str, np.ndarray] = field(default_factory=dict)
    sticks: int = 0
    apart: float = 0.0
    """Difference of a second method from the true motion."""
    conditioning: float = 0.0
    checked_by: str = "dop853"

    def described(self) -> str:
        values = " ".join(f"{name} {value:.3g}" for name, value in self.values.items())
        return f"{self.number:4d}: {values} load {self.load:.2f} t_end {self.t_end:.3g}"


@dataclass
class Run:
    """Error and work of one run; none if the run gave up."""

    scene: Scene
    error: float = math.nan
    sticks: int = -1
    work: dict[str, float] = field(default_factory=dict)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--methods", default=",".join(METHODS))
    options = parser.parse_args()
    methods, numbers = options.methods.split(","), range(options.scenes)
    tolerances = {method: MORE_TOLERANCES if method in STAGES else TOLERANCES for method in methods}
    if options.short:
        methods, numbers = ["radau9", "radau13"], range(1, 4)
        tolerances = dict.fromkeys(methods, (1e-4, 1e-6))
    drawn = [scene for number in progress(numbers, "truths") if (scene := draw(options.seed, number))]
    regular = [scene for scene in drawn if scene.apart <= AGREE]
    print_scenes(drawn, len(numbers))
    runs = {
        (method, rtol): [measure(scene, method, rtol) for scene in regular]
        for method in progress(methods, "methods")
        for rtol in tolerances[method]
    }
    priced = (1e-3, 1e-11) if options.short else (1e-3, 1e-5, 1e-8, 1e-11)
    prices = {method: price(method, priced) for method in methods}
    print_errors(runs, prices)
    print_work(runs, prices, [method for method in methods if method in STAGES])


# Scenes


def draw(seed: int, number: int) -> Scene | None:
    """A random scene with its true motion; none if that cannot be computed."""
    values = random_values(seed, number)
    load = float(np.random.default_rng([seed, number, 1]).uniform())
    scene = Scene(number, values, load, duration(values, load))
    try:
        first = run(scene, "radau13", TRUTH)
        scene.truth = {name: np.array(first[name]) for name in COLUMNS}
        scene.sticks = first.sticks()
        try:
            second = run(scene, "dop853", TRUTH)
        except ds.SolverError:
            scene.checked_by = "radau9"
            second = run(scene, "radau9", TRUTH)
        changed = run(scene, "radau13", TRUTH, 1.0 + CHANGE)
    except ds.SolverError as problem:
        print(f"no truth of {scene.described()}: {problem}", file=sys.stderr)
        return None
    scene.apart = error(scene, second)
    scene.conditioning = error(scene, changed) / CHANGE
    return scene


def duration(values: dict[str, float], load: float) -> float:
    """Duration of the initial stick, and then of fast periods, or of the remainder of the slow cycle if affordable [s]."""
    groups = ds.Scene(FIG3).groups()
    stiffness_x = float(groups["system"]["stiffness_x"])
    pull = np.array(
        [
            stiffness_x * math.cos(math.radians(values["phi"])),
            values["k_y"] * math.sin(math.radians(values["phi"])),
        ]
    )
    # |(load F_0, 0) + D pull| = F_0
    middle = pull[0] * load * limit() / (pull @ pull)
    stick = -middle + math.sqrt(middle**2 + limit() ** 2 * (1.0 - load**2) / (pull @ pull))
    fast = 2.0 * math.pi * math.sqrt(values["mass"] / values["k_y"])
    slow = SLOW_CYCLES * limit() * (1.0 - load) / (stiffness_x * values["V"])
    slipping = slow if FAST_PERIODS * fast < slow < MOST_FAST_PERIODS * fast else FAST_PERIODS * fast
    return stick / values["V"] + slipping


def limit() -> float:
    """The static limit F_0 [N]."""
    friction = ds.Scene(FIG3).friction
    return friction.mu_0 * friction.normal_load


def run(scene: Scene, method: str, rtol: float, heavier: float = 1.0) -> Result:
    values = scene.values
    stiffness_x = ds.Scene(FIG3).system.stiffness_x
    return ds.run(
        FIG3,
        scene={"t_end": scene.t_end},
        system={
            "mass": heavier * values["mass"],
            "stiffness_y": values["k_y"],
            "misalignment_deg": values["phi"],
        },
        friction={"v_f": values["v_f"]},
        drive={"velocity": values["V"]},
        initial={"velocity_ratio": 0.0, "elongation_x": scene.load * limit() / stiffness_x},
        integrator={"method": method, "rtol": rtol, "cycle_map": "off", "max_steps": MOST_STEPS},
        output={
            "interval": scene.t_end / SAMPLES,
            "fields": list(COLUMNS),
        },
    )


def error(scene: Scene, result: Result) -> float:
    """Largest difference of the slip velocity or of the spring force, over their scales."""
    truth = scene.truth
    w, force = (
        float(np.hypot(result[x] - truth[x], result[y] - truth[y]).max())
        for x, y in (COLUMNS[:2], COLUMNS[2:])
    )
    fastest = float(np.hypot(truth["w_x"], truth["w_y"]).max())
    # Slips may be so short that all samples are at rest.
    return max(w / fastest if fastest > 0.0 else 0.0, force / limit())


def measure(scene: Scene, method: str, rtol: float) -> Run:
    try:
        result = run(scene, method, rtol)
    except ds.SolverError:
        return Run(scene)
    work = {name: float(result.statistics[name]) for name in ("newton", "rhs")}
    return Run(scene, error(scene, result), result.sticks(), work)


# Work


@dataclass
class Price:
    """Millions of instructions of a Newton iteration and of an attempted step, or of an evaluation of an explicit method."""

    stages: int
    iteration: float = 0.0
    step: float = 0.0

    def of(self, run: Run) -> float:
        newton, rhs = run.work["newton"], run.work["rhs"]
        # Besides its stages at each iteration, a step evaluates its two probes.
        return self.iteration * newton + self.step * (rhs - self.stages * newton) / 2.0


def price(method: str, tolerances: Sequence[float]) -> Price:
    """Cost on Fig. 3 without the start of the program, from runs at these tolerances and two lengths."""
    stages = STAGES.get(method, 0)
    if not shutil.which("valgrind"):
        return Price(stages, iteration=float(stages), step=2.0)
    counts, counted = [], []
    for rtol in tolerances:
        (one, first), (other, second) = (callgrind(method, rtol, t_end) for t_end in (0.01, 0.06))
        more = Run(None, work={name: other[name] - one[name] for name in ("newton", "rhs")})
        counts.append([Price(stages, 1.0, 0.0).of(more), Price(stages, 0.0, 1.0).of(more)])
        counted.append((second - first) / 1e6)
    found = np.linalg.lstsq(np.array(counts), np.array(counted))[0]
    return Price(stages, *found)


def callgrind(method: str, rtol: float, t_end: float) -> tuple[dict[str, float], float]:
    """Counts and instructions of the program on Fig. 3."""
    settings = {
        "scene.t_end": t_end,
        "integrator.method": method,
        "integrator.rtol": rtol,
        "integrator.cycle_map": "off",
        "output.interval": t_end,
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fig3.h5"
        counted = instructions(FIG3, file, settings)
        return dict(ds.open(file).statistics), counted


# Tables


def print_scenes(drawn: Sequence[Scene], asked: int) -> None:
    irregular = [scene for scene in drawn if scene.apart > AGREE]
    sticks = [scene.sticks for scene in drawn]
    print(
        f"{asked} scenes, {asked - len(drawn)} without a truth, {len(irregular)} left out because two methods at {TRUTH:.0e} differ by more than {AGREE:.0e}; "
        f"{sum(scene.checked_by == 'radau9' for scene in drawn)} checked by radau9; sticks: median {np.median(sticks):.0f}, most {max(sticks)}"
    )
    for scene in irregular:
        print(f"  {scene.apart:.1e} {scene.described()}, {scene.sticks} sticks")


def print_errors(runs: dict[tuple[str, float], list[Run]], prices: dict[str, Price]) -> None:
    """Quantiles of error over rtol, and the shares of errors in the expected range."""
    print(
        f"\nError over rtol: least, 5, 25, 50, 75, 95 %, most; below, within, above {BAND[0]} ... {BAND[1]:g}, beyond {BAND[1]:g} (1 + C); "
        "geometric mean of the work"
    )
    for (method, rtol), tried in runs.items():
        done = [r for r in tried if r.work]
        over = np.array([r.error for r in done]) / rtol
        low, high = np.mean(over < BAND[0]), np.mean(over > BAND[1])
        beyond = np.mean(over > BAND[1] * (1.0 + np.array([r.scene.conditioning for r in done])))
        quantiles = np.quantile(over, (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0))
        miscounted = sum(r.sticks != r.scene.sticks for r in done)
        print(
            f"{method:8} {rtol:.0e} {' '.join(f'{q:8.2g}' for q in quantiles)}  {low:5.0%} {1 - low - high:5.0%} {high:5.0%} {beyond:5.0%}  "
            f"{geometric_mean([prices[method].of(r) for r in done]):8.3g}  {len(tried) - len(done)} gave up, {miscounted} with other sticks"
        )


def print_work(
    runs: dict[tuple[str, float], list[Run]], prices: dict[str, Price], methods: Sequence[str]
) -> None:
    """The work for a given error, and which method is the cheapest."""
    tolerances = sorted({rtol for method, rtol in runs if method in methods})
    print(
        "\nWork for an error: geometric mean over the scenes where all get there [million instructions], and in how many each is the cheapest"
    )
    for target in TARGETS:
        work = {
            m: np.array(
                [
                    work_for(target, one, prices[m])
                    for one in zip(*(runs[m, rtol] for rtol in tolerances), strict=True)
                ]
            )
            for m in methods
        }
        table = np.array([work[m] for m in methods])
        there = np.isfinite(table).all(axis=0)
        cheapest = table[:, there].argmin(axis=0)
        cells = [
            f"{m} {geometric_mean(work[m][there]):8.3g} ({np.count_nonzero(cheapest == k):3d})"
            for k, m in enumerate(methods)
        ]
        print(f"{target:.0e} {there.sum():4d} scenes  {'   '.join(cells)}")


def work_for(target: float, tried: Sequence[Run], price: Price) -> float:
    """Work from runs of increasing tolerance; an error counts as at least that of a smaller tolerance."""
    done = [r for r in tried if r.work]
    error = np.maximum.accumulate([max(r.error, 1e-16) for r in done])
    work = [price.of(r) for r in done]
    if not done or error[0] > target:
        return math.nan
    return float(np.exp(np.interp(np.log(target), np.log(error), np.log(work))))


def geometric_mean(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values)))) if len(values) else math.nan


if __name__ == "__main__":
    main()
