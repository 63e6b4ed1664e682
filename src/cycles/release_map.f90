!> The motion as a map: from a release of the object to the next one.
!>
!> Under a steady drive the direction of friction at a release is the whole state, so that the motion is the iteration of a function
!> of one number, alpha -> P(alpha). By steps alone the map is complete. It has two branches, parted at the angle where sticks end:
!> above it a lap (slip and stick) turns the force towards the soft axis, below it a slip turns it back. Where many passages of a
!> branch are needed, it is tabulated (dst_branch); nobody who asks for a passage needs to know. docs/cycles.md, section 3.
module dst_release_map
  use dst_assembly, only: new_motion
  use dst_branch, only: branch_t, new_branch, in_root, in_distance, in_logarithm, nodes, tests, values
  use dst_errors, only: error_t
  use dst_kinds, only: wp, int64, pi
  use dst_motion, only: motion_t
  use dst_piece, only: slip_begins, sticks
  use dst_scene, only: scene_t
  use dst_slip_stick, only: slip_stick_t
  use dst_state, only: state_t
  implicit none
  private

  public :: release_map_t, passage_t, new_release_map

  !> Largest distance of an interpolated passage from one that is run, in rtol. Convention; twice: of 12 random scenes one has two
  !> more unstable cycles.
  real(wp), parameter :: accurate = 30.0_wp
  !> A difference of the angle at whose growth the slope is measured: this share of the turn, but not less than so many rtol.
  !> Conventions. Ten times: the exponent of Fig. 3 is higher by 0.02, as a slip depends on its beginning like a square root near a
  !> touch.
  real(wp), parameter :: push = 1.0e-4_wp, least_push = 0.1_wp
  !> The angle at which sticks end is found with this uncertainty [rad].
  real(wp), parameter :: fine = 1.0e-13_wp
  !> A passage that turns the force by less [rad] comes back to where it began: near a fixed point that the motion reaches from both
  !> sides in turn. Convention; twice: the same cycles of 12 random scenes.
  real(wp), parameter :: still = 1.0e-8_wp
  !> Where sticks end by grazing, the share of rest goes to zero: at this distance it is below so much. Convention.
  real(wp), parameter :: grazing_share = 0.02_wp
  !> Laps are tabulated up to this angle [rad], slips in a canard down to so much below the end of sticks. Conventions: other
  !> passages are run.
  real(wp), parameter :: steepest = 0.4995_wp*pi, depth = 0.17_wp

  !> The motion from one release to the next.
  type :: passage_t
    real(wp) :: from = 0.0_wp, to = 0.0_wp      !! alpha, rad
    real(wp) :: duration = 0.0_wp               !! s
    real(wp) :: at_rest = 0.0_wp                !! the last rest, s; 0 if the passage was interpolated
    real(wp) :: slope = 0.0_wp                  !! P'(alpha)
    real(wp) :: log_slope = 0.0_wp              !! the sum of ln |P'| over the passages of a slow cycle or several
    logical :: has_slope = .false.
  contains
    procedure :: turns_back
    procedure :: go_on
  end type passage_t

  !> The map of a scene under a steady drive. alpha is the angle from the soft to the stiff axis, each in the direction in which the
  !> drive pulls.
  type :: release_map_t
    class(slip_stick_t), allocatable :: steps
    !> No passage takes longer [s].
    real(wp) :: longest = 0.0_wp
    !> An unstable fixed point at the end of sticks [rad], if there is one.
    logical :: has_fixed = .false.
    real(wp) :: fixed = 0.0_wp
    !> Tables, once the branches are parted.
    logical, private :: is_tried = .false.
    type(branch_t), private :: branch(2)           !! laps, slips
    !> The last passage that was run.
    type(passage_t), private :: before
    real(wp), private :: rtol = 0.0_wp, pull(2) = 1.0_wp
  contains
    procedure :: first
    procedure :: next
    procedure :: come_back
    procedure :: power
    procedure :: theta
  end type release_map_t

