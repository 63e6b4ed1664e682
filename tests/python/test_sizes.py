"""What a deck will need is weighed before anything is written, and `check` and `run` give one answer."""

from __future__ import annotations

import os
import random
import re
import resource
from collections.abc import Callable

import pytest
from programs import INPUTS, Program

FIG3 = (INPUTS / "fig3.nml").read_text()
SLOW = (INPUTS / "low_frequency.nml").read_text()
GRID = "\n&sweep\n  parameter = 'system.misalignment_deg'\n  first = 1.0, last = 8.0\n  count = {}\n  keep = '{}'\n/\n"
MEGABYTE = 1024**2

pytestmark = pytest.mark.deck


def limit(kind: int, value: int) -> Callable[[], None]:
    """For `preexec_fn`; besides, no test fills a disk."""

    def set_limits() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50 * MEGABYTE, 50 * MEGABYTE))
        resource.setrlimit(kind, (value, value))

    return set_limits


@pytest.fixture
def call(executable, tmp_path):
    """Run a command in an empty folder."""
    program = Program((executable,), tmp_path, {"OMP_NUM_THREADS": "2"}, {"PATH": os.environ["PATH"]})

    def run(*arguments, settings=(), limits=(resource.RLIMIT_CORE, 0), **environment):
        return program(*arguments, settings=settings, env=environment, preexec_fn=limit(*limits))

    return run


# --- one answer

# Values that a key may have, some of them faulty alone, some only with others.
VALUES = {
    "scene.model": ("full", "low_frequency", "high_frequency", "creep", "creep_asymptotic", "auto", "fool"),
    "scene.t_end": ("1e-3", "2e-3", "0.1", "1e300", "-1", ""),
    "scene.quantities": ("creep", "stick_slip"),
    "system.misalignment_deg": ("0", "1", "90", "180", "1e3"),
    "system.stiffness_y": ("1e7", "1e2", "0", ""),
    "system.mass": ("0.25", ""),
    "friction.contact": ("exact", "smoothed"),
    "friction.v_smooth": ("1e-6", ""),
    "friction.mu_0": ("0.2", "0", "-1"),
    "friction.law": ("constant", "weakening", ""),
    "drive.velocity": ("1e-3", "0", "1e-3,-1e-3", "1e-3,0"),
    "drive.time": ("0", "0,1e-3", "0,0,0"),
    "initial.elongation_x": ("0", "1", "1e-3"),
    "integrator.method": ("radau9", "rk4", "dopri5", "rodas4p", ""),
    "integrator.step": ("1e-5", "1e-300", ""),
    "integrator.rtol": ("1e-6", "1", ""),
    "output.interval": ("1e-3", "0", "1e-300", "1e-20", "1e-15", "1e300"),
    "output.fields": ("u_x", "zeta", "zeta,X", "theta,psi", "u_x,u_x", "default", "nothing"),
    "sweep.parameter": ("system.misalignment_deg", "friction.mu_0", "scene.t_end", "integrator.step", "no.key", ""),
    "sweep.count": ("2", "1e9", "1e12", "1.5"),
    "sweep.first": ("0.1", "-1"),
    "sweep.last": ("0.3", "1e400"),
    "sweep.keep": ("series", "summary", "cycles"),
    "sweep.spacing": ("log", "linear"),
    "sweep.points": ("points.csv", "none.csv"),
}  # fmt: skip


def awkward_settings(dice: random.Random) -> list[str]:
    """Some keys set to something; now and then a whole sweep."""
    keys = dice.sample([key for key in VALUES if not key.startswith("sweep")], dice.randint(1, 5))
    if dice.random() < 0.4:
        keys += [f"sweep.{key}" for key in ("parameter", "first", "last", "count")]
        keys += [key for key in ("sweep.keep", "sweep.spacing", "sweep.points") if dice.random() < 0.25]
    if "scene.t_end" not in keys:
        keys.append("scene.t_end")
    # The first value is mostly sound.
    return [f"{key}={VALUES[key][0] if dice.random() < 0.6 else dice.choice(VALUES[key][1:])}" for key in keys]


