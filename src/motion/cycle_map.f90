!> A motion under a steady drive, passage by passage and slow cycle by slow cycle.
!>
!> A passage that the release map has in a table is one piece of the motion. Where a slow cycle begins with the same release as some
!> slow cycles before, what follows is a repetition: one piece as well, however often they repeat. So is what follows a slow cycle
!> without a rest that ends as it began. Everything else is computed step by step. Nothing that reads the motion changes it.
!> docs/cycle_map.md.
module dst_cycle_map
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_divergence, only: divergence_t
  use dst_errors, only: error_t
  use dst_kinds, only: wp, int64
  use dst_motion, only: motion_t, serialise_motion, events_of_piece
  use dst_passage, only: passage_t, passage_of, measured, alpha_of, theta_of, duration, slip_duration, drive_work, friction_work, &
    damper_work
  use dst_piece, only: piece_t, no_event, stick_begins, slip_begins, slips, sticks
  use dst_recording, only: recording_t, most_pieces
  use dst_recurrence, only: recurrence_t
  use dst_release_map, only: release_map_t, new_release_map
  use dst_slip_stick, only: slip_stick_t
  use dst_slow_cycle, only: slow_cycle_t, most_repeats
  use dst_state, only: state_t, instant_t
  use dst_stepper, only: work_count_t
  use dst_stepping, only: stepping_t
  use dst_tangent, only: set_slope
  use dst_writer, only: event_t
  implicit none
  private

  public :: cycle_map_t, new_cycle_map

  !> A slow cycle is taken for the one that it approaches if the angle and the duration differ by no more than this share of rtol,
  !> and by no more than a tenth of what cycles of the summary may. The difference of the durations is known and taken into account:
  !> errors do not add up. Conventions.
  real(wp), parameter :: close = 0.03_wp, most_apart = 1.0e-6_wp
  !> Slow cycles whose releases differ by no more than this [rad] stretch differences by the same factor. Convention; a thousand
  !> times: -0.24 for -0.172 with V = 0.2 mm/s, whose slopes change much near the end of sticks.
  real(wp), parameter :: alike = 1.0e-10_wp
  !> Differences of this size are roundoff [rad]. Convention; twice: no change.
  real(wp), parameter :: roundoff = 100.0_wp*epsilon(1.0_wp)
  !> Of repetitions with so many events each is listed; and so many of their passages are described once and for all. Conventions;
  !> twice each: no change.
  integer, parameter :: most_listed = 100000, most_described = 1000

  !> Where the motion stands among its passages and slow cycles.
  type :: orbit_t
    !> The present map, 0 if there is none yet.
    integer :: current = 0
    !> After how many slow cycles the motion repeats, 0 if it does not yet.
    integer :: repeats = 0
    type(divergence_t) :: divergence
    !> The present slow cycle begins as so many slow cycles before, 0 if it does not: it stretches differences by as much.
    integer, private :: like = 0
    !> The number of slow cycles, and how the last ones ended [rad].
    integer(int64), private :: slow_cycles = 0
    real(wp), private :: last_returned(0:most_repeats) = 0.0_wp
    !> Whether the last piece ended where a passage begins, and its angle alpha [rad]; whether the passage by steps began there.
    logical, private :: begins_passage = .false., in_passage = .false.
    real(wp), private :: alpha = 0.0_wp
    !> The last piece, if it is one passage.
    type(passage_t), private :: passage
    !> Numbers of the next passage and of the last one among those that repeat.
    integer, private :: following = 1, number = 1
    !> Whether these are without a rest; what is known of such a motion.
    logical :: is_restless = .false.
    type(recurrence_t) :: recurrence
    type(work_count_t), private :: own
  end type orbit_t

  !> A motion by steps, passages and repetitions.
  type, extends(motion_t) :: cycle_map_t
    type(orbit_t) :: orbit
    class(stepping_t), allocatable :: steps
    !> The same at the beginning of the motion, if it can rest: from it maps run passages.
    class(slip_stick_t), allocatable, private :: unused
    real(wp) :: rtol = 0.0_wp
    !> Whether passages and slow cycles are leapt at all; if not, their growth is followed all the same.
    logical :: leaps = .true.
    !> Whether laps alone are leapt: where each slip may be that with which the run ends.
    logical, private :: only_laps = .false.
    !> Maps, one for each drive velocity so far.
    type(release_map_t), allocatable :: maps(:)
    !> The present passage by steps, and the motion without a rest since it was last looked at.
    type(recording_t), private :: recording, since_look
    !> The passage that is shown: when it begins, and the motion in it.
    type(recording_t) :: shown
    type(state_t) :: shown_from
    logical, private :: is_shown = .false.
    !> When it ends [s].
    real(wp), private :: shown_end = 0.0_wp
    !> The motion in passages of the slow cycles that repeat, as far as it has been described.
    type(recording_t), allocatable, private :: described(:)
    !> Its piece that `show` was asked for last, and its number, 0 if there is none.
    type(piece_t), private :: shown_piece
    integer, private :: shown_number = 0
    !> The last slow cycles, at places modulo their number, and the present one. Allocatable, as gfortran 12 frees wrong addresses
    !> of fixed arrays of such a type (tests/python/test_fortran_comments.py).
    type(slow_cycle_t), allocatable :: slow(:)
    !> What repeats, once: one slow cycle or several.
    type(slow_cycle_t) :: block
  contains
    procedure :: go_on
    procedure :: show
    procedure :: passages
    procedure :: passage_number
    procedure :: elongation
    procedure :: moved
    procedure :: show_passage
    procedure :: block_duration
    procedure :: lasted
    procedure :: slow_cycles_in
    procedure :: instant
    procedure :: events
    procedure :: next_instant
    procedure :: energy
    procedure :: work
    procedure :: is_undecided
    procedure :: velocity
    procedure :: serialise
  end type cycle_map_t

