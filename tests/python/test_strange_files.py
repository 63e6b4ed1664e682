"""Result files of strangers, made to lead their reader out of the file, or to fill the memory: refused, and soon.

`hostile` makes 300 of ten kinds. Every one is read in a process of its own, whose memory and time are measured.
"""

from __future__ import annotations

import csv
import json
import resource
import shutil
from pathlib import Path

import dynstiction as ds
import h5py
import hostile
import numpy as np
import pytest
from damage import changed, killed
from programs import SCRIPT, STOPPED, Program, limited
from sweeps import SCENE, Sweep

MOST_MEGABYTES = 200.0
MOST_SECONDS = 2.0
READERS = ("open", "open_sweep", "open_trade")

# In a child of a process that has imported everything: what it needs more is what the file took.
READ = """
import json, os, resource, sys, time, warnings
import dynstiction as ds, h5py, numpy as np, xarray, dynstiction._judge, dynstiction._hdf5
warnings.simplefilter("ignore")
MB = 2**20
def status(key):
    with open("/proc/self/status") as lines:
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(key))
def content(value):
    if isinstance(value, ds.Result):
        columns = b"".join(np.ascontiguousarray(value[n]).tobytes() for n in value)
        rest = [repr(value), repr(value.parameters), repr(value.summary), repr(value.attributes), value.deck, value.resolved_deck]
        return columns, "".join(rest)
    return b"", str(value)
for line in sys.stdin:
    file, reader, canary, number = json.loads(line)
    out, into = os.pipe()
    child = os.fork()
    if child == 0:
        with open("/proc/self/clear_refs", "w") as stream:
            stream.write("5")
        limit = status("VmSize") + 400 * MB
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        before, begun = status("VmRSS"), time.perf_counter()
        leak, error = False, ""
        try:
            numbers, text = content(getattr(ds, reader)(file))
            error = "read"
            leak = canary in text or np.float64(number).tobytes() in numbers
        except BaseException as fault:
            kind, error = type(fault).__name__, str(fault)
            leak = canary in error
            error = f"{kind}: {error}"
        found = {"file": file, "reader": reader, "error": error, "leak": leak, "seconds": time.perf_counter() - begun,
                 "megabytes": (status("VmHWM") - before) / MB}
        os.write(into, (json.dumps(found) + "\\n").encode()[:60000])
        os._exit(0)
    os.close(into)
    with os.fdopen(out) as stream:
        answer = stream.read()
    _, code = os.waitpid(child, 0)
    print(answer.strip() or json.dumps({"file": file, "reader": reader, "error": f"died: {code}", "leak": False, "seconds": 0.0,
                                        "megabytes": 0.0}), flush=True)
"""


@pytest.fixture(scope="module")
def sound(tmp_path_factory, executable, fig3_text) -> Path:
    file = tmp_path_factory.mktemp("sound") / "sound.h5"
    deck = file.with_suffix(".nml")
    deck.write_text(fig3_text)
    Program((executable,))("run", deck, "-o", file, "--quiet", "--set", "scene.t_end=0.02", status=0)
    return file


def read_all(files, readers=READERS):
    asked = [(str(file), reader, hostile.CANARY, hostile.NUMBER) for file in files for reader in readers]
    done = SCRIPT(READ, input="\n".join(map(json.dumps, asked)), timeout=60 + 2 * len(asked), status=0)
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(asked)
    return found


def judge(found):
    """Nothing of other files, little memory, soon, and refused by name."""
    for case in found:
        assert not case["leak"], case
        assert case["seconds"] < MOST_SECONDS, case
        assert case["megabytes"] < MOST_MEGABYTES, case
        assert case["error"] == "read" or case["error"].startswith(f"FileError: {case['file']}: "), case
        assert "\n" not in case["error"], case
    print(
        f"\n{len(found)} reads: {max(c['megabytes'] for c in found):.0f} MB, {max(c['seconds'] for c in found):.2f} s,"
        f" {sum(c['error'] == 'read' for c in found)} read"
    )


