#!/usr/bin/env bash
# tools/run.sh DECK [OPTION of "dynstiction run"]...
#
# Installs what is missing, builds the program, runs the deck and draws its figure. The first run takes one to two minutes and
# prints what it does; later runs take seconds. Writes NAME.h5 and NAME.png in the current folder for a deck NAME.nml, or FILE.h5 and FILE.png
# with -o FILE.h5; an earlier run's files are replaced.
#
# Needs Debian or Ubuntu (it installs the rest, into .venv and build beside this folder; compilers and libraries with apt-get), or another Unix
# with a Fortran and a C compiler, HDF5, LAPACK, pkg-config and Python 3.11 or later.
#
#     tools/run.sh inputs/fig3.nml
#     tools/run.sh inputs/fig3.nml -o phi2.h5 --set system.misalignment_deg=2

source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

help_if_wanted "$@"
(($# > 0)) || die "which deck? For example: tools/run.sh inputs/fig3.nml"
deck=$1
shift
[[ $deck != -* ]] || die "the deck comes first: tools/run.sh DECK $deck ...; see tools/run.sh --help"
[[ -r $deck ]] || die "$deck: no such deck; those of the paper are in $checkout/inputs"

file=$(basename "$deck" .nml).h5
named=no previous=
for argument in "$@"; do
  case $previous in -o | --output) file=$argument named=yes ;; esac
  case $argument in --output=*) file=${argument#--output=} named=yes ;; esac
  previous=$argument
done
[[ $named == yes ]] || set -- -o "$file" "$@"
picture=${file%.h5}.png

is_new=no
[[ -e $venv/bin/dynstiction ]] || is_new=yes
prepare_to_build
is_prepared || locked build_beside_packages
say "Running $deck"
# From here on the program itself handles Ctrl-C.
trap - INT
export DYNSTICTION_EXE=$venv/bin/dynstiction
"$DYNSTICTION_EXE" run "$deck" --overwrite "$@"
# Isolated from modules in the current folder.
MPLBACKEND=agg "$venv/bin/python" -I -m dynstiction plot "$file" -o "$picture"
printf '%s\n' "$file" "$picture"
if [[ $is_new == yes ]]; then
  say "For the command dynstiction and the Python package in this shell: source $(printf '%q' "$venv/bin/activate")"
fi
