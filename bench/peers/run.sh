#!/usr/bin/env bash
# Benchmark against other solvers: installs what is missing, builds, measures, and writes bench/peers/peers.csv and bench/peers/peers.png.
#     bench/peers/run.sh [--rounds N] [--only PEER...] [--long] [--draw] [--short]
# --only: installs and builds these alone.
# --short: in half a minute whether it still runs, with the peers that are quick to install, odeint and SciPy.
# In addition to what tools/test.sh installs: the Debian packages below, and Python packages into build/peers/.

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
source "$here/../../tools/setup.sh"
help_if_wanted "$@"

# The peers after --only, with --short odeint, else all.
only=
choosing=no
for word; do
  case $word in
    --only) choosing=yes ;;
    --short) only=' odeint ' && break ;;
    --*) choosing=no ;;
    *) [[ $choosing == no ]] || only+=" $word " ;;
  esac
done

# wanted PEER...: one of them is to be measured.
wanted() {
  local peer
  [[ -n $only ]] || return 0
  for peer; do
    [[ $only != *" $peer "* ]] || return 0
  done
  return 1
}

debian_packages+=(g++ libboost-dev)
# cmake builds numbalsoda.
! wanted numbalsoda SciPy || debian_packages+=(cmake)
! wanted CVODE ARKODE || debian_packages+=(libsundials-dev)
! wanted Siconos || debian_packages+=(libsiconos-kernel-dev libsiconos-numerics-dev)
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

prepare test
build_program -Dtests=false
mkdir -p "$work"
compile g++ odeint
! wanted numbalsoda SciPy || peer_environment venv "numpy scipy numba numbalsoda"
# pyradau13 0.5 does not compile against NumPy 2, whose headers define I.
! wanted pyradau13 || peer_environment venv_radau13 "numpy<2 setuptools<70 wheel" pyradau13
! wanted nosnoc || peer_environment venv_nosnoc "nosnoc==0.2.0"
if wanted CVODE ARKODE; then
  # Debian's SUNDIALS headers need those of MPI.
  compile mpicxx sundials -lsundials_cvode -lsundials_arkode -lsundials_nvecserial -lsundials_sunlinsoldense -lsundials_sunmatrixdense
fi
if wanted Siconos; then
  compile g++ siconos -isystem /usr/include/siconos/kernel -isystem /usr/include/siconos/numerics -isystem /usr/include/siconos -lsiconos_kernel -lsiconos_numerics
fi
exec "$venv/bin/python" "$here/run.py" "$@"
