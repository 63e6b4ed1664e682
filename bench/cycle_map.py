"""Savings and costs of the cycle map: `integrator.cycle_map = 'auto'` compared with 'off'.

    python bench/cycle_map.py [--runs 5] [--scenes 300] [--short]

Prints (a) time, error and work on Fig. 3 to 10, 100 and 1000 s; (b) a comparison on random scenes (0 for none): where the map is slower, and
whether the releases are the same. Times are processor times of `ds.run`, on which other users of a machine have little effect: the
least of N runs in turn, or of a single run if it takes more than a second.
"""

import time
from collections.abc import Mapping

import dynstiction as ds
import numpy as np
from common import FIG3, duration, options_of, progress, random_values
from fig3 import final_reference

TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
MAPS = ("auto", "off")
LONG_RUN = 1.0  # s
SEED = 16
TIMED_RTOL, RTOL = 1e-6, 1e-10
SHORTEST = 0.005
"""The times of shorter runs without the map [s] are not compared: they are mostly the time of the call."""
SAME = 1e-8
"""Release times are not the same if they differ by more than this share of t_end."""


def main() -> None:
    options = options_of(__doc__, runs=(5, 1), scenes=(300, 10))
    print("(a) Fig. 3 from rest; error of w at 10 s against the reference; each with the map / without")
    print("t_end   rtol                    ms  ratio         error of w             Newton  ratio  leapt")
    # Without the map 1000 s take half a minute.
    lengths = (
        ((10.0, (1e-6,)),)
        if options.short
        else ((10.0, TOLERANCES), (100.0, TOLERANCES), (1000.0, (1e-6, 1e-10)))
    )
    for t_end, tolerances in lengths:
        for rtol in tolerances:
            print_length(t_end, rtol, options.runs)
    if options.scenes:
        print_scenes(options.scenes, options.runs)


def pair(scene: ds.Scene, rtol: float, runs: int) -> tuple[list[ds.Result], list[float]]:
    """Runs with the map and without, in turn, and the least processor times [s]."""
    results, seconds = {}, dict.fromkeys(MAPS, np.inf)
    for number in range(runs):
        for cycle_map in MAPS:
            if number and seconds[cycle_map] > LONG_RUN:
                continue
            begun = time.process_time()
            results[cycle_map] = ds.run(
                scene, integrator={"rtol": rtol, "cycle_map": cycle_map, "max_steps": 30_000_000}
            )
            seconds[cycle_map] = min(seconds[cycle_map], time.process_time() - begun)
    return [results[each] for each in MAPS], [seconds[each] for each in MAPS]


def print_length(t_end: float, rtol: float, runs: int) -> None:
    results, seconds = pair(ds.Scene(FIG3, t_end=t_end, velocity_ratio=0.0, interval=10.0), rtol, runs)
    reference = final_reference()
    errors = [
        np.linalg.norm([each["w_x"][1], each["w_y"][1]] - reference) / np.linalg.norm(reference)
        for each in results
    ]
    newton = [each.statistics["newton"] for each in results]
    print(
        f"{t_end:5g} {rtol:6.0e} {1e3 * seconds[0]:9.2f} / {1e3 * seconds[1]:9.2f} {seconds[1] / seconds[0]:6.1f}  {errors[0]:.1e} / {errors[1]:.1e} "
        f"{newton[0]:9.0f} / {newton[1]:7.0f} {newton[1] / newton[0]:6.1f} {results[0].statistics['cycles_leapt']:6.0f}",
        flush=True,
    )


def print_scenes(count: int, runs: int) -> None:
    """Times, the worst scenes, and whether the releases are the same."""
    print(f"\n(b) {count} random scenes")
    times: dict[str, list[list[float]]] = {}
    leapt = same = 0
    for number in progress(range(count), "random scenes"):
        values = random_values(SEED, number)
        t_end = duration(values)
        name = f"{number:4d}: {' '.join(f'{key} {value:.3g}' for key, value in values.items())} t_end {t_end:.3g}"
        try:
            leapt_here, apart, own, times[name] = compare(values, t_end, runs)
        except ds.DynstictionError as error:
            print(f"failed {name}: {error}")
            continue
        leapt, same = leapt + leapt_here, same + (apart <= SAME)
        if apart > SAME:
            print(f"{'irregular' if own >= 0.1 * apart else 'DIFFERENT'}: {apart:.1e}, own {own:.1e}  {name}")
    print(
        f"rtol {RTOL:.0e}: release times equal to {SAME:.0e} of t_end in {same} of {len(times)}; cycles leapt in {leapt}"
    )
    timed = {name: each for name, each in times.items() if min(off for _, off in each) > SHORTEST} or times
    ratios = {name: [auto / off for auto, off in each] for name, each in timed.items()}
    print(
        f"Of the {len(timed)} that take more than {1e3 * SHORTEST:g} ms without the map, time with it over that without"
    )
    for i, rtol in enumerate((TIMED_RTOL, RTOL)):
        share = np.quantile([each[i] for each in ratios.values()], (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0))
        print(f"rtol {rtol:.0e}: {' '.join(f'{v:.3f}' for v in share)} (least, 10, 25, 50, 75, 90 %, most)")
    for name in sorted(ratios, key=lambda name: -max(ratios[name]))[:10]:
        print(f"  {' '.join(f'{ratio:.3f}' for ratio in ratios[name])}  {name}")


def compare(
    values: Mapping[str, float], t_end: float, runs: int
) -> tuple[bool, float, float, list[list[float]]]:
    """Whether cycles were leapt, the differences of releases with the map and, if they differ, at another rtol, and times at both rtol."""
    scene = ds.Scene(
        FIG3, t_end=t_end, interval=t_end, mass=values["mass"], stiffness_y=values["k_y"],
        misalignment_deg=values["phi"], v_f=values["v_f"], velocity=values["V"],
    )  # fmt: skip
    _, first = pair(scene, TIMED_RTOL, runs)
    (auto, off), second = pair(scene, RTOL, runs)
    apart = difference(auto, off)
    own = (
        difference(
            ds.run(scene, integrator={"rtol": RTOL / 3.0, "cycle_map": "off", "max_steps": 30_000_000}), off
        )
        if apart > SAME
        else 0.0
    )
    return bool(auto.statistics["cycles_leapt"]), apart, own, [first, second]


def difference(one: ds.Result, other: ds.Result) -> float:
    """Largest difference of release times over the length of the run; infinite if their numbers differ."""
    times = [result.events["time"][result.events["kind"] == 2] for result in (one, other)]
    if times[0].size != times[1].size:
        return np.inf
    return float(np.abs(times[0] - times[1]).max(initial=0.0) / one.time[-1])


if __name__ == "__main__":
    main()
