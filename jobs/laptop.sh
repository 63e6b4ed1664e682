#!/usr/bin/env bash
# A sweep on all cores of this machine. If it was stopped or killed, start it again: it continues.
#   jobs/laptop.sh inputs/map_lambda.nml map_lambda.h5          # what follows is passed to the program
set -euo pipefail
deck=${1:?deck with &sweep} output=${2:?result file}
shift 2
exec nice "${DYNSTICTION:-dynstiction}" run "$deck" -o "$output" "$@"
