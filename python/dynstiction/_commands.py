"""The one table of the commands that Python carries out: their parser, help, completion, manual page and documentation.

It imports the standard library only: the build and the documentation read it where the compiled core is missing.
"""

from __future__ import annotations

import argparse
import re
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

PROGRAM = "dynstiction"
"""Name of the executable, and of what wrote a result."""

WIDTH = 110
"""Columns of the help."""

# A paragraph is a command with its operands, or with a colon a list of options that several commands have; two blanks precede what
# a command or an option is for, and longer lines go on behind blanks. Then lines with a dash are options, with $ examples, with a
# colon a list of options, others the command's description. An option with an exclamation mark must be given, one with three dots
# may be repeated; the default of a number stands in brackets.
TABLE = """
:set
--set GROUP.KEY=VALUE...  use VALUE in place of the deck's, without VALUE its default; may be repeated; text
  needs no quotes

:overwrite
--overwrite  replace existing output files

:trace
:set
:overwrite
--time COLUMN  column of times in TRACE: its number from 0, its name, or in HDF5 the path of a dataset;
  default: time, or 0
--force COLUMN  the same for the force along the pull; default: force, or 1
--displacement COLUMN  the same for the displacement along the pull, if it was measured
--unit QUANTITY=UNIT...  unit of time, force, displacement or lateral_force, like time=ms or force=mN, or its
  factor to SI, like force=-9.81e-3; default: that in TRACE, or SI
--delimiter C  character between columns; default: found automatically
--interval S  time between two samples [s], if there is no column of times
--from T  first time of the trace that is used [s]
--to T  last time of the trace that is used [s]
--zero FROM:TO  times between which nothing pulls [s]: their mean force is the zero
--filter HZ:ORDER  HZ or HZ:ORDER, corner frequency and order (2) of the Butterworth low pass of the measuring
  chain

plot FILE.h5...  draw a result file, or several side by side
Draw a result file, or one figure that compares several runs. Of a run with many cycles only the first ones
are drawn, unless --from or --to is given. Prints the file it wrote.
:overwrite
--kind KIND  for a run history, velocities, spectrogram, damping, creep, path or columns; default: by its
  model; for a sweep map (default) or bifurcation
--quantity NAME  quantity of a map of a sweep, like period (default: swing), or of a bifurcation diagram
  (peak_force)
--columns COLUMNS  columns of a run to draw, with commas between them, like friction,theta; one panel each
--overlay  draw several runs as lines in the same panels, not side by side
--from T  first time of the run [s]; default of --from and --to: the first cycles, if there are many
--to T  last time of the run [s]
--output FIGURE  default: FILE.png, for several files comparison.png; also .pdf, .svg
$ plot fig3.h5 --kind path
$ plot fig3.h5 --columns friction,theta --from 2 --to 3
$ plot 1deg.h5 2deg.h5 --overlay

report FILE.h5  one HTML page with all contents of a result file
Write one HTML page: summary, figures, cycles, parameters, solver statistics, provenance, deck. It needs
neither network nor other files. Prints the file it wrote.
:overwrite
--output HTML  default: FILE.html
$ report fig3.h5

export FILE.h5  write a result file's tables as CSV
Write the tables of a result file as CSV: for a run time series, events and summary, for a sweep its cases and
their cycles. Prints the files it wrote.
:overwrite
--output DIR  folder, created if it does not exist; default: the current one
$ export fig3.h5

animate FILE.h5  show a run from above
Show the object from above, while friction turns and the spring force and the position change. Prints what it
wrote.
:overwrite
--output! OUT  X.gif, or a folder for PNG frames
--from T  first time of the run [s]; default of --from and --to: the first creep and three cycles
--to T  last time of the run [s]
--fps N  frames per second (20)
--seconds S  length of the animation [s] (10)
$ animate fig3.h5 -o fig3.gif --from 2 --to 3

paper  draw every figure of the paper
Run the decks of Nakano and Popov (2020) and draw every figure. Prints the files it wrote.
:overwrite
--output! DIR  folder, created if it does not exist
--format png|pdf|svg  default: png
$ paper -o figures

trade DECK  measured error against cost of methods and models
Measure error against cost on the deck's own scene: models, methods and tolerances, against a reference whose
own error is estimated. Prints the best settings as a table, and the cheapest ones for an accuracy as lines of
a deck; draws error against cost.
:set
:overwrite
--accuracy A  of the recommended settings, which stay below it with a margin (1e-3)
--budget S  wall time in seconds (10)
--quantities NAMES  quantities that have this accuracy, with commas between them: values of the summary,
  elongation, slip_velocity, creep_velocity; default: elongation, period, peak_force and creep_velocity
--output FIGURE  default: DECK with _trade.png, in the current folder; also .pdf, .svg
$ trade inputs/fig3.nml --accuracy 1e-4
$ trade inputs/fig3.nml --accuracy 1e-2 --quantities period --budget 3

range DECK  where stick-slip begins and ends
Say whether a scene has stick-slip and whether its steady sliding is stable, and where both change in numbers
of the deck: by runs of the full model, with its friction law and dampers. Prints a table. dynstiction
stability DECK --key is the same.
:set
--key KEYS  numbers GROUP.KEY of &system, &friction and &drive, with commas between them; default:
  misalignment_deg, velocity, damping_x, mass, stiffness_x and normal_load
$ range my.nml
$ stability my.nml --key system.damping_x,drive.velocity

branch DECK  limit cycles over a key, through folds and doublings
Follow the limit cycles of a scene, stable and unstable, over a key of the deck: branches with their folds,
period doublings and ends. Prints a table, draws a figure. dynstiction cycles DECK --along is the same.
:set
:overwrite
--along! KEY=FROM:TO  the key, GROUP.KEY, and its range
--most N  unstable cycles of up to N slow cycles are followed (2)
--output FIGURE  default: DECK with _branches.png, in the current folder; also .pdf, .svg
$ branch my.nml --along system.misalignment_deg=1:9
$ cycles my.nml --along drive.velocity=1e-4:1e-1

compare DECK TRACE  compare a measured trace with a scene
Compare a measured trace of the force along the pull with the run of a deck: period, peak, valley, slip time
and creep before slip of both, cycle by cycle, with their scatter, and the mean force over a cycle. TRACE is a
table of text, or an HDF5, MATLAB or TDMS file. Prints a table, draws a figure.
:trace
--lateral COLUMN  the same for the lateral force, if it was measured
--output FIGURE  default: TRACE with _compared.png, in the current folder; also .pdf, .svg
$ compare my.nml trace.csv
$ compare my.nml trace.csv --zero 0:1.9 --filter 300:4
$ compare my.nml trace.csv --time t --force "F [mN]" --unit time=ms --from 10

fit DECK TRACE...  find the parameters of a measured trace
Find parameters of a deck from measured traces of the force along the pull: least squares on the mean waveform
of the cycles and their period, or, if the cycles are not alike, on each of them. Says whether the fit
explains the traces; prints values, errors, intervals, and what the traces do not determine; writes the fitted
deck, draws waveform and residuals. Exit status 6 if the fit does not explain the traces. TRACE is as for
compare.
:trace
--free! KEYS  parameters GROUP.KEY to be found, with commas between them; also drive.velocity, chain.tare,
  chain.filter and chain.gain
--with KEY=VALUES...  values of a key that differ from trace to trace, with commas between them; may be
  repeated
--known KEY=VALUE:ERROR...  value of a free parameter that is known from elsewhere, with its standard error;
  may be repeated
--bound KEY=LEAST:LARGEST...  least and largest value of a free parameter; may be repeated
--starts N  number of the slow model's starts that are completed (2)
--seed N  seed of the random starts (0): the same seed gives the same bits
--kind KIND  the figure: waveform (default), time (over time), cycles (each by itself, distributions of period and
  peak), corner (the parameters two by two)
--fitted NML  the fitted deck; default: TRACE with _fitted.nml, in the current folder
--output FIGURE  default: TRACE with _fitted.png, in the current folder; also .pdf, .svg, and .html, a report with all
  figures
$ fit my.nml trace.csv --free system.misalignment_deg,friction.mu_0
$ fit my.nml slow.csv fast.csv --with drive.velocity=1e-3,5e-3 --free friction.mu_0,friction.mu_inf,friction.v_f
$ fit my.nml trace.csv --free system.mass,chain.tare --known system.mass=0.4:0.01
"""


