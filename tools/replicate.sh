#!/usr/bin/env bash
# tools/replicate.sh [--page]: what the paper says, and what holds: runs a command for each claim and prints them as a table, with the
# value expected and the value found. With --page the table of docs/claims.md is written anew. Installs what is missing, as tools/run.sh
# does; the commands take ten seconds. The exit status is 1 if a value is not as expected.

source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

help_if_wanted "$@"
prepare
build_program -Dtests=false
exec "$venv/bin/python" "$checkout/tools/replicate.py" "$@"
