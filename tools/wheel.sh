#!/usr/bin/env bash
# tools/wheel.sh [FOLDER]: makes a wheel for this Python that needs neither HDF5 nor LAPACK nor gfortran's libraries where it is
# installed, into FOLDER (dist). Prints the wheel's name.
#
# All of them are linked statically into the executable, because pip puts it into bin/, where it cannot find libraries of the
# package. LAPACK is linked statically into the Python extension; auditwheel copies the needed libraries of gfortran into the wheel.
# libcurl, which HDF5 uses for files in the cloud, is left out by the static linker, which takes only what is called.

source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

help_if_wanted "$@"
folder=${1:-dist}
build=$checkout/build/wheel
# With a blank, because the path of the checkout may also have one.
archives="$build/static libraries"

# A folder in which the linker finds only static libraries, also those that the compiler adds.
collect_archives() {
  local name
  rm -rf "$archives"
  mkdir -p "$archives"
  for name in gfortran gomp quadmath; do
    ln -s "$(archive_of "$name")" "$archives/lib$name.a"
  done
  # HDF5's compression filter: the first calls the second.
  printf 'GROUP ( "%s" "%s" )\n' "$(archive_of sz)" "$(archive_of aec)" > "$archives/libsz.so"
}

archive_of() {
  local file
  file=$(gfortran -print-file-name="lib$1.a")
  [[ $file == /* ]] || die "lib$1.a is not there: install the static libraries of gfortran and HDF5"
  printf '%s\n' "$file"
}

# One word of several that Meson splits at blanks.
quoted() { printf "'%s'" "${1//\'/\'\\\'\'}"; }

# In a folder of its own from the beginning, so that it does not depend on what an interrupted one has left.
make_wheel() {
  rm -rf "$build"
  collect_archives
  say 'Building the wheel (about a minute) ...'
  busy "$build/build.log" '^\[[0-9]+/[0-9]+\]' python -m build --wheel --no-isolation --outdir "$build/plain" "-Cbuild-dir=$build/meson" \
    -Csetup-args=-Dprefer_static=true "-Csetup-args=-Dfortran_link_args=$(quoted "-L$archives") -static-libgcc" "$checkout" || {
    cat "$build/build.log" >&2
    die 'building the wheel failed: see above'
  }
  # The path of this Python's own library is useless on other machines.
  auditwheel repair --strip --wheel-dir "$build/repaired" "$build/plain"/*.whl > "$build/repair.log" 2>&1 || {
    cat "$build/repair.log" >&2
    die 'auditwheel refused the wheel: see above'
  }
}

prepare package
locked make_wheel
wheel=$(basename "$build/repaired"/*.whl)
mkdir -p "$folder"
# Complete, or not there.
cp "$build/repaired/$wheel" "$folder/.$wheel.new"
mv "$folder/.$wheel.new" "$folder/$wheel"
printf '%s\n' "$folder/$wheel"
