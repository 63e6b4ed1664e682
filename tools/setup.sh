# Sourced by the scripts in this folder: installs what is missing and builds, and says so before it does.
# Only the apt packages below are installed outside the checkout. Repeating a script without changes takes seconds.
# If a script was interrupted, start it again: unfinished steps are recognised and repeated.

# Options and functions that the calling shell exports, or BASH_ENV defines, must not change what the commands below mean.
while read -r _ _ name; do [[ -z $name ]] || unset -f "$name"; done <<< "$(declare -F)"
set +o noclobber +o noglob +o posix
shopt -u failglob nullglob nocasematch
set -euo pipefail

unset CDPATH
checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$checkout/.venv
release=$checkout/build/release

debian_packages=(gfortran gcc libc6-dev pkg-config libhdf5-dev hdf5-tools liblapack-dev)

say() { printf '%s\n' "$*" >&2; }
die() { say "${0##*/}: $*"; exit 1; }
have() { command -v "$1" > /dev/null; }

# Ctrl-C, also if the running command ends as if it had failed. A compilation that ends this way continues later; see compile_in.
unfinished=
trap '[[ -z $unfinished ]] || rm -f "$unfinished"; say "${0##*/}: interrupted; start the same command again to continue"; exit 130' INT

# Variables that change what Python, pip, compilers, Meson, ninja, git and bash do, by families: what the scripts start gets none of them.
# Those of the network stay: proxies, certificates, and where pip fetches packages.
clean_environment() {
  local name kept families toolchain
  kept='PYTHON|PYTHONUNBUFFERED|PYTHONDONTWRITEBYTECODE'
  kept+='|PIP_((EXTRA_)?INDEX_URL|NO_INDEX|FIND_LINKS|TRUSTED_HOST|(CLIENT_)?CERT|PROXY|(DEFAULT_)?TIMEOUT|RETRIES|KEYRING_PROVIDER|(NO_)?CACHE_DIR|CONFIG_FILE)'
  # Of HDF5 when it runs, not when it is compiled with.
  kept+='|HDF5_(USE_FILE_LOCKING|PLUGIN_PATH)'
  families='(PYTHON|PIP_|_?CONDA_|MAMBA_|MESON|NINJA|MPL|GREP_).*|VIRTUAL_ENV|MATPLOTLIBRC|BASH_ENV|ENV|DESTDIR|MAKEFLAGS'
  families+='|GIT_(DIR|WORK_TREE|INDEX_FILE|OBJECT_DIRECTORY|COMMON_DIR|NAMESPACE|PREFIX)|(CLICOLOR_)?FORCE_COLOR|POSIXLY_CORRECT'
  # On Debian compilers and libraries are the packages that install_system_packages installs. Elsewhere they may come with these variables.
  toolchain='(FC|F77|F90|CC|CXX|AR|NM|LD|AS|RANLIB|STRIP|OBJCOPY|CPP|LIBS|[A-Z0-9]*FLAGS|(FC|CC|CXX)_LD|[A-Z0-9]*LIBRARY_PATH|CPATH|[A-Z_]*INCLUDE_PATH)'
  toolchain+='|(PKG_CONFIG|HDF5_|CMAKE_|LD_|GCC_|COLLECT_|GFORTRAN_).*|(OMPI|MPICH)_(FC|F77|F90|CC|CXX)|COMPILER_PATH|DEPENDENCIES_OUTPUT|SUNPRO_DEPENDENCIES'
  if has_apt; then families+="|$toolchain"; fi
  for name in $(compgen -e); do
    if [[ $name =~ ^($families)$ && ! $name =~ ^($kept)$ ]]; then unset "$name"; fi
  done
  # Numbers and messages as the scripts read them, and no options of the calling shell for those that they start.
  { export LC_ALL=C.UTF-8; } 2> /dev/null
  export -n SHELLOPTS BASHOPTS
  export MPLCONFIGDIR=$venv/matplotlib
  choose_temporary_folder
}

has_apt() { have dpkg-query && have apt-get; }

