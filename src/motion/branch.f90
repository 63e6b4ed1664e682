!> One branch of the release map: its laps, or its slips, as polynomials in a function of the distance from the end of sticks.
!>
!> Where sticks end by grazing, laps are analytic in the square root of the distance. If there is another such place just beyond, or
!> the end is not known so well, or it is a canard, they are analytic in the logarithm, as are slips, but need twice the points. So
!> laps are tried in the square root first. Intervals of the logarithm are halved where one polynomial does not pass its test. The
!> table of an interval is a function of the scene and the interval alone. docs/cycle_map.md, section 2.
module dst_branch
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_kinds, only: wp
  use dst_passage_table, only: passage_table_t
  implicit none
  private

  public :: branch_t, new_branch, most_parts

  !> Halvings of the whole. Convention; one more: the same cycles of 12 random scenes.
  integer, parameter :: most_halvings = 7
  !> Parts of a table in which passages are observed: its halves, their halves, and so on, 8 times. Convention; twice: measures
  !> change by 6e-12.
  integer, parameter :: most_parts = 2**9 - 1

  !> An interval of the variable.
  type :: interval_t
    real(wp) :: first = 0.0_wp, last = 0.0_wp
    integer :: halvings = 0
    !> Passages that were run in it, and their steps; its halves, 0 if it was not halved.
    integer :: visits = 0, steps = 0, half(2) = 0
    logical :: is_tried = .false., is_known = .false.
    !> Passages from its table that were followed in each of its parts; the halves of part i are parts 2i and 2i + 1.
    integer :: visits_of_part(most_parts) = 0
  end type interval_t

  !> Where a branch is, and whether the square root of the distance is its variable, not the logarithm.
  type :: limits_t
    real(wp) :: end = 0.0_wp, side = 1.0_wp, nearest = 0.0_wp, reach = -1.0_wp     !! rad
    logical :: has_root = .false.
  end type limits_t

  !> A branch, which may be empty.
  type :: branch_t
    type(limits_t), private :: limits
    type(interval_t), allocatable :: intervals(:)
    type(passage_table_t), allocatable :: table(:)     !! of those that are known
  contains
    procedure :: without_tables
    procedure :: interval_count
    procedure :: place_of
    procedure :: distance
    procedure :: visit
    procedure :: angle
    procedure :: depth
    procedure :: has_root
    procedure :: keep
    procedure :: refine
    procedure :: x_of
    procedure :: x_rate
    procedure :: serialise
  end type branch_t

