"""``python -m dynstiction``: figures of result files."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from .errors import Error, IncompleteWarning, UsageError
from .result import open


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}: see {self.prog} --help")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status; a fault goes to stderr as one line."""
    try:
        options = _parser().parse_args(arguments)
        _plot(options.file, options.kind, options.output)
    except Error as error:
        print(f"dynstiction: {error}", file=sys.stderr)
        return error.exit_status
    return 0


def _parser() -> _Parser:
    parser = _Parser(prog="python -m dynstiction", description="Figures of dynstiction's result files.")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    plot = commands.add_parser("plot", help="draw a result file", description="Draw a result file.")
    plot.add_argument("file", metavar="FILE.h5", type=Path)
    plot.add_argument("--kind", default="history", help="history (the default) or path")
    plot.add_argument("-o", "--output", metavar="PNG", type=Path, help="default: FILE.png; also .pdf, .svg")
    return parser


def _plot(file: Path, kind: str, output: Path | None) -> None:
    from . import plot  # noqa: PLC0415  (matplotlib is slow to import)

    with warnings.catch_warnings(record=True, action="always", category=IncompleteWarning) as caught:
        result = open(file)
    for warning in caught:
        print(f"dynstiction: {warning.message}", file=sys.stderr)
    plot.save(result, output or file.with_suffix(".png"), kind)


if __name__ == "__main__":
    sys.exit(main())
