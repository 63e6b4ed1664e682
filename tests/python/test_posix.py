"""The operating system is asked in one C file, with the headers' own constants; with another C library, or without what only Linux
has, it compiles and does the same.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from programs import ROOT, Program

SOURCES = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.f90")}
POSIX_C, POSIX_F90 = ROOT / "src" / "system" / "posix.c", "src/system/posix.f90"
HDF5_F90 = "src/file/hdf5_tools.f90"
# Imports of posix.c by which no file and no process is reached: no fault of theirs is looked for.
HARMLESS = {
    "_exit", "abort", "calloc", "dup2", "execvp", "free", "getpid", "getppid", "getrlimit", "glob", "globfree",
    "gmtime_r", "isatty", "malloc", "prctl", "pthread_attr_destroy", "pthread_attr_init", "pthread_attr_setstacksize",
    "pthread_create", "pthread_join", "sched_getaffinity", "setitimer", "setrlimit", "setsid", "sigaction", "sigaddset",
    "sigemptyset", "sigprocmask", "statvfs", "strchr", "strcpy", "strerror", "strftime", "strlen", "time", "__errno_location",
    "__stack_chk_fail",
}  # fmt: skip
NUMBERS = {name.lower() for name in errno.errorcode.values()} | {
    name.lower() for name in [*signal.Signals.__members__, *dir(os)] if re.match(r"SIG[A-Z]|O_", name)
}


def bound_names(text: str) -> list[str]:
    """C names that a module declares, without those of its own procedures."""
    declared = re.sub(r"(?m)!.*$|^\s*type,.*$", "", text.split("\ncontains\n", maxsplit=1)[0])
    names = []
    for line in declared.splitlines():
        if found := re.search(r"(\w+)\s*\([^()]*\)\s*bind\(c(?:,\s*name\s*=\s*['\"](\w+)['\"])?\)", line, re.IGNORECASE):
            names.append(found[2] or found[1])
        elif re.search(r"\bbind\(c", line, re.IGNORECASE):
            names += re.findall(r"\w+", line.split("::")[-1])
    return names


def numbers(text: str) -> list[str]:
    """Constants of the system by number: a name of errno.h, signal.h or fcntl.h, or what is made to be handed to C as an int."""
    named = [name for name in re.findall(r"\b(\w+)\s*=\s*\d", text) if name.lower() in NUMBERS]
    return named + re.findall(r"integer\(c_(?:int|long|intptr_t)\),\s*parameter\s*::.*", text)


def test_one_module_declares_what_the_system_has_and_none_its_numbers() -> None:
    elsewhere = {
        file: names
        for file, text in SOURCES.items()
        if file not in (POSIX_F90, HDF5_F90) and (names := [name for name in bound_names(text) if (file, name) != ("src/file/ending.f90", "crc32")])
    }  # fmt: skip
    assert not elsewhere, f"declare them in {POSIX_F90}"
    of_the_library = re.findall(r"bind\(c, name='(\w+)'\)", SOURCES[HDF5_F90])
    assert len(of_the_library) > 10
    assert all(name.startswith(("H5", "dst_h5")) for name in of_the_library)
    # HDF5's own constants are its callers' business.
    found = {file: hits for file, text in SOURCES.items() if not file.startswith("src/file/") and (hits := numbers(text))}
    assert not found, "posix.c has the headers' constants"


def test_the_checks_find_what_they_look_for() -> None:
    for text, names, count in (
        ("interface\n integer(c_int) function c_kill(p, s) bind(c, name='kill')\n", ["kill"], 0),
        ("interface\n integer(c_int) function isatty(descriptor) bind(c)\n", ["isatty"], 0),
        ("integer(c_int), bind(c) :: one, two\n", ["one", "two"], 0),
        ("type, bind(c) :: t\n\ncontains\n  subroutine own(x) bind(c)\n", [], 0),
        ("integer(c_int), parameter :: would_block = 11\n", [], 1),
        ("integer, parameter :: sigterm = 15, other = 3\n", [], 1),
    ):
        assert (bound_names(text), len(numbers(text))) == (names, count), text


# What posix.c promises without its callers, on a folder of its own.
PROGRAM = r"""
#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <stdint.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
extern const int dst_o_rdwr, dst_o_creat, dst_o_excl, dst_o_nofollow, dst_eexist, dst_eloop;
int dst_utc(int64_t, char *), dst_open(const char *, int), dst_close(int), dst_fsync(int), dst_errno(void);
int dst_look_up(int, const char *, int64_t *), dst_write(int, const char *, int64_t, int64_t);
int64_t dst_read(int, char *, int64_t, int64_t), dst_matches(const char *, glob_t **, char ***), dst_now(void), dst_stack_limit(void);
void dst_set_file_size(int, int64_t), dst_forget_matches(glob_t *), *dst_begin_thread(void *(*)(void *), void *, int64_t);
void dst_join_thread(void *), dst_wait(double), dst_keep_mode(const char *, int);
double dst_free_space(const char *);

static void *mark(void *place) { *(int *)place = 7; return NULL; }

