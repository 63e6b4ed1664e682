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
  use dst_polynomial_roots, only: polynomial_roots
  implicit none
  private

  public :: follow_instability

  !> Accuracy of the growth rate. Convention. Twice: no change on Fig. 3; 0.2 % more work and 2.6 times the error where the motion
  !> leaves steady sliding at 5 degrees after a push of 1e-9.
  real(wp), parameter :: share = 1.0e-3_wp
  !> Growth below this share of a root is due to the roundoff of its computation. Convention; twice: no change.
  real(wp), parameter :: roundoff = 1.0e-12_wp

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
end module dst_instability
