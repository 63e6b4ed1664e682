#!/usr/bin/env bash
# bench/short.sh: every benchmark in its short form, a few seconds each, to see that it still runs; nothing is measured.
# One that fails, or prints nothing, is named, with the end of what it printed.

source "$(dirname "${BASH_SOURCE[0]}")/../tools/setup.sh"

help_if_wanted "$@"
passed=0
failed=0
log=$(mktemp)
trap 'rm -f "$log"' EXIT

# short NAME COMMAND...
short() {
  local name=$1 begin=$SECONDS
  shift
  if "$@" > "$log" 2> "$log.errors" < /dev/null && [[ -s $log ]]; then
    passed=$((passed + 1))
    say "ok    $name, $((SECONDS - begin)) s"
  else
    failed=$((failed + 1))
    say "FAIL  $name: $*"
    [[ -s $log ]] || say '      printed nothing'
    tail -n 20 "$log" "$log.errors" | sed 's/^/      /' >&2
  fi
  rm -f "$log.errors"
}

prepare test
build_program -Dtests=false
cd "$checkout"
for file in bench/*.py; do
  short "${file##*/}" python "$file" --short
done
short peers/run.sh bench/peers/run.sh --short
printf 'Benchmarks: %d passed, %d failed\n' "$passed" "$failed"
((failed == 0))
