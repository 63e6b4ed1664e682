"""``python -m dynstiction``: figures, reports and tables of results, figures of the paper.

The executable hands these commands over to this module: ``dynstiction plot FILE.h5`` is the same.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ._arguments import names_in, nearest
from ._commands import PROGRAM, Layout, add_commands
from ._native import catalogue
from ._output import check_outputs, put, unfinished
from ._progress import bars
from .errors import (
    DeckError,
    Error,
    FileError,
    FitWarning,
    SolverError,
    UsageError,
    printable,
)
from .result import Result, open
from .scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .trace import Chain, Trace

# The plotting modules are imported where they are used: matplotlib is slow to import.


UNEXPLAINED = 6
"""Exit status of a fit that does not explain its trace."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}: see {self.prog} --help")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a word that is not one of the choices, and name the nearest choice."""
        if action.choices is None or value in action.choices:
            return
        choices = [str(choice) for choice in action.choices]
        if action.dest == "name":
            theirs = [entry["name"] for entry in catalogue()["commands"]]
            if value in theirs:
                raise UsageError(
                    f"'{value}' is a command of the executable, which is built where HDF5 is: write {PROGRAM} {value}, "
                    "or use the package in Python (ds.run, ds.sweep)"
                )
            choices += theirs
            near = _nearest(str(value), choices) or f"there are {' | '.join(choices)}, "
            raise UsageError(f"unknown command '{value}': {near}see {PROGRAM} --help")
        near = _nearest(str(value), choices)
        self.error(
            f"{action.metavar or action.option_strings[-1]} '{value}' is unknown: {near}choose {' | '.join(choices)}"
        )

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Refuse an argument that does not have its form, and show that."""
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError:
            option, kind = action.option_strings[-1], " (a number)" if action.type in (int, float) else ""
            self.error(f"{option} {arg_string}: write {option} {action.metavar}{kind}")

    def parse_all(self, arguments: Sequence[str] | None) -> argparse.Namespace:
        """Parse every word; refuse the remaining ones with a message for the command."""
        options, left = self.parse_known_args(arguments)
        if not left:
            return options
        see = f"see {self.prog} {options.name} --help"
        if not left[0].startswith("-"):
            raise UsageError(f"too many operands, from '{left[0]}' on: {see}")
        (commands,) = (action.choices for action in self._actions if action.dest == "name")
        known = commands[options.name]._option_string_actions  # type: ignore[index]
        near = _nearest(left[0].partition("=")[0], known)
        raise UsageError(f"unknown option '{left[0]}': {near}{see}")

    def _print_message(self, message: str, file: Any = None) -> None:
        if file is sys.stderr:
            super()._print_message(message, file)
        else:
            _say(message, end="")


def _nearest(given: str, known: Iterable[str]) -> str:
    """The nearest known word, as the beginning of a remedy; empty if no word is near."""
    near = nearest(given, known)
    return f"the nearest is '{near}', " if near else ""


def _say(text: object, end: str = "\n") -> None:
    """Print to standard output at once; raise an error if it cannot be written."""
    try:
        if sys.stdout is None:
            raise OSError("it is closed")
        print(text, end=end, flush=True)
    except OSError as error:
        if sys.stdout is not None:
            # Discard unwritten output: the interpreter would try to write it again at its end, and print a message.
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            os.close(nowhere)
        reason = error.strerror or error
        raise FileError(f"cannot write to the standard output: {reason}") from error


