"""Measure this code and its peers on one scene; called by run.sh, which installs and builds.

    python bench/peers/run.py [--rounds N] [--only PEER...] [--draw] [--short]

Fig. 3 to 2.5 s. Every point (peer, method, formulation, tolerances) is run in turn, and all of them again in the next round; its
time is the median of the processor times. Its error of u_x and of w is the largest, over t = 0.02, 0.5, 2 and 2.5 s, of
|u_x - ref|/|ref| and of |w - ref|/|ref| (Euclidean). Writes bench/peers/peers.csv and bench/peers/peers.png, prints the table.
--short measures a few points of the peers that are quick to install, writes into build/peers/, and fails if one gives no result.
"""

import argparse
import csv
import itertools
import json
import math
import platform
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import dynstiction as ds
import numpy as np
import scipy
from dynstiction.plot.style import BLACK, BLUE, DOTS_PER_INCH, GREEN, MM, STYLE, VERMILION
from matplotlib import rc_context
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[2]
HERE, WORK = ROOT / "bench" / "peers", ROOT / "build" / "peers"
OURS = "dynstiction"
TIMES = (0.02, 0.5, 2.0, 2.5)
LEVELS = {"A": (1e-3, 1e-1), "B": (1e-5, 1e-2), "C": (1e-7, 1e-4), "D": (1e-9, 1e-6)}
FORMULATIONS = ("polar", "smoothed", "printed", "nonsmooth")

PEERS = {
    "odeint": [str(WORK / "odeint")],
    "CVODE": [str(WORK / "sundials")],
    "ARKODE": [str(WORK / "sundials")],
    "SciPy": [sys.executable, str(HERE / "scipy_peer.py")],
    "Siconos": [str(WORK / "siconos")],
}


