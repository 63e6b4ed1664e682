"""The parameters behind a measured force trace (docs/fit.md)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arguments import generator, instance, names_in, number, shown, whole
from ._fit.models import NoCycleError, fastest_slip, full_means, slow_means, slow_scene, steady_velocity
from ._fit.solve import PRIOR, Model, Solution, best_start, least_squares_of, residuals, unfitted, weights_of
from ._fit.starts import glances
from ._fit.waveform import Waveform, waveform_of
from ._progress import progress_bar
from .errors import Error, FitWarning, UsageError
from .scene import DeckLike, Scene
from .trace import Trace
from .trace_comparison import compare
from .trace_cycles import TraceCycles, find_cycles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Fit", "FittedParameter", "fit", "verdict"]

_Floats = NDArray[np.float64]

TOLD = 0.5
"""Largest standard error of a logarithm at which a trace determines the parameter."""
SEEN = 0.3
"""Least share of a parameter in a direction, relative to the largest, for which it is named."""
COARSE = (0.02, 0.005, 0.001)
"""Errors relative to swing and period that are added, one fit after another."""
COARSE_OF_OWN = (0.05, 0.02, 0.005, 0.001, 0.0)
"""The same for fits of the scene's own model by itself."""
NEAR = 100.0
"""Misfit below which a fit begins with the errors of the trace."""
CORRECTIONS = 6
"""Largest number of times that the difference between the full model and the slow one is computed."""
CORRECTED = 0.1
"""Change of a parameter, in standard errors, below which this ends."""
MISFIT = 1e-4
"""Probability of such a misfit by chance, below which there is a note."""
BROAD_STEP, OWN_STEP = 0.02, 5e-3
"""Changes of a logarithm for a derivative of the full model, whose runs are sampled."""
RANDOM_STARTS = 6
WEAKENING = ("friction.mu_0", "friction.mu_inf", "friction.v_f")
LAW_STEP = 0.01
"""For other laws: changes of the exponent and of the viscous term over the weakening, for a derivative. Twice: the same to 2 %."""
LARGE_FRICTION = 2.0
"""Coefficient of friction above which there is a note."""
HANGING = 3.0
"""Change of a parameter by another law, in standard errors, above which there is a note."""
LEAST_DROP = 1e-3
"""Least weakening at the start of a fit, as a share of mu_0."""
SPREAD = 0.7
"""Largest change of a logarithm in a random start."""
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
class Fit:
    """Parameters behind a trace, and their errors.

    Attributes
    ----------
    parameters : dict of str to FittedParameter
        By ``group.key``.
    correlation : ndarray, shape (p, p)
        Correlation of the logarithms of the parameters, in their order.
    scene : Scene
        The scene with the fitted values: ``fit.scene.to_deck()`` is a deck that runs. A parameter that the trace does not
        determine has one of the values that fit.
    model : str
        The model of the fitted values.
    misfit : float
        Mean square of the residuals over that expected from the scatter of the cycles: 1 if the model is right.
    chance : float
        Probability of such a misfit if the model is right.
    cycles : TraceCycles
        The cycles of the trace.
    waveform : Waveform
        Mean of the cycles, and its errors.
    fitted : ndarray, shape (n,)
        Force of the model in the bins of the waveform [N].
    ahead : ndarray, shape (k,)
        How far the object of the model is ahead of the drive in the creep [m], as in the waveform; empty without a measured displacement.
    period : float
        The model's period [s].
    notes : tuple of str
        Cautions about the result; also given as `FitWarning`.
    evaluations : int
        Number of model runs.
    logarithms : ndarray, shape (2, p)
        Logarithms of the parameters, and their standard errors.
    """

    parameters: Mapping[str, FittedParameter]
    correlation: _Floats
    scene: Scene
    model: str
    misfit: float
    chance: float
    cycles: TraceCycles
    waveform: Waveform
    fitted: _Floats
    ahead: _Floats
    period: float
    notes: tuple[str, ...]
    evaluations: int
    logarithms: _Floats

    @property
    def explains(self) -> bool:
        """Whether the model explains the trace, within the scatter of its cycles, and is the scene's own."""
        return self.chance >= MISFIT and self.model == (self.scene.scene.model or "full")

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
        width = float(t.ppf(0.5 * (1.0 + level), len(self.waveform.cycles) - 1)) * float(
            self.logarithms[1][i]
        )
        ends = sorted(
            math.copysign(math.exp(self.logarithms[0][i] + side * width), self[name]) for side in (-1.0, 1.0)
        )
        return ends[0], ends[1]

    def plot(self) -> Figure:
        """Measured waveform and that of the model, and the residuals.

        Returns
        -------
        Figure
            A matplotlib figure.
        """
        from .plot.trace_fit import fit_figure  # noqa: PLC0415  (slow to import)

        return fit_figure(self)

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
        pairs = [
            (abs(self.correlation[i, j]), names[i], names[j], self.correlation[i, j])
            for i in range(len(names))
            for j in range(i)
        ]
        for _, one, other, value in sorted(pairs, reverse=True)[:3]:
            yield f"correlation of {one} and {other}: {value:.3f}"
        yield f"misfit over scatter {self.misfit:.2f}, by chance with probability {self.chance:.2g}"
        yield from (f"note: {note}" for note in self.notes)


