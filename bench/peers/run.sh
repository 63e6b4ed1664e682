#!/usr/bin/env bash
# Benchmark against other solvers: installs what is missing (Debian packages), builds, measures, and writes bench/peers/peers.csv and bench/peers/peers.png.
#     bench/peers/run.sh [--rounds N] [--only PEER...] [--draw] [--short]
# --only: measures these alone.
# --short: in half a minute whether it still runs, with the peers that are quick to install, odeint and SciPy.

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
source "$here/../../tools/setup.sh"
help_if_wanted "$@"

debian_packages+=(g++ libboost-dev)
is_short=no
[[ " $* " != *' --short '* ]] || is_short=yes
[[ $is_short == yes ]] || debian_packages+=(libsundials-dev libsiconos-numerics-dev)
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
if [[ $is_short == no ]]; then
  # Debian's SUNDIALS headers need those of MPI.
  compile mpicxx cvode -lsundials_cvode -lsundials_nvecserial
  compile g++ siconos -isystem /usr/include/siconos/numerics -isystem /usr/include/siconos -lsiconos_numerics
fi
exec "$venv/bin/python" "$here/run.py" "$@"
