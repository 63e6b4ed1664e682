!> The time of day, and waiting.
module dst_clock
  use, intrinsic :: iso_c_binding, only: c_double
  use dst_kinds, only: wp, int64
  use dst_posix, only: c_utc, c_wait, seconds_now
  implicit none
  private

  public :: utc_now, utc_at, seconds_now, wait_seconds

contains

  !> Now, as ISO 8601 in UTC: '2026-01-31T23:59:59Z'.
  character(20) function utc_now()
    utc_now = utc_at(seconds_now())
  end function utc_now

  !> The same for a moment in seconds since 1970; '*' if the year has more than four digits.
  character(20) function utc_at(seconds)
    integer(int64), intent(in) :: seconds
    character(21) :: text

    utc_at = '****-**-**T**:**:**Z'
    if (c_utc(seconds, text) == 1) utc_at = text(:20)
  end function utc_at

  !> Wait for some time.
  subroutine wait_seconds(seconds)
    real(wp), intent(in) :: seconds

    call c_wait(real(seconds, c_double))
  end subroutine wait_seconds
end module dst_clock
