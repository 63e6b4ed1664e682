"""Draw docs/architecture.svg: the modules of src/ by rooms, and the way of a deck through them.

    python docs/architecture.py

Every module must have a room, and a room may use only the rooms listed for it; otherwise nothing is
drawn and the offending line is printed. So the picture cannot disagree with the source.
"""

import re
import sys
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parent.parent
WIDTH, HEIGHT = 1000, 1016
# fmt: off
TONES = {
    "ground": "#e9e9e9", "physics": "#d9ead8", "numerics": "#d6e4f2", "deck": "#f6e7cf", "meeting": "#e2dcef",
    "simulation": "#e2dcef", "writers": "#f3dcd8", "executable": "#eef0d2", "comparison": "#e2dcef", "python": "#eef0d2",
    "sweeps": "#e2dcef",
}

# room: (title, x, y, width, height, rooms it may use besides itself, modules)
ROOMS = {
    "executable": ("the executable", 20, 66, 570, 130,
                   "ground deck simulation comparison sweeps writers slider stability",
                   "program main command_line completion handover deck_check standard_streams threads run trade_run sweep_runner processes dealer show "
                   "progress stability_report"),
    "python": ("Python", 610, 66, 370, 130, "ground physics deck simulation comparison sweeps writers", "python_api"),
    "comparison": ("comparing runs of one scene", 20, 220, 560, 110, "ground physics deck simulation writers observables linear_solve",
                   "trade trade_plan trade_quantities trade_advice trade_report trade_table"),
    "sweeps": ("many cases of one scene", 600, 220, 380, 110, "ground deck simulation writers observables summary slider friction",
               "sweep lanes division sweep_shard sweep_points sweep_list sweep_file"),
    "simulation": ("the one run routine", 20, 352, 300, 150,
                   "ground physics numerics scene meeting memory_writer",
                   "simulation model_choice model_columns output_size"),
    "writers": ("where results go", 340, 352, 320, 150, "ground sha256",
                 "hdf5_writer hdf5_origin hdf5_tools memory_writer result_file checkpoint lock seal crc32 disk disk_space process signals"),
    "meeting": ("where physics and numerics meet", 20, 526, 640, 112, "ground physics numerics",
                "contact trajectory observables cycles summary trajectory_summary moreau_jean creep_motion"),
    "physics": ("physics", 20, 662, 200, 240, "ground", "full_model low_frequency straight_slip slider friction drive slip_system stability creep"),
    "numerics": ("numerics", 240, 662, 420, 240, "ground slip_system drive",
                 "radau runge_kutta newton_kernels runge_kutta_tableaux linear_solve collocation bernstein instability polynomial_roots "
                 "interpolation stepper"),
    "deck": ("the deck", 680, 352, 300, 550, "ground",
             "scene parameters deck deck_sweep deck_text deck_values schema namelist faults sha256"),
    "ground": ("ground", 20, 926, 960, 72, "", "kinds errors text machine plain_numbers archive writer"),
}

SAY = {
    "program": "begins, ends", "main": "prints errors", "command_line": "words, --help", "completion": "for shells", "run": "deck → file", "progress": "one line",
    "python_api": "flat routines for f2py", "simulation": "builds, advances, records", "hdf5_writer": "the file",
    "memory_writer": "arrays", "result_file": "its life", "lock": "one at a time", "hdf5_origin": "whose file it is", "checkpoint": "state on disk",
    "archive": "state as words", "signals": "stop, please", "handover": "Python's turn", "moreau_jean": "steps without events",
    "disk": "the system", "seal": "checksum of all", "crc32": "as in zlib", "process": "what may crash", "contact": "rest, release, stop",
    "trajectory": "advances, events", "observables": "output columns", "cycles": "peak to peak", "summary": "extremes, energy",
    "trajectory_summary": "of a run",
    "full_model": "Eqs. 1–5", "low_frequency": "Eq. 4, rigid k_y", "straight_slip": "Eq. 9", "creep_motion": "creep of a scene",
    "sweep": "what a case is", "lanes": "cases side by side", "sweep_shard": "finished cases", "sweep_points": "lists in CSV", "sweep_list": "lists of cases", "sweep_file": "one file of all",
    "sweep_runner": "all cases, all cores", "division": "who has which cases", "show": "how far it is", "deck_check": "will it run?", "threads": "with stacks",
    "standard_streams": "output, errors", "disk_space": "is there room?", "output_size": "how many samples", "plain_numbers": "for people", "processes": "MPI, or none", "dealer": "cases to processes", "machine": "host, job", "deck_sweep": "&sweep",
    "model_choice": "what auto is", "model_columns": "who gives what", "trade": "compares", "trade_plan": "what to try", "trade_quantities": "errors",
    "trade_advice": "the cheapest", "trade_report": "its table", "trade_table": "its columns", "trade_run": "comparison → file", "slider": "m, K, φ", "friction": "F(v)", "drive": "V(t)",
    "stability": "linear theory", "creep": "Eqs. 7, 8", "stability_report": "its table",
    "slip_system": "a model, seen by a method", "radau": "implicit steps", "runge_kutta": "explicit steps",
    "newton_kernels": "one per size", "linear_solve": "small and dense", "collocation": "Radau IIA", "runge_kutta_tableaux": "methods as data", "hdf5_tools": "HDF5, briefly", "bernstein": "first zero", "instability": "longest step", "polynomial_roots": "Laguerre",
    "interpolation": "dense output", "stepper": "a method, seen by the trajectory",
    "scene": "the deck, typed", "deck": "reads and checks", "schema": "the one table of keys",
    "namelist": "scanner", "kinds": "wp", "errors": "codes as values",
    "writer": "a writer, seen by the run routine", "faults": "all in one go", "deck_text": "check, template",
    "deck_values": "values as given", "parameters": "keys for the file", "sha256": "of the deck", "text": "words, numbers",
}
# Abstract types: the doors between rooms.
DOORS = {"slip_system", "stepper", "writer"}

