!> Prints what `dynstiction template --json` prints, where the executable is not built.
program describer
  use, intrinsic :: iso_fortran_env, only: output_unit
  use dst_build_info, only: version
  use dst_catalogue, only: catalogue
  implicit none

  write (output_unit, '(a)', advance='no') catalogue(version)
end program describer
