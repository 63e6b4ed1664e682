!> The exact contact, with leaps over fast cycles: a map follows slip and stick that repeat from release to release.
!>
!> At a release under a steady drive the whole state is one angle (dst_cycle_table). If it is cheaper, single cycles are run from
!> Chebyshev points of an interval of angles, and all cycles in it follow by polynomials. The motion between two such intervals - an
!> excursion: the last cycles before sticks end, the slip, and the cycles after it - is computed step by step. It is a function of
!> the angle as well: a stretch that begins where an earlier one began is the same. docs/cycle_map.md.
module dst_cycle_map
  use dst_archive, only: archive_t
  use dst_cycle_survey, only: cycle_survey_t
  use dst_cycle_table, only: duration, drive_work, measures
  use dst_divergence, only: divergence_t
  use dst_errors, only: error_t
  use dst_fast_cycle, only: release_angle_t, release_at, fast_cycle_t
  use dst_kinds, only: wp, int64, pi
  use dst_leap, only: leap_t
  use dst_motion, only: motion_t, serialise_motion
  use dst_piece, only: piece_t, no_event, slip_begins, slips, touches, sticks
  use dst_recording, only: recording_t
  use dst_slip_stick, only: slip_stick_t
  use dst_state, only: state_t, instant_t
  use dst_stepper, only: work_count_t
  implicit none
  private

  public :: cycle_map_t, new_cycle_map, max_leaps

  !> Two releases are the same if their angles differ by no more than this [rad]: some roundoffs. If an excursion is known to lose
  !> the memory of its beginning, they may differ by this many times rtol, if no more than this share of rtol is left of the
  !> difference at its end. Conventions; twice: no change on Fig. 3.
  real(wp), parameter :: same_angle = 1000.0_wp*epsilon(1.0_wp), near = 0.3_wp, left_over = 0.003_wp
  !> Releases with which slow cycles begin are the same up to this share of rtol: nothing corrects the time, which may hang on the
  !> angle a thousandfold. Convention.
  real(wp), parameter :: near_whole = 1.0e-4_wp
  !> If the turn of a cycle is this many times larger than that of the cycle before, the cycle is an excursion. Convention; twice:
  !> no change on Fig. 3, 7 % more iterations with k_y = 1e6 N/m.
  real(wp), parameter :: far_back = 5.0_wp
  !> The excursions from which the growth of a small difference is measured begin this share of a turn apart. Ten times: the
  !> exponent of Fig. 3 is higher by 0.02, as excursions depend on their beginning like a square root near a touch. A difference of
  !> them below this share of rtol, the error of Newton's method, is not resolved. Conventions.
  real(wp), parameter :: push = 1.0e-4_wp, unseen = 1.0e-6_wp
  !> They begin no nearer than this share of rtol, and have to end within this many times the duration of the one that is measured.
  !> Conventions.
  real(wp), parameter :: least_push = 0.1_wp, long = 2.0_wp
  !> An excursion that is reused lies in time by the drift of fast cycles: each lasts no longer than this many periods of the
  !> stiffer spring, and turns by at least this many times rtol, as the one before within this factor. What is larger or smaller
  !> is a slow cycle, or noise. Conventions; twice: no change on Fig. 3.
  real(wp), parameter :: longest_fast = 10.0_wp, least_turn = 10.0_wp, alike = 2.0_wp
  !> Permitted error of the energy balance of a leap, in rtol of the energy exchanged. Convention: of 7000 random scenes the
  !> balance of steps is open by 190 at most.
  real(wp), parameter :: unbalanced = 1000.0_wp
  !> An excursion in which the force turned back more often comes to no table: whole slow cycles are recorded. Convention.
  integer, parameter :: most_returns = 3
  !> Largest numbers of leaps that are kept, of excursions that can be reused, and of pieces of one.
  integer, parameter :: max_leaps = 32, max_kept = 4, max_pieces = 8000

  !> A motion by steps and leaps.
  type, extends(motion_t) :: cycle_map_t
    class(slip_stick_t), allocatable :: steps
    type(cycle_survey_t) :: survey
    !> Leaps that are kept; their number so far, and the place of the last piece among them.
    type(leap_t), allocatable :: leaps(:)
    integer(int64) :: leap_count = 0
    integer :: current = 0
    !> The time by which the last piece is ahead of the leap that is kept [s].
    real(wp) :: lead = 0.0_wp
    !> Growth of small differences from slow cycle to slow cycle.
    type(divergence_t) :: divergence
    !> Work in addition to that of the steps, and of the survey.
    type(work_count_t), private :: own
    !> Whether the last piece ended with a release; and the release before, if only one cycle is between them, with its time [s].
    logical, private :: released = .false.
    logical, private :: has_before = .false.
    type(release_angle_t), private :: before
    real(wp), private :: before_time = 0.0_wp
    !> Whether the last piece was a leap through a table; whether an excursion is in progress, whether its pieces are kept, where it
    !> began, and when the one before ended [s].
    logical, private :: follows_leg = .false.
    logical, private :: recording = .false., keeping = .false.
    type(recording_t), private :: excursion
    type(release_angle_t), private :: excursion_from
    integer, private :: excursion_releases = 0, excursion_returns = 0
    real(wp), private :: excursion_at = 0.0_wp     !! s
    real(wp), private :: last_return = -1.0_wp
    !> Turn of a cycle that is not an excursion; how many in a row turned back; and whether the present excursion began after one
    !> that did: if it ends so, too, it is a whole slow cycle.
    real(wp), private :: usual_turn = 0.0_wp
    integer, private :: turned_back = 0
    logical, private :: is_whole = .false.
  contains
    procedure :: go_on
    procedure :: elongation_at
    procedure :: instant
    procedure :: state_in_leap
    procedure :: next_in_leap
    procedure :: lead_after
    procedure :: energy
    procedure :: work
    procedure :: is_undecided
    procedure :: velocity
    procedure :: events
    procedure :: next_instant
    procedure :: serialise
  end type cycle_map_t

