!> The motion as a map: from a release of the object to the next one.
!>
!> Under a steady drive the direction of friction at a release is the whole state, so that the motion is the iteration of a function
!> of one number, alpha -> P(alpha). By steps alone the map is complete. It has two branches, parted at the angle where sticks end:
!> above it a lap (slip and stick) turns the force towards the soft axis, below it a slip turns it back. Where many passages of a
!> branch are needed, it is tabulated (dst_branch); nobody who asks for a passage needs to know. A table is made from runs that
!> begin with the same state of the method: it is a function of the scene, V and its interval alone. docs/cycle_map.md, section 2.
module dst_release_map
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_branch, only: branch_t, new_branch
  use dst_drive, only: drive_segment_t
  use dst_errors, only: error_t
  use dst_kinds, only: wp, int64, pi
  use dst_linear_solve, only: solve_in_place
  use dst_observation, only: observation_t, observe
  use dst_passage, only: passage_t, passage_of, alpha_of, theta_of, still, duration, turn, slip_duration, measures
  use dst_passage_table, only: passage_table_t, new_passage_table, values
  use dst_piece, only: slip_begins, sticks
  use dst_recording, only: recording_t, most_pieces
  use dst_remembered, only: remembered_t
  use dst_slip_stick, only: slip_stick_t
  use dst_state, only: state_t
  use dst_stepper, only: work_count_t
  use dst_tangent, only: set_slope
  implicit none
  private

  public :: release_map_t, watch_t, new_release_map

  !> Largest error of a table, in rtol, relative to the duration and to the turn. Convention; measured in bench/cycle_map.py.
  real(wp), parameter :: accurate = 0.1_wp
  !> Tables begin at this distance from the end of sticks [rad], or at this share of the turn of a lap there: so many slow cycles
  !> have a release that is nearer and is run; or at the last lap that tells where sticks end by grazing. The end is found with a
  !> tenth of this uncertainty. Conventions.
  real(wp), parameter :: nearest = 1.0e-7_wp, near_share = 0.01_wp, fine = 0.1_wp
  !> Laps are tabulated up to this angle [rad], or up to the one at which branches are parted, if that is steeper, as after a
  !> reversal; slips in a canard down to so much below the end of sticks. Conventions: other passages are run.
  real(wp), parameter :: steepest = 0.4995_wp*pi, depth = 0.17_wp
  !> A table is made as soon as so many passages in it are expected for each of its points, or as many have been run, and may take
  !> as many steps fewer than these passages. What is expected is known from the laps of a slow cycle, or after this number of
  !> passages of an interval. The end of sticks is looked for after this number of laps or slips, if as many are expected, or after
  !> this multiple of passages. Conventions; twice, one after the other: the same work within 0.2 %, 1.3 % more, the same.
  real(wp), parameter :: profit = 2.0_wp
  !> Steps for the parting of branches and for tables that do not pass their tests: at most this share of those that are expected in
  !> all. So much dearer than without tables is a motion at worst. Convention; twice: the same work within 0.2 %.
  real(wp), parameter :: in_vain = 0.15_wp
  integer, parameter :: first_passages = 8, many = 3
  !> Points between those of a table at which it is tested: near both ends and in the middle.
  real(wp), parameter :: test_at(3) = [-0.985_wp, 0.02_wp, 0.985_wp]
  !> Newton's steps to a fixed point, which turns the force by no more than this [rad]. Conventions; twice each: no change.
  integer, parameter :: most_steps = 20
  real(wp), parameter :: at_rest = 1.0e-12_wp
  !> Laps that tell where sticks end by grazing. Convention.
  integer, parameter :: most_laps = 5
  !> So many passages are as good as a motion without end.
  real(wp), parameter :: without_end = 1.0e9_wp

  !> The end of sticks by grazing. There the share of rest vanishes like the square root of the distance, so that the angle is a
  !> polynomial of it without a linear term: through the last laps, each nearer than the one before.
  type :: grazing_t
    integer :: count = 0
    real(wp) :: share(most_laps) = 0.0_wp, angle(most_laps) = 0.0_wp
    !> From where on the share of rest falls [rad].
    real(wp) :: begins = 0.0_wp
    !> Where they end [rad], by how much that differs from what was known before this lap, and its error, if differences decrease
    !> further as they did; huge if there is no such value.
    real(wp) :: end = huge(1.0_wp), differs = huge(1.0_wp), error = huge(1.0_wp)
  contains
    procedure :: take
  end type grazing_t

  !> What is known of the passages so far.
  type :: learned_t
    logical :: is_parted = .false.
    !> The number of slips that were run, of laps that were run since the last slip, of passages, and the last one that was run.
    integer :: slips = 0, row = 0
    integer(int64) :: passages = 0
    type(passage_t) :: before
    !> The duration of passages [s], and the number that is expected in all, in slow cycles like the first ones or in the first one.
    real(wp) :: lasted = 0.0_wp, expected = 0.0_wp
    !> The number of passages that were run, their steps, the steps in vain, and the passages that were run for tables.
    integer(int64) :: run = 0, steps = 0, vain = 0
    integer :: sampled = 0
    !> The largest error of a table that is in use, over rtol = 1.
    real(wp) :: error = 0.0_wp
  end type learned_t

  !> The map under one steady drive velocity.
  type :: release_map_t
    !> The motion that runs passages; its last passage; and how it begins each of them.
    class(slip_stick_t), allocatable :: steps
    type(recording_t) :: recording
    real(wp) :: ran = huge(1.0_wp)                !! where that begins, rad
    class(slip_stick_t), allocatable, private :: unused
    real(wp) :: velocity = 0.0_wp                 !! V, m/s
    real(wp), private :: rtol = 0.0_wp
    !> No passage takes longer [s]; and how many slips `next` is expected to give, negative if nobody knows.
    real(wp) :: longest = huge(1.0_wp), slips_expected = without_end
    !> An unstable fixed point at the end of sticks [rad], if there is one.
    logical :: has_fixed = .false.
    real(wp) :: fixed = 0.0_wp
    !> Tables, once the branches are parted; with or without the motion inside. Allocatable: see cycle_map_t.
    type(branch_t), allocatable :: branch(:)      !! laps, slips
    logical :: keeps_motion = .false.
    type(learned_t), private :: learned
    !> Passages that `next` has run; where it may give others by them, and with which error of their end [rad], 0 if not.
    type(remembered_t), private :: remembered
    real(wp) :: recalls = 0.0_wp
    !> Who looks on while slow cycles are followed, and may end it.
    procedure(watch_t), pointer, nopass :: watch => null()
  contains
    procedure :: first
    procedure :: next
    procedure :: run
    procedure :: look_up
    procedure :: part_as
    procedure :: describe
    procedure :: count
    procedure :: learn
    procedure :: come_back
    procedure :: is_spent
    procedure :: theta
    procedure :: elongation
    procedure :: work
    procedure :: serialise
  end type release_map_t

  abstract interface
    !> Whether to end a search that has followed so many passages.
    logical function watch_t(passages)
      import :: int64
      integer(int64), intent(in) :: passages
    end function watch_t
  end interface

