!> Explicit Runge-Kutta methods: dopri5 and dop853 (adaptive), rk4 (fixed step).
!>
!> The unknowns are the elongation minus the drive's displacement, U = u - D(t) e, and the slip unknowns:
!>
!>     U' = -w(y),      y' = g(u, y)/B(y).
!>
!> Thus any piecewise-linear V(t) is exact for Hooke's springs. The two works are quadratures with the weights of the method.
!>
!> With the displacement D(t), X' = advance_by_slip . w + advance_by_drive V. Elongations that a model keeps constant do not change.
!>
!> At rest in polar unknowns B vanishes. A stage at rest makes the attempt fail; dst_past_rest leads the motion past a rest.
module dst_runge_kutta
  use, intrinsic :: iso_c_binding, only: c_loc
  use dst_archive, only: archive_t
  use dst_kinds, only: wp
  use dst_dense_output, only: column_u, column_y, column_position
  use dst_drive, only: drive_segment_t
  use dst_instability, only: follow_instability
  use dst_interpolation, only: new_grid, max_degree
  use dst_runge_kutta_tableaux, only: tableau_t, tableau_named, dense_weights, max_stages
  use dst_slip_system, only: slip_system_t, stage_terms_t, new_terms, max_components, max_unknowns
  use dst_state, only: state_t
  use dst_step_control, only: step_control_t, new_step_control, factor_for, unsolved_factor
  use dst_stepper, only: stepper_t, attempt_t, serialise_stepper
  implicit none
  private

  public :: runge_kutta_t, new_runge_kutta

  !> Elongations and slip unknowns in one vector; in that of their rates the powers of drive, friction and dampers [W] follow.
  integer, parameter :: n_values = max_components + max_unknowns, first_y = 1 + max_components
  integer, parameter :: of_drive = n_values + 1, of_friction = n_values + 2, of_dampers = n_values + 3
  ! The effects of "twice" were measured with dop853 on Fig. 3 (1 s, rtol 1e-6).
  !
  !> Largest product of step and rate for which rk4 is stable (2.785 for relaxation, 2.828 for oscillation).
  real(wp), parameter :: stability_limit = 2.7_wp
  !> A longer step is shortened to this share of the limit, by this factor at most. Conventions.
  real(wp), parameter :: stability_margin = 0.9_wp, least_stable_factor = 0.1_wp
  !> Largest factor between steps, and the memory of their control. Hairer & Wanner's convention for the memory of DOPRI5. Twice the
  !> factor: the same; twice the memory: 16 % less work, the same error.
  real(wp), parameter :: largest_factor = 5.0_wp, memory = 0.04_wp
  !> Order of the dense output of DOP853.
  integer, parameter :: dense_order = 7
  !> Tolerance of the estimate over rtol, with one estimate and with two: measured against converged motion, so that the relative
  !> error of the slip velocity is about rtol. Twice: 3 % less work, the same error.
  real(wp), parameter :: tolerance_of_one = 0.05_wp, tolerance_of_two = 1.0_wp
  !> Share of the error of order 3 with which DOP853 stretches the error of order 5. Hairer & Wanner's convention. Twice: the same
  !> work and error.
  real(wp), parameter :: stretch_share = 0.1_wp
  !> A disturbance below this many tolerances of the estimate is not noticed. Convention.
  real(wp), parameter :: seen = 10.0_wp
  !> Factor after a turn that was missed. Convention.
  real(wp), parameter :: turn_factor = 0.5_wp
  !> With dampers, which act in a much shorter time than the oscillations, a step that is far too long makes stages whose squares
  !> would overflow. No value this large belongs to a state.
  real(wp), parameter :: no_state = 1.0e70_wp
  !> Permitted ratio of the error of the dense output to that of the step's end. Twice: 5 % less work, the same error.
  real(wp), parameter :: dense_allowance = 10.0_wp
  !> The same for the defect of the dense output around a turn, whose order is still lower. Fig. 3 has no such turn.
  real(wp), parameter :: turn_allowance = 30.0_wp

  !> The stages of the last attempt, which the next one may need again, and what the length of the next step is made of.
  type :: history_t
    !> slope(:, i) = (U', y', powers) at stage i.
    real(wp) :: slope(of_dampers, max_stages) = 0.0_wp
    !> The states (u, y, V) whose slopes are the first and the one at the end of the step: an attempt starts where the last one did,
    !> if that was rejected, or where it ended.
    real(wp) :: start(n_values + 1) = 0.0_wp, end(n_values + 1) = 0.0_wp
    logical :: start_known = .false., end_known = .false.
    !> Whether this attempt repeats a rejected one; then the next step is not longer.
    logical :: repeated = .false.
    type(step_control_t) :: control
  end type history_t

  !> An explicit method for one system, with its state between steps.
  type, extends(stepper_t) :: runge_kutta_t
    type(tableau_t) :: method
    !> Tolerance of the estimated slip-velocity error of a step, relative to the slip speed.
    real(wp) :: estimate_tolerance = 1.0e-8_wp
    !> dense_weight(:, i): weights of the slopes in the value at node i.
    real(wp) :: dense_weight(max_stages, 0:max_degree) = 0.0_wp
    type(history_t) :: history
    type(stage_terms_t) :: terms
    !> dw/dy at the stage evaluated last, (component, unknown).
    real(wp) :: velocity_y(max_components*max_unknowns) = 0.0_wp
  contains
    procedure :: restart
    procedure :: attempt
    procedure :: accept
    procedure :: end_rate
    procedure :: serialise
  end type runge_kutta_t

