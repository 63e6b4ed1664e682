!> A stretch of a motion, and what a summary needs to know of it: where its load turns back, how long the object creeps, its largest
!> velocity along the drive, and where slip begins.
!>
!> These are properties of the motion inside the stretch, not of its ends: all zeros and extremes of polynomials in Bernstein's form
!> are found (dst_bernstein). The load k_x u_x is a polynomial as it is. The rate of u_x, V e_x - w_x, which is more accurate than
!> the derivative of the polynomial, X' and F(v) are functions of polynomials; they are interpolated at Chebyshev points, in parts
!> of the stretch that are halved until the interpolation is accurate. A stretch is not searched if a bound shows that there is
!> nothing to find.
module dst_stretch
  use dst_bernstein, only: sign_changes, first_zero, bernstein_value
  use dst_interpolation, only: grid_t, max_degree
  use dst_kinds, only: wp
  implicit none
  private

  public :: stretch_t, moment_t, tiny_rate, nowhere, most_turns

  !> An object that is slower than this share of the drive velocity seems to rest.
  real(wp), parameter :: tiny_rate = 0.1_wp
  !> A place that does not exist.
  real(wp), parameter :: nowhere = 2.0_wp
  !> Permitted error of an interpolation, relative to the terms of the quantity, and the length of a part that is not halved any
  !> more. Conventions; twice: an angle by 2e-7, and no change; far below the digits of a summary; most stretches are one part.
  real(wp), parameter :: accurate = 1.0e-9_wp, shortest = 1.0_wp/128.0_wp
  !> The quantities that are interpolated: X' [m/s], |k_x u_x| - F(v) [N], and the rate of the elongation [m/s].
  integer, parameter :: rate = 1, excess = 2, stretching = 3
  !> Most points of a stretch at which the load turns back.
  integer, parameter :: most_turns = 4*max_degree

  !> The motion at one instant, in the form that the summary uses.
  type :: moment_t
    real(wp) :: time = 0.0_wp               !! s
    real(wp) :: position = 0.0_wp           !! X, m
    real(wp) :: rate = 0.0_wp               !! X', m/s
    real(wp) :: slip_velocity(2) = 0.0_wp   !! m/s
    real(wp) :: force = 0.0_wp              !! k_x u_x, N
    real(wp) :: elongation_rate = 0.0_wp    !! of the soft spring, m/s
    real(wp) :: drive_velocity = 0.0_wp     !! V, m/s
  end type moment_t

  !> One advance of a motion: its ends, and the motion between them. Places in it go from 0 to 1.
  type, abstract :: stretch_t
    type(moment_t) :: first, last
    logical :: sticking = .false.
  contains
    procedure(moment_at), deferred :: at
    procedure(friction_at), deferred :: friction
    procedure(load_polynomial), deferred :: load
    procedure(bounds_of_rate), deferred :: rate_bounds
    procedure(bound_of_friction), deferred :: least_friction
    procedure :: slip_along
    procedure :: duration
    procedure :: turning_places
    procedure :: creep_time
    procedure :: largest_rate
    procedure :: slip_begins_at
  end type stretch_t

  abstract interface
    !> The motion at a place.
    function moment_at(self, place) result(moment)
      import :: stretch_t, moment_t, wp
      class(stretch_t), intent(in) :: self
      real(wp), intent(in) :: place
      type(moment_t) :: moment
    end function moment_at

    !> F(v) [N] at a slip speed [m/s].
    pure real(wp) function friction_at(self, speed)
      import :: stretch_t, wp
      class(stretch_t), intent(in) :: self
      real(wp), intent(in) :: speed
    end function friction_at

    !> Degree and Bernstein coefficients of the load k_x u_x [N].
    subroutine load_polynomial(self, degree, coefficient)
      import :: stretch_t, wp, max_degree
      class(stretch_t), intent(in) :: self
      integer, intent(out) :: degree
      real(wp), intent(out) :: coefficient(0:max_degree)
    end subroutine load_polynomial

    !> A lower and an upper bound of |X'| [m/s] in the stretch; they need not be close if the latter is not above `enough`.
    function bounds_of_rate(self, enough) result(bounds)
      import :: stretch_t, wp
      class(stretch_t), intent(in) :: self
      real(wp), intent(in) :: enough
      real(wp) :: bounds(2)
    end function bounds_of_rate

    !> A lower bound of F(v) [N].
    pure real(wp) function bound_of_friction(self)
      import :: stretch_t, wp
      class(stretch_t), intent(in) :: self
    end function bound_of_friction
  end interface

  !> A part of a stretch between two places, and the Bernstein coefficients of a quantity in it.
  type :: part_t
    real(wp) :: from = 0.0_wp, to = 0.0_wp
    real(wp) :: coefficient(0:max_degree) = 0.0_wp
    !> Largest term of the quantity so far.
    real(wp) :: largest = 0.0_wp
  contains
    procedure :: place
  end type part_t

