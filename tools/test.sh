#!/usr/bin/env bash
# tools/test.sh [--release | --standard | --full | --sanitize] [--cluster] [--package] [--bench]
#
# Installs what is missing, builds and tests. Says first how long that takes; the last line is "all passed", or lists what failed.
# Without an option it tests an installation: unit tests, reference results, models, decks, the Python package and a figure.
#
#   --release    every unit test and Python test, and fuzzing, with the build that is installed
#   --standard   also builds with run-time checks and sanitizers, and line coverage
#   --full       also the heavier proofs, the decks under the sanitizers, and the build in quadruple precision
#   --sanitize   the sanitizers and valgrind alone
#
# In addition to any of these:
#
#   --cluster    shares of sweeps through a real Slurm; executors over MPI and dask
#   --package    wheel, source archive, library, lowest versions, other compilers, manual and notebooks;
#                with --full also recipes of distributors, and every compiler
#   --bench      the short forms of all benchmarks
#
# The output of each set of tests is in build/tests. See tests/README.md.

source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

level=proof
extras=()
for argument in "$@"; do
  case $argument in
    --release | --standard | --full | --sanitize) level=${argument#--} ;;
    --cluster | --package | --bench) extras+=("${argument#--}") ;;
    -h | --help) help_if_wanted --help ;;
    *) die "unknown option $argument; see tools/test.sh --help" ;;
  esac
done

is_wanted() { [[ " ${extras[*]-} " == *" $1 "* ]]; }

debug=$checkout/build/debug
quad=$checkout/build/quad
sanitized=$checkout/build/sanitized
threaded=$checkout/build/threaded
checks='-fcheck=all -ffpe-trap=invalid,zero,overflow -fbacktrace'
results=$checkout/build/tests
python_summary='^=+ .*(passed|failed|error|skipped|no tests ran).* =+$'

# Reference results, models, decks, the Python package, commands of Python, and a figure.
proof=("$checkout"/tests/python/test_{references,models,decks,python_api,handover}.py
  "$checkout/tests/python/test_plots.py::test_command_draws_a_file")

# Minutes on two idle cores.
declare -A minutes=([proof]=2 [release]=8 [standard]=20 [full]=60 [sanitize]=3 [cluster]=4 [package]=15 [bench]=3)

say_how_long() {
  local part total=${minutes[$level]} shared=0
  for part in ${extras[@]+"${extras[@]}"}; do
    shared=$((shared + ${minutes[$part]}))
  done
  # In two lists.
  total=$((total + (shared + 1)/2))
  say "This takes about $total minutes$([[ $level != full ]] || echo ' or more') on two idle cores, and up to two more the first time."
  [[ $level != proof ]] || say 'Every test: tools/test.sh --standard. All options: tools/test.sh --help'
}

# run_tests TITLE PATTERN COMMAND...: run the command, and keep the summary lines of the test runner. If sets run side by side,
# their output goes to a file, and is shown if they fail.
side_by_side=no
run_tests() {
  local title=$1 pattern=$2 begin=$SECONDS status=0 log summary
  log=$results/$(tr -cs '[:alnum:]\n' _ <<< "$1").log
  shift 2
  if [[ $side_by_side == yes ]]; then
    say "== $title: begins"
    touch "${log%.log}.running"
    "$@" < /dev/null > "$log" 2>&1 || status=$?
    rm -f "${log%.log}.running"
    ((status == 0)) || sed "s/^/[$title] /" "$log" >&2
  else
    say "== $title"
    "$@" < /dev/null 2>&1 | tee "$log" || status=$?
  fi
  summary=$(grep -aE "$pattern" "$log" | tr -d '=' | tr -s ' ' | tr '\n' ' ') || summary='did not run: see above'
  [[ $side_by_side == no ]] || say "== $title: ends after $((SECONDS - begin)) s, $([[ $status == 0 ]] && echo passed || echo FAILED)"
  add_summary "$title" "$status" "$summary"
}

# One line at a time: sets that run side by side write into one file.
add_summary() { printf '%s\t%s\t%s\n' "$2" "$1" "$3" >> "$results/summary.txt"; }

# in_two_lists SET...: run sets, each a function and its arguments, in two lists at the same time: a list that has finished a set
# takes the next one. Twice a minute a line names the running sets.
lists=()
in_two_lists() {
  local list silence next=$((SECONDS + 30))
  side_by_side=yes
  # Processes in separate groups: they receive Ctrl-C, and end with this script.
  set -m
  for list in first second; do
    take_sets "$list" "$@" < /dev/null &
    lists+=($!)
  done
  set +m
  exec {silence}<> <(:)
  while kill -0 "${lists[@]}" 2> /dev/null; do
    read -r -t 1 -u "$silence" || true
    ((SECONDS >= next)) || continue
    next=$((SECONDS + 30))
    say "  $SECONDS s: $(cd "$results" && ls -- *.running 2> /dev/null | sed 's/\.running$//' | tr '\n' ' ')"
  done
  for list in "${lists[@]}"; do
    wait "$list" || add_summary 'A list of sets' 1 'ended early: see above'
  done
  lists=()
  side_by_side=no
}
# The second list has a lower priority: sweeps on a cluster, which the first one takes, need the processor at once.
take_sets() {
  local set
  [[ $1 == first ]] || renice -n $(($(nice) < 9 ? $(nice) + 10 : 19)) -p "$BASHPID" > /dev/null
  for set in "${@:2}"; do
    # shellcheck disable=SC2086  # a function and its arguments
    ! mkdir "$results/$set.taken" 2> /dev/null || $set
  done
}
end_lists() {
  local list
  for list in ${lists[@]+"${lists[@]}"}; do
    kill -TERM -- "-$list" 2> /dev/null || true
  done
}
trap end_lists EXIT
trap 'exit 143' TERM

