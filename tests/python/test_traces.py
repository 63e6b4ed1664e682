"""Measured traces: what is read, what is refused and where, what noise does to cycles, and a trace beside a scene."""

from __future__ import annotations

import copy
import gzip
import pickle
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import dynstiction as ds
import h5py
import numpy as np
import pytest
from dynstiction.trace_comparison import simulate_like
from dynstiction.trace_cycles import noise_level
from dynstiction.trace_file import UNITS
from programs import Program
from scipy.io import savemat

hypothesis = pytest.importorskip("hypothesis", reason="pip install hypothesis")
st = hypothesis.strategies

SCENE = """&scene
  title = 'a rig on the bench', model = 'low_frequency', t_end = 3.0
/
&system
  mass = 0.1, stiffness_x = 400.0, misalignment_deg = 3.0
/
&friction
  law = 'weakening', mu_0 = 0.30, mu_inf = 0.20, v_f = 5.0e-3, normal_load = 4.0
/
&drive
  velocity = 2.0e-3
/
&output
  interval = 1.0e-3
/
"""
"""No scene of the paper."""

PERIOD, LOW, HIGH, FALL = 0.7312345, 1.3, 2.1, 0.04
"""Of the traces that are made here, straight lines: seconds, newtons, and the part of a period in which the force falls."""


def sawtooth(cycles: float = 12.3, per_cycle: float = 400.3, noise: float = 0.0, seed: int = 0) -> ds.Trace:
    """Force that rises along a straight line and falls along another; noise relative to its amplitude."""
    time = np.arange(0.0, cycles * PERIOD, PERIOD / per_cycle)
    phase = (time / PERIOD + 0.3) % 1.0
    force = LOW + (HIGH - LOW) * np.where(phase < 1.0 - FALL, phase / (1.0 - FALL), (1.0 - phase) / FALL)
    random = np.random.default_rng(seed)
    return ds.Trace(time, force + noise * (HIGH - LOW) * random.standard_normal(time.size), name="saw")


def write(folder: Path, text: str, name: str = "trace.csv", encoding: str = "utf-8") -> Path:
    file = folder / name
    file.write_bytes(text.encode(encoding))
    return file


def table(rows: Any, head: str = "", delimiter: str = ",") -> str:
    return head + "".join(delimiter.join(str(each) for each in row) + "\n" for row in rows)


ROWS = [(round(0.01 * i, 6), round(1.0 + 0.1 * (i % 7), 6)) for i in range(30)]


HEADS = {
    "brackets": "t [ms];F [mN]\n",
    "round": "t (msec);F (mN)\n",
    "slash": "t/ms;F/mN\n",
    "in": "time in ms;force in mN\n",
    "underscore": "time_ms;force_mN\n",
    "blank": "time ms;force mN\n",
    "line of units": "Zeit;Kraft\nms;mN\n",
    "empty line": "t [ms];F [mN]\n;\n",
    "sign in a name": "t [ms];Force #1 [mN]\n",
    "comment above others": "# t [ms]; F [mN]\n# load cell 3\n",
    "comment with another delimiter": "# t [ms], F [mN]\n",
    "preamble": "Test;friction\nDate;1.2.2024\nRate:;500 Hz\nBy;X\n\nt [ms];F [mN]\n",
    "LabVIEW": "LabVIEW Measurement\nWriter_Version;2\n***End_of_Header***\nTime;Force\nms;mN\n",
    "LabVIEW's labels": "Samples;9\nDate;2024/02/01\nY_Unit_Label;mN\nDelta_X;1\nX_Value [ms];Force;Comment\n",
    "a line below units": "Zeit;Kraft\nms;mN\nraw;raw\n",
    "comments, names and units": "# time;force\n# ms;mN\n",
    "units behind a sign above names": "# t [ms], F [mN]\ntime;force\n",
    "units alone": "ms;mN\n",
    "a rule": "t [ms];F [mN]\n------;------\n",
    "units within names": "Time {ms} (raw);[mN] Force\n",
}
MISREAD = {
    "unknown in round brackets": ("t (ms);F (pound)\n", "1600;1600", r"trace.csv:1: force is in 'pound', which is unknown"),
    "unknown after a slash": ("t/ms;F/V\n", "1600;1600", "force is in 'V'"),
    "units of no columns": ("# units: [mN] and [ms]\n", "1600;1600", "trace.csv:1: names units, but not 2 columns"),
    "thousands or decimals": ("t [ms];F [mN]\n", "1,600;1,600", "trace.csv:2: the comma in all numbers may be"),
    "units of a label": ("Name;t;F\nUnit;ms;mN\n", "1600;1600", "trace.csv:2: names units, but not 2 columns"),
    "decimal commas between commas": ("t,F\n", "1,600,1,600", "trace.csv:2: the comma may be a decimal one or separate columns"),
    "times of day": ("t;F\n", "10:00:0,600;1,6", "time .column 0. is '10:00:0,600', no number: name a column of seconds"),
    "a damaged first line": ("t [ms];F [mN]\nabc;1.0\n", "1600;1600", "trace.csv:2: time .column 0. is 'abc'"),
}


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS)
def test_units_are_found_in_any_usual_head(tmp_path: Path, head: str) -> None:
    """A unit that is overlooked makes the force wrong by a thousand."""
    rows = "\n".join(f"{10 * i};{1000 + i % 7}" for i in range(100))
    read = ds.read_trace(write(tmp_path, head + rows + "\n"))
    assert (read.time[1], read.force[3]) == pytest.approx((0.01, 1.003), rel=1e-14)
    assert read.lines is not None and read.lines[0] == 1 + head.count("\n")