contains

  !> The motion `steps`, which has been started and is moved away, with leaps over its cycles at this tolerance.
  subroutine new_cycle_map(steps, rtol, map)
    class(slip_stick_t), allocatable, intent(inout) :: steps
    real(wp), intent(in) :: rtol
    type(cycle_map_t), intent(out) :: map

    call move_alloc(steps, map%steps)
    map%slider = map%steps%slider
    map%drive = map%steps%drive
    map%t_end = map%steps%t_end
    map%survey%rtol = rtol
    map%piece = map%steps%piece
    map%contact = map%steps%contact
  end subroutine new_cycle_map

  !> Leaps that are kept.
  pure integer function remembered(self)
    class(cycle_map_t), intent(in) :: self

    remembered = int(min(self%leap_count, int(max_leaps, int64)))
  end function remembered

  !> A leap, or a piece of the motion by steps.
  subroutine go_on(self, horizon, error)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error
    integer :: place

    ! Just after a knot the release belongs to another drive velocity.
    if (self%released .and. self%segment == self%steps%segment) then
      call choose_leap(self, horizon, place)
      if (place > 0) then
        call make_leap(self, place)
        return
      end if
    end if
    self%follows_leg = .false.
    if (.not. self%recording) call self%divergence%lose()
    call self%steps%advance(error)
    self%piece%to = self%steps%piece%to
    self%piece%contact = self%steps%piece%contact
    self%piece%event = self%steps%piece%event
    self%piece%drive = self%steps%piece%drive
    call self%piece%path%take(self%steps%piece%path)
    self%contact = self%steps%contact
    self%segment = self%steps%segment
    call note_piece(self)
  end subroutine go_on

  !> Whether the last piece by steps ended with a release under a steady drive; and the cycle before it.
  subroutine note_piece(self)
    class(cycle_map_t), intent(inout) :: self
    type(release_angle_t) :: here

    associate (piece => self%steps%piece)
      if (self%recording) then
        if (self%keeping) call self%excursion%append(piece)
        if (self%excursion%count >= max_pieces) self%recording = .false.
      end if
      self%released = piece%event == slip_begins .and. piece%contact == sticks .and. .not. abs(piece%drive%acceleration) > 0.0_wp &
        .and. abs(piece%drive%velocity) > 0.0_wp
      if (piece%contact == touches .or. piece%to%time >= piece%drive%end) then
        ! An excursion may have touches, which no cycle has.
        self%recording = self%recording .and. piece%to%time < piece%drive%end
        call forget(self)
      end if
      if (.not. self%released) return
      here = release_at(piece%to%y(2))
      self%excursion_releases = self%excursion_releases + 1
      call note_return(self, here%angle - self%before%angle)
      if (self%has_before) then
        self%survey%before = self%survey%last
        self%survey%last = fast_cycle_t(.true., self%before, piece%to%time - self%before_time, here%angle - self%before%angle, &
          (piece%to%time - piece%from%time)/max(tiny(1.0_wp), piece%to%time - self%before_time))
      end if
      self%has_before = .true.
      self%before = here
      self%before_time = piece%to%time
    end associate
  end subroutine note_piece

  !> A large turn back is an excursion, after which the cycles begin again: the time that this takes. With any turn back a slow
  !> cycle is complete.
  pure subroutine note_return(self, turn)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: turn

    if (turn*self%usual_turn < 0.0_wp .and. abs(turn) > far_back*abs(self%usual_turn)) then
      if (self%last_return >= 0.0_wp) self%survey%slow_period = self%piece%to%time - self%last_return
      self%last_return = self%piece%to%time
    else
      self%usual_turn = turn
    end if
    ! Cycles turn the force towards the soft axis.
    if (turn*sign(1.0_wp, self%slider%along(1)*self%piece%drive%velocity) >= -self%survey%rtol) then
      self%turned_back = self%turned_back + 1
      self%excursion_returns = self%excursion_returns + 1
    else
      self%turned_back = 0
    end if
  end subroutine note_return

  !> Data about the cycles are not valid any more.
  pure subroutine forget(self)
    class(cycle_map_t), intent(inout) :: self

    self%has_before = .false.
    self%survey%last%known = .false.
    self%survey%before%known = .false.
  end subroutine forget

  !> The leap from the present release: its place among those that are kept, 0 if there is none.
  subroutine choose_leap(self, horizon, place)
    class(cycle_map_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    integer, intent(out) :: place
    type(release_angle_t) :: here
    real(wp) :: longest
    logical :: is_complete
    integer :: table

    place = 0
    associate (now => self%piece%to)
      here = release_at(now%y(2))
      longest = now%until(horizon)
      if (now%time < self%milestone) longest = min(longest, now%until(self%milestone))
      table = self%survey%table_of(self%piece%drive%velocity, here)
      is_complete = self%recording .and. self%is_whole .and. self%turned_back > 0
      if (is_complete) call end_excursion(self)
      place = known_leap(self, here, longest)
      ! A slow cycle with one stick is recorded first: it may repeat.
      if (table == 0 .and. place == 0 .and. (is_complete .or. self%turned_back == 0)) &
        call self%survey%make_table(self%steps, self%piece%drive%velocity, here, longest, now%until(self%t_end), table)
      if (max(table, place) > 0 .and. self%recording) then
        call end_excursion(self)
        ! The leap may have been dropped, or its place reused.
        if (place > 0) place = known_leap(self, here, longest)
      end if
      if (place > 0) then
        if (self%leaps(place)%table == 0) self%own%excursions_reused = self%own%excursions_reused + 1
      else if (table > 0) then
        call new_place(self, here, place)
        call self%leaps(place)%follow(table, self%survey%table(table), longest)
        if (self%leaps(place)%cycles == 0) place = 0
      else if ((.not. self%recording .and. (self%follows_leg .or. self%turned_back > 0)) &
          .or. (self%turned_back > 0 .and. self%excursion_returns > most_returns)) then
        call self%excursion%clear()
        self%recording = .true.
        self%is_whole = self%turned_back > 0
        ! The next one is about as far away as the last return.
        self%keeping = self%is_whole .or. (self%last_return >= 0.0_wp .and. longest > now%time - self%last_return)
        self%excursion_from = here
        self%excursion_releases = 0
        self%excursion_returns = 0
        self%excursion_at = now%time
      end if
      if (place > 0) then
        if (.not. is_sound(self, here, self%leaps(place), longest)) place = 0
      end if
    end associate
  end subroutine choose_leap

  !> Whether a leap invents nothing: the time increases, by no more than asked, the lead is at most one fast cycle, events stay in
  !> order, and the works balance. Otherwise the motion continues by steps.
  logical function is_sound(self, here, leap, longest)
    class(cycle_map_t), intent(in) :: self
    type(release_angle_t), intent(in) :: here
    type(leap_t), intent(in) :: leap
    real(wp), intent(in) :: longest
    real(wp), allocatable :: time(:)
    integer, allocatable :: kind(:)
    real(wp) :: lead

    lead = lead_of(self, here, leap)
    associate (k => self%slider%stiffness, u => self%elongation_at(leap%from%theta()), &
        u_last => self%elongation_at(leap%to%theta()), duration => leap%duration - lead)
      is_sound = duration > 0.0_wp .and. duration <= longest .and. leap%friction_work >= 0.0_wp .and. &
        abs(leap%drive_work - leap%friction_work - leap%damper_work - 0.5_wp*sum(k*(u_last**2 - u**2))) &
        <= unbalanced*self%survey%rtol*leap%exchanged
    end associate
    if (.not. is_sound .or. .not. abs(lead) > 0.0_wp) return
    call leap%events(time, kind)
    where (time > leap%slip_begins) time = time - lead
    is_sound = abs(lead) <= self%survey%last%duration .and. all(time(2:) > time(:size(time) - 1))
  end function is_sound

  !> A leap that began at the same release and ends in time, 0 if there is none.
  integer function known_leap(self, here, longest) result(place)
    class(cycle_map_t), intent(inout) :: self
    type(release_angle_t), intent(in) :: here
    real(wp), intent(in) :: longest
    integer :: i

    place = 0
    do i = 1, remembered(self)
      associate (leap => self%leaps(i))
        if (abs(leap%velocity - self%piece%drive%velocity) > 0.0_wp .or. leap%from%side*here%side < 0.0_wp) cycle
        if (leap%duration > longest .or. .not. leap%is_kept) cycle
        associate (apart => abs(leap%from%angle - here%angle))
          if (apart <= merge(max(same_angle, near_whole*self%survey%rtol), same_angle, leap%is_whole)) then
            place = i
          else if (leap%table == 0 .and. apart <= near*self%survey%rtol .and. self%survey%before%known) then
            if (.not. leap%is_measured) call measure_stretch(self, i)
            if (leap%stretch_known .and. exp(leap%log_stretch)*apart <= left_over*self%survey%rtol) place = i
          end if
        end associate
        if (place > 0) return
      end associate
    end do
  end function known_leap

  !> The time [s] by which the motion is ahead of an excursion that is kept and begins at a slightly different angle: the cycles
  !> drift from one to the other at a rate that is extrapolated from that of the last two.
  pure real(wp) function lead_of(self, here, leap) result(lead)
    class(cycle_map_t), intent(in) :: self
    type(release_angle_t), intent(in) :: here
    type(leap_t), intent(in) :: leap

    lead = 0.0_wp
    if (leap%table > 0 .or. .not. self%survey%before%known) return
    associate (last => self%survey%last, before => self%survey%before)
      ! Slow cycles with one stick each do not drift: if they repeat, their turns are noise.
      if (max(last%duration, before%duration) > longest_fast*2.0_wp*pi*self%slider%radian_time()) return
      if (min(abs(last%turn), abs(before%turn)) < least_turn*self%survey%rtol) return
      if (last%turn/before%turn < 1.0_wp/alike .or. last%turn/before%turn > alike) return
      lead = (here%angle - leap%from%angle)*(1.5_wp*last%duration/last%turn - 0.5_wp*before%duration/before%turn)
    end associate
  end function lead_of

  !> The place where the next leap is kept.
  subroutine new_place(self, here, place)
    class(cycle_map_t), intent(inout) :: self
    type(release_angle_t), intent(in) :: here
    integer, intent(out) :: place

    if (.not. allocated(self%leaps)) allocate (self%leaps(max_leaps))
    place = int(modulo(self%leap_count, int(max_leaps, int64))) + 1
    self%leap_count = self%leap_count + 1
    associate (leap => self%leaps(place))
      leap%number = self%leap_count
      leap%velocity = self%piece%drive%velocity
      leap%from = here
      leap%table = 0
      leap%cycles = 0
      leap%duration = 0.0_wp
      leap%is_kept = .false.
      leap%stretch_known = .false.
      leap%is_measured = .false.
      leap%uses = 0
      leap%is_whole = .false.
    end associate
  end subroutine new_place

  !> The present excursion has ended.
  subroutine end_excursion(self)
    class(cycle_map_t), intent(inout) :: self
    integer :: place, kept, i

    self%recording = .false.
    call new_place(self, self%excursion_from, place)
    self%leaps(place)%to = release_at(self%piece%to%y(2))
    self%leaps(place)%duration = self%piece%to%time - self%excursion_at
    self%leaps(place)%releases = self%excursion_releases
    self%leaps(place)%is_whole = self%is_whole .and. self%turned_back > 0
    ! Whole slow cycles are measured when they are reused.
    if (self%divergence%is_worth_measuring() .and. .not. self%leaps(place)%is_whole) call measure_stretch(self, place)
    call note_stretch(self, place)
    if (.not. self%keeping) return
    call self%leaps(place)%keep(self%excursion)
    ! Otherwise excursions that are not reused would accumulate.
    kept = 0
    do i = remembered(self), 1, -1
      associate (leap => self%leaps(modulo(place + i - 1, max_leaps) + 1))
        if (leap%table > 0 .or. .not. leap%is_kept) cycle
        kept = kept + 1
        if (kept > max_kept) call leap%drop()
      end associate
    end do
  end subroutine end_excursion

  !> The growth of a small difference in an excursion: from two others that begin on either side of it. Both are computed by the
  !> survey's scout, so that their difference is no error of the steps.
  subroutine measure_stretch(self, place)
    class(cycle_map_t), intent(inout) :: self
    integer, intent(in) :: place
    type(release_angle_t) :: from(2), to(2)
    real(wp) :: apart
    logical :: found
    integer :: i

    associate (leap => self%leaps(place))
      apart = max(push*abs(self%usual_turn), least_push*self%survey%rtol)
      found = leap%duration > 0.0_wp
      from = leap%from
      from%angle = from%angle + [-0.5_wp, 0.5_wp]*apart
      do i = 1, 2
        if (found) call self%survey%run_releases(leap%velocity, from(i), leap%releases, &
          long*leap%duration, to(i), found)
      end do
      found = found .and. to(1)%side*to(2)%side > 0.0_wp
      leap%is_measured = .true.
      leap%stretch_known = found
      if (found) leap%log_stretch = log(max(abs(to(2)%angle - to(1)%angle), unseen*self%survey%rtol)/apart)
    end associate
  end subroutine measure_stretch

  !> Add the growth of a small difference in a leap, or in an excursion that has been computed by steps. A slow cycle ends with an
  !> excursion that leads back.
  pure subroutine note_stretch(self, place)
    class(cycle_map_t), intent(inout) :: self
    integer, intent(in) :: place

    associate (leap => self%leaps(place))
      call self%divergence%pass(leap%log_stretch)
      if (.not. leap%stretch_known) call self%divergence%lose()
      if (leap%table > 0) return
      associate (turn => leap%to%angle - leap%from%angle)
        if (leap%is_whole .or. (turn*self%usual_turn < 0.0_wp .and. abs(turn) > far_back*abs(self%usual_turn))) &
          call self%divergence%come_back()
      end associate
    end associate
  end subroutine note_stretch

  !> Elongation [m] at a release with friction at the angle `theta` [rad].
  pure function elongation_at(self, theta) result(u)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: theta
    real(wp) :: u(2)

    u = self%slider%elongation_at_limit(theta, self%piece%drive%velocity)
  end function elongation_at

  !> Make a leap the last piece.
  subroutine make_leap(self, place)
    class(cycle_map_t), intent(inout) :: self
    integer, intent(in) :: place
    type(state_t) :: to
    real(wp) :: worked

    ! An excursion that has been reused once may never be reused again.
    if (self%leaps(place)%uses > 0 .and. .not. self%leaps(place)%is_measured) call measure_stretch(self, place)
    self%leaps(place)%uses = self%leaps(place)%uses + 1
    call note_stretch(self, place)
    associate (leap => self%leaps(place), from => self%piece%from)
      self%lead = lead_of(self, release_at(from%y(2)), leap)
      ! Up to the beginning of the excursion the drive's work is that of the cycles; the rest of the energy is friction's.
      worked = 0.0_wp
      if (abs(self%lead) > 0.0_wp) worked = -self%lead*drive_power(self)
      to = from
      call to%later(from, leap%duration - self%lead)
      to%drive_work = from%drive_work + leap%drive_work + worked
      to%friction_work = from%friction_work + leap%friction_work + worked &
        - 0.5_wp*sum(self%slider%stiffness*(self%elongation_at(leap%from%theta())**2 - from%u**2))
      to%damper_work = from%damper_work + leap%damper_work
      call self%steps%place_at_release(leap%to%theta(), to)
      associate (there => self%steps%piece%to)
        there%position = from%position + self%piece%drive%velocity*(leap%duration - self%lead) &
          - dot_product(there%u - from%u, self%slider%along)
        self%piece%to = there
      end associate
      self%own%cycles_leapt = self%own%cycles_leapt + leap%cycles
      self%own%events = self%own%events + 2*leap%cycles
      if (leap%table > 0) self%own%map_error = max(self%own%map_error, self%survey%table(leap%table)%error)
    end associate
    self%current = place
    self%leapt = .true.
    self%piece%event = slip_begins
    self%piece%contact = slips
    self%contact = slips
    self%released = .true.
    self%has_before = .true.
    self%before = self%leaps(place)%to
    self%before_time = self%piece%to%time
    self%survey%before%known = .false.
    if (.not. self%leaps(place)%is_whole) self%turned_back = 0
    self%follows_leg = self%leaps(place)%table > 0
    if (.not. self%follows_leg) return
    associate (leap => self%leaps(place), n => self%leaps(place)%cycles)
      self%survey%last = leap%cycle_of(n)
      if (n > 1) self%survey%before = leap%cycle_of(n - 1)
    end associate
  end subroutine make_leap

  !> Mean power of the drive [W] in the last cycle, if it belongs to a table that is still kept; else the power at the release.
  pure real(wp) function drive_power(self)
    class(cycle_map_t), intent(in) :: self
    real(wp) :: measure(measures)

    drive_power = self%piece%drive%velocity &
      *dot_product(self%slider%force_at_rest(self%piece%from%u, self%piece%drive%velocity), self%slider%along)
    if (self%current == 0) return
    associate (leap => self%leaps(self%current))
      if (leap%table == 0 .or. leap%cycles == 0) return
      measure = self%survey%table(leap%table)%measures_at(leap%angle(leap%cycles))
    end associate
    drive_power = measure(drive_work)/measure(duration)
  end function drive_power

  pure function instant(self, time)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(instant_t) :: instant
    type(state_t) :: state
    real(wp) :: elapsed
    integer :: contact

    if (.not. self%leapt .or. time >= self%piece%to%time) then
      instant = self%steps%instant(time)
      return
    end if
    associate (from => self%piece%from)
      elapsed = from%until(time)
      call self%state_in_leap(self%leaps(self%current), elapsed + self%lead_after(elapsed), state, contact)
      state%position = from%position + self%piece%drive%velocity*elapsed - dot_product(state%u - from%u, self%slider%along)
    end associate
    state%time = time
    instant = self%steps%instant_of(state, contact)
  end function instant

  !> The state and the contact in a leap, some time after it began; time and position count from there. Without works.
  pure subroutine state_in_leap(self, leap, elapsed, state, contact)
    class(cycle_map_t), intent(in) :: self
    type(leap_t), intent(in) :: leap
    real(wp), intent(in) :: elapsed            !! s
    type(state_t), intent(out) :: state
    integer, intent(out) :: contact
    real(wp) :: within, value(4), theta
    integer :: i

    if (leap%table == 0) then
      call state_in_recording(leap%recording, elapsed, state, contact)
    else
      i = leap%cycle_at(elapsed)
      within = elapsed - leap%start(i)
      if (within < leap%slip(i)) then
        contact = slips
        value = self%survey%table(leap%table)%slip_at(self%steps%closed_form%grid, leap%angle(i), within/leap%slip(i))
        theta = leap%from%side*leap%angle(i)
        state%u = self%elongation_at(theta) + value(1:2)
        state%y(1:2) = [value(3), theta + value(4)]
      else
        contact = sticks
        state%u = self%elongation_at(leap%from%side*leap%angle(i + 1)) &
          - leap%velocity*(leap%start(i + 1) - elapsed)*self%piece%drive_coupling
      end if
      associate (u_first => self%elongation_at(leap%from%theta()))
        state%position = leap%velocity*elapsed - dot_product(state%u - u_first, self%slider%along)
      end associate
    end if
    state%time = elapsed
  end subroutine state_in_leap

  !> The same for an excursion.
  pure subroutine state_in_recording(recording, elapsed, state, contact)
    type(recording_t), intent(in) :: recording
    real(wp), intent(in) :: elapsed            !! s
    type(state_t), intent(out) :: state
    integer, intent(out) :: contact
    type(piece_t) :: piece
    type(state_t) :: first

    call recording%get(recording%place_of(elapsed), piece)
    first = recording%from(1)
    state = piece%at(first%time + elapsed)
    state%position = state%position - first%position
    contact = piece%contact
  end subroutine state_in_recording

  !> The time by which the last piece is ahead of the leap that is kept, some time after its beginning [s]. The fast oscillation
  !> continues from the beginning at the same time; the slip, and everything after it, comes earlier.
  pure real(wp) function lead_after(self, elapsed) result(lead)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: elapsed

    lead = merge(self%lead, 0.0_wp, elapsed > self%leaps(self%current)%slip_begins)
  end function lead_after

  !> The end of the step in a leap that follows some time [s] after its beginning; in a cycle the end of a panel of its table.
  pure real(wp) function next_in_leap(self, leap, elapsed) result(next)
    class(cycle_map_t), intent(in) :: self
    type(leap_t), intent(in) :: leap
    real(wp), intent(in) :: elapsed
    integer :: i, k

    if (leap%table == 0) then
      next = leap%recording%end_of(leap%recording%place_of(elapsed))
      return
    end if
    i = leap%cycle_at(elapsed)
    next = leap%start(i + 1)
    associate (table => self%survey%table(leap%table))
      do k = table%panels, 1, -1
        associate (panel_end => leap%start(i) + table%panel_end(k)*leap%slip(i))
          if (panel_end <= elapsed) exit
          next = panel_end
        end associate
      end do
    end associate
  end function next_in_leap

  pure subroutine events(self, time, kind)
    class(cycle_map_t), intent(in) :: self
    real(wp), allocatable, intent(out) :: time(:)
    integer, allocatable, intent(out) :: kind(:)
    integer :: i

    if (.not. self%leapt) then
      time = pack([self%piece%to%time], self%piece%event /= no_event)
      kind = pack([self%piece%event], self%piece%event /= no_event)
      return
    end if
    call self%leaps(self%current)%events(time, kind)
    associate (from => self%piece%from)
      do i = 1, size(time)
        time(i) = from%time + (from%time_rest + (time(i) - self%lead_after(time(i))))
      end do
    end associate
  end subroutine events

  pure real(wp) function next_instant(self, time)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: time
    real(wp) :: next, former

    next_instant = max(time, self%piece%to%time)
    if (.not. self%leapt .or. .not. self%piece%to%time > time) return
    associate (from => self%piece%from, to => self%piece%to)
      next = from%until(time) + self%lead_after(from%until(time))
      ! After rounding, an end may be that of the step before.
      do
        former = next
        next = self%next_in_leap(self%leaps(self%current), former)
        next_instant = min(to%time, from%time + (from%time_rest + (next - self%lead_after(next))))
        if (next_instant > time) return
        if (.not. next > former) exit
      end do
      next_instant = to%time
    end associate
  end function next_instant

  pure real(wp) function energy(self, velocity)
    class(cycle_map_t), intent(in) :: self
    real(wp), intent(in) :: velocity(2)

    energy = self%steps%energy(velocity)
  end function energy

  pure function work(self)
    class(cycle_map_t), intent(in) :: self
    type(work_count_t) :: work, surveyed

    surveyed = self%survey%work()
    work = self%steps%work()
    work = work%plus(surveyed)
    work = work%plus(self%own)
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
    class(cycle_map_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    integer :: i

    call serialise_motion(self, archive)
    call self%steps%serialise(archive)
    call self%survey%serialise(archive, self%steps)
    call self%own%serialise(archive)
    call archive%serialise(self%leap_count)
    if (self%leap_count > 0 .and. .not. allocated(self%leaps)) allocate (self%leaps(max_leaps))
    do i = 1, remembered(self)
      call self%leaps(i)%serialise(archive)
    end do
    call archive%serialise(self%current)
    call archive%serialise(self%lead)
    call archive%serialise(self%released)
    call archive%serialise(self%has_before)
    call self%before%serialise(archive)
    call archive%serialise(self%before_time)
    call archive%serialise(self%follows_leg)
    call archive%serialise(self%recording)
    call archive%serialise(self%keeping)
    if (self%recording .and. self%keeping) call self%excursion%serialise(archive)
    call self%excursion_from%serialise(archive)
    call archive%serialise(self%last_return)
    call archive%serialise(self%usual_turn)
    call archive%serialise(self%turned_back)
    call archive%serialise(self%is_whole)
    call self%divergence%serialise(archive)
    call archive%serialise(self%excursion_releases)
    call archive%serialise(self%excursion_returns)
    call archive%serialise(self%excursion_at)
  end subroutine serialise
end module dst_cycle_map
