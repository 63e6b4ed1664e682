#!/usr/bin/env bash
# Benchmark against other solvers: installs what is missing (Debian packages), builds, measures, and writes bench/peers/peers.csv and bench/peers/peers.png.
#     bench/peers/run.sh [--rounds N] [--only PEER...] [--draw] [--short]
# --only: installs and builds these alone.
# --short: in half a minute whether it still runs, with the peers that are quick to install, odeint and SciPy.

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
! wanted CVODE || debian_packages+=(libsundials-dev)
! wanted Siconos || debian_packages+=(libsiconos-numerics-dev)
work=$checkout/build/peers

compile() {
  local compiler=$1 source=$2
  shift 2
  "$compiler" -std=c++17 -O3 -march=native -DNDEBUG -Wall -Wextra "$here/$source.cpp" -o "$work/$source" "$@"
}

prepare test
build_program -Dtests=false
mkdir -p "$work"
compile g++ odeint
if wanted CVODE; then
  # Debian's SUNDIALS headers need those of MPI.
  compile mpicxx cvode -lsundials_cvode -lsundials_nvecserial -lsundials_sunlinsoldense -lsundials_sunmatrixdense
fi
if wanted Siconos; then
  compile g++ siconos -isystem /usr/include/siconos/numerics -isystem /usr/include/siconos -lsiconos_numerics
fi
exec "$venv/bin/python" "$here/run.py" "$@"
