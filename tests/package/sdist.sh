#!/usr/bin/env bash
# tests/package/sdist.sh: does the source archive, unpacked elsewhere and without git, install with pip and know its version and
# revision? pip takes the build's tools from .venv; `pip install .` fetches them itself.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"

help_if_wanted "$@"

prepare package
unpacked_archive "$scratch/elsewhere"
python -m venv --system-site-packages "$scratch/clean"
# The tools and libraries of .venv, behind the clean environment's own packages.
printf '%s\n' "$venv"/lib/python*/site-packages > "$(echo "$scratch"/clean/lib/python*/site-packages)/tools.pth"
version=$(sed -n "s/^  version: '\(.*\)',/\1/p" "$checkout/meson.build")
revision=$(git -C "$checkout" rev-parse HEAD | cut -c 1-12)
cd "$scratch"

# As part of a repository of somebody else, whose revision is not that of the program.
git init --quiet .
git -c user.name=test -c user.email=test@localhost commit --quiet --allow-empty --message 'Another project'

install() {
  PATH=$scratch/clean/bin:$PATH python -m pip install --disable-pip-version-check --no-index --no-deps --no-build-isolation ./elsewhere
}

check 'the archive is named after the version' ls dist/dynstiction-"$version".tar.gz
check 'no generated or private files in it' fails grep -E '/(build|\.venv|__pycache__)/|\.(h5|so|pyc)$' <(tar tzf dist/*.tar.gz)
check 'pip install .' install
check 'pip knows the version' grep -x "Version: $version" <(clean/bin/python -m pip show dynstiction 2> /dev/null)
check 'the program knows version and revision' grep "^dynstiction $version ($revision," <(clean/bin/dynstiction --version)
check 'so does the package' clean/bin/python -c "
import dynstiction as ds
assert ds.__version__ == '$version' and '$scratch/clean' in ds.__file__, (ds.__version__, ds.__file__)
assert ds.run('elsewhere/inputs/fig3.nml', scene={'t_end': 0.1}).attributes['git_revision'] == '$revision'"
check 'no library or manual page comes with pip' fails ls clean/include/dynstiction clean/lib/libdynstiction.a clean/share/man/man1/dynstiction.1
check 'uninstall' clean/bin/python -m pip uninstall --yes dynstiction
check 'uninstall leaves nothing' fails grep -i dynstiction <(files_below clean)

summary 'Source archive'
