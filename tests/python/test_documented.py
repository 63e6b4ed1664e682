"""Every public name is documented and typed; importing is quick and takes only what is used."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dynstiction as ds
import pytest
from dynstiction import _native
from programs import SCRIPT, Program

PACKAGE = Path(ds.__file__).parent


def callables() -> Iterator[tuple[str, Any]]:
    """Public functions, classes, and their public methods and properties."""
    for name in ds.__all__:
        thing = getattr(ds, name)
        yield name, thing
        if inspect.isclass(thing):
            for member, value in vars(thing).items():
                if not member.startswith("_") and (callable(value) or isinstance(value, classmethod | property)):
                    yield f"{name}.{member}", value.__func__ if isinstance(value, classmethod) else value


PUBLIC = dict(callables())


def section(text: str, title: str) -> str:
    """A section of a docstring, without its title."""
    found = re.search(rf"^{title}\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", text, re.MULTILINE | re.DOTALL)
    return found[1] if found else ""


def named_in(text: str) -> set[str]:
    """Parameters that a docstring explains."""
    heads = re.findall(r"^(\S[^:\n]*)(?: : .*)?$", section(text, "Parameters"), re.MULTILINE)
    return {name.strip().lstrip("*") for head in heads for name in head.split(",")}


def parameters_of(thing: Any) -> set[str]:
    """Parameters of a function, or of what makes an instance."""
    if isinstance(thing, property) or (inspect.isclass(thing) and issubclass(thing, Exception | tuple)):
        return set()
    return set(inspect.signature(thing).parameters) - {"self", "cls"}


def attributes_in(text: str) -> set[str]:
    heads = re.findall(r"^(\S[^:\n]*) : ", section(text, "Attributes"), re.MULTILINE)
    return {part.strip() for head in heads for part in head.split(",")}


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_explained_with_its_parameters(name: str) -> None:
    thing = PUBLIC[name]
    assert "__doc__" in vars(thing) if inspect.isclass(thing) else thing.__doc__
    text = inspect.getdoc(thing) or ""
    first = text.splitlines()[0]
    assert len(first) > 15
    assert first.rstrip().endswith((".", ":"))
    explained = named_in(text)
    if inspect.isclass(thing):
        # A dataclass that is a result lists its attributes.
        explained |= attributes_in(text).union(*(attributes_in(inspect.getdoc(base) or "") for base in thing.__mro__[1:]))
    missing = parameters_of(thing) - explained
    assert not missing, f"{name}: {sorted(missing)}"


def test_the_check_would_see_a_gap() -> None:
    text = "Do it.\n\nParameters\n----------\na : float\n    One.\nb, c : int\n    Two.\n\nReturns\n-------\nx : y\n"
    assert named_in(text) == {"a", "b", "c"}
    assert named_in("Do it.") == set()


def test_every_module_says_what_it_is() -> None:
    for path in sorted(PACKAGE.rglob("*.py")):
        assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), path.name


# Types


def test_the_package_says_that_it_is_typed() -> None:
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.full
@pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="no mypy: pip install mypy")
def test_mypy_is_content_with_package_and_use(tmp_path: Path) -> None:
    use = tmp_path / "use.py"
    use.write_text(
        "import dynstiction as ds\n"
        "scene = ds.Scene(system=ds.System(mass=0.25), friction={'mu_0': 0.2})\n"
        "mass: float | None = scene.replace(system={'mass': 1.0}).system.mass\n"
        "with ds.Simulation(scene, drive=ds.Drive(velocity=[1e-3, 2e-3], time=(0.0, 1.0))) as simulation:\n"
        "    simulation.step_to(0.5)\n"
        "    result: ds.Result = simulation.finish(progress=True)\n"
        "period: float = ds.stick_slip_statistics(result).means()['period']\n"
        "figure = ds.plot(ds.run(scene, misalignment_deg=2.0, times=[0.1, 0.2]))\n"
        "figure.savefig('x.png')\n"
        "result.plot('path').savefig('x.png')\n"
        "by_group: dict[str, dict[str, float]] = {'system': {'mass': 1.0}}\n"
        "scene.replace(**by_group)\n"
    )
    wrong = tmp_path / "wrong.py"
    wrong.write_text(
        "import dynstiction as ds\n"
        "ds.System(mas=1.0)\n"
        "ds.Setup(model='ful')\n"
        "ds.Scene(sytem=ds.System())\n"
        "ds.run('x.nml', system=ds.Friction())\n"
        "ds.System(mass='heavy')\n"
        "ds.run('x.nml', misalignment_dg=2.0)\n"
        "ds.run('x.nml', mass='heavy')\n"
    )

    mypy = Program((sys.executable, "-m", "mypy", "--strict", "--cache-dir", tmp_path / "cache"), tmp_path)
    assert mypy(use, status=0, timeout=None).stdout == "Success: no issues found in 1 source file\n"
    report = mypy(wrong, status=1, timeout=None).stdout
    for line in range(2, 9):
        assert f"wrong.py:{line}: error" in report, report


# Cost

SLOW = (
    *("matplotlib", "scipy", "xarray", "pandas", "tqdm", "h5py", "h5netcdf"),
    *("dynstiction.plot", "dynstiction._trade", "dynstiction.trace_comparison", "dynstiction.trace_fit"),
)


def python(code: str) -> str:
    return SCRIPT(code, status=0).stdout.strip()


def test_importing_and_running_takes_nothing_that_is_not_used(fig3_text: str) -> None:
    code = f"""
import sys, dynstiction as ds
result = ds.run({fig3_text!r}, scene={{"t_end": 0.01}})
repr(result), result._repr_html_(), ds.Scene({fig3_text!r})._repr_html_(), ds.stick_slip_statistics(result)
print([name for name in {SLOW!r} if name in sys.modules])
"""
    assert python(code) == "[]"


def test_a_run_asks_the_core_few_times(fig3: ds.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a short run costs beyond the integration is mostly calls."""
    calls: list[str] = []

    class Counting:
        def __getattr__(self, name: str) -> Any:
            calls.append(name)
            return getattr(core, name)

    core = _native._core
    ds.run(fig3, scene={"t_end": 1e-3})
    monkeypatch.setattr(_native, "_core", Counting())
    ds.run(fig3, scene={"t_end": 1e-3})
    assert 0 < len(calls) <= 25, calls
