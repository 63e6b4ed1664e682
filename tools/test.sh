#!/usr/bin/env bash
# tools/test.sh [--quick | --full]: installs what is missing, builds, and runs every test.
# --quick leaves out the build with run-time checks; --full adds the heavier proofs, and the build in quadruple precision.

source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

with_debug=yes
with_quad=no
selection=(-m 'not full')
for argument in "$@"; do
  case $argument in
    --quick) with_debug=no ;;
    --full) selection=() with_quad=yes DYNSTICTION_FULL=1; export DYNSTICTION_FULL ;;
    *) die "unknown option $argument: tools/test.sh [--quick | --full]" ;;
  esac
done

debug=$checkout/build/debug
quad=$checkout/build/quad
checks='-fcheck=all -ffpe-trap=invalid,zero,overflow -fbacktrace'
summaries=()
failed=0

# run_tests TITLE PATTERN COMMAND...: run, and keep the runner's own summary lines.
run_tests() {
  local title=$1 pattern=$2 log=$checkout/build/tests.log summary
  shift 2
  say "== $title"
  "$@" < /dev/null 2>&1 | tee "$log" || failed=1
  summary=$(grep -E "$pattern" "$log" | tr -s ' ' | tr '\n' ' ') || summary='did not run: see above'
  summaries+=("$title: $summary")
}

unit_tests() { run_tests "$1" '^(Ok|Fail|Expected Fail|Skipped|Timeout):' meson test -C "$2" --no-rebuild --print-errorlogs; }
python_tests() {
  run_tests "$1" '^=+ .*(passed|failed|error|skipped|no tests ran).* =+$' python -m pytest "${@:2}" "$checkout"/tests/{python,extremes}
}

prepare
build_release
cd "$checkout"
export DYNSTICTION_EXE=$venv/bin/dynstiction
if [[ $with_quad == yes ]]; then
  build "$quad" -Dprecision=quad
  export DYNSTICTION_QUAD_EXE=$quad/src/dynstiction-quad
  unit_tests 'Fortran unit tests in quadruple precision' "$quad"
fi
unit_tests 'Fortran unit tests' "$release"
python_tests 'Python tests' ${selection[@]+"${selection[@]}"}

if [[ $with_debug == yes ]]; then
  build "$debug" -Dpython=false -Doptimization=1 -Ddebug=true "-Dfortran_args=$checks"
  export DYNSTICTION_EXE=$debug/src/dynstiction
  unit_tests 'Fortran unit tests with run-time checks' "$debug"
  python_tests 'Decks with run-time checks' -m 'deck and not full'
fi

printf '\n'
printf '%s\n' "${summaries[@]}"
exit $failed
