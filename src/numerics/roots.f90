!> A zero of a function between two points where it has opposite signs. The caller evaluates the function at the proposed points,
!> and narrows the bracket by the results:
!>
!>     do
!>       x = bracket%false_position()
!>       f = ...
!>       call bracket%narrow(x, f)
!>       if (bracket%width() <= ...) exit
!>     end do
module dst_roots
  use dst_kinds, only: wp
  implicit none
  private

  public :: bracket_t

  !> The ends and the values there, of opposite signs.
  type :: bracket_t
    real(wp) :: x(2) = 0.0_wp, f(2) = 0.0_wp
    !> The end replaced last.
    integer :: replaced = 0
  contains
    procedure :: false_position
    procedure :: middle
    procedure :: newton
    procedure :: narrow
    procedure :: width
  end type bracket_t

contains

  !> The zero of the straight line through both ends; in floating point perhaps just outside the bracket.
  pure real(wp) function false_position(self) result(x)
    class(bracket_t), intent(in) :: self

    x = (self%x(1)*self%f(2) - self%x(2)*self%f(1))/(self%f(2) - self%f(1))
  end function false_position

  pure real(wp) function middle(self) result(x)
    class(bracket_t), intent(in) :: self

    x = 0.5_wp*(self%x(1) + self%x(2))
  end function middle

  !> Newton's point from x, where the function has this value and slope; the middle if it lies outside or the slope does not rise.
  pure real(wp) function newton(self, x, f, slope) result(next)
    class(bracket_t), intent(in) :: self
    real(wp), intent(in) :: x, f, slope

    next = self%x(1)
    if (slope > 0.0_wp) next = x - f/slope
    if (.not. (next > self%x(1) .and. next < self%x(2))) next = self%middle()
  end function newton

  !> Replace the end with the same sign as f by x, where the function is f. If the other end stays for the second time, its value is
  !> halved (Illinois' rule), so that false positions come from both sides. A zero counts as having the second end's sign.
  pure subroutine narrow(self, x, f)
    class(bracket_t), intent(inout) :: self
    real(wp), intent(in) :: x, f
    integer :: near, far

    near = 2
    if (abs(f) > 0.0_wp .and. (f > 0.0_wp .eqv. self%f(1) > 0.0_wp)) near = 1
    far = 3 - near
    self%x(near) = x
    self%f(near) = f
    if (self%replaced == near) self%f(far) = 0.5_wp*self%f(far)
    self%replaced = near
  end subroutine narrow

  pure real(wp) function width(self)
    class(bracket_t), intent(in) :: self

    width = self%x(2) - self%x(1)
  end function width
end module dst_roots
