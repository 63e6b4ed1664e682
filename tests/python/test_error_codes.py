"""Every way to end has its code; docs/errors.md explains each one, and the messages say so.

What no deck provokes is in tests/unit/test_giving_up.f90, with a method that fails on purpose: time that stands still, a NaN in the
state, in a work or in a column alone.
"""

from __future__ import annotations

import re

import h5py
import pytest
from fig3 import DECK
from programs import INPUTS, ROOT, STOPPED, Program

PAGE = "docs/errors.md"
HELP = "dynstiction help errors"
"""Where a message sends: the same page, in the program."""

pytestmark = pytest.mark.deck


def codes() -> dict[str, int]:
    """Names and values of the codes in src/base/errors.f90."""
    found = re.findall(r"integer, parameter :: (\w+) = (\d+)", (ROOT / "src/base/errors.f90").read_text())
    return {name: int(value) for name, value in found}


def rows() -> list[list[str]]:
    """All rows of all tables of the page."""
    lines = (ROOT / PAGE).read_text().splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")]


def test_every_code_is_explained() -> None:
    """By its number, with what it means and a cure; what needs none is success."""
    explained: dict[int, list[str]] = {}
    for row in rows():
        if re.fullmatch(r"\d+", row[0]):
            explained[int(row[0])] = row[1:]
    assert len(codes()) >= 12
    for name, code in codes().items():
        assert code in explained, f"{name} = {code} is not in {PAGE}"
        assert all(len(cell) > 3 for cell in explained[code][-2:]) or code == 0, f"{PAGE} says too little of {code}"


def words_of(code: int) -> list[str]:
    """What the page says that the message of a solver that gave up says."""
    message = next(row[1] for row in rows() if row[0] == str(code))
    return [part.strip(" `") for part in re.split("…|;", message) if part.strip(" `…;")]


DECKS: dict[str, tuple[int, tuple[str, ...]]] = {
    "step_underflow": (41, ("integrator.method=radau9", "friction.v_f=1e-9", "system.mass=1e-12")),
    "too_many_steps": (42, ("integrator.max_steps=50",)),
    "not_finite": (43, ("friction.normal_load=1e300",)),
    "too_many_rejections": (44, ("initial.elongation_x=1e300",)),
    "stopped_early": (75, ("output.wall_limit=1e-9",)),
}


@pytest.mark.parametrize("name", DECKS)
def test_the_message_names_the_page_and_the_file_the_code(program: Program, name: str) -> None:
    code, settings = DECKS[name]
    assert codes()[name] == code
    done = program("run", DECK, "-o", "x.h5", "--quiet", settings=("scene.t_end=0.3", *settings))
    if done.returncode == -8:
        pytest.skip("this build stops at any overflow")
    assert done.returncode == (75 if code == 75 else 4), done
    assert done.stderr.count("\n") == 1
    assert HELP in done.stderr
    assert re.search(r" (at|after) t = [\d.]+(e-?\d+)? (s|of)\b", done.stderr)
    if code != 75:
        assert any(words in done.stderr for words in words_of(code)), (done.stderr, words_of(code))
    with h5py.File(program.folder / "x.h5") as data:
        assert (data.attrs["result_code"], data.attrs["complete"]) == (code, 0)
        assert f"dynstiction: {DECK}: {data.attrs['result_text']}\n" == done.stderr


def test_failed_and_forgotten_cases_of_a_sweep(program: Program) -> None:
    folder = program.folder
    grid = "\n&sweep\n parameter = 'system.misalignment_deg', first = 1.0, last = 8.0, count = 4\n/\n"
    (folder / "map.nml").write_text((INPUTS / "low_frequency.nml").read_text() + grid)
    limit = ("--quiet", "--set", "integrator.max_steps=20")
    done = program("run", "map.nml", "-o", "failed.h5", *limit)
    assert done.returncode == codes()["some_failed"] == 5
    assert HELP in done.stderr
    with h5py.File(folder / "failed.h5") as data:
        assert (data["sweep/result_code"][:] == 42).all()
        assert all(HELP.encode() in text for text in data["sweep/failures/result_text"][:])
        assert data.attrs["result_code"] == 5
    program("run", "map.nml", "-o", "part.h5", *limit, "--share", "1/2", status=5)
    assert HELP in program("merge", "map.nml", "-o", "part.h5", *limit, status=STOPPED).stderr
    with h5py.File(folder / "part.h5") as data:
        assert sorted(data["sweep/result_code"][:]) == [-1, -1, 42, 42]
