"""True error and cost by rtol and method, on random scenes.

    python bench/tolerance.py [samples | summary] [--scenes 100] [--seed 17] [--methods radau5,...] [--short]

samples: Scenes begin at rest, with a random load of the soft spring, and slip for 150 fast periods, or up to ten times as long if they
then reach the end of the slow cycle, without the cycle map. The error of a run is its largest difference from the true motion at 20,000
samples: of the slip velocity relative to the largest slip speed, or of the spring force relative to the static limit F_0, whichever
is larger.

summary: The reason for the default of rtol, by the default method. Half of the scenes are those of the sweeps that people make (phi 0.3 to
8 degrees, k_y 1e6 to 1e8 N/m, V 0.2 to 100 mm/s, 10 s), the others as various as those of `samples`. The error is the largest of a
summary value: relative to its size, that of a share to 1, and of a valley, of a swing and of a work to the peak or the largest work.

The true motion is that of radau13 at rtol = 1e-12. Scenes in which another method at that rtol differs from it by more than 1e-9 (in
the summary: radau13 at 1e-11, 1e-6) are irregular, listed and left out. The conditioning C is the difference caused by a change of the
mass, over the relative change.

Prints, for every method and tolerance, quantiles of error/rtol, the shares of scenes below 0.01, above 30, and beyond 30 (1 + C), the share
that is right to 1e-5, the geometric means of Newton iterations and of evaluations of the equations (one stage each), and which values are worst; of `samples`
then the evaluations for a given error, interpolated between the tolerances, as geometric means over the scenes. It takes some minutes.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import dynstiction as ds
import numpy as np
from common import FIG3, duration, options_of, progress, random_values

RADAU = ("radau5", "radau9", "radau13")
TOLERANCES = (1e-3, 1e-4, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8, 1e-9, 1e-10)
TARGETS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
BAND, WANTED = (0.01, 30.0), 1e-5
TRUTH, CHANGE, MOST_STEPS = 1e-12, 1e-7, 200_000
COLUMNS = ("w_x", "w_y", "spring_force_x", "spring_force_y")
SAMPLES, FAST_PERIODS, MOST_FAST_PERIODS, SLOW_CYCLES = 20_000, 150.0, 1500.0, 1.3
SWEPT = {"phi": (0.3, 8.0), "k_y": (1e6, 1e8), "V": (0.2e-3, 0.1)}
SCALES = dict.fromkeys(
    ("period", "peak_force", "stick_duration", "slip_duration", "slip_length", "first_peak_force", "max_X_rate", "sticks", "sticking_time")
) | {
    "valley_force": "peak_force", "swing": "first_peak_force", "drive_work": "friction_work", "friction_work": "friction_work",
    "creep_share": 1.0, "slip_angle": 1.0,
}  # fmt: skip
"""Of each summary value: itself, another one, or a number."""
SCENE = ds.Scene(FIG3)
F_0, K_X = SCENE.friction.mu_0 * SCENE.friction.normal_load, SCENE.system.stiffness_x


@dataclass
class Run:
    """The error of a run, the value that is worst, and its work; a run that gave up has none."""

    error: float = math.inf
    worst: str = "gave up"
    newton: float = math.nan
    rhs: float = math.nan


class Case:
    """A random scene with its true motion."""

    def __init__(self, what: str, seed: int, number: int) -> None:
        swept = what == "summary" and number % 2 == 0
        self.values = random_values(seed, number, SWEPT) if swept else random_values(seed, number)
        self.number, self.errors = number, self.of_summary if what == "summary" else self.of_samples
        names = {"phi": "misalignment_deg", "k_y": "stiffness_y", "V": "velocity"}
        keys = {names.get(name, name): value for name, value in self.values.items()}
        if what == "summary":
            t_end = 10.0 if swept else duration(self.values)
            keys |= {"t_end": t_end, "interval": t_end, "fields": "u_x"}
        else:
            load = float(np.random.default_rng([seed, number, 1]).uniform())
            t_end = self.length(load)
            keys |= {
                "t_end": t_end,
                "interval": t_end / SAMPLES,
                "fields": COLUMNS,
                "max_steps": MOST_STEPS,
                "cycle_map": "off",
            }
            keys |= {"velocity_ratio": 0.0, "elongation_x": load * F_0 / K_X}
        self.scene = SCENE.replace(**keys)
        self.truth = self.run("radau13", TRUTH)
        if what == "summary":
            self.apart, self.agree = self.measure("radau13", 1e-11).error, 1e-6
        else:
            self.apart, self.agree = self.measure("dop853", TRUTH).error, 1e-9
            if self.apart == math.inf:
                self.apart = self.measure("radau9", TRUTH).error
        changed = self.scene.replace(mass=self.scene.system.mass * (1.0 + CHANGE))
        self.conditioning = max(self.errors(self.run("radau13", TRUTH, changed)).values()) / CHANGE

    def __str__(self) -> str:
        described = " ".join(f"{name} {value:.3g}" for name, value in self.values.items())
        return (
            f"{self.number:4d}: {described} t_end {self.scene.scene.t_end:.3g}, {self.truth.sticks()} sticks"
        )

    def length(self, load: float) -> float:
        """Duration of the initial stick, and then of fast periods, or of the remainder of the slow cycle if affordable [s]."""
        angle = math.radians(self.values["phi"])
        pull = np.array([K_X * math.cos(angle), self.values["k_y"] * math.sin(angle)])
        # |(load F_0, 0) + D pull| = F_0
        middle = pull[0] * load * F_0 / (pull @ pull)
        stick = -middle + math.sqrt(middle**2 + F_0**2 * (1.0 - load**2) / (pull @ pull))
        fast = 2.0 * math.pi * math.sqrt(self.values["mass"] / self.values["k_y"])
        slow = SLOW_CYCLES * F_0 * (1.0 - load) / (K_X * self.values["V"])
        slipping = slow if FAST_PERIODS * fast < slow < MOST_FAST_PERIODS * fast else FAST_PERIODS * fast
        return stick / self.values["V"] + slipping

    def run(self, method: str, rtol: float, scene: ds.Scene | None = None) -> ds.Result:
        return ds.run(scene or self.scene, integrator={"method": method, "rtol": rtol})

    def measure(self, method: str, rtol: float) -> Run:
        try:
            result = self.run(method, rtol)
        except ds.SolverError:
            return Run()
        errors, work = self.errors(result), result.statistics
        worst = max(errors, key=lambda name: errors[name])
        return Run(errors[worst], worst, work["newton"], work["rhs"])

    def of_samples(self, result: ds.Result) -> dict[str, float]:
        w, force = (
            float(np.hypot(result[x] - self.truth[x], result[y] - self.truth[y]).max())
            for x, y in (COLUMNS[:2], COLUMNS[2:])
        )
        fastest = float(np.hypot(self.truth["w_x"], self.truth["w_y"]).max())
        # Slips may be so short that all samples are at rest.
        return {"w": w / fastest if fastest > 0.0 else 0.0, "force": force / F_0}

    def of_summary(self, result: ds.Result) -> dict[str, float]:
        """Of a value that is there in one run only, infinite."""
        found, truth = result.summary, self.truth.summary
        errors = {}
        for name in SCALES.keys() & (found.keys() | truth.keys()):
            scale = SCALES[name] or name
            scale = abs(truth.get(scale, 1.0)) if isinstance(scale, str) else scale
            apart = abs(found.get(name, math.inf) - truth.get(name, math.inf))
            errors[name] = apart / scale if scale > 0.0 else math.inf if apart > 0.0 else 0.0
        return errors


def main() -> None:
    options = options_of(
        __doc__,
        "samples",
        "summary",
        scenes=(100, 4),
        seed=17,
        methods=("radau5,radau9,radau13,dopri5,dop853", "radau9,radau13"),
    )
    tolerances = TOLERANCES[1:7:3] if options.short else TOLERANCES
    for what in options.words:
        print(f"{what}, {options.scenes} scenes")
        methods = options.methods.split(",") if what == "samples" else ["radau13"]
        cases = []
        for number in progress(range(options.scenes), "true motions"):
            try:
                cases.append(Case(what, options.seed, number))
            except ds.SolverError as problem:
                print(f"no truth of {number}: {problem}")
        for case in cases:
            if case.apart > case.agree:
                print(f"irregular, {case.apart:.1e}: {case}")
        cases = [case for case in cases if case.apart <= case.agree]
        runs = {
            (method, rtol): [case.measure(method, rtol) for case in cases]
            for method in progress(methods, "methods") for rtol in tolerances if method in RADAU or rtol in TOLERANCES[1::2]
        }  # fmt: skip
        print_errors(cases, runs)
        if what == "samples":
            print_work(runs, [method for method in methods if method in RADAU])


def print_errors(cases: list[Case], runs: Mapping[tuple[str, float], list[Run]]) -> None:
    print(
        "error/rtol: least, 5, 25, 50, 75, 95 %, most; below, above, beyond; right to 1e-5; Newton, evaluations; worst"
    )
    for (method, rtol), tried in runs.items():
        done = [(run, case) for run, case in zip(tried, cases, strict=True) if run.worst != "gave up"]
        error = np.array([run.error for run, _ in done])
        over, growth = error / rtol, np.array([case.conditioning for _, case in done])
        quantiles = " ".join(f"{q:8.2g}" for q in np.quantile(over, (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)))
        shares = (over < BAND[0], over > BAND[1], over > BAND[1] * (1.0 + growth), error <= WANTED)
        work = [geometric_mean([getattr(run, name) for run, _ in done]) for name in ("newton", "rhs")]
        worst = Counter(run.worst for run in tried if run.error > WANTED)
        print(
            f"{method:8} {rtol:.0e} {quantiles}  {' '.join(f'{np.mean(share):5.0%}' for share in shares)}  "
            f"{' '.join(f'{each:8.3g}' for each in work)}  {', '.join(f'{name} {count}' for name, count in worst.most_common(4))}"
        )


def print_work(runs: Mapping[tuple[str, float], list[Run]], methods: list[str]) -> None:
    """The evaluations for a given error, and which method needs fewest."""
    print(
        "evaluations for an error: geometric mean over the scenes where all get there, and in how many each needs fewest"
    )
    for target in TARGETS:
        table = np.array(
            [
                [
                    work_for(target, tried)
                    for tried in zip(*(runs[key] for key in runs if key[0] == m), strict=True)
                ]
                for m in methods
            ]
        )
        there = np.isfinite(table).all(axis=0)
        fewest = table[:, there].argmin(axis=0)
        cells = [
            f"{m} {geometric_mean(table[i, there]):8.3g} ({np.count_nonzero(fewest == i):3d})"
            for i, m in enumerate(methods)
        ]
        print(f"{target:.0e} {there.sum():4d} scenes  {'   '.join(cells)}")


def work_for(target: float, tried: tuple[Run, ...]) -> float:
    """From runs of decreasing rtol; an error counts as at least that of a smaller rtol."""
    done = [run for run in reversed(tried) if run.worst != "gave up"]
    error = np.maximum.accumulate([max(run.error, 1e-16) for run in done])
    if not done or error[0] > target:
        return math.nan
    return float(np.exp(np.interp(np.log(target), np.log(error), np.log([run.rhs for run in done]))))


def geometric_mean(values: list[float]) -> float:
    # Some scenes need no step.
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-3))))) if len(values) else math.nan


if __name__ == "__main__":
    main()
