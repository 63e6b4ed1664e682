#!/usr/bin/env bash
# Benchmark against other solvers: installs what is missing, builds, measures, and writes docs/peers.csv and docs/peers.png.
#     bench/peers/run.sh [--rounds N] [--only PEER...] [--long] [--draw] [--short]
# --short: in half a minute whether it still runs, with the peers that are quick to install, odeint and SciPy.
# Besides what tools/test.sh installs: the Debian packages below, and Python packages into build/peers/.

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
source "$here/../../tools/setup.sh"

short=no
[[ " $* " != *' --short '* ]] || short=yes
debian_packages+=(g++ libboost-dev)
# cmake builds numbalsoda.
[[ $short == yes ]] || debian_packages+=(cmake libsundials-dev)
work=$checkout/build/peers

# peer_environment FOLDER 'PACKAGE...' [LATER PACKAGE]: the last one needs the others to build.
peer_environment() {
  local folder=$work/$1 first=$2 later=${3:-}
  [[ -e $folder/installed ]] && return
  say "Installing into $folder: $first $later"
  rm -rf "$folder"
  "$python" -m venv "$folder"
  # shellcheck disable=SC2086
  "$folder/bin/python" -m pip install --quiet --disable-pip-version-check $first >&2 || { say "not available: $first"; return; }
  if [[ -n $later ]]; then
    "$folder/bin/python" -m pip install --quiet --disable-pip-version-check --no-build-isolation "$later" >&2 ||
      { say "not available: $later"; return; }
  fi
  touch "$folder/installed"
}

compile() {
  local compiler=$1 source=$2
  shift 2
  "$compiler" -std=c++17 -O3 -march=native -DNDEBUG -Wall -Wextra "$here/$source.cpp" -o "$work/$source" "$@"
}

prepare
build_release
mkdir -p "$work"
compile g++ odeint
if [[ $short == no ]]; then
  peer_environment venv "numpy scipy numba numbalsoda"
  # pyradau13 0.5 does not compile against NumPy 2, whose headers define I.
  peer_environment venv_radau13 "numpy<2 setuptools<70 wheel" pyradau13
  # Debian's SUNDIALS headers need those of MPI.
  compile mpicxx sundials -lsundials_cvode -lsundials_arkode -lsundials_nvecserial -lsundials_sunlinsoldense -lsundials_sunmatrixdense
fi
exec "$venv/bin/python" "$here/run.py" "$@"
