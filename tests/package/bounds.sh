#!/usr/bin/env bash
# tests/package/bounds.sh [lowest|newest]: does the source archive install with the lowest versions that pyproject.toml names,
# or with the newest ones, and pass a part of the Python tests there?
#
# By default both, the lowest with the oldest Python from 3.11 on, the newest with the newest; PYTHON= names another one. Every
# test is collected before the extras are installed: a test that needs one of them says so. The last line is the test runner's.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"

help_if_wanted "$@"

tests=(test_{python_api,damaged_files,equations}.py test_plots.py::test_command_draws_a_file)

# pythons: every Python from 3.11 on that can build extensions, the oldest first.
pythons() {
  local candidate
  for candidate in "${python:-python3}" python3.{11..19} ${PYENV_ROOT:-$HOME/.pyenv}/versions/*/bin/python3; do
    "$candidate" -c '
import ensurepip, os, sys, sysconfig
if sys.version_info >= (3, 11) and os.path.exists(sysconfig.get_path("include") + "/Python.h"):
    print(*sys.version_info[:3], sys.executable)' 2> /dev/null || true
  done | sort -u -k1,1n -k2,2n -k3,3n | cut -d ' ' -f 4-
}

# Lower bounds of pyproject.toml as fixed versions, by the name of the package; they must be those of meson.build and tools/.
lowest_versions() {
  "$1" - "$checkout" << 'END'
import re, sys, tomllib
from pathlib import Path

root = Path(sys.argv[1])
project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
groups = [project["build-system"]["requires"], project["project"]["dependencies"], *project["project"]["optional-dependencies"].values()]
bounds = dict(text.split(">=") for group in groups for text in group if ">=" in text)
for file in root.glob("tools/requirements*.txt"):
    for name, bound in (line.split(">=") for line in file.read_text(encoding="utf-8").split() if ">=" in line):
        if bound != bounds.get(name, bound):
            sys.exit(f"tools/{file.name}: {name}>={bound}, but pyproject.toml says {bounds[name]}")
(meson,) = re.findall(r"meson_version: '>= ([\d.]+)'", (root / "meson.build").read_text(encoding="utf-8"))
if meson.removesuffix(".0") != bounds["meson"]:
    sys.exit(f"meson.build: meson >= {meson}, but pyproject.toml says {bounds['meson']}")
print("\n".join(f"{name}=={bound}" for name, bound in bounds.items()))
END
}

# requirements LIST: a list of pyproject.toml.
requirements() {
  "$clean/bin/python" -c "
import tomllib
project = tomllib.load(open('$source/pyproject.toml', 'rb'))
print('\n'.join(project$1))"
}

pip() { timed "$clean/bin/python" -m pip install --disable-pip-version-check --quiet "$@"; }

run_pytest() { (cd "$source" && PATH=$clean/bin:$PATH DYNSTICTION_EXE=$clean/bin/dynstiction "$clean/bin/python" -m pytest -q -p no:cacheprovider "$@"); }

test_bounds() { # test_bounds lowest|newest PYTHON
  clean=$scratch/$1
  say "== $1: $("$2" --version)"
  "$2" -m venv "$clean"
  pip --upgrade pip
  lowest_versions "$clean/bin/python" > "$scratch/lowest.txt"
  [[ $1 == lowest ]] || : > "$scratch/lowest.txt"
  mapfile -t build_tools < <(requirements "['build-system']['requires']")
  pip -c "$scratch/lowest.txt" "${build_tools[@]}" ninja
  # meson and its Python of this environment; without isolation, so that the build has these versions.
  PATH=$clean/bin:$PATH pip -c "$scratch/lowest.txt" --no-build-isolation "$source" pytest
  say "Installed in $seconds s: $("$clean/bin/python" -m pip freeze --all | grep -E "^(meson|meson-python|numpy|h5py|matplotlib|xarray|pandas|scipy)==" | tr '\n' ' ')"
  run_pytest --collect-only -qq tests > "$scratch/collected.txt" 2>&1 || {
    tail -n 40 "$scratch/collected.txt" >&2
    die 'without the extras not every test is collected: pytest.importorskip("PACKAGE", reason="pip install PACKAGE")'
  }
  mapfile -t extras < <(requirements "['project']['optional-dependencies']['netcdf'] + project['project']['optional-dependencies']['progress'] + project['project']['optional-dependencies']['tdms']")
  pip -c "$scratch/lowest.txt" "${extras[@]}" pytest-xdist
  run_pytest -m 'not full' -k 'not any_damage_is_read and not damaged_comparison' -n auto --dist loadfile "${tests[@]/#/tests/python/}"
}

# The archive is made in .venv, whose Python is not the one under test, and unpacked elsewhere.
given=${PYTHON:-}
unset PYTHON
prepare package
source=$scratch/elsewhere
unpacked_archive "$source"

mapfile -t all < <(pythons)
for kind in ${1:-lowest newest}; do
  case $kind in
    lowest) chosen=${all[0]} ;;
    newest) chosen=${all[-1]} ;;
    *) die "unknown word $kind: lowest or newest" ;;
  esac
  test_bounds "$kind" "${given:-$chosen}"
done
