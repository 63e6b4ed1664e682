"""Packages that only some functions need."""

from __future__ import annotations

from importlib import import_module

from .errors import PackageError

__all__ = ["needed"]


def needed(package: str, user: str) -> None:
    """Import a package, or a module in one, before anything else is done; the `PackageError` names the function that needs it."""
    try:
        import_module(package)
    except ImportError as error:
        name = package.partition(".")[0]
        raise PackageError(f"{user} needs {name} ({error}): pip install {name}") from None
