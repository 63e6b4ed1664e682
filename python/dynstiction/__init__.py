"""Sliding of an anisotropically sprung mass with friction-vector rotation.

The model is that of K. Nakano and V. L. Popov, "Dynamic stiction without static friction: The role of friction
vector rotation", Phys. Rev. E 102, 063001 (2020). SI units everywhere; angles in radians unless a name ends in ``_deg``.

>>> import dynstiction as ds
>>> result = ds.run("inputs/fig3.nml", misalignment_deg=2.0)               # doctest: +SKIP
>>> result.time, result["u_x"], result.events, result.summary              # doctest: +SKIP
>>> result.save("run.h5"); again = ds.open("run.h5")                       # doctest: +SKIP
"""

from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from .errors import (
    ColumnError,
    DeckError,
    Error,
    FileError,
    FitWarning,
    IncompleteWarning,
    OutOfMemoryError,
    PackageError,
    SamplingWarning,
    SolverError,
    StiffnessWarning,
    UsageError,
)

try:
    import numpy as _numpy  # noqa: F401
except ImportError as error:
    # NumPy refuses all but the first interpreter of a process that imports it.
    raise PackageError(
        f"dynstiction needs NumPy, which cannot be loaded here ({error}): install it; if the process has several "
        "interpreters, use dynstiction in one of them, or use processes"
    ) from error

from . import _native
from ._run import run
from ._sweep import sweep
from .creep import Creep, creep_asymptotic, creep_exact, creep_velocity
from .equations import SlipProblem, jacobian, rhs, slip_problem
from .groups import Drive, Friction, Initial, Integrator, Output, Setup, Sweep, System
from .limit_cycles import Cycles, LimitCycle, cycles
from .record import Described
from .result import Result, open
from .scene import Scene
from .simulation import Simulation
from .spectrum import Spectrogram, creep_frequency, oscillation_frequency, ridge, spectrogram
from .stability import (
    CreepEnd,
    CriticalMisalignment,
    Stability,
    creep_end,
    critical_misalignment,
    damping_ratio,
    steady_sliding_eigenvalues,
)
from .stick_slip import StickSlip, stick_slip_statistics

# What only some scripts use is imported at its first use: that is an eighth of the import of the package, and matplotlib a second.
_MODULE_OF = {
    "plot": "plot",
    "Trade": "_trade",
    "trade": "_trade",
    "Branch": "branches",
    "BranchPoint": "branches",
    "Branches": "branches",
    "branch": "branches",
    "Trace": "trace",
    "Statistic": "trace_comparison",
    "TraceComparison": "trace_comparison",
    "compare": "trace_comparison",
    "CreepFit": "creep_fit",
    "fit_creep": "creep_fit",
    "FrictionFit": "friction_fit",
    "fit_friction_law": "friction_fit",
    "Chain": "trace_chain",
    "CreepTest": "trace_rivals",
    "Explanation": "trace_rivals",
    "creep_test": "trace_rivals",
    "explanations": "trace_rivals",
    "KeyRange": "ranges",
    "StickSlipRange": "ranges",
    "stick_slip_range": "ranges",
    "Derivatives": "tangents",
    "derivatives": "tangents",
    "Sensitivity": "tangents",
    "sensitivity": "tangents",
    "TracePlan": "trace_plan",
    "plan_traces": "trace_plan",
    "TraceCycles": "trace_cycles",
    "Waveform": "trace_cycles",
    "find_cycles": "trace_cycles",
    "mean_slip": "trace_cycles",
    "mean_waveform": "trace_cycles",
    "read_trace": "trace_file",
    "Fit": "trace_fit",
    "FittedParameter": "trace_fit",
    "FittedTrace": "trace_fit",
    "fit": "trace_fit",
}
if _TYPE_CHECKING:
    from ._trade import Trade, trade
    from .branches import Branch, Branches, BranchPoint, branch
    from .creep_fit import CreepFit, fit_creep
    from .friction_fit import FrictionFit, fit_friction_law
    from .plot import plot as plot
    from .ranges import KeyRange, StickSlipRange, stick_slip_range
    from .tangents import Derivatives, Sensitivity, derivatives, sensitivity
    from .trace import Trace
    from .trace_chain import Chain
    from .trace_comparison import Statistic, TraceComparison, compare
    from .trace_cycles import TraceCycles, Waveform, find_cycles, mean_slip, mean_waveform
    from .trace_file import read_trace
    from .trace_fit import Fit, FittedParameter, FittedTrace, fit
    from .trace_plan import TracePlan, plan_traces
    from .trace_rivals import CreepTest, Explanation, creep_test, explanations

__version__ = _native.origin()["version"]

__all__ = [
    "Branch",
    "BranchPoint",
    "Branches",
    "Chain",
    "ColumnError",
    "Creep",
    "CreepEnd",
    "CreepFit",
    "CreepTest",
    "CriticalMisalignment",
    "Cycles",
    "DeckError",
    "Derivatives",
    "Described",
    "Drive",
    "Error",
    "Explanation",
    "FileError",
    "Fit",
    "FitWarning",
    "FittedParameter",
    "FittedTrace",
    "Friction",
    "FrictionFit",
    "IncompleteWarning",
    "Initial",
    "Integrator",
    "KeyRange",
    "LimitCycle",
    "OutOfMemoryError",
    "Output",
    "PackageError",
    "Result",
    "SamplingWarning",
    "Scene",
    "Sensitivity",
    "Setup",
    "Simulation",
    "SlipProblem",
    "SolverError",
    "Spectrogram",
    "Stability",
    "Statistic",
    "StickSlip",
    "StickSlipRange",
    "StiffnessWarning",
    "Sweep",
    "System",
    "Trace",
    "TraceComparison",
    "TraceCycles",
    "TracePlan",
    "Trade",
    "UsageError",
    "Waveform",
    "branch",
    "compare",
    "creep_asymptotic",
    "creep_end",
    "creep_exact",
    "creep_frequency",
    "creep_test",
    "creep_velocity",
    "critical_misalignment",
    "cycles",
    "damping_ratio",
    "derivatives",
    "explanations",
    "find_cycles",
    "fit",
    "fit_creep",
    "fit_friction_law",
    "jacobian",
    "mean_slip",
    "mean_waveform",
    "open",
    "oscillation_frequency",
    "plan_traces",
    "read_trace",
    "rhs",
    "ridge",
    "run",
    "sensitivity",
    "slip_problem",
    "spectrogram",
    "steady_sliding_eigenvalues",
    "stick_slip_range",
    "stick_slip_statistics",
    "sweep",
    "trade",
]


def __getattr__(name: str) -> _Any:
    """Import what is in ``_MODULE_OF``, at its first use."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module  # noqa: PLC0415

    module = import_module(f".{_MODULE_OF[name]}", __name__)
    globals()[name] = value = getattr(module, name, module)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})
