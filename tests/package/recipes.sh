#!/usr/bin/env bash
# tests/package/recipes.sh: do the recipes of packaging/ build, and does what they make run Fig. 3?
#
# The Debian packages are built and unpacked into an empty folder; the script of the conda recipe installs into a prefix, and the recipe is
# read by rattler-build's own parser; the options in Spack's recipe and the packages in the two definitions of images are compared with what there is.
# Takes three minutes. What the machine has no tools for is skipped, with a line that says so.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"

help_if_wanted "$@"

prepare package
packaging=$checkout/packaging
version=$(sed -n "s/^  version: '\(.*\)',/\1/p" "$checkout/meson.build")
(cd "$checkout" && git ls-files -z --cached --others --exclude-standard | tar c --null -T -) > "$scratch/source.tar"
sources() { mkdir -p "$1" && tar x -f "$scratch/source.tar" -C "$1"; }

# fig3 PROGRAM PYTHONPATH: that program's Fig. 3, read with that package.
fig3() {
  "$1" run "$checkout/inputs/fig3.nml" --quiet --overwrite -o "$scratch/fig3.h5"
  PYTHONPATH=$2 python -c "
import dynstiction as ds
assert ds.__file__.startswith('$2'), ds.__file__
assert ds.open('$scratch/fig3.h5').sticks() == 5398 == ds.run('$checkout/inputs/fig3.nml').sticks()
ds.plot(ds.open('$scratch/fig3.h5'))"
}
says_version() { "$1" --version | grep "^dynstiction $version ("; }

check 'the recipes have the version of the program' test 3 == "$(grep -l -E "(version: |version\(|dynstiction \()\"?$version[\"-]" "$packaging"/{conda/recipe.yaml,debian/changelog,spack/packages/dynstiction/package.py} | wc -l)"

# Debian.
debian() {
  (cd "$scratch/debian_source" && cp -r packaging/debian debian &&
    DEB_BUILD_OPTIONS="nocheck parallel=$(nproc)" dpkg-buildpackage -us -uc -b -d) 2>&1 | tee "$scratch/debian.log"
}
if have dpkg-buildpackage && have dh && have dh_python3; then
  sources "$scratch/debian_source"
  root=$scratch/debian_root
  mkdir "$root"
  check 'Debian: the packages are built' debian
  for package in dynstiction python3-dynstiction libdynstiction-dev; do
    check "Debian: $package" dpkg -x "$scratch/${package}_$version"-*.deb "$root"
  done
  check 'Debian: version' says_version "$root/usr/bin/dynstiction"
  check 'Debian: Fig. 3 has 5398 sticks' fig3 "$root/usr/bin/dynstiction" "$root/usr/lib/python3/dist-packages"
  check 'Debian: manual page and completion' ls "$root"/usr/share/{man/man1/dynstiction.1.gz,bash-completion/completions/dynstiction}
  check 'Debian: the library' ls "$root"/usr/lib/*/{libdynstiction.so,pkgconfig/dynstiction.pc} "$root/usr/include/dynstiction/dst_scene.mod"
  check 'Debian: no run path' fails grep -E 'R(UN)?PATH' <(readelf -d "$root/usr/bin/dynstiction" "$root"/usr/lib/python3/dist-packages/dynstiction/_core*.so)
  check 'Debian: nothing is in no package' fails grep 'dh_missing: warning' "$scratch/debian.log"
else
  skip 'Debian: dpkg-buildpackage, debhelper or dh-python is not installed'
fi

# conda.
prefix=$scratch/conda
conda_script() { (cd "$scratch/conda_source" && PREFIX=$prefix PYTHON=$venv/bin/python bash packaging/conda/build.sh); }
if "$venv/bin/python" -m pip install --help | grep -qE -- '^ *-C'; then
  sources "$scratch/conda_source"
  check 'conda: the script of the recipe' conda_script
  check 'conda: version' says_version "$prefix/bin/dynstiction"
  check 'conda: Fig. 3 has 5398 sticks' fig3 "$prefix/bin/dynstiction" "$(echo "$prefix"/lib/python*/site-packages)"
  check 'conda: metadata, library, manual page' ls "$prefix"/lib/{python*/site-packages/"dynstiction-$version.dist-info/METADATA",libdynstiction.so,pkgconfig/dynstiction.pc} "$prefix/share/man/man1/dynstiction.1"
else
  skip 'conda: the script needs pip 23.1'
fi
if "$python" -m venv "$scratch/rattler" && "$scratch/rattler/bin/pip" install --quiet --disable-pip-version-check py-rattler-build > "$scratch/rattler.log" 2>&1; then
  check 'conda: rattler-build reads the recipe' "$scratch/rattler/bin/python" -c "
from rattler_build import Stage0Recipe, VariantConfig
recipe = Stage0Recipe.from_file('$packaging/conda/recipe.yaml').render(VariantConfig.from_file('$packaging/conda/variants.yaml'))[0].recipe.to_dict()
import tomllib
wanted = tomllib.load(open('$checkout/pyproject.toml', 'rb'))['project']['dependencies']
there = {line.split()[0].removesuffix('-base') for line in recipe['requirements']['run']}
assert recipe['package']['version'] == '$version'
assert there == {'python', *(line.partition('>')[0] for line in wanted)}, (there, wanted)"
else
  skip 'conda: py-rattler-build cannot be installed'
fi

# Spack: Python, and options that meson.options has.
recipe=$packaging/spack/packages/dynstiction/package.py
check 'Spack: the recipe is Python' python -c "compile(open('$recipe').read(), '$recipe', 'exec')"
spack_options() {
  local option
  for option in $(grep -oE '"?-D[a-z0-9_.]+' "$recipe" | sed 's/.*-D//'); do
    [[ $option == python.install_env ]] || grep -q "^option('$option'" "$checkout/meson.options" || { echo "no option $option"; return 1; }
  done
}
check 'Spack: its options are those of the build' spack_options
if have spack; then
  check 'Spack: a specification' bash -c "spack repo add '$packaging/spack' && spack spec dynstiction"
else
  skip 'Spack: spack is not installed'
fi

# commands_of FILE: what an image is built with, a line for each command.
commands_of() {
  case $1 in
    *Dockerfile) sed -n 's/^RUN //p' "$1" ;;
    *.def) awk '/^%/ { wanted = $1 == "%post"; next } wanted' "$1" ;;
  esac
}
known_packages() {
  local package
  have apt-cache || return 0
  for package in $(commands_of "$1" | grep -oE 'install -y --no-install-recommends [a-z0-9 .-]+' | cut -d ' ' -f 4-); do
    apt-cache show "$package" > "$scratch/package" 2>&1 || { echo "no package $package"; return 1; }
  done
}
for file in Dockerfile dynstiction.def; do
  commands_of "$packaging/$file" > "$scratch/commands.sh"
  check "$file has commands" test -s "$scratch/commands.sh"
  check "$file: the shell reads them" sh -n "$scratch/commands.sh"
  check "$file: the packages of Debian are there" known_packages "$packaging/$file"
done
if have docker && docker info > "$scratch/docker.log" 2>&1; then
  check 'Dockerfile: the image' docker build -f "$packaging/Dockerfile" -t dynstiction-test "$checkout"
  check 'Dockerfile: it runs' docker run --rm dynstiction-test --version
else
  skip 'Dockerfile: there is no Docker daemon'
fi
if have apptainer; then
  check 'Apptainer: the image' apptainer build "$scratch/dynstiction.sif" "$packaging/dynstiction.def"
else
  skip 'Apptainer: it is not installed'
fi

summary 'Recipes'
