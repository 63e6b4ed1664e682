!> The one working precision of the code and the constants that depend on it.
module dst_kinds
  use, intrinsic :: iso_fortran_env, only: real64, int64
  implicit none
  private

  public :: wp, int64, pi, degree

  !> Working precision of every real number in the core.
  integer, parameter :: wp = real64

  real(wp), parameter :: pi = acos(-1.0_wp)
  !> One degree in radians.
  real(wp), parameter :: degree = pi/180.0_wp
end module dst_kinds
