"""Write docs/file.md, the manual page of the result file, from files that the program writes.

    python docs/make_file_page.py [EXECUTABLE]

Names, types, units and meanings are read from the files of a short run and a small sweep; only texts that are not in these
files are in this script.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np

FOLDER = Path(__file__).resolve().parent
DECK = FOLDER.parent / "inputs" / "fig3.nml"

INTRODUCTION = """\
# The result file

<!-- Made by docs/make_file_page.py from files that the program writes: change the program or the script, not this page. -->

An HDF5 file in the format of HDF5 1.8; the executable and `Result.save` write the same. With other programs than Python: [howto/read_files.md](howto/read_files.md).

* Texts are variable-length UTF-8. Numbers are 64-bit floats, if the type is not given below.
* Every dataset has the attributes `units` and `long_name`. `/time_series/time` is the dimension scale of the other columns.
* The last sample is at `t_end` exactly. Behind HDF5's end are the state of a run that can be resumed and a checksum of the whole
  file: [checkpoints.md](checkpoints.md).
"""

ROOT = {
    "program": "`dynstiction`, or `dynstiction-quad` of the build in quadruple precision",
    "version": "its version",
    "git_revision": "its source",
    "compiler": "what built it",
    "build_flags": "with which flags",
    "host": "machine",
    "job": "job of the scheduler (Slurm, PBS, LSF), or empty",
    "threads": "of the process",
    "created": "when the run began, ISO 8601, UTC",
    "deck_sha256": "SHA-256 of the deck as read",
    "model": "model that was integrated",
    "model_choice": "with `model = 'auto'`: which model was taken, and why",
    "method": "method of integration; `closed form` for the models that have one",
    "result_code": "0: done; else why the run ended: [errors.md](errors.md)",
    "result_text": "the same in words",
    "complete": "1 when the run reached its end; written last",
}

GROUPS = {
    "deck": "`text` is the deck as read, `resolved` the deck with every key as used.",
    "parameters": "Every [key of the deck](deck.md) with a number, as used, with its unit and meaning.",
    "time_series": "The columns that `output.fields` names, one value for each sample.",
    "events": "Every stick and slip, whether or not a sample is near. Where a motion repeats with more than 100 000 of them, they are a block: successive rows that "
    "occur `occurs` times, each time a `period` later, all of them before all of them again. `result.events_between` gives each event of an interval.",
    "summary": "Summary values of the run, of the motion between the samples too. A value that does not exist is left out, such as the mean of a cycle that did not occur. "
    "`NAME_scatter` is the standard deviation of the mean `NAME` of cycles.",
    "statistics": "Counts of the work.",
}

SWEEP = """\
## Sweeps

The file of a [sweep](sweeps.md) has, in place of `/time_series`, `/events` and `/summary`, the group `/sweep` with one row for each case, and a dataset for each
varied parameter, `/sweep/<key>`. With `keep = 'series'` or [`'cycles'`](sweeps.md#cycles), `/sweep/series` or `/sweep/cycles` has a row of samples or cycles for each
case, padded with NaN. Messages of failed cases are in `/sweep/failures`. The attribute `grid` of `/sweep` is the shape of the grid.
"""

ELSEWHERE = """\
For every column, the file of `dynstiction-quad` also has `/remainder/time_series/<name>`, the difference of the quadruple number from the double.
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("executable", nargs="?", default="dynstiction", help="default: the one on PATH")
    executable = parser.parse_args().executable
    with tempfile.TemporaryDirectory() as folder:
        run = written(executable, Path(folder) / "run.h5", "--set", "scene.t_end=5")
        sweep = written(
            executable, Path(folder) / "sweep.h5", "--set", "scene.t_end=0.02", "--set", "sweep.parameter=drive.velocity",
            "--set", "sweep.first=1e-3", "--set", "sweep.last=2e-3", "--set", "sweep.count=2", "--set", "sweep.keep=cycles",
        )  # fmt: skip
        with h5py.File(run) as file, h5py.File(sweep) as cases:
            parts = [INTRODUCTION, root(file)]
            for name, meaning in GROUPS.items():
                parts.append(
                    f"## /{name}\n\n{meaning}\n\n{'' if name in ('deck', 'parameters') else rows(file[name])}".rstrip()
                    + "\n"
                )
            parts += [
                SWEEP,
                rows(cases["sweep"], skip=("velocity",)),
                "`summary/NAME` has the values of `/summary`, and\n",
                rows(cases["sweep/summary"], "summary/", skip=tuple(file["summary"])),
                "`cycles/NAME` has period, peak and valley forces, durations and slip length of single cycles, and\n",
                rows(cases["sweep/cycles"], "cycles/", skip=tuple(file["summary"])),
                ELSEWHERE,
            ]
    (FOLDER / "file.md").write_text("\n".join(parts), encoding="utf-8")


def written(executable: str, file: Path, *settings: str) -> Path:
    subprocess.run([executable, "run", str(DECK), "-o", str(file), "--quiet", *settings], check=True)
    return file


def root(file: h5py.File) -> str:
    missing = set(file.attrs) - set(ROOT)
    if missing:
        sys.exit(f"attributes without a meaning in ROOT: {', '.join(sorted(missing))}")
    lines = ["## Attributes of the file", "", "| attribute | meaning |", "| --- | --- |"]
    return "\n".join([*lines, *(f"| `{name}` | {meaning} |" for name, meaning in ROOT.items()), ""])


def rows(found: h5py.Group, prefix: str = "", skip: tuple[str, ...] = ()) -> str:
    lines = ["| dataset | meaning |", "| --- | --- |"]
    for name, dataset in found.items():
        if not isinstance(dataset, h5py.Dataset) or name in skip or name.endswith("_scatter"):
            continue
        unit = dataset.attrs.get("units", "1")
        notes = ", ".join(note for note in (kind(dataset), "" if unit == "1" else f"[{unit}]") if note)
        meaning = dataset.attrs["long_name"].replace("|", chr(92) + "|")
        lines.append(f"| `{prefix}{name}` {notes}".rstrip() + f" | {meaning} |")
    return "\n".join([*lines, ""])


def kind(dataset: h5py.Dataset) -> str:
    """The type, if it is not a 64-bit float."""
    if h5py.check_string_dtype(dataset.dtype):
        return "text"
    name = {"f": "float", "i": "integer"}[np.dtype(dataset.dtype).kind] + str(8 * dataset.dtype.itemsize)
    return "" if name == "float64" else name


if __name__ == "__main__":
    main()
