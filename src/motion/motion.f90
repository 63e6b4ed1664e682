!> A motion is a sequence of pieces. Sources of pieces extend `motion_t`:
!>
!>     stepping_t             steps of an integrator, without rest
!>       slip_stick_t         slip, rest and release of the exact contact
!>     creep_motion_t         slow creep in closed form
!>     cycle_map_t            one of the first three with what repeats, and fast cycles, leapt
!>
!> The readers of a motion (columns, summary, samples, saved states) use the last piece and the state at any time in it; a leap is a
!> piece with many events.
module dst_motion
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_drive, only: drive_t
  use dst_errors, only: error_t, raise, chattering
  use dst_text, only: short_length, short_text
  use dst_kinds, only: wp, int64
  use dst_piece, only: piece_t, no_event, slip_begins, slips
  use dst_slider, only: slider_t
  use dst_state, only: state_t, instant_t
  use dst_stepper, only: work_count_t
  use dst_writer, only: event_t
  implicit none
  private

  public :: motion_t, next_piece, change_over, serialise_motion, events_of_piece, at_time

  !> Numbers of events, and of pieces, at one time after which the motion is given up. Conventions. Twice: no change.
  integer, parameter :: max_events_at_once = 100, max_pieces_at_once = 10000

  !> What goes on from piece to piece.
  type :: motion_state_t
    !> The last piece; before the first one it only contains the beginning of the motion.
    type(piece_t) :: piece
    !> Whether the object slips, touches or sticks at the end of the piece.
    integer :: contact = slips
    !> Stretch of the drive in which the last piece is or the next one begins.
    integer :: segment = 1
    !> Whether the last piece is a leap (dst_cycle_map), from one release to a later one; how often that is repeated, 0 if once.
    logical :: leapt = .false.
    integer(int64) :: repetitions = 0
    !> Numbers of events and pieces since the time last increased.
    integer :: events_at_once = 0
    integer :: pieces_at_once = 0
  end type motion_state_t

  !> A motion in progress.
  type, abstract, extends(motion_state_t) :: motion_t
    type(slider_t) :: slider
    type(drive_t) :: drive
    real(wp) :: t_end = 0.0_wp                !! s
    !> The next piece ends at this time [s] at the latest.
    real(wp) :: next_look = huge(1.0_wp)
    !> Whether it has a closed form at any time; its pieces have no works.
    logical :: in_closed_form = .false.
    !> Whether it can rest while the drive does; while the drive moves, the other motion is used, which the drive partly prescribes.
    logical :: may_rest = .true.
  contains
    !> Make the next piece, up to a time [s] at most.
    procedure(go_on), deferred :: go_on
    !> The state at a time [s] of the last piece in plain quantities.
    procedure(instant), deferred :: instant
    ! Procedures that a closed form does not need:
    procedure :: take_over
    procedure :: energy
    procedure :: work
    procedure :: is_undecided
    procedure :: velocity
    procedure :: events => events_of_piece
    procedure :: show
    procedure :: next_instant
    procedure :: serialise => serialise_motion
    procedure :: finished
    procedure :: velocity_now
    procedure :: advance
  end type motion_t

  abstract interface
    subroutine go_on(self, horizon, error)
      import :: motion_t, error_t, wp
      class(motion_t), intent(inout) :: self
      real(wp), intent(in) :: horizon
      type(error_t), allocatable, intent(out) :: error
    end subroutine go_on

    pure function instant(self, time)
      import :: motion_t, instant_t, wp
      class(motion_t), intent(in) :: self
      real(wp), intent(in) :: time
      type(instant_t) :: instant
    end function instant
  end interface

