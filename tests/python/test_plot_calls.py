"""`ds.plot(result)`, `result.plot()`, and the package of that name."""

from __future__ import annotations

import pytest
from programs import SCRIPT


def python(code: str, *arguments: str) -> str:
    return SCRIPT("import dynstiction as ds, sys\n" + code, *arguments, status=0).stdout.strip()


WAYS = (
    "figure = ds.plot(result)",
    "figure = result.plot()",
    "figure = ds.plot.draw(result)",
    "import dynstiction.plot; figure = dynstiction.plot.draw(result)",
    "import dynstiction.plot as p; figure = p(result)",
    "from dynstiction.plot.time_series import draw_history; figure = ds.plot(result)",
)


@pytest.mark.parametrize("code", WAYS)
def test_each_way_to_a_figure(code: str, fig3_text: str) -> None:
    run = "result = ds.run(sys.argv[1], t_end=0.05)\nassert 'matplotlib' not in sys.modules and 'plot' in dir(ds)\n"
    report = "\nprint(type(figure).__name__, len(figure.axes) > 2, 'matplotlib.pyplot' in sys.modules)"
    assert python(run + code + report, fig3_text) == "Figure True False"


PYPLOT = """
import matplotlib
matplotlib.use(sys.argv[2])
import matplotlib.pyplot as plt
result = ds.run(sys.argv[1], t_end=0.05)
figures = [result.plot(), ds.plot(result, "path"), ds.plot({"a": result, "b": result})]
print([plt.figure(number) in figures for number in plt.get_fignums()], len(set(plt.get_fignums())))
print(figures[1].get_size_inches() == ds.plot.draw(result, "path").get_size_inches())
plt.close(figures[0])
print(len(plt.get_fignums()))
"""


def test_pyplot_shows_the_figure_where_it_is_in_use(fig3_text: str) -> None:
    """And only what was drawn to be shown: `draw` leaves it alone."""
    assert python(PYPLOT, fig3_text, "agg").splitlines() == ["[True, True, True] 3", "[ True  True]", "2"]


def test_inline_figures_are_shown_once(fig3_text: str) -> None:
    pytest.importorskip("matplotlib_inline")
    lines = python(PYPLOT.replace("plt.close", "print"), fig3_text, "module://matplotlib_inline.backend_inline").splitlines()
    assert lines[0] == "[] 0"
