!> Slip, rest and release of the exact contact, in the unknowns y = (v, theta). A stop is where v = 0 at the end of a step.
module dst_slip_stick
  use dst_bernstein, only: first_zero, first_minimum, bernstein_value
  use dst_braking, only: braking_t, braking
  use dst_dense_output, only: dense_output_t, column_y
  use dst_drive, only: drive_t
  use dst_errors, only: error_t
  use dst_interpolation, only: chebyshev_grid, max_degree
  use dst_kinds, only: wp, pi
  use dst_piece, only: stick_begins, slip_begins, slips, touches, sticks
  use dst_rest, only: is_held, comes_to_rest, delay_by_turning, release_delay, slip_start_t, spring_force_size, start_at_release, &
    start_of_slip, touch_time
  use dst_slider, only: slider_t
  use dst_state, only: state_t, instant_t
  use dst_stepper, only: attempt_t
  use dst_stepping, only: stepping_t, first_phase, slide, start_stepping => start
  use dst_straight_slip, only: on_line
  implicit none
  private

  public :: slip_stick_t

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

  !> Slip slower than this share of a slow speed does not matter, whatever its direction. Convention; twice: no change.
  real(wp), parameter :: negligible_share = 1.0e-6_wp

  !> The multiple of its own roundoff by which a load must have grown before it moves the object. Convention; twice: no change.
  real(wp), parameter :: noise_allowance = 10.0_wp
  !> Slip slower than this share of the speed with which it began is over: its square would soon underflow. Twice: no change.
  real(wp), parameter :: faded_share = epsilon(1.0_wp)**2

  !> Motion with rest.
  type, extends(stepping_t) :: slip_stick_t
    !> A stop is finished in closed form below this share of the largest recent slip speed.
    real(wp) :: cut_share = 0.0_wp
    !> Motion in closed form, on nodes at which a polynomial is accurate everywhere.
    type(dense_output_t) :: closed_form
    !> Whether this attempt ends at the lowest point of a shallow dip.
    logical, private :: to_dip = .false.
  contains
    procedure :: go_on
    procedure :: try
    procedure :: set_up
    procedure :: start
    procedure :: begin
    procedure :: reread
    procedure :: first_step
    procedure :: come_to_rest
    procedure :: rest_or_set_off
    procedure :: stop_or_turn
    procedure :: ends_straight
    procedure :: look_at_jump
    procedure :: stay_stuck
    procedure :: finish
    procedure :: set_off
    procedure :: place_at_release
    procedure :: settle
    procedure :: friction_in
  end type slip_stick_t

