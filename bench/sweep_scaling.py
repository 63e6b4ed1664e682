"""How well sweeps use the cores, and the needs of a large one, for readers to repeat.

    python bench/sweep_scaling.py [efficiency] [full] [million] [shares] [--file FILE.h5] [--repeat 3] [--short]

efficiency: two threads compared with one; cases with equal costs, and with costs that differ by a factor of 1000, the expensive
ones in a row. full: a map of model `full` compared with single runs. million: a summary sweep of a million cases, in two shares,
and its merge. shares: by how much the last share ends later than with ideal dealing, which keeps all processes busy until the end or
until the longest case ends; beside it that of contiguous blocks of cases; from /sweep/wall_time of FILE, by default of 1000 cases of
model `full` with other misalignments and velocities.

The efficiency consists of two numbers that do not depend on other work of the machine: `busy`, the share of the wall time of all
cores that was spent in cases, from the start of the program to its end, and `cpu`, the processor time of one thread over that of
all. `wall` is the plain ratio of wall times over the cores, which needs a quiet machine. Medians, and the range in brackets.
"""

import tempfile
from pathlib import Path
from statistics import median

import h5py
import numpy as np
from common import FIG3, INPUTS, largest_memory, options_of, program

SCENE = (INPUTS / "low_frequency.nml").read_text()
CORES = 2


def main() -> None:
    options = options_of(
        __doc__,
        "efficiency",
        "full",
        "million",
        "shares",
        file="",
        repeat=(3, 1),
        part=(1, 20),
        t_end=(2.0, 0.05),
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        deck, output = folder / "deck.nml", folder / "deck.h5"
        if "efficiency" in options.words:
            # 600 cases of some milliseconds; or 60 that cost 1000 times as much as the other 540.
            for title, ends in (("equal", [300.0] * 600), ("1000 times", [3000.0] * 60 + [3.0] * 540)):
                (folder / "points.csv").write_text(
                    "\n".join(["scene.t_end", *map(str, ends[:: options.part])])
                )
                deck.write_text(SCENE + "&sweep points = 'points.csv' /\n")
                print_efficiency(f"low_frequency, costs {title}", deck, output, options.repeat)
        if "full" in options.words:
            print_full(deck, output, options.repeat, 40 // options.part)
        if "million" in options.words:
            print_million(deck, output, 1000 // options.part)
        if "shares" in options.words:
            if not options.file:
                grid = (
                    "--vary",
                    "system.misalignment_deg=0.5:20:40",
                    "--vary",
                    "drive.velocity=0.5e-3:5e-3:25",
                )
                program("sweep", FIG3, output, *grid, threads=1, **{"scene.t_end": options.t_end})
            print_shares(Path(options.file or output))


def print_efficiency(title: str, deck: Path, output: Path, repeat: int) -> None:
    measured: dict[int, list[tuple[float, float, float]]] = {1: [], CORES: []}
    for _ in range(repeat):
        for threads, found in measured.items():
            wall, cpu = program("run", deck, output, threads=threads)
            with h5py.File(output) as file:
                in_cases = float(file["sweep/wall_time"][:].sum())
            found.append((wall, cpu, in_cases / wall / threads))
    print(f"{title}: {repeat} runs of each, alternating")
    for threads, found in measured.items():
        pairs = list(zip(measured[1], found, strict=True))
        print(
            f"{threads} threads: {median(many[0] for many in found):7.2f} s, busy {spread([many[2] for many in found])}, "
            f"cpu {spread([one[1] / many[1] for one, many in pairs])}, wall {spread([one[0] / (threads * many[0]) for one, many in pairs])}",
            flush=True,
        )


def spread(values: list[float]) -> str:
    return f"{median(values):.3f} [{min(values):.3f}, {max(values):.3f}]"


def print_full(deck: Path, output: Path, repeat: int, count: int) -> None:
    """A map of angles, and the same cases as separate runs that write the same summary."""
    angles = np.linspace(0.5, 0.25 + 0.25 * count, count)
    varied = (
        f"&sweep parameter = 'system.misalignment_deg', first = 0.5, last = {angles[-1]}, count = {count} /\n"
    )
    deck.write_text(FIG3.read_text() + varied)
    print_efficiency("full", deck, output, repeat)
    totals = []
    for _ in range(repeat):
        singles = [
            program(
                "run", FIG3, output, threads=1, **{"system.misalignment_deg": angle, "output.interval": 10}
            ).processor
            for angle in angles
        ]
        totals.append(program("run", deck, output, threads=CORES).processor / sum(singles))
    print(
        f"full: processor time of the map in {CORES} threads over that of {count} single runs: {spread(totals)}"
    )


def print_million(deck: Path, output: Path, side: int) -> None:
    cases = side**2
    deck.write_text(
        SCENE.replace("t_end = 10.0", "t_end = 0.02")
        + "&sweep parameter = 'system.misalignment_deg', 'drive.velocity', first = 1.0, 1e-3, last = 8.0, 4e-3, "
        f"count = {side}, {side} /\n"
    )
    walls, cpus = zip(
        *(program("run", deck, output, "--share", f"{i}/2", threads=CORES) for i in (1, 2)), strict=True
    )
    print(
        f"{cases} cases: {sum(walls):.1f} s, {1e6 * sum(cpus) / cases:.1f} us of processor time a case, {largest_memory():.0f} MB"
    )
    wall, cpu = program("merge", deck, output, threads=1)
    with h5py.File(output) as file:
        sizes: list[int] = []
        file["sweep"].visititems(lambda _, item: sizes.append(getattr(item, "size", 0)))
    print(
        f"merge: {wall:.1f} s ({cpu:.1f} s of processor time), {largest_memory():.0f} MB at most so far; "
        f"{output.stat().st_size / sum(sizes):.2f} bytes a value"
    )


def print_shares(file: Path) -> None:
    with h5py.File(file) as opened:
        seconds = opened["sweep/wall_time"][:][opened["sweep/result_code"][:] >= 0]
    longest = seconds.max() / seconds.mean()
    print(f"{seconds.size} cases, {seconds.mean():.1e} s on average, the longest {longest:.1f} times that")
    print("processes   shares   blocks   more time than ideal dealing [%]")
    for processes in (4, 8, 16, 32, 64):
        ideal = max(seconds.sum() / processes, seconds.max())
        interleaved = max(seconds[i::processes].sum() for i in range(processes))
        blocks = max(block.sum() for block in np.array_split(seconds, processes))
        print(f"{processes:9} {100 * (interleaved / ideal - 1):8.1f} {100 * (blocks / ideal - 1):8.1f}")


if __name__ == "__main__":
    main()
