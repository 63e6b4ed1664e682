#!/usr/bin/env bash
# tools/run.sh DECK [OPTION of "dynstiction run"]...: installs what is missing, builds, runs the deck and draws its figure.
# Writes NAME.h5 and NAME.png in the current folder for a deck NAME.nml; an earlier run's files are replaced.

source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

(($# > 0)) || die "which deck? For example: tools/run.sh inputs/fig3.nml"
deck=$1
shift
[[ -r $deck ]] || die "$deck: no such deck; see inputs/"

file=$(basename "$deck" .nml).h5
previous=
for argument in "$@"; do
  if [[ $previous == -o ]]; then file=$argument; fi
  previous=$argument
done
[[ " $* " == *' -o '* ]] || set -- -o "$file" "$@"
picture=${file%.h5}.png

prepare
build_release
dynstiction run "$deck" --overwrite "$@"
python -m dynstiction plot "$file" -o "$picture"
printf '%s\n' "$file" "$picture"