contains

  !> The system, its drive, and the end [s].
  subroutine set_up(self, slider, drive, t_end)
    class(slip_stick_t), intent(inout) :: self
    type(slider_t), intent(in) :: slider
    type(drive_t), intent(in) :: drive
    real(wp), intent(in) :: t_end

    call self%stepping_t%set_up(slider, drive, t_end)
    self%now%release_step = first_phase*slider%radian_time()
    self%closed_form%grid = chebyshev_grid()
  end subroutine set_up

  !> Place the object at time 0 with elongation `u` and y = (v, theta); its position is X.
  subroutine start(self, u, y, position)
    class(slip_stick_t), intent(inout) :: self
    real(wp), intent(in) :: u(2), y(2), position

    call start_stepping(self, u, y, position)
    if (self%contact == slips .and. .not. self%piece%to%y(1) > 0.0_wp) call self%note_event(slip_begins)
  end subroutine start

  !> Begin with the present state, at rest or in motion.
  subroutine begin(self)
    class(slip_stick_t), intent(inout) :: self

    self%now%just_released = .false.
    if (.not. self%piece%to%y(1) > 0.0_wp) then
      call self%rest_or_set_off(stays_at_rest(self))
      return
    end if
    self%now%next_step = min(self%now%next_step, self%first_step())
    self%now%direction = self%piece%to%y(2)
    call self%system%set_slip_direction(self%now%direction)
    call self%stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
  end subroutine begin

  !> Express the velocity along the axis, of the time in which the drive prescribed the motion across, as slip along a line.
  subroutine reread(self)
    class(slip_stick_t), intent(inout) :: self

    self%piece%to%y(1:2) = on_line(self%piece%to%y(1))
  end subroutine reread

  !> Step size [s] with which a method begins from the present slip speed: the time in which friction alone would stop it.
  pure real(wp) function first_step(self)
    class(slip_stick_t), intent(in) :: self

    first_step = self%piece%to%y(1)*self%slider%mass/max(self%slider%law%kinetic_limit, tiny(1.0_wp))
  end function first_step

  !> At v = 0: rest, or set off in the direction of K u.
  subroutine rest_or_set_off(self, rests)
    class(slip_stick_t), intent(inout) :: self
    logical, intent(in) :: rests

    if (rests) then
      call self%come_to_rest()
    else
      call self%set_off(start_of_slip(self%slider, self%piece%to%u, self%drive_velocity(), self%piece%drive%acceleration))
    end if
  end subroutine rest_or_set_off

  !> Whether the object, which has not moved, or not for so long [s], is held.
  pure logical function stays_at_rest(self, age)
    class(slip_stick_t), intent(in) :: self
    real(wp), intent(in), optional :: age

    stays_at_rest = is_held(self%slider, self%piece%to%u, self%drive_velocity(), self%piece%drive%acceleration, age)
  end function stays_at_rest

  !> How long the object rests at a state [s].
  pure real(wp) function age(self, state)
    class(slip_stick_t), intent(in) :: self
    type(state_t), intent(in) :: state

    age = -state%until(self%now%rest_since)
  end function age

  !> After slip whose speed has fallen to zero: rest, or a turn.
  subroutine stop_or_turn(self)
    class(slip_stick_t), intent(inout) :: self

    associate (now => self%piece%to)
      call self%rest_or_set_off(comes_to_rest(self%slider, now%y(2), now%u, self%drive_velocity(), self%piece%drive%acceleration))
    end associate
  end subroutine stop_or_turn

  !> Where the drive velocity jumps, the force of the dampers jumps: a slip that begins there is accelerated by the excess of their
  !> force over friction, and one that would begin after a stop may not begin.
  subroutine look_at_jump(self)
    class(slip_stick_t), intent(inout) :: self

    if (.not. (self%slider%is_damped() .and. self%now%just_released)) return
    if (self%piece%from%time > self%piece%drive%start .or. self%piece%drive%start <= 0.0_wp) return
    self%now%just_released = .false.
    self%contact = slips
    call self%rest_or_set_off(stays_at_rest(self, age(self, self%piece%to)))
    self%piece%from = self%piece%to
    self%piece%contact = self%contact
  end subroutine look_at_jump

  !> From slip to rest.
  subroutine come_to_rest(self)
    class(slip_stick_t), intent(inout) :: self

    self%piece%to%y = 0.0_wp
    self%now%rest_since = self%piece%to%time
    self%contact = merge(touches, sticks, is_touch(self))
    if (self%contact == sticks) call self%note_event(stick_begins)
  end subroutine come_to_rest

  !> Whether the rest that begins now will last no longer than a touch.
  pure logical function is_touch(self)
    class(slip_stick_t), intent(in) :: self
    real(wp) :: delay

    associate (now => self%piece%to, drive => self%piece%drive)
      delay = release_delay(self%slider, now%u, drive, now%time)
      is_touch = now%time > 0.0_wp .and. delay <= touch_time(self%slider, self%drive_velocity(), drive%acceleration) &
        .and. delay < now%until(min(self%t_end, drive%end))
    end associate
  end function is_touch

  !> At rest until the spring force reaches the static limit or the horizon is reached.
  subroutine stay_stuck(self, horizon)
    class(slip_stick_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    real(wp) :: delay, duration, travel, taken
    logical :: released

    associate (from => self%piece%from, to => self%piece%to, drive => self%piece%drive, k => self%slider%stiffness, &
        coupling => self%system%drive_coupling)
      delay = release_delay(self%slider, from%u, drive, from%time, age(self, from))
      duration = from%until(horizon)
      released = delay < duration
      if (released) released = moves_within(self, delay, duration - delay)
      if (released) duration = delay
      travel = drive%displacement(from%time, duration)
      to%u = from%u + travel*coupling
      call to%later(from, duration)
      if (.not. released) call to%arrive(horizon)
      to%drive_work = from%drive_work + travel*dot_product(k*coupling, 0.5_wp*(from%u + to%u))
      to%damper_work = from%damper_work
      if (self%slider%is_damped()) then
        ! The springs are stretched as fast as the drive moves.
        taken = sum(self%slider%damping*coupling**2)*drive%velocity_square(from%time, duration)
        to%drive_work = to%drive_work + taken
        to%damper_work = from%damper_work + taken
      end if
    end associate
    if (.not. released) then
      ! A rest that was expected to be a touch lasts longer.
      if (self%contact == touches) call self%note_event(stick_begins)
      self%contact = sticks
      return
    end if
    if (self%contact == sticks) call self%note_event(slip_begins)
    call self%set_off(start_at_release(self%slider, self%piece%to%u, self%drive_velocity(), self%piece%drive%acceleration, &
      age(self, self%piece%to)))
  end subroutine stay_stuck

  !> Whether the load grows beyond its own roundoff within `time` [s] of a release that is `delay` away. If it does not, the slip is
  !> undetermined, and the object rests.
  pure logical function moves_within(self, delay, time)
    class(slip_stick_t), intent(in) :: self
    real(wp), intent(in) :: delay, time
    type(slip_start_t) :: beginning

    associate (from => self%piece%from, drive => self%piece%drive)
      beginning = start_of_slip(self%slider, from%u + drive%displacement(from%time, delay)*self%system%drive_coupling, &
        drive%velocity_at(from%time + delay), drive%acceleration)
    end associate
    moves_within = .not. beginning%curvature(1) > 0.0_wp .or. (self%slider%is_damped() .and. beginning%rate(1) > 0.0_wp) &
      .or. beginning%curvature(1)*time > noise_allowance*self%system%acceleration_noise
  end function moves_within

  !> From rest into slip.
  subroutine set_off(self, beginning)
    class(slip_stick_t), intent(inout) :: self
    type(slip_start_t), intent(in) :: beginning

    self%contact = slips
    self%now%just_released = .true.
    self%now%from_dip = .false.
    self%now%slipped = 0.0_wp
    self%now%next_step = self%now%release_step
    ! The load has to grow beyond its own roundoff before it moves the object.
    if (beginning%curvature(1) > 0.0_wp) self%now%next_step = max(self%now%release_step, &
      noise_allowance*self%system%acceleration_noise/beginning%curvature(1))
    self%piece%to%y(1:2) = beginning%y
    self%now%direction = beginning%y(2)
    call self%system%set_slip_direction(self%now%direction)
    call self%stepper%begin_slip(beginning%rate, beginning%curvature)
  end subroutine set_off

  !> Place the object at a release with friction at the angle `theta` [rad]: with a steady drive that is the whole state, except
  !> time, position and works, which are those of `at`.
  subroutine place_at_release(self, theta, at)
    class(slip_stick_t), intent(inout) :: self
    real(wp), intent(in) :: theta
    type(state_t), intent(in) :: at

    self%piece%to = at
    where (self%slider%free > 0.0_wp) self%piece%to%u = self%slider%elongation_at_limit(theta, self%drive_velocity())
    self%piece%to%y = 0.0_wp
    call self%set_off(start_at_release(self%slider, self%piece%to%u, self%drive_velocity(), self%piece%drive%acceleration))
  end subroutine place_at_release

  !> To be called after a step, which may have ended in a stop.
  subroutine settle(self, stopped, truncated)
    class(slip_stick_t), intent(inout) :: self
    logical, intent(in) :: stopped, truncated

    self%now%from_dip = self%to_dip
    self%now%slipped = self%now%slipped + self%stepper%step
    if (stopped) then
      self%now%slip_before = self%now%last_slip
      self%now%last_slip = self%now%slipped
    end if
    if (self%now%just_released .and. .not. truncated) self%now%release_step = self%now%next_step
    self%now%just_released = .false.
    if (stopped) call self%stop_or_turn()
    if (fades(self)) call self%come_to_rest()
  end subroutine settle

  !> Whether slip against a force that grows with the speed, which decays without an end, is negligible: the square of such a share
  !> of the largest slip speed would soon underflow.
  pure logical function fades(self)
    class(slip_stick_t), intent(in) :: self

    fades = .false.
    if (self%contact /= slips .or. self%now%just_released) return
    associate (now => self%piece%to)
      if (now%y(1) <= faded_share*self%stepper%start_speed) fades = stays_at_rest(self)
    end associate
  end function fades

  !> Whether slip from the present state whose speed falls to zero at the elongation `u` [m] may end there in its present direction:
  !> the time that this neglects is to the time up to the end what the speed `cut` [m/s] is to the largest slip speed.
  pure logical function ends_straight(self, u, drive_velocity, cut)
    class(slip_stick_t), intent(in) :: self
    real(wp), intent(in) :: u(2), drive_velocity, cut
    real(wp) :: share

    associate (now => self%piece%to)
      share = max(delay_by_turning(self%slider, now%y(2), now%u, self%drive_velocity()), &
        delay_by_turning(self%slider, now%y(2), u, drive_velocity))
      ends_straight = share*now%y(1) <= max(negligible_share, self%cut_share)*cut
    end associate
  end function ends_straight

  !> The end of slip in closed form as a piece, with its final state.
  subroutine finish(self, stopping, to)
    class(slip_stick_t), intent(inout) :: self
    type(braking_t), intent(in) :: stopping
    type(state_t), intent(in) :: to

    call stopping%describe(self%slider, self%piece%from, self%closed_form)
    call self%piece%path%take(self%closed_form)
    self%piece%to = to
    self%stepper%count%steps = self%stepper%count%steps + 1
    call self%stop_or_turn()
  end subroutine finish

  !> The direction of slip is an unknown.
  pure subroutine friction_in(self, instant)
    class(slip_stick_t), intent(in) :: self
    type(instant_t), intent(inout) :: instant
    real(wp) :: magnitude(1), slope(1)

    call self%slider%law%evaluate(1, [hypot(instant%velocity(1), instant%velocity(2))], magnitude, slope)
    instant%friction = magnitude(1)
    instant%theta = instant%state%y(2)
    if (abs(instant%theta) > pi) instant%theta = instant%theta - 2.0_wp*pi*anint(instant%theta/(2.0_wp*pi))
  end subroutine friction_in

  !> A stretch at rest, the end of slip in closed form, or a step.
  subroutine go_on(self, horizon, error)
    class(slip_stick_t), intent(inout) :: self
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
    class(slip_stick_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    logical, intent(out) :: ended
    type(braking_t) :: stopping
    type(state_t) :: to
    real(wp) :: cut
    logical :: unloaded

    ended = .false.
    if (self%now%just_released) return
    cut = self%cut_share*self%stepper%peak_speed
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
    class(slip_stick_t), intent(in) :: self
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

  !> Attempt a step: to the stop, if the last two slips were alike and predict the stop within the length; else of that length,
  !> shortened to the stop if v reaches zero in it.
  subroutine try(self, step, to, outcome, stopped)
    class(slip_stick_t), intent(inout) :: self
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
    class(slip_stick_t), intent(inout) :: self
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
    class(slip_stick_t), intent(in) :: self
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
    class(slip_stick_t), intent(inout) :: self
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
    class(slip_stick_t), intent(inout) :: self
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
    class(slip_stick_t), intent(in) :: self
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
    class(slip_stick_t), intent(in) :: self
    type(attempt_t), intent(inout) :: outcome
    real(wp) :: coefficient(0:max_degree)

    call dip_coefficients(self, coefficient)
    outcome%solved = first_zero(coefficient(0:self%stepper%grid%degree)) > 1.0_wp
    if (.not. outcome%solved) outcome%factor = missed_factor
  end subroutine refuse_hidden_stop

  !> Bernstein coefficients of v in the last attempt. It rises from the lowest point of a dip; if the polynomial seems to fall
  !> there, within its accuracy, it does not.
  pure subroutine dip_coefficients(self, coefficient)
    class(slip_stick_t), intent(in) :: self
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
    class(slip_stick_t), intent(in) :: self
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
end module dst_slip_stick
