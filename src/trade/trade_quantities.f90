!> What `trade` measures of a run: the quantities that a user reads, and their errors against a reference.
!>
!> final_elongation, final_velocity: |difference| at t_end over the largest elongation and slip speed of the motion.
!> period, peak_force, valley_force, slip_length, max_X_rate, sticks, first_peak_force: relative, of the values in the summary.
!> creep_velocity: relative, of [X(3T/4) - X(T/4)]/(T/2), T the first stick phase (up to the first slip).
!> fast_amplitude, fast_phase: of the oscillation of k_y u_y around T/2, fitted to the motion by least squares over eight periods
!> at the frequency of the reference; the amplitude relative, the phase over pi.
!>
!> A quantity that the reference has and the run has not counts as an error of 1.
module dst_trade_quantities
  use dst_kinds, only: wp, pi
  use dst_linear_solve, only: solve_in_place
  use dst_memory_writer, only: memory_writer_t
  use dst_columns, only: find_column
  use dst_scene, only: scene_t
  use dst_simulation, only: simulation_t
  use dst_writer, only: quantity_t, outcome_t, find_quantity
  implicit none
  private

  public :: quantities, quantity_count, observation_t, observation_plan_t
  public :: plan_observation, tune_frequency, observe_run, errors_of, not_applicable

  !> The table of quantities: name, unit, meaning.
  type(quantity_t), parameter :: quantities(*) = [ &
    quantity_t('final_elongation', 'm', 'elongation of the springs at t_end, over the largest one'), &
    quantity_t('final_velocity', 'm s-1', 'slip velocity at t_end, over the largest one'), &
    quantity_t('period', 's', 'mean time from peak to peak of the load'), &
    quantity_t('peak_force', 'N', 'mean peak of the load'), &
    quantity_t('valley_force', 'N', 'mean valley of the load'), &
    quantity_t('slip_length', 'm', 'mean advance in X from peak to valley'), &
    quantity_t('max_X_rate', 'm s-1', 'largest slip speed along the drive'), &
    quantity_t('creep_velocity', 'm s-1', 'mean of X'' over the middle half of the first stick phase'), &
    quantity_t('fast_amplitude', 'N', 'amplitude of the fast oscillation of k_y u_y'), &
    quantity_t('fast_phase', 'rad', 'phase of the fast oscillation of k_y u_y, error over pi'), &
    quantity_t('sticks', '1', 'times that the object came to rest'), &
    quantity_t('first_peak_force', 'N', 'first peak of the load')]
  !> Number of quantities.
  integer, parameter :: quantity_count = size(quantities)

  integer, parameter :: elongation = 1, velocity = 2, first_of_summary = 3, last_of_summary = 7
  integer, parameter :: creep = 8, amplitude = 9, phase = 10, sticks = 11, first_peak = 12

  !> Error of a quantity that the reference does not have.
  real(wp), parameter :: not_applicable = -1.0_wp

  !> Length of the fast window in periods, and samples in a period.
  integer, parameter :: periods = 8, samples_per_period = 24
  integer, parameter :: window_samples = periods*samples_per_period + 1

  !> The quantities of one run; only the vectors have a second component.
  type :: observation_t
    logical :: has(quantity_count) = .false.
    real(wp) :: value(2, quantity_count) = 0.0_wp
  end type observation_t

  !> When to look, and what errors refer to.
  type :: observation_plan_t
    real(wp), allocatable :: instants(:)   !! s: 0, T/4, the window if there is one, 3T/4, t_end
    logical :: has_window = .false.
    real(wp) :: frequency = 0.0_wp         !! Hz, of the fast oscillation in the window
    real(wp) :: stiffness(2) = 0.0_wp      !! N/m
    real(wp) :: static_limit = 0.0_wp      !! N
    real(wp) :: scale(2) = 0.0_wp          !! largest elongation [m] and slip speed [m/s]
  end type observation_plan_t

