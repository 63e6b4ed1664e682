!> One branch of the release map: its laps, or its slips, as polynomials in the variable in which they are analytic.
!>
!> Let d be the distance of a release from the end of sticks. Where sticks end by grazing, the time at rest goes to zero like the
!> square root of d, and laps are analytic in it, slips in d; where they end while the object still rests for some time, both are
!> analytic in ln d. Intervals of this variable are halved where one polynomial does not pass its test; an interval is tabulated
!> once as many of its passages have been run as that takes. The table is a function of the scene and the interval alone.
!> docs/cycles.md, section 3.
module dst_branch
  use dst_chebyshev, only: chebyshev_points, chebyshev_polynomials, chebyshev_coefficients, chebyshev_derivative
  use dst_kinds, only: wp
  implicit none
  private

  public :: branch_t, new_branch, in_root, in_distance, in_logarithm, nodes, tests, values

  !> The variable.
  integer, parameter :: in_root = 1, in_distance = 2, in_logarithm = 3
  !> Points of an interval, and points between them at which it is tested; the values there: duration [s] and turn [rad].
  integer, parameter :: nodes = 33, tests = 4, values = 2
  !> Where: between the points, near both ends and in the middle.
  real(wp), parameter :: test_at(tests) = [-0.99_wp, -0.31_wp, 0.43_wp, 0.985_wp]
  !> Halvings of the whole. Convention; one more: the same cycles of 12 random scenes.
  integer, parameter :: most_halvings = 7
  !> Nearest distance from the end in the variable ln d [rad]. Convention: nearer releases are run; twice: the same cycles of 12
  !> random scenes.
  real(wp), parameter :: nearest = 1.0e-7_wp

  !> An interval of the variable.
  type :: interval_t
    real(wp) :: first = 0.0_wp, last = 0.0_wp
    integer :: halvings = 0
    !> Passages that were run in it; its halves, 0 if it was not halved.
    integer :: visits = 0, half(2) = 0
    logical :: is_tried = .false., is_known = .false.
    !> Coefficients of Chebyshev polynomials, of the values and of the slope of the turn, if it is known.
    real(wp) :: coefficient(nodes, values + 1) = 0.0_wp
  end type interval_t

  !> A branch, which may be empty.
  type :: branch_t
    integer, private :: variable = in_distance
    real(wp), private :: end = 0.0_wp, side = 1.0_wp, reach = -1.0_wp     !! rad
    integer, private :: count = 0
    type(interval_t), allocatable, private :: intervals(:)     !! valid up to `count`
  contains
    procedure :: place_of
    procedure :: is_known
    procedure :: is_wanted
    procedure :: angle
    procedure :: fill
    procedure :: evaluate
  end type branch_t

