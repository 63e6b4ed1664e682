"""Draw docs/architecture.svg: the layers, which are the folders of src/, on levels that follow from their dependences.

    python docs/architecture.py

The second line of a layer's meson.build says which layers it may use. If a module uses another layer, layers use each other, or a named
layer is not used, the script prints this and draws nothing. So the picture always agrees with the source.
"""

import argparse
import re
import sys
import textwrap
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parent.parent
WIDTH, MARGIN, GAP, LETTER, LINE = 1000, 16, 8, 7.2, 17
TONES = ["#e9e9e9", "#f6e7cf", "#d9ead8", "#d6e4f2", "#e2dcef", "#f3dcd8", "#eef0d2"]
GENERATED = {"precision", "scene_numbers", "build_info", "error_page"}


def rooms_of(source: Path) -> dict[str, Path]:
    """Folder of each layer; the interface to Python, python/core, is also a layer."""
    rooms = {path.parent.name: path.parent for path in sorted(source.glob("*/meson.build"))}
    return rooms | {"python": source.parent / "python" / "core"}


def modules_of(folder: Path) -> dict[str, set[str]]:
    """The modules of a layer, each with the modules that it uses. Several files of one module, and its submodules, count as one."""
    found: dict[str, set[str]] = {}
    for file in sorted(folder.glob("*.f90")):
        text = file.read_text(encoding="utf-8")
        module = re.search(r"^(?:module |submodule\()dst_(\w+)", text, re.MULTILINE)
        name = module[1] if module else file.stem
        found.setdefault(name, set()).update(re.findall(r"^\s*use\s*(?:::)?\s*dst_(\w+)", text, re.MULTILINE))
    return found


def promised(folder: Path) -> tuple[str, set[str]]:
    """Purpose of a layer, and the layers that it may use."""
    first, second = (folder / "meson.build").read_text(encoding="utf-8").splitlines()[:2]
    return first.removeprefix("# "), set(second.removeprefix("# Uses: ").rstrip(".").split()) - {"nothing"}


def complaints(source: Path) -> list[str]:
    """Violations of the rule that layers use only the layers that they name, and never in a circle."""
    rooms = rooms_of(source)
    room_of = {module: room for room, folder in rooms.items() for module in modules_of(folder)}
    found = []
    for room, folder in rooms.items():
        used = set()
        for module, others in modules_of(folder).items():
            for other in sorted(others - GENERATED - {module}):
                if other not in room_of:
                    found.append(f"{room}/{module} uses {other}, which is in no layer")
                elif room_of[other] not in {room, *promised(folder)[1]}:
                    found.append(
                        f"{room}/{module} uses {room_of[other]}/{other}, a layer that {room} does not name"
                    )
                used.add(room_of.get(other))
        found += [
            f"{room} names {other}, but does not use it" for other in sorted(promised(folder)[1] - used)
        ]
    return found or ([] if floors(rooms) else ["layers use each other in a circle"])


def floors(rooms: dict[str, Path]) -> list[list[str]]:
    """Layers by level, the lowest first; empty if they use each other in a circle."""
    found: list[list[str]] = []
    placed: set[str] = set()
    while len(placed) < len(rooms):
        floor = [room for room in rooms if room not in placed and promised(rooms[room])[1] <= placed]
        if not floor:
            return []
        found.append(floor)
        placed.update(floor)
    return found


def text(content: str, x: float, y: float, size: float, style: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" {style}>{escape(content)}</text>'


def picture(source: Path) -> str:
    rooms = rooms_of(source)
    parts: list[str] = []
    y = 56.0
    for number, floor in reversed(list(enumerate(floors(rooms)))):
        width = (WIDTH - 2 * MARGIN - GAP * (len(floor) - 1)) / len(floor)
        modules = {
            room: textwrap.wrap(", ".join(modules_of(rooms[room])), int(width / LETTER)) for room in floor
        }
        height = 48.0 + LINE * max(map(len, modules.values()))
        for place, room in enumerate(floor):
            what, uses = promised(rooms[room])
            x = MARGIN + place * (width + GAP)
            parts += [
                f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="8" fill="{TONES[number % len(TONES)]}" stroke="#888">'
                f"<title>{escape(what)}</title></rect>",
                text(room, x + 10, y + 19, 13, 'font-weight="bold"'),
                *(text(line, x + 10, y + 38 + LINE * row, 11.5) for row, line in enumerate(modules[room])),
                text(
                    "uses " + " ".join(sorted(uses)) if uses else "",
                    x + 10,
                    y + height - 8,
                    10.5,
                    'fill="#555"',
                ),
            ]
        y += height + GAP
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y:.0f}" width="{WIDTH}" height="{y:.0f}" '
        'font-family="DejaVu Sans, Helvetica, Arial, sans-serif">'
    )
    title = text(
        "The layers of src/, each level above those that it uses", MARGIN, 26, 17, 'font-weight="bold"'
    )
    rule = "A layer uses only layers on lower levels, and of these only those that it names."
    ground = f'<rect width="{WIDTH}" height="{y:.0f}" fill="white"/>'
    return "\n".join([head, ground, title, text(rule, MARGIN, 44, 11.5, 'fill="#444"'), *parts, "</svg>", ""])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.parse_args()
    found = complaints(ROOT / "src")
    for line in found:
        print(line, file=sys.stderr)
    if found:
        sys.exit(1)
    (ROOT / "docs" / "architecture.svg").write_text(picture(ROOT / "src"), encoding="utf-8")


if __name__ == "__main__":
    main()