def fit(
    scene: DeckLike,
    trace: Trace,
    free: Sequence[str] | str,
    *,
    starts: int = 2,
    rng: int | np.random.Generator | None = 0,
    progress: bool | None = None,
) -> Fit:
    """Find the parameters of a scene from a trace.

    The mean waveform of the trace's cycles and their period are fitted, first with the slow model, which takes a millisecond for
    each run. Then the difference between the scene's own model and the slow one is added, and the fit is repeated until neither
    changes.

    Parameters
    ----------
    scene : str, PathLike or Scene
        The rig: its known parameters, and initial values of the free ones. The drive velocity must be constant.
    trace : Trace
        Force along the pull, from `read_trace`; a displacement in it is fitted, too.
    free : sequence of str, or str
        Parameters to be found, ``group.key``; in a string they are separated by commas.
    starts : int
        Number of starts from which the fit is completed: the best among the scene's values, several rough estimates from the
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
        If the trace has no stick-slip to fit, see `find_cycles`.
    DeckError
        If the scene is refused.

    Warns
    -----
    FitWarning
        If the model does not explain the trace, or the trace does not determine a parameter.

    Notes
    -----
    Logarithms are fitted, so that values keep their sign. Standard errors follow from the scatter of the cycles, by the effect of
    each single cycle on the fit. They are valid for noise that is correlated within a cycle, but do not include an error that all
    cycles share.
    """
    trace = instance("trace", trace, Trace, "give what read_trace, Trace or Trace.of returns")
    whole("starts", starts, least=1)
    problem = _problem(Scene(scene), trace, free)
    with progress_bar(progress, 1.0, BAR) as show:
        return problem.solve(starts, generator(rng), show)


