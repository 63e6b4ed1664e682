"""Cost of the low-frequency model and its differences from the full one, for readers to repeat.

    python bench/models.py [--runs N] [--exe PATH] [--short]

Prints, for Fig. 3 at rtol 1e-6, the solver's wall time of both models, the full one with and without the cycle map (median of N
alternating runs), the instructions for 10 s if valgrind is installed (from two lengths of the run, so that start, tables of the map
and output cancel), and the differences of the summary values.
"""

import argparse
import re
import shutil
import statistics
import subprocess
import tempfile
from pathlib import Path

import h5py

ROOT = Path(__file__).resolve().parent.parent
DECKS = {"full": "fig3", "full, map off": "fig3", "low_frequency": "low_frequency"}
QUANTITIES = (
    "period",
    "peak_force",
    "valley_force",
    "slip_length",
    "max_X_rate",
    "stick_duration",
    "slip_duration",
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=11, help="number of runs for a median")
    parser.add_argument("--exe", default=shutil.which("dynstiction") or ROOT / ".venv/bin/dynstiction")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    if options.short:
        options.runs = 1
    with tempfile.TemporaryDirectory() as folder:
        times: dict[str, list[float]] = {model: [] for model in DECKS}
        for _ in range(options.runs):
            for model in DECKS:
                times[model].append(run(options.exe, Path(folder), model)["wall_time"])
        for model, values in times.items():
            print(
                f"{model:14} {1e3 * statistics.median(values):9.3f} ms for 10 s, least {1e3 * min(values):.3f} ms"
            )
        full, direct, low = (statistics.median(times[model]) for model in DECKS)
        print(f"ratio {full / low:.0f}, without the map {direct / low:.0f}")
        if shutil.which("valgrind") and not options.short:
            full, direct, low = (instructions(options.exe, Path(folder), model) for model in DECKS)
            print(
                f"instructions for 10 s: {full:.3e}, {direct:.3e} and {low:.3e}, ratios {full / low:.0f} and {direct / low:.0f}"
            )
        full_run, _, low_run = (run(options.exe, Path(folder), model) for model in DECKS)
        for name in QUANTITIES:
            print(
                f"{name:15} {full_run[name]:.6g} {low_run[name]:.6g} {100 * (low_run[name] / full_run[name] - 1):+.3f} %"
            )


def run(exe: str, folder: Path, model: str) -> dict[str, float]:
    """Summary and statistics of one run."""
    subprocess.run(command(exe, folder, model, 10.0), check=True)
    with h5py.File(folder / "run.h5") as file:
        return {
            name: float(value[()])
            for group in ("summary", "statistics")
            for name, value in file[group].items()
        }


def command(exe: str, folder: Path, model: str, t_end: float) -> list[str]:
    settings = ["integrator.rtol=1e-6", f"scene.t_end={t_end}", f"output.interval={t_end}"]
    if model == "full, map off":
        settings.append("integrator.cycle_map=off")
    return [
        *(str(exe), "run", str(ROOT / "inputs" / f"{DECKS[model]}.nml"), "-o", str(folder / "run.h5")),
        *("--overwrite", "--quiet"),
        *(word for setting in settings for word in ("--set", setting)),
    ]


def instructions(exe: str, folder: Path, model: str) -> float:
    """Instructions for 10 s of the motion."""
    spans = (100.0, 1000.0) if model == "low_frequency" else (2.0, 12.0)
    counts = []
    for t_end in spans:
        tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder / 'callgrind'}"]
        finished = subprocess.run(
            [*tool, *command(exe, folder, model, t_end)], check=True, capture_output=True, text=True
        )
        # The child processes that flush the file are counted separately.
        counts.append(max(int(count) for count in re.findall(r"Collected : (\d+)", finished.stderr)))
    return (counts[1] - counts[0]) / (spans[1] - spans[0]) * 10.0


if __name__ == "__main__":
    main()