def test_a_preamble_may_be_longer_than_the_samples(tmp_path: Path) -> None:
    """Lines of it do not hide the delimiter, of one column neither."""
    for count in (3, 12, 40):
        preamble = "".join(f"Key {i}: value, {i}\n" for i in range(count))
        read = ds.read_trace(write(tmp_path, preamble + "t [s];F [mN]\n0,0;1,5\n0,1;2,5\n0,2;3,5\n"))
        np.testing.assert_allclose(read.force, [1.5e-3, 2.5e-3, 3.5e-3], rtol=1e-14)
        read = ds.read_trace(write(tmp_path, preamble.replace(",", "") + "F\n1.5\n2.5\n3.5\n"), interval=0.1)
        np.testing.assert_array_equal(read.force, [1.5, 2.5, 3.5])


@pytest.mark.parametrize("case", MISREAD)
def test_a_head_that_is_not_understood_is_refused(tmp_path: Path, case: str) -> None:
    head, first, told = MISREAD[case]
    rows = "\n".join([first, *(first.replace("600", f"{601 + i}") for i in range(100))])
    with pytest.raises((ds.FileError, ds.UsageError), match=told):
        ds.read_trace(write(tmp_path, head + rows + "\n"))


# What is read -------------------------------------------------------------------------------------------------------------


@hypothesis.settings(max_examples=150, deadline=None)
@hypothesis.given(
    values=st.lists(st.floats(-1e6, 1e6, allow_nan=False).map(lambda x: float(f"{x:.9g}")), min_size=4, max_size=40),
    delimiter=st.sampled_from([",", ";", "\t", " ", "|"]),
    comma=st.booleans(),
    head=st.sampled_from(["none", "names", "units", "line", "comment"]),
    time_unit=st.sampled_from(sorted(UNITS["time"])),
    force_unit=st.sampled_from(sorted(UNITS["force"])),
    named=st.booleans(),
    before=st.integers(0, 2),
    blank_lines=st.booleans(),
    ending=st.sampled_from(["\n", "\r\n"]),
    last_delimiter=st.booleans(),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
)
def test_tables_are_read_as_they_were_written(
    tmp_path_factory: pytest.TempPathFactory,
    values: list[float],
    delimiter: str,
    comma: bool,
    head: str,
    time_unit: str,
    force_unit: str,
    named: bool,
    before: int,
    blank_lines: bool,
    ending: str,
    last_delimiter: bool,
    encoding: str,
) -> None:
    comma = comma and delimiter != ","
    time = [0.25 * i for i in range(len(values))]
    lines = ["# a rig", "# on the bench"]
    # Blanks between columns part names too.
    names = ["other"] * before + (["Time", "Load"] if delimiter == " " else ["Time", "Load cell"])
    if len(set(names)) < len(names):
        names = [f"other{i}" for i in range(before)] + names[before:]
    units = ["V"] * before + [time_unit, force_unit]
    between = delimiter
    if head in ("names", "line"):
        lines.append(between.join(names))
    if head == "line":
        lines.append(between.join(units))
    if head == "units":
        space = "" if delimiter == " " else " "
        lines.append(between.join(f"{name}{space}[{unit}]" for name, unit in zip(names, units, strict=True)))
    if head == "comment":
        lines.append("# " + between.join(names))
    for pair in zip(time, values, strict=True):
        texts = [repr(x) for x in (*[7.5] * before, *pair)]
        if comma:
            texts = [text.replace(".", ",") for text in texts]
        lines.append(between.join(texts) + (delimiter if last_delimiter and delimiter not in " \t" else ""))
        if blank_lines:
            lines.append("")
    file = write(tmp_path_factory.mktemp("t"), ending.join(lines) + ending, encoding=encoding)
    by_name = named and head != "none"
    columns = {"time": names[-2], "force": names[-1].upper()} if by_name else {"time": before, "force": before + 1}
    told = head in ("units", "line")
    read = ds.read_trace(
        file,
        **columns,
        units=None if told else {"time": time_unit, "force": force_unit},
        delimiter=delimiter if delimiter == "|" else None,
    )
    np.testing.assert_allclose(read.time, np.array(time) * UNITS["time"][time_unit], rtol=1e-15)
    np.testing.assert_allclose(read.force, np.array(values) * UNITS["force"][force_unit], rtol=1e-15)
    assert read.name == str(file)


def test_a_factor_is_a_unit_and_wins_over_the_head(tmp_path: Path) -> None:
    file = write(tmp_path, table(ROWS, "t [ms],F [V]\n"))
    with pytest.raises(ds.UsageError, match=r"force is in 'V', which is unknown: name the unit \(N, mN"):
        ds.read_trace(file)
    read = ds.read_trace(file, units={"force": -2.5, "time": "s"})
    np.testing.assert_array_equal(read.force, [-2.5 * force for _, force in ROWS])
    np.testing.assert_array_equal(read.time, [time for time, _ in ROWS])
    assert ds.read_trace(file, units={"force": "1e-3"}).time[1] == pytest.approx(1e-5)


