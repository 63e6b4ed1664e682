!> Slip and stick by an implicit method, which can begin and end a step at rest: a stop is where v = 0 at the end of a step.
module dst_implicit_slip
  use dst_bernstein, only: first_zero, first_minimum, bernstein_value
  use dst_braking, only: braking_t, braking
  use dst_dense_output, only: column_y
  use dst_errors, only: error_t
  use dst_interpolation, only: max_degree
  use dst_kinds, only: wp
  use dst_piece, only: slips
  use dst_rest, only: slip_start_t, spring_force_size
  use dst_slip_stick, only: slip_stick_t, set_off_from_rest => set_off, settle_slip => settle, noise_allowance
  use dst_state, only: state_t
  use dst_stepper, only: attempt_t
  use dst_stepping, only: slide
  implicit none
  private

  public :: implicit_slip_t

  ! The effects of "twice" were measured with radau9 on Fig. 3 (2.4 s, rtol 1e-6 and 1e-8) and on drives that reverse or stop.
  !
  !> Change of the slip speed at the lowest point, relative to the largest one in the step, that is roundoff (1e-14 in double
  !> precision, a few digits above it). Convention. Twice: no change.
  real(wp), parameter :: landed = 10.0_wp**(1 - precision(1.0_wp))
  !> Lowest slip speed of a dip, relative to the largest one in the step: a shallow dip is evaluated at its lowest point, and so is
  !> one that seems to stay just above zero. Conventions: the accuracy of the dense output. Twice: 0.1 % more iterations, the same
  !> error; no change.
  real(wp), parameter :: shallow = 0.01_wp, just_above = 1.0e-4_wp
  !> Number of Newton iterations for the length of a step that shall end at a lowest point, each a step of its own. Convention; an
  !> iteration that needs them all is limited by roundoff. Twice: 0.2 to 0.8 % more iterations, the same error.
  integer, parameter :: max_landings = 20
  !> The smallest share of a step that one of these iterations leaves. Convention. Twice, so that no iteration shortens the step: up
  !> to 11 % more iterations in other scenes, no change in Fig. 3; half: no change.
  real(wp), parameter :: least_left = 0.5_wp
  !> Two slips take nearly the same time if it differs by less than this share. Convention. Twice: the same steps.
  real(wp), parameter :: alike = 0.1_wp
  !> Factor after a step that may have missed a stop. Convention. Fig. 3 has none; twice in other scenes: up to 1 % more work.
  real(wp), parameter :: missed_factor = 0.25_wp

  !> Motion by an implicit method.
  type, extends(slip_stick_t) :: implicit_slip_t
    !> Whether this attempt ends at the lowest point of a shallow dip.
    logical, private :: to_dip = .false.
  contains
    procedure :: go_on
    procedure :: set_off
    procedure :: try
    procedure :: settle
  end type implicit_slip_t

