"""Compile the core with another Fortran compiler, and run its unit tests.

    python tools/second_compiler.py COMPILER, for example flang-new-19

All layers below the result file are compiled, in the order of use; the modules of HDF5 and MPI fit only one compiler. Tests that
need the other layers, or functions in quadruple precision, which LLVM 19 does not have, are left out. Prints the first file that
does not compile, or a last line `N files compiled, N test programs passed, N failed`.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SRC = ROOT / "src"
UNIT = ROOT / "tests" / "unit"
WITH_HDF5_OR_MPI = ("file", "app")
NOT_HERE = ("test_creep", "test_deck")
SHARED_BY_TESTS = ("checks", "random_numbers", "scenes")


def in_order_of_use(sources: list[Path]) -> list[Path]:
    modules: dict[str, Path] = {}
    uses: dict[Path, list[str]] = {}
    for source in sources:
        text = source.read_text(encoding="utf-8")
        modules.update({name: source for name in re.findall(r"^module (dst_\w+)", text, re.MULTILINE)})
        uses[source] = re.findall(r"^ *(?:use |submodule\()(dst_\w+)", text, re.MULTILINE)
    ordered: dict[Path, None] = {}

    def take(source: Path) -> None:
        if source not in ordered:
            for module in uses[source]:
                take(modules[module])
            ordered[source] = None

    for source in sources:
        take(source)
    return list(ordered)


def core_tests() -> Iterable[Path]:
    rows = re.findall(
        r"^  '(\w+)': core_dep,$", (UNIT / "meson.build").read_text(encoding="utf-8"), re.MULTILINE
    )
    return (UNIT / f"test_{name}.f90" for name in rows if f"test_{name}" not in NOT_HERE)


def main(compiler: str) -> int:
    with tempfile.TemporaryDirectory() as folder:

        def run(*command: str | Path) -> bool:
            return subprocess.run(command, cwd=folder, stdout=subprocess.DEVNULL, check=False).returncode == 0

        precision = Path(folder) / "precision.f90"
        kind = (SRC / "base" / "precision.f90.in").read_text(encoding="utf-8").replace("@kind@", "real64")
        precision.write_text(kind, encoding="utf-8")
        rooms = [path for path in sorted(SRC.glob("*/*.f90")) if path.parent.name not in WITH_HDF5_OR_MPI]
        sources = in_order_of_use([precision, *rooms]) + [UNIT / f"{name}.f90" for name in SHARED_BY_TESTS]
        for source in sources:
            if not run(compiler, "-c", "-O2", source):
                print(f"{source.name} does not compile")
                return 1
        if not run("cc", "-c", SRC / "system" / "posix.c", "-o", "posix_c.o"):
            return 1
        objects = ["posix_c.o", *(f"{source.stem}.o" for source in sources)]
        passed = [
            run(compiler, "-o", source.stem, source, *objects, "-llapack", "-lblas")
            and run(f"./{source.stem}")
            for source in core_tests()
        ]
    failed = passed.count(False)
    print(f"{len(sources)} files compiled, {passed.count(True)} test programs passed, {failed} failed")
    return int(failed > 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("compiler")
    sys.exit(main(parser.parse_args().compiler))
