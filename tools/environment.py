"""tools/environment.py: what tools/setup.sh asks Python about the state of the checkout.

* `whole` prints what the environment in a folder lacks of a Python version and of the requirements in files, one fault a line. It reads what is
  there: versions and dependencies of packages, the size of each of their files, and the interpreter that their commands start.
* `network` prints those settings of pip's configuration files that say how packages are fetched, as NAME=VALUE, each with a NUL at its end.
  Settings that say what is installed, and where, are left out.
* `lock` waits until no other script has locked the open file with the given number, and locks it.
"""

from __future__ import annotations

import argparse
import configparser
import csv
import fcntl
import os
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

NETWORK = (
    "index-url",
    "extra-index-url",
    "no-index",
    "find-links",
    "trusted-host",
    "cert",
    "client-cert",
    "proxy",
    "timeout",
    "retries",
    "keyring-provider",
    "cache-dir",
    "no-cache-dir",
)
"""Names in pip's configuration files; tools/setup.sh has the same for the environment."""


def faults(folder: str, version: str, files: list[str]) -> Iterator[str]:
    """What the environment of this interpreter, which should be that of the folder, lacks of the requirements in the files."""
    if not os.path.isdir(folder) or not os.path.samefile(folder, sys.prefix) or sys.prefix == sys.base_prefix:
        yield f"{folder} is not an environment"
        return
    if version != (here := "{}.{}".format(*sys.version_info)):
        yield f"{folder} is of Python {here}"
        return
    try:
        from pip._vendor.packaging.requirements import Requirement  # noqa: PLC0415  pip may be what is missing.
    except ImportError:
        yield "pip is missing"
        return
    lines = [line for file in files for line in Path(file).read_text(encoding="utf-8").splitlines()]
    wanted = [Requirement(line) for line in lines if line.strip() and not line.startswith("#")]
    seen: set[tuple[str, frozenset[str]]] = set()
    while wanted:
        requirement = wanted.pop()
        key = requirement.name.lower(), frozenset(requirement.extras)
        if key in seen:
            continue
        seen.add(key)
        try:
            package = distribution(requirement.name)
        except PackageNotFoundError:
            yield f"{requirement.name} is missing"
            continue
        if not requirement.specifier.contains(package.version, prereleases=True):
            yield f"{requirement}: {package.version} is installed"
        yield from damage(package)
        for line in package.requires or ():
            further = Requirement(line)
            extras = requirement.extras or {""}
            if further.marker is None or any(further.marker.evaluate({"extra": extra}) for extra in extras):
                wanted.append(further)


def damage(package: Distribution) -> Iterator[str]:
    """Whether a file of the package is absent or cut short, or one of its commands starts another interpreter.

    Longer files are left alone: where a network is inspected, its administrators append certificates to those of packages.
    """
    name = package.metadata["Name"]
    rows = list(csv.reader((package.read_text("RECORD") or "").splitlines()))
    # pip writes the record again when everything else is there.
    if not any(row[0].endswith("/INSTALLER") for row in rows):
        yield f"{name} is not completely installed"
        return
    site = str(package.locate_file(""))
    for path, _, size in rows:
        if not size:
            continue
        file = os.path.join(site, path)
        try:
            found = os.stat(file).st_size
        except OSError:
            found = -1
        if found < int(size):
            yield f"{name}: {file} is {'absent' if found < 0 else 'cut short'}"
            return
        if path.startswith("../") and "/bin/" in path:
            head = Path(file).read_bytes()[:1000]
            if head.startswith(b"#!") and os.fsencode(sys.prefix) not in head:
                yield f"{name}: {file} starts the Python of another folder"
                return


def network() -> Iterator[str]:
    """Settings in pip's configuration files, in the order of pip's manual; the last one of a name counts."""
    home = Path(os.path.expanduser("~"))
    settings = os.environ.get
    files = [
        Path(folder) / "pip" / "pip.conf" for folder in (settings("XDG_CONFIG_DIRS") or "/etc/xdg").split(":")
    ]
    files += [Path("/etc/pip.conf"), home / ".pip" / "pip.conf"]
    files += [home / "Library" / "Application Support" / "pip" / "pip.conf"]
    files += [
        Path(settings("XDG_CONFIG_HOME") or home / ".config") / "pip" / "pip.conf",
        Path(sys.prefix) / "pip.conf",
    ]
    files += [Path(named)] if (named := settings("PIP_CONFIG_FILE")) else []
    found: dict[str, str] = {}
    for file in files:
        parser = configparser.RawConfigParser(strict=False)
        try:
            parser.read(file, encoding="utf-8")
        except (configparser.Error, OSError, UnicodeDecodeError) as error:
            print(f"{file} is left out: {str(error).splitlines()[0]}", file=sys.stderr)
            continue
        for section in ("global", "install"):
            if parser.has_section(section):
                found |= {key.replace("_", "-"): value for key, value in parser.items(section)}
    for name in NETWORK:
        variable = "PIP_" + name.upper().replace("-", "_")
        if found.get(name) and variable not in os.environ:
            yield f"{variable}={found[name]}"


def lock(number: int) -> None:
    """Lock the open file; on a file system without locks a line says so."""
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(
                "Another script of this checkout installs or compiles: waiting until it has finished",
                file=sys.stderr,
            )
            fcntl.flock(number, fcntl.LOCK_EX)
    except OSError as error:
        print(
            f"This file system has no locks ({error.strerror}): do not start two scripts of this checkout at the same time",
            file=sys.stderr,
        )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    whole = commands.add_parser("whole")
    for name in ("folder", "version"):
        whole.add_argument(name)
    whole.add_argument("requirements", nargs="+")
    commands.add_parser("network")
    commands.add_parser("lock").add_argument("number", type=int)
    arguments = parser.parse_args()
    if arguments.command == "whole":
        lacks = list(faults(arguments.folder, arguments.version, arguments.requirements))
        print(*lacks, sep="\n", end="\n" if lacks else "")
        return int(bool(lacks))
    if arguments.command == "network":
        for setting in network():
            sys.stdout.write(setting + "\0")
    if arguments.command == "lock":
        lock(arguments.number)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
