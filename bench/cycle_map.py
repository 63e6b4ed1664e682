"""Savings and costs of the cycle map: `integrator.cycle_map = 'auto'` compared with 'off'.

    python bench/cycle_map.py [--runs N] [--scenes N] [--short]

Prints (a) time, error and work on Fig. 3 to 10, 100 and 1000 s; (b) a comparison on random scenes (--scenes, 300 by default, 0 for none): where
the map is slower, and whether the releases are the same. Times are processor times of `ds.run`, on which other users of a machine
have little effect: medians of N runs in turn (5 by default), or a single run if it takes more than a second.
"""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import dynstiction as ds
import numpy as np
from common import FIG3, parser_of, progress, random_values
from dynstiction.result import Result
from fig3 import final_reference

TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
LONG_RUN = 1.0  # s
SEED = 16

SLOW_PERIODS, FAST_PERIODS = 5.0, 1500.0
TIMED_RTOL, RTOL = 1e-6, 1e-10
SHORTEST = 0.005
"""The times of shorter runs without the map [s] are not compared: they are mostly the time of the call."""
SAME = 1e-8
"""Release times are not the same if they differ by more than this share of t_end."""
SLOWER, REPEATS = 1.04, 4
"""A scene in which the map is slower by more is run again so often, because of other work on the machine."""


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--runs", type=int, default=5, help="number of runs for a median")
    parser.add_argument("--scenes", type=int, default=300, help="random scenes")
    options = parser.parse_args()
    runs, scenes, tolerances = options.runs, options.scenes, TOLERANCES
    if options.short:
        runs, scenes, tolerances = 1, 10, (1e-6,)
    print("(a) Fig. 3 from rest; error of w at 10 s against the reference; each with the map / without")
    print("t_end   rtol                    ms  ratio         error of w             Newton  ratio  leapt")
    print_lengths(10.0, tolerances, runs)
    if not options.short:
        print_lengths(100.0, tolerances, runs)
        # Without the map 1000 s take half a minute.
        print_lengths(1000.0, (1e-6, 1e-10), 1)
    if scenes:
        print_scenes([compare(number) for number in progress(range(scenes), "random scenes")])


@dataclass
class Pair:
    """Runs with the map and without, and their processor times [s]."""

    results: dict[str, Result] = field(default_factory=dict)
    seconds: dict[str, list[float]] = field(default_factory=lambda: {"auto": [], "off": []})

    def more(self, run: Callable[[str], Result], runs: int) -> "Pair":
        """In turn; a long run is made only once."""
        for _ in range(runs):
            for cycle_map, spent in self.seconds.items():
                if min(spent, default=0.0) > LONG_RUN:
                    continue
                begin = time.process_time()
                self.results[cycle_map] = run(cycle_map)
                spent.append(time.process_time() - begin)
        return self

    def work(self, name: str) -> list[float]:
        return [float(self.results[cycle_map].statistics[name]) for cycle_map in self.seconds]

    def least_ratio(self) -> float:
        return min(self.seconds["auto"]) / min(self.seconds["off"])


def print_lengths(t_end: float, tolerances: tuple[float, ...], runs: int) -> None:
    for rtol in tolerances:

        def run(cycle_map: str, rtol: float = rtol) -> Result:
            return ds.run(
                FIG3,
                t_end=t_end,
                velocity_ratio=0.0,
                integrator={"rtol": rtol, "cycle_map": cycle_map},
                output={"interval": 10.0},
            )

        pair = Pair().more(run, runs)
        times = [1e3 * statistics.median(spent) for spent in pair.seconds.values()]
        errors = [error_at_10(result) for result in pair.results.values()]
        newton = pair.work("newton")
        print(
            f"{t_end:5g} {rtol:6.0e} {times[0]:9.2f} / {times[1]:9.2f} {times[1] / times[0]:6.1f}  {errors[0]:.1e} / {errors[1]:.1e} "
            f"{newton[0]:9.0f} / {newton[1]:7.0f} {newton[1] / newton[0]:6.1f} {pair.work('cycles_leapt')[0]:6.0f}",
            flush=True,
        )


def error_at_10(result: Result) -> float:
    w, true = np.array([result["w_x"][1], result["w_y"][1]]), final_reference()
    return float(np.linalg.norm(w - true) / np.linalg.norm(true))


# Random scenes


