# Sourced by run.sh and test.sh: installs what is missing and builds, and says so before it does.
# Nothing but the apt packages below is installed outside the checkout. A rerun with nothing changed takes seconds.

set -euo pipefail

checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$checkout/.venv
release=$checkout/build/release

debian_packages=(gfortran gcc libc6-dev pkg-config libhdf5-dev hdf5-tools liblapack-dev)

say() { printf '%s\n' "$*" >&2; }
die() { say "${0##*/}: $*"; exit 1; }
have() { command -v "$1" > /dev/null; }

# Everything that the two commands need; afterwards .venv/bin comes first on PATH.
prepare() {
  find_python
  install_system_packages
  create_environment
  export PATH=$venv/bin:$PATH
}

find_python() {
  local candidate
  for candidate in "${PYTHON:-python3}" python3 python3.{14,13,12,11}; do
    if have "$candidate" && "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null; then
      python=$(command -v "$candidate")
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
    # A Python that is not Debian's brings these two itself.
    "$python" -c 'import venv, ensurepip' 2> /dev/null || missing+=("python$python_version-venv")
    has_python_headers || missing+=("python$python_version-dev")
    ((${#missing[@]} == 0)) || apt_install "${missing[@]}"
  else
    for package in gfortran gcc pkg-config h5fc; do
      have "$package" || missing+=("$package")
    done
    ((${#missing[@]} == 0)) || die "not found: ${missing[*]}. Install with your package manager: a Fortran and a C compiler," \
      "pkg-config, HDF5 with its Fortran interface (h5fc) and LAPACK, with their development files"
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
  apt_get() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq "$@" < /dev/null > /dev/null; }
  # The lists may be absent or stale; an unreachable extra source must not stop the installation.
  apt_get update || say "apt-get update failed; trying with the lists that are here"
  apt_get install --no-install-recommends -y "$@" || die "apt-get could not install $*"
}

# The .venv of this checkout; made anew when the requirements, the Python or the checkout's place changed.
create_environment() {
  local stamp=$venv/installed wanted
  wanted=$(printf 'Python %s, %s\n' "$python_version" "$checkout"; cat "$checkout/tools/requirements.txt")
  if [[ -e $stamp && $(< "$stamp") == "$wanted" ]]; then return; fi
  say "Installing into $venv: $(grep -v '^#' "$checkout/tools/requirements.txt" | tr '\n' ' ')"
  rm -rf "$venv" "$checkout/build"
  "$python" -m venv "$venv"
  "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$checkout/tools/requirements.txt" >&2
  printf '%s\n' "$wanted" > "$stamp"
}

# build FOLDER [MESON OPTION]...: configure where that has not been done, and compile.
build() {
  local folder=$1 log
  shift
  if [[ ! -e $folder/build.ninja ]]; then
    say "Configuring $folder"
    rm -rf "$folder"
    mkdir -p "$folder"
    log=$folder.log
    if ! meson setup "$folder" "$checkout" "$@" > "$log" 2>&1; then
      cat "$log" >&2
      rm -rf "$folder"
      die "configuring failed: see above"
    fi
  fi
  ninja -C "$folder" --quiet >&2 || die "compiling failed: see above"
}

# The executable in .venv/bin and the package in .venv's site-packages.
build_release() {
  build "$release" --prefix="$venv" -Dpython.install_env=venv
  rm -rf "$venv/lib/python$python_version/site-packages/dynstiction"
  meson install -C "$release" --quiet --no-rebuild
}
