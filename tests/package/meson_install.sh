#!/usr/bin/env bash
# tests/package/meson_install.sh: installs with Meson into a fresh prefix, builds the programs in downstream/ against the
# library, and uninstalls. The build is the one without OpenMP, so that it is known to work as well.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"

help_if_wanted "$@"

prepare
folder=$checkout/build/without_openmp
prefix=$scratch/prefix

compile() { # compile PROGRAM [FLAG]...
  local program=$1
  shift
  gfortran -std=f2008 -Wall -Werror -o "$scratch/$program" "$checkout/tests/package/downstream/$program.f90" \
    $(pkg-config --cflags dynstiction) "$@"
}

# Whether the program prints the number that the installed executable gives.
prints_u_x() {
  diff <(LD_LIBRARY_PATH=$libraries "$scratch/run_deck" "$checkout/inputs/fig3.nml") - <<< "$u_x"
}
prints_critical_angle() {
  local printed
  printed=$(LD_LIBRARY_PATH=$libraries "$scratch/physics")
  [[ $printed == 'phi_c ='*' deg' ]]
  python -c "
angle = $(awk '{ print $3 }' <<< "$printed")
there = $("$prefix/bin/dynstiction" stability "$checkout/inputs/fig3.nml" | awk '/critical angle, slow mode/ { print $5 }')
assert abs(angle - there) < 1e-6, (angle, there)"
}
refuses_a_missing_deck() {
  local printed
  ! printed=$(LD_LIBRARY_PATH=$libraries "$scratch/run_deck" missing.nml 2> /dev/null) && [[ $printed == missing.nml:* ]]
}
runs_a_sweep() {
  (cat "$checkout/inputs/fig3.nml"; printf '&sweep\n parameter = "system.misalignment_deg" first = 1 last = 2 count = 2\n/\n') > "$scratch/sweep.nml"
  "$prefix/bin/dynstiction" run "$scratch/sweep.nml" -o "$scratch/sweep.h5" --quiet --set scene.t_end=0.01
}

rm -rf "$folder"
build "$folder" --prefix="$scratch/prefix" -Dpython.install_env=prefix -Dopenmp=disabled -Dtests=false -Doptimization=1
meson install -C "$folder" --quiet --no-rebuild
export PKG_CONFIG_PATH libraries PYTHONPATH
PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name dynstiction.pc)")
libraries=$(dirname "$PKG_CONFIG_PATH")
PYTHONPATH=$(dirname "$(dirname "$(find "$prefix" -name '_core*.so')")")
"$prefix/bin/dynstiction" run "$checkout/inputs/fig3.nml" -o "$scratch/fig3.h5" --quiet --set scene.t_end=2.5
u_x="u_x =$(python -c "import h5py; print(f\"{h5py.File('$scratch/fig3.h5')['time_series/u_x'][-1]:24.16E}\")") m"

check 'one version everywhere' python -c "
import subprocess, dynstiction as ds
said = subprocess.run(['$prefix/bin/dynstiction', '--version'], capture_output=True, text=True, check=True).stdout
assert said.split()[1] == ds.__version__ == '$(pkg-config --modversion dynstiction)'"
check 'OpenMP is not in it' grep -x 'OpenMP: *no' <("$prefix/bin/dynstiction" --version)
check 'nor linked' fails grep libgomp <(ldd "$prefix/bin/dynstiction" "$libraries"/libdynstiction.so)
check 'the manual page' grep -q '^\.TH DYNSTICTION 1' "$prefix/share/man/man1/dynstiction.1"
for file in bash-completion/completions/dynstiction zsh/site-functions/_dynstiction fish/vendor_completions.d/dynstiction.fish; do
  check "completion: $file" test -s "$prefix/share/$file"
done
check 'a picture' python -m dynstiction plot "$scratch/fig3.h5" -o "$scratch/fig3.png"
check 'a sweep without OpenMP' runs_a_sweep
for library in shared static; do
  flags=$(pkg-config --libs dynstiction)
  [[ $library == shared ]] || flags="$libraries/libdynstiction.a $(pkg-config --static --libs dynstiction | sed 's/-ldynstiction//')"
  for program in run_deck physics; do
    check "$program compiles with the $library library" compile "$program" $flags
  done
  check "$library: a deck run in memory gives the number of the executable" prints_u_x
  check "$library: the critical misalignment" prints_critical_angle
  check "$library: a missing deck is an error, not a crash" refuses_a_missing_deck
done
check 'the static one needs no libdynstiction.so' fails grep libdynstiction <(ldd "$scratch/run_deck")
check 'uninstall' ninja -C "$folder" uninstall
check 'uninstall leaves nothing' fails find "$prefix"

summary 'Meson install'