def _pair(text: str) -> tuple[float, float]:
    """Two numbers with a colon between them."""
    first, second = map(float, text.split(":"))
    return first, second


def _of_key(read: Callable[[str], Any]) -> Callable[[str], tuple[str, Any]]:
    """What reads a key, and after an ``=`` its value."""

    def read_both(text: str) -> tuple[str, Any]:
        key, value = text.split("=", 1)
        return key, read(value)

    return read_both


def _filter(text: str) -> tuple[float, int]:
    """Corner frequency [Hz] and order of a low pass."""
    corner, _, order = text.partition(":")
    return float(corner), int(order or 2)


ARGUMENTS: dict[str, tuple[Any, tuple[str, ...]]] = {
    **dict.fromkeys(("KEY=VALUE:ERROR", "KEY=LEAST:LARGEST", "KEY=FROM:TO"), (_of_key(_pair), ())),
    "KEY=VALUES": (_of_key(lambda text: tuple(map(float, text.split(",")))), ()),
    "QUANTITY=UNIT": (_of_key(str), ()),
    "FROM:TO": (_pair, ()),
    "HZ:ORDER": (_filter, ()),
    "A": (float, ()),
    "S": (float, ()),
    "T": (float, ()),
    "N": (int, ()),
    "COLUMN": (lambda text: int(text) if text.isdecimal() else text, ()),
    "DECK": (str, ("*.nml",)),
    "TRACE": (str, ("*.csv", "*.h5", "*.mat", "*.tdms")),
    "FILE.h5": (Path, ("*.h5",)),
    "FILE": (str, ("*.h5",)),
    "NML": (Path, ("*.nml",)),
    "FIGURE": (Path, ("*.png",)),
    "HTML": (Path, ("*.html",)),
    "OUT": (Path, ("*.gif",)),
    "DIR": (Path, ("*/",)),
}
"""Type of what follows an option or is an operand, and the endings of the files that it names; others are texts."""


