!> How long a step may be if it has to follow a motion that has become unstable.
!>
!> A long implicit step damps exponential growth, and would stay on a motion that the object leaves. Near steady sliding a
!> disturbance grows or decays like exp(lambda t), where lambda are the roots of the model's characteristic polynomial
!> (`decay_polynomial` of dst_slip_system).
!>
!> A method of order p multiplies a motion of rate lambda in a step h by R(h lambda) = exp(h lambda) (1 - E (h lambda)^(p+1) + ...).
!> The relative error of the growth Re(lambda) > 0 is at most `share` if
!>
!>     E |h lambda|^(p+1) <= share h Re(lambda).
!>
!> For Radau IIA with s stages, p = 2 s - 1 and E = (s-1)! s!/((2s-1)! (2s)!), the leading term of the error of the (s-1, s)
!> Pade approximation of the exponential (Hairer & Wanner II, Sec. IV.3).
module dst_instability
  use dst_kinds, only: wp
  implicit none
  private

  public :: follow_instability

  !> Accuracy of the growth rate. Convention. Twice: no change on Fig. 3; 0.2 % more work and 2.6 times the error where the motion
  !> leaves steady sliding at 5 degrees after a push of 1e-9.
  real(wp), parameter :: share = 1.0e-3_wp
  !> Growth below this share of a root is due to the roundoff of its computation. Convention; twice: no change.
  real(wp), parameter :: roundoff = 1.0e-12_wp

  !> Convention: Laguerre's method converges in a few iterations. Twice and half: no change.
  integer, parameter :: max_iterations = 80
  !> Roundoff of a value over its bound from Horner's scheme, with a margin. Twice: no change.
  real(wp), parameter :: value_roundoff = 4.0_wp*epsilon(1.0_wp)

contains

  !> The longest step [s] that follows the growth of disturbances with this characteristic polynomial (by rising power), and their
  !> fastest growth [1/s]; huge and 0 if nothing grows.
  pure subroutine follow_instability(coefficient, order, error_constant, longest, growth)
    real(wp), intent(in) :: coefficient(0:)
    integer, intent(in) :: order                       !! p
    real(wp), intent(in) :: error_constant             !! E
    real(wp), intent(out) :: longest, growth
    complex(wp) :: rate(ubound(coefficient, 1))
    integer :: k

    longest = huge(longest)
    growth = 0.0_wp
    if (all_decay(coefficient)) return
    call polynomial_roots(coefficient, rate)
    do k = 1, size(rate)
      if (.not. real(rate(k)) > roundoff*abs(rate(k))) cycle
      growth = max(growth, real(rate(k)))
      longest = min(longest, (share*real(rate(k))/(error_constant*abs(rate(k))))**(1.0_wp/real(order, wp))/abs(rate(k)))
    end do
  end subroutine follow_instability

  !> Whether all roots certainly decay: the conditions of Routh and Hurwitz for degree 2 and 4; for other degrees the answer is no.
  pure logical function all_decay(c)
    real(wp), intent(in) :: c(0:)

    all_decay = all(c > 0.0_wp) .and. (size(c) == 3 .or. size(c) == 5)
    if (size(c) == 5) all_decay = all_decay .and. (c(3)*c(2) - c(4)*c(1))*c(1) > c(3)**2*c(0)
  end function all_decay

  !> All roots of sum_k coefficient(k) x^k, by Laguerre's method with deflation; the leading coefficient must not be zero. The roots
  !> of small magnitude come first, which keeps the deflation accurate; complex ones come in pairs.
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
end module dst_instability