int main(void) {
  char text[21], bytes[8] = "", **names;
  int64_t facts[5], now[5];
  glob_t *found;
  int seven = 0;

  assert(dst_utc(951782400, text) && !strcmp(text, "2000-02-29T00:00:00Z"));
  assert(!dst_utc(INT64_MAX, text) && dst_now() > 1700000000);

  int file = dst_open("a[1]*.txt", dst_o_rdwr + dst_o_creat + dst_o_excl);
  assert(file >= 0 && (fcntl(file, F_GETFD) & FD_CLOEXEC));
  assert(dst_open("a[1]*.txt", dst_o_rdwr + dst_o_creat + dst_o_excl) < 0 && dst_errno() == dst_eexist);
  assert(symlink("a[1]*.txt", "link") == 0 && dst_open("link", dst_o_rdwr + dst_o_nofollow) < 0 && dst_errno() == dst_eloop);
  assert(dst_write(file, "abcdef", 6, -1) == 0 && dst_write(file, "XY", 2, 3) == 0);
  assert(dst_read(file, bytes, 8, 2) == 4 && !strcmp(bytes, "cXYf"));
  assert(dst_look_up(file, "", facts) == 0 && facts[0] && facts[1] == 6);
  dst_set_file_size(file, 5);
  chmod("a[1]*.txt", 0640);
  int other = dst_open("other", dst_o_rdwr + dst_o_creat);
  struct stat mode;
  dst_keep_mode("a[1]*.txt", other);
  assert(fstat(other, &mode) == 0 && (mode.st_mode & 0777) == 0640 && dst_close(other) == 0);
  assert(dst_look_up(-1, "a[1]*.txt", now) == 0 && now[1] == 5 && now[3] == facts[3] && now[4] == facts[4]);
  assert(dst_look_up(-1, "link", now) == 0 && !now[0] && dst_look_up(-1, "nothing", now) < 0 && dst_errno() == ENOENT);
  assert(dst_fsync(file) == 0 && dst_close(file) == 0 && dst_close(file) < 0);
  assert(dst_matches("a[1]*", &found, &names) == 1 && !strcmp(names[0], "a[1]*.txt"));
  dst_forget_matches(found);
  assert(dst_matches("a1", &found, &names) == 0);
  dst_forget_matches(found);
  assert(dst_free_space(".") > 0.0 && dst_free_space("nowhere") < 0.0);

  void *thread = dst_begin_thread(mark, &seven, 1 << 20);
  assert(thread);
  dst_join_thread(thread);
  assert(seven == 7 && dst_stack_limit() > 0);
  dst_wait(0.001);
  return 0;
}
"""
WAYS = ("", "-D_FILE_OFFSET_BITS=64 -D_POSIX_C_SOURCE=200809L", "-U__linux__ -D_XOPEN_SOURCE=700")


@pytest.mark.parametrize("compiler", ["cc", "musl-gcc"])
@pytest.mark.parametrize("flags", WAYS)
def test_it_compiles_and_works(compiler: str, flags: str, tmp_path: Path) -> None:
    """`-U__linux__` stands for the systems that are none: what only Linux has is left out."""
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    strict = [compiler, "-std=c11", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", *flags.split()]
    subprocess.run([*strict, "-c", str(POSIX_C), "-o", str(tmp_path / "posix.o")], check=True)
    program = tmp_path / "program.c"
    program.write_text(PROGRAM, encoding="utf-8")
    subprocess.run([compiler, "-pthread", "-D_GNU_SOURCE", program, tmp_path / "posix.o", "-o", tmp_path / "program"], check=True)
    folder = tmp_path / "folder"
    folder.mkdir()
    Program((tmp_path / "program",), folder)(status=0)


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


@pytest.mark.parametrize(
    ("here", "command", "told"),
    [
        ("program", "./dynstiction", "beside"),
        ("trap", "../program/dynstiction", "beside"),
        ("trap", "./link", "beside"),
        ("trap", "dynstiction", "of PATH"),
    ],
)
def test_python_is_found_without_proc(executable: Path, tmp_path: Path, here: str, command: str, told: str) -> None:
    """If the system does not give a program its own file, the word of its call is used; a word found in PATH is not a file here."""
    if subprocess.run(["unshare", "-rm", "mount", "-t", "tmpfs", "none", "/proc"], capture_output=True, check=False).returncode:
        pytest.skip("a user may not hide /proc here")
    for folder, word in (("program", "beside"), ("path", "of PATH"), ("trap", "of the folder here")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "python3").write_text(f"#!/bin/sh\necho {word}\n", encoding="utf-8")
        (tmp_path / folder / "python3").chmod(0o755)
    shutil.copy(executable, tmp_path / "program" / "dynstiction")
    (tmp_path / "trap" / "dynstiction").mkdir()
    (tmp_path / "trap" / "link").symlink_to(tmp_path / "program" / "dynstiction")
    (tmp_path / "path" / "dynstiction").symlink_to(tmp_path / "program" / "dynstiction")
    hidden = Program(("unshare", "-rm", "sh", "-c", 'mount -t tmpfs none /proc; exec "$0" plot'), tmp_path / here)
    done = hidden(command, env={"DYNSTICTION_PYTHON": None, "PATH": f"{tmp_path / 'path'}:{os.environ['PATH']}"}, status=0)
    assert (done.stdout, done.stderr) == (f"{told}\n", "")
