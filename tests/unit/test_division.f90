!> The division of a sweep: every case in one share, shares of one size, and no grid in step with them.
program test_division
  use checks, only: check, finish
  use dst_division, only: division_t, place_in_shuffle
  use dst_kinds, only: wp
  use dst_text, only: integer_text
  implicit none

  integer :: cases

  do cases = 1, 400
    call check_bijection(cases)
  end do
  call check_bijection(1000000)
  call check_bijection(46341)
  call check('the shuffle ends for the largest sweep', place_in_shuffle(huge(1), huge(1)) > 0)
  do cases = 1, 40
    call check_shares(cases)
  end do
  call check_no_step(40, 40)
  call check_no_step(64, 64)
  call check_no_step(1000, 16)
  call finish()

contains

  !> Each place is that of one case.
  subroutine check_bijection(cases)
    integer, intent(in) :: cases
    logical, allocatable :: taken(:)
    integer :: i, place

    allocate (taken(cases))
    taken = .false.
    do i = 1, cases
      place = place_in_shuffle(i, cases)
      if (place >= 1 .and. place <= cases) taken(place) = .true.
    end do
    call check('a bijection of '//integer_text(cases), all(taken))
  end subroutine check_bijection

  !> Shares are as large as they say, and differ by one case at most.
  subroutine check_shares(cases)
    integer, intent(in) :: cases
    type(division_t) :: division
    integer :: i, held
    logical :: right

    right = .true.
    do i = 1, 60*60
      division = division_t(share=modulo(i - 1, 60) + 1, shares=(i - 1)/60 + 1)
      if (division%share > division%shares) cycle
      held = count_of(division, cases)
      right = right .and. held == division%size(cases) .and. held >= cases/division%shares &
        .and. held <= (cases - 1)/division%shares + 1
    end do
    call check('shares of '//integer_text(cases)//' cases', right)
  end subroutine check_shares

  integer function count_of(division, cases)
    type(division_t), intent(in) :: division
    integer, intent(in) :: cases
    integer :: i

    count_of = 0
    do i = 1, cases
      if (division%has(i, cases)) count_of = count_of + 1
    end do
  end function count_of

  !> The cases of a share stand in all columns of a grid, for any number of shares: of a shuffle by chance no column
  !> of a share is further from the mean than so many standard deviations.
  subroutine check_no_step(rows, columns)
    integer, intent(in) :: rows, columns
    real(wp), parameter :: most_deviations = 6.0_wp
    real(wp) :: mean, worst
    type(division_t) :: division
    integer :: held(columns), shares, share, i, column

    worst = 0.0_wp
    do shares = 2, 20
      mean = real(rows, wp)/shares
      do share = 1, shares
        division = division_t(share=share, shares=shares)
        held = 0
        do i = 1, rows*columns
          column = modulo(i - 1, columns) + 1
          if (division%has(i, rows*columns)) held(column) = held(column) + 1
        end do
        worst = max(worst, maxval(abs(held - mean))/sqrt(mean))
      end do
    end do
    call check('no step with '//integer_text(rows)//' x '//integer_text(columns), worst < most_deviations)
  end subroutine check_no_step
end program test_division
