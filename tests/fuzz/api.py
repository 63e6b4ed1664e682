"""Random calls of the public Python API: no crash, no hang, only documented exceptions, no silent NaN.

``python tests/fuzz/api.py --calls 20000 --seed 1`` runs the calls in processes of their own, a batch each. A call follows from its
seed and number alone, so that ``--only NUMBER`` repeats one. What was found is printed; the exit status is 1 then.

An oracle of its own for each call: a function may return what it documents, or raise an `Error` of the package, MemoryError, or
TypeError where Python itself finds that an argument is missing or has no such name. Finite arguments give finite numbers where the
documentation mentions no NaN.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import faulthandler
import inspect
import math
import os
import pickle
import random
import resource
import subprocess
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import dynstiction as ds
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))

from fig3 import SLIDER, TEXT

BATCH = 500
"""Calls of one process."""

PATIENCE = 20.0
"""Seconds after which a call counts as hanging."""

MEMORY = 4 * 2**30

DECK = TEXT.replace("t_end = 10.0", "t_end = 0.02")

GOOD = {
    **SLIDER, "misalignment_deg": 1.1, "v_smooth": 1e-5, "theta": 0.3, "t": 0.5, "tau": 0.5, "phi": 0.1, "kappa": 1e-3,
    "above": 10.0, "window": 0.01, "count": 20, "until": 0.01,
}  # fmt: skip


class Cause(Exception):
    """What foreign objects raise."""


class Hostile:
    """An object that refuses whatever is asked of it."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise Cause("no array")

    def __float__(self) -> float:
        raise Cause("no float")

    def __repr__(self) -> str:
        raise Cause("no text")


