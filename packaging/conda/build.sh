#!/usr/bin/env bash
# What conda runs in the sources, with PREFIX, PYTHON and the flags of its compilers in the environment. pip installs the program and the
# Python package with its metadata; the library, the manual page and the completion come from the same build.
set -euo pipefail

"$PYTHON" -m pip install . --no-deps --no-build-isolation --ignore-installed --prefix="$PREFIX" -v \
  -Cbuild-dir=build/conda -Csetup-args=--prefix="$PREFIX" -Csetup-args=--libdir=lib
meson install -C build/conda --no-rebuild --tags=devel,man,completion
