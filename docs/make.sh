#!/usr/bin/env bash
# docs/make.sh PAGE...: makes again what a page of the manual shows, by this build: figures and generated pages in their places; tables
# and numbers are printed, to be compared. Each takes at most ten minutes on two cores; without an argument it lists the pages.

source "$(dirname "${BASH_SOURCE[0]}")/../tools/setup.sh"

figures=$checkout/docs/figures

# sweep DECK NAME [KEY=VALUE...]: the sweep of inputs/DECK.nml, with settings, as NAME.h5 in a folder that goes away.
sweep() {
  local settings=()
  for setting in "${@:3}"; do settings+=(--set "$setting"); done
  dynstiction run "$checkout/inputs/$1.nml" -o "$work/$2.h5" "${settings[@]}"
}

# shown LANGUAGE PAGE: runs in that folder what a page shows in this language.
shown() {
  awk -v begin="\`\`\`$1" '$0 == begin { on = 1; next } /^```$/ { on = 0 } on' "$checkout/docs/$2.md" > "$work/shown"
  if [[ $1 == sh ]]; then (cd "$work" && bash -euo pipefail shown); else (cd "$work" && python shown); fi
}

# draw NAME FIGURE [OPTION...]: a figure of that file.
draw() { dynstiction plot "$work/$1.h5" "${@:3}" --overwrite -o "$figures/$2.png"; }

page() {
  case $1 in
    architecture) python docs/architecture.py ;;
    command_line | deck) python docs/make_pages.py "$venv/bin/dynstiction" ;;
    file) python docs/make_file_page.py "$venv/bin/dynstiction" ;;
    claims) tools/replicate.sh --page ;;
    creep_validation) python -m dynstiction.creep_validation docs/creep_validation.png ;;
    cycle_map) cp inputs/fig3.nml "$work" && shown python cycle_map && cp "$work/cycle_map.png" "$figures" && python bench/cycle_map.py --scenes 0 ;;
    cycles) python bench/sensitivity.py ;;
    figures) (cd "$work" && dynstiction paper) ;;
    fit) python bench/fit.py errors && python bench/creep_test.py --count 10 ;;
    fit_creep) python bench/creep_fit.py ;;
    maps)
      sweep map_phi_velocity map && draw map map_phi_velocity
      sweep map_phi_velocity low scene.model=low_frequency && draw low map_phi_velocity_low
      sweep map_lambda map_lambda && shown python maps && cp "$work/map_lambda.png" "$figures"
      sweep map_anisotropy rest && draw rest map_anisotropy --quantity sticking_time
      for key in stiffness misalignment velocity; do
        sweep "bifurcation_$key" "$key" && draw "$key" "bifurcation_$key" --kind bifurcation
      done
      ;;
    models) python bench/models.py ;;
    regularity)
      for map in map_regularity map_regularity_angle; do sweep "$map" "$map" && draw "$map" "$map" --quantity lyapunov_exponent; done
      ;;
    sweeps) python bench/sweep.py ;;
    tutorial)
      shown sh tutorial && cp "$work/ten.png" "$figures/tutorial_ten.png" && cp "$work/map.png" "$figures/tutorial_map.png"
      ;;
    validation) python bench/fig3.py && python bench/limit_cycles.py ;;
    *) die "no page '$1' has anything to be made: ${pages[*]}" ;;
  esac
}

pages=(architecture claims command_line creep_validation cycle_map cycles deck figures file fit fit_creep maps models regularity sweeps tutorial validation)

help_if_wanted "$@"
if (($# == 0)); then
  say "docs/make.sh PAGE...: ${pages[*]}"
  exit
fi
prepare
build_program -Dtests=false
source "$venv/bin/activate"
cd "$checkout"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for each; do
  page "$each"
done