# A folder with room for a file, and where programs may be started.
choose_temporary_folder() {
  local folder probe usable
  unset TMP TEMP
  for folder in "${TMPDIR:-/tmp}" /tmp /var/tmp "$checkout/build/tmp"; do
    [[ $folder != "$checkout/build/tmp" ]] || mkdir -p "$folder"
    probe=$(mktemp "$folder/dynstiction.XXXXXX" 2> /dev/null) || continue
    usable=no
    if printf '#!/bin/sh\n' > "$probe" && chmod 700 "$probe" && "$probe" && head -c 1000000 /dev/zero > "$probe"; then usable=yes; fi 2> /dev/null
    rm -f "$probe"
    [[ $usable == no ]] || break
  done
  if [[ $folder != "${TMPDIR:-/tmp}" ]]; then
    say "${TMPDIR:-/tmp} has no room, or starts no programs: temporary files are in $folder"
    export TMPDIR=$folder
  fi
}
clean_environment

# locked COMMAND...: while no other script installs or compiles in this checkout. What the command starts keeps the lock, so that the next script
# also waits for what a killed one has left running.
lock=
locked() {
  if [[ -n $lock ]]; then
    "$@"
    return
  fi
  mkdir -p "$checkout/build"
  exec {lock}>> "$checkout/build/lock"
  "$python" -I - "$lock" << 'END'
import fcntl, sys

number = int(sys.argv[1])
try:
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print("Another script of this checkout installs or compiles: waiting until it has finished", file=sys.stderr)
        fcntl.flock(number, fcntl.LOCK_EX)
except OSError as error:
    print(f"This file system has no locks ({error.strerror}): do not start two scripts of this checkout at the same time", file=sys.stderr)
END
  "$@"
  exec {lock}>&-
  lock=
}

# help_if_wanted "$@": with --help or -h as the first argument, print the comment at the head of the script, and end.
help_if_wanted() {
  [[ ${1:-} == --help || ${1:-} == -h ]] || return 0
  awk 'NR > 1 { if (!/^#/) exit; sub(/^# ?/, ""); print }' "$0"
  exit 0
}

# busy LOG PATTERN COMMAND...: run the command and write its output to LOG. Every 8 s a line shows the progress:
# the last match of PATTERN (for grep -E) in LOG.
busy() {
  local log=$1 pattern=$2 watcher status=0
  shift 2
  mkdir -p "$(dirname "$log")"
  : > "$log"
  report_progress "$log" "$pattern" &
  watcher=$!
  "$@" > "$log" 2>&1 < /dev/null || status=$?
  kill "$watcher" 2> /dev/null || true
  wait "$watcher" 2> /dev/null || true
  return $status
}

report_progress() {
  local begin=$SECONDS next=8 silence last
  exec {silence}<> <(:)
  while kill -0 $$ 2> /dev/null; do
    # A pause of a second, without a process that could run longer than this script.
    read -r -t 1 -u "$silence" || true
    ((SECONDS - begin >= next)) || continue
    next=$((next + 8))
    last=$([[ -z $2 ]] || grep -aoE "$2" "$1" | tail -n 1) || true
    say "  $((SECONDS - begin)) s${last:+: ${last:0:100}}"
  done
}

# prepare [SET]...: install everything that a run and a picture need, and the packages of tools/requirements_SET.txt; afterwards
# .venv/bin comes first in PATH.
prepare() {
  prepare_to_build
  is_prepared || add_requirements run "$@"
}
prepare_to_build() {
  check_place
  find_python
  install_system_packages
  is_prepared || locked create_environment
  # Debian's compilers and pkg-config, not those of an active conda.
  if has_apt; then PATH=/usr/bin:/bin:/usr/sbin:/sbin:$PATH; fi
  export PATH=$venv/bin:$PATH
}

# What no command below could work with.
check_place() {
  local refused='[:"$`\\]'
  if [[ $checkout =~ $refused || $checkout == *$'\n'* ]]; then
    die "$checkout: Python environments and compilers cannot work below a folder with : \" \$ \` \\ or a line break in its name; move or rename it"
  fi
  [[ -w $checkout ]] || die "$checkout: this user may not write here, but the scripts install into it; copy it to a folder of your own"
}

