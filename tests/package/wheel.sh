#!/usr/bin/env bash
# tests/package/wheel.sh [WHEEL]: does the wheel (by default one that tools/wheel.sh makes now) work where HDF5, LAPACK and
# gfortran's libraries are not?
#
# In a mount namespace each file of these libraries is an empty one. Where the system permits no namespace, only what the
# loader finds is checked, and a line says so.

source "$(dirname "${BASH_SOURCE[0]}")/checks.sh"

help_if_wanted "$@"

prepare
if (($# > 0)); then
  wheel=$(realpath "$1")
else
  "$checkout/tools/wheel.sh" "$scratch/dist" > /dev/null
  wheel=$(ls "$scratch"/dist/*.whl)
fi
clean=$scratch/clean
unwanted='lib(hdf5.*|gfortran|quadmath|gomp|lapack.*|blas.*|openblas.*|sz|aec|curl.*)\.so[^/]*'

# within COMMAND...: where the unwanted libraries are not, in the scratch folder, without the PATH of the checkout.
within() {
  local prelude=
  [[ $hidden == no ]] || prelude='while read -r file; do mount --bind "$0" "$file" || exit 99; done < unwanted.txt; '
  (cd "$scratch" && PATH=$clean/bin:/usr/local/bin:/usr/bin:/bin \
    "${namespace[@]}" bash -c "$prelude"'exec "$@"' "$scratch/empty" "$@")
}

list_unwanted() {
  find /lib /usr/lib /usr/local/lib "$venv/lib" -regextype posix-extended -type f -regex ".*/$unwanted" ! -path '*/site-packages/*' -exec realpath {} + |
    sort -u > "$scratch/unwanted.txt"
}

# What the loader finds for the files of the wheel, besides what lies in it and what every Linux has.
foreign_libraries() {
  local file
  while read -r file; do
    ldd "$file" | awk '/=>/ { print $3 }' | grep -vE "^$clean/|/(libc|libm|libmvec|libz|libgcc_s|libdl|libpthread|librt)\.so" || true
  done < <(find "$clean" -path '*dynstiction*' \( -name '*.so*' -o -path '*/bin/dynstiction' \) -type f)
}

no_foreign_libraries() { [[ -z $(foreign_libraries | tee /dev/stderr) ]]; }

first_picture() {
  within dynstiction run fig3.nml --quiet --overwrite
  within python -m dynstiction plot fig3.h5 -o fig3.png
}

touch "$scratch/empty"
list_unwanted
hidden=yes
namespace=(unshare --map-root-user --mount)
if ! "${namespace[@]}" true 2> /dev/null; then
  hidden=no
  namespace=()
  say 'This system permits no mount namespace: the libraries are not hidden, only what the loader finds is checked.'
fi

cp "$checkout/inputs/fig3.nml" "$scratch/"
"$python" -m venv "$clean"
timed "$clean/bin/python" -m pip install --disable-pip-version-check "$wheel"
with_dependencies=$seconds
timed "$clean/bin/python" -m pip uninstall --yes dynstiction
files_below "$clean" > "$scratch/before.txt"
timed "$clean/bin/python" -m pip install --disable-pip-version-check --no-index --no-deps "$wheel"
alone=$seconds

if [[ $hidden == yes ]]; then
  check 'the libraries are hidden' fails within python -c 'import ctypes; ctypes.CDLL("libgfortran.so.5")'
fi
check 'nothing outside the wheel is loaded' no_foreign_libraries
check 'no path of this machine is a run path' fails grep -qE 'R(UN)?PATH.*\[[^$]' <(find "$clean" -path '*dynstiction*' -type f -name '*.so*' -exec readelf -d {} +; readelf -d "$clean/bin/dynstiction")
timed first_picture
picture=$seconds
check 'the executable has run to the end' within python -c 'import dynstiction as ds; r = ds.open("fig3.h5"); assert r.time[-1] == 10.0'
check 'a picture' within python -c 'import matplotlib.image as m; assert m.imread("fig3.png").std() > 0.05'
check 'Python and executable count the same sticks' within python -c '
import dynstiction as ds
assert ds.run("fig3.nml").sticks() == ds.open("fig3.h5").sticks() > 5000'
check 'the installed wheel has its decks' within python -c '
import dynstiction, pathlib
assert (pathlib.Path(dynstiction.__file__).parent / "inputs" / "fig3.nml").read_text() == open("fig3.nml").read()'
check 'a sweep runs in threads' within python -c '
import os; os.environ["OMP_NUM_THREADS"] = "2"
import subprocess
text = open("fig3.nml").read() + "&sweep\n parameter = \"system.misalignment_deg\" first = 1 last = 4 count = 4\n/\n"
open("sweep.nml", "w").write(text)
subprocess.run(["dynstiction", "run", "sweep.nml", "-o", "sweep.h5", "--quiet", "--set", "scene.t_end=0.01"], check=True)'
check 'uninstall' "$clean/bin/python" -m pip uninstall --yes dynstiction
check 'uninstall leaves nothing' diff "$scratch/before.txt" <(files_below "$clean")

say "$(basename "$wheel"), $(($(stat -c %s "$wheel") / 1000)) kB; libraries hidden: $hidden"
say "pip install with dependencies $with_dependencies s, of the wheel alone $alone s; run and first picture $picture s"
summary 'Wheel'
