"""Measure this code and its peers on one scene; called by run.sh, which installs and builds.

    python bench/peers/run.py [--rounds 3] [--only PEER...] [--draw] [--short]

Fig. 3 to 2.5 s. Every point (peer, method, formulation, tolerances) is run in turn, and the fast ones again in each further round; its
time is the median of the processor times. Its error of u_x and of w is the largest, over t = 0.02, 0.5, 2 and 2.5 s, of
|u_x - ref|/|ref| and of |w - ref|/|ref| (Euclidean). Writes bench/peers/peers.csv and bench/peers/peers.png, prints the table.
--only measures these, and keeps the other rows; --draw only draws and prints. --short measures a few points of the peers that are quick
to install, writes into build/peers/, and fails if one gives no result.
"""

import argparse
import itertools
import json
import math
import platform
import statistics
import subprocess
import sys
import time
import warnings
from pathlib import Path

import dynstiction as ds
import numpy as np
import pandas as pd
import scipy
import scipy_peer
from dynstiction.plot.style import BLACK, BLUE, DOTS_PER_INCH, MM, STYLE, VERMILION
from matplotlib import rc_context
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[2]
HERE, WORK = ROOT / "bench" / "peers", ROOT / "build" / "peers"
OURS = "dynstiction"
TIMES = (0.02, 0.5, 2.0, 2.5)
LEVELS = {"A": (1e-3, 1e-1), "B": (1e-5, 1e-2), "C": (1e-7, 1e-4), "D": (1e-9, 1e-6)}
"""Largest errors of u_x and of w."""
CURVES = {
    "odeint": (VERMILION, "s"),
    "CVODE": (BLUE, "v"),
    "SciPy": ("0.5", "X"),
    "Siconos": ("#8C564B", "<"),
}
"""Colour and marker of each peer; those but SciPy are programs in build/peers of that name."""
POINT = ["peer", "method", "formulation", "settings"]

GRIDS = """
dynstiction radau5,radau9,radau13 polar 5 cycle_map=auto,off rtol=1e-3,3e-4,1e-4,3e-5,1e-5,3e-6,1e-6,3e-7,1e-7,1e-8,1e-9,1e-10
dynstiction dop853 polar 5 cycle_map=auto,off rtol=1e-2,1e-3,1e-4,1e-5,1e-6,1e-7
odeint rosenbrock4 polar 5 rtol=1e-4,3e-5,1e-5,3e-6,1e-6,3e-7,1e-7,3e-8,1e-8,1e-9,1e-10 v_cut=3e-6,1e-6,3e-7,1e-7
odeint dopri5 polar 5 rtol=1e-4,1e-5,1e-6,1e-7,1e-8 v_cut=3e-6,1e-6,1e-7
CVODE bdf polar 5 rtol=1e-3,1e-4,1e-5,1e-6,1e-7,1e-8,1e-9,1e-10,1e-11 v_cut=1e-7
CVODE adams polar 5 rtol=1e-5,1e-6,1e-7,1e-8,1e-9,1e-10 v_cut=1e-7
odeint rosenbrock4 smoothed 5 rtol=1e-4,1e-5,1e-6,1e-7 v_s=1e-9,1e-10,1e-11
odeint rosenbrock4 smoothed 5 rtol=1e-8,1e-9 v_s=1e-11,1e-12,1e-13
odeint rosenbrock4 smoothed 5 rtol=1e-11 v_s=1e-13,1e-14
odeint dopri5 smoothed 5 rtol=1e-5 v_s=1e-8,1e-9
CVODE bdf smoothed 5 rtol=1e-6,1e-7,1e-8,1e-9 v_s=1e-10,1e-11,1e-12
CVODE adams smoothed 5 rtol=1e-6,1e-8 v_s=1e-10
SciPy LSODA smoothed 60 rtol=1e-6,1e-7 v_s=1e-10,1e-11
SciPy Radau smoothed 60 rtol=1e-5 v_s=1e-10
SciPy DOP853 smoothed 20 rtol=1e-5 v_s=1e-8
odeint rosenbrock4,dopri5 printed 5 rtol=1e-3,1e-6
CVODE bdf,adams printed 5 rtol=1e-6
SciPy Radau,LSODA,DOP853 printed 60 rtol=1e-6
Siconos fc3d nonsmooth 60 h=1e-5,2e-6,1e-6,5e-7,2e-7,1e-7,5e-8
"""
# One point of each kind; SciPy is cut off by its time limit, as most of its points are.
SHORT = """
dynstiction radau9 polar 5 cycle_map=auto,off rtol=1e-6
odeint rosenbrock4 polar 5 rtol=1e-6 v_cut=1e-7
odeint dopri5 smoothed 2 rtol=1e-5 v_s=1e-8
odeint rosenbrock4 printed 2 rtol=1e-3
SciPy LSODA smoothed 3 rtol=1e-6 v_s=1e-10
"""