# unit_tests TITLE FOLDER [OPTION of meson test]...
unit_tests() {
  run_tests "$1" '^(Ok|Fail|Expected Fail|Skipped|Timeout):' meson test -C "$2" --no-rebuild --print-errorlogs "${@:3}"
}

# python_tests TITLE [OPTION of pytest]... FILE...: on all cores; the tests of a file stay together, because they share fixtures.
python_tests() {
  run_tests "$1" "$python_summary" python -m pytest -n auto --dist loadfile --durations=10 --durations-min=5 "${@:2}"
}
all_python=("$checkout"/tests/{python,extremes,audit,invariance})

# Lines of src/ that the tests of the checked build reach, by file: lines, share, name; the last row is the total. The flat layer
# for Python is not in that build.
print_coverage() {
  local table=$checkout/build/coverage.txt
  say '== Line coverage of src/ by the tests with run-time checks'
  (cd "$debug" && find src -name '*.gcda' -exec gcov --no-output --relative-only {} +) 2> /dev/null | awk '
    /^File / { name = $2; gsub(/.*\/|\047/, "", name); wanted = $2 ~ /src\// && name != "python_api.f90" }
    /^Lines executed:/ && wanted {
      split($2, part, /[:%]/); lines = $4; reached = part[2]*lines/100; all += lines; all_reached += reached; wanted = 0
      printf "%6d %6.1f %%  %s\n", lines, part[2], name | "sort -k2 -n"
    }
    END { close("sort -k2 -n"); printf "%6d %6.1f %%  total\n", all, 100*all_reached/all }' | tee "$table"
  add_summary 'Line coverage of src/' 0 "$(awk 'END { print $2, $3 }' "$table")"
}

# One short run.
memcheck() {
  have valgrind || {
    add_summary Valgrind 0 'skipped, valgrind is not installed'
    return
  }
  run_tests 'Valgrind on a short run' 'ERROR SUMMARY' valgrind --error-exitcode=1 --child-silent-after-fork=yes --leak-check=full --errors-for-leak-kinds=definite \
    "$release/src/dynstiction" run inputs/fig3.nml --set scene.t_end=0.05 --quiet --overwrite -o "$checkout/build/memcheck.h5"
}

# Shares of sweeps through a real Slurm on this machine; executors, unless all Python tests run anyway.
cluster_tests() {
  run_tests 'Sweeps through Slurm' "($python_summary)|skipped:" "$checkout/tests/slurm/run.sh" "$DYNSTICTION_EXE"
  [[ $level != proof && $level != sanitize ]] ||
    python_tests 'Executors' -m 'not full' "$checkout"/tests/python/test_{executors,many_tasks}.py
}

benchmarks() { run_tests 'Benchmarks, short' '^Benchmarks:' "$checkout/bench/short.sh"; }

package() { run_tests "Package, $1.sh" '(passed|failed|skipped)' "$checkout/tests/package/$1.sh"; }
# The newest versions are those of this environment; the lower bounds are tried with the source archive.
bounds() {
  run_tests 'Bounds of the requirements' "$python_summary|[0-9]+ passed" "$checkout/tests/package/bounds.sh" $([[ $level == full ]] || echo lowest)
}
compilers() { run_tests 'Other compilers' '(passed|failed|skipped)' "$checkout/tests/package/compilers.sh" $([[ $level != full ]] || echo --full); }

# Making the manual runs the notebooks. If all Python tests have run, only the heavy tests of these files are left.
manual() { run_tests 'Manual' '(build/docs/index.html|failed)' "$checkout/tools/docs.sh"; }
pages() {
  run_tests 'Pages that change the source' "$python_summary" \
    python -m pytest $([[ $level == proof || $level == sanitize ]] || printf -- '-m full') "$checkout"/tests/python/test_{howto,documented}.py
}

tests_with_checks() {
  build "$debug" -Dpython=false -Doptimization=1 -Ddebug=true -Dwerror=true -Db_coverage=true "-Dfortran_args=$checks"
  find "$debug" -name '*.gcda' -delete
  unit_tests 'Fortran unit tests with run-time checks' "$debug"
  # Files, streams and messages compute nothing that these do not; with --full all of them run.
  local decks=("$checkout"/tests/{extremes,audit,invariance} "$checkout"/tests/python/test_{references,models,decks,damping,stability,cycle_map,limit_cycles,lanes}.py)
  # The steps of radau5 are those of the other two with other coefficients, and many more; the unit tests have them.
  local share=(-k 'not radau5')
  [[ $level != full ]] || decks=("${all_python[@]}") share=()
  # The tests of extreme scenes are one file, and share nothing.
  DYNSTICTION_EXE=$debug/src/dynstiction python_tests 'Decks with run-time checks' --dist worksteal -m 'deck and not full' \
    ${share[@]+"${share[@]}"} "${decks[@]}"
  print_coverage
}

tests_with_sanitizers() {
  # libgfortran and HDF5 keep their buffers until the program ends.
  export ASAN_OPTIONS=detect_leaks=0
  build "$sanitized" -Dpython=false -Doptimization=1 -Ddebug=true -Db_sanitize=address,undefined -Db_lundef=false \
    -Dfortran_args=-fno-sanitize-recover=all -Dc_args=-fno-sanitize-recover=all
  unit_tests 'Fortran unit tests with AddressSanitizer and UBSan' "$sanitized" $([[ $level == full ]] || printf -- '--no-suite long')
  if [[ $level == full ]]; then
    DYNSTICTION_EXE=$sanitized/src/dynstiction python_tests 'Decks with AddressSanitizer and UBSan' -m 'deck and not full' "${all_python[@]}"
  fi
  memcheck
  configure "$threaded" -Dpython=false -Doptimization=1 -Ddebug=true -Db_sanitize=thread -Db_lundef=false
  compile_in "$threaded" tests/threads/run_threads
  unit_tests 'Threads with ThreadSanitizer' "$threaded" threads
}

checks_more() { [[ $level == standard || $level == full || $level == sanitize ]]; }

# A function, so that the script is read to its end before it begins, and may be changed during its run.
main() {
  say_how_long
  local environments=(test) failed
  [[ $level == proof || $level == sanitize ]] || environments+=(manual)
  if is_wanted cluster; then
    debian_packages+=(openmpi-bin slurm-wlm munge parallel)
  fi
  if is_wanted package; then
    debian_packages+=(patch musl-tools)
    [[ $level != full ]] || debian_packages+=(debhelper dh-python)
    environments+=(package)
  fi
  ! is_wanted bench || debian_packages+=(g++ libboost-dev)
  prepare "${environments[@]}"
  ! is_wanted cluster || (add_requirements cluster) || say 'No dask or mpi4py: their tests are skipped'
  if is_wanted package; then
    # Without other compilers the program is built only by gfortran.
    have flang-new-22 || (apt_install flang-22 libflang-22-dev) || (apt_install flang-19 libflang-19-dev) || say 'No flang: a compiler is left out'
    [[ $level != full ]] || (apt_install gfortran-11) || say 'No older gfortran: it is left out'
  fi
  build_release
  # Scripts that are called from here find everything installed.
  export DYNSTICTION_PREPARED=$checkout DYNSTICTION_EXE=$venv/bin/dynstiction
  cd "$checkout"
  # A bounded run has the same random scenes each time: a rare scene would turn any change red. With --full they are new.
  [[ $level == full ]] || export DYNSTICTION_SEED=${DYNSTICTION_SEED:-20201}
  mkdir -p "$results"
  rm -rf "${results:?}"/*

  if [[ $level == full ]]; then
    export DYNSTICTION_FULL=1
    build "$quad" -Dprecision=quad
    export DYNSTICTION_QUAD_EXE=$quad/src/dynstiction-quad
    unit_tests 'Fortran unit tests in quadruple precision' "$quad"
  fi

  case $level in
    proof)
      unit_tests 'Fortran unit tests' "$release" --no-suite fuzz
      python_tests 'Python tests' -m 'not full' "${proof[@]}"
      ;;
    release | standard)
      unit_tests 'Fortran unit tests' "$release"
      python_tests 'Python tests' -m 'not full' "${all_python[@]}"
      ;;
    full)
      unit_tests 'Fortran unit tests' "$release"
      python_tests 'Python tests' "${all_python[@]}"
      ;;
  esac

  # What takes long comes early, so that both lists end at about the same time.
  local sets=()
  ! is_wanted cluster || sets+=(cluster_tests)
  ! is_wanted package || sets+=(bounds 'package wheel')
  [[ $level != standard && $level != full ]] || sets+=(tests_with_checks)
  ! checks_more || sets+=(tests_with_sanitizers)
  ! is_wanted package || sets+=('package without_hdf5' compilers manual 'package meson_install' pages)
  ! is_wanted package || [[ $level != full ]] || sets+=('package sdist' 'package recipes')
  ! is_wanted bench || sets+=(benchmarks)
  ((${#sets[@]} == 0)) || in_two_lists "${sets[@]}"

  printf '\n'
  sort -s -k1,1n "$results/summary.txt" | cut -f 2,3 | sed 's/\t/: /'
  failed=$(awk -F '\t' '$1 > 0 { printf "%s%s", between, $2; between = "; " }' "$results/summary.txt")
  if [[ -n $failed ]]; then
    printf 'failed after %d min: %s\n' $(((SECONDS + 30)/60)) "$failed"
    exit 1
  fi
  printf 'all passed, in %d min\n' $(((SECONDS + 30)/60))
}

main
exit
