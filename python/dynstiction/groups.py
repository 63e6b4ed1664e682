"""The groups of a deck as dataclasses.

Made by tools/generate_groups.py from the schema of the core: change src/deck/schema.f90 or the script, not this file.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, TypedDict, TypeVar

from .deck_group import DeckGroup

__all__ = [
    "Drive",
    "Friction",
    "GroupValues",
    "Groups",
    "Initial",
    "Integrator",
    "Output",
    "SceneGroups",
    "Setup",
    "Sweep",
    "System",
]


@dataclass(frozen=True, kw_only=True, repr=False)
class Setup(DeckGroup):
    """Group ``&scene`` of a deck.

    Parameters
    ----------
    title : str
        What the scene shows; kept in the results.
    model : Literal["full", "low_frequency", "high_frequency", "creep", "creep_asymptotic", "auto"]
        The equations to integrate. Default full.
    form : Literal["first_power", "printed", "third_order"]
        Of Eq. (8): as derived from Eq. (7), as printed in the preprint, or with the next order; only with
        model creep_asymptotic. Default first_power.
    quantities : Literal["stick_slip", "creep", "high_frequency"]
        What the model is chosen for; only with model auto. Default stick_slip.
    accuracy : float
        Error against the full model that is allowed in these quantities [1]; >= 1.0e-12 and <= 1.0; only
        with model auto. Default 1.0e-3.
    t_end : float | None
        End of the simulated time [s]; > 0.0. No default.
    """

    group: ClassVar[str] = "scene"

    title: str = ""
    model: Literal["full", "low_frequency", "high_frequency", "creep", "creep_asymptotic", "auto"] = "full"
    form: Literal["first_power", "printed", "third_order"] = "first_power"
    quantities: Literal["stick_slip", "creep", "high_frequency"] = "stick_slip"
    accuracy: float = 0.001
    t_end: float | None = None


@dataclass(frozen=True, kw_only=True, repr=False)
class System(DeckGroup):
    """Group ``&system`` of a deck.

    Parameters
    ----------
    mass : float | None
        Mass of the object [kg]; > 0.0; only with model full | low_frequency | high_frequency | auto. No
        default.
    stiffness_x : float | None
        Stiffness along the soft principal axis [N/m]; > 0.0. No default.
    stiffness_y : float | None
        Stiffness along the stiff principal axis [N/m]; > 0.0; only with model full | high_frequency | creep
        | auto. No default.
    misalignment_deg : float | None
        Angle phi from the drive direction to the soft axis [deg]; >= -360.0 and <= 360.0. No default.
    """

    group: ClassVar[str] = "system"

    mass: float | None = None
    stiffness_x: float | None = None
    stiffness_y: float | None = None
    misalignment_deg: float | None = None


@dataclass(frozen=True, kw_only=True, repr=False)
class Friction(DeckGroup):
    """Group ``&friction`` of a deck.

    Parameters
    ----------
    law : Literal["constant", "weakening"]
        How friction depends on the slip velocity; only with model full | low_frequency | high_frequency |
        auto. Default weakening.
    mu_0 : float | None
        Friction coefficient at rest [1]; >= 0.0. No default.
    mu_inf : float | None
        Friction coefficient at high slip velocity [1]; >= 0.0; only with law weakening. No default.
    v_f : float | None
        Slip velocity over which friction weakens [m/s]; > 0.0; only with law weakening. No default.
    normal_load : float | None
        Normal load W [N]; >= 0.0. No default.
    contact : Literal["exact", "smoothed"]
        Exact: set-valued at rest, with events; smoothed: w/sqrt(abs(w)^2 + v_smooth^2); only with model full
        | auto. Default exact.
    v_smooth : float
        Smoothing velocity, to be far below V sin(phi) [m/s]; > 0.0; only with contact smoothed. Default 0.0.
    """

    group: ClassVar[str] = "friction"

    law: Literal["constant", "weakening"] = "weakening"
    mu_0: float | None = None
    mu_inf: float | None = None
    v_f: float | None = None
    normal_load: float | None = None
    contact: Literal["exact", "smoothed"] = "exact"
    v_smooth: float = 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class Drive(DeckGroup):
    """Group ``&drive`` of a deck.

    Parameters
    ----------
    velocity : float | Sequence[float] | None
        Drive velocity: one value, or one for each time; constant after the last [m/s]. No default.
    time : float | Sequence[float]
        Corners of a piecewise-linear velocity, from 0 on; a time given twice is a jump [s]; >= 0.0. Default
        0.0.
    """

    group: ClassVar[str] = "drive"

    velocity: float | Sequence[float] | None = None
    time: float | Sequence[float] = 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class Initial(DeckGroup):
    """Group ``&initial`` of a deck.

    Parameters
    ----------
    velocity_ratio : float
        Initial velocity along the drive over the drive velocity, X'(0)/V [1]; only with model full |
        low_frequency | high_frequency | auto. Default 0.0.
    elongation_x : float
        Initial elongation of the spring along the soft axis; high_frequency holds it [m]; only with model
        full | low_frequency | high_frequency | auto. Default 0.0.
    elongation_y : float
        Initial elongation of the spring along the stiff axis [m]; only with model full | high_frequency |
        auto. Default 0.0.
    """

    group: ClassVar[str] = "initial"

    velocity_ratio: float = 0.0
    elongation_x: float = 0.0
    elongation_y: float = 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class Integrator(DeckGroup):
    """Group ``&integrator`` of a deck.

    Parameters
    ----------
    method : Literal["radau5", "radau9", "radau13", "dopri5", "dop853", "rodas4p", "rk4", "moreau_jean"]
        Radau: implicit; dopri5, dop853, rk4: explicit; moreau_jean: nonsmooth; rodas4p: sweeps; only with
        model full | low_frequency | high_frequency | auto. Default radau9.
    rtol : float
        Relative tolerance of a step [1]; >= 1.0e-13 and <= 0.1; only with method radau5 | radau9 | radau13 |
        dopri5 | dop853 | rodas4p. Default 1.0e-8.
    step : float
        The fixed step [s]; > 0.0; only with method rk4 | moreau_jean. Default 0.0.
    v_cut : float
        Slip velocity below which a stop is finished in closed form; 0 = chosen from rtol and V [m/s]; >=
        0.0; only with method dopri5 | dop853 and contact exact. Default 0.0.
    step_max : float
        Longest step; 0 = no limit [s]; >= 0.0; only with method radau5 | radau9 | radau13 | dopri5 | dop853
        | rodas4p. Default 0.0.
    max_steps : int
        Most steps of a run; 0 = no limit [1]; >= 0; only with model full | low_frequency | high_frequency |
        auto. Default 0.
    """

    group: ClassVar[str] = "integrator"

    method: Literal["radau5", "radau9", "radau13", "dopri5", "dop853", "rodas4p", "rk4", "moreau_jean"] = (
        "radau9"
    )
    rtol: float = 1e-08
    step: float = 0.0
    v_cut: float = 0.0
    step_max: float = 0.0
    max_steps: int = 0


@dataclass(frozen=True, kw_only=True, repr=False)
class Output(DeckGroup):
    """Group ``&output`` of a deck.

    Parameters
    ----------
    file : str
        File of the results; empty = the deck's name with .h5, in the current directory.
    interval : float
        Time between samples; 0 = every accepted step [s]; >= 0.0. Default 1.0e-3.
    fields : str | Sequence[str]
        Columns of the time series; of default, u_x, u_y, w_x, w_y, X, Y, X_rate, Y_rate, spring_force_x,
        spring_force_y, friction, theta, psi, sticking, zeta. Default default.
    flush_seconds : float
        Wall time between flushes of the file [s]; >= 0.0. Default 5.0.
    checkpoint_interval : float
        Wall time between checkpoints; 0 = only when the run is stopped [s]; >= 0.0. Default 600.0.
    wall_limit : float
        Wall time after which the run stops; 0 = no limit [s]; >= 0.0. Default 0.0.
    """

    group: ClassVar[str] = "output"

    file: str = ""
    interval: float = 0.001
    fields: str | Sequence[str] = "default"
    flush_seconds: float = 5.0
    checkpoint_interval: float = 600.0
    wall_limit: float = 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class Sweep(DeckGroup):
    """Group ``&sweep`` of a deck.

    Parameters
    ----------
    parameter : str | Sequence[str] | None
        Keys that are varied, as GROUP.KEY; the last varies fastest.
    first : float | Sequence[float] | None
        First value of each parameter, in its own unit.
    last : float | Sequence[float] | None
        Last value of each parameter.
    count : float | Sequence[float] | None
        Number of values of each parameter [1]; >= 1.0 and <= 1.0e9.
    spacing : str | Sequence[str]
        Distance of the values: one for all parameters, or one for each; of linear, log. Default linear.
    points : str
        CSV or HDF5 file, a column for each GROUP.KEY and a case a row, in place of the above.
    keep : Literal["summary", "series"]
        What is kept of a case: its summary, or the time series too. Default summary.
    """

    group: ClassVar[str] = "sweep"

    parameter: str | Sequence[str] | None = None
    first: float | Sequence[float] | None = None
    last: float | Sequence[float] | None = None
    count: float | Sequence[float] | None = None
    spacing: str | Sequence[str] = "linear"
    points: str = ""
    keep: Literal["summary", "series"] = "summary"


GroupValues = Mapping[str, object]
"""Keys of one deck group and their values: numbers, strings, or sequences of them; None takes a key out."""


class Groups(TypedDict, total=False):
    """Keywords that stand for the groups of a deck: a dataclass replaces a group, a mapping changes keys of it."""

    scene: Setup | GroupValues
    system: System | GroupValues
    friction: Friction | GroupValues
    drive: Drive | GroupValues
    initial: Initial | GroupValues
    integrator: Integrator | GroupValues
    output: Output | GroupValues
    sweep: Sweep | GroupValues


G = TypeVar("G", bound=DeckGroup)


class SceneGroups:
    """The groups of a scene as attributes."""

    __slots__ = ()

    @abstractmethod
    def _group(self, kind: type[G]) -> G: ...

    @property
    def scene(self) -> Setup:
        """Group ``&scene``, with the defaults of what is not given."""
        return self._group(Setup)

    @property
    def system(self) -> System:
        """Group ``&system``, with the defaults of what is not given."""
        return self._group(System)

    @property
    def friction(self) -> Friction:
        """Group ``&friction``, with the defaults of what is not given."""
        return self._group(Friction)

    @property
    def drive(self) -> Drive:
        """Group ``&drive``, with the defaults of what is not given."""
        return self._group(Drive)

    @property
    def initial(self) -> Initial:
        """Group ``&initial``, with the defaults of what is not given."""
        return self._group(Initial)

    @property
    def integrator(self) -> Integrator:
        """Group ``&integrator``, with the defaults of what is not given."""
        return self._group(Integrator)

    @property
    def output(self) -> Output:
        """Group ``&output``, with the defaults of what is not given."""
        return self._group(Output)

    @property
    def sweep(self) -> Sweep:
        """Group ``&sweep``, with the defaults of what is not given."""
        return self._group(Sweep)
