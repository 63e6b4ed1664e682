"""The one table of the commands that Python carries out: their parser, help, completion, manual page and documentation.

It imports the standard library only: the build and the documentation read it where the compiled core is missing.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

__all__ = ["PROGRAM", "Layout", "add_commands", "argument_of", "described"]

PROGRAM = "dynstiction"
"""Name of the executable, and of what wrote a result."""

WIDTH = 110
"""Columns of the help."""


class Layout(argparse.RawDescriptionHelpFormatter):
    """Help as that of the executable: as wide, and examples as they are."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=WIDTH, max_help_position=25)

    def add_usage(self, usage: Any, actions: Any, groups: Any, prefix: str | None = None) -> None:
        super().add_usage(usage, actions, groups, "Usage: " if prefix is None else prefix)


def add_commands(to: Any) -> None:
    """Add the parser of each command.

    Parameters
    ----------
    to : object
        What ``ArgumentParser.add_subparsers`` returns.
    """

    def command(name: str, brief: str, meaning: str, *examples: str) -> Callable[..., Any]:
        text = textwrap.fill(" ".join(meaning.split()), WIDTH)
        shown = "examples:\n" + "\n".join(f"  dynstiction {example}" for example in examples)
        parser = to.add_parser(name, help=brief, description=text, epilog=shown, formatter_class=Layout)
        return parser.add_argument  # type: ignore[no-any-return]

    _add_commands_of_results(command)
    _add_commands_of_scenes(command)


def _add_commands_of_results(command: Callable[..., Any]) -> None:
    """What draws or writes results."""
    add = command(
        "plot",
        "draw a result file, or several side by side",
        """Draw a result file, or one figure that compares several runs. Of a run with many cycles only the first ones are drawn,
        unless --from or --to is given. Prints the file it wrote.""",
        "plot fig3.h5 --kind path",
        "plot fig3.h5 --columns friction,theta --from 2 --to 3",
        "plot 1deg.h5 2deg.h5 --overlay",
    )
    add("files", metavar="FILE.h5", type=Path, nargs="+")
    _overwrite(add)
    add(
        "--kind",
        metavar="KIND",
        help="for a run history, velocities, spectrogram, damping, creep, path or columns; default: by its model; "
        "for a sweep map (default) or bifurcation",
    )
    add(
        "--quantity",
        metavar="NAME",
        help="quantity of a map of a sweep, like period (default: swing), or of a bifurcation diagram (peak_force)",
    )
    add(
        "--columns",
        metavar="COLUMNS",
        help="columns of a run to draw, with commas between them, like friction,theta; one panel each",
    )
    add(
        "--overlay",
        action="store_true",
        help="draw several runs as lines in the same panels, not side by side",
    )
    _part(add, "of the run [s]; default of --from and --to: the first cycles, if there are many")
    _output(add, "FIGURE", "default: FILE.png, for several files comparison.png; also .pdf, .svg")

    add = command(
        "report",
        "one HTML page with all contents of a result file",
        """Write one HTML page: summary, figures, cycles, parameters, solver statistics, provenance, deck. It needs neither network
        nor other files. Prints the file it wrote.""",
        "report fig3.h5",
    )
    add("file", metavar="FILE.h5", type=Path)
    _overwrite(add)
    _output(add, "HTML", "default: FILE.html")

    add = command(
        "export",
        "write a result file's tables as CSV",
        """Write the tables of a result file as CSV: for a run time series, events and summary, for a sweep its cases and their cycles.
        Prints the files it wrote.""",
        "export fig3.h5",
    )
    add("file", metavar="FILE.h5", type=Path)
    _overwrite(add)
    _output(add, "DIR", "folder, created if it does not exist; default: the current one", default=Path())

    add = command(
        "animate",
        "show a run from above",
        """Show the object from above, while friction turns and the spring force and the position change. Prints what it wrote.""",
        "animate fig3.h5 -o fig3.gif --from 2 --to 3",
    )
    add("file", metavar="FILE.h5", type=Path)
    _overwrite(add)
    _output(add, "OUT", "X.gif, or a folder for PNG frames", required=True)
    _part(add, "of the run [s]; default of --from and --to: the first creep and three cycles")
    _number(add, "--fps", "N", 20, "frames per second (20)")
    _number(add, "--seconds", "S", 10.0, "length of the animation [s] (10)")

    add = command(
        "paper",
        "draw every figure of the paper",
        "Run the decks of Nakano and Popov (2020) and draw every figure. Prints the files it wrote.",
        "paper -o figures",
    )
    _overwrite(add)
    _output(add, "DIR", "folder, created if it does not exist", required=True)
    add("--format", choices=("png", "pdf", "svg"), default="png", help="default: png")


