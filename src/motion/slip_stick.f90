!> Slip, rest and release of the exact contact, in the unknowns y = (v, theta). implicit_slip_t and explicit_slip_t integrate the
!> slip.
module dst_slip_stick
  use dst_braking, only: braking_t
  use dst_dense_output, only: dense_output_t
  use dst_drive, only: drive_t
  use dst_interpolation, only: chebyshev_grid
  use dst_kinds, only: wp, pi
  use dst_piece, only: stick_begins, slip_begins, slips, touches, sticks
  use dst_rest, only: is_held, comes_to_rest, delay_by_turning, release_delay, slip_start_t, start_at_release, start_of_slip, &
    touch_time
  use dst_slider, only: slider_t
  use dst_state, only: state_t, instant_t
  use dst_stepping, only: stepping_t, first_phase, start_stepping => start
  use dst_straight_slip, only: on_line
  implicit none
  private

  public :: slip_stick_t, negligible_share, noise_allowance
  ! Procedures of the parent that the extending types call.
  public :: set_off, settle

  !> Slip slower than this share of a slow speed does not matter, whatever its direction. Convention; twice: no change.
  real(wp), parameter :: negligible_share = 1.0e-6_wp

  !> The multiple of its own roundoff by which a load must have grown before it moves the object. Convention; twice: no change.
  real(wp), parameter :: noise_allowance = 10.0_wp
  !> Slip slower than this share of the speed with which it began is over: its square would soon underflow. Twice: no change.
  real(wp), parameter :: faded_share = epsilon(1.0_wp)**2

  !> Motion with rest.
  type, abstract, extends(stepping_t) :: slip_stick_t
    !> A stop is finished in closed form below this slip speed [m/s] or this share of the largest recent slip speed.
    real(wp) :: cut_speed = 0.0_wp
    real(wp) :: cut_share = 0.0_wp
    !> Motion in closed form, on nodes at which a polynomial is accurate everywhere.
    type(dense_output_t) :: closed_form
  contains
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
    self%piece%to%u = self%slider%elongation_at_limit(theta, self%drive_velocity())
    self%piece%to%y = 0.0_wp
    call self%set_off(start_at_release(self%slider, self%piece%to%u, self%drive_velocity(), self%piece%drive%acceleration))
  end subroutine place_at_release

  !> To be called after a step, which may have ended in a stop.
  subroutine settle(self, stopped, truncated)
    class(slip_stick_t), intent(inout) :: self
    logical, intent(in) :: stopped, truncated

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
    associate (theta => instant%state%y(2))
      instant%theta = theta - 2.0_wp*pi*anint(theta/(2.0_wp*pi))
    end associate
  end subroutine friction_in
end module dst_slip_stick
