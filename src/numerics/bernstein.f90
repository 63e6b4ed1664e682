!> Zeros and minima of a polynomial on [0, 1] given by its Bernstein coefficients.
!>
!> The graph is in the convex hull of the coefficients, so "no coefficient is negative" proves that there is no crossing, and de
!> Casteljau's subdivision finds the first one if there is any: a dip that begins and ends inside a step cannot be missed.
module dst_bernstein
  use dst_kinds, only: wp
  use dst_roots, only: bracket_t
  implicit none
  private

  public :: first_zero, first_minimum, bernstein_value

  !> Most halvings of the interval: 60 in double precision, when it has no digits left. Twice and half: no change.
  integer, parameter :: max_depth = digits(1.0_wp) + 7
  !> Most false positions, and the width of the bracket, relative to its place, that is roundoff. Twice: no change; the last digit.
  integer, parameter :: max_iterations = 200
  real(wp), parameter :: width_roundoff = 2.0_wp*epsilon(1.0_wp)

contains

  !> First position in (0, 1] where the polynomial passes from positive to zero or below;
  !> 2 if there is none. The value at 0 counts as positive.
  pure recursive function first_zero(coefficient) result(position)
    real(wp), intent(in) :: coefficient(0:)
    real(wp) :: position

    position = search(ubound(coefficient, 1), coefficient, 0)
  end function first_zero

  !> First position after `start` where the polynomial stops falling and begins to rise; 2 if there is none.
  pure function first_minimum(coefficient, start) result(position)
    real(wp), intent(in) :: coefficient(0:), start
    real(wp) :: position
    real(wp) :: slope(0:ubound(coefficient, 1) - 1), begin

    position = 2.0_wp
    begin = start
    slope = slope_from(begin)
    if (slope(0) > 0.0_wp) then
      begin = begin + first_zero(slope)*(1.0_wp - begin)
      if (.not. begin < 1.0_wp) return
      slope = slope_from(begin)
    end if
    position = first_zero(-slope)
    if (position <= 1.0_wp) position = begin + position*(1.0_wp - begin)

  contains

    !> Bernstein coefficients of the slope on [x, 1], except a positive factor.
    pure function slope_from(x) result(difference)
      real(wp), intent(in) :: x
      real(wp) :: difference(0:ubound(coefficient, 1) - 1)
      real(wp) :: c(0:ubound(coefficient, 1))
      integer :: k, n

      n = ubound(coefficient, 1)
      c = coefficient
      do k = 1, n
        c(0:n - k) = (1.0_wp - x)*c(0:n - k) + x*c(1:n - k + 1)
      end do
      difference = c(1:) - c(:n - 1)
    end function slope_from
  end function first_minimum

  pure recursive function search(degree, coefficient, depth) result(position)
    integer, intent(in) :: degree, depth
    real(wp), intent(in) :: coefficient(0:degree)
    real(wp) :: position
    real(wp) :: left(0:degree), right(0:degree)

    position = 2.0_wp
    if (all(coefficient(1:) > 0.0_wp)) return
    if (descends(degree, coefficient)) then
      if (coefficient(degree) <= 0.0_wp) position = bracketed_zero(degree, coefficient)
      return
    end if
    if (depth == max_depth) then
      position = 0.5_wp
      return
    end if
    call subdivide(degree, coefficient, left, right)
    position = search(degree, left, depth + 1)
    if (position <= 1.0_wp) then
      position = 0.5_wp*position
    else if (right(0) <= 0.0_wp) then
      position = 0.5_wp
    else
      position = search(degree, right, depth + 1)
      if (position <= 1.0_wp) position = 0.5_wp + 0.5_wp*position
    end if
  end function search

  !> Whether the coefficients never rise: then the polynomial falls and has at most one zero.
  pure logical function descends(degree, coefficient)
    integer, intent(in) :: degree
    real(wp), intent(in) :: coefficient(0:degree)

    descends = all(coefficient(1:) <= coefficient(:degree - 1)) .and. coefficient(0) > 0.0_wp
  end function descends

  !> The zero of a falling polynomial: false positions, to roundoff.
  pure function bracketed_zero(degree, coefficient) result(x)
    integer, intent(in) :: degree
    real(wp), intent(in) :: coefficient(0:degree)
    real(wp) :: x
    real(wp) :: f
    type(bracket_t) :: bracket
    integer :: iteration

    bracket = bracket_t([0.0_wp, 1.0_wp], [coefficient(0), coefficient(degree)])
    do iteration = 1, max_iterations
      x = bracket%false_position()
      f = bernstein_value(degree, coefficient, x)
      call bracket%narrow(x, f)
      if (abs(f) <= epsilon(f)*coefficient(0) .or. bracket%width() <= width_roundoff*bracket%x(2)) exit
    end do
  end function bracketed_zero

  !> Value at x in [0, 1] by de Casteljau's scheme.
  pure function bernstein_value(degree, coefficient, x) result(value)
    integer, intent(in) :: degree
    real(wp), intent(in) :: coefficient(0:degree), x
    real(wp) :: value
    real(wp) :: c(0:degree)
    integer :: k

    c = coefficient
    do k = degree, 1, -1
      c(0:k - 1) = (1.0_wp - x)*c(0:k - 1) + x*c(1:k)
    end do
    value = c(0)
  end function bernstein_value

  !> Coefficients of the same polynomial on the left and on the right half of the interval.
  pure subroutine subdivide(degree, coefficient, left, right)
    integer, intent(in) :: degree
    real(wp), intent(in) :: coefficient(0:degree)
    real(wp), intent(out) :: left(0:degree), right(0:degree)
    integer :: k

    right = coefficient
    left(0) = right(0)
    do k = 1, degree
      right(0:degree - k) = 0.5_wp*(right(0:degree - k) + right(1:degree - k + 1))
      left(k) = right(0)
    end do
  end subroutine subdivide
end module dst_bernstein
