"""Compile the core with another Fortran compiler: `python tools/second_compiler.py flang-new-19`, any of which takes flang's options.

Everything below the result file is compiled, in the order of use; HDF5's own modules fit one compiler only. Nothing is linked. Prints the first
file that does not compile and why, or a last line `N files compiled`.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

SRC = Path(__file__).resolve().parents[1] / "src"
WITH_HDF5_OR_MPI = ("file", "app")


def in_order_of_use(sources: list[Path]) -> list[Path]:
    modules: dict[str, Path] = {}
    uses: dict[Path, list[str]] = {}
    for source in sources:
        text = source.read_text(encoding="utf-8")
        modules.update({name: source for name in re.findall(r"^module (dst_\w+)", text, re.MULTILINE)})
        uses[source] = re.findall(r"^ *use (dst_\w+)", text, re.MULTILINE)
    ordered: dict[Path, None] = {}

    def take(source: Path) -> None:
        if source not in ordered:
            for module in uses[source]:
                take(modules[module])
            ordered[source] = None

    for source in sources:
        take(source)
    return list(ordered)


def main(compiler: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        precision = Path(folder) / "precision.f90"
        precision.write_text(
            (SRC / "base" / "precision.f90.in").read_text(encoding="utf-8").replace("@kind@", "real64"),
            encoding="utf-8",
        )
        sources = [path for path in sorted(SRC.glob("*/*.f90")) if path.parent.name not in WITH_HDF5_OR_MPI]
        ordered = in_order_of_use([precision, *sources])
        options = ("-c", "-O2", "-fopenmp", "-std=f2018", "-module-dir", folder, "-I", folder)
        for source in ordered:
            done = subprocess.run(
                [compiler, *options, "-o", f"{folder}/{source.stem}.o", source], check=False
            )
            if done.returncode:
                print(f"{source.relative_to(SRC.parent)} does not compile")
                return 1
    print(f"{len(ordered)} files compiled")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
