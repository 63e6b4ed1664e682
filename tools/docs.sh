#!/usr/bin/env bash
# tools/docs.sh: makes the manual, build/docs/index.html. Installs what is missing, as tools/run.sh does, and the tools of
# docs/requirements.txt into build/docs-venv. Any warning is an error. Takes about three minutes.

source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

help_if_wanted "$@"
(($# == 0)) || die "it takes no arguments; see tools/docs.sh --help"
manual=$checkout/build/docs
tools=$checkout/build/docs-venv
log=$checkout/build/docs.log

# The tools of the manual, and the package of .venv beside them.
create_tools() {
  local requirements=$checkout/docs/requirements.txt
  is_whole "$tools" "$requirements" || new_environment "$tools" "$requirements"
}

# FORD's pages would fetch style sheets and scripts from the network; docs/ford.css takes their place.
cut_network() {
  "$python" - "$1" << 'END'
import re, sys
from pathlib import Path

for page in Path(sys.argv[1]).rglob("*.html"):
    text = page.read_text(encoding="utf-8")
    page.write_text(re.sub(r"<link [^>]*https://cdn[^>]*>|<script [^>]*https://cdn[^>]*></script>", "", text), encoding="utf-8")
END
}

# quietly WHAT COMMAND...: its output goes to the log and is shown if it fails.
quietly() {
  say "$1 ..."
  busy "$log" '^(reading sources|writing output|Processing|Generating).*' "${@:2}" || { cat "$log" >&2; die "$1 failed: see above"; }
}

make_manual() {
  local notebook name
  create_tools
  quietly 'Making the manual' env PYTHONPATH="$(echo "$venv"/lib/python*/site-packages)" \
    "$tools/bin/sphinx-build" -W --keep-going -E -a -b html -d "$checkout/build/doctrees" "$checkout/docs" "$manual"
  for notebook in "$checkout"/docs/notebooks/*.ipynb; do
    name=$(basename "$notebook" .ipynb)
    grep -q '<img[^>]*_images/' "$manual/notebooks/$name.html" || die "the notebook $name draws no figure"
  done
  quietly 'Making the pages of the Fortran modules' "$tools/bin/ford" -o "$manual/fortran" "$checkout/docs/ford.md"
  ! grep -i warning "$log" || die 'FORD warns: see above'
  cut_network "$manual/fortran"
}

prepare
build_program -Dtests=false
locked make_manual
printf '%s\n' "$manual/index.html"
