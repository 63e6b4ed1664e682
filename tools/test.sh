#!/usr/bin/env bash
# tools/test.sh [--quick | --full | --sanitize] [--cluster] [--package] [--bench] [--mutation]: installs what is missing, builds, and runs every test.
# --quick leaves out the builds with run-time checks and sanitizers; --full adds the heavier proofs, the decks under the
# sanitizers and the build in quadruple precision; --sanitize runs the sanitizers and valgrind alone. --cluster adds sweeps on
# real MPI and Slurm, --package wheel, source archive, library, manual and notebooks, --bench the short forms of all benchmarks,
# --mutation 25 small changes of the core that the tests must notice. See docs/testing.md.

source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

with_release=yes
with_debug=yes
with_sanitizers=yes
with_quad=no
with_cluster=no
with_package=no
with_bench=no
with_mutation=no
selection=(-m 'not full')
for argument in "$@"; do
  case $argument in
    --quick) with_debug=no with_sanitizers=no ;;
    --sanitize) with_release=no with_debug=no ;;
    --full) selection=() with_quad=yes DYNSTICTION_FULL=1; export DYNSTICTION_FULL ;;
    --cluster) with_cluster=yes ;;
    --package) with_package=yes ;;
    --bench) with_bench=yes ;;
    --mutation) with_mutation=yes ;;
    *) die "unknown option $argument: tools/test.sh [--quick | --full | --sanitize] [--cluster] [--package] [--bench] [--mutation]" ;;
  esac
done

debug=$checkout/build/debug
quad=$checkout/build/quad
sanitized=$checkout/build/sanitized
threaded=$checkout/build/threaded
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
# On all cores; a file's tests stay together, for what they share.
python_tests() {
  run_tests "$1" '^=+ .*(passed|failed|error|skipped|no tests ran).* =+$' python -m pytest -n auto --dist loadfile \
    "${@:2}" "$checkout"/tests/{python,extremes,audit}
}

# What the tests of the checked build have reached of src/, by file: lines, share, name; last the total. The flat layer for
# Python is not in that build.
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
  summaries+=("Line coverage of src/: $(awk 'END { print $2, $3 }' "$table")")
}

# One short run.
memcheck() {
  if ! have valgrind; then
    summaries+=('Valgrind: skipped, valgrind is not installed')
    return
  fi
  run_tests 'Valgrind on a short run' 'ERROR SUMMARY' valgrind --error-exitcode=1 --child-silent-after-fork=yes --leak-check=full --errors-for-leak-kinds=definite \
    "$release/src/dynstiction" run inputs/fig3.nml --set scene.t_end=0.05 --quiet --overwrite -o "$checkout/build/memcheck.h5"
}

# Engines that run the shards of a sweep; without them their tests are skipped.
install_engines() {
  python -m pip install --quiet --disable-pip-version-check hyperqueue distributed >&2 || say 'pip could not install the engines for shards'
}

# Sweeps over real MPI processes and through a real Slurm, on this machine.
cluster_tests() {
  run_tests 'Sweeps over MPI' '(^=+ .*(passed|failed|error|skipped|no tests ran).* =+$)|skipped' "$checkout/tests/mpi/run.sh" "$checkout/build/mpi"
  run_tests 'Sweeps through Slurm' '(^=+ .*(passed|failed|error|skipped|no tests ran).* =+$)|skipped:' "$checkout/tests/slurm/run.sh" \
    "$DYNSTICTION_EXE" "$checkout/build/mpi/openmpi/src/dynstiction" pmix "$checkout/build/mpi/mpich/src/dynstiction" pmi2
}

# What a user installs, and the manual.
package_tests() {
  local script
  # Without a browser the report is not looked at, and a line says so.
  have chromium || (apt_install chromium) || say 'No chromium: the report is not opened in a browser'
  for script in sdist meson_install wheel parallel_hdf5; do
    run_tests "Package, $script.sh" '(passed|failed|skipped)' "$checkout/tests/package/$script.sh"
  done
  have flang-new-19 || (apt_install flang-19) || say 'No flang: the core is compiled by gfortran alone'
  ! have flang-new-19 || run_tests 'The core with another compiler' '(files compiled|does not compile)' \
    python "$checkout/tools/second_compiler.py" flang-new-19
  run_tests 'Manual' '(build/docs/index.html|failed)' "$checkout/tools/docs.sh"
  run_tests 'Pages that change the source, notebooks, report' '^=+ .*(passed|failed|error|skipped|no tests ran).* =+$' \
    python -m pytest "$checkout"/tests/python/test_{howto,notebooks,report,documented}.py
}

[[ $with_cluster == no ]] || debian_packages+=(libopenmpi-dev openmpi-bin libmpich-dev mpich slurm-wlm munge parallel)
[[ $with_package == no ]] || debian_packages+=(patch musl-tools)
prepare
[[ $with_cluster == no ]] || install_engines
build_release
cd "$checkout"
export DYNSTICTION_EXE=$venv/bin/dynstiction
if [[ $with_quad == yes ]]; then
  build "$quad" -Dprecision=quad
  export DYNSTICTION_QUAD_EXE=$quad/src/dynstiction-quad
  unit_tests 'Fortran unit tests in quadruple precision' "$quad"
fi
if [[ $with_release == yes ]]; then
  unit_tests 'Fortran unit tests' "$release"
  python_tests 'Python tests' ${selection[@]+"${selection[@]}"}
fi

[[ $with_cluster == no ]] || cluster_tests
[[ $with_package == no ]] || package_tests
[[ $with_bench == no ]] || run_tests 'Benchmarks, short' '^Benchmarks:' "$checkout/bench/short.sh" "$checkout/build/mpi"
[[ $with_mutation == no ]] || run_tests 'Small changes of the core that the tests notice' '^[0-9]+ passed, [0-9]+ failed$' \
  python "$checkout/tests/mutation/mutate.py" --count 25 --jobs "$(nproc)"

if [[ $with_debug == yes ]]; then
  build "$debug" -Dpython=false -Doptimization=1 -Ddebug=true -Dwerror=true -Db_coverage=true "-Dfortran_args=$checks"
  find "$debug" -name '*.gcda' -delete
  export DYNSTICTION_EXE=$debug/src/dynstiction
  unit_tests 'Fortran unit tests with run-time checks' "$debug"
  python_tests 'Decks with run-time checks' -m 'deck and not full'
  print_coverage
fi

if [[ $with_sanitizers == yes ]]; then
  # libgfortran and HDF5 keep their buffers until the program ends.
  export ASAN_OPTIONS=detect_leaks=0 DYNSTICTION_EXE=$sanitized/src/dynstiction
  build "$sanitized" -Dpython=false -Doptimization=1 -Ddebug=true -Db_sanitize=address,undefined -Db_lundef=false \
    -Dfortran_args=-fno-sanitize-recover=all -Dc_args=-fno-sanitize-recover=all
  unit_tests 'Fortran unit tests with AddressSanitizer and UBSan' "$sanitized"
  if [[ ${DYNSTICTION_FULL:-} == 1 ]]; then
    python_tests 'Decks with AddressSanitizer and UBSan' -m 'deck and not full'
  fi
  memcheck
  build "$threaded" -Dpython=false -Doptimization=1 -Ddebug=true -Db_sanitize=thread -Db_lundef=false
  run_tests 'Threads with ThreadSanitizer' '^(Ok|Fail):' meson test -C "$threaded" --no-rebuild --print-errorlogs threads
fi

printf '\n'
printf '%s\n' "${summaries[@]}"
exit $failed
