!> Motion by the steps of an integrator, without rest: the smoothed contact, and motion that the drive partly prescribes.
module dst_stepping
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_drive, only: drive_t
  use dst_errors, only: error_t, raise, step_underflow, too_many_rejections
  use dst_kinds, only: wp
  use dst_motion, only: motion_t, serialise_motion, at_time
  use dst_piece, only: slips, sticks
  use dst_slider, only: slider_t, direction_of
  use dst_slip_system, only: slip_system_t
  use dst_state, only: state_t, instant_t
  use dst_text, only: short_text
  use dst_stepper, only: stepper_t, attempt_t, work_count_t
  implicit none
  private

  public :: stepping_t
  ! Procedures of the parent that the extending types call: by name, so that the procedures that these call are the type's own.
  public :: start, slide
  public :: first_phase

  ! The effects of "twice" were measured with radau9, dopri5 and dop853 on Fig. 3 (rtol 1e-6 and 1e-8) and on drives that reverse or
  ! stop.
  !
  !> First step, as phase of the faster oscillation [rad]. Convention. Twice: the same work within 0.2 %, the same error.
  real(wp), parameter :: first_phase = 0.5_wp
  !> Rejections in a row after which the motion is given up: the step is then below 1e-31 of the first. Convention;
  !> twice: no change.
  integer, parameter :: max_rejections = 60
  !> Largest factor after a rejection, and after this many in a row. Conventions. Twice: no change, as the estimate gives a smaller
  !> one; half: 4 to 23 % more work, about the same error. Fig. 3 has no such layer: twice and half no change.
  real(wp), parameter :: rejected_factor = 0.9_wp, timid_factor = 0.25_wp
  integer, parameter :: timid_rejections = 8
  !> If less than this share of a step would remain up to the horizon, the step ends there. Convention; twice: no change.
  real(wp), parameter :: least_remnant = 1.0e-6_wp

  !> What goes on from step to step; some of it only in slip with a rest.
  type :: step_state_t
    real(wp) :: next_step = 0.0_wp      !! size of the next step, s
    !> After the last release: size of the first step [s], time [s], direction of slip [rad].
    real(wp) :: release_step = 0.0_wp, slipped = 0.0_wp, direction = 0.0_wp
    !> When the last rest began [s].
    real(wp) :: rest_since = 0.0_wp
    !> The time of the last slip and of the one before from release to stop [s], 0 if there was none.
    real(wp) :: last_slip = 0.0_wp, slip_before = 0.0_wp
    logical :: just_released = .false.
    !> Whether the last step ended at the lowest point of a shallow dip.
    logical :: from_dip = .false.
  end type step_state_t

  !> A motion by steps.
  type, extends(motion_t) :: stepping_t
    type(step_state_t) :: now
    class(slip_system_t), allocatable :: system
    class(stepper_t), allocatable :: stepper
    real(wp) :: step_max = 0.0_wp       !! s; 0 if there is none
    real(wp) :: fixed_step = 0.0_wp     !! of a method without error estimate, s; 0 for the others
  contains
    procedure :: set_up
    procedure :: start
    procedure :: begin
    procedure :: go_on => slide
    procedure :: take_over
    procedure :: reread
    procedure :: try
    procedure :: settle
    procedure :: note_event
    procedure :: drive_velocity
    procedure :: velocity
    procedure :: instant
    procedure :: instant_of
    procedure :: friction_in
    procedure :: energy
    procedure :: work
    procedure :: is_undecided
    procedure :: serialise => serialise_stepping
  end type stepping_t

