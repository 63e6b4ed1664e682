!> A run: scene in, samples and events out to a writer, in slices of wall time.
!>
!> This is the one run routine; the executable and Python call it with different writers.
module dst_simulation
  use, intrinsic :: iso_fortran_env, only: int64
  use dst_archive, only: archive_t
  use dst_kinds, only: wp
  use dst_errors, only: error_t, raise, result_done, deck_error, too_many_steps, not_finite, stopped_early
  use dst_creep_motion, only: creep_motion_t, new_creep_motion
  use dst_drive, only: new_drive
  use dst_friction, only: new_friction_law
  use dst_full_model, only: new_full_polar, new_full_smoothed
  use dst_low_frequency, only: new_low_frequency
  use dst_model_columns, only: gives_column
  use dst_moreau_jean, only: new_moreau_jean
  use dst_observables, only: columns, instant_t, find_column, default_columns, damping_ratio_exists, observe, row_of
  use dst_radau, only: new_radau
  use dst_runge_kutta, only: new_runge_kutta
  use dst_scene, only: scene_t
  use dst_slider, only: slider_t, cos_sin_degrees
  use dst_straight_slip, only: new_straight_slip, on_line
  use dst_text, only: short_text
  use dst_trajectory, only: trajectory_t, no_event, stick_begins, slip_begins, at_time
  use dst_trajectory_summary, only: trajectory_summary_t
  use dst_writer, only: writer_t, quantity_t, outcome_t
  implicit none
  private

  public :: simulation_t, slider_from_scene, wall_clock

  integer, parameter :: buffer_rows = 512
  !> How long the largest slip speed is remembered, in radians of the faster oscillation.
  real(wp), parameter :: memory = 10.0_wp
  !> The clock is read once every so many advances.
  integer, parameter :: advances_between_looks = 16

  !> One run: what is integrated, with what, and what is recorded.
  type :: simulation_t
    type(scene_t) :: scene
    type(trajectory_t) :: trajectory
    !> The motion in closed form, of the models that have one; the trajectory then only tells the time.
    type(creep_motion_t), allocatable :: creep
    type(trajectory_summary_t) :: summary
    !> Numbers of the output columns; the first is time.
    integer, allocatable :: selected(:)
    logical :: finished = .false.
    !> Wall time spent so far [s], and what of it was spent before the last checkpoint that the run goes on from.
    real(wp) :: elapsed = 0.0_wp
    real(wp) :: elapsed_before = 0.0_wp
    integer(int64) :: advances = 0
    !> Instants to sample [s], from 0 to t_end, where they shall not have equal distances.
    real(wp), allocatable :: instants(:)
    !> Whether all samples and the event of the last advance have been taken.
    logical :: recorded = .false.
    !> Samples taken so far, and rows waiting for the writer.
    integer(int64) :: samples = 0
    integer :: waiting = 0
    real(wp), allocatable :: rows(:, :)
  contains
    procedure :: start
    procedure :: proceed
    procedure :: has_reached
    procedure :: state_at
    procedure :: outcome
    procedure :: output_columns
    procedure :: state_text
    procedure :: exchange
  end type simulation_t