@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.full) for seed in range(6, 14))])
def test_check_and_run_give_one_answer(call, tmp_path, seed):
    """What `check` passes runs, and what it refuses is refused in the same words. In both there are enough of either kind."""
    dice = random.Random(seed)
    (tmp_path / "deck.nml").write_text(FIG3)
    (tmp_path / "points.csv").write_text("system.misalignment_deg\n1.0\n2.0\n")
    sound = refused = 0
    for _ in range(120):
        settings = awkward_settings(dice)
        checked = call("check", "deck.nml", settings=settings)
        # A run that takes long is one that began.
        if any(setting == "scene.t_end=1e300" for setting in settings) and checked.returncode == 0:
            continue
        done = call("run", "deck.nml", "--overwrite", "--quiet", settings=settings)
        if checked.returncode == 0:
            assert done.returncode in {0, 4, 5}, (settings, done.stderr)
            sound += 1
        else:
            assert (done.returncode, done.stderr) == (checked.returncode, checked.stderr), settings
            assert done.returncode in {2, 3}
            refused += 1
    assert sound > 12 and refused > 20, (sound, refused)


def test_nothing_runs_unless_all_decks_are_sound(call, tmp_path):
    """Also what only the simulation refuses is refused with its line, and before the first deck runs."""
    text = FIG3.replace("misalignment_deg = 1.0", "misalignment_deg = 0.0").replace("&output\n", "&output\n  fields = 'zeta'\n")
    (tmp_path / "bad.nml").write_text(text)
    (tmp_path / "good.nml").write_text(FIG3.replace("t_end = 10.0", "t_end = 1e-3"))
    place = text.splitlines().index("  fields = 'zeta'") + 1
    done = call("run", "good.nml", "bad.nml")
    assert done.returncode == 2 and not list(tmp_path.glob("*.h5"))
    assert re.match(rf"dynstiction: bad\.nml:{place}: .*zeta has no value.*\n$", done.stderr)


def test_all_faults_of_a_sweep_in_one_go(call, tmp_path):
    """Whatever else is wrong in the deck or in the group; and no fault that only follows from another."""
    sweep = (
        "&sweep\n parameter = 'system.misalignmnt_deg', 'friction.mu_0'\n first = 1.0, 'x'\n last = 2.0, 1e300\n"
        " count = 2.5, 3\n spacing = 'log', 'linear', 'log'\n keep = 'all'\n/\n"
    )
    (tmp_path / "bad.nml").write_text(FIG3.replace("mass =", "mas =") + sweep)
    done = call("check", "bad.nml")
    base = (FIG3.replace("mass =", "mas =")).count("\n")
    found = [int(line.split(":")[2]) - base for line in done.stderr.splitlines()]
    assert done.returncode == 2
    assert [line for line in found if line > 0] == [2, 3, 5, 6, 7], done.stderr
    assert sum(line < 0 for line in found) == 1 and "unknown key 'mas'" in done.stderr


# --- sizes

RK4 = ("integrator.method=rk4", "integrator.rtol=", "friction.contact=smoothed", "friction.v_smooth=1e-6")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("output.interval=1e-300",), "more than 2^53 samples"),
        (("scene.t_end=1e308", "output.interval=5e-324"), "below the range"),
        (("output.interval=1e-14", "output.fields=u_x,sticking"), "1e15 samples of 3 columns need 17 PB"),
        ((*RK4, "output.interval=0", "integrator.step=1e-14"), "raise integrator.step"),
    ],
)
def test_a_run_too_large_is_refused(call, tmp_path, settings, words):
    (tmp_path / "x.nml").write_text(FIG3)
    for command in ("check", "run"):
        done = call(command, "x.nml", settings=settings)
        assert done.returncode == (3 if " need " in done.stderr else 2) and words in done.stderr, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["x.nml"]


def test_the_limit_is_the_room_on_the_disk(call, tmp_path):
    """Of the folder of the output; not where the run is limited in time. Large sizes are printed."""
    (tmp_path / "x.nml").write_text(FIG3)
    disk = os.statvfs(tmp_path)
    free = disk.f_bavail * disk.f_frsize
    row = 15 * 8 + 1  # 16 columns, one of them of bytes
    for factor, status in ((0.5, 0), (2.0, 3)):
        settings = [f"output.interval={10.0 * row / (factor * free)!r}"]
        done = call("check", "x.nml", settings=settings)
        assert done.returncode == status, done.stderr
        assert ("will take" in done.stderr) == (status == 0 and factor * free > 1e9)
        assert call("check", "x.nml", settings=[*settings, "output.wall_limit=10"]).returncode == 0
    other = call("check", "x.nml", settings=[*settings, "output.file=/proc/x.h5"])
    assert other.returncode == 0, "/proc does not say how much room it has"


