"""Runs the whole extremes matrix and counts how its cells end: the tables of tests/extremes/README.md.

python tests/extremes/census.py [--workers N] [--singles]
"""

from __future__ import annotations

import argparse
import collections
import multiprocessing
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))

from invariants import Ending, finish
from matrix import KINDS, Cell, cells

CODES = {0: "result", 2: "refused", 42: "max_steps", 43: "not finite", 44: "rejections", 45: "chattering", 75: "hangs"}


def end_of(cell: Cell) -> tuple[Cell, Ending, float]:
    began = time.monotonic()
    ending = finish(cell.groups())
    ending.result = None
    return cell, ending, time.monotonic() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--singles", action="store_true", help="leave the pairs out")
    arguments = parser.parse_args()
    todo = [*cells(pairs=False), *([] if arguments.singles else cells(pairs=True))]
    counts: collections.Counter[tuple[str, int | str]] = collections.Counter()
    slowest = 0.0
    with multiprocessing.Pool(arguments.workers) as pool:
        for cell, ending, seconds in pool.imap_unordered(end_of, todo, chunksize=16):
            counts[cell.kind.name, ending.code] += 1
            counts[cell.kind.name, "faults"] += bool(ending.faults)
            slowest = max(slowest, seconds)
            for fault in ending.faults:
                print(f"FAULT {cell.name}: {fault}", flush=True)
            if ending.code not in {0, 2, 42}:
                print(f"{ending.code} {cell.name}: {ending.text}", flush=True)
    columns: list[int | str] = [*CODES, "faults"]
    print(f"\n{len(todo)} cells, the longest {slowest:.2f} s\n", file=sys.stderr)
    print("| model and method | " + " | ".join(str(CODES.get(c, c)) for c in columns) + " |")  # type: ignore[call-overload]
    print("| --- |" + " --- |" * len(columns))
    for kind in KINDS:
        print(f"| {kind.name} | " + " | ".join(str(counts[kind.name, c] or "") for c in columns) + " |")


if __name__ == "__main__":
    main()
