"""What the benchmarks share: their arguments, the program and what a process costs, random scenes."""

import argparse
import os
import re
import resource
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import dynstiction as ds
import numpy as np

T = TypeVar("T")

ROOT = Path(__file__).resolve().parents[2]
INPUTS = ROOT / "inputs"
FIG3 = INPUTS / "fig3.nml"
PROGRAM = shutil.which("dynstiction") or str(ROOT / ".venv" / "bin" / "dynstiction")

RANGES = {"mass": (1e-4, 10.0), "k_y": (1e5, 1e10), "phi": (0.05, 30.0), "V": (1e-5, 0.1), "v_f": (1e-4, 1.0)}
"""Of random scenes: kg, N/m, degrees, m/s, m/s."""


def parser_of(doc: str | None) -> argparse.ArgumentParser:
    """A parser with the option that every benchmark has; benchmarks do not look at coarse samples, and want no note of them."""
    warnings.simplefilter("ignore", ds.SamplingWarning)
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="a few seconds, to check that it runs")
    return parser


class Cost(NamedTuple):
    """Wall time and processor time [s] of a process."""

    wall: float
    processor: float


def words_of(command: str, deck: Path, output: Path, settings: Mapping[str, object]) -> list[str | Path]:
    given = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    return [PROGRAM, command, deck, "-o", output, "--overwrite", "--quiet", *given]


def program(
    command: str, deck: Path, output: Path, *words: str, threads: int | None = None, **settings: object
) -> Cost:
    """Run the program without a word; settings are those of --set, as `**{"scene.t_end": 1.0}`."""
    environment = os.environ | ({} if threads is None else {"OMP_NUM_THREADS": str(threads)})
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    line = [*words_of(command, deck, output, settings), *words]
    subprocess.run(line, check=True, env=environment, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Cost(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def largest_memory() -> float:
    """Of any process that has ended [MB]."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def instructions(deck: Path, output: Path, settings: Mapping[str, object]) -> float:
    """Instructions of a run, counted by valgrind; the processes that write the file are left out."""
    tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={output.with_suffix('.callgrind')}"]
    line = [*tool, *words_of("run", deck, output, settings)]
    said = subprocess.run(line, check=True, capture_output=True, text=True).stderr
    return max(float(count) for count in re.findall(r"Collected : (\d+)", said))


def random_values(
    seed: int, number: int, ranges: Mapping[str, tuple[float, float]] = RANGES
) -> dict[str, float]:
    """Log-uniform within ranges."""
    random = np.random.default_rng([seed, number])
    return {name: float(10.0 ** random.uniform(*np.log10(bounds))) for name, bounds in ranges.items()}


def progress(items: Sequence[T], what: str) -> Iterator[T]:
    """The items, with a line of progress from time to time."""
    due = time.monotonic() + 10.0
    for i, item in enumerate(items):
        if time.monotonic() > due:
            due = time.monotonic() + 10.0
            print(f"{i} of {len(items)} {what}", file=sys.stderr, flush=True)
        yield item
