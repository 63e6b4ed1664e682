!> The working precision of the code, which is chosen in the build, and the constants that depend on it.
module dst_kinds
  use, intrinsic :: iso_fortran_env, only: real64, int64
  use dst_precision, only: wp
  implicit none
  private

  public :: wp, real64, int64, pi, degree

  real(wp), parameter :: pi = acos(-1.0_wp)
  !> One degree in radians.
  real(wp), parameter :: degree = pi/180.0_wp
end module dst_kinds