def points(grids: str) -> list[tuple[str, str, str, str, float]]:
    """Peer, method, formulation, settings and limit of the processor time [s]: all combinations of a line."""
    return [
        (peer, *rest[:2], " ".join(rest[3:]), float(rest[2]))
        for line in grids.strip().splitlines()
        for peer, methods, formulation, limit, *settings in [line.split()]
        for rest in itertools.product(
            methods.split(","),
            [formulation],
            [limit],
            *(
                [f"{key}={value}" for value in values.split(",")]
                for key, values in (each.split("=") for each in settings)
            ),
        )
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3, help="runs of which the median is taken")
    parser.add_argument("--only", nargs="+", default=[OURS, *CURVES], metavar="PEER")
    parser.add_argument("--draw", action="store_true")
    parser.add_argument("--short", action="store_true", help="half a minute: whether it still runs")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ds.SamplingWarning)
    file = WORK / "short.csv" if options.short else HERE / "peers.csv"
    if not options.draw:
        chosen = [each for each in points(SHORT if options.short else GRIDS) if each[0] in options.only]
        new = measure(chosen, 1 if options.short else options.rounds)
        known = pd.read_csv(file, comment="#", dtype=str) if file.exists() and not options.short else new[:0]
        rows = pd.concat([known[~known.peer.isin(options.only)], new])
        rows = rows.sort_values("peer", key=lambda peer: peer.map([OURS, *CURVES].index), kind="stable")
        file.write_text(
            "".join(f"# {line}\n" for line in provenance()) + rows.to_csv(index=False), encoding="utf-8"
        )
    measured = pd.read_csv(file, comment="#")
    measured["label"] = measured.method.where(
        ~measured.settings.str.contains("cycle_map=off"), measured.method + ", map off"
    )
    draw(measured, file.with_suffix(".png"))
    print(table(measured))
    if options.short:
        # Even if a peer fails, ours and odeint's polar form end, and SciPy gets past the first sample.
        least = (
            measured.formulation.map({"polar": 2.5}).fillna(measured.peer.map({"SciPy": 0.02})).fillna(0.0)
        )
        bad = measured[
            ~measured.status.isin(["done", "time limit", "step size underflow"]) | (measured.reached < least)
        ]
        sys.exit(bad.to_string() if len(bad) else 0)


def measure(points: list[tuple[str, str, str, str, float]], rounds: int) -> pd.DataFrame:
    """A row of the file for each point."""
    scenes = json.loads((ROOT / "tests" / "reference" / "fig3.json").read_text())
    exact = {row[0]: row[1:] for row in scenes["scenes"]["fig3"]["states"]}
    reference = np.array([exact[t] for t in TIMES])
    rows, seconds = {}, {}
    for number in range(rounds):
        for point in points:
            # What takes long, or depends on Python, is measured once.
            if number and (
                point[0] == "SciPy"
                or rows[point]["status"] != "done"
                or statistics.median(seconds[point]) >= 0.5
            ):
                continue
            answer = run(*point)
            times = seconds.setdefault(point, [])
            times.append(answer["seconds"])
            error_u, error_w = errors(np.array(answer["states"]).reshape(-1, 4), reference)
            reached = [
                name
                for name, (u, w) in LEVELS.items()
                if error_u <= u and error_w <= w and answer["status"] == "done"
            ]
            rows[point] = dict(zip(POINT, point, strict=False)) | {
                "runs": len(times), "seconds": f"{statistics.median(times):.4g}", "error_u": f"{error_u:.2g}", "error_w": f"{error_w:.2g}",
                "level": reached[-1] if reached else "-", "stops": answer["stops"], "reached": f"{answer['time']:.4g}", "status": answer["status"],
            }  # fmt: skip
            if number == 0:
                print(*rows[point].values(), file=sys.stderr, flush=True)
        print(f"round {number + 1} of {rounds} done", file=sys.stderr, flush=True)
    return pd.DataFrame(rows.values()).astype(str)


