"""Random lives of a result file: run, stop, kill, full disk, hang-up, second copies, files moved about, resume.

    python tests/faults/sequences.py --count 500 --seed 1
    python tests/faults/sequences.py --seed 1 --only 123        # one of them, step by step

Each sequence ends with what a user would do last: resume without faults. Then the file must hold the bits of a run that nothing
happened to; or the program has refused with a reason, where the file or its checkpoint was removed or exchanged, or nothing had
been computed. On the way no file of others is touched, nothing hangs, and of several programs on one file one runs.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from faults import GRID, OWN, RESULT, Laboratory, close_laboratory, executable, laboratory, write_bystanders
from program import Ended, Running, content, fault_of_unfinished, is_complete, is_sealed, rows_of, snapshot
from programs import DONE, FILE_ERROR, INPUTS, STOPPED

# What the closed forms do not use.
ABSENT = ("system.mass=", "friction.law=", "initial.velocity_ratio=", "integrator.method=", "integrator.rtol=")
SMOOTHED = ("friction.contact=smoothed", "friction.v_smooth=1.0e-5")
FIG3 = ("scene.t_end=0.02", "output.interval=1e-4", "integrator.step_max=5e-5")
FIXED = ("integrator.step=2e-6", "integrator.rtol=", "scene.t_end=5e-4", "output.interval=1e-5")
CREEP = ("output.interval=1e-3", "scene.t_end=1.0")
# Decks by method and model; seconds that pass at a look at the clock, so that there are several flushes and checkpoints.
SCENES: dict[str, tuple[float, tuple[str, ...]]] = {
    "radau5": (0.08, ("fig3", "integrator.method=radau5", *FIG3)),
    "radau9": (0.12, ("fig3", *FIG3)),
    "radau13": (0.12, ("fig3", "integrator.method=radau13", *FIG3)),
    "dopri5": (0.02, ("fig3", "integrator.method=dopri5", "integrator.rtol=1e-6", *FIG3[:2])),
    "dop853": (0.04, ("fig3", "integrator.method=dop853", "integrator.rtol=1e-6", "output.interval=0", FIG3[0])),
    "rk4": (0.05, ("fig3", "integrator.method=rk4", *SMOOTHED, *FIXED)),
    "moreau_jean": (0.05, ("fig3", "integrator.method=moreau_jean", *FIXED)),
    "low_frequency": (0.05, ("slide_hold_slide", "scene.model=low_frequency", "system.stiffness_y=", "output.interval=1e-2",
                             "output.fields=u_x,w_y,sticking", "scene.t_end=5.5", "integrator.step_max=0.02")),
    "high_frequency": (0.0012, ("slide_hold_slide", "scene.model=high_frequency", "output.interval=1e-2",
                                "output.fields=u_y,X", "scene.t_end=5.1", "integrator.step_max=0.02")),
    "creep": (0.05, ("fig3_constant", "scene.model=creep", *ABSENT, *CREEP, "output.fields=u_x,X_rate")),
    "creep_asymptotic": (0.05, ("fig3_constant", "scene.model=creep_asymptotic", *ABSENT, "system.stiffness_y=", *CREEP,
                                "output.fields=X,X_rate")),
    "auto": (0.15, ("fig3", "scene.model=auto", *FIG3[:2])),
    "rest": (0.5, ("fig3", "drive.velocity=1e-9", "initial.velocity_ratio=0", "output.fields=u_x", "output.interval=1e-3",
                   "scene.t_end=1.0")),
}  # fmt: skip
SWEEP_TEXT = (INPUTS / "low_frequency.nml").read_text().replace("t_end = 10.0", "t_end = 0.5") + GRID
SWEEPS = {"sweep": SWEEP_TEXT + "/\n", "sweep with series": SWEEP_TEXT + "  keep = 'series'\n/\n"}
OFTEN = ("output.flush_seconds=0.4", "output.checkpoint_interval=0.7")
SIGNALS = ("TERM", "HUP", "INT", "USR1")
KILLS = ("kill:all", "kill:all", "group:all", "orphan:child")
FULL = ("ENOSPC+:all", "EDQUOT+:all", "EFBIG+:all", "ENOSPC:all")


class Wrong(Exception):
    """What must not be."""


class Sequence:
    """One life of a result file."""

    def __init__(self, lab: Laboratory, number: str, only: str | None = None) -> None:
        self.lab, self.program = lab, lab.program
        self.chance = random.Random(number)
        self.name = only or self.chance.choice([*SCENES, *SCENES, *SWEEPS])
        self.is_sweep = self.name in SWEEPS
        self.clock = 0.0 if self.is_sweep else SCENES[self.name][0]
        self.trace: list[str] = [self.name]
        self.folder = Path(tempfile.mkdtemp(prefix="life-", dir=lab.room))
        self.file = self.folder / RESULT
        self.is_small = not self.is_sweep and self.chance.random() < 0.15 and self.mount("size=200k")
        (self.folder / "sweep.nml").write_text(SWEEPS.get(self.name, ""))
        write_bystanders(self.folder)
        if not self.is_small:
            shutil.copy(lab.foreign, self.folder / "other.h5")
        self.before = snapshot(self.folder)
        # Whether someone else exchanged or removed the result or its checkpoint: then a refusal is right.
        self.is_meddled = False
        self.has_limit = False  # of wall time, in its deck
        self.faults: list[str] = []  # that do not end the sequence

    # A small disk.

    def mount(self, options: str) -> bool:
        if os.geteuid() != 0:
            return False
        command = ["mount", "-t", "tmpfs", "-o", options, "none", str(self.folder)]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0

    def close(self) -> None:
        if self.is_small:
            subprocess.run(["umount", "-l", str(self.folder)], check=True)
        shutil.rmtree(self.folder, ignore_errors=True)

    # Commands.

    def command(self, kind: str, file: str = RESULT) -> list[str]:
        if kind == "resume" and not self.is_sweep:
            return ["resume", file, "--quiet"]
        overwrite = ["--overwrite"] if kind == "run --overwrite" else []
        if self.is_sweep:
            return ["run", "sweep.nml", "-o", file, "--quiet", *overwrite]
        scene = SCENES[self.name][1]
        settings = [word for key in (*scene[1:], *OFTEN) for word in ("--set", key)]
        return ["run", str(INPUTS / f"{scene[0]}.nml"), "-o", file, "--quiet", *overwrite, *settings]

    def start(self, kind: str, fault: str = "", file: str = RESULT, extra: tuple[str, ...] = (), **settings: object) -> Running:
        what = f"{kind} {file if file != RESULT else ''} {fault} {' '.join(extra)} {settings or ''}"
        self.trace.append(" ".join(what.split()))
        return self.program.start(self.folder, *self.command(kind, file), *extra, fault=fault, clock=self.clock, **settings)

    def end(self, run: Running, *allowed: int, quiet: bool = False) -> Ended:
        """Wait, and look at how it ended and what is there."""
        ended = run.wait(20.0)
        self.trace.append(f"   -> {ended.status} {ended.text.strip()[:200]}")
        if ended.hung:
            raise Wrong("it hangs")
        if ended.status not in allowed and not (self.has_limit and ended.status == STOPPED):
            raise Wrong(f"exit status {ended.status}: {ended.text.strip()[:150]}")
        if ended.status > 0 and not ended.text.startswith("dynstiction: "):
            raise Wrong("it says nothing about its failure")
        if not quiet:
            if ended.status == DONE:
                self.check_result(self.file)
            self.check_files()
        return ended

    def length(self) -> int:
        """Number of calls of an undisturbed run."""
        return self.lab.lengths[self.name]

    def any_call(self) -> int:
        return 1 + int(self.length() * self.chance.random() ** 0.7)

    # What must hold at any time.

    def check_files(self) -> None:
        after = snapshot(self.folder)
        for name in self.before:
            if name not in OWN and after.get(name) != self.before[name]:
                self.faults.append(f"the file of others {name} is {'changed' if name in after else 'gone'}")
        self.before = {name: after[name] for name in self.before if name in after}

    def check_result(self, file: Path) -> None:
        if not is_complete(file):
            raise Wrong("all seems well, but the file is not complete")
        if numbers(file) != self.lab.numbers[self.name]:
            raise Wrong("all seems well, but the numbers differ")
        if not is_sealed(file):
            raise Wrong("all seems well, but the file is not sealed")

    def check_unfinished(self, file: Path) -> None:
        if file.exists() and not self.is_sweep:
            what = fault_of_unfinished(file, self.lab.numbers[self.name])
            if what:
                raise Wrong(f"the file {what}")

    def must_resume(self) -> bool:
        """Whether a refusal would lose something."""
        return not (self.is_meddled or self.is_sweep or rows_of(self.file) == 0 or is_complete(self.file))

    # What may happen.

    def next_kind(self) -> str:
        if self.is_sweep or not self.file.exists():
            return "run"
        return self.chance.choice(["resume", "resume", "resume", "run --overwrite"])

    def disturbed(self) -> None:
        """A run or resume that is stopped, killed, or finds the disk full."""
        kind = self.next_kind()
        resumes = kind == "resume" and self.must_resume()
        was_complete = is_complete(self.file)
        what = self.chance.choice(("signal", "kill", "full", "limit", "wall", "nothing"))
        n = self.any_call()
        allowed: tuple[int, ...] = (DONE, FILE_ERROR)
        fault, settings, extra = "", {}, ()
        if what == "signal":
            fault = f"{self.chance.choice(SIGNALS)}:parent:{n}"
            allowed = (DONE, STOPPED, FILE_ERROR, -1, -2, -10, -15)
        elif what == "kill":
            fault, allowed = f"{self.chance.choice(KILLS)}:{n}", (DONE, -9, FILE_ERROR)
        elif what == "full":
            fault = f"{self.chance.choice(FULL)}:{n}"
        elif what == "limit":
            settings = {"FAULT_FSIZE": self.chance.randrange(1000, 80000)}
        elif what == "wall" and kind != "resume":
            self.has_limit = True
            extra = ("--set", f"output.wall_limit={self.chance.uniform(0.1, 3.0):.3f}")
            allowed = (DONE, STOPPED, FILE_ERROR)
        ended = self.end(self.start(kind, fault, extra=extra, **settings), *allowed)
        if kind == "run --overwrite" and ended.status in (DONE, STOPPED):
            self.is_meddled = False
        self.check_unfinished(self.file)
        if resumes and ended.status == FILE_ERROR and what in ("nothing", "signal", "wall"):
            raise Wrong(f"refused: {ended.text.strip()[:150]}")
        if was_complete and kind == "resume" and not is_complete(self.file):
            raise Wrong("a complete file is damaged")

    def second_copies(self) -> None:
        """While one program is held somewhere, others start on the same file: they are refused and disturb nothing."""
        kind = self.next_kind()
        resumes = kind == "resume" and self.must_resume()
        after_kill = self.chance.random() < 0.3
        n = self.any_call()
        first = self.start(kind, f"hold:all:{n}")
        with contextlib.suppress(AssertionError):
            first.wait_for_hold()
        is_held = bool(first.holds()) and not first.server.has_ended()
        self.trace.append(f"   held: {first.holds()}")
        is_placed = self.file.exists()
        old = snapshot(self.folder)
        others = [self.start(self.chance.choice(["run", "resume", "run --overwrite"])) for _ in range(self.chance.randrange(1, 4))]
        # At the very first calls the program has not got hold of anything yet: the lock may be a stale one.
        lock = self.folder / f"{RESULT}.lock"
        has_lock = n > 30 if self.is_sweep else lock.exists() and f"process {first.process}\n" in lock.read_text()
        if is_held and has_lock:
            for other in others:
                ended = self.end(other, DONE, FILE_ERROR, quiet=True)
                if ended.status != FILE_ERROR:
                    raise Wrong("a second program runs at the same time")
                reasons = ("process", "exists") if is_placed else ("process", "no such file")
                if not any(reason in ended.text for reason in reasons):
                    raise Wrong(f"a second program is refused for another reason: {ended.text.strip()[:120]}")
            # The child of a program that waits for it, and other threads, continue.
            is_still = not self.is_sweep and "waitpid" not in first.holds()[0]
            if is_still and snapshot(self.folder) != old:
                raise Wrong("a second program changes files")
            others = []
        if after_kill:
            first.kill_group()
            self.trace.append("   the first is killed")
        first.release()
        ended = self.end(first, DONE, FILE_ERROR, *((-9,) if after_kill else ()), quiet=bool(others))
        if not others and not after_kill and resumes and ended.status == FILE_ERROR:
            raise Wrong(f"the first is disturbed: {ended.text.strip()[:120]}")
        endings = [ended.status, *(self.end(other, DONE, FILE_ERROR, quiet=True).status for other in others)]
        if DONE in endings:
            self.check_result(self.file)
        self.check_unfinished(self.file)
        self.check_files()
        if kind == "run --overwrite":
            self.is_meddled = False

    def all_at_once(self) -> None:
        """Several programs begin together: one does it, the others are refused."""
        kind = "run" if self.is_sweep or not self.file.exists() else "resume"
        resumes = self.must_resume() or (kind == "run" and not self.is_sweep)
        calls = [self.chance.randrange(1, 60) for _ in range(self.chance.randrange(2, 5))]
        runs = [self.start(kind, f"hold:all:{n}") for n in calls]
        for run in runs:
            with contextlib.suppress(AssertionError):
                run.wait_for_hold(seconds=0.05)
        for run in runs:
            run.release()
        ended = [self.end(run, DONE, FILE_ERROR, quiet=True) for run in runs]
        done = sum(one.status in (DONE, STOPPED) for one in ended)
        if resumes and done != 1 and not (self.is_small and done == 0):
            raise Wrong(f"of {len(runs)} programs at once {done} end with 0")
        if any(one.status == DONE for one in ended):
            self.check_result(self.file)
        self.check_unfinished(self.file)
        self.check_files()

    def meddling(self) -> None:
        """Someone moves files about between two runs."""
        if self.is_sweep or not self.file.exists():
            return
        checkpoint = self.file.with_name(f"{RESULT}.checkpoint")
        what = self.chance.choice(("rename", "rename", "put back", "no checkpoint", "no result", "older result"))
        self.trace.append(f"user: {what}")
        if what == "rename":
            self.under_another_name(checkpoint)
            return
        aside = [path.with_name(f"aside-{path.name}") for path in (self.file, checkpoint)]
        if what in ("put back", "older result"):
            for path, copy in zip((self.file, checkpoint), aside, strict=True):
                if path.exists():
                    shutil.copy2(path, copy)
            must = self.must_resume()
            self.disturbed()
            if what == "older result" or not aside[1].exists():
                self.is_meddled = True
                aside[0].rename(self.file)
            else:
                aside[0].rename(self.file)
                aside[1].rename(checkpoint)
                self.is_meddled = not must
            aside[1].unlink(missing_ok=True)
        elif what == "no checkpoint":
            checkpoint.unlink(missing_ok=True)
            self.is_meddled = True
        else:
            self.file.unlink()
            self.is_meddled = True

    def under_another_name(self, checkpoint: Path) -> None:
        """Both files get another name, the run is resumed there, and they come back."""
        must = self.must_resume()
        pairs = [(path, path.with_name(path.name.replace(RESULT, "z.h5"))) for path in (self.file, checkpoint)]
        for path, other in pairs:
            if path.exists():
                path.rename(other)
        fault = self.chance.choice(("", f"TERM:parent:{self.any_call()}", f"kill:all:{self.any_call()}"))
        ended = self.end(self.start("resume", fault, file="z.h5"), DONE, STOPPED, FILE_ERROR, -9, -15, quiet=True)
        if ended.status == FILE_ERROR and must:
            raise Wrong(f"refused under another name: {ended.text.strip()[:120]}")
        for path, other in pairs:
            if other.exists():
                other.rename(path)
        for path in self.folder.glob("z.h5*"):
            path.unlink()

    def exchanged_while_it_runs(self) -> None:
        """The file of a run under way is removed or exchanged: what stands there then is not the run's."""
        if self.is_sweep or self.is_small:
            return
        kind = "run --overwrite" if self.file.exists() else "run"
        # At its last calls it has done with the file.
        run = self.start(kind, f"hold:all:{min(self.any_call(), self.length() - 40)}")
        with contextlib.suppress(AssertionError):
            run.wait_for_hold()
        self.file.unlink(missing_ok=True)
        shutil.copy(self.folder / "other.h5", self.file)
        is_early = not run.server.has_ended()
        self.trace.append("user: another file under the name of the result")
        theirs = self.file.read_bytes()
        is_new = kind == "run"
        run.release()
        ended = self.end(run, DONE, FILE_ERROR, quiet=True)
        # What was asked to overwrite may do so until it has put its own file there.
        if is_early and self.file.read_bytes() != theirs and (is_new or ended.status != DONE):
            raise Wrong("another's file under the name of the result is changed")
        if is_early and self.file.read_bytes() == theirs and ended.status == DONE:
            raise Wrong("exit status 0, but the result is gone")
        if ended.status == DONE:
            self.check_result(self.file)
        if self.file.read_bytes() == theirs:
            self.file.unlink()
        self.is_meddled = True
        self.check_files()

    # The whole life.

    def live(self) -> None:
        acts: list[Callable[[], None]] = [self.disturbed] * 6
        acts += [self.second_copies] * 2 + [self.all_at_once, self.meddling, self.meddling, self.exchanged_while_it_runs]
        for _ in range(self.chance.randrange(2, 7)):
            self.chance.choice(acts)()
        if self.is_small:
            self.trace.append("there is room again")
            command = ["mount", "-o", "remount,size=4m", str(self.folder)]
            subprocess.run(command, check=True)
        self.finish()

    def finish(self) -> None:
        """Resume to the end without faults."""
        must = self.must_resume()
        for _ in range(200):
            kind = "run" if self.is_sweep or not self.file.exists() else "resume"
            ended = self.end(self.start(kind), DONE, STOPPED, FILE_ERROR)
            if ended.status != STOPPED:
                break
            del self.trace[-2:]
        if ended.status == FILE_ERROR and is_complete(self.file) and ("complete" in ended.text or self.is_sweep):
            if numbers(self.file) != self.lab.numbers[self.name]:
                raise Wrong("the finished numbers differ")
        elif ended.status == FILE_ERROR:
            if must or self.is_sweep:
                raise Wrong(f"refused: {ended.text.strip()[:150]}")
            if ended.text.count("\n") != 1 or ": " not in ended.text:
                raise Wrong(f"no honest refusal: {ended.text}")
            self.end(self.start("run --overwrite"), DONE)
        elif ended.status != DONE:
            raise Wrong("it is stopped again and again")
        left = {path.name for path in self.folder.iterdir()} - set(self.before) - {RESULT}
        if left:
            raise Wrong(f"left behind: {', '.join(sorted(litter_kind(name) for name in left))}")