contains

  !> The method called `method_name` for a system with these numbers of components and slip unknowns. rtol has the same meaning as
  !> for Radau IIA; the fixed step of rk4 does not depend on it.
  function new_runge_kutta(method_name, components, unknowns, rtol) result(stepper)
    character(*), intent(in) :: method_name
    integer, intent(in) :: components, unknowns
    real(wp), intent(in) :: rtol
    type(runge_kutta_t) :: stepper
    integer :: i, degree

    stepper%explicit = .true.
    stepper%method = tableau_named(method_name)
    stepper%estimate_tolerance = merge(tolerance_of_two, tolerance_of_one, stepper%method%errors > 1)*rtol
    ! With a memory, because the step is mostly limited by stability: the friction direction relaxes quickly.
    stepper%history%control = new_step_control(stepper%method%order, largest_factor, memory=memory)
    degree = 3 + stepper%method%dense_terms
    stepper%grid = new_grid([(real(i, wp)/real(degree, wp), i=0, degree)])
    do i = 0, degree
      stepper%dense_weight(:, i) = dense_weights(stepper%method, stepper%grid%node(i))
    end do
    stepper%noise_floor = seen*stepper%estimate_tolerance
    stepper%terms = new_terms(1, components, unknowns)
  end function new_runge_kutta

  !> An explicit method needs no first guess, so it ignores rate and curvature.
  pure subroutine restart(self, rate, curvature)
    class(runge_kutta_t), intent(inout) :: self
    real(wp), intent(in) :: rate(:), curvature(:)

    self%start_speed = 0.0_wp
    self%peak_speed = 0.0_wp
    ! The equations may be different from now on.
    self%history%start_known = .false.
    self%history%end_known = .false.
    call self%history%control%restart()
  end subroutine restart

  subroutine attempt(self, system, drive, from, step, to, outcome, to_stop)
    class(runge_kutta_t), intent(inout) :: self
    class(slip_system_t), intent(in) :: system
    type(drive_segment_t), intent(in) :: drive
    type(state_t), intent(in) :: from
    real(wp), intent(in) :: step
    type(state_t), intent(out) :: to
    type(attempt_t), intent(out) :: outcome
    logical, intent(in), optional :: to_stop
    real(wp) :: state(n_values)

    ! An explicit method cannot solve for the length of a step.
    if (present(to_stop)) then
      if (to_stop) return
    end if
    self%step = step
    self%speed_scale = 0.0_wp
    call step_stages()
    if (outcome%solved) call judge()
    if (outcome%solved .and. outcome%error <= 1.0_wp) call dense_stages()
    if (outcome%solved .and. outcome%error <= 1.0_wp) call judge_dense()
    if (outcome%solved .and. outcome%error <= 1.0_wp) then
      call set_nodal()
      if (self%method%errors > 0) call judge_turns()
      call look_for_growth()
    end if

  contains

    !> The stages of the step itself, its end and the slope there.
    subroutine step_stages()
      real(wp) :: gained(of_dampers)
      integer :: i

      call begin()
      associate (s => self%method%stages)
        do i = 2, s + 1
          if (.not. outcome%solved) return
          call stage_state(i)
          call evaluate(i)
        end do
        self%history%end = [state, drive%velocity_at(from%time + self%step)]
        self%history%end_known = outcome%solved
        gained = matmul(self%history%slope(:, 1:s), self%method%b(1:s))
        call to%later(from, self%step)
        to%u = state(1:max_components)
        to%y = state(first_y:)
        to%position = from%position + system%advance_by_drive*drive%displacement(from%time, self%step) &
          - self%step*dot_product(system%advance_by_slip, gained(1:max_components))
        to%drive_work = from%drive_work + self%step*gained(of_drive)
        to%friction_work = from%friction_work + self%step*gained(of_friction)
        to%damper_work = from%damper_work + self%step*gained(of_dampers)
      end associate
    end subroutine step_stages

    !> The first stage: it is reused if the slope of this state is known.
    subroutine begin()
      real(wp) :: first(n_values + 1)

      first = [from%u, from%y, drive%velocity_at(from%time)]
      outcome%solved = .true.
      self%history%repeated = self%history%start_known .and. all_equal(first, self%history%start)
      if (self%history%end_known .and. all_equal(first, self%history%end)) then
        self%history%slope(:, 1) = self%history%slope(:, self%method%stages + 1)
      else if (.not. self%history%repeated) then
        state = first(:n_values)
        call evaluate(1)
      end if
      self%speed_scale = max(self%speed_scale, sqrt(sum(self%history%slope(1:max_components, 1)**2) &
        + (system%prescribed*first(n_values + 1))**2))
      self%history%start = first
      ! The limit of the fixed step is checked in the evaluation, so a failed evaluation has to be repeated.
      self%history%start_known = outcome%solved .and. self%method%errors > 0
      self%history%end_known = .false.
    end subroutine begin

    !> The weighted sum of the slopes of elongations and slip unknowns at the first stages.
    function combined(weight) result(total)
      real(wp), intent(in) :: weight(:)
      real(wp) :: total(n_values)
      integer :: j

      total = 0.0_wp
      do j = 1, size(weight)
        total = total + weight(j)*self%history%slope(1:n_values, j)
      end do
    end function combined

    !> u and y of stage i.
    subroutine stage_state(i)
      integer, intent(in) :: i

      state = self%step*combined(self%method%a(i, 1:i - 1))
      state(1:max_components) = from%u + state(1:max_components) &
        + drive%displacement(from%time, self%method%c(i)*self%step)*system%drive_coupling
      state(first_y:) = from%y + state(first_y:)
    end subroutine stage_state

    !> Slope and powers of stage i; not solved if the state is invalid, at rest, or if the step is beyond the stability limit of a
    !> method that cannot detect it otherwise.
    subroutine evaluate(i)
      integer, intent(in) :: i
      real(wp) :: drive_velocity, velocity(max_components), step_rate, driven

      outcome%solved = .false.
      if (.not. all(abs(state) <= merge(no_state, huge(1.0_wp), system%is_damped))) return
      self%count%rhs = self%count%rhs + 1
      drive_velocity = drive%velocity_at(from%time + self%method%c(i)*self%step)
      associate (n => system%components, m => system%unknowns, first => system%axis, &
          last => system%axis + system%components - 1, terms => self%terms)
        call system%kinematics(1, state(first_y:), velocity, self%velocity_y)
        call system%dynamics(1, [drive_velocity], state(first:last), state(first_y:), self%velocity_y, terms)
        if (any(terms%inertia(1, :) <= 0.0_wp)) return
        associate (slope => self%history%slope(:, i))
          slope = 0.0_wp
          slope(first:last) = -velocity(1:n)
          slope(first_y:max_components + m) = terms%force(1, :)/terms%inertia(1, :)
          slope(of_friction) = terms%dissipation(1)
          slope(of_drive) = drive_velocity*dot_product(system%drive_stiffness, state(1:max_components)) + terms%supply(1)
          if (system%is_damped) then
            call system%damper_powers(drive_velocity, velocity(1:n), driven, slope(of_dampers))
            slope(of_drive) = slope(of_drive) + driven
          end if
        end associate
        self%speed_scale = max(self%speed_scale, sqrt(sum(velocity(1:n)**2) + (system%prescribed*drive_velocity)**2))
        outcome%solved = .true.
        if (self%method%errors > 0) return
        step_rate = self%step*fastest_rate(n, m, terms, self%velocity_y)
        outcome%solved = step_rate <= stability_limit
        if (.not. outcome%solved) outcome%factor = max(least_stable_factor, stability_margin*stability_limit/step_rate)
      end associate
    end subroutine evaluate

    !> Error and step size factor.
    subroutine judge()
      real(wp) :: size, stretch

      outcome%error = 0.0_wp
      outcome%factor = 1.0_wp
      if (self%method%errors == 0) return
      size = error_size(self%method%error(:, 1), self%velocity_y)
      if (self%method%errors == 2) then
        stretch = stretch_share*error_size(self%method%error(:, 2), self%velocity_y)
        if (size > 0.0_wp) size = size*(size/hypot(size, stretch))
      end if
      outcome%error = size/tolerance()
      call self%history%control%advise(self%step, self%history%repeated, outcome%error, outcome%factor)
    end subroutine judge

    !> Permitted slip-velocity error of the step [m/s].
    real(wp) function tolerance()
      tolerance = self%speed_scale*self%estimate_tolerance + self%step*system%acceleration_noise
    end function tolerance

    !> An error estimate as a slip velocity [m/s]: the error of y, and that of u times the frequency with which the springs convert
    !> it to velocity; magnified along an axis whose spring has a smaller scale than the slip speed.
    real(wp) function error_size(weight, velocity_y) result(size)
      real(wp), intent(in) :: weight(max_stages), velocity_y(system%components, system%unknowns)
      real(wp) :: error(n_values), square, frequency_square, own_speed(max_components)
      integer :: k, l, axis

      error = self%step*combined(weight(1:self%method%all_stages))
      square = 0.0_wp
      own_speed = system%spring_speed(self%history%start(1:max_components))
      do k = 1, system%components
        axis = system%axis + k - 1
        frequency_square = 0.0_wp
        do l = 1, system%unknowns
          frequency_square = frequency_square + velocity_y(k, l)*self%terms%force_u(1, l, k)/self%terms%inertia(1, l)
        end do
        square = square + (dot_product(velocity_y(k, :), error(first_y:max_components + system%unknowns))**2 &
          + abs(frequency_square)*error(axis)**2)*max(1.0_wp, self%speed_scale/own_speed(axis))**2
      end do
      size = sqrt(square)
    end function error_size

    !> The stages that only the dense output needs.
    subroutine dense_stages()
      real(wp) :: factor
      integer :: i

      factor = outcome%factor
      outcome%factor = unsolved_factor
      do i = self%method%stages + 2, self%method%all_stages
        call stage_state(i)
        call evaluate(i)
        if (.not. outcome%solved) return
      end do
      outcome%factor = factor
    end subroutine dense_stages

    !> Refuse the step if its dense output is not accurate enough. A step at the limit of stability leaves a remainder of the
    !> quickly relaxing part, which is harmless at its end, but is magnified by the extra stages of DOP853.
    subroutine judge_dense()
      real(wp) :: error

      if (self%method%errors < 2) return
      error = error_size(self%method%dense_error, self%velocity_y)/(dense_allowance*tolerance())
      outcome%error = max(outcome%error, error)
      outcome%factor = min(outcome%factor, factor_for(error, dense_order))
    end subroutine judge_dense

    !> Node values of the dense output.
    subroutine set_nodal()
      real(wp) :: change(n_values)
      integer :: i

      do i = 0, self%grid%degree
        change = self%step*combined(self%dense_weight(1:self%method%all_stages, i))
        self%nodal(i, column_u:column_u + max_components - 1) = from%u + change(1:max_components)
        self%nodal(i, column_y:column_y + max_unknowns - 1) = from%y + change(first_y:)
        self%nodal(i, column_position) = from%position - dot_product(system%advance_by_slip, change(1:max_components)) &
          + system%advance_by_drive*drive%displacement(from%time, self%grid%node(i)*self%step)
      end do
    end subroutine set_nodal

    !> Refuse the step if it has missed a peak of friction where the slip turns back.
    subroutine judge_turns()
      real(wp) :: allowed(max_components), error

      allowed = turn_allowance*tolerance()
      error = self%error_of_turns(system, drive, from, allowed)
      outcome%error = max(outcome%error, error)
      if (error > 1.0_wp) outcome%factor = min(outcome%factor, turn_factor)
    end subroutine judge_turns

    !> Whether steady sliding is unstable and no disturbance is visible: an explicit method cannot resolve any below its tolerance.
    subroutine look_for_growth()
      !> Share of the drive's velocity up to which the motion may be steady sliding. Convention.
      real(wp), parameter :: close = 0.01_wp
      real(wp) :: coefficient(0:system%components + system%unknowns), weakening, longest, growth, velocity

      self%unseen_growth = 0.0_wp
      self%emerged = .false.
      velocity = drive%velocity_at(from%time)
      associate (first => system%axis, last => system%axis + system%components - 1)
        if (any(abs(self%history%slope(first:last, 1) + velocity*system%drive_coupling(first:last)) > close*abs(velocity))) &
          return
        call system%decay_polynomial(from%y(1:system%unknowns), velocity, coefficient, weakening)
        call follow_instability(coefficient, self%method%order, 1.0_wp, longest, growth)
      end associate
      if (growth > 0.0_wp) call self%look_at_growth(drive, from, growth, &
        self%is_disturbed(system, drive, from, self%noise_floor, self%noise_floor))
    end subroutine look_for_growth
  end subroutine attempt

  pure logical function all_equal(a, b)
    real(wp), intent(in) :: a(:), b(:)

    all_equal = .not. any(abs(a - b) > 0.0_wp)
  end function all_equal

  !> An upper bound of the fastest rate [1/s] of the linearised motion.
  pure real(wp) function fastest_rate(n, m, terms, velocity_y) result(rate)
    integer, intent(in) :: n, m
    type(stage_terms_t), intent(in) :: terms
    real(wp), intent(in) :: velocity_y(n, m)
    real(wp) :: relaxation, elasticity
    integer :: k

    associate (g => terms%force_y, b => terms%inertia)
      relaxation = 0.0_wp
      elasticity = 0.0_wp
      do k = 1, m
        relaxation = max(relaxation, abs(g(1, k, k))/b(1, k))
        elasticity = elasticity + dot_product(terms%force_u(1, k, :), velocity_y(:, k))/b(1, k)
      end do
      if (m > 1) relaxation = relaxation + sqrt(abs(g(1, 1, 2)*g(1, 2, 1))/(b(1, 1)*b(1, 2)))
    end associate
    rate = max(relaxation, sqrt(abs(elasticity)))
  end function fastest_rate

  pure subroutine accept(self)
    class(runge_kutta_t), intent(inout) :: self

    call self%note_speed()
    call self%note_growth()
    call self%history%control%accept(self%step)
  end subroutine accept

  !> y' at the end of the last attempt.
  pure function end_rate(self) result(rate)
    class(runge_kutta_t), intent(in) :: self
    real(wp) :: rate(max_unknowns)

    rate = self%history%slope(first_y:n_values, self%method%stages + 1)
  end function end_rate

  !> Save or load. Terms and dw/dy are scratch: each attempt computes them again.
  subroutine serialise(self, archive)
    class(runge_kutta_t), intent(inout), target :: self
    type(archive_t), intent(inout) :: archive

    call serialise_stepper(self, archive)
    call archive%serialise(c_loc(self%history), storage_size(self%history))
  end subroutine serialise
end module dst_runge_kutta
