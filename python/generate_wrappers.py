"""Generate the C and Fortran wrappers of one Fortran file with f2py, and refuse what f2py only warns of.

f2py maps a kind that it does not know to C ``float`` and goes on; the extension would then return wrong numbers.

    python python/generate_wrappers.py python/core/python_api.f90 FOLDER
"""

import argparse
import subprocess
import sys
from pathlib import Path

MODULE = "_core"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source")
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args()
    source, folder = arguments.source, arguments.folder
    command = [
        sys.executable,
        "-m",
        "numpy.f2py",
        source,
        "-m",
        MODULE,
        "--lower",
        "--build-dir",
        str(folder),
    ]
    run = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    faults = [line for line in run.stdout.splitlines() if "is mapped to C" in line]
    if run.returncode != 0 or faults:
        print("\n".join(faults) or run.stdout, file=sys.stderr)
        print(f"{source}: use literal real(c_double) and integer(c_int) for every argument", file=sys.stderr)
        return 1
    # f2py leaves out the wrapper file that it does not need; the build expects both.
    for name, empty in ((f"{MODULE}-f2pywrappers.f", "C"), (f"{MODULE}-f2pywrappers2.f90", "!")):
        if not (folder / name).exists():
            (folder / name).write_text(f"{empty}     nothing to wrap\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
