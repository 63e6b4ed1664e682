!> The division of a sweep: every case is in one share, shares have equal sizes, and no grid is in step with them.
program test_division
  use checks, only: check, finish
  use dst_division, only: division_t
  use dst_kinds, only: wp
  use dst_text, only: integer_text
  implicit none

  integer :: cases

  call check_rows(1, 1000)
  call check_rows(7, 1000)
  call check_rows(64, 3000)
  call check_rows(1000, 50)
  call check_rows(999999, 3)
  do cases = 1, 40
    call check_shares(cases)
  end do
  call check_no_step(40, 40)
  call check_no_step(64, 64)
  call check_no_step(1000, 16)
  call finish()

contains

  !> In each row of as many cases as shares every share has one; also in the last rows of the largest sweep.
  subroutine check_rows(shares, rows)
    integer, intent(in) :: shares, rows
    integer, parameter :: most_cases = 1000000000
    type(division_t) :: division
    logical, allocatable :: taken(:)
    integer :: first, row, i
    logical :: right

    division%shares = shares
    allocate (taken(shares))
    right = .true.
    do row = 0, rows - 1
      first = row*shares
      if (row > rows/2) first = (most_cases/shares - row)*shares
      taken = .false.
      do i = 1, shares
        taken(division%share_of(first + i)) = .true.
      end do
      right = right .and. all(taken)
    end do
    call check('rows of '//integer_text(shares), right)
  end subroutine check_rows

  !> Shares have the stated size, and differ by one case at most.
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
      if (division%has(i)) count_of = count_of + 1
    end do
  end function count_of

  !> The cases of a share are in all columns of a grid, for any number of shares: no column of a share differs from the mean by more
  !> than this number of standard deviations of chance.
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
          if (division%has(i)) held(column) = held(column) + 1
        end do
        worst = max(worst, maxval(abs(held - mean))/sqrt(mean))
      end do
    end do
    call check('no step with '//integer_text(rows)//' x '//integer_text(columns), worst < most_deviations)
  end subroutine check_no_step
end program test_division
