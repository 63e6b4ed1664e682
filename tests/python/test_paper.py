"""`python -m dynstiction paper`: every figure of the paper, from the decks that are installed with the package."""

from __future__ import annotations

from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from dynstiction.plot import paper
from dynstiction.plot.schematics import coil, draw_angles, draw_apparatus, principal_axes
from dynstiction.plot.style import new_figure
from matplotlib.figure import Figure
from programs import INPUTS, Program


def test_command_draws_every_figure_and_lists_it(package: Program, tmp_path: Path) -> None:
    done = package("paper", "-o", "a/b", status=0, timeout=None)
    names = ["fig1", "fig2", "fig3", "fig4", "fig5", "creep", "constant", "phi10"]
    assert done.stdout.split() == [f"a/b/{name}.png" for name in names]
    assert {path.name for path in (tmp_path / "a" / "b").iterdir()} == {f"{name}.png" for name in names}
    assert len(done.stderr.splitlines()) == 4 + 8, "a line for each deck and figure"
    for suffix, head in (("pdf", b"%PDF"), ("svg", b"<?xml")):
        (file,) = paper.draw_paper(tmp_path, suffix, names=["fig2"])
        assert file == tmp_path / f"fig2.{suffix}"
        assert file.read_bytes().startswith(head)


def test_installed_decks_are_those_of_inputs() -> None:
    for name in {deck for figure in paper.FIGURES.values() for deck in figure.decks}:
        assert paper.deck(name).text == (INPUTS / f"{name}.nml").read_text(encoding="utf-8")
    with pytest.raises(ds.FileError, match=r"none\.nml.*install"):
        paper.deck("none")


@pytest.mark.parametrize("draw", [draw_apparatus, draw_angles])
def test_schematics_fit_the_column(draw: object) -> None:
    figure: Figure = new_figure(draw)  # type: ignore[arg-type]
    assert figure.get_size_inches()[0] * 25.4 == pytest.approx(86.0)
    figure.draw_without_rendering()
    texts = [text for text in figure.axes[0].texts if text.get_text()]
    boxes = [text.get_window_extent() for text in texts]
    for text, box in zip(texts, boxes, strict=True):
        assert text.get_fontsize() >= 7.0
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:i]), texts[i].get_text()


def test_springs_of_the_schematics_lie_on_the_axes() -> None:
    """V (cos phi, sin phi) in the principal axes is V along X, Eq. (1); a coil joins its ends."""
    phi = 0.3
    soft, stiff = principal_axes(phi)
    np.testing.assert_allclose(np.cos(phi) * soft + np.sin(phi) * stiff, [1.0, 0.0], atol=1e-15)
    start, end = np.array([1.0, 2.0]), np.array([4.0, -2.0])
    points = coil(start, end, turns=5, width=0.1)
    np.testing.assert_allclose(points[[0, -1]], [start, end])
    span = (end - start) / 5.0
    away = np.abs((points - start) @ np.array([-span[1], span[0]]))
    assert away.max() == pytest.approx(0.1)
    assert np.all(np.isfinite(coil(start, start, turns=5, width=0.1)))