contains

  !> The branch on one side (+1 above, -1 below) of the angle at which sticks end, up to a distance [rad] from it.
  pure subroutine new_branch(variable, end, side, reach, branch)
    integer, intent(in) :: variable
    real(wp), intent(in) :: end, side, reach
    type(branch_t), intent(out) :: branch

    branch%variable = variable
    branch%end = end
    branch%side = side
    branch%reach = reach
    branch%count = 1
    allocate (branch%intervals(2**(most_halvings + 1) - 1))
    if (variable == in_logarithm) branch%intervals(1)%first = log(nearest)
    branch%intervals(1)%last = variable_of(branch, reach)
  end subroutine new_branch

  !> The variable at a distance from the end [rad].
  pure real(wp) function variable_of(self, distance) result(z)
    class(branch_t), intent(in) :: self
    real(wp), intent(in) :: distance

    select case (self%variable)
    case (in_root)
      z = sqrt(distance)
    case (in_logarithm)
      z = log(distance)
    case default
      z = distance
    end select
  end function variable_of

  !> The smallest interval so far that contains an angle [rad]; 0 if there is none.
  pure integer function place_of(self, at) result(place)
    class(branch_t), intent(in) :: self
    real(wp), intent(in) :: at
    real(wp) :: distance, z

    place = 0
    distance = self%side*(at - self%end)
    if (distance <= 0.0_wp .or. distance > self%reach) return
    z = variable_of(self, distance)
    if (z < self%intervals(1)%first) return
    place = 1
    do while (self%intervals(place)%half(1) > 0)
      associate (here => self%intervals(place))
        place = here%half(merge(1, 2, z <= 0.5_wp*(here%first + here%last)))
      end associate
    end do
  end function place_of

  pure logical function is_known(self, place)
    class(branch_t), intent(in) :: self
    integer, intent(in) :: place

    is_known = .false.
    if (place > 0) is_known = self%intervals(place)%is_known
  end function is_known

  !> Note that a passage was run in this interval; whether it is to be tabulated now.
  logical function is_wanted(self, place)
    class(branch_t), intent(inout) :: self
    integer, intent(in) :: place

    is_wanted = .false.
    if (place == 0) return
    associate (here => self%intervals(place))
      here%visits = here%visits + 1
      is_wanted = .not. here%is_tried .and. here%visits >= (nodes + tests)/2**min(here%halvings, 1)
    end associate
  end function is_wanted

  !> The angle [rad] at one of the points at which an interval is tabulated, or tested.
  pure real(wp) function angle(self, place, number)
    class(branch_t), intent(in) :: self
    integer, intent(in) :: place, number
    real(wp) :: x(nodes + tests), z

    x(:nodes) = chebyshev_points(nodes)
    x(nodes + 1:) = test_at
    associate (here => self%intervals(place))
      z = here%first + 0.5_wp*(here%last - here%first)*(1.0_wp + x(number))
    end associate
    select case (self%variable)
    case (in_root)
      z = z**2
    case (in_logarithm)
      z = exp(z)
    end select
    angle = self%end + self%side*z
  end function angle

  !> Tabulate an interval, or halve it: `value` holds the passages from all its angles, if they are known; `tolerance` is relative
  !> to the largest duration, and the same for the turn [rad].
  pure subroutine fill(self, place, value, are_known, tolerance)
    class(branch_t), intent(inout) :: self
    integer, intent(in) :: place
    real(wp), intent(in) :: value(nodes + tests, values)
    logical, intent(in) :: are_known
    real(wp), intent(in) :: tolerance
    real(wp) :: coefficient(nodes, values), polynomial(nodes), error(values)
    integer :: i

    self%intervals(place)%is_tried = .true.
    if (are_known) then
      coefficient = chebyshev_coefficients(value(:nodes, :))
      error = 0.0_wp
      do i = 1, tests
        call chebyshev_polynomials(nodes, test_at(i), polynomial)
        error = max(error, abs(matmul(polynomial, coefficient) - value(nodes + i, :)))
      end do
      error(1) = error(1)/maxval(value(:, 1))
      if (maxval(error) <= tolerance) then
        associate (here => self%intervals(place))
          here%is_known = .true.
          here%coefficient(:, :values) = coefficient
          here%coefficient(:, values + 1) = chebyshev_derivative(coefficient(:, values))*(2.0_wp/(here%last - here%first))
        end associate
        return
      end if
    end if
    if (self%intervals(place)%halvings == most_halvings) return
    associate (here => self%intervals(place), halves => self%intervals(self%count + 1:self%count + 2))
      here%half = self%count + [1, 2]
      halves%first = [here%first, 0.5_wp*(here%first + here%last)]
      halves%last = [halves(2)%first, here%last]
      halves%halvings = here%halvings + 1
    end associate
    self%count = self%count + 2
  end subroutine fill

  !> Duration [s] and turn [rad] of the passage from an angle [rad] in an interval that is tabulated, and the slope of the turn.
  pure subroutine evaluate(self, place, at, value, slope)
    class(branch_t), intent(in) :: self
    integer, intent(in) :: place
    real(wp), intent(in) :: at
    real(wp), intent(out) :: value(values), slope
    real(wp) :: polynomial(nodes), found(values + 1), distance, z, rate

    distance = self%side*(at - self%end)
    z = variable_of(self, distance)
    rate = 1.0_wp
    if (self%variable == in_root) rate = 0.5_wp/z
    if (self%variable == in_logarithm) rate = 1.0_wp/distance
    associate (here => self%intervals(place))
      call chebyshev_polynomials(nodes, 2.0_wp*(z - here%first)/(here%last - here%first) - 1.0_wp, polynomial)
      found = matmul(polynomial, here%coefficient)
    end associate
    value = found(:values)
    slope = self%side*rate*found(values + 1)
  end subroutine evaluate
end module dst_branch