@dataclass(frozen=True, eq=False)
class _Problem:
    scene: Scene
    names: tuple[str, ...]
    begin: _Floats
    """Values in the scene."""
    cycles: TraceCycles
    wave: Waveform

    @property
    def weakening(self) -> tuple[int, int, int] | None:
        """Indices of mu_0, mu_inf and v_f, if all three are free."""
        if not set(WEAKENING) <= set(self.names):
            return None
        i, j, k = (self.names.index(name) for name in WEAKENING)
        return i, j, k

    def logarithms(self, q: _Floats) -> _Floats:
        """Logarithms of the parameters from the coordinates of the fit, in which mu_inf is replaced by ln((mu_0 - mu_inf)/v_f).

        Creep depends on the slope of friction only, which hardly distinguishes mu_inf from v_f: in these coordinates the valley of
        good fits is straight.
        """
        z = q.copy()
        if self.weakening:
            i, j, k = self.weakening
            limit = math.exp(q[i]) - math.exp(q[j] + q[k])
            if limit <= 0.0:
                raise NoCycleError("mu_inf would be negative")
            z[j] = math.log(limit)
        return z

    def coordinates(self, z: _Floats) -> _Floats:
        """The coordinates for which `logarithms` returns z."""
        q = z.copy()
        if self.weakening:
            i, j, k = self.weakening
            q[j] = math.log(max(math.exp(z[i]) - math.exp(z[j]), LEAST_DROP * math.exp(z[i]))) - z[k]
        return q

    def slopes(self, q: _Floats) -> _Floats:
        """Derivatives of `logarithms`, shape (p, p)."""
        slopes = np.eye(q.size)
        if self.weakening:
            i, j, k = self.weakening
            top, drop = math.exp(q[i]), math.exp(q[j] + q[k])
            slopes[j, [i, j, k]] = np.array([top, -drop, -drop]) / (top - drop)
        return slopes

    def with_values(self, scene: Scene, q: _Floats, names: Sequence[str]) -> Scene:
        groups: dict[str, dict[str, float]] = {}
        for name, value, old in zip(self.names, np.exp(self.logarithms(q)), self.begin, strict=True):
            group, _, key = name.partition(".")
            if name in names:
                groups.setdefault(group, {})[key] = math.copysign(float(value), old)
        return scene.replace(**groups)

    def solve(self, starts: int, random: np.random.Generator, say: Callable[[float], None]) -> Fit:
        slow = slow_scene(self.scene)
        heard = tuple(name for name in self.names if _given(slow, name))

        def slowly(z: _Floats, delay: float) -> _Floats:
            return slow_means(self.with_values(slow, z, heard), self.wave, delay)

        def fully(z: _Floats, delay: float) -> _Floats:
            return full_means(self.with_values(self.scene, z, self.names), self.wave, delay)

        model = str(self.scene.scene.model or "full")
        own = None if model == "low_frequency" else fully
        mute = [i for i, name in enumerate(self.names) if name not in heard]
        found = self._first(slowly, own, starts, random, say)
        notes: list[str] = []
        offset: _Floats | float = 0.0
        count = found.evaluations
        fitted, why = slowly, None
        if own is not None:
            try:
                found, offset, extra = self._corrected(slowly, own, found, mute)
                count += extra
            except NoCycleError as error:
                why = error
            values = self._values(slowly, found) + offset
            if why or self._misfit(values)[1] < MISFIT:
                alone = self._alone(own, found, say)
                count += alone.evaluations if alone else 0
                if alone and (why or alone.cost < self._cost(values)):
                    found, offset, fitted, why = alone, 0.0, own, None
            if why:
                notes.append(
                    f"the model {model} has no stick-slip that repeats at these values ({why}): they are those of low_frequency"
                )
                model = "low_frequency"
        say(1.0)
        return self._told(fitted, found, offset, model, notes, count, self._of_other_laws(slow, heard, found))

    def _values(self, model: Model, found: Solution) -> _Floats:
        return model(found.z[:-1], float(found.z[-1]) * self.wave.fall)

    def _cost(self, values: _Floats) -> float:
        measured = np.append(self.wave.rows.mean(axis=0), self.wave.period)
        return float(np.sum(((values - measured) * weights_of(self.wave, 0.0)) ** 2))

    def _alone(self, own: Model, found: Solution, say: Callable[[float], None]) -> Solution | None:
        """The best fit of the scene's own model with its own derivatives, from the scene's values and from those of the slow model: where
        k_y/k_x is small, that one leads astray.
        """
        given = unfitted(self.coordinates(np.log(np.abs(self.begin))))
        best: Solution | None = None
        count = 0
        for start in (given, found):
            one = start
            try:
                is_near = self._misfit(self._values(own, start))[0] < NEAR
                for i, coarse in enumerate(COARSE_OF_OWN[-1:] if is_near else COARSE_OF_OWN):
                    say(0.8 + 0.02 * i)
                    one = least_squares_of(
                        own, self.wave, one.z[:-1], coarse=coarse, delay=float(one.z[-1]), step=OWN_STEP
                    )
                    count += one.evaluations
            except NoCycleError:
                continue
            if best is None or one.cost < best.cost:
                best = one
            if self._misfit(self._values(own, one))[1] >= MISFIT:
                break
        return None if best is None else Solution(best.z, best.cost, best.jacobian, count)

    def _misfit(self, values: _Floats) -> tuple[float, float]:
        """Mean square of the residuals over that expected from the scatter of the cycles, and the probability of such a misfit."""
        from scipy.stats import f  # noqa: PLC0415  (slow to import)

        wave, p = self.wave, len(self.names)
        n = len(wave.cycles)
        weights = weights_of(wave, 0.0)[:-1]
        residual = (wave.rows.mean(axis=0) - values[:-1]) * weights
        explained = float(np.sum((wave.rows.var(axis=0, ddof=1) / n + wave.model_error**2) * weights**2))
        used = int(np.count_nonzero(wave.counts))
        misfit = float(residual @ residual) / explained * used / max(used - p - 1, 1)
        return misfit, float(f.sf(misfit, max(used - p - 1, 1), used * (n - 1)))

    def _of_other_laws(self, slow: Scene, heard: Sequence[str], found: Solution) -> _Floats | None:
        """Effect of another exponent, and of a viscous term as large as the weakening in the fastest slip: shape (n + 1, 2)."""
        if slow.friction.law not in (None, "weakening"):
            return None
        here = self.with_values(slow, found.z[:-1], heard)
        friction = here.friction
        drop = float(friction.mu_0 or 0.0) - float(friction.mu_inf or 0.0)
        delay = float(found.z[-1]) * self.wave.fall
        try:
            before = slow_means(here, self.wave, delay)
            viscous = drop / fastest_slip(here, self.wave)
            columns = [
                (slow_means(here.replace(friction={"law": "stribeck", **law}), self.wave, delay) - before)
                / LAW_STEP
                for law in ({"exponent": 1.0 + LAW_STEP}, {"viscous": LAW_STEP * viscous})
            ]
        except NoCycleError:
            return None
        return np.column_stack(columns)

    def _first(
        self,
        slowly: Model,
        own: Model | None,
        starts: int,
        random: np.random.Generator,
        say: Callable[[float], None],
    ) -> Solution:
        """The best of several fits with errors that shrink to those of the trace; each fit computes the difference again."""
        given = self.coordinates(np.log(np.abs(self.begin)))
        near = [given, *self._glances(np.log(np.abs(self.begin)))]
        near += [
            near[int(random.integers(len(near)))] + random.uniform(-SPREAD, SPREAD, given.size)
            for _ in range(RANDOM_STARTS)
        ]
        best: Solution | None = None
        count = len(near)
        for i, start in enumerate(best_start(slowly, self.wave, near, starts)):
            say(0.1 + 0.7 * i / starts)
            try:
                found = unfitted(start)
                for coarse in COARSE:
                    offset = 0.0 if math.isinf(found.cost) else self._difference(slowly, own, found)
                    found = self._fit(slowly, found, offset, coarse)
                    count += found.evaluations + 2
            except NoCycleError:
                continue
            if best is None or found.cost < best.cost:
                best = found
        if best is None:
            raise UsageError(
                f"{self.scene.name}: no stick-slip near any start: begin with values of {', '.join(self.names)} with which "
                "'dynstiction cycles' finds a stable cycle"
            )
        return Solution(best.z, best.cost, best.jacobian, count)

    def _fit(self, slowly: Model, found: Solution, offset: _Floats | float, coarse: float) -> Solution:
        return least_squares_of(
            slowly, self.wave, found.z[:-1], coarse=coarse, offset=offset, delay=float(found.z[-1])
        )

    def _difference(self, slowly: Model, own: Model | None, found: Solution) -> _Floats | float:
        """The scene's own model minus the slow one; 0 if the own model has no stick-slip there."""
        if own is None:
            return 0.0
        delay = float(found.z[-1]) * self.wave.fall
        try:
            return own(found.z[:-1], delay) - slowly(found.z[:-1], delay)
        except Error:
            return 0.0

    def _glances(self, own: _Floats) -> Iterator[_Floats]:
        normal_load = self.scene.friction.normal_load or 1.0
        for values in glances(self.wave, steady_velocity(self.scene), normal_load):
            start = own.copy()
            for i, name in enumerate(self.names):
                if name in values:
                    start[i] = math.log(values[name])
            yield self.coordinates(start)

    def _corrected(
        self, slowly: Model, fully: Model, found: Solution, mute: Sequence[int]
    ) -> tuple[Solution, _Floats, int]:
        """The fit of the full model with the derivatives of the slow one, except for parameters that the slow one does not have."""
        wave = self.wave
        count = 0
        for _ in range(CORRECTIONS):
            z, delay = found.z[:-1], float(found.z[-1]) * wave.fall
            here = fully(z, delay)
            offset = here - slowly(z, delay)
            new = self._fit(slowly, found, offset, 0.0)
            jacobian = new.jacobian.copy()
            weights = weights_of(wave, 0.0)
            for i in mute:
                there = z.copy()
                there[i] += BROAD_STEP
                jacobian[:, i] = (fully(there, delay) - here) / BROAD_STEP * weights
            count += new.evaluations + 2 + len(mute)
            change = new.z - found.z
            if mute:
                # A step of all parameters, with the columns that the slow model lacks.
                at = residuals(slowly, wave, weights, offset)(new.z)
                change_of_all = -np.linalg.solve(_normal(jacobian), jacobian.T @ at)
                new = Solution(new.z + np.clip(change_of_all, -0.5, 0.5), new.cost, jacobian, 0)
                change = new.z - found.z
            else:
                new = Solution(new.z, new.cost, jacobian, 0)
            found = new
            error = np.sqrt(np.diag(np.linalg.inv(_normal(jacobian))))
            if np.all(np.abs(change[:-1]) < CORRECTED * error[:-1]):
                break
        return found, offset, count

    def _told(
        self,
        model_of: Model,
        found: Solution,
        offset: _Floats | float,
        model: str,
        notes: list[str],
        count: int,
        other_laws: _Floats | None,
    ) -> Fit:
        wave = self.wave
        z, jacobian = found.z.copy(), found.jacobian.copy()
        values = self._values(model_of, found) + offset
        scene = self.with_values(self.scene, z[:-1], self.names)
        # From the coordinates to the logarithms.
        jacobian[:, :-1] = np.linalg.solve(self.slopes(z[:-1]).T, jacobian[:, :-1].T).T
        z[:-1] = self.logarithms(z[:-1])
        p = len(self.names)
        weights = weights_of(wave, 0.0)
        inverse = np.linalg.inv(_normal(jacobian))
        mean = wave.rows.mean(axis=0)
        influence = (wave.rows - mean) * weights[:-1] @ jacobian[:-1] @ inverse
        n = len(wave.cycles)
        covariance = influence.T @ influence / (n * (n - 1.0)) + np.outer(
            inverse @ jacobian[-1], inverse @ jacobian[-1]
        )
        misfit, chance = self._misfit(values)
        covariance *= max(1.0, misfit)
        # Where the trace has no information, the inverse is that of the prior, and the scatter does not show this.
        broad = np.sqrt(np.diag(inverse))[:-1]
        error = np.sqrt(np.diag(covariance))[:-1]
        told = np.maximum(broad, error) < TOLD
        notes += self._flat(inverse[:-1, :-1], told)
        law_error = np.full(p, math.nan)
        if other_laws is not None:
            law_error = _law_errors(jacobian, other_laws * weights[:, np.newaxis])[:p]
            notes += self._hanging_on_the_law(z, error, law_error, told)
        if chance < MISFIT:
            notes.append(
                f"the model does not explain the trace: its misfit is {misfit:.2g} times what the scatter of the cycles explains: "
                "another friction law, a parameter that is fixed at a wrong value, or a rig that differs from the scene; the "
                "errors include the misfit, but the values may be wrong by more"
            )
        if "friction.mu_0" in self.names and math.exp(z[self.names.index("friction.mu_0")]) > LARGE_FRICTION:
            notes.append(
                "friction.mu_0 is very large: are the unit of the force and friction.normal_load right?"
            )
        notes += self.cycles.notes
        for note in notes:
            warnings.warn(note, FitWarning, stacklevel=4)
        logarithms = np.where(told, z[:-1], np.log(np.abs(self.begin)))
        parameters = {
            name: FittedParameter(
                name,
                math.copysign(math.exp(z[i]), self.begin[i]) if told[i] else math.nan,
                math.exp(z[i]) * float(error[i]) if told[i] else math.inf,
                _unit(name),
                bool(told[i]),
                math.exp(z[i]) * float(law_error[i]),
            )
            for i, name in enumerate(self.names)
        }
        scale = np.sqrt(np.diag(inverse))[:-1]
        return Fit(
            parameters,
            inverse[:-1, :-1] / np.outer(scale, scale),
            scene,
            model,
            misfit,
            chance,
            self.cycles,
            wave,
            *np.split(values[:-1], [wave.error.size]),
            float(values[-1]),
            tuple(notes),
            count,
            np.array([logarithms, error]),
        )

    def _hanging_on_the_law(
        self, z: _Floats, error: _Floats, law_error: _Floats, told: NDArray[np.bool_]
    ) -> Iterator[str]:
        hanging = [i for i in range(len(self.names)) if told[i] and law_error[i] > HANGING * error[i]]
        if hanging:
            each = ", ".join(f"{self.names[i]} ± {math.exp(z[i]) * law_error[i]:.2g}" for i in hanging)
            yield (
                f"{each} if friction need not fall exponentially (another exponent, a viscous term): the trace depends on friction "
                "at the speeds of its slips only, and laws that agree there fit equally well"
            )

    def _flat(self, inverse: NDArray[Any], told: NDArray[np.bool_]) -> Iterator[str]:
        """Notes on the parameters that the trace does not determine."""
        if told.all():
            return
        sizes, directions = np.linalg.eigh(inverse)
        for size, column in zip(sizes, directions.T, strict=True):
            if size < TOLD**2:
                continue
            direction = column / column[np.argmax(np.abs(column))]
            seen = [
                (name, power) for name, power in zip(self.names, direction, strict=True) if abs(power) > SEEN
            ]
            if len(seen) == 1:
                yield f"the trace does not determine {seen[0][0]}: fix it at a known value"
            else:
                powers = " ".join(f"{name}^{power:.2g}" for name, power in seen)
                yield (
                    f"the trace does not distinguish {', '.join(name for name, _ in seen)}: a common factor {powers} changes "
                    "nothing that is measured: fix one of them at a known value"
                )