def test_times_may_come_from_the_sampling_interval(tmp_path: Path) -> None:
    file = write(tmp_path, "\n".join(str(force) for _, force in ROWS))
    read = ds.read_trace(file, interval=0.02)
    np.testing.assert_allclose(read.time, 0.02 * np.arange(30))
    np.testing.assert_array_equal(read.force, [force for _, force in ROWS])
    with pytest.raises(ds.UsageError, match="time and interval"):
        ds.read_trace(file, interval=0.02, time=0)


def test_displacement_and_lateral_force_are_read(tmp_path: Path) -> None:
    rows = [(t, f, 10.0 * f, 100.0 * t) for t, f in ROWS]
    file = write(tmp_path, table(rows, "time;force;across (mN);way [um]\n", ";"))
    read = ds.read_trace(file, displacement="way", lateral_force=2)
    np.testing.assert_allclose(read.displacement, 1e-4 * read.time, rtol=1e-14)
    np.testing.assert_allclose(read.lateral_force, 0.01 * read.force, rtol=1e-14)


def test_hdf5_by_paths_and_units(tmp_path: Path) -> None:
    file = tmp_path / "trace.h5"
    time, force = (np.array(each) for each in zip(*ROWS, strict=True))
    with h5py.File(file, "w") as out:
        out["time"], out["run/cell"] = 1e3 * time, force
        out["time"].attrs["units"] = "ms"
        out["matrix"] = np.zeros((3, 3))
    read = ds.read_trace(file, force="run/cell", units={"force": "mN"})
    np.testing.assert_allclose(read.time, time, rtol=1e-15)
    np.testing.assert_allclose(read.force, 1e-3 * force, rtol=1e-15)
    with pytest.raises(ds.UsageError, match=r"which column is force\? Name it: the columns are 0 'matrix', 1 'run/cell', 2 'time'"):
        ds.read_trace(file)
    with pytest.raises(ds.UsageError, match=r"matrix has the shape \(3, 3\)"):
        ds.read_trace(file, force="matrix")
    with pytest.raises(ds.UsageError, match="is no text, and has no delimiter"):
        ds.read_trace(file, delimiter=",")
    cut = write(tmp_path, "", "cut.h5")
    cut.write_bytes(file.read_bytes()[:200])
    with pytest.raises(ds.FileError, match="cannot be read"):
        ds.read_trace(cut)


def test_matlab_and_tdms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both kinds of MATLAB's files, one with its head before that of HDF5, and channels with units, the times of a waveform."""
    time, force = (np.array(each) for each in zip(*ROWS, strict=True))
    file = tmp_path / "trace.mat"
    savemat(file, {"rig": {"time": time, "force": force, "note": "x"}})
    reads = [ds.read_trace(file)]
    with h5py.File(file, "w", userblock_size=512) as out:
        for name, values in (("t", time), ("F", force), ("#refs#/a", force)):
            out.create_dataset(name, data=values[np.newaxis]).attrs["MATLAB_class"] = np.bytes_("double")
        out["note"] = np.array([[82], [105]], dtype=np.uint16)
    reads.append(ds.read_trace(file))
    nptdms = pytest.importorskip("nptdms", reason="pip install npTDMS")
    file = tmp_path / "trace.tdms"
    waveform = {"unit_string": "mN", "wf_increment": ROWS[1][0]}
    with nptdms.TdmsWriter(file) as writer:
        writer.write_segment([nptdms.ChannelObject("rig", name, 1e3 * force, waveform) for name in ("Force", "b", "c")])
    for read in (*reads, *(ds.read_trace(file, force=column) for column in (None, "c", "rig/b"))):
        np.testing.assert_allclose((read.time, read.force), (time, force), rtol=1e-14)
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(ds.PackageError, match=r"pip install dynstiction\[tdms\]"):
        ds.read_trace(file)


def test_a_long_table_needs_little_more_memory_than_its_numbers(tmp_path: Path) -> None:
    file = tmp_path / "long.csv"
    file.write_text("t [us];F\n" + "".join(f"{i};1.5\n" for i in range(200_000)))
    tracemalloc.start()
    ds.read_trace(file)
    assert tracemalloc.get_traced_memory()[1] < 200_000 * 80 + 10e6
    tracemalloc.stop()


def test_the_file_of_a_run_is_a_trace(tmp_path: Path) -> None:
    result = ds.run(SCENE)
    result.save(tmp_path / "run.h5")
    read = ds.read_trace(tmp_path / "run.h5", force="time_series/spring_force_x")
    np.testing.assert_array_equal(read.force, result["spring_force_x"])


# What is refused ----------------------------------------------------------------------------------------------------------


def changed(line: int, text: str) -> str:
    """The table with another line; a head stands on line 1."""
    lines = table(ROWS, "time,force\n").splitlines()
    lines[line - 1] = text
    return "\n".join(lines) + "\n"


