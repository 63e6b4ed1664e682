!> A function through points, as a piecewise cubic that is monotone wherever the points are.
!>
!> Between two points it is the cubic with their values and derivatives (Hermite). The derivative at a point is that of the parabola
!> through it and its neighbours, limited to three times the smaller slope next to it, and 0 if the slopes on both sides differ in
!> sign: there is no overshoot, and the error is of the third order in the spacing where the function is smooth and monotone, of the
!> second at its turns. Below the first point the function continues by its tangent, above the last one it is constant: there the
!> slope jumps, and at the last point itself it is 0.
!>
!> Source: F. N. Fritsch and R. E. Carlson, Monotone piecewise cubic interpolation, SIAM J. Numer. Anal. 17 (1980) 238.
module dst_monotone_cubic
  use dst_interpolation, only: last_begun
  use dst_kinds, only: wp
  implicit none
  private

  public :: monotone_cubic_t, new_monotone_cubic

  !> The points, and the derivatives there from the right; at the last one, from the left.
  type :: monotone_cubic_t
    real(wp), allocatable :: x(:), value(:), slope(:)
  contains
    procedure :: evaluate
  end type monotone_cubic_t

contains

  !> The function through at least two points of increasing `x`.
  pure function new_monotone_cubic(x, value) result(curve)
    real(wp), intent(in) :: x(:), value(:)
    type(monotone_cubic_t) :: curve
    real(wp) :: width(size(x) - 1), secant(size(x) - 1)
    integer :: i, n

    n = size(x)
    allocate (curve%x, source=x)
    allocate (curve%value, source=value)
    width = x(2:) - x(:n - 1)
    secant = (value(2:) - value(:n - 1))/width
    allocate (curve%slope(n), source=secant(1))
    if (n == 2) return
    curve%slope(1) = limited(end_slope(width(1), width(2), secant(1), secant(2)), secant(1), secant(1))
    do i = 2, n - 1
      associate (share => width(i - 1)/(width(i - 1) + width(i)))
        curve%slope(i) = limited((1.0_wp - share)*secant(i - 1) + share*secant(i), secant(i - 1), secant(i))
      end associate
    end do
    curve%slope(n) = limited(end_slope(width(n - 1), width(n - 2), secant(n - 1), secant(n - 2)), secant(n - 1), secant(n - 1))
  end function new_monotone_cubic

  !> The derivative at the outer end of the first of two panels, of the parabola through the three points.
  pure real(wp) function end_slope(width, next_width, secant, next_secant)
    real(wp), intent(in) :: width, next_width, secant, next_secant

    end_slope = secant + (secant - next_secant)*(width/(width + next_width))
  end function end_slope

  !> A derivative with the sign of the slopes on both sides, at most three times the smaller one.
  pure real(wp) function limited(derivative, before, after)
    real(wp), intent(in) :: derivative, before, after

    limited = 0.0_wp
    if (before > 0.0_wp .and. after > 0.0_wp) then
      limited = min(max(derivative, 0.0_wp), 3.0_wp*min(before, after))
    else if (before < 0.0_wp .and. after < 0.0_wp) then
      limited = max(min(derivative, 0.0_wp), 3.0_wp*max(before, after))
    end if
  end function limited

  !> Values and derivatives at positions `at`.
  pure subroutine evaluate(self, at, value, slope)
    class(monotone_cubic_t), intent(in) :: self
    real(wp), intent(in) :: at(:)
    real(wp), intent(out) :: value(:), slope(:)
    real(wp) :: t, width, secant, bend, rest
    integer :: i, k, n

    n = size(self%x)
    do i = 1, size(at)
      if (at(i) >= self%x(n)) then
        value(i) = self%value(n)
        slope(i) = 0.0_wp
        cycle
      else if (at(i) <= self%x(1)) then
        value(i) = self%value(1) + self%slope(1)*(at(i) - self%x(1))
        slope(i) = self%slope(1)
        cycle
      end if
      k = last_begun(self%x(:size(self%x) - 1), at(i))
      width = self%x(k + 1) - self%x(k)
      t = (at(i) - self%x(k))/width
      rest = (self%x(k + 1) - at(i))/width
      secant = (self%value(k + 1) - self%value(k))/width
      bend = self%slope(k) + self%slope(k + 1) - 2.0_wp*secant
      ! The chord, and a part that vanishes at both ends.
      value(i) = self%value(k) + (at(i) - self%x(k))*(secant + rest*(self%slope(k) - secant - t*bend))
      slope(i) = self%slope(k) + t*(2.0_wp*(secant - self%slope(k)) - bend*(2.0_wp - 3.0_wp*t))
    end do
  end subroutine evaluate
end module dst_monotone_cubic