def verdict(found: Fit, given: Scene, trace: Trace) -> tuple[bool, str]:
    """Whether a fit explains its trace, and what runs of the fitted deck and of the given one say of that.

    Parameters
    ----------
    found : Fit
        The fit.
    given : Scene
        The scene with which it began.
    trace : Trace
        Its trace.

    Returns
    -------
    explains : bool
        Whether its misfit is that of the scatter, its model the scene's own, and no mean over the cycles differs by more than three
        errors.
    words : str
        One line for each deck.
    """
    lines, agree = [], []
    for name, scene in (("fitted", found.scene), ("given", given)):
        try:
            differing = [each for each in compare(scene, trace).statistics if each.differs]
        except Error as error:
            agree.append(False)
            lines.append(f"the run of the {name} deck cannot be compared with the trace: {error}")
            continue
        agree.append(not differing)
        each = ", ".join(f"{one.name} by {one.deviation:.1f}" for one in differing)
        lines.append(
            f"the run of the {name} deck "
            + (f"differs from the trace: {each} standard errors" if differing else "agrees with the trace")
        )
    explains = found.explains and agree[0]
    first = (
        "the fit explains the trace"
        if explains
        else "the fit does NOT explain the trace: do not use its values"
    )
    if not explains and agree[1]:
        first += "; the given deck agrees with it"
    return explains, "\n".join([first, *lines])


