"""How to divide a sweep among processes: dealt out by rank 0 during the sweep, or divided beforehand; for readers to repeat.

    python bench/dealing.py [simulate] [maps] [real] [--exe EXE] [--mpi EXE --launcher "mpirun --oversubscribe"] [--short]

Four divisions. deal: rank 0 gives pieces of the list in order, as src/app/dealer.f90 does. stride: process I
of N has every N-th case. shuffled: the same with case numbers in a fixed random order. turned: every process has one of each N
successive cases, and which one changes by the golden ratio, as for --shard in src/sweep/division.f90.

The number is the loss: the time at which the last process ends over the mean time that processes spend in cases, minus 1.
simulate: 2 to 10^4 processes, 10 to 10^5 cases of 10 ms on average for each process. Costs are equal; log-uniform over a factor of
1000; 1000 times as large in one of ten cases, at the end of the list; or, in a grid with as many columns as processes,
log-uniform over the columns. maps: measured costs of the sweeps in inputs/ with shorter durations. real: 2 to 64 processes on
this machine, and the processor time of all over that of one. Here the time of a process is the sum of `wall_time` of its cases,
which includes the time of other processes if there are fewer cores than processes: `solo` uses the time of each case alone.
"""

import argparse
import heapq
import os
import resource
import shlex
import struct
import subprocess
import tempfile
from collections import deque
from pathlib import Path

import h5py
import numpy as np

INPUTS = Path(__file__).parents[1] / "inputs"
ALLOWED = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMP_NUM_THREADS": "1"}
MEAN = 1.0e-2  # s
# From src/app/sweep_work.f90 (the first) and src/app/dealer.f90.
LOOK, AHEAD, PIECE, MESSAGE, MOST, PART = 5.0e-4, 2.0e-3, 5.0e-3, 5.0e-5, 512, 4
# Processor time of rank 0 for a question [s]: bench_dealer.
ANSWER = 1.0e-5
# Largest numbers of cases in a simulation, and of questions to rank 0.
MOST_CASES, MOST_QUESTIONS = 10_000_000, 500_000


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", default=["simulate", "maps", "real"])
    parser.add_argument("--exe", default="dynstiction")
    parser.add_argument("--mpi", help="program built with MPI, for `real`")
    parser.add_argument("--launcher", default="mpirun.openmpi --oversubscribe --bind-to none")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "simulate" in options.parts:
            simulate(options.short)
        if "maps" in options.parts:
            print_maps(folder, options.exe, options.short)
        if "real" in options.parts:
            print_real(folder, options)


class Rank:
    """Work of rank r: pieces (first case, end, time at which it begins), and its recent speed."""

    def __init__(self) -> None:
        self.pieces: deque[tuple[int, int, float]] = deque()
        self.free = 0.0
        self.rate, self.since, self.done, self.done_then = 1.0 / PIECE, 0.0, 0, 0


