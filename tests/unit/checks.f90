!> Shared by the unit tests: counting checks, comparing numbers, ending with a verdict.
module checks
  use, intrinsic :: iso_fortran_env, only: error_unit
  use dst_kinds, only: wp
  implicit none
  private

  public :: check, check_close, check_order, finish

  integer :: passed = 0, failed = 0

contains

  !> A condition that must be true.
  subroutine check(name, holds)
    character(*), intent(in) :: name
    logical, intent(in) :: holds

    if (holds) then
      passed = passed + 1
    else
      failed = failed + 1
      write (error_unit, '(a)') 'FAILED: '//name
    end if
  end subroutine check

  !> A number that must be within `tolerance` of the expected value.
  subroutine check_close(name, actual, expected, tolerance)
    character(*), intent(in) :: name
    real(wp), intent(in) :: actual, expected, tolerance
    character(120) :: text

    write (text, '(es23.16, a, es23.16, a, es8.1)') actual, ' instead of ', expected, ' within ', tolerance
    call check(name//': '//trim(adjustl(text)), abs(actual - expected) <= tolerance)
  end subroutine check_close

  !> An order of convergence: `coarse` and `fine` are errors, `refinement` the ratio of the steps.
  subroutine check_order(name, coarse, fine, refinement, expected, tolerance)
    character(*), intent(in) :: name
    real(wp), intent(in) :: coarse, fine, refinement, expected, tolerance

    call check_close(name//': observed order', log(coarse/fine)/log(refinement), expected, tolerance)
  end subroutine check_order

  !> Print the verdict; a failed check is a failed test.
  subroutine finish()
    print '(i0, " passed, ", i0, " failed")', passed, failed
    if (failed > 0) error stop 1
  end subroutine finish
end module checks