@pytest.mark.parametrize("count", [6, pytest.param(30, marks=pytest.mark.full)])
@pytest.mark.parametrize("kind", hostile.KINDS)
def test_hostile_files_are_refused_or_read_as_they_are(sound, tmp_path, kind, count):
    hostile.put_canaries(tmp_path)
    files = [tmp_path / f"{kind.replace(' ', '_')}_{seed}.h5" for seed in range(count)]
    for seed, file in enumerate(files):
        hostile.make(sound, file, kind, seed)
    found = read_all(files)
    judge(found)
    right = ds.open(sound)
    for case in found:
        if case["reader"] == "open" and case["error"] == "read":
            # Only where the sound data are untouched.
            got = ds.open(case["file"])
            assert all(np.array_equal(got[name], right[name]) for name in right if name in got)
            assert got.parameters["title"] == right.parameters["title"] and got.deck == right.deck
    refused = [case for case in found if case["reader"] == "open" and case["error"] != "read"]
    assert len(refused) >= 0.8 * count, found


def test_the_ways_in_refuse_alike(package, sound, tmp_path):
    """Figures, reports, tables: the object and the remedy are named, with exit status 3."""
    hostile.put_canaries(tmp_path)
    file = tmp_path / "bad.h5"
    shutil.copy(sound, file)
    with h5py.File(file, "r+") as data:
        del data["parameters/title"]
        hostile.put_external(data, "parameters/title", (), True, tmp_path)
    for arguments in (["plot"], ["export", "--csv"]):
        done = package(arguments[0], file.name, *arguments[1:], status=3)
        assert "'parameters/title' has its data in another file" in done.stderr and "do not trust" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.h5", "secret.bin", "secret.h5", "secret.txt"]


# --- what Fortran reads


LIMITS = limited(resource.RLIMIT_AS, 2**31)
POINT = "system.misalignment_deg"


def list_of(kind):
    def write(file, folder):
        if kind == "external":
            file.create_dataset(POINT, (10,), "<f8", external=[(str(folder / "secret.bin"), 0, 80)])
        elif kind == "external link":
            file[POINT] = h5py.ExternalLink(folder / "secret.h5", "/numbers")
        elif kind == "soft link":
            file["other"] = np.ones(3)
            file[POINT] = h5py.SoftLink("/other")
        elif kind == "virtual":
            layout = h5py.VirtualLayout((1000,), "<f8")
            layout[:] = h5py.VirtualSource(folder / "secret.h5", "numbers", shape=(2000,))[:1000]
            file.create_virtual_dataset(POINT, layout)
        elif kind == "gzip":
            file.create_dataset(POINT, data=np.full(2**22, 2.0), compression="gzip")
        elif kind == "plugin":
            creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            creation.set_chunk((100,))
            creation.set_filter(32015, h5py.h5z.FLAG_OPTIONAL, ())
            h5py.h5d.create(file.id, POINT.encode(), h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple((100,)), creation)
        elif kind == "size":
            file.create_dataset(POINT, (2**29,), "<f8")
        elif kind == "chunks":
            file.create_dataset(POINT, (2**29,), "<f8", chunks=(1000,))
        elif kind == "compound":
            file[POINT] = np.zeros(3, [("a", "<f8")])
        else:
            file.create_dataset(POINT, (3,), h5py.ref_dtype)

    return write


@pytest.mark.parametrize(
    "kind", ["external", "external link", "soft link", "virtual", "gzip", "plugin", "size", "chunks", "compound", "reference"]
)
def test_hostile_lists_of_points_are_refused(tmp_path, kind):
    hostile.put_canaries(tmp_path)
    sweep = Sweep(tmp_path, SCENE.replace("t_end = 10.0", "t_end = 0.1") + "\n&sweep points = 'p.h5' /\n")
    with h5py.File(tmp_path / "p.h5", "w") as file:
        list_of(kind)(file, tmp_path)
    done = sweep.run("a.h5", preexec_fn=LIMITS)
    assert done.returncode == 3 and POINT in done.stderr and ": give " in done.stderr, done
    assert str(int(hostile.NUMBER)) not in done.stderr and not (tmp_path / "a.h5").exists()


