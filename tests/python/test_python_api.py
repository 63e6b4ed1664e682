"""The Python package: runs, scenes, results, files, errors, threads, signals."""

from __future__ import annotations

import gc
import os
import pickle
import re
import signal
import sys
import threading
import time
import types
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import PIPE

import dynstiction as ds
import fig3 as fig3_deck
import h5py
import numpy as np
import pytest
import xarray
from dynstiction._interrupt import held_back
from dynstiction.record import si_units
from fig3 import SLIDER
from programs import SCRIPT, Program
from results import assert_same

SHORT = {"t_end": 0.05}


# Scenes and overrides


def test_path_text_and_scene_give_the_same_run(tmp_path: Path, fig3: ds.Scene, fig3_text: str) -> None:
    path = tmp_path / "a & b.nml"
    path.write_text(fig3_text)
    others = {"scene": {"title": "it's Fig. 3", **SHORT}, "system": {"misalignment_deg": 1}, "friction": {"normal_load": 10}}
    groups = fig3_deck.changed(fig3_deck.GROUPS, others, {"initial": {"velocity_ratio": np.float64(1e-6)}})
    from_text = ds.run(fig3_text, scene=SHORT)
    for deck in (str(path), path, fig3, ds.Scene(path)):
        assert_same(ds.run(deck, scene=SHORT), from_text)
    assert_same(ds.run(ds.Scene(**groups)), from_text)


def test_one_line_of_text_is_a_deck_and_not_a_path(fig3_text: str) -> None:
    one_line = " ".join(fig3_text.split())
    assert_same(ds.run(one_line, scene=SHORT), ds.run(fig3_text, scene=SHORT))


def test_overrides_reach_the_core(fig3: ds.Scene) -> None:
    result = ds.run(fig3, scene=SHORT, drive={"velocity": 2e-3}, output={"interval": 1e-3})
    assert result.time[-1] == 0.05
    assert result.time.size == 51
    # A stuck object stretches its spring at the rate V.
    stretch = np.hypot(result["u_x"], result["u_y"])[1]
    assert stretch == pytest.approx(2e-3 * result.time[1], rel=1e-6)


def test_later_override_wins(fig3: ds.Scene) -> None:
    scene = fig3.replace(scene={"t_end": 1.0}).replace(scene={"T_END": 0.02})
    assert ds.run(scene).time[-1] == 0.02
    assert ds.run(scene, scene={"t_end": 0.01}).time[-1] == 0.01


def test_none_takes_a_key_out(fig3: ds.Scene) -> None:
    friction = {"law": "constant", "mu_inf": None, "v_f": None}
    constant = ds.run(fig3, scene=SHORT, friction=friction)
    assert constant.parameters["law"] == "constant"
    assert not {"mu_inf", "v_f"} & set(constant.parameters)
    again = fig3.replace(friction=friction).replace(friction={"law": None, "mu_inf": 0.15, "v_f": 0.01})
    assert_same(ds.run(again, scene=SHORT), ds.run(fig3, scene=SHORT))
    keys = {"t_end": 1.0, "title": None}
    assert ds.Scene(scene=keys) == ds.Scene(scene={"t_end": 1.0})


def test_list_of_values_is_a_drive_profile(fig3: ds.Scene) -> None:
    times, velocities = np.array([0.0, 0.01, 0.01, 0.05]), (1e-3, 1e-3, 0, 0)
    stopped = ds.run(fig3, scene=SHORT, drive={"time": times, "velocity": velocities})
    # Released at 11.5 ms at the earliest: the drive stops before, and the object never moves again.
    assert stopped["X"][-1] == pytest.approx(stopped["X"][1], abs=1e-12)
    assert stopped["u_x"][-1] == pytest.approx(1e-5, rel=1e-3)


def test_long_list_survives_the_deck_text() -> None:
    velocities = list(np.linspace(1e-3, 2e-3, 500))
    scene = ds.Scene(drive={"velocity": velocities})
    values = scene.text.split("=")[1].removesuffix("\n/\n").split(",")
    assert [float(value) for value in values] == velocities
    assert max(map(len, scene.text.splitlines())) < 200


def test_scene_is_immutable_and_comparable(fig3: ds.Scene, fig3_text: str) -> None:
    changed = fig3.replace(system={"mass": 0.5})
    assert fig3 == ds.Scene(fig3_text)
    assert hash(fig3) == hash(ds.Scene(fig3_text))
    assert changed != fig3
    assert changed == ds.Scene(fig3_text, system={"mass": 0.5})
    assert fig3.settings == ()
    assert changed.settings == ("system.mass=0.5",)
    assert "system.mass=0.5" in repr(changed)
    with pytest.raises(AttributeError):
        fig3.text = "other"  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(changed)) == changed