@dataclass
class Point:
    """One peer with one setting, and the results of its runs."""

    peer: str
    method: str
    formulation: str
    settings: dict[str, str]
    limit: float = 5.0
    seconds: list[float] = field(default_factory=list)
    error_u: float = math.nan
    error_w: float = math.nan
    stops: int = 0
    reached: float = 0.0
    status: str = ""
    runs: int = 0

    def name(self):
        """Name of the method, as in the table."""
        return f"{self.method}, map off" if self.settings.get("cycle_map") == "off" else self.method

    def level(self):
        """Best level reached, or '-'."""
        held = [name for name, (u, w) in LEVELS.items() if self.error_u <= u and self.error_w <= w]
        return held[-1] if held and self.status == "done" else "-"

    def worth_another_round(self):
        return self.peer != "SciPy" and self.status == "done" and statistics.median(self.seconds) < 0.5

    def measure(self, reference):
        answer = self.run_ours() if self.peer == OURS else self.run_peer()
        self.status, self.stops, self.reached = answer["status"], answer["stops"], answer["time"]
        self.seconds.append(answer["seconds"])
        self.runs += 1
        states = np.array(answer["states"]).reshape(-1, 4)
        if len(states):
            exact = np.array([reference[t] for t in TIMES[: len(states)]])
            w, w_exact = states[:, 2:], exact[:, 2:]
            self.error_u = float(np.max(np.abs(states[:, 0] / exact[:, 0] - 1.0)))
            self.error_w = float(
                np.max(np.linalg.norm(w - w_exact, axis=1) / np.linalg.norm(w_exact, axis=1))
            )

    def run_ours(self):
        """Run from Python; the time includes reading the deck."""
        begun = time.process_time()
        result = ds.run(
            ROOT / "inputs" / "fig3.nml",
            scene={"t_end": TIMES[-1]},
            integrator={
                "method": self.method,
                "rtol": float(self.settings["rtol"]),
                "cycle_map": self.settings["cycle_map"],
            },
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

    def run_peer(self):
        words = [f"{key}={value}" for key, value in self.settings.items()]
        words += [f"method={self.method}", f"formulation={self.formulation}", f"limit={self.limit}"]
        failed = {"seconds": math.nan, "time": 0.0, "stops": 0, "states": []}
        try:
            done = subprocess.run(
                [*PEERS[self.peer], *words], capture_output=True, text=True, timeout=1200, check=False
            )
        except FileNotFoundError:
            return {**failed, "status": "not available"}
        except subprocess.TimeoutExpired:
            return {**failed, "status": "hangs"}
        lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
        return json.loads(lines[0]) if lines else {**failed, "status": f"exit status {done.returncode}"}


def grid(peer, method, formulation, limit=5.0, **values):
    """Points with all combinations of values."""
    for row in itertools.product(*(text.split() for text in values.values())):
        yield Point(peer, method, formulation, dict(zip(values, row, strict=True)), limit)


def points():
    """All points, the fast ones first."""
    decades = "1e-3 1e-4 1e-5 1e-6 1e-7 1e-8 1e-9 1e-10"
    for method in ("radau5", "radau9", "radau13"):
        yield from grid(
            OURS, method, "polar", cycle_map="auto off",
            rtol="1e-3 3e-4 1e-4 3e-5 1e-5 3e-6 1e-6 3e-7 1e-7 1e-8 1e-9 1e-10",
        )  # fmt: skip
    yield from grid(OURS, "dop853", "polar", cycle_map="auto off", rtol="1e-2 1e-3 1e-4 1e-5 1e-6 1e-7")
    # Our polar slip velocity and switching.
    rosenbrock = "1e-4 3e-5 1e-5 3e-6 1e-6 3e-7 1e-7 3e-8 1e-8 1e-9 1e-10"
    yield from grid("odeint", "rosenbrock4", "polar", rtol=rosenbrock, v_cut="3e-6 1e-6 3e-7 1e-7")
    yield from grid("odeint", "dopri5", "polar", rtol="1e-4 1e-5 1e-6 1e-7 1e-8", v_cut="3e-6 1e-6 1e-7")
    yield from grid("CVODE", "bdf", "polar", rtol=decades + " 1e-11", v_cut="1e-7")
    yield from grid("CVODE", "adams", "polar", rtol="1e-5 1e-6 1e-7 1e-8 1e-9 1e-10", v_cut="1e-7")
    yield from grid("ARKODE", "dirk", "polar", order="3 5", rtol="1e-5 1e-6 1e-7 1e-8", v_cut="1e-7")
    yield from grid("ARKODE", "dirk", "polar", 20.0, order="5", rtol="1e-9 1e-10", v_cut="1e-7")
    yield from grid("ARKODE", "erk", "polar", order="4 5", rtol="1e-4 1e-6 1e-7 1e-8", v_cut="1e-6 1e-7")
    # Smoothed.
    yield from grid("odeint", "rosenbrock4", "smoothed", rtol="1e-4 1e-5 1e-6 1e-7", v_s="1e-9 1e-10 1e-11")
    yield from grid("odeint", "rosenbrock4", "smoothed", rtol="1e-8 1e-9", v_s="1e-11 1e-12 1e-13")
    yield from grid("odeint", "rosenbrock4", "smoothed", rtol="1e-11", v_s="1e-13 1e-14")
    yield from grid("odeint", "dopri5", "smoothed", rtol="1e-5", v_s="1e-8 1e-9")
    yield from grid("CVODE", "bdf", "smoothed", rtol="1e-6 1e-7 1e-8 1e-9", v_s="1e-10 1e-11 1e-12")
    yield from grid("CVODE", "adams", "smoothed", rtol="1e-6 1e-8", v_s="1e-10")
    yield from grid("ARKODE", "dirk", "smoothed", order="3", rtol="1e-6 1e-7", v_s="1e-10")
    yield from grid("ARKODE", "dirk", "smoothed", order="5", rtol="1e-6", v_s="1e-10")
    yield from grid("ARKODE", "erk", "smoothed", order="5", rtol="1e-4", v_s="1e-8")
    yield from grid("SciPy", "LSODA", "smoothed", 60.0, rtol="1e-6 1e-7", v_s="1e-10 1e-11")
    yield from grid("SciPy", "Radau", "smoothed", 60.0, rtol="1e-5", v_s="1e-10")
    yield from grid("SciPy", "DOP853", "smoothed", 20.0, rtol="1e-5", v_s="1e-8")
    # As printed.
    yield from grid("odeint", "rosenbrock4", "printed", rtol="1e-3 1e-6")
    yield from grid("odeint", "dopri5", "printed", rtol="1e-3 1e-6")
    yield from grid("CVODE", "bdf", "printed", rtol="1e-6")
    yield from grid("CVODE", "adams", "printed", rtol="1e-6")
    yield from grid("ARKODE", "dirk", "printed", rtol="1e-6")
    yield from grid("ARKODE", "erk", "printed", rtol="1e-6")
    for method in ("Radau", "LSODA", "DOP853"):
        yield from grid("SciPy", method, "printed", 60.0, rtol="1e-6")
    yield from nonsmooth_points()


def nonsmooth_points():
    """Peers that use the friction law without changes, including rest."""
    yield from grid("Siconos", "fc3d", "nonsmooth", 60.0, h="1e-5 2e-6 1e-6 5e-7 2e-7 1e-7 5e-8")
    yield from grid("Siconos", "kernel", "nonsmooth", 200.0, h="1e-5 2e-6 1e-6 5e-7")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3, help="runs of which the median is taken")
    parser.add_argument(
        "--only", nargs="+", default=[OURS, *PEERS], help="measure only these, keep the other rows"
    )
    parser.add_argument(
        "--draw", action="store_true", help="only the figure and the table, from bench/peers/peers.csv"
    )
    parser.add_argument("--short", action="store_true", help="a few seconds: whether it still runs")
    options = parser.parse_args()
    if options.short:
        run_short()
        return
    measured = read_csv(HERE / "peers.csv")
    if not options.draw:
        kept = [p for p in measured if p.peer not in options.only]
        new = [point for point in points() if point.peer in options.only]
        measure(new, options.rounds)
        measured = sorted([*kept, *new], key=lambda point: [OURS, *PEERS].index(point.peer))
        write_csv(HERE / "peers.csv", measured)
    draw(measured, HERE / "peers.png")
    print(table(measured))


