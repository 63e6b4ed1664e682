!> Measures how long something takes.
module dst_stopwatch
  use dst_kinds, only: wp, int64
  implicit none
  private

  public :: wall_clock

contains

  !> Wall-clock time [s] from an arbitrary origin.
  real(wp) function wall_clock()
    integer(int64) :: count, rate

    call system_clock(count, rate)
    wall_clock = real(count, wp)/real(rate, wp)
  end function wall_clock
end module dst_stopwatch