class Layout(argparse.RawDescriptionHelpFormatter):
    """Help as that of the executable: as wide, and examples as they are."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=WIDTH, max_help_position=25)

    def add_usage(self, usage: Any, actions: Any, groups: Any, prefix: str | None = None) -> None:
        super().add_usage(usage, actions, groups, "Usage: " if prefix is None else prefix)


def add_commands(to: Any) -> list[dict[str, Any]]:
    """Add the parser of each command to `to`, which ``ArgumentParser.add_subparsers`` has returned.

    The entries of the commands are returned, as `described` has them, but without their usage.
    """
    entries = []
    shared: dict[str, list[tuple[str, str]]] = {}
    for paragraph in TABLE.strip().split("\n\n"):
        pairs = [line.partition("  ")[::2] for line in paragraph.replace("\n  ", " ").split("\n")]
        (head, brief), *lines = [line for pair in pairs for line in shared.get(pair[0], [pair])]
        if head.startswith(":"):
            shared[head] = lines
            continue
        name, _, operands = head.partition(" ")
        meaning = " ".join(line for line, _ in lines if line[0] not in "-$")
        examples = [line.replace("$", PROGRAM) for line, _ in lines if line[0] == "$"]
        parser = to.add_parser(
            name,
            help=brief,
            description=textwrap.fill(meaning, WIDTH),
            epilog="\n  ".join(["examples:", *examples]),
            formatter_class=Layout,
        )
        for operand in operands.split():
            kind, several = operand.removesuffix("..."), operand.endswith("...")
            dest = kind.removesuffix(".h5").lower() + "s" * several
            parser.add_argument(dest, metavar=kind, type=ARGUMENTS[kind][0], nargs="+" if several else None)
        options = [
            (_add_option(parser, *line.partition(" ")[::2], about), about)
            for line, about in lines
            if line[0] == "-"
        ]
        entries.append({
            "name": name, "operands": operands, "brief": brief, "meaning": meaning, "options": options,
            "examples": "\n".join(examples),
        })  # fmt: skip
    return entries


def _add_option(parser: argparse.ArgumentParser, name: str, argument: str, meaning: str) -> str:
    """Add an option; its name, the short one if it has two, and what follows it."""
    kind = argument.removesuffix("...")
    how: dict[str, Any] = {"metavar": kind, "type": ARGUMENTS.get(kind, (str,))[0]}
    if not argument:
        how = {"action": "store_true"}
    elif "|" in argument:
        how = {"choices": argument.split("|"), "default": meaning.partition("default: ")[2]}
    elif argument.endswith("..."):
        how |= {"action": "append", "default": []}
    elif how["type"] in (int, float) and (default := re.search(r"\(([\d.e-]+)\)", meaning)):
        how["default"] = how["type"](default[1])
    names = [*["-o"] * name.startswith("--output"), name.rstrip("!")]
    parser.add_argument(*names, help=meaning, required=name.endswith("!"), **how)
    return f"{names[0]} {kind}".strip()


def described() -> list[dict[str, Any]]:
    """Each command as an entry of ``dynstiction template --json``: its options are pairs of name and meaning."""
    found = argparse.ArgumentParser(prog=PROGRAM).add_subparsers()
    entries = add_commands(found)
    for entry in entries:
        usage = found.choices[entry["name"]].format_usage()
        entry["usage"] = usage.strip().removeprefix("Usage: ").replace("[-h] ", "")
    return entries