contains

  !> Continue from the state of another motion, whose method is moved here.
  subroutine take_over(self, before)
    class(motion_t), intent(inout) :: self, before

    associate (unused => [self%contact, before%contact])
    end associate
  end subroutine take_over

  !> Kinetic and elastic energy [J] at the end of the last piece, with this slip velocity [m/s].
  pure real(wp) function energy(self, velocity)
    class(motion_t), intent(in) :: self
    real(wp), intent(in) :: velocity(2)

    associate (unused => self%contact, also_unused => velocity)
    end associate
    energy = 0.0_wp
  end function energy

  !> The work done so far.
  pure function work(self)
    class(motion_t), intent(in) :: self
    type(work_count_t) :: work

    associate (unused => self%contact)
    end associate
    work = work_count_t()
  end function work

  !> Whether invisible roundoff determines the motion from now on; see dst_stepper.
  pure logical function is_undecided(self)
    class(motion_t), intent(in) :: self

    associate (unused => self%contact)
    end associate
    is_undecided = .false.
  end function is_undecided

  !> Slip velocity (w_x, w_y) [m/s] in a state of the last piece in which the object slips.
  pure function velocity(self, state)
    class(motion_t), intent(in) :: self
    type(state_t), intent(in) :: state
    real(wp) :: velocity(2)
    type(instant_t) :: there

    there = self%instant(state%time)
    velocity = there%velocity
  end function velocity

  !> Make the motion around a time [s] of the last piece ready for `instant` and `next_instant`, if it is a leap.
  subroutine show(self, time)
    class(motion_t), intent(inout) :: self
    real(wp), intent(in) :: time

    associate (unused => self%contact, also_unused => time)
    end associate
  end subroutine show

  !> The events of the last piece, which is no leap.
  pure subroutine events_of_piece(self, log)
    class(motion_t), intent(in) :: self
    type(event_t), allocatable, intent(out) :: log(:)

    log = pack([event_t(self%piece%to%time, self%piece%event)], self%piece%event /= no_event)
  end subroutine events_of_piece

  !> The next time [s] after `time` that is sampled if no interval is given: the end of the last piece, or of a step in it.
  pure real(wp) function next_instant(self, time)
    class(motion_t), intent(in) :: self
    real(wp), intent(in) :: time

    next_instant = max(time, self%piece%to%time)
  end function next_instant

  pure logical function finished(self)
    class(motion_t), intent(in) :: self

    finished = self%piece%to%time >= self%t_end
  end function finished

  !> Slip velocity (w_x, w_y) [m/s] at the end of the last piece.
  pure function velocity_now(self) result(velocity)
    class(motion_t), intent(in) :: self
    real(wp) :: velocity(2)

    velocity = 0.0_wp
    if (self%contact == slips) velocity = self%velocity(self%piece%to)
  end function velocity_now

  !> The next piece of one of two motions that alternate at knots where the drive begins or ceases to rest; or of the only one.
  subroutine next_piece(motion, other, error)
    class(motion_t), allocatable, intent(inout) :: motion, other
    type(error_t), allocatable, intent(out) :: error

    if (allocated(other) .and. motion%piece%to%time >= motion%piece%drive%end) then
      motion%piece%event = no_event
      call enter_segment(motion)
      if (motion%may_rest .neqv. motion%piece%drive%rests) call change_over(motion, other)
      if (motion%piece%event /= no_event) return
    end if
    call motion%advance(error)
  end subroutine next_piece

  !> The next piece.
  subroutine advance(self, error)
    class(motion_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error

    self%piece%event = no_event
    self%leapt = .false.
    if (self%piece%to%time >= self%piece%drive%end) call enter_segment(self)
    self%piece%from = self%piece%to
    self%piece%contact = self%contact
    call self%go_on(min(self%t_end, self%piece%drive%end, self%next_look), error)
    if (.not. allocated(error)) call watch_progress(self, error)
  end subroutine advance

  !> Past a knot of the drive.
  pure subroutine enter_segment(self)
    class(motion_t), intent(inout) :: self

    do while (self%piece%to%time >= self%drive%segment(self%segment)%end)
      self%segment = self%segment + 1
    end do
    self%piece%drive = self%drive%segment(self%segment)
  end subroutine enter_segment

  !> The other motion continues. If that ends a rest, it is an event, and a piece of its own.
  subroutine change_over(motion, other)
    class(motion_t), allocatable, intent(inout) :: motion, other
    class(motion_t), allocatable :: kept

    call move_alloc(motion, kept)
    call move_alloc(other, motion)
    call move_alloc(kept, other)
    motion%piece = other%piece
    motion%piece%from = motion%piece%to
    motion%piece%contact = other%contact
    motion%segment = other%segment
    motion%events_at_once = other%events_at_once
    motion%pieces_at_once = other%pieces_at_once
    motion%contact = slips
    if (other%contact /= slips .and. .not. motion%may_rest) motion%piece%event = slip_begins
    call motion%take_over(other)
  end subroutine change_over

  !> Steps shorter than the resolution of the time are legitimate if the mass is small, but only a limited number of them; the same
  !> holds for events.
  subroutine watch_progress(motion, error)
    class(motion_t), intent(inout) :: motion
    type(error_t), allocatable, intent(inout) :: error

    if (motion%piece%to%time > motion%piece%from%time) then
      motion%events_at_once = 0
      motion%pieces_at_once = 0
      return
    end if
    motion%pieces_at_once = motion%pieces_at_once + 1
    if (motion%piece%event /= no_event) motion%events_at_once = motion%events_at_once + 1
    if (motion%events_at_once > max_events_at_once .or. motion%pieces_at_once > max_pieces_at_once) &
      call raise(error, chattering, 'the contact chatters: time stands still at '//trim(at_time(motion%piece%to))// &
        ': use a smaller rtol, another method, or contact = ''smoothed''')
  end subroutine watch_progress

  !> 't = 1.25 s (u = … m, y = …)'. Of fixed length: gfortran keeps the length of an allocatable text that a function returns
  !> in static storage, and several threads advance at once.
  pure character(160) function at_time(state) result(text)
    type(state_t), intent(in) :: state

    character(short_length) :: u(2), y(2), time

    time = short_text(state%time)
    u = [short_text(state%u(1)), short_text(state%u(2))]
    y = [short_text(state%y(1)), short_text(state%y(2))]
    text = 't = '//trim(time)//' s (u = '//trim(u(1))//', '//trim(u(2))//' m, slip '//trim(y(1))//', '//trim(y(2))//')'
  end function at_time

  !> Save or load the data of every motion, to which a type adds its own; the rest follows from the scene.
  subroutine serialise_motion(self, archive)
    class(motion_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call archive%serialise(c_loc(self%motion_state_t), storage_size(self%motion_state_t))
  end subroutine serialise_motion
end module dst_motion