@dataclass
class Compared:
    """A random scene, and the results of its runs."""

    number: int
    values: dict[str, float]
    t_end: float
    time: dict[float, float] = field(default_factory=dict)
    """Ratio of the processor times with and without the map, by tolerance."""
    seconds: dict[float, float] = field(default_factory=dict)
    """Least processor time without the map."""
    sticks: tuple[int, int] = (0, 0)
    difference: float = 0.0
    """Largest difference of release times, over t_end; infinite if their numbers differ."""
    own: float = 0.0
    """The same for the direct run and one at a third of its tolerance."""
    cycles: int = 0
    failed: str = ""

    def __str__(self) -> str:
        values = " ".join(f"{name} {value:.3g}" for name, value in self.values.items())
        return f"{self.number:4d}: {values} t_end {self.t_end:.3g}"


def duration(values: Mapping[str, float]) -> float:
    """Some slow or fast periods, whichever is shorter [s]."""
    system, friction = ds.Scene(FIG3).system, ds.Scene(FIG3).friction
    slow = friction.mu_0 * friction.normal_load / (system.stiffness_x * values["V"])
    fast = 2.0 * np.pi * np.sqrt(values["mass"] / values["k_y"])
    return float(min(SLOW_PERIODS * slow, FAST_PERIODS * fast))


def compare(number: int) -> Compared:
    """Run a random scene with the map and without, at both tolerances."""
    values = random_values(SEED, number)
    scene = Compared(number, values, duration(values))

    def run(cycle_map: str, rtol: float) -> Result:
        return ds.run(
            FIG3,
            scene={"t_end": scene.t_end},
            system={"mass": values["mass"], "stiffness_y": values["k_y"], "misalignment_deg": values["phi"]},
            friction={"v_f": values["v_f"]},
            drive={"velocity": values["V"]},
            integrator={"rtol": rtol, "cycle_map": cycle_map, "max_steps": 3_000_000},
            output={"interval": scene.t_end},
        )

    try:
        for rtol in (TIMED_RTOL, RTOL):

            def at_rtol(cycle_map: str, rtol: float = rtol) -> Result:
                return run(cycle_map, rtol)

            pair = Pair().more(at_rtol, 1)
            if pair.least_ratio() > SLOWER:
                pair.more(at_rtol, REPEATS)
            scene.seconds[rtol], scene.time[rtol] = min(pair.seconds["off"]), pair.least_ratio()
        auto, off = pair.results["auto"], pair.results["off"]
        scene.cycles, scene.sticks = int(pair.work("cycles_leapt")[0]), (auto.sticks(), off.sticks())
        scene.difference = apart(auto, off)
        if scene.difference > SAME:
            scene.own = apart(run("off", RTOL / 3.0), off)
    except ds.DynstictionError as error:
        scene.failed = str(error)
    return scene


def apart(one: Result, other: Result) -> float:
    """Largest difference of release times over the length of the run; infinite if their numbers differ."""
    times = [result.events["time"][result.events["kind"] == 2] for result in (one, other)]
    if times[0].size != times[1].size:
        return np.inf
    return float(np.abs(times[0] - times[1]).max(initial=0.0) / one.time[-1])


def print_scenes(compared: list[Compared]) -> None:
    """Times, the worst scenes, and whether the releases are the same."""
    whole = [scene for scene in compared if not scene.failed]
    print(
        f"\n(b) {len(compared)} random scenes, {sum(bool(s.cycles) for s in whole)} of them with cycles leapt"
    )
    for scene in compared:
        if scene.failed:
            print(f"failed {scene}: {scene.failed}")
    timed = [s for s in whole if min(s.seconds.values()) > SHORTEST] or whole
    print(f"Of the {len(timed)} that take more than {1e3 * SHORTEST:g} ms without the map")
    for rtol in (TIMED_RTOL, RTOL):
        ratios = [s.time[rtol] for s in timed]
        share = " ".join(f"{v:.3f}" for v in np.quantile(ratios, (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)))
        print(f"rtol {rtol:.0e}, time with the map over without: {share} (least, 10, 25, 50, 75, 90 %, most)")
    for scene in sorted(timed, key=lambda s: max(s.time.values()), reverse=True)[:10]:
        print(f"  {' '.join(f'{ratio:.3f}' for ratio in scene.time.values())} {scene.cycles:6d}  {scene}")
    equal = [s for s in whole if s.difference <= SAME]
    print(f"rtol {RTOL:.0e}: release times equal to {SAME:.0e} of t_end in {len(equal)} of {len(whole)}")
    for scene in whole:
        if scene.difference > SAME:
            name = "irregular" if scene.own >= 0.1 * scene.difference else "DIFFERENT"
            print(f"  {name}: {scene.difference:.1e}, own {scene.own:.1e}, sticks {scene.sticks}  {scene}")


if __name__ == "__main__":
    main()
