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

MM_PER_INCH = 25.4


def test_command_draws_every_figure_and_lists_it(package: Program, tmp_path: Path) -> None:
    done = package("paper", "-o", "a/b", status=0, timeout=None)
    names = ["fig1", "fig2", "fig3", "fig4", "fig5", "creep", "constant", "phi10"]
    assert done.stdout.split() == [f"a/b/{name}.png" for name in names]
    assert {path.name for path in (tmp_path / "a" / "b").iterdir()} == {f"{name}.png" for name in names}
    progress = done.stderr.splitlines()
    assert progress[0] == "deck 1/4: fig3.nml"
    assert progress[-1].startswith("figure 8/8: phi10")
    assert len(progress) == 12


@pytest.mark.parametrize(("suffix", "head"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_other_formats(tmp_path: Path, suffix: str, head: bytes) -> None:
    (file,) = paper.draw_paper(tmp_path, suffix, names=["fig2"])
    assert file == tmp_path / f"fig2.{suffix}"
    assert file.read_bytes().startswith(head)


def test_installed_decks_are_those_of_inputs() -> None:
    for name in {deck for figure in paper.FIGURES.values() for deck in figure.decks}:
        assert paper.deck(name).text == (INPUTS / f"{name}.nml").read_text(encoding="utf-8")


def test_a_missing_deck_is_an_error() -> None:
    with pytest.raises(ds.FileError, match=r"none\.nml.*install"):
        paper.deck("none")


def test_refusals_are_one_line(package: Program, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    refused = {("paper",): 1, ("paper", "-o", "x", "--format", "gif"): 1, ("paper", "-o", "file"): 3}
    for arguments, status in refused.items():
        done = package(*arguments)
        assert (done.returncode, done.stdout) == (status, ""), arguments
        assert done.stderr.startswith("dynstiction: ")
        assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("draw", [draw_apparatus, draw_angles])
def test_schematics_fit_the_column(draw: object) -> None:
    figure: Figure = new_figure(draw)  # type: ignore[arg-type]
    assert figure.get_size_inches()[0] * MM_PER_INCH == pytest.approx(86.0)
    figure.draw_without_rendering()
    texts = [text for text in figure.axes[0].texts if text.get_text()]
    boxes = [text.get_window_extent() for text in texts]
    for text, box in zip(texts, boxes, strict=True):
        assert text.get_fontsize() >= 7.0
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= figure.bbox.x1
        assert box.y1 <= figure.bbox.y1
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:i]), texts[i].get_text()


def test_principal_axes_carry_the_drive() -> None:
    """V (cos phi, sin phi) in the principal axes is V along X, Eq. (1)."""
    phi = 0.3
    soft, stiff = principal_axes(phi)
    np.testing.assert_allclose(np.cos(phi) * soft + np.sin(phi) * stiff, [1.0, 0.0], atol=1e-15)


def test_coil_joins_its_ends() -> None:
    start, end = np.array([1.0, 2.0]), np.array([4.0, -2.0])
    points = coil(start, end, turns=5, width=0.1)
    np.testing.assert_allclose(points[[0, -1]], [start, end])
    span = (end - start) / 5.0
    away = np.abs((points - start) @ np.array([-span[1], span[0]]))
    assert away.max() == pytest.approx(0.1)
    assert np.all(np.isfinite(coil(start, start, turns=5, width=0.1)))
