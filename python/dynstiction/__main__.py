"""``python -m dynstiction``: figures of result files, and the validation of slow creep."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from .errors import Error, FileError, IncompleteWarning, UsageError
from .result import open


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}: see {self.prog} --help")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status; a fault goes to stderr as one line."""
    try:
        options = _parser().parse_args(arguments)
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except Error as error:
        print(f"dynstiction: {error}", file=sys.stderr)
        return error.exit_status


def _parser() -> _Parser:
    parser = _Parser(prog="python -m dynstiction", description="Figures and validations.")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    plot = commands.add_parser("plot", help="draw a result file", description="Draw a result file.")
    plot.add_argument("file", metavar="FILE.h5", type=Path)
    plot.add_argument("--kind", default="history", help="history (the default) or path")
    plot.add_argument("-o", "--output", metavar="PNG", type=Path, help="default: FILE.png; also .pdf, .svg")
    plot.set_defaults(command=lambda options: _plot(options.file, options.kind, options.output))
    creep = commands.add_parser(
        "validate-creep",
        help="which exponent Eq. (8) has",
        description="Hold the forms of Eq. (8) against the exact creep, and that against the full model. Prints the tables and the "
        "finding, writes creep_validation.png and creep_validation.csv; exit status 1 if a check fails.",
    )
    creep.add_argument("-o", "--output", metavar="DIR", type=Path, default=Path(), help="default: here")
    creep.set_defaults(command=lambda options: _validate_creep(options.output))
    return parser


def _plot(file: Path, kind: str, output: Path | None) -> int:
    from . import plot  # noqa: PLC0415  (matplotlib is slow to import)

    with warnings.catch_warnings(record=True, action="always", category=IncompleteWarning) as caught:
        result = open(file)
    for warning in caught:
        print(f"dynstiction: {warning.message}", file=sys.stderr)
    plot.save(result, output or file.with_suffix(".png"), kind)
    return 0


def _validate_creep(folder: Path) -> int:
    from . import validate, validate_figure  # noqa: PLC0415

    with _progress("runs of the full model", validate.RUNS) as advance:
        validation = validate.validate_creep(advance=advance)
    print(validation.report())
    table = folder / "creep_validation.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with table.open("w", encoding="utf-8", newline="") as file:
            validation.write_csv(file)
    except OSError as error:
        raise FileError(f"{table}: cannot be written: {error}") from error
    validate_figure.save(validation, folder / "creep_validation.png")
    return 0 if validation.holds else 1


@contextmanager
def _progress(what: str, total: int) -> Iterator[Callable[[], None]]:
    """Count on stderr: a bar where tqdm is installed, otherwise a plain line now and then."""
    done = 0

    def count() -> None:
        nonlocal done
        done += 1
        if done % 10 == 0 or done == total:
            print(f"{done} of {total} {what}", file=sys.stderr, flush=True)

    try:
        from tqdm import tqdm  # type: ignore[import-untyped]  # noqa: PLC0415  (optional)
    except ImportError:
        yield count
        return
    with tqdm(total=total, desc=what) as bar:

        def update() -> None:
            bar.update()

        yield update


if __name__ == "__main__":
    sys.exit(main())
