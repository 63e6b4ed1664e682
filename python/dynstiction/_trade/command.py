"""``dynstiction trade``: run the comparison for the scene of a deck, stop it on signals, print its progress and write the file.

The file is like the file of a run, with the summary and the statistics of the reference. In place of the time series, the group
/trade has one row for each point.
"""

from __future__ import annotations

import signal
import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from .._output import check_outputs
from ..errors import Error, FileError, UsageError, printable
from ..scene import Scene
from . import begin
from .advice import advice, cheapest, overview
from .measure import Comparison, StoppedEarlyError
from .report import report, selection

__all__ = ["compare"]

TERMINAL_INTERVAL, PLAIN_INTERVAL = 0.2, 10.0
"""Wall time between two lines of progress [s]."""


def compare(options: Namespace, say: Callable[[str], None]) -> None:
    """Run the comparison of a command line, write the file, print the table and the recommended settings for an accuracy.

    A comparison that was stopped, or has no reference, is written to the file before the `Error` is raised.
    """
    accuracy, quantity, overwrite = options.accuracy, options.quantity, options.overwrite
    output = options.output or f"{Path(options.deck).stem}_trade.h5"
    if accuracy is not None and accuracy > 1.0:
        raise UsageError("the accuracy is out of range: it must be > 0.0 and <= 1.0")
    with _listening() as received:
        from .. import _save  # noqa: PLC0415  (h5py is slow to import)

        comparison = begin(Scene.of_command(options.deck, options.set), accuracy, options.budget, quantity)
        check_outputs([output], [options.deck], overwrite=overwrite, hdf5=True)
        _save.refuse_to_replace(output, overwrite=overwrite)
        fault = _watch(comparison, received, "" if options.quiet else printable(options.deck))
        table = comparison.table() if comparison.has_reference else None
        try:
            _save.write(comparison.record(fault), output, overwrite=overwrite, trade=table)
        except FileError as error:
            fault = fault or error
    if fault is not None:
        raise fault
    if not options.quiet:
        say(report(comparison, quantity) if options.all else selection(comparison, quantity))
        say(
            f"\n{overview(comparison, quantity)}\nWritten: {printable(output)}; draw it with dynstiction plot\n"
        )
    if accuracy is not None:
        text = advice(comparison, cheapest(comparison, accuracy, quantity))
        say("".join(f"{printable(line)}\n" for line in text.splitlines()))


def _watch(comparison: Comparison, received: Sequence[str], label: str) -> Error | None:
    """Run the comparison until its end, an error or a signal, and return the error. Progress is printed if there is a label."""
    terminal = sys.stderr is not None and sys.stderr.isatty()
    interval = TERMINAL_INTERVAL if terminal else PLAIN_INTERVAL
    budget, due = comparison.budget, interval
    fault: Error | None = None
    try:
        for _ in comparison.steps():
            elapsed = min(comparison.elapsed, budget)
            if received:
                text = f"stopped by {received[0]}: the file holds what was measured until then"
                fault = StoppedEarlyError(text)
                break
            if label and elapsed >= due:
                done = f"{100.0 * elapsed / budget:6.1f} %, wall time = {elapsed:.3g} of {budget:.6g} s"
                line = f"{label}:{done}, {budget - elapsed:.0f} s left"
                _put(f"\r{line}\x1b[K" if terminal else f"{line}\n")
                due = elapsed + interval
    except Error as error:
        fault = error
    if terminal and due > interval:
        _put("\r\x1b[K")
    return fault


def _put(text: str) -> None:
    with suppress(OSError):
        sys.stderr.write(text)
        sys.stderr.flush()


@contextmanager
def _listening() -> Iterator[list[str]]:
    """Names of the signals that were received; a second SIGINT ends the process at once."""
    received: list[str] = []

    def remember(number: int, _: FrameType | None) -> None:
        received.append(signal.Signals(number).name)
        if number == signal.SIGINT:
            signal.signal(number, signal.SIG_DFL)

    # The shell lets a job in the background ignore SIGINT: an ignored signal stays ignored.
    all_of_them = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)
    before = {n: signal.signal(n, remember) for n in all_of_them if signal.getsignal(n) is not signal.SIG_IGN}
    try:
        yield received
    finally:
        for number, action in before.items():
            signal.signal(number, action)