def deal(costs: np.ndarray, ranks: int) -> float:
    """Loss of dealing: an event is an answer to a rank that asked."""
    before = np.concatenate([[0.0], np.cumsum(costs)])
    cases, given, server = len(costs), 0, 0.0
    all_ranks = [Rank() for _ in range(ranks)]
    questions = [(0.0, r) for r in range(ranks)]
    while given < cases:
        asked, r = heapq.heappop(questions)
        rank = all_ranks[r]
        wanted = max(1, round(rank.rate * max(PIECE, ranks * MESSAGE)))
        now = asked
        if r > 0:
            server = now = max(asked + LOOK, server + ANSWER)
        left = cases - given
        piece = min(left, wanted, MOST, max(1, left // (PART * ranks)))
        # The work finished so far, and the speed.
        while rank.pieces and end_of(rank.pieces[0], before) <= now:
            first, last, _ = rank.pieces.popleft()
            rank.done += last - first
        done = rank.done
        if rank.pieces:
            first, _, begun = rank.pieces[0]
            done += int(np.searchsorted(before, before[first] + now - begun, "right")) - 1 - first
        if done > rank.done_then and now > rank.since:
            rank.rate = (done - rank.done_then) / (now - rank.since)
            rank.since, rank.done_then = now, done
        rank.pieces.append((given, given + piece, max(now, rank.free)))
        given += piece
        rank.free = end_of(rank.pieces[-1], before)
        heapq.heappush(questions, (next_question(rank, before, now), r))
    return max(rank.free for rank in all_ranks) / (before[-1] / ranks) - 1.0


def end_of(piece: tuple[int, int, float], before: np.ndarray) -> float:
    first, last, begun = piece
    return begun + float(before[last] - before[first])


def next_question(rank: Rank, before: np.ndarray, now: float) -> float:
    """Time at which the remaining cases last less than `ahead` and a case has ended, or at which no case is left."""
    few = int(rank.rate * AHEAD)
    beginnings = []
    for first, last, begun in reversed(rank.pieces):
        count = min(last - first, few + 1 - len(beginnings))
        beginnings += [
            begun + float(before[i] - before[first]) for i in range(last - 1, last - 1 - count, -1)
        ]
        if len(beginnings) > few:
            break
    first, _, begun = rank.pieces[0]
    running = max(first, int(np.searchsorted(before, before[first] + now - begun, "right")) - 1)
    finished = begun + float(before[running + 1] - before[first])
    return max(now, beginnings[-1], min(max(finished, now + LOOK), beginnings[0]))


def stride(costs: np.ndarray, ranks: int) -> float:
    padded = np.append(costs, np.zeros(-len(costs) % ranks))
    return float(padded.reshape(-1, ranks).sum(0).max() * ranks / costs.sum()) - 1.0


def turned(costs: np.ndarray, ranks: int) -> float:
    rows = np.append(costs, np.zeros(-len(costs) % ranks)).reshape(-1, ranks)
    turn = np.arange(len(rows), dtype=np.int64) * 2654435769 % 2**32 * ranks // 2**32
    places = (np.arange(ranks) - turn[:, None]) % ranks
    return stride(np.take_along_axis(rows, places, 1).ravel(), ranks)


def shuffled(costs: np.ndarray, ranks: int) -> float:
    return stride(np.random.default_rng(1).permutation(costs), ranks)


def shuffled_many(costs: np.ndarray, ranks: int, each: int) -> float:
    """Loss for more cases than fit into memory: sums of many such costs have a normal distribution."""
    sums = np.random.default_rng(1).normal(each * costs.mean(), np.sqrt(each) * costs.std(), ranks)
    return float(sums.max() / sums.mean()) - 1.0


def costs_of(kind: str, ranks: int, each: int) -> np.ndarray:
    """Costs [s] of all cases in the order of their numbers."""
    generator = np.random.default_rng(2)
    cases = ranks * each
    if kind == "equal":
        costs = np.ones(cases)
    elif kind == "log-uniform":
        costs = 1000.0 ** generator.random(cases)
    elif kind == "expensive last":
        costs = np.where(np.arange(cases) < cases - cases // 10, 1.0, 1000.0)
    else:
        costs = np.tile(1000.0 ** generator.random(ranks), each)
    return costs * (MEAN / costs.mean())


KINDS = ("equal", "log-uniform", "expensive last", "in step")


def simulate(short: bool) -> None:
    print("simulated loss [%]: deal, stride, shuffled, turned (nan: too many to simulate)")
    for kind in KINDS:
        for ranks in (2, 16) if short else (2, 8, 64, 1000, 10_000):
            for each in (10, 100) if short else (10, 100, 1000, 10_000, 100_000):
                cases = ranks * each
                costs = costs_of(kind, ranks, min(each, MOST_CASES // ranks))
                losses = [np.nan, np.nan, shuffled_many(costs, ranks, each), np.nan]
                if cases <= MOST_CASES:
                    losses = [np.nan, stride(costs, ranks), shuffled(costs, ranks), turned(costs, ranks)]
                if cases / max(1.0, ranks * MESSAGE / MEAN) <= MOST_QUESTIONS:
                    losses[0] = deal(costs, ranks)
                show(f"{kind:>14} {ranks:6} x {each:6}", losses)


def show(title: str, losses: list[float], ratio: float | None = None) -> None:
    words = [f"{100 * loss:8.2f}" for loss in losses]
    if ratio:
        words.append(f"{ratio:.2f}")
    print(f"{title}: " + " ".join(words), flush=True)


def run(command: list[str], **settings: str) -> None:
    subprocess.run(command, check=True, env=os.environ | ALLOWED | settings)


def measured_costs(folder: Path, exe: str, short: bool) -> dict[str, np.ndarray]:
    """Seconds of each case of the maps in inputs/, run by one thread for a part of their duration."""
    part = 0.002 if short else 0.1
    found = {}
    for deck in sorted(INPUTS.glob("map_*.nml")):
        copy = folder / deck.name
        text = deck.read_text()
        points = deck.with_suffix(".csv")
        settings = ["--set", f"scene.t_end={8.0 * part}"]
        if points.exists():
            settings = []
            head, *rows = points.read_text().split()
            place = head.split(",").index("scene.t_end")
            table = [row.split(",") for row in rows]
            for row in table:
                row[place] = repr(part * float(row[place]))
            (folder / points.name).write_text("\n".join([head, *map(",".join, table)]))
        copy.write_text(text)
        output = folder / "costs.h5"
        run([exe, "run", str(copy), "-o", str(output), "--quiet", "--overwrite", *settings])
        with h5py.File(output) as file:
            found[deck.stem] = file["sweep/wall_time"][:]
    return found


def print_maps(folder: Path, exe: str, short: bool) -> None:
    print("loss with measured costs [%]: deal, stride, shuffled, turned")
    for name, costs in measured_costs(folder, exe, short).items():
        print(
            f"{name}: {len(costs)} cases, {costs.mean():.1e} s on average, longest {costs.max() / costs.mean():.1f} times that, "
            f"standard deviation {costs.std() / costs.mean():.1f} times"
        )
        for ranks in (2, 4, 8, 16, 25, 32, 64):
            losses = [deal(costs, ranks), *(way(costs, ranks) for way in (stride, shuffled, turned))]
            show(f"{name:>18} {ranks:6}", losses)


def print_real(folder: Path, options: argparse.Namespace) -> None:
    scene = (INPUTS / "low_frequency.nml").read_text()
    share = 20 if options.short else 1
    print(
        "real processes: largest sum of wall times over the mean, minus 1 [%]; the same of solo times; "
        "processor time of all over that of one process"
    )
    for kind in ("equal", "log-uniform", "expensive last"):
        costs = costs_of(kind, 64 // share, 10)
        deck, points = folder / "real.nml", folder / "points.csv"
        deck.write_text(scene + "&sweep points = 'points.csv' /\n")
        # Costs are proportional to durations; 100 s of sliding take some milliseconds.
        points.write_text("\n".join(["scene.t_end", *(f"{100.0 * cost / MEAN:.6g}" for cost in costs)]))
        single, _ = processes(folder, deck, [[options.exe, "run"]], None)
        solo = solo_of(folder)
        for count in (2, 4) if options.short else (2, 8, 64):
            ways = {"shards": [[options.exe, "run", "--shard", f"{i + 1}/{count}"] for i in range(count)]}
            if options.mpi:
                ways["deal"] = [[*shlex.split(options.launcher), "-n", str(count), options.mpi, "run"]]
            for way, commands in ways.items():
                used, sums = processes(folder, deck, commands, solo)
                show(f"{kind:>14} {count:3} {way:>7}", sums, used / single)


def processes(
    folder: Path, deck: Path, commands: list[list[str]], solo: dict[int, float] | None
) -> tuple[float, list[float]]:
    """Processor time of all [s], and the losses from the wall times and from the solo times of the cases of each process."""
    for file in folder.glob("real.h5*"):
        file.unlink()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    rest = [str(deck), "-o", str(folder / "real.h5"), "--quiet", "--keep-shards"]
    running = [subprocess.Popen([*command, *rest], env=os.environ | ALLOWED) for command in commands]
    if any([process.wait() for process in running]):
        raise SystemExit(f"failed: {commands[0]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    done = [records(file) for file in sorted(folder.glob("real.h5.shard-*"))]
    sums = [np.array([sum(cases.values()) for cases in done])]
    if solo:
        sums.append(np.array([sum(solo[case] for case in cases) for cases in done]))
    return used, [float(each.max() / each.mean()) - 1.0 for each in sums]


def solo_of(folder: Path) -> dict[int, float]:
    return {
        case: seconds for file in folder.glob("real.h5.shard-*") for case, seconds in records(file).items()
    }


HEADER_BYTES = 96


def records(shard: Path) -> dict[int, float]:
    """Wall time of each case in a shard [s]: the last value of a record, before its checksum."""
    data, place, found = shard.read_bytes(), HEADER_BYTES, {}
    while place < len(data):
        case, _, length = struct.unpack_from("<iii", data, place)
        found[case] = struct.unpack_from("<d", data, place + 8 * length - 16)[0]
        place += 8 * length
    return found


if __name__ == "__main__":
    main()
