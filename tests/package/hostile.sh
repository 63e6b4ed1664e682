#!/usr/bin/env bash
# tests/package/hostile.sh: does tools/run.sh work, or say what to do, in an environment that is against it, and does it repair
# what an earlier run left?
#
# A copy of the checkout without git, in a folder with a strange name, belongs to a user without sudo and without a home, with every variable of
# Python, pip, conda, compilers, Matplotlib, git and bash set to what breaks an installation. It is damaged, moved, killed at many points, and
# started twice at the same time. Takes about four minutes; packages are fetched once, into build/wheels. As root the user is nobody.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"

help_if_wanted "$@"

prepare
as_user=()
if ((EUID == 0)); then
  nobody=(setpriv --reuid=65534 --regid=65534 --clear-groups)
  for candidate in "$python" /usr/bin/python3; do
    "${nobody[@]}" "$candidate" -I -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2> /dev/null || continue
    as_user=("${nobody[@]}")
    python=$candidate
    break
  done
  ((${#as_user[@]})) || say 'No Python that the user nobody may start: the user is root'
fi
wheels=$checkout/build/wheels
mkdir -p "$wheels"
"$python" -I -m venv "$scratch/fetch"
busy "$checkout/build/wheels.log" '^ *(Collecting|Downloading|Saved) .*' \
  "$scratch/fetch/bin/python" -I -m pip download --disable-pip-version-check -r "$checkout/tools/requirements.txt" -d "$wheels" ||
  die "no packages: see $checkout/build/wheels.log"

# Where the user may read and write.
chmod 755 "$scratch"
cp -r "$wheels" "$scratch/wheels"
place=$scratch/"a b'c ü #%&(1)"
work=$scratch/work
enemy=$scratch/enemy
mkdir -p "$place" "$work" "$enemy"/{bin,lib,site,target,user,destination}
copy_to() { # copy_to FOLDER
  mkdir -p "$1"
  (cd "$checkout" && git ls-files -z 2> /dev/null | tar c --null -T -) | tar x -C "$1"
}
copy_to "$place/checkout"

# Tools that leave a trace and fail.
for tool in gfortran gcc cc c++ h5fc h5cc pkg-config pkgconf meson ninja ar ranlib git cmake python3 python3.14 python3.13 python3.12 pip; do
  printf '#!/bin/sh\necho "%s" >> "%s/called"\nexit 1\n' "$tool" "$enemy" > "$enemy/bin/$tool"
done
touch "$enemy/called"
chmod 666 "$enemy/called"
chmod 755 "$enemy"/bin/*
# What pip would count as installed, and what ends every Python that finds it.
for name in meson ninja numpy; do
  mkdir -p "$enemy/site/$name-99.0.dist-info"
  printf 'Metadata-Version: 2.1\nName: %s\nVersion: 99.0\n' "$name" > "$enemy/site/$name-99.0.dist-info/METADATA"
done
echo 'raise SystemExit("hostile")' > "$enemy/site/sitecustomize.py"
echo 'raise SystemExit("hostile")' > "$enemy/site/numpy.py"
for library in libgfortran.so.5 libhdf5_serial.so.103 liblapack.so.3; do echo none > "$enemy/lib/$library"; done
echo 'grep() { echo hostile; }; cd() { builtin cd /; }' > "$enemy/bash_env"
echo 'numpy==1.0' > "$enemy/constraints.txt"
# The folder of packages is of the network; the remainder is not.
cat > "$enemy/pip.conf" << CONF
[global]
no-index = true
find-links = $scratch/wheels
quiet = 3
require-virtualenv = true
target = $enemy/target
[install]
prefix = $enemy/target
user = true
no-deps = true
CONF
hostile=(
  PATH="$enemy/bin:$(dirname "$python"):/usr/local/bin:/usr/bin:/bin" HOME=/nonexistent XDG_CACHE_HOME=/nonexistent TMPDIR=/nonexistent LANG=tr_TR.UTF-8 LC_ALL=de_DE.UTF-8 DISPLAY=:99
  PYTHONPATH="$enemy/site" PYTHONHOME=/nonexistent PYTHONUSERBASE="$enemy/user" PYTHONOPTIMIZE=2 PYTHONWARNINGS=error PYTHONPLATLIBDIR=lib99
  PIP_CONFIG_FILE="$enemy/pip.conf" PIP_TARGET="$enemy/target" PIP_PREFIX="$enemy/target" PIP_ROOT="$enemy/target" PIP_USER=1 PIP_NO_DEPS=1
  PIP_DRY_RUN=1 PIP_QUIET=3 PIP_LOG=/nonexistent/log PIP_REQUIRE_VIRTUALENV=1 PIP_CONSTRAINT="$enemy/constraints.txt" PIP_NO_BINARY=:all:
  VIRTUAL_ENV="$enemy" CONDA_PREFIX="$enemy" _CONDA_PYTHON_SYSCONFIGDATA_NAME=nonexistent
  FC="$enemy/bin/gfortran" CC="$enemy/bin/gcc" CXX="$enemy/bin/c++" AR="$enemy/bin/ar" FFLAGS='-ffast-math -fno-such-flag' FCFLAGS=-fno-such-flag
  CFLAGS=-fno-such-flag CPPFLAGS=-DNULL=1 LDFLAGS=-lnonexistent CPATH="$enemy" LIBRARY_PATH="$enemy/lib" LD_LIBRARY_PATH="$enemy/lib"
  PKG_CONFIG=/nonexistent PKG_CONFIG_PATH="$enemy" PKG_CONFIG_LIBDIR=/nonexistent CMAKE_PREFIX_PATH="$enemy" HDF5_FC=/nonexistent HDF5_FLINKER=/nonexistent
  DESTDIR="$enemy/destination" MAKEFLAGS=-n NINJA_STATUS=hostile FORCE_COLOR=1 POSIXLY_CORRECT=1 SHELLOPTS=noclobber BASHOPTS=nullglob:failglob
  MPLBACKEND=module://nonexistent MPLCONFIGDIR=/nonexistent MATPLOTLIBRC=/nonexistent GIT_DIR=/nonexistent GIT_INDEX_FILE=/nonexistent
  CDPATH="$place:/" BASH_ENV="$enemy/bash_env" GFORTRAN_CONVERT_UNIT=big_endian DYNSTICTION_EXE=/nonexistent
)
give() { ((${#as_user[@]} == 0)) || chown -R 65534:65534 "$@"; }
give "$place" "$work" "$enemy"

# user COMMAND...: in the hostile environment, in the folder of results.
user() {
  (cd "$work" && umask 077 && exec env -u TERM -u PIP_FIND_LINKS -u PIP_NO_INDEX -u PIP_INDEX_URL "${hostile[@]}" ${as_user[@]+"${as_user[@]}"} "$@")
}
run() { user /bin/bash "$here/tools/run.sh" "$here/inputs/fig3.nml" "$@"; }
short() { run -o "$1.h5" --set scene.t_end=0.01 --quiet; }
here=$place/checkout

# asks LINES: of tools/setup.sh, in the hostile environment.
asks() { user /bin/bash -c 'source "$0/tools/setup.sh"; '"$1" "$here" "${@:2}"; }

says() { # says PATTERN COMMAND...: the command fails, and its last line matches.
  local pattern=$1 said
  shift
  if said=$("$@" 2>&1); then return 1; fi
  printf '%s\n' "$said"
  grep -qE "$pattern" <<< "$(tail -n 1 <<< "$said")"
}

# Refusals, which need nothing installed.
mkdir "$scratch/a:b" "$scratch/locked"
cp -r "$here" "$scratch/a:b/checkout"
cp -r "$here" "$scratch/locked/checkout"
chmod 555 "$scratch/locked/checkout"
give "$scratch/a:b"
refused_in() { user /bin/bash "$1/tools/run.sh" "$here/inputs/fig3.nml"; }
check 'a colon in the path is refused' says 'move or rename it' refused_in "$scratch/a:b/checkout"
if ((${#as_user[@]})); then check 'a checkout of somebody else is refused' says 'copy it to a folder of your own' refused_in "$scratch/locked/checkout"; fi
check 'no room on the disk is said before anything is installed' says '400 MB are needed' asks 'df() { printf "\n- - - 9000 -\n"; }; prepare'
check 'without network it says so' says 'Is the network there' asks 'export PIP_NO_INDEX=1 PIP_FIND_LINKS=/nonexistent; prepare'
check 'a temporary folder is chosen' asks '[[ -d $TMPDIR && -w $TMPDIR ]]'
namespace=(unshare --map-root-user --mount)
if "${namespace[@]}" true 2> /dev/null; then
  mkdir "$scratch/tmp"
  # A folder on a disk that is full, and one where no program starts.
  for options in size=8k noexec; do
    check "a temporary folder with $options is not used" "${namespace[@]}" bash -c 'mount -t tmpfs -o "$1" none "$0/tmp"
      [[ $1 != size* ]] || head -c 100000 /dev/zero > "$0/tmp/full" 2> /dev/null
      TMPDIR=$0/tmp; export TMPDIR; source "$2/tools/setup.sh" && [[ $TMPDIR != "$0/tmp" ]]' "$scratch" "$options" "$checkout"
  done
fi

# Everything at once, after an installation without network.
check 'a first run' run --quiet
counts() { [[ $("$here/.venv/bin/python" -I -c 'import sys, dynstiction as ds; print(ds.open(sys.argv[1]).sticks())' "$work/$1.h5") == 5398 ]]; }
check 'Fig. 3 has 5398 sticks' counts fig3
check 'a picture' test -s "$work/fig3.png"
check 'the compilers of the environment were not called' fails grep -vE '^python3' "$enemy/called"
check 'nothing was installed elsewhere' test -z "$(find "$enemy"/{target,user,destination} -mindepth 1)"
check 'no flags of the environment' fails grep -E 'fast-math|no-such-flag' <("$here/.venv/bin/dynstiction" --version)
again() { [[ $(run --quiet 2>&1 | grep -cE 'Installing|Making|Configuring|Compiling') == 0 ]]; }
check 'a second run installs and compiles nothing' again

# Damage of .venv that a look at it must find: something is moved away and back, or changed.
site=$(echo "$here"/.venv/lib/python*/site-packages)
is_whole_now() { asks 'find_python; is_whole "$venv" "$checkout/tools/requirements.txt" || { echo "$faults"; exit 1; }'; }
# whole_with FILE COMMAND...: is it whole while COMMAND has changed the file, which comes back afterwards?
whole_with() {
  local file=$1 status=0
  mv "$file" "$scratch/away"
  cp -pr "$scratch/away" "$file"
  "${@:2}" "$file"
  is_whole_now || status=1
  rm -rf "$file"
  mv "$scratch/away" "$file"
  return $status
}
longer() { echo '# certificates of a network' >> "$1"; }
check 'a whole environment is one' is_whole_now
for part in bin/python pyvenv.cfg bin/meson bin/ninja; do check "without $part it is not whole" fails whole_with "$here/.venv/$part" rm -rf; done
for part in numpy h5py/__init__.py xarray pandas/__init__.py pip "$(cd "$site" && echo numpy-*.dist-info)" "$(cd "$site" && echo meson-*.dist-info)/RECORD"; do
  check "without $part it is not whole" fails whole_with "$site/$part" rm -rf
done
check 'with a short file it is not whole' fails whole_with "$site/matplotlib/__init__.py" truncate -s 10
check 'with a longer file it is whole' whole_with "$site/matplotlib/__init__.py" longer
# Of the same length.
check 'with a command of another environment it is not whole' fails whole_with "$here/.venv/bin/f2py" sed -i '1,2s/checkout/dheckout/g'
check 'and afterwards it is whole' is_whole_now

# started COMMAND...: its process group leads itself; its number is in $process.
started() {
  set -m
  "$@" > "$scratch/started.log" 2>&1 &
  process=$!
  set +m
}
# killed_after SECONDS WHAT COMMAND...: WHAT is `script` (what it has started goes on) or `all`.
killed_after() {
  local seconds=$1 what=$2
  shift 2
  started "$@"
  sleep "$seconds"
  if [[ $what == all ]]; then kill -KILL -- "-$process" 2> /dev/null || true; else kill -KILL "$process" 2> /dev/null || true; fi
  wait "$process" 2> /dev/null || true
}

# A compilation that was killed: its files may be incomplete.
touch "$here/src/base/text.f90"
killed_after 4 all short killed
check 'after a killed compilation' short compiled

# Moved, half of .venv removed, then killed at many points, and in the end two at the same time.
mv "$place/checkout" "$place/moved"
here=$place/moved
rm -rf "$here"/.venv/lib/python*/site-packages/{numpy,h5py}
what=script
for point in 0.3 1.5 3 6 10 15; do
  killed_after "$point" "$what" short killed
  [[ $what == all ]] && what=script || what=all
done
two_at_once() {
  local first second status=0
  short first > "$scratch/first.log" 2>&1 &
  first=$!
  short second > "$scratch/second.log" 2>&1 &
  second=$!
  wait "$first" || status=1
  wait "$second" || status=1
  cat "$scratch/first.log" "$scratch/second.log"
  ((status == 0)) && grep -q 'waiting until it has finished' "$scratch"/{first,second}.log
}
check 'moved, half removed, killed: two at the same time work' two_at_once
check 'Fig. 3 again' run --quiet
check 'Fig. 3 has 5398 sticks again' counts fig3
check 'and now nothing is left to do' again

summary 'Hostile environments'
