"""The operating system is asked in one C file, which compiles with another C library, and without what only Linux has."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from programs import ROOT

POSIX_C = ROOT / "src" / "system" / "posix.c"
# Imports of posix.c by which no file and no process is reached: no fault of theirs is looked for.
HARMLESS = {
    "_exit", "abort", "calloc", "dup2", "execvp", "free", "getpid", "getppid", "getrlimit", "glob", "globfree",
    "gmtime_r", "isatty", "malloc", "prctl", "pthread_attr_destroy", "pthread_attr_init", "pthread_attr_setstacksize",
    "pthread_create", "pthread_join", "sched_getaffinity", "setitimer", "setrlimit", "setsid", "sigaction", "sigaddset",
    "sigemptyset", "sigprocmask", "statvfs", "strchr", "strcpy", "strerror", "strftime", "strlen", "time", "__errno_location",
    "__stack_chk_fail",
}  # fmt: skip


WAYS = ("", "-D_FILE_OFFSET_BITS=64 -D_POSIX_C_SOURCE=200809L", "-U__linux__ -D_XOPEN_SOURCE=700")


@pytest.mark.parametrize("compiler", ["cc", "musl-gcc"])
@pytest.mark.parametrize("flags", WAYS)
def test_it_compiles(compiler: str, flags: str, tmp_path: Path) -> None:
    """`-U__linux__` stands for the systems that are none: what only Linux has is left out."""
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    strict = [compiler, "-std=c11", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", *flags.split()]
    subprocess.run([*strict, "-c", str(POSIX_C), "-o", str(tmp_path / "posix.o")], check=True)


def test_faults_reach_every_call(tmp_path: Path) -> None:
    """The shim of the fault tests intercepts every call of posix.c that affects a file or a process."""
    subprocess.run(["cc", "-D_FILE_OFFSET_BITS=64", "-O2", "-c", str(POSIX_C), "-o", str(tmp_path / "posix.o")], check=True)
    listing = subprocess.run(["nm", "-u", str(tmp_path / "posix.o")], check=True, capture_output=True, text=True).stdout
    imports = set(re.findall(r"\bU (\w+)", listing))
    shim = (ROOT / "tests" / "faults" / "shim.c").read_text(encoding="utf-8")
    assert {"open64", "pwrite64"} <= imports
    assert not [
        name
        for name in sorted(imports)
        if name.removesuffix("64") not in HARMLESS and not re.search(rf"(?:\w[ *]+{name}\(\w|BY_\w+\([\w *]+, {name},)", shim)
    ]