class Objects:
    """What a process makes once: results, scenes and handles in every state."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.scene = ds.Scene(DECK)
        self.result = ds.run(self.scene)
        self.result.save(folder / "good.h5")
        (folder / "text.h5").write_text("no HDF5")
        (folder / "empty.h5").write_bytes(b"")
        (folder / "deck.nml").write_text(DECK)
        self.fork_safe = ds.Simulation(self.scene)
        self.closed = ds.Simulation(self.scene)
        self.closed.close()
        # By steps: with the map it would be at its end at once.
        self.busy = ds.Simulation(self.scene, scene={"t_end": 1e9}, output={"interval": 1e9}, integrator={"cycle_map": "off"})
        self.thread = threading.Thread(target=self._keep_busy, daemon=True)
        self.thread.start()
        time = np.arange(500) * 1e-3
        self.spectrum = ds.spectrogram(time, np.sin(300 * time), window=0.05)
        self.cycles = ds.stick_slip_statistics(self.result)

    def _keep_busy(self) -> None:
        with contextlib.suppress(ds.UsageError):
            self.busy.finish(progress=False)

    def end(self) -> None:
        """Close what is running, from another thread than its own."""
        self.busy.close()
        self.thread.join(PATIENCE)


def numbers(rng: random.Random) -> Any:
    """A number: ordinary, at an edge of the range, or none."""
    match rng.randrange(6):
        case 0:
            return rng.uniform(-2.0, 2.0)
        case 1:
            return rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-323.0, 308.0)
        case 2:
            return 10.0 ** rng.uniform(-6.0, 6.0)
        case 3:
            return rng.choice([0, 1, -1, 2**31, 2**63, 2**64, 10**30, 10**400, True, False])
        case 4:
            return rng.choice([0.0, -0.0, 5e-324, 2.3e-308, 1e308, 1.7976931348623157e308, math.pi / 2, 1.0])
        case _:
            return rng.choice([math.nan, math.inf, -math.inf])


def odd(rng: random.Random, objects: Objects) -> Any:
    """What no function asks for."""
    infinite: list[Any] = []
    infinite.append(infinite)
    return rng.choice(
        [
            None, "", "x", "1", "nan", b"bytes", "\0", "\ud800", "a\nb", "&scene /", "&scene", "é" * 300, 1j, [1j], [], [[]], {},
            {"a": 1}, {1: 2}, {"a\nb": {"c": 1}}, set(), object(), Hostile(), ds, ds.run, int, ..., slice(3), [None], ["a", 1],
            [[1, 2], [3]], infinite, np.array("x"), np.array([None]), np.ma.array([1.0, 2.0], mask=[0, 1]), np.float32(1), np.int8(3),
            np.longdouble("1e4000"), np.datetime64("2020-01-01"), np.empty((0, 4)), np.empty((3, 0)), np.broadcast_to(1.0, (2**40,)),
            np.ones((2,) * 9), np.ones((1, 4), order="F"), np.zeros((3, 4)), lambda: 0,
            (x for x in (1, 2)), Path("/"), Path("no.nml"), objects.folder, objects.scene, objects.result, objects.closed, objects.busy,
            objects.spectrum, objects.cycles, objects.folder / "text.h5", 10**5000, range(3), memoryview(b"12"),
        ]
    )  # fmt: skip


def argument(name: str, rng: random.Random, objects: Objects) -> Any:
    """A value for an argument, mostly one that is meant."""
    kind = rng.random()
    if kind < 0.55 and name in GOOD:
        good = GOOD[name]
        return good if isinstance(good, int) or rng.random() < 0.5 else good * 10.0 ** rng.uniform(-2, 2)
    if kind < 0.75:
        return numbers(rng)
    if kind < 0.9:
        shape = rng.choice([(), (1,), (3,), (2, 3), (4,), (0,), (3, 1), (5, 4)])
        values = np.array([GOOD.get(name, 1.0)] * math.prod(shape) or [], dtype=float).reshape(shape)
        for _ in range(rng.randrange(3)):
            if values.size:
                with warnings.catch_warnings(action="ignore"):
                    values.flat[rng.randrange(values.size)] = np.float64(numbers_as_float(rng))
        return values if rng.random() < 0.5 else values.tolist()
    return odd(rng, objects)


def numbers_as_float(rng: random.Random) -> float:
    """A number that is a float."""
    while True:
        value = numbers(rng)
        try:
            return float(value)
        except OverflowError:
            continue


def groups(rng: random.Random, objects: Objects) -> dict[str, Any]:
    """Overrides of a deck."""
    keys = {
        "scene": ["t_end", "model", "title"], "system": ["mass", "stiffness_x", "stiffness_y", "misalignment_deg"],
        "friction": ["mu_0", "mu_inf", "v_f", "normal_load", "law", "contact", "v_smooth"], "drive": ["velocity", "time"],
        "initial": ["velocity_ratio", "elongation_x"], "integrator": ["method", "rtol", "step", "max_steps"],
        "output": ["interval", "fields"], "sweep": ["count", "keep", "first"],
    }  # fmt: skip
    given: dict[str, Any] = {"integrator": {"max_steps": 2000}, "output": {"wall_limit": 0.3}}
    for _ in range(rng.randrange(3)):
        group = rng.choice(list(keys))
        if rng.random() < 0.1:
            given[group] = odd(rng, objects)
        elif isinstance(given.setdefault(group, {}), dict):
            given[group] = {**given[group], rng.choice(keys[group]): argument(rng.choice(list(GOOD)), rng, objects)}
    # Nobody waits for a run of 1e300 s, or one of 1e300 samples; but the sizes themselves are tested.
    if isinstance(given.get("integrator"), dict):
        given["integrator"].setdefault("max_steps", 2000)
    if isinstance(given.get("output"), dict):
        given["output"].setdefault("wall_limit", 0.3)
    return given


def deck(rng: random.Random, objects: Objects) -> Any:
    """What stands for a scene."""
    if rng.random() < 0.8:
        return rng.choice([DECK, objects.scene, objects.folder / "deck.nml"])
    return odd(rng, objects)


def keywords(function: Callable[..., Any], rng: random.Random, objects: Objects) -> dict[str, Any]:
    """Arguments for what a function names, each left out now and then where it has a default."""
    given = {}
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            continue
        if parameter.default is not parameter.empty and rng.random() < 0.4:
            continue
        given[name] = argument(name, rng, objects)
    return given


def call(rng: random.Random, objects: Objects) -> tuple[str, Callable[[], Any]]:
    """One call: its words, and what makes it."""
    kind = rng.random()
    if kind < 0.55:
        name = rng.choice(NUMERICAL)
        function = getattr(ds, name)
        given = keywords(function, rng, objects)
        if name in ("rhs", "jacobian") and rng.random() < 0.7:
            given["state"] = np.array([[numbers_as_float(rng) for _ in range(4)] for _ in range(rng.randrange(4))]).reshape(-1, 4)
        if name == "ridge" and rng.random() < 0.7:
            given["spectrum"] = objects.spectrum
        if name == "spectrogram" and rng.random() < 0.7:
            n = rng.choice([0, 1, 2, 10, 100, 300])
            given["time"] = np.arange(n) * 10.0 ** rng.uniform(-3, 3)
            given["values"] = np.sin(np.arange(n)) * 10.0 ** rng.choice([0.0, 0.0, 200.0, -200.0, 308.0])
        return f"{name}({short(given)})", lambda: checked(function(**given), given, name)
    if kind < 0.7:
        return run_call(rng, objects)
    return object_call(rng, objects)


def run_call(rng: random.Random, objects: Objects) -> tuple[str, Callable[[], Any]]:  # noqa: PLR0911
    """A run, a sweep, a comparison, a scene."""
    where, change = deck(rng, objects), groups(rng, objects)
    name = rng.choice(["run", "run", "Simulation", "Scene", "sweep", "sweep", "trade", "check", "group"])
    words = f"{name}({short(where)}, {short(change)})"
    if name == "group":
        kind = rng.choice([ds.Drive, ds.Friction, ds.Initial, ds.Integrator, ds.Output, ds.Setup, ds.Sweep, ds.System])
        field = rng.choice(list(kind.__dataclass_fields__))
        value = argument(field, rng, objects)
        return f"{kind.__name__}({field}={short(value)})", lambda: round_trip(kind(**{field: value}))
    if name == "check":
        return words, lambda: ds.Scene(where, **change).check()
    if name == "Scene":
        return words, lambda: round_trip(ds.Scene(where, **change))
    if name == "Simulation":
        times = [numbers(rng) for _ in range(2)]

        def steps() -> None:
            with ds.Simulation(where, **change) as simulation:
                for time in times:
                    simulation.step_to(time)

        return f"{words} step_to {times}", steps
    if name == "trade":
        budget = rng.choice([0.02, 1e-3, numbers(rng)])
        given = {
            "budget": min(budget, 0.05) if isinstance(budget, int | float) else budget,
            "quantities": rng.choice([(), ["period"], odd(rng, objects)]),
        }
        return f"{words} {short(given)}", lambda: ds.trade(where, **given, **change)
    if name == "sweep":
        axes = rng.choice([{rng.choice(["system.misalignment_deg", "drive.velocity", "system.mass", "no.key", "scene.t_end"]): argument("phi", rng, objects)}, odd(rng, objects)])  # fmt: skip
        threads = rng.choice([None, 1, 2, 10**9, numbers(rng), odd(rng, objects)])
        return f"{words} {short(axes)} threads={short(threads)}", lambda: ds.sweep(where, axes, threads=threads, **change)
    return words, lambda: round_trip(ds.run(where, **change))


def object_call(rng: random.Random, objects: Objects) -> tuple[str, Callable[[], Any]]:
    """A method of an object in one of its states, or a file."""
    simulation = rng.choice(["closed", "busy", "fresh"])
    path = rng.choice(["good.h5", "text.h5", "empty.h5", "new.h5", "no/new.h5", ".", "x" * 300, "a\0b"])
    target: Any = objects.folder / path if rng.random() < 0.8 else odd(rng, objects)
    value, other = argument("until", rng, objects), odd(rng, objects)

    def held() -> ds.Simulation:
        return ds.Simulation(objects.scene) if simulation == "fresh" else getattr(objects, simulation)

    def threads() -> None:
        """Two threads use one simulation, a third one closes it; or none does."""
        shared = ds.Simulation(objects.scene, scene={"t_end": 0.5})
        found: list[BaseException] = []

        def use() -> None:
            try:
                for time in np.linspace(0.0, 0.5, 5):
                    shared.step_to(time)
            except ds.UsageError:
                pass
            except BaseException as error:
                found.append(error)

        users = [threading.Thread(target=use) for _ in range(2)]
        for user in users:
            user.start()
        if rng.random() < 0.5:
            shared.close()
        for user in users:
            user.join()
        if found:
            raise found[0]

    def forked() -> None:
        """The child uses and frees its copies; those of the parent continue."""
        child = os.fork()
        if child == 0:
            status = 1
            try:
                objects.fork_safe.step_to(objects.fork_safe.t_end)
                objects.fork_safe.close()
                try:
                    objects.busy.step_to(1e9)
                except ds.UsageError:
                    status = 0
            finally:
                os._exit(status)
        if os.waitpid(child, 0)[1] != 0:
            raise AssertionError("the forked process failed")
        ds.Simulation(objects.scene).finish()

    choices: list[tuple[str, Callable[[], Any]]] = [
        (f"copy {simulation}", lambda: refused(lambda: rng.choice([copy.copy, copy.deepcopy, pickle.dumps])(held()))),
        (f"copy in a list {simulation}", lambda: refused(lambda: pickle.dumps([{"a": held()}]))),
        (f"step_to({short(value)}) {simulation}", lambda: held().step_to(value)),
        (f"state {simulation}", lambda: dict(held().state)),
        (f"result {simulation}", lambda: held().result),
        (f"events {simulation}", lambda: held().events),
        (f"repr {simulation}", lambda: (repr(held()), held().time, held().finished, held().scene)),
        (f"finish({short(other)}) {simulation}", lambda: held().finish(other) if simulation != "busy" else None),
        (f"save({short(target)})", lambda: objects.result.save(target, overwrite=rng.random() < 0.5)),
        (f"save(overwrite={short(other)})", lambda: objects.result.save(objects.folder / "new.h5", overwrite=other)),
        (f"open({short(target)})", lambda: ds.open(target)),
        (f"result[{short(other)}]", lambda: objects.result[other]),
        (f"cycles[{short(other)}]", lambda: objects.cycles[other]),
        (f"stick_slip_statistics({short(other)})", lambda: ds.stick_slip_statistics(other)),
        (f"Described({short(other)})", lambda: ds.Described(other)),
        (f"Scene({short(target)})", lambda: ds.Scene(target)),
        (f"Scene.replace({short(other)})", lambda: objects.scene.replace(system=other)),
        ("round trips", lambda: [round_trip(x) for x in (objects.result, objects.cycles, objects.spectrum, objects.scene)]),
        ("threads", threads),
        ("fork", forked),
    ]
    return rng.choice(choices)


NUMERICAL = [
    "creep_asymptotic", "creep_end", "creep_exact", "creep_frequency", "creep_velocity", "critical_misalignment", "damping_ratio", "jacobian",
    "oscillation_frequency", "rhs", "ridge", "spectrogram", "steady_sliding_eigenvalues",
]  # fmt: skip

MAY_BE_NAN = {"ridge", "critical_misalignment", "creep_end"}
"""Their documentation says where."""


def checked(returned: Any, given: dict[str, Any], name: str) -> None:
    """Refuse NaN and infinity that nobody has given."""
    arrays = returned if isinstance(returned, tuple) else (returned,)
    for array in arrays:
        if array.dtype.kind not in "fc":
            raise AssertionError(f"dtype {array.dtype}")
        if name == "critical_misalignment" and np.any(np.isinf(array)):
            raise AssertionError(f"infinite: {returned}")
        if name not in MAY_BE_NAN and not np.all(np.isfinite(array)):
            raise AssertionError(f"not finite: {returned}")


def refused(copying: Callable[[], Any]) -> None:
    """A handle is not copied."""
    try:
        copying()
    except TypeError as error:
        if "scene" in str(error):
            return
        raise AssertionError(f"no remedy: {error}") from error
    raise AssertionError("was copied")


def round_trip(thing: Any) -> None:
    """Copies are as good as the thing."""
    for again in (copy.copy(thing), copy.deepcopy(thing), pickle.loads(pickle.dumps(thing))):
        if repr(again) != repr(thing):
            raise AssertionError(f"{again!r} from {thing!r}")


def short(value: Any) -> str:
    """A value in few words."""
    try:
        return repr(value)[:200]
    except Exception:
        return f"<{type(value).__name__}>"


def allowed(error: BaseException) -> bool:
    """Whether an exception is one that the documentation names."""
    if isinstance(error, ds.Error | MemoryError):
        return True
    # Of Python itself, which binds the arguments of a call, and of dataclasses.
    frames = traceback.extract_tb(error.__traceback__)
    return isinstance(error, TypeError) and frames[-1].filename == __file__ and "argument" in str(error)


def one(seed: int, number: int, objects: Objects) -> str:
    """Make a call; what is wrong with it, or nothing."""
    rng = random.Random(f"{seed}:{number}")
    print(number, "is being made up", file=sys.stderr)
    words, make = call(rng, objects)
    print(number, " ".join(words.encode("ascii", "backslashreplace").decode().split()), file=sys.stderr)
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            warnings.simplefilter("ignore", ds.IncompleteWarning)
            make()
    except Exception as error:
        if not allowed(error):
            where = traceback.extract_tb(error.__traceback__)[-1]
            fault = f"{words}: {type(error).__name__}: {str(error)[:300]} [{Path(where.filename).name}:{where.lineno}]"
            return " ".join(fault.split())
    finally:
        faulthandler.cancel_dump_traceback_later()
    return ""


def batch(seed: int, first: int, count: int) -> None:
    """Calls in this process, with a limit of memory."""
    faulthandler.enable()
    # Before the limit: what is imported late would fail in a foreign place.
    import h5py  # noqa: F401, PLC0415  # fmt: skip

    with tempfile.TemporaryDirectory() as folder:
        # Wild paths are names in this folder.
        os.chdir(folder)
        objects = Objects(Path(folder))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        for number in range(first, first + count):
            if fault := one(seed, number, objects):
                print(f"{seed}:{number}: {fault}".encode("ascii", "backslashreplace").decode(), flush=True)
        objects.end()
    print("done", flush=True)


def findings(seed: int, calls: int) -> Iterator[str]:
    """Findings in the calls, each batch in a separate process; after a crash it continues after the call that crashed."""
    first = 0
    while first < calls:
        count = min(BATCH, calls - first)
        numbers_given = ("--batch", str(first), "--calls", str(count), "--seed", str(seed))
        command = [sys.executable, "-X", "faulthandler", os.path.abspath(__file__), *numbers_given]
        with tempfile.TemporaryFile("w+") as log:
            try:
                ended = subprocess.run(command, stdout=subprocess.PIPE, stderr=log, text=True, timeout=BATCH * 2.0, check=False)
                status, printed = ended.returncode, ended.stdout
            except subprocess.TimeoutExpired as late:
                status, printed = -1, (late.stdout or b"").decode()
            log.seek(0)
            lines = log.read().splitlines()
        yield from (line for line in printed.splitlines() if line != "done")
        first += count
        if status != 0 or not printed.endswith("done\n"):
            numbered = [line for line in lines if line.partition(" ")[0].isdecimal()]
            last = numbered[-1] if numbered else "before the first call"
            yield f"{seed}: the process ended with {status} in call {last}\n" + "\n".join(lines[-25:])
            if numbered:
                first = int(last.partition(" ")[0]) + 1


def main() -> int:
    """Run the calls, print what they find."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=20000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--batch", type=int, help="run calls from this number on in this process")
    parser.add_argument("--only", type=int, help="run the call of this number alone in this process")
    options = parser.parse_args()
    if options.batch is not None or options.only is not None:
        batch(options.seed, *((options.batch, options.calls) if options.only is None else (options.only, 1)))
        return 0
    found = 0
    for finding in findings(options.seed, options.calls):
        found += 1
        print(finding, flush=True)
    print(f"{options.calls} calls, seed {options.seed}: {found} findings")
    return min(found, 1)


if __name__ == "__main__":
    sys.exit(main())
