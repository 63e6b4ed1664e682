"""Whatever columns a result has, against time: for files that hold too few for another kind."""

from __future__ import annotations

from matplotlib.figure import Figure

from ..errors import UsageError
from ..result import Result
from .samples import thin
from .style import BLACK, BLUE, COLUMN_WIDTH, GREEN, MM, ORANGE, PURPLE, SKY, VERMILION

__all__ = ["draw_series"]

PANEL_HEIGHT = 28.0 * MM
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, BLACK, ORANGE, SKY)


def draw_series(result: Result, figure: Figure) -> None:
    """Every column against time, one panel each."""
    names = [name for name in result if name != "time"]
    if not names:
        raise UsageError("nothing to draw: the result holds times only: run again with other output.fields")
    figure.set_size_inches(COLUMN_WIDTH, PANEL_HEIGHT * len(names) + 8.0 * MM)
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for i, (name, axis) in enumerate(zip(names, axes, strict=True)):
        axis.plot(*thin(result.time, result[name]), color=COLOURS[i % len(COLOURS)])
        units = result.columns.units[name]
        axis.set_ylabel(f"{name.replace('_', ' ')} [{'–' if units == '1' else units}]")
        axis.margins(y=0.12)
    axes[-1].set_xlim(result.time[0], result.time[-1])
    axes[-1].set_xlabel("$t$ [s]")
    figure.align_ylabels(axes)
