!> Slip and stick by an explicit method. It evaluates y' = g/B, which has no value at rest: slip begins as a power series and ends
!> in closed form, and in between the method avoids v = 0.
module dst_explicit_slip
  use dst_bernstein, only: first_zero
  use dst_braking, only: braking_t, braking, default_cut_speed
  use dst_errors, only: error_t, raise, release_failed
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_motion, only: at_time
  use dst_piece, only: slips
  use dst_release, only: release_t, release_series
  use dst_rest, only: slip_start_t, spring_force_size
  use dst_slip_stick, only: slip_stick_t, set_off_from_rest => set_off, negligible_share
  use dst_state, only: state_t
  use dst_stepper, only: attempt_t
  use dst_stepping, only: slide
  implicit none
  private

  public :: explicit_slip_t

  !> A step in which v reaches zero is repeated up to this share of the time until then, shortened by this factor at most.
  !> Conventions. Fig. 3 and similar scenes have no such step, as stops end in closed form; twice and half: no change.
  real(wp), parameter :: share_before_stop = 0.95_wp, least_factor = 0.1_wp

  !> Motion by an explicit method.
  type, extends(slip_stick_t) :: explicit_slip_t
    !> With cut_speed = 0 the cut-off is chosen from this tolerance.
    real(wp) :: cut_rtol = 0.0_wp
  contains
    procedure :: go_on
    procedure :: set_off
    procedure :: try
  end type explicit_slip_t

contains

  !> A stretch at rest, the start or end of slip in closed form, or a step.
  subroutine go_on(self, horizon, error)
    class(explicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error
    logical :: ended

    call self%look_at_jump()
    if (self%contact /= slips) then
      call self%stay_stuck(horizon)
    else if (self%now%just_released) then
      call follow_release(self, horizon, error)
    else
      call end_slow_slip(self, horizon, ended)
      if (.not. ended) call slide(self, horizon, error)
    end if
  end subroutine go_on

  !> End slip that is slower than the cut-off in closed form. Slip against more than friction ends without a rest, in a turn: the
  !> method continues through it, unless its speed is negligible and counts as zero. The same holds for slip in which a knot of the
  !> drive occurs just after its release.
  subroutine end_slow_slip(self, horizon, ended)
    class(explicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    logical, intent(out) :: ended
    type(braking_t) :: stopping
    type(state_t) :: to
    real(wp) :: cut, slow
    logical :: negligible

    associate (now => self%piece%to, drive => self%piece%drive, drive_velocity => self%drive_velocity())
      cut = max(self%cut_speed, self%cut_share*self%stepper%peak_speed)
      if (.not. self%cut_speed > 0.0_wp) &
        cut = max(cut, default_cut_speed(self%cut_rtol, drive_velocity, self%stepper%peak_speed))
      ! Slow compared with the drive, whatever the motion so far.
      slow = default_cut_speed(self%cut_rtol, drive_velocity, abs(drive_velocity))
      negligible = now%y(1) <= negligible_share*max(cut, slow)
      ended = now%y(1) <= cut .or. negligible
      if (.not. ended) return
      stopping = braking(self%slider, drive, now)
      ended = stopping%ends_within(now%until(horizon), cut)
      if (ended) then
        to = stopping%end_of_slip(self%slider, drive, now)
        if (.not. negligible) ended = self%ends_straight(to%u, merge(drive%velocity_at(to%time), drive_velocity, &
          self%slider%is_damped()), cut)
      end if
      if (.not. ended) then
        ended = negligible .and. (.not. now%time > drive%start .or. stopping%acceleration < 0.0_wp)
        if (.not. ended) return
        now%y(1) = 0.0_wp
        call self%stop_or_turn()
        return
      end if
    end associate
    call self%finish(stopping, to)
  end subroutine end_slow_slip

  subroutine set_off(self, beginning)
    class(explicit_slip_t), intent(inout) :: self
    type(slip_start_t), intent(in) :: beginning

    self%now%release_rate = beginning%rate(1)
    call set_off_from_rest(self, beginning)
  end subroutine set_off

  !> The start of slip as power series, as one piece.
  subroutine follow_release(self, horizon, error)
    class(explicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error
    type(release_t) :: release
    real(wp) :: duration, left

    self%now%just_released = .false.
    associate (from => self%piece%from, to => self%piece%to, drive => self%piece%drive)
      release = release_series(self%slider, drive, from, self%now%release_rate, self%stepper%release_tolerance)
      if (.not. release%moves .and. spring_force_size(self%slider, from%u, self%drive_velocity()) > 0.0_wp) then
        ! The force equals friction and does not grow: the object stays at rest.
        call self%come_to_rest()
        return
      end if
      if (.not. release%accurate) then
        call raise(error, release_failed, 'slip does not start smoothly enough for an explicit method at '// &
          trim(at_time(from))//': use a Radau method')
        return
      end if
      left = from%until(horizon)
      duration = min(release%tau_end*release%unit, left)
      call release%describe(self%slider, drive, from, duration, self%closed_form, to)
      if (duration >= left) call to%arrive(horizon)
      call self%piece%path%take(self%closed_form)
      self%stepper%count%steps = self%stepper%count%steps + 1
      call self%stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
      self%stepper%start_speed = to%y(1)
      self%stepper%peak_speed = to%y(1)
    end associate
    self%now%next_step = min(self%now%release_step, self%first_step())
  end subroutine follow_release

  !> Refuse an attempt in which v reaches zero, so that the next one ends before that.
  subroutine try(self, step, to, outcome, stopped)
    class(explicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: step
    type(state_t), intent(out) :: to
    type(attempt_t), intent(out) :: outcome
    logical, intent(out) :: stopped
    real(wp) :: coefficient(0:max_degree), position

    stopped = .false.
    call self%stepper%attempt(self%system, self%piece%drive, self%piece%from, step, to, outcome)
    if (.not. outcome%solved .or. outcome%error > 1.0_wp) return
    call self%stepper%speed_coefficients(coefficient)
    position = first_zero(coefficient(0:self%stepper%grid%degree))
    if (position > 1.0_wp) return
    outcome%solved = .false.
    outcome%factor = max(least_factor, share_before_stop*position)
  end subroutine try
end module dst_explicit_slip