@pytest.mark.parametrize("kind", ["external", "external link", "virtual", "list", "numbers", "attribute"])
def test_a_hostile_origin_is_refused(tmp_path, program, fig3_text, kind):
    hostile.put_canaries(tmp_path)
    deck = tmp_path / "fig3.nml"
    deck.write_text(fig3_text)
    program("run", deck, "-o", "x.h5", "--quiet", "--set", "output.wall_limit=0.01", status=STOPPED)
    changed(tmp_path / "x.h5.checkpoint", killed)
    with h5py.File(tmp_path / "x.h5", "r+", libver=("v108", "latest" if kind == "virtual" else "v108")) as file:
        if kind != "attribute":
            del file["deck/text"]
        if kind == "external":
            hostile.put_external(file, "deck/text", (), True, tmp_path)
        elif kind == "external link":
            del file["deck"]
            file["deck"] = h5py.ExternalLink(tmp_path / "secret.h5", "/")
        elif kind == "virtual":
            layout = h5py.VirtualLayout((10,), "<f8")
            layout[:] = h5py.VirtualSource(tmp_path / "secret.h5", "numbers", shape=(2000,))[:10]
            file.create_virtual_dataset("deck/text", layout)
        elif kind == "list":
            file.create_dataset("deck/text", data=["a"] * 100000, dtype=h5py.string_dtype())
        elif kind == "numbers":
            file["deck/text"] = 3.0
        else:
            file.attrs["complete"] = np.zeros(7000, np.int32)
    done = program("resume", tmp_path / "x.h5", timeout=20)
    assert done.returncode == 3 and "do not trust the file" in done.stderr, done
    assert ("complete" if kind == "attribute" else "deck") in done.stderr and hostile.CANARY not in done.stderr


# --- names and texts


EVIL = "x\n\x1b[31mdynstiction: forged\r\x9b2J.nml"


def test_names_cannot_control_the_terminal(tmp_path, program, package):
    deck = tmp_path / EVIL
    deck.write_text("&scene t_endd = 1 kk = 2 /\n")
    for command in ("check", "run", "stability", "resume", "trade"):
        done = program(command, deck, timeout=20, encoding=None)
        assert done.returncode in (2, 3), done
        shown = done.stderr.decode()
        assert all(letter.isprintable() for letter in shown.replace("\n", "")), shown
        assert all(line.startswith("dynstiction: /") for line in shown.splitlines()), shown
    assert len(shown.splitlines()) >= 2
    for command in (["plot"], ["export", "--csv"]):
        done = package(command[0], deck, *command[1:], encoding=None)
        assert done.returncode == 3 and len(done.stderr.splitlines()) == 1 and b"\x1b" not in done.stderr, done


def test_texts_of_a_file_cannot_control_the_terminal(sound, tmp_path):
    file = tmp_path / "bad.h5"
    shutil.copy(sound, file)
    with h5py.File(file, "r+") as data:
        del data["parameters/title"]
        data["parameters/title"] = EVIL
        data["time_series/u_x"].attrs["units"] = EVIL
        data.attrs["result_text"], data.attrs["model"], data.attrs["complete"] = EVIL, EVIL, np.int32(0)
    with pytest.warns(ds.IncompleteWarning) as caught:
        result = ds.open(file)
    for shown in (repr(result), repr(result.parameters), str(caught[0].message)):
        assert "forged" in shown and all(letter.isprintable() for letter in shown.replace("\n", ""))
        assert not any(line.startswith("dynstiction: forged") for line in shown.splitlines())
    assert result.parameters["title"] == EVIL


@pytest.mark.parametrize("beginning", ["=1+1", "+1", "-1", "@SUM", "\t=1", "\r=1", "  =1"])
def test_no_cell_of_a_table_is_a_formula(package, sound, tmp_path, beginning):
    file = tmp_path / "bad.h5"
    shutil.copy(sound, file)
    with h5py.File(file, "r+") as data:
        del data["parameters/title"]
        data["parameters/title"] = beginning
        data["summary/sticks"].attrs["long_name"] = beginning
        data.move("time_series/u_y", "time_series/=u_y")
    package("export", "--csv", file, "-o", tmp_path / "t", status=0)
    for table in (tmp_path / "t").glob("*.csv"):
        with table.open(newline="") as stream:
            for row in csv.reader(stream):
                for cell in row:
                    try:
                        float(cell)
                    except ValueError:
                        assert not cell.lstrip(" ").startswith(("=", "+", "-", "@", "\t", "\r")), (table, cell)