def run_short():
    """One point of each kind; SciPy is cut off by its time limit, as most of its points are."""
    measured = [
        Point(OURS, "radau9", "polar", {"cycle_map": "auto", "rtol": "1e-6"}),
        Point(OURS, "radau9", "polar", {"cycle_map": "off", "rtol": "1e-6"}),
        Point("odeint", "rosenbrock4", "polar", {"rtol": "1e-6", "v_cut": "1e-7"}),
        Point("odeint", "dopri5", "smoothed", {"rtol": "1e-5", "v_s": "1e-8"}, 2.0),
        Point("odeint", "rosenbrock4", "printed", {"rtol": "1e-3"}, 2.0),
        Point("SciPy", "LSODA", "smoothed", {"rtol": "1e-6", "v_s": "1e-10"}, 3.0),
    ]
    measure(measured, 1)
    write_csv(WORK / "short.csv", measured)
    draw(read_csv(WORK / "short.csv"), WORK / "short.png")
    print(table(measured))
    # Even if a peer fails, ours and odeint's polar form end, and SciPy gets past the first sample.
    for point, reached in zip(measured, (2.5, 2.5, 2.5, 0.0, 0.0, 0.02), strict=True):
        if point.status not in ("done", "time limit", "step size underflow") or point.reached < reached:
            sys.exit(
                f"{point.peer} {point.method}, {point.formulation}: {point.status} at t = {point.reached} s"
            )


def measure(measured, rounds):
    reference = reference_states()
    for number in range(rounds):
        for point in measured:
            if number == 0 or point.worth_another_round():
                point.measure(reference)
                if number == 0:
                    print(row_of(point), file=sys.stderr, flush=True)
        print(f"round {number + 1} of {rounds} done", file=sys.stderr, flush=True)


def reference_states():
    """(u_x, u_y, w_x, w_y) by time, converged in quadruple precision."""
    scenes = json.loads((ROOT / "tests" / "reference" / "fig3.json").read_text())
    return {row[0]: row[1:] for row in scenes["scenes"]["fig3"]["states"]}


