"""Programs as a user calls them, and what tests do to them: wait, end, limit, a small disk."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import pty
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import ModuleType

import h5py
import pytest

ROOT = Path(__file__).resolve().parents[2]


def script(path: Path) -> ModuleType:
    """A script outside the package, as a module. Its dataclasses and named tuples look for it among the modules."""
    specification = importlib.util.spec_from_file_location(path.stem, path)
    assert specification and specification.loader
    sys.modules[path.stem] = module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


INPUTS = ROOT / "inputs"
DONE, FILE_ERROR, STOPPED = 0, 3, 75
"""Exit statuses: docs/errors.md."""


@dataclass(frozen=True)
class Program:
    """A command with its first words. Called with the others it runs to its end; `start` runs it in the background."""

    first: tuple[object, ...]
    folder: Path | None = None
    env: Mapping[str, str | None] = field(default_factory=dict)
    """Variables besides `base`; None takes one out."""
    base: Mapping[str, str] = field(default_factory=lambda: os.environ)

    def words(self, *arguments: object, settings: Iterable[str] = ()) -> list[str]:
        return [*map(str, (*self.first, *arguments)), *(word for setting in settings for word in ("--set", setting))]

    def options(self, env: Mapping[str, str | None] | None = None, **options: object) -> dict[str, object]:
        """Options of `subprocess`: text in UTF-8, in our folder, unless others are given."""
        variables = {k: v for k, v in {**self.base, **self.env, **(env or {})}.items() if v is not None}
        return {"cwd": self.folder, "encoding": "utf-8", "env": variables, **options}

    def __call__(
        self,
        *arguments: object,
        settings: Iterable[str] = (),
        status: int | None = None,
        timeout: float | None = 600.0,
        **options: object,
    ) -> subprocess.CompletedProcess[str]:
        """Status, output and errors; `status` is the only one that may be."""
        given = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **self.options(**options)}
        done = subprocess.run(self.words(*arguments, settings=settings), timeout=timeout, check=False, **given)
        assert status in (None, done.returncode), done
        return done

    def start(self, *arguments: object, settings: Iterable[str] = (), **options: object) -> subprocess.Popen[str]:
        """A process in the background; its errors can be read."""
        given = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, **self.options(**options)}
        return subprocess.Popen(self.words(*arguments, settings=settings), **given)


def assert_refused(done: subprocess.CompletedProcess[str], *words: str) -> None:
    """As a file that cannot be read or written, in a line or two."""
    assert done.returncode == FILE_ERROR and done.stderr.startswith("dynstiction: "), done
    assert len(done.stderr.splitlines()) <= 2, done.stderr
    for word in words:
        assert word in done.stderr


PACKAGE = Program((sys.executable, "-m", "dynstiction"))
SCRIPT = Program((sys.executable, "-c"))
"""Python code in a process of its own."""


def executable() -> Path:
    """The program under test: DYNSTICTION_EXE, beside this Python, or on the PATH."""
    if named := os.environ.get("DYNSTICTION_EXE"):
        assert Path(named).is_file(), f"DYNSTICTION_EXE={named} is no file"
        return Path(named).absolute()
    search = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    found = shutil.which("dynstiction", path=search)
    if found is None:
        pytest.fail("no executable: set DYNSTICTION_EXE or put dynstiction on the path")
    return Path(found)


def opened(file: Path) -> h5py.File:
    """An HDF5 file, also in the microseconds in which the program that has given it its name has it locked."""
    for _ in range(100):
        with contextlib.suppress(BlockingIOError):
            return h5py.File(file)
        time.sleep(0.01)
    return h5py.File(file)


def wait_until(condition: Callable[[], object], what: object = "that", seconds: float = 60.0) -> None:
    """Wait for what comes true sooner or later."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what} did not come true in time"
        time.sleep(0.002)


def end_group(process: subprocess.Popen[str]) -> None:
    """Kill a process that began a session of its own, with all its children."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait(30)


def on_terminal(start: Callable[..., subprocess.Popen[str]]) -> str:
    """What a program that is started by this writes to a terminal as its standard error, until it ends; with status 0 or 75."""
    ours, theirs = pty.openpty()
    process = start(stderr=theirs)
    os.close(theirs)
    text = b""
    # Linux: an error when the other end was closed.
    with contextlib.suppress(OSError):
        while data := os.read(ours, 4096):
            text += data
    os.close(ours)
    assert process.wait(60) in (DONE, STOPPED)
    return text.decode()


def limited(kind: int, value: int) -> Callable[[], None]:
    """For `preexec_fn`: a limit of the system."""
    return partial(resource.setrlimit, kind, (value, value))


@contextlib.contextmanager
def small_disk(folder: Path, size: str) -> Iterator[Callable[[str], object]]:
    """A file system of this size, at a new folder; what is given makes it larger."""
    folder.mkdir()
    mount = Program(("mount",))
    if os.geteuid() != 0 or not shutil.which("mount") or mount("-t", "tmpfs", "-o", f"size={size}", "none", folder).returncode:
        pytest.skip("a small disk cannot be mounted here: not root, or mount is not permitted")
    try:
        yield lambda size: mount("-o", f"remount,size={size}", folder, status=0)
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)
