#!/usr/bin/env bash
# tests/package/without_hdf5.sh: where HDF5 is not installed, the library and the Python package are built without the program.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"

help_if_wanted "$@"

prepare
folder=$checkout/build/without_hdf5
prefix=$scratch/prefix

# A system without HDF5: pkg-config has all its files except those of HDF5, and there is no h5cc.
hide_hdf5() {
  local places file
  IFS=: read -r -a places <<< "$(pkg-config --variable pc_path pkg-config)"
  mkdir "$scratch/pkgconfig"
  for file in $(find "${places[@]}" -name '*.pc' ! -name 'hdf5*' 2> /dev/null); do
    ln -sf "$file" "$scratch/pkgconfig/"
  done
  printf "[binaries]\nh5cc = '%s'\n" "$scratch/h5cc" > "$scratch/native.ini"
  export PKG_CONFIG_LIBDIR=$scratch/pkgconfig
}

setup() { meson setup "$1" "$checkout" -Doptimization=1 --native-file "$scratch/native.ini" --prefix="$prefix" -Dpython.install_env=prefix "${@:2}"; }
is_refused_with_the_remedy() {
  local printed
  ! printed=$(setup "$scratch/refused" -Dtests=false 2>&1) && grep 'HDF5 .* was not found: .* -Dprogram=false' <<< "$printed"
}

hide_hdf5
rm -rf "$folder"
check 'the program needs HDF5' is_refused_with_the_remedy
check 'without the program' setup "$folder" -Dprogram=false -Dtests=false
check 'with the tests that need no HDF5' setup "$scratch/tests" -Dprogram=false
check 'it compiles' ninja -C "$folder"
check 'it is installed' meson install -C "$folder" --quiet --no-rebuild
check 'no program' fails find "$prefix/bin"
check 'nothing needs HDF5' fails grep -i hdf5 <(find "$prefix" -name '*.so' -exec ldd {} +)
export PYTHONPATH
PYTHONPATH=$(dirname "$(dirname "$(find "$prefix" -name '_core*.so')")")
cd "$scratch"
check 'Python runs, writes and reads' python -c "
import dynstiction as ds
assert ds.__file__.startswith('$prefix'), ds.__file__
result = ds.run('$checkout/inputs/fig3.nml', t_end=0.5)
result.save('run.h5')
assert ds.open('run.h5').summary['sticks'] == result.summary['sticks'] > 0"
check 'Python draws' python -m dynstiction plot run.h5 -o run.png
check 'a sweep' python -c "
import dynstiction as ds
table = ds.sweep('$checkout/inputs/fig3.nml', {'misalignment_deg': [1.0, 2.0]}, t_end=0.1)
assert list(table.result_code) == [0, 0], table"

summary 'Without HDF5'