contains

  !> The branch on one side (+1 above, -1 below) of the angle at which sticks end, between two distances [rad] from it.
  pure subroutine new_branch(end, side, nearest, reach, has_root, branch)
    real(wp), intent(in) :: end, side, nearest, reach
    logical, intent(in) :: has_root     !! whether to try the square root of the distance
    type(branch_t), intent(out) :: branch

    branch%limits = limits_t(end, side, nearest, reach, has_root)
    allocate (branch%intervals(1), branch%table(1))
    branch%intervals%first = variable(branch, nearest)
    branch%intervals%last = variable(branch, reach)
  end subroutine new_branch

  !> The branch without its tables, no nearer to the end of sticks [rad], and to no larger angle [rad], than this.
  pure type(branch_t) function without_tables(self, nearest, highest) result(branch)
    class(branch_t), intent(in) :: self
    real(wp), intent(in) :: nearest, highest
    real(wp) :: first, last

    first = max(self%limits%nearest, nearest)
    last = self%limits%reach
    if (self%limits%side > 0.0_wp) last = min(last, self%distance(highest))
    if (first < last) call new_branch(self%limits%end, self%limits%side, first, last, self%limits%has_root, branch)
  end function without_tables

  !> The variable at a distance [rad] from the end of sticks.
  pure real(wp) function variable(self, distance)
    class(branch_t), intent(in) :: self
    real(wp), intent(in) :: distance

    if (self%limits%has_root) then
      variable = sqrt(distance)
    else
      variable = log(distance)
    end if
  end function variable

  !> Whether its variable is the square root of the distance.
  pure logical function has_root(self)
    class(branch_t), intent(in) :: self

    has_root = self%limits%has_root
  end function has_root

  !> Number of intervals, with those that were halved; 0 for an empty branch.
  pure integer function interval_count(self) result(count)
    class(branch_t), intent(in) :: self

    count = 0
    if (allocated(self%intervals)) count = size(self%intervals)
  end function interval_count

  !> The smallest interval so far that contains an angle [rad]; 0 if there is none.
  pure integer function place_of(self, at) result(place)
    class(branch_t), intent(in) :: self
    real(wp), intent(in) :: at
    real(wp) :: z

    place = 0
    if (self%distance(at) < self%limits%nearest .or. self%distance(at) > self%limits%reach) return
    z = variable(self, self%distance(at))
    place = 1
    do while (self%intervals(place)%half(1) > 0)
      associate (here => self%intervals(place))
        place = here%half(merge(1, 2, z <= 0.5_wp*(here%first + here%last)))
      end associate
    end do
  end function place_of

  !> Distance of an angle from the end of sticks, negative on the other side [rad].
  pure real(wp) function distance(self, at)
    class(branch_t), intent(in) :: self
    real(wp), intent(in) :: at

    distance = self%limits%side*(at - self%limits%end)
  end function distance

  !> Note that a passage was run in an interval, in so many steps.
  pure subroutine visit(self, place, steps)
    class(branch_t), intent(inout) :: self
    integer, intent(in) :: place, steps

    self%intervals(place)%visits = self%intervals(place)%visits + 1
    self%intervals(place)%steps = self%intervals(place)%steps + steps
  end subroutine visit

  !> The angle [rad] at a place `x` in [-1, 1] of an interval.
  pure real(wp) function angle(self, place, x)
    class(branch_t), intent(in) :: self
    integer, intent(in) :: place
    real(wp), intent(in) :: x
    real(wp) :: z

    associate (here => self%intervals(place))
      z = here%first + 0.5_wp*(here%last - here%first)*(1.0_wp + x)
    end associate
    if (self%limits%has_root) then
      angle = self%limits%end + self%limits%side*z**2
    else
      angle = self%limits%end + self%limits%side*exp(z)
    end if
  end function angle

  !> Distance [rad] of an angle in an interval from the end of the interval that is nearer to the soft axis.
  pure real(wp) function depth(self, place, at)
    class(branch_t), intent(in) :: self
    integer, intent(in) :: place
    real(wp), intent(in) :: at

    depth = at - min(self%angle(place, -1.0_wp), self%angle(place, 1.0_wp))
  end function depth

  !> The table of an interval.
  pure subroutine keep(self, place, table)
    class(branch_t), intent(inout) :: self
    integer, intent(in) :: place
    type(passage_table_t), intent(in) :: table

    self%intervals(place)%is_known = .true.
    self%table(place) = table
  end subroutine keep

  !> An interval has no table: try the logarithm, or halve it, unless it is too small.
  pure subroutine refine(self, place)
    class(branch_t), intent(inout) :: self
    integer, intent(in) :: place
    type(interval_t) :: halves(2)
    type(passage_table_t) :: none(2)
    type(limits_t) :: limits

    if (self%limits%has_root) then
      limits = self%limits
      call new_branch(limits%end, limits%side, limits%nearest, limits%reach, .false., self)
      return
    end if
    if (self%intervals(place)%halvings == most_halvings) return
    self%intervals(place)%half = self%interval_count() + [1, 2]
    associate (here => self%intervals(place))
      halves%first = [here%first, 0.5_wp*(here%first + here%last)]
      halves%last = [halves(2)%first, here%last]
      halves%halvings = here%halvings + 1
    end associate
    self%intervals = [self%intervals, halves]
    self%table = [self%table, none]
  end subroutine refine

  !> The place in [-1, 1] of an angle [rad] in an interval.
  pure real(wp) function x_of(self, place, at) result(x)
    class(branch_t), intent(in) :: self
    integer, intent(in) :: place
    real(wp), intent(in) :: at

    associate (here => self%intervals(place))
      x = 2.0_wp*(variable(self, self%distance(at)) - here%first)/(here%last - here%first) - 1.0_wp
    end associate
  end function x_of

  !> Its derivative [1/rad].
  pure real(wp) function x_rate(self, place, at) result(rate)
    class(branch_t), intent(in) :: self
    integer, intent(in) :: place
    real(wp), intent(in) :: at

    associate (here => self%intervals(place))
      rate = 2.0_wp*self%limits%side/(here%last - here%first)
    end associate
    if (self%limits%has_root) then
      rate = 0.5_wp*rate/sqrt(self%distance(at))
    else
      rate = rate/self%distance(at)
    end if
  end function x_rate

  !> Save or load, without the tables: they can be made again.
  subroutine serialise(self, archive)
    class(branch_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive
    integer, target :: n

    call archive%serialise(c_loc(self%limits), storage_size(self%limits))
    n = self%interval_count()
    call archive%serialise(c_loc(n), storage_size(n))
    if (n == 0) return
    if (archive%is_loading()) allocate (self%intervals(n), self%table(n))
    call archive%serialise(c_loc(self%intervals(1)), storage_size(self%intervals), n)
  end subroutine serialise
end module dst_branch