contains

  !> The map of the motion `steps`, which has been started, under a steady drive velocity [m/s], at this tolerance.
  subroutine new_release_map(steps, velocity, rtol, keeps_motion, map)
    class(slip_stick_t), intent(in) :: steps
    real(wp), intent(in) :: velocity, rtol
    logical, intent(in) :: keeps_motion       !! whether laps have to be described
    type(release_map_t), intent(out) :: map

    allocate (map%steps, source=steps)
    map%steps%stepper%count = work_count_t()
    map%steps%t_end = huge(1.0_wp)**0.25_wp
    map%steps%segment = 1
    map%steps%drive%segment = [drive_segment_t(velocity=velocity)]
    map%steps%piece%drive = map%steps%drive%segment(1)
    map%velocity = velocity
    map%rtol = rtol
    map%keeps_motion = keeps_motion
    allocate (map%branch(2))
    allocate (map%unused, source=map%steps)
  end subroutine new_release_map

  !> No passage yet: the beginning of several.
  pure type(passage_t) function beginning(alpha)
    real(wp), intent(in) :: alpha

    beginning = passage_t(from=alpha, to=alpha, slope=1.0_wp, has_slope=.true.)
  end function beginning

  !> The direction of friction [rad] at a release.
  pure real(wp) function theta(self, alpha)
    class(release_map_t), intent(in) :: self
    real(wp), intent(in) :: alpha

    theta = theta_of(alpha, self%steps%slider, self%velocity)
  end function theta

  !> The elongation of the springs [m] at a release.
  pure function elongation(self, alpha) result(u)
    class(release_map_t), intent(in) :: self
    real(wp), intent(in) :: alpha
    real(wp) :: u(2)

    u = self%steps%slider%elongation_at_limit(self%theta(alpha), self%velocity)
  end function elongation

  !> Points of a table: what laps over a right angle need in the logarithm for a hundredth of this tolerance (measured: 32 at 1e-5,
  !> 41 at 1e-8), or in the square root (15, 21).
  pure integer function points(self, has_root)
    class(release_map_t), intent(in) :: self
    logical, intent(in), optional :: has_root     !! no if absent

    points = max(21, nint(20.0_wp - 3.0_wp*log10(self%rtol)))
    if (.not. present(has_root)) return
    if (has_root) points = max(9, nint(7.0_wp - 2.0_wp*log10(self%rtol)))
  end function points

  !> The first release of the motion that the map was made of, if no passage was run before.
  subroutine first(self, alpha, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(out) :: alpha
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error

    call step_to_release(self, self%longest, most_pieces, found, error)
    alpha = alpha_of(self%steps%piece%to%y(2), self%steps%slider, self%velocity)
  end subroutine first

  !> From the present state to the next release, which has to occur before the time `longest` [s], and within so many steps.
  subroutine step_to_release(self, longest, most, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: longest
    integer(int64), intent(in) :: most
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error

    found = .false.
    call self%recording%clear()
    associate (piece => self%steps%piece)
      do while (piece%to%time <= longest .and. self%recording%count < min(most, most_pieces) .and. .not. found)
        call self%steps%advance(error)
        if (allocated(error)) return
        call self%recording%append(piece)
        found = piece%event == slip_begins .and. piece%contact == sticks
      end do
    end associate
  end subroutine step_to_release

  !> The passage from `alpha` [rad] by steps, if it takes no longer than `longest` [s] and no more than so many steps.
  subroutine run(self, alpha, longest, passage, found, error, most)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: alpha, longest
    type(passage_t), intent(out) :: passage
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error
    integer(int64), intent(in), optional :: most
    type(work_count_t) :: count
    integer(int64) :: steps

    steps = most_pieces
    if (present(most)) steps = most
    count = self%steps%stepper%count
    deallocate (self%steps)
    allocate (self%steps, source=self%unused)
    self%steps%stepper%count = count
    call self%steps%place_at_release(self%theta(alpha), state_t())
    call step_to_release(self, longest, steps, found, error)
    self%ran = alpha
    passage%from = alpha
    if (found) passage = passage_of(alpha, self%recording, self%steps%slider, self%velocity)
  end subroutine run

  !> The passage from `alpha` [rad], P(alpha), with its slope.
  subroutine next(self, alpha, passage, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: alpha
    type(passage_t), intent(out) :: passage
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error

    call self%look_up(alpha, passage, found)
    if (found) return
    if (self%recalls > 0.0_wp) call self%remembered%recall(alpha, self%recalls, end_of_slips(self), passage, found)
    if (found) return
    call self%run(alpha, self%longest, passage, found, error)
    if (allocated(error) .or. .not. found) return
    call set_slope(self%recording, self%steps%system, self%steps%slider, passage)
    call self%remembered%keep(passage)
    call self%learn(passage, without_end*passage%measure(duration), self%slips_expected, .false., error)
  end subroutine next

  !> The angle [rad] up to which passages are slips that are smooth in the angle, if it is known.
  pure real(wp) function end_of_slips(self)
    class(release_map_t), intent(in) :: self

    end_of_slips = -huge(1.0_wp)
    if (self%branch(1)%has_root()) end_of_slips = -self%branch(1)%distance(0.0_wp)
  end function end_of_slips

  !> The passage that a table has.
  pure subroutine look_up(self, alpha, passage, found)
    class(release_map_t), intent(in) :: self
    real(wp), intent(in) :: alpha
    type(passage_t), intent(out) :: passage
    logical, intent(out) :: found
    real(wp) :: value(values), rate
    integer :: i, place

    found = .false.
    do i = 1, size(self%branch)
      place = self%branch(i)%place_of(alpha)
      if (place == 0) cycle
      if (.not. self%branch(i)%intervals(place)%is_known) cycle
      call self%branch(i)%table(place)%evaluate(self%branch(i)%x_of(place, alpha), value)
      found = value(slip_duration) > 0.0_wp .and. value(duration) > value(slip_duration)
      passage = passage_t(alpha, alpha + value(turn), value(:measures), is_plain=i == 1, table=[i, place])
      rate = self%branch(i)%x_rate(place, alpha)
      call passage%take_slope(1.0_wp + rate*value(measures + 1), rate*value(values))
      return
    end do
  end subroutine look_up

  !> Part the branches where the map of the same motion at a larger tolerance has parted them, for laps up to an angle [rad]. Where
  !> sticks end by grazing, they are not known to end there so well that a table could begin nearer than a good part of a lap.
  subroutine part_as(self, other, highest)
    class(release_map_t), intent(inout) :: self
    type(release_map_t), intent(in) :: other
    real(wp), intent(in) :: highest
    !> This part of a lap; and the place of a lap in its table, of which the end has a rounding error.
    real(wp), parameter :: part_of_lap = 0.3_wp, beginning = -0.999_wp
    type(passage_t) :: lap
    logical :: found

    self%learned%is_parted = other%learned%is_parted
    if (other%branch(1)%has_root()) call other%look_up(other%branch(1)%angle(1, beginning), lap, found)
    self%branch(1) = other%branch(1)%without_tables(part_of_lap*abs(lap%measure(turn)), highest)
    self%branch(2) = other%branch(2)%without_tables(0.0_wp, highest)
  end subroutine part_as

  !> The motion of a passage: from its table if that has it, else by steps. In slips, and in laps at tight tolerances, the motion
  !> between the ends of steps is not accurate enough for a table.
  subroutine describe(self, passage, recording, found)
    class(release_map_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    type(recording_t), intent(inout) :: recording
    logical, intent(out) :: found
    type(error_t), allocatable :: error
    type(passage_t) :: again
    real(wp) :: u(2, 2)

    associate (slider => self%steps%slider, place => passage%table(2), branch => self%branch(passage%table(1)))
      if (branch%table(place)%panels == 0) then
        call self%run(passage%from, self%longest, again, found, error)
        call recording%copy(self%recording)
        return
      end if
      found = .true.
      u(:, 1) = self%elongation(passage%from)
      u(:, 2) = self%elongation(passage%to)
      call branch%table(place)%describe(branch%x_of(place, passage%from), passage, slider, u, self%theta(passage%from), &
        self%unused%piece, recording)
    end associate
  end subroutine describe

  !> Count a passage of the motion.
  pure subroutine count(self, passage)
    class(release_map_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage

    self%learned%passages = self%learned%passages + 1
    self%learned%lasted = self%learned%lasted + passage%measure(duration)
  end subroutine count

  !> A passage was run: part the branches when many laps are expected, or when many passages have been run and these are a lap and
  !> the slip after it; and tabulate what is often needed.
  subroutine learn(self, passage, rest, slips, only_laps, error)
    class(release_map_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    real(wp), intent(in) :: rest, slips        !! how long the map will be needed [s], and how many slips are expected
    logical, intent(in) :: only_laps           !! whether each slip is run
    type(error_t), allocatable, intent(out) :: error
    type(passage_t) :: before
    real(wp) :: left, enough
    integer :: i

    enough = 2.0_wp*profit*real(points(self), wp)
    associate (known => self%learned)
      before = known%before
      known%before = passage
      call self%count(passage)
      call count_steps(self, passage%steps)
      known%row = known%row + 1
      if (passage%turns_back()) then
        known%row = 0
        known%slips = known%slips + 1
      end if
      left = rest/known%lasted
      if (known%slips > 0 .and. slips >= 0.0_wp) left = min(left, slips/real(known%slips, wp))
      known%expected = real(known%passages, wp)*(1.0_wp + left)
      ! Where the laps of the first slow cycle end is not known: half way.
      left = laps_left(before, passage, 0.5_wp*passage%to, rest)
      if (known%slips == 0) known%expected = real(known%passages, wp) + left
      if (.not. known%is_parted .and. steps_left(self) >= real(points(self), wp)*steps_each(self)) then
        if (passage%turns_back()) then
          if ((known%passages >= many*points(self) .and. known%expected - real(known%passages, wp) >= enough .or. &
            known%slips >= first_passages .and. slips >= profit*real(points(self), wp)) .and. &
            before%is_plain .and. before%from > passage%from .and. .not. before%turns_back()) &
            call part(self, passage%from, before, before, error)
        else if (known%row >= first_passages .and. passage%is_plain .and. before%is_plain) then
          if (left >= enough) call part(self, 0.0_wp, passage, before, error)
        end if
      end if
    end associate
    if (allocated(error)) return
    do i = 1, merge(1, size(self%branch), only_laps)
      call tabulate(self, i, before, passage, rest, slips)
    end do
  end subroutine learn

  !> Count a passage that was run in so many steps.
  pure subroutine count_steps(self, steps)
    class(release_map_t), intent(inout) :: self
    integer, intent(in) :: steps

    self%learned%run = self%learned%run + 1
    self%learned%steps = self%learned%steps + steps
  end subroutine count_steps

  !> Steps of a passage, in the mean of those that were run, of which there must be one.
  pure real(wp) function steps_each(self)
    class(release_map_t), intent(in) :: self

    steps_each = real(self%learned%steps, wp)/real(self%learned%run, wp)
  end function steps_each

  !> Steps that may still be made in vain.
  pure real(wp) function steps_left(self)
    class(release_map_t), intent(in) :: self

    steps_left = in_vain*self%learned%expected*steps_each(self) - real(self%learned%vain, wp)
  end function steps_left

  !> A number of steps.
  pure integer(int64) function as_count(steps)
    real(wp), intent(in) :: steps

    as_count = int(min(steps, without_end), int64)
  end function as_count

  !> Laps that are expected after two of them, up to a distance from the beginning of the last one [rad], and in a time [s].
  pure real(wp) function laps_left(before, last, way, rest) result(laps)
    type(passage_t), intent(in) :: before, last
    real(wp), intent(in) :: way, rest
    real(wp) :: ratio

    laps = 0.0_wp
    if (last%turns_back() .or. .not. abs(before%measure(turn)) > 0.0_wp) return
    laps = min(way/abs(last%measure(turn)), rest/last%measure(duration))
    ! Turns that decrease in equal ratios lead to a lap that repeats itself.
    ratio = last%measure(turn)/before%measure(turn)
    if (ratio < 1.0_wp) laps = min(laps, log(still/abs(last%measure(turn)))/log(max(tiny(1.0_wp), ratio)))
  end function laps_left

  !> Find the angle at which sticks end, between an angle [rad] that begins no lap and a lap, by the sign of the turn, or where the
  !> share of rest of laps vanishes, if sticks end by grazing and successive laps agree about it.
  subroutine part(self, below, lap, other_lap, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: below
    type(passage_t), intent(in) :: lap, other_lap
    type(error_t), allocatable, intent(out) :: error
    !> The next guess lies above the end by this share of the distance, if two guesses of it agree so far. Convention.
    real(wp), parameter :: ahead = 0.1_wp
    !> Laps are tried in the square root if the share of rest rises with it over so much of the branch. Convention.
    real(wp), parameter :: wide = 0.1_wp
    type(passage_t) :: last, here
    type(grazing_t) :: grazing
    real(wp) :: low, end, guess, top, near
    logical :: found, is_grazing

    self%learned%is_parted = .true.
    top = max(steepest, lap%from)
    low = below
    last = lap
    call grazing%take(other_lap)
    call grazing%take(lap)
    do
      near = max(nearest, near_share*abs(last%measure(turn)))
      end = low
      if (grazing%end < last%from) end = max(low, grazing%end)
      ! The last laps may rest so briefly that they are none.
      is_grazing = grazing%error <= accurate*self%rtol .and. grazing%end < last%from
      if (is_grazing) then
        end = grazing%end
        near = max(nearest, last%from - end)
        is_grazing = grazing%begins - end >= wide*(top - end)
        exit
      end if
      if (last%from - end <= fine*near) exit
      if (abs(last%measure(turn)) <= near_share*abs(lap%measure(turn))) then
        ! Laps come to one that repeats itself, or to a canard.
        near = max(near, last%from - end)
        exit
      end if
      guess = end + ahead*(last%from - end)
      if (grazing%differs > ahead*(last%from - end)) guess = max(0.5_wp*(low + last%from), guess)
      guess = rounded(guess)
      ! Laps just above the end are about as long as each other; what takes longer is none.
      call self%run(guess, 2.0_wp*last%measure(duration)*max(1.0_wp, sin(last%from)/sin(guess)), here, found, error, &
        as_count(steps_left(self)))
      self%learned%sampled = self%learned%sampled + 1
      self%learned%vain = self%learned%vain + self%recording%count
      call count_steps(self, self%recording%count)
      if (allocated(error) .or. steps_left(self) < 0.0_wp) return
      if (found .and. here%is_plain .and. here%to < here%from) then
        last = here
        call grazing%take(here)
      else
        low = guess
      end if
    end do
    end = rounded(end)
    near = max(nearest, rounded(near))
    call self%run(last%from + near, self%longest, here, found, error)
    if (allocated(error) .or. .not. found) return
    call new_branch(end, 1.0_wp, near, top - end, is_grazing, self%branch(1))
    ! To a stable lap the motion comes from both sides.
    if (abs(here%to - last%from) <= near) return
    self%has_fixed = abs(last%to - last%from) <= near
    self%fixed = last%from
    call new_branch(end, -1.0_wp, near, max(depth, abs(last%measure(turn))), .false., self%branch(2))

  contains

    !> An angle [rad] without the digits in which machines differ: else the tables of all passages would.
    pure real(wp) function rounded(angle)
      real(wp), intent(in) :: angle

      associate (unit => min(0.01_wp*self%rtol, 0.01_wp*nearest))
        rounded = unit*anint(angle/unit)
      end associate
    end function rounded
  end subroutine part

  !> Another lap, nearer to the end of sticks.
  pure subroutine take(self, lap)
    class(grazing_t), intent(inout) :: self
    type(passage_t), intent(in) :: lap
    real(wp) :: before(2), angle(most_laps)
    real(wp), allocatable :: matrix(:, :)
    integer :: i, k
    logical :: singular

    associate (n => self%count, share => self%share, here => lap%share_of_rest())
      if (n > 0) then
        if (here >= share(n)) n = 0
      end if
      if (n == 0) self%begins = lap%from
      if (n == most_laps) then
        share(:n - 1) = share(2:n)
        self%angle(:n - 1) = self%angle(2:n)
        n = n - 1
      end if
      n = n + 1
      share(n) = here
      self%angle(n) = lap%from
      before = [self%end, self%differs]
      self%end = huge(self%end)
      self%differs = huge(self%end)
      self%error = huge(self%end)
      if (n < 2) return
      matrix = reshape([(((share(i)/share(1))**merge(0, k, k == 1), i=1, n), k=1, n)], [n, n])
      angle = self%angle
      call solve_in_place(n, matrix, angle(:n), singular)
      if (singular) return
      self%end = angle(1)
      if (before(1) < huge(before)) self%differs = abs(self%end - before(1))
      if (self%differs < before(2) .and. before(2) < huge(before)) self%error = self%differs*(self%differs/before(2))
    end associate
  end subroutine take

  !> Tabulate the interval around a passage, if that is due.
  subroutine tabulate(self, which, before, passage, rest, slips)
    class(release_map_t), intent(inout) :: self
    integer, intent(in) :: which               !! branch
    type(passage_t), intent(in) :: before, passage
    real(wp), intent(in) :: rest, slips
    type(passage_table_t) :: table
    real(wp) :: expected, each, needed, allowed
    integer(int64) :: made
    logical :: found
    integer :: place, visits

    associate (branch => self%branch(which), n => points(self, self%branch(which)%has_root()))
      place = branch%place_of(passage%from)
      if (place == 0) return
      call branch%visit(place, passage%steps)
      if (branch%intervals(place)%is_tried) return
      visits = branch%intervals(place)%visits
      each = real(branch%intervals(place)%steps, wp)/real(visits, wp)
      expected = 0.0_wp
      if (visits >= first_passages) expected = slips*real(visits, wp)/real(max(1, self%learned%slips), wp)
      if (which == 1) expected = max(expected, laps_left(before, passage, branch%depth(place, passage%from), rest))
      if (expected < profit*real(n, wp) .and. (slips >= 0.0_wp .or. &
        visits < (n + size(test_at))/2**min(branch%intervals(place)%halvings, 1))) return
      allowed = min(max(expected/profit, real(visits, wp))*each, steps_left(self))
      needed = real(n, wp)*each
      if (needed > allowed) return
      branch%intervals(place)%is_tried = .true.
      call fill(self, which, place, table, found, made, each)
      if (found) then
        call branch%keep(place, table)
      else
        call branch%refine(place)
        self%learned%vain = self%learned%vain + made
      end if
    end associate
  end subroutine tabulate

  !> The table of an interval; `found`: it passes its test. No passage of it may take very many more steps than those so far.
  subroutine fill(self, which, place, table, found, made, each)
    class(release_map_t), intent(inout), target :: self
    integer, intent(in) :: which, place
    type(passage_table_t), intent(out) :: table
    logical, intent(out) :: found
    integer(int64), intent(out) :: made         !! steps
    real(wp), intent(in) :: each                !! steps of a passage before, in the mean
    !> How many more. Convention; twice: no change.
    real(wp), parameter :: very_many = 32.0_wp
    type(passage_t) :: passage
    type(observation_t) :: seen
    real(wp) :: error, inside
    integer :: i, k

    made = 0
    inside = 0.0_wp
    call new_passage_table(points(self, self%branch(which)%has_root()), table)
    do k = 1, table%points
      ! Slips far below the end of sticks may be none: they come first.
      i = merge(table%points + 1 - k, k, which == 1)
      call sample(table%point(i))
      if (.not. found) return
      if (self%keeps_motion .and. which == 1) then
        call table%take(i, passage, self%recording)
      else
        call table%take(i, passage)
      end if
      call table%seen%take(i, seen, k == 1)
    end do
    call table%settle()
    call table%seen%settle(self%rtol, self%steps%slider%law%static_limit/self%steps%slider%stiffness(1))
    do i = 1, size(test_at)
      call sample(test_at(i))
      if (.not. found) return
      call table%seen%test(test_at(i), seen)
      error = table%error_of(test_at(i), passage)
      found = error <= accurate*self%rtol
      if (.not. found) return
      inside = max(inside, table%error_inside(test_at(i), self%recording))
      self%learned%error = max(self%learned%error, error)
    end do
    if (inside <= accurate*self%rtol) then
      self%learned%error = max(self%learned%error, inside)
    else if (table%pieces_in_panel == 1 .and. .not. self%branch(which)%has_root()) then
      ! Not better in halves: the motion between the ends of steps is not so accurate.
      table%panels = 0
    else
      found = .false.
    end if

  contains

    subroutine sample(x)
      real(wp), intent(in) :: x
      type(error_t), allocatable :: failure

      self%learned%sampled = self%learned%sampled + 1
      call self%run(self%branch(which)%angle(place, x), self%longest, passage, found, failure, &
        as_count(very_many*each))
      made = made + self%recording%count
      call count_steps(self, self%recording%count)
      ! The motion itself need not come there.
      found = found .and. .not. allocated(failure) .and. (passage%is_plain .or. which == 2)
      if (.not. (found .and. self%keeps_motion)) return
      call observe(self%steps, self%recording, seen)
      ! The time at rest has to be that after the slip.
      table%seen%are_smooth = table%seen%are_smooth .and. passage%is_plain
    end subroutine sample
  end subroutine fill

  !> A slow cycle: passage after passage until one turns back, the `slip`. `whole` leads from its beginning to its end.
  subroutine come_back(self, alpha, whole, slip, found, error)
    class(release_map_t), intent(inout) :: self
    real(wp), intent(in) :: alpha
    type(passage_t), intent(out) :: whole, slip
    logical, intent(out) :: found
    type(error_t), allocatable, intent(out) :: error

    whole = beginning(alpha)
    do
      found = .not. self%is_spent()
      if (.not. found) return
      call self%next(whole%to, slip, found, error)
      if (allocated(error) .or. .not. found) return
      if (slip%table(1) > 0) call self%count(slip)
      call whole%go_on(slip)
      if (slip%turns_back()) exit
    end do
    ! A lap that hardly turns the force, near a fixed point that the motion comes to slowly, is as good as one there.
    if (slip%measure(turn) < -at_rest) call settle_at(self, slip)
    whole%to = slip%to
  end subroutine come_back

  !> From a lap that hardly turns the force to the one that does not, if Newton's method finds it ahead, with the slopes that laps
  !> have.
  subroutine settle_at(self, lap)
    class(release_map_t), intent(inout) :: self
    type(passage_t), intent(inout) :: lap
    ! A failure where the motion does not come to is none.
    type(error_t), allocatable :: error
    type(passage_t) :: one
    real(wp) :: to, last
    logical :: found
    integer :: iteration

    one = lap
    last = abs(lap%measure(turn))
    do iteration = 1, most_steps
      if (.not. (one%has_slope .and. one%slope > 0.0_wp .and. one%slope < 1.0_wp)) return
      to = one%from + one%measure(turn)/(1.0_wp - one%slope)
      if (.not. (to > 0.0_wp .and. to < lap%from)) return
      call self%next(to, one, found, error)
      if (allocated(error) .or. .not. found) return
      if (abs(one%measure(turn)) <= at_rest) lap = one
      if (abs(one%measure(turn)) <= at_rest .or. abs(one%measure(turn)) > 0.5_wp*last) return
      last = abs(one%measure(turn))
    end do
  end subroutine settle_at

  !> Whether slow cycles have cost so much, or a share of it, or somebody says, that no more are found.
  logical function is_spent(self, share)
    class(release_map_t), intent(in) :: self
    real(wp), intent(in), optional :: share     !! 1 if absent
    !> Passages and Newton iterations: some seconds. Conventions.
    real(wp), parameter :: most = 1.5e6_wp, most_work = 2.0e6_wp
    real(wp) :: limit

    limit = 1.0_wp
    if (present(share)) limit = share
    is_spent = max(real(self%learned%passages, wp)/most, real(self%steps%stepper%count%newton, wp)/most_work) > limit
    if (.not. is_spent .and. associated(self%watch)) is_spent = self%watch(self%learned%passages)
  end function is_spent

  !> The work done in passages that were run.
  pure function work(self)
    class(release_map_t), intent(in) :: self
    type(work_count_t) :: work

    work = self%steps%stepper%count
    work%events = 0
    work%cycles_sampled = self%learned%sampled
    work%map_error = self%learned%error
  end function work

  !> Save or load; tables are made again.
  subroutine serialise(self, archive)
    class(release_map_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive
    integer(int64) :: made
    logical :: found
    integer :: i, place

    do i = 1, size(self%branch)
      call self%branch(i)%serialise(archive)
      do place = 1, self%branch(i)%interval_count()
        if (archive%is_loading() .and. self%branch(i)%intervals(place)%is_known) &
          call fill(self, i, place, self%branch(i)%table(place), found, made, without_end)
      end do
    end do
    call archive%serialise(c_loc(self%learned), storage_size(self%learned))
    call archive%serialise(c_loc(self%steps%stepper%count), storage_size(self%steps%stepper%count))
  end subroutine serialise
end module dst_release_map