# Whether tools/test.sh of this checkout has called this script; it has already installed everything, and tests this installation.
is_prepared() { [[ ${DYNSTICTION_PREPARED:-} == "$checkout" ]]; }

find_python() {
  local candidate
  # The Python of .venv as long as it works, whichever comes first in PATH today.
  for candidate in ${PYTHON:+"$PYTHON"} "$venv/bin/python" python3 python3.{14,13,12,11} /usr/bin/python3; do
    if have "$candidate" && "$candidate" -I -c 'import sys, ssl, ctypes; sys.exit(sys.version_info < (3, 11))' 2> /dev/null; then
      python=$(command -v "$candidate")
      # The one from which .venv was made, as it may have to be made again.
      [[ $python != "$venv"/* ]] || python=$("$python" -I -c 'import os, sys; print(os.path.realpath(sys._base_executable))')
      [[ $python != "$venv"/* ]] || continue
      python_version=$("$python" -I -c 'import sys; print("%d.%d" % sys.version_info[:2])')
      return
    fi
    [[ $candidate != "${PYTHON:-}" ]] || say "PYTHON=$PYTHON is not a Python 3.11 or later that works: looking for another one"
  done
  die "Python 3.11 or later is needed: install it, or name it with PYTHON=/path/to/python3"
}

install_system_packages() {
  local missing=() package
  if has_apt; then
    for package in "${debian_packages[@]}"; do
      [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2> /dev/null) == installed ]] || missing+=("$package")
    done
    # A Python that is not Debian's contains these two.
    "$python" -I -c 'import venv, ensurepip' 2> /dev/null || missing+=("python$python_version-venv")
    has_python_headers || missing+=("python$python_version-dev")
    ((${#missing[@]} == 0)) || apt_install "${missing[@]}"
  else
    for package in gfortran gcc pkg-config; do
      have "$package" || missing+=("$package")
    done
    have h5cc || pkg-config --exists hdf5 || pkg-config --exists hdf5-serial || missing+=(HDF5)
    ((${#missing[@]} == 0)) || die "not found: ${missing[*]}. Install with your package manager: a Fortran and a C compiler," \
      "pkg-config, HDF5 (with h5cc or hdf5.pc) and LAPACK, with their development files"
  fi
}

has_python_headers() {
  [[ -e $("$python" -I -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h ]]
}

apt_install() {
  local as_root=()
  say "Installing Debian packages: $*"
  if ((EUID != 0)); then
    have sudo || die "these packages need an administrator: apt-get install $*. With compilers and libraries of your own, for example of conda: see docs/install.md"
    as_root=(sudo)
  fi
  # Other users must be able to read what is installed, and services that start now must not keep the lock.
  apt_get() (
    umask 022
    [[ -z $lock ]] || exec {lock}>&-
    busy "$checkout/build/apt.log" '^(Get:[0-9]+|Unpacking|Setting up) .*' "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
      apt-get -o DPkg::Lock::Timeout=600 "$@"
  )
  # The lists may be absent or stale; an unreachable extra source must not stop the installation.
  apt_get update || say "apt-get update failed; trying with the existing lists"
  apt_get install --no-install-recommends -y "$@" || { tail -n 20 "$checkout/build/apt.log" >&2; die "apt-get could not install $*"; }
}

# What is to be installed, a line each.
lines_of() { cat "$@" | grep -v '^#'; }

# create_environment: .venv, with the packages of tools/requirements.txt. What its list says is compared with what is needed: an environment of
# another folder or Python, or one whose making or removal was interrupted, is made again. Builds contain paths of it.
create_environment() {
  if is_whole "$venv" "$checkout/tools/requirements.txt"; then return; fi
  # What makes a build count as configured is removed first, because removing may be interrupted, too.
  mkdir -p "$checkout/build"
  rm -f "$checkout"/build/*/configured
  find "$checkout/build" -mindepth 1 -maxdepth 1 ! -name lock ! -name tmp -exec rm -rf {} +
  new_environment "$venv" "$checkout/tools/requirements.txt"
}

# Additional requirements of runs, tests and packages, by sets.
add_requirements() {
  local set requirements
  for set in "$@"; do
    requirements=$checkout/tools/requirements_$set.txt
    if is_whole "$venv" "$requirements"; then continue; fi
    locked install_into "$venv" "$requirements"
  done
}

# is_whole FOLDER REQUIREMENTS: whether the environment there has a Python, and its list, which is written when pip has ended, names what the
# file names, that folder and the wanted Python. If not, $faults says what is missing.
is_whole() {
  local list=$1/installed
  [[ -e $list ]] || list=/dev/null
  faults=$({ lines_of "$2"; mark_of "$1"; } | grep -vxF -f "$list") || faults=
  [[ -x $1/bin/python && -z $faults ]]
}
mark_of() { printf 'Python %s in %s\n' "$python_version" "$1"; }

# new_environment FOLDER REQUIREMENTS
new_environment() {
  local folder=$1 log=$checkout/build/venv.log free
  [[ ! -e $folder ]] || say "Making $folder again: ${faults%%$'\n'*}"
  # One that these scripts have not made is kept.
  if [[ -e $folder && ! -e $folder/made_by_tools && ! -e $folder/installed ]]; then
    say "$folder is not made by this script: it is now $folder.before"
    [[ ! -e $folder.before ]] || die "$folder.before is there as well: remove one of them"
    mv "$folder" "$folder.before"
  fi
  rm -rf "$folder/bin" && rm -rf "$folder" || die "$folder cannot be removed: see above. Does it belong to another user?"
  free=$(df -Pk "$checkout" | awk 'NR == 2 { print int($4/1024) }') || free=
  [[ -z $free ]] || ((free > 400)) || die "400 MB are needed in $checkout, $free MB are free"
  mkdir -p "$folder"
  : > "$folder/made_by_tools"
  busy "$log" '' "$python" -I -m venv "$folder" || { cat "$log" >&2; die "no environment: see above"; }
  install_into "$folder" "$2"
}

# install_into FOLDER REQUIREMENTS
install_into() {
  local folder=$1 list=$1/installed
  say "Installing into $folder: $(lines_of "$2" | tr '\n' ' ')"
  pip_install "$folder" -r "$2"
  { [[ ! -e $list ]] || cat "$list"; lines_of "$2"; mark_of "$folder"; } > "$list.new"
  mv "$list.new" "$list"
  if [[ $2 == */tools/requirements_* && $2 != */requirements_run.txt ]]; then
    # Tests start Python often, and may not be allowed to write bytecode.
    busy "$checkout/build/bytecode.log" '' "$folder/bin/python" -I -m compileall -q -j 0 "$folder/lib" || true
  fi
}

# pip_install FOLDER [OPTION]... [PACKAGE]...
pip_install() {
  local folder=$1 log=$checkout/build/pip.log
  shift
  # Bytecode of all packages would take most of the time, and a third of the space. run.sh makes it for the modules that it imports.
  busy "$log" '^ *(Collecting|Downloading|Installing) [^ ]*( [^ ]*)?' "$folder/bin/python" -I -m pip install --no-user --disable-pip-version-check \
    --no-input --progress-bar off --no-compile "$@" || {
    grep -vE '^ *(Collecting|Downloading|Using cached|Requirement already)' "$log" >&2 || true
    die "pip could not install $*: see above. Is the network there, and room on the disk? To try again, start the same command again"
  }
}

# configure FOLDER [MESON OPTION]...: if that has not been done, if the folder was moved here, or if its last compilation was killed.
configure() { locked configure_now "$@"; }
configure_now() {
  local folder=$1 log=$1.log stamp=$1/configured place
  shift
  place=$(printf '%s\n' "$checkout" "$folder")
  if [[ -e $folder/unfinished ]]; then
    say "The last compilation in $folder was killed"
  elif [[ -e $folder/build.ninja && -e $stamp && $(< "$stamp") == "$place" ]]; then
    return
  fi
  say "Configuring $folder"
  rm -f "$stamp"
  rm -rf "$folder" || die "$folder cannot be removed: see above. Does it belong to another user?"
  mkdir -p "$folder"
  busy "$log" '^[A-Z].*' meson setup "$folder" "$checkout" "$@" || {
    cat "$log" >&2
    rm -rf "$folder"
    die "configuring failed: see above$(what_may_differ)"
  }
  printf '%s\n' "$place" > "$stamp.new"
  mv "$stamp.new" "$stamp"
}

# Variables that Meson and the compilers obey, for messages; on Debian they are unset.
what_may_differ() {
  local name names=
  for name in FC CC FFLAGS CFLAGS LDFLAGS LD_LIBRARY_PATH PKG_CONFIG_PATH CPATH LIBRARY_PATH; do
    [[ -z ${!name:-} ]] || names+=" $name"
  done
  [[ -z $names ]] || printf '. These variables of your environment change the build:%s' "$names"
}

# build FOLDER [MESON OPTION]...: configure and compile.
build() {
  configure "$@"
  compile_in "$1"
}

# compile_in FOLDER [TARGET]...: prints a line if there is much to do. The output of the compilers goes to FOLDER-ninja.log.
compile_in() { locked compile_now "$@"; }
compile_now() {
  local folder=$1 log=$1-ninja.log steps
  shift
  if [[ ! -e $folder/.ninja_log ]]; then
    say "Compiling $folder (half a minute on two idle cores) ..."
  else
    steps=$(ninja -C "$folder" -n "$@" 2> /dev/null | grep -c '^\[') || true
    # Looking up the revision alone counts as twenty.
    ((steps < 40)) || say "Compiling what has changed in $folder ..."
  fi
  # It stays if this script is killed: then a file may be incomplete.
  unfinished=$folder/unfinished
  : > "$unfinished"
  busy "$log" '^\[[0-9]+/[0-9]+\]' ninja -C "$folder" "$@" || {
    rm -f "$unfinished"
    sed -n '/^FAILED/,$p' "$log" >&2
    die "compiling failed: see above, or $log$(what_may_differ)"
  }
  rm -f "$unfinished"
  unfinished=
}

# The executable in .venv/bin and the package in .venv's site-packages. build_program does not add tests to a build without tests.
build_program() { is_prepared || locked install_program "$@"; }
install_program() {
  local log=$release/meson-logs/install-log.txt package
  build "$release" --prefix="$venv" -Dpython.install_env=venv "$@"
  meson install -C "$release" --quiet --no-rebuild
  # Modules that the package no longer has. Everything else stays in its place, as a run of another shell may use it.
  package=$(grep '/dynstiction/__init__\.py$' "$log")
  { find "${package%/*}" -type f ! -name '*.pyc' | grep -vxF -f "$log" || true; } | tr '\n' '\0' | xargs -0 rm -f
  load_completion
}

# The same while the packages that a picture needs are installed.
build_beside_packages() {
  add_requirements run &
  local packages=$!
  build_program -Dtests=false
  wait "$packages" || exit
}

# The same with all tests.
build_release() { is_prepared || locked install_release; }
install_release() {
  if [[ -e $release/build.ninja ]] && ! grep -q 'tests/unit/' "$release/build.ninja"; then
    say 'Compiling the tests (20 s on two idle cores) ...'
    meson configure "$release" -Dtests=true
  fi
  build_program -Dtests=true
}

# Completion of the command line comes with `source .venv/bin/activate`, in bash and zsh, and with activate.fish.
load_completion() {
  local activate=$venv/bin/activate
  grep -q '_dynstiction' "$activate" || cat >> "$activate" << 'END'

# Completion of dynstiction's command line; zsh where its own completion is on (compinit).
if [ -n "${BASH_VERSION:-}" ] && [ -r "$VIRTUAL_ENV/share/bash-completion/completions/dynstiction" ]; then
    . "$VIRTUAL_ENV/share/bash-completion/completions/dynstiction"
elif [ -n "${ZSH_VERSION:-}" ]; then
    eval 'fpath=("$VIRTUAL_ENV/share/zsh/site-functions" $fpath)
    if whence compdef > /dev/null; then autoload -Uz _dynstiction; compdef _dynstiction dynstiction; fi'
fi
END
  grep -q 'dynstiction' "$activate.fish" || cat >> "$activate.fish" << 'END'

# Completion of dynstiction's command line.
source "$VIRTUAL_ENV/share/fish/vendor_completions.d/dynstiction.fish"
END
}