contains

  !> X' [m/s] and the slip speed [m/s] at a place in slip.
  subroutine slip_along(self, place, rate, speed)
    class(stretch_t), intent(in) :: self
    real(wp), intent(in) :: place
    real(wp), intent(out) :: rate, speed
    type(moment_t) :: moment

    moment = self%at(place)
    rate = moment%rate
    speed = hypot(moment%slip_velocity(1), moment%slip_velocity(2))
  end subroutine slip_along

  !> Length [s].
  pure real(wp) function duration(self)
    class(stretch_t), intent(in) :: self

    duration = self%last%time - self%first%time
  end function duration

  !> The places, in their order, at which the load, with these Bernstein coefficients, turns back.
  subroutine turning_places(self, grid, load, places, count)
    class(stretch_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    real(wp), intent(in) :: load(0:)
    real(wp), intent(out) :: places(most_turns)
    integer, intent(out) :: count
    type(part_t) :: part
    real(wp) :: slope(ubound(load, 1)), position(max_degree)
    integer :: n

    count = 0
    slope = load(1:) - load(:ubound(load, 1) - 1)
    if (all(slope >= 0.0_wp) .or. all(slope <= 0.0_wp)) return
    if (self%sticking) then
      call sign_changes(ubound(slope, 1) - 1, slope, places, count)
      return
    end if
    do while (part%to < 1.0_wp)
      call next_part(self, grid, stretching, part)
      call sign_changes(max_degree, part%coefficient, position, n)
      n = min(n, most_turns - count)
      places(count + 1:count + n) = part%from + (part%to - part%from)*position(:n)
      count = count + n
    end do
  end subroutine turning_places

  !> Time [s] between two places at which the object rests or creeps, |X'| <= |V|/10.
  real(wp) function creep_time(self, grid, from, to)
    class(stretch_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    real(wp), intent(in) :: from, to
    type(part_t) :: part
    real(wp) :: slowest, largest, bounds(2)

    creep_time = (to - from)*self%duration()
    if (self%sticking) return
    associate (drive => [self%first%drive_velocity, self%last%drive_velocity])
      slowest = merge(minval(abs(drive)), 0.0_wp, product(drive) > 0.0_wp)
      largest = maxval(abs(drive))
    end associate
    bounds = self%rate_bounds(tiny_rate*slowest)
    if (bounds(2) <= tiny_rate*slowest) return
    creep_time = 0.0_wp
    if (bounds(1) > tiny_rate*largest) return
    do while (part%to < 1.0_wp)
      call next_part(self, grid, rate, part)
      associate (begin => max(from, part%from), end => min(to, part%to))
        if (end > begin) creep_time = creep_time + self%duration()*creep_share(self, part, begin, end)
      end associate
    end do
  end function creep_time

  !> Share of the stretch that is creep between two places of a part: X' = V/10 or X' = -V/10 at its ends.
  pure real(wp) function creep_share(self, part, from, to)
    class(stretch_t), intent(in) :: self
    type(part_t), intent(in) :: part
    real(wp), intent(in) :: from, to
    real(wp) :: limit(0:max_degree), position(max_degree), ends(2*max_degree + 2), middle
    integer :: i, side, n, count

    associate (first => self%first%drive_velocity, last => self%last%drive_velocity)
      limit = [(tiny_rate*(first + (last - first)*part%place(real(i, wp)/real(max_degree, wp))), i=0, max_degree)]
    end associate
    ends(1:2) = [from, to]
    count = 2
    do side = -1, 1, 2
      call sign_changes(max_degree, part%coefficient + real(side, wp)*limit, position, n)
      do i = 1, n
        count = count + 1
        ends(count) = min(to, max(from, part%place(position(i))))
      end do
    end do
    call sort(ends(:count))
    creep_share = 0.0_wp
    do i = 1, count - 1
      middle = (0.5_wp*(ends(i) + ends(i + 1)) - part%from)/(part%to - part%from)
      if (abs(bernstein_value(max_degree, part%coefficient, middle)) <= abs(bernstein_value(max_degree, limit, middle))) &
        creep_share = creep_share + (ends(i + 1) - ends(i))
    end do
  end function creep_share

  !> Largest |X'| [m/s], or `known` if it is not larger.
  real(wp) function largest_rate(self, grid, known) result(largest)
    class(stretch_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    real(wp), intent(in) :: known
    type(part_t) :: part
    real(wp) :: position(max_degree), bounds(2), here, speed
    integer :: i, n

    largest = max(known, abs(self%first%rate), abs(self%last%rate))
    if (self%sticking) return
    bounds = self%rate_bounds(largest)
    if (bounds(2) <= largest) return
    do while (part%to < 1.0_wp)
      call next_part(self, grid, rate, part)
      associate (x => part%coefficient)
        if (maxval(abs(x)) <= largest) cycle
        largest = max(largest, abs(x(0)), abs(x(max_degree)))
        call sign_changes(max_degree - 1, x(1:) - x(:max_degree - 1), position, n)
        do i = 1, n
          call evaluate(self, rate, part%place(position(i)), here, speed)
          largest = max(largest, abs(here))
        end do
      end associate
    end do
  end function largest_rate

  !> The first place at which |k_x u_x|, with these Bernstein coefficients, exceeds F(v); `nowhere` if there is none.
  real(wp) function slip_begins_at(self, grid, load) result(place)
    class(stretch_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    real(wp), intent(in) :: load(0:)
    type(part_t) :: part

    place = nowhere
    if (self%sticking) return
    if (maxval(abs(load)) < self%least_friction()) return
    do while (part%to < 1.0_wp)
      call next_part(self, grid, excess, part)
      place = 0.0_wp
      if (part%coefficient(0) < 0.0_wp) place = first_zero(-part%coefficient)
      if (place > 1.0_wp) cycle
      place = part%place(place)
      return
    end do
    place = nowhere
  end function slip_begins_at

  !> Interpolate a quantity in the part that follows, as long as the interpolation is accurate.
  subroutine next_part(self, grid, which, part)
    class(stretch_t), intent(in) :: self
    type(grid_t), intent(in) :: grid
    integer, intent(in) :: which
    type(part_t), intent(inout) :: part
    real(wp) :: value(0:max_degree), there, term
    !> Where the interpolation is tested: between two points, near the middle.
    real(wp), parameter :: test = 0.4_wp
    integer :: i

    part%from = part%to
    part%to = 1.0_wp
    do
      do i = 0, max_degree
        call evaluate(self, which, part%place(grid%node(i)), value(i), term)
        part%largest = max(part%largest, term)
      end do
      call grid%bernstein_coefficients(value, part%coefficient)
      if (part%to - part%from <= shortest) return
      call evaluate(self, which, part%place(test), there, term)
      if (abs(there - bernstein_value(max_degree, part%coefficient, test)) <= accurate*part%largest) return
      part%to = 0.5_wp*(part%from + part%to)
    end do
  end subroutine next_part

  !> The place of a stretch that is a position in [0, 1] of a part.
  pure real(wp) function place(self, position)
    class(part_t), intent(in) :: self
    real(wp), intent(in) :: position

    place = self%from + position*(self%to - self%from)
  end function place

  !> A quantity at a place, and the size of the larger of its terms.
  subroutine evaluate(self, which, place, value, term)
    class(stretch_t), intent(in) :: self
    integer, intent(in) :: which
    real(wp), intent(in) :: place
    real(wp), intent(out) :: value, term
    type(moment_t) :: moment

    if (which == rate) then
      call self%slip_along(place, value, term)
      return
    end if
    moment = self%at(place)
    associate (speed => hypot(moment%slip_velocity(1), moment%slip_velocity(2)))
      select case (which)
      case (stretching)
        value = moment%elongation_rate
        term = max(speed, abs(moment%drive_velocity))
      case default
        value = abs(moment%force) - self%friction(speed)
        term = abs(moment%force)
      end select
    end associate
  end subroutine evaluate

  !> Sort a few numbers.
  pure subroutine sort(x)
    real(wp), intent(inout) :: x(:)
    real(wp) :: here
    integer :: i, k

    do i = 2, size(x)
      here = x(i)
      do k = i - 1, 1, -1
        if (x(k) <= here) exit
        x(k + 1) = x(k)
      end do
      x(k + 1) = here
    end do
  end subroutine sort
end module dst_stretch