BAD_LINES = {
    "nan": (changed(7, "0.05,nan"), r":7: force is nan: take the sample out"),
    "inf": (changed(7, "0.05,-inf"), r":7: force is -inf: take"),
    "text": (changed(9, "0.07,off"), r":9: force \(column 1\) is 'off', no number: correct the line"),
    "empty": (changed(9, "0.07,"), r":9: force \(column 1\) is empty: correct the line"),
    "short": (changed(9, "0.07"), r":9: has 1 columns, and force is column 1: complete the line, or take it out"),
    "backwards": (changed(12, "0.05,1"), r":12: time 0\.05 s comes after 0\.09 s: sort the samples"),
    "same time": (changed(12, "0.09,1"), r":12: time 0\.09 s is the one before: write times with more digits"),
    "gap": (table([*ROWS[:10], *ROWS[17:]], "time,force\n"), r":12: a gap of 0\.08 s before 0\.17 s, samples are 0\.01 s apart"),
    "nothing": ("\n# only this\n", r": has no samples"),
    "names only": ("time,force\n", r":1: no columns of numbers are found, as in .*: name the delimiter"),
    "prose": ("a force\nthat was\nmeasured\nby hand\n", r":4: no columns of numbers are found, as in .*: name the delimiter"),
    "two samples": ("0,1\n1,2\n", r": has 2 samples: at least 3 are needed"),
    "binary": ("\0\0\0", r": is not text: give a table of text, or an HDF5, MATLAB or TDMS file"),
}


@pytest.mark.parametrize("what", BAD_LINES)
def test_bad_data_is_refused_with_its_line(what: str, tmp_path: Path) -> None:
    text, message = BAD_LINES[what]
    file = write(tmp_path, text)
    with pytest.raises(ds.FileError, match=f"^{file}{message}"):
        ds.read_trace(file)


BAD_USE: dict[str, tuple[dict[str, Any], str]] = {
    "number": ({"force": 5}, r"force is to be column 5: the columns are 0 'time', 1 'force', 2 'x', 3 'x'"),
    "name": ({"force": "fource"}, r"force is to be column 'fource': the columns are 0 'time'"),
    "twice the name": ({"force": "x"}, r"2 columns are called 'x': give its number"),
    "the same": ({"time": "force", "force": 1}, r"time and force are the same column, 1"),
    "taken": ({"force": "time"}, r"time and force are the same column, 0"),
    "unit": (
        {"units": {"force": "pound"}},
        r"units: force in 'pound': the units are N, mN, cN, uN, nN, kN, gf, kgf, lbf; for another give its factor to N",
    ),
    "no factor": ({"units": {"force": 0.0}}, r"units: the factor of force is 0"),
    "quantity": ({"units": {"load": "N"}}, r"units: 'load': a trace has time, force, displacement, lateral_force"),
    "delimiter": ({"delimiter": ",,"}, r"delimiter = ',,': it is one character"),
    "units": ({"units": "mN"}, r"units = 'mN': units are a mapping of names"),
    "kind": ({"force": 1.0}, r"force = 1\.0: a column is given by its number, from 0, or its name"),
    "interval": ({"interval": 0.0}, r"interval = 0: interval must be finite and in \(0, inf\) s"),
}


@pytest.mark.parametrize("what", BAD_USE)
def test_wrong_columns_and_units_are_refused(what: str, tmp_path: Path) -> None:
    how, message = BAD_USE[what]
    file = write(tmp_path, table([(*row, 1, 2) for row in ROWS], "time,force,x,x\n"))
    with pytest.raises(ds.UsageError, match=message):
        ds.read_trace(file, **how)


def test_arrays_are_checked_like_files() -> None:
    time = np.arange(50.0)
    with pytest.raises(ds.FileError, match="trace: sample 4: force is nan, and 1 more: take the samples out"):
        ds.Trace(time, np.where(np.isin(time, (4, 9)), np.nan, time))
    with pytest.raises(ds.FileError, match="x: sample 3: time 1 s comes after 2 s"):
        ds.Trace(np.r_[0.0, 1.0, 2.0, 1.0, 5.0], np.zeros(5), name="x")
    with pytest.raises(ds.UsageError, match="force has 49 samples and time has 50"):
        ds.Trace(time, time[1:])
    with pytest.raises(ds.UsageError, match=r"force has the shape \(5, 10\)"):
        ds.Trace(time, time.reshape(5, 10))
    for wrong in (["a"] * 50, time * 1j, None):
        with pytest.raises(ds.UsageError, match="force must be a real number or an array of them"):
            ds.Trace(time, wrong)  # type: ignore[arg-type]
    with pytest.raises(ds.UsageError, match="masked"):
        ds.Trace(time, np.ma.masked_equal(time, 3.0))
    with pytest.raises(ds.UsageError, match="lines must be whole numbers"):
        ds.Trace(time, time, lines=time)


def test_traces_do_not_change_and_are_copied() -> None:
    time = np.arange(50.0)
    trace = ds.Trace(time, time % 7, displacement=2.0 * time)
    time[:] = 0.0
    assert trace.time[-1] == 49.0
    with pytest.raises(ValueError, match="read-only"):
        trace.force[0] = 1.0
    again = pickle.loads(pickle.dumps(copy.deepcopy(trace)))
    np.testing.assert_array_equal(again.force, trace.force)
    part = trace.part(10.0, 20.0)
    assert (part.time[0], part.time[-1], part.displacement[0]) == (10.0, 20.0, 20.0)
    with pytest.raises(ds.UsageError, match="0 samples from 60 to inf s: it has times from 0 to 49 s"):
        trace.part(60.0)
    assert trace.regular() is trace
    np.testing.assert_allclose(trace.regular(0.5).time, np.arange(0.0, 49.25, 0.5))


