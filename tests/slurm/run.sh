#!/usr/bin/env bash
# tests/slurm/run.sh EXE [MPI_EXE MPI_TYPE]... [PYTEST OPTION]...: sweeps through a Slurm of one node (cluster.sh), with the scripts of jobs/
# as they are (test_jobs.py). EXE is the program; MPI_EXE one built with MPI, of the type that srun knows (pmix for Open MPI, pmi2 for
# MPICH). With -m '' the whole matrix of faults is run. Where Slurm cannot be started it is skipped, with a line that says why.
# Needs root, the Debian packages slurm-wlm and munge, and python with h5py and pytest. Takes three to four minutes.
set -euo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  awk 'NR > 1 { if (!/^#/) exit; sub(/^# ?/, ""); print }' "$0"
  exit 0
fi

folder=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
DYNSTICTION_EXE=$(realpath "${1:?program}")
shift
export DYNSTICTION_EXE PYTHONPATH=$folder/../python
unset DYNSTICTION_OPENMPI_EXE DYNSTICTION_MPICH_EXE
while [[ ${2:-} == pm* ]]; do
  case $2 in
    pmix) variable=DYNSTICTION_OPENMPI_EXE ;;
    pmi2) variable=DYNSTICTION_MPICH_EXE ;;
    *) printf 'tests/slurm/run.sh: unknown type of MPI: %s\n' "$2" >&2; exit 1 ;;
  esac
  # A build that was skipped leaves no program; the tests say so.
  [[ ! -x $1 ]] || export "$variable=$(realpath "$1")"
  shift 2
done
status=0
"$folder/cluster.sh" python -m pytest -m 'not full' "$folder/test_jobs.py" "$@" || status=$?
# 77: there is no Slurm; a line has said why.
exit $((status == 77 ? 0 : status))
