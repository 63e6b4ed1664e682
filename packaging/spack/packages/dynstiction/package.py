"""Spack's recipe; see packaging/README.md."""

from spack.package import depends_on, extends, license, variant, version
from spack_repo.builtin.build_systems.meson import MesonPackage


class Dynstiction(MesonPackage):
    """Stick-slip simulation of a mass on misaligned, anisotropic springs: creep, dynamic stiction, slip, steady sliding."""

    license("MIT")

    # Built from a checkout or an unpacked source archive, by `spack dev-build`: there is no address to fetch one from.
    version("1.0.0")

    variant("openmp", default=True, description="Sweeps over several threads")

    extends("python@3.11:")
    depends_on("c", type="build")
    depends_on("fortran", type="build")
    depends_on("meson@1.2:", type="build")
    depends_on("ninja", type="build")
    depends_on("pkgconfig", type="build")
    depends_on("py-numpy@2:", type=("build", "run"))
    depends_on("py-h5py", type="run")
    depends_on("py-matplotlib", type="run")
    depends_on("py-scipy", type="run")
    depends_on("py-pandas", type="run")
    depends_on("py-xarray", type="run")
    depends_on("hdf5~mpi")
    depends_on("lapack")
    depends_on("zlib-api")

    def meson_args(self) -> list[str]:
        """Options of meson.options; Spack gives prefix and kind of build itself."""
        openmp = "enabled" if "+openmp" in self.spec else "disabled"
        return ["-Dtests=false", "-Dpython.install_env=prefix", f"-Dopenmp={openmp}"]