def flat(value: float = 1.0, noise: float = 0.0) -> ds.Trace:
    time = np.arange(0.0, 20.0, 0.001)
    return ds.Trace(time, value + noise * np.random.default_rng(3).standard_normal(time.size), name="flat")


NO_CYCLES: dict[str, tuple[Any, str]] = {
    "constant": (flat, "flat: the force is constant, 1 N: name the column of the force"),
    "noise": (lambda: flat(1.0, 0.1), "flat: no stick-slip above the noise: .* with a noise of 0.[01]"),
    "rise": (lambda: ds.Trace(np.arange(99.0), np.arange(99.0)), "trace: no stick-slip above the noise"),
    "one cycle": (
        lambda: sawtooth(2.3),
        r"saw: 1 whole cycles \(2 slips\) in 1\.68\d s: at least 3 are needed: give a longer trace",
    ),
    "few samples": (lambda: sawtooth(40.0, 12.3), r"saw: 12 samples in a cycle of 0\.71\d+ s: at least 20 are needed"),
    "sign": (
        lambda: ds.Trace(sawtooth().time, -sawtooth().force, name="saw"),
        "saw: the force rises in .* s and falls in .* s, as if its sign were turned: give a negative factor",
    ),
}


@pytest.mark.parametrize("what", NO_CYCLES)
def test_traces_without_cycles_are_refused(what: str) -> None:
    make, message = NO_CYCLES[what]
    with pytest.raises(ds.FileError, match=message):
        ds.find_cycles(make())


# What noise does ----------------------------------------------------------------------------------------------------------


def test_cycles_of_straight_lines_are_known() -> None:
    cycles = ds.find_cycles(sawtooth())
    assert len(cycles) == 11
    means = cycles.means()
    assert means["period"] == pytest.approx(PERIOD, rel=1e-5)
    assert means["peak_force"] == pytest.approx(HIGH, abs=8e-3 * (HIGH - LOW))
    # Peak and valley are given where a harmonic fall would have them: a sharp one has them within its own length.
    assert means["valley_force"] == pytest.approx(LOW, abs=8e-3 * (HIGH - LOW))
    assert means["slip_duration"] == pytest.approx(0.8 * FALL * PERIOD, rel=0.02)
    assert means["loading_rate"] == pytest.approx((HIGH - LOW) / (PERIOD * (1.0 - FALL)), rel=1e-9)
    assert abs(means["creep_share"]) < 1e-9
    # A slip is in the middle of its fall.
    expected = PERIOD * (np.arange(1, 13) - 0.3 - 0.5 * FALL)
    np.testing.assert_allclose(cycles.slips, expected, atol=0.02 * FALL * PERIOD)


@pytest.mark.parametrize(("noise", "names"), [(0.01, None), (0.05, ("period", "peak_force", "loading_rate", "creep_share"))])
def test_the_bias_by_noise_is_below_the_standard_error(noise: float, names: tuple[str, ...] | None) -> None:
    exact = ds.find_cycles(sawtooth()).means()
    deviations: dict[str, list[float]] = {name: [] for name in names or exact}
    for seed in range(50):
        cycles = ds.find_cycles(sawtooth(noise=noise, seed=seed))
        assert len(cycles) == 11
        assert cycles.noise == pytest.approx(noise * (HIGH - LOW), rel=0.06)
        means, errors = cycles.means(), cycles.errors()
        for name, found in deviations.items():
            found.append((means[name] - exact[name]) / errors[name])
    for name, found in deviations.items():
        # The mean of 50 deviations is the bias in standard errors, give or take 0.14.
        assert abs(np.mean(found)) < 1.0, (name, np.mean(found))
        # And the standard errors are what they say. Slips that are regular but for noise have a better mean period.
        assert (0.2 if name == "period" else 0.5) < np.std(found) < 2.0, (name, np.std(found))


def test_noise_behind_a_filter_is_no_slip() -> None:
    """From one sample to the next it differs little, and behind a coarse converter some are alike."""
    time = np.arange(0.0, 41.0, 5e-4)
    noise = ds.Chain(filter=300.0, order=4).response(5e-4, np.random.default_rng(1).normal(0.0, 0.01, time.size))
    force = np.round((5.0 + time % 3.9 / 3.9 + noise) * 1024.0) / 1024.0
    assert len(ds.find_cycles(ds.Trace(time, force))) == 9


def test_a_chain_drifts_hums_and_rounds() -> None:
    time = np.arange(0.0, 2.0, 1e-3)
    chain = ds.Chain(gain=2.0, tare=0.5, drift=0.1, hum=0.2, mains=60.0, step=1.0 / 64.0)
    shown = 64.0 * chain(ds.Trace(time, np.full(time.size, 3.0))).force
    assert np.all(shown % 1.0 == 0.0)
    np.testing.assert_allclose(shown / 64.0, 6.5 + 0.1 * time + 0.2 * np.sin(120.0 * np.pi * time), rtol=0.0, atol=0.0079)


def test_a_dip_at_the_end_of_the_slip_is_no_valley() -> None:
    trace = sawtooth()
    phase = (trace.time / PERIOD + 0.3) % 1.0
    dip = np.where((phase < 0.05) | (phase > 0.998), 0.15 * (HIGH - LOW), 0.0)
    plain, dipped = ds.find_cycles(trace), ds.find_cycles(ds.Trace(trace.time, trace.force - dip))
    assert dipped.means()["valley_force"] == pytest.approx(plain.means()["valley_force"], abs=0.02 * (HIGH - LOW))


