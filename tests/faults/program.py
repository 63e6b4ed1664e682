"""The program under faults: start it with the shim, wait for it and all its children, and look at what is left."""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import struct
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))

from damage import CHECKSUM_LENGTH, sealed


def compiled_shim(folder: Path) -> Path:
    """The library of shim.c."""
    library = folder / "shim.so"
    source = Path(__file__).with_name("shim.c")
    compiler = os.environ.get("CC", "cc")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", source, "-o", library, "-ldl"], check=True)
    return library


@dataclass(frozen=True)
class Call:
    """A counted call of the system: `who` made it, as its `own`-th and as the `all`-th of the run."""

    who: str
    own: int
    all: int
    name: str
    letters: str
    path: str


@dataclass
class Ended:
    """How a run ended: exit status, or minus the signal; what it printed; its calls; the faults that struck it."""

    status: int
    text: str
    calls: list[Call] = field(default_factory=list)
    hits: list[Call] = field(default_factory=list)
    hung: bool = False


class Running:
    """A run under way."""

    def __init__(self, program: Program, server: Server, log: Path, output: Path) -> None:
        self.program, self.server, self.log, self.output = program, server, log, output
        self.process = server.process
        self.gates: list[Path] = []

    def wait_for_hold(self, seconds: float = 10.0) -> None:
        """Wait until the program is held."""
        end = time.monotonic() + seconds
        while not (self.log.exists() and re.search("^hit .* hold ", self.log.read_text(), re.MULTILINE)):
            if self.server.has_ended() or time.monotonic() > end:
                text = self.output.read_text() if self.output.exists() else ""
                raise AssertionError(f"it was not held: {text}")
            time.sleep(0.0005)

    def release(self, fault: int = 0) -> None:
        """Continue the process that the fault at this place of the list holds."""
        self.gates.append(self.log.with_suffix(f".gate{fault}"))
        self.gates[-1].touch()

    def wait(self, seconds: float = 30.0) -> Ended:
        """Wait until the run and all its children have ended; kill them when they do not."""
        status = self.server.status(seconds)
        hung = status is None
        if status is None:
            self.server.kill()
            status = self.server.status(seconds)
            assert status is not None, "processes cannot be killed"
        ended = Ended(os.waitstatus_to_exitcode(status), self.output.read_text(errors="replace"), hung=hung)
        if self.log.exists():
            for line in self.log.read_text(errors="replace").splitlines():
                words = line.removeprefix("hit ").split(" ", 5)
                if len(words) == 6:
                    call = Call(words[0], int(words[1]), int(words[2]), *words[3:])
                    (ended.hits if line.startswith("hit ") else ended.calls).append(call)
        self.program.give_back(self)
        return ended


class Server:
    """The program held where it begins; a copy of it runs for each request (see shim.c)."""

    def __init__(self, executable: Path, shim: Path) -> None:
        requests, self.to = os.pipe()
        self.replies, answers = os.pipe()
        sanitizer = os.environ.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0"
        environment = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
        environment |= {
            "FAULT_SERVER": f"{requests},{answers}",
            "LD_PRELOAD": str(shim),
            "OMP_NUM_THREADS": "1",  # the same calls each time
            "ASAN_OPTIONS": sanitizer,
        }
        self.popen = subprocess.Popen(
            [executable], stdin=subprocess.DEVNULL, env=environment, pass_fds=(requests, answers), start_new_session=True
        )
        os.close(requests)
        os.close(answers)
        self.process = 0

    def start(self, folder: Path, output: Path, settings: dict[str, str], arguments: list[str]) -> None:
        texts = [str(folder), str(output), str(len(settings)), *(f"{k}={v}" for k, v in settings.items()), *arguments]
        request = b"".join(os.fsencode(text) + b"\0" for text in texts)
        os.write(self.to, struct.pack("i", len(request)) + request)
        (self.process,) = struct.unpack("i", os.read(self.replies, 4))

    def has_ended(self) -> bool:
        return bool(select.select([self.replies], [], [], 0.0)[0])

    def status(self, seconds: float) -> int | None:
        """Wait status, or None if the run does not end in time."""
        if not select.select([self.replies], [], [], seconds)[0]:
            return None
        self.process = 0
        return struct.unpack("i", os.read(self.replies, 4))[0]

    def kill(self) -> None:
        """Kill the run and its children, which are a session."""
        if self.process:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process, signal.SIGKILL)

    def close(self) -> None:
        self.kill()
        os.close(self.to)
        os.close(self.replies)
        self.popen.wait(30)


