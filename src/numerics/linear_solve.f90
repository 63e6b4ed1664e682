!> Solution of one small dense linear system.
!>
!> LAPACK's dgesv does the same; for orders up to 14 its overhead costs more than the arithmetic.
!> Newton's kernels include the body with the order fixed; this module has it for any order.
module dst_linear_solve
  use dst_kinds, only: wp
  implicit none
  private

  public :: solve_in_place

contains

  !> Overwrite `b` with the solution of a x = b; `a` is destroyed. `zero_pivot` if a pivot is zero or not a number; then b has no
  !> meaning.
  pure subroutine solve_in_place(order, a, b, zero_pivot)
    integer, intent(in) :: order
    real(wp), intent(inout) :: a(order, order), b(order)
    logical, intent(out) :: zero_pivot

    if (order == 1) then
      zero_pivot = .not. abs(a(1, 1)) > 0.0_wp
      if (.not. zero_pivot) b(1) = b(1)/a(1, 1)
      return
    end if
    call eliminate(order, a, b, zero_pivot)
  end subroutine solve_in_place

  pure subroutine eliminate(order, a, b, zero_pivot)
    integer, intent(in) :: order
    real(wp), intent(inout) :: a(order, order), b(order, 1)
    logical, intent(out) :: zero_pivot
    include 'gauss_jordan.inc'
  end subroutine eliminate
end module dst_linear_solve
