"""Savings and costs of the cycle map: `integrator.cycle_map = 'auto'` compared with 'off'.

    python bench/cycle_map.py [--runs N] [--scenes N] [--exe PATH] [--short]

Prints (a) time, error and work on Fig. 3 to 10, 100 and 1000 s without samples, with the 50,000 samples of the deck in memory and
in a file, and by method; (b) the same against the stiffness k_y; (c) a comparison on random scenes (--scenes, 300 by default; 0
leaves them out): where the map is slower, and whether the releases are the same. Seeds are fixed. Times are processor times of
`ds.run`, on which other users of a machine have little effect: medians of N runs in turn (5 by default), or a single run if it
takes more than a second. All of it takes about ten minutes.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dynstiction as ds
import h5py
import numpy as np
from dynstiction.result import Result

DECK = Path(__file__).resolve().parent.parent / "inputs" / "fig3.nml"
# t = 10 s, converged in quadruple precision: tests/reference/fig3.json.
REFERENCE_W = np.array([6.2816809453075609e-5, 3.4203886485577507e-5])
TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
# Without the map 1000 s take half a minute.
DIRECT_TOLERANCES = {1000.0: (1e-6, 1e-10)}
METHODS = ("radau5", "radau9", "radau13", "dopri5", "dop853")
STIFFNESSES = tuple(10.0**exponent for exponent in range(6, 12))
LONG_RUN = 1.0  # s
SEED = 16

SLOW_PERIODS, FAST_PERIODS = 5.0, 1500.0
RANGES = {"mass": (1e-4, 10.0), "k_y": (1e5, 1e10), "phi": (0.05, 30.0), "V": (1e-5, 0.1), "v_f": (1e-4, 1.0)}
RANDOM_RTOL, TIMED_RTOL = 1e-10, 1e-6
# The times of shorter runs without the map [s] are not compared: they are mostly the time of the call.
SHORTEST = 0.005
# Release times are not the same if they differ by more than this share of t_end.
SAME = 1e-8
# A scene in which the map is slower by more than this share is run again this many times, because of other work on the machine.
SLOWER, REPEATS = 1.04, 4


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5, help="number of runs for a median")
    parser.add_argument("--scenes", type=int, default=300, help="random scenes")
    parser.add_argument(
        "--exe", default=shutil.which("dynstiction") or DECK.parent.parent / ".venv/bin/dynstiction"
    )
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    runs, scenes, lengths, tolerances, stiffnesses = (
        options.runs,
        options.scenes,
        (10.0, 100.0, 1000.0),
        TOLERANCES,
        STIFFNESSES,
    )
    if options.short:
        runs, scenes, lengths, tolerances, stiffnesses = 1, 10, (10.0,), (1e-6,), (1e6, 1e9)
    for t_end in lengths:
        print_lengths(t_end, tolerances, runs)
    print_samples(str(options.exe), runs)
    print_methods(tolerances if options.short else (1e-3, 1e-4, *tolerances), runs)
    print_stiffnesses(stiffnesses, runs)
    if scenes > 0:
        print_scenes(compare_all(scenes))


# Fig. 3


@dataclass
class Pair:
    """Runs with the map and without, and their processor times [s]."""

    results: dict[str, Result] = field(default_factory=dict)
    seconds: dict[str, list[float]] = field(default_factory=dict)

    def median(self, cycle_map: str) -> float:
        return statistics.median(self.seconds[cycle_map])

    def __getitem__(self, cycle_map: str) -> Result:
        return self.results[cycle_map]


def in_turn(run: Callable[[str], Result], runs: int, which: Sequence[str] = ("auto", "off")) -> Pair:
    """Results and times of 'auto' and 'off', one after the other; a long run is made only once."""
    pair = Pair()
    for _ in range(runs):
        for cycle_map in which:
            if min(pair.seconds.get(cycle_map, [0.0])) > LONG_RUN:
                continue
            begin = time.process_time()
            pair.results[cycle_map] = run(cycle_map)
            pair.seconds.setdefault(cycle_map, []).append(time.process_time() - begin)
    return pair


def fig3(
    cycle_map: str,
    rtol: float,
    t_end: float,
    interval: float,
    method: str = "radau9",
    **groups: Mapping[str, float],
) -> Result:
    return ds.run(
        DECK,
        scene={"t_end": t_end},
        integrator={"rtol": rtol, "method": method, "cycle_map": cycle_map},
        output={"interval": interval},
        **groups,
    )


def print_lengths(t_end: float, tolerances: Sequence[float], runs: int) -> None:
    """Time, error, sticks and Newton iterations without samples; beyond 10 s the error is the difference from the finest direct run."""
    direct = DIRECT_TOLERANCES.get(t_end, tolerances)
    pairs = {
        rtol: in_turn(
            lambda cycle_map, rtol=rtol: fig3(cycle_map, rtol, t_end, t_end),
            runs,
            ("auto", "off") if rtol in direct else ("auto",),
        )
        for rtol in tolerances
    }
    finest = pairs[min(direct)]["off"]
    true = REFERENCE_W if t_end == 10.0 else slip_velocity(finest)
    of_what = "reference" if t_end == 10.0 else f"direct run at {min(direct):.0e}"
    print(
        f"\n(a) Fig. 3 to {t_end:g} s, no samples; error of w against the {of_what}; each with the map / without"
    )
    print(
        f"{'rtol':>6} {'ms':>20} {'ratio':>6} {'error of w':>17} {'sticks':>15} {'Newton':>18} {'ratio':>6}  leapt sampled reused"
    )
    for rtol, pair in pairs.items():
        both = ("auto", "off") if rtol in direct else ("auto",)
        errors = [np.linalg.norm(slip_velocity(pair[c]) - true) / np.linalg.norm(true) for c in both]
        newton = [int(pair[c].statistics["newton"]) for c in both]
        times = [1e3 * pair.median(c) for c in both]
        ratios = [f"{a[1] / a[0]:.1f}" if len(a) > 1 else "" for a in (times, newton)]
        print(
            f"{rtol:6.0e} {joined('{:.2f}', times):>20} {ratios[0]:>6} {joined('{:.1e}', errors):>17} "
            f"{joined('{}', [pair[c].sticks() for c in both]):>15} {joined('{}', newton):>18} {ratios[1]:>6}  {leapt(pair['auto'])}",
            flush=True,
        )


def slip_velocity(result: Result) -> np.ndarray:
    return np.array([result["w_x"][-1], result["w_y"][-1]])


def joined(form: str, values: Sequence[float]) -> str:
    return " / ".join(form.format(value) for value in values)


def leapt(result: Result) -> str:
    cycles, sampled, reused = (
        int(result.statistics[n]) for n in ("cycles_leapt", "cycles_sampled", "excursions_reused")
    )
    return f"{cycles} {sampled} {reused}"


def print_methods(tolerances: Sequence[float], runs: int) -> None:
    """The cycles that each method leaps, and the time that this saves."""
    print("\nFig. 3 to 10 s by method: time with the map over that without / cycles leapt")
    print(f"{'method':8} {' '.join(f'{rtol:>14.0e}' for rtol in tolerances)}")
    for method in METHODS:
        cells = []
        for rtol in tolerances:
            pair = in_turn(
                lambda c, rtol=rtol, method=method: fig3(c, rtol, 10.0, 10.0, method), min(runs, 3)
            )
            cells.append(f"{least(pair):.3f} / {pair['auto'].statistics['cycles_leapt']:.0f}")
        print(f"{method:8} {' '.join(f'{cell:>14}' for cell in cells)}", flush=True)


def print_samples(exe: str, runs: int) -> None:
    """Cost of the samples of the deck in memory and in a file, and of only writing the same arrays."""
    rtol, t_end, interval = 1e-6, 10.0, 2e-4
    bare = in_turn(lambda cycle_map: fig3(cycle_map, rtol, t_end, t_end), runs)
    full = in_turn(lambda cycle_map: fig3(cycle_map, rtol, t_end, interval), runs)
    print(f"\nFig. 3 to 10 s, rtol {rtol:.0e}, samples of the deck: {full['auto'].time.size} [ms]")
    print(f"{'':22} {'map':>8} {'without':>8}   (of processes the least)")
    print(f"{'solver, no samples':22} {1e3 * bare.median('auto'):8.1f} {1e3 * bare.median('off'):8.1f}")
    print(f"{'solver, in memory':22} {1e3 * full.median('auto'):8.1f} {1e3 * full.median('off'):8.1f}")
    worst = max(
        np.abs(full["auto"][name] - full["off"][name]).max() / np.abs(full["off"][name]).max()
        for name in ("u_x", "u_y", "w_x", "w_y")
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fig3.h5"
        seconds: dict[tuple[str, float], list[float]] = {}
        copying: list[float] = []
        for _ in range(runs):
            for cycle_map in ("auto", "off"):
                for every in (t_end, interval):
                    seconds.setdefault((cycle_map, every), []).append(
                        process(exe, file, cycle_map, rtol, every)
                    )
            copying.append(copy_arrays(file, Path(folder) / "copy.h5"))
    columns = {key: 1e3 * min(values) for key, values in seconds.items()}
    for every, name in ((t_end, "process, no samples"), (interval, "process, into a file")):
        print(f"{name:22} {columns['auto', every]:8.1f} {columns['off', every]:8.1f}")
    print(f"{'writing the arrays':22} {1e3 * min(copying):8.1f} {1e3 * min(copying):8.1f}")
    more = [columns[c, interval] - columns[c, t_end] - 1e3 * min(copying) for c in ("auto", "off")]
    print(f"{'samples beyond that':22} {more[0]:8.1f} {more[1]:8.1f}")
    print(f"largest difference of samples of u and w, over the largest of each: {worst:.1e}")


def process(exe: str, output: Path, cycle_map: str, rtol: float, interval: float) -> float:
    """Processor time of a process that runs Fig. 3 into a file [s]."""
    settings = (f"integrator.cycle_map={cycle_map}", f"integrator.rtol={rtol}", f"output.interval={interval}")
    command = [exe, "run", str(DECK), "--overwrite", "--quiet", "-o", str(output)]
    for setting in settings:
        command += ["--set", setting]
    started = subprocess.Popen(command)
    _, status, usage = os.wait4(started.pid, 0)
    if status != 0:
        raise SystemExit(f"{' '.join(command)} failed")
    return usage.ru_utime + usage.ru_stime


def copy_arrays(source: Path, target: Path) -> float:
    """Processor time [s] of writing the datasets of a file, from memory, with the same chunks and compression."""
    arrays: list[tuple[str, Any, dict[str, Any]]] = []
    with h5py.File(source) as file:

        def note(name: str, item: h5py.Dataset | h5py.Group) -> None:
            if isinstance(item, h5py.Dataset) and item.shape:
                layout = {
                    n: getattr(item, n)
                    for n in ("chunks", "compression", "compression_opts", "shuffle", "fletcher32")
                }
                arrays.append((name, item[()], layout | {"dtype": item.dtype}))

        file.visititems(note)
    begin = time.process_time()
    with h5py.File(target, "w") as file:
        for name, data, layout in arrays:
            file.create_dataset(name, data=data, **layout)
    spent = time.process_time() - begin
    target.unlink()
    return spent


def print_stiffnesses(stiffnesses: Sequence[float], runs: int) -> None:
    """Fig. 3 with other stiffnesses, at two tolerances."""
    t_end = 10.0
    print("\n(b) Fig. 3 to 10 s against k_y, with the map / without")
    print(f"{'k_y':>6} {'rtol':>6} {'ms':>20} {'Newton':>18} {'sticks':>15}  leapt sampled reused")
    for rtol in (1e-6, 1e-8):
        for k_y in stiffnesses:
            pair = in_turn(
                lambda cycle_map, k_y=k_y, rtol=rtol: fig3(
                    cycle_map, rtol, t_end, t_end, system={"stiffness_y": k_y}
                ),
                runs,
            )
            both = ("auto", "off")
            print(
                f"{k_y:6.0e} {rtol:6.0e} {joined('{:.1f}', [1e3 * pair.median(c) for c in both]):>20} "
                f"{joined('{}', [int(pair[c].statistics['newton']) for c in both]):>18} {joined('{}', [pair[c].sticks() for c in both]):>15}"
                f"  {leapt(pair['auto'])}",
                flush=True,
            )


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
    newton: dict[float, float] = field(default_factory=dict)
    sticks: tuple[int, int] = (0, 0)
    difference: float = 0.0
    """Largest difference of release times, over t_end; infinite if their numbers differ."""
    own: float = 0.0
    """The same for the direct run and one at a third of its tolerance."""
    cycles: int = 0
    failed: str = ""

    def described(self) -> str:
        values = " ".join(f"{name} {value:.3g}" for name, value in self.values.items())
        return f"{self.number:4d}: {values} t_end {self.t_end:.3g}"


def compare_all(number: int) -> list[Compared]:
    """Compare random scenes, and print progress from time to time."""
    compared, due = [], time.monotonic() + 10.0
    for i in range(number):
        compared.append(compare(i))
        if time.monotonic() > due:
            due += 10.0
            print(f"{i + 1} of {number} random scenes", file=sys.stderr, flush=True)
    return compared


def print_scenes(compared: Sequence[Compared]) -> None:
    """Times and work, the worst scenes, and whether the releases are the same."""
    whole = [scene for scene in compared if not scene.failed]
    print(
        f"\n(c) {len(compared)} random scenes, {sum(bool(s.cycles) for s in whole)} of them with cycles leapt, "
        f"{sum(bool(s.sticks[1]) for s in whole)} with sticks"
    )
    for scene in compared:
        if scene.failed:
            print(f"failed {scene.described()}: {scene.failed}")
    timed = [s for s in whole if min(s.seconds.values()) > SHORTEST] or whole
    print(f"Of the {len(timed)} that take more than {1e3 * SHORTEST:g} ms without the map")
    for rtol in (TIMED_RTOL, RANDOM_RTOL):
        for what, ratios in (
            ("time", [s.time[rtol] for s in timed]),
            ("Newton iterations", [s.newton[rtol] for s in timed]),
        ):
            share = np.quantile(ratios, (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0))
            print(
                f"rtol {rtol:.0e}, {what:17} with the map over without: "
                f"{' '.join(f'{v:.3f}' for v in share)} (least, 10, 25, 50, 75, 90 %, most); above 1.05: {sum(r > 1.05 for r in ratios)}"
            )
    worst = sorted(timed, key=lambda s: max(s.time.values()), reverse=True)[:10]
    print("The ten in which the map is worst: time at both tolerances, Newton iterations, cycles leapt")
    for scene in worst:
        ratios = " ".join(f"{scene.time[r]:.3f}" for r in (TIMED_RTOL, RANDOM_RTOL))
        work = " ".join(f"{scene.newton[r]:.3f}" for r in (TIMED_RTOL, RANDOM_RTOL))
        print(f"  {ratios}  {work}  {scene.cycles:6d}  {scene.described()}")
    same = [s for s in whole if s.sticks[0] == s.sticks[1]]
    equal = [s for s in whole if s.difference <= SAME]
    irregular = [s for s in whole if s.difference > SAME and s.own >= 0.1 * s.difference]
    wrong = [s for s in whole if s.difference > SAME and s not in irregular]
    largest = max((s.difference for s in equal if s.cycles), default=0.0)
    print(
        f"rtol {RANDOM_RTOL:.0e}: same number of sticks in {len(same)} of {len(whole)}; release times equal to {SAME:.0e} of t_end in "
        f"{len(equal)} (largest with cycles leapt {largest:.1e})"
    )
    for name, scenes in (("irregular", irregular), ("DIFFERENT", wrong)):
        for scene in scenes:
            print(
                f"  {name}: {scene.difference:.1e}, without the map at rtol and rtol/3 {scene.own:.1e}, sticks {scene.sticks[0]} and "
                f"{scene.sticks[1]}  {scene.described()}"
            )


def random_values(
    seed: int, number: int, ranges: Mapping[str, tuple[float, float]] = RANGES
) -> dict[str, float]:
    """Log-uniform within ranges."""
    random = np.random.default_rng([seed, number])
    return {name: float(10.0 ** random.uniform(*np.log10(bounds))) for name, bounds in ranges.items()}


def compare(number: int) -> Compared:
    """Run a random scene with the map and without, at both tolerances."""
    values = random_values(SEED, number)
    scene = Compared(number, values, duration(values))
    try:
        for rtol in (TIMED_RTOL, RANDOM_RTOL):
            pair = in_turn(lambda cycle_map, rtol=rtol: random_run(scene, rtol, cycle_map), 1)
            if least(pair) > SLOWER:
                again = in_turn(lambda cycle_map, rtol=rtol: random_run(scene, rtol, cycle_map), REPEATS)
                for cycle_map, seconds in again.seconds.items():
                    pair.seconds[cycle_map] += seconds
            newton = [pair[c].statistics["newton"] for c in ("auto", "off")]
            scene.seconds[rtol] = min(pair.seconds["off"])
            scene.time[rtol], scene.newton[rtol] = least(pair), newton[0] / max(1.0, newton[1])
        scene.cycles = int(pair["auto"].statistics["cycles_leapt"])
        scene.sticks = pair["auto"].sticks(), pair["off"].sticks()
        scene.difference = apart(pair["auto"], pair["off"])
        if scene.difference > SAME:
            scene.own = apart(random_run(scene, RANDOM_RTOL / 3.0, "off"), pair["off"])
    except ds.DynstictionError as error:
        scene.failed = str(error)
    return scene


def least(pair: Pair) -> float:
    """Ratio of the least times."""
    return min(pair.seconds["auto"]) / min(pair.seconds["off"])


def duration(values: Mapping[str, float]) -> float:
    """Some slow or fast periods, whichever is shorter [s]."""
    groups = ds.Scene(DECK).groups()
    system, friction = groups["system"], groups["friction"]
    slow = (
        float(friction["mu_0"])
        * float(friction["normal_load"])
        / (float(system["stiffness_x"]) * values["V"])
    )
    fast = 2.0 * np.pi * np.sqrt(values["mass"] / values["k_y"])
    return float(min(SLOW_PERIODS * slow, FAST_PERIODS * fast))


def random_scene(scene: Compared, rtol: float, cycle_map: str) -> ds.Scene:
    values = scene.values
    return ds.Scene(
        DECK,
        scene={"t_end": scene.t_end},
        system={"mass": values["mass"], "stiffness_y": values["k_y"], "misalignment_deg": values["phi"]},
        friction={"v_f": values["v_f"]},
        drive={"velocity": values["V"]},
        integrator={"rtol": rtol, "cycle_map": cycle_map, "max_steps": 3_000_000},
        output={"interval": scene.t_end},
    )


def random_run(scene: Compared, rtol: float, cycle_map: str) -> Result:
    return ds.run(random_scene(scene, rtol, cycle_map))


def apart(one: Result, other: Result) -> float:
    """Largest difference of release times over the length of the run; infinite if their numbers differ."""
    times = [result.events["time"][result.events["kind"] == 2] for result in (one, other)]
    if times[0].size != times[1].size:
        return np.inf
    return float(np.abs(times[0] - times[1]).max(initial=0.0) / one.time[-1])


if __name__ == "__main__":
    main()
