!> All roots of a real polynomial of low degree, by Laguerre's method with deflation.
module dst_polynomial_roots
  use dst_kinds, only: wp
  implicit none
  private

  public :: polynomial_roots

  !> Convention: Laguerre's method converges in a few iterations. Twice and half: no change.
  integer, parameter :: max_iterations = 80
  !> Roundoff of a value over its bound from Horner's scheme, with a margin. Twice: no change.
  real(wp), parameter :: value_roundoff = 4.0_wp*epsilon(1.0_wp)

contains

  !> Roots of sum_k coefficient(k) x^k; the leading coefficient must not be zero. The roots of small magnitude come first, which
  !> keeps the deflation accurate; complex ones come in pairs.
  pure subroutine polynomial_roots(coefficient, root)
    real(wp), intent(in) :: coefficient(0:)
    complex(wp), intent(out) :: root(:)
    real(wp) :: c(0:ubound(coefficient, 1)), unit
    complex(wp) :: found
    integer :: degree, k, n

    n = ubound(coefficient, 1)
    ! In units in which the product of the roots is 1, so that their magnitude neither overflows nor underflows.
    unit = 1.0_wp
    if (abs(coefficient(0)) > 0.0_wp) unit = (abs(coefficient(0)/coefficient(n)))**(1.0_wp/real(n, wp))
    c = [(coefficient(k)/coefficient(n)*unit**(k - n), k=0, n)]
    degree = n
    do while (degree > 2)
      found = one_root(degree, c(0:degree))
      root(n - degree + 1) = found
      if (abs(aimag(found)) > epsilon(1.0_wp)*abs(found)) then
        root(n - degree + 2) = conjg(found)
        call divide(degree, c(0:degree), [abs(found)**2, -2.0_wp*real(found)])
        degree = degree - 2
      else
        call divide(degree, c(0:degree), [-real(found)])
        degree = degree - 1
      end if
    end do
    if (degree == 2) root(n - 1:n) = roots_of_quadratic(c(0:2))
    if (degree == 1) root(n) = -c(0)/c(1)
    root = unit*root
  end subroutine polynomial_roots

  !> Divide a polynomial by its factor x^m + sum_k factor(k) x^(k - 1), m = size(factor).
  pure subroutine divide(degree, c, factor)
    integer, intent(in) :: degree
    real(wp), intent(inout) :: c(0:degree)
    real(wp), intent(in) :: factor(:)
    integer :: k, m

    m = size(factor)
    do k = degree, m, -1
      c(k - m:k - 1) = c(k - m:k - 1) - c(k)*factor
    end do
    c(0:degree - m) = c(m:degree)
  end subroutine divide

  !> Both roots of c(0) + c(1) x + c(2) x^2, without cancellation.
  pure function roots_of_quadratic(c) result(root)
    real(wp), intent(in) :: c(0:2)
    complex(wp) :: root(2)
    real(wp) :: discriminant, larger

    discriminant = c(1)**2 - 4.0_wp*c(0)*c(2)
    if (discriminant < 0.0_wp) then
      root(1) = cmplx(-c(1), sqrt(-discriminant), wp)/(2.0_wp*c(2))
      root(2) = conjg(root(1))
    else
      larger = -0.5_wp*(c(1) + sign(sqrt(discriminant), c(1)))
      root = 0.0_wp
      if (abs(larger) > 0.0_wp) root = [c(0)/larger, larger/c(2)]
    end if
  end function roots_of_quadratic

  !> One root, found from 0.
  pure complex(wp) function one_root(n, c) result(x)
    integer, intent(in) :: n
    real(wp), intent(in) :: c(0:n)
    complex(wp) :: value, slope, curve, ratio, square, discriminant, denominator, change
    real(wp) :: rounding
    integer :: iteration, k

    x = (0.0_wp, 0.0_wp)
    do iteration = 1, max_iterations
      value = c(n)
      slope = (0.0_wp, 0.0_wp)
      curve = (0.0_wp, 0.0_wp)
      rounding = abs(value)
      do k = n - 1, 0, -1
        curve = x*curve + slope
        slope = x*slope + value
        value = x*value + c(k)
        rounding = abs(value) + abs(x)*rounding
      end do
      if (abs(value) <= value_roundoff*rounding) return
      ratio = slope/value
      square = ratio**2
      discriminant = sqrt(real(n - 1, wp)*(real(n, wp)*(square - 2.0_wp*curve/value) - square))
      denominator = ratio + discriminant
      if (abs(ratio - discriminant) > abs(denominator)) denominator = ratio - discriminant
      if (abs(denominator) > 0.0_wp) then
        change = real(n, wp)/denominator
      else
        ! The polynomial is symmetric about x: step aside.
        change = cmplx(1.0_wp + abs(x), real(iteration, wp), wp)
      end if
      x = x - change
      if (abs(change) <= epsilon(1.0_wp)*abs(x)) return
    end do
  end function one_root
end module dst_polynomial_roots
