"""What the tests of sweeps share: decks, and a way to run them and to look at what they left."""

from __future__ import annotations

import h5py
from programs import INPUTS, Program, executable

# By steps, so that a case lasts as long as its t_end says.
SCENE = (INPUTS / "low_frequency.nml").read_text().replace("&integrator", "&integrator\n  cycle_map = 'off'")
GRID = """
&sweep
  parameter = 'system.misalignment_deg', 'drive.velocity'
  first = 1.0, 1.0e-3
  last = 8.0, 4.0e-3
  count = 12, 5
  spacing = 'linear', 'log'
/
"""


class Sweep:
    """A deck in a folder, and the program that runs it."""

    def __init__(self, folder, text=SCENE + GRID, exe=None):
        self.folder = folder
        self.exe = exe or executable()
        # Nothing of a job or a launcher around the tests.
        self.program = Program((self.exe,), base={"PATH": "/usr/bin:/bin"})
        self.deck = folder / "map.nml"
        self.deck.write_text(text)

    def command(self, output, *arguments, command="run", quiet=True):
        return [command, self.deck, "-o", self.folder / output, *(["--quiet"] if quiet else []), *arguments]

    def run(self, output, *arguments, threads=2, command="run", env=None, **options):
        env = {"OMP_NUM_THREADS": str(threads), **(env or {})}
        return self.program(*self.command(output, *arguments, command=command), env=env, timeout=300, **options)

    def start(self, output, *arguments, quiet=True, env=None, **options):
        """A run in the background, in a separate process group."""
        program = Program((self.exe,), env={"OMP_NUM_THREADS": "2", **(env or {})})
        return program.start(*self.command(output, *arguments, quiet=quiet), start_new_session=True, **options)


def values(path):
    """Everything in /sweep that does not depend on the clock."""
    found = {}

    def take(name, item):
        if isinstance(item, h5py.Dataset) and name != "wall_time":
            found[name] = item[()]

    with h5py.File(path) as file:
        file["sweep"].visititems(take)
    return found


def same(a, b):
    """Whether two files hold the same bits."""
    return a.keys() == b.keys() and all(
        list(x) == list(b[name]) if x.dtype == object else x.tobytes() == b[name].tobytes() for name, x in a.items()
    )