def litter_kind(name: str) -> str:
    for kind in ("lock", "checkpoint", "shard"):
        if kind in name:
            return kind
    return "scratch file"


def numbers(file: Path) -> dict[str, tuple]:
    """What does not depend on how the run was stopped."""
    return {name: bits for name, bits in content(file).items() if not name.startswith(("deck", "parameters", "statistics/wall"))}


class Lives(Laboratory):
    """Sequences, and what they are compared with."""

    def __init__(self, lab: Laboratory) -> None:
        super().__init__(lab.program, lab.room)
        self.numbers: dict[str, dict[str, tuple]] = {}
        self.lengths: dict[str, int] = {}
        self.foreign = self.room / "foreign.h5"

    def learn(self, name: str) -> None:
        """Run a scene without faults."""
        if not self.foreign.exists():
            where = self.room / "foreign"
            where.mkdir()
            deck = str(INPUTS / "low_frequency.nml")
            self.program.run(where, "run", deck, "-o", "o.h5", "--quiet", "--set", "scene.t_end=0.1")
            (where / "o.h5").rename(self.foreign)
        if name not in self.numbers:
            self.numbers[name], self.lengths[name] = {}, 0
            first = Sequence(self, "reference", only=name)
            ended = self.program.run(first.folder, *first.command("run"), clock=first.clock, log=True)
            assert ended.status == DONE, ended.text
            self.numbers[name], self.lengths[name] = numbers(first.file), len(ended.calls)
            first.close()