def _add_commands_of_scenes(command: Callable[..., Any]) -> None:
    """What runs a scene more than once."""
    add = command(
        "trade",
        "measured error against cost of methods and models",
        """Measure error against cost on the deck's own scene: models, methods and tolerances, against a reference whose own error is
        estimated. Prints the best settings as a table, and the cheapest ones for an accuracy as lines of a deck; draws error against
        cost.""",
        "trade inputs/fig3.nml --accuracy 1e-4",
        "trade inputs/fig3.nml --accuracy 1e-2 --quantities period --budget 3",
    )
    add("deck", metavar="DECK")
    _settings(add)
    _overwrite(add)
    _number(
        add, "--accuracy", "A", 1e-3, "of the recommended settings, which stay below it with a margin (1e-3)"
    )
    _number(add, "--budget", "S", 10.0, "wall time in seconds (10)")
    add(
        "--quantities",
        metavar="NAMES",
        default="",
        help="quantities that have this accuracy, with commas between them: values of the summary, elongation, slip_velocity, "
        "creep_velocity; default: elongation, period, peak_force and creep_velocity",
    )
    _output(add, "FIGURE", "default: DECK with _trade.png, in the current folder; also .pdf, .svg")

    add = command(
        "range",
        "where stick-slip begins and ends",
        """Say whether a scene has stick-slip and whether its steady sliding is stable, and where both change in numbers of the deck: by
        runs of the full model, with its friction law and dampers. Prints a table. dynstiction stability DECK --key is the same.""",
        "range my.nml",
        "stability my.nml --key system.damping_x,drive.velocity",
    )
    add("deck", metavar="DECK")
    _settings(add)
    add(
        "--key",
        metavar="KEYS",
        help="numbers GROUP.KEY of &system, &friction and &drive, with commas between them; default: misalignment_deg, velocity, "
        "damping_x, mass, stiffness_x and normal_load",
    )

    add = command(
        "branch",
        "limit cycles over a key, through folds and doublings",
        """Follow the limit cycles of a scene, stable and unstable, over a key of the deck: branches with their folds, period doublings and
        ends. Prints a table, draws a figure. dynstiction cycles DECK --along is the same.""",
        "branch my.nml --along system.misalignment_deg=1:9",
        "cycles my.nml --along drive.velocity=1e-4:1e-1",
    )
    add("deck", metavar="DECK")
    _settings(add)
    _overwrite(add)
    add(
        "--along",
        metavar="KEY=FROM:TO",
        required=True,
        help="the key, GROUP.KEY, and its range",
    )
    _number(add, "--most", "N", 2, "unstable cycles of up to N slow cycles are followed (2)")
    _output(add, "FIGURE", "default: DECK with _branches.png, in the current folder; also .pdf, .svg")

    add = command(
        "compare",
        "compare a measured trace with a scene",
        """Compare a measured trace of the force along the pull with the run of a deck: period, peak, valley, slip time and creep before
        slip of both, cycle by cycle, with their scatter, and the mean force over a cycle. TRACE is a table of text or an HDF5 file with
        time and force. Prints a table, draws a figure.""",
        "compare my.nml trace.csv",
        "compare my.nml trace.csv --zero 0:1.9 --filter 300:4",
        'compare my.nml trace.csv --time t --force "F [mN]" --unit time=ms --from 10',
    )
    _trace(add, "TRACE")
    add(
        "--lateral", metavar="COLUMN", type=_column, help="the same for the lateral force, if it was measured"
    )
    _output(add, "FIGURE", "default: TRACE with _compared.png, in the current folder; also .pdf, .svg")

    add = command(
        "fit",
        "find the parameters of a measured trace",
        """Find parameters of a deck from measured traces of the force along the pull: least squares on the mean waveform of the cycles and
        their period, or, if the cycles are not alike, on each of them. Says whether the fit explains the traces; prints values, errors,
        intervals, and what the traces do not determine; writes the fitted deck, draws waveform and residuals. Exit status 6 if the fit
        does not explain the traces. TRACE is as for compare.""",
        "fit my.nml trace.csv --free system.misalignment_deg,friction.mu_0",
        "fit my.nml slow.csv fast.csv --with drive.velocity=1e-3,5e-3 --free friction.mu_0,friction.mu_inf,friction.v_f",
        "fit my.nml trace.csv --free system.mass,chain.tare --known system.mass=0.4:0.01",
    )
    _trace(add, "TRACE", nargs="+")
    add(
        "--free",
        metavar="KEYS",
        required=True,
        help="parameters GROUP.KEY to be found, with commas between them; also drive.velocity, chain.tare, chain.filter and chain.gain",
    )
    _repeated(
        add,
        "--with",
        "KEY=VALUES",
        "values of a key that differ from trace to trace, with commas between them; may be repeated",
    )
    _repeated(
        add,
        "--known",
        "KEY=VALUE:ERROR",
        "value of a free parameter that is known from elsewhere, with its standard error; may be repeated",
    )
    _repeated(
        add, "--bound", "KEY=LEAST:LARGEST", "least and largest value of a free parameter; may be repeated"
    )
    _number(add, "--starts", "N", 2, "number of the slow model's starts that are completed (2)")
    _number(add, "--seed", "N", 0, "seed of the random starts (0): the same seed gives the same bits")
    add(
        "--kind",
        metavar="KIND",
        default="waveform",
        help="the figure: waveform (default), cycles (each by itself, distributions of period and peak), corner (the parameters two by two)",
    )
    add(
        "--fitted",
        metavar="NML",
        type=Path,
        help="the fitted deck; default: TRACE with _fitted.nml, in the current folder",
    )
    _output(add, "FIGURE", "default: TRACE with _fitted.png, in the current folder; also .pdf, .svg")


