"""A measured trace and a scene: the cycles of both from the same code, with their scatter (docs/howto/measured_traces.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import NDArray

from ._arguments import instance
from ._fit.waveform import bin_means, waveform_of, whole_cycles
from ._run import run_sampled
from .errors import FileError, UsageError, printable
from .groups import Changes
from .html import page_table
from .record import headed
from .scene import DeckLike, Scene
from .simulation import Simulation
from .trace import Chain, Trace
from .trace_cycles import TraceCycles, find_cycles, fine_enough

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped]
    from matplotlib.figure import Figure


FEWEST, MOST = 12, 60
"""Number of cycles of a run that are compared: the least, and the largest unless the trace has more."""
FACTOR = 2
"""Cycles of the run for each cycle of the trace: so many that the run adds little to the uncertainty."""
SETTLED, LONGEST = 1e-6, 100.0
"""The period of a run is known when two cycles agree to this, or after so many measured periods, if `t_end` of the deck is not later."""
BEGINNING = 4.0
"""Periods of a run before the cycles that are counted."""
OTHER_UNIT = 100.0
"""Ratio of the periods of trace and run above which one of them is in another unit."""
MOST_SAMPLES = 2_500_000
"""Largest number of samples of the cycles of a run that are compared."""
DIFFERENT = 3.0
"""Standard errors above which two means differ."""
SURE = 1e-6
"""Least standard error, relative to the value: roundoff of runs and files."""
FIELDS = ("spring_force_x", "spring_force_y", "pull_force", "X")
"""Columns of a run that a trace needs."""
COLUMNS = {
    "measured": ("measured", "{:.5g}"),
    "measured_scatter": ("scatter", "{:.2g}"),
    "measured_error": ("error", "{:.2g}"),
    "simulated": ("simulated", "{:.5g}"),
    "simulated_scatter": ("scatter", "{:.2g}"),
    "simulated_error": ("error", "{:.2g}"),
    "difference": ("difference", "{:+.2g}"),
    "deviation": ("in errors", "{:+.1f}"),
}
"""Columns of the table: their heads, and how values are written."""
SEED = 20201209
"""Seed of the noise that a run gets, so that a comparison gives the same result each time."""


@dataclass(frozen=True, repr=False, eq=False)
class TraceComparison:
    """A trace and a run, side by side.

    Attributes
    ----------
    trace : Trace
        The measured trace.
    run : Trace
        The settled part of the run, sampled like the trace and with similar noise.
    scene : Scene
        The scene of the run.
    measured, simulated : TraceCycles
        Their cycles.
    statistics : pandas.DataFrame
        A row for each column of the cycles: ``units``; mean over the cycles, standard deviation from cycle to cycle and standard error
        of the mean of both, ``measured``, ``measured_scatter``, ``measured_error``, ``simulated``, ...; ``difference``, simulated minus
        measured, and ``deviation``, the difference over the standard error of both together. NaN where one is not known.
    edges : ndarray, shape (n + 1,)
        Edges of the bins over a cycle, time since the slip [s].
    waveforms : tuple of ndarray, shape (cycles, n)
        Mean force of each cycle in these bins [N], of the trace and of the run.
    """

    trace: Trace
    run: Trace
    scene: Scene
    measured: TraceCycles
    simulated: TraceCycles
    statistics: pandas.DataFrame
    edges: NDArray[np.float64]
    waveforms: tuple[NDArray[np.float64], NDArray[np.float64]]

    def __getitem__(self, name: str) -> pandas.Series:
        """A row of the statistics."""
        if name not in self.statistics.index:
            raise UsageError(f"no statistic {name!r}, only {', '.join(self.statistics.index)}")
        return self.statistics.loc[name]

    @property
    def waveform_rms(self) -> float:
        """Root mean square of the difference of both mean waveforms over a cycle, relative to the measured swing."""
        measured, simulated = (rows.mean(axis=0) for rows in self.waveforms)
        square = np.average((simulated - measured) ** 2, weights=np.diff(self.edges))
        return float(np.sqrt(square) / self["swing"].measured)

    @property
    def differing(self) -> tuple[str, ...]:
        """Names of the statistics whose means are more than three standard errors apart."""
        return tuple(self.statistics.index[self.statistics["deviation"].abs() > DIFFERENT])

    def report(self) -> str:
        """The table as text, with the notes."""
        units = f"; {self.trace.units}" if self.trace.units else ""
        told = ", ".join(self.differing)
        lines = [
            f"{self.trace.name}: {len(self.measured)} cycles, noise {self.measured.noise:.3g} N a sample{units}",
            f"{self.scene.name}: {len(self.simulated)} cycles of a settled run with the same noise",
            "",
            *self._table().to_string().splitlines(),
            "",
            f"waveforms differ by {self.waveform_rms:.3g} of the swing (root mean square over a cycle)",
            f"{'differ' if told else 'nothing differs'} by more than {DIFFERENT:g} standard errors{told and f': {told}'}",
            *(f"{self.trace.name}: {note}" for note in self.measured.notes),
            *(f"{self.scene.name}: {note}" for note in self.simulated.notes),
        ]
        return "\n".join(map(printable, lines)) + "\n"

    def plot(self) -> Figure:
        """Figure: mean waveforms over a cycle and around the slip, and their difference in standard errors.

        Returns
        -------
        matplotlib.figure.Figure
            Not attached to any window.
        """
        from .plot.style import new_figure  # noqa: PLC0415
        from .plot.traces import draw_trace_comparison  # noqa: PLC0415  (matplotlib is slow to import)

        return new_figure(lambda figure: draw_trace_comparison(self, figure))

    def __repr__(self) -> str:
        return f"<TraceComparison\n{self.report()}>"

    def _repr_html_(self) -> str:
        shown = self._table()
        return page_table(
            f"{self.trace.name} and {self.scene.name}", ["", *shown.columns], [*shown.itertuples(name=None)]
        )

    def _table(self) -> pandas.DataFrame:
        """The statistics as texts."""
        import pandas  # noqa: PLC0415  (slow to import)

        columns = (
            self.statistics[name].astype(object).map(form.format, na_action="ignore").fillna("–").rename(head)
            for name, (head, form) in COLUMNS.items()
        )
        shown = pandas.concat(columns, axis=1)
        return shown.set_axis([headed(name, units) for name, units in self.statistics["units"].items()])


def compare(
    deck: DeckLike,
    trace: Trace,
    *,
    chain: Chain | None = None,
    noise: bool = True,
    **changes: Unpack[Changes],
) -> TraceComparison:
    """Compare a scene with a measured trace.

    The scene is run until it has twice as many cycles as the trace, after as many cycles that do not count. Its force along the
    pull is sampled like the trace and gets similar white noise. So every statistic comes from the same code under the same
    conditions.

    Parameters
    ----------
    deck : str, PathLike or Scene
        Path of a deck, text of a deck, or a scene.
    trace : Trace
        The measured trace, from `read_trace` or `Trace`.
    chain : Chain, optional
        The measuring chain that the run passes; by default it changes nothing.
    noise : bool
        Whether the run gets noise like that of the trace.
    **changes : value of a key, or Setup, System, Friction, Drive, Initial, Integrator, Output, or mapping
        Overrides of the deck, as for `dynstiction.run`.

    Returns
    -------
    TraceComparison
        Statistics of both with scatter and standard errors, and aligned mean waveforms; `TraceComparison.plot` draws them.

    Raises
    ------
    DeckError, SolverError
        As for `dynstiction.run`.
    FileError
        If the trace is not usable (`find_cycles`).
    UsageError
        If the scene has no stick-slip to compare, or `trace` is not a trace.
    """
    scene = Scene(deck, **changes)
    trace = instance("trace", trace, Trace, "give what read_trace or Trace returns").regular()
    chain = instance("chain", chain or Chain(), Chain, "give a dynstiction.Chain")
    trace, measured = fine_enough(trace)
    run = chain(simulate_like(scene, trace, measured))
    if noise:
        run = run.with_noise(measured.noise, SEED)
    simulated = _cycles_of_run(scene, run)
    wave = waveform_of(replace(trace, displacement=None), measured, 0.0)
    slips = whole_cycles(run, simulated.slips, wave.edges)[:, np.newaxis]
    waveforms = wave.rows, bin_means(run.time, run.force, wave.edges + slips)
    statistics = _statistics(measured, simulated)
    return TraceComparison(trace, run, scene, measured, simulated, statistics, wave.edges, waveforms)


def _without_cycles(scene: Scene, reason: str) -> UsageError:
    return UsageError(
        f"{scene.name}: its run has no cycles to compare with the trace: {reason}: change the deck; dynstiction stability shows where it "
        "has stick-slip"
    )


def _cycles_of_run(scene: Scene, run: Trace) -> TraceCycles:
    try:
        return find_cycles(run)
    except FileError as error:
        # Without the advice that applies to traces.
        raise _without_cycles(scene, str(error).partition(": ")[2].rpartition(": ")[0]) from None


def _statistics(measured: TraceCycles, simulated: TraceCycles) -> pandas.DataFrame:
    import pandas  # noqa: PLC0415  (slow to import)

    table = pandas.DataFrame({"units": measured.means().units})
    for side, cycles in (("measured", measured), ("simulated", simulated)):
        for what, values in (
            ("", cycles.means()),
            ("_scatter", cycles.scatter()),
            ("_error", cycles.errors()),
        ):
            table[f"{side}{what}"] = pandas.Series(dict(values))
    table["difference"] = table["simulated"] - table["measured"]
    sure = SURE * table[["measured", "simulated"]].abs().max(axis=1)
    error = (table["measured_error"] ** 2 + table["simulated_error"] ** 2 + sure**2) ** 0.5
    table["deviation"] = (table["difference"] / error).where(error != 0.0, 0.0)
    return table


def simulate_like(scene: Scene, trace: Trace, cycles: TraceCycles) -> Trace:
    """The force of a settled run of a scene, sampled like a trace, without noise, from somewhat before the first slip.

    With a constant drive velocity the run has four times as many cycles as the trace, at least 24 and at most 120 unless the trace has
    more, whatever the deck's `t_end` is, and the later half is returned. With another drive the run ends at `t_end`, and the later half
    of its cycles is returned.

    Raises
    ------
    DeckError, SolverError
        As for `dynstiction.run`.
    UsageError
        If the run has no stick-slip, or too few cycles, or its period is not of the size of the trace's.
    """
    n, measured = len(cycles), cycles.means()["period"]
    wanted = max(FEWEST, min(FACTOR * n, MOST), n)
    with Simulation(scene) as asked:
        end = asked.t_end
    if np.unique(scene.groups().get("drive", {}).get("velocity", 0.0)).size == 1:
        longest = max(end, LONGEST * measured)
        quick = {"interval": longest, "fields": ["u_x"], "wall_limit": None}
        summary = run_sampled(
            scene, progress=False, scene={"settle": SETTLED, "t_end": longest}, output=quick
        ).summary
        period = summary.get("period", np.nan)
        if not 1.0 / OTHER_UNIT < period / measured < OTHER_UNIT:
            told = "no period" if np.isnan(period) else f"a period of {period:.3g} s"
            raise _without_cycles(
                scene,
                f"it has {told}, and the trace one of {measured:.3g} s (is the unit of its time right?)",
            )
        wanted = min(wanted, max(FEWEST, int(MOST_SAMPLES * trace.interval / period)))
        end = (2.0 * wanted + BEGINNING) * period
    output = {"interval": trace.interval, "fields": FIELDS, "wall_limit": None}
    run = Trace.of(
        run_sampled(scene, progress=False, scene={"settle": None, "t_end": end}, output=output),
        trace.interval,
    )
    found = _cycles_of_run(scene, run)
    # The last slips of the later half, and a part before the first of them.
    kept = min(wanted, max(len(found) // 2, 3))
    first = found.slips.size - 1 - kept
    start = run.time[0] if first <= 0 else 0.5 * (found.slips[first - 1] + found.slips[first])
    return replace(run.part(float(start)), name=scene.name)