# The way of a deck: number, x, y of its mark, as in architecture.md.
MARKS = [(1, 38, 66), (2, 698, 352), (3, 962, 352), (4, 38, 352), (5, 38, 526), (6, 642, 526), (7, 642, 352), (8, 572, 66)]
# fmt: on


def main() -> None:
    room_of = {module: room for room, entry in ROOMS.items() for module in entry[6].split()}
    faults = list(complaints(room_of))
    if faults:
        sys.exit("\n".join(faults))
    parts = [header()]
    for room, entry in ROOMS.items():
        parts += draw_room(room, *entry)
    parts += draw_python()
    parts += [draw_mark(*mark) for mark in MARKS]
    (ROOT / "docs" / "architecture.svg").write_text("\n".join([*parts, "</svg>", ""]), encoding="utf-8")


def module_of(file: Path) -> str:
    """The file's stem; processes_mpi and processes_serial are two ways to build one module."""
    return "processes" if file.stem.startswith("processes_") else file.stem


def complaints(room_of: dict[str, str]) -> list[str]:
    found = []
    for file in sorted((ROOT / "src").glob("*.f90")):
        module = module_of(file)
        if module not in room_of:
            found.append(f"{file.name}: has no room")
            continue
        allowed = {room_of[module], module, *ROOMS[room_of[module]][5].split()}
        for line in file.read_text(encoding="utf-8").splitlines():
            used = re.match(r"\s*use\s*(?:::)?\s*dst_(\w+)", line)
            if not used or used[1] in ("build_info", "precision"):
                continue
            if used[1] not in room_of:
                found.append(f"{file.name}: uses {used[1]}, which has no room")
            elif used[1] not in allowed and room_of[used[1]] not in allowed:
                found.append(f"{file.name} ({room_of[module]}) uses {used[1]} ({room_of[used[1]]})")
    here = {module_of(file) for file in (ROOT / "src").glob("*.f90")}
    return found + [f"{module}: drawn, but not in src/" for module in sorted(set(room_of) - here)]


def header() -> str:
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" \
font-family="DejaVu Sans, Helvetica, Arial, sans-serif">
<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>
<text x="20" y="26" font-size="17" font-weight="bold">The rooms of src/</text>
<text x="20" y="44" font-size="11.5" fill="#444">A room uses only rooms on lower floors; numerics sees of physics \
only slip_system and drive. Dashed: abstract types. Numbers: the way of a deck.</text>"""


def draw_room(
    room: str, title: str, x: int, y: int, width: int, height: int, _: str, modules: str
) -> list[str]:
    parts = [
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="8" fill="{TONES[room]}" stroke="#888"/>',
        f'<text x="{x + width / 2}" y="{y + 19}" font-size="13" font-weight="bold" text-anchor="middle">{escape(title)}</text>',
    ]
    chips = modules.split()
    wide = [chip for chip in chips if chip in DOORS and room in ("physics", "numerics")]
    columns = {
        "executable": 5,
        "comparison": 3,
        "sweeps": 3,
        "writers": 3,
        "physics": 2,
        "numerics": 2,
        "meeting": 5,
        "ground": 5,
    }.get(room, 1)
    rows = -(-(len(chips) - len(wide)) // columns) + len(wide)
    gap, top = 8, 28
    chip_width = (width - gap * (columns + 1)) / columns
    chip_height = (height - top - gap * rows) / rows
    if room == "python":
        chip_height = 43
        return parts + draw_chip(
            "python_api", x + gap, y + height - chip_height - gap, width - 2 * gap, chip_height
        )
    column = row = 0
    for chip in [*(c for c in chips if c not in wide), *wide]:
        span = chip in wide
        if span and column:
            column, row = 0, row + 1
        left = x + gap + column * (chip_width + gap)
        parts += draw_chip(
            chip,
            left,
            y + top + row * (chip_height + gap),
            width - 2 * gap if span else chip_width,
            chip_height,
        )
        column += columns if span else 1
        if column >= columns:
            column, row = 0, row + 1
    return parts


def draw_chip(name: str, x: float, y: float, width: float, height: float) -> list[str]:
    dash = ' stroke-dasharray="4 3"' if name in DOORS else ""
    middle = x + width / 2
    rect = f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="4" fill="white" stroke="#999"{dash}/>'
    return [
        rect,
        text(name, middle, y + height / 2 - 3, 12.5, "#000"),
        text(SAY[name], middle, y + height / 2 + 11, 10.5, "#666"),
    ]


def text(content: str, x: float, y: float, size: float, colour: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{colour}" text-anchor="middle">{escape(content)}</text>'


def draw_python() -> list[str]:
    """The package stands outside src/, over its flat interface."""
    x, y, width = ROOMS["python"][1:4]
    rect = (
        f'<rect x="{x + 8}" y="{y + 28}" width="{width - 16}" height="43" rx="4" fill="white" stroke="#999"/>'
    )
    return [
        rect,
        text("python/dynstiction", x + width / 2, y + 48, 12.5, "#000"),
        text("run, trade, Scene, plot; f2py makes the wrappers", x + width / 2, y + 63, 10.5, "#666"),
    ]


def draw_mark(number: int, x: int, y: int) -> str:
    circle = f'<circle cx="{x}" cy="{y}" r="11" fill="#D55E00"/>'
    return f'{circle}<text x="{x}" y="{y + 4.5}" font-size="13" font-weight="bold" fill="white" text-anchor="middle">{number}</text>'


if __name__ == "__main__":
    main()