class Program:
    """The executable under the shim. Use as a context, which ends all that it started."""

    def __init__(self, executable: Path, shim: Path | None = None) -> None:
        self.scratch = tempfile.TemporaryDirectory(prefix="faults-")
        self.executable = executable
        self.shim = shim or compiled_shim(Path(self.scratch.name))
        self.free: list[Server] = []
        self.busy: list[Server] = []
        self.count = 0

    def __enter__(self) -> Program:
        return self

    def __exit__(self, *_: object) -> None:
        self.end_all()
        for server in self.free:
            server.close()
        self.scratch.cleanup()

    def start(self, folder: Path, *arguments: object, fault: str = "", clock: float = 0.0, log: bool = False,
              **settings: object) -> Running:  # fmt: skip
        """Start the program in `folder`, with `fault` and the other settings of the shim; `clock`: seconds a look."""
        self.count += 1
        notes = Path(self.scratch.name) / f"{self.count}"
        output, lines = notes.with_suffix(".txt"), notes.with_suffix(".log")
        environment = {"FAULT_DIR": os.path.realpath(folder), "FAULT": fault, "FAULT_CLOCK": str(clock),
                       "FAULT_GATE": str(notes.with_suffix(".gate"))}  # fmt: skip
        if fault or log:
            environment["FAULT_LOG"] = str(lines)
        environment |= {name: str(value) for name, value in settings.items()}
        server = self.free.pop() if self.free else Server(self.executable, self.shim)
        self.busy.append(server)
        server.start(folder, output, environment, [str(self.executable), *map(str, arguments)])
        return Running(self, server, lines, output)

    def run(self, folder: Path, *arguments: object, seconds: float = 30.0, **how: object) -> Ended:
        """Run the program to its end; `how` as for `start`."""
        return self.start(folder, *arguments, **how).wait(seconds)

    def end_all(self) -> None:
        """End what still runs."""
        for server in self.busy:
            server.close()
        self.busy.clear()

    def give_back(self, run: Running) -> None:
        self.busy.remove(run.server)
        self.free.append(run.server)
        for path in (run.log, run.output, *run.gates):
            path.unlink(missing_ok=True)


def content(file: Path) -> dict[str, tuple]:
    """Every bit of a result but wall times and what depends on the moment."""
    found: dict[str, tuple] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and not name.endswith("wall_time"):
            value = item[()]
            bits = tuple(value) if item.dtype == object and item.shape else value
            found[name] = (item.shape, bits.tobytes() if isinstance(bits, (np.ndarray, np.generic)) else bits)

    with h5py.File(file) as data:
        data.visititems(visit)
        found |= {name: (str(data.attrs[name]),) for name in ("result_code", "complete", "deck_sha256")}
    return found


def is_complete(file: Path) -> bool:
    """Whether a file opens and says that it is complete."""
    try:
        with h5py.File(file) as data:
            return bool(data.attrs["complete"] == 1)
    except (OSError, KeyError):
        return False


def is_sealed(file: Path) -> bool:
    """Whether the file ends with the checksum of what is before it."""
    data = file.read_bytes()
    return data == sealed(data[:-CHECKSUM_LENGTH])


def fault_of_unfinished(file: Path, expected: dict[str, tuple]) -> str:
    """What is wrong with a file that a plain reader opens: its columns must begin like those expected. '' if nothing."""
    try:
        with h5py.File(file) as data:
            for group in ("time_series", "events"):
                lengths = set()
                for name, column in data.get(group, {}).items():
                    bits = column[()].tobytes()
                    lengths.add(len(column))
                    if f"{group}/{name}" not in expected or not expected[f"{group}/{name}"][1].startswith(bits):
                        return f"wrong numbers in {group}/{name}"
                if len(lengths) > 1:
                    return f"columns of {group} differ in length"
    except (OSError, RuntimeError, KeyError) as error:
        return f"does not open: {str(error)[:60]}"
    return ""


def snapshot(folder: Path) -> dict[str, tuple]:
    """What a folder holds: of each name what it is, and its bytes."""
    found: dict[str, tuple] = {}
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        what = os.readlink(path) if path.is_symlink() else b"folder" if path.is_dir() else path.read_bytes()
        found[str(path.relative_to(folder))] = (status.st_ino, status.st_mode, what)
    return found