def test_slips_far_below_the_noise_of_a_sample_are_found() -> None:
    """Where there are many samples: noise as large as half of the amplitude."""
    cycles = ds.find_cycles(sawtooth(cycles=8.3, per_cycle=20000.0, noise=0.5, seed=5))
    assert len(cycles) == 7
    assert cycles.means()["period"] == pytest.approx(PERIOD, rel=0.01)


def test_noise_is_told_from_the_signal() -> None:
    random = np.random.default_rng(11)
    slow = 5.0 * np.sin(np.linspace(0.0, 20.0, 20000))
    assert noise_level(slow) < 1e-5
    assert noise_level(slow + 0.02 * random.standard_normal(slow.size)) == pytest.approx(0.02, rel=0.03)


def test_spikes_and_drift_do_not_make_cycles() -> None:
    trace = sawtooth(noise=0.005, seed=2)
    spiked = trace.force.copy()
    spiked[[700, 1523, 2951]] += [3.0, -2.0, 2.5]
    calm, wild = ds.find_cycles(trace), ds.find_cycles(ds.Trace(trace.time, spiked))
    assert len(wild) == len(calm)
    np.testing.assert_allclose(wild.slips, calm.slips, atol=2.0 * trace.interval)
    assert calm.notes == ()
    drifting = ds.find_cycles(ds.Trace(trace.time, trace.force + 0.05 * trace.time))
    assert len(drifting) == len(calm)
    assert drifting.drift == pytest.approx(0.05, rel=0.02)
    assert any("drifts by 0.4" in note for note in drifting.notes)


def test_slips_between_two_samples_have_no_duration() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    cycles = ds.find_cycles(ds.Trace(time, 1.0 + time % 0.7))
    assert np.all(np.isnan(cycles["slip_duration"]))
    assert "their duration is not given" in cycles.notes[0]
    assert cycles.means()["period"] == pytest.approx(0.7, rel=1e-3)


@hypothesis.settings(max_examples=40, deadline=None)
@hypothesis.given(
    scale=st.floats(1e-6, 1e6), offset=st.floats(-10.0, 10.0), stretch=st.floats(1e-3, 1e3), begin=st.floats(-100.0, 100.0)
)
def test_cycles_scale_with_their_trace(scale: float, offset: float, stretch: float, begin: float) -> None:
    trace = sawtooth(noise=0.01)
    exact = ds.find_cycles(trace)
    other = ds.find_cycles(ds.Trace(stretch * (trace.time + begin), scale * (trace.force + offset)))
    assert len(other) == len(exact)
    np.testing.assert_allclose(other["period"], stretch * exact["period"], rtol=1e-6)
    np.testing.assert_allclose(other["peak_force"], scale * (exact["peak_force"] + offset), rtol=1e-6, atol=1e-5 * scale)
    np.testing.assert_allclose(other["creep_share"], exact["creep_share"], atol=1e-5)


# Runs ---------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def result() -> ds.Result:
    return ds.run(SCENE, scene={"t_end": 40.0})


@pytest.fixture(scope="module")
def measured(result: ds.Result) -> ds.Trace:
    """A trace of the bench's rig, with noise of 1 % of the amplitude."""
    return ds.Trace.of(result).part(8.0).with_noise(0.01 * 0.6, rng=4)


def test_a_run_as_a_trace(result: ds.Result) -> None:
    trace = ds.Trace.of(result)
    phi = np.radians(3.0)
    along = result["spring_force_x"] * np.cos(phi) + result["spring_force_y"] * np.sin(phi)
    np.testing.assert_array_equal(trace.force, along)
    np.testing.assert_array_equal(trace.displacement, result["X"])
    # Both components together are the spring force.
    size = np.hypot(result["spring_force_x"], result["spring_force_y"])
    np.testing.assert_allclose(np.hypot(trace.force, trace.lateral_force), size, rtol=1e-12)
    coarse = ds.Trace.of(result, 0.01)
    np.testing.assert_allclose(coarse.force, np.interp(coarse.time, result.time, along))
    cycles = ds.find_cycles(trace.part(8.0))
    assert cycles.means()["period"] == pytest.approx(result.summary["period"], rel=1e-5)
    back = ds.Trace.of(ds.run(SCENE, drive={"velocity": -2.0e-3}))
    np.testing.assert_allclose(back.force, trace.force[: back.force.size], atol=1e-6)
    uneven = ds.Trace.of(ds.run(SCENE, output={"interval": 0.0}))
    assert np.allclose(np.diff(uneven.time), uneven.interval)


def test_a_run_with_dampers_as_a_trace() -> None:
    damped = {"damping_x": 2.0}
    with pytest.raises(ds.ColumnError, match=r"needs the column pull_force: add it to output\.fields"):
        ds.Trace.of(ds.run(SCENE, system=damped, output={"fields": ["spring_force_x", "spring_force_y", "X"]}))
    run = ds.run(SCENE, system=damped)
    trace = ds.Trace.of(run)
    phi = np.radians(3.0)
    expected = run["spring_force_x"] * np.cos(phi) + run["spring_force_y"] * np.sin(phi)
    expected += 2.0 * (2.0e-3 * np.cos(phi) - run["w_x"]) * np.cos(phi)
    np.testing.assert_allclose(trace.force, expected, rtol=1e-12, atol=1e-12)
    assert trace.lateral_force is None