contains

  !> A stretch at rest, the end of slip in closed form, or a step.
  subroutine go_on(self, horizon, error)
    class(implicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error
    logical :: ended

    call self%look_at_jump()
    if (self%contact /= slips) then
      call self%stay_stuck(horizon)
      return
    end if
    call end_slow_slip(self, horizon, ended)
    if (.not. ended) call slide(self, horizon, error)
  end subroutine go_on

  !> End slip that is slower than the cut-off in closed form, if it is about to stop and rests then. Slip against more than friction
  !> ends without a rest, in a turn: the method continues through it, unless its speed is negligible.
  subroutine end_slow_slip(self, horizon, ended)
    class(implicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    logical, intent(out) :: ended
    type(braking_t) :: stopping
    type(state_t) :: to
    real(wp) :: cut
    logical :: unloaded

    ended = .false.
    if (self%now%just_released) return
    cut = max(self%cut_speed, self%cut_share*self%stepper%peak_speed)
    associate (now => self%piece%to, drive => self%piece%drive)
      unloaded = now%y(1) > cut
      if (unloaded) then
        if (.not. is_unloaded(self, now)) return
        cut = now%y(1)
      end if
      stopping = braking(self%slider, drive, now)
      if (.not. (stopping%ends_within(now%until(horizon), cut) .and. stopping%acceleration < 0.0_wp)) return
      to = stopping%end_of_slip(self%slider, drive, now)
      if (unloaded) then
        if (.not. is_unloaded(self, to)) return
      end if
      ended = self%ends_straight(to%u, merge(drive%velocity_at(to%time), self%drive_velocity(), self%slider%is_damped()), cut)
    end associate
    if (ended) call self%finish(stopping, to)
  end subroutine end_slow_slip

  !> Whether the springs hardly pull and friction hardly changes. Then nothing turns the slip, and at its end it has no equation for
  !> the direction; the error of the closed form is proportional to the square of this share of the static limit.
  pure logical function is_unloaded(self, state)
    class(implicit_slip_t), intent(in) :: self
    type(state_t), intent(in) :: state
    real(wp) :: friction(1), slope(1)

    associate (limit => self%slider%law%kinetic_limit)
      is_unloaded = spring_force_size(self%slider, state%u, self%piece%drive%velocity_at(state%time)) <= self%cut_share*limit
      if (is_unloaded .and. self%slider%is_damped()) &
        is_unloaded = maxval(self%slider%damping)*state%y(1) <= self%cut_share*limit
      if (.not. is_unloaded) return
      call self%slider%law%evaluate(1, state%y(1:1), friction, slope)
      is_unloaded = max(abs(limit - friction(1)), abs(slope(1))*state%y(1)) <= self%cut_share*limit
    end associate
  end function is_unloaded

  subroutine set_off(self, beginning)
    class(implicit_slip_t), intent(inout) :: self
    type(slip_start_t), intent(in) :: beginning

    self%now%from_dip = .false.
    self%now%slipped = 0.0_wp
    call set_off_from_rest(self, beginning)
  end subroutine set_off

  subroutine settle(self, stopped, truncated)
    class(implicit_slip_t), intent(inout) :: self
    logical, intent(in) :: stopped, truncated

    self%now%from_dip = self%to_dip
    self%now%slipped = self%now%slipped + self%stepper%step
    if (stopped) then
      self%now%slip_before = self%now%last_slip
      self%now%last_slip = self%now%slipped
    end if
    call settle_slip(self, stopped, truncated)
  end subroutine settle

  !> Attempt a step: to the stop, if the last two slips were alike and predict the stop within the length; else of that length,
  !> shortened to the stop if v reaches zero in it.
  subroutine try(self, step, to, outcome, stopped)
    class(implicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: step
    type(state_t), intent(out) :: to
    type(attempt_t), intent(out) :: outcome
    logical, intent(out) :: stopped
    real(wp) :: due

    self%to_dip = .false.
    due = self%now%last_slip + (self%now%last_slip - self%now%slip_before) - self%now%slipped
    if (abs(self%now%last_slip - self%now%slip_before) <= alike*self%now%last_slip .and. due > 0.0_wp .and. due <= step &
      .and. .not. self%now%just_released) then
      call land(self, due, step, to, outcome, stopped)
      if (stopped) return
      self%stepper%count%rejected = self%stepper%count%rejected + 1
    end if
    stopped = .false.
    call self%stepper%attempt(self%system, self%piece%drive, self%piece%from, step, to, outcome)
    if (outcome%solved) call examine(self, to, outcome, stopped)
  end subroutine try

  !> Shorten a solved attempt in which v reaches zero so that it ends there. The dense output cannot decide whether a shallow dip
  !> reaches zero: such an attempt is first shortened to the lowest point, since the solution at the end of a step decides.
  subroutine examine(self, to, outcome, stopped)
    class(implicit_slip_t), intent(inout) :: self
    type(state_t), intent(inout) :: to
    type(attempt_t), intent(inout) :: outcome
    logical, intent(inout) :: stopped
    real(wp) :: zero, lowest, depth, longest, curvature

    if (self%now%just_released) then
      outcome%solved = moves_off(self)
      if (.not. outcome%solved) outcome%factor = missed_factor
      return
    end if
    call find_dip(self, zero, lowest, depth)
    longest = min(lowest, 1.0_wp)*self%stepper%step
    if (lowest < 1.0_wp .and. -just_above <= depth .and. depth <= shallow) then
      call settle_on_lowest(self, longest, self%stepper%step, to, outcome, curvature)
      if (.not. outcome%solved) return
      self%to_dip = to%y(1) > 0.0_wp
      if (self%to_dip) then
        call refuse_hidden_stop(self, outcome)
        return
      end if
      longest = self%stepper%step
      call land(self, max(least_left*longest, longest - sqrt(2.0_wp*abs(to%y(1))/curvature)), longest, to, outcome, stopped)
    else if (zero <= 1.0_wp) then
      call land(self, zero*self%stepper%step, longest, to, outcome, stopped)
    else
      call refuse_hidden_stop(self, outcome)
    end if
  end subroutine examine

  !> Where the slip speed of the last attempt first passes through zero and where, after that, it is lowest, as positions in the
  !> attempt, 2 if nowhere; and how far below zero it is, relative to the largest speed.
  pure subroutine find_dip(self, zero, lowest, depth)
    class(implicit_slip_t), intent(in) :: self
    real(wp), intent(out) :: zero, lowest, depth
    real(wp) :: coefficient(0:max_degree)

    zero = 2.0_wp
    lowest = 2.0_wp
    depth = -1.0_wp
    associate (grid => self%stepper%grid, scale => self%stepper%speed_scale)
      call dip_coefficients(self, coefficient)
      if (all(coefficient(1:grid%degree) > just_above*scale)) return
      zero = first_zero(coefficient(0:grid%degree))
      lowest = first_minimum(coefficient(0:grid%degree), merge(zero, 0.0_wp, zero <= 1.0_wp))
      if (lowest <= 1.0_wp) depth = -bernstein_value(grid%degree, coefficient(0:grid%degree), lowest)/scale
    end associate
  end subroutine find_dip

  !> Repeat the step with the length, at most `longest` [s], at which v is lowest at its end; v'' there is `curvature` [m/s3].
  subroutine settle_on_lowest(self, guess, longest, to, outcome, curvature)
    class(implicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: guess, longest
    type(state_t), intent(inout) :: to
    type(attempt_t), intent(inout) :: outcome
    real(wp), intent(out) :: curvature
    real(wp) :: step, next, slope
    integer :: iteration

    step = guess
    curvature = 0.0_wp
    do iteration = 1, max_landings
      call self%stepper%attempt(self%system, self%piece%drive, self%piece%from, step, to, outcome)
      if (.not. outcome%solved) exit
      call self%stepper%end_slope(slope, curvature)
      outcome%solved = curvature > 0.0_wp
      if (.not. outcome%solved) exit
      if (slope**2 <= landed*self%stepper%speed_scale*curvature) exit
      next = min(longest, max(least_left*step, step - slope/curvature))
      if (.not. abs(next - step) > epsilon(step)*step) exit
      step = next
    end do
  end subroutine settle_on_lowest

  !> Repeat the step so that it ends in the stop that is near `guess` and at most `longest` [s] away: then the event has the
  !> accuracy of a step's end and not only that of the dense output.
  subroutine land(self, guess, longest, to, outcome, stopped)
    class(implicit_slip_t), intent(inout) :: self
    real(wp), intent(in) :: guess, longest
    type(state_t), intent(inout) :: to
    type(attempt_t), intent(inout) :: outcome
    logical, intent(out) :: stopped

    call self%stepper%attempt(self%system, self%piece%drive, self%piece%from, guess, to, outcome, to_stop=.true.)
    stopped = outcome%solved .and. self%stepper%step <= longest
    if (stopped) stopped = is_first_stop(self)
    if (stopped) return
    outcome%solved = .false.
    outcome%factor = missed_factor
  end subroutine land

  !> Whether the slip speed of the last attempt, which vanishes at its end, is positive before: it falls at the end. v/(1 - tau) has
  !> the Bernstein coefficients b_i s/(s - i), i = 0 ... s - 1.
  pure logical function is_first_stop(self)
    class(implicit_slip_t), intent(in) :: self
    real(wp) :: coefficient(0:max_degree)
    integer :: i

    call dip_coefficients(self, coefficient)
    associate (s => self%stepper%grid%degree)
      do i = 0, s - 1
        coefficient(i) = coefficient(i)*real(s, wp)/real(s - i, wp)
      end do
      is_first_stop = first_zero(coefficient(0:s - 1)) > 1.0_wp
    end associate
  end function is_first_stop

  !> A dip that does not reach zero after all; but v must not have passed through zero either.
  pure subroutine refuse_hidden_stop(self, outcome)
    class(implicit_slip_t), intent(in) :: self
    type(attempt_t), intent(inout) :: outcome
    real(wp) :: coefficient(0:max_degree)

    call dip_coefficients(self, coefficient)
    outcome%solved = first_zero(coefficient(0:self%stepper%grid%degree)) > 1.0_wp
    if (.not. outcome%solved) outcome%factor = missed_factor
  end subroutine refuse_hidden_stop

  !> Bernstein coefficients of v in the last attempt. It rises from the lowest point of a dip; if the polynomial seems to fall
  !> there, within its accuracy, it does not.
  pure subroutine dip_coefficients(self, coefficient)
    class(implicit_slip_t), intent(in) :: self
    real(wp), intent(out) :: coefficient(0:max_degree)
    integer :: half

    associate (grid => self%stepper%grid)
      call self%stepper%speed_coefficients(coefficient)
      if (.not. self%now%from_dip) return
      half = (grid%degree + 1)/2
      coefficient(0:half) = coefficient(0:half) + shallow*self%stepper%speed_scale
    end associate
  end subroutine dip_coefficients

  !> Whether the first step after a release has v > 0 throughout, except for roundoff; a step that is too long may have found the
  !> other branch. v begins with 0, so v/tau has the Bernstein coefficients b_i s/i, i = 1 ... s. The first of these is also 0 up to
  !> the accuracy of the polynomial: a negative value within that is ignored.
  pure logical function moves_off(self)
    class(implicit_slip_t), intent(in) :: self
    real(wp) :: coefficient(0:max_degree)
    integer :: i

    associate (grid => self%stepper%grid, s => self%stepper%grid%degree, &
        noise => noise_allowance*self%system%acceleration_noise*self%stepper%step)
      call self%stepper%speed_coefficients(coefficient)
      do i = 1, s
        coefficient(i) = coefficient(i)*real(s, wp)/real(i, wp) + noise
        if (i <= (s + 1)/2) coefficient(i) = coefficient(i) + shallow*self%stepper%speed_scale
      end do
      moves_off = self%stepper%nodal(s, column_y) > 0.0_wp .and. first_zero(coefficient(1:s)) > 1.0_wp
    end associate
  end function moves_off
end module dst_implicit_slip
