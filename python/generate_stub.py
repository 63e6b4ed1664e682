"""Write the types of the compiled extension as f2py makes it from one Fortran file: its stub, for type checkers.

python python/generate_stub.py python/core/python_api.f90 python/dynstiction/_core.pyi
"""

import argparse
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from numpy.f2py import crackfortran

SCALARS = {"integer": "int", "real": "float", "character": "bytes"}
ARRAYS = {"integer": "_Integers", "real": "_Floats", "character": "_Characters"}
HEAD = '''"""Types of the compiled extension; made by python/generate_stub.py from python/core/python_api.f90."""

import numpy as np
from numpy.typing import NDArray

_Integers = NDArray[np.int32]
_Floats = NDArray[np.float64]
_Characters = NDArray[np.bytes_]

'''


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source")
    parser.add_argument("target")
    arguments = parser.parse_args()
    source, target = arguments.source, arguments.target
    crackfortran.verbose = 0
    with redirect_stdout(sys.stderr):
        (module,) = crackfortran.crackfortran([source])
    lines = [f"class {module['name']}:"]
    for routine in module["body"]:
        if routine["block"] == "subroutine" and "public" in module["vars"][routine["name"]]["attrspec"]:
            lines += ["    @staticmethod", f"    def {signature(routine)}: ..."]
    Path(target).write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    return 0


def signature(routine: dict[str, Any]) -> str:
    """Name, arguments and results; the size of an array argument is known from the array."""
    about = routine["vars"]
    given = [name for name in routine["args"] if {"in", "inout"} & set(about[name]["intent"])]
    sizes = {size for name in given for size in about[name].get("dimension", ())}
    arguments = [f"{n}: {kind(about[n]).replace('bytes', 'str')}" for n in given if n not in sizes]
    results = [kind(about[name]) for name in routine["args"] if "out" in about[name]["intent"]]
    returned = "None" if not results else results[0] if len(results) == 1 else f"tuple[{', '.join(results)}]"
    return f"{routine['name']}({', '.join(arguments)}) -> {returned}"


def kind(about: dict[str, Any]) -> str:
    """Type of an argument for Python."""
    if "dimension" in about:
        return ARRAYS[about["typespec"]]
    return SCALARS[about["typespec"]]


if __name__ == "__main__":
    sys.exit(main())
