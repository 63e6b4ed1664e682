"""The exceptions of the package; every one of them is an `Error`."""

from __future__ import annotations

from typing import Self


def printable(text: str) -> str:
    """Text that is safe to print: control characters and line breaks, which foreign names and files may contain, become ``?``."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


class Error(Exception):
    """Base class of all errors of dynstiction.

    Attributes
    ----------
    exit_status : int
        Exit status of a command that fails with this error.
    """

    exit_status = 1

    def __str__(self) -> str:  # not that of KeyError, which prints the repr of the message
        return printable(str(self.args[0]) if self.args else "")


class UsageError(Error, ValueError):
    """A function was called with arguments that are not valid."""


class ColumnError(UsageError, KeyError):
    """A result has no column, or its summary has no value, with this name; the text gives the nearest name."""


class PackageError(UsageError, ImportError):
    """A function needs a package that is not installed; the text says how to install it."""


class DeckError(Error, ValueError):
    """A deck was refused; each line of the text gives one fault with its file, its line and what would be right."""

    exit_status = 2

    def __str__(self) -> str:
        return "\n".join(map(printable, str(self.args[0]).split("\n"))) if self.args else ""


class FileError(Error, OSError):
    """A file is missing, damaged, of another program, or exists already."""

    exit_status = 3


class SolverError(Error):
    """The solver gave up.

    Attributes
    ----------
    code : int
        41 step underflow, 42 too many steps, 43 not finite, 44 too many rejections, 45 chattering,
    result : Result or None
        The result until then.
    """

    exit_status = 4

    def __init__(self, message: str, code: int, result: object = None) -> None:
        super().__init__(message, code, result)
        self.code = code
        self.result = result


class OutOfMemoryError(SolverError, MemoryError):
    """A run needed more memory than there is; `code` is 47."""

    def __new__(cls, *args: object) -> Self:
        # MemoryError's own __new__ would refuse this class when a copy is made, as for another process.
        return Exception.__new__(cls, *args)


class IncompleteWarning(UserWarning):
    """A result ends before the `t_end` of its deck."""

    def __str__(self) -> str:
        return printable(super().__str__())


class SamplingWarning(UserWarning):
    """The samples of a run are too far apart to show its fast oscillation: figures show an oscillation that does not exist."""


class StiffnessWarning(UserWarning):
    """An explicit method will need many steps on a stiff scene: the text says how many, and which method is faster."""


class FitWarning(UserWarning):
    """The result of a fit must be used with care: the text says why."""


SOLVER_GAVE_UP = range(40, 50)
OUT_OF_MEMORY = 47
_ERROR_OF_STATUS: dict[int, type[Error]] = {1: UsageError, 2: DeckError, 3: FileError}


def error_for(status: int, message: str) -> Error:
    """Exception for a status code of the core (> 0) and its message."""
    if status == OUT_OF_MEMORY:
        return OutOfMemoryError(message, status)
    if status in SOLVER_GAVE_UP:
        return SolverError(message, status)
    return _ERROR_OF_STATUS.get(status, Error)(message)
