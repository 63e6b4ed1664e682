"""The parameters behind measured force traces (docs/fit.md)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arguments import generator, instance, names_in, number, shown, whole
from ._fit.models import NoCycleError, fastest_slip, slow_cycles, steady_velocity
from ._fit.problem import CHAIN, Problem, Recording, unit_of
from ._fit.search import ALSO, MISFIT, USUAL, Search
from ._fit.shooting import GAINED
from ._fit.solve import Solution
from ._fit.waveform import waveform_of, without_drift
from ._progress import progress_bar
from .errors import Error, FitWarning, UsageError
from .scene import DeckLike, Scene
from .trace import Chain, Trace
from .trace_comparison import TraceComparison, compare
from .trace_cycles import fine_enough

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_Floats = NDArray[np.float64]

TOLD = 0.5
"""Largest standard error of a logarithm at which a trace determines the parameter."""
HUGE = 300.0
"""Logarithm above which the end of an interval is infinite."""
BY_CHANCE, MEANS = 1e-3, 7
"""Probability with which one of the means over the cycles of a right deck is told to differ, and their number."""
TWO_SIDED = 1.96
"""Errors to each side that hold 95 %: of an interval that contains several fits, the standard error is as much smaller."""
SEEN = 0.3
"""Least share of a parameter in a direction, relative to the largest, for which it is named."""
LAW_STEP = 0.01
"""For other laws: changes of the exponent and of the viscous term over the weakening, for a derivative. Twice: the same to 2 %."""
LARGE_FRICTION = 2.0
"""Coefficient of friction above which there is a note."""
HANGING = 3.0
"""Change of a parameter by another law, in standard errors, above which there is a note."""
LINKED, WITH_THEM = 0.999, 0.99
"""Correlations of two parameters above which there is a note, and of a further one with those above which the note names it, too."""
RELATED, SURELY = 0.5, 3.5
"""Correlation of one cycle with the next above which they change slowly, and its least significance."""
BAR = "fit: {percentage:3.0f}%|{bar}| {elapsed}"


@dataclass(frozen=True)
class FittedParameter:
    """Value of a parameter from a trace, and its errors.

    Attributes
    ----------
    name : str
        ``group.key`` of the deck.
    value : float
        Best value; NaN if the trace does not determine it.
    error : float
        Standard error; infinite if the trace does not determine the parameter.
    unit : str
        Unit of the value.
    told : bool
        Whether the trace determines the parameter.
    law_error : float
        Standard error if friction need not fall exponentially: with an exponent of 1 to about 2, and a viscous term up to the
        weakening. NaN if the law is not 'weakening'.
    """

    name: str
    value: float
    error: float
    unit: str
    told: bool
    law_error: float


@dataclass(frozen=True, eq=False, repr=False)
class FittedTrace(Recording):
    """One trace of a fit.

    Attributes
    ----------
    trace, scene, chain, cycles, waveform
        The trace, its scene and measuring chain with the fitted values, its cycles, and their mean with its errors.
    given : Scene
        The scene with the values with which the fit began.
    fitted_rows : ndarray, shape (cycles, n + k)
        The `rows` of the waveform as the model explains each; one row if cycles repeat.
    period : float
        The model's period [s].
    """

    given: Scene
    fitted_rows: _Floats
    period: float

    @property
    def fitted(self) -> _Floats:
        """Mean force of the model in the bins of the waveform [N], shape (n,)."""
        return np.asarray(self.fitted_rows.mean(axis=0)[: self.waveform.time.size])

    @property
    def ahead(self) -> _Floats:
        """How far the object of the model is ahead of the drive in the creep [m], shape (k,); empty without a measured displacement."""
        return np.asarray(self.fitted_rows.mean(axis=0)[self.waveform.time.size :])

    @cached_property
    def comparison(self) -> TraceComparison:
        """A run with the fitted values beside the trace.

        Raises
        ------
        UsageError, SolverError
            As for `compare`.
        """
        return compare(self.scene, self.trace, chain=self.chain)


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Parameters behind one trace or several, and their errors. What is of a trace is of the first: `traces` has all.

    Attributes
    ----------
    parameters : dict of str to FittedParameter
        By ``group.key``.
    correlation : ndarray, shape (p, p)
        Correlation of the logarithms of the parameters, in their order.
    traces : tuple of FittedTrace
        What is fitted to each trace; ``fit.scene.to_deck()`` is a deck that runs. A parameter that the trace does not determine has one
        of the values that fit.
    model : str
        The model of the fitted values.
    misfit : float
        Mean square of the residuals over that expected from the scatter of the cycles: 1 if the model is right.
    chance : float
        Probability of such a misfit if the model is right.
    notes : tuple of str
        Cautions about the result; also given as `FitWarning`.
    sets : tuple of ndarray, shape (2, p)
        Logarithms of the parameters (of the tare: the tare over the swing) and their standard errors: of the best fit, and of others that
        explain the trace as well.
    problem : object
        What was fitted.
    coordinates : ndarray
        The fit in its coordinates.
    """

    parameters: Mapping[str, FittedParameter]
    correlation: _Floats
    traces: tuple[FittedTrace, ...]
    model: str
    misfit: float
    chance: float
    notes: tuple[str, ...]
    sets: tuple[_Floats, ...]
    problem: Problem
    coordinates: _Floats

    scene = property(lambda self: self.traces[0].scene, doc="The scene with the fitted values.")
    cycles = property(lambda self: self.traces[0].cycles, doc="The cycles of the trace.")
    waveform = property(lambda self: self.traces[0].waveform, doc="Mean of the cycles, and its errors.")
    fitted = property(
        lambda self: self.traces[0].fitted, doc="Force of the model in the bins of the waveform [N]."
    )
    ahead = property(lambda self: self.traces[0].ahead, doc="How far the object is ahead of the drive [m].")
    period = property(lambda self: self.traces[0].period, doc="The model's period [s].")

    @property
    def covariance(self) -> _Floats:
        """Covariance of the logarithms of the parameters, shape (p, p)."""
        return np.asarray(self.correlation * np.outer(self.sets[0][1], self.sets[0][1]))

    def residuals(self, values: Mapping[str, float] | Sequence[float]) -> _Floats:
        """Residuals over their errors at other values, for a sampler or another least squares.

        Parameters
        ----------
        values : mapping, or sequence of float
            Values of the free parameters, by name or in their order; those that a mapping lacks are as fitted.

        Returns
        -------
        ndarray, shape (r,)
            Of all bins of all traces and their periods: the logarithm of the likelihood is minus half of the sum of squares. 1e6 each
            where there is no stick-slip.
        """
        problem = self.problem
        p = len(problem.names)
        here = problem.named(self.coordinates)
        here |= dict(values) if isinstance(values, Mapping) else dict(zip(problem.names, values, strict=True))
        at = np.array([number(name, here[name]) for name in problem.names])
        return problem.residuals(np.append(problem.coordinates(at), self.coordinates[p:]), 0.0)

    @property
    def explains(self) -> bool:
        """Whether the model explains the trace, within the scatter of its cycles, and is the scene's own."""
        return self.chance >= MISFIT and self.is_of_own_model

    @property
    def is_of_own_model(self) -> bool:
        """Whether the model of the fitted values is the scene's own, and not the slow one that proposes starts."""
        return self.model == (self.scene.scene.model or "full")

    def __getitem__(self, name: str) -> float:
        """Value of a parameter, NaN if the trace does not determine it."""
        if name not in self.parameters:
            raise UsageError(
                f"{shown(name)}: is not free in this fit: the free parameters are {', '.join(self.parameters)}"
            )
        return self.parameters[name].value

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of a parameter, from Student's distribution for the cycles of the trace.

        Parameters
        ----------
        name : str
            ``group.key``.
        level : float
            Probability with which the interval contains the true value.

        Returns
        -------
        low, high : float
            Ends of the interval; 0 and infinity for a parameter that the trace does not determine.
        """
        from scipy.stats import t  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

        number("level", level, above=0.0, below=1.0)
        if not self.parameters[name].told:
            return 0.0, math.inf
        i = list(self.parameters).index(name)
        cycles = sum(len(each.waveform.rows) for each in self.traces)
        width = float(t.ppf(0.5 * (1.0 + level), cycles - 1))
        ends = [float(each[0][i] + side * width * each[1][i]) for each in self.sets for side in (-1.0, 1.0)]
        scale = self.problem.scales[i]
        if math.isfinite(scale):
            return min(ends) * scale, max(ends) * scale
        # Other values that explain the trace may leave this one open.
        sizes = [math.exp(end) if end < HUGE else math.inf for end in (min(ends), max(ends))]
        low, high = sorted(math.copysign(size, self[name]) for size in sizes)
        return low, high

    def plot(
        self, kind: str = "waveform", *, trace: int = 0, start: float | None = None, end: float | None = None
    ) -> Figure:
        """Figure of the fit.

        Parameters
        ----------
        kind : str
            ``waveform``: measured and that of the model, and the residuals; ``time``: the same over time; ``cycles``: residuals of each
            cycle, distributions of period and peak of the trace and of a run; ``corner``: the parameters two by two, with their errors.
        trace : int
            Number of the trace, from 0.
        start, end : float, optional
            Times that ``time`` shows [s]; by default the first cycles.

        Returns
        -------
        Figure
            A matplotlib figure.
        """
        from .plot.traces import fit_figure  # noqa: PLC0415  (slow to import)

        return fit_figure(self, kind, trace, start, end)

    def report(self) -> str:
        """The fit as one HTML page, with all figures; it needs neither network nor other files."""
        from .report import fit_report  # noqa: PLC0415  (slow to import)

        return fit_report(self)

    def __repr__(self) -> str:
        return "\n  ".join([f"<Fit: {len(self.waveform.cycles)} cycles, {self.model}", *self._lines()]) + ">"

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        width = max(map(len, self.parameters))
        for each in self.parameters.values():
            if each.told:
                low, high = self.interval(each.name)
                yield (
                    f"{each.name:{width}}  {each.value:.6g} ± {each.error:.2g} {each.unit}   "
                    f"95 %: {low:.6g} to {high:.6g}".replace(" 1 ", " ")
                )
            else:
                yield f"{each.name:{width}}  not determined by this trace"
        names = list(self.parameters)
        pairs = [(self.correlation[i, j], names[i], names[j]) for i in range(len(names)) for j in range(i)]
        for value, one, other in sorted(pairs, key=lambda pair: (abs(pair[0]), *pair[1:]), reverse=True)[:3]:
            yield f"correlation of {one} and {other}: {value:.3f}"
        yield f"misfit over scatter {self.misfit:.2f}, by chance with probability {self.chance:.2g}"
        yield from (f"note: {note}" for note in self.notes)


def fit(
    scene: DeckLike,
    trace: Trace | Sequence[Trace],
    free: Sequence[str] | str,
    *,
    each: Mapping[str, Sequence[float]] | None = None,
    known: Mapping[str, tuple[float, float]] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    ties: Mapping[str, tuple[str, float]] | None = None,
    chain: Chain | None = None,
    starts: int = 2,
    rng: int | np.random.Generator | None = 0,
    progress: bool | None = None,
) -> Fit:
    """Find the parameters of a scene from one trace or from several.

    The mean waveform of a trace's cycles and their period are fitted; if the cycles are not alike, each cycle by itself, by the nearest
    one of a long run. The model is that of the scene, and it passes the same measuring chain and the same sampling as the trace. The slow
    model only proposes starts.

    Parameters
    ----------
    scene : str, PathLike or Scene
        The rig: its known parameters, and initial values of the free ones. The drive velocity must be constant.
    trace : Trace, or sequence of Trace
        Force along the pull, from `read_trace`; a displacement in it is fitted, too.
    free : sequence of str, or str
        Parameters to be found, ``group.key`` of &system and &friction, ``drive.velocity``, and ``chain.tare``, ``chain.filter``,
        ``chain.gain``; in a string they are separated by commas. All traces share them.
    each : mapping of str to sequence of float, optional
        Values that differ from trace to trace, ``{"drive.velocity": (1e-3, 5e-3)}``.
    known : mapping of str to (float, float), optional
        Values of free parameters that are known from elsewhere, with their standard errors.
    bounds : mapping of str to (float, float), optional
        Least and largest values of free parameters.
    ties : mapping of str to (str, float), optional
        Keys that are a multiple of a free parameter, ``{"friction.mu_inf": ("friction.mu_0", 0.75)}``.
    chain : Chain, optional
        The measuring chain; by default it changes nothing.
    starts : int
        Number of the slow model's starts that are completed: the best among the scene's values, several rough estimates from the
        waveform, and random changes of both.
    rng : int or numpy.random.Generator, optional
        Source of the random starts: the same seed gives the same bits, None other starts each time.
    progress : bool, optional
        Whether to show a bar; by default on a terminal, after a second.

    Returns
    -------
    Fit
        Values, standard errors, correlations, notes and the fitted scene.

    Raises
    ------
    UsageError
        If a parameter cannot be free, or has no initial value in the scene, or no start has stick-slip.
    FileError
        If a trace has no stick-slip to fit, see `find_cycles`.
    DeckError
        If the scene is refused.

    Warns
    -----
    FitWarning
        If the model does not explain the trace, or the trace does not determine a parameter.

    Notes
    -----
    Logarithms are fitted, so that values keep their sign. Standard errors follow from the scatter of the cycles, by the effect of
    each single cycle on the fit. They are valid for noise that is correlated within a cycle, and for cycles of which each resembles the
    next, but do not include an error that all cycles share.
    """
    whole("starts", starts, least=1)
    with progress_bar(progress, 1.0, BAR) as show:
        given = problem_of(
            Scene(scene), trace, free, each=each, known=known, bounds=bounds, ties=ties, chain=chain
        )
        search = Search(given, starts, generator(rng), show)
        search.run()
        show(1.0)
        if search.found:
            try:
                return _told(search.problem, search.found, search.problem, search.slow or given)
            except NoCycleError as error:
                # Each cycle is explained, but a run does not come to them.
                search.faults.append(error)
        if search.slow is None or search.proposal is None:
            raise UsageError(
                f"{given.recordings[0].scene.name}: no stick-slip near any start: begin with values of {', '.join(given.names)} with which "
                "'dynstiction cycles' finds a stable cycle"
            )
        why = search.faults[-1] if search.faults else "the slow model's has none"
        note = f"the model {given.model} has no stick-slip near these values ({why}): they are those of low_frequency"
        best = search.slow.improved(search.proposal, (0.0,))
        return _told(search.slow, [best], given, search.slow, note)


def _told(
    problem: Problem, found: Sequence[Solution], own: Problem, slow: Problem, *notes_before: str
) -> Fit:
    """A fit of a problem, whose scenes are those of the own model."""
    names, p, notes = problem.names, len(problem.names), list(notes_before)
    best = min(found, key=lambda each: each.cost)
    misfit, chance = problem.misfit(best.z, best.left)
    covariance, inverse, related = problem.covariance(best)
    covariance *= max(1.0, misfit)
    z = problem.logarithms(best.z[:p])
    broad, error = np.sqrt(np.diag(inverse))[:p], np.sqrt(np.diag(covariance))[:p]
    # Where the trace has no information, the inverse is that of the prior, and the scatter does not show this.
    told = np.maximum(broad, error) < TOLD
    notes += _flat(names, inverse[:p, :p], told)
    notes += _linked(names, inverse[:p, :p], told)
    law_error = _law_errors(problem, slow, best)
    notes += _hanging_on_the_law(names, z, error, law_error, told)
    if chance < MISFIT:
        notes.append(
            f"the model does not explain the trace: its misfit is {misfit:.2g} times what the scatter of the cycles explains: "
            "another friction law, a parameter that is fixed at a wrong value, or a rig that differs from the scene; the "
            "errors include the misfit, but the values may be wrong by more"
        )
    values = problem.named(best.z)
    if abs(values.get("friction.mu_0", 0.0)) > LARGE_FRICTION:
        notes.append("friction.mu_0 is very large: are the unit of the force and friction.normal_load right?")
    for name, ends in problem.bounds.items():
        if values[name] in ends:
            notes.append(f"{name} is at its bound {values[name]:.6g}: the other values are those with it")
    fewest = min(len(each.waveform.rows) for each in problem.recordings)
    if related > max(RELATED, SURELY / math.sqrt(fewest)) and problem.recordings[0].waveform.repeats:
        notes.append(
            f"the cycles change slowly (correlation of one with the next {related:.2f}): the load, the speed or the zero of the force is not "
            "constant; the errors allow for it, but the values may be wrong by more"
        )
    # The rest of each cycle is sought until little is to be gained: no nearer are costs known where each has its own.
    excess = (
        ALSO * max(1.0, misfit)
        if problem.repeats
        else GAINED * sum(len(r.waveform.rows) for r in problem.recordings)
    )
    others = [
        each
        for each in found
        if each is not best and (each.cost - best.cost < excess or _explains(problem, each))
    ]
    sets = [_logarithms(problem, each, misfit) for each in others]
    sets = [each for each in sets if np.any(np.abs(each[0] - z) > error)]
    if any(np.any((np.abs(each[0] - z) > error)[told]) for each in sets):
        notes.append("other values explain the trace as well: the intervals contain them")
    for record in problem.recordings:
        notes += record.cycles.notes
    for note in notes:
        warnings.warn(note, FitWarning, stacklevel=3)
    middles, errors = np.moveaxis(np.array([[z, error], *sets]), 1, 0)
    reach = TWO_SIDED * errors
    whole_error = np.ptp([middles - reach, middles + reach], axis=(0, 1)) / (2.0 * TWO_SIDED)
    scales = np.where(np.isfinite(problem.scales), problem.scales, np.abs(list(values.values())))
    parameters = {
        name: FittedParameter(
            name,
            values[name] if told[i] else math.nan,
            float(scales[i] * whole_error[i]) if told[i] else math.inf,
            unit_of(name),
            bool(told[i]),
            float(scales[i] * law_error[i]),
        )
        for i, name in enumerate(names)
    }
    fitted = []
    for k, (record, given) in enumerate(zip(problem.recordings, own.recordings, strict=True)):
        cycles = problem.cycles(best.z, k)
        here = replace(own.at_values(given, best.z[:p]), waveform=record.waveform)
        fitted.append(
            FittedTrace(
                **vars(here),
                given=given.scene,
                fitted_rows=record.explained(cycles),
                period=cycles.period,
            )
        )
    begun = problem.logarithms(problem.coordinates(problem.begin))
    logarithms = np.array([np.where(told, z, begun), error])
    scale = np.sqrt(np.diag(inverse))[:p]
    return Fit(
        parameters,
        inverse[:p, :p] / np.outer(scale, scale),
        tuple(fitted),
        problem.model,
        misfit,
        chance,
        tuple(notes),
        (logarithms, *sets),
        problem,
        best.z,
    )


def _explains(problem: Problem, found: Solution) -> bool:
    """Whether a fit to cycles that are alike explains the traces: where the cost is rugged no search is sure of the least one."""
    return problem.repeats and found.left is not None and problem.misfit(found.z, found.left)[1] >= USUAL


def _logarithms(problem: Problem, found: Solution, misfit: float) -> _Floats:
    """Logarithms of the parameters and their standard errors, shape (2, p)."""
    p = len(problem.names)
    spread = problem.covariance(found)[0] * max(1.0, misfit)
    return np.array([problem.logarithms(found.z[:p]), np.sqrt(np.diag(spread))[:p]])


def _law_errors(problem: Problem, slow: Problem, found: Solution) -> _Floats:
    """Standard errors of the parameters if two coordinates of other laws, which are known to about 1, are added, shape (p,): the weighted
    effects of another exponent, and of a viscous term as large as the weakening in the fastest slip. NaN if the law is no exponential.
    """
    p, z = len(slow.names), found.z
    effects: list[_Floats] = []
    try:
        for k, record in enumerate(slow.recordings):
            here = slow.at_values(record, z[:p]).scene
            friction, wave = here.friction, record.waveform
            if friction.law not in (None, "weakening"):
                return np.full(p, math.nan)
            drop = float(friction.mu_0 or 0.0) - float(friction.mu_inf or 0.0)
            viscous = drop / fastest_slip(here, wave)
            laws = ({"exponent": 1.0 + LAW_STEP}, {"viscous": LAW_STEP * viscous})
            scenes = [here, *(here.replace(friction={"law": "stribeck", **law}) for law in laws)]
            delay = float(z[p + k]) * wave.fall
            before, *after = (slow_cycles(each, wave, delay, record.chain, False) for each in scenes)
            effect = []
            for there in after:
                change = (there.rows - before.rows)[0] * wave.weights(0.0)
                if not wave.repeats:
                    change = np.tile(change / math.sqrt(len(wave.rows)), len(wave.rows))
                effect.append(np.append(change, (there.period - before.period) / record.period_error(0.0)))
            effects.append(np.column_stack(effect) / LAW_STEP)
    except Error:
        return np.full(p, math.nan)
    jacobian = found.jacobian.copy()
    jacobian[:, :p] = np.linalg.solve(problem.slopes(z[:p]).T, jacobian[:, :p].T).T
    extended = np.column_stack([jacobian, np.vstack([*effects, np.zeros((len(slow.known), 2))])])
    prior = np.append(problem.priors**-2, np.ones(2))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(extended.T @ extended + np.diag(prior))))[:p])


def _hanging_on_the_law(
    names: Sequence[str], z: _Floats, error: _Floats, law_error: _Floats, told: NDArray[np.bool_]
) -> Iterator[str]:
    far = told & (law_error > HANGING * error)
    hanging = [i for i, name in enumerate(names) if far[i] and name not in CHAIN]
    if hanging:
        each = ", ".join(f"{names[i]} ± {math.exp(z[i]) * law_error[i]:.2g}" for i in hanging)
        yield (
            f"{each} if friction need not fall exponentially (another exponent, a viscous term): the trace depends on friction "
            "at the speeds of its slips only, and laws that agree there fit equally well"
        )


def _flat(names: Sequence[str], inverse: NDArray[Any], told: NDArray[np.bool_]) -> Iterator[str]:
    """Notes on the parameters that the trace does not determine."""
    sizes, directions = np.linalg.eigh(inverse)
    for column in directions.T[(sizes >= TOLD**2) & ~told.all()]:
        direction = column / column[np.argmax(np.abs(column))]
        seen = {name: power for name, power in zip(names, direction, strict=True) if abs(power) > SEEN}
        if len(seen) == 1:
            yield f"the trace does not determine {next(iter(seen))}: fix it at a known value"
        else:
            powers = " ".join(f"{name}^{power:.2g}" for name, power in seen.items())
            yield (
                f"the trace does not distinguish {', '.join(seen)}: a common factor {powers} changes "
                "nothing that is measured: fix one of them at a known value"
            )


def _linked(names: Sequence[str], inverse: NDArray[Any], told: NDArray[np.bool_]) -> Iterator[str]:
    """A note on parameters of which a trace shows little more than a product: speed, stiffness and mass, for example."""
    scale = np.sqrt(np.diag(inverse))
    related = np.abs(inverse / np.outer(scale, scale)) * np.outer(told, told)
    np.fill_diagonal(related, 0.0)
    close = np.any(related > LINKED, axis=0)
    for _ in names:
        close |= np.any(related[:, close] > WITH_THEM, axis=1)
    linked = [name for name, is_close in zip(names, close, strict=True) if is_close]
    if linked:
        yield (
            f"the trace hardly distinguishes {', '.join(linked)}: a common change of them changes next to nothing that is measured: fix "
            "one of them, if it is known"
        )


_Given: TypeAlias = Mapping[str, Any]
"""What an option says of each key."""


def problem_of(
    scene: Scene,
    trace: Trace | Sequence[Trace],
    free: Sequence[str] | str,
    *,
    each: _Given | None = None,
    known: _Given | None = None,
    bounds: _Given | None = None,
    ties: _Given | None = None,
    chain: Chain | None = None,
) -> Problem:
    """The problem of a fit; arguments and errors are those of `fit`."""
    each, known, bounds, ties = (dict(given or {}) for given in (each, known, bounds, ties))
    names = names_in("free", free)
    traces = [
        instance("trace", one, Trace, "give what read_trace, Trace or Trace.of returns")
        for one in (trace if isinstance(trace, Sequence) else [trace])
    ]
    scene.check()
    _check_model(scene)
    chain = instance("chain", chain or Chain(), Chain, "give a dynstiction.Chain")
    if not any(names):
        raise UsageError(
            "free: name the parameters to be found, like 'system.misalignment_deg,friction.mu_0'"
        )
    if not traces:
        raise UsageError("trace: give at least one trace")
    for name in names:
        if names.count(name) > 1:
            raise UsageError(f"free: {name} is named twice")
    begin = np.array([_begin(scene, chain, name) for name in names])
    _check_options(names, len(traces), each, known, bounds, ties)
    recordings = []
    for k, one in enumerate(traces):
        rig = scene.replace(**cast(Any, {name: float(own[k]) for name, own in each.items()}))
        velocity = steady_velocity(rig)
        if velocity == 0.0:
            raise UsageError(
                f"{scene.name}: drive.velocity is 0 or changes: a fit needs a constant velocity that is not 0"
            )
        if one.displacement is not None and "drive.velocity" in names:
            raise UsageError(
                "free: drive.velocity cannot be free with a displacement, which contains it: leave one of them out"
            )
        fine, cycles = fine_enough(one)
        if "chain.tare" in names:
            fine = without_drift(fine, cycles.slips)
        recordings.append(Recording(rig, chain, fine, cycles, waveform_of(fine, cycles, abs(velocity))))
    return Problem(names, begin, known, bounds, ties, tuple(recordings))


def _check_model(scene: Scene) -> None:
    """Refuse a scene without exact derivatives."""
    model = scene.scene.model or "full"
    if model not in ("full", "low_frequency"):
        raise UsageError(
            f"{scene.name}: scene.model = '{model}': only 'full' and 'low_frequency' can be fitted"
        )
    if model == "full" and scene.friction.contact == "smoothed":
        raise UsageError(
            f"{scene.name}: contact = 'smoothed': a fit needs exact derivatives: give a deck with contact 'exact'"
        )


def _check_options(
    names: Sequence[str], traces: int, each: _Given, known: _Given, bounds: _Given, ties: _Given
) -> None:
    """Refuse what does not fit to the free parameters and the number of traces."""
    for name, own in each.items():
        _check_key("each", name)
        if name in names:
            raise UsageError(f"each: {name} is free: a parameter is found, or its values are known")
        if len(own) != traces:
            raise UsageError(
                f"each: {name} has {len(own)} values, and there are {traces} traces: give one for each"
            )
    for option, given in (("known", known), ("bounds", bounds)):
        for name in given:
            if name not in names:
                raise UsageError(f"{option}: {name} is not free: a fixed value stands in the deck")
    for name, (_, error) in known.items():
        number(f"the error of {name}", error, above=0.0)
    for name, (low, high) in bounds.items():
        if not low < high:
            raise UsageError(f"bounds: {name}: {low:g} is not below {high:g}: give the least value first")
    for name, (other, factor) in ties.items():
        _check_key("ties", name)
        if name in names or other not in names:
            raise UsageError(
                f"ties: {name} is a multiple of {other}: the first must not be free, the second must be"
            )
        number(f"the factor of {name}", factor)


def _check_key(what: str, name: str) -> None:
    """Refuse what is no number of the rig or its drive."""
    group, _, key = name.partition(".")
    if name == "drive.velocity":
        return
    if group not in ("system", "friction") or (group, key) not in {
        (o.group, o.name) for o in _native.schema()
    }:
        raise UsageError(
            f"{what}: {shown(name)}: only keys of &system and &friction, like system.misalignment_deg, drive.velocity, and "
            f"{', '.join(CHAIN)} can be found"
        )
    if _native.key_info(group, key).kind != "real":
        raise UsageError(f"{what}: {name} is not a real number: choose one of its values for each fit")


def _begin(scene: Scene, chain: Chain, name: str) -> float:
    """Value of a parameter with which a fit begins."""
    group, _, key = name.partition(".")
    if name in CHAIN:
        value = getattr(chain, key)
        if value is None:
            raise UsageError(f"free: {name} has no value: give one to begin with, chain=Chain({key}=...)")
        return float(value)
    _check_key("free", name)
    value = steady_velocity(scene) if name == "drive.velocity" else scene.groups().get(group, {}).get(key)
    if not isinstance(value, float) or value == 0.0:
        raise UsageError(
            f"free: {name} has no value but 0 in {scene.name}: give one to begin with, also a rough one"
        )
    return value


def verdict(found: Fit) -> tuple[bool, str]:
    """Whether a fit explains its traces, and what runs of the fitted decks and of the given ones say of that.

    Parameters
    ----------
    found : Fit
        The fit.

    Returns
    -------
    explains : bool
        Whether its misfit is that of the scatter, its model the scene's own, and no mean over the cycles differs by more than
        happens by chance once in a thousand fits.
    words : str
        One line for each deck.
    """
    from scipy.stats import norm  # noqa: PLC0415  (slow to import)

    lines: list[str] = []
    agree = {"fitted": True, "given": True}
    # Of many means one is far off by chance.
    limit = float(norm.isf(0.5 * BY_CHANCE / (MEANS * len(found.traces))))
    for each in found.traces:
        of = f" of {each.trace.name}" if len(found.traces) > 1 else ""
        for name, one in (("fitted", each), ("given", replace(each, scene=each.given))):
            try:
                deviations = one.comparison.statistics["deviation"]
            except Error as error:
                agree[name] = False
                lines.append(f"the run of the {name} deck cannot be compared with the trace{of}: {error}")
                continue
            off = [f"{which} by {by:.1f}" for which, by in deviations.items() if abs(by) > limit]
            agree[name] &= not off
            differs = f"differs from the trace{of}: {', '.join(off)} standard errors"
            lines.append(f"the run of the {name} deck {differs if off else f'agrees with the trace{of}'}")
    explains = found.explains and agree["fitted"]
    first = f"the fit {'explains' if explains else 'does NOT explain'} the trace"
    if not explains:
        first += ": do not use its values" + "; the given deck agrees with it" * agree["given"]
    return explains, "\n".join([first, *lines])