def try_sequence(lives: Lives, number: str) -> tuple[list[str], list[str]]:
    """What is wrong, and the trace."""
    for name in (*SCENES, *SWEEPS):
        lives.learn(name)
    sequence = Sequence(lives, number)
    try:
        sequence.live()
    except Wrong as wrong:
        sequence.faults.append(str(wrong))
    finally:
        lives.program.end_all()
        sequence.close()
    return sorted(set(sequence.faults)), sequence.trace


def try_sequences(seeds: list[str]) -> list[tuple[str, list[str], list[str]]]:
    """For a process of its own."""
    lives = Lives(laboratory())
    try:
        return [(seed, *try_sequence(lives, seed)) for seed in seeds]
    finally:
        close_laboratory()
        laboratory.cache_clear()


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--count", type=int, default=500)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only", type=int, help="this one only, with its steps")
    options.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    given = options.parse_args()
    executable()
    seeds = [f"{given.seed}-{i}" for i in range(given.count)]
    if given.only is not None:
        seeds = [f"{given.seed}-{given.only}"]
    pieces = [seeds[i : i + 25] for i in range(0, len(seeds), 25)]
    results = []
    with ProcessPoolExecutor(given.jobs) as pool:
        for done in pool.map(try_sequences, pieces):
            results += done
    kinds: Counter[str] = Counter()
    for seed, faults, trace in results:
        kinds.update(fault[:80] for fault in faults)
        if faults or given.only is not None:
            print(f"sequence {seed}: {'; '.join(faults) or 'sound'}")
            if given.only is not None or min(kinds[fault[:80]] for fault in faults) <= 2:
                print(*(f"    {line}" for line in trace), sep="\n")
    for wrong, count in kinds.most_common():
        print(f"{count:5} x {wrong}")
    failures = sum(bool(faults) for _, faults, _ in results)
    print(f"{len(results) - failures} of {len(results)} sequences sound")
    return failures > 0


if __name__ == "__main__":
    sys.exit(main())
