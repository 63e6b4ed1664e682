"""Write docs/command_line.md, the manual page of the command line, from what `--help` prints.

    python docs/make_command_page.py [EXECUTABLE]

The commands are those that `dynstiction --help` names, and the commands of `python -m dynstiction`.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parent / "command_line.md"

INTRODUCTION = """\
# The command line

<!-- Made by docs/make_command_page.py from `dynstiction --help`: change src/app/command_line.f90 or the script, not this page. -->

Every command explains itself with `--help`; this page is what they print. Exit statuses and messages: [errors.md](errors.md).
"""

EXIT_STATUS = "\nExit status:\n"


def main() -> None:
    executable = sys.argv[1] if len(sys.argv) > 1 else "dynstiction"
    parts = [INTRODUCTION, section("dynstiction", text := printed(executable))]
    own = text.partition("By the Python package")[0]
    for name in dict.fromkeys(re.findall(r"^  dynstiction (\w+)", own, re.MULTILINE)):
        parts.append(
            section(f"dynstiction {name}", printed(executable, name).partition(EXIT_STATUS)[0] + "\n")
        )
    python = [sys.executable, "-m", "dynstiction"]
    parts.append(section("python -m dynstiction", text := printed(*python)))
    for name in dict.fromkeys(re.findall(r"^ {4}([\w-]+)(?: |$)", text, re.MULTILINE)):
        parts.append(section(f"python -m dynstiction {name}", printed(*python, name)))
    PAGE.write_text("\n".join(parts), encoding="utf-8")


def printed(*command: str) -> str:
    # argparse breaks lines at the terminal's width.
    environment = {**os.environ, "COLUMNS": "110"}
    done = subprocess.run([*command, "--help"], capture_output=True, text=True, check=True, env=environment)
    return re.sub(r"[ \t]+$", "", done.stdout, flags=re.MULTILINE)


def section(title: str, text: str) -> str:
    return f"## {title}\n\n```none\n{text.rstrip()}\n```\n"


if __name__ == "__main__":
    main()
