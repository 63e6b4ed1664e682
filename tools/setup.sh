# Sourced by the scripts in this folder: installs what is missing and builds, and says so before it does.
# Only the apt packages below are installed outside the checkout. Repeating a script without changes takes seconds.
# If a script was interrupted, start it again: unfinished steps are recognised and repeated.

set -euo pipefail

checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$checkout/.venv
release=$checkout/build/release

debian_packages=(gfortran gcc libc6-dev pkg-config libhdf5-dev hdf5-tools liblapack-dev)

say() { printf '%s\n' "$*" >&2; }
die() { say "${0##*/}: $*"; exit 1; }
have() { command -v "$1" > /dev/null; }

# Ctrl-C, also if the running command ends as if it had failed.
trap 'say "${0##*/}: interrupted; start the same command again to continue"; exit 130' INT

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
  find_python
  install_system_packages
  if ! is_prepared; then
    create_environment
    add_requirements "$@"
  fi
  export PATH=$venv/bin:$PATH
}

# Whether tools/test.sh of this checkout has called this script; it has already installed everything, and tests this installation.
is_prepared() { [[ ${DYNSTICTION_PREPARED:-} == "$checkout" ]]; }

find_python() {
  local candidate
  for candidate in "${PYTHON:-python3}" python3 python3.{14,13,12,11}; do
    if have "$candidate" && "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null; then
      python=$(command -v "$candidate")
      # In a shell with an active .venv: the Python from which it was made, as it may have to be made again.
      [[ $python != "$venv"/* ]] || python=$("$python" -c 'import sys; print(sys._base_executable)')
      python_version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
      return
    fi
  done
  die "Python 3.11 or later is needed: install it, or name it with PYTHON=/path/to/python3"
}

install_system_packages() {
  local missing=() package
  if have dpkg-query && have apt-get; then
    for package in "${debian_packages[@]}"; do
      [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2> /dev/null) == installed ]] || missing+=("$package")
    done
    # A Python that is not Debian's contains these two.
    "$python" -c 'import venv, ensurepip' 2> /dev/null || missing+=("python$python_version-venv")
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
  [[ -e $("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h ]]
}

apt_install() {
  local as_root=()
  say "Installing Debian packages: $*"
  if ((EUID != 0)); then
    have sudo || die "these packages need an administrator: apt-get install $*"
    as_root=(sudo)
  fi
  apt_get() { busy "$checkout/build/apt.log" '^(Get:[0-9]+|Unpacking|Setting up) .*' "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get "$@"; }
  # The lists may be absent or stale; an unreachable extra source must not stop the installation.
  apt_get update || say "apt-get update failed; trying with the existing lists"
  apt_get install --no-install-recommends -y "$@" || { tail -n 20 "$checkout/build/apt.log" >&2; die "apt-get could not install $*"; }
}

names_in() { grep -v '^#' "$1" | tr '\n' ' '; }

# The .venv of this checkout; it is made again if its requirements, the Python or the path of the checkout changed.
create_environment() {
  local stamp=$venv/installed wanted requirements=$checkout/tools/requirements.txt
  wanted=$(printf 'Python %s, %s\n' "$python_version" "$checkout"; cat "$requirements")
  if [[ -e $stamp && $(< "$stamp") == "$wanted" ]]; then return; fi
  say "Installing into $venv (about 30 s): $(names_in "$requirements")"
  # The stamp is removed first, because removing may be interrupted, too.
  rm -f "$stamp" "$checkout"/build/*/build.ninja
  rm -rf "$venv" "$checkout/build"
  busy "$checkout/build/venv.log" '' "$python" -m venv "$venv" || { cat "$checkout/build/venv.log" >&2; die "no environment: see above"; }
  pip_install -r "$requirements"
  printf '%s\n' "$wanted" > "$stamp"
}

# Additional requirements of tests and packages, by sets.
add_requirements() {
  local set requirements stamp
  for set in "$@"; do
    requirements=$checkout/tools/requirements_$set.txt
    stamp=$venv/installed_$set
    if cmp -s "$requirements" "$stamp"; then continue; fi
    say "Installing into $venv: $(names_in "$requirements")"
    pip_install -r "$requirements"
    # Tests start Python often, and may not be allowed to write bytecode.
    busy "$checkout/build/bytecode.log" '' "$venv/bin/python" -m compileall -q -j 0 "$venv/lib" || true
    cp "$requirements" "$stamp"
  done
}

# pip_install [OPTION]... [PACKAGE]...: into .venv.
pip_install() {
  local log=$checkout/build/pip.log
  # Bytecode of all packages would take most of the time, and a third of the space. run.sh makes it for the modules that it imports.
  busy "$log" '^ *(Collecting|Downloading|Installing) [^ ]*( [^ ]*)?' \
    "$venv/bin/python" -m pip install --disable-pip-version-check --progress-bar off --no-compile "$@" || {
    grep -vE '^ *(Collecting|Downloading|Using cached|Requirement already)' "$log" >&2 || true
    die "pip could not install $*: see above. Is the network there? To try again, start the same command again"
  }
}

# configure FOLDER [MESON OPTION]...: if that has not been done.
configure() {
  local folder=$1 log=$1.log
  shift
  [[ ! -e $folder/build.ninja ]] || return 0
  say "Configuring $folder"
  rm -rf "$folder"
  mkdir -p "$folder"
  busy "$log" '^[A-Z].*' meson setup "$folder" "$checkout" "$@" || {
    cat "$log" >&2
    rm -rf "$folder"
    die "configuring failed: see above"
  }
}

# build FOLDER [MESON OPTION]...: configure and compile.
build() {
  configure "$@"
  compile_in "$1"
}

# compile_in FOLDER [TARGET]...: prints a line if there is much to do. The output of the compilers goes to FOLDER-ninja.log.
compile_in() {
  local folder=$1 log=$1-ninja.log steps
  shift
  if [[ ! -e $folder/.ninja_log ]]; then
    say "Compiling $folder (half a minute on two idle cores) ..."
  else
    steps=$(ninja -C "$folder" -n "$@" 2> /dev/null | grep -c '^\[') || true
    ((steps < 20)) || say "Compiling what has changed in $folder ..."
  fi
  busy "$log" '^\[[0-9]+/[0-9]+\]' ninja -C "$folder" "$@" || {
    sed -n '/^FAILED/,$p' "$log" >&2
    die "compiling failed: see above"
  }
}

# The executable in .venv/bin and the package in .venv's site-packages. build_program does not add tests to a build without tests.
build_program() {
  ! is_prepared || return 0
  local site=$venv/lib/python$python_version/site-packages/dynstiction
  build "$release" --prefix="$venv" -Dpython.install_env=venv "$@"
  rm -rf "$site"
  meson install -C "$release" --quiet --no-rebuild
  load_completion
}

# The same with all tests.
build_release() {
  ! is_prepared || return 0
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
