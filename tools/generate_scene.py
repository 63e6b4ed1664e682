"""Write the numbers of a scene, and how they are set by their keys, as a Fortran module, from the table of keys.

    generate_scene.py src/deck/schema.f90 OUTPUT

The build runs this script. A key with one number becomes a component with its name, unit and default.
"""

import argparse
import re
from pathlib import Path

# group, name, kind, unit, then range and whether it is required, default.
KEY = re.compile(r"key_t\('(\w+)', '(\w+)', (real|integer)_kind, '([^']*)',[^']*(?:must|may), '([^']*)'")
TYPES = {"real": "real(wp)", "integer": "integer(int64)"}
MODULE = """!> The keys with one number, as a scene has them. Made by tools/generate_scene.py from src/deck/schema.f90.
module dst_scene_numbers
  use dst_kinds, only: wp, int64
  implicit none
  private

  public :: scene_numbers_t

  !> The numbers of a scene, in the units of the deck.
  type :: scene_numbers_t
{components}
  contains
    procedure :: set
  end type scene_numbers_t

contains

  !> Set the component of a key, in its unit; other names change nothing. Safe in threads: no text of deferred length is used.
  pure subroutine set(self, name, value)
    class(scene_numbers_t), intent(inout) :: self
    character(*), intent(in) :: name
    real(wp), intent(in) :: value

    select case (name)
{cases}
    end select
  end subroutine set
end module dst_scene_numbers
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", type=Path, nargs=2, metavar="FILE", help="schema.f90, and the module")
    schema, output = parser.parse_args().files
    components, cases = [], []
    for group, name, kind, unit, default in KEY.findall(schema.read_text(encoding="utf-8")):
        if group == "sweep":
            continue
        start = default + ("_wp" if kind == "real" else "_int64") if default[:1].isdigit() else "0.0_wp"
        components.append(f"    {TYPES[kind]} :: {name} = {start}   !! {unit}")
        value = "value" if kind == "real" else "nint(value, int64)"
        cases.append(f"    case ('{name}')\n      self%{name} = {value}")
    output.write_text(
        MODULE.format(components="\n".join(components), cases="\n".join(cases)), encoding="utf-8"
    )


if __name__ == "__main__":
    main()