COLUMNS = [
    "peer",
    "method",
    "formulation",
    "settings",
    "runs",
    "seconds",
    "error_u",
    "error_w",
    "level",
    "stops",
    "reached",
    "status",
]


def row_of(point):
    settings = " ".join(f"{key}={value}" for key, value in point.settings.items())
    seconds = statistics.median(point.seconds)
    return [
        point.peer, point.method, point.formulation, settings, point.runs, f"{seconds:.4g}",
        f"{point.error_u:.2g}", f"{point.error_w:.2g}", point.level(), point.stops, f"{point.reached:.4g}", point.status,
    ]  # fmt: skip


def write_csv(path, measured):
    with path.open("w", newline="") as file:
        for line in provenance():
            file.write(f"# {line}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(row_of(point) for point in measured)


def read_csv(path):
    if not path.exists():
        return []
    rows = csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#"))
    return [
        Point(
            row["peer"], row["method"], row["formulation"],
            dict(word.split("=") for word in row["settings"].split()), seconds=[float(row["seconds"])],
            error_u=float(row["error_u"]), error_w=float(row["error_w"]), stops=int(row["stops"]),
            reached=float(row["reached"]), status=row["status"], runs=int(row["runs"]),
        )
        for row in rows
    ]  # fmt: skip


def provenance():
    """Machine and versions."""
    cpu = next(
        line.split(":", 1)[1].strip()
        for line in [*Path("/proc/cpuinfo").read_text().splitlines(), "model name: unknown"]
        if line.startswith("model name")
    )
    yield f"processor: {cpu}; {platform.system()} {platform.machine()}; Python {platform.python_version()}"
    yield f"dynstiction {output_of([str(ROOT / '.venv/bin/dynstiction'), '--version'])}"
    yield f"compiler of the peers: {output_of(['g++', '--version'])}, -O3 -march=native"
    for package in ("libsundials-dev", "libboost-dev", "libsiconos-kernel-dev"):
        yield f"{package} {output_of(['dpkg-query', '-W', '-f', '${Version}', package])}"
    yield f"scipy {scipy.__version__}, numpy {np.__version__}"


def output_of(command):
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[0]
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def fastest(measured, level):
    """The fastest point that reaches a level, if all points with smaller rtol or h and otherwise the same settings also reach it.

    Without that condition, settings whose errors happen to cancel would be chosen.
    """
    u, w = LEVELS[level]

    def others(point):
        return {key: value for key, value in point.settings.items() if key not in ("rtol", "h")}

    def fineness(point):
        return float(point.settings.get("rtol") or point.settings["h"])

    def holds(point):
        return point.error_u <= u and point.error_w <= w

    done = [p for p in measured if p.status == "done"]
    holding = [
        p for p in done
        if all(
            holds(q) for q in done
            if (q.peer, q.method, q.formulation, others(q)) == (p.peer, p.method, p.formulation, others(p))
            and fineness(q) <= fineness(p)
        )
    ]  # fmt: skip
    return min(holding, key=lambda p: statistics.median(p.seconds), default=None)


def table(measured):
    """Time to reach each level and its ratio to ours, in Markdown."""
    ours = {level: fastest([p for p in measured if p.peer == OURS], level) for level in LEVELS}
    lines = [
        "| formulation | peer, method | A | B | C | D | otherwise |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    groups = dict.fromkeys((p.formulation, p.peer, p.name()) for p in measured)
    order = {name: i for i, name in enumerate(FORMULATIONS)}
    for key in sorted(groups, key=lambda k: (order[k[0]], k[1] != OURS)):
        formulation, peer, method = key
        group = [p for p in measured if (p.formulation, p.peer, p.name()) == key]
        cells = []
        for level in LEVELS:
            best = fastest(group, level)
            cells.append("–" if best is None else cell(best, ours[level], peer))
        note = "" if cells[0] != "–" else how_it_fails(group)
        lines.append(f"| {formulation} | {peer} {method} | {' | '.join(cells)} | {note} |")
    return "\n".join(lines)


def cell(best, ours, peer):
    """Time of a point and its ratio to ours."""
    seconds = statistics.median(best.seconds)
    if peer == OURS and best.settings.get("cycle_map") != "off":
        return f"**{seconds:.3g}**" if best is ours else f"{seconds:.3g}"
    if ours is None:
        return f"{seconds:.3g}"
    ratio = seconds / statistics.median(ours.seconds)
    return f"{seconds:.3g} ({ratio:.{0 if ratio >= 10 else 1}f}×)"


def how_it_fails(group):
    """The point that reached the latest time, in words."""
    last = max(group, key=lambda p: (p.reached, -(p.error_w if p.error_w < math.inf else math.inf)))
    if last.status == "done":
        return f"done in {statistics.median(last.seconds):.2g} s, error of w {last.error_w:.2g}"
    return f"{last.status} after {statistics.median(last.seconds):.2g} s at t = {last.reached:.2g} s"


CURVES = {
    "odeint": (VERMILION, "s"),
    "CVODE": (BLUE, "v"),
    "ARKODE": (GREEN, "D"),
    "SciPy": ("0.5", "X"),
    "Siconos": ("#8C564B", "<"),
}


def draw(measured, path):
    """Work and precision: time against the error of w, in our formulation and smoothed."""
    with rc_context(STYLE):
        figure = Figure(figsize=(178.0 * MM, 84.0 * MM), layout="constrained")
        axes = figure.subplots(1, 2, sharex=True, sharey=True)
        titles = ("(a) our formulation handed to the peers", "(b) peers: smoothed or nonsmooth contact")
        panels = (("polar",), ("smoothed", "nonsmooth"))
        for axis, formulations, title in zip(axes, panels, titles, strict=True):
            for peer, (colour, marker) in CURVES.items():
                for style, method in zip(("-", "--", ":"), methods_of(measured, peer), strict=False):
                    chosen = [
                        p
                        for p in measured
                        if (p.peer, p.method) == (peer, method) and p.formulation in formulations
                    ]
                    curve(axis, chosen, colour, marker, style, f"{peer} {method}")
            ours = [p for p in measured if p.peer == OURS]
            for method, style in (("radau9", "-"), ("radau13", "--")):
                for name, fill in ((method, BLACK), (f"{method}, map off", "white")):
                    chosen = [p for p in ours if p.name() == name]
                    curve(axis, chosen, BLACK, "o", style, f"{OURS} {name}", width=1.4, fill=fill)
            for name, (_, w) in LEVELS.items():
                axis.axvline(w, color="0.8", linewidth=0.6, zorder=0)
                axis.text(w, 1.01, name, transform=axis.get_xaxis_transform(), ha="center", va="bottom")
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.set_title(title, fontsize=8.0, pad=12.0)
            axis.set_xlabel("error of $w$")
        axes[0].set_xlim(1.0, 1e-10)
        axes[0].set_ylabel("processor time [s]")
        handles, labels = axes[0].get_legend_handles_labels()
        known = sorted(zip(labels, handles, strict=True), key=lambda entry: not entry[0].startswith(OURS))
        figure.legend(
            [handle for _, handle in known],
            [label for label, _ in known],
            loc="outside right center",
            frameon=False,
            fontsize=7.0,
        )
        figure.savefig(path, dpi=DOTS_PER_INCH // 2)


def methods_of(measured, peer):
    """Peers with a point that ended."""
    return list(dict.fromkeys(p.method for p in measured if p.peer == peer and p.status == "done"))


def curve(axis, chosen, colour, marker, style, label, width=0.8, fill=None):
    """The points for which no other point of the method is better in both time and error."""
    done = sorted((p for p in chosen if p.status == "done"), key=lambda p: statistics.median(p.seconds))
    front, best = [], 0.9
    for point in done:
        if point.error_w < best:
            front.append(point)
            best = point.error_w
    axis.plot(
        [p.error_w for p in front], [statistics.median(p.seconds) for p in front],
        color=colour, marker=marker, linestyle=style, markersize=3.0, linewidth=width, label=label,
        markerfacecolor=fill or colour,
    )  # fmt: skip


if __name__ == "__main__":
    main()
