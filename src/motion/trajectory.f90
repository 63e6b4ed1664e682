!> The motion as a sequence of advances: sliding steps and stuck stretches.
!>
!> One call of `advance` makes one accepted step of the integrator or one stretch at rest, at most
!> up to the next knot of the drive or the end. Afterwards the object tells where it was (`from`),
!> where it is (`now`), whether it stuck in between, what event ended the advance, and the motion
!> at any instant in between.
module dst_trajectory
  use dst_archive, only: archive_t
  use dst_kinds, only: wp, pi
  use dst_errors, only: error_t, raise, step_underflow, too_many_rejections, chattering, release_failed
  use dst_bernstein, only: first_zero, first_minimum, bernstein_value
  use dst_contact, only: load, holds, release_delay, onset_t, onset_of_slip, braking_t, braking, end_of_slip, touch_time, &
    default_cut_speed, &
    release_t, release_series
  use dst_drive, only: drive_t, drive_segment_t
  use dst_interpolation, only: grid_t, new_grid, max_degree
  use dst_slider, only: slider_t
  use dst_slip_system, only: slip_system_t
  use dst_straight_slip, only: on_line
  use dst_stepper, only: stepper_t, motion_t, attempt_t, column_u, column_y, column_position, n_columns
  implicit none
  private

  public :: trajectory_t, no_event, stick_begins, slip_begins, at_time

  !> What happened at the end of an advance.
  integer, parameter :: no_event = 0, stick_begins = 1, slip_begins = 2
  !> Slip speed at the end of a step, relative to the largest one in it: of a landing that has converged (1e-14 in double
  !> precision), and of one that counts as a stop.
  real(wp), parameter :: landed = 10.0_wp**(1 - precision(1.0_wp)), at_rest = 10.0_wp**(6 - precision(1.0_wp))
  !> Lowest slip speed of a dip, relative to the largest one in the step: a shallow dip is decided at its lowest point, and so is
  !> one that seems to stay just above zero.
  real(wp), parameter :: shallow = 0.01_wp, just_above = 1.0e-4_wp
  integer, parameter :: max_landings = 20
  integer, parameter :: max_rejections = 60, timid_rejections = 8
  integer, parameter :: max_events_at_once = 100, max_steps_at_once = 10000

  !> A motion in progress: its equations, its method, where it was and where it is.
  type :: trajectory_t
    type(slider_t) :: slider
    type(drive_t) :: drive
    class(slip_system_t), allocatable :: system
    !> Of a model whose motion across follows the drive: the system for while the drive moves, or that for
    !> while it rests; the one in use is `system`.
    class(slip_system_t), allocatable :: other_system
    class(stepper_t), allocatable :: stepper
    !> Whether the trajectory finds rest and release (exact contact, y = (v, theta)).
    logical :: exact_contact = .true.
    real(wp) :: t_end = 0.0_wp
    real(wp) :: step_max = 0.0_wp
    !> Step size of a method without error estimate [s]; 0 for the others.
    real(wp) :: fixed_step = 0.0_wp
    !> A stop is finished in closed form below this slip speed [m/s] or this share of the largest slip speed of late; an explicit
    !> method with cut_speed = 0 chooses it from the tolerance `cut_rtol`.
    real(wp) :: cut_speed = 0.0_wp
    real(wp) :: cut_share = 0.0_wp
    real(wp) :: cut_rtol = 0.0_wp
    type(motion_t) :: from, now
    logical :: sticking = .false.
    logical :: was_sticking = .false.
    !> Whether the rest is a mere touch, see dst_contact: no stick, and no event.
    logical :: touching = .false., was_touching = .false.
    integer :: event = no_event
    !> Step size wanted next [s].
    real(wp) :: next_step = 0.0_wp
    !> Step size that the first step after a release took last time [s].
    real(wp) :: release_step = 0.0_wp
    logical :: just_released = .false.
    !> Whether the last step ended at the lowest point of a shallow dip, and whether this attempt does.
    logical :: from_dip = .false., to_dip = .false.
    !> How slip starts, for an explicit method that is led through it.
    real(wp) :: release_rate = 0.0_wp
    !> Nodes for the advances that the trajectory makes in closed form.
    type(grid_t) :: closed_form_grid
    integer :: segment = 1
    !> Events and advances since the time last moved.
    integer :: events_at_once = 0
    integer :: steps_at_once = 0
  contains
    procedure :: start
    procedure :: advance
    procedure :: at
    procedure :: finished
    procedure :: drive_segment
    procedure :: may_rest
    procedure :: exchange_systems
    procedure :: exchange
  end type trajectory_t