contains

  !> Build the model and the method of the scene and place the object at time 0.
  subroutine start(self, scene, error)
    class(simulation_t), intent(inout) :: self
    type(scene_t), intent(in) :: scene
    type(error_t), allocatable, intent(out) :: error

    self%scene = scene
    associate (trajectory => self%trajectory)
      call slider_from_scene(scene, trajectory%slider)
      trajectory%drive = new_drive(scene%drive_time, scene%drive_velocity)
      trajectory%t_end = scene%t_end
      if (scene%is_closed_form()) then
        call start_creep(self, error)
      else
        call choose_equations(scene, trajectory, error)
        if (.not. allocated(error)) call choose_method(scene, trajectory, error)
      end if
      if (.not. allocated(error)) call select_columns(self, error)
      if (allocated(error)) return
      if (.not. allocated(self%creep)) then
        call start_motion(trajectory, scene)
        call self%summary%start(trajectory)
      end if
    end associate
    allocate (self%rows(size(self%selected), buffer_rows))
  end subroutine start

  !> The equations of motion by name, for a trajectory with slider and drive.
  subroutine choose_equations(scene, trajectory, error)
    type(scene_t), intent(in) :: scene
    type(trajectory_t), intent(inout) :: trajectory
    type(error_t), allocatable, intent(out) :: error

    associate (slider => trajectory%slider)
      select case (scene%model)
      case ('low_frequency')
        slider%follows = [1.0_wp, 0.0_wp]
        slider%turns = .false.
        call choose_low_frequency(scene, trajectory)
      case ('high_frequency')
        slider%follows = [0.0_wp, 1.0_wp]
        slider%turns = .false.
        if (abs(slider%stiffness(1)*scene%elongation_x) >= slider%law%onset) then
          call raise(error, deck_error, 'high_frequency holds for a longitudinal load below the static limit: '// &
            '|stiffness_x*elongation_x| must be < mu_0*normal_load = '//trim(short_text(slider%law%onset))//' N', &
            'initial.elongation_x')
          return
        end if
        trajectory%system = new_straight_slip(slider, 2, [scene%elongation_x, 0.0_wp])
      case default
        ! Moreau-Jean solves the exact contact in the slip velocity itself, with its own friction.
        trajectory%exact_contact = scene%contact == 'exact' .and. scene%method /= 'moreau_jean'
        if (trajectory%exact_contact) then
          trajectory%system = new_full_polar(slider)
        else
          trajectory%system = new_full_smoothed(slider)
        end if
      end select
    end associate
  end subroutine choose_equations

  !> The guided motion while the drive has a velocity across the soft axis, straight slip with rest while not.
  subroutine choose_low_frequency(scene, trajectory)
    type(scene_t), intent(in) :: scene
    type(trajectory_t), intent(inout) :: trajectory
    real(wp) :: slow

    associate (drive => trajectory%drive, slider => trajectory%slider)
      trajectory%system = new_straight_slip(slider, 1, [0.0_wp, 0.0_wp])
      if (.not. abs(slider%along(2)) > 0.0_wp) return
      ! The way driven while a ramp passes through zero goes with the square of this share of its velocity.
      slow = max(3.0e-6_wp, 0.1_wp*sqrt(scene%rtol))
      drive = drive%with_rests(slow)
      trajectory%other_system = new_low_frequency(slider)
    end associate
    if (.not. trajectory%drive%segment(1)%rests) call trajectory%exchange_systems()
  end subroutine choose_low_frequency

  !> Slow creep in closed form.
  subroutine start_creep(self, error)
    class(simulation_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    character(:), allocatable :: form

    if (.not. self%scene%interval > 0.0_wp) then
      call raise(error, deck_error, "output.interval must be > 0 with model = '"//self%scene%model// &
        "': a closed form has no steps", 'output.interval')
      return
    end if
    form = ''
    if (self%scene%model == 'creep_asymptotic') form = self%scene%form
    allocate (self%creep)
    call new_creep_motion(self%trajectory%slider, self%trajectory%drive, form, self%scene%t_end, self%creep, error)
  end subroutine start_creep

  !> The object and its contact.
  subroutine slider_from_scene(scene, slider)
    type(scene_t), intent(in) :: scene
    type(slider_t), intent(out) :: slider

    slider%mass = scene%mass
    slider%stiffness = [scene%stiffness_x, scene%stiffness_y]
    slider%along = cos_sin_degrees(scene%misalignment_deg)
    call new_friction_law(scene%law, scene%mu_0, scene%mu_inf, scene%v_f, scene%normal_load, slider%law)
    if (scene%contact /= 'exact') slider%smoothing = scene%v_smooth**2
  end subroutine slider_from_scene

  !> The integrators by name.
  subroutine choose_method(scene, trajectory, error)
    type(scene_t), intent(in) :: scene
    type(trajectory_t), intent(inout) :: trajectory
    type(error_t), allocatable, intent(out) :: error

    if (scene%method == 'rk4' .and. trajectory%may_rest()) then
      call raise(error, deck_error, "method 'rk4' cannot follow the exact contact, and here the object may come to rest: "// &
        'use an adaptive method', 'integrator.method')
      return
    end if
    if (scene%method == 'rodas4p') then
      call raise(error, deck_error, "method 'rodas4p' is for the cases of a sweep, and keeps no series: use radau9", &
        'integrator.method')
      return
    end if
    trajectory%step_max = scene%step_max
    associate (components => trajectory%system%components)
      select case (scene%method)
      case ('radau5')
        trajectory%stepper = new_radau(3, components, scene%rtol)
      case ('radau9')
        trajectory%stepper = new_radau(5, components, scene%rtol)
      case ('radau13')
        trajectory%stepper = new_radau(7, components, scene%rtol)
      case ('moreau_jean')
        trajectory%stepper = new_moreau_jean(trajectory%slider)
        trajectory%fixed_step = scene%step
      case default
        trajectory%stepper = new_runge_kutta(scene%method, components, scene%rtol)
      end select
    end associate
    trajectory%stepper%memory = memory/maxval(trajectory%slider%frequency())
    ! The slipped distance left below this share of the peak speed is below rtol of what was slipped.
    trajectory%cut_share = 0.03_wp*sqrt(scene%rtol)
    if (trajectory%stepper%explicit) then
      trajectory%fixed_step = scene%step
      trajectory%cut_speed = scene%v_cut
      trajectory%cut_rtol = scene%rtol
    end if
  end subroutine choose_method

  !> Initial elongation and slip velocity X'(0) = velocity_ratio V(0), Y'(0) = 0.
  subroutine start_motion(trajectory, scene)
    type(trajectory_t), intent(inout) :: trajectory
    type(scene_t), intent(in) :: scene
    real(wp) :: u(2), y(2), w(2)

    u = [scene%elongation_x, scene%elongation_y]
    w = scene%velocity_ratio*scene%drive_velocity(1)*trajectory%slider%along
    select case (scene%model)
    case ('low_frequency')
      y = [w(1), 0.0_wp]
      if (trajectory%exact_contact) y = on_line(w(1))
    case ('high_frequency')
      y = straight_slip_from(trajectory, w, u)
    case default
      y = w
      if (trajectory%exact_contact) y = [hypot(w(1), w(2)), atan2(w(2), w(1))]
    end select
    call trajectory%start(u, y, -dot_product(u, trajectory%slider%along))
  end subroutine start_motion

  !> (v, theta) of a slip that the longitudinal load faces, F_0 cos(theta) = k_x u_x, towards the side of u_y or
  !> of the drive, as fast as the velocity w in that direction.
  pure function straight_slip_from(trajectory, w, u) result(y)
    type(trajectory_t), intent(in) :: trajectory
    real(wp), intent(in) :: w(2), u(2)
    real(wp) :: y(2), side

    side = u(2)
    if (.not. abs(side) > 0.0_wp) side = w(2)
    y(2) = sign(acos(trajectory%slider%stiffness(1)*u(1)/trajectory%slider%law%onset), side)
    y(1) = max(0.0_wp, dot_product(w, [cos(y(2)), sin(y(2))]))
  end function straight_slip_from

  !> Which columns are written.
  subroutine select_columns(self, error)
    class(simulation_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error
    integer :: i, column

    if (self%scene%fields(1) == 'default') then
      self%selected = default_columns(self%trajectory)
      self%selected = pack(self%selected, gives_column(self%scene%model, columns(self%selected)%name))
      return
    end if
    self%selected = [1]
    do i = 1, size(self%scene%fields)
      column = find_column(self%scene%fields(i))
      if (column == 0) then
        call raise(error, deck_error, 'output.fields: there is no column '//trim(self%scene%fields(i)), 'output.fields')
        return
      else if (columns(column)%name == 'zeta' .and. .not. damping_ratio_exists(self%trajectory)) then
        call raise(error, deck_error, 'output.fields: zeta has no value where V sin(phi) = 0: leave zeta out', 'output.fields')
        return
      else if (.not. gives_column(self%scene%model, columns(column)%name)) then
        call raise(error, deck_error, "output.fields: model = '"//self%scene%model//"' does not give "// &
          trim(columns(column)%name)//': leave it out', 'output.fields')
        return
      end if
      if (all(self%selected /= column)) self%selected = [self%selected, column]
    end do
  end subroutine select_columns

  !> Descriptions of the columns written.
  pure function output_columns(self) result(descriptions)
    class(simulation_t), intent(in) :: self
    type(quantity_t), allocatable :: descriptions(:)

    descriptions = columns(self%selected)
  end function output_columns

  !> Go on for at most `seconds` of wall time [s], or to the end, or until the time `until` [s] has been reached. An error of
  !> the solver ends the run: it is then finished, and all up to the error has been written.
  subroutine proceed(self, seconds, writer, error, until)
    class(simulation_t), intent(inout) :: self
    real(wp), intent(in) :: seconds
    class(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error
    real(wp), intent(in), optional :: until
    type(error_t), allocatable :: disk_error
    real(wp) :: begun, passed, last
    integer :: looks_left

    begun = wall_clock()
    last = huge(1.0_wp)
    if (present(until)) last = until
    passed = 0.0_wp
    looks_left = advances_between_looks
    do while (.not. (allocated(error) .or. at_end(self) .or. self%has_reached(last)))
      if (self%recorded) call advance(self, error)
      if (.not. allocated(error)) call record(self, writer, error)
      looks_left = looks_left - 1
      if (looks_left == 0 .or. .not. self%recorded) then
        passed = wall_clock() - begun
        if (passed >= seconds) exit
        if (over_time(self, passed)) exit
        looks_left = advances_between_looks
      end if
    end do
    call flush_rows(self, writer, disk_error)
    if (allocated(disk_error) .and. .not. allocated(error)) call move_alloc(disk_error, error)
    passed = wall_clock() - begun
    if (.not. (allocated(error) .or. at_end(self)) .and. over_time(self, passed)) call raise_over_time(error)
    self%elapsed = self%elapsed + passed
    self%finished = allocated(error) .or. at_end(self)
  end subroutine proceed

  pure logical function at_end(self)
    class(simulation_t), intent(in) :: self

    at_end = self%recorded .and. self%trajectory%finished()
  end function at_end

  !> Whether the motion is known up to `time` [s], and all samples up to it have been taken.
  pure logical function has_reached(self, time)
    class(simulation_t), intent(in) :: self
    real(wp), intent(in) :: time

    if (allocated(self%creep)) then
      has_reached = self%recorded .and. (at_end(self) .or. sample_time(self) > time)
    else
      has_reached = self%recorded .and. self%trajectory%now%time >= time
    end if
  end function has_reached

  !> The row of output at `time` [s], within the last advance or, in closed form, anywhere.
  subroutine state_at(self, time, row)
    class(simulation_t), intent(in) :: self
    real(wp), intent(in) :: time
    real(wp), intent(out) :: row(:)

    if (allocated(self%creep)) then
      call row_of(self%trajectory, self%creep%at(time), self%selected, row)
    else
      call row_of(self%trajectory, instant_at(self, time), self%selected, row)
    end if
  end subroutine state_at

  !> The motion inside the last advance.
  type(instant_t) function instant_at(self, time)
    class(simulation_t), intent(in) :: self
    real(wp), intent(in) :: time
    logical :: sticking, touching

    associate (trajectory => self%trajectory)
      sticking = trajectory%was_sticking
      touching = trajectory%was_touching
      if (time >= trajectory%now%time) then
        sticking = trajectory%sticking
        touching = trajectory%touching
      end if
      instant_at = observe(trajectory, trajectory%at(time), sticking)
      instant_at%sticking = sticking .and. .not. touching
    end associate
  end function instant_at

  subroutine raise_over_time(error)
    type(error_t), allocatable, intent(out) :: error

    call raise(error, stopped_early, 'stopped at the wall-time limit: raise output.wall_limit')
  end subroutine raise_over_time

  pure logical function over_time(self, passed)
    class(simulation_t), intent(in) :: self
    real(wp), intent(in) :: passed

    over_time = self%scene%wall_limit > 0.0_wp &
      .and. self%elapsed - self%elapsed_before + passed > self%scene%wall_limit
  end function over_time

  !> One advance, checked and summed up; in closed form on to the next sample.
  subroutine advance(self, error)
    class(simulation_t), intent(inout) :: self
    type(error_t), allocatable, intent(out) :: error

    self%advances = self%advances + 1
    if (allocated(self%creep)) then
      self%trajectory%now%time = sample_time(self)
      self%recorded = .false.
      return
    end if
    call self%trajectory%advance(error)
    if (allocated(error)) return
    call check(self, error)
    if (allocated(error)) return
    call self%summary%follow(self%trajectory)
    self%recorded = .false.
  end subroutine advance

  !> Limits and sanity of the last advance.
  subroutine check(self, error)
    class(simulation_t), intent(in) :: self
    type(error_t), allocatable, intent(out) :: error
    character(60) :: limit

    associate (now => self%trajectory%now, steps => self%trajectory%stepper%count%steps)
      if (.not. abs(now%time) + sum(abs(now%u)) + sum(abs(now%y)) + abs(now%position) + abs(now%drive_work) &
        + abs(now%friction_work) <= huge(1.0_wp)) then
        call raise(error, not_finite, 'the motion is not finite after '//trim(at_time(self%trajectory%from))// &
          ': use a smaller rtol or another method')
      else if (self%scene%max_steps > 0 .and. steps >= self%scene%max_steps .and. .not. self%trajectory%finished()) then
        write (limit, '(a,i0)') 'integrator.max_steps = ', self%scene%max_steps
        call raise(error, too_many_steps, trim(limit)//' reached at '//trim(at_time(now))//': raise it, or use a larger rtol')
      end if
    end associate
  end subroutine check

  !> Samples that fall into the last advance, and its event. Of many samples some are left for the next call.
  subroutine record(self, writer, error)
    class(simulation_t), intent(inout) :: self
    class(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error
    logical :: all_taken

    if (allocated(self%creep)) then
      call record_creep(self, writer, error)
      return
    end if
    all_taken = .true.
    associate (trajectory => self%trajectory)
      if (self%advances == 0) then
        call take_sample(self, writer, 0.0_wp, error)
      else if (self%scene%interval > 0.0_wp) then
        call take_samples(self, writer, all_taken, error)
      else if (trajectory%now%time > trajectory%from%time) then
        call take_sample(self, writer, trajectory%now%time, error)
      end if
      if (trajectory%event /= no_event .and. all_taken .and. .not. allocated(error)) &
        call writer%write_events([trajectory%now%time], [trajectory%event], error)
    end associate
    self%recorded = all_taken
  end subroutine record

  !> The samples due by now, up to a buffer full; `all_taken` tells whether these were all.
  subroutine take_samples(self, writer, all_taken, error)
    class(simulation_t), intent(inout) :: self
    class(writer_t), intent(inout) :: writer
    logical, intent(out) :: all_taken
    type(error_t), allocatable, intent(out) :: error
    real(wp) :: time
    integer :: i

    all_taken = .true.
    do i = 1, buffer_rows
      time = sample_time(self)
      if (time > self%trajectory%now%time) return
      call take_sample(self, writer, time, error)
      if (allocated(error) .or. time >= self%scene%t_end) return
    end do
    all_taken = .false.
  end subroutine take_samples

  !> Time of the next sample [s].
  pure real(wp) function sample_time(self)
    class(simulation_t), intent(in) :: self

    if (allocated(self%instants)) then
      sample_time = self%instants(min(self%samples + 1, size(self%instants, kind=int64)))
      return
    end if
    sample_time = real(self%samples, wp)*self%scene%interval
    ! The end is sampled exactly; a multiple of the interval within roundoff of it is the end.
    if (sample_time >= self%scene%t_end*(1.0_wp - 4.0_wp*epsilon(sample_time))) sample_time = self%scene%t_end
  end function sample_time

  !> The sample that is due now of a motion in closed form.
  subroutine record_creep(self, writer, error)
    class(simulation_t), intent(inout) :: self
    class(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error
    type(instant_t) :: instant

    if (self%samples == 0) call record_creep_events(self, writer, error)
    if (allocated(error)) return
    instant = self%creep%at(self%trajectory%now%time)
    self%summary%largest_rate = max(self%summary%largest_rate, abs(dot_product(instant%velocity, self%creep%slider%along)))
    call add_row(self, instant, writer, error)
    self%recorded = .true.
  end subroutine record_creep

  !> Slow creep begins after a true stick.
  subroutine record_creep_events(self, writer, error)
    class(simulation_t), intent(inout) :: self
    class(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error

    if (.not. self%creep%onset > 0.0_wp) return
    self%summary%sticks = 1
    self%summary%sticking_time = min(self%creep%onset, self%scene%t_end)
    call writer%write_events([0.0_wp], [stick_begins], error)
    if (allocated(error) .or. self%creep%onset >= self%scene%t_end) return
    call writer%write_events([self%creep%onset], [slip_begins], error)
  end subroutine record_creep_events

  !> One row of output at a time inside the last advance.
  subroutine take_sample(self, writer, time, error)
    class(simulation_t), intent(inout) :: self
    class(writer_t), intent(inout) :: writer
    real(wp), intent(in) :: time
    type(error_t), allocatable, intent(out) :: error

    call add_row(self, instant_at(self, time), writer, error)
  end subroutine take_sample

  subroutine add_row(self, instant, writer, error)
    class(simulation_t), intent(inout) :: self
    type(instant_t), intent(in) :: instant
    class(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error
    integer :: column

    if (self%waiting == buffer_rows) call flush_rows(self, writer, error)
    if (allocated(error)) return
    self%waiting = self%waiting + 1
    self%samples = self%samples + 1
    associate (row => self%rows(:, self%waiting))
      call row_of(self%trajectory, instant, self%selected, row)
      if (all(abs(row) <= huge(row))) return
      self%waiting = self%waiting - 1
      column = self%selected(findloc(abs(row) <= huge(row), .false., dim=1))
      call raise(error, not_finite, trim(columns(column)%name)//' is not finite at '//trim(at_time(instant%motion))// &
        ': leave it out of output.fields, or scale the parameters')
    end associate
  end subroutine add_row

  !> Hand the waiting rows to the writer.
  subroutine flush_rows(self, writer, error)
    class(simulation_t), intent(inout) :: self
    class(writer_t), intent(inout) :: writer
    type(error_t), allocatable, intent(out) :: error

    if (self%waiting > 0) call writer%write_samples(self%rows(:, :self%waiting), error)
    self%waiting = 0
  end subroutine flush_rows

  !> How the run has ended; `error` is what `proceed` returned.
  subroutine outcome(self, error, result)
    class(simulation_t), intent(in) :: self
    type(error_t), allocatable, intent(in) :: error
    type(outcome_t), intent(out) :: result

    result%result_code = result_done
    result%result_text = 'done'
    if (allocated(error)) then
      result%result_code = error%code
      result%result_text = error%text
    end if
    call self%summary%describe(self%trajectory, self%elapsed, result)
  end subroutine outcome

  !> Time and state, for messages.
  pure function state_text(self) result(text)
    class(simulation_t), intent(in) :: self
    character(:), allocatable :: text

    text = trim(at_time(self%trajectory%now))
  end function state_text

  !> Save or load, between two calls of `proceed`. A simulation is loaded after it has been started.
  subroutine exchange(self, archive)
    class(simulation_t), intent(inout) :: self
    type(archive_t), intent(inout) :: archive

    if (allocated(self%creep)) then
      call self%trajectory%now%exchange(archive)
    else
      call self%trajectory%exchange(archive)
    end if
    call self%summary%exchange(archive)
    call archive%exchange(self%elapsed)
    call archive%exchange(self%advances)
    call archive%exchange(self%recorded)
    call archive%exchange(self%samples)
    if (archive%is_loading()) self%elapsed_before = self%elapsed
  end subroutine exchange

  !> Wall-clock time [s] from an arbitrary origin.
  real(wp) function wall_clock()
    integer(int64) :: count, rate

    call system_clock(count, rate)
    wall_clock = real(count, wp)/real(rate, wp)
  end function wall_clock
end module dst_simulation
