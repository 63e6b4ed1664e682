!> Numbers for people: few digits, sizes and times in units that fit.
module dst_plain_numbers
  use dst_kinds, only: wp, int64
  use dst_text, only: integer_text, short_text
  implicit none
  private

  public :: number_text, long_text, bytes_text, duration_text

contains

  !> The same as `short_text`, of the length that is needed: up to `figures` (3) significant digits. What has fewer digits than
  !> other numbers have is 0: a reader cannot distinguish the two.
  pure function number_text(value, figures) result(text)
    real(wp), intent(in) :: value
    integer, intent(in), optional :: figures
    character(:), allocatable :: text
    integer :: wanted

    wanted = 3
    if (present(figures)) wanted = figures
    text = trim(short_text(merge(0.0_wp, value, abs(value) <= tiny(value)), wanted))
  end function number_text

  !> Ten digits, for tables with which other programs compute.
  pure function long_text(value) result(text)
    real(wp), intent(in) :: value
    character(:), allocatable :: text

    text = number_text(value, 10)
  end function long_text

  !> '12 bytes', '1.5 kB', '80 GB': decimal units, as disk tools use them.
  pure function bytes_text(bytes) result(text)
    real(wp), intent(in) :: bytes
    character(:), allocatable :: text
    character(5), parameter :: units(7) = [character(5) :: 'bytes', 'kB', 'MB', 'GB', 'TB', 'PB', 'EB']
    real(wp) :: count
    integer :: i

    count = bytes
    do i = 1, size(units) - 1
      if (count < 999.5_wp) exit
      count = count/1.0e3_wp
    end do
    text = number_text(count)//' '//trim(units(i))
  end function bytes_text

  !> '0.5 s', '12 s', '3 min 20 s', '2 h 5 min', '3 d 4 h', 'over 1000 d'.
  pure function duration_text(seconds) result(text)
    real(wp), intent(in) :: seconds
    character(:), allocatable :: text
    real(wp), parameter :: minute = 60.0_wp, hour = 60.0_wp*minute, day = 24.0_wp*hour

    if (.not. seconds < 1.0e3_wp*day) then
      text = 'over 1000 d'
    else if (seconds < 9.5_wp) then
      text = number_text(anint(10.0_wp*seconds)/10.0_wp)//' s'
    else if (seconds < minute - 0.5_wp) then
      text = integer_text(nint(seconds))//' s'
    else if (seconds < hour - 0.5_wp) then
      text = two_units(anint(seconds), 60_int64, ' min', ' s')
    else if (seconds < day - 0.5_wp*minute) then
      text = two_units(anint(seconds/minute), 60_int64, ' h', ' min')
    else
      text = two_units(anint(seconds/hour), 24_int64, ' d', ' h')
    end if
  end function duration_text

  !> `count` of the smaller unit as a sum of larger and smaller ones; the smaller unit is left out if its number is 0.
  pure function two_units(count, each, larger, smaller) result(text)
    real(wp), intent(in) :: count
    integer(int64), intent(in) :: each
    character(*), intent(in) :: larger, smaller
    character(:), allocatable :: text
    integer(int64) :: whole

    whole = nint(count, int64)
    text = integer_text(whole/each)//larger
    if (modulo(whole, each) > 0) text = text//' '//integer_text(modulo(whole, each))//smaller
  end function two_units
end module dst_plain_numbers
