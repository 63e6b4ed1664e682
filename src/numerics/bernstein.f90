!> Zeros and minima of a polynomial on [0, 1] given by its Bernstein coefficients.
!>
!> The graph is in the convex hull of the coefficients, so "no coefficient is negative" proves that there is no crossing, and de
!> Casteljau's subdivision finds the first one if there is any: a dip that begins and ends inside a step cannot be missed.
module dst_bernstein
  use dst_kinds, only: wp
  use dst_roots, only: bracket_t
  implicit none
  private

  public :: first_zero, first_minimum, sign_changes, bernstein_value

  !> Most halvings of the interval: 60 in double precision, when it has no digits left. Twice and half: no change.
  integer, parameter :: max_depth = digits(1.0_wp) + 7
  !> Most false positions, and the width of the bracket, relative to its place, that is roundoff. Twice: no change; the last digit.
  integer, parameter :: max_iterations = 200
  !> Two changes of sign that are this many halvings close count as none. Convention; twice: no change.
  integer, parameter :: closest = 30
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

  !> The positions in (0, 1), in their order, at which the polynomial changes its sign.
  pure subroutine sign_changes(degree, coefficient, position, count)
    integer, intent(in) :: degree
    real(wp), intent(in) :: coefficient(0:degree)
    real(wp), intent(out) :: position(:)      !! of at least `degree` elements
    integer, intent(out) :: count

    count = 0
    call collect(degree, coefficient, 0.0_wp, 1.0_wp, 0, position, count)
  end subroutine sign_changes

  !> Append those of the interval from `begin` on, on which these are the coefficients. The coefficients change their sign at least
  !> as often as the polynomial.
  pure recursive subroutine collect(degree, coefficient, begin, length, depth, position, count)
    integer, intent(in) :: degree, depth
    real(wp), intent(in) :: coefficient(0:degree), begin, length
    real(wp), intent(inout) :: position(:)
    integer, intent(inout) :: count
    real(wp) :: left(0:degree), right(0:degree)

    if (.not. (any(coefficient < 0.0_wp) .and. any(coefficient > 0.0_wp))) return
    if (count == size(position)) return
    if (changes(coefficient) == 1 .and. abs(coefficient(0)) > 0.0_wp .and. abs(coefficient(degree)) > 0.0_wp) then
      count = count + 1
      position(count) = begin + length*bracketed_zero(degree, sign(1.0_wp, coefficient(0))*coefficient)
    else if (depth < closest) then
      call subdivide(degree, coefficient, left, right)
      call collect(degree, left, begin, 0.5_wp*length, depth + 1, position, count)
      ! A zero of both halves.
      if (abs(right(0)) <= 0.0_wp .and. last_sign(left)*first_sign(right) < 0.0_wp .and. count < size(position)) then
        count = count + 1
        position(count) = begin + 0.5_wp*length
      end if
      call collect(degree, right, begin + 0.5_wp*length, 0.5_wp*length, depth + 1, position, count)
    else if (first_sign(coefficient)*last_sign(coefficient) < 0.0_wp) then
      count = count + 1
      position(count) = begin + 0.5_wp*length
    end if
  end subroutine collect

  !> How often the coefficients that are not zero change their sign.
  pure integer function changes(coefficient)
    real(wp), intent(in) :: coefficient(:)
    real(wp) :: former
    integer :: i

    changes = 0
    former = 0.0_wp
    do i = 1, size(coefficient)
      if (abs(coefficient(i)) <= 0.0_wp) cycle
      if (former*coefficient(i) < 0.0_wp) changes = changes + 1
      former = sign(1.0_wp, coefficient(i))
    end do
  end function changes

  !> The sign of the first coefficient that is not zero: that of the polynomial just after 0.
  pure real(wp) function first_sign(coefficient)
    real(wp), intent(in) :: coefficient(:)
    integer :: i

    first_sign = 0.0_wp
    do i = 1, size(coefficient)
      if (.not. abs(coefficient(i)) > 0.0_wp) cycle
      first_sign = sign(1.0_wp, coefficient(i))
      return
    end do
  end function first_sign

  !> That of the polynomial just before 1.
  pure real(wp) function last_sign(coefficient)
    real(wp), intent(in) :: coefficient(:)

    last_sign = first_sign(coefficient(size(coefficient):1:-1))
  end function last_sign

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