def test_creep_before_slip_tells_dynamic_stiction_from_static_friction() -> None:
    """Without misalignment the object rests until it slips, and the force has a corner; with it the force bends before."""
    shares = {}
    for angle in (0.0, 1.0, 3.0):
        run = ds.run(SCENE, scene={"t_end": 25.0}, system={"misalignment_deg": angle})
        trace = ds.Trace.of(run).part(5.0).with_noise(0.006, rng=1)
        cycles = ds.find_cycles(trace)
        shares[angle] = cycles.means()["creep_share"], cycles.errors()["creep_share"]
        if angle == 0.0:
            # What the inertia of the slip rounds off is a part of the slip's own share of the period.
            assert shares[0.0][0] < 0.2 * cycles.means()["slip_duration"] / cycles.means()["period"] + 3.0 * shares[0.0][1]
    for low, high in ((0.0, 1.0), (1.0, 3.0)):
        assert shares[high][0] - shares[low][0] > 5.0 * np.hypot(shares[low][1], shares[high][1])


def test_a_scene_agrees_with_its_own_trace(measured: ds.Trace) -> None:
    comparison = ds.compare(SCENE, measured)
    assert comparison.differing == ()
    assert comparison.waveform_rms < 0.01
    assert (comparison.statistics["deviation"].abs() < 3.5).all()
    assert (comparison.statistics["simulated_error"] < 2.0 * comparison.statistics["measured_error"]).all()
    assert "nothing differs" in comparison.report()
    assert comparison.simulated.noise == pytest.approx(comparison.measured.noise, rel=0.1)
    assert ds.compare(SCENE, measured, noise=False).simulated.noise < 1e-3 * comparison.measured.noise
    assert comparison["period"].measured_error < 1e-3 * comparison["period"].measured


def test_deviations_are_standard_ones(result: ds.Result) -> None:
    """Over many noises the means of a scene and of its own trace differ by what the errors say."""
    quiet = ds.Trace.of(result).part(8.0)
    run = simulate_like(ds.Scene(SCENE), quiet, ds.find_cycles(quiet))
    found = []
    for seed in range(12):
        mine = ds.find_cycles(quiet.with_noise(0.012, seed))
        theirs = ds.find_cycles(run.with_noise(mine.noise, 1000 + seed))
        found.append(
            [
                (theirs.means()[q] - mine.means()[q]) / np.hypot(theirs.errors()[q], mine.errors()[q])
                for q in ("period", "peak_force", "valley_force", "slip_duration", "loading_rate", "creep_share")
            ]
        )
    assert np.all(np.abs(np.mean(found, axis=0)) < 1.2), np.mean(found, axis=0)
    assert np.all(np.std(found, axis=0) < 2.0)


@pytest.mark.parametrize(
    ("change", "differing"),
    [
        ({"system": {"misalignment_deg": 4.5}}, {"creep_share", "loading_rate", "swing"}),
        ({"system": {"stiffness_x": 420.0}}, {"period", "loading_rate"}),
        ({"friction": {"mu_0": 0.31}}, {"peak_force", "period"}),
    ],
)
def test_another_scene_differs(measured: ds.Trace, change: dict[str, Any], differing: set[str]) -> None:
    comparison = ds.compare(SCENE, measured, **change)
    assert differing <= set(comparison.differing)
    assert "differ by more than 3 standard errors: " in comparison.report()


def test_the_run_is_as_long_as_it_must_be(measured: ds.Trace) -> None:
    few = measured.part(end=measured.time[0] + 8.5 * ds.find_cycles(measured).means()["period"])
    cycles = ds.find_cycles(few)
    run = simulate_like(ds.Scene(SCENE), few, cycles)
    assert run.interval == pytest.approx(measured.interval)
    assert len(ds.find_cycles(run)) in (2 * len(cycles) - 1, 2 * len(cycles))
    assert run.time[-1] > 3.0  # the deck's t_end
    # The samples are those of a run at these times, not interpolated.
    longer = ds.Trace.of(ds.run(SCENE, scene={"t_end": 60.0}, output={"interval": measured.interval}))
    same = np.rint(run.time / measured.interval).astype(int)
    np.testing.assert_allclose(run.force, longer.force[same], atol=1e-4)


def test_a_run_has_no_more_samples_than_its_slips_need(measured: ds.Trace) -> None:
    wrong = ds.Trace(1e-3 * measured.time, measured.force)
    with pytest.raises(ds.UsageError, match=r"a period of 0\.96. s, and the trace one of 0\.000964 s .*the unit of its time"):
        ds.compare(SCENE, wrong)
    time = np.arange(8.0, 14.0, 2e-5)
    fine = ds.Trace(time, np.interp(time, measured.time, measured.force)).with_noise(0.02, 1)
    comparison = ds.compare(SCENE, fine)
    assert comparison.trace.time.size == fine.time.size // 9
    assert comparison.run.interval == pytest.approx(1.8e-4)


