#!/usr/bin/env bash
# docs/make_tutorial_figures.sh: draws the pictures of docs/tutorial.md again, by the commands of that page.
# Needs `dynstiction` on the path: source .venv/bin/activate.
set -euo pipefail

figures=$(cd "$(dirname "${BASH_SOURCE[0]}")/figures" && pwd)
cd "$(mktemp -d)"
# The blocks of kind sh, one after another.
awk '/^```sh$/ { on = 1; next } /^```$/ { on = 0 } on' "$figures/../tutorial.md" > commands.sh
bash -euo pipefail commands.sh > log 2>&1 || { cat log >&2; exit 1; }
cp ten.png "$figures/tutorial_ten.png"
cp map.png "$figures/tutorial_map.png"
