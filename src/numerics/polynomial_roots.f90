!> All roots of a real polynomial of low degree, by Laguerre's method with deflation.
module dst_polynomial_roots
  use dst_kinds, only: wp
  implicit none
  private

  public :: polynomial_roots

  !> Convention: Laguerre's method converges in a few. Twice and half: no change.
  integer, parameter :: max_iterations = 80
  !> Roundoff of a value over the bound on it that Horner's scheme gives, with a margin. Twice: no change.
  real(wp), parameter :: value_roundoff = 4.0_wp*epsilon(1.0_wp)

contains

  !> Roots of sum_k coefficient(k) x^k; the leading coefficient must not be zero. The roots of small magnitude come first, which
  !> keeps the deflation accurate; each has converged to roundoff.
  pure subroutine polynomial_roots(coefficient, root)
    real(wp), intent(in) :: coefficient(0:)
    complex(wp), intent(out) :: root(:)
    complex(wp) :: c(0:ubound(coefficient, 1)), carried, kept
    real(wp) :: unit
    integer :: degree, k, n

    n = ubound(coefficient, 1)
    ! In units in which the product of the roots is 1: their size neither overflows nor underflows.
    unit = 1.0_wp
    if (abs(coefficient(0)) > 0.0_wp) unit = (abs(coefficient(0)/coefficient(n)))**(1.0_wp/real(n, wp))
    c = [(cmplx(coefficient(k)/coefficient(n)*unit**(k - n), kind=wp), k=0, n)]
    do degree = n, 1, -1
      root(n - degree + 1) = one_root(degree, c(0:degree))
      carried = c(degree)
      do k = degree - 1, 0, -1
        kept = c(k)
        c(k) = carried
        carried = kept + root(n - degree + 1)*carried
      end do
    end do
    root = unit*root
  end subroutine polynomial_roots

  !> One root, found from 0.
  pure complex(wp) function one_root(n, c) result(x)
    integer, intent(in) :: n
    complex(wp), intent(in) :: c(0:n)
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
        ! Symmetric about x: turn aside.
        change = cmplx(1.0_wp + abs(x), real(iteration, wp), wp)
      end if
      x = x - change
      if (abs(change) <= epsilon(1.0_wp)*abs(x)) return
    end do
  end function one_root
end module dst_polynomial_roots
