!> Reproducible random numbers for the unit tests.
module random_numbers
  use dst_kinds, only: int64, wp
  implicit none
  private

  public :: start_random, uniform, log_uniform

contains

  !> Begin the sequence with this number.
  subroutine start_random(number)
    integer, intent(in) :: number
    integer :: n, i

    call random_seed(size=n)
    call random_seed(put=[(int(modulo(104729_int64*number + 7919*i, int(huge(1), int64))), i=1, n)])
  end subroutine start_random

  !> n numbers between `low` and `high`.
  function uniform(n, low, high) result(numbers)
    integer, intent(in) :: n
    real(wp), intent(in) :: low, high
    real(wp) :: numbers(n)

    call random_number(numbers)
    numbers = low + (high - low)*numbers
  end function uniform

  !> A number whose logarithm is uniformly distributed between those of `low` and `high`.
  real(wp) function log_uniform(low, high)
    real(wp), intent(in) :: low, high

    log_uniform = exp(sum(uniform(1, log(low), log(high))))
  end function log_uniform
end module random_numbers
