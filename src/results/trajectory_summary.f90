!> The summary of a single run: what dst_summary looks at, read from the trajectory.
module dst_trajectory_summary
  use dst_archive, only: archive_t
  use dst_kinds, only: wp
  use dst_observables, only: slip_velocity, drive_velocity
  use dst_stepper, only: motion_t, work_count_t
  use dst_summary, only: summary_t, energies_t, moment_t, stretch_t, summary_quantities, summary_values
  use dst_trajectory, only: trajectory_t, stick_begins
  use dst_writer, only: quantity_t, outcome_t
  implicit none
  private

  public :: trajectory_summary_t, statistics

  !> The work done, in the order of `describe`.
  type(quantity_t), parameter :: statistics(*) = [ &
    quantity_t('steps', '1', 'accepted steps'), &
    quantity_t('rejected', '1', 'rejected steps'), &
    quantity_t('rhs', '1', 'evaluations of the equations of motion'), &
    quantity_t('jacobians', '1', 'evaluations of the Jacobian of a step'), &
    quantity_t('factorisations', '1', 'factorised linear systems'), &
    quantity_t('newton', '1', 'Newton iterations'), &
    quantity_t('events', '1', 'stick and slip events'), &
    quantity_t('wall_time', 's', 'wall time of the run')]

  !> What is known of a run so far.
  type, extends(summary_t) :: trajectory_summary_t
    !> Slip velocity at the end of the last advance [m/s].
    real(wp), private :: velocity(2) = 0.0_wp
  contains
    procedure :: start
    procedure :: follow
    procedure :: values
    procedure :: describe
    procedure :: exchange
  end type trajectory_summary_t

  !> The last advance of a trajectory.
  type, extends(stretch_t) :: advance_t
    type(trajectory_t), pointer :: trajectory => null()
  contains
    procedure :: at
    procedure :: friction
  end type advance_t

contains

  !> Begin with a trajectory that has been started.
  subroutine start(self, trajectory)
    class(trajectory_summary_t), intent(inout) :: self
    type(trajectory_t), intent(in) :: trajectory

    self%velocity = velocity_now(trajectory)
    associate (slider => trajectory%slider)
      ! High frequency: the longitudinal load is given.
      call self%cycles%begin(slider%along(1)*merge(1.0_wp, 0.0_wp, slider%follows(1) > 0.0_wp), slider%law%onset, &
        slider%stiffness(1), slider%mass)
    end associate
    call self%begin(moment_of(trajectory, trajectory%now, self%velocity), energy(trajectory, self%velocity), trajectory%t_end)
    if (trajectory%event == stick_begins) self%sticks = 1
  end subroutine start

  !> Take in the trajectory's last advance.
  subroutine follow(self, trajectory)
    class(trajectory_summary_t), intent(inout) :: self
    type(trajectory_t), intent(in), target :: trajectory
    type(advance_t) :: advance

    advance%trajectory => trajectory
    advance%sticking = trajectory%was_sticking
    advance%first = moment_of(trajectory, trajectory%from, self%velocity)
    self%velocity = velocity_now(trajectory)
    advance%last = moment_of(trajectory, trajectory%now, self%velocity)
    self%exchanged = self%exchanged + abs(trajectory%now%drive_work - trajectory%from%drive_work) + &
      abs(trajectory%now%friction_work - trajectory%from%friction_work)
    if (trajectory%event == stick_begins) self%sticks = self%sticks + 1
    if (self%undecided_from < 0.0_wp .and. trajectory%stepper%is_undecided()) self%undecided_from = trajectory%now%time
    call self%take_in(advance)
  end subroutine follow

  pure function velocity_now(trajectory) result(velocity)
    type(trajectory_t), intent(in) :: trajectory
    real(wp) :: velocity(2)

    velocity = 0.0_wp
    if (.not. trajectory%sticking) velocity = slip_velocity(trajectory, trajectory%now)
  end function velocity_now

  !> A motion in the last advance that slips with this velocity [m/s].
  pure function moment_of(trajectory, motion, velocity) result(moment)
    type(trajectory_t), intent(in) :: trajectory
    type(motion_t), intent(in) :: motion
    real(wp), intent(in) :: velocity(2)
    type(moment_t) :: moment

    associate (slider => trajectory%slider)
      moment%time = motion%time
      moment%position = motion%position
      moment%rate = dot_product(velocity, slider%along)
      moment%slip_velocity = velocity
      moment%force = slider%stiffness(1)*motion%u(1)
      moment%drive_velocity = drive_velocity(trajectory, motion%time)
      moment%force_rate = slider%stiffness(1)*slider%follows(1)*(moment%drive_velocity*slider%along(1) - velocity(1))
    end associate
  end function moment_of

  function at(self, time) result(moment)
    class(advance_t), intent(in) :: self
    real(wp), intent(in) :: time
    type(moment_t) :: moment
    type(motion_t) :: motion
    real(wp) :: velocity(2)

    motion = self%trajectory%at(time)
    velocity = 0.0_wp
    if (.not. self%sticking) velocity = slip_velocity(self%trajectory, motion)
    moment = moment_of(self%trajectory, motion, velocity)
  end function at

  pure real(wp) function friction(self, speed)
    class(advance_t), intent(in) :: self
    real(wp), intent(in) :: speed
    real(wp) :: force(1), slope(1)

    call self%trajectory%slider%law%evaluate(1, [speed], force, slope)
    friction = force(1)
  end function friction

  !> Kinetic and elastic energy [J], without that of a motion which the drive guides.
  pure real(wp) function energy(trajectory, velocity)
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: velocity(2)
    real(wp) :: own(2)

    own = velocity
    if (abs(trajectory%system%guided) > 0.0_wp) own(2) = 0.0_wp
    energy = 0.5_wp*(trajectory%slider%mass*sum(own**2) + sum(trajectory%slider%stiffness*trajectory%now%u**2))
  end function energy

  !> The values of all `summary_quantities`, and which of them this run has.
  subroutine values(self, trajectory, value, given)
    class(trajectory_summary_t), intent(in) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(out) :: value(:)
    logical, intent(out) :: given(:)

    if (allocated(trajectory%stepper)) then
      call summary_values(self%summary_t, value, given, energies_t(self%first_energy, energy(trajectory, self%velocity), &
        trajectory%now%drive_work, trajectory%now%friction_work))
    else
      call summary_values(self%summary_t, value, given)
    end if
  end subroutine values

  !> Write summary and statistics into the outcome. A mean of nothing is left out, not invented.
  subroutine describe(self, trajectory, wall_time, outcome)
    class(trajectory_summary_t), intent(in) :: self
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: wall_time
    type(outcome_t), intent(inout) :: outcome
    type(work_count_t) :: work
    real(wp) :: value(size(summary_quantities))
    logical :: given(size(summary_quantities))

    call self%values(trajectory, value, given)
    outcome%summary = pack(summary_quantities, given)
    outcome%summary_value = pack(value, given)
    if (allocated(trajectory%stepper)) work = trajectory%stepper%count
    outcome%statistics = statistics
    outcome%statistics_value = [real([work%steps, work%rejected, work%rhs, work%jacobians, work%factorisations, work%newton, &
      work%events], wp), wall_time]
  end subroutine describe

  !> Save or load.
  subroutine exchange(self, archive)
    class(trajectory_summary_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    call self%summary_t%exchange(archive)
    call archive%exchange(self%velocity)
  end subroutine exchange
end module dst_trajectory_summary
