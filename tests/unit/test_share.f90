!> Shares of a sweep: every case is in one of them, a share knows its rows, and a file its share.
program test_share
  use checks, only: check, finish
  use dst_share, only: share_t
  use dst_text, only: integer_text
  implicit none

  integer :: cases

  do cases = 1, 40
    call check_division(cases)
  end do
  call check_name('phi.h5', 'phi.3-of-16.h5')
  call check_name('a.b/phi', 'a.b/phi.3-of-16')
  call check_name('a.b/phi.x.h5', 'a.b/phi.x.3-of-16.h5')
  call check_name('.h5', '.h5.3-of-16')
  call finish()

contains

  !> Cases of all shares are those of the sweep, in order, and as evenly divided as can be.
  subroutine check_division(cases)
    integer, intent(in) :: cases
    type(share_t) :: share
    integer :: taken(cases), i, n, row
    logical :: is_even

    do n = 1, cases + 3
      taken = 0
      is_even = .true.
      do i = 1, n
        share = share_t(i, n)
        is_even = is_even .and. abs(share%size(cases) - cases/n) <= 1
        do row = 1, share%size(cases)
          taken(share%case_of(row)) = taken(share%case_of(row)) + 1
        end do
      end do
      call check(integer_text(cases)//' cases in '//integer_text(n)//' shares', all(taken == 1) .and. is_even)
    end do
  end subroutine check_division

  subroutine check_name(result_file, expected)
    character(*), intent(in) :: result_file, expected
    type(share_t) :: share

    share = share_t(3, 16)
    call check('the file of share 3/16 of '//result_file, share%file_name(result_file) == expected)
    share = share_t()
    call check('all of '//result_file, share%file_name(result_file) == result_file)
  end subroutine check_name
end program test_share