def errors(states: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
    """Of u_x and of w, at the samples that were reached."""
    if not len(states):
        return math.nan, math.nan
    exact = reference[: len(states)]
    of_w = np.linalg.norm(states[:, 2:] - exact[:, 2:], axis=1) / np.linalg.norm(exact[:, 2:], axis=1)
    return float(np.max(np.abs(states[:, 0] / exact[:, 0] - 1.0))), float(np.max(of_w))


def run(peer: str, method: str, formulation: str, settings: str, limit: float) -> dict:
    """Status, processor time [s], time reached [s], number of stops, and the states at the times of the samples."""
    given = dict(word.split("=") for word in settings.split())
    if peer == OURS:
        return run_ours(method, given)
    if peer == "SciPy":
        return scipy_peer.run(method, float(given["rtol"]), float(given.get("v_s", 0.0)), limit)
    failed = {"seconds": math.nan, "time": 0.0, "stops": 0, "states": []}
    words = [
        WORK / peer.lower(),
        *settings.split(),
        f"method={method}",
        f"formulation={formulation}",
        f"limit={limit}",
    ]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=1200, check=False)
    except FileNotFoundError:
        return failed | {"status": "not available"}
    except subprocess.TimeoutExpired:
        return failed | {"status": "hangs"}
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    return json.loads(lines[0]) if lines else failed | {"status": f"exit status {done.returncode}"}


def run_ours(method: str, given: dict[str, str]) -> dict:
    """Run from Python; the time includes reading the deck."""
    begun = time.process_time()
    result = ds.run(
        ROOT / "inputs" / "fig3.nml",
        t_end=TIMES[-1],
        integrator={"method": method, "rtol": float(given["rtol"]), "cycle_map": given["cycle_map"]},
        output={"interval": TIMES[0], "fields": ["u_x", "u_y", "w_x", "w_y"]},
    )
    seconds = time.process_time() - begun
    rows = np.rint(np.array(TIMES) / TIMES[0]).astype(int)
    states = np.stack([result[name][rows] for name in ("u_x", "u_y", "w_x", "w_y")], axis=1)
    return {
        "status": "done",
        "seconds": seconds,
        "time": TIMES[-1],
        "stops": result.sticks(),
        "states": states,
    }


