#!/usr/bin/env bash
# tests/slurm/run.sh EXE [PYTEST OPTION]...: sweeps with the program EXE through a Slurm of one node (cluster.sh), with the scripts of
# jobs/ as they are (test_jobs.py). Where Slurm cannot be started it is skipped, with a line that says why.
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
status=0
"$folder/cluster.sh" python -m pytest "$folder/test_jobs.py" "$@" || status=$?
# 77: there is no Slurm; a line has said why.
exit $((status == 77 ? 0 : status))
