#!/usr/bin/env bash
# tests/package/parallel_hdf5.sh: with an HDF5 that was built for MPI the program writes the same numbers. Skipped where there is none.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"

help_if_wanted "$@"

if ! have h5pcc || ! have mpifort; then
  printf 'Parallel HDF5: skipped, h5pcc or mpifort is not installed (Debian: libhdf5-openmpi-dev)\n'
  exit 0
fi
prepare
build_program -Dtests=false
folder=$checkout/build/parallel_hdf5
rm -rf "$folder"
configure "$folder" --native-file "$checkout/tools/parallel_hdf5.ini" -Dmpi=enabled -Dpython=false -Dtests=false
compile_in "$folder" src/dynstiction

run() { "$1" run "$checkout/inputs/fig3.nml" -o "$scratch/$2" --quiet --set scene.t_end=2.5; }

check 'the HDF5 is a parallel one' grep -x 'HDF5: .*(parallel)' <("$folder/src/dynstiction" --version)
check 'the other build has a serial one' grep -x 'HDF5: .*(serial)' <("$release/src/dynstiction" --version)
check 'a run' run "$folder/src/dynstiction" parallel.h5
check 'a run with serial HDF5' run "$release/src/dynstiction" serial.h5
check 'the same numbers' h5diff "$scratch/parallel.h5" "$scratch/serial.h5" /time_series /time_series

summary 'Parallel HDF5'
