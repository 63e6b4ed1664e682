#!/usr/bin/env bash
# tests/package/compilers.sh [--full [NAME]...]: builds the program with other compilers and flags, and for another processor. Each build runs
# the unit tests and Fig. 3 of the paper: 5398 sticks, and numbers that agree with those of the installed program within 1e-11. By
# radau9, the eigenvectors of whose five stages have a condition number of 95: those of radau13 have 1,170, and its roundoff is 10 times larger.
#
#   --full   all builds, or those named, also for an emulated aarch64 with products and sums that are rounded together; without it
#            LLVM's flang
#
# A compiler that is not installed is skipped, with a line that says so. On Debian: apt-get install flang-22 libflang-22-dev,
# gfortran-11, libopenblas-dev, libblis-dev, and for aarch64 gfortran-aarch64-linux-gnu qemu-user, whose libraries are downloaded into build/aarch64.

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
assert difference[worst] < 1e-11
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

for_aarch64() {
  local folder=$checkout/build/aarch64
  is_wanted aarch64 || return 0
  if ! have aarch64-linux-gnu-gfortran || ! have qemu-aarch64 || ! have dpkg; then
    skip 'aarch64: no aarch64-linux-gnu-gfortran, no qemu-aarch64, or not Debian'
    return
  fi
  say '== aarch64, emulated'
  check 'aarch64: libraries' libraries_for_aarch64 "$folder/root"
  cat > "$folder/cross.ini" << END
[binaries]
c = ['aarch64-linux-gnu-gcc', '--sysroot=$folder/root']
fortran = ['aarch64-linux-gnu-gfortran', '--sysroot=$folder/root']
ar = 'aarch64-linux-gnu-ar'
strip = 'aarch64-linux-gnu-strip'
pkg-config = 'pkg-config'
exe_wrapper = ['qemu-aarch64', '-L', '$folder/root', '-E', 'LD_LIBRARY_PATH=$(folders_of_libraries "$folder/root")']

[properties]
pkg_config_libdir = '$folder/root/usr/lib/aarch64-linux-gnu/pkgconfig'
sys_root = '$folder/root'

[built-in options]
c_link_args = [$(link_arguments "$folder/root")]
fortran_link_args = [$(link_arguments "$folder/root")]

[host_machine]
system = 'linux'
cpu_family = 'aarch64'
cpu = 'aarch64'
endian = 'little'
END
  rm -rf "$folder/program"
  # This processor rounds a product and a sum together; on x86-64 --full does.
  check 'aarch64: configures' meson setup "$folder/program" "$checkout" --cross-file "$folder/cross.ini" -Dpython=false \
    -Dlapack=lapack,blas -Dfortran_args=-ffp-contract=fast
  [[ -e $folder/program/build.ninja ]] || return 0
  check 'aarch64: compiles' ninja -C "$folder/program"
  check 'aarch64: unit tests' meson test -C "$folder/program" --no-rebuild --print-errorlogs --timeout-multiplier 20 \
    --no-suite fuzz --no-suite threads
  run_fig3 aarch64 qemu-aarch64 -L "$folder/root" -E "LD_LIBRARY_PATH=$(folders_of_libraries "$folder/root")" \
    "$folder/program/src/dynstiction"
}

folders_of_libraries() { printf '%s' "$1/usr/lib/aarch64-linux-gnu:$1/lib/aarch64-linux-gnu:$1/usr/lib/aarch64-linux-gnu/lapack:$1/usr/lib/aarch64-linux-gnu/blas"; }

link_arguments() {
  local folder arguments=()
  for folder in $(folders_of_libraries "$1" | tr ':' ' '); do
    arguments+=("'-L$folder'" "'-Wl,-rpath-link,$folder'")
  done
  (IFS=,; printf '%s' "${arguments[*]}")
}

# HDF5, LAPACK, zlib and what they need, unpacked into a folder; the package manager of this machine is not changed.
libraries_for_aarch64() {
  local root=$1 apt=$checkout/build/aarch64/apt archive
  [[ ! -e $root/complete ]] || return 0
  mkdir -p "$root" "$apt"/{lists,archives}/partial
  : > "$apt/status"
  local options=(-o "Dir::State::lists=$apt/lists" -o "Dir::State::status=$apt/status" -o "Dir::Cache::archives=$apt/archives"
    -o "Dir::Cache::pkgcache=" -o "Dir::Cache::srcpkgcache=" -o APT::Architecture=arm64 -o APT::Architectures::=arm64
    -o Debug::NoLocking=true)
  apt-get "${options[@]}" update || return 1
  apt-get "${options[@]}" install -y --download-only --no-install-recommends libhdf5-dev liblapack-dev libgomp1 zlib1g-dev || return 1
  for archive in "$apt"/archives/*.deb; do
    dpkg -x "$archive" "$root" || return 1
  done
  # Debian's alternatives, which only an installation makes.
  ln -sf lapack-netlib.pc "$root/usr/lib/aarch64-linux-gnu/pkgconfig/lapack.pc"
  ln -sf blas-netlib.pc "$root/usr/lib/aarch64-linux-gnu/pkgconfig/blas.pc"
  ln -sf hdf5-serial.pc "$root/usr/lib/aarch64-linux-gnu/pkgconfig/hdf5.pc"
  rm -rf "$apt"
  touch "$root/complete"
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
  for_aarch64
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
summary 'Compilers and processors'
