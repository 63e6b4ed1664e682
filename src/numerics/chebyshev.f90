!> Polynomials through values at Chebyshev points of the first kind, x_j = cos(pi (j - 1/2)/n), j = 1 ... n, in [-1, 1].
!>
!> Source: Trefethen, Approximation Theory and Approximation Practice (SIAM 2013), chapters 2, 3 and 5.
module dst_chebyshev
  use dst_kinds, only: wp, pi
  implicit none
  private

  public :: chebyshev_points, chebyshev_polynomials, chebyshev_coefficients, chebyshev_derivative, cardinal_functions

contains

  !> The points, in falling order.
  pure function chebyshev_points(n) result(x)
    integer, intent(in) :: n
    real(wp) :: x(n)
    integer :: j

    x = 0.0_wp
    do j = 1, n/2
      x(j) = cos(pi*(real(j, wp) - 0.5_wp)/real(n, wp))
      x(n + 1 - j) = -x(j)
    end do
  end function chebyshev_points

  !> T_0(x) ... T_{n-1}(x).
  pure subroutine chebyshev_polynomials(n, x, polynomial)
    integer, intent(in) :: n
    real(wp), intent(in) :: x
    real(wp), intent(out) :: polynomial(n)
    integer :: k

    polynomial(1) = 1.0_wp
    if (n > 1) polynomial(2) = x
    do k = 3, n
      polynomial(k) = 2.0_wp*x*polynomial(k - 1) - polynomial(k - 2)
    end do
  end subroutine chebyshev_polynomials

  !> Coefficients of T_0 ... T_{n-1} from values at the n points, column by column.
  pure function chebyshev_coefficients(values) result(coefficient)
    real(wp), intent(in) :: values(:, :)
    real(wp) :: coefficient(size(values, 1), size(values, 2))
    integer :: j, k, n

    n = size(values, 1)
    do k = 1, n
      coefficient(k, :) = 0.0_wp
      do j = 1, n
        coefficient(k, :) = coefficient(k, :) + values(j, :)*cos(pi*real(modulo((k - 1)*(2*j - 1), 4*n), wp)/real(2*n, wp))
      end do
      coefficient(k, :) = coefficient(k, :)*(merge(1.0_wp, 2.0_wp, k == 1)/real(n, wp))
    end do
  end function chebyshev_coefficients

  !> Coefficients of the derivative of a series in Chebyshev polynomials.
  pure function chebyshev_derivative(coefficient) result(derivative)
    real(wp), intent(in) :: coefficient(:)
    real(wp) :: derivative(size(coefficient)), next(0:size(coefficient) + 1)
    integer :: k

    next = 0.0_wp
    do k = size(coefficient) - 1, 1, -1
      next(k - 1) = next(k + 1) + 2.0_wp*real(k, wp)*coefficient(k + 1)
    end do
    derivative = next(0:size(coefficient) - 1)
    derivative(1) = 0.5_wp*derivative(1)
  end function chebyshev_derivative

  !> The polynomials that are 1 at one of the n points and 0 at the others, at x (barycentric formula).
  pure subroutine cardinal_functions(n, points, x, cardinal)
    integer, intent(in) :: n
    real(wp), intent(in) :: points(n)     !! from `chebyshev_points`
    real(wp), intent(in) :: x
    real(wp), intent(out) :: cardinal(n)
    integer :: j, hit

    hit = 0
    do j = 1, n
      if (.not. abs(x - points(j)) > 0.0_wp) hit = j
    end do
    if (hit > 0) then
      cardinal = 0.0_wp
      cardinal(hit) = 1.0_wp
      return
    end if
    ! The weights (-1)^j sin(pi (j - 1/2)/n) are sqrt(1 - x_j^2) with changing signs.
    do j = 1, n
      cardinal(j) = sqrt((1.0_wp - points(j))*(1.0_wp + points(j)))/(x - points(j))
      if (modulo(j, 2) == 0) cardinal(j) = -cardinal(j)
    end do
    cardinal = cardinal/sum(cardinal)
  end subroutine cardinal_functions
end module dst_chebyshev