def described() -> Iterator[dict[str, Any]]:
    """Each command as an entry of ``dynstiction template --json``: its options are pairs of name and meaning."""
    found = argparse.ArgumentParser(prog=PROGRAM).add_subparsers()
    add_commands(found)
    briefs = {choice.dest: choice.help for choice in found._choices_actions}
    for name, parser in found.choices.items():
        actions = [action for action in parser._actions if action.dest != "help"]
        yield {
            "name": name,
            "operands": " ".join(
                f"{action.metavar}{'...' if action.nargs == '+' else ''}"
                for action in actions
                if not action.option_strings
            ),
            "brief": briefs[name],
            "usage": parser.format_usage().strip().removeprefix("Usage: ").replace("[-h] ", ""),
            "meaning": " ".join(parser.description.split()),
            "options": [
                (f"{action.option_strings[0]} {argument_of(action)}".strip(), action.help)
                for action in actions
                if action.option_strings
            ],
            "examples": textwrap.dedent(parser.epilog.partition("\n")[2]),
        }


def argument_of(action: argparse.Action) -> str:
    """What follows an option: a word in capitals, or its choices; '' if nothing does."""
    return "" if action.nargs == 0 else "|".join(action.choices or [str(action.metavar)])


def _settings(add: Callable[..., Any]) -> None:
    _repeated(
        add,
        "--set",
        "GROUP.KEY=VALUE",
        "use VALUE in place of the deck's, without VALUE its default; may be repeated; text needs no quotes",
    )


def _overwrite(add: Callable[..., Any]) -> None:
    add("--overwrite", action="store_true", help="replace existing output files")


def _output(add: Callable[..., Any], kind: str, meaning: str, **how: Any) -> None:
    add("-o", "--output", metavar=kind, type=Path, help=meaning, **how)


def _repeated(add: Callable[..., Any], name: str, metavar: str, meaning: str) -> None:
    add(name, metavar=metavar, action="append", default=[], help=meaning)


def _number(add: Callable[..., Any], name: str, metavar: str, default: float, meaning: str) -> None:
    add(name, metavar=metavar, type=type(default), default=default, help=meaning)


def _part(add: Callable[..., Any], of: str) -> None:
    add("--from", metavar="T", type=float, help=f"first time {of}")
    add("--to", metavar="T", type=float, help=f"last time {of.partition(';')[0]}")


def _trace(add: Callable[..., Any], metavar: str, **how: Any) -> None:
    """The deck and the trace, how the trace is read, and its measuring chain."""
    add("deck", metavar="DECK")
    add("trace", metavar=metavar, **how)
    _settings(add)
    _overwrite(add)
    add(
        "--time",
        metavar="COLUMN",
        type=_column,
        help="column of times in TRACE: its number from 0, its name, or in HDF5 the path of a dataset; default: time, or 0",
    )
    add(
        "--force",
        metavar="COLUMN",
        type=_column,
        help="the same for the force along the pull; default: force, or 1",
    )
    add(
        "--displacement",
        metavar="COLUMN",
        type=_column,
        help="the same for the displacement along the pull, if it was measured",
    )
    _repeated(
        add,
        "--unit",
        "QUANTITY=UNIT",
        "unit of time, force, displacement or lateral_force, like time=ms or force=mN, or its factor to SI, like "
        "force=-9.81e-3; default: that in TRACE, or SI",
    )
    add("--delimiter", metavar="C", help="character between columns; default: found automatically")
    add(
        "--interval",
        metavar="S",
        type=float,
        help="time between two samples [s], if there is no column of times",
    )
    _part(add, "of the trace that is used [s]")
    add(
        "--zero",
        metavar="T",
        help="FROM:TO, times between which nothing pulls [s]: their mean force is the zero",
    )
    add(
        "--filter",
        metavar="N",
        help="HZ or HZ:ORDER, corner frequency and order (2) of the Butterworth low pass of the measuring chain",
    )


def _column(text: str) -> int | str:
    """A column of a table, by number or name."""
    return int(text) if text.isdecimal() else text