contains

  !> The motion `steps`, which has been started and is moved away, with its map at this tolerance.
  subroutine new_cycle_map(steps, rtol, leaps, only_laps, map)
    class(stepping_t), allocatable, intent(inout) :: steps
    real(wp), intent(in) :: rtol
    logical, intent(in) :: leaps, only_laps
    type(cycle_map_t), intent(out) :: map

    select type (steps)
    class is (slip_stick_t)
      allocate (map%unused, source=steps)
    end select
    call move_alloc(steps, map%steps)
    map%slider = map%steps%slider
    map%drive = map%steps%drive
    map%t_end = map%steps%t_end
    map%rtol = rtol
    map%leaps = leaps
    map%only_laps = only_laps
    map%piece = map%steps%piece
    map%contact = map%steps%contact
    allocate (map%maps(0), map%slow(0:most_repeats))
  end subroutine new_cycle_map

  !> A leap, or a piece of the motion by steps.
  subroutine go_on(self, horizon, error)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error

    self%is_shown = .false.
    ! Just after a knot the release belongs to another drive velocity.
    if (self%leaps .and. self%orbit%begins_passage .and. self%segment == self%steps%segment) then
      call leap(self, self%piece%from%until(horizon))
      if (self%leapt) return
    end if
    self%steps%t_end = self%t_end
    self%steps%next_look = merge(self%orbit%recurrence%next_look(), huge(1.0_wp), self%steps%contact == slips)
    call self%steps%advance(error)
    self%piece%to = self%steps%piece%to
    self%piece%contact = self%steps%piece%contact
    self%piece%event = self%steps%piece%event
    self%piece%drive = self%steps%piece%drive
    call self%piece%path%take(self%steps%piece%path)
    self%contact = self%steps%contact
    self%segment = self%steps%segment
    call note_piece(self)
    if (self%leaps .and. .not. (self%only_laps .or. self%steps%fixed_step > 0.0_wp)) call look_for_recurrence(self)
  end subroutine go_on

  !> A piece by steps has been made: record it, if it belongs to a passage, which may end with it.
  subroutine note_piece(self)
    class(cycle_map_t), intent(inout) :: self
    type(passage_t) :: passage

    associate (piece => self%steps%piece, velocity => self%steps%piece%drive%velocity)
      if (self%orbit%in_passage) call self%recording%append(piece)
      self%orbit%begins_passage = .false.
      if (.not. piece%is_steady() .or. self%recording%count >= most_pieces) then
        call forget(self)
        return
      end if
      self%orbit%begins_passage = piece%event == slip_begins .and. piece%contact == sticks
      if (.not. self%orbit%begins_passage) return
      if (self%orbit%in_passage) then
        passage = passage_of(self%orbit%alpha, self%recording, self%slider, velocity)
        if (self%orbit%like == 0 .and. self%slider%direction_free) &
          call set_slope(self%recording, self%steps%system, self%slider, passage)
        call arrive(self, passage)
      else
        call take_map(self, velocity)
      end if
      self%orbit%alpha = alpha_of(piece%to%y(2), self%slider, velocity)
      self%orbit%in_passage = .true.
      call self%recording%clear()
    end associate
  end subroutine note_piece

  !> A piece by steps has been made: whether the motion is without a rest, and repeats.
  subroutine look_for_recurrence(self)
    class(cycle_map_t), intent(inout) :: self
    real(wp) :: shorter
    logical :: repeats

    associate (piece => self%steps%piece, recurrence => self%orbit%recurrence)
      if (piece%contact /= slips .or. piece%event /= no_event .or. .not. piece%is_steady() &
        .or. self%since_look%count >= most_pieces) then
        recurrence = recurrence_t()
        if (self%orbit%is_restless) call forget(self)
        return
      end if
      if (recurrence%is_watched) call self%since_look%append(piece)
      call recurrence%see(piece, self%slider)
      if (piece%to%time >= recurrence%next_look()) then
        call recurrence%look(piece, self%slider, largest_difference(self), repeats, shorter)
        if (repeats) call repeat_since_look(self, shorter)
      end if
      if (.not. abs(recurrence%last%time - piece%to%time) > 0.0_wp) call self%since_look%clear()
    end associate
  end subroutine look_for_recurrence

  !> What follows repeats the motion since the last look, which is longer than a slow cycle by so little [s].
  subroutine repeat_since_look(self, shorter)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: shorter

    call forget(self)
    call self%block%clear(.true.)
    call self%block%append(measured(self%since_look), self%since_look)
    if (.not. self%block%sum%is_complete) return
    call self%block%lengthen(-shorter)
    self%orbit%repeats = 1
    self%orbit%following = 1
    self%orbit%is_restless = .true.
    self%orbit%begins_passage = .true.
  end subroutine repeat_since_look

  !> By how much slow cycles may differ that are taken for the same, as a share of their size.
  pure real(wp) function largest_difference(self)
    class(cycle_map_t), intent(in) :: self

    largest_difference = min(close*self%rtol, most_apart)
  end function largest_difference

  !> What follows is not related to the passages so far.
  pure subroutine forget(self)
    class(cycle_map_t), intent(inout) :: self

    self%orbit%in_passage = .false.
    call self%recording%clear()
    self%orbit%repeats = 0
    if (allocated(self%described)) deallocate (self%described)
    self%orbit%is_restless = .false.
    self%orbit%slow_cycles = 0
    self%orbit%like = 0
    if (self%orbit%divergence%count > 0) self%orbit%divergence = divergence_t()
  end subroutine forget

  !> The map of a drive velocity [m/s]; the first slow cycle begins.
  subroutine take_map(self, velocity)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: velocity
    integer :: i

    call self%slow(0)%clear(self%leaps)
    if (.not. self%leaps) return
    self%orbit%current = 0
    do i = 1, size(self%maps)
      if (.not. abs(self%maps(i)%velocity - velocity) > 0.0_wp) self%orbit%current = i
    end do
    if (self%orbit%current > 0) return
    call add_map(self, velocity)
    self%orbit%current = size(self%maps)
  end subroutine take_map

  !> A map of a drive velocity [m/s] that has none yet.
  subroutine add_map(self, velocity)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: velocity
    type(release_map_t) :: map

    call new_release_map(self%unused, velocity, self%rtol, .true., map)
    self%maps = [self%maps, map]
  end subroutine add_map

  !> A passage is complete, by steps or by a table.
  subroutine arrive(self, passage)
    class(cycle_map_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    type(error_t), allocatable :: error

    associate (now => self%slow(place_of(self%orbit%slow_cycles)))
      call now%append(passage, self%recording)
      ! A failure in a passage to which the motion does not come is none of the motion.
      if (passage%table(1) > 0) then
        call self%maps(self%orbit%current)%count(passage)
      else if (self%leaps) then
        call self%maps(self%orbit%current)%learn(passage, time_left(self), slow_cycles_left(self), self%only_laps, error)
      end if
      if (.not. passage%turns_back()) return
      if (self%orbit%like > 0) then
        call self%orbit%divergence%come_back_like(self%orbit%like)
        associate (before => self%slow(place_of(self%orbit%slow_cycles - self%orbit%like))%sum%whole)
          now%sum%whole%loss = before%loss
          now%sum%whole%slope = before%slope
          now%sum%whole%shift = before%shift
          now%sum%whole%has_slope = before%has_slope
        end associate
      else
        call self%orbit%divergence%come_back(now%sum%whole%log_slope, now%sum%whole%has_slope)
      end if
      call self%orbit%divergence%lose(now%sum%whole, 1_int64)
    end associate
    self%orbit%slow_cycles = self%orbit%slow_cycles + 1
    associate (n => self%orbit%slow_cycles)
      self%orbit%last_returned(modulo(n, size(self%orbit%last_returned, kind=int64))) = passage%to
      call look_back(self)
      if (self%leaps .and. .not. self%only_laps) call look_for_repetition(self)
      call self%slow(place_of(n))%clear(self%leaps)
    end associate
  end subroutine arrive

  pure integer function place_of(number)
    integer(int64), intent(in) :: number

    place_of = int(modulo(number, int(most_repeats + 1, int64)))
  end function place_of

  !> Whether the slow cycle that begins is like one before.
  pure subroutine look_back(self)
    class(cycle_map_t), intent(inout) :: self
    integer :: m

    self%orbit%like = 0
    do m = int(min(self%orbit%slow_cycles - 1, int(most_repeats, int64))), 1, -1
      if (abs(returned(self, 0) - returned(self, m)) <= alike) self%orbit%like = m
    end do
  end subroutine look_back

  !> Whether what follows repeats the last slow cycles.
  subroutine look_for_repetition(self)
    class(cycle_map_t), intent(inout) :: self
    real(wp) :: longer
    logical :: found
    integer :: m, i

    do m = 1, int(min(self%orbit%slow_cycles - 1, int(most_repeats, int64)))
      call look_for_cycle(self, m, longer, found)
      if (.not. found) cycle
      call self%block%clear(.true.)
      do i = m, 1, -1
        call self%block%join(self%slow(place_of(self%orbit%slow_cycles - i)))
      end do
      if (.not. self%block%sum%is_complete) return
      call self%block%lengthen(longer)
      self%orbit%repeats = m
      self%orbit%following = 1
      return
    end do
  end subroutine look_for_repetition

  !> Whether the last so many slow cycles end with the release with which they began, but for roundoff; or so near that, as their
  !> slope tells, the next ones approach a cycle that takes so little `longer` [s].
  pure subroutine look_for_cycle(self, slow_cycles, longer, found)
    class(cycle_map_t), intent(in) :: self
    integer, intent(in) :: slow_cycles
    real(wp), intent(out) :: longer
    logical, intent(out) :: found
    type(passage_t) :: last
    real(wp) :: distance, allowed, advance

    longer = 0.0_wp
    distance = returned(self, 0) - returned(self, slow_cycles)
    allowed = largest_difference(self)
    found = abs(distance) <= roundoff
    if (found .or. abs(distance) > allowed) return
    last = last_ones(self, slow_cycles)
    if (.not. (last%has_slope .and. abs(last%slope) < 1.0_wp)) return
    ! If the slope is negative, every second slow cycle is nearer, but two are no cycle of their own.
    distance = distance/(1.0_wp - last%slope)
    longer = last%shift*distance
    ! The angle counts as much as an advance of the drive that turns the force so far.
    advance = self%slider%law%static_limit/self%slider%stiffness(1)/abs(self%maps(self%orbit%current)%velocity)
    found = abs(distance)*max(advance, last%loss%shift) <= allowed*last%measure(duration)/real(slow_cycles, wp)
  end subroutine look_for_cycle

  !> The last so many slow cycles together.
  pure type(passage_t) function last_ones(self, slow_cycles) result(all)
    class(cycle_map_t), intent(in) :: self
    integer, intent(in) :: slow_cycles
    integer :: ago

    all = self%slow(place_of(self%orbit%slow_cycles - slow_cycles))%sum%whole
    do ago = slow_cycles - 1, 1, -1
      call all%go_on(self%slow(place_of(self%orbit%slow_cycles - ago))%sum%whole)
    end do
  end function last_ones

  !> How long the last so many slow cycles took [s]; of more than are kept, those are taken for all.
  pure real(wp) function lasted(self, slow_cycles)
    class(cycle_map_t), intent(in) :: self
    integer, intent(in) :: slow_cycles
    type(passage_t) :: last

    associate (kept => min(slow_cycles, most_repeats))
      last = last_ones(self, kept)
      lasted = last%measure(duration)*(real(slow_cycles, wp)/real(kept, wp))
    end associate
  end function lasted

  !> The number of the last slow cycles that took this time [s] together, to a thousandth; 0 if none did. One more or less takes
  !> some tenth more or less, as at most eight are compared.
  pure integer function slow_cycles_in(self, time) result(number)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: time

    do number = int(min(int(most_repeats, int64), self%orbit%slow_cycles)), 1, -1
      if (abs(self%lasted(number) - time) <= 1.0e-3_wp*time) return
    end do
    number = 0
  end function slow_cycles_in

  !> Time until V changes, or the motion ends [s].
  pure real(wp) function time_left(self)
    class(cycle_map_t), intent(in) :: self

    time_left = self%piece%to%until(min(self%t_end, self%piece%drive%end))
  end function time_left

  !> Slow cycles in this time, or until one or two of them repeat, if differences shrink further as in the last ones.
  pure real(wp) function slow_cycles_left(self) result(left)
    class(cycle_map_t), intent(in) :: self
    real(wp) :: distance
    type(passage_t) :: last
    integer :: m

    left = 0.0_wp
    if (self%orbit%slow_cycles == 0) return
    left = time_left(self)/self%lasted(1)
    do m = 1, int(min(self%orbit%slow_cycles - 1, 2_int64))
      last = last_ones(self, m)
      distance = abs(returned(self, 0) - returned(self, m))
      if (last%has_slope .and. abs(last%slope) < 1.0_wp .and. min(abs(last%slope), distance) > 0.0_wp) &
        left = min(left, real(m, wp)*max(0.0_wp, log(close*self%rtol/distance)/log(abs(last%slope))))
    end do
  end function slow_cycles_left

  !> The release with which a slow cycle ended [rad].
  pure real(wp) function returned(self, ago)
    class(cycle_map_t), intent(in) :: self
    integer, intent(in) :: ago

    returned = self%orbit%last_returned(modulo(self%orbit%slow_cycles - ago, size(self%orbit%last_returned, kind=int64)))
  end function returned

  !> A leap from the present release, if there is one that takes no longer than `longest` [s].
  subroutine leap(self, longest)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: longest
    type(passage_t) :: passage
    integer(int64) :: times
    logical :: found

    if (self%orbit%repeats > 0) then
      times = 0
      associate (lasting => self%block_duration())
        if (self%orbit%following == 1) times = int(min(longest/lasting, 1.0e15_wp), int64)
        if (real(times, wp)*lasting > longest) times = times - 1
      end associate
      if (times > 0) then
        call repeat_block(self, times)
        return
      end if
      passage = self%block%part(self%orbit%following)%passage
      if (passage%measure(duration) > longest) return
      self%orbit%number = self%orbit%following
      self%orbit%following = 1 + modulo(self%orbit%following, self%block%sum%count)
      if (passage%table(1) == 0) self%orbit%own%excursions_reused = self%orbit%own%excursions_reused + 1
      call take_passage(self, passage)
      return
    end if
    call self%maps(self%orbit%current)%look_up(self%orbit%alpha, passage, found)
    if (.not. found .or. passage%measure(duration) > longest .or. (self%only_laps .and. passage%table(1) /= 1)) return
    call take_passage(self, passage)
    call arrive(self, passage)
  end subroutine leap

  !> Make a passage the last piece.
  subroutine take_passage(self, passage)
    class(cycle_map_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage

    self%orbit%passage = passage
    self%repetitions = 0
    self%orbit%own%cycles_leapt = self%orbit%own%cycles_leapt + 1
    self%orbit%own%events = self%orbit%own%events + 2
    call make_piece(self, passage, 1.0_wp)
  end subroutine take_passage

  !> Make repetitions of the last slow cycles the last piece.
  subroutine repeat_block(self, times)
    class(cycle_map_t), intent(inout) :: self
    integer(int64), intent(in) :: times
    type(passage_t) :: whole

    associate (own => self%orbit%own, sum => self%block%sum)
      self%repetitions = times
      own%cycles_leapt = own%cycles_leapt + times*sum%count
      own%excursions_reused = own%excursions_reused + times*sum%recordings
      if (.not. self%orbit%is_restless) own%events = own%events + 2*times*sum%count
      call self%orbit%divergence%lose(sum%whole, times)
      whole = sum%whole
    end associate
    whole%to = self%orbit%alpha
    call make_piece(self, whole, real(times, wp))
  end subroutine repeat_block

  !> The last piece is this passage, or several of the same kind.
  subroutine make_piece(self, passage, times)
    class(cycle_map_t), intent(inout) :: self
    type(passage_t), intent(in) :: passage
    real(wp), intent(in) :: times
    type(state_t) :: to

    associate (from => self%piece%from, value => passage%measure)
      to = from
      call to%later(from, times*value(duration))
      to%drive_work = from%drive_work + times*value(drive_work)
      to%friction_work = from%friction_work + times*value(friction_work)
      to%damper_work = from%damper_work + times*value(damper_work)
      self%steps%piece%to = to
      if (.not. self%orbit%is_restless) then
        select type (steps => self%steps)
        class is (slip_stick_t)
          call steps%place_at_release(theta_of(passage%to, self%slider, self%piece%drive%velocity), to)
        end select
      end if
      associate (there => self%steps%piece%to)
        there%position = self%moved(from%position, self%piece%drive%velocity*times*value(duration), there%u - from%u)
        self%piece%to = there
        self%orbit%recurrence%last = there
      end associate
    end associate
    self%orbit%alpha = passage%to
    self%leapt = .true.
    self%piece%event = merge(no_event, slip_begins, self%orbit%is_restless)
    self%piece%contact = slips
    self%contact = slips
    call self%recording%clear()
  end subroutine make_piece

  !> Duration of the slow cycles that repeat [s].
  pure real(wp) function block_duration(self)
    class(cycle_map_t), intent(in) :: self

    block_duration = self%block%sum%whole%measure(duration)
  end function block_duration

  !> Number of passages in a leap, or in one of its repetitions.
  pure integer function passages(self)
    class(cycle_map_t), intent(in) :: self

    passages = merge(self%block%sum%count, 1, self%repetitions > 0)
  end function passages

  !> Passage number `k` of a leap, and when it begins [s] after the leap, or after its repetition.
  pure subroutine passage_number(self, k, passage, begin)
    class(cycle_map_t), intent(in) :: self
    integer, intent(in) :: k
    type(passage_t), intent(out) :: passage
    real(wp), intent(out) :: begin

    passage = self%orbit%passage
    begin = 0.0_wp
    if (self%repetitions == 0) return
    passage = self%block%part(k)%passage
    begin = self%block%part(k)%begin
  end subroutine passage_number

  !> Show passage number `k` of a repetition of the leap (0: the first one).
  subroutine show_passage(self, repetition, k)
    class(cycle_map_t), intent(inout) :: self
    integer(int64), intent(in) :: repetition
    integer, intent(in) :: k
    type(passage_t) :: passage
    type(state_t) :: end
    real(wp) :: begin
    logical :: found

    call self%passage_number(k, passage, begin)
    associate (from => self%piece%from)
      if (repetition > 0) begin = begin + real(repetition, wp)*self%block_duration()
      self%shown_from = from
      call self%shown_from%later(from, begin)
      self%shown_from%u = self%elongation(passage%from)
      self%shown_from%position = self%moved(from%position, self%piece%drive%velocity*begin, self%shown_from%u - from%u)
    end associate
    self%is_shown = .true.
    self%shown_number = 0
    if (passage%table(1) == 0) then
      call self%shown%copy(self%block%recording(self%block%part(merge(k, self%orbit%number, self%repetitions > 0))%recorded))
    else if (self%repetitions == 0 .or. k > most_described) then
      call self%maps(self%orbit%current)%describe(passage, self%shown, found)
    else
      if (.not. allocated(self%described)) allocate (self%described(min(self%passages(), most_described)))
      if (self%described(k)%count == 0) call self%maps(self%orbit%current)%describe(passage, self%described(k), found)
      call self%shown%copy(self%described(k))
    end if
    call end%later(self%shown_from, self%shown%duration())
    self%shown_end = end%time
  end subroutine show_passage

  !> The elongation of the springs [m] where a passage of the last piece, a leap, begins or ends: with this angle alpha [rad], or as
  !> the cycle without a rest began.
  pure function elongation(self, alpha) result(u)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: alpha
    real(wp) :: u(2)

    if (self%orbit%is_restless) then
      u = self%block%recording(1)%kept(1)%from%u
    else
      u = self%maps(self%orbit%current)%elongation(alpha)
    end if
  end function elongation

  !> X [m] from a position on, after a way of the drive [m] in which the springs have been stretched by so much [m]. Slip along a
  !> line may turn back in another direction: what repeats then has been seen to advance by so much.
  pure real(wp) function moved(self, position, way, stretched)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: position, way, stretched(2)

    associate (system => self%steps%system)
      if (system%components == size(stretched)) then
        moved = position + way - dot_product(stretched, self%slider%along)
      else if (self%steps%may_rest) then
        associate (inside => self%block%recording(1))
          moved = position + way/(self%piece%drive%velocity*self%block_duration())*inside%kept(inside%count)%to%position
        end associate
      else
        moved = position + way*system%advance_by_drive &
          + dot_product(system%advance_by_slip, way*system%drive_coupling - stretched)
      end if
    end associate
  end function moved

  !> Show the passage that contains a time [s] of the last piece: `instant` reads the motion there.
  subroutine show(self, time)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: time
    real(wp) :: elapsed
    integer :: number

    if (.not. self%leapt .or. time >= self%piece%to%time) return
    if (.not. self%is_shown .or. time >= self%shown_end .or. self%shown_from%until(time) < 0.0_wp) call show_passage_at(self, time)
    elapsed = self%shown_from%until(time)
    if (self%shown_number > 0) then
      associate (now => self%shown%kept(self%shown_number))
        if (elapsed >= now%from%time .and. elapsed < now%to%time) return
      end associate
    end if
    number = self%shown%place_of(elapsed)
    if (number == self%shown_number) return
    self%shown_number = number
    call self%shown%get(number, self%shown_from, self%shown_piece)
  end subroutine show

  !> Show the passage of the last piece, a leap, that contains a time [s].
  subroutine show_passage_at(self, time)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: time
    integer(int64) :: repetition
    real(wp) :: elapsed
    integer :: k

    repetition = 0
    k = 1
    if (self%repetitions > 0) then
      elapsed = max(0.0_wp, self%piece%from%until(time))
      repetition = min(int(elapsed/self%block_duration(), int64), self%repetitions - 1)
      k = self%block%place_of(elapsed - real(repetition, wp)*self%block_duration())
    end if
    call self%show_passage(repetition, k)
    if (time < self%shown_end) return
    ! Within roundoff of its end the next one begins.
    k = k + 1
    if (k > self%passages()) then
      k = 1
      repetition = repetition + 1
    end if
    if (repetition < self%repetitions) call self%show_passage(repetition, k)
  end subroutine show_passage_at

  !> The motion at a time [s] of the last piece that is shown.
  pure function instant(self, time)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(instant_t) :: instant

    if (.not. self%leapt .or. time >= self%piece%to%time) then
      instant = self%steps%instant(time)
    else
      instant = self%steps%instant_of(self%shown_piece%at(time), self%shown_piece%contact)
    end if
  end function instant

  !> Events of the last piece. Repetitions with very many are a block that occurs again and again.
  pure subroutine events(self, log)
    class(cycle_map_t), intent(in) :: self
    type(event_t), allocatable, intent(out) :: log(:)
    type(passage_t) :: passage
    type(state_t) :: from, at(2)
    real(wp) :: begin, skipped, period
    integer(int64) :: repetition, occurs, i
    integer :: k

    if (.not. self%leapt) then
      call events_of_piece(self, log)
      return
    end if
    if (self%orbit%is_restless) then
      allocate (log(0))
      return
    end if
    associate (times => max(1_int64, self%repetitions), events => 2_int64*self%passages())
      period = merge(self%block_duration(), 0.0_wp, self%repetitions > 0)
      occurs = merge(times, 1_int64, times*events > most_listed)
      allocate (log(events*times/occurs))
      do repetition = 0, times/occurs - 1
        skipped = real(repetition, wp)*period
        do k = 1, self%passages()
          call self%passage_number(k, passage, begin)
          call from%later(self%piece%from, begin + skipped)
          call at%later(from, passage%measure([slip_duration, duration]))
          i = repetition*events + 2*k
          log(i - 1:i) = [event_t(at(1)%time, stick_begins, occurs, period), event_t(at(2)%time, slip_begins, occurs, period)]
        end do
      end do
      if (occurs == 1) log(size(log))%time = self%piece%to%time
    end associate
  end subroutine events

  pure real(wp) function next_instant(self, time)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(state_t) :: at
    integer :: i

    next_instant = max(time, self%piece%to%time)
    if (.not. self%leapt .or. time >= self%piece%to%time) return
    do i = self%shown%place_of(self%shown_from%until(time)), self%shown%count
      associate (end => self%shown%kept(i)%to)
        call at%later(self%shown_from, end%time + end%time_rest)
      end associate
      next_instant = min(self%piece%to%time, at%time)
      if (next_instant > time) return
    end do
    next_instant = self%piece%to%time
  end function next_instant

  pure real(wp) function energy(self, velocity)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: velocity(2)

    energy = self%steps%energy(velocity)
  end function energy

  pure function work(self)
    class(cycle_map_t), intent(in) :: self
    type(work_count_t) :: work, one
    integer :: i

    work = self%steps%work()
    work = work%plus(self%orbit%own)
    do i = 1, size(self%maps)
      one = self%maps(i)%work()
      work = work%plus(one)
    end do
  end function work

  pure logical function is_undecided(self)
    class(cycle_map_t), intent(in) :: self

    is_undecided = self%steps%is_undecided()
  end function is_undecided

  pure function velocity(self, state)
    class(cycle_map_t), intent(in) :: self
    type(state_t), intent(in) :: state
    real(wp) :: velocity(2)

    velocity = self%steps%velocity(state)
  end function velocity

  subroutine serialise(self, archive)
    class(cycle_map_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive
    real(wp), target :: velocity
    integer, target :: n
    integer :: i

    call serialise_motion(self, archive)
    call self%steps%serialise(archive)
    call archive%serialise(c_loc(self%orbit), storage_size(self%orbit))
    n = size(self%maps)
    call archive%serialise(c_loc(n), storage_size(n))
    do i = 1, n
      if (.not. archive%is_loading()) velocity = self%maps(i)%velocity
      call archive%serialise(c_loc(velocity), storage_size(velocity))
      if (archive%is_loading()) call add_map(self, velocity)
      call self%maps(i)%serialise(archive)
    end do
    do i = 0, most_repeats
      call self%slow(i)%serialise(archive)
    end do
    call self%block%serialise(archive)
    call self%recording%serialise(archive)
    call self%since_look%serialise(archive)
  end subroutine serialise
end module dst_cycle_map
