"""Every figure of the paper, from the decks that come with the package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from .._output import check_outputs, make_folder
from .._run import run
from ..errors import FileError
from ..result import Result
from ..scene import Scene
from . import KINDS
from .damping import draw_damping_of
from .schematics import draw_angles, draw_apparatus
from .style import new_figure, write
from .view import view_of


class PaperFigure(NamedTuple):
    """A figure: what it shows, the decks whose results it needs, and how it is drawn."""

    title: str
    decks: tuple[str, ...]
    draw: Callable[[Sequence[Result], Figure], None]


FIG4_WINDOW = 0.1
"""Length of the Hamming window of Fig. 4 [s]."""


def _of_kind(title: str, name: str, kind: str, **how: float) -> PaperFigure:
    return PaperFigure(
        title, (name,), lambda results, figure: KINDS[kind].draw(view_of(results[0]), figure, **how)
    )


FIGURES: dict[str, PaperFigure] = {
    "fig1": PaperFigure("the model", (), lambda _, figure: draw_apparatus(figure)),
    "fig2": PaperFigure("its angles", (), lambda _, figure: draw_angles(figure)),
    "fig3": _of_kind("creep and stick-slip", "fig3", "history"),
    "fig4": _of_kind("oscillation of the first creep", "fig4", "spectrogram", length=FIG4_WINDOW),
    "fig5": PaperFigure("damping diagram", ("fig3", "phi10"), draw_damping_of),
    "creep": _of_kind("creep and its closed form", "fig3_constant", "creep"),
    "constant": _of_kind("constant friction: no stick-slip", "fig3_constant", "history"),
    "phi10": _of_kind("misalignment of 10 degrees: no stick-slip", "phi10", "history"),
}
"""Figures by the name of their file."""


def deck(name: str) -> Scene:
    """A deck of ``inputs/`` that was installed with the package; a `FileError` is raised if it is missing."""
    file = resources.files("dynstiction") / "inputs" / f"{name}.nml"
    try:
        return Scene(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"{file}: {error.strerror or error}: install the package again") from error


def draw_paper(
    folder: Path,
    suffix: str = "png",
    names: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
    *,
    overwrite: bool = True,
) -> list[Path]:
    """Run the decks and draw the figures into a folder, which is created if it does not exist.

    Parameters
    ----------
    folder : Path
        Folder of the files.
    suffix : {'png', 'pdf', 'svg'}
        The format.
    names : sequence of str
        Names of the figures in `FIGURES`; by default all.
    progress : callable
        Function that gets a line of text at the begin of each step.
    overwrite : bool
        Whether figures of an earlier call may be replaced.

    Returns
    -------
    list of Path
        The files, in the order of `FIGURES`.

    Raises
    ------
    FileError
        If a file cannot be written.
    """
    wanted = {name: FIGURES[name] for name in names or FIGURES}
    make_folder(folder)
    files = [folder / f"{name}.{suffix}" for name in wanted]
    check_outputs(files, overwrite=overwrite)
    needed = list(dict.fromkeys(name for figure in wanted.values() for name in figure.decks))
    results = {}
    for i, name in enumerate(needed, 1):
        progress(f"deck {i}/{len(needed)}: {name}.nml")
        results[name] = run(deck(name))
    for i, (name, figure) in enumerate(wanted.items(), 1):
        progress(f"figure {i}/{len(wanted)}: {name}, {figure.title}")
        picture = new_figure(partial(figure.draw, [results[name] for name in figure.decks]))
        write(picture, files[i - 1], overwrite=overwrite)
    return files