contains

  !> The map of a scene, which must have one steady drive velocity, exact contact and a method for it.
  subroutine new_release_map(scene, map, error)
    type(scene_t), intent(in) :: scene
    type(release_map_t), intent(out) :: map
    type(error_t), allocatable, intent(out) :: error
    type(scene_t) :: plain
    class(motion_t), allocatable :: motion, other

    plain = scene
    plain%cycle_map = 'off'
    call new_motion(plain, motion, other, error)
    if (allocated(error)) return
    select type (motion)
    class is (slip_stick_t)
      allocate (map%steps, source=motion)
    end select
    map%longest = scene%t_end
    map%steps%t_end = huge(1.0_wp)**0.25_wp
    map%rtol = scene%rtol
    map%pull = sign([1.0_wp, 1.0_wp], map%steps%slider%along*scene%drive_velocity(1))
  end subroutine new_release_map

  !> Whether the passage leads away from the soft axis, as a slip does.
  pure logical function turns_back(self)
    class(passage_t), intent(in) :: self

    turns_back = self%to >= self%from - still
  end function turns_back

  !> Continue with the passage that follows.
  pure subroutine go_on(self, next)
    class(passage_t), intent(inout) :: self
    type(passage_t), intent(in) :: next

    self%to = next%to
    self%duration = self%duration + next%duration
    self%slope = self%slope*next%slope
    self%log_slope = self%log_slope + next%log_slope
    self%has_slope = self%has_slope .and. next%has_slope
  end subroutine go_on

  !> No passage yet: the beginning of several.
  pure type(passage_t) function beginning(alpha)
    real(wp), intent(in) :: alpha

    beginning = passage_t(from=alpha, to=alpha, slope=1.0_wp, has_slope=.true.)
  end function beginning

  !> The direction of friction [rad] at a release.
  pure real(wp) function theta(self, alpha)
    class(release_map_t), intent(in) :: self
    real(wp), intent(in) :: alpha

    theta = atan2(self%pull(2)*sin(alpha), self%pull(1)*cos(alpha))
  end function theta

  pure real(wp) function alpha_of(self, theta) result(alpha)
    class(release_map_t), intent(in) :: self
    real(wp), intent(in) :: theta

    alpha = atan2(self%pull(2)*sin(theta), self%pull(1)*cos(theta))
  end function alpha_of

  !> The first release of the scene's own motion, from its initial state.
  subroutine first(self, alpha, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(out) :: alpha
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: at_rest

    call step_to_release(self, self%longest, alpha, at_rest, found, error)
  end subroutine first

  !> From the present state to the next release, for `longest` [s] at most.
  subroutine step_to_release(self, longest, alpha, at_rest, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: longest
    real(wp), intent(out) :: alpha, at_rest
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error

    found = .false.
    alpha = 0.0_wp
    at_rest = 0.0_wp
    do while (self%steps%piece%to%time <= longest)
      call self%steps%advance(error)
      if (allocated(error)) return
      associate (piece => self%steps%piece)
        found = piece%event == slip_begins .and. piece%contact == sticks
        if (.not. found) cycle
        alpha = alpha_of(self, piece%to%y(2))
        at_rest = piece%to%time - piece%from%time
        return
      end associate
    end do
  end subroutine step_to_release

  !> The passage from `alpha` [rad] by steps.
  subroutine run(self, alpha, longest, passage, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: alpha, longest
    type(passage_t), intent(out) :: passage
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error

    passage%from = alpha
    call self%steps%place_at_release(self%theta(alpha), state_t())
    call step_to_release(self, longest, passage%to, passage%at_rest, found, error)
    passage%duration = self%steps%piece%to%time
  end subroutine run

  !> The passage from `alpha` [rad]: P(alpha); its slope only on request.
  subroutine next(self, alpha, with_slope, passage, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: alpha
    logical, intent(in) :: with_slope
    type(passage_t), intent(out) :: passage
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error

    call look_up(self, alpha, passage, found)
    if (found) return
    call run(self, alpha, self%longest, passage, found, error)
    if (allocated(error) .or. .not. found) return
    if (with_slope) call measure_slope(self, passage, error)
    if (.not. allocated(error)) call learn(self, passage, error)
  end subroutine next

  !> The passage that a table has.
  pure subroutine look_up(self, alpha, passage, found)
    class(release_map_t), intent(in) :: self
    real(wp), intent(in) :: alpha
    type(passage_t), intent(out) :: passage
    logical, intent(out) :: found
    real(wp) :: value(values), slope
    integer :: i, place

    found = .false.
    do i = 1, size(self%branch)
      place = self%branch(i)%place_of(alpha)
      found = self%branch(i)%is_known(place)
      if (.not. found) cycle
      call self%branch(i)%evaluate(place, alpha, value, slope)
      passage = passage_t(alpha, alpha + value(2), value(1), slope=1.0_wp + slope, has_slope=.true.)
      return
    end do
  end subroutine look_up

  !> P' by a difference; there is none where the neighbours do not stay neighbours.
  subroutine measure_slope(self, passage, error)
    class(release_map_t), intent(inout) :: self
    type(passage_t), intent(inout) :: passage
    type(error_t), allocatable, intent(out) :: error
    !> The neighbours may take so much longer or less. Convention.
    real(wp), parameter :: alike = 0.05_wp
    type(passage_t) :: beside(2)
    logical :: found(2)
    real(wp) :: apart
    integer :: i

    apart = max(push*abs(passage%to - passage%from), least_push*self%rtol)
    do i = 1, 2
      call run(self, passage%from + (real(i, wp) - 1.5_wp)*apart, 2.0_wp*passage%duration, beside(i), found(i), error)
      if (allocated(error)) return
    end do
    passage%has_slope = all(found)
    if (passage%has_slope) passage%has_slope = abs(beside(2)%duration - beside(1)%duration) <= alike*passage%duration
    if (passage%has_slope) passage%slope = (beside(2)%to - beside(1)%to)/apart
  end subroutine measure_slope

  !> A passage was run: part the branches when a lap and the slip after it are known, and tabulate what is often needed.
  subroutine learn(self, passage, error)
    class(release_map_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    type(error_t), allocatable, intent(out) :: error
    type(passage_t) :: before
    integer :: i

    before = self%before
    self%before = passage
    if (.not. self%is_tried .and. passage%turns_back() .and. .not. before%turns_back() .and. before%from > passage%from) &
      call part(self, before, passage, error)
    if (allocated(error)) return
    do i = 1, size(self%branch)
      call tabulate(self, i, passage%from)
    end do
  end subroutine learn

  !> Find the angle at which sticks end, between a lap and a slip, by the sign of the turn, and what is analytic on both sides.
  subroutine part(self, lap, slip, error)
    class(release_map_t), intent(inout) :: self
    type(passage_t), intent(in) :: lap, slip
    type(error_t), allocatable, intent(out) :: error
    real(wp), parameter :: beside = 1.0e-7_wp    !! rad
    type(passage_t) :: last, here
    real(wp) :: low
    logical :: found

    self%is_tried = .true.
    low = slip%from
    last = lap
    do while (last%from - low > fine)
      ! Laps just above the end are about as long as each other; what takes longer is none.
      call run(self, 0.5_wp*(low + last%from), 2.0_wp*last%duration, here, found, error)
      if (allocated(error)) return
      if (found .and. here%to < here%from) then
        last = here
      else
        low = here%from
      end if
    end do
    associate (end => last%from, grazes => last%at_rest <= grazing_share*last%duration)
      if (grazes) then
        call new_branch(in_root, end, 1.0_wp, steepest - end, self%branch(1))
        call new_branch(in_distance, end, -1.0_wp, end - last%to, self%branch(2))
        return
      end if
      call run(self, end + beside, self%longest, here, found, error)
      if (allocated(error) .or. .not. found) return
      ! A motion that comes nearer to the end needs no tables.
      if (abs(here%to - end) <= beside) return
      self%has_fixed = abs(last%to - end) <= beside
      self%fixed = end
      call new_branch(in_logarithm, end, 1.0_wp, steepest - end, self%branch(1))
      call new_branch(in_logarithm, end, -1.0_wp, depth, self%branch(2))
    end associate
  end subroutine part

  !> Tabulate the interval around an angle [rad], if that is due.
  subroutine tabulate(self, which, alpha)
    class(release_map_t), intent(inout) :: self
    integer, intent(in) :: which               !! branch
    real(wp), intent(in) :: alpha
    type(passage_t) :: passage
    type(error_t), allocatable :: error
    real(wp) :: value(nodes + tests, values)
    logical :: found
    integer :: place, i

    place = self%branch(which)%place_of(alpha)
    if (.not. self%branch(which)%is_wanted(place)) return
    do i = 1, nodes + tests
      call run(self, self%branch(which)%angle(place, i), self%longest, passage, found, error)
      ! The motion itself need not come there.
      if (allocated(error)) deallocate (error)
      if (.not. found) exit
      value(i, :) = [passage%duration, passage%to - passage%from]
    end do
    call self%branch(which)%fill(place, value, found, accurate*self%rtol)
  end subroutine tabulate

  !> A slow cycle: passage after passage until one turns back, the `slip`. `whole` leads from its beginning to its end.
  subroutine come_back(self, alpha, with_slope, whole, slip, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: alpha
    logical, intent(in) :: with_slope
    type(passage_t), intent(out) :: whole, slip
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    !> Passages after which there is no return, and Newton iterations in all after which nothing more is found: some seconds.
    !> Conventions.
    integer, parameter :: most = 200000
    integer(int64), parameter :: most_work = 3000000_int64
    integer :: i

    whole = beginning(alpha)
    do i = 1, most
      call self%next(whole%to, with_slope, slip, found, error)
      if (allocated(error) .or. .not. found) return
      if (with_slope) slip%log_slope = log(max(tiny(1.0_wp), abs(slip%slope)))
      call whole%go_on(slip)
      if (slip%turns_back()) return
      if (self%steps%stepper%count%newton > most_work) exit
    end do
    found = .false.
  end subroutine come_back

  !> So many slow cycles, with their slope.
  subroutine power(self, alpha, slow_cycles, whole, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: alpha
    integer, intent(in) :: slow_cycles
    type(passage_t), intent(out) :: whole
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    type(passage_t) :: one, slip
    integer :: i

    whole = beginning(alpha)
    do i = 1, slow_cycles
      call self%come_back(whole%to, .true., one, slip, found, error)
      if (allocated(error) .or. .not. found) return
      call whole%go_on(one)
    end do
  end subroutine power
end module dst_release_map
