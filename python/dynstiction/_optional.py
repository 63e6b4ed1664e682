"""Packages that only some functions need."""

from __future__ import annotations

from importlib import import_module

from .errors import PackageError

__all__ = ["needed"]


def needed(package: str, user: str) -> None:
    """Make sure of a package; a function that needs one asks for it before it does anything else.

    Parameters
    ----------
    package : str
        The module that is imported: a package, or one in it.
    user : str
        What needs it, for the message.

    Raises
    ------
    PackageError
        If it cannot be imported.
    """
    try:
        import_module(package)
    except ImportError as error:
        name = package.partition(".")[0]
        raise PackageError(f"{user} needs {name} ({error}): pip install {name}") from None