def test_check_gives_every_key_as_used(fig3: ds.Scene) -> None:
    resolved = fig3.replace(system={"mass": 0.5}).check()
    assert "mass = 0.5" in resolved.lower()
    assert_same(ds.run(resolved, scene=SHORT), ds.run(fig3, scene=SHORT, system={"mass": 0.5}))


def test_progress_goes_from_zero_to_the_end(fig3: ds.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []

    class Bar:
        def __init__(self, total: float, **_: object) -> None:
            self.n, self.total = 0.0, total

        def __enter__(self) -> Bar:
            return self

        def __exit__(self, *_: object) -> None:
            shown.append((self.n, self.total))

        def update(self, step: float) -> None:
            assert step > 0
            self.n += step

    monkeypatch.setitem(sys.modules, "tqdm.auto", types.SimpleNamespace(tqdm=Bar))
    ds.run(fig3, progress=True, scene={"t_end": 0.25})
    assert shown == [(pytest.approx(0.25), 0.25)]
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.raises(ds.UsageError, match="pip install tqdm"):
        ds.run(fig3, progress=True, scene=SHORT)


# Errors


def test_refused_deck_names_file_line_fault_and_remedy(tmp_path: Path, fig3_text: str) -> None:
    path = tmp_path / "wrong.nml"
    path.write_text(fig3_text.replace("mass = 0.25", "mas = 0.25").replace("v_f = 0.010", "v_f = 'fast'"))
    with pytest.raises(ds.DeckError) as refused:
        ds.run(path)
    first, second = sorted(str(refused.value).splitlines())
    assert f"{path}:15: " in first + second
    assert f"{path}:7: " in first + second
    assert "'mas'" in str(refused.value)
    assert "'mass'" in str(refused.value)


@pytest.mark.parametrize(
    ("groups", "named"),
    [
        ({"sytem": {"mass": 1.0}}, "system"),
        ({"system": {"mas": 1.0}}, "mass"),
        ({"system": {"mass": -1.0}}, "mass"),
        ({"system": {"mass": float("nan")}}, "mass"),
        ({"system": {"mass": float("inf")}}, "mass"),
        ({"system": {"mass": "heavy"}}, "mass"),
        ({"system": {"mass": [1.0, 2.0]}}, "mass"),
        ({"system": {"mass": True}}, "mass"),
        ({"scene": {"model": "ful"}}, "full"),
        ({"scene": {"model": "full', t_end = '1"}}, "model"),
        ({"drive": {"velocity": []}}, "velocity"),
        ({"system": {"mass": None}}, "'mass' is missing"),
    ],
)
def test_wrong_override_is_refused(fig3: ds.Scene, groups: dict[str, dict[str, object]], named: str) -> None:
    with pytest.raises(ds.DeckError, match=named):
        ds.run(fig3, **groups)


def test_wrong_call_is_refused(fig3: ds.Scene) -> None:
    with pytest.raises(ds.UsageError, match="a group is a mapping"):
        ds.run(fig3, system=3.0)  # type: ignore[arg-type]
    with pytest.raises(ds.UsageError, match="a number, a string"):
        ds.run(fig3, drive={"velocity": [1e-3, None]})
    with pytest.raises(ds.UsageError, match="line breaks"):
        ds.run(fig3, scene={"title": "two\nlines"})


def test_missing_deck_is_a_file_error(tmp_path: Path) -> None:
    with pytest.raises(ds.FileError, match=r"none\.nml"):
        ds.run(tmp_path / "none.nml")
    with pytest.raises(ds.FileError, match="No such file"):
        ds.run("none.nml")
    with pytest.raises(ds.FileError):
        ds.run(tmp_path)


def test_all_errors_are_one_family() -> None:
    for kind in (ds.DeckError, ds.SolverError, ds.FileError, ds.UsageError, ds.ColumnError):
        assert issubclass(kind, ds.Error)


def test_solver_error_carries_code_and_what_was_computed(fig3: ds.Scene) -> None:
    whole = ds.run(fig3, scene=SHORT)
    with pytest.raises(ds.SolverError, match="step") as gave_up:
        ds.run(fig3, integrator={"max_steps": int(whole.statistics["steps"]) // 2})
    assert gave_up.value.code == 42
    part = gave_up.value.result
    assert part is not None
    assert not part.complete
    assert part.result_code == 42
    assert 0 < part.time.size < whole.time.size
    np.testing.assert_array_equal(part["u_x"], whole["u_x"][: part.time.size])


# Results


def test_result_describes_itself(fig3_result: ds.Result) -> None:
    assert fig3_result.columns.units["u_x"] == "m"
    assert fig3_result.columns.units["time"] == "s"
    assert fig3_result.columns.long_names["u_x"]
    assert next(iter(fig3_result)) == "time"
    assert fig3_result.complete
    assert fig3_result.result_code == 0
    assert fig3_result.statistics["steps"] > 0
    assert isinstance(fig3_result.statistics["steps"], int)
    assert fig3_result.statistics.units["wall_time"] == "s"
    assert fig3_result.attributes["model"] == "full"
    assert fig3_result.attributes["method"] == "radau13"
    assert "u_x" in fig3_result
    assert "5398 sticks" in repr(fig3_result)


def test_missing_names_name_the_nearest(fig3: ds.Scene, fig3_result: ds.Result) -> None:
    """A slip of the pen is not answered with the advice for a column that was not asked for, nor the reverse."""
    short = ds.run(fig3, t_end=0.1, fields=["X", "theta"])
    for call, words in (
        (lambda: fig3_result["tehta"], r"no column 'tehta': did you mean 'theta'\?"),
        (lambda: fig3_result.columns["U_X"], "did you mean 'u_x'"),
        (lambda: fig3_result["quite else"], r"no column 'quite else': there are time, u_x"),
        (lambda: short["u_x"], r"no column 'u_x' \(spring elongation .*output\.fields and run again; there are time, X, theta"),
        (lambda: short["zet"], r"did you mean 'zeta'\? This run has none: name it in .*output\.fields"),
        (lambda: fig3_result.summary["perod"], "no summary value 'perod': did you mean 'period'"),
        (lambda: fig3_result.statistics["stepz"], "did you mean 'steps'"),
        (lambda: fig3_result.parameters["mas"], "did you mean 'mass'"),
        (lambda: ds.Described([])["a"], "no value 'a': there are none"),
        (lambda: fig3_result[["u_x"]], "no column"),
    ):
        with pytest.raises(ds.ColumnError, match=words) as missing:
            call()
        assert isinstance(missing.value, KeyError)
    # A value that other runs have: what is there says more than an error.
    assert np.isnan(short.summary["period"]) and "period" not in short.summary and short.summary.get("period") is None
    for call, words in (
        (lambda: fig3.replace(misalignmen_deg=2.0), "'misalignmen_deg' is not a key of a deck: did you mean 'misalignment_deg'"),
        (lambda: fig3.replace(**{"system.mas": 2.0}), r"did you mean 'system\.mass'"),
        (lambda: ds.run(fig3, systm=2.0), "not a group of a deck: did you mean 'system'"),
        (lambda: ds.run(fig3, qqqqq=2.0), r"nor a group of a deck \(scene, system, .*template"),
    ):
        with pytest.raises(ds.UsageError, match=words):
            call()


def test_a_result_is_a_mapping(fig3_result: ds.Result) -> None:
    assert isinstance(fig3_result, Mapping)
    names = list(fig3_result)
    assert names == list(fig3_result.keys()) == list(fig3_result.columns)
    assert len(fig3_result) == len(names) > 10
    assert dict(fig3_result)["u_x"] is fig3_result["u_x"]
    assert [name for name, values in fig3_result.items() if values is fig3_result["theta"]] == ["theta"]
    assert len(list(fig3_result.values())) == len(names)
    assert fig3_result.get("none of these") is None
    assert "u_x" in fig3_result and "tehta" not in fig3_result and [] not in list(fig3_result)
    other = ds.Result(**vars(fig3_result))
    assert fig3_result != other and len({fig3_result, other}) == 2
    slips = ds.stick_slip_statistics(fig3_result)
    assert list(dict(slips)) == list(slips.columns)


def test_units_have_one_grammar_and_counts_are_integers(fig3_result: ds.Result) -> None:
    units = {*fig3_result.columns.units.values(), *fig3_result.summary.units.values(), *fig3_result.parameters.units.values()}
    assert {"m/s", "1", "N"} <= units
    assert not [unit for unit in units if "-" in unit]
    assert (
        si_units("m s-1") == "m/s" and si_units("N s m-1") == "N s/m" and si_units("m s-2") == "m/s2" and si_units("s-1") == "1/s"
    )
    assert [si_units(unit) for unit in ("m/s", "1", "", "a - b")] == ["m/s", "1", "", "a - b"]
    assert type(fig3_result.summary["cycles"]) is type(fig3_result.summary["sticks"]) is int
    assert type(fig3_result.parameters["max_steps"]) is int
    lines = repr(fig3_result).splitlines()
    assert "  cycles = 8" in lines
    assert "w_x [m/s]" in lines[1] and "sticking, zeta" in lines[1] and re.search(rf", {list(fig3_result)[-1]}( \[\S+\])?$", lines[1])
    assert "model = full" in repr(fig3_result.parameters).splitlines()
    assert not [line for line in repr(fig3_result.parameters).splitlines() if line.endswith(" 1") and "=" not in line[-4:]]


def test_result_is_shown_in_a_notebook(fig3: ds.Scene, fig3_result: ds.Result) -> None:
    page = fig3_result._repr_html_()
    assert page.count("<svg") == 3
    assert "dynamic stiction" in page
    assert len(page) < 50_000
    assert "<svg" not in ds.run(fig3, scene=SHORT, output={"fields": "Y"})._repr_html_()


def test_results_and_errors_are_pickled(fig3: ds.Scene, fig3_result: ds.Result) -> None:
    again = pickle.loads(pickle.dumps(fig3_result))
    assert_same(again, fig3_result)
    assert again.attributes == fig3_result.attributes
    assert dict(again.summary) == dict(fig3_result.summary)
    assert again.columns.units == fig3_result.columns.units
    assert repr(again) == repr(fig3_result)
    with pytest.raises(ds.SolverError) as gave_up:
        ds.run(fig3, integrator={"max_steps": 10})
    error = pickle.loads(pickle.dumps(gave_up.value))
    assert (error.code, str(error)) == (42, str(gave_up.value))
    assert_same(error.result, gave_up.value.result)


def test_arrays_are_float64_and_contiguous(fig3_result: ds.Result) -> None:
    for name in fig3_result:
        values = fig3_result[name]
        assert values.dtype == np.float64
        assert values.flags.c_contiguous
        assert values.shape == fig3_result.time.shape
    assert fig3_result.time[0] == 0.0
    assert fig3_result.time[-1] == 10.0
    assert np.all(np.diff(fig3_result.time) > 0)


def test_events_alternate_and_agree_with_the_samples(fig3_result: ds.Result) -> None:
    kinds, times = fig3_result.events["kind"], fig3_result.events["time"]
    assert kinds[0] == 1
    assert np.all(np.diff(kinds) != 0)
    assert np.all(np.diff(times) > 0)
    after_first = fig3_result.time >= times[0]
    last_event = np.searchsorted(times, fig3_result.time[after_first], side="right") - 1
    np.testing.assert_array_equal(kinds[last_event] == 1, fig3_result["sticking"][after_first] == 1)


def test_fields_choose_the_columns(fig3: ds.Scene) -> None:
    result = ds.run(fig3, scene=SHORT, output={"fields": ["X", "theta"]})
    assert set(result.columns) == {"time", "X", "theta"}
    one = ds.run(fig3, scene=SHORT, output={"fields": "X"})
    np.testing.assert_array_equal(one["X"], result["X"])


def test_to_xarray_is_the_saved_group(tmp_path: Path, fig3_result: ds.Result) -> None:
    dataset = fig3_result.to_xarray()
    assert dataset["u_x"].attrs["units"] == "m"
    assert dataset["time"].attrs["units"] == "s"
    assert dataset.attrs["model"] == "full"
    fig3_result.save(tmp_path / "run.h5")
    with xarray.open_dataset(tmp_path / "run.h5", group="time_series", engine="h5netcdf") as saved:
        assert set(saved.variables) == set(dataset.variables)
        for name in dataset.variables:
            np.testing.assert_array_equal(saved[name], dataset[name])
            assert saved[name].dims == ("time",)
            assert saved[name].attrs["units"] == dataset[name].attrs["units"]


# Files


ADDED: dict[str, object] = {
    "temperature_C": 21.7,
    "humidity": np.float32(0.45),
    "position": np.array([1.5, 2.5]),
    "operator": np.bytes_(b"K. N."),
    "note": "mine: é",
    "checked": np.True_,
    "serial": 2**40,
}


def test_attributes_that_others_have_added_stay_as_they_are(tmp_path: Path, fig3_result: ds.Result) -> None:
    first, second = tmp_path / "edited.h5", tmp_path / "saved.h5"
    fig3_result.save(first)
    with h5py.File(first, "r+") as file:
        file.attrs.update(ADDED)
        kinds = {name: file.attrs.get_id(name).dtype for name in file.attrs}
    opened = ds.open(first)
    opened.save(second)
    for result in (opened, ds.open(second)):
        assert {name for name in result.attributes if name not in ADDED} == set(fig3_result.attributes)
        assert all(np.array_equal(result.attributes[name], value) for name, value in ADDED.items())
        assert result.to_xarray().attrs["temperature_C"] == 21.7
    with h5py.File(second) as file:
        assert {name: file.attrs.get_id(name).dtype for name in file.attrs} == kinds


def test_saved_result_opens_as_the_same(tmp_path: Path, fig3_result: ds.Result) -> None:
    path = tmp_path / "run.h5"
    fig3_result.save(path)
    opened = ds.open(path)
    assert_same(opened, fig3_result)
    for table in ("columns", "summary", "statistics", "parameters"):
        ours, theirs = getattr(fig3_result, table), getattr(opened, table)
        assert list(ours) == list(theirs), "in the same order"
        assert ours.units == theirs.units
        assert ours.long_names == theirs.long_names
        if table != "columns":
            assert [type(value) for value in ours.values()] == [type(value) for value in theirs.values()]
    assert dict(opened.summary) == dict(fig3_result.summary)
    assert dict(opened.statistics) == dict(fig3_result.statistics)
    assert dict(opened.parameters) == dict(fig3_result.parameters)
    assert opened.attributes == fig3_result.attributes
    assert opened.deck == fig3_result.deck
    assert opened.resolved_deck == fig3_result.resolved_deck
    assert [file.name for file in tmp_path.iterdir()] == ["run.h5"]


def test_a_file_of_the_executable_is_read_in_the_order_of_memory(program: Program, tmp_path: Path, fig3: ds.Scene) -> None:
    (tmp_path / "deck.nml").write_text(fig3.text)
    for fields in ("default", ["theta", "X", "u_x"]):
        names = fields if isinstance(fields, str) else ",".join(fields)
        program(
            "run",
            "deck.nml",
            "-o",
            "run.h5",
            "--quiet",
            "--overwrite",
            settings=["scene.t_end=0.05", f"output.fields={names}"],
            status=0,
        )
        opened, ours = ds.open(tmp_path / "run.h5"), ds.run(fig3, t_end=0.05, fields=fields)
        assert_same(opened, ours)
        assert repr(opened).splitlines()[1:] == repr(ours).splitlines()[1:]
        for table in ("columns", "summary", "statistics", "parameters"):
            assert list(getattr(opened, table)) == list(getattr(ours, table))
            assert getattr(opened, table).units == getattr(ours, table).units


def test_units_of_older_files_are_read_in_today_s_grammar(tmp_path: Path, fig3: ds.Scene) -> None:
    result = ds.run(fig3, t_end=0.01)
    columns = ds.Described((info._replace(units=info.units.replace("m/s", "m s-1")), v) for info, v in result.columns.info())
    old = ds.Result(**{**vars(result), "columns": columns})
    old.save(tmp_path / "old.h5")
    with h5py.File(tmp_path / "old.h5") as file:
        assert file["time_series/w_x"].attrs["units"] == "m s-1"
    assert ds.open(tmp_path / "old.h5").columns.units == result.columns.units


def layout(file: h5py.File) -> dict[str, object]:
    """Every object of a file with its kind, type and attributes; every attribute with its type and text."""
    found: dict[str, object] = {}

    def note(name: str, item: h5py.Group | h5py.Dataset) -> None:
        found[name] = kind_of(item.id.get_type(), item.shape) if isinstance(item, h5py.Dataset) else "group"
        for key in item.attrs:
            attribute = item.attrs.get_id(key)
            value = item.attrs[key] if key in ("units", "long_name", "NAME", "CLASS") else None
            found[f"{name}@{key}"] = (*kind_of(attribute.get_type(), attribute.shape), value)

    note("", file)
    file.visititems(note)
    return found


def kind_of(kind: h5py.h5t.TypeID, shape: tuple[int, ...]) -> tuple[object, ...]:
    if isinstance(kind, h5py.h5t.TypeStringID):
        return "text", kind.get_cset(), kind.is_variable_str(), shape
    return kind.dtype.str, shape


def test_saved_file_has_the_layout_of_the_executable(tmp_path: Path, program: Program, fig3: ds.Scene) -> None:
    scene = fig3.replace(scene=SHORT)
    (tmp_path / "deck.nml").write_text(scene.text)
    program("run", "deck.nml", "-o", "theirs.h5", "--set", "scene.t_end=0.05", "--quiet", status=0)
    ds.run(scene).save(tmp_path / "ours.h5")
    with h5py.File(tmp_path / "ours.h5") as ours, h5py.File(tmp_path / "theirs.h5") as theirs:
        assert layout(ours) == layout(theirs)
        for name in set(ours.attrs) - {"created"}:
            assert ours.attrs[name] == theirs.attrs[name], name
        for group in ("deck", "parameters", "time_series", "events", "summary"):
            for name in ours[group]:
                assert np.all(ours[group][name][()] == theirs[group][name][()]), name


def test_existing_file_is_kept(tmp_path: Path, fig3: ds.Scene) -> None:
    path = tmp_path / "run.h5"
    result = ds.run(fig3, scene=SHORT)
    result.save(path)
    before = path.read_bytes()
    with pytest.raises(ds.FileError, match="overwrite"):
        result.save(path)
    assert path.read_bytes() == before
    result.save(path, overwrite=True)
    assert_same(ds.open(path), result)
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    with pytest.raises(ds.FileError, match="no HDF5 file"):
        result.save(notes, overwrite=True)
    assert notes.read_text() == "mine"
    with pytest.raises(ds.FileError, match="cannot be written"):
        result.save(tmp_path / "no" / "folder.h5")


def test_foreign_and_damaged_files_are_refused(tmp_path: Path, fig3_result: ds.Result) -> None:
    with pytest.raises(ds.FileError, match="no such file"):
        ds.open(tmp_path / "none.h5")
    foreign = tmp_path / "foreign.h5"
    with h5py.File(foreign, "w") as file:
        file["data"] = np.arange(3)
    with pytest.raises(ds.FileError, match="no file of dynstiction"):
        ds.open(foreign)
    text = tmp_path / "text.h5"
    text.write_text("&scene /")
    with pytest.raises(ds.FileError, match="is a deck, not a result: dynstiction run"):
        ds.open(text)
    text.write_text("a letter")
    with pytest.raises(ds.FileError, match="cannot be read"):
        ds.open(text)
    whole = tmp_path / "whole.h5"
    fig3_result.save(whole)
    for part in (100, 3000, whole.stat().st_size // 2):
        truncated = tmp_path / f"{part}.h5"
        truncated.write_bytes(whole.read_bytes()[:part])
        with pytest.raises(ds.FileError, match="cannot be read"):
            ds.open(truncated)


def test_incomplete_file_opens_with_a_warning(tmp_path: Path, fig3_result: ds.Result) -> None:
    path = tmp_path / "run.h5"
    fig3_result.save(path)
    with h5py.File(path, "r+") as file:
        file.attrs["complete"] = 0
        del file["summary"], file["statistics"]
    with pytest.warns(ds.IncompleteWarning, match="before the run's end"):
        opened = ds.open(path)
    assert not opened.complete
    assert_same(opened, fig3_result)
    assert len(opened.summary) == 0


# Threads, signals, memory


CREEP: dict[str, dict[str, object]] = {
    "system": {"mass": None},
    "friction": {"law": None, "mu_inf": None, "v_f": None},
    "initial": {"velocity_ratio": None},
    "integrator": {"method": None, "rtol": None},
}
SMOOTHED = {"contact": "smoothed", "v_smooth": 1e-6}
# Every model and method, one scene each: what one run leaves behind would change the next.
THREAD_SCENES: list[dict[str, dict[str, object]]] = [
    {"integrator": {"method": "radau5"}},
    {"integrator": {"method": "radau9"}, "system": {"misalignment_deg": 5.0}},
    {"integrator": {"method": "radau13"}, "system": {"misalignment_deg": 10.0}},
    {"integrator": {"method": "dopri5"}, "system": {"misalignment_deg": 20.0}},
    {"integrator": {"method": "dop853"}, "drive": {"velocity": 3e-3}},
    {"integrator": {"method": "rk4", "step": 1e-6}, "friction": SMOOTHED},
    {"scene": {"model": "low_frequency"}, "system": {"stiffness_y": None}},
    {"scene": {"model": "high_frequency"}, "initial": {"elongation_x": 1e-4}},
    {"scene": {"model": "creep"}, **CREEP},
    {"scene": {"model": "creep_asymptotic"}, **CREEP, "system": {"mass": None, "stiffness_y": None}},
    {"scene": {"model": "auto"}},
]


@pytest.fixture(scope="module")
def thread_scenes(fig3: ds.Scene) -> list[ds.Scene]:
    return [fig3.replace(**{**changes, "scene": {"t_end": 0.2, **changes.get("scene", {})}}) for changes in THREAD_SCENES]


@pytest.fixture(scope="module")
def alone(thread_scenes: list[ds.Scene]) -> list[ds.Result]:
    return [ds.run(scene) for scene in thread_scenes]


@pytest.mark.parametrize("threads", [2, 4, 16])
def test_threads_give_the_same_bits(threads: int, thread_scenes: list[ds.Scene], alone: list[ds.Result]) -> None:
    with ThreadPoolExecutor(threads) as pool:
        together = list(pool.map(ds.run, thread_scenes * 2))
    for a, b in zip(together, alone * 2, strict=True):
        assert_same(a, b)


@pytest.mark.parametrize("threads", [2, 4, 16])
def test_functions_give_the_same_bits_in_threads(threads: int) -> None:
    angle = np.linspace(0.01, 3.0, 2000)
    motion = np.random.default_rng(1).normal(scale=1e-3, size=(2000, 4))

    def everything(_: int) -> list[bytes]:
        found = [
            ds.rhs(motion, **SLIDER),
            ds.jacobian(motion, **SLIDER),
            ds.damping_ratio(angle, **SLIDER),
            ds.steady_sliding_eigenvalues(**SLIDER),
            *ds.critical_misalignment(**SLIDER),
        ]
        return [np.asarray(values).tobytes() for values in found]

    expected = everything(0)
    with ThreadPoolExecutor(threads) as pool:
        for found in pool.map(everything, range(2 * threads)):
            assert found == expected


def test_errors_in_threads_keep_their_texts(fig3: ds.Scene) -> None:
    scenes = [fig3.replace(integrator={"max_steps": n}) for n in (100, 300, 1000)]

    def message(n: int) -> str:
        try:
            if n % 2:
                ds.run(scenes[n % 3])
            else:
                ds.damping_ratio(1.0, **{**SLIDER, "mass": -(10.0 ** -(n % 5))})
        except ds.Error as error:
            return str(error)
        return "no error"

    expected = [message(n) for n in range(30)]
    assert "no error" not in expected
    with ThreadPoolExecutor(16) as pool:
        for n, found in zip(range(300), pool.map(lambda n: message(n % 30), range(300)), strict=True):
            assert found == expected[n % 30]


def test_other_threads_go_on_during_a_run(fig3: ds.Scene) -> None:
    ticks = []
    done = threading.Event()

    def tick() -> None:
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        begin = time.perf_counter()
        ds.run(fig3, scene={"t_end": 20.0}, integrator={"rtol": 1e-10})
        end = time.perf_counter()
    finally:
        done.set()
        thread.join()
    during = np.array([tick for tick in ticks if begin <= tick <= end])
    # Chunks of 50 ms that held the lock would leave a tick each, at most.
    assert during.size > 5 * (end - begin) / 0.05
    assert np.median(np.diff(during)) < 0.01


def test_interrupt_ends_a_run_within_a_second(fig3_text: str) -> None:
    script = (
        "import dynstiction as ds, signal, sys\n"
        # A shell that starts the tests in the background has interrupts ignored, and children inherit that.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "print('begun', flush=True)\n"
        "ds.run(sys.argv[1], scene={'t_end': 1e5}, output={'interval': 1.0}, integrator={'cycle_map': 'off'})\n"
    )
    process = SCRIPT.start(script, fig3_text, stdout=PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    begin = time.perf_counter()
    _, errors = process.communicate(timeout=10.0)
    assert time.perf_counter() - begin < 1.0
    assert "KeyboardInterrupt: stopped at t = " in errors
    # As by Ctrl-C, so that a loop of the shell ends too.
    assert process.returncode == -signal.SIGINT


def test_an_interrupt_waits_for_what_is_kept() -> None:
    """It is raised right after the complete block; or not at all, if another one is being raised."""
    steps: list[str] = []
    with pytest.raises(KeyboardInterrupt), held_back():
        os.kill(os.getpid(), signal.SIGINT)
        steps.append("kept")
    with held_back(forget=True):
        os.kill(os.getpid(), signal.SIGINT)
        steps.append("told")
    assert steps == ["kept", "told"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


INTERRUPT_A_RUN = """
import os, signal, sys, threading, time
import dynstiction as ds

def interrupt():
    time.sleep(0.2)
    for _ in range(int(sys.argv[2])):
        os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
simulation = ds.Simulation(sys.argv[1], t_end=400.0)
threading.Thread(target=interrupt).start()
try:
    simulation.finish()
except KeyboardInterrupt as error:
    part = error.partial
time.sleep(0.1)
assert not part.complete and 0.0 < part.time[-1] <= simulation.time < 400.0, (part, simulation)
assert simulation.state["time"] == simulation.time and part.events["time"][-1] <= simulation.time
result, whole = simulation.finish(), ds.run(sys.argv[1], t_end=400.0)
for name in whole:
    assert result[name].tobytes() == whole[name].tobytes(), name
    assert part[name].tobytes() == whole[name][: part.time.size].tobytes(), name
assert result.events.tobytes() == whole.events.tobytes()
assert part.events.tobytes() == whole.events[: part.events.size].tobytes()
assert dict(result.summary) == dict(whole.summary)
print("the same")
"""


@pytest.mark.parametrize("signals", [1, 3])
def test_interrupt_gives_what_is_done_and_the_run_can_go_on(signals: int, fig3_text: str) -> None:
    assert SCRIPT(INTERRUPT_A_RUN, fig3_text, signals, status=0).stdout == "the same\n"


def resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_a_thousand_runs_leak_nothing(fig3: ds.Scene) -> None:
    scene = fig3.replace(scene={"t_end": 1e-3})
    wrong = fig3.replace(system={"mas": 1.0})

    def call(times: int) -> None:
        for _ in range(times):
            ds.run(scene)
            with pytest.raises(ds.DeckError):
                ds.run(wrong)
        gc.collect()

    call(200)
    before = resident_bytes()
    call(1000)
    # One deck text or buffer of 64 KiB forgotten a call would be 64 MB.
    assert resident_bytes() - before < 4_000_000


# Equations


def numpy_rhs(state: np.ndarray, v_smooth: float = 0.0) -> np.ndarray:
    """Eqs. (1)-(5), written a second time."""
    p = SLIDER
    u, w = state[..., :2], state[..., 2:]
    v = np.linalg.norm(w, axis=-1, keepdims=True)
    force = (p["mu_inf"] + (p["mu_0"] - p["mu_inf"]) * np.exp(-v / p["v_f"])) * p["normal_load"]
    angle = np.radians(p["misalignment_deg"])
    along = np.array([np.cos(angle), np.sin(angle)])
    stiffness = np.array([p["stiffness_x"], p["stiffness_y"]])
    acceleration = (stiffness * u - force * w / np.sqrt(v**2 + v_smooth**2)) / p["mass"]
    return np.concatenate([p["velocity"] * along - w, acceleration], axis=-1)


def some_states(*shape: int) -> np.ndarray:
    scale = np.array([2e-3, 2e-7, 1e-3, 1e-4])
    return np.random.default_rng(3).normal(size=(*shape, 4)) * scale


@pytest.mark.parametrize("shape", [(), (1,), (7,), (3, 5), (2, 0, 4)])
@pytest.mark.parametrize("v_smooth", [0.0, 1e-5])
def test_rhs_and_jacobian_have_the_shape_of_the_states(shape: tuple[int, ...], v_smooth: float) -> None:
    states = some_states(*shape)
    rates = ds.rhs(states, **SLIDER, v_smooth=v_smooth)
    assert rates.shape == (*shape, 4)
    assert rates.flags.c_contiguous
    np.testing.assert_allclose(rates, numpy_rhs(states, v_smooth), rtol=1e-12, atol=1e-14)
    derivative = ds.jacobian(states, **SLIDER, v_smooth=v_smooth)
    assert derivative.shape == (*shape, 4, 4)
    assert derivative.flags.c_contiguous


@pytest.mark.parametrize("v_smooth", [0.0, 1e-3])
def test_jacobian_is_the_derivative_of_rhs(v_smooth: float) -> None:
    states = some_states(50)
    derivative = ds.jacobian(states, **SLIDER, v_smooth=v_smooth)
    speed = np.linalg.norm(states[:, 2:], axis=1)[:, None]
    forces = np.abs(states[:, :2]) * [SLIDER["stiffness_x"], SLIDER["stiffness_y"]] + 2.0
    terms = np.concatenate([np.abs(states[:, 2:]) + SLIDER["velocity"], forces / SLIDER["mass"]], axis=1)
    for j in range(4):
        step = 1e-4 * speed if j >= 2 else np.full_like(speed, 1e-9)
        shift = np.zeros((50, 4))
        shift[:, j : j + 1] = step

        def slope(h: float, shift: np.ndarray = shift, step: np.ndarray = step) -> np.ndarray:
            difference = numpy_rhs(states + h * shift, v_smooth) - numpy_rhs(states - h * shift, v_smooth)
            return difference / (2 * h * step)

        # Richardson: the error of the central difference is of second order.
        expected = (4 * slope(0.5) - slope(1.0)) / 3
        rounding = 50 * np.finfo(float).eps * terms / step
        truncation = 1e-9 * np.abs(expected).max(axis=1, keepdims=True)
        assert np.all(np.abs(derivative[:, :, j] - expected) <= rounding + truncation)


def test_friction_without_a_limit_is_constant() -> None:
    constant = {k: v for k, v in SLIDER.items() if k not in ("mu_inf", "v_f")}
    equal = SLIDER | {"mu_inf": SLIDER["mu_0"]}
    states = some_states(10)
    np.testing.assert_array_equal(ds.rhs(states, **constant), ds.rhs(states, **equal))
    np.testing.assert_array_equal(ds.jacobian(states, **constant), ds.jacobian(states, **equal))
    with pytest.raises(ds.UsageError, match="belong together"):
        ds.rhs(states, **constant, mu_inf=0.1)
    with pytest.raises(ds.UsageError, match="last dimension"):
        ds.rhs(np.zeros((4, 3)), **SLIDER)


def test_rhs_takes_any_array_and_changes_none() -> None:
    states = some_states(6)
    kept = states.copy()
    expected = ds.rhs(states, **SLIDER)
    np.testing.assert_array_equal(ds.rhs(states.tolist(), **SLIDER), expected)
    np.testing.assert_array_equal(ds.rhs(np.asfortranarray(states), **SLIDER), expected)
    np.testing.assert_array_equal(ds.rhs(states[::2], **SLIDER), expected[::2])
    np.testing.assert_array_equal(states, kept)