def _law_errors(jacobian: _Floats, other_laws: _Floats) -> _Floats:
    """Standard errors of the parameters if the coordinates of other laws, which are known to about 1, are added."""
    extended = np.column_stack([jacobian, other_laws])
    prior = np.append(np.full(jacobian.shape[1], PRIOR**-2), np.ones(other_laws.shape[1]))
    errors: _Floats = np.sqrt(np.diag(np.linalg.inv(extended.T @ extended + np.diag(prior))))
    return errors


def _normal(jacobian: _Floats) -> _Floats:
    """Normal matrix, with the prior that each parameter is known to a factor of ten."""
    prior = np.append(np.full(jacobian.shape[1] - 1, PRIOR**-2), PRIOR**-2)
    matrix: _Floats = jacobian.T @ jacobian + np.diag(prior)
    return matrix


def _problem(scene: Scene, trace: Trace, free: Sequence[str] | str) -> _Problem:
    names = names_in("free", free)
    scene.check()
    if not names or names == ("",):
        raise UsageError(
            "free: name the parameters to be found, like 'system.misalignment_deg,friction.mu_0'"
        )
    values = scene.groups()
    for i, name in enumerate(names):
        group, _, key = name.partition(".")
        if name in names[:i]:
            raise UsageError(f"free: {name} is named twice")
        if group not in ("system", "friction") or key not in {
            each.name for each in _native.schema() if each.group == group
        }:
            raise UsageError(
                f"free: {shown(name)}: only keys of &system and &friction can be found, like system.misalignment_deg"
            )
        if _native.key_info(group, key).kind != "real":
            raise UsageError(f"free: {name} is not a real number: choose one of its values for each fit")
        value = values.get(group, {}).get(key)
        if not isinstance(value, float) or value == 0.0:
            raise UsageError(
                f"free: {name} has no value but 0 in {scene.name}: give one to begin with, also a rough one"
            )
    if steady_velocity(scene) == 0.0:
        raise UsageError(
            f"{scene.name}: drive.velocity is 0 or changes: a fit needs a constant velocity that is not 0"
        )
    cycles = find_cycles(trace)
    begin = np.array(
        [values[name.partition(".")[0]][name.partition(".")[2]] for name in names], dtype=np.float64
    )
    return _Problem(scene, names, begin, cycles, waveform_of(trace, cycles, abs(steady_velocity(scene))))


def _given(scene: Scene, name: str) -> bool:
    group, _, key = name.partition(".")
    return key in scene.groups().get(group, {})


def _unit(name: str) -> str:
    group, _, key = name.partition(".")
    return _native.key_info(group, key).units
