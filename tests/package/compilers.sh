#!/usr/bin/env bash
# tests/package/compilers.sh [--full [NAME]...]: builds the program with other compilers and flags. Each build runs
# the unit tests and Fig. 3 of the paper: 5398 sticks, and numbers that agree with those of the installed program within 1e-10. By
# radau9, the eigenvectors of whose five stages have a condition number of 95: those of radau13 have 1,170, and its roundoff is 10 times larger.
#
#   --full   all builds, or those named, also with products and sums that are rounded together; without it LLVM's flang
#
# A compiler that is not installed is skipped, with a line that says so. On Debian: apt-get install flang-22 libflang-22-dev,
# gfortran-11, libopenblas-dev, libblis-dev.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"
help_if_wanted "$@"

is_full=no
if [[ ${1:-} == --full ]]; then
  is_full=yes
  shift
fi
named=" $* "
prepare
reference=$scratch/reference.h5
"${DYNSTICTION_EXE:-$venv/bin/dynstiction}" run "$checkout/inputs/fig3.nml" --set integrator.method=radau9 -o "$reference" --quiet

# agrees FILE: whether the sticks are counted, and each column and value of the summary agrees with the reference relative to its
# largest value, components of a vector relative to the largest of both. Roundoff itself has no such value: the residual of the
# energy, the scatter of equal cycles, the exponent of a stable one.
agrees() {
  python - "$reference" "$1" << 'END'
import sys
import h5py
import numpy as np

def numbers(name):
    with h5py.File(name) as file:
        return {key: file[f"{group}/{key}"][()] for group in ("time_series", "summary") for key in file[group]}


def largest(key):
    vector = next((pair for pair in VECTORS if key in pair), (key,))
    return max(np.max(np.abs(here[name])) for name in vector)


VECTORS = [("w_x", "w_y"), ("u_x", "u_y"), ("X_rate", "Y_rate"), ("spring_force_x", "spring_force_y")]
here, there = numbers(sys.argv[1]), numbers(sys.argv[2])
assert there["sticks"] == 5398, there["sticks"]
compared = [key for key in here if not key.endswith(("_scatter", "_residual")) and "lyapunov" not in key]
assert len(compared) > 20
difference = {key: float(np.max(np.abs(here[key] - there[key])) / (largest(key) or 1.0)) for key in compared}
worst = max(difference, key=difference.__getitem__)
print(f"largest difference: {difference[worst]:.1e}, of {worst}")
# Newton's method leaves 1e-3 rtol, 1e-11: where the last digits differ it may end an iteration earlier.
assert difference[worst] < 1e-10
END
}

is_wanted() { [[ $named == '  ' || $named == *" $1 "* ]]; }

# with NAME COMPILER [OPTION of Meson]...: a build, its unit tests (without --full some of them), Fig. 3.
with() {
  local name=$1 compiler=$2 folder=$checkout/build/with_$1 quick=()
  is_wanted "$name" || return 0
  shift 2
  if ! have "${compiler%% *}"; then
    skip "$name: no $compiler"
    return
  fi
  rm -rf "$folder"
  mkdir -p "$folder"
  say "== $name: $compiler $*"
  check "$name: configures" env FC="$compiler" meson setup "$folder" "$checkout" -Dpython=false "$@"
  [[ -e $folder/build.ninja ]] || return 0
  check "$name: compiles" compiles "$folder" "$compiler"
  [[ $is_full == yes ]] || quick=(deck models numerics plain_numbers radau release_map resume sha256)
  check "$name: unit tests" meson test -C "$folder" --no-rebuild --print-errorlogs --no-suite fuzz --no-suite threads ${quick[@]+"${quick[@]}"}
  run_fig3 "$name" "$folder/src/dynstiction"
}

# compiles FOLDER COMPILER: this machine's own gfortran without a warning.
compiles() {
  ninja -C "$1" 2>&1 | tee "$scratch/compiles.log"
  ((PIPESTATUS[0] == 0)) || return 1
  [[ $2 != gfortran ]] || fails grep -q 'warning:' "$scratch/compiles.log"
}

run_fig3() {
  local name=$1
  shift
  check "$name: Fig. 3 runs" "$@" run "$checkout/inputs/fig3.nml" --set integrator.method=radau9 -o "$scratch/$name.h5" --quiet
  check "$name: the numbers of the installed program" agrees "$scratch/$name.h5"
}

newest() { # newest PATTERN: the newest installed program with such a name
  compgen -c | grep -xE "$1" | sort -u -V | tail -n 1
}

# with_lapack LIBRARY[,LIBRARY]: a build with this LAPACK, if it is there.
with_lapack() {
  if printf 'program p\nexternal dgeev\ncall dgeev()\nend program p\n' | gfortran -x f95 - -o "$scratch/links" $(sed 's/^\|,/ -l/g' <<< "$1") 2> /dev/null; then
    with "${1//,/_}" gfortran "-Dlapack=$1"
  elif is_wanted "${1//,/_}"; then
    skip "${1//,/_}: it is not installed"
  fi
}

flang=$(newest 'flang-new-[0-9]+') || true
with flang "${flang:-flang}" -Doptimization=2
if [[ $is_full == yes ]]; then
  with fused gfortran '-Dfortran_args=-ffp-contract=fast -mfma'
  with oldest "$(compgen -c | grep -xE 'gfortran-[0-9]+' | sort -u -V | head -n 1)"
  with newest "$(newest 'gfortran-[0-9]+')"
  for level in 0 1 2; do
    with "O$level" gfortran "-Doptimization=$level"
  done
  with plain gfortran --buildtype=plain -Dfortran_args=-O1
  with native gfortran -Dnative=true
  with lto gfortran -Db_lto=true
  for library in openblas lapack,blis flexiblas; do with_lapack "$library"; done
  with checks gfortran -Doptimization=1 '-Dfortran_args=-fcheck=all -ffpe-trap=invalid -finit-real=snan'
fi
summary 'Compilers'
