#!/usr/bin/env bash
# tests/mpi/run.sh BUILD_FOLDER [PYTEST OPTION]...: builds the program with Open MPI and with MPICH below BUILD_FOLDER and runs the
# tests of sweeps and of faults over MPI with both (faults.py has the whole matrix). What is not installed is skipped, with a line
# that says so. Needs meson, ninja and pytest on PATH, and the package dynstiction and DYNSTICTION_EXE, its program, as for
# tests/python. Debian packages: libopenmpi-dev, openmpi-bin, libmpich-dev, mpich.
set -euo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  awk 'NR > 1 { if (!/^#/) exit; sub(/^# ?/, ""); print }' "$0"
  exit 0
fi
checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
folder=${1:?folder to build in}
shift

have() { command -v "$1" > /dev/null; }

# build NAME VARIABLE: build with the wrapper mpifort.NAME, and name the program in VARIABLE.
build() {
  local name=$1 variable=$2 log=$folder/$1.log
  if ! { have "mpifort.$name" && have "mpirun.$name"; }; then
    printf 'MPI: skipped with %s: no mpifort.%s and mpirun.%s\n' "$name" "$name" "$name"
    return
  fi
  if [[ ! -e $folder/$name/build.ninja ]]; then
    FC=mpifort.$name meson setup "$folder/$name" "$checkout" -Dmpi=enabled -Dpython=false -Dtests=false > "$log" 2>&1 ||
      { cat "$log" >&2; return 1; }
  fi
  ninja -C "$folder/$name" --quiet src/dynstiction
  export "$variable=$folder/$name/src/dynstiction"
}

mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
unset DYNSTICTION_OPENMPI_EXE DYNSTICTION_MPICH_EXE
build openmpi DYNSTICTION_OPENMPI_EXE
build mpich DYNSTICTION_MPICH_EXE
if [[ -z ${DYNSTICTION_OPENMPI_EXE:-}${DYNSTICTION_MPICH_EXE:-} ]]; then exit 0; fi
exec python -m pytest -m 'not full' "$checkout"/tests/python/test_{sweep_mpi,sweep_kills,mpi_faults}.py -k 'not Threads and not Array' "$@"
