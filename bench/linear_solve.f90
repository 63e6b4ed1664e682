!> Time of one small dense solve: Gauss-Jordan with fixed order (as Newton's kernels compile it),
!> the same with the order as an argument, and LAPACK's dgesv.
!>
!>     meson compile -C build/release bench_linear_solve && build/release/bench/bench_linear_solve [--short]
program bench_linear_solve
  use, intrinsic :: iso_fortran_env, only: int64
  use dst_kinds, only: wp
  use dst_linear_solve, only: solve_in_place
  implicit none

  interface
    subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
      import :: wp
      integer, intent(in) :: n, nrhs, lda, ldb
      real(wp), intent(inout) :: a(lda, *), b(ldb, *)
      integer, intent(out) :: ipiv(*), info
    end subroutine dgesv
  end interface

  integer, parameter :: rounds = 5
  integer, parameter :: orders(3) = [6, 10, 14]
  integer :: i, repetitions
  character(8) :: argument

  repetitions = 200000
  call get_command_argument(1, argument)
  if (argument == '--short') repetitions = 2000
  print '(a)', 'order   fixed [us]   argument [us]   dgesv [us]   (best of 5 rounds)'
  do i = 1, size(orders)
    print '(i5, 3f14.3)', orders(i), best(orders(i), 1), best(orders(i), 2), best(orders(i), 3)
  end do

contains

  !> Least time of one solve [us] over the rounds.
  real(wp) function best(order, solver)
    integer, intent(in) :: order, solver
    real(wp) :: matrix(order, order), a(order, order), b(order), total
    integer :: pivots(order), info, repetition, round
    integer(int64) :: begun, ended, rate
    logical :: zero_pivot

    call random_number(matrix)
    best = huge(best)
    total = 0.0_wp
    do round = 1, rounds
      call system_clock(begun, rate)
      do repetition = 1, repetitions
        a = matrix
        b = 1.0_wp
        select case (solver)
        case (1)
          call solve_fixed(order, a, b)
        case (2)
          call solve_in_place(order, a, b, zero_pivot)
        case default
          call dgesv(order, 1, a, order, pivots, b, order, info)
        end select
        total = total + b(1)
      end do
      call system_clock(ended)
      best = min(best, 1.0e6_wp*real(ended - begun, wp)/(real(rate, wp)*repetitions))
    end do
    if (total > huge(total)) print *, total
  end function best

  subroutine solve_fixed(order, a, b)
    integer, intent(in) :: order
    real(wp), intent(inout) :: a(order, order), b(order)
    logical :: zero_pivot

    select case (order)
    case (6)
      call solve_6(a, b, zero_pivot)
    case (10)
      call solve_10(a, b, zero_pivot)
    case default
      call solve_14(a, b, zero_pivot)
    end select
  end subroutine solve_fixed

  subroutine solve_6(a, b, zero_pivot)
    integer, parameter :: order = 6
    real(wp), intent(inout) :: a(order, order), b(order, 1)
    logical, intent(out) :: zero_pivot
    include '../src/numerics/gauss_jordan.inc'
  end subroutine solve_6

  subroutine solve_10(a, b, zero_pivot)
    integer, parameter :: order = 10
    real(wp), intent(inout) :: a(order, order), b(order, 1)
    logical, intent(out) :: zero_pivot
    include '../src/numerics/gauss_jordan.inc'
  end subroutine solve_10

  subroutine solve_14(a, b, zero_pivot)
    integer, parameter :: order = 14
    real(wp), intent(inout) :: a(order, order), b(order, 1)
    logical, intent(out) :: zero_pivot
    include '../src/numerics/gauss_jordan.inc'
  end subroutine solve_14
end program bench_linear_solve
