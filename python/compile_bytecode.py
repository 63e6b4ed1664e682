"""Bytecode of the package, for `meson install`: a file that Meson installs is one that it uninstalls; one that Python caches is not.

    python python/compile_bytecode.py PACKAGE OUTPUT DEPFILE [MADE]...

OUTPUT gets the folders ``__pycache__`` of PACKAGE, to which the modules MADE by the build belong, and nothing else.
"""

import argparse
import shutil
from importlib.util import cache_from_source
from pathlib import Path
from py_compile import PycInvalidationMode, compile


def main(package: Path, output: Path, depfile: Path, *made: Path) -> None:
    shutil.rmtree(output, ignore_errors=True)
    sources = sorted(package.rglob("*.py"))
    for source in (*sources, *made):
        name = source.relative_to(package.parent) if source in sources else Path(package.name, source.name)
        cached = cache_from_source(str(output.parent / name))
        # The hash, as the times of installed files are the installer's matter.
        compile(
            str(source),
            cached,
            dfile=str(name),
            doraise=True,
            invalidation_mode=PycInvalidationMode.CHECKED_HASH,
        )
    # A file that comes or goes changes its folder.
    watched = {*sources, *(source.parent for source in sources)}
    depfile.write_text(f"{output}: {' '.join(map(str, sorted(watched)))}\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name in ("package", "output", "depfile"):
        parser.add_argument(name, type=Path)
    parser.add_argument("made", type=Path, nargs="*")
    arguments = parser.parse_args()
    main(arguments.package, arguments.output, arguments.depfile, *arguments.made)