def provenance():
    """Machine and versions."""
    cpu = [
        line.split(":", 1)[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    yield f"processor: {(cpu or ['unknown'])[0]}; {platform.system()} {platform.machine()}; Python {platform.python_version()}"
    yield f"dynstiction {ds.__version__}, scipy {scipy.__version__}, numpy {np.__version__}"
    for package in ("g++", "libsundials-dev", "libboost-dev", "libsiconos-numerics-dev"):
        asked = ["dpkg-query", "-W", "-f", "${Version}", package]
        yield f"{package} {subprocess.run(asked, capture_output=True, text=True, check=False).stdout or 'unknown'}"


def fastest(points: pd.DataFrame, level: str) -> pd.Series | None:
    """The fastest point that reaches a level, if all points with smaller rtol or h and otherwise the same settings also reach it.

    Without that condition, settings whose errors happen to cancel would be chosen.
    """
    u, w = LEVELS[level]
    done = points[points.status == "done"].copy()
    done["holds"] = (done.error_u <= u) & (done.error_w <= w)
    done["fineness"] = done.settings.str.extract(r"\b(?:rtol|h)=(\S+)")[0].astype(float)
    done["others"] = done.settings.str.replace(r"\b(?:rtol|h)=\S+", "", regex=True)
    done = done.sort_values("fineness")
    done["holds"] = done.groupby([*POINT[:3], "others"]).holds.cummin()
    held = done[done.holds]
    return None if held.empty else held.loc[held.seconds.idxmin()]


def table(measured: pd.DataFrame) -> str:
    """Time to reach each level and its ratio to ours, in Markdown."""
    ours = {level: fastest(measured[measured.peer == OURS], level) for level in LEVELS}
    lines = [
        "| formulation | peer, method | A | B | C | D | otherwise |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for formulation in ("polar", "smoothed", "printed", "nonsmooth"):
        for (peer, label), group in measured[measured.formulation == formulation].groupby(
            ["peer", "label"], sort=False
        ):
            best = {level: fastest(group, level) for level in LEVELS}
            is_ours = peer == OURS and "map off" not in label
            cells = [cell(best[level], ours[level], is_ours) for level in LEVELS]
            # The point that reached the latest time, in words.
            last = group.sort_values(["reached", "error_w"], ascending=[False, True]).iloc[0]
            note = f"{last.status} after {last.seconds:.2g} s at t = {last.reached:.2g} s"
            if last.status == "done":
                note = f"done in {last.seconds:.2g} s, error of w {last.error_w:.2g}"
            lines.append(
                f"| {formulation} | {peer} {label} | {' | '.join(cells)} | {note if best['A'] is None else ''} |"
            )
    return "\n".join(lines)


def cell(best: pd.Series | None, ours: pd.Series | None, is_ours: bool) -> str:
    """Time of a point and its ratio to ours."""
    if best is None:
        return "–"
    if is_ours or ours is None:
        return (
            f"**{best.seconds:.3g}**"
            if ours is not None and best.name == ours.name
            else f"{best.seconds:.3g}"
        )
    ratio = best.seconds / ours.seconds
    return f"{best.seconds:.3g} ({ratio:.{0 if ratio >= 10 else 1}f}×)"


def draw(measured: pd.DataFrame, path: Path) -> None:
    """Work and precision: time against the error of w, in our formulation and smoothed."""
    done = measured[measured.status == "done"]
    with rc_context(STYLE):
        figure = Figure(figsize=(178.0 * MM, 84.0 * MM), layout="constrained")
        axes = figure.subplots(1, 2, sharex=True, sharey=True)
        titles = ("(a) our formulation handed to the peers", "(b) peers: smoothed or nonsmooth contact")
        for axis, formulations, title in zip(
            axes, (["polar"], ["smoothed", "nonsmooth"]), titles, strict=True
        ):
            for peer, (colour, marker) in CURVES.items():
                own = done[done.peer == peer]
                for style, method in zip(("-", "--", ":"), own.method.unique(), strict=False):
                    chosen = own[(own.method == method) & own.formulation.isin(formulations)]
                    curve(
                        axis,
                        chosen,
                        f"{peer} {method}",
                        color=colour,
                        marker=marker,
                        linestyle=style,
                        linewidth=0.8,
                    )
            for method, style in (("radau9", "-"), ("radau13", "--")):
                for label, fill in ((method, BLACK), (f"{method}, map off", "white")):
                    chosen = done[(done.peer == OURS) & (done.label == label)]
                    curve(
                        axis,
                        chosen,
                        f"{OURS} {label}",
                        color=BLACK,
                        marker="o",
                        linestyle=style,
                        linewidth=1.4,
                        markerfacecolor=fill,
                    )
            for name, (_, w) in LEVELS.items():
                axis.axvline(w, color="0.8", linewidth=0.6, zorder=0)
                axis.text(w, 1.01, name, transform=axis.get_xaxis_transform(), ha="center", va="bottom")
            axis.set(xscale="log", yscale="log", xlabel="error of $w$")
            axis.set_title(title, fontsize=8.0, pad=12.0)
        axes[0].set(xlim=(1.0, 1e-10), ylabel="processor time [s]")
        known = sorted(
            zip(*axes[0].get_legend_handles_labels(), strict=True),
            key=lambda entry: not entry[1].startswith(OURS),
        )
        figure.legend(*zip(*known, strict=True), loc="outside right center", frameon=False, fontsize=7.0)
        figure.savefig(path, dpi=DOTS_PER_INCH // 2)


def curve(axis, chosen: pd.DataFrame, label: str, **style) -> None:
    """The points for which no other point of the method is better in both time and error."""
    ordered = chosen.sort_values("seconds", kind="stable")
    front = ordered[ordered.error_w < ordered.error_w.cummin().shift(fill_value=0.9).clip(upper=0.9)]
    axis.plot(front.error_w, front.seconds, markersize=3.0, label=label, **style)


if __name__ == "__main__":
    main()
