# Sourced by the tests in this folder: counted checks, and a scratch folder that goes at the end.

source "$(dirname "${BASH_SOURCE[0]}")/../../tools/setup.sh"

passed=0
failed=0
skipped=0
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# check WHAT COMMAND...: count whether the command succeeds; of one that does not, show what it printed.
check() {
  local what=$1
  shift
  if "$@" > "$scratch/check.log" 2>&1; then
    passed=$((passed + 1))
    say "ok    $what"
  else
    failed=$((failed + 1))
    say "FAIL  $what: $*"
    sed 's/^/      /' "$scratch/check.log" >&2
  fi
}

skip() {
  say "skipped  $*"
  skipped=$((skipped + 1))
}

fails() { ! "$@"; }

# timed COMMAND...: run it, and keep its wall time [s] in `seconds`; one that fails ends the test.
timed() {
  local begin=$EPOCHREALTIME
  "$@" > "$scratch/timed.log" 2>&1 || {
    cat "$scratch/timed.log" >&2
    die "failed: $*"
  }
  seconds=$(python3 -c "print(f'{$EPOCHREALTIME - $begin:.1f}')")
}

# The files below a folder, by name.
files_below() { (cd "$1" && find . | sort); }

# unpacked_archive FOLDER: the source archive, made in .venv into $scratch/dist and unpacked there.
unpacked_archive() {
  (cd "$checkout" && python -m build --sdist --no-isolation --outdir "$scratch/dist" > "$scratch/build.log" 2>&1) || {
    cat "$scratch/build.log" >&2
    die 'no source archive: see above'
  }
  mkdir "$1"
  tar xzf "$scratch"/dist/*.tar.gz -C "$1" --strip-components=1
}

summary() {
  printf '%s: %d passed, %d failed, %d skipped\n' "$1" "$passed" "$failed" "$skipped"
  ((failed == 0))
}
