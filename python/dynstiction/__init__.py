"""Sliding of an anisotropically sprung mass with friction-vector rotation.

The model is that of K. Nakano and V. L. Popov, "Dynamic stiction without static friction: The role of friction
vector rotation", Phys. Rev. E 102, 063001 (2020). SI units everywhere; angles in radians unless a name ends in ``_deg``.

>>> import dynstiction as ds
>>> result = ds.run("inputs/fig3.nml", misalignment_deg=2.0)               # doctest: +SKIP
>>> result.time, result["u_x"], result.events, result.summary              # doctest: +SKIP
>>> result.save("run.h5"); again = ds.open("run.h5")                       # doctest: +SKIP
"""

import re as _re
from importlib import import_module as _import_module

# A name is imported at its first use: a script pays for what it uses. The stub, which type checkers read, is the list.
with open(f"{__file__}i", encoding="utf-8") as _stub:
    _MODULE_OF = {
        name: module for module, name in _re.findall(r"^from \.(\w+) import (\w+)", _stub.read(), _re.M)
    }

__all__ = [name for name in _MODULE_OF if name != "plot"]


def __getattr__(name: str) -> object:
    if name == "__version__":
        return _import_module("._native", __name__).origin()["version"]
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = _import_module(f".{_MODULE_OF[name]}", __name__)
    globals()[name] = value = getattr(module, name, module)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF, "__version__"})
