!> Solution of one small dense linear system by LU factorisation with partial pivoting.
!>
!> LAPACK's dgesv does the same; below order 20 its overhead costs more than the arithmetic
!> (bench/small_lu measures both).
module dst_small_lu
  use dst_kinds, only: wp
  implicit none
  private

  public :: solve_in_place

contains

  !> Overwrite `b` with the solution of a x = b, and `a` with its factors. `singular` when a pivot
  !> is zero or not a number; then b has no meaning.
  pure subroutine solve_in_place(n, a, b, singular)
    integer, intent(in) :: n
    real(wp), intent(inout) :: a(n, n), b(n)
    logical, intent(out) :: singular
    real(wp) :: largest, factor, swap
    integer :: i, j, k, pivot

    singular = .true.
    do k = 1, n
      pivot = k
      largest = abs(a(k, k))
      do i = k + 1, n
        if (abs(a(i, k)) > largest) then
          largest = abs(a(i, k))
          pivot = i
        end if
      end do
      if (.not. largest > 0.0_wp) return
      if (pivot /= k) then
        do j = k, n
          swap = a(k, j)
          a(k, j) = a(pivot, j)
          a(pivot, j) = swap
        end do
        swap = b(k)
        b(k) = b(pivot)
        b(pivot) = swap
      end if
      factor = 1.0_wp/a(k, k)
      a(k + 1:n, k) = a(k + 1:n, k)*factor
      do j = k + 1, n
        a(k + 1:n, j) = a(k + 1:n, j) - a(k, j)*a(k + 1:n, k)
      end do
      b(k + 1:n) = b(k + 1:n) - b(k)*a(k + 1:n, k)
      a(k, k) = factor
    end do
    do k = n, 1, -1
      b(k) = b(k)*a(k, k)
      b(1:k - 1) = b(1:k - 1) - b(k)*a(1:k - 1, k)
    end do
    singular = .false.
  end subroutine solve_in_place
end module dst_small_lu