@pytest.mark.parametrize(
    ("count", "keep", "settings", "words"),
    [
        ("1e9, 1e9", "summary", (), "value(s) of 'count'"),
        ("1e9", "cycles", ("sweep.cycles=100",), "1e9 cases of {numbers} numbers"),
        ("2", "series", ("output.interval=1e-8", "output.fields=u_x,X,u_y"), "at most 2e9 numbers, 6.67e8 samples of its 3 columns"),
        ("4*1e9", "summary", ("sweep.parameter=system.misalignment_deg,friction.mu_0,friction.mu_inf,friction.v_f",
                              "sweep.first=4*0.1", "sweep.last=4*0.2"), "more than 1.0e9 cases"),
        ("1000000", "series", ("output.interval=1e-6",), "1e6 cases of"),
    ],
)  # fmt: skip
def test_a_sweep_too_large_is_refused(call, catalogue, tmp_path, count, keep, settings, words):
    # Six measures of a hundred cycles; five columns at the end, steps and wall time.
    words = words.format(numbers=6 * 100 + len(catalogue["summary"]) + 5 + 2)
    (tmp_path / "x.nml").write_text(SLOW.replace("rodas4p", "radau9") + GRID.format(count, keep))
    for command in ("check", "run"):
        done = call(command, "x.nml", settings=settings, limits=(resource.RLIMIT_AS, 2000 * MEGABYTE))
        assert done.returncode == (3 if "cases of" in words else 2) and words in done.stderr, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["x.nml"]


# --- memory and threads


def test_memory_that_cannot_be_had(call, tmp_path):
    (tmp_path / "x.nml").write_text(SLOW + GRID.format(200_000_000, "summary"))
    for size in (100, 200, 400):
        room = (resource.RLIMIT_AS, size * MEGABYTE)
        done = call("run", "x.nml", "--quiet", settings=["output.wall_limit=1"], limits=room)
        assert done.returncode == 4, done
        assert re.match(r"dynstiction: (x\.nml: )?no memory for .*\n$", done.stderr)


@pytest.mark.parametrize("command", ["run map.nml", "run fig3.nml", "check fig3.nml", "check bad.nml", "stability fig3.nml"])
def test_small_stacks(call, tmp_path, command):
    (tmp_path / "map.nml").write_text(SLOW + GRID.format(20, "summary"))
    (tmp_path / "fig3.nml").write_text(FIG3.replace("t_end = 10.0", "t_end = 0.1"))
    (tmp_path / "bad.nml").write_text(FIG3.replace(" = ", " == "))
    for kilobytes in (64, 128, 256):
        more = ("--quiet", "--overwrite") if command.startswith("run") else ()
        done = call(*command.split(), *more, limits=(resource.RLIMIT_STACK, 1024 * kilobytes))
        assert done.returncode == (2 if "bad" in command else 0), (kilobytes, done)


@pytest.mark.parametrize(
    "environment", [{"OMP_STACKSIZE": "16k"}, {"OMP_NUM_THREADS": "99999"}, {"OMP_NUM_THREADS": "300", "OMP_STACKSIZE": "16k"}]
)
@pytest.mark.parametrize("room", [None, 500])
def test_threads_that_cannot_be_had(call, tmp_path, environment, room):
    """A sweep runs with the threads that there are; each has the stack that it needs."""
    (tmp_path / "map.nml").write_text(SLOW + GRID.format(400, "summary"))
    limits = (resource.RLIMIT_AS, room * MEGABYTE) if room else (resource.RLIMIT_CORE, 0)
    done = call("run", "map.nml", "--quiet", limits=limits, **environment)
    assert done.returncode == 0, done


# --- names


def test_a_name_that_ends_with_a_blank_is_refused_and_others_are_taken_exactly(call, tmp_path):
    text = FIG3.replace("t_end = 10.0", "t_end = 1e-3")
    (tmp_path / "x.nml").write_text(text)
    for name in (" ", "x.h5 ", " x.h5 "):
        (tmp_path / "y.nml").write_text(text.replace("&output\n", f"&output\n  file = '{name}'\n"))
        for arguments in (("x.nml", "-o", name), ("x.nml", "--set", f"output.file={name}"), ("y.nml",), (f"x.nml{name[-1]}",)):
            done = call("run", *arguments)
            assert done.returncode in {1, 2} and "ends with a blank" in done.stderr, (arguments, done)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.nml", "y.nml"]
    names = {" x.h5", "a b.h5", "x.h5\t", "'x'.h5"}
    for name in names:
        assert call("run", "x.nml", "-o", name, "--quiet").returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == {"x.nml", "y.nml", *names}