def _note(message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a line on stderr: a warning, in place of Python's form, which names a line of this package."""
    print(f"dynstiction: {printable(str(message))}", file=sys.stderr)


def main(arguments: Sequence[str] | None = None, program: str = "python -m dynstiction") -> int:
    """Run a command and return its exit status; an error is printed on stderr in one line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Arguments of the command line; by default those of this process.
    program : str
        Name by which the user called the program.
    """
    try:
        with _ended_by_signals(), warnings.catch_warnings():
            warnings.showwarning = _note
            given = list(sys.argv[1:] if arguments is None else arguments)
            if given[:1] == ["complete"]:
                from ._completion import completions  # noqa: PLC0415

                for candidate in completions(given[1:]):
                    _say(candidate)
                return 0
            if given[:1] == ["help"]:
                given = [*(word for word in given[1:] if word != "python"), "--help"]
            options = _parser(program).parse_all(given)
            return COMMANDS[options.name](options) or 0
    except Error as error:
        status, words = error.exit_status, str(error)
    except ModuleNotFoundError as error:
        remedy = f"install it, {sys.executable} -m pip install {error.name}"
        status, words = FileError.exit_status, f"the Python package {error.name} is missing: {remedy}"
    except MemoryError as error:
        status, words = SolverError.exit_status, f"no memory: {error or 'ask for less'}"
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        status, words = FileError.exit_status, f"{where}{error.strerror or error}"
    print(f"dynstiction: {printable(words) if status != DeckError.exit_status else words}", file=sys.stderr)
    return status


def _end(number: int, _: object) -> None:
    """Remove files that are being written, and end by the signal, so that the shell that called sees how the command ended.

    Nothing is raised: in an import, and in a function that C has called, it would be lost, changed, or abort the process.
    """
    for part in unfinished:
        with suppress(OSError):
            os.unlink(part)
    line = f"dynstiction: stopped by {signal.Signals(number).name}\n"
    with suppress(OSError):
        os.write(2, f"\n{line}".encode() if bars else line.encode())
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """SIGINT and SIGTERM end the process, unless the caller ignores them, and so does a reader of the output that has ended."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGPIPE)}
    for number, handler in before.items():
        if number == signal.SIGPIPE:
            signal.signal(number, signal.SIG_DFL)
        elif handler != signal.SIG_IGN:
            signal.signal(number, _end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _parser(program: str) -> _Parser:
    """Parser of the table of commands."""
    parser = _Parser(
        prog=program,
        description="Figures, reports and tables of results; measured traces; the trade of accuracy for time.",
        epilog=f"The commands of the executable: {PROGRAM} --help",
        formatter_class=Layout,
    )
    add_commands(parser.add_subparsers(title="commands", required=True, metavar="COMMAND", dest="name"))
    return parser


def _plot(options: argparse.Namespace) -> None:
    from . import plot  # noqa: PLC0415

    part: dict[str, Any] = {"start": vars(options)["from"], "end": options.to}
    if options.columns is not None:
        part["columns"] = [name for name in names_in("--columns", options.columns) if name]
        if not part["columns"]:
            raise UsageError("--columns: name at least one, as --columns friction,theta")
    one = len(options.files) == 1
    name = options.files[0].with_suffix(".png") if one else "comparison.png"
    write = _figure(options, name, options.files)
    if one:
        (file,) = options.files
        if options.overlay:
            raise UsageError("--overlay is for several files: give the others too")
        drawable = open(file)
        write(plot.draw(drawable, options.kind, options.quantity, **part))
        drawn = {file.stem: drawable} if isinstance(drawable, Result) else {}
    else:
        if options.kind is not None or options.quantity is not None:
            raise UsageError(
                "--kind and --quantity are for one file: several are compared, with --columns and --overlay"
            )
        stems = [file.stem for file in options.files]
        # Without folder and suffix, or complete where that is needed to distinguish them.
        names = stems if len(set(stems)) == len(stems) else map(str, options.files)
        drawn = {name: _open_run(file) for name, file in zip(names, options.files, strict=True)}
        write(plot.draw(drawn, "overlay" if options.overlay else "compare", **part))
    _note_samples(drawn)


def _note_samples(results: Mapping[str, Result]) -> None:
    """Print a line for each result whose samples do not show its fast oscillation."""
    from .plot import coarseness  # noqa: PLC0415

    for name, result in results.items():
        if coarse := coarseness(result):
            _note(f"{name}: {coarse}: run with a smaller output.interval")


def _scene(options: argparse.Namespace) -> Scene:
    """The scene of the deck, with settings as those of the executable, in which text has no quotes."""
    scene = Scene(Path(options.deck))
    scene._name = options.deck
    for setting in options.set:
        name, _, scene._settings[name.lower()] = setting.partition("=")
    return scene


def _trace(options: argparse.Namespace, path: str) -> Trace:
    """The trace in a file that the options of a command describe."""
    from .trace_file import read_trace  # noqa: PLC0415

    delimiter = {"tab": "\t", "\\t": "\t", "blank": " "}.get(options.delimiter, options.delimiter)
    trace = read_trace(
        path,
        time=options.time,
        force=options.force,
        displacement=options.displacement,
        lateral_force=vars(options).get("lateral"),
        units=dict(options.unit),
        delimiter=delimiter,
        interval=options.interval,
    )
    if options.zero:
        trace = trace.zeroed(*options.zero)
    return trace.part(vars(options)["from"], options.to)


def _stem(path: str) -> str:
    """Name of a trace's file without its endings."""
    return Path(path.removesuffix(".gz")).stem


def _chain(options: argparse.Namespace) -> Chain:
    """The measuring chain that the options of a command describe."""
    from .trace import Chain  # noqa: PLC0415

    corner, order = options.filter or (None, 2)
    return Chain(filter=corner, order=order)


def _figure(
    options: argparse.Namespace,
    name: str,
    inputs: Sequence[Any],
    outputs: Sequence[Path] = (),
    pages: Sequence[str] = (),
) -> Callable[[Figure | str], None]:
    """Check the file of a figure, or of a page where there are some, and other outputs before anything is computed; what writes the figure, and says so."""
    from .plot.style import format_of, write  # noqa: PLC0415

    path = options.output or Path(name)
    if path.suffix.lower() not in pages:
        format_of(path)
    check_outputs([*outputs, path], inputs, overwrite=options.overwrite)

    def put_figure(figure: Figure | str) -> None:
        if isinstance(figure, str):
            put(path, figure.encode(), overwrite=options.overwrite)
        else:
            write(figure, path, overwrite=options.overwrite)
        _say(printable(str(path)))

    return put_figure


def _compare(options: argparse.Namespace) -> None:
    from .trace_comparison import compare  # noqa: PLC0415

    write = _figure(options, f"{_stem(options.trace)}_compared.png", [options.deck, options.trace])
    trace = _trace(options, options.trace)
    comparison = compare(_scene(options), trace, chain=_chain(options))
    _say(comparison.report())
    write(comparison.plot())


def _fit(options: argparse.Namespace) -> int:
    from .plot.traces import check_fit_kind  # noqa: PLC0415
    from .trace_fit import fit, verdict  # noqa: PLC0415
    from .trace_rivals import explanations  # noqa: PLC0415

    stem, kind = _stem(options.traces[0]), options.kind or "waveform"
    deck = options.fitted or Path(f"{stem}_fitted.nml")
    check_fit_kind(kind)
    write = _figure(options, f"{stem}_fitted.png", [options.deck, *options.traces], [deck], PAGES)
    with warnings.catch_warnings():
        # The notes of the fit are printed with it.
        warnings.simplefilter("ignore", FitWarning)
        traces = [_trace(options, each) for each in options.traces]
        found = fit(
            _scene(options),
            traces,
            options.free,
            each=dict(vars(options)["with"]),
            known=dict(options.known),
            bounds=dict(options.bound),
            chain=_chain(options),
            starts=options.starts,
            rng=options.seed,
        )
        explains, words = verdict(found)
        others = () if explains else explanations(found)
    _say(words)
    if others:
        _say("\n".join(["what would explain it, fitted with one more free parameter:", *map(str, others)]))
    for trace in traces:
        _say(f"{printable(trace.name)}: {trace.units}")
    _say(found)
    put(deck, found.scene.to_deck().encode(), overwrite=options.overwrite)
    _say(printable(str(deck)))
    is_page = options.output is not None and options.output.suffix.lower() in PAGES
    write(found.report() if is_page else found.plot(kind))
    return 0 if explains else UNEXPLAINED


def _report(options: argparse.Namespace) -> None:
    from .report import write_report  # noqa: PLC0415

    output = options.output or options.file.with_suffix(".html")
    if output.suffix.lower() not in PAGES:
        raise FileError(f"{output}: cannot be written: a report is a page: call it {output.stem}.html")
    check_outputs([output], [options.file], overwrite=options.overwrite)
    result = _open_run(options.file)
    write_report(result, output, options.file.name, overwrite=options.overwrite)
    _note_samples({options.file.stem: result})
    _say(printable(str(output)))


def _export(options: argparse.Namespace) -> None:
    from .export import export_csv  # noqa: PLC0415

    found = open(options.file)
    for file in export_csv(found, options.output or Path(), options.file.stem, overwrite=options.overwrite):
        _say(printable(str(file)))


def _trade(options: argparse.Namespace) -> None:
    from ._trade import trade  # noqa: PLC0415

    write = _figure(options, f"{Path(options.deck).stem}_trade.png", [options.deck])
    found = trade(_scene(options), options.budget, options.quantities or "")
    _say(found.report())
    write(found.plot())
    _say(found.recommend(options.accuracy)[1], end="")


def _range(options: argparse.Namespace) -> None:
    from .ranges import KEYS, stick_slip_range  # noqa: PLC0415

    _say(stick_slip_range(_scene(options), options.key or KEYS))


def _branch(options: argparse.Namespace) -> None:
    from .branches import branch  # noqa: PLC0415
    from .plot import draw  # noqa: PLC0415

    write = _figure(options, f"{Path(options.deck).stem}_branches.png", [options.deck])
    key, ends = options.along
    found = branch(_scene(options), key, *ends, slow_cycles=options.most)
    _say(found)
    if found.branches:
        write(draw(found))


def _paper(options: argparse.Namespace) -> None:
    from .plot.paper import draw_paper  # noqa: PLC0415

    show = partial(print, file=sys.stderr, flush=True)
    for file in draw_paper(options.output, options.format, progress=show, overwrite=options.overwrite):
        _say(file)


def _animate(options: argparse.Namespace) -> None:
    from .plot.animation import animate  # noqa: PLC0415

    start = vars(options)["from"]
    if start is not None and options.to is not None and not start < options.to:
        raise UsageError(f"--from {start:g} is not before --to {options.to:g}: exchange them")
    if options.output.suffix:
        check_outputs([options.output], [options.file], overwrite=options.overwrite)
    animate(
        _open_run(options.file),
        options.output,
        start=start,
        end=options.to,
        frames_per_second=options.fps,
        seconds=options.seconds,
        overwrite=options.overwrite,
    )
    _say(printable(str(options.output)))


def _open_run(file: Path) -> Result:
    """The run in a file."""
    found = open(file)
    if not isinstance(found, Result):
        remedy = "dynstiction plot draws it, dynstiction export writes its tables"
        raise FileError(f"{printable(str(file))}: holds a sweep, not one run: {remedy}")
    return found


PAGES = (".html", ".htm")
"""Suffixes of a report."""

COMMANDS: dict[str, Callable[[argparse.Namespace], int | None]] = {
    function.__name__[1:]: function
    for function in (_plot, _report, _export, _animate, _paper, _trade, _range, _branch, _compare, _fit)
}
"""Function of each command."""

if __name__ == "__main__":
    sys.exit(main())