@pytest.mark.parametrize(
    "change",
    [
        {"drive": {"velocity": -2.0e-3}},
        {"drive": {"time": (0.0, 1.0), "velocity": (-2.0e-3, -2.0e-3)}},
        {"system": {"misalignment_deg": 177.0}},
        {"output": {"fields": ("u_x",), "interval": 0.5}},
        {"scene": {"settle": 1.0e-3, "t_end": 0.1}},
    ],
)
def test_mirror_images_and_settings_of_output_change_nothing(measured: ds.Trace, change: dict[str, Any]) -> None:
    along = ds.Trace(measured.time, measured.force)
    assert ds.compare(SCENE, along, **change).differing == ()


def test_displacement_and_lateral_force_are_compared(result: ds.Result, measured: ds.Trace) -> None:
    cycles = ds.find_cycles(measured)
    assert cycles.means()["slip_length"] == pytest.approx(result.summary["slip_length"], rel=0.03)
    # Over a cycle the object goes as far as the drive: what it does not slip it creeps.
    assert cycles.means()["slip_length"] < 2.0e-3 * cycles.means()["period"] * np.cos(np.radians(3.0))
    # Friction turns across the pull in slip and back towards it in creep.
    swing = np.ptp(np.quantile(measured.lateral_force, (0.02, 0.98)))
    assert -swing < cycles.means()["lateral_change"] < -0.5 * swing
    assert ds.compare(SCENE, measured).differing == ()
    comparison = ds.compare(SCENE, measured, system={"misalignment_deg": 4.5})
    assert "slip_length" in comparison.differing
    rows, _ = comparison.waveforms
    np.testing.assert_array_equal(comparison.plot().axes[1].lines[0].get_ydata(), rows.mean(axis=0))
    mirrored = ds.compare(SCENE, measured, system={"misalignment_deg": -3.0})
    assert mirrored.differing == ("lateral_change",)
    without = ds.compare(SCENE, ds.Trace(measured.time, measured.force))
    assert {"slip_length", "lateral_change"}.isdisjoint(without.statistics.index)


def test_scenes_without_cycles_are_refused(measured: ds.Trace) -> None:
    with pytest.raises(ds.UsageError, match="deck: its run has no cycles to compare"):
        ds.compare(SCENE, measured, friction={"mu_inf": None, "v_f": None, "law": "constant"})
    with pytest.raises(ds.UsageError, match=r"it has no period, and the trace one of 0\.964 s .*: change the deck"):
        ds.compare(SCENE, measured, drive={"velocity": 0.0})
    with pytest.raises(ds.DeckError, match="nearest is 'mass'"):
        ds.compare(SCENE.replace("mass", "mas"), measured)
    with pytest.raises(ds.UsageError, match="trace = 1: trace must be a Trace: give what read_trace"):
        ds.compare(SCENE, 1)  # type: ignore[arg-type]


# The command --------------------------------------------------------------------------------------------------------------


def test_the_command_compares(executable: Path, measured: ds.Trace, tmp_path: Path) -> None:
    write(tmp_path, SCENE, "rig.nml")
    rows = zip((1e3 * measured.time).tolist(), (-1e3 * measured.force).tolist(), strict=True)
    write(tmp_path, table(rows, "t\tcell\n", "\t"), "rig.csv")
    call = Program((executable, "compare"), tmp_path)
    how = ("rig.nml", "rig.csv", "--time", "t", "--force", "1", "--unit", "time=ms", "--unit", "force=-1e-3")
    said = call(*how, "--from", 8, "--set", "system.misalignment_deg=4.5", status=0)
    assert said.stderr == ""
    assert f"{len(ds.find_cycles(measured))} cycles" in said.stdout
    assert "differ by more than 3 standard errors: " in said.stdout
    assert said.stdout.splitlines()[-1] == "rig_compared.png"
    assert (tmp_path / "rig_compared.png").stat().st_size > 10000
    parts = ((), ("--from", 20), ("--to", 20))
    counts = [int(call(*how, *part, "--overwrite", status=0).stdout.split("rig.csv: ")[1].split()[0]) for part in parts]
    assert min(counts) > 5 and 0 < counts[0] - counts[1] - counts[2] <= 2
    own = call(*how, "-o", "own.svg", status=0).stdout
    assert "nothing differs by more than 3 standard errors" in own
    assert (tmp_path / "own.svg").exists()
    assert "slip_length" not in own
    rows = zip(measured.time.tolist(), measured.force.tolist(), (1e6 * measured.displacement).tolist(), strict=True)
    write(tmp_path, table(rows, "t,f,stage\n"), "both.csv")
    both = call("rig.nml", "both.csv", "--displacement", "stage", "--unit", "displacement=um", status=0).stdout
    assert "slip_length [m]" in both
    assert "nothing differs by more than 3 standard errors" in both


def test_a_compressed_table_says_its_units(tmp_path: Path) -> None:
    table = "t [ms];F [mN]\n" + "\n".join(f"{i};{1000 + i}" for i in range(5))
    with gzip.open(tmp_path / "a.csv.gz", "wt") as stream:
        stream.write(table)
    trace = ds.read_trace(tmp_path / "a.csv.gz")
    np.testing.assert_allclose(trace.force, 1.0 + 1e-3 * np.arange(5))
    assert trace.units == trace.part(0.0, 3e-3).units == "time in ms, force in mN"
    (tmp_path / "b.csv.gz").write_bytes((tmp_path / "a.csv.gz").read_bytes()[:-9])
    with pytest.raises(ds.FileError, match="cannot be read: Compressed file ended"):
        ds.read_trace(tmp_path / "b.csv.gz")
