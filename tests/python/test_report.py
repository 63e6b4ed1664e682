"""The HTML page of a run: complete and self-contained."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import dynstiction as ds
import numpy as np
import pytest
from dynstiction.__main__ import main
from dynstiction.report import report
from matplotlib import image


@pytest.fixture(scope="module")
def page(fig3_result: ds.Result) -> str:
    return report(fig3_result, "fig3.h5")


class Reader(HTMLParser):
    """Texts, and every attribute that can make a browser load something."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.links: list[str] = []
        self.open: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "img", "input", "link"):
            self.open.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_the_page_holds_what_the_file_holds(page: str, fig3_result: ds.Result) -> None:
    reader = Reader(page)
    assert reader.open == []
    texts = {text.strip() for text in reader.texts}
    for values in (fig3_result.summary, fig3_result.statistics, fig3_result.parameters):
        for info, value in values.info():
            assert info.name in texts
            assert info.long_name in texts
            assert (f"{value:.6g}" if isinstance(value, float) else str(value)) in texts
    assert {str(value) for value in fig3_result.attributes.values()} <= texts
    assert {"m/s", "N/m", "Fig. 3, Nakano & Popov (2020)", "fig3.h5", "complete"} <= texts
    assert fig3_result.deck.strip() in texts
    assert "0.915064" in texts, "a period of the table of cycles"
    spread = fig3_result.summary.get("period_scatter", ds.stick_slip_statistics(fig3_result).scatter()["period"])
    assert f"{spread:.2g}" in texts


def test_the_page_loads_nothing_and_its_figures_are_those_of_plot(page: str) -> None:
    links = Reader(page).links
    assert all(link.startswith("data:image/png;base64,") for link in links)
    assert not re.search(r"https?:|//[a-z]|@import|url\(", re.sub(r"base64,[^\"]*", "", page))
    assert "Content-Security-Policy" in page
    kinds = re.findall(r'<img alt="(\w+): \w', page)
    assert kinds == ["history", "velocities", "spectrogram", "damping", "creep", "path"]
    for link in links:
        pixels = image.imread(io.BytesIO(base64.b64decode(link.partition(",")[2])))
        assert pixels.shape[1] > 700
        assert np.ptp(pixels) > 0.5


def test_what_was_set_is_listed(page: str, fig3: ds.Scene) -> None:
    """The keys of the deck, and what was set beside it; of a long profile the first values."""

    def section(page: str) -> str:
        return page[page.index("What was set") : page.index("<h2>Summary")]

    keys = re.findall(r"<tr><td[^>]*>([a-z]+\.\w+)</td>", section(page))
    assert keys == [f"{group}.{key}" for group, values in fig3.groups().items() for key in values]
    assert re.search(r"stiffness_y</td><td[^>]*>1e\+07</td><td[^>]*>N/m</td>", section(page))
    drive = {"time": [0.01 * i for i in range(40)], "velocity": [1e-3, 0.0] * 20}
    changed = ds.run(fig3, scene={"t_end": 0.05}, system={"mass": 0.5}, integrator={"max_steps": 12345}, drive=drive)
    also = section(report(changed, "changed.h5"))
    values = r"0\.001, 0, 0\.001, 0, 0\.001, 0, 0\.001, 0, 0\.001, 0, 0\.001, 0, … \(40 values\)"
    for key, value in (
        ("scene.t_end", "0.05"),
        ("system.mass", "0.5"),
        ("integrator.max_steps", "12345"),
        ("drive.velocity", values),
    ):
        assert re.search(rf"{key}</td><td[^>]*>{value}</td>", also), key
    assert "checkpoint_interval" not in section(page) + also


def test_any_run_has_a_page(fig3: ds.Scene, fig3_result: ds.Result) -> None:
    few = ds.run(fig3, scene={"t_end": 0.05, "title": "<script>alert(1)</script>"}, output={"fields": "X"})
    page = report(few, "a<b>.h5")
    assert "<script>alert" not in page
    assert "a&lt;b&gt;.h5" in page
    assert 'alt="columns: ' in page
    assert "lacks the columns" in page
    cut = replace(fig3_result, columns=ds.Described((i, v[:0]) for i, v in fig3_result.columns.info()))
    assert "Too few samples" in report(replace(cut, attributes={"complete": 0}), "cut.h5")


def test_the_command_writes_beside_the_file(tmp_path: Path, fig3: ds.Scene, capsys: pytest.CaptureFixture[str]) -> None:
    ds.run(fig3, scene={"t_end": 0.05}).save(tmp_path / "run.h5")
    assert main(["report", str(tmp_path / "run.h5")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'run.html'}\n"
    assert (tmp_path / "run.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert main(["report", str(tmp_path / "run.h5")]) == 3
    assert main(["report", str(tmp_path / "run.h5"), "--overwrite"]) == 0