contains

  !> The system, its drive, and the end [s].
  subroutine set_up(self, slider, drive, t_end)
    class(stepping_t), intent(inout) :: self
    type(slider_t), intent(in) :: slider
    type(drive_t), intent(in) :: drive
    real(wp), intent(in) :: t_end

    self%slider = slider
    self%drive = drive
    self%t_end = t_end
  end subroutine set_up

  !> Place the object at time 0 with elongation `u` and slip unknowns `y`; its position is X.
  subroutine start(self, u, y, position)
    class(stepping_t), intent(inout) :: self
    real(wp), intent(in) :: u(2), y(2), position

    self%piece%to = state_t(u=u, position=position)
    self%piece%to%y(1:2) = y
    self%piece%from = self%piece%to
    self%piece%drive = self%drive%segment(1)
    call self%piece%obey(self%system)
    self%now%next_step = first_phase*self%slider%radian_time()
    if (self%fixed_step > 0.0_wp) self%now%next_step = self%fixed_step
    call self%begin()
  end subroutine start

  !> Begin with the present state, after a start or when the drive begins to prescribe the motion across.
  subroutine begin(self)
    class(stepping_t), intent(inout) :: self

    call self%stepper%restart([0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp])
  end subroutine begin

  !> Continue from the present state of another motion, with its method.
  subroutine take_over(self, before)
    class(stepping_t), intent(inout) :: self
    class(motion_t), intent(inout) :: before

    select type (before)
    class is (stepping_t)
      call move_alloc(before%stepper, self%stepper)
      self%now%next_step = before%now%next_step
      call self%reread()
    end select
    call self%piece%obey(self%system)
    call self%begin()
  end subroutine take_over

  !> Express the slip unknowns of the previous motion in those of this one: here those of straight slip as the velocity along its
  !> axis.
  subroutine reread(self)
    class(stepping_t), intent(inout) :: self

    associate (y => self%piece%to%y)
      y(1:2) = [y(1)*cos(y(2)), 0.0_wp]
    end associate
  end subroutine reread

  !> One accepted step of the integrator; it ends at the horizon at the latest, or earlier if `try` shortens it.
  subroutine slide(self, horizon, error)
    class(stepping_t), intent(inout) :: self
    real(wp), intent(in) :: horizon
    type(error_t), allocatable, intent(out) :: error
    type(attempt_t) :: outcome
    type(state_t) :: to
    real(wp) :: step, longest, left, wanted
    logical :: truncated, stopped
    integer :: rejections

    longest = 0.0_wp
    left = self%piece%from%until(horizon)
    do rejections = 0, max_rejections
      step = self%now%next_step
      if (self%step_max > 0.0_wp) step = min(step, self%step_max)
      truncated = (1.0_wp + least_remnant)*step >= left
      if (truncated) step = left
      call self%try(step, to, outcome, stopped)
      if (outcome%solved .and. outcome%error <= 1.0_wp) exit
      self%stepper%count%rejected = self%stepper%count%rejected + 1
      ! An initial layer shows the same error until it is resolved: there the estimate reduces the step too little.
      self%now%next_step = self%stepper%step*min(outcome%factor, &
        merge(timid_factor, rejected_factor, rejections >= timid_rejections))
      longest = max(longest, step)
      if (underflows(self, longest)) exit
    end do
    if (.not. (outcome%solved .and. outcome%error <= 1.0_wp)) then
      call give_up(self, rejections, error)
      return
    end if
    truncated = truncated .and. self%stepper%step >= step
    if (truncated) call to%arrive(horizon)
    self%piece%to = to
    call self%piece%path%take(self%stepper)
    call self%stepper%accept()
    self%stepper%count%steps = self%stepper%count%steps + 1
    ! A step shortened by the horizon must not shrink the one after it.
    wanted = self%stepper%step*outcome%factor
    if (truncated) wanted = max(wanted, self%now%next_step)
    if (self%fixed_step > 0.0_wp) wanted = self%fixed_step
    self%now%next_step = wanted
    call self%settle(stopped, truncated)
  end subroutine slide

  !> Attempt a step of this length; if slip can stop, a shorter one that ends in a stop, or none if an event prevents it.
  subroutine try(self, step, to, outcome, stopped)
    class(stepping_t), intent(inout) :: self
    real(wp), intent(in) :: step
    type(state_t), intent(out) :: to
    type(attempt_t), intent(out) :: outcome
    logical, intent(out) :: stopped

    stopped = .false.
    call self%stepper%attempt(self%system, self%piece%drive, self%piece%from, step, to, outcome)
  end subroutine try

  !> The consequences of an accepted step, which may have ended in a stop or may have been shortened by the horizon.
  subroutine settle(self, stopped, truncated)
    class(stepping_t), intent(inout) :: self
    logical, intent(in) :: stopped, truncated

    associate (unused => self%contact, also_unused => [stopped, truncated])
    end associate
  end subroutine settle

  !> Whether the next step is negligible compared with the `longest` one [s] that was tried, and does not move the time either.
  pure logical function underflows(self, longest)
    class(stepping_t), intent(in) :: self
    real(wp), intent(in) :: longest

    associate (time => self%piece%from%time)
      underflows = self%now%next_step <= epsilon(longest)*longest .and. .not. time + self%now%next_step > time
    end associate
  end function underflows

  !> No step was accurate enough, after too many rejections or down to a negligible step.
  pure subroutine give_up(self, rejections, error)
    class(stepping_t), intent(in) :: self
    integer, intent(in) :: rejections
    type(error_t), allocatable, intent(out) :: error
    character(120) :: what

    if (rejections > max_rejections) then
      write (what, '(a,i0,a)') 'more than ', max_rejections, ' steps in a row were rejected at '
      call raise(error, too_many_rejections, trim(what)//' '//trim(at_time(self%piece%from))// &
        ': use a larger rtol or another method')
    else
      what = 'the step size fell to '//trim(short_text(self%now%next_step))//' s without success at'
      call raise(error, step_underflow, trim(what)//' '//trim(at_time(self%piece%from))//': use another method, and '// &
        'check the values and units of the parameters')
    end if
  end subroutine give_up

  !> The piece ends with an event.
  pure subroutine note_event(self, event)
    class(stepping_t), intent(inout) :: self
    integer, intent(in) :: event

    self%piece%event = event
    self%stepper%count%events = self%stepper%count%events + 1
  end subroutine note_event

  !> V [m/s] at the end of the last piece.
  pure real(wp) function drive_velocity(self)
    class(stepping_t), intent(in) :: self

    drive_velocity = self%piece%drive%velocity_at(self%piece%to%time)
  end function drive_velocity

  pure function velocity(self, state)
    class(stepping_t), intent(in) :: self
    type(state_t), intent(in) :: state
    real(wp) :: velocity(2)

    velocity = self%system%slip_velocity(state%y, self%piece%drive%velocity_at(state%time))
  end function velocity

  pure function instant(self, time)
    class(stepping_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(instant_t) :: instant
    integer :: contact

    contact = self%piece%contact
    if (time >= self%piece%to%time) contact = self%contact
    instant = self%instant_of(self%piece%at(time), contact)
  end function instant

  !> A state, in slip or at rest, in plain quantities.
  pure function instant_of(self, state, contact) result(instant)
    class(stepping_t), intent(in) :: self
    type(state_t), intent(in) :: state
    integer, intent(in) :: contact
    type(instant_t) :: instant
    real(wp) :: balance(2)

    instant%state = state
    instant%sticking = contact == sticks
    instant%drive_velocity = self%piece%drive%velocity_at(state%time)
    instant%spring_force = self%slider%stiffness*instant%state%u
    if (contact /= slips) then
      balance = instant%spring_force
      if (self%slider%is_damped()) balance = self%slider%force_at_rest(instant%state%u, instant%drive_velocity)
      instant%friction = hypot(balance(1), balance(2))
      instant%theta = direction_of(balance)
      return
    end if
    instant%velocity = self%velocity(instant%state)
    call self%friction_in(instant)
    ! A rigid spring has the force that the prescribed motion needs.
    associate (prescribed => self%system%prescribed)
      if (abs(prescribed) > 0.0_wp) instant%spring_force(2) = instant%friction*sin(instant%theta) &
        + self%slider%mass*prescribed*self%piece%drive%acceleration
    end associate
  end function instant_of

  !> Magnitude and direction of friction in slip.
  pure subroutine friction_in(self, instant)
    class(stepping_t), intent(in) :: self
    type(instant_t), intent(inout) :: instant
    real(wp) :: speed, magnitude(1), slope(1)

    speed = hypot(instant%velocity(1), instant%velocity(2))
    call self%slider%law%evaluate(1, [speed], magnitude, slope)
    call self%system%own_friction(instant%state%y, magnitude(1))
    instant%friction = magnitude(1)
    if (self%slider%smoothing > 0.0_wp) instant%friction = magnitude(1)*speed/sqrt(speed**2 + self%slider%smoothing)
    instant%theta = direction_of(instant%velocity)
  end subroutine friction_in

  !> Without the motion that the drive prescribes.
  pure real(wp) function energy(self, velocity)
    class(stepping_t), intent(in) :: self
    real(wp), intent(in) :: velocity(2)
    real(wp) :: own(2)

    own = velocity
    if (abs(self%system%prescribed) > 0.0_wp) own(2) = 0.0_wp
    energy = 0.5_wp*(self%slider%mass*sum(own**2) + sum(self%slider%stiffness*self%piece%to%u**2))
  end function energy

  pure function work(self)
    class(stepping_t), intent(in) :: self
    type(work_count_t) :: work

    work = self%stepper%count
  end function work

  pure logical function is_undecided(self)
    class(stepping_t), intent(in) :: self

    is_undecided = self%stepper%is_undecided()
  end function is_undecided

  !> Save or load the data of every motion by steps; the method only if it is not with the motion that alternates with this one.
  subroutine serialise_stepping(self, archive)
    class(stepping_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call serialise_motion(self, archive)
    if (allocated(self%stepper)) call self%stepper%serialise(archive)
    call archive%serialise(c_loc(self%now), storage_size(self%now))
    call self%system%set_slip_direction(self%now%direction)
  end subroutine serialise_stepping
end module dst_stepping
