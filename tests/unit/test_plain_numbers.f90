!> Numbers for people: short, with a digit before the point, and exact to three digits.
program test_plain_numbers
  use checks, only: check, finish
  use dst_kinds, only: wp
  use dst_plain_numbers, only: number_text, bytes_text, duration_text
  use dst_text, only: read_real, short_text, word
  implicit none

  real(wp), parameter :: number(8) = [0.0_wp, 0.5_wp, 12.0_wp, -0.25_wp, 1234.56_wp, 999.7_wp, 1.23e6_wp, 1.0e-7_wp]
  character(*), parameter :: numbers = '0 0.5 12 -0.25 1235 1000 1.23e6 1e-7'
  real(wp), parameter :: byte(4) = [12.0_wp, 1500.0_wp, 999.9e9_wp, 1.0e25_wp]
  character(8), parameter :: bytes(4) = [character(8) :: '12 bytes', '1.5 kB', '1 TB', '1e7 EB']
  real(wp), parameter :: second(9) = [0.5_wp, 0.0_wp, 59.4_wp, 59.6_wp, 200.0_wp, 3599.9_wp, 7500.0_wp, 100.0_wp*3600.0_wp, &
    1.0e300_wp]
  character(11), parameter :: duration(9) = [character(11) :: '0.5 s', '0 s', '59 s', '1 min', '3 min 20 s', '1 h', '2 h 5 min', &
    '4 d 4 h', 'over 1000 d']
  integer :: i

  do i = 1, size(number)
    call check(word(numbers, i), number_text(number(i)) == word(numbers, i))
  end do
  do i = 1, size(byte)
    call check(bytes(i), bytes_text(byte(i)) == bytes(i))
  end do
  do i = 1, size(second)
    call check(duration(i), duration_text(second(i)) == duration(i))
  end do
  call everywhere()
  call texts_of_the_solver()
  call finish()

contains

  !> A number of any magnitude reads back to within half a unit of its third digit, begins with a digit, and is short.
  subroutine everywhere()
    real(wp) :: value, again
    character(:), allocatable :: text, problem
    logical :: near, short, plain
    integer :: i

    near = .true.
    short = .true.
    plain = .true.
    do i = -3000, 3000
      value = 10.0_wp**(0.1_wp*i)*(1.0_wp + 1.0e-3_wp*modulo(i, 7))
      text = number_text(value)
      call read_real(text, again, problem)
      near = near .and. problem == '' .and. abs(again - value) <= 5.01e-3_wp*value
      short = short .and. len(text) <= 9
      plain = plain .and. scan(text(1:1), '0123456789') == 1 .and. scan(text(len(text):), '0123456789') == 1
    end do
    call check('near to the value', near)
    call check('short', short)
    call check('begins and ends with a digit', plain)
  end subroutine everywhere

  !> Texts of fixed length have room for every number, of either sign, to five digits.
  subroutine texts_of_the_solver()
    real(wp), parameter :: special(*) = [0.0_wp, 9.99999_wp, 99999.6_wp, 1.0e-4_wp]
    real(wp) :: value
    logical :: near
    integer :: i

    near = .true.
    do i = -3070, 3079
      value = 10.0_wp**(0.1_wp*i)*(1.0_wp + 1.0e-3_wp*modulo(i, 7))
      near = near .and. is_near(value) .and. is_near(-value)
    end do
    do i = 1, size(special)
      near = near .and. is_near(special(i)) .and. is_near(-special(i))
    end do
    call check('near to the value in a fixed length', near)
    call check('the longest', index(short_text(-tiny(1.0_wp)), '-2.2251e-308') == 1 .or. wp /= kind(1.0d0))
    call check('-0.25 in a fixed length', short_text(-0.25_wp) == '-0.25')
    call check('1.5e-7 in a fixed length', short_text(1.5e-7_wp) == '1.5e-7')
  end subroutine texts_of_the_solver

  logical function is_near(value)
    real(wp), intent(in) :: value
    character(:), allocatable :: problem
    real(wp) :: again

    call read_real(trim(short_text(value)), again, problem)
    is_near = problem == '' .and. abs(again - value) <= 5.01e-5_wp*abs(value)
  end function is_near
end program test_plain_numbers