contains

  !> Place the object at time 0 with elongation `u` and slip unknowns `y`; its position is X.
  subroutine start(self, u, y, position)
    class(trajectory_t), intent(inout) :: self
    real(wp), intent(in) :: u(2), y(2), position

    self%now = motion_t(u=u, y=y, position=position)
    self%from = self%now
    self%release_step = 0.5_wp*sqrt(self%slider%mass/maxval(self%slider%stiffness))
    if (self%fixed_step > 0.0_wp) self%release_step = self%fixed_step
    if (self%exact_contact .or. allocated(self%other_system)) self%closed_form_grid = closed_form_grid()
    self%next_step = self%release_step
    call begin_motion(self)
    if (self%exact_contact .and. .not. (self%sticking .or. self%now%y(1) > 0.0_wp)) call note_event(self, slip_begins)
  end subroutine start

  !> Begin with what `now` holds, at rest or in motion.
  subroutine begin_motion(self)
    class(trajectory_t), intent(inout) :: self

    if (self%exact_contact .and. .not. self%now%y(1) > 0.0_wp) then
      call rest_or_turn(self)
      return
    end if
    if (self%exact_contact) then
      self%next_step = min(self%next_step, self%now%y(1)*self%slider%mass/max(self%slider%law%onset, tiny(1.0_wp)))
      call self%system%face(self%now%y(2))
    end if
    call self%stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
    if (.not. self%stepper%rests_itself .or. any(abs(self%now%y) > 0.0_wp)) return
    if (holds(self%slider, self%now%u, velocity_now(self))) call come_to_rest(self)
  end subroutine begin_motion

  pure logical function finished(self)
    class(trajectory_t), intent(in) :: self

    finished = self%now%time >= self%t_end
  end function finished

  !> The stretch of the drive in which the last advance lay or the next one begins.
  pure function drive_segment(self) result(segment)
    class(trajectory_t), intent(in) :: self
    type(drive_segment_t) :: segment

    segment = self%drive%segment(self%segment)
  end function drive_segment

  pure real(wp) function velocity_now(self)
    class(trajectory_t), intent(in) :: self

    velocity_now = self%drive%segment(self%segment)%velocity_at(self%now%time)
  end function velocity_now

  !> One accepted sliding step or one stuck stretch.
  subroutine advance(self, error)
    class(trajectory_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: horizon
    logical :: passed

    self%event = no_event
    if (self%now%time >= self%drive%segment(self%segment)%end) then
      call enter_segment(self)
      if (self%event /= no_event) return
    end if
    horizon = min(self%t_end, self%drive%segment(self%segment)%end)
    self%from = self%now
    self%was_sticking = self%sticking
    self%was_touching = self%touching
    if (self%sticking .and. .not. self%stepper%rests_itself) then
      call stay_stuck(self, horizon)
    else
      passed = .false.
      if (self%exact_contact) call pass_rest(self, horizon, passed, error)
      if (allocated(error)) return
      if (.not. passed) call slide(self, horizon, error)
    end if
    if (allocated(error)) return
    call watch_progress(self, error)
  end subroutine advance

  !> Past a knot of the drive. If the motion across follows the drive, it may begin there or end; a
  !> beginning that ends a rest is an event, and this the advance.
  subroutine enter_segment(self)
    class(trajectory_t), intent(inout) :: self

    do while (self%now%time >= self%drive%segment(self%segment)%end)
      self%segment = self%segment + 1
    end do
    if (.not. allocated(self%other_system)) return
    if (self%exact_contact .eqv. self%drive%segment(self%segment)%rests) return
    self%from = self%now
    self%was_sticking = self%sticking
    call self%exchange_systems()
    associate (y => self%now%y)
      if (self%exact_contact) then
        y = on_line(y(1))
      else
        y = [y(1)*cos(y(2)), 0.0_wp]
      end if
    end associate
    if (self%sticking .and. .not. self%exact_contact) self%event = slip_begins
    self%sticking = .false.
    call begin_motion(self)
  end subroutine enter_segment

  !> Between the system in which the drive guides the motion across, and the one that can rest.
  pure subroutine exchange_systems(self)
    class(trajectory_t), intent(inout) :: self
    class(slip_system_t), allocatable :: kept

    call move_alloc(self%system, kept)
    call move_alloc(self%other_system, self%system)
    call move_alloc(kept, self%other_system)
    self%exact_contact = .not. self%exact_contact
  end subroutine exchange_systems

  !> Whether the object may come to rest before t_end.
  pure logical function may_rest(self)
    class(trajectory_t), intent(in) :: self
    integer :: i

    may_rest = self%exact_contact
    if (.not. allocated(self%other_system)) return
    do i = 1, size(self%drive%segment)
      associate (segment => self%drive%segment(i))
        may_rest = may_rest .or. segment%start < self%t_end .and. segment%rests
      end associate
    end do
  end function may_rest

  !> Steps shorter than the resolution of the time are legitimate where the mass is small, but not
  !> without end; nor are events.
  subroutine watch_progress(self, error)
    class(trajectory_t), intent(inout) :: self
    type(error_t), allocatable, intent(inout) :: error

    if (self%now%time > self%from%time) then
      self%events_at_once = 0
      self%steps_at_once = 0
      return
    end if
    self%steps_at_once = self%steps_at_once + 1
    if (self%event /= no_event) self%events_at_once = self%events_at_once + 1
    if (self%events_at_once > max_events_at_once .or. self%steps_at_once > max_steps_at_once) &
      call raise(error, chattering, 'the contact chatters: time stands still at '//trim(at_time(self%now))// &
        ': use a smaller rtol, another method, or contact = ''smoothed''')
  end subroutine watch_progress

  !> The motion at a time [s] inside the last advance.
  pure function at(self, time) result(motion)
    class(trajectory_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(motion_t) :: motion

    associate (drive => self%drive%segment(self%segment), elapsed => self%from%until(time))
      if (time >= self%now%time) then
        motion = self%now
      else if (self%was_sticking) then
        motion = self%from
        motion%u = motion%u + drive%displacement(self%from%time, elapsed)*self%system%along
      else
        motion = self%stepper%dense(self%system, drive, self%from, min(1.0_wp, max(0.0_wp, elapsed/self%stepper%step)))
      end if
    end associate
    motion%time = time
  end function at

  !> At rest until the spring force reaches the static limit or the horizon comes.
  subroutine stay_stuck(self, horizon)
    class(trajectory_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    real(wp) :: delay, duration, travel
    type(onset_t) :: onset
    logical :: released

    associate (drive => self%drive%segment(self%segment), k => self%slider%stiffness)
      delay = release_delay(self%slider, self%from%u, drive, self%from%time)
      duration = self%from%until(horizon)
      released = delay < duration
      if (released) released = moves_within(self, delay, duration - delay)
      if (released) duration = delay
      travel = drive%displacement(self%from%time, duration)
      self%now%u = self%from%u + travel*self%system%along
      call self%now%later(self%from, duration)
      if (.not. released) call arrive(self%now, horizon)
      self%now%drive_work = self%from%drive_work + travel*dot_product(k*self%system%along, &
        0.5_wp*(self%from%u + self%now%u))
    end associate
    ! What was thought to be a touch lasts.
    if (self%touching .and. .not. released) call note_event(self, stick_begins)
    if (released) then
      if (.not. self%touching) call note_event(self, slip_begins)
      onset = onset_of_slip(self%slider, self%now%u, velocity_now(self))
      ! The release is where |K u| = F_0 by definition: no excess from roundoff.
      onset%rate(1) = 0.0_wp
      call set_off(self, onset)
    end if
    self%touching = .false.
  end subroutine stay_stuck

  !> At the horizon [s] exactly.
  pure subroutine arrive(motion, horizon)
    type(motion_t), intent(inout) :: motion
    real(wp), intent(in) :: horizon

    motion%time = horizon
    motion%time_rest = 0.0_wp
  end subroutine arrive

  pure subroutine note_event(self, event)
    class(trajectory_t), intent(inout) :: self
    integer, intent(in) :: event

    self%event = event
    self%stepper%count%events = self%stepper%count%events + 1
  end subroutine note_event

  !> Whether the load grows beyond its own roundoff within `time` [s] of a release that is `delay` away. If it does not, nothing can
  !> be said of the slip, and the object rests.
  pure logical function moves_within(self, delay, time)
    class(trajectory_t), intent(in) :: self
    real(wp), intent(in) :: delay, time
    type(onset_t) :: onset

    associate (drive => self%drive%segment(self%segment))
      onset = onset_of_slip(self%slider, self%from%u + drive%displacement(self%from%time, delay)*self%system%along, &
        drive%velocity_at(self%from%time + delay))
    end associate
    moves_within = .not. onset%curvature(1) > 0.0_wp .or. onset%curvature(1)*time > 10.0_wp*self%system%acceleration_noise
  end function moves_within

  !> From rest into slip.
  subroutine set_off(self, onset)
    class(trajectory_t), intent(inout) :: self
    type(onset_t), intent(in) :: onset

    self%sticking = .false.
    self%from_dip = .false.
    self%just_released = .true.
    self%next_step = self%release_step
    ! The load has to grow beyond its own roundoff before it moves anything.
    if (onset%curvature(1) > 0.0_wp .and. .not. self%fixed_step > 0.0_wp) self%next_step = max(self%release_step, &
      10.0_wp*self%system%acceleration_noise/onset%curvature(1))
    self%release_rate = onset%rate(1)
    self%now%y = onset%y
    call self%system%face(onset%y(2))
    call self%stepper%restart(onset%rate, onset%curvature)
  end subroutine set_off

  !> From slip to rest.
  subroutine come_to_rest(self)
    class(trajectory_t), intent(inout) :: self

    self%sticking = .true.
    self%now%y = 0.0_wp
    self%touching = .false.
    if (.not. self%stepper%rests_itself) self%touching = touches(self)
    if (.not. self%touching) call note_event(self, stick_begins)
  end subroutine come_to_rest

  !> Whether the rest that begins now will last no longer than a touch.
  pure logical function touches(self)
    class(trajectory_t), intent(in) :: self
    real(wp) :: delay

    associate (drive => self%drive%segment(self%segment))
      delay = release_delay(self%slider, self%now%u, drive, self%now%time)
      touches = self%now%time > 0.0_wp .and. delay <= touch_time(self%slider, velocity_now(self)) &
        .and. delay < self%now%until(min(self%t_end, drive%end))
    end associate
  end function touches

  !> One accepted step of the integrator; it ends at the horizon at the latest, and at v = 0.
  subroutine slide(self, horizon, error)
    class(trajectory_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error
    type(attempt_t) :: outcome
    type(motion_t) :: to
    real(wp) :: step, longest, left
    logical :: truncated, stopped
    integer :: rejections

    longest = 0.0_wp
    left = self%from%until(horizon)
    do rejections = 0, max_rejections
      step = self%next_step
      if (self%step_max > 0.0_wp) step = min(step, self%step_max)
      truncated = 1.000001_wp*step >= left
      if (truncated) step = left
      call self%stepper%attempt(self%system, self%drive%segment(self%segment), self%from, step, to, outcome)
      stopped = .false.
      if (outcome%solved .and. self%exact_contact) then
        if (self%stepper%explicit) then
          call keep_moving(self, outcome)
        else
          call look_for_stop(self, to, outcome, stopped)
        end if
      end if
      if (outcome%solved .and. outcome%error <= 1.0_wp) exit
      self%stepper%count%rejected = self%stepper%count%rejected + 1
      ! An initial layer shows the same error until it is resolved: there the estimate's advice is too timid.
      self%next_step = self%stepper%step*min(outcome%factor, merge(0.25_wp, 0.9_wp, rejections >= timid_rejections))
      longest = max(longest, step)
      if (underflows(self, longest)) exit
    end do
    if (.not. (outcome%solved .and. outcome%error <= 1.0_wp)) then
      call give_up(self, rejections, error)
      return
    end if
    truncated = truncated .and. self%stepper%step >= step
    if (truncated) call arrive(to, horizon)
    self%now = to
    self%from_dip = self%to_dip
    call self%stepper%accept()
    self%stepper%count%steps = self%stepper%count%steps + 1
    call choose_next_step(self, outcome%factor, truncated)
    if (self%stepper%rests_itself) then
      call note_rest(self)
    else if (stopped) then
      call rest_or_turn(self)
    end if
    if (fades(self)) call come_to_rest(self)
  end subroutine slide

  !> Whether the next step is so much shorter than the `longest` [s] that was tried that it is none, and does not move
  !> the time either.
  pure logical function underflows(self, longest)
    class(trajectory_t), intent(in) :: self
    real(wp), intent(in) :: longest

    underflows = self%next_step <= epsilon(longest)*longest .and. .not. self%from%time + self%next_step > self%from%time
  end function underflows

  !> No step was good enough, after so many rejections or down to a step that is none.
  pure subroutine give_up(self, rejections, error)
    class(trajectory_t), intent(in) :: self
    integer, intent(in) :: rejections
    type(error_t), allocatable, intent(out) :: error
    character(120) :: what

    if (rejections > max_rejections) then
      write (what, '(a,i0,a)') 'more than ', max_rejections, ' steps in a row were rejected at '
      call raise(error, too_many_rejections, trim(what)//' '//trim(at_time(self%from))//': use a larger rtol or another method')
    else
      write (what, '(a,es8.1,a)') 'the step size fell to ', self%next_step, ' s without success at'
      call raise(error, step_underflow, trim(what)//' '//trim(at_time(self%from))//': use another method, and see whether the '// &
        'parameters are meant')
    end if
  end subroutine give_up

  !> Whether slip against a force that grows with the speed, which dies away without an end, is over by any measure: the
  !> square of such a share of the largest slip speed would soon underflow.
  pure logical function fades(self)
    class(trajectory_t), intent(in) :: self

    fades = .false.
    if (.not. self%exact_contact .or. self%sticking .or. self%just_released) return
    if (self%now%y(1) <= epsilon(1.0_wp)**2*self%stepper%start_speed) fades = holds(self%slider, self%now%u, velocity_now(self))
  end function fades

  !> Whether the object is at rest now, as the method has found it, and the event that this is. A step that ends with w = 0
  !> under more load than friction can hold is a turn.
  subroutine note_rest(self)
    class(trajectory_t), intent(inout) :: self
    logical :: at_rest_now

    at_rest_now = .not. any(abs(self%now%y) > 0.0_wp) .and. &
      load(self%slider, self%now%u) <= self%slider%law%onset*(1.0_wp + 4.0_wp*epsilon(1.0_wp))
    if (at_rest_now .and. .not. self%sticking) then
      call come_to_rest(self)
    else if (self%sticking .and. .not. at_rest_now) then
      self%sticking = .false.
      call note_event(self, slip_begins)
    end if
    self%was_sticking = self%was_sticking .and. at_rest_now
  end subroutine note_rest

  !> Slip speed [m/s] below which a stop is finished in closed form.
  pure real(wp) function cut_level(self)
    class(trajectory_t), intent(in) :: self

    cut_level = max(self%cut_speed, self%cut_share*self%stepper%peak_speed)
    if (self%stepper%explicit .and. .not. self%cut_speed > 0.0_wp) &
      cut_level = max(cut_level, default_cut_speed(self%cut_rtol, velocity_now(self), self%stepper%peak_speed))
  end function cut_level

  !> Slip speed [m/s] that is slow for an explicit method by the drive's measure, whatever the motion so far.
  pure real(wp) function slow_for_drive(self)
    class(trajectory_t), intent(in) :: self

    slow_for_drive = 0.0_wp
    if (self%stepper%explicit) slow_for_drive = default_cut_speed(self%cut_rtol, velocity_now(self), abs(velocity_now(self)))
  end function slow_for_drive

  !> The step size that the controller wants; a step cut short by the horizon may not shrink it.
  pure subroutine choose_next_step(self, factor, truncated)
    class(trajectory_t), intent(inout) :: self
    real(wp), intent(in) :: factor
    logical, intent(in) :: truncated
    real(wp) :: wanted

    wanted = self%stepper%step*factor
    if (truncated) wanted = max(wanted, self%next_step)
    if (self%fixed_step > 0.0_wp) wanted = self%fixed_step
    if (self%just_released .and. .not. truncated) self%release_step = wanted
    self%next_step = wanted
    self%just_released = .false.
  end subroutine choose_next_step

  !> Shorten an attempt in which v reaches zero so that it ends there. Whether a shallow dip reaches zero, the dense output cannot
  !> tell: such an attempt is first shortened to the lowest point, for what is known at the end of a step decides.
  subroutine look_for_stop(self, to, outcome, stopped)
    class(trajectory_t), intent(inout) :: self
    type(motion_t), intent(inout) :: to
    type(attempt_t), intent(inout) :: outcome
    logical, intent(out) :: stopped
    real(wp) :: zero, lowest, depth, reach, curvature

    stopped = .false.
    self%to_dip = .false.
    if (self%just_released) then
      outcome%solved = moves_off(self)
      if (.not. outcome%solved) outcome%factor = 0.25_wp
      return
    end if
    call find_dip(self, zero, lowest, depth)
    reach = min(lowest, 1.0_wp)*self%stepper%step
    if (lowest < 1.0_wp .and. -just_above <= depth .and. depth <= shallow) then
      call settle_on_lowest(self, reach, self%stepper%step, to, outcome, curvature)
      if (.not. outcome%solved) return
      self%to_dip = to%y(1) > 0.0_wp
      if (self%to_dip) then
        call refuse_hidden_stop(self, outcome)
        return
      end if
      reach = self%stepper%step
      call land(self, max(0.5_wp*reach, reach - sqrt(2.0_wp*abs(to%y(1))/curvature)), reach, to, outcome, stopped)
    else if (zero <= 1.0_wp) then
      call land(self, zero*self%stepper%step, reach, to, outcome, stopped)
    end if
    if (outcome%solved .and. .not. stopped) call refuse_hidden_stop(self, outcome)
  end subroutine look_for_stop

  !> Where the slip speed of the last attempt first passes through zero and where, after that, it is lowest, as positions in the
  !> attempt, 2 if nowhere; and how far below zero that is, relative to the largest speed.
  pure subroutine find_dip(self, zero, lowest, depth)
    class(trajectory_t), intent(in) :: self
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
    class(trajectory_t), intent(inout) :: self
    real(wp), intent(in) :: guess, longest
    type(motion_t), intent(inout) :: to
    type(attempt_t), intent(inout) :: outcome
    real(wp), intent(out) :: curvature
    real(wp) :: step, next, slope
    integer :: iteration

    step = guess
    curvature = 0.0_wp
    do iteration = 1, max_landings
      call self%stepper%attempt(self%system, self%drive%segment(self%segment), self%from, step, to, outcome)
      if (.not. outcome%solved) exit
      call end_slope(self, slope, curvature)
      outcome%solved = curvature > 0.0_wp
      if (.not. outcome%solved) exit
      if (slope**2 <= landed*self%stepper%speed_scale*curvature) exit
      next = min(longest, max(0.5_wp*step, step - slope/curvature))
      if (.not. abs(next - step) > epsilon(step)*step) exit
      step = next
    end do
  end subroutine settle_on_lowest

  !> First and second derivative of v with time at the end of the last attempt [m/s2, m/s3].
  pure subroutine end_slope(self, slope, curvature)
    class(trajectory_t), intent(in) :: self
    real(wp), intent(out) :: slope, curvature
    real(wp) :: rate(0:max_degree)
    integer :: i

    rate = 0.0_wp
    associate (grid => self%stepper%grid, s => self%stepper%grid%degree)
      do i = 0, s
        rate(i) = dot_product(grid%derivative(i, 0:s), self%stepper%nodal(0:s, column_y))/self%stepper%step
      end do
      slope = rate(s)
      curvature = dot_product(grid%derivative(s, 0:s), rate(0:s))/self%stepper%step
    end associate
  end subroutine end_slope

  !> Repeat the step with the length, at most `longest` [s], at which v vanishes at its end, so that the event has the accuracy
  !> of a step's end and not only that of the dense output. Newton's method, kept between a speed above and one below zero.
  subroutine land(self, guess, longest, to, outcome, stopped)
    class(trajectory_t), intent(inout) :: self
    real(wp), intent(in) :: guess, longest
    type(motion_t), intent(inout) :: to
    type(attempt_t), intent(inout) :: outcome
    logical, intent(out) :: stopped
    real(wp) :: step, next, before, behind, slope, curvature
    integer :: iteration

    stopped = .false.
    step = guess
    before = 0.0_wp
    behind = longest
    do iteration = 1, max_landings
      call self%stepper%attempt(self%system, self%drive%segment(self%segment), self%from, step, to, outcome)
      if (.not. outcome%solved) return
      if (abs(to%y(1)) <= landed*self%stepper%speed_scale .or. iteration == max_landings) exit
      if (to%y(1) > 0.0_wp) then
        before = step
      else
        behind = step
      end if
      call end_slope(self, slope, curvature)
      next = step - to%y(1)/slope
      if (abs(next - step) <= 2.0_wp*epsilon(step)*step) exit
      if (.not. (next > before .and. next < behind)) next = 0.5_wp*(before + behind)
      if (.not. behind - before > 2.0_wp*epsilon(step)*behind) exit
      step = next
    end do
    stopped = abs(to%y(1)) <= at_rest*self%stepper%speed_scale
  end subroutine land

  !> A dip that does not reach zero after all; but v may not have passed through it either.
  pure subroutine refuse_hidden_stop(self, outcome)
    class(trajectory_t), intent(in) :: self
    type(attempt_t), intent(inout) :: outcome
    real(wp) :: coefficient(0:max_degree)

    call dip_coefficients(self, coefficient)
    outcome%solved = first_zero(coefficient(0:self%stepper%grid%degree)) > 1.0_wp
    if (.not. outcome%solved) outcome%factor = 0.25_wp
  end subroutine refuse_hidden_stop

  !> Bernstein coefficients of v in the last attempt. It rises from the lowest point of a dip; where the polynomial seems to fall there,
  !> within its accuracy, it does not.
  pure subroutine dip_coefficients(self, coefficient)
    class(trajectory_t), intent(in) :: self
    real(wp), intent(out) :: coefficient(0:max_degree)
    integer :: half

    associate (grid => self%stepper%grid)
      call grid%bernstein_coefficients(self%stepper%nodal(:, column_y), coefficient)
      if (.not. self%from_dip) return
      half = (grid%degree + 1)/2
      coefficient(0:half) = coefficient(0:half) + shallow*self%stepper%speed_scale
    end associate
  end subroutine dip_coefficients

  !> Whether the first step after a release has v > 0 throughout, roundoff apart; a step that is too
  !> long may have found the other branch. v begins with 0, so v/tau has the Bernstein coefficients b_i s/i, i = 1 ... s. It begins
  !> with 0 as well, up to the accuracy of the polynomial: what seems negative there is none.
  pure logical function moves_off(self)
    class(trajectory_t), intent(in) :: self
    real(wp) :: coefficient(0:max_degree)
    integer :: i

    associate (grid => self%stepper%grid, s => self%stepper%grid%degree, &
        noise => 10.0_wp*self%system%acceleration_noise*self%stepper%step)
      call grid%bernstein_coefficients(self%stepper%nodal(:, column_y), coefficient)
      do i = 1, s
        coefficient(i) = coefficient(i)*real(s, wp)/real(i, wp) + noise
        if (i <= (s + 1)/2) coefficient(i) = coefficient(i) + shallow*self%stepper%speed_scale
      end do
      moves_off = self%stepper%nodal(s, column_y) > 0.0_wp .and. first_zero(coefficient(1:s)) > 1.0_wp
    end associate
  end function moves_off

  !> At v = 0: rest, or go on in the direction of K u.
  subroutine rest_or_turn(self)
    class(trajectory_t), intent(inout) :: self
    type(onset_t) :: onset

    if (holds(self%slider, self%now%u, velocity_now(self))) then
      call come_to_rest(self)
    else
      onset = onset_of_slip(self%slider, self%now%u, velocity_now(self))
      call set_off(self, onset)
    end if
  end subroutine rest_or_turn

  !> Slip slower than the cut-off that is about to end, in closed form; for an explicit method the start of slip as well.
  !> `passed` tells that this was the advance.
  !>
  !> Slip against K u ends without a rest, in a turn. It is left to the method until it is so slow that
  !> it does not matter how the direction changes. For an explicit method it then counts as none; so does slip that a knot
  !> of the drive has caught just after its release.
  subroutine pass_rest(self, horizon, passed, error)
    class(trajectory_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    logical, intent(out) :: passed
    type(error_t), allocatable, intent(out) :: error
    type(motion_t) :: to
    type(braking_t) :: course
    logical :: falls, negligible, at_knot
    real(wp), parameter :: negligible_share = 1.0e-6_wp

    passed = .true.
    if (self%just_released) then
      passed = self%stepper%explicit
      if (passed) call follow_release(self, horizon, error)
      return
    end if
    associate (v => self%now%y(1), cut => cut_level(self), drive => self%drive%segment(self%segment))
      passed = v <= cut
      passed = passed .or. v <= negligible_share*slow_for_drive(self)
      if (.not. passed) return
      course = braking(self%slider, drive, self%now)
      to = end_of_slip(self%slider, drive, self%now, course)
      falls = course%falls .and. course%steady .and. course%highest <= cut .and. course%delay <= self%now%until(horizon) &
        .and. (self%stepper%explicit .or. course%acceleration < 0.0_wp)
      negligible = v <= negligible_share*max(cut, slow_for_drive(self))
      at_knot = .not. self%now%time > drive%start
      if (falls .and. (negligible .or. holds(self%slider, to%u, velocity_now(self)))) then
        call describe_braking(self, course, to)
        self%now = to
        call rest_or_turn(self)
      else if (self%stepper%explicit .and. negligible .and. (at_knot .or. course%acceleration < 0.0_wp)) then
        v = 0.0_wp
        call rest_or_turn(self)
      else
        passed = .false.
      end if
    end associate
  end subroutine pass_rest

  !> The start of slip as power series, as one advance.
  subroutine follow_release(self, horizon, error)
    class(trajectory_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error
    type(release_t) :: release
    type(motion_t) :: motion
    real(wp) :: nodal(0:max_degree, n_columns), tau, duration, left
    integer :: i

    self%just_released = .false.
    associate (drive => self%drive%segment(self%segment), grid => self%closed_form_grid)
      release = release_series(self%slider, drive, self%from, self%release_rate, self%stepper%release_tolerance)
      if (.not. release%moves .and. load(self%slider, self%from%u) > 0.0_wp) then
        ! As much force as friction, and no growth: it stays.
        call come_to_rest(self)
        return
      end if
      if (.not. release%accurate) then
        call raise(error, release_failed, 'slip does not start smoothly enough for an explicit method at '// &
          trim(at_time(self%from))//': use a Radau method')
        return
      end if
      left = self%from%until(horizon)
      duration = min(release%reach*release%unit, left)
      do i = 0, grid%degree
        tau = grid%node(i)*(duration/release%unit)
        motion = release%at(self%slider, drive, self%from, tau)
        nodal(i, column_u:column_u + 1) = motion%u &
          - drive%displacement(self%from%time, tau*release%unit)*self%slider%pulled()
        nodal(i, column_y:column_y + 1) = motion%y
        nodal(i, column_position) = motion%position
      end do
      self%now = motion
      call self%now%later(self%from, duration)
      if (duration >= left) call arrive(self%now, horizon)
    end associate
    call self%stepper%describe(self%closed_form_grid, duration, nodal)
    self%stepper%count%steps = self%stepper%count%steps + 1
    call self%stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
    self%stepper%start_speed = self%now%y(1)
    self%stepper%peak_speed = self%now%y(1)
    self%next_step = min(self%release_step, self%now%y(1)*self%slider%mass/max(self%slider%law%onset, tiny(1.0_wp)))
    if (self%fixed_step > 0.0_wp) self%next_step = self%fixed_step
  end subroutine follow_release

  !> The end of slip as an advance: the motion inside it, and its works with u and F(v) varying.
  subroutine describe_braking(self, course, to)
    class(trajectory_t), intent(inout) :: self
    type(braking_t), intent(in) :: course
    type(motion_t), intent(inout) :: to
    real(wp) :: nodal(0:max_degree, n_columns), friction(1), slope(1), direction(2), time, slipped
    integer :: i

    associate (v => self%from%y(1), theta => self%from%y(2), grid => self%closed_form_grid)
      direction = [cos(theta), sin(theta)]
      slipped = 0.0_wp
      do i = 0, grid%degree
        time = grid%node(i)*course%delay
        slipped = time*(v + time*(0.5_wp*course%acceleration + time*course%jerk/6.0_wp))
        nodal(i, column_u:column_u + 1) = self%from%u - slipped*self%slider%follows*direction
        nodal(i, column_y) = max(0.0_wp, v + time*(course%acceleration + 0.5_wp*time*course%jerk))
        nodal(i, column_y + 1) = theta
        nodal(i, column_position) = self%from%position + slipped*dot_product(self%slider%along, direction)
      end do
      call self%stepper%describe(grid, course%delay, nodal)
      call self%slider%law%evaluate(1, [v], friction, slope)
      to%friction_work = self%from%friction_work + self%slider%law%onset*slipped + slope(1)*v**2*course%delay/3.0_wp
      to%drive_work = self%from%drive_work &
        + self%drive%segment(self%segment)%displacement(self%from%time, course%delay) &
        *dot_product(self%system%along_stiffness, 0.5_wp*(self%from%u + to%u)) &
        + slipped*dot_product(self%slider%held_force(self%from%u), direction)
    end associate
    self%stepper%count%steps = self%stepper%count%steps + 1
  end subroutine describe_braking

  !> Refuse an attempt in which v reaches zero, so that the next one ends before that.
  subroutine keep_moving(self, outcome)
    class(trajectory_t), intent(in) :: self
    type(attempt_t), intent(inout) :: outcome
    real(wp) :: coefficient(0:max_degree), position

    if (outcome%error > 1.0_wp) return
    associate (grid => self%stepper%grid)
      call grid%bernstein_coefficients(self%stepper%nodal(:, column_y), coefficient)
      position = first_zero(coefficient(0:grid%degree))
    end associate
    if (position > 1.0_wp) return
    outcome%solved = .false.
    outcome%factor = max(0.1_wp, 0.95_wp*position)
  end subroutine keep_moving

  !> Nodes at which a polynomial is well known everywhere: the extrema of Chebyshev's.
  pure function closed_form_grid() result(grid)
    type(grid_t) :: grid
    integer :: i

    grid = new_grid([(sin(0.5_wp*pi*real(i, wp)/real(max_degree, wp))**2, i=0, max_degree)])
  end function closed_form_grid

  !> 't = 1.25 s (u = … m, y = …)'. Of fixed length: gfortran keeps the length of an allocatable text that a function returns
  !> in static storage, and several threads advance at once.
  pure character(160) function at_time(motion) result(text)
    type(motion_t), intent(in) :: motion

    write (text, '(a,es24.16e3,a,2es25.16e3,a,2es25.16e3,a)') 't =', motion%time, ' s (u =', motion%u, ' m, slip', motion%y, ')'
  end function at_time

  !> Save or load what changes on the way; the rest follows from the scene.
  subroutine exchange(self, archive)
    class(trajectory_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive
    logical :: exact_contact

    exact_contact = self%exact_contact
    call archive%exchange(exact_contact)
    if (allocated(self%other_system) .and. (exact_contact .neqv. self%exact_contact)) call self%exchange_systems()
    call self%system%exchange(archive)
    call self%stepper%exchange(archive)
    call self%from%exchange(archive)
    call self%now%exchange(archive)
    call archive%exchange(self%sticking)
    call archive%exchange(self%was_sticking)
    call archive%exchange(self%touching)
    call archive%exchange(self%was_touching)
    call archive%exchange(self%event)
    call archive%exchange(self%next_step)
    call archive%exchange(self%release_step)
    call archive%exchange(self%just_released)
    call archive%exchange(self%from_dip)
    call archive%exchange(self%release_rate)
    call archive%exchange(self%segment)
    call archive%exchange(self%events_at_once)
    call archive%exchange(self%steps_at_once)
  end subroutine exchange
end module dst_trajectory