contains

  !> Plan from a survey: a run of the scene with samples at equal distances.
  subroutine plan_observation(run, samples, plan)
    type(simulation_t), intent(in) :: run
    type(memory_writer_t), intent(in) :: samples
    type(observation_plan_t), intent(out) :: plan
    ! On the heap: a survey is larger than a small stack.
    real(wp), allocatable :: time(:), load(:), theta(:)
    real(wp) :: stick_end, tangent(2)
    integer :: i

    allocate (time, source=samples%samples(1, :samples%rows))
    allocate (load, source=samples%samples(column_of(run, 'u_x'), :samples%rows))
    allocate (theta, source=samples%samples(column_of(run, 'theta'), :samples%rows))
    plan%stiffness = run%motion%slider%stiffness
    plan%static_limit = run%motion%slider%law%onset
    plan%scale = [largest(samples, column_of(run, 'u_x'), column_of(run, 'u_y')), &
                  largest(samples, column_of(run, 'w_x'), column_of(run, 'w_y'))]
    load = abs(plan%stiffness(1)*load)
    stick_end = first_stick_phase(time, load)
    ! The frequency of a creep in which friction points along theta.
    tangent = 0.0_wp
    do i = 1, size(time)
      if (abs(time(i) - 0.5_wp*stick_end) <= max(0.02_wp*stick_end, time(2))) &
        tangent = tangent + [cos(theta(i))**2, sin(theta(i))**2]
    end do
    tangent = tangent/max(sum(tangent), tiny(1.0_wp))
    plan%frequency = sqrt(dot_product(plan%stiffness, tangent)/run%motion%slider%mass)/(2.0_wp*pi)
    plan%has_window = run%scene%model /= 'low_frequency' .and. real(periods, wp) < 0.2_wp*stick_end*plan%frequency
    call place_instants(stick_end, run%scene%t_end, plan)
  end subroutine plan_observation

  !> Largest length of the vectors with these two columns.
  pure real(wp) function largest(samples, column_x, column_y)
    type(memory_writer_t), intent(in) :: samples
    integer, intent(in) :: column_x, column_y
    integer :: i

    largest = 0.0_wp
    do i = 1, samples%rows
      largest = max(largest, samples%samples(column_x, i)**2 + samples%samples(column_y, i)**2)
    end do
    largest = sqrt(largest)
  end function largest

  !> End of the first stick phase [s]: the first peak of the load that is followed by a fall of 5 %, else where the load comes
  !> within 1 % of its largest value.
  pure real(wp) function first_stick_phase(time, load) result(stick_end)
    real(wp), intent(in) :: time(:), load(:)
    integer :: i, peak

    stick_end = time(size(time))
    peak = 1
    do i = 1, size(time)
      if (load(i) > load(peak)) peak = i
      if (load(peak) - load(i) > 0.05_wp*maxval(load)) exit
    end do
    if (i > size(time)) then
      do peak = 1, size(time)
        if (load(peak) >= 0.99_wp*maxval(load)) exit
      end do
    end if
    if (peak > 1 .and. peak <= size(time)) stick_end = time(peak)
  end function first_stick_phase

  pure subroutine place_instants(stick_end, t_end, plan)
    real(wp), intent(in) :: stick_end, t_end
    type(observation_plan_t), intent(inout) :: plan
    integer :: i

    if (plan%has_window) then
      plan%instants = [0.0_wp, 0.25_wp*stick_end, &
        [(0.5_wp*stick_end + real(i, wp)/(samples_per_period*plan%frequency), i=0, window_samples - 1)], &
        0.75_wp*stick_end, t_end]
    else
      plan%instants = [0.0_wp, 0.25_wp*stick_end, 0.75_wp*stick_end, t_end]
    end if
  end subroutine place_instants

  !> Take the frequency at which the oscillation of a run's samples is fitted best, within 15 %.
  subroutine tune_frequency(run, samples, plan)
    type(simulation_t), intent(in) :: run
    type(memory_writer_t), intent(in) :: samples
    type(observation_plan_t), intent(inout) :: plan
    integer, parameter :: candidates = 61
    real(wp) :: force(window_samples), residual(candidates), trial(candidates), coefficients(5), curvature
    integer :: i, best

    if (.not. plan%has_window) return
    call window_force(run, samples, force)
    do i = 1, candidates
      trial(i) = plan%frequency*(0.85_wp + 0.3_wp*real(i - 1, wp)/real(candidates - 1, wp))
      call fit(window_times(plan), force, trial(i), coefficients, residual(i))
    end do
    best = min(max(minloc(residual, dim=1), 2), candidates - 1)
    plan%frequency = trial(best)
    curvature = residual(best - 1) - 2.0_wp*residual(best) + residual(best + 1)
    if (curvature > 0.0_wp) plan%frequency = plan%frequency &
      + 0.5_wp*(trial(2) - trial(1))*max(-1.0_wp, min(1.0_wp, (residual(best - 1) - residual(best + 1))/curvature))
  end subroutine tune_frequency

  !> The quantities of a finished run that was sampled at the plan's instants.
  subroutine observe_run(plan, run, samples, outcome, observation)
    type(observation_plan_t), intent(in) :: plan
    type(simulation_t), intent(in) :: run
    type(memory_writer_t), intent(in) :: samples
    type(outcome_t), intent(in) :: outcome
    type(observation_t), intent(out) :: observation
    real(wp) :: position(2)
    integer :: q

    associate (rows => samples%samples(:, :samples%rows), seen => observation)
      call take_vector(elongation, column_of(run, 'u_x'), column_of(run, 'u_y'))
      call take_vector(velocity, column_of(run, 'w_x'), column_of(run, 'w_y'))
      do q = first_of_summary, last_of_summary
        call take_summary(q)
      end do
      call take_summary(sticks)
      call take_summary(first_peak)
      position = rows(column_of(run, 'X'), [2, samples%rows - 1])
      seen%has(creep) = .true.
      seen%value(1, creep) = (position(2) - position(1))/(rows(1, samples%rows - 1) - rows(1, 2))
    end associate
    if (plan%has_window) call observe_oscillation(plan, run, samples, observation)

  contains

    subroutine take_vector(q, x, y)
      integer, intent(in) :: q, x, y

      observation%has(q) = min(x, y) > 0
      if (observation%has(q)) observation%value(:, q) = samples%samples([x, y], samples%rows)
    end subroutine take_vector

    subroutine take_summary(q)
      integer, intent(in) :: q
      integer :: i

      i = find_quantity(outcome%summary, quantities(q)%name)
      if (i == 0) return
      observation%has(q) = .true.
      observation%value(1, q) = outcome%summary_value(i)
    end subroutine take_summary
  end subroutine observe_run

  !> Amplitude [N] and phase [rad] of k_y u_y in the window.
  subroutine observe_oscillation(plan, run, samples, observation)
    type(observation_plan_t), intent(in) :: plan
    type(simulation_t), intent(in) :: run
    type(memory_writer_t), intent(in) :: samples
    type(observation_t), intent(inout) :: observation
    real(wp) :: force(window_samples), coefficients(5), residual

    if (column_of(run, 'spring_force_y') == 0) return
    call window_force(run, samples, force)
    call fit(window_times(plan), force, plan%frequency, coefficients, residual)
    observation%value(1, amplitude) = hypot(coefficients(4), coefficients(5))
    ! Far below what friction can resist there is no oscillation, but a trend that the fit did not take up.
    if (.not. observation%value(1, amplitude) > 1.0e-6_wp*plan%static_limit) return
    observation%has([amplitude, phase]) = .true.
    observation%value(1, phase) = atan2(-coefficients(5), coefficients(4))
  end subroutine observe_oscillation

  subroutine window_force(run, samples, force)
    type(simulation_t), intent(in) :: run
    type(memory_writer_t), intent(in) :: samples
    real(wp), intent(out) :: force(window_samples)

    force = samples%samples(column_of(run, 'spring_force_y'), 3:2 + window_samples)
  end subroutine window_force

  !> Times of the window's samples from its middle [s].
  pure function window_times(plan) result(times)
    type(observation_plan_t), intent(in) :: plan
    real(wp) :: times(window_samples)

    times = plan%instants(3:2 + window_samples)
    times = times - 0.5_wp*(times(1) + times(window_samples))
  end function window_times

  !> Least squares of 1, t, t^2, cos, sin(2 pi f t), by the normal equations of a scaled time.
  pure subroutine fit(time, value, frequency, coefficients, residual)
    real(wp), intent(in) :: time(:), value(:), frequency
    real(wp), intent(out) :: coefficients(5), residual
    real(wp) :: basis(size(time), 5), normal(5, 5)
    logical :: singular

    basis(:, 1) = 1.0_wp
    basis(:, 2) = time/time(size(time))
    basis(:, 3) = basis(:, 2)**2
    basis(:, 4) = cos(2.0_wp*pi*frequency*time)
    basis(:, 5) = sin(2.0_wp*pi*frequency*time)
    normal = matmul(transpose(basis), basis)
    coefficients = matmul(value, basis)
    call solve_in_place(5, normal, coefficients, singular)
    if (singular) coefficients = 0.0_wp
    residual = sum((value - matmul(basis, coefficients))**2)
  end subroutine fit

  !> Errors of a run against the reference, in the order of `quantities`.
  pure function errors_of(plan, observation, reference) result(error)
    type(observation_plan_t), intent(in) :: plan
    type(observation_t), intent(in) :: observation, reference
    real(wp) :: error(quantity_count), difference, scale
    integer :: q

    do q = 1, quantity_count
      difference = sqrt(sum((observation%value(:, q) - reference%value(:, q))**2))
      scale = sqrt(sum(reference%value(:, q)**2))
      select case (q)
      case (elongation)
        scale = plan%scale(1)
      case (velocity)
        scale = plan%scale(2)
      case (phase)
        difference = abs(observation%value(1, q) - reference%value(1, q))
        difference = min(difference, 2.0_wp*pi - difference)
        scale = pi
      end select
      error(q) = not_applicable
      if (.not. (reference%has(q) .and. scale > 0.0_wp)) cycle
      error(q) = 1.0_wp
      if (observation%has(q)) error(q) = difference/scale
    end do
  end function errors_of

  !> Row of a column in the samples of a run, 0 if it has none.
  pure integer function column_of(run, name)
    type(simulation_t), intent(in) :: run
    character(*), intent(in) :: name

    column_of = findloc(run%selected, find_column(name), dim=1)
  end function column_of
end module dst_trade_quantities
