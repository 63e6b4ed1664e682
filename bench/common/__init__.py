"""What the benchmarks share: their arguments, the program and what a process costs, random scenes."""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import dynstiction as ds
import numpy as np

T = TypeVar("T")

ROOT = Path(__file__).resolve().parents[2]
INPUTS = ROOT / "inputs"
FIG3 = INPUTS / "fig3.nml"
PROGRAM = shutil.which("dynstiction") or str(ROOT / ".venv" / "bin" / "dynstiction")

RANGES = {"mass": (1e-4, 10.0), "k_y": (1e5, 1e10), "phi": (0.05, 30.0), "V": (1e-5, 0.1), "v_f": (1e-4, 1.0)}
"""Of random scenes: kg, N/m, degrees, m/s, m/s."""


def options_of(doc: str | None, *words: str, **usual: Any) -> argparse.Namespace:
    """Options of a benchmark, each with its usual value, or a pair of it and that with --short; False is a flag. `words` may be named first."""
    # Benchmarks do not look at coarse samples, and want no note of them.
    warnings.simplefilter("ignore", ds.SamplingWarning)
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if words:
        parser.add_argument("words", nargs="*", metavar="|".join(words))
    for name, value in usual.items():
        option = f"--{name.replace('_', '-')}"
        if value is False:
            parser.add_argument(option, action="store_true")
        else:
            first = value[0] if isinstance(value, tuple) else value
            parser.add_argument(option, type=type(first), help=f"default: {first}")
    parser.add_argument("--short", action="store_true", help="a few seconds, to check that it runs")
    given = parser.parse_args()
    if words:
        given.words = given.words or words
        if unknown := set(given.words) - set(words):
            parser.error(f"{', '.join(unknown)}: only {', '.join(words)}")
    for name, value in usual.items():
        if getattr(given, name) is None:
            setattr(given, name, value[given.short] if isinstance(value, tuple) else value)
    return given


class Cost(NamedTuple):
    """Wall time and processor time [s] of a process."""

    wall: float
    processor: float


def program(
    command: str, deck: Path, output: Path, *words: str, threads: int | None = None, **settings: object
) -> Cost:
    """Run the program without a word; settings are those of --set, as `**{"scene.t_end": 1.0}`."""
    environment = os.environ | ({} if threads is None else {"OMP_NUM_THREADS": str(threads)})
    given = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    line = [PROGRAM, command, deck, "-o", output, "--overwrite", "--quiet", *given, *words]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(line, check=True, env=environment, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Cost(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def timed(call: Callable[[], T], times: int) -> tuple[list[float], list[T]]:
    """Wall times of calls [s], and their results."""
    seconds, results = [], []
    for _ in range(times):
        begun = time.perf_counter()
        results.append(call())
        seconds.append(time.perf_counter() - begun)
    return seconds, results


def largest_memory() -> float:
    """Of any process that has ended [MB]."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def random_values(
    seed: int, number: int, ranges: Mapping[str, tuple[float, float]] = RANGES
) -> dict[str, float]:
    """Log-uniform within ranges."""
    random = np.random.default_rng([seed, number])
    return {name: float(10.0 ** random.uniform(*np.log10(bounds))) for name, bounds in ranges.items()}


def duration(values: Mapping[str, float]) -> float:
    """Of a random scene: five slow or 1500 fast periods, whichever is shorter [s]."""
    scene = ds.Scene(FIG3)
    slow = scene.friction.mu_0 * scene.friction.normal_load / (scene.system.stiffness_x * values["V"])
    return float(min(5.0 * slow, 1500.0 * 2.0 * np.pi * np.sqrt(values["mass"] / values["k_y"])))


def progress(items: Sequence[T], what: str) -> Iterator[T]:
    """The items, with a line of progress from time to time."""
    due = time.monotonic() + 10.0
    for i, item in enumerate(items):
        if time.monotonic() > due:
            due = time.monotonic() + 10.0
            print(f"{i} of {len(items)} {what}", file=sys.stderr, flush=True)
        yield item
