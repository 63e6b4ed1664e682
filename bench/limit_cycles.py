"""Limit cycles and limits of stick-slip, found without runs: their cost, and whether runs agree.

    python bench/limit_cycles.py [--folds] [--short]

Prints the time of `dynstiction.cycles` on Fig. 3 and how far its cycles are from those of settled runs; then for each row
of the table in docs/maps.md the angle at which stick-slip of the slow motion ends, by bisection of its cycles, and whether two runs
agree, 1e-8 of the angle below and above it: below it the swing settles above 5 % of F_0, above it to less. At folds, with
``--folds`` (some minutes), stick-slip continues below the angle, and becomes steady sliding above it.
"""

import time
from statistics import median

import dynstiction as ds
from common import INPUTS, parser_of

FIG3 = ds.Scene(INPUTS / "fig3.nml")
VELOCITIES = (0.03e-3, 0.1e-3, 0.3e-3, 1e-3, 10e-3, 30e-3, 50e-3, 75e-3, 100e-3)
LIMIT, STIFFNESS = 2.0, 1e3
LEAST = 0.05 * LIMIT
BESIDE, MOST_CYCLES = 1e-8, 6000


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--folds", action="store_true", help="runs on either side of each fold")
    options = parser.parse_args()
    repetitions = 3 if options.short else 21
    for model in ("low_frequency", "full"):
        found = ds.cycles(FIG3, model=model)
        seconds = median(timed(lambda model=model: ds.cycles(FIG3, model=model)) for _ in range(repetitions))
        print(f"cycles, {model:13s} {1e3 * seconds:8.1f} ms, from the settled run {distance(found):.1e}")
    print(f"{'V [mm/s]':>9s} {'end [deg]':>16s} {'by':>6s} {'runs: apart':>12s}")
    for velocity in VELOCITIES[3:5] if options.short else VELOCITIES:
        # A stiff axis on which the slow motion holds at every velocity.
        scene = FIG3.replace(drive={"velocity": velocity}, system={"stiffness_y": 1e10})
        at, is_fold = end_of_stick_slip(scene, 0.5, 25.0)
        agreement, goes_on = "", []
        if not is_fold:
            goes_on = [swings(scene, at, at * (1.0 + side * BESIDE)) for side in (-1, 1)]
        elif options.folds:
            goes_on = [lasts(scene, at * (1.0 + side * BESIDE)) for side in (-1, 1)]
        if goes_on:
            agreement = f"< {BESIDE:.0e}" if goes_on == [True, False] else f"no: {goes_on}"
        kind = "fold" if is_fold else "swing"
        print(f"{1e3 * velocity:9g} {at:16.12f} {kind:>6s} {agreement:>12s}")


def end_of_stick_slip(scene: ds.Scene, low: float, high: float) -> tuple[float, bool]:
    """The angle [deg] between two from which on no stable cycle of the slow motion swings by 5 % of F_0, and whether it is a fold."""

    def cycles(angle: float) -> ds.Cycles:
        return ds.cycles(scene.replace(misalignment_deg=angle), model="low_frequency")

    while high - low > 1e-13 * high:
        middle = 0.5 * (low + high)
        goes_on = any(cycle.swing >= LEAST for cycle in cycles(middle).stable)
        low, high = (middle, high) if goes_on else (low, middle)
    return high, bool(cycles(high * (1.0 - 1e-6)).unstable)


def timed(call) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def distance(found: ds.Cycles) -> float:
    """Largest relative difference of period, peak and valley between the stable cycle and the last cycle of a settled run."""
    cycle = found.stable[-1]
    system, friction = {}, {}
    if found.model == "low_frequency":
        system, friction = {"stiffness_y": None}, {"contact": None}
    run = ds.run(
        FIG3,
        scene={"model": found.model, "t_end": 60.0, "settle": 1e-10},
        system=system,
        friction=friction,
        integrator={"method": "radau13", "rtol": 1e-12},
        output={"interval": 60.0},
    )
    names = ("period", "peak_force", "valley_force")
    return max(abs(getattr(cycle, name) / run.summary[name] - 1.0) for name in names)


def slow_scene(scene: ds.Scene, angle: float, valley: float, t_end: float) -> ds.Scene:
    """The slow motion from a valley of the load, at an angle [deg]."""
    return scene.replace(
        scene={"model": "low_frequency", "t_end": t_end},
        system={"stiffness_y": None, "misalignment_deg": angle},
        friction={"contact": None},
        initial={"elongation_x": valley / STIFFNESS, "velocity_ratio": 1.0},
        integrator={"method": "radau13", "rtol": 1e-12},
        output={"interval": t_end},
    )


def swings(scene: ds.Scene, at: float, angle: float) -> bool:
    """Whether runs at an angle near the end `at`, which begin near the cycle at the end, settle to a swing that counts."""
    cycle = ds.cycles(scene.replace(system={"misalignment_deg": at}), model="low_frequency").stable[-1]
    begun = slow_scene(scene, angle, cycle.valley_force - 0.01 * LEAST, MOST_CYCLES * cycle.period)
    return ds.run(begun, scene={"settle": 1e-10}).summary["swing"] > LEAST


def lasts(scene: ds.Scene, angle: float) -> bool:
    """Whether stick-slip with a somewhat larger initial swing continues for a long time."""
    cycle = ds.cycles(
        scene.replace(system={"misalignment_deg": 0.999 * angle}), model="low_frequency"
    ).stable[-1]
    run = ds.run(
        slow_scene(scene, angle, cycle.valley_force, 2e6 * cycle.period), integrator={"max_steps": 10**9}
    )
    return run.summary["swing"] > 0.5 * cycle.swing


if __name__ == "__main__":
    main()
